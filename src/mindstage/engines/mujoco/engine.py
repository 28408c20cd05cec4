"""MujocoEngine: a world simulated by MuJoCo in this process.

Static bodies are fixed to MuJoCo's world, and so are kinematic ones until one of them is moved; from then on they are
so heavy that nothing changes their prescribed velocities (see `CompiledModel.set_kinematic_pose`). Dynamic bodies have
free joints, or joints of kinematic trees. A large world has several models (see `regions`). An edit only marks them as
stale; the next call that needs physics compiles new ones where something has changed, once for all edits, and transfers
the running state to them (see `transfer_state`).
"""

from __future__ import annotations

import time
from collections.abc import Collection, Iterable, Mapping
from types import MappingProxyType
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from mindstage.access.limits import Duration
from mindstage.engines.base import (
    ActuatorState,
    Applied,
    Capability,
    Contact,
    DynamicsScale,
    EngineFactory,
    EngineStats,
    PoseArray,
    RebuildTime,
    SavedState,
    SpawnNote,
    SpawnNoteKind,
)
from mindstage.engines.editing import EditingEngine, Performed
from mindstage.engines.edits import RestoreBodies, SetActuators, SimulatedBodies
from mindstage.engines.entity_registry import EntityRegistry, pose_error
from mindstage.engines.kinematic_tree import JointAxis, joint_coordinates
from mindstage.engines.mujoco.arena import ARENA_CAP_BYTES
from mindstage.engines.mujoco.model_cache import MAX_UNCHECKED_STEPS, ModelCache
from mindstage.engines.mujoco.regions import WorldTables
from mindstage.engines.mujoco.state import (
    CompiledModel,
    ModelJoint,
    actuator_states,
    current_joint_coordinates,
    find_contacts,
    set_joint_coordinates,
)
from mindstage.engines.physics_model import check_joint_limits
from mindstage.errors import EngineClosedError, PoseUnreachableError, SimulationDivergedError
from mindstage.ranges import Count, Finite, ForceVector, Length, Point, TimeStep, checked
from mindstage.scene import BodyGeometry, BodyId, Color, Pose, World
from mindstage.scene.edits import Edit
from mindstage.scene.joint_kinematics import coupled_positions, first_movable_axis
from mindstage.scene.transforms import (
    Array,
    normalized_pose_array,
    pose_inverse,
    pose_multiply,
)

__all__ = ["MujocoEngine", "whole_steps"]

_MAX_BEYOND_LIMIT = 0.05
"""Limits of joints are soft: physics moves a joint so far beyond its limit at most [m or rad]."""
_POSE_TOLERANCE = 1e-12
"""Poses that differ by less from the described one are equal to it [m, rad], relative to larger coordinates."""


def whole_steps(duration_s: float, timestep_s: float) -> tuple[int, float]:
    """The number of time steps in a duration [s], and the remainder [s]."""
    steps = int(duration_s / timestep_s + 1e-6)
    return steps, max(0.0, duration_s - steps * timestep_s)


class _KnownJoints(NamedTuple):
    """The result of `MujocoEngine.joint_positions`, of which only joints between moved bodies are computed again."""

    tables: WorldTables | None
    """Those of the world that the joints are of."""
    ids: list[BodyId]
    axes: Mapping[BodyId, tuple[JointAxis, ...]]
    rows: NDArray[np.intp]
    """n x 2: the rows of both ends of each joint in arrays of poses."""
    poses: Array
    """n x 2 x 7: the poses of the ends."""
    positions: Mapping[BodyId, tuple[float, ...]]


class MujocoEngine(EditingEngine):
    """An engine that simulates with MuJoCo."""

    name = "mujoco"
    capabilities = frozenset(
        {
            Capability.SAVE,
            Capability.FORK,
            Capability.CONTACTS,
            Capability.SCALE_DYNAMICS,
            Capability.JOINTS,
            Capability.KINEMATIC_VELOCITIES,
            Capability.STATISTICS,
            Capability.ACTUATORS,
        }
    )

    @checked
    def __init__(self, *, timestep_s: TimeStep = 0.002, memory_cap_bytes: Count = ARENA_CAP_BYTES) -> None:
        """Creates an engine with an empty world.

        Args:
            timestep_s: MuJoCo's time step [s].
            memory_cap_bytes: the most memory that a model may have for contacts, constraints and pairs of bodies.
        """
        self._cache = ModelCache(timestep_s, arena_cap_bytes=memory_cap_bytes)
        self._timestep_s = timestep_s
        self._pending_s = 0.0
        self._step_wall_s = float("inf")
        """The wall time of a time step since the rebuild `_measured`, as last measured [s]; infinite before that."""
        self._measured: RebuildTime | None = None
        self._forces: list[tuple[BodyId, Array, Array | None]] = []
        self._closed = False
        self._known_joints: _KnownJoints | None = None

    @property
    def time_s(self) -> float:
        """See `Engine`; the same holds for the methods below."""
        return self._require_open().time_s

    @property
    def rebuild_pending(self) -> bool:
        """See `RebuildingEngine`."""
        return self._cache.stale and not self._closed

    @property
    def expected_rebuild_s(self) -> float:
        """See `RebuildingEngine`."""
        return self._cache.expected_rebuild_s if self.rebuild_pending else 0.0

    @property
    def last_rebuild(self) -> RebuildTime | None:
        """See `RebuildingEngine`."""
        return self._cache.last_rebuild

    def rebuild(self) -> None:
        """See `RebuildingEngine`."""
        self._require_open().update()

    def apply(self, edit: Edit) -> Applied:
        applied = super().apply(edit)
        self._cache.key = object()
        return applied

    def _entities(self) -> EntityRegistry:
        return self._require_open().registry

    def _perform(self, edit: Edit) -> Performed:
        return self._cache.apply(edit)

    def _restore(self, edit: RestoreBodies, displaced: Mapping[BodyId, Array]) -> None:
        self._cache.restore(edit, displaced)

    def _decisions(self, ids: Collection[BodyId]) -> tuple[SimulatedBodies, Mapping[BodyId, BodyGeometry]]:
        builder = self._cache.builder
        return builder.decisions(ids), {id: builder.geometry[id] for id in ids if id in builder.geometry}

    def _actuators_inverse(self, edit: SetActuators) -> SetActuators:
        return self._cache.builder.actuators.inverse(edit)

    @property
    def state_key(self) -> object:
        return self._cache.key

    def clear(self) -> None:
        self._require_open()
        self._cache = ModelCache(self._timestep_s, arena_cap_bytes=self._cache.arena_cap_bytes)
        self._forces.clear()

    def _set_pose(self, id: BodyId, pose: Pose, *, restores: bool) -> None:
        cache = self._require_open()
        cache.registry.body(id)
        if reason := pose_error(pose):
            raise PoseUnreachableError(id, reason=reason)
        target = normalized_pose_array(pose)
        if id in cache.forest.tree_joints:
            cache.update()  # joint coordinates need a current model
        if cache.stale or not self._move_in_place(cache, id, target, restores=restores):
            cache.move(id, target)
        cache.registry.move(id, pose)
        cache.include_separated_pairs()

    def highlight(self, ids: Iterable[BodyId], color: Color | None) -> None:
        self._require_open().registry.highlight(ids, color)

    def highlights(self) -> Mapping[BodyId, Color]:
        return MappingProxyType(self._require_open().registry.highlighted)

    @checked
    def apply_force(self, id: BodyId, force: ForceVector, point: Point | None = None) -> None:
        cache = self._require_open()
        cache.registry.body(id)
        cache.key = object()
        self._forces.append(
            (id, np.asarray(force, dtype=float), None if point is None else np.asarray(point, dtype=float))
        )

    @checked
    def step(self, duration_s: Duration) -> None:
        self.step_for(duration_s, wall_s=float("inf"))

    @checked
    def step_for(self, duration_s: Duration, *, wall_s: float) -> float:
        """See `InterruptibleEngine`."""
        cache = self._require_open()
        steps, self._pending_s = whole_steps(self._pending_s + duration_s, self._timestep_s)
        if steps <= 0:
            return 0.0
        end_s, cache.key = time.monotonic() + wall_s, object()
        cache.update()
        cache.builder.mark_simulated()
        if cache.last_rebuild is not self._measured:
            self._measured, self._step_wall_s = cache.last_rebuild, float("inf")
        remaining, is_pushed = steps, False
        while remaining > 0:
            count = min(MAX_UNCHECKED_STEPS - cache.unchecked_steps, remaining)
            began_s = time.monotonic()
            if end_s - began_s < count * self._step_wall_s:
                count = max(1, int((end_s - began_s) / self._step_wall_s))
            is_pushed = self._prepare(cache, is_pushed=is_pushed)
            cache.step(count)
            now_s = time.monotonic()
            self._step_wall_s = (now_s - began_s) / count
            remaining -= count
            if remaining and not cache.unchecked_steps:
                cache.check_free_bodies()
                if cache.stale and wall_s < float("inf"):
                    break
            if now_s >= end_s:
                break
        self._end_step(cache, is_done=not remaining)
        return remaining * self._timestep_s

    def _prepare(self, cache: ModelCache, *, is_pushed: bool) -> bool:
        """Brings the regions up to date before steps; returns whether the forces of the step act in all of them."""
        if cache.stale:  # a body was stopped within the step
            cache.update()
            is_pushed = False
        for id, _, _ in self._forces:
            cache.model_of(id)  # its region is awake from now on
        is_changed = cache.check(has_forces=bool(self._forces))
        if self._forces and (is_changed or not is_pushed):
            self._apply_forces(cache)
        return True

    def _end_step(self, cache: ModelCache, *, is_done: bool) -> None:
        """Takes the forces of a step from its regions, reads warnings, and checks falling bodies if that is due."""
        for region in cache.regions:
            if self._forces:
                region.compiled.data.xfrc_applied[:] = 0.0
            cache.late_notes.extend(_check_warnings(region.compiled))
        if is_done:
            self._forces.clear()
            if not cache.unchecked_steps:
                cache.check_free_bodies()

    def poses(self) -> tuple[tuple[BodyId, ...], PoseArray]:
        cache = self._require_open()
        return cache.registry.ids, cache.poses()

    def joint_positions(self) -> Mapping[BodyId, tuple[float, ...]]:
        cache = self._require_open()
        cache.update()
        known, poses = self._known_joints, cache.poses()
        if known is None or known.tables is not cache.tables:
            assert cache.tables is not None
            found = {id: each for region in cache.regions for id, each in region.joints().items()}
            rows = cache.tables.rows
            joints = [each.tree_joint.joint for each in found.values()]
            ends = np.array([(rows[each.parent], rows[each.child]) for each in joints], dtype=np.intp).reshape(-1, 2)
            axes = {id: each.axes for id, each in found.items()}
            known = _KnownJoints(cache.tables, list(found), axes, ends, np.full((len(joints), 2, 7), np.nan), {})
        ends_now = poses[known.rows]
        is_moved = (ends_now != known.poses).any(axis=(1, 2))
        if not is_moved.any():
            self._known_joints = known
            return known.positions
        positions = dict(known.positions)
        for row in np.flatnonzero(is_moved).tolist():
            id = known.ids[row]
            parent_from_frame, child_from_frame = cache.builder.joint_frames[id]
            fixed = pose_multiply(ends_now[row, 0], parent_from_frame)
            moving = pose_multiply(ends_now[row, 1], child_from_frame)
            relative = pose_multiply(pose_inverse(fixed), moving)
            positions[id] = tuple(joint_coordinates(relative, known.axes[id]).tolist())
        self._known_joints = known._replace(poses=ends_now, positions=positions)
        return positions

    def stats(self) -> EngineStats:
        regions = self._require_open().regions
        sleep = np.concatenate([np.zeros(0), *(region.sleep() for region in regions)])
        return EngineStats(
            movable=int(np.count_nonzero(sleep >= int(mujoco.mjtSleepState.mjS_ASLEEP))),
            awake=int(np.count_nonzero(sleep == int(mujoco.mjtSleepState.mjS_AWAKE))),
            contacts=sum(int(region.compiled.data.ncon) for region in regions if not region.is_resting),
            timestep_s=self._timestep_s,
        )

    def snapshot(self) -> World:
        cache = self._require_open()
        poses = cache.builder.described_if_settled(cache.poses())
        return cache.registry.to_world(
            poses,
            joint_frames=cache.builder.joint_frames,
            tolerance_m=_POSE_TOLERANCE,
            tolerance_rad=_POSE_TOLERANCE,
        )

    def save_state(self) -> SavedState:
        return SavedState(self._require_open().copy())

    def restore_state(self, state: SavedState) -> None:
        self._require_open()
        if not isinstance(state, ModelCache):
            raise TypeError(f"expected a state from MujocoEngine.save_state, not {type(state).__name__}")
        self._cache = state.copy()
        self._forces.clear()
        self._pending_s = 0.0

    def scale_dynamics(self, scales: Mapping[BodyId, DynamicsScale]) -> None:
        self._require_open().scale_dynamics(scales)

    @checked
    def set_commands(self, commands: Mapping[str, Finite]) -> None:
        self._require_open().set_commands(commands)

    def actuator_states(self) -> Mapping[str, ActuatorState]:
        cache = self._require_open()
        if not cache.builder.actuators.actuators:
            return {}
        cache.update()
        actuators, states = cache.builder.actuators, dict[str, ActuatorState]()
        for region in cache.regions:
            states |= actuator_states(region.compiled)
        return {
            name: ActuatorState(position=0.0, velocity=0.0, effort=0.0, command=actuators.commands.get(name, 0.0))
            for name in actuators.actuators.keys() - states.keys()
        } | states

    def contacts(self) -> tuple[Contact, ...]:
        cache = self._require_open()
        cache.update()
        ids, regions = cache.registry.ids, [region for region in cache.regions if not region.is_resting]
        found = [find_contacts(region.compiled, region.rows, ids) for region in regions]
        if len(found) == 1 or cache.tables is None:
            return found[0] if found else ()
        rows = cache.tables.rows
        contacts = [contact for each in found for contact in each]
        return tuple(sorted(contacts, key=lambda each: (rows[each.a], len(ids) if each.b is None else rows[each.b])))

    def compiled(self) -> CompiledModel:
        """A model of the whole world with its state.

        For a world with one region it is the model that is simulated: who sets its state has to call `set_state`, and
        it is shared with forks and must not be changed. For a world with several regions it is made for the call.
        """
        return self._require_open().model()

    @checked
    def compiled_near(
        self, ids: Collection[BodyId], *, within_m: Length, boxes: Iterable[PoseArray] = ()
    ) -> CompiledModel:
        """A model of what is within a distance of the box around some bodies, or in other boxes, with its state.

        For a world with one region it is the result of `compiled`. Otherwise it is made for the call, and costs what is
        near: other bodies are not in it, and those of kinematic trees are, wherever their parts are.

        Args:
            ids: the bodies.
            within_m: the distance [m].
            boxes: lower and upper corners of the boxes, 2 x 3 each [m].
        """
        return self._require_open().model_near(ids, within_m, boxes)

    def bounds(self, ids: Iterable[BodyId]) -> Array:
        """The axis-aligned box around some bodies, 2 x 3: lower and upper corner [m].

        Args:
            ids: the bodies; the id of a joint stands for those of its ends that can move.

        Raises:
            KeyError: there is no such body or joint.
        """
        cache = self._require_open()
        joints, forest = cache.registry.joints, cache.forest

        def bodies(id: BodyId) -> Iterable[BodyId]:
            if id not in joints:
                return (id,)
            ends = joints[id].parent, joints[id].child
            return [end for end in ends if forest.groups[forest.root_of[end]].is_dynamic] or ends

        return cache.bounds(body for id in ids for body in bodies(id))

    def join_regions(self) -> None:
        """Simulates the whole world in one model from now on, however large it is."""
        self._require_open().join()

    def fork(self) -> MujocoEngine:
        forked = MujocoEngine(timestep_s=self._timestep_s, memory_cap_bytes=self._cache.arena_cap_bytes)
        forked._cache = self._require_open().copy()
        forked._pending_s, forked._forces = self._pending_s, list(self._forces)
        return forked

    def close(self) -> None:
        self._closed = True

    @property
    def assumptions(self) -> tuple[str, ...]:
        """See `AssumingEngine`."""
        return self._require_open().builder.assumptions

    def include_touching_pairs(self) -> None:
        """See `AssumingEngine`."""
        cache = self._require_open()
        cache.update()
        cache.include_separated_pairs(are_touching=True)

    @property
    def notes(self) -> tuple[SpawnNote, ...]:
        """Notes on decisions caused by edits, and warnings of MuJoCo; those of a spawn are in its report."""
        return tuple(self._require_open().late_notes)

    def _require_open(self) -> ModelCache:
        if self._closed:
            raise EngineClosedError(self.name)
        return self._cache

    def _apply_forces(self, cache: ModelCache) -> None:
        for region in cache.regions:
            region.compiled.data.xfrc_applied[:] = 0.0
        for id, force, point in self._forces:
            compiled = cache.model_of(id)
            if compiled is None:
                continue
            compiled.update_poses()
            body_id = compiled.body_ids[id]
            compiled.data.xfrc_applied[body_id, :3] += force
            if point is not None:
                compiled.data.xfrc_applied[body_id, 3:] += np.cross(point - compiled.data.xipos[body_id], force)

    def _move_in_place(self, cache: ModelCache, id: BodyId, target: Array, *, restores: bool) -> bool:
        """Moves a body without a new model if it is free, kinematic or on a joint; False for others."""
        cache.enable_kinematic_motion(id)
        cache.update()
        moving = cache.builder.bodies_moving_with(id)
        before, compiled = cache.bounds(moving), cache.model_of(id)
        if compiled is None:
            return False
        compiled.update_poses()
        if id in compiled.free_joint_addresses:
            qpos, dof = compiled.free_joint_addresses[id]
            compiled.data.qpos[qpos : qpos + 7] = target
            compiled.data.qvel[dof : dof + 6] = 0.0
        elif id in compiled.kinematic_addresses:
            compiled.set_kinematic_pose(id, target, at_once=restores)
        elif (tree_joint := cache.forest.tree_joints.get(id)) is not None:
            tolerance = _MAX_BEYOND_LIMIT if restores else 0.0
            self._set_joint(cache, compiled, id, tree_joint.joint.id, target, tolerance)
        else:
            return False
        mujoco.mj_kinematics(compiled.model, compiled.data)
        cache.disturb(np.stack([before, cache.bounds(moving)]))
        return True

    def _set_joint(
        self,
        cache: ModelCache,
        compiled: CompiledModel,
        id: BodyId,
        joint_id: BodyId,
        target: Array,
        tolerance: float,
    ) -> None:
        """Sets the coordinates of the joint that holds a body.

        Raises:
            PoseUnreachableError: the joint does not allow the pose.
        """
        poses = cache.poses_by_id()
        check_joint_limits(cache.builder, id, target, poses, tolerance=tolerance)
        joint = compiled.joints[joint_id]
        child_from_body = pose_multiply(pose_inverse(poses[id]), poses[joint.tree_joint.child])
        requested = {**poses, joint.tree_joint.child: pose_multiply(target, child_from_body)}
        coordinates = current_joint_coordinates(joint, requested, cache.builder.joint_frames[joint_id])
        coupled = self._coupled_coordinates(compiled.joints, id, joint, coordinates, tolerance)
        set_joint_coordinates(compiled, joint, coordinates)
        for other, other_coordinates in coupled:
            set_joint_coordinates(compiled, other, other_coordinates)

    @staticmethod
    def _coupled_coordinates(
        joints: Mapping[BodyId, ModelJoint], id: BodyId, joint: ModelJoint, coordinates: Array, tolerance: float
    ) -> list[tuple[ModelJoint, Array]]:
        """Joints that are coupled to the one that holds a body, and their coordinates.

        Raises:
            PoseUnreachableError: a coupled joint does not allow its position.
        """
        described = {each: model_joint.tree_joint.joint for each, model_joint in joints.items()}
        axis = first_movable_axis(joint.tree_joint.joint)
        if axis is None:
            return []
        sign = -1.0 if joint.tree_joint.is_reversed else 1.0
        positions = coupled_positions(described, joint.tree_joint.joint.id, sign * float(coordinates[axis]))
        found = []
        for other_id, position in positions.items():
            other, other_axis = joints[other_id], first_movable_axis(described[other_id])
            if other.is_ball or other_axis is None:
                continue
            value = -position if other.tree_joint.is_reversed else position
            for each in other.axes:
                if (
                    each.index == other_axis
                    and each.limit is not None
                    and abs(value - each.middle) > each.limit + tolerance + 1e-6
                ):
                    reason = f"{other_id!r}, which is coupled to its joint, does not reach {position:.4g}"
                    raise PoseUnreachableError(id, reason=reason)
            row = np.zeros(6)
            row[other_axis] = value
            found.append((other, row))
        return found


_DIVERGENCE_WARNINGS = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
)


def _check_warnings(compiled: CompiledModel) -> list[SpawnNote]:
    """MuJoCo's warnings since the last call.

    Raises:
        SimulationDivergedError: the state is not finite.
    """
    notes: list[SpawnNote] = []
    counts = compiled.data.warning.number.tolist()  # seven numbers: faster in a list than in an array
    if not any(counts):
        return notes
    for kind in (kind for kind, count in enumerate(counts) if count):
        counter = compiled.data.warning[kind]
        counter.number = 0
        warning = mujoco.mjtWarning(kind)
        if warning in _DIVERGENCE_WARNINGS:
            body = compiled.model.body(int(compiled.model.dof_bodyid[counter.lastinfo])).name.removeprefix("body:")
            quantity = warning.name.removeprefix("mjWARN_BAD").lower()
            reason = f"the {quantity} of {body!r} is not finite or far too large"
            raise SimulationDivergedError(time_s=float(compiled.data.time), what=reason)
        text = f"at {compiled.data.time:.3f} s MuJoCo warned: {mujoco.mju_warningText(kind, counter.lastinfo)}"
        notes.append(SpawnNote(SpawnNoteKind.SOLVER, (), text))
    return notes


MUJOCO_ENGINE = EngineFactory(("mujoco",), lambda name, settings: MujocoEngine())


# MuJoCo counts its warnings, and `_check_warnings` reports them. By default it also writes them to a file in the
# current directory.
mujoco.set_mju_user_warning(lambda text: None)
