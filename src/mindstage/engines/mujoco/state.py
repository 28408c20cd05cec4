"""The state of a compiled MuJoCo model, and its transfer to the next model.

An edit produces a new model. Joint coordinates, velocities and sleep are copied from the old one by name; bodies on new
joints get their coordinates from their poses.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Collection, Container, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import mujoco
import numpy as np
from numpy.typing import NDArray

from mindstage.engines.kinematic_tree import JointAxis, TreeJoint, joint_coordinates
from mindstage.scene import BodyId
from mindstage.scene.transforms import Array, pose_inverse, pose_multiply, quat_conjugate, quat_rotate

__all__ = [
    "CompiledModel",
    "ModelJoint",
    "current_joint_coordinates",
    "set_joint_coordinates",
    "transfer_state",
    "wake_islands",
]


@dataclass(slots=True)
class ModelJoint:
    """A tree joint in a compiled model."""

    tree_joint: TreeJoint
    axes: tuple[JointAxis, ...]
    is_ball: bool
    qpos_address: int
    """Start of its coordinates in `qpos`, in the order of `axes`; the quaternion of a ball joint comes last."""
    dof_address: int
    """Start of its velocities in `qvel`."""
    body_id: int
    """The MuJoCo body that it moves."""


@dataclass(slots=True)
class CompiledModel:
    """A compiled model with its data, and the addresses of bodies and joints in it."""

    model: Any
    data: Any
    rows: dict[BodyId, int]
    """Row of each body in arrays of poses."""
    body_ids: dict[BodyId, int]
    """MuJoCo's id of each body; scenery has none."""
    body_id_order: NDArray[np.intp]
    """The same as an array in the order of `rows`, to read all poses at once; 0 for scenery."""
    scenery: NDArray[np.intp]
    """Rows of the bodies that are part of MuJoCo's world body."""
    scenery_poses: Array
    """Their poses, k x 7."""
    joints: dict[BodyId, ModelJoint]
    """The tree joints by id."""
    free_joint_addresses: dict[BodyId, tuple[int, int]]
    """Addresses in `qpos` and `qvel` of each rigid group with a free joint."""
    mocap_ids: dict[BodyId, int]
    """MuJoCo's mocap id of each kinematic group."""
    free_heights: NDArray[np.intp] = field(init=False)
    """Addresses in `qpos` of the heights of the free joints, in the order of `free_joint_addresses`."""

    free_velocities: NDArray[np.intp] = field(init=False)
    """Addresses in `qvel` of their linear velocities, k x 3."""

    def __post_init__(self) -> None:
        addresses = np.array(list(self.free_joint_addresses.values()), dtype=np.intp).reshape(-1, 2)
        self.free_heights = addresses[:, 0] + 2
        self.free_velocities = addresses[:, 1:] + np.arange(3)

    def without(self, removed: Collection[BodyId], *, remaining_joints: Container[BodyId]) -> CompiledModel:
        """The same model without some bodies and joints, so that their state is not transferred.

        Args:
            removed: ids of the bodies to omit.
            remaining_joints: ids of the joints to keep.
        """
        return replace(
            self,
            body_ids={id: body_id for id, body_id in self.body_ids.items() if id not in removed},
            free_joint_addresses={
                id: addresses for id, addresses in self.free_joint_addresses.items() if id not in removed
            },
            joints={id: joint for id, joint in self.joints.items() if id in remaining_joints},
        )

    def poses(self) -> Array:
        """All poses, n x 7, in the order of `rows`."""
        poses = np.empty((len(self.body_id_order), 7))
        poses[:, :3], poses[:, 3:] = self.data.xpos[self.body_id_order], self.data.xquat[self.body_id_order]
        poses[self.scenery] = self.scenery_poses
        return poses


def _update_sleep() -> Callable[[int, int], object] | None:
    """MuJoCo's internal function that updates all other sleep data from `tree_asleep`, if it can be loaded.

    The library exports it, but the Python binding does not. Without it, sleeping bodies wake up at each edit until they
    fall asleep again.
    """
    for path in Path(mujoco.__file__).parent.glob(f"*mujoco*{mujoco.__version__}*"):
        if path.suffix in {".dll", ".dylib"} or ".so" in path.name:
            function = getattr(ctypes.CDLL(str(path)), "mj_updateSleep", None)
            if function is not None:
                function.argtypes, function.restype = (ctypes.c_void_p, ctypes.c_void_p), None
                return cast("Callable[[int, int], object]", function)
    return None


_UPDATE_SLEEP = _update_sleep()
_FULLY_AWAKE = -(1 + mujoco.mjMINAWAKE)
"""MuJoCo increments this value in every step in which a tree does not move; at 0 the tree sleeps."""


def transfer_state(
    old: CompiledModel | None,
    new: CompiledModel,
    poses: Mapping[BodyId, Array],
    joint_frames: Mapping[BodyId, tuple[Array, Array]],
    at_rest: set[BodyId],
    changed_boxes: NDArray[np.float64],
) -> None:
    """Sets the state of a new model from that of the old one.

    Args:
        old: the previous model, or None.
        new: the model to set.
        poses: current poses of all bodies [m, w x y z].
        joint_frames: each joint's frame in its parent and in its child.
        at_rest: bodies that were just moved and have zero velocity.
        changed_boxes: k x 2 x 3, lower and upper corners of boxes in which something changed [m]; bodies that sleep
            there wake up.
    """
    data = new.data
    for root, (_, velocity) in new.free_joint_addresses.items():
        if old is not None and root in old.body_ids and root not in at_rest:  # scenery has no velocity
            data.qvel[velocity : velocity + 6] = _velocity(old, root)
            if root in old.free_joint_addresses:
                old_dof = old.free_joint_addresses[root][1]
                data.qacc_warmstart[velocity : velocity + 6] = old.data.qacc_warmstart[old_dof : old_dof + 6]
    for id, joint in new.joints.items():
        if old is not None and not _copy_joint(old, new, id, joint, at_rest):  # a first model has them
            set_joint_coordinates(new, joint, current_joint_coordinates(joint, poses, joint_frames[id]))
    mujoco.mj_forward(new.model, data)
    if old is not None:
        _keep_asleep(old, new, changed_boxes)


def current_joint_coordinates(
    joint: ModelJoint, poses: Mapping[BodyId, Array], joint_frames: tuple[Array, Array]
) -> Array:
    """Six coordinates of a joint from the poses of its bodies, followed by its rotation as a quaternion."""
    parent_from_frame, child_from_frame = joint.tree_joint.order_ends(joint_frames)
    fixed, moving = (
        pose_multiply(poses[joint.tree_joint.parent], parent_from_frame),
        pose_multiply(poses[joint.tree_joint.child], child_from_frame),
    )
    relative = pose_multiply(pose_inverse(fixed), moving)
    return np.concatenate([joint_coordinates(relative, joint.axes), relative[3:]])


def set_joint_coordinates(compiled: CompiledModel, joint: ModelJoint, coordinates: Array) -> None:
    """Sets the coordinates of a joint and its velocity to zero."""
    position = joint.qpos_address
    for axis in joint.axes:
        if axis.is_prismatic or not joint.is_ball:
            compiled.data.qpos[position] = coordinates[axis.index]
            position += 1
    if joint.is_ball:
        compiled.data.qpos[position : position + 4] = coordinates[6:]
    compiled.data.qvel[joint.dof_address : joint.dof_address + len(joint.axes)] = 0.0


def _copy_joint(old: CompiledModel, new: CompiledModel, id: BodyId, joint: ModelJoint, at_rest: set[BodyId]) -> bool:
    """Copies the state of a joint; False if the joint is new or changed, or one of its bodies was moved."""
    old_joint = old.joints.get(id)
    if old_joint is None or old_joint.tree_joint.parent != joint.tree_joint.parent or old_joint.axes != joint.axes:
        return False
    if joint.tree_joint.child in at_rest and joint.tree_joint.parent not in at_rest:
        return False
    degrees = len(joint.axes)
    now = slice(joint.qpos_address, joint.qpos_address + degrees + joint.is_ball)
    then = slice(old_joint.qpos_address, old_joint.qpos_address + degrees + joint.is_ball)
    new.data.qpos[now] = old.data.qpos[then]
    now, then = (
        slice(joint.dof_address, joint.dof_address + degrees),
        slice(old_joint.dof_address, old_joint.dof_address + degrees),
    )
    new.data.qvel[now] = old.data.qvel[then]
    new.data.qacc_warmstart[now] = old.data.qacc_warmstart[then]
    return True


def _velocity(old: CompiledModel, id: BodyId) -> Array:
    """The velocity of a body as a free joint has it: linear in the world frame, angular in the body frame."""
    if id in old.free_joint_addresses:
        start = old.free_joint_addresses[id][1]
        return np.array(old.data.qvel[start : start + 6])
    body_id = old.body_ids[id]
    spatial_velocity = np.zeros(6)
    mujoco.mj_objectVelocity(old.model, old.data, mujoco.mjtObj.mjOBJ_XBODY, body_id, spatial_velocity, 0)
    quaternion = np.array(old.data.xquat[body_id])
    return np.concatenate([spatial_velocity[3:], quat_rotate(quat_conjugate(quaternion), spatial_velocity[:3])])


def _trees_by_body(compiled: CompiledModel) -> dict[BodyId, int]:
    """MuJoCo's tree of each body that has degrees of freedom."""
    trees = compiled.model.body_treeid
    return {id: int(trees[body_id]) for id, body_id in compiled.body_ids.items() if trees[body_id] >= 0}


def _keep_asleep(old: CompiledModel, new: CompiledModel, changed_boxes: NDArray[np.float64]) -> None:
    """Lets trees that were asleep stay asleep.

    MuJoCo links the trees of a sleeping island in a cycle. A cycle is kept if all of its trees still exist and nothing
    changed near any of them.
    """
    trees = _trees_by_body(new)
    asleep = old.data.tree_asleep
    next_of: dict[int, int] = {}
    tree_of_old: dict[int, int] = {}
    for id, old_tree in _trees_by_body(old).items():
        if id in trees:
            tree_of_old.setdefault(old_tree, trees[id])
    for old_tree, new_tree in tree_of_old.items():
        neighbor = int(asleep[old_tree])
        if neighbor >= 0 and neighbor in tree_of_old:
            next_of[new_tree] = tree_of_old[neighbor]
    disturbed = _disturbed_trees(new, changed_boxes)
    sleeping: set[int] = set()
    for start, next_tree in next_of.items():
        cycle, tree = [start], next_tree
        while tree != start and tree in next_of and len(cycle) <= len(next_of):
            cycle.append(tree)
            tree = next_of[tree]
        if tree == start and not disturbed.intersection(cycle):
            sleeping.update(cycle)
    if sleeping and _UPDATE_SLEEP is not None:
        for tree in sleeping:
            new.data.tree_asleep[tree] = next_of[tree]
        _UPDATE_SLEEP(new.model._address, new.data._address)


def wake_islands(compiled: CompiledModel, changed_boxes: NDArray[np.float64]) -> None:
    """Wakes islands that sleep near some boxes (k x 2 x 3 [m]), and restarts the sleep countdown of others there.

    MuJoCo wakes a tree that has a velocity; the one set here is too small to matter.
    """
    for tree in _disturbed_trees(compiled, changed_boxes):
        if compiled.data.tree_asleep[tree] >= 0:
            compiled.data.qvel[compiled.model.tree_dofadr[tree]] += 1e-12
        else:
            compiled.data.tree_asleep[tree] = _FULLY_AWAKE


def _disturbed_trees(compiled: CompiledModel, changed_boxes: NDArray[np.float64]) -> set[int]:
    """Trees with geoms that reach into one of the boxes."""
    if not len(changed_boxes) or not compiled.model.nbody:
        return set()
    trees = compiled.model.body_treeid
    moving = np.flatnonzero(trees >= 0)
    geoms = np.flatnonzero(trees[compiled.model.geom_bodyid] >= 0)
    reach = compiled.model.geom_rbound[geoms, None] + 0.02
    center = compiled.data.geom_xpos[geoms]
    disturbed: set[int] = set()
    for low, high in changed_boxes:
        is_near = np.all((center + reach >= low) & (center - reach <= high), axis=1)
        disturbed.update(trees[compiled.model.geom_bodyid[geoms[is_near]]].tolist())
    return disturbed if len(moving) else set()
