"""The services of Unreal's UROSWorldControl, with its names, types and behavior, so that its clients work unchanged."""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from mindstage.access.policies import EDIT, READ, SPAWN
from mindstage.bridge.conversions import color_from_code, pose_array_messages, pose_from_message
from mindstage.bridge.conversions_unreal import (
    attachment_from_message,
    body_from_box,
    body_from_message,
    iri_namespace,
    joint_from_message,
    materials_from_lists,
    physics_from_message,
    world_from_request,
)
from mindstage.engines import PoseArray, SpawnReport
from mindstage.errors import AttachmentError, BodyExistsError, BodyNotFoundError, MindstageError, WorldError
from mindstage.msgs import geometry_msgs
from mindstage.msgs import world_control_msgs as wire
from mindstage.rdf.graphs import local_name
from mindstage.ros.diagnostics import DiagnosticsPublisher
from mindstage.ros.engine_services import CheckpointServices
from mindstage.ros.service import ServiceSpec
from mindstage.ros.state import StateReader, free_id, map_iri
from mindstage.scene import Attachment, Body, BodyId, Iri, World
from mindstage.scene.bounding_boxes import OrientedBoxes, overlapping_pairs, penetration_depths
from mindstage.scene.edits import Attach, Delete, SetMaterials, SetPhysics, SetPoses
from mindstage.scene.spatial import SpatialRelation, SpatialRelations
from mindstage.scene.transforms import normalize, pose_array

__all__ = ["WorldControlServices"]


_UNRELATED = "apart"
_CONTACT_TOLERANCE_M = 1e-3
"""Penetration up to which bodies only touch [m]."""
_DEFAULT_SIZE = (0.05, 0.05, 0.05)
"""Size of a body without one [m]."""
"""Timeout of a spawn call without one [s]; a large world takes long."""


def _spatial_relation_name(world: World, one: str, other: str) -> str:
    """Returns the closest spatial relation of one body to another."""
    space = SpatialRelations(world)
    found = {each.relation for each in space.related(subjects=[BodyId(one)], others=[BodyId(other)])}
    return next((relation.value for relation in SpatialRelation if relation in found), _UNRELATED)


def _overlapping_bodies(world: World, body: Body) -> tuple[BodyId, ...]:
    """Returns the bodies that a new body would overlap; bodies that enclose others are ignored."""
    if not any(body.pose.quaternion):
        return ()  # a zero quaternion, which the engine rejects
    enclosing = set(SpatialRelations(replace(world, bodies=(*world.bodies, body))).enclosing_bodies)
    bodies = [each for each in world.bodies if each.id not in enclosing]
    boxes = _oriented_boxes([*bodies, body])
    is_new = np.zeros(len(bodies) + 1, dtype=bool)
    is_new[-1] = True
    overlapping: list[BodyId] = []
    for a, b in overlapping_pairs(boxes, is_new, ~is_new):
        overlaps = penetration_depths(boxes, a, b) > _CONTACT_TOLERANCE_M
        overlapping += (bodies[min(pair)].id for pair in zip(a[overlaps].tolist(), b[overlaps].tolist(), strict=True))
    return tuple(overlapping)


def _oriented_boxes(bodies: list[Body]) -> OrientedBoxes:
    """Returns the oriented bounding boxes of bodies."""
    poses = pose_array(body.pose for body in bodies)
    poses[:, 3:] = normalize(poses[:, 3:])
    return OrientedBoxes.from_poses(
        poses, np.array([body.size or _DEFAULT_SIZE for body in bodies], dtype=np.float64).reshape(-1, 3)
    )


def _socket_pose(state_reader: StateReader, id: str, socket: str) -> PoseArray:
    """Returns the pose of a socket: a body attached to the body, or the body itself without a name.

    Raises:
        BodyNotFoundError: there is no such body, or none of that name is attached to it.
    """
    row = state_reader.pose(id)
    if not socket:
        return row
    attached = [state_reader.body(each.child) for each in state_reader.world().attachments if each.parent == id]
    for body in attached:
        if socket in {body.id, body.label, local_name(body.cls)}:
            return state_reader.pose(body.id)
    raise BodyNotFoundError(socket, known=[body.id for body in attached], world=f"attachments of {id}")


def _row_message(row: PoseArray) -> geometry_msgs.Pose:
    """Converts a row of seven numbers to a message."""
    return pose_array_messages(row[None])[0]


class _RequestedModel(NamedTuple):
    """A model of a call that is to be spawned."""

    body: Body
    attachments: tuple[Attachment, ...]
    number: int = 0
    """Index of the request among those of its batch."""


class WorldControlServices:
    """Services that spawn, move, highlight and query bodies by id."""

    def __init__(self, state_reader: StateReader, diagnostics: DiagnosticsPublisher) -> None:
        self._state_reader = state_reader
        self._simulation = state_reader.simulation
        self._diagnostics = diagnostics
        self._checkpoints = CheckpointServices(state_reader.simulation)

    def services(self) -> Iterator[ServiceSpec]:
        """Yields all services."""
        yield ServiceSpec(wire.SpawnSemanticMap, self.spawn_semantic_map, SPAWN)
        yield ServiceSpec(wire.SpawnModel, self.spawn_models, EDIT, batched=True)
        yield ServiceSpec(wire.SpawnProMesh, self.spawn_pro_mesh, EDIT)
        yield ServiceSpec(wire.SpawnPhysicsConstraint, self.spawn_physics_constraint, EDIT)
        yield ServiceSpec(wire.AttachModelToParent, self.attach, EDIT)
        yield ServiceSpec(wire.DeleteModel, self.delete_model, EDIT)
        yield ServiceSpec(wire.DeleteAll, self.delete_all, EDIT)
        yield ServiceSpec(wire.SetModelPose, self.set_model_pose, EDIT)
        yield ServiceSpec(wire.GetModelPose, self.get_model_pose, READ, quick=True)
        yield ServiceSpec(wire.GetModelSocketPose, self.get_model_socket_pose, READ)
        yield ServiceSpec(wire.SetPhysicsProperties, self.set_physics, EDIT)
        yield ServiceSpec(wire.SetMaterial, self.set_material, EDIT, name="change_material")
        yield ServiceSpec(wire.HighlightModel, self.highlight, EDIT, name="highlight_models")
        yield ServiceSpec(wire.ObjectToObjectState, self.object_to_object_state, READ)
        yield ServiceSpec(wire.Checkpoint, self.checkpoint, EDIT)
        yield ServiceSpec(wire.ResetLevel, self.reset_level, EDIT)
        yield ServiceSpec(wire.MoveObject, self.move_object, EDIT)

    # -- spawning ------------------------------------------------------------------------------------------------------

    def spawn_semantic_map(self, request: wire.SpawnSemanticMap.Request) -> wire.SpawnSemanticMap.Response:
        """Spawns a map; failed objects are listed, with the reasons on the diagnostics."""
        snapshot = self._state_reader.state()
        iri = self._known_map(request) or map_iri(f"spawned_{len(self._simulation.worlds) + 1}")
        world, notes = world_from_request(request, iri=iri, name=local_name(iri), taken=frozenset(snapshot.ids))
        self._diagnostics.report_notes("spawn_semantic_map", notes)
        report = self._simulation.spawn(world)
        self._diagnostics.report_spawn("spawn_semantic_map", report)
        failed_children = {failure.id for failure in report.failed_attachments}
        return wire.SpawnSemanticMap.Response(
            success=report.ok,
            failed_model_ids=tuple(failure.id for failure in report.failed_bodies),
            failed_constraint_ids=tuple(failure.id for failure in report.failed_joints),
            failed_relations=tuple(relation for relation in request.relations if relation.child_id in failed_children),
        )

    def spawn_models(
        self, requests: Sequence[wire.SpawnModel.Request]
    ) -> list[wire.SpawnModel.Response | MindstageError]:
        """Spawns models, each attached to its parent if it has one, in their order and in as few edits as possible.

        Returns:
            The response or the error of each.
        """
        results: dict[int, wire.SpawnModel.Response | MindstageError] = {}
        batch: dict[BodyId, _RequestedModel] = {}
        for index, request in enumerate(requests):
            if request.spawn_collision_check or BodyId(request.parent_id) in batch or BodyId(request.id) in batch:
                results |= self._spawn_batch(batch)  # the request depends on these
                batch = {}
            try:
                model = self._requested_model(request, taken=batch)
            except MindstageError as error:
                results[index] = error
            else:
                if isinstance(model, _RequestedModel):
                    batch[model.body.id] = model._replace(number=index)
                else:
                    results[index] = model
        results |= self._spawn_batch(batch)
        return [results[index] for index in range(len(requests))]

    def _requested_model(
        self, request: wire.SpawnModel.Request, *, taken: Container[BodyId]
    ) -> _RequestedModel | wire.SpawnModel.Response:
        """Returns the body of a request, or the response if it cannot be spawned."""
        rows = self._state_reader.row_by_id(self._state_reader.state())
        id = request.id or free_id(request.name or "Model", rows, taken)
        body, notes = body_from_message(request, id=id, namespace=self._namespace())
        if request.override_name:
            body = replace(body, label=request.override_name)
        etype = ""
        if body.id in rows:
            etype = wire.SpawnModel.Response.ID_TAKEN
            self._diagnostics.report_refusal("spawn_model", BodyExistsError(body.id))
        elif request.spawn_collision_check and (obstacles := _overlapping_bodies(self._simulation.snapshot(), body)):
            etype = wire.SpawnModel.Response.OBSTRUCTED
            self._diagnostics.report_failures("spawn_model", [(body.id, f"it would overlap {', '.join(obstacles)}")])
        if etype:
            return wire.SpawnModel.Response(id=body.id, name=_display_name(body), etype=etype)
        self._diagnostics.report_notes("spawn_model", notes)
        return _RequestedModel(body, self._attachments(body, parent=request.parent_id))

    def _spawn_batch(
        self, batch: Mapping[BodyId, _RequestedModel]
    ) -> dict[int, wire.SpawnModel.Response | MindstageError]:
        """Spawns models in one edit; returns the responses and errors by the index of the request."""
        if not batch:
            return {}
        bodies = tuple(model.body for model in batch.values())
        attachments = tuple(attachment for model in batch.values() for attachment in model.attachments)
        try:
            report = self._simulation.spawn(World(iri=self._iri(), bodies=bodies, attachments=attachments))
        except MindstageError as error:
            if len(batch) == 1 or not isinstance(error, WorldError):
                return {model.number: error for model in batch.values()}
            each = [self._spawn_batch({id: model}) for id, model in batch.items()]  # the world rejected one of them
            return {index: result for results in each for index, result in results.items()}
        self._diagnostics.report_spawn("spawn_model", report)
        failed_ids = {failure.id for failure in (*report.failed_bodies, *report.failed_attachments)}
        return {
            model.number: wire.SpawnModel.Response(id=id, name=_display_name(model.body), success=id not in failed_ids)
            for id, model in batch.items()
        }

    def spawn_pro_mesh(self, request: wire.SpawnProMesh.Request) -> wire.SpawnProMesh.Response:
        """Spawns a box."""
        body = body_from_box(request, id=self._id(request.id, "Box"), namespace=self._namespace())
        success = self._spawn_body("spawn_pro_mesh", body, parent=request.parent_id)
        return wire.SpawnProMesh.Response(id=body.id, name=_display_name(body), success=success)

    def spawn_physics_constraint(
        self, request: wire.SpawnPhysicsConstraint.Request
    ) -> wire.SpawnPhysicsConstraint.Response:
        """Spawns a joint between two bodies."""
        description = request.constraint_description
        id = free_id("Constraint", {each.id for each in self._state_reader.world().joints})
        joint, notes = joint_from_message(description, id=id, namespace=self._namespace())
        self._diagnostics.report_notes("spawn_physics_constraint", notes)
        world = World(iri=self._iri(), joints=(joint,))
        return wire.SpawnPhysicsConstraint.Response(success=self._spawn("spawn_physics_constraint", world))

    def _spawn_body(self, operation: str, body: Body, *, parent: str) -> bool:
        attachments = self._attachments(body, parent=parent)
        return self._spawn(operation, World(iri=self._iri(), bodies=(body,), attachments=attachments))

    def _attachments(self, body: Body, *, parent: str) -> tuple[Attachment, ...]:
        if not parent:
            return ()
        self._state_reader.require([parent])
        return (attachment_from_message(wire.RelationDescription(parent_id=parent, child_id=body.id)),)

    def _spawn(self, operation: str, world: World) -> bool:
        report: SpawnReport = self._simulation.spawn(world)
        self._diagnostics.report_spawn(operation, report)
        return report.ok

    # -- deletion ------------------------------------------------------------------------------------------------------

    def delete_model(self, request: wire.DeleteModel.Request) -> wire.DeleteModel.Response:
        """Deletes a body."""
        self._delete([request.id])
        return wire.DeleteModel.Response(success=True)

    def delete_all(self, request: wire.DeleteAll.Request) -> wire.DeleteAll.Response:
        """Deletes all bodies with a tag; it is not an error if there is none."""

        def has_tag(body: Body) -> bool:
            return any(
                tag.type == request.type_to_delete
                and tag.key == request.key_to_delete
                and (request.ignore_value or tag.value == request.value_to_delete)
                for tag in body.tags
            )

        self._delete([body.id for body in self._state_reader.world().bodies if has_tag(body)])
        return wire.DeleteAll.Response(success=True)

    def _delete(self, ids: Sequence[str]) -> None:
        self._simulation.apply(Delete(tuple(map(BodyId, ids))))

    # -- poses ---------------------------------------------------------------------------------------------------------

    def set_model_pose(self, request: wire.SetModelPose.Request) -> wire.SetModelPose.Response:
        """Sets the pose of a body."""
        self._set_pose(request.id, request)
        return wire.SetModelPose.Response(success=True)

    def move_object(self, request: wire.MoveObject.Request) -> wire.MoveObject.Response:
        """Sets the pose of a body by the name of its actor: an id, or a label that only one body has."""
        self._set_pose(self._id_of_actor(request.Name), request)
        return wire.MoveObject.Response(success=True)

    def get_model_pose(self, request: wire.GetModelPose.Request) -> wire.GetModelPose.Response:
        """Returns the pose of a body."""
        return wire.GetModelPose.Response(pose=_row_message(self._state_reader.pose(request.id)), success=True)

    def get_model_socket_pose(self, request: wire.GetModelSocketPose.Request) -> wire.GetModelSocketPose.Response:
        """Returns the pose of a body that is attached to a body, or of the body itself without a socket name."""
        row = _socket_pose(self._state_reader, request.id, request.socket)
        return wire.GetModelSocketPose.Response(pose=_row_message(row), success=True)

    def object_to_object_state(self, request: wire.ObjectToObjectState.Request) -> wire.ObjectToObjectState.Response:
        """Returns the relation of one body to another: on, inside, above, below, next_to, or apart."""
        self._state_reader.require([request.source_object_id, request.other_object_id])
        state = _spatial_relation_name(self._simulation.snapshot(), request.source_object_id, request.other_object_id)
        return wire.ObjectToObjectState.Response(state=state, success=True)

    def attach(self, request: wire.AttachModelToParent.Request) -> wire.AttachModelToParent.Response:
        """Attaches a body to another one, at their current poses."""
        parent, child = BodyId(request.parent_id), BodyId(request.child_id)
        if parent == child:
            raise AttachmentError(parent, child, reason="a body cannot be attached to itself")
        self._simulation.apply(Attach(parent, child))
        return wire.AttachModelToParent.Response(success=True)

    def _set_pose(self, id: str, request: wire.SetModelPose.Request | wire.MoveObject.Request) -> None:
        self._simulation.apply(SetPoses({BodyId(id): pose_from_message(request.pose)}))

    def _id_of_actor(self, name: str) -> str:
        bodies = self._state_reader.world().bodies
        labeled = [body.id for body in bodies if body.label == name]
        if len(labeled) == 1 and name not in {body.id for body in bodies}:
            return labeled[0]
        if len(labeled) > 1:
            raise BodyNotFoundError(name, known=labeled, world=f"{len(labeled)} bodies of that label")
        return name

    # -- properties ----------------------------------------------------------------------------------------------------

    def highlight(self, request: wire.HighlightModel.Request) -> wire.HighlightModel.Response:
        """Highlights a body in one of five colors, or removes its highlight."""
        self._simulation.highlight([BodyId(request.id)], color_from_code(request.color))
        return wire.HighlightModel.Response(success=True)

    def set_material(self, request: wire.SetMaterial.Request) -> wire.SetMaterial.Response:
        """Sets the materials of a body."""
        materials = materials_from_lists(request.material_names, request.material_paths)
        self._simulation.apply(SetMaterials(BodyId(request.id), materials))
        return wire.SetMaterial.Response(success=True)

    def set_physics(self, request: wire.SetPhysicsProperties.Request) -> wire.SetPhysicsProperties.Response:
        """Sets the physics properties of a body."""
        physics = physics_from_message(request.physics_properties)
        self._simulation.apply(SetPhysics(BodyId(request.id), physics))
        return wire.SetPhysicsProperties.Response(success=True)

    # -- the simulation------------------------------------------------------------------------------------------------

    def checkpoint(self, request: wire.Checkpoint.Request) -> wire.Checkpoint.Response:
        """Saves (`save`), restores (`restore`) or deletes (`forget`) a named state."""
        error = self._checkpoints.execute(request.command, request.args)
        if error:
            raise WorldError(error)
        return wire.Checkpoint.Response(success=True)

    def reset_level(self, request: wire.ResetLevel.Request) -> wire.ResetLevel.Response:
        """Returns to the state after the last spawn; the id of the level is ignored."""
        self._simulation.reset()
        return wire.ResetLevel.Response(success=True)

    # -- names ---------------------------------------------------------------------------------------------------------

    def _id(self, given: str, stem: str) -> str:
        return given or free_id(stem or "Model", self._state_reader.row_by_id(self._state_reader.state()))

    def _known_map(self, request: wire.SpawnSemanticMap.Request) -> Iri | None:
        """Returns the map from which models with the tag `Iri` come, if it is in the knowledge base."""
        iris = (
            tag.value for model in request.models for tag in model.tags if (tag.type, tag.key) == ("Mindstage", "Iri")
        )
        namespaces = {iri_namespace(iri) for iri in iris}
        spawned = {world.iri for world in self._simulation.worlds}
        maps = (map for map in self._simulation.knowledge.maps() if map not in spawned)
        return next((map for map in maps if iri_namespace(map) in namespaces), None)

    def _iri(self) -> Iri:
        worlds = self._simulation.worlds
        return worlds[0].iri if worlds else map_iri("spawned")

    def _namespace(self) -> str:
        return iri_namespace(self._iri())


def _display_name(body: Body) -> str:
    return body.label or body.id
