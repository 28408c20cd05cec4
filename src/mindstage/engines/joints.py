"""Joints: the six axes of a constraint as slides, hinges and balls.

Coordinates are those of the joint frame: x, y, z [m], then twist (about x), swing 2 (about y), swing 1 (about z) [rad].
Slides come first, so that they go along axes that do not turn, then the hinges about z, y and x, which are the angles
of a rotation in that order (Tait-Bryan); MuJoCo applies joints so. Three free angles are a ball, which has no singular
pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mindstage.world import AxisMotion, Joint, SoftLimit
from mindstage.world.geometry import Array, quat_multiply
from mindstage.world.travel import axis_ranges

__all__ = ["AXIS_NAMES", "JointAxis", "is_ball", "joint_coordinates", "movable_axes", "pose_from_joint_coordinates"]

AXIS_NAMES = ("x", "y", "z", "twist", "swing2", "swing1")
"""Of a constraint, in the order of coordinates."""

_HINGE_ORDER = (5, 4, 3)


@dataclass(frozen=True, slots=True)
class JointAxis:
    """One axis along or about which something can move."""

    index: int
    """Into `AXIS_NAMES`: 0 to 2 are slides along x, y, z; 3 to 5 hinges about them."""
    limit: float | None
    """Either way from the middle [m or rad]; None for no limit."""
    soft_limit: SoftLimit
    middle: float = 0.0
    """Of its range, from where it was spawned."""

    @property
    def is_prismatic(self) -> bool:
        """Whether it is a slide, not a hinge."""
        return self.index < 3

    @property
    def direction(self) -> int:
        """0, 1, 2 for x, y, z."""
        return self.index % 3


def movable_axes(joint: Joint, *, is_reversed: bool = False) -> tuple[JointAxis, ...]:
    """The axes that can move, slides first; a range of one point is none.

    Args:
        constraint: the constraint.
        upside_down: whether its child holds its parent, so that all goes the other way.
    """
    linear, angular = joint.linear, joint.angular
    softs = (*(linear.soft_limit,) * 3, angular.twist_soft_limit, angular.swing_soft_limit, angular.swing_soft_limit)
    ranges = axis_ranges(joint)
    way = -1.0 if is_reversed else 1.0
    return tuple(
        JointAxis(index, None, softs[index])
        if motion is AxisMotion.FREE
        else JointAxis(index, limit, softs[index], way * middle)
        for index in (0, 1, 2, *_HINGE_ORDER)
        for motion, limit, middle in [ranges[index]]
        if motion is AxisMotion.FREE or (motion is AxisMotion.LIMITED and middle - limit < middle + limit)
    )


def is_ball(axes: Sequence[JointAxis]) -> bool:
    """Whether all three rotations are free."""
    return sum(axis.limit is None for axis in axes if not axis.is_prismatic) == 3


def pose_from_joint_coordinates(coordinates: Sequence[float]) -> Array:
    """The child's joint frame seen from the parent's, seven numbers, for six coordinates."""
    quaternion = np.array([1.0, 0.0, 0.0, 0.0])
    for index in _HINGE_ORDER:
        turn = np.zeros(4)
        turn[0], turn[1 + index % 3] = np.cos(coordinates[index] / 2), np.sin(coordinates[index] / 2)
        quaternion = quat_multiply(quaternion, turn)
    return np.array([*coordinates[:3], *quaternion])


def joint_coordinates(relative: Array, axes: Sequence[JointAxis]) -> Array:
    """Six coordinates of a joint frame seen from the parent's; angles within a half turn either way.

    What the axes cannot express is left out; compare `pose_from_joint_coordinates` of the result to know whether there was any.
    """
    w, x, y, z = (relative[3:] / np.linalg.norm(relative[3:])).tolist()
    hinges = [axis for axis in axes if not axis.is_prismatic]
    angles = np.zeros(3)
    if len(hinges) == 1:
        direction = hinges[0].direction
        angles[direction] = 2 * np.arctan2((x, y, z)[direction], w)
    elif hinges:
        angles[0] = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
        angles[1] = np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0))
        angles[2] = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return np.concatenate([relative[:3], (angles + np.pi) % (2 * np.pi) - np.pi])
