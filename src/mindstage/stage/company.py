"""Company: who takes part in a stage's life from elsewhere, such as a robot's programs over ROS.

Whoever lets others in introduces them once, by a function that says who is there; nothing has to be kept up to date.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import msgspec

__all__ = ["Company", "Guest"]


class Guest(msgspec.Struct, frozen=True, kw_only=True):
    """One who is connected."""

    name: str
    transport: str
    """By which way, in a word or two: "ROS"."""
    activity: str = ""
    """What it does here, in a few words."""


class Company:
    """All who are there; calls may come from any thread."""

    def __init__(self) -> None:
        self._tellers: tuple[Callable[[], Iterable[Guest]], ...] = ()
        self._watchers: tuple[Callable[[], None], ...] = ()

    def introduce(self, who: Callable[[], Iterable[Guest]]) -> Callable[[], None]:
        """Lets a function tell who is there, from any thread; returns what takes it away again."""
        self._tellers = (*self._tellers, who)

        def farewell() -> None:
            self._tellers = tuple(each for each in self._tellers if each is not who)

        return farewell

    def guests(self) -> tuple[Guest, ...]:
        """Who is there now."""
        return tuple(guest for tell in self._tellers for guest in tell())

    def watch(self, react: Callable[[], None]) -> Callable[[], None]:
        """Calls a function after each edit, when the frame tells of it; returns what ends that.

        It is called in the stage's thread, and must return at once.
        """
        self._watchers = (*self._watchers, react)

        def farewell() -> None:
            self._watchers = tuple(each for each in self._watchers if each is not react)

        return farewell

    def tell_of_edit(self) -> None:
        """Tells all who watch that bodies, materials or lights came, went or changed."""
        for react in self._watchers:
            react()
