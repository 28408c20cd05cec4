"""Insides: how thick walls may be, where shelves are and what must be left free, by what stands in a thing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mindstage.shapes.fitting.setting import Around, Setting
from mindstage.shapes.sides import Gap, Side
from mindstage.world.boxes import Indices
from mindstage.world.geometry import Array

__all__ = ["Inside", "inside_of", "let_in", "levels_in", "openings_in"]

_CLEARANCE_M = 0.0005
"""Between a wall and what is next to it."""
_THINNEST_M = 0.0005
_LEVEL_M = 0.004
"""Contents whose undersides differ by less stand on one level."""
_LET_IN_M = 0.002
"""What stands in something by no more only touches it."""
_LARGEST_SHARE = 0.5
"""Of the volume of what it is in, nothing loose is larger."""


class Inside:
    """What is inside one body, in its own frame."""

    def __init__(self, rows: Indices, low: Array, high: Array, loose: NDArray[np.bool_], half: Array) -> None:
        self.rows = rows
        self.low, self.high = low, high
        self.loose = loose
        self.half = half

    def wall(self, side: Side, usual: float) -> float:
        """How thick the wall at one side may be [m], at most the usual."""
        axis = side.axis
        reach = self.high[:, axis] if side.sign > 0 else -self.low[:, axis]
        room = float(self.half[axis] - reach.max(initial=-np.inf)) - _CLEARANCE_M
        return float(np.clip(room, min(_THINNEST_M, usual), usual))


def inside_of(setting: Setting, row: int, around: Around) -> Inside:
    """What is in a body: loose things, and what slides or hangs in it."""
    half = setting.boxes.half[row]
    middle = (around.low + around.high) / 2
    within = np.all(np.abs(middle) < half, axis=1)
    loose = within & setting.loose[around.rows] & (setting.volume[around.rows] < _LARGEST_SHARE * setting.volume[row])
    held = within & ~setting.loose[around.rows] & np.all((around.low > -half) & (around.high < half), axis=1)
    kept = loose | held
    return Inside(around.rows[kept], around.low[kept], around.high[kept], loose[kept], half)


def levels_in(inside: Inside, up: Side) -> tuple[float, ...]:
    """Where contents stand, upwards from the middle [m], the lowest first; what is on other contents tells nothing."""
    low, high = inside.low[inside.loose], inside.high[inside.loose]
    if not len(low):
        return ()
    axis = up.axis
    flat = [each for each in range(3) if each != axis]
    bottoms, tops = (low[:, axis], high[:, axis]) if up.sign > 0 else (-high[:, axis], -low[:, axis])
    beneath = np.abs(tops - bottoms[:, None]) < _LEVEL_M
    beside = np.all((low[:, flat] < high[:, None, flat]) & (low[:, None, flat] < high[:, flat]), axis=2)
    stacked = np.any(beneath & beside & ~np.eye(len(low), dtype=bool), axis=1)
    levels: list[float] = []
    for level in sorted(bottoms[~stacked].tolist()):
        if not (levels and level - levels[-1] < _LEVEL_M):
            levels.append(level)
    return tuple(levels)


def let_in(setting: Setting, row: int, around: Around, up: Side, kinds: NDArray[np.bool_]) -> tuple[Gap, ...]:
    """What must be left free for sinks and the like that are let into the top of a body."""
    half = setting.boxes.half[row]
    axis = up.axis
    flat = [each for each in range(3) if each != axis]
    bottom, top = (around.low, around.high) if up.sign > 0 else (-around.high, -around.low)
    through = (bottom[:, axis] < half[axis] - _LET_IN_M) & (top[:, axis] > half[axis] - _LET_IN_M)
    framed = np.all((around.low[:, flat] > -half[flat]) & (around.high[:, flat] < half[flat]), axis=1)
    return _gaps(around, kinds[around.rows] & through & framed)


def openings_in(
    setting: Setting, row: int, around: Around, kinds: NDArray[np.bool_], *, ways: bool = False
) -> tuple[Gap, ...]:
    """What a wall must leave free for what stands in it.

    Args:
        setting: the place.
        row: the wall.
        around: what is near it.
        kinds: for each body, whether it may stand in a wall.
        ways: whether the ways on which it moves are left free as well.
    """
    half = setting.boxes.half[row]
    chosen = kinds[around.rows] & np.all((around.low < half) & (around.high > -half), axis=1)
    if not ways:
        return _gaps(around, chosen)
    low, high = around.low.copy(), around.high.copy()
    for at in np.flatnonzero(chosen).tolist():
        low[at], high[at] = setting.swept(int(around.rows[at]), low[at], high[at], row)
    return _gaps(Around(around.rows, low, high), chosen)


def _gaps(around: Around, chosen: NDArray[np.bool_]) -> tuple[Gap, ...]:
    low = around.low[chosen] - _CLEARANCE_M
    high = around.high[chosen] + _CLEARANCE_M
    return tuple(
        Gap(low=(a[0], a[1], a[2]), high=(b[0], b[1], b[2])) for a, b in zip(low.tolist(), high.tolist(), strict=True)
    )
