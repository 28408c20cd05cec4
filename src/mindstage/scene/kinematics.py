"""Kinematics: ranges and displacements of joints, and groups of bodies that attachments hold together rigidly."""

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
    """The motion that a joint allows on one of its six axes."""

    motion: AxisMotion
    limit: float
    """Half of the range [m or rad]; ignored unless the motion is limited."""
    middle: float
    """Middle of the range, relative to the spawn pose [m or rad]."""


class JointDisplacement(NamedTuple):
    """The displacement of a joint from its spawn pose, on the axis with the largest displacement."""

    displacement: float
    """[m] or [rad], never negative."""
    is_prismatic: bool
    """Whether the axis is a translation [m] rather than a rotation [rad]."""
    fraction: float | None
    """The displacement relative to the reach of the axis, 0 to 1; None if the axis is unlimited."""


def axis_ranges(joint: Joint) -> tuple[JointAxisRange, ...]:
    """Returns the ranges of all six axes: x, y, z [m], twist (about x), swing2 (about y), swing1 (about z) [rad]."""
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
    """Returns the largest displacement from the spawn pose on each axis, in the order of `axis_ranges` [m or rad].

    0 for a locked axis, None for a free one.
    """
    return tuple(
        None if motion is AxisMotion.FREE else 0.0 if motion is AxisMotion.LOCKED else limit + abs(middle)
        for motion, limit, middle in axis_ranges(joint)
    )


def joint_displacement(joint: Joint, positions: Sequence[float]) -> JointDisplacement | None:
    """Returns the displacement of a joint; None if all of its axes are locked.

    Args:
        joint: the joint.
        positions: its displacement on each axis, in the order of `axis_ranges` [m or rad].
    """
    displacements = [
        JointDisplacement(abs(position), axis < 3, None if reach is None else min(abs(position) / reach, 1.0))
        for axis, (position, reach) in enumerate(zip(positions, joint_reach(joint), strict=True))
        if reach != 0.0
    ]
    return max(
        displacements,
        key=lambda each: each.fraction if each.fraction is not None else each.displacement,
        default=None,
    )


_MOBILITY_RANK = {Mobility.DYNAMIC: 0, Mobility.KINEMATIC: 1}
"""Bodies with a lower rank are moved first; all others have rank 2."""


@dataclass(frozen=True, slots=True)
class RigidGroups:
    """Groups of bodies that attachments connect rigidly; rows are indices into `World.bodies`."""

    root_row: NDArray[np.intp]
    """For each body, the row of the root body of its group, which identifies the group."""
    jointed_pairs: frozenset[tuple[int, int]]
    """Pairs of groups that a joint connects: the moving group, then the holding one."""
    is_jointed: NDArray[np.bool_]
    """For each body, whether a joint holds its group, as it does a door with its handle."""
    is_dynamic: NDArray[np.bool_]
    """For each body, whether the physics simulation moves its group."""

    @classmethod
    def from_world(cls, world: World) -> RigidGroups:
        """Computes the groups of a world; a cycle of attachments is cut at an arbitrary body."""
        rows = {body.id: row for row, body in enumerate(world.bodies)}
        parents = {attachment.child: attachment.parent for attachment in world.attachments if attachment.parent in rows}
        root_row = np.array([rows[_root_of(body.id, parents)] for body in world.bodies], dtype=np.intp)
        jointed_pairs = set()
        for joint in world.joints:
            if joint.parent in rows and joint.child in rows:
                moving, holder = moving_body(joint, world.bodies[rows[joint.parent]], world.bodies[rows[joint.child]])
                jointed_pairs.add((int(root_row[rows[moving.id]]), int(root_row[rows[holder.id]])))
        is_jointed = np.isin(root_row, [moving for moving, _ in jointed_pairs])
        is_dynamic = np.array([body.physics.is_dynamic for body in world.bodies], dtype=bool)
        return cls(root_row, frozenset(jointed_pairs), is_jointed, is_dynamic[root_row])


def moving_body(joint: Joint, parent: Body, child: Body) -> tuple[Body, Body]:
    """Returns the body that a joint moves and the body that holds it.

    Maps use parent and child either way. Dynamic bodies are moved before kinematic ones, and those before static ones;
    of two with equal mobility, the smaller one is moved.
    """

    def rank(body: Body) -> tuple[int, float]:
        mobility = body.physics.mobility
        return (2 if mobility is None else _MOBILITY_RANK.get(mobility, 2), _volume(body))

    moving, holder = sorted((child, parent), key=rank)
    return moving, holder


def _volume(body: Body) -> float:
    return float(np.prod(body.size)) if body.size else 0.0


def _root_of(id: BodyId, parents: Mapping[BodyId, BodyId]) -> BodyId:
    visited = {id}
    while (parent := parents.get(id)) is not None and parent not in visited:
        visited.add(parent)
        id = parent
    return id
