"""Company: who takes part in a stage's life from elsewhere, such as a robot's programs over ROS.

Whoever lets others in introduces them once, by a function that says who is there; nothing has to be kept up to date.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import msgspec

__all__ = ["ClientDirectory", "ConnectedClient"]


class ConnectedClient(msgspec.Struct, frozen=True, kw_only=True):
    """One who is connected."""

    name: str
    transport: str
    """By which way, in a word or two: "ROS"."""
    activity: str = ""
    """What it does here, in a few words."""


class ClientDirectory:
    """All who are there; calls may come from any thread."""

    def __init__(self) -> None:
        self._sources: tuple[Callable[[], Iterable[ConnectedClient]], ...] = ()
        self._edit_callbacks: tuple[Callable[[], None], ...] = ()

    def add_client_source(self, source: Callable[[], Iterable[ConnectedClient]]) -> Callable[[], None]:
        """Lets a function tell who is there, from any thread; returns what takes it away again."""
        self._sources = (*self._sources, source)

        def farewell() -> None:
            self._sources = tuple(each for each in self._sources if each is not source)

        return farewell

    def clients(self) -> tuple[ConnectedClient, ...]:
        """Who is there now."""
        return tuple(guest for tell in self._sources for guest in tell())

    def on_edit(self, callback: Callable[[], None]) -> Callable[[], None]:
        """Calls a function after each edit, when the frame tells of it; returns what ends that.

        It is called in the stage's thread, and must return at once.
        """
        self._edit_callbacks = (*self._edit_callbacks, callback)

        def farewell() -> None:
            self._edit_callbacks = tuple(each for each in self._edit_callbacks if each is not callback)

        return farewell

    def notify_edit(self) -> None:
        """Tells all who watch that bodies, materials or lights came, went or changed."""
        for react in self._edit_callbacks:
            react()
