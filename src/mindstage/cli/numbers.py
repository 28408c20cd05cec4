"""Numbers: what was typed about how maps mean theirs, sorted by map."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from enum import Enum

    from mindstage.knowledge import UnitConventions

__all__ = ["DEFAULT_CONVENTIONS", "ConventionOptions"]


class ConventionOptions(NamedTuple):
    """The options `--units`, `--frame` and `--guess_quaternion_order`, each as often as it was given."""

    units: Sequence[str] | None = None
    frame: Sequence[str] | None = None
    quaternion: Sequence[str] | None = None

    def by_map(self, maps: Sequence[str]) -> list[UnitConventions]:
        """For each map, what was said of it; what was said of all maps counts where nothing was said of the one.

        Raises:
            InvalidArgumentError: there are no such units, or no such map.
        """
        from mindstage.knowledge import Handedness, LengthUnit, QuaternionOrder, UnitConventions

        units = _by_map("--units", self.units, maps, LengthUnit)
        frames = _by_map("--frame", self.frame, maps, Handedness)
        orders = _by_map("--quaternion", self.quaternion, maps, QuaternionOrder)
        return [
            UnitConventions(units=unit, frame=frame, quaternion=order)  # type: ignore[arg-type]
            for unit, frame, order in zip(units, frames, orders, strict=True)
        ]


DEFAULT_CONVENTIONS = ConventionOptions()


def _by_map(option: str, values: Sequence[str] | None, maps: Sequence[str], kind: type[Enum]) -> list[Enum | None]:
    from mindstage.errors import InvalidArgumentError

    choices = {str(choice.value): choice for choice in kind}
    known = {name: at for at, map in enumerate(maps) for name in (map, Path(map).name, Path(map).stem)}
    found: list[Enum | None] = [None] * len(maps)
    for text in sorted(values or (), key=lambda text: "=" in text):  # what is said of one map comes after, and counts
        map, equals, value = text.rpartition("=")
        if value.lower() not in choices:
            raise InvalidArgumentError(
                f"{option} {text}", cause=f"{value!r} is none of them", remedy=f"use {_choices(choices)}"
            )
        if equals and map not in known:
            raise InvalidArgumentError(
                f"{option} {text}", cause=f"no map {map!r} is loaded", remedy=f"use {_choices(known)}"
            )
        for at in [known[map]] if equals else range(len(maps)):
            found[at] = choices[value.lower()]
    return found


def _choices(names: Iterable[str]) -> str:
    return ", ".join(names)
