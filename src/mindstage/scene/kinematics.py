"""Assemblies: bodies that hang together by attachments, and what the constraints between them let move.

Travel: how far something that a constraint holds can go, and how far it went.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mindstage.scene.model import AxisMotion, Body, BodyId, Joint, Mobility, World

__all__ = [
    "JointAxisRange",
    "JointDisplacement",
    "RigidGroups",
    "axis_ranges",
    "joint_displacement",
    "joint_reach",
    "moving_body",
]


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


_MOBILITY_RANK = {Mobility.DYNAMIC: 0, Mobility.KINEMATIC: 1}
"""Who gives way first."""


@dataclass(frozen=True, slots=True)
class RigidGroups:
    """The bodies of a world, in its order."""

    root_row: NDArray[np.intp]
    """For each body, that of its assembly: the row of the body that all of it finally hangs on."""
    jointed_pairs: frozenset[tuple[int, int]]
    """Pairs of assemblies that a constraint joins: the one that moves, then the one that holds it."""
    is_jointed: NDArray[np.bool_]
    """For each body, whether its assembly hangs in a constraint, as a door with its handle does."""
    is_dynamic: NDArray[np.bool_]
    """For each body, whether the physics moves its assembly."""

    @classmethod
    def from_world(cls, world: World) -> RigidGroups:
        """Finds them; a circle of attachments is cut somewhere."""
        rows = {body.id: row for row, body in enumerate(world.bodies)}
        parents = {hold.child: hold.parent for hold in world.attachments if hold.parent in rows}
        number = np.array([rows[_root_of(body.id, parents)] for body in world.bodies], dtype=np.intp)
        joined = set()
        for joint in world.joints:
            if joint.parent in rows and joint.child in rows:
                moving, holder = moving_body(joint, world.bodies[rows[joint.parent]], world.bodies[rows[joint.child]])
                joined.add((int(number[rows[moving.id]]), int(number[rows[holder.id]])))
        hung = np.isin(number, [moving for moving, _ in joined])
        simulates = np.array([body.physics.is_dynamic for body in world.bodies], dtype=bool)
        return cls(number, frozenset(joined), hung, simulates[number])


def moving_body(joint: Joint, parent: Body, child: Body) -> tuple[Body, Body]:
    """Which of its two bodies a constraint lets move, and which one holds it.

    Maps have the roles either way round. What the physics moves gives way before what a program moves, and that before
    what is fixed; of two alike the smaller one does.
    """

    def rank(body: Body) -> tuple[int, float]:
        mobility = body.physics.mobility
        return (2 if mobility is None else _MOBILITY_RANK.get(mobility, 2), _volume(body))

    moving, holder = sorted((child, parent), key=rank)
    return moving, holder


def _volume(body: Body) -> float:
    return float(np.prod(body.size)) if body.size else 0.0


def _root_of(id: BodyId, parents: Mapping[BodyId, BodyId]) -> BodyId:
    seen = {id}
    while (above := parents.get(id)) is not None and above not in seen:
        seen.add(above)
        id = above
    return id
