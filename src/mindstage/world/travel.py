"""Travel: how far something that a constraint holds can go, and how far it went."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from mindstage.world.values import AxisMotion, Joint

__all__ = ["JointAxisRange", "JointDisplacement", "axis_ranges", "joint_displacement", "joint_reach"]


class JointAxisRange(NamedTuple):
    """What a constraint says of one of its six axes."""

    motion: AxisMotion
    limit: float
    """Either way from the middle [m or rad]; without meaning unless the motion is limited."""
    middle: float
    """Of its range, from where the child was spawned."""


class JointDisplacement(NamedTuple):
    """How far something went from where it was spawned, on the axis on which it went farthest."""

    displacement: float
    """[m] or [rad], never negative."""
    is_prismatic: bool
    """Whether the way is one in meters."""
    fraction: float | None
    """Of the farthest that it can go that way; None where nothing limits it."""


def axis_ranges(joint: Joint) -> tuple[JointAxisRange, ...]:
    """All six axes: x, y, z [m], twist (about x), swing2 (about y), swing1 (about z) [rad]."""
    linear, angular = joint.linear, joint.angular
    return (
        JointAxisRange(linear.x, linear.limit, linear.x_middle),
        JointAxisRange(linear.y, linear.limit, linear.y_middle),
        JointAxisRange(linear.z, linear.limit, linear.z_middle),
        JointAxisRange(angular.twist, angular.twist_limit, angular.twist_middle),
        JointAxisRange(angular.swing2, angular.swing2_limit, angular.swing2_middle),
        JointAxisRange(angular.swing1, angular.swing1_limit, angular.swing1_middle),
    )


def joint_reach(joint: Joint) -> tuple[float | None, ...]:
    """How far each axis leads from where the child was spawned, in the order of `axis_ranges` [m or rad].

    0 is no way at all, None one without an end.
    """
    return tuple(
        None if motion is AxisMotion.FREE else 0.0 if motion is AxisMotion.LOCKED else limit + abs(middle)
        for motion, limit, middle in axis_ranges(joint)
    )


def joint_displacement(joint: Joint, positions: Sequence[float]) -> JointDisplacement | None:
    """How far a constraint let its child go; None for one that lets nothing move.

    Args:
        joint: the constraint.
        positions: where it is, in the order of `joint_reach`.
    """
    ways = [
        JointDisplacement(abs(position), axis < 3, None if reach is None else min(abs(position) / reach, 1.0))
        for axis, (position, reach) in enumerate(zip(positions, joint_reach(joint), strict=True))
        if reach != 0.0
    ]
    return max(ways, key=lambda way: way.fraction if way.fraction is not None else way.displacement, default=None)
