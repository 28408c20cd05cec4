"""Likely joints: where a door turns and which way a drawer slides, where the map says only that they do.

What is decided comes from where things stand. A drawer comes out on the side that its handle is on. A door turns about
the edge farthest from its handle, and opens away from what it closes. What there is no sign of is taken as in most
kitchens: doors turn about their upright edge on the left, drawers come out along their x axis, which points forward.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mindstage.knowledge.readers.joint_frames import JointRange
from mindstage.world import Pose, Vector
from mindstage.world.geometry import Array, normalized_pose_array, quat_rotate

__all__ = ["InferredAxis", "ObservedBox", "infer_hinge_axis", "infer_prismatic_axis"]

_OFFSET_TOLERANCE = 0.05
"""What is off the middle by less than this part of half the extent is in the middle."""
_DEFAULT_EXTENT_M = 0.1
"""Of what has no size."""


class ObservedBox(NamedTuple):
    """Where something stands, and how large it is."""

    pose: Pose
    size: Vector | None

    @property
    def center(self) -> Array:
        """In the world [m]."""
        return np.array(self.pose.position)

    @property
    def half_extents(self) -> Array:
        """Half the extents along its own axes [m], never 0."""
        return np.maximum(self.size or (_DEFAULT_EXTENT_M,) * 3, 1e-3) / 2

    def axis(self, number: int) -> Array:
        """One of its axes, in the world."""
        return quat_rotate(normalized_pose_array(self.pose)[3:], np.eye(3)[number])

    def local_center_of(self, other: ObservedBox) -> Array:
        """Another box's center along its own axes [m]."""
        away = other.center - self.center
        return np.array([float(away @ self.axis(number)) for number in range(3)])


class InferredAxis(NamedTuple):
    """An axis, and what speaks for it."""

    origin: Array
    axis: Array
    evidence: str


def infer_prismatic_axis(parent: ObservedBox, child: ObservedBox, handle: ObservedBox | None) -> InferredAxis:
    """The way along which a child comes out of its parent.

    Args:
        parent: what it comes out of.
        child: what comes out.
        handle: what it is pulled by.
    """
    for base, other, evidence in ((child, handle, "its handle is on that side"), (parent, child, "it is on that side")):
        if other is None:
            continue
        off = base.local_center_of(other) / base.half_extents
        number = int(np.argmax(np.abs(off)))
        if abs(off[number]) > _OFFSET_TOLERANCE:
            return InferredAxis(child.center, np.sign(off[number]) * base.axis(number), evidence)
    return InferredAxis(child.center, child.axis(0), "nothing tells another way than forward")


def infer_hinge_axis(
    parent: ObservedBox,
    child: ObservedBox,
    handle: ObservedBox | None,
    range: JointRange,
    *,
    origin: Array | None = None,
    radius: float | None = None,
) -> InferredAxis:
    """The line about which a child turns; turning it on, where the range is wider, takes it away from its parent.

    Args:
        parent: what it closes.
        child: what turns.
        handle: what it is pulled by.
        range: how far it turns.
        origin: a point on the line, where that is known.
        radius: how far from the line the handle is, where that is known [m].
    """
    thin = int(np.argmin(child.half_extents))
    plane = [number for number in (2, 1, 0) if number != thin]  # where nothing tells, the edge to the side counts
    out = child.axis(thin)
    if (child.center - parent.center) @ out < 0.0:
        out = -out
    if origin is not None:
        off = np.array([float((child.center - origin) @ child.axis(number)) for number in (0, 1, 2)])
        evidence = "its place is told"
    else:
        off = child.local_center_of(handle) if handle is not None else np.zeros(3)
        evidence = "its handle is on the other side"
    share = np.abs(off / child.half_extents)
    side = max(plane, key=lambda number: float(share[number]))
    if share[side] <= _OFFSET_TOLERANCE:
        side = next(number for number in (1, 0, 2) if number != thin)
        towards, evidence = _right_hand_direction(out, child.axis(side)), "nothing tells another edge than the left one"
    else:
        towards = np.sign(off[side]) * child.axis(side)
    along = next(number for number in plane if number != side)
    if origin is None:
        far = (
            child.half_extents[side]
            if radius is None or handle is None
            else radius - float(child.local_center_of(handle) @ _to_box_frame(child, towards))
        )
        origin = child.center - far * towards
    axis = child.axis(along)
    opens = float(np.cross(axis, towards) @ out)
    if range is not None and abs(range[0]) > abs(range[1]):
        opens = -opens
    return InferredAxis(origin, axis if opens >= 0.0 else -axis, evidence)


def _right_hand_direction(outward: Array, side: Array) -> Array:
    """The way along a side that is on the right of whoever stands in front."""
    right = np.cross(np.array([0.0, 0.0, 1.0]), outward)
    return side if side @ right >= 0.0 else -side


def _to_box_frame(box: ObservedBox, direction: Array) -> Array:
    """A direction of the world along a box's own axes."""
    return np.array([float(direction @ box.axis(number)) for number in range(3)])
