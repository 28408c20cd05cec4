"""Reach: what hangs in a joint on something that stands still, and never gets to the scenery.

A drawer in the middle of a room meets no wall, however far it is pulled. Told so, MuJoCo does not look for contacts
between the two in every step; in a kitchen it would look at a hundred parts of the scenery for each drawer.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mindstage.engines.joints import JointAxis
from mindstage.engines.mujoco.blueprint import ModelInput
from mindstage.world import BodyId
from mindstage.world.boxes import OrientedBoxes
from mindstage.world.geometry import Array, pose_inverse, pose_multiply, quat_rotate

__all__ = ["cull_static_contacts"]

_LIMIT_OVERRUN_M = 0.05
"""So far something may slide past its limit, pushed hard; what turns is taken to turn all the way round."""
_CORNERS = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij"), axis=-1).reshape(8, 3)


def cull_static_contacts(
    model_input: ModelInput, axes: Mapping[BodyId, tuple[JointAxis, ...]], scenery: OrientedBoxes
) -> list[BodyId]:
    """The bodies that get to no scenery on the whole way that the one joint on which they hang lets them go.

    Args:
        plan: who hangs on whom, and where.
        axes: of each constraint that is a joint.
        scenery: what stands still.
    """
    hung = _limited_root_joints(model_input, axes)
    if not hung or not len(scenery.center):
        return []
    low, high = _swept_bounds(model_input, hung)
    first, last = scenery.bounds()
    meets = np.all((low[:, None] < last[None]) & (high[:, None] > first[None]), axis=2).any(axis=1)
    far = (top for top, met in zip(hung, meets.tolist(), strict=True) if not met)
    return [id for top in far for id in model_input.forest.groups[top].bodies]


def _limited_root_joints(
    model_input: ModelInput, axes: Mapping[BodyId, tuple[JointAxis, ...]]
) -> dict[BodyId, JointAxis]:
    """The tops that a joint of one axis, with hard limits, holds to what stands still."""
    forest = model_input.forest
    found = {}
    for top, branch in forest.tree_joints.items():
        joint = axes.get(branch.joint.id, ())
        limited = len(joint) == 1 and joint[0].limit is not None and not joint[0].soft_limit.enabled
        if limited and model_input.is_fixed(forest.groups[forest.root_of[branch.parent]]):
            found[top] = joint[0]
    return found


def _swept_bounds(model_input: ModelInput, root_joints: Mapping[BodyId, JointAxis]) -> tuple[Array, Array]:
    """The corners of upright boxes that hold the assemblies, wherever their joints let them be."""
    joints = list(root_joints.values())
    branches = [model_input.forest.tree_joints[top] for top in root_joints]
    ends = [branch.order_ends(model_input.builder.joint_frames[branch.joint.id]) for branch in branches]
    fixed = pose_multiply(
        model_input.poses[[model_input.rows[branch.parent] for branch in branches]], np.array([end[0] for end in ends])
    )
    moving = pose_multiply(
        model_input.poses[[model_input.rows[branch.child] for branch in branches]], np.array([end[1] for end in ends])
    )
    low, high = _group_bounds(model_input, list(root_joints))
    number = [joint.direction for joint in joints]
    directions = quat_rotate(fixed[:, 3:], np.eye(3)[number])
    now = pose_multiply(pose_inverse(fixed), moving)[np.arange(len(joints)), number]
    limits = np.array([(joint.limit or 0.0) + _LIMIT_OVERRUN_M for joint in joints])
    middles = np.array([joint.middle for joint in joints])
    ways = np.stack([middles - limits - now, middles + limits - now], axis=1)
    shifts = ways[:, :, None] * directions[:, None]
    turned_low, turned_high = _rotation_bounds(low, high, moving[:, :3], directions)
    slides = np.array([joint.is_prismatic for joint in joints])[:, None]
    low = np.where(slides, low + np.minimum(shifts.min(axis=1), 0.0), turned_low)
    return low, np.where(slides, high + np.maximum(shifts.max(axis=1), 0.0), turned_high)


def _group_bounds(model_input: ModelInput, roots: list[BodyId]) -> tuple[Array, Array]:
    """The corners of upright boxes round assemblies as they stand."""
    bodies = [model_input.forest.groups[top].bodies for top in roots]
    rows = [model_input.rows[id] for each in bodies for id in each]
    low, high = OrientedBoxes.from_poses(model_input.poses[rows], model_input.sizes[rows]).bounds()
    first = np.cumsum([0, *(len(each) for each in bodies[:-1])])
    return np.minimum.reduceat(low, first), np.maximum.reduceat(high, first)


def _rotation_bounds(low: Array, high: Array, anchors: Array, axes: Array) -> tuple[Array, Array]:
    """The boxes in which other ones stay, however far they are turned about an axis."""
    away = low[:, None] + _CORNERS * (high - low)[:, None] - anchors[:, None]
    along = np.einsum("nci,ni->nc", away, axes)
    radius = np.linalg.norm(away - along[..., None] * axes[:, None], axis=2).max(axis=1)
    start, end = along.min(axis=1), along.max(axis=1)
    middle = anchors + axes * ((start + end) / 2)[:, None]
    half = np.abs(axes) * ((end - start) / 2)[:, None] + np.sqrt(np.maximum(1.0 - axes**2, 0.0)) * radius[:, None]
    return middle - half, middle + half
