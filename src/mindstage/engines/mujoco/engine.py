"""MujocoEngine: a world in MuJoCo.

Static bodies are fixed to the world, and so are kinematic ones until one of them is moved; then they are mocap bodies.
Dynamic ones move freely, and constraints make kinematic trees of them. An edit only marks the model as stale; the next
call that needs physics builds it once, and what was running goes on (see `carry`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

import mujoco
import numpy as np

from mindstage.engines.contract import (
    Capability,
    EngineStats,
    PoseArray,
    SavedState,
    SpawnNote,
    SpawnNoteKind,
    SpawnReport,
)
from mindstage.engines.inventory import pose_error
from mindstage.engines.joints import joint_coordinates
from mindstage.engines.mujoco.carry import current_joint_coordinates, set_joint_coordinates, wake_islands
from mindstage.engines.mujoco.live import CompiledModel
from mindstage.engines.mujoco.scene import ModelCache
from mindstage.engines.traveling import check_joint_limits
from mindstage.errors import EngineClosedError, PoseUnreachableError, SimulationDivergedError
from mindstage.world import NO_GEOMETRY, BodyId, BodyPhysics, Color, GeometryMap, Material, Pose, Vector, World
from mindstage.world.geometry import (
    Array,
    normalized_pose_array,
    pose_array,
    pose_from_array,
    pose_inverse,
    pose_multiply,
    quat_angle,
)

__all__ = ["MujocoEngine"]

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
