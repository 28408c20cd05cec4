"""PlannedEngine: a far engine that leaves decisions to us.

A game engine moves what it is told to move. Which bodies hang together, what keeps apart, what an unknown mass is and
where a joint lets something go is worked out here, by the same code as for engines in this process, and told with each
edit. Pushes wait here for the step that they are for, and its answer says where everything is then: a loop of pushes,
steps and poses is one question at a time.

Changes: what of a plan a far engine does not know yet.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

import msgspec
import numpy as np

from mindstage.bridge.conversions import (
    BodyModelDelta,
    JointModelDelta,
    PhysicsModelDelta,
    geometry_to_json,
    model_delta_to_json,
    point_message,
    pose_message,
    to_json,
    vector_message,
)
from mindstage.engines.base import Capability, PoseArray, SpawnReport
from mindstage.engines.physics_model import (
    BodyModel,
    JointModel,
    PhysicsModelBuilder,
    check_joint_limits,
    joint_positions_from_poses,
)
from mindstage.engines.registry import EntityRegistry, pose_error
from mindstage.engines.remote.client import ServiceClient
from mindstage.engines.remote.mindstage import MeshExporter, MindstageRemoteEngine, encode_geometry, encode_world
from mindstage.errors import PoseUnreachableError
from mindstage.msgs import Message, Service
from mindstage.msgs import mindstage_msgs as wire
from mindstage.scene import (
    NO_GEOMETRY,
    Body,
    BodyId,
    BodyPhysics,
    Color,
    GeometryMap,
    Joint,
    Light,
    Material,
    Pose,
    Vector,
    World,
)
from mindstage.scene.transforms import (
    Array,
    normalize,
    normalized_pose_array,
    pose_from_array,
    pose_inverse,
    pose_multiply,
)

__all__ = ["CompiledRemoteEngine", "ModelState"]


@dataclass(frozen=True, slots=True)
class ModelState:
    """All that was told of a plan."""

    bodies: Mapping[BodyId, BodyModelDelta] = field(default_factory=dict)
    excluded_pairs: frozenset[tuple[BodyId, BodyId]] = frozenset()
    joints: Mapping[BodyId, JointModelDelta] = field(default_factory=dict)

    @classmethod
    def from_builder(cls, builder: PhysicsModelBuilder) -> ModelState:
        """What there is to be told."""
        plan = builder.build_model()
        return cls(
            bodies={id: _body_change(each) for id, each in plan.bodies.items()},
            excluded_pairs=plan.excluded_pairs,
            joints={id: _joint_change(each) for id, each in plan.joints.items()},
        )

    def diff_to(self, target: ModelState, *, poses: Mapping[BodyId, Pose] | None = None) -> PhysicsModelDelta:
        """What is to be told of another plan by someone who has told this one; what is gone needs no word.

        Args:
            then: the other one.
            poses: of bodies that are put somewhere else.
        """
        here = target.bodies.keys()
        joints: dict[BodyId, JointModelDelta | None] = dict.fromkeys(self.joints.keys() - target.joints.keys())
        joints |= {id: joint for id, joint in target.joints.items() if self.joints.get(id) != joint}
        return PhysicsModelDelta(
            bodies={id: body for id, body in target.bodies.items() if self.bodies.get(id) != body},
            apart=tuple(sorted(target.excluded_pairs - self.excluded_pairs)),
            together=tuple(
                sorted(
                    pair for pair in self.excluded_pairs - target.excluded_pairs if pair[0] in here and pair[1] in here
                )
            ),
            joints=joints,
            poses=dict(poses or {}),
        )


def _body_change(model: BodyModel) -> BodyModelDelta:
    return BodyModelDelta(
        size=model.size,
        top=model.root,
        hold=model.pose_in_root,
        mobility=model.mobility,
        gravity=model.gravity,
        mass_kg=model.mass_kg,
        ghost=model.non_colliding,
        solids=model.collision_shapes,
        friction=model.friction,
        restitution=model.restitution,
    )


def _joint_change(model: JointModel) -> JointModelDelta:
    """As the map has the roles, since that is how it tells the ranges."""
    parent, child = model.joint.parent, model.joint.child
    ends = model.parent_from_joint, model.child_from_joint
    of_parent, of_child = ends if model.parent == parent else ends[::-1]
    return JointModelDelta(parent=parent, child=child, of_parent=of_parent, of_child=of_child)


# ruff: noqa: D102 - the contract documents an engine's methods, once for all

_POSE_DTYPE = np.dtype(("<f8", 7))
_POSE_TOLERANCE = 1e-5
"""Single precision's poses are off by so much in a place of ten meters or so [m, rad]."""

ModelEdit = Callable[[PhysicsModelBuilder, Array], object]


class CompiledRemoteEngine(MindstageRemoteEngine):
    """The contract, where the thinking is done here and the moving there.

    Others may edit that world as well, by hand in an editor. What came or went by that is taken over when it is seen,
    and decided about with the next edit.
    """

    def __init__(
        self, client: ServiceClient, *, control_time: bool = True, export_mesh: MeshExporter = lambda form: ""
    ) -> None:
        super().__init__(client, control_time=control_time, export_mesh=export_mesh)
        self._builder = PhysicsModelBuilder()
        self._sent_state = ModelState()
        self._forces: list[wire.Force] = []
        self._revision = 0
        self._remote_ids: tuple[BodyId, ...] = ()
        """The bodies of that revision, in the order of its rows."""
        self._pose_rows: Array | None = None
        """Where everything is, in the order of the planner's bodies, if a step has just told that."""
        self._step_returns_poses = False
        """Whether somebody looks at the poses after each step."""
        self._current_poses()

    @property
    def capabilities(self) -> frozenset[Capability]:
        return super().capabilities | {Capability.JOINTS}

    # -- the world -----------------------------------------------------------------------------------------------------

    def spawn(self, world: World, *, geometry: GeometryMap = NO_GEOMETRY) -> SpawnReport:
        self.ping()  # whether it is still the world that we know
        where = np.zeros((0, 7)) if self._world_lost else self._current_poses()
        trial = self._builder.copy()
        report = trial.add(world, where, geometry=geometry)
        text, left_out = encode_world(_accepted_part(world, self._builder.registry, trial.registry))
        told = ModelState.from_builder(trial)
        new = trial.registry.bodies.keys() - self._builder.registry.bodies.keys()
        usable, _ = encode_geometry(
            {id: form for id, form in geometry.items() if id in new}
        )  # what is not is noted already
        request = wire.SpawnWorld.Request(
            world=text,
            forms=geometry_to_json(usable, mesh=self._export_mesh),
            plan=model_delta_to_json(self._sent_state.diff_to(told)),
        )
        there = self._spawn(request, entity_count=len(world.bodies) + len(world.joints))
        failed = [failure.id for each in (left_out, there) for failure in each.failed_bodies]
        trial.remove(id for id in trial.registry.ids if id in set(failed))
        self._commit(trial, told if not failed else ModelState.from_builder(trial))
        return _merge_reports(report, left_out, there)

    def clear(self) -> None:
        super().clear()
        self._reset()

    def delete(self, ids: Iterable[BodyId]) -> None:
        wanted = tuple(ids)
        self._apply_edit(wire.Delete, wire.Delete.Request(ids=wanted), lambda planner, where: planner.remove(wanted))

    def attach(self, parent: BodyId, child: BodyId) -> None:
        request = wire.Attach.Request(parent=parent, child=child)
        self._apply_edit(wire.Attach, request, lambda planner, where: planner.attach(parent, child, where))

    def detach(self, child: BodyId) -> None:
        self._apply_edit(wire.Detach, wire.Detach.Request(child=child), lambda planner, where: planner.detach(child))

    # -- bodies --------------------------------------------------------------------------------------------------------

    def set_pose(self, id: BodyId, pose: Pose) -> None:
        self._require_body(id)
        if reason := pose_error(pose):
            raise PoseUnreachableError(id, reason=reason)
        where, target, planner = self._poses_by_id(), normalized_pose_array(pose), self._builder
        if id in planner.forest.tree_joints:
            check_joint_limits(planner, id, target, where, tolerance=_POSE_TOLERANCE)
        moving = planner.bodies_moving_with(id)
        moved = pose_multiply(
            pose_multiply(target, pose_inverse(where[id])), np.array([where[each] for each in moving])
        )
        moved[:, 3:] = normalize(moved[:, 3:])
        poses = dict(zip(moving, map(pose_from_array, moved), strict=True)) | {id: pose}

        def put(planner: PhysicsModelBuilder, where: Array) -> None:
            planner.update_attachment_pose(id, target, where)
            planner.registry.replace(id, pose=pose)

        request = wire.SetPose.Request(id=id, pose=pose_message(pose))
        if id in planner.forest.rigid_parents:
            self._apply_edit(wire.SetPose, request, put, poses=poses)
        else:  # nothing else changes, and what is dragged is put somewhere many times a second
            self._send_edit(wire.SetPose, request, PhysicsModelDelta(poses=poses))
            planner.registry.replace(id, pose=pose)

    def set_physics(self, id: BodyId, physics: BodyPhysics) -> None:
        request = wire.SetPhysics.Request(id=id, physics=to_json(physics))
        self._apply_edit(wire.SetPhysics, request, lambda planner, where: planner.set_physics(id, physics))

    def set_materials(self, id: BodyId, materials: tuple[Material, ...]) -> None:
        self._require_body(id)
        super().set_materials(id, materials)
        self._builder.registry.replace(id, materials=materials)

    def highlight(self, ids: Iterable[BodyId], color: Color | None) -> None:
        super().highlight(tuple(self._require_body(id) for id in ids), color)

    def apply_force(self, id: BodyId, force: Vector, point: Vector | None = None) -> None:
        self._require_body(id)
        push = wire.Force(id=id, force=vector_message(force))
        if point is not None:
            push = msgspec.structs.replace(push, at_point=True, point=point_message(point))
        self._forces.append(push)

    # -- time ----------------------------------------------------------------------------------------------------------

    def step(self, duration_s: float) -> None:
        self._step_returns_poses &= self._pose_rows is None
        wanted, self._pose_rows = self._step_returns_poses, None
        forces = tuple(force for force in self._forces if force.id in self._builder.registry.bodies)
        self._forces.clear()
        reply = self._step(wire.Step.Request(duration_s=duration_s, forces=forces, packed=wanted))
        if wanted and reply.revision == self._revision:
            self._pose_rows = self._in_registry_order(self._unpack_poses("step", reply.rows))

    def poses(self) -> tuple[tuple[BodyId, ...], PoseArray]:
        self._require_open().wait_ready()
        rows = self._current_poses()
        self._pose_rows, self._step_returns_poses = None, True  # who asks again may ask because others move things
        return self._builder.registry.ids, rows

    def joint_positions(self) -> Mapping[BodyId, tuple[float, ...]]:
        self._require_open()
        return joint_positions_from_poses(self._builder, self._poses_by_id())

    # -- edits ---------------------------------------------------------------------------------------------------------

    def _apply_edit(
        self, service: type[Service], request: Message, edit: ModelEdit, *, poses: Mapping[BodyId, Pose] | None = None
    ) -> None:
        """Makes an edit here, tells it with all that it changes, and keeps it if it was done there."""
        self._require_open()
        where = self._current_poses()
        trial = self._builder.copy()
        edit(trial, where)
        now = dict(zip(self._builder.registry.ids, where, strict=True))
        now |= {id: normalized_pose_array(pose) for id, pose in (poses or {}).items()}
        trial.update_collisions(np.array([now[id] for id in trial.registry.ids]).reshape(-1, 7))
        told = ModelState.from_builder(trial)
        self._send_edit(service, request, self._sent_state.diff_to(told, poses=poses))
        self._commit(trial, told)

    def _send_edit(self, service: type[Service], request: Message, change: PhysicsModelDelta) -> None:
        self._call(service, msgspec.structs.replace(request, plan=model_delta_to_json(change)))
        self._pose_rows = None

    def _commit(self, builder: PhysicsModelBuilder, sent_state: ModelState) -> None:
        self._builder, self._sent_state, self._pose_rows = builder, sent_state, None
        self._ids = builder.registry.ids

    def _require_body(self, id: BodyId) -> BodyId:
        """The id.

        Raises:
            BodyNotFoundError: there is no such body.
        """
        self._require_open()
        return self._builder.registry.body(id).id

    # -- what is there -------------------------------------------------------------------------------------------------

    def _current_poses(self) -> Array:
        """All poses now, n x 7, in the order of the planner's bodies."""
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
            read = np.frombuffer(rows, dtype=_POSE_DTYPE).astype(np.float64)
            if len(read) != len(self._remote_ids) or not np.isfinite(read).all():
                raise ValueError(f"{len(self._remote_ids)} ids and {len(read)} rows, all of which should be numbers")
            read[:, 3:] = normalize(read[:, 3:])
            return read

    def _in_registry_order(self, rows: Array) -> Array:
        """Rows in the order of the planner's bodies, which is that of the far engine unless others edit there."""
        ids = self._builder.registry.ids
        if ids == self._remote_ids:
            return rows
        places = {id: row for row, id in enumerate(self._remote_ids)}
        return rows[[places[id] for id in ids]]

    def _resync(self) -> None:
        """Takes over what stands there, which others have changed; with the next edit, all of it is told anew."""
        forms, planner = self._builder.geometry, PhysicsModelBuilder()
        planner.add(self.snapshot(), np.zeros((0, 7)), geometry=forms)
        self._commit(planner, ModelState())

    def _reset(self) -> None:
        self._commit(PhysicsModelBuilder(), ModelState())
        self._forces.clear()
        self._revision, self._remote_ids = 0, ()

    def _reconnect(self) -> None:
        super()._reconnect()
        if self._world_lost:
            self._reset()


P = TypeVar("P", Body, Joint, Light)


def _accepted_part(world: World, before: EntityRegistry, after: EntityRegistry) -> World:
    """What of a world came in."""
    hung = {(after.parents[child], child) for child in after.parents.keys() - before.parents.keys()}
    return msgspec.structs.replace(
        world,
        bodies=_added_items(world.bodies, before.bodies, after.bodies),
        joints=_added_items(world.joints, before.joints, after.joints),
        lights=_added_items(world.lights, before.lights, after.lights),
        attachments=tuple(dict.fromkeys(each for each in world.attachments if (each.parent, each.child) in hung)),
    )


def _added_items(parts: Iterable[P], before: Mapping[BodyId, P], after: Mapping[BodyId, P]) -> tuple[P, ...]:
    """Those that are there now and were not; of several with one id, the one that came in."""
    came = {part.id: part for part in parts if part.id not in before and after.get(part.id) is part}
    return tuple(came.values())


def _merge_reports(*reports: SpawnReport) -> SpawnReport:
    """What was decided here, what could not travel, and what became of it there."""
    here, left_out, there = reports
    return msgspec.structs.replace(
        there,
        failed_bodies=here.failed_bodies + left_out.failed_bodies + there.failed_bodies,
        failed_joints=here.failed_joints + left_out.failed_joints + there.failed_joints,
        failed_attachments=here.failed_attachments + there.failed_attachments,
        notes=here.notes + there.notes,
    )
