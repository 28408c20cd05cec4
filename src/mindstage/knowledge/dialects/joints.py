"""Likely joints: where a door turns and which way a drawer slides, where the map says only that they do.

What is decided comes from where things stand. A drawer comes out on the side that its handle is on. A door turns about
the edge farthest from its handle, and opens away from what it closes. What there is no sign of is taken as in most
kitchens: doors turn about their upright edge on the left, drawers come out along their x axis, which points forward.

Joint frames: from an axis and a range, as other dialects tell joints, to the frame and motions of a constraint.

The frame's x lies along the axis. A range from `lower` to `upper` has its middle between the two and its limit at half
of their distance, so that middle - limit is `lower` again and middle + limit `upper`.
"""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple

import msgspec
import numpy as np

from mindstage.scene import AngularLimits, AxisMotion, LinearLimits, Pose, SoftLimit, Vector
from mindstage.scene.transforms import Array, normalized_pose_array, pose_from_array, quat_rotate

__all__ = [
    "InferredAxis",
    "JointLimits",
    "JointRange",
    "JointType",
    "ObservedBox",
    "center_and_half_range",
    "infer_hinge_axis",
    "infer_prismatic_axis",
    "joint_from_axis",
    "to_vector",
]


class JointType(StrEnum):
    """What a joint lets its child do."""

    REVOLUTE = "hinge"
    PRISMATIC = "slide"
    FIXED = "fixed"
    FLOATING = "floating"
    PLANAR = "planar"
    """Slide and turn in the plane that its axis stands on."""


JointRange = tuple[float, float] | None
"""From where to where, seen from the pose as spawned [m or rad]; None for no end."""


class JointLimits(msgspec.Struct, frozen=True):
    """What a constraint needs beyond its two ends."""

    pose: Pose
    linear: LinearLimits
    angular: AngularLimits

    @property
    def is_movable(self) -> bool:
        """Whether it lets anything happen."""
        linear, angular = self.linear, self.angular
        axes = (linear.x, linear.y, linear.z, angular.twist, angular.swing1, angular.swing2)
        return any(axis is not AxisMotion.LOCKED for axis in axes)


def center_and_half_range(lower: float, upper: float) -> tuple[float, float]:
    """The middle of a range and how far it goes either way."""
    return (lower + upper) / 2, (upper - lower) / 2


def joint_from_axis(
    joint_type: JointType, origin: Array, axis: Array, range: JointRange, *, damping: float = 0.0
) -> JointLimits:
    """A joint at a place in the world.

    Args:
        kind: what it lets happen.
        origin: a point on its axis [m].
        axis: its direction; any length but 0.
        range: of a hinge or a slide; its lower end comes first.
        damping: of its motion [Ns/m or Nms/rad].
    """
    pose = pose_from_array(np.concatenate([origin, _rotation_from_x(axis / np.linalg.norm(axis))]))
    linear, angular = LinearLimits(), AngularLimits()
    motion = AxisMotion.FREE if range is None else AxisMotion.LIMITED
    middle, limit = (0.0, 0.0) if range is None else center_and_half_range(*range)
    soft = SoftLimit(damping=damping)
    free = AxisMotion.FREE
    if joint_type is JointType.PRISMATIC:
        linear = LinearLimits(x=motion, limit=limit, x_middle=middle, soft_limit=soft)
    elif joint_type is JointType.REVOLUTE:
        angular = AngularLimits(twist=motion, twist_limit=limit, twist_middle=middle, twist_soft_limit=soft)
    elif joint_type is JointType.PLANAR:
        linear, angular = LinearLimits(y=free, z=free), AngularLimits(twist=free)
    elif joint_type is JointType.FLOATING:
        linear, angular = LinearLimits(x=free, y=free, z=free), AngularLimits(swing1=free, swing2=free, twist=free)
    return JointLimits(pose, linear, angular)


def _rotation_from_x(axis: Array) -> Array:
    """The shortest rotation that takes x to an axis; about z where that is the way back."""
    x, y, z = (float(part) for part in axis)
    if x < -1.0 + 1e-12:
        return np.array([0.0, 0.0, 0.0, 1.0])
    quaternion = np.array([1.0 + x, 0.0, -z, y])
    return np.asarray(quaternion / np.linalg.norm(quaternion))


def to_vector(row: Array) -> Vector:
    """Three numbers of an array."""
    x, y, z = (float(part) for part in row)
    return x, y, z


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
