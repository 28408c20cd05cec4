"""Numbers: what was typed about how maps mean theirs, sorted by map."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from enum import Enum

    from mindstage.knowledge import Conventions

__all__ = ["AS_THE_MAP_HAS_THEM", "Numbers"]


class Numbers(NamedTuple):
    """The options `--units`, `--frame` and `--quaternion`, each as often as it was given."""

    units: Sequence[str] | None = None
    frame: Sequence[str] | None = None
    quaternion: Sequence[str] | None = None

    def by_map(self, maps: Sequence[str]) -> list[Conventions]:
        """For each map, what was said of it; what was said of all maps counts where nothing was said of the one.

        Raises:
            ArgumentRefused: there are no such units, or no such map.
        """
        from mindstage.knowledge import Conventions, Frame, QuaternionOrder, Units

        units = _by_map("--units", self.units, maps, Units)
        frames = _by_map("--frame", self.frame, maps, Frame)
        orders = _by_map("--quaternion", self.quaternion, maps, QuaternionOrder)
        return [
            Conventions(units=unit, frame=frame, quaternion=order)  # type: ignore[arg-type]
            for unit, frame, order in zip(units, frames, orders, strict=True)
        ]


AS_THE_MAP_HAS_THEM = Numbers()


def _by_map(option: str, told: Sequence[str] | None, maps: Sequence[str], kind: type[Enum]) -> list[Enum | None]:
    from mindstage.errors import ArgumentRefused

    choices = {str(choice.value): choice for choice in kind}
    known = {name: at for at, map in enumerate(maps) for name in (map, Path(map).name, Path(map).stem)}
    found: list[Enum | None] = [None] * len(maps)
    for text in sorted(told or (), key=lambda text: "=" in text):  # what is said of one map comes after, and counts
        map, equals, value = text.rpartition("=")
        if value.lower() not in choices:
            raise ArgumentRefused(f"{option} {text}", cause=f"{value!r} is none of them", remedy=f"use {_any(choices)}")
        if equals and map not in known:
            raise ArgumentRefused(f"{option} {text}", cause=f"no map {map!r} is loaded", remedy=f"use {_any(known)}")
        for at in [known[map]] if equals else range(len(maps)):
            found[at] = choices[value.lower()]
    return found


def _any(names: Iterable[str]) -> str:
    return ", ".join(names)
