"""The regions of a world that MuJoCo simulates, kept up to date through edits and while bodies move."""

from __future__ import annotations

import copy
import time
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from itertools import chain, islice

import numpy as np
from numpy.typing import NDArray

from mindstage.engines.base import DynamicsScale, RebuildTime, SpawnNote, SpawnNoteKind
from mindstage.engines.editing import Performed
from mindstage.engines.edits import RestoreBodies, SetActuators
from mindstage.engines.entity_registry import EntityRegistry
from mindstage.engines.kinematic_tree import KinematicForest
from mindstage.engines.mujoco.arena import ARENA_CAP_BYTES, check_arena
from mindstage.engines.mujoco.compiler import FIXED_MOBILITIES, ModelInput, compile_model
from mindstage.engines.mujoco.model_files import stored_model
from mindstage.engines.mujoco.regions import (
    REGION_BODIES,
    Boxes,
    Region,
    WorldTables,
    assign_units,
    box_meets,
    find_handovers,
    reach_of,
)
from mindstage.engines.mujoco.state import (
    STIFFENING,
    CompiledModel,
    FastContact,
    FastGroup,
    limit_stiffness,
    scale_model,
    set_commands,
    transfer_state,
    wake_islands,
)
from mindstage.engines.physics_model import PhysicsModelBuilder
from mindstage.errors import EngineError
from mindstage.ranges import MAX_SIZE_M
from mindstage.scene import BodyId, Mobility
from mindstage.scene.bounding_boxes import OrientedBoxes
from mindstage.scene.edits import Attach, Delete, Detach, Edit, SetPhysics, Spawn
from mindstage.scene.transforms import Array, normalize, pose_array, pose_inverse, pose_multiply

__all__ = ["MAX_UNCHECKED_STEPS", "ModelCache"]


class ModelCache:
    """A world, the poses of its bodies, and the models of its regions."""

    def __init__(self, timestep_s: float, *, time_s: float = 0.0, arena_cap_bytes: int = ARENA_CAP_BYTES) -> None:
        self.builder = PhysicsModelBuilder()
        self.stale = True
        self.key = object()
        """Identifies the state, apart from highlights."""
        self._timestep_s = timestep_s
        self._time_s = time_s
        self.arena_cap_bytes = arena_cap_bytes
        """The largest size of the memory of a model for contacts and constraints."""
        self.regions: list[Region] = []
        self.tables: WorldTables | None = None
        """Those of the world as it was when the regions were brought up to date last."""
        self._is_joined = False
        """Whether the world is one region, however large it is."""
        self._boxes: Boxes = np.zeros((0, 3)), np.zeros((0, 3))
        """Boxes around all bodies; those of awake ones as they were at the last check, unless there is one region."""
        self._poses = np.zeros((0, 7))
        """Poses of all bodies, in the order of `registry.ids`, except what regions have not written there yet."""
        self._at_rest: set[BodyId] = set()
        self._kinematics_driven = False
        self._changed_boxes: list[Array] = []
        self._fast_bodies: set[BodyId] = set()
        """Bodies that were reported as fast."""
        self._scales: dict[BodyId, DynamicsScale] = {}
        self._limited_servos: set[str] = set()
        """Servos that were reported as too stiff."""
        self.unchecked_steps = 0
        """Number of time steps since falling bodies and the borders of regions were checked."""
        self._is_moved = False
        """Whether a body was moved in place since then."""
        self.fast: dict[BodyId, FastContact] = {}
        """The roots of the groups for which time steps are divided until then."""
        self.last_rebuild: RebuildTime | None = None
        """When the model was compiled last."""
        self._cost_ratio = 1.0
        """The time that the last rebuild took, divided by `_usual_rebuild_s`."""

    def copy(self) -> ModelCache:
        """An independent copy, stale if this one is; compiled models are immutable and shared."""
        result = ModelCache(self._timestep_s, time_s=self._time_s, arena_cap_bytes=self.arena_cap_bytes)
        result.builder, result.stale, result.key = self.builder.copy(), self.stale, self.key
        result.regions, result.tables = [each.copy() for each in self.regions], self.tables
        result._is_joined, result._poses = self._is_joined, self._poses.copy()
        result._boxes = self._boxes[0].copy(), self._boxes[1].copy()
        result._at_rest, result._is_moved = set(self._at_rest), self._is_moved
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
        return self._time_s

    def update(self) -> None:
        """Brings the regions up to date if anything has changed."""
        if self.stale or self.tables is None:
            self._rebuild()

    def model(self, *, with_poses: bool = True) -> CompiledModel:
        """The current model of the whole world, compiled anew if anything changed.

        Args:
            with_poses: whether the poses of its bodies and geoms are needed.
        """
        self.update()
        if not self._is_whole():
            joined = self.copy()
            joined.join()
            return joined.model(with_poses=with_poses)
        compiled = self.regions[0].wake(self._time_s)
        if with_poses:
            compiled.update_poses()
        return compiled

    def model_near(self, ids: Collection[BodyId], within_m: float, boxes: Iterable[Array]) -> CompiledModel:
        """The current model of what is near some bodies or in some boxes; see `MujocoEngine.compiled_near`."""
        self.update()
        if self.tables is None or self._is_whole():
            return self.model()
        self._update_awake_boxes(self.poses())
        near = self.bounds(ids) + np.array([[-within_m], [within_m]])
        within = np.any([box_meets(box, self._boxes) for box in (near, *boxes)], axis=0)
        found = self.tables.unit_of[within]
        units = np.zeros(len(self.tables.unit_sizes), dtype=bool)
        units[found[found >= 0]] = True
        return self._compile_region(self.tables, self.poses(), units, np.zeros((0, 2, 3)), within=within).compiled

    def join(self) -> None:
        """Makes the world one region, and keeps it one."""
        self._is_joined, self.stale = True, self.stale or not self._is_whole()

    def _is_whole(self) -> bool:
        """Whether the world is one region."""
        return len(self.regions) == 1 and bool(np.isinf(self.regions[0].box).all())

    def region_of(self, id: BodyId) -> Region | None:
        """The region that simulates a body; None for one that is fixed."""
        self.update()
        return next((each for each in self.regions if id in each.bodies), None)

    def model_of(self, id: BodyId) -> CompiledModel | None:
        """The model that simulates a body, to be changed; None for a body that is fixed."""
        region = self.region_of(id)
        return None if region is None else region.wake(self._time_s)

    def poses(self) -> Array:
        """Current poses, n x 7, in the order of `registry.ids`."""
        for region in self.regions:
            if not region.is_read:
                is_written = region.is_own if np.isfinite(region.box).all() else region.rows >= 0
                self._poses[region.rows[is_written]] = region.compiled.poses()[is_written]
                region.is_read = True
        return self._poses.copy()

    def poses_by_id(self) -> dict[BodyId, Array]:
        """Current poses by body."""
        return dict(zip(self.registry.ids, self.poses(), strict=True))

    def bounds(self, ids: Iterable[BodyId]) -> Array:
        """The axis-aligned box around some bodies, 2 x 3: lower and upper corner [m]."""
        boxes = self._boxes_of(ids)
        return np.array([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])

    def _boxes_of(self, ids: Iterable[BodyId]) -> Array:
        """The axis-aligned box around each of some bodies, k x 2 x 3: lower and upper corner [m]."""
        selected, rows = list(ids), self.registry.rows
        poses = self.poses()[[rows[id] for id in selected]].reshape(-1, 7)
        return np.stack(OrientedBoxes.from_poses(poses, self.builder.mass_properties.sizes(selected)).bounds(), axis=1)

    def model_input(self, poses: Array | None = None) -> ModelInput:
        """The input for compiling the current world.

        Args:
            poses: the result of `poses`, if the caller has it already.
        """
        tables = WorldTables(self.builder, kinematics_driven=self._kinematics_driven)
        return self._limited(
            tables.model_input(self.builder, self.poses() if poses is None else poses, self._timestep_s)
        )

    def _limited(self, model_input: ModelInput, *before: CompiledModel) -> ModelInput:
        """The input with the sizes of the arena: the largest one, and how much the models before it have used."""
        model_input.arena_cap_bytes = self.arena_cap_bytes
        model_input.arena_used_bytes = max((int(each.data.maxuse_arena) for each in before), default=0)
        return model_input

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
        bodies = chain(self.registry.bodies.values(), edit.world.bodies)
        movable = (each for each in bodies if each.physics.mobility not in FIXED_MOBILITIES)
        check_arena(len(list(islice(movable, 2 * REGION_BODIES))), cap_bytes=self.arena_cap_bytes)
        before = self.poses()
        performed = self.builder.apply(edit, before)
        new_ids = self.registry.ids[len(before) :]
        poses = pose_array(self.registry.bodies[id].pose for id in new_ids)
        poses[:, 3:] = normalize(poses[:, 3:])
        self._poses = np.concatenate([before, poses])
        for id, pose in performed.moved.items():
            self._poses[self.registry.rows[id]] = pose
        self._at_rest.update(performed.moved)
        self.stale = True
        return performed

    def _remove(self, ids: tuple[BodyId, ...]) -> None:
        removed = {self.registry.body(id).id for id in ids}
        if not removed:
            return
        self._changed_boxes.append(self.bounds(removed))
        poses, rows = self.poses(), [self.registry.rows[id] for id in removed]
        self.builder.remove(removed)
        self._poses = np.delete(poses, rows, axis=0)
        self._at_rest -= removed
        self.stale = True
        for region in self.regions:  # a body spawned later with the same id is another body
            if not removed.isdisjoint(region.compiled.rows):
                region.release(removed, self.registry.joints)

    def restore(self, edit: RestoreBodies, displaced: Mapping[BodyId, Array]) -> None:
        """Adds deleted bodies again, after others were moved."""
        self.registry.require_free(edit.ids)
        for id, target in displaced.items():
            if self.builder.is_loose(id):
                self._place(self.builder.connected_bodies(id), id, target)
            else:
                self.move(id, target)
        self.builder.restore(edit, self.poses())
        known = self._poses
        restored = [id for id in self.registry.ids if id in edit.poses]
        self._poses = np.empty((len(self.registry.ids), 7))
        is_restored = np.array([id in edit.poses for id in self.registry.ids], dtype=bool)
        self._poses[~is_restored] = known
        self._poses[is_restored] = [edit.poses[id] for id in restored]
        self.stale = True
        self._changed_boxes.append(self.bounds(edit.poses))

    def move(self, id: BodyId, target: Array) -> None:
        """Moves a body and all bodies that move with it; not for bodies on joints."""
        self.builder.update_attachment_pose(id, target, self.poses())
        self._place(self.builder.bodies_moving_with(id), id, target)

    def _place(self, moving: list[BodyId], id: BodyId, target: Array) -> None:
        """Moves bodies, one of which gets a target pose, rigidly."""
        current, row = self.poses(), self.registry.rows[id]
        self._changed_boxes.append(self.bounds(moving))
        rows = [self.registry.rows[each] for each in moving]
        moved = pose_multiply(pose_multiply(target, pose_inverse(current[row])), current[rows])
        moved[:, 3:] = normalize(moved[:, 3:])
        self._poses[rows] = moved
        self._poses[row] = target
        self.stale = True
        self._at_rest.update(moving)
        self._changed_boxes.append(self.bounds(moving))

    def include_separated_pairs(self, *, are_touching: bool = False) -> None:
        """Lets pairs collide that overlapped when they were added, and are apart now, or `are_touching`."""
        if self.stale or self.tables is None or not self.builder.collision_filter.temporary_pairs:
            return
        if apart := self.builder.separated_pairs(self.poses(), are_touching=are_touching):
            self.builder.include_pairs(apart)
            self.tables = self.tables.without_pairs(apart)
            for region in self.regions:
                if here := [pair for pair in apart if region.compiled.body_ids.keys() >= set(pair)]:
                    region.wake(self._time_s).include_pairs(here)

    def check_free_bodies(self) -> None:
        """Makes bodies static that fell far below the place."""
        self.include_separated_pairs()
        if self.builder.bounds is None:
            return
        for region in self.regions:
            compiled = region.compiled
            if region.is_resting or not compiled.free_joint_addresses:
                continue
            heights = compiled.data.qpos[compiled.free_heights]
            if heights.min() < self.builder.bounds.fall_limit_m:
                positions = compiled.data.qpos[compiled.free_heights[:, None] + np.arange(-2, 1)]
                of_roots = dict(zip(compiled.free_joint_addresses, positions, strict=True))
                if fallen := self.builder.stop_fallen(of_roots):
                    self._at_rest.update(fallen)
                    self.stale = True

    def check(self, *, has_forces: bool) -> bool:
        """Looks ahead to the next check, if that is due: before each call of `step`.

        Returns:
            Whether some regions have other models now.
        """
        is_due, before = not self.unchecked_steps or has_forces, self.regions
        if is_due or self._is_moved:
            self._is_moved = False
            self._hand_over()
            self._find_fast()
        return self.regions is not before

    def step(self, count: int) -> None:
        """Advances time by some steps, at most until bodies are checked again.

        These steps are divided if at their begin a body will hit something that it may pass through. Regions in which
        everything is asleep are not stepped.
        """
        end_s = self._time_s
        for _ in range(count):
            end_s += self._timestep_s
        active = [region for region in self.regions if not region.is_resting]
        for number, region in enumerate(active):
            was_asleep, compiled = region.is_asleep(), region.compiled
            fast = {id: each for id, each in self.fast.items() if id in region.bodies}
            try:
                compiled.step(count, fast=fast)
            except EngineError:
                for each in active[:number]:
                    each.compiled.step_back()
                raise
            region.is_read, region.is_resting = False, was_asleep and region.is_asleep()
        if len(self.regions) == 1 and active:
            end_s = float(active[0].compiled.data.time)
        for region in active:
            region.compiled.data.time = end_s
        self._time_s = end_s
        self.unchecked_steps = (self.unchecked_steps + count) % MAX_UNCHECKED_STEPS

    def _find_fast(self) -> None:
        before, self.fast = self.fast, {}
        for region in self.regions:
            compiled = region.compiled
            if region.is_resting or not compiled.may_be_fast(_MIN_FAST_SPEED):
                continue
            with compiled.at_physical_poses():
                pressed = compiled.pressed_trees()
                for group in compiled.fast_groups(_MIN_FAST_SPEED):
                    is_pressed = compiled.model.body_treeid[compiled.body_ids[group.root]] in pressed
                    if group.root in before or not is_pressed:  # stiff contacts throw out what is deep in soft ones
                        self._check_fast(region, group)

    def _check_fast(self, region: Region, group: FastGroup) -> None:
        """Finds what a group will hit within which the contact force cannot stop it.

        A contact of MuJoCo is a spring with a time constant, not a hard surface: the body moves on for
        `_CONTACT_DURATION_S`, and if it is then in the middle of a thin obstacle, it is pushed out on the other side.
        Shorter time steps allow for stiffer springs.
        """
        compiled, duration_s, id = region.compiled, MAX_UNCHECKED_STEPS * self._timestep_s, group.root
        falls, within_s, gained = group.is_free and compiled.is_falling(id), duration_s, 0.0
        if falls:
            mean = group.velocity - (0.0, 0.0, _GRAVITY_M_S2 * duration_s / 2)
            speed, mean_speed = float(np.linalg.norm(group.velocity)), float(np.linalg.norm(mean))
            within_m = min((speed + _GRAVITY_M_S2 * duration_s) * duration_s, MAX_SIZE_M)
            group, within_s, gained = group._replace(velocity=mean), within_m / mean_speed, mean_speed - speed
        ids = list(compiled.rows)
        for obstacle in compiled.obstacles(group, within_s, _CONTACT_DURATION_S):
            fall_m = obstacle.distance_m * falls
            hit_speed = float(np.sqrt(max(obstacle.speed - gained, 0.0) ** 2 + 2 * _GRAVITY_M_S2 * fall_m))
            thickness_m = min(self.builder.mass_properties.size(ids[obstacle.row]))
            share = hit_speed * _CONTACT_DURATION_S / (min(thickness_m, obstacle.thickness_m) / 2)
            if share <= 1.0:
                continue
            known = self.fast.get(id, FastContact(obstacle.friction, 1.0))
            # A stiff contact with a door or a kinematic body, which are heavy, throws what also touches something else.
            stiffening = STIFFENING if group.is_free else min(max(share, known.stiffening), STIFFENING)
            self.fast[id] = FastContact(min(obstacle.friction, known.friction), stiffening)
            moves_m = hit_speed * _DIVIDED_CONTACT_DURATION_S
            if moves_m > (thickness_m + obstacle.thickness_m) / 2 and id not in self._fast_bodies:
                self._fast_bodies.add(id)
                text = (
                    f"{id} will hit something {obstacle.thickness_m * 1000:.3g} mm thick at {hit_speed:.3g} m/s and "
                    f"moves by {moves_m * 1000:.3g} mm before the contact stops it: it may pass through"
                )
                self.late_notes.append(SpawnNote(SpawnNoteKind.FAST, (id,), text))

    def scale_dynamics(self, scales: Mapping[BodyId, DynamicsScale]) -> None:
        """See `Engine.scale_dynamics`."""
        for id in scales:
            self.registry.body(id)
        self.key = object()
        before, self._scales = self._scales, {**self._scales, **scales}
        boxes = self._boxes_of(scales)
        if self.stale or self.tables is None:
            self._changed_boxes += list(boxes)
            return
        changes = {id: _relative_scale(scale, before.get(id)) for id, scale in scales.items()}
        for region in self.regions:
            here = {id: change for id, change in changes.items() if id in region.compiled.rows}
            if here:
                compiled = region.wake(self._time_s)
                compiled.model = copy.copy(compiled.model)  # forks share it
                scale_model(compiled, self.forest.root_of, here)
        self.disturb(boxes)

    def disturb(self, boxes: NDArray[np.float64]) -> None:
        """Wakes bodies that sleep near some boxes, k x 2 x 3 [m], in which something has changed."""
        self._is_moved = True
        for region in self.regions:
            if len(boxes) and box_meets(region.box, (boxes[:, 0], boxes[:, 1])).any():
                compiled = region.wake(self._time_s)
                compiled.update_poses()
                wake_islands(compiled, boxes)

    def set_commands(self, commands: Mapping[str, float]) -> None:
        """See `Engine.set_commands`."""
        self.builder.actuators.set_commands(commands)
        self.key = object()
        if not self.stale:
            for region in self.regions:
                if region.compiled.actuators.names:
                    set_commands(region.wake(self._time_s), self.builder.actuators.commands)

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
        return self._cost_ratio * self._usual_rebuild_s()

    def _usual_rebuild_s(self) -> float:
        """The time of a rebuild as measured for up to eighty kitchens on one core [s]."""
        bodies = len(self.registry.ids)
        if self.tables is not None and not self._is_whole():  # the new bodies, and two regions
            compiled = min(bodies, max(bodies - len(self.tables.ids), 0) + 2 * REGION_BODIES)
            return 1e-3 + 1e-5 * bodies + 2e-4 * compiled
        return 1e-3 + 2e-4 * bodies + (4e-7 * bodies**2 if self._is_joined else 0.0)

    def _rebuild(self) -> None:
        self.last_rebuild = began = RebuildTime(began_s=time.monotonic())
        usual_s = self._usual_rebuild_s()
        try:
            self._compile()
            took_s = time.monotonic() - began.began_s
            self._cost_ratio = took_s / usual_s
        finally:
            self.last_rebuild = RebuildTime(began_s=began.began_s, ended_s=time.monotonic())

    def _compile(self) -> None:
        """Divides the world among regions, and compiles the models of those in which something has changed."""
        poses, before = self.poses(), self.tables
        self.builder.update_collisions(poses)
        tables = WorldTables(self.builder, kinematics_driven=self._kinematics_driven, before=before)
        changed_boxes: NDArray[np.float64] = np.array(self._changed_boxes).reshape(-1, 2, 3)
        if self._is_joined or tables.is_single:
            everything = np.ones(len(tables.unit_sizes), dtype=bool)
            regions = [self._compile_region(tables, poses, everything, changed_boxes, is_whole=True)]
        else:
            known = self.regions, self._boxes
            self.regions = [replace(region) for region in self.regions]
            try:
                for region in self.regions:
                    region.use_rows(tables)
                self._update_boxes(tables, before, poses)
                regions = self._divide(tables, before, poses, changed_boxes)
            except EngineError:  # it is tried again after the next edit
                self.regions, self._boxes = known
                raise
        self.regions, self.tables, self.stale = regions, tables, False
        self._at_rest, self._changed_boxes = set(), []

    def _divide(
        self,
        tables: WorldTables,
        before: WorldTables | None,
        poses: Array,
        changed_boxes: NDArray[np.float64],
    ) -> list[Region]:
        unit_boxes = tables.unit_boxes(self._boxes)
        changed, is_all = (set(), True) if before is None else tables.changed_since(before)
        rows = [tables.rows[id] for id in changed if id in tables.rows]
        boxes = np.concatenate([changed_boxes, np.stack([each[rows] for each in self._boxes], axis=1)])
        regions = []
        for units, region in assign_units(tables, unit_boxes, self.regions, moved=self._at_rest):
            if (
                region is None
                or is_all
                or not region.is_current
                or not changed.isdisjoint(region.compiled.rows)
                or box_meets(region.box, (boxes[:, 0], boxes[:, 1])).any()
                or not tables.has_bodies(units, region)
            ):
                is_here = np.zeros(len(tables.unit_sizes), dtype=bool)
                is_here[units] = True
                region = self._compile_region(tables, poses, is_here, changed_boxes, unit_boxes=unit_boxes)
            regions.append(region)
        return regions

    def _update_boxes(self, tables: WorldTables, before: WorldTables | None, poses: Array) -> None:
        """Computes the boxes of the bodies that are new or were moved, and of those that may have moved since then."""
        boxes = np.empty((len(tables.ids), 3)), np.empty((len(tables.ids), 3))
        is_old = np.ones(len(tables.ids), dtype=bool)
        if before is not None and tables.sources is not None and len(self._boxes[0]) == len(before.ids):
            is_old = tables.sources < 0
            for new, known in zip(boxes, self._boxes, strict=True):
                new[~is_old] = known[tables.sources[~is_old]]
            is_old[[tables.rows[id] for id in self._at_rest]] = True
            for region in self.regions:
                if not region.is_resting:
                    rows = region.rows[region.is_own]
                    is_old[rows[rows >= 0]] = True
        rows = np.flatnonzero(is_old)
        for known, new in zip(boxes, tables.boxes(poses, rows), strict=True):
            known[rows] = new
        self._boxes = boxes

    def _update_awake_boxes(self, poses: Array) -> None:
        """Computes the boxes of the bodies that may have moved since the last edit or check."""
        assert self.tables is not None
        for region in self.regions:
            if not region.is_resting:
                rows = region.rows[region.is_own]
                for known, new in zip(self._boxes, self.tables.boxes(poses, rows), strict=True):
                    known[rows] = new

    def _compile_region(
        self,
        tables: WorldTables,
        poses: Array,
        units: NDArray[np.bool_],
        changed_boxes: NDArray[np.float64],
        *,
        is_whole: bool = False,
        unit_boxes: Boxes | None = None,
        within: NDArray[np.bool_] | None = None,
    ) -> Region:
        """Compiles the model of some units, in the state that they have in the regions where they are.

        Args:
            tables: the world.
            poses: poses of all bodies.
            units: whether each unit is in the region.
            changed_boxes: boxes in which sleeping bodies wake up, k x 2 x 3 [m].
            is_whole: whether the region is the whole world.
            unit_boxes: boxes within which the units are for some time; by default their present ones.
            within: whether each body is near enough to be in the model; by default those near the units.
        """
        bodies = tables.bodies_of(units)
        found = {id: region.compiled for region in self.regions for id in region.bodies & bodies}
        owners = {id: found[id] for id in sorted(found, key=tables.rows.__getitem__)}
        if is_whole:
            box, model_input = (
                np.array([[-np.inf] * 3, [np.inf] * 3]),
                tables.model_input(self.builder, poses, self._timestep_s),
            )
        else:
            low, high = tables.unit_boxes(self._boxes) if unit_boxes is None else unit_boxes
            box = reach_of(low[units], high[units])
            is_near = box_meets(box, self._boxes) if within is None else within
            model_input = tables.region_input(self.builder, poses, self._timestep_s, units, is_near)
        self._limited(model_input, *{id(each): each for each in owners.values()}.values())
        compiled = compile_model(model_input) if owners else stored_model(model_input)
        compiled.data.time = self._time_s
        if compiled.actuators.names:
            self._report_limited(limit_stiffness(compiled))
        transfer_state(
            owners,
            compiled,
            dict(zip(model_input.rows, model_input.poses, strict=True)),
            self.builder.joint_frames,
            self._at_rest,
            changed_boxes,
            self.builder.actuators.commands,
            is_first=self.tables is None,
            is_same_world=tables is self.tables and not self._scales,
        )
        if scales := {id: scale for id, scale in self._scales.items() if id in compiled.rows}:
            scale_model(compiled, self.forest.root_of, scales)
        frozen = {id: poses[tables.rows[id]] for id in compiled.rows if id not in bodies and tables.moves(id)}
        region = Region(bodies, compiled, box, frozen, is_read=False)
        region.use_rows(tables)
        return region

    def _hand_over(self) -> None:
        """Lets units that may meet before the next check be in one region, and models have what is near."""
        tables = self.tables
        if tables is None or self._is_whole():
            return
        if all(region.is_resting for region in self.regions):
            return
        poses = self.poses()
        self._update_awake_boxes(poses)
        handovers = find_handovers(tables, self.regions, self._boxes, poses, MAX_UNCHECKED_STEPS * self._timestep_s)
        if not handovers.regions:
            return
        nowhere = np.zeros((0, 2, 3))
        compiled = [
            self._compile_region(tables, poses, units, nowhere, unit_boxes=handovers.swept)
            for units, _ in handovers.regions
        ]
        for number in handovers.resting:
            self.regions[number].is_resting = True
        places = {place: new for (_, place), new in zip(handovers.regions, compiled, strict=True) if place is not None}
        for number, region in enumerate(self.regions):
            if number not in places and (moved := {id for new in compiled for id in new.bodies & region.bodies}):
                region.release(moved, self.registry.joints.keys())
        added = [new for (_, place), new in zip(handovers.regions, compiled, strict=True) if place is None]
        kept = [places.get(number, region) for number, region in enumerate(self.regions)]
        self.regions = [region for region in (*kept, *added) if region.bodies]


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
MAX_UNCHECKED_STEPS = 50
"""Number of time steps after which falling bodies and pairs that overlapped are checked."""
