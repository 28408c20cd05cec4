"""Joint frames: from an axis and a range, as other dialects tell joints, to the frame and motions of a constraint.

The frame's x lies along the axis. A range from `lower` to `upper` has its middle between the two and its limit at half
of their distance, so that middle - limit is `lower` again and middle + limit `upper`.
"""

from __future__ import annotations

from enum import StrEnum

import msgspec
import numpy as np

from mindstage.world import AngularMotion, LinearMotion, Motion, Pose, Soft, Vector
from mindstage.world.geometry import Array, pose_from

__all__ = ["Joint", "JointKind", "Range", "joint_along", "span", "vector"]


class JointKind(StrEnum):
    """What a joint lets its child do."""

    HINGE = "hinge"
    SLIDE = "slide"
    FIXED = "fixed"
    FLOATING = "floating"
    PLANAR = "planar"
    """Slide and turn in the plane that its axis stands on."""


Range = tuple[float, float] | None
"""From where to where, seen from the pose as spawned [m or rad]; None for no end."""


class Joint(msgspec.Struct, frozen=True):
    """What a constraint needs beyond its two ends."""

    pose: Pose
    linear: LinearMotion
    angular: AngularMotion

    @property
    def moves(self) -> bool:
        """Whether it lets anything happen."""
        linear, angular = self.linear, self.angular
        axes = (linear.x, linear.y, linear.z, angular.twist, angular.swing1, angular.swing2)
        return any(axis is not Motion.LOCKED for axis in axes)


def span(lower: float, upper: float) -> tuple[float, float]:
    """The middle of a range and how far it goes either way."""
    return (lower + upper) / 2, (upper - lower) / 2


def joint_along(kind: JointKind, origin: Array, axis: Array, range: Range, *, damping: float = 0.0) -> Joint:
    """A joint at a place in the world.

    Args:
        kind: what it lets happen.
        origin: a point on its axis [m].
        axis: its direction; any length but 0.
        range: of a hinge or a slide; its lower end comes first.
        damping: of its motion [Ns/m or Nms/rad].
    """
    pose = pose_from(np.concatenate([origin, _turn_x_to(axis / np.linalg.norm(axis))]))
    linear, angular = LinearMotion(), AngularMotion()
    motion = Motion.FREE if range is None else Motion.LIMITED
    middle, limit = (0.0, 0.0) if range is None else span(*range)
    soft = Soft(damping=damping)
    free = Motion.FREE
    if kind is JointKind.SLIDE:
        linear = LinearMotion(x=motion, limit=limit, x_middle=middle, soft=soft)
    elif kind is JointKind.HINGE:
        angular = AngularMotion(twist=motion, twist_limit=limit, twist_middle=middle, twist_soft=soft)
    elif kind is JointKind.PLANAR:
        linear, angular = LinearMotion(y=free, z=free), AngularMotion(twist=free)
    elif kind is JointKind.FLOATING:
        linear, angular = LinearMotion(x=free, y=free, z=free), AngularMotion(swing1=free, swing2=free, twist=free)
    return Joint(pose, linear, angular)


def _turn_x_to(axis: Array) -> Array:
    """The shortest rotation that takes x to an axis; about z where that is the way back."""
    x, y, z = (float(part) for part in axis)
    if x < -1.0 + 1e-12:
        return np.array([0.0, 0.0, 0.0, 1.0])
    quaternion = np.array([1.0 + x, 0.0, -z, y])
    return np.asarray(quaternion / np.linalg.norm(quaternion))


def vector(row: Array) -> Vector:
    """Three numbers of an array."""
    x, y, z = (float(part) for part in row)
    return x, y, z
