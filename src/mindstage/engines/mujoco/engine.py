"""MujocoEngine: a world in MuJoCo.

Static bodies are fixed to the world, and so are kinematic ones until one of them is moved; then they are mocap bodies.
Dynamic ones move freely, and constraints make kinematic trees of them. An edit only marks the model as stale; the next
call that needs physics builds it once, and what was running goes on (see `carry`).

SceneKeeper: everything that a MuJoCo model is made from, kept true while a world is edited.

Edits are cheap: they change what is planned and mark the model as stale. `live` builds it when physics is
needed next, once for all edits since, and carries the running state over.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping
from types import MappingProxyType

import mujoco
import numpy as np
from numpy.typing import NDArray

from mindstage.engines.base import Capability, EngineStats, PoseArray, SavedState, SpawnNote, SpawnNoteKind, SpawnReport
from mindstage.engines.kinematic_tree import KinematicForest, joint_coordinates
from mindstage.engines.mujoco.compiler import ModelInput, compile_model
from mindstage.engines.mujoco.state import (
    CompiledModel,
    current_joint_coordinates,
    set_joint_coordinates,
    transfer_state,
    wake_islands,
)
from mindstage.engines.physics_model import PhysicsModelBuilder, check_joint_limits
from mindstage.engines.registry import EntityRegistry, pose_error
from mindstage.errors import EngineClosedError, PoseUnreachableError, SimulationDivergedError
from mindstage.scene import (
    NO_GEOMETRY,
    BodyId,
    BodyPhysics,
    Color,
    GeometryMap,
    Material,
    Mobility,
    Pose,
    Vector,
    World,
)
from mindstage.scene.bounding_boxes import OrientedBoxes
from mindstage.scene.transforms import (
    Array,
    normalize,
    normalized_pose_array,
    pose_array,
    pose_from_array,
    pose_inverse,
    pose_multiply,
    quat_angle,
)

__all__ = ["ModelCache", "MujocoEngine"]


class ModelCache:
    """The plan, where everything stands, and the model made from both."""

    def __init__(self, timestep_s: float, *, time_s: float = 0.0) -> None:
        self.builder = PhysicsModelBuilder()
        self.stale = True
        self._timestep_s = timestep_s
        self._time_s = time_s
        self._compiled: CompiledModel | None = None
        self._pending_poses: dict[BodyId, Array] = {}
        """Poses that the model does not have yet."""
        self._at_rest: set[BodyId] = set()
        self._kinematics_driven = False
        self._changed_boxes: list[Array] = []

    def copy(self) -> ModelCache:
        """A keeper of its own in the same state, stale if this one is; compiled models never change, so are shared."""
        twin = ModelCache(self._timestep_s, time_s=self._time_s)
        twin.builder, twin.stale = self.builder.copy(), self.stale
        if self._compiled is not None:
            twin._compiled = copy.copy(self._compiled)
            twin._compiled.data = copy.copy(self._compiled.data)
        twin._pending_poses, twin._at_rest = dict(self._pending_poses), set(self._at_rest)
        twin._changed_boxes, twin._kinematics_driven = list(self._changed_boxes), self._kinematics_driven
        return twin

    # -- what there is -----------------------------------------------------------------------------------------

    @property
    def registry(self) -> EntityRegistry:
        """What stands here, as it was described."""
        return self.builder.registry

    @property
    def forest(self) -> KinematicForest:
        """Who hangs on whom now."""
        return self.builder.forest

    @property
    def late_notes(self) -> list[SpawnNote]:
        """What had to be decided because of edits, and what the physics warned of."""
        return self.builder.late_notes

    @property
    def time_s(self) -> float:
        """Simulated time [s]."""
        return self._time_s if self._compiled is None else float(self._compiled.data.time)

    @property
    def last_model(self) -> CompiledModel | None:
        """The model that was built last, stale or not; None before the first."""
        return self._compiled

    def model(self) -> CompiledModel:
        """The model, made anew if anything changed since."""
        if self.stale or self._compiled is None:
            self._rebuild()
        assert self._compiled is not None
        return self._compiled

    def poses(self) -> Array:
        """All poses now, n x 7, in the order of the inventory's ids."""
        if not self.stale and self._compiled is not None:
            return self._compiled.poses()
        ids = self.registry.ids
        poses = np.zeros((len(ids), 7))
        known: Mapping[BodyId, int] = {}
        if self._compiled is not None:
            known, before = self._compiled.rows, self._compiled.poses()
            old = np.fromiter((known.get(id, -1) for id in ids), dtype=np.intp, count=len(ids))
            poses[old >= 0] = before[old[old >= 0]]
        for row, id in enumerate(ids):
            if id in self._pending_poses:
                poses[row] = self._pending_poses[id]
        return poses

    def poses_by_id(self) -> dict[BodyId, Array]:
        """All poses now, by body."""
        return dict(zip(self.registry.ids, self.poses(), strict=True))

    def bounds(self, ids: Iterable[BodyId]) -> Array:
        """The box around some bodies, 2 x 3: lower and upper corner [m]."""
        where = self.poses_by_id()
        wanted = list(ids)
        poses = np.array([where[id] for id in wanted]).reshape(-1, 7)
        low, high = OrientedBoxes.from_poses(poses, self.builder.mass_properties.sizes(wanted)).bounds()
        return np.array([low.min(axis=0), high.max(axis=0)])

    def model_input(self, poses: Array | None = None) -> ModelInput:
        """All that a model of it is made from.

        Args:
            where: all poses, if they are at hand.
        """
        poses = self.poses() if poses is None else poses
        return ModelInput.from_builder(self.builder, poses, self._timestep_s, kinematics_driven=self._kinematics_driven)

    # -- edits -------------------------------------------------------------------------------------------------

    def add(self, world: World, *, geometry: GeometryMap = NO_GEOMETRY) -> SpawnReport:
        """See `Engine.spawn`."""
        before = self.poses()
        report = self.builder.add(world, before, geometry=geometry)
        came = self.registry.ids[len(before) :]
        poses = pose_array(self.registry.bodies[id].pose for id in came)
        poses[:, 3:] = normalize(poses[:, 3:])
        self._pending_poses.update(zip(came, poses, strict=True))
        self.stale = True
        return report

    def remove(self, ids: tuple[BodyId, ...]) -> None:
        """See `Engine.delete`."""
        gone = {self.registry.body(id).id for id in ids}
        if not gone:
            return
        self._changed_boxes.append(self.bounds(gone))
        self.builder.remove(gone)
        for id in gone:
            self._pending_poses.pop(id, None)
        self._at_rest -= gone
        self.stale = True
        if self._compiled is not None:  # what comes under the same name later is something else
            self._compiled = self._compiled.without(gone, remaining_joints=self.registry.joints)

    def attach(self, parent: BodyId, child: BodyId) -> None:
        """See `Engine.attach_parts`."""
        self.builder.attach(parent, child, self.poses())
        self.stale = True

    def detach(self, child: BodyId) -> None:
        """See `Engine.detach`."""
        self.stale |= self.builder.detach(child)

    def set_physics(self, id: BodyId, physics: BodyPhysics) -> None:
        """See `Engine.set_physics`."""
        self.builder.set_physics(id, physics)
        self._changed_boxes.append(self.bounds([id]))
        self.stale = True

    def move(self, id: BodyId, target: Array) -> None:
        """Puts a body, and all that goes with it, somewhere else; for bodies that no joint holds."""
        where = self.poses_by_id()
        moving = self.builder.bodies_moving_with(id)
        self._changed_boxes.append(self.bounds(moving))
        self.builder.update_attachment_pose(id, target, self.poses())
        new_from_old = pose_multiply(target, pose_inverse(where[id]))
        moved = pose_multiply(new_from_old, np.array([where[body] for body in moving]))
        moved[:, 3:] = normalize(moved[:, 3:])
        self._pending_poses.update(zip(moving, moved, strict=True))
        self._pending_poses[id] = target
        self._at_rest.update(moving)
        self._changed_boxes.append(self.bounds(moving))
        self.stale = True

    def enable_kinematic_motion(self, id: BodyId) -> None:
        """Makes kinematic bodies such that they can be moved in place, if this is one and the first that is."""
        assembly = self.forest.groups.get(id)
        if not self._kinematics_driven and assembly is not None and assembly.mobility is Mobility.KINEMATIC:
            self._kinematics_driven = self.stale = True

    def _rebuild(self) -> None:
        where = self.poses()
        self.builder.update_collisions(where)
        ids = self.registry.ids
        new = compile_model(self.model_input(where))
        new.data.time = self.time_s
        disturbed: NDArray[np.float64] = np.array(self._changed_boxes).reshape(-1, 2, 3)
        transfer_state(
            self._compiled, new, dict(zip(ids, where, strict=True)), self.builder.joint_frames, self._at_rest, disturbed
        )
        self._compiled, self.stale = new, False
        self._pending_poses, self._at_rest, self._changed_boxes = {}, set(), []


_POSE_TOLERANCE = 1e-12
"""A pose that differs by less from the described one is the described one [m, rad]; larger numbers round more."""


class MujocoEngine:
    """The contract, kept by MuJoCo."""

    name = "mujoco"
    capabilities = frozenset({Capability.SAVE, Capability.JOINTS, Capability.STATISTICS})

    def __init__(self, *, timestep_s: float = 0.002) -> None:
        """An empty world.

        Args:
            timestep_s: MuJoCo's time step [s].
        """
        self._cache = ModelCache(timestep_s)
        self._timestep_s = timestep_s
        self._pending_s = 0.0
        self._forces: list[tuple[BodyId, Array, Array | None]] = []
        self._closed = False

    @property
    def time_s(self) -> float:
        """See the contract, here and below."""
        return self._require_open().time_s

    def spawn(self, world: World, *, geometry: GeometryMap = NO_GEOMETRY) -> SpawnReport:
        return self._require_open().add(world, geometry=geometry)

    def delete(self, ids: Iterable[BodyId]) -> None:
        self._require_open().remove(tuple(ids))

    def clear(self) -> None:
        self._cache = ModelCache(self._timestep_s, time_s=self._require_open().time_s)
        self._forces.clear()

    def attach(self, parent: BodyId, child: BodyId) -> None:
        self._require_open().attach(parent, child)

    def detach(self, child: BodyId) -> None:
        self._require_open().detach(child)

    def set_pose(self, id: BodyId, pose: Pose) -> None:
        keeper = self._require_open()
        keeper.registry.body(id)
        if reason := pose_error(pose):
            raise PoseUnreachableError(id, reason=reason)
        target = normalized_pose_array(pose)
        if id in keeper.forest.tree_joints:
            keeper.model()  # how far a joint goes is known to the model
        if not keeper.stale and self._move_in_place(keeper, id, target):
            keeper.registry.replace(id, pose=pose)
            return
        keeper.move(id, target)
        keeper.registry.replace(id, pose=pose)

    def set_physics(self, id: BodyId, physics: BodyPhysics) -> None:
        self._require_open().set_physics(id, physics)

    def set_materials(self, id: BodyId, materials: tuple[Material, ...]) -> None:
        self._require_open().registry.replace(id, materials=materials)

    def highlight(self, ids: Iterable[BodyId], color: Color | None) -> None:
        self._require_open().registry.highlight(ids, color)

    def highlights(self) -> Mapping[BodyId, Color]:
        return MappingProxyType(self._require_open().registry.highlighted)

    def apply_force(self, id: BodyId, force: Vector, point: Vector | None = None) -> None:
        self._require_open().registry.body(id)
        self._forces.append(
            (id, np.asarray(force, dtype=float), None if point is None else np.asarray(point, dtype=float))
        )

    def step(self, duration_s: float) -> None:
        keeper = self._require_open()
        self._pending_s += duration_s
        steps = int(self._pending_s / self._timestep_s + 1e-6)
        if steps <= 0:
            return
        self._pending_s = max(0.0, self._pending_s - steps * self._timestep_s)
        live = keeper.model()
        if self._forces:
            self._apply_forces(live)
        mujoco.mj_step(live.model, live.data, nstep=steps)
        mujoco.mj_kinematics(live.model, live.data)
        if self._forces:
            live.data.xfrc_applied[:] = 0.0
            self._forces.clear()
        keeper.late_notes.extend(_check(live))

    def poses(self) -> tuple[tuple[BodyId, ...], PoseArray]:
        keeper = self._require_open()
        return keeper.registry.ids, keeper.poses()

    def joint_positions(self) -> Mapping[BodyId, tuple[float, ...]]:
        keeper = self._require_open()
        live, where = keeper.model(), keeper.poses_by_id()
        positions = {}
        for id, joint in live.joints.items():
            constraint = joint.tree_joint.joint
            of_parent, of_child = keeper.builder.joint_frames[id]
            fixed = pose_multiply(where[constraint.parent], of_parent)
            moving = pose_multiply(where[constraint.child], of_child)
            positions[id] = tuple(joint_coordinates(pose_multiply(pose_inverse(fixed), moving), joint.axes).tolist())
        return positions

    def stats(self) -> EngineStats:
        live = self._require_open().last_model
        sleep = np.zeros(0) if live is None else live.data.body_awake
        return EngineStats(
            movable=int(np.count_nonzero(sleep >= int(mujoco.mjtSleepState.mjS_ASLEEP))),
            awake=int(np.count_nonzero(sleep == int(mujoco.mjtSleepState.mjS_AWAKE))),
            contacts=0 if live is None else int(live.data.ncon),
            timestep_s=self._timestep_s,
        )

    def snapshot(self) -> World:
        keeper = self._require_open()
        keeper.model()  # a log tells what the physics has, not what it is about to be given
        now = keeper.poses()
        given = pose_array(body.pose for body in keeper.registry.bodies.values())
        scale = np.maximum(1.0, np.abs(given[:, :3]).max(axis=1, initial=1.0))
        stayed = (np.abs(now[:, :3] - given[:, :3]).max(axis=1, initial=0.0) <= _POSE_TOLERANCE * scale) & (
            quat_angle(given[:, 3:], now[:, 3:]) <= _POSE_TOLERANCE
        )
        rows = np.flatnonzero(~stayed).tolist()
        return keeper.registry.to_world({keeper.registry.ids[row]: pose_from_array(now[row]) for row in rows})

    def save_state(self) -> SavedState:
        return SavedState(self._require_open().copy())

    def restore_state(self, state: SavedState) -> None:
        self._require_open()
        if not isinstance(state, ModelCache):
            raise TypeError(f"a state that MujocoEngine.save made is needed, not {type(state).__name__}")
        self._cache = state.copy()
        self._forces.clear()
        self._pending_s = 0.0

    def close(self) -> None:
        self._closed = True

    @property
    def notes(self) -> tuple[SpawnNote, ...]:
        """What had to be decided because of edits, and what the physics warned of (a spawn's own are in its report)."""
        return tuple(self._require_open().late_notes)

    def _require_open(self) -> ModelCache:
        if self._closed:
            raise EngineClosedError(self.name)
        return self._cache

    def _apply_forces(self, compiled: CompiledModel) -> None:
        for id, force, at in self._forces:
            number = compiled.body_ids.get(id)
            if number is None:
                continue
            compiled.data.xfrc_applied[number, :3] += force
            if at is not None:
                compiled.data.xfrc_applied[number, 3:] += np.cross(at - compiled.data.xipos[number], force)

    def _move_in_place(self, cache: ModelCache, id: BodyId, target: Array) -> bool:
        """Moves what needs no new model: what is free, kinematic, or on a joint. False for the rest."""
        cache.enable_kinematic_motion(id)
        live = cache.model()
        moving = cache.builder.bodies_moving_with(id)
        if id in live.free_joint_addresses:
            position, velocity = live.free_joint_addresses[id]
            live.data.qpos[position : position + 7] = target
            live.data.qvel[velocity : velocity + 6] = 0.0
        elif id in live.mocap_ids:
            live.data.mocap_pos[live.mocap_ids[id]] = target[:3]
            live.data.mocap_quat[live.mocap_ids[id]] = target[3:]
        elif (branch := cache.forest.tree_joints.get(id)) is not None:
            self._set_joint(cache, id, branch.joint.id, target)
        else:
            return False
        before = cache.bounds(moving)
        mujoco.mj_kinematics(live.model, live.data)
        wake_islands(live, np.stack([before, cache.bounds(moving)]))
        return True

    def _set_joint(self, cache: ModelCache, id: BodyId, joint_id: BodyId, target: Array) -> None:
        """Puts a body on a joint where it is asked to be.

        Raises:
            PoseUnreachableError: its joint does not go there.
        """
        live, where = cache.model(), cache.poses_by_id()
        check_joint_limits(cache.builder, id, target, where)
        joint = live.joints[joint_id]
        child_from_top = pose_multiply(pose_inverse(where[id]), where[joint.tree_joint.child])
        asked = {**where, joint.tree_joint.child: pose_multiply(target, child_from_top)}
        set_joint_coordinates(
            live, joint, current_joint_coordinates(joint, asked, cache.builder.joint_frames[joint_id])
        )


_DIVERGENCE_WARNINGS = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
)


def _check(compiled: CompiledModel) -> list[SpawnNote]:
    """What MuJoCo warned of since the last call.

    Raises:
        SimulationDivergedError: it saw numbers that mean nothing.
    """
    notes = []
    for kind in range(int(mujoco.mjtWarning.mjNWARNING)):
        entry = compiled.data.warning[kind]
        if not entry.number:
            continue
        entry.number = 0
        warning = mujoco.mjtWarning(kind)
        if warning in _DIVERGENCE_WARNINGS:
            body = compiled.model.body(int(compiled.model.dof_bodyid[entry.lastinfo])).name.removeprefix("body:")
            quantity = warning.name.removeprefix("mjWARN_BAD").lower()
            what = f"the {quantity} of {body!r} is not a number or far too large"
            raise SimulationDivergedError(time_s=float(compiled.data.time), what=what)
        text = f"at {compiled.data.time:.3f} s MuJoCo warned: {mujoco.mju_warningText(kind, entry.lastinfo)}"
        notes.append(SpawnNote(SpawnNoteKind.SOLVER, (), text))
    return notes


# MuJoCo counts its warnings, and `_check` tells them; the file that it would write them to as well has no place in
# the folder from which somebody happens to work.
mujoco.set_mju_user_warning(lambda text: None)
