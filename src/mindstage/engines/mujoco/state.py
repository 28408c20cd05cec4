"""Carry: what was moving goes on moving when the model is made anew.

An edit gives a new model. Joint coordinates, velocities and sleep come from the old one by name; what hangs on a new
joint gets its coordinates from where it stands.

Live: a compiled model, its state, and where everything of ours is in it.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Collection, Container, Mapping
from dataclasses import dataclass, replace
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
    """A branch of the forest as it stands in the model."""

    tree_joint: TreeJoint
    axes: tuple[JointAxis, ...]
    is_ball: bool
    qpos_address: int
    """Where its coordinates begin in `qpos`, in the order of `axes` (a ball's quaternion last)."""
    dof_address: int
    """Where they begin in `qvel`."""
    body_id: int
    """The MuJoCo body that the joints move."""


@dataclass(slots=True)
class CompiledModel:
    """A compiled model, its state, and where everything is in it."""

    model: Any
    data: Any
    rows: dict[BodyId, int]
    """The order of poses: as in the blueprint."""
    body_ids: dict[BodyId, int]
    """MuJoCo's number of each body; scenery has none."""
    body_id_order: NDArray[np.intp]
    """The same in the order of `ModelInput.rows`, for reading all poses at once; 0 for scenery."""
    scenery: NDArray[np.intp]
    """Rows of bodies that are part of MuJoCo's world."""
    scenery_poses: Array
    """Where those stand."""
    joints: dict[BodyId, ModelJoint]
    """By constraint."""
    free_joint_addresses: dict[BodyId, tuple[int, int]]
    """Of each assembly that moves freely: where its pose begins in `qpos`, its velocity in `qvel`."""
    mocap_ids: dict[BodyId, int]
    """MuJoCo's mocap number of each kinematic assembly."""

    def without(self, removed: Collection[BodyId], *, remaining_joints: Container[BodyId]) -> CompiledModel:
        """The same, as a state to carry over, in which some bodies are not known any more.

        Args:
            gone: those bodies.
            joints: the constraints that are still there.
        """
        return replace(
            self,
            body_ids={id: number for id, number in self.body_ids.items() if id not in removed},
            free_joint_addresses={id: place for id, place in self.free_joint_addresses.items() if id not in removed},
            joints={id: joint for id, joint in self.joints.items() if id in remaining_joints},
        )

    def poses(self) -> Array:
        """All poses, n x 7, in the order of `ModelInput.rows`."""
        poses = np.empty((len(self.body_id_order), 7))
        poses[:, :3], poses[:, 3:] = self.data.xpos[self.body_id_order], self.data.xquat[self.body_id_order]
        poses[self.scenery] = self.scenery_poses
        return poses


def _update_sleep() -> Callable[[int, int], object] | None:
    """MuJoCo's own function that makes everything else agree with `tree_asleep`.

    The library exports it, its Python binding does not. Without it, what slept before an edit wakes up and falls
    asleep again by itself.
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
"""From here MuJoCo counts up, once a step, while a tree does not move; at 0 it sleeps."""


def transfer_state(
    old: CompiledModel | None,
    new: CompiledModel,
    poses: Mapping[BodyId, Array],
    joint_frames: Mapping[BodyId, tuple[Array, Array]],
    at_rest: set[BodyId],
    changed_boxes: NDArray[np.float64],
) -> None:
    """Sets the state of a new model.

    Args:
        old: the model before, if there was one.
        new: the model to set.
        where: poses of all bodies [m, w x y z].
        ends: the frames of constraints, as in the blueprint.
        at_rest: bodies that were just put somewhere and have no velocity.
        disturbed: k x 2 x 3, boxes (lower and upper corner) in which something changed; what sleeps there wakes up.
    """
    data = new.data
    for top, (_, velocity) in new.free_joint_addresses.items():
        if old is not None and top in old.body_ids and top not in at_rest:  # scenery had no velocity
            data.qvel[velocity : velocity + 6] = _velocity(old, top)
            if top in old.free_joint_addresses:
                before = old.free_joint_addresses[top][1]
                data.qacc_warmstart[velocity : velocity + 6] = old.data.qacc_warmstart[before : before + 6]
    for id, joint in new.joints.items():
        if old is not None and not _copy_joint(old, new, id, joint, at_rest):  # a first model stands as spawned
            set_joint_coordinates(new, joint, current_joint_coordinates(joint, poses, joint_frames[id]))
    mujoco.mj_forward(new.model, data)
    if old is not None:
        _keep_asleep(old, new, changed_boxes)


def current_joint_coordinates(
    joint: ModelJoint, poses: Mapping[BodyId, Array], joint_frames: tuple[Array, Array]
) -> Array:
    """Six coordinates of a joint, from where the two bodies stand; then the quaternion, for a ball."""
    of_parent, of_child = joint.tree_joint.order_ends(joint_frames)
    fixed, moving = (
        pose_multiply(poses[joint.tree_joint.parent], of_parent),
        pose_multiply(poses[joint.tree_joint.child], of_child),
    )
    relative = pose_multiply(pose_inverse(fixed), moving)
    return np.concatenate([joint_coordinates(relative, joint.axes), relative[3:]])


def set_joint_coordinates(compiled: CompiledModel, joint: ModelJoint, coordinates: Array) -> None:
    """Sets a joint's coordinates; its velocity becomes zero."""
    position = joint.qpos_address
    for axis in joint.axes:
        if axis.is_prismatic or not joint.is_ball:
            compiled.data.qpos[position] = coordinates[axis.index]
            position += 1
    if joint.is_ball:
        compiled.data.qpos[position : position + 4] = coordinates[6:]
    compiled.data.qvel[joint.dof_address : joint.dof_address + len(joint.axes)] = 0.0


def _copy_joint(old: CompiledModel, new: CompiledModel, id: BodyId, joint: ModelJoint, at_rest: set[BodyId]) -> bool:
    """Takes a joint's state over as it was; False if it was not the same joint, or its bodies were moved by hand."""
    before = old.joints.get(id)
    if before is None or before.tree_joint.parent != joint.tree_joint.parent or before.axes != joint.axes:
        return False
    if joint.tree_joint.child in at_rest and joint.tree_joint.parent not in at_rest:
        return False
    degrees = len(joint.axes)
    here = slice(joint.qpos_address, joint.qpos_address + degrees + joint.is_ball)
    there = slice(before.qpos_address, before.qpos_address + degrees + joint.is_ball)
    new.data.qpos[here] = old.data.qpos[there]
    here, there = (
        slice(joint.dof_address, joint.dof_address + degrees),
        slice(before.dof_address, before.dof_address + degrees),
    )
    new.data.qvel[here] = old.data.qvel[there]
    new.data.qacc_warmstart[here] = old.data.qacc_warmstart[there]
    return True


def _velocity(old: CompiledModel, id: BodyId) -> Array:
    """A body's velocity as a free joint has it: linear in the world, angular in the body."""
    if id in old.free_joint_addresses:
        start = old.free_joint_addresses[id][1]
        return np.array(old.data.qvel[start : start + 6])
    number = old.body_ids[id]
    both = np.zeros(6)
    mujoco.mj_objectVelocity(old.model, old.data, mujoco.mjtObj.mjOBJ_XBODY, number, both, 0)
    quaternion = np.array(old.data.xquat[number])
    return np.concatenate([both[3:], quat_rotate(quat_conjugate(quaternion), both[:3])])


def _trees_by_body(compiled: CompiledModel) -> dict[BodyId, int]:
    """The tree of each body that the physics moves."""
    trees = compiled.model.body_treeid
    return {id: int(trees[number]) for id, number in compiled.body_ids.items() if trees[number] >= 0}


def _keep_asleep(old: CompiledModel, new: CompiledModel, changed_boxes: NDArray[np.float64]) -> None:
    """Trees that slept go on sleeping; MuJoCo links those that fell asleep together in a circle.

    A circle is kept only if each of its trees is still there and nothing changed near any of them.
    """
    trees = _trees_by_body(new)
    asleep = old.data.tree_asleep
    next_of: dict[int, int] = {}
    tree_of_old: dict[int, int] = {}
    for id, before in _trees_by_body(old).items():
        if id in trees:
            tree_of_old.setdefault(before, trees[id])
    for before, now in tree_of_old.items():
        neighbor = int(asleep[before])
        if neighbor >= 0 and neighbor in tree_of_old:
            next_of[now] = tree_of_old[neighbor]
    stirred = _disturbed_trees(new, changed_boxes)
    kept: set[int] = set()
    for start, following in next_of.items():
        circle, here = [start], following
        while here != start and here in next_of and len(circle) <= len(next_of):
            circle.append(here)
            here = next_of[here]
        if here == start and not stirred.intersection(circle):
            kept.update(circle)
    if kept and _UPDATE_SLEEP is not None:
        for tree in kept:
            new.data.tree_asleep[tree] = next_of[tree]
        _UPDATE_SLEEP(new.model._address, new.data._address)


def wake_islands(compiled: CompiledModel, changed_boxes: NDArray[np.float64]) -> None:
    """Wakes all that sleeps near some boxes (k x 2 x 3), and all that fell asleep together with it.

    MuJoCo itself wakes what has a velocity; this one is too small to matter. What is about to fall asleep begins to
    count anew.
    """
    for tree in _disturbed_trees(compiled, changed_boxes):
        if compiled.data.tree_asleep[tree] >= 0:
            compiled.data.qvel[compiled.model.tree_dofadr[tree]] += 1e-12
        else:
            compiled.data.tree_asleep[tree] = _FULLY_AWAKE


def _disturbed_trees(compiled: CompiledModel, changed_boxes: NDArray[np.float64]) -> set[int]:
    """Trees whose bodies reach into a box in which something changed."""
    if not len(changed_boxes) or not compiled.model.nbody:
        return set()
    trees = compiled.model.body_treeid
    moving = np.flatnonzero(trees >= 0)
    geoms = np.flatnonzero(trees[compiled.model.geom_bodyid] >= 0)
    reach = compiled.model.geom_rbound[geoms, None] + 0.02
    center = compiled.data.geom_xpos[geoms]
    stirred: set[int] = set()
    for low, high in changed_boxes:
        near = np.all((center + reach >= low) & (center - reach <= high), axis=1)
        stirred.update(trees[compiled.model.geom_bodyid[geoms[near]]].tolist())
    return stirred if len(moving) else set()
