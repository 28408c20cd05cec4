"""Insides: how thick walls may be, where shelves are and what must be left free, by what stands in a thing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mindstage.shapes.fitting.setting import Neighborhood, SceneContext
from mindstage.shapes.sides import BodySide, Cutout
from mindstage.world.boxes import Indices
from mindstage.world.geometry import Array

__all__ = ["Cavity", "cavity_of", "shelf_heights", "wall_openings", "worktop_cutouts"]

_CLEARANCE_M = 0.0005
"""Between a wall and what is next to it."""
_MIN_WALL_M = 0.0005
_SAME_LEVEL_M = 0.004
"""Contents whose undersides differ by less stand on one level."""
_MIN_INSERT_DEPTH_M = 0.002
"""What stands in something by no more only touches it."""
_MAX_CONTENT_FRACTION = 0.5
"""Of the volume of what it is in, nothing loose is larger."""


class Cavity:
    """What is inside one body, in its own frame."""

    def __init__(self, rows: Indices, low: Array, high: Array, is_free: NDArray[np.bool_], half: Array) -> None:
        self.rows = rows
        self.low, self.high = low, high
        self.is_free = is_free
        self.half = half

    def wall_thickness(self, side: BodySide, default: float) -> float:
        """How thick the wall at one side may be [m], at most the usual."""
        axis = side.axis
        reach = self.high[:, axis] if side.sign > 0 else -self.low[:, axis]
        room = float(self.half[axis] - reach.max(initial=-np.inf)) - _CLEARANCE_M
        return float(np.clip(room, min(_MIN_WALL_M, default), default))


def cavity_of(context: SceneContext, row: int, neighborhood: Neighborhood) -> Cavity:
    """What is in a body: loose things, and what slides or hangs in it."""
    half = context.boxes.half_extents[row]
    middle = (neighborhood.low + neighborhood.high) / 2
    within = np.all(np.abs(middle) < half, axis=1)
    loose = (
        within
        & context.is_free[neighborhood.rows]
        & (context.volume[neighborhood.rows] < _MAX_CONTENT_FRACTION * context.volume[row])
    )
    held = (
        within
        & ~context.is_free[neighborhood.rows]
        & np.all((neighborhood.low > -half) & (neighborhood.high < half), axis=1)
    )
    kept = loose | held
    return Cavity(neighborhood.rows[kept], neighborhood.low[kept], neighborhood.high[kept], loose[kept], half)


def shelf_heights(cavity: Cavity, up: BodySide) -> tuple[float, ...]:
    """Where contents stand, upwards from the middle [m], the lowest first; what is on other contents tells nothing."""
    low, high = cavity.low[cavity.is_free], cavity.high[cavity.is_free]
    if not len(low):
        return ()
    axis = up.axis
    flat = [each for each in range(3) if each != axis]
    bottoms, tops = (low[:, axis], high[:, axis]) if up.sign > 0 else (-high[:, axis], -low[:, axis])
    beneath = np.abs(tops - bottoms[:, None]) < _SAME_LEVEL_M
    beside = np.all((low[:, flat] < high[:, None, flat]) & (low[:, None, flat] < high[:, flat]), axis=2)
    stacked = np.any(beneath & beside & ~np.eye(len(low), dtype=bool), axis=1)
    levels: list[float] = []
    for level in sorted(bottoms[~stacked].tolist()):
        if not (levels and level - levels[-1] < _SAME_LEVEL_M):
            levels.append(level)
    return tuple(levels)


def worktop_cutouts(
    context: SceneContext, row: int, neighborhood: Neighborhood, up: BodySide, insert_mask: NDArray[np.bool_]
) -> tuple[Cutout, ...]:
    """What must be left free for sinks and the like that are let into the top of a body."""
    half = context.boxes.half_extents[row]
    axis = up.axis
    flat = [each for each in range(3) if each != axis]
    bottom, top = (neighborhood.low, neighborhood.high) if up.sign > 0 else (-neighborhood.high, -neighborhood.low)
    through = (bottom[:, axis] < half[axis] - _MIN_INSERT_DEPTH_M) & (top[:, axis] > half[axis] - _MIN_INSERT_DEPTH_M)
    framed = np.all((neighborhood.low[:, flat] > -half[flat]) & (neighborhood.high[:, flat] < half[flat]), axis=1)
    return _cutouts(neighborhood, insert_mask[neighborhood.rows] & through & framed)


def wall_openings(
    context: SceneContext,
    row: int,
    neighborhood: Neighborhood,
    opening_mask: NDArray[np.bool_],
    *,
    include_motion: bool = False,
) -> tuple[Cutout, ...]:
    """What a wall must leave free for what stands in it.

    Args:
        setting: the place.
        row: the wall.
        around: what is near it.
        kinds: for each body, whether it may stand in a wall.
        ways: whether the ways on which it moves are left free as well.
    """
    half = context.boxes.half_extents[row]
    chosen = opening_mask[neighborhood.rows] & np.all((neighborhood.low < half) & (neighborhood.high > -half), axis=1)
    if not include_motion:
        return _cutouts(neighborhood, chosen)
    low, high = neighborhood.low.copy(), neighborhood.high.copy()
    for at in np.flatnonzero(chosen).tolist():
        low[at], high[at] = context.sweep_bounds(int(neighborhood.rows[at]), low[at], high[at], row)
    return _cutouts(Neighborhood(neighborhood.rows, low, high), chosen)


def _cutouts(neighborhood: Neighborhood, chosen: NDArray[np.bool_]) -> tuple[Cutout, ...]:
    low = neighborhood.low[chosen] - _CLEARANCE_M
    high = neighborhood.high[chosen] + _CLEARANCE_M
    return tuple(
        Cutout(low=(a[0], a[1], a[2]), high=(b[0], b[1], b[2]))
        for a, b in zip(low.tolist(), high.tolist(), strict=True)
    )
