"""MujocoEngine: a world simulated by MuJoCo in this process.

Static bodies are fixed to MuJoCo's world, and so are kinematic ones until one of them is moved; from then on they are
so heavy that nothing changes their prescribed velocities (see `CompiledModel.set_kinematic_pose`). Dynamic bodies have
free joints, or joints of kinematic trees. An edit only marks the model as stale; the next call that needs physics
compiles a new model, once for all edits, and transfers the running state to it (see `transfer_state`).
"""

from __future__ import annotations

import copy
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
from mindstage.engines.kinematic_tree import KinematicForest, joint_coordinates
from mindstage.engines.mujoco.arena import ARENA_CAP_BYTES, check_arena
from mindstage.engines.mujoco.compiler import FIXED_MOBILITIES, ModelInput, compile_model
from mindstage.engines.mujoco.state import (
    CompiledModel,
    ModelJoint,
    actuator_states,
    current_joint_coordinates,
    find_contacts,
    limit_stiffness,
    scale_model,
    set_commands,
    set_joint_coordinates,
    transfer_state,
    wake_islands,
)
from mindstage.engines.physics_model import PhysicsModelBuilder, check_joint_limits
from mindstage.errors import EngineClosedError, PoseUnreachableError, SimulationDivergedError
from mindstage.ranges import MAX_SIZE_M, Count, Finite, ForceVector, Point, TimeStep, checked
from mindstage.scene import BodyGeometry, BodyId, Color, Mobility, Pose, World
from mindstage.scene.bounding_boxes import OrientedBoxes
from mindstage.scene.edits import Attach, Delete, Detach, Edit, SetPhysics, Spawn
from mindstage.scene.joint_kinematics import coupled_positions, first_movable_axis
from mindstage.scene.transforms import (
    Array,
    normalize,
    normalized_pose_array,
    pose_array,
    pose_inverse,
    pose_multiply,
)

__all__ = ["ModelCache", "MujocoEngine", "whole_steps"]


class ModelCache:
    """The input of a MuJoCo model, the poses of all bodies, and the model compiled from them."""

    def __init__(self, timestep_s: float, *, time_s: float = 0.0, arena_cap_bytes: int = ARENA_CAP_BYTES) -> None:
        self.builder = PhysicsModelBuilder()
        self.stale = True
        self.key = object()
        """Identifies the state, apart from highlights."""
        self._timestep_s = timestep_s
        self._time_s = time_s
        self.arena_cap_bytes = arena_cap_bytes
        """The largest size of the memory of a model for contacts and constraints."""
        self._compiled: CompiledModel | None = None
        self._pending_poses: dict[BodyId, Array] = {}
        """Poses that the compiled model does not have yet."""
        self._stale_poses: Array | None = None
        """The result of `poses` while the model is stale."""
        self._at_rest: set[BodyId] = set()
        self._kinematics_driven = False
        self._changed_boxes: list[Array] = []
        self._fast_bodies: set[BodyId] = set()
        """Bodies that were reported as fast."""
        self._scales: dict[BodyId, DynamicsScale] = {}
        self._limited_servos: set[str] = set()
        """Servos that were reported as too stiff."""
        self.unchecked_steps = 0
        """Number of time steps since falling bodies were checked."""
        self.fast: dict[BodyId, float] = {}
        """Bodies for which time steps are divided until then, with the friction of what they hit."""
        self.last_rebuild: RebuildTime | None = None
        """When the model was compiled last."""
        self._cost_ratio = 1.0
        """The time that the last rebuild took, divided by what `_usual_rebuild_s` expects."""

    def copy(self) -> ModelCache:
        """An independent copy, stale if this one is; compiled models are immutable and shared."""
        result = ModelCache(self._timestep_s, time_s=self._time_s, arena_cap_bytes=self.arena_cap_bytes)
        result.builder, result.stale, result.key = self.builder.copy(), self.stale, self.key
        if self._compiled is not None:
            result._compiled = self._compiled.copy()
        result._pending_poses, result._at_rest = dict(self._pending_poses), set(self._at_rest)
        result._stale_poses = self._stale_poses
        result._changed_boxes, result._kinematics_driven = list(self._changed_boxes), self._kinematics_driven
        result._fast_bodies, result._scales = set(self._fast_bodies), dict(self._scales)
        result.unchecked_steps, result._limited_servos = self.unchecked_steps, set(self._limited_servos)
        result.fast = dict(self.fast)
        result.last_rebuild, result._cost_ratio = self.last_rebuild, self._cost_ratio
        return result

    # -- state ------------------------------------------------------------------------------------------------

    @property
    def registry(self) -> EntityRegistry:
        """The bodies, joints and attachments as they were described."""
        return self.builder.registry

    @property
    def forest(self) -> KinematicForest:
        """The rigid groups and how joints connect them."""
        return self.builder.forest

    @property
    def late_notes(self) -> list[SpawnNote]:
        """Notes on decisions caused by edits, and warnings of MuJoCo."""
        return self.builder.late_notes

    @property
    def time_s(self) -> float:
        """Simulated time [s]."""
        return self._time_s if self._compiled is None else float(self._compiled.data.time)

    @property
    def last_model(self) -> CompiledModel | None:
        """The model compiled last, stale or not; None before the first one."""
        return self._compiled

    def model(self, *, with_poses: bool = True) -> CompiledModel:
        """The current model, compiled anew if anything changed.

        Args:
            with_poses: whether the poses of its bodies and geoms are needed.
        """
        if self.stale or self._compiled is None:
            self._rebuild()
        assert self._compiled is not None
        if with_poses:
            self._compiled.update_poses()
        return self._compiled

    def poses(self) -> Array:
        """Current poses, n x 7, in the order of `registry.ids`."""
        if not self.stale and self._compiled is not None:
            return self._compiled.poses()
        if self._stale_poses is None:
            self._stale_poses = self._compute_stale_poses()
        return self._stale_poses.copy()

    def _compute_stale_poses(self) -> Array:
        """The poses in the last model, and those that it does not have yet."""
        ids = self.registry.ids
        poses = np.zeros((len(ids), 7))
        if self._compiled is not None:
            known, before = self._compiled.rows, self._compiled.poses()
            old = np.fromiter((known.get(id, -1) for id in ids), dtype=np.intp, count=len(ids))
            poses[old >= 0] = before[old[old >= 0]]
        rows = [row for row, id in enumerate(ids) if id in self._pending_poses]
        if rows:
            poses[rows] = [self._pending_poses[ids[row]] for row in rows]
        return poses

    def poses_by_id(self) -> dict[BodyId, Array]:
        """Current poses by body."""
        return dict(zip(self.registry.ids, self.poses(), strict=True))

    def bounds(self, ids: Iterable[BodyId]) -> Array:
        """The axis-aligned box around some bodies, 2 x 3: lower and upper corner [m]."""
        boxes = self._boxes(ids)
        return np.array([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])

    def _boxes(self, ids: Iterable[BodyId]) -> Array:
        """The axis-aligned box around each of some bodies, k x 2 x 3: lower and upper corner [m]."""
        poses_by_id = self.poses_by_id()
        selected = list(ids)
        poses = np.array([poses_by_id[id] for id in selected]).reshape(-1, 7)
        return np.stack(OrientedBoxes.from_poses(poses, self.builder.mass_properties.sizes(selected)).bounds(), axis=1)

    def model_input(self, poses: Array | None = None) -> ModelInput:
        """The input for compiling the current world.

        Args:
            poses: the result of `poses`, if the caller has it already.
        """
        poses = self.poses() if poses is None else poses
        result = ModelInput.from_builder(
            self.builder, poses, self._timestep_s, kinematics_driven=self._kinematics_driven
        )
        result.arena_cap_bytes = self.arena_cap_bytes
        if self._compiled is not None:
            result.arena_used_bytes = int(self._compiled.data.maxuse_arena)
        return result

    # -- edits -------------------------------------------------------------------------------------------------

    def apply(self, edit: Edit) -> Performed:
        """Makes an edit; see `PhysicsModelBuilder.apply`."""
        if isinstance(edit, Spawn):
            return self._spawn(edit)
        if isinstance(edit, Delete):
            self._remove(edit.bodies)
            return Performed()
        before, was_attached = self.poses(), isinstance(edit, Detach) and edit.child in self.registry.parents
        performed = self.builder.apply(edit, before)
        if isinstance(edit, SetPhysics):
            self._changed_boxes.append(self.bounds([edit.id]))
        self.stale |= was_attached or isinstance(edit, Attach | SetPhysics | SetActuators)
        return performed

    def _spawn(self, edit: Spawn) -> Performed:
        bodies = (*self.registry.bodies.values(), *edit.world.bodies)
        movable = sum(each.physics.mobility not in FIXED_MOBILITIES for each in bodies)
        check_arena(movable, cap_bytes=self.arena_cap_bytes)
        before = self.poses()
        performed = self.builder.apply(edit, before)
        new_ids = self.registry.ids[len(before) :]
        poses = pose_array(self.registry.bodies[id].pose for id in new_ids)
        poses[:, 3:] = normalize(poses[:, 3:])
        self._pending_poses.update(zip(new_ids, poses, strict=True))
        self._pending_poses.update(performed.moved)
        self._at_rest.update(performed.moved)
        self.stale, self._stale_poses = True, None if performed.moved else np.concatenate([before, poses])
        return performed

    def _remove(self, ids: tuple[BodyId, ...]) -> None:
        removed = {self.registry.body(id).id for id in ids}
        if not removed:
            return
        self._changed_boxes.append(self.bounds(removed))
        self.builder.remove(removed)
        for id in removed:
            self._pending_poses.pop(id, None)
        self._at_rest -= removed
        self.stale, self._stale_poses = True, None
        if self._compiled is not None:  # a body spawned later with the same id is another body
            self._compiled = self._compiled.without(removed, remaining_joints=self.registry.joints)

    def restore(self, edit: RestoreBodies, displaced: Mapping[BodyId, Array]) -> None:
        """Adds deleted bodies again, after others were moved."""
        self.registry.require_free(edit.ids)
        for id, target in displaced.items():
            if self.builder.is_loose(id):
                self._place(self.builder.connected_bodies(id), id, target)
            else:
                self.move(id, target)
        self.builder.restore(edit, self.poses())
        self._pending_poses |= {id: np.array(row) for id, row in edit.poses.items()}
        self.stale, self._stale_poses = True, None
        self._changed_boxes.append(self.bounds(edit.poses))

    def move(self, id: BodyId, target: Array) -> None:
        """Moves a body and all bodies that move with it; not for bodies on joints."""
        self.builder.update_attachment_pose(id, target, self.poses())
        self._place(self.builder.bodies_moving_with(id), id, target)

    def _place(self, moving: list[BodyId], id: BodyId, target: Array) -> None:
        """Moves bodies, one of which gets a target pose, rigidly."""
        current = self.poses_by_id()
        self._changed_boxes.append(self.bounds(moving))
        new_from_old = pose_multiply(target, pose_inverse(current[id]))
        moved = pose_multiply(new_from_old, np.array([current[body] for body in moving]))
        moved[:, 3:] = normalize(moved[:, 3:])
        self._pending_poses.update(zip(moving, moved, strict=True))
        self._pending_poses[id] = target
        self.stale, self._stale_poses = True, None
        self._at_rest.update(moving)
        self._changed_boxes.append(self.bounds(moving))

    def include_separated_pairs(self) -> None:
        """Lets pairs collide that overlapped when they were added, and are apart now."""
        if self.stale or self._compiled is None or not self.builder.collision_filter.temporary_pairs:
            return
        if apart := self.builder.separated_pairs(self.poses()):
            self.builder.include_pairs(apart)
            self._compiled.include_pairs(apart)

    def check_free_bodies(self) -> None:
        """Makes bodies static that fell far below the place."""
        self.include_separated_pairs()
        compiled = self._compiled
        if compiled is None or not compiled.free_joint_addresses or self.builder.bounds is None:
            return
        heights = compiled.data.qpos[compiled.free_heights]
        if heights.min() < self.builder.bounds.fall_limit_m:
            of_roots = dict(zip(compiled.free_joint_addresses, heights.tolist(), strict=True))
            if fallen := self.builder.stop_fallen(of_roots):
                self._at_rest.update(fallen)
                self.stale = True

    def step(self, compiled: CompiledModel, count: int, *, has_forces: bool) -> None:
        """Advances time by some steps, at most until bodies are checked again.

        These steps are divided if at their begin a body will hit something that it may pass through.
        """
        if not self.unchecked_steps or has_forces:
            self._find_fast(compiled)
        compiled.step(count, fast=self.fast)
        self.unchecked_steps = (self.unchecked_steps + count) % _MAX_UNCHECKED_STEPS

    def _find_fast(self, compiled: CompiledModel) -> None:
        self.fast = {}
        velocities = compiled.data.qvel[compiled.free_velocities]
        if np.abs(velocities).max(initial=0.0) > _MIN_FAST_SPEED:
            compiled.update_poses()
            roots, pressed = list(compiled.free_joint_addresses), compiled.pressed_trees()
            for row in np.flatnonzero(np.linalg.norm(velocities, axis=1) > _MIN_FAST_SPEED).tolist():
                if compiled.body_ids[roots[row]] not in pressed:
                    self._check_fast(compiled, roots[row], velocities[row])

    def _check_fast(self, compiled: CompiledModel, id: BodyId, velocity: Array) -> None:
        """Finds what a body will hit within which the contact force cannot stop it.

        A contact of MuJoCo is a spring with a time constant, not a hard surface: the body moves on for
        `_CONTACT_DURATION_S`, and if it is then in the middle of a thin obstacle, it is pushed out on the other side.
        Shorter time steps allow for stiffer springs. Obstacles are found by rays from the body's corners and center.
        """
        duration_s, falls = _MAX_UNCHECKED_STEPS * self._timestep_s, compiled.is_falling(id)
        mean = velocity + np.array([0.0, 0.0, -_GRAVITY_M_S2 * duration_s / 2]) * falls
        speed, thickness_m = float(np.linalg.norm(velocity)), min(self.builder.mass_properties.size(id))
        end_speed = speed + _GRAVITY_M_S2 * duration_s * falls
        within_m = min(end_speed * duration_s, MAX_SIZE_M)
        for distance_m, obstacle_m, friction in compiled.obstacles(id, mean, within_m=within_m):
            hit_speed = float(np.sqrt(speed**2 + 2 * _GRAVITY_M_S2 * distance_m * falls))
            if hit_speed * _CONTACT_DURATION_S <= min(thickness_m, obstacle_m) / 2:
                continue
            self.fast[id] = min(friction, self.fast.get(id, friction))
            moves_m = hit_speed * _DIVIDED_CONTACT_DURATION_S
            if moves_m > (thickness_m + obstacle_m) / 2 and id not in self._fast_bodies:
                self._fast_bodies.add(id)
                text = (
                    f"{id} will hit something {obstacle_m * 1000:.3g} mm thick at {hit_speed:.3g} m/s and moves by "
                    f"{moves_m * 1000:.3g} mm before the contact stops it: it may pass through"
                )
                self.late_notes.append(SpawnNote(SpawnNoteKind.FAST, (id,), text))

    def scale_dynamics(self, scales: Mapping[BodyId, DynamicsScale]) -> None:
        """See `Engine.scale_dynamics`."""
        for id in scales:
            self.registry.body(id)
        self.key = object()
        before, self._scales = self._scales, {**self._scales, **scales}
        boxes = self._boxes(scales)
        if self.stale or self._compiled is None:
            self._changed_boxes += list(boxes)
        elif scales:
            compiled = self._compiled
            compiled.model = copy.copy(compiled.model)  # forks share it
            changes = {id: _relative_scale(scale, before.get(id)) for id, scale in scales.items()}
            scale_model(compiled, self.forest.root_of, changes)
            wake_islands(compiled, boxes)

    def set_commands(self, commands: Mapping[str, float]) -> None:
        """See `Engine.set_commands`."""
        self.builder.actuators.set_commands(commands)
        self.key = object()
        if not self.stale and self._compiled is not None:
            set_commands(self._compiled, self.builder.actuators.commands)

    def _report_limited(self, stiffness: Mapping[str, float]) -> None:
        for name in sorted(stiffness.keys() - self._limited_servos):
            actuator = self.builder.actuators.actuators[name]
            text = (
                f"the servo {name} has a stiffness of {actuator.stiffness:.3g}, which is unstable with a time step of "
                f"{self._timestep_s:g} s and what it moves: {stiffness[name]:.3g} is simulated"
            )
            self.late_notes.append(SpawnNote(SpawnNoteKind.CLAMPED, (actuator.joint,), text))
        self._limited_servos |= stiffness.keys()

    def enable_kinematic_motion(self, id: BodyId) -> None:
        """Makes kinematic bodies movable in place, when the first of them is moved."""
        group = self.forest.groups.get(id)
        if not self._kinematics_driven and group is not None and group.mobility is Mobility.KINEMATIC:
            self._kinematics_driven = self.stale = True

    @property
    def expected_rebuild_s(self) -> float:
        """How long a rebuild is expected to take [s]."""
        return self._cost_ratio * _usual_rebuild_s(len(self.registry.ids))

    def _rebuild(self) -> None:
        self.last_rebuild = began = RebuildTime(began_s=time.monotonic())
        try:
            self._compile()
            took_s = time.monotonic() - began.began_s
            self._cost_ratio = took_s / _usual_rebuild_s(len(self.registry.ids))
        finally:
            self.last_rebuild = RebuildTime(began_s=began.began_s, ended_s=time.monotonic())

    def _compile(self) -> None:
        poses = self.poses()
        self.builder.update_collisions(poses)
        ids = self.registry.ids
        compiled = compile_model(self.model_input(poses))
        compiled.data.time = self.time_s
        if compiled.actuators.names:
            self._report_limited(limit_stiffness(compiled))
        changed_boxes: NDArray[np.float64] = np.array(self._changed_boxes).reshape(-1, 2, 3)
        transfer_state(
            self._compiled,
            compiled,
            dict(zip(ids, poses, strict=True)),
            self.builder.joint_frames,
            self._at_rest,
            changed_boxes,
            self.builder.actuators.commands,
        )
        if scales := {id: scale for id, scale in self._scales.items() if id in self.registry.bodies}:
            scale_model(compiled, self.forest.root_of, scales)
        self._compiled, self.stale, self._stale_poses = compiled, False, None
        self._pending_poses, self._at_rest, self._changed_boxes = {}, set(), []


def _usual_rebuild_s(bodies: int) -> float:
    """The time of a rebuild by the number of bodies, as measured for one and for ten kitchens on one core [s]."""
    return 1e-3 + 2e-4 * bodies + 4e-7 * bodies**2


def _relative_scale(scale: DynamicsScale, before: DynamicsScale | None) -> DynamicsScale:
    """The factors that replace earlier ones."""
    if before is None:
        return scale
    return DynamicsScale(
        mass=scale.mass / before.mass,
        friction=scale.friction / before.friction,
        joint_friction=scale.joint_friction / before.joint_friction,
    )


_MIN_FAST_SPEED = 0.5
"""Slower bodies pass through nothing [m/s]."""
_CONTACT_DURATION_S = 0.007
"""How long a body moves on after a contact began: for MuJoCo's default time constant divided by e [s]."""
_DIVIDED_CONTACT_DURATION_S = 0.00035
"""The same with time steps in `SUBSTEPS` parts, as measured for blades that fall on thin plates [s]."""
_GRAVITY_M_S2 = 9.81
_MAX_UNCHECKED_STEPS = 50
"""Number of time steps after which falling bodies and pairs that overlapped are checked."""
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

    compiled: CompiledModel
    ids: list[BodyId]
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
        """The wall time of a time step of `_measured_model`, as last measured [s]; infinite before that."""
        self._measured_model: mujoco.MjModel | None = None
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
        self._require_open().model(with_poses=False)

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
            cache.model()  # joint coordinates need a current model
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
        compiled = cache.model(with_poses=bool(self._forces))
        cache.builder.mark_simulated()
        if self._forces:
            self._apply_forces(compiled)
        if compiled.model is not self._measured_model:
            self._measured_model, self._step_wall_s = compiled.model, float("inf")
        remaining = steps
        while remaining > 0:
            count = min(_MAX_UNCHECKED_STEPS - cache.unchecked_steps, remaining)
            began_s = time.monotonic()
            if end_s - began_s < count * self._step_wall_s:
                count = max(1, int((end_s - began_s) / self._step_wall_s))
            cache.step(compiled, count, has_forces=bool(self._forces))
            now_s = time.monotonic()
            self._step_wall_s = (now_s - began_s) / count
            remaining -= count
            if remaining and not cache.unchecked_steps:
                cache.check_free_bodies()
                if cache.stale and wall_s < float("inf"):
                    break
                if cache.stale:
                    compiled = self._continue_with_new_model(cache)
            if now_s >= end_s:
                break
        if self._forces:
            compiled.data.xfrc_applied[:] = 0.0
            if not remaining:
                self._forces.clear()
        cache.late_notes.extend(_check_warnings(compiled))
        if not remaining and not cache.unchecked_steps:
            cache.check_free_bodies()
        return remaining * self._timestep_s

    def _continue_with_new_model(self, cache: ModelCache) -> CompiledModel:
        """The model after a body was stopped within a step; the forces of the step still act."""
        compiled = cache.model()
        if self._forces:
            self._apply_forces(compiled)
        return compiled

    def poses(self) -> tuple[tuple[BodyId, ...], PoseArray]:
        cache = self._require_open()
        return cache.registry.ids, cache.poses()

    def joint_positions(self) -> Mapping[BodyId, tuple[float, ...]]:
        cache = self._require_open()
        compiled, poses = cache.model(), cache.poses()
        known = self._known_joints
        if known is None or known.compiled is not compiled:
            joints = [(id, each.tree_joint.joint) for id, each in compiled.joints.items()]
            ends = [(compiled.rows[joint.parent], compiled.rows[joint.child]) for _, joint in joints]
            rows = np.array(ends, dtype=np.intp).reshape(-1, 2)
            known = _KnownJoints(compiled, [id for id, _ in joints], rows, np.full((len(joints), 2, 7), np.nan), {})
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
            positions[id] = tuple(joint_coordinates(relative, compiled.joints[id].axes).tolist())
        self._known_joints = known._replace(poses=ends_now, positions=positions)
        return positions

    def stats(self) -> EngineStats:
        compiled = self._require_open().last_model
        sleep = np.zeros(0) if compiled is None else compiled.data.body_awake[~compiled.is_kinematic]
        return EngineStats(
            movable=int(np.count_nonzero(sleep >= int(mujoco.mjtSleepState.mjS_ASLEEP))),
            awake=int(np.count_nonzero(sleep == int(mujoco.mjtSleepState.mjS_AWAKE))),
            contacts=0 if compiled is None else int(compiled.data.ncon),
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
        return actuator_states(cache.model(with_poses=False), cache.builder.actuators)

    def contacts(self) -> tuple[Contact, ...]:
        cache = self._require_open()
        return find_contacts(cache.model(), cache.registry.ids)

    def compiled(self) -> CompiledModel:
        """The current model with its state, compiled anew if anything has changed.

        Who sets its state has to call `set_state`; the model is shared with forks and must not be changed.
        """
        return self._require_open().model()

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

    @property
    def notes(self) -> tuple[SpawnNote, ...]:
        """Notes on decisions caused by edits, and warnings of MuJoCo; those of a spawn are in its report."""
        return tuple(self._require_open().late_notes)

    def _require_open(self) -> ModelCache:
        if self._closed:
            raise EngineClosedError(self.name)
        return self._cache

    def _apply_forces(self, compiled: CompiledModel) -> None:
        for id, force, point in self._forces:
            body_id = compiled.body_ids.get(id)
            if body_id is None:
                continue
            compiled.data.xfrc_applied[body_id, :3] += force
            if point is not None:
                compiled.data.xfrc_applied[body_id, 3:] += np.cross(point - compiled.data.xipos[body_id], force)

    def _move_in_place(self, cache: ModelCache, id: BodyId, target: Array, *, restores: bool) -> bool:
        """Moves a body without a new model if it is free, kinematic or on a joint; False for others."""
        cache.enable_kinematic_motion(id)
        compiled = cache.model()
        moving = cache.builder.bodies_moving_with(id)
        if id in compiled.free_joint_addresses:
            qpos, dof = compiled.free_joint_addresses[id]
            compiled.data.qpos[qpos : qpos + 7] = target
            compiled.data.qvel[dof : dof + 6] = 0.0
        elif id in compiled.kinematic_addresses:
            compiled.set_kinematic_pose(id, target, at_once=restores)
        elif (tree_joint := cache.forest.tree_joints.get(id)) is not None:
            tolerance = _MAX_BEYOND_LIMIT if restores else 0.0
            self._set_joint(cache, id, tree_joint.joint.id, target, tolerance)
        else:
            return False
        before = cache.bounds(moving)
        mujoco.mj_kinematics(compiled.model, compiled.data)
        wake_islands(compiled, np.stack([before, cache.bounds(moving)]))
        return True

    def _set_joint(self, cache: ModelCache, id: BodyId, joint_id: BodyId, target: Array, tolerance: float) -> None:
        """Sets the coordinates of the joint that holds a body.

        Raises:
            PoseUnreachableError: the joint does not allow the pose.
        """
        compiled, poses = cache.model(), cache.poses_by_id()
        check_joint_limits(cache.builder, id, target, poses, tolerance=tolerance)
        joint = compiled.joints[joint_id]
        child_from_body = pose_multiply(pose_inverse(poses[id]), poses[joint.tree_joint.child])
        requested = {**poses, joint.tree_joint.child: pose_multiply(target, child_from_body)}
        coordinates = current_joint_coordinates(joint, requested, cache.builder.joint_frames[joint_id])
        coupled = self._coupled_coordinates(cache, id, joint, coordinates, tolerance)
        set_joint_coordinates(compiled, joint, coordinates)
        for other, other_coordinates in coupled:
            set_joint_coordinates(compiled, other, other_coordinates)

    @staticmethod
    def _coupled_coordinates(
        cache: ModelCache, id: BodyId, joint: ModelJoint, coordinates: Array, tolerance: float
    ) -> list[tuple[ModelJoint, Array]]:
        """Joints that are coupled to the one that holds a body, and their coordinates.

        Raises:
            PoseUnreachableError: a coupled joint does not allow its position.
        """
        joints = cache.model().joints
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
