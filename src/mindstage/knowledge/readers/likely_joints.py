"""Likely joints: where a door turns and which way a drawer slides, where the map says only that they do.

What is decided comes from where things stand. A drawer comes out on the side that its handle is on. A door turns about
the edge farthest from its handle, and opens away from what it closes. What there is no sign of is taken as in most
kitchens: doors turn about their upright edge on the left, drawers come out along their x axis, which points forward.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mindstage.knowledge.readers.joint_frames import Range
from mindstage.world import Pose, Vector
from mindstage.world.geometry import Array, rotate, unit_pose

__all__ = ["Box", "Likely", "likely_hinge", "likely_slide"]

_OFF = 0.05
"""What is off the middle by less than this part of half the extent is in the middle."""
_EXTENT_M = 0.1
"""Of what has no size."""


class Box(NamedTuple):
    """Where something stands, and how large it is."""

    pose: Pose
    size: Vector | None

    @property
    def centre(self) -> Array:
        """In the world [m]."""
        return np.array(self.pose.position)

    @property
    def half(self) -> Array:
        """Half the extents along its own axes [m], never 0."""
        return np.maximum(self.size or (_EXTENT_M,) * 3, 1e-3) / 2

    def axis(self, number: int) -> Array:
        """One of its axes, in the world."""
        return rotate(unit_pose(self.pose)[3:], np.eye(3)[number])

    def seen(self, other: Box) -> Array:
        """Another box's centre along its own axes [m]."""
        away = other.centre - self.centre
        return np.array([float(away @ self.axis(number)) for number in range(3)])


class Likely(NamedTuple):
    """An axis, and what speaks for it."""

    origin: Array
    axis: Array
    evidence: str


def likely_slide(parent: Box, child: Box, handle: Box | None) -> Likely:
    """The way along which a child comes out of its parent.

    Args:
        parent: what it comes out of.
        child: what comes out.
        handle: what it is pulled by.
    """
    for base, other, evidence in ((child, handle, "its handle is on that side"), (parent, child, "it is on that side")):
        if other is None:
            continue
        off = base.seen(other) / base.half
        number = int(np.argmax(np.abs(off)))
        if abs(off[number]) > _OFF:
            return Likely(child.centre, np.sign(off[number]) * base.axis(number), evidence)
    return Likely(child.centre, child.axis(0), "nothing tells another way than forward")


def likely_hinge(
    parent: Box,
    child: Box,
    handle: Box | None,
    range: Range,
    *,
    origin: Array | None = None,
    radius: float | None = None,
) -> Likely:
    """The line about which a child turns; turning it on, where the range is wider, takes it away from its parent.

    Args:
        parent: what it closes.
        child: what turns.
        handle: what it is pulled by.
        range: how far it turns.
        origin: a point on the line, where that is known.
        radius: how far from the line the handle is, where that is known [m].
    """
    thin = int(np.argmin(child.half))
    plane = [number for number in (2, 1, 0) if number != thin]  # where nothing tells, the edge to the side counts
    out = child.axis(thin)
    if (child.centre - parent.centre) @ out < 0.0:
        out = -out
    if origin is not None:
        off = np.array([float((child.centre - origin) @ child.axis(number)) for number in (0, 1, 2)])
        evidence = "its place is told"
    else:
        off = child.seen(handle) if handle is not None else np.zeros(3)
        evidence = "its handle is on the other side"
    share = np.abs(off / child.half)
    side = max(plane, key=lambda number: float(share[number]))
    if share[side] <= _OFF:
        side = next(number for number in (1, 0, 2) if number != thin)
        towards, evidence = _right_of(out, child.axis(side)), "nothing tells another edge than the left one"
    else:
        towards = np.sign(off[side]) * child.axis(side)
    along = next(number for number in plane if number != side)
    if origin is None:
        far = (
            child.half[side]
            if radius is None or handle is None
            else radius - float(child.seen(handle) @ _row(child, towards))
        )
        origin = child.centre - far * towards
    axis = child.axis(along)
    opens = float(np.cross(axis, towards) @ out)
    if range is not None and abs(range[0]) > abs(range[1]):
        opens = -opens
    return Likely(origin, axis if opens >= 0.0 else -axis, evidence)


def _right_of(out: Array, side: Array) -> Array:
    """The way along a side that is on the right of whoever stands in front."""
    right = np.cross(np.array([0.0, 0.0, 1.0]), out)
    return side if side @ right >= 0.0 else -side


def _row(box: Box, direction: Array) -> Array:
    """A direction of the world along a box's own axes."""
    return np.array([float(direction @ box.axis(number)) for number in range(3)])
