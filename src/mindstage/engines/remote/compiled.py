"""CompiledRemoteEngine: a remote engine that receives a compiled physics model.

A game engine simulates what it is given. Rigid groups, excluded contact pairs, estimated masses and joint frames are
computed here, by the same code as for engines in this process, and sent as differences with each edit. Forces are
collected for the next step, whose response contains all poses: a loop of forces, step and poses costs one call per
step.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import msgspec
import numpy as np

from mindstage.access.limits import Duration
from mindstage.bridge.conversions import (
    BodyModelDelta,
    DriveModelDelta,
    GroundDelta,
    JointModelDelta,
    PhysicsModelDelta,
    geometry_to_json,
    model_delta_to_json,
    point_message,
    pose_message,
    to_json,
    vector_message,
)
from mindstage.engines.base import Actuator, Capability, PoseArray, SpawnNote, SpawnReport
from mindstage.engines.editing import EditingEngine, Performed, is_moved, unsupported_edit
from mindstage.engines.edits import RestoreBodies, SetActuators, SimulatedBodies
from mindstage.engines.entity_registry import EntityRegistry, pose_error
from mindstage.engines.ground import Ground
from mindstage.engines.kinematic_tree import coupled_body_poses
from mindstage.engines.physics_model import (
    BodyModel,
    JointModel,
    PhysicsModelBuilder,
    build_physics_model,
    check_joint_limits,
    joint_positions_from_poses,
)
from mindstage.engines.remote.client import ServiceClient
from mindstage.engines.remote.mindstage import MeshExporter, MindstageRemoteEngine, encode_geometry, encode_world
from mindstage.errors import PoseUnreachableError
from mindstage.msgs import Message, Service
from mindstage.msgs import mindstage_msgs as wire
from mindstage.ranges import Finite, ForceVector, Point, checked
from mindstage.scene import (
    Body,
    BodyGeometry,
    BodyId,
    Color,
    GeometryMap,
    Joint,
    Light,
    Material,
    Pose,
    World,
)
from mindstage.scene.edits import Attach, Delete, Detach, Edit, SetLabel, SetMaterials, SetPhysics, Spawn
from mindstage.scene.transforms import (
    Array,
    normalize,
    normalized_pose_array,
    pose_array,
    pose_from_array,
    pose_inverse,
    pose_multiply,
)

__all__ = ["CompiledRemoteEngine", "ModelState"]


_NO_GROUND = GroundDelta(height_m=None)


@dataclass(frozen=True, slots=True)
class ModelState:
    """The part of a physics model that was sent to a remote engine."""

    bodies: Mapping[BodyId, BodyModelDelta] = field(default_factory=dict)
    excluded_pairs: frozenset[tuple[BodyId, BodyId]] = frozenset()
    joints: Mapping[BodyId, JointModelDelta] = field(default_factory=dict)
    ground: GroundDelta = _NO_GROUND

    @classmethod
    def from_builder(cls, builder: PhysicsModelBuilder) -> ModelState:
        """The state that describes the current model of a builder."""
        model = build_physics_model(builder)
        return cls(
            bodies={id: _body_change(each) for id, each in model.bodies.items()},
            excluded_pairs=model.excluded_pairs,
            joints={id: _joint_change(each) for id, each in model.joints.items()},
            ground=_ground_change(model.ground),
        )

    def diff_to(self, target: ModelState, *, poses: Mapping[BodyId, Pose] | None = None) -> PhysicsModelDelta:
        """What an engine with this state must be sent to have another one; removed bodies are not listed.

        Args:
            target: the other state.
            poses: new poses of bodies that are moved.
        """
        remaining = set(target.bodies)
        joints: dict[BodyId, JointModelDelta | None] = dict.fromkeys(self.joints.keys() - target.joints.keys())
        joints |= {id: joint for id, joint in target.joints.items() if self.joints.get(id) != joint}
        return PhysicsModelDelta(
            bodies={id: body for id, body in target.bodies.items() if self.bodies.get(id) != body},
            excluded_pairs=tuple(sorted(target.excluded_pairs - self.excluded_pairs)),
            included_pairs=tuple(
                sorted(pair for pair in self.excluded_pairs - target.excluded_pairs if remaining.issuperset(pair))
            ),
            joints=joints,
            poses=dict(poses or {}),
            ground=None if self.ground == target.ground else target.ground,
        )


def _ground_change(ground: Ground | None) -> GroundDelta:
    return _NO_GROUND if ground is None else GroundDelta(height_m=ground.height_m, area=ground.area)


def _body_change(model: BodyModel) -> BodyModelDelta:
    return BodyModelDelta(
        size=model.size,
        top=model.root,
        hold=model.pose_in_root,
        mobility=model.mobility,
        gravity=model.gravity,
        mass_kg=model.mass_kg,
        ghost=model.non_colliding,
        collision_shapes=model.collision_shapes,
        friction=model.friction,
        restitution=model.restitution,
        on_ground=model.on_ground,
        inertia=model.inertia,
    )


def _joint_change(model: JointModel) -> JointModelDelta:
    """With the map's parent and child, to which the ranges of the joint refer."""
    parent, child = model.joint.parent, model.joint.child
    ends = model.parent_from_joint, model.child_from_joint
    of_parent, of_child = ends if model.parent == parent else ends[::-1]
    return JointModelDelta(
        parent=parent,
        child=child,
        of_parent=of_parent,
        of_child=of_child,
        linear=model.joint.linear if model.is_limited else None,
        angular=model.joint.angular if model.is_limited else None,
        drives=tuple(_drive_change(axis, each) for axis, each in model.drives),
        is_driven=model.is_driven,
    )


def _drive_change(axis: int, actuator: Actuator) -> DriveModelDelta:
    return DriveModelDelta(
        name=actuator.name,
        axis=axis,
        mode=str(actuator.mode),
        effort_limit=actuator.effort_limit,
        stiffness=actuator.stiffness,
        damping=actuator.damping,
        armature=actuator.armature,
        friction=actuator.friction,
    )


# ruff: noqa: D102 - the methods of an engine are documented in the protocol

_POSE_DTYPE = np.dtype(("<f8", 7))
_MAX_BEYOND_LIMIT = 0.05
"""Limits of joints are soft: physics moves a joint so far beyond its limit at most [m or rad]."""
_POSE_TOLERANCE = 1e-5
"""Rounding error of a single-precision pose some ten meters from the origin [m, rad]."""

_CHECK_PERIOD_S = 0.1
"""The simulated time after which pairs are checked that overlapped when they were added [s]."""
_ROUNDING_S = 1e-9

ModelEdit = Callable[[PhysicsModelBuilder, Array], object]


class CompiledRemoteEngine(EditingEngine, MindstageRemoteEngine):
    """An engine that computes the physics model here and simulates it remotely.

    The remote world may also be edited there, for example by hand in an editor. Bodies added or removed that way are
    taken over when they are noticed, and become part of the model with the next edit.
    """

    def __init__(
        self, client: ServiceClient, *, control_time: bool = True, export_mesh: MeshExporter = lambda geometry: ""
    ) -> None:
        super().__init__(client, control_time=control_time, export_mesh=export_mesh)
        self._builder = PhysicsModelBuilder()
        self._sent_state = ModelState()
        self._forces: list[wire.Force] = []
        self._until_check_s = _CHECK_PERIOD_S
        """The simulated time until pairs that overlapped are checked."""
        self._revision = 0
        self._remote_ids: tuple[BodyId, ...] = ()
        """The bodies of that revision, in the order of its rows."""
        self._pose_rows: Array | None = None
        """Poses of all bodies, n x 7, in the order of the registry, if the last step returned them."""
        self._step_returns_poses = False
        """Whether poses are read after each step."""
        self._current_poses()

    @property
    def capabilities(self) -> frozenset[Capability]:
        return super().capabilities | {Capability.JOINTS}

    # -- the world -----------------------------------------------------------------------------------------------------

    def _entities(self) -> EntityRegistry:
        self._require_open()
        return self._builder.registry

    def _rows(self) -> dict[BodyId, Array]:
        return self._poses_by_id()

    def _described_poses(self) -> dict[BodyId, Pose]:
        registry = self._builder.registry
        rows = self._builder.described_if_settled(self._current_poses())
        now = {id: pose_from_array(row) for id, row in zip(registry.ids, rows, strict=True)}
        return {
            id: now[id] if is_moved(body.pose, now[id], tolerance_m=_POSE_TOLERANCE, tolerance_rad=_POSE_TOLERANCE)
            else body.pose
            for id, body in registry.bodies.items()
        }  # fmt: skip

    def _decisions(self, ids: Collection[BodyId]) -> tuple[SimulatedBodies, Mapping[BodyId, BodyGeometry]]:
        builder = self._builder
        return builder.decisions(ids), {id: builder.geometry[id] for id in ids if id in builder.geometry}

    def _actuators_inverse(self, edit: SetActuators) -> SetActuators:
        self._require_actuators()
        return self._builder.actuators.inverse(edit)

    def _perform(self, edit: Edit) -> Performed:
        match edit:
            case Spawn():
                return self._spawn_compiled(edit)
            case SetMaterials():
                self._call(
                    wire.SetMaterials,
                    wire.SetMaterials.Request(id=edit.id, materials=to_json(edit.materials, tuple[Material, ...])),
                )
                self._builder.registry.change(edit)
            case SetLabel():
                self._call(wire.SetLabel, wire.SetLabel.Request(id=edit.id, label=edit.text))
                self._builder.registry.change(edit)
            case _:
                service, request = _service_of(edit)
                self._apply_edit(service, request, lambda builder, poses: builder.apply(edit, poses))
        return Performed()

    def _spawn_compiled(self, edit: Spawn) -> Performed:
        self.ping()  # detects a world that was reset
        world = edit.world
        poses = np.zeros((0, 7)) if self._world_lost else self._current_poses()
        trial = self._builder.copy()
        performed = trial.apply(edit, poses)
        text, unsent = encode_world(_accepted_part(world, self._builder.registry, trial.registry))
        new = trial.registry.bodies.keys() - self._builder.registry.bodies.keys()
        remote = self._send_world(
            trial, text, {id: edit.geometry[id] for id in edit.geometry if id in new}, performed.moved
        )
        failed = {failure.id for each in (unsent, remote) for failure in each.failed_bodies}
        trial.remove(id for id in trial.registry.ids if id in failed)
        self._commit(trial, ModelState.from_builder(trial))
        return replace(performed, report=_merge_reports(performed.report, unsent, remote))

    def _send_world(
        self, trial: PhysicsModelBuilder, text: str, geometry: GeometryMap, moved: Mapping[BodyId, Array]
    ) -> SpawnReport:
        """Sends bodies that were added to a copy of the builder."""
        change = self._sent_state.diff_to(ModelState.from_builder(trial), poses=_poses_from_arrays(moved))
        usable, _ = encode_geometry(geometry)  # the report of the builder covers the others
        request = wire.SpawnWorld.Request(
            world=text, geometries=geometry_to_json(usable, mesh=self._export_mesh), plan=model_delta_to_json(change)
        )
        return self._spawn(request, entity_count=len(trial.registry.bodies))

    def _restore(self, edit: RestoreBodies, displaced: Mapping[BodyId, Array]) -> None:
        for id, row in displaced.items():
            moving = self._builder.connected_bodies(id) if self._builder.is_loose(id) else None
            self._place(id, pose_from_array(row), moving)
        poses = self._current_poses()
        trial = self._builder.copy()
        trial.restore(edit, poses)
        rows = {id: np.array(row) for id, row in edit.poses.items()}
        bodies = (
            msgspec.structs.replace(body, pose=pose_from_array(rows[body.id])) if is_moved(body.pose, at) else body
            for body in edit.world.bodies
            for at in (pose_from_array(rows[body.id]),)
        )
        part = _accepted_part(
            msgspec.structs.replace(edit.world, bodies=tuple(bodies)), self._builder.registry, trial.registry
        )
        self._send_world(trial, encode_world(part)[0], edit.geometry, {})
        self._commit(trial, ModelState.from_builder(trial))
        if edit.decisions.commands:
            self.set_commands(edit.decisions.commands)

    def snapshot(self) -> World:
        world = super().snapshot()
        settled = self._builder.settled
        if not settled:
            return world
        self._current_poses()  # the registry is that of the snapshot
        ids = self._builder.registry.ids
        row_of = {body.id: row for row, body in enumerate(world.bodies)}
        poses = pose_array(world.bodies[row_of[id]].pose for id in ids)
        poses[:, 3:] = normalize(poses[:, 3:])
        described = self._builder.described_if_settled(poses)
        is_kept = np.any(described != poses, axis=1).tolist()
        given = self._builder.registry.bodies
        kept = {id: given[id].pose for id, keeps in zip(ids, is_kept, strict=True) if keeps}
        bodies = (
            msgspec.structs.replace(body, pose=kept[body.id]) if body.id in kept else body for body in world.bodies
        )
        return msgspec.structs.replace(world, bodies=tuple(bodies))

    def clear(self) -> None:
        super().clear()
        self._reset()

    # -- bodies --------------------------------------------------------------------------------------------------------

    def _set_pose(self, id: BodyId, pose: Pose, *, restores: bool) -> None:
        if reason := pose_error(pose):
            raise PoseUnreachableError(id, reason=reason)
        if id in self._builder.forest.tree_joints:
            tolerance = _MAX_BEYOND_LIMIT if restores else _POSE_TOLERANCE
            check_joint_limits(self._builder, id, normalized_pose_array(pose), self._poses_by_id(), tolerance=tolerance)
        self._place(id, pose)
        self._include_separated_pairs()

    def _place(self, id: BodyId, pose: Pose, moving: Sequence[BodyId] | None = None) -> None:
        """Moves a body, and others with it: by default those that move with it."""
        current, target, builder = self._poses_by_id(), normalized_pose_array(pose), self._builder
        moving = builder.bodies_moving_with(id) if moving is None else moving
        moved = pose_multiply(
            pose_multiply(target, pose_inverse(current[id])), np.array([current[each] for each in moving])
        )
        moved[:, 3:] = normalize(moved[:, 3:])
        poses = dict(zip(moving, map(pose_from_array, moved), strict=True)) | {id: pose}
        now = current | {each: normalized_pose_array(at) for each, at in poses.items()}
        registry = builder.registry
        for other, row in coupled_body_poses(registry.joints, builder.joint_frames, registry.bodies, now, id).items():
            carried = builder.bodies_moving_with(other)
            before = np.array([now[each] for each in carried])
            after = pose_multiply(pose_multiply(row, pose_inverse(now[other])), before)
            poses |= dict(zip(carried, map(pose_from_array, after), strict=True))

        def apply(builder: PhysicsModelBuilder, poses: Array) -> None:
            builder.update_attachment_pose(id, target, poses)
            builder.registry.move(id, pose)

        request = wire.SetPose.Request(id=id, pose=pose_message(pose))
        if id in builder.forest.rigid_parents:
            self._apply_edit(wire.SetPose, request, apply, poses=poses)
        else:  # the model does not change, and a dragged body gets many poses a second
            self._send_edit(wire.SetPose, request, PhysicsModelDelta(poses=poses))
            builder.registry.move(id, pose)

    def highlight(self, ids: Iterable[BodyId], color: Color | None) -> None:
        super().highlight(tuple(self._require_body(id) for id in ids), color)

    @checked
    def apply_force(self, id: BodyId, force: ForceVector, point: Point | None = None) -> None:
        self._require_body(id)
        applied_force = wire.Force(id=id, force=vector_message(force))
        if point is not None:
            applied_force = msgspec.structs.replace(applied_force, at_point=True, point=point_message(point))
        self._forces.append(applied_force)

    # -- actuators -----------------------------------------------------------------------------------------------------

    @checked
    def set_commands(self, commands: Mapping[str, Finite]) -> None:
        self._require_actuators()
        self._builder.actuators.set_commands(commands)
        super().set_commands(commands)

    # -- time ----------------------------------------------------------------------------------------------------------

    @checked
    def step(self, duration_s: Duration) -> None:
        self._builder.mark_simulated()
        forces = tuple(force for force in self._forces if force.id in self._builder.registry.bodies)
        self._forces.clear()
        remaining_s = duration_s
        while self._builder.collision_filter.temporary_pairs and remaining_s > self._until_check_s:
            remaining_s -= self._until_check_s
            self._step_part(self._until_check_s, forces)
        self._step_part(remaining_s, forces)

    def _step_part(self, duration_s: float, forces: tuple[wire.Force, ...]) -> None:
        """Steps until pairs that overlapped are checked, at most."""
        self._step_returns_poses &= self._pose_rows is None
        read_poses, self._pose_rows = self._step_returns_poses, None
        reply = self._step(wire.Step.Request(duration_s=duration_s, forces=forces, packed=read_poses))
        if read_poses and reply.revision == self._revision:
            self._pose_rows = self._in_registry_order(self._unpack_poses("step", reply.rows))
        self._stop_fallen()
        if self._builder.collision_filter.temporary_pairs:
            self._until_check_s -= duration_s
            if self._until_check_s <= _ROUNDING_S:
                self._include_separated_pairs()

    def poses(self) -> tuple[tuple[BodyId, ...], PoseArray]:
        self._require_open().wait_ready()
        rows = self._current_poses()
        self._pose_rows, self._step_returns_poses = None, True  # a second read may follow a remote edit
        return self._builder.registry.ids, rows

    def joint_positions(self) -> Mapping[BodyId, tuple[float, ...]]:
        self._require_open()
        return joint_positions_from_poses(self._builder, self._poses_by_id())

    @property
    def notes(self) -> tuple[SpawnNote, ...]:
        return tuple(self._builder.late_notes)

    @property
    def assumptions(self) -> tuple[str, ...]:
        """See `AssumingEngine`."""
        return self._builder.assumptions

    def _stop_fallen(self) -> None:
        """Makes bodies static that fell far below the place, as far as the last step returned poses."""
        bounds, rows = self._builder.bounds, self._pose_rows
        if bounds is None or rows is None or not len(rows) or rows[:, 2].min() >= bounds.fall_limit_m:
            return
        ids, root_of = self._builder.registry.ids, self._builder.forest.root_of
        positions = {
            id: row[:3]
            for id, row in zip(ids, rows, strict=True)
            if row[2] < bounds.fall_limit_m and root_of[id] == id and self._builder.is_loose(id)
        }
        if not positions:
            return
        trial = self._builder.copy()
        fallen = trial.stop_fallen(positions)
        if not fallen:
            return
        sent = ModelState.from_builder(trial)
        poses = {id: pose_from_array(rows[ids.index(id)]) for id in fallen}
        request = wire.SetPose.Request(id=fallen[0], pose=pose_message(poses[fallen[0]]))
        self._send_edit(wire.SetPose, request, self._sent_state.diff_to(sent, poses=poses))
        self._commit(trial, sent)

    def include_touching_pairs(self) -> None:
        """See `AssumingEngine`."""
        self._include_separated_pairs(are_touching=True)

    def _include_separated_pairs(self, *, are_touching: bool = False) -> None:
        """Lets pairs collide that overlapped when they were added, and are apart now, or `are_touching`."""
        self._until_check_s = _CHECK_PERIOD_S
        if not self._builder.collision_filter.temporary_pairs:
            return
        poses, ids = self._current_poses(), self._builder.registry.ids
        if apart := self._builder.separated_pairs(poses, are_touching=are_touching):
            trial = self._builder.copy()
            trial.include_pairs(apart)
            sent, (id, _) = ModelState.from_builder(trial), min(apart)
            pose = pose_message(pose_from_array(poses[ids.index(id)]))
            self._send_edit(wire.SetPose, wire.SetPose.Request(id=id, pose=pose), self._sent_state.diff_to(sent))
            self._commit(trial, sent)

    # -- edits ---------------------------------------------------------------------------------------------------------

    def _apply_edit(
        self, service: type[Service], request: Message, edit: ModelEdit, *, poses: Mapping[BodyId, Pose] | None = None
    ) -> None:
        """Makes an edit in a copy of the builder, sends it with the resulting changes, and commits it on success."""
        self._require_open()
        before = self._current_poses()
        trial = self._builder.copy()
        edit(trial, before)
        now = dict(zip(self._builder.registry.ids, before, strict=True))
        now |= {id: normalized_pose_array(pose) for id, pose in (poses or {}).items()}
        trial.update_collisions(np.array([now[id] for id in trial.registry.ids]).reshape(-1, 7))
        sent = ModelState.from_builder(trial)
        self._send_edit(service, request, self._sent_state.diff_to(sent, poses=poses))
        self._commit(trial, sent)

    def _send_edit(self, service: type[Service], request: Message, change: PhysicsModelDelta) -> None:
        self._call(service, msgspec.structs.replace(request, plan=model_delta_to_json(change)))
        self._pose_rows = None

    def _commit(self, builder: PhysicsModelBuilder, sent_state: ModelState) -> None:
        self._builder, self._sent_state, self._pose_rows = builder, sent_state, None
        self._ids = builder.registry.ids

    def _require_body(self, id: BodyId) -> BodyId:
        """Returns the id.

        Raises:
            BodyNotFoundError: there is no such body.
        """
        self._require_open()
        return self._builder.registry.body(id).id

    # -- state ---------------------------------------------------------------------------------------------------------

    def _current_poses(self) -> Array:
        """All current poses, n x 7, in the order of the registry."""
        if self._pose_rows is not None:
            return self._pose_rows
        reply: Any = self._call(wire.GetPoses, wire.GetPoses.Request(packed=True, known=self._revision))
        if reply.revision != self._revision:
            self._revision, self._remote_ids = reply.revision, tuple(map(BodyId, reply.ids))
            if set(self._remote_ids) != set(self._builder.registry.ids):
                self._resync()
        return self._in_registry_order(self._unpack_poses("get_poses", reply.rows))

    def _poses_by_id(self) -> dict[BodyId, Array]:
        return dict(zip(self._builder.registry.ids, self._current_poses(), strict=True))

    def _unpack_poses(self, name: str, rows: bytes) -> Array:
        with self._client.validating(name):
            poses = np.frombuffer(rows, dtype=_POSE_DTYPE).astype(np.float64)
            if len(poses) != len(self._remote_ids) or not np.isfinite(poses).all():
                raise ValueError(f"{len(self._remote_ids)} ids and {len(poses)} rows, all of which should be numbers")
            poses[:, 3:] = normalize(poses[:, 3:])
            return poses

    def _in_registry_order(self, rows: Array) -> Array:
        """Rows in the order of the registry, which is that of the remote engine unless others edit its world."""
        ids = self._builder.registry.ids
        if ids == self._remote_ids:
            return rows
        row_of = {id: row for row, id in enumerate(self._remote_ids)}
        return rows[[row_of[id] for id in ids]]

    def _resync(self) -> None:
        """Takes over a world that was edited remotely; the next edit sends the whole model again."""
        before, builder = self._builder, PhysicsModelBuilder()
        world = super().snapshot()
        spawn = Spawn(
            world,
            geometry=before.geometry,
            immovable=frozenset(before.registry.immovable),
            uncertain_poses=before.uncertain_poses,
            settle=False,
        )
        builder.apply(spawn, np.zeros((0, 7)))
        builder.ground, builder.late_notes = before.ground, before.late_notes
        self._commit(builder, ModelState(ground=_ground_change(before.ground)))

    def _reset(self) -> None:
        self._commit(PhysicsModelBuilder(), ModelState())
        self._forces.clear()
        self._revision, self._remote_ids = 0, ()

    def _reconnect(self) -> None:
        super()._reconnect()
        if self._world_lost:
            self._reset()


def _service_of(edit: Edit) -> tuple[type[Service], Message]:
    """The service that makes an edit, and its request."""
    match edit:
        case Delete():
            return wire.Delete, wire.Delete.Request(ids=edit.bodies)
        case Attach():
            return wire.Attach, wire.Attach.Request(parent=edit.parent, child=edit.child)
        case Detach():
            return wire.Detach, wire.Detach.Request(child=edit.child)
        case SetPhysics():
            return wire.SetPhysics, wire.SetPhysics.Request(id=edit.id, physics=to_json(edit.physics))
        case SetActuators():
            text = to_json(edit.actuators, tuple[Actuator, ...])
            return wire.SetActuators, wire.SetActuators.Request(actuators=text, without_weight=edit.without_weight)
    raise unsupported_edit("this remote engine", edit)


P = TypeVar("P", Body, Joint, Light)


def _poses_from_arrays(poses: Mapping[BodyId, Array]) -> dict[BodyId, Pose]:
    return {id: pose_from_array(pose) for id, pose in poses.items()}


def _accepted_part(world: World, before: EntityRegistry, after: EntityRegistry) -> World:
    """The part of a world that was added."""
    attached = {(after.parents[child], child) for child in after.parents.keys() - before.parents.keys()}
    return msgspec.structs.replace(
        world,
        bodies=_added_items(world.bodies, before.bodies, after.bodies),
        joints=_added_items(world.joints, before.joints, after.joints),
        lights=_added_items(world.lights, before.lights, after.lights),
        attachments=tuple(dict.fromkeys(each for each in world.attachments if (each.parent, each.child) in attached)),
    )


def _added_items(parts: Iterable[P], before: Mapping[BodyId, P], after: Mapping[BodyId, P]) -> tuple[P, ...]:
    """The entities that were added; of several with one id, the one that was accepted."""
    added = {part.id: part for part in parts if part.id not in before and after.get(part.id) is part}
    return tuple(added.values())


def _merge_reports(*reports: SpawnReport) -> SpawnReport:
    """Combines the reports of the builder, the encoder and the remote engine."""
    local, unsent, remote = reports
    return msgspec.structs.replace(
        remote,
        failed_bodies=local.failed_bodies + unsent.failed_bodies + remote.failed_bodies,
        failed_joints=local.failed_joints + unsent.failed_joints + remote.failed_joints,
        failed_attachments=local.failed_attachments + remote.failed_attachments,
        notes=local.notes + remote.notes,
    )
