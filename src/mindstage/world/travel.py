"""Travel: how far something that a constraint holds can go, and how far it went."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from mindstage.world.values import Constraint, Motion

__all__ = ["AxisRange", "Travel", "axis_ranges", "reaches", "travel"]


class AxisRange(NamedTuple):
    """What a constraint says of one of its six axes."""

    motion: Motion
    limit: float
    """Either way from the middle [m or rad]; without meaning unless the motion is limited."""
    middle: float
    """Of its range, from where the child was spawned."""


class Travel(NamedTuple):
    """How far something went from where it was spawned, on the axis on which it went farthest."""

    way: float
    """[m] or [rad], never negative."""
    slides: bool
    """Whether the way is one in metres."""
    share: float | None
    """Of the farthest that it can go that way; None where nothing limits it."""


def axis_ranges(joint: Constraint) -> tuple[AxisRange, ...]:
    """All six axes: x, y, z [m], twist (about x), swing2 (about y), swing1 (about z) [rad]."""
    linear, angular = joint.linear, joint.angular
    return (
        AxisRange(linear.x, linear.limit, linear.x_middle),
        AxisRange(linear.y, linear.limit, linear.y_middle),
        AxisRange(linear.z, linear.limit, linear.z_middle),
        AxisRange(angular.twist, angular.twist_limit, angular.twist_middle),
        AxisRange(angular.swing2, angular.swing2_limit, angular.swing2_middle),
        AxisRange(angular.swing1, angular.swing1_limit, angular.swing1_middle),
    )


def reaches(joint: Constraint) -> tuple[float | None, ...]:
    """How far each axis leads from where the child was spawned, in the order of `axis_ranges` [m or rad].

    0 is no way at all, None one without an end.
    """
    return tuple(
        None if motion is Motion.FREE else 0.0 if motion is Motion.LOCKED else limit + abs(middle)
        for motion, limit, middle in axis_ranges(joint)
    )


def travel(joint: Constraint, positions: Sequence[float]) -> Travel | None:
    """How far a constraint let its child go; None for one that lets nothing move.

    Args:
        joint: the constraint.
        positions: where it is, in the order of `reaches`.
    """
    ways = [
        Travel(abs(position), axis < 3, None if reach is None else min(abs(position) / reach, 1.0))
        for axis, (position, reach) in enumerate(zip(positions, reaches(joint), strict=True))
        if reach != 0.0
    ]
    return max(ways, key=lambda way: way.share if way.share is not None else way.way, default=None)
