"""Traveling: where constraints have let their bodies go, and where they would let them go, from poses alone.

For engines that do not say so themselves.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mindstage.engines.forest import TreeJoint
from mindstage.engines.joints import JointAxis, is_ball, joint_coordinates, movable_axes, pose_from_joint_coordinates
from mindstage.engines.planning import PhysicsModelBuilder
from mindstage.errors import PoseUnreachableError
from mindstage.world import BodyId
from mindstage.world.geometry import Array, pose_inverse, pose_multiply, quat_angle

__all__ = ["check_joint_limits", "joint_positions_from_poses"]

_REACH_TOLERANCE_M, _REACH_TOLERANCE_RAD = 1e-6, 1e-6


def joint_positions_from_poses(
    builder: PhysicsModelBuilder, poses: Mapping[BodyId, Array]
) -> dict[BodyId, tuple[float, ...]]:
    """How far each constraint that can move has moved: see `Engine.joint_positions`.

    Args:
        planner: who hangs on whom.
        where: all poses.
    """
    places = {}
    for branch in builder.forest.tree_joints.values():
        constraint = branch.joint
        if axes := movable_axes(constraint, is_reversed=branch.is_reversed):
            of_parent, of_child = builder.joint_frames[constraint.id]
            fixed = pose_multiply(poses[constraint.parent], of_parent)
            moving = pose_multiply(poses[constraint.child], of_child)
            places[constraint.id] = tuple(joint_coordinates(pose_multiply(pose_inverse(fixed), moving), axes).tolist())
    return places


def check_joint_limits(
    builder: PhysicsModelBuilder, id: BodyId, target: Array, poses: Mapping[BodyId, Array], *, tolerance: float = 0.0
) -> None:
    """Makes sure that the constraint which holds a body lets it get somewhere.

    Args:
        planner: who hangs on whom.
        id: a body that hangs on a constraint, the top of its assembly.
        target: where it is to be.
        where: all poses now.
        slack: how far off the engine's own poses may be [m, rad].

    Raises:
        PoseUnreachableError: it does not.
    """
    branch = builder.forest.tree_joints[id]
    axes = movable_axes(branch.joint, is_reversed=branch.is_reversed)
    if not axes:
        raise PoseUnreachableError(id, reason=f"the constraint {branch.joint.id!r} locks it")
    of_parent, of_child = branch.order_ends(builder.joint_frames[branch.joint.id])
    fixed = pose_multiply(poses[branch.parent], of_parent)
    wanted = pose_multiply(target, pose_multiply(pose_inverse(poses[id]), poses[branch.child]))
    asked = pose_multiply(pose_inverse(fixed), pose_multiply(wanted, of_child))
    place = joint_coordinates(asked, axes)
    for axis in axes:
        _check_axis_limit(id, branch, axis, float(place[axis.index]), tolerance)
    allowed = np.zeros(6)
    for axis in axes:
        allowed[axis.index] = place[axis.index]
    relative = pose_from_joint_coordinates(allowed.tolist())
    if is_ball(axes):
        relative[3:] = asked[3:]
    reached = pose_multiply(pose_multiply(fixed, relative), pose_inverse(of_child))
    off_m = float(np.linalg.norm(reached[:3] - wanted[:3]))
    if (
        off_m > _REACH_TOLERANCE_M + tolerance
        or float(quat_angle(reached[3:], wanted[3:])) > _REACH_TOLERANCE_RAD + tolerance
    ):
        reason = f"{branch.joint.id!r} does not lead there; the nearest it allows is {off_m:.3g} m off"
        raise PoseUnreachableError(id, reason=reason)


def _check_axis_limit(id: BodyId, tree_joint: TreeJoint, axis: JointAxis, position: float, tolerance: float) -> None:
    beyond = position - axis.middle
    if axis.limit is not None and abs(beyond) > axis.limit + _REACH_TOLERANCE_M + tolerance:
        end = axis.middle + np.copysign(axis.limit, beyond)
        asked_for = f"{position:.4g} {'m' if axis.is_prismatic else 'rad'}"
        raise PoseUnreachableError(id, reason=f"{tree_joint.joint.id!r} ends at {end:g}, asked for was {asked_for}")
