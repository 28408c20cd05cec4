"""Joint frames: from an axis and a range, as other dialects tell joints, to the frame and motions of a constraint.

The frame's x lies along the axis. A range from `lower` to `upper` has its middle between the two and its limit at half
of their distance, so that middle - limit is `lower` again and middle + limit `upper`.
"""

from __future__ import annotations

from enum import StrEnum

import msgspec
import numpy as np

from mindstage.world import AngularLimits, AxisMotion, LinearLimits, Pose, SoftLimit, Vector
from mindstage.world.geometry import Array, pose_from_array

__all__ = ["JointLimits", "JointRange", "JointType", "center_and_half_range", "joint_from_axis", "to_vector"]


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
