"""Joint axes and frames, shared by the dialects that describe a joint by an axis and a range.

A joint frame has its x axis along the joint axis. A range from `lower` to `upper` has its middle halfway and its limit
at half the distance, so that middle - limit is `lower` and middle + limit is `upper`.

Where a map gives no axis, it is inferred from the poses of the bodies: a drawer opens towards its handle; a door turns
about the edge farthest from its handle and opens away from the body that it closes. Without such evidence a door turns
about its left vertical edge and a drawer slides along its x axis, which points forward.
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


JointRange = tuple[float, float] | None
"""Lower and upper limit relative to the initial pose [m or rad]; None for no limits."""
_OFFSET_TOLERANCE = 0.05
"""Offset from the center, as a fraction of the half extent, below which a box counts as centered."""
_DEFAULT_EXTENT_M = 0.1
"""Extent of a body without a size [m]."""


class JointType(StrEnum):
    """The kind of motion that a joint allows."""

    REVOLUTE = "hinge"
    PRISMATIC = "slide"
    FIXED = "fixed"
    FLOATING = "floating"
    PLANAR = "planar"
    """Translation and rotation in the plane perpendicular to its axis."""


class JointLimits(msgspec.Struct, frozen=True):
    """Pose and degrees of freedom of a joint."""

    pose: Pose
    linear: LinearLimits
    angular: AngularLimits

    @property
    def is_movable(self) -> bool:
        """Whether any axis is not locked."""
        linear, angular = self.linear, self.angular
        axes = (linear.x, linear.y, linear.z, angular.twist, angular.swing1, angular.swing2)
        return any(axis is not AxisMotion.LOCKED for axis in axes)


def center_and_half_range(lower: float, upper: float) -> tuple[float, float]:
    """Returns the middle of a range and half its width."""
    return (lower + upper) / 2, (upper - lower) / 2


def joint_from_axis(
    joint_type: JointType, origin: Array, axis: Array, range: JointRange, *, damping: float = 0.0
) -> JointLimits:
    """Creates a joint from a point and an axis in the world frame.

    Args:
        joint_type: the motion that it allows.
        origin: a point on the joint axis [m].
        axis: direction of the axis; any length but 0.
        range: limits of a revolute or prismatic joint, lower one first.
        damping: of the motion [Ns/m or Nms/rad].
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
    """Returns the shortest rotation (w x y z) that maps x to a unit axis; half a turn about z for -x."""
    x, y, z = (float(part) for part in axis)
    if x < -1.0 + 1e-12:
        return np.array([0.0, 0.0, 0.0, 1.0])
    quaternion = np.array([1.0 + x, 0.0, -z, y])
    return np.asarray(quaternion / np.linalg.norm(quaternion))


def to_vector(row: Array) -> Vector:
    """Converts an array of three numbers to a tuple."""
    x, y, z = (float(part) for part in row)
    return x, y, z


class ObservedBox(NamedTuple):
    """Pose and size of a body in the world frame; the size is None if unknown."""

    pose: Pose
    size: Vector | None

    @property
    def center(self) -> Array:
        """Position in the world frame [m]."""
        return np.array(self.pose.position)

    @property
    def half_extents(self) -> Array:
        """Half the extents along the box's own axes [m], never 0."""
        return np.maximum(self.size or (_DEFAULT_EXTENT_M,) * 3, 1e-3) / 2

    def axis(self, number: int) -> Array:
        """Returns the direction of one of the box's axes in the world frame."""
        return quat_rotate(normalized_pose_array(self.pose)[3:], np.eye(3)[number])

    def local_center_of(self, other: ObservedBox) -> Array:
        """Returns the center of another box relative to this one's, along this one's axes [m]."""
        offset = other.center - self.center
        return np.array([float(offset @ self.axis(number)) for number in range(3)])


class InferredAxis(NamedTuple):
    """An axis in the world frame, a point on it, and the evidence for it."""

    origin: Array
    axis: Array
    evidence: str


def infer_prismatic_axis(parent: ObservedBox, child: ObservedBox, handle: ObservedBox | None) -> InferredAxis:
    """Returns the direction in which a child slides out of its parent.

    Args:
        parent: the body that contains the child, such as a cupboard.
        child: the body that slides, such as a drawer.
        handle: the handle of the child, if there is one.
    """
    for base, other, evidence in ((child, handle, "its handle is on that side"), (parent, child, "it is on that side")):
        if other is None:
            continue
        off = base.local_center_of(other) / base.half_extents
        number = int(np.argmax(np.abs(off)))
        if abs(off[number]) > _OFFSET_TOLERANCE:
            return InferredAxis(child.center, np.sign(off[number]) * base.axis(number), evidence)
    return InferredAxis(child.center, child.axis(0), "there is no evidence for another direction than forward")


def infer_hinge_axis(
    parent: ObservedBox,
    child: ObservedBox,
    handle: ObservedBox | None,
    range: JointRange,
    *,
    origin: Array | None = None,
    radius: float | None = None,
) -> InferredAxis:
    """Returns the line that a child turns about; positive rotation opens it if the upper limit is the farther one.

    Args:
        parent: the body that the child closes, such as a cupboard.
        child: the body that turns, such as a door.
        handle: the handle of the child, if there is one.
        range: limits of the rotation [rad].
        origin: a point on the line, if known.
        radius: distance of the handle from the line, if known [m].
    """
    thin = int(np.argmin(child.half_extents))
    plane = [number for number in (2, 1, 0) if number != thin]  # without evidence, a vertical edge is chosen
    out = child.axis(thin)
    if (child.center - parent.center) @ out < 0.0:
        out = -out
    if origin is not None:
        off = np.array([float((child.center - origin) @ child.axis(number)) for number in (0, 1, 2)])
        evidence = "its position is given"
    else:
        off = child.local_center_of(handle) if handle is not None else np.zeros(3)
        evidence = "its handle is on the other side"
    share = np.abs(off / child.half_extents)
    side = max(plane, key=lambda number: float(share[number]))
    if share[side] <= _OFFSET_TOLERANCE:
        side = next(number for number in (1, 0, 2) if number != thin)
        towards = _right_hand_direction(out, child.axis(side))
        evidence = "there is no evidence for another edge than the left one"
    else:
        towards = np.sign(off[side]) * child.axis(side)
    along = next(number for number in plane if number != side)
    if origin is None:
        distance = (
            child.half_extents[side]
            if radius is None or handle is None
            else radius - float(child.local_center_of(handle) @ _to_box_frame(child, towards))
        )
        origin = child.center - distance * towards
    axis = child.axis(along)
    opens = float(np.cross(axis, towards) @ out)
    if range is not None and abs(range[0]) > abs(range[1]):
        opens = -opens
    return InferredAxis(origin, axis if opens >= 0.0 else -axis, evidence)


def _right_hand_direction(outward: Array, side: Array) -> Array:
    """Returns the direction along a side that points to the right when the front is looked at from outside."""
    right = np.cross(np.array([0.0, 0.0, 1.0]), outward)
    return side if side @ right >= 0.0 else -side


def _to_box_frame(box: ObservedBox, direction: Array) -> Array:
    """Returns a direction of the world frame along a box's own axes."""
    return np.array([float(direction @ box.axis(number)) for number in range(3)])
