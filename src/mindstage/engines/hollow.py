"""Hollow: a box with room inside, made of plates.

A map says that milk is in the fridge and where; it does not say that a fridge has walls and shelves. What stands in a
box must stand on something, so the box gets a floor at each height on which its contents stand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mindstage.world import Vector
from mindstage.world.boxes import OrientedBoxes
from mindstage.world.geometry import Array

__all__ = ["HollowBox", "WallPanel", "hollow_box"]

_WALL_THICKNESS_M = 0.015
_MIN_THICKNESS_M = 0.001
_CLEARANCE_M = 0.0005
"""Between a wall and what stands next to it."""
_FEW = 8
"""So many contents are compared faster in plain numbers than in arrays."""
_SAME_LEVEL_M = 0.004
"""Contents whose undersides differ by less stand on one level."""
_SIDE_NAMES = ("to the back", "to the front", "to the right", "to the left", "to the bottom", "to the top")
"""Of the body's own axes: x backwards and forwards, y, z."""


@dataclass(frozen=True, slots=True)
class WallPanel:
    """A solid part, parallel to the hollow body's axes."""

    center: Vector
    """In the body's frame [m]."""
    size: Vector
    """[m]."""


@dataclass(frozen=True, slots=True)
class HollowBox:
    """What became of the box."""

    panels: tuple[WallPanel, ...]
    opening: str
    """Where one reaches in, in words."""


def hollow_box(boxes: OrientedBoxes, outer: int, inner: Sequence[int], fronts: Sequence[Array]) -> HollowBox:
    """Walls, an opening and floors for a box with contents.

    Args:
        boxes: all boxes there are.
        outer: the one to be made hollow.
        inner: those inside.
        fronts: centers, in the world, of what closes it (doors): each opens the side that it is nearest to.
            Without any, the top is open.
    """
    half, turn = boxes.half_extents[outer], boxes.rotation[outer]
    low, high = _extents(boxes, outer, inner)
    up = turn[2].tolist()
    vertical = max(range(3), key=lambda axis: abs(up[axis]))
    top = 2 * vertical + (1 if up[vertical] > 0 else 0)
    sides = {_side_towards((front - boxes.center[outer]) @ turn, half) for front in fronts} - {top ^ 1}
    opening = sides or {top}
    room = _interior(half, low, high)
    reach: list[float] = half.tolist()
    plates = [
        _panel(reach, side // 2, *_wall_range(side, reach, room))
        for side in range(6)
        if side not in opening and side // 2 != vertical
    ]
    if top not in opening:
        plates.append(_panel(reach, vertical, *_wall_range(top, reach, room)))
    plates += _floors(reach, vertical, up[vertical] > 0, low, high)
    words = " and ".join(_SIDE_NAMES[side] for side in sorted(opening))
    return HollowBox(tuple(plate for plate in plates if min(plate.size) > 0.0), words)


def _extents(boxes: OrientedBoxes, outer: int, inner: Sequence[int]) -> tuple[Array, Array]:
    """Lower and upper corners of the inner boxes, each n x 3, in the frame of the outer one."""
    turn, inside = boxes.rotation[outer], list(inner)
    center = (boxes.center[inside] - boxes.center[outer]) @ turn
    reach = (np.abs(turn.T @ boxes.rotation[inside]) @ boxes.half_extents[inside][:, :, None])[:, :, 0]
    return center - reach, center + reach


def _side_towards(point: Array, half: Array) -> int:
    """The side of the box that a point is farthest out of: 0 is x backwards, 1 x forwards, and so on for y and z."""
    place: list[float] = point.tolist()
    out = [abs(along) - extent for along, extent in zip(place, half.tolist(), strict=True)]
    axis = max(range(3), key=out.__getitem__)
    return 2 * axis + int(place[axis] > 0)


def _interior(half: Array, low: Array, high: Array) -> tuple[list[float], list[float]]:
    """The room between the walls: as wide as the contents need, no wall thicker than usual."""
    usual = [extent - min(_WALL_THICKNESS_M, extent / 5) for extent in half.tolist()]
    start = [min(-each, first - _CLEARANCE_M) for each, first in zip(usual, low.min(axis=0).tolist(), strict=True)]
    end = [max(each, last + _CLEARANCE_M) for each, last in zip(usual, high.max(axis=0).tolist(), strict=True)]
    return start, end


def _wall_range(side: int, half: list[float], room: tuple[list[float], list[float]]) -> tuple[float, float]:
    """From where to where a wall goes along its own axis; the two are equal where there is no room for one."""
    axis = side // 2
    if side % 2:
        start, end = room[1][axis], half[axis]
    else:
        start, end = -half[axis], room[0][axis]
    return (start, end) if end - start >= _MIN_THICKNESS_M else (start, start)


def _floors(half: list[float], vertical: int, upright: bool, low: Array, high: Array) -> list[WallPanel]:
    """A plate under each level of contents that does not stand on other contents."""
    flat = [axis for axis in range(3) if axis != vertical]
    bottoms = (low if upright else -high)[:, vertical]
    tops = (high if upright else -low)[:, vertical]
    bottom = -half[vertical]
    lowest = bottoms.tolist()
    if 1 < len(lowest) <= _FEW:
        firsts, lasts, highest = low.tolist(), high.tolist(), tops.tolist()
        lowest = [
            level
            for one, level in enumerate(lowest)
            if not any(
                other != one
                and abs(top - level) < _SAME_LEVEL_M
                and all(
                    firsts[one][axis] < lasts[other][axis] and firsts[other][axis] < lasts[one][axis] for axis in flat
                )
                for other, top in enumerate(highest)
            )
        ]
    elif len(lowest) > _FEW:
        beneath = np.abs(tops - bottoms[:, None]) < _SAME_LEVEL_M
        beside = np.all((low[:, flat] < high[:, None, flat]) & (low[:, None, flat] < high[:, flat]), axis=2)
        stacked = np.any(beneath & beside & ~np.eye(len(low), dtype=bool), axis=1)
        lowest = bottoms[~stacked].tolist()
    levels: list[float] = []
    for level in sorted(lowest):
        if not (levels and level - levels[-1] < _SAME_LEVEL_M):
            levels.append(level)
    floors = []
    for level in levels:
        ceiling_below = max([bottom, *(top for top in tops.tolist() if top <= level + _SAME_LEVEL_M)])
        start = bottom if level == levels[0] else max(level - _WALL_THICKNESS_M, ceiling_below + _CLEARANCE_M)
        if level - start >= _MIN_THICKNESS_M:
            floors.append(_panel(half, vertical, *((start, level) if upright else (-level, -start))))
    return floors


def _panel(half: list[float], axis: int, start: float, end: float) -> WallPanel:
    """A plate across the whole box, between two places along one axis."""
    center, size = [0.0, 0.0, 0.0], [2 * extent for extent in half]
    center[axis], size[axis] = (start + end) / 2, end - start
    return WallPanel((center[0], center[1], center[2]), (size[0], size[1], size[2]))
