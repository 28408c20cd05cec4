"""World control: the services of Unreal's UROSWorldControl, answered by a stage.

Names, types and habits are the plugin's, so that a program which spoke to Unreal does not notice.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from msgspec.structs import replace

from mindstage.bridge.description import (
    attachment_from,
    body_from,
    body_from_box,
    colour_from_code,
    constraint_from,
    materials_from,
    physics_from,
    pose_from,
    world_from_request,
)
from mindstage.engines import SpawnReport
from mindstage.errors import AttachmentRefused, BodyExists, BodyUnknown, WorldError
from mindstage.knowledge.names import local_name
from mindstage.msgs import world_control_msgs as wire
from mindstage.ros.checkpoints import Checkpoints
from mindstage.ros.diagnostics import Diagnostics
from mindstage.ros.names import free_id, map_iri, namespace_of
from mindstage.ros.neighbourhood import how_they_stand, obstacles, socket_pose, wire_pose
from mindstage.ros.offer import ServiceOffer
from mindstage.ros.sight import Sight
from mindstage.world import Attachment, Body, BodyId, Iri, World

__all__ = ["WorldControl"]

_SPAWNING_S = 300.0
"""How long a caller waits for a spawn who does not say it: a large world takes its time, and ends in time by itself."""


class WorldControl:
    """Spawns, moves, lights up and asks, by ids."""

    def __init__(self, sight: Sight, diagnostics: Diagnostics) -> None:
        self._sight = sight
        self._stage = sight.stage
        self._diagnostics = diagnostics
        self._checkpoints = Checkpoints(sight.stage)

    def offers(self) -> Iterator[ServiceOffer]:
        """All services."""
        yield ServiceOffer(wire.SpawnSemanticMap, self.spawn_semantic_map, patience_s=_SPAWNING_S)
        yield ServiceOffer(wire.SpawnModel, self.spawn_model)
        yield ServiceOffer(wire.SpawnProMesh, self.spawn_pro_mesh)
        yield ServiceOffer(wire.SpawnPhysicsConstraint, self.spawn_physics_constraint)
        yield ServiceOffer(wire.AttachModelToParent, self.attach)
        yield ServiceOffer(wire.DeleteModel, self.delete_model)
        yield ServiceOffer(wire.DeleteAll, self.delete_all)
        yield ServiceOffer(wire.SetModelPose, self.set_model_pose)
        yield ServiceOffer(wire.GetModelPose, self.get_model_pose, quick=True)
        yield ServiceOffer(wire.GetModelSocketPose, self.get_model_socket_pose)
        yield ServiceOffer(wire.SetPhysicsProperties, self.set_physics)
        yield ServiceOffer(wire.SetMaterial, self.set_material, name="change_material")
        yield ServiceOffer(wire.HighlightModel, self.highlight, name="highlight_models")
        yield ServiceOffer(wire.ObjectToObjectState, self.object_to_object_state)
        yield ServiceOffer(wire.Checkpoint, self.checkpoint)
        yield ServiceOffer(wire.ResetLevel, self.reset_level)
        yield ServiceOffer(wire.MoveObject, self.move_object)

    # -- spawning ------------------------------------------------------------------------------------------------------

    def spawn_semantic_map(self, request: wire.SpawnSemanticMap.Request) -> wire.SpawnSemanticMap.Response:
        """A whole map; what of it failed is listed, and why it did on the diagnostics."""
        frame = self._sight.frame()
        iri = self._known_map(request) or map_iri(f"spawned_{len(self._stage.worlds) + 1}")
        world, remarks = world_from_request(request, iri=iri, name=local_name(iri), taken=frozenset(frame.ids))
        self._diagnostics.remarked("spawn_semantic_map", remarks)
        report = self._stage.spawn(world)
        self._diagnostics.spawned("spawn_semantic_map", report)
        lost = {failure.id for failure in report.failed_attachments}
        return wire.SpawnSemanticMap.Response(
            success=report.ok,
            failed_model_ids=tuple(failure.id for failure in report.failed_bodies),
            failed_constraint_ids=tuple(failure.id for failure in report.failed_constraints),
            failed_relations=tuple(relation for relation in request.relations if relation.child_id in lost),
        )

    def spawn_model(self, request: wire.SpawnModel.Request) -> wire.SpawnModel.Response:
        """One model; it hangs on its parent, if it has one."""
        body, remarks = body_from(request, id=self._id(request.id, request.name), namespace=self._namespace())
        if request.override_name:
            body = _labelled(body, request.override_name)
        etype = ""
        if body.id in self._sight.rows(self._sight.frame()):
            etype = wire.SpawnModel.Response.ID_TAKEN
            self._diagnostics.refused("spawn_model", BodyExists(body.id))
        elif request.spawn_collision_check and (met := obstacles(self._stage.log(), body)):
            etype = wire.SpawnModel.Response.OBSTRUCTED
            self._diagnostics.failed("spawn_model", [(body.id, f"it would stand in {', '.join(met)}")])
        if etype:
            return wire.SpawnModel.Response(id=body.id, name=_name(body), etype=etype)
        self._diagnostics.remarked("spawn_model", remarks)
        success = self._put("spawn_model", body, parent=request.parent_id)
        return wire.SpawnModel.Response(id=body.id, name=_name(body), success=success)

    def spawn_pro_mesh(self, request: wire.SpawnProMesh.Request) -> wire.SpawnProMesh.Response:
        """A box of a size."""
        body = body_from_box(request, id=self._id(request.id, "Box"), namespace=self._namespace())
        success = self._put("spawn_pro_mesh", body, parent=request.parent_id)
        return wire.SpawnProMesh.Response(id=body.id, name=_name(body), success=success)

    def spawn_physics_constraint(
        self, request: wire.SpawnPhysicsConstraint.Request
    ) -> wire.SpawnPhysicsConstraint.Response:
        """A constraint between two bodies that are there."""
        description = request.constraint_description
        id = free_id("Constraint", {each.id for each in self._sight.world().constraints})
        constraint, remarks = constraint_from(description, id=id, namespace=self._namespace())
        self._diagnostics.remarked("spawn_physics_constraint", remarks)
        world = World(iri=self._iri(), constraints=(constraint,))
        return wire.SpawnPhysicsConstraint.Response(success=self._spawn("spawn_physics_constraint", world))

    def _put(self, what: str, body: Body, *, parent: str) -> bool:
        attachments: tuple[Attachment, ...] = ()
        if parent:
            self._sight.require([parent])
            attachments = (attachment_from(wire.RelationDescription(parent_id=parent, child_id=body.id)),)
        return self._spawn(what, World(iri=self._iri(), bodies=(body,), attachments=attachments))

    def _spawn(self, what: str, world: World) -> bool:
        report: SpawnReport = self._stage.spawn(world)
        self._diagnostics.spawned(what, report)
        return report.ok

    # -- taking away ---------------------------------------------------------------------------------------------------

    def delete_model(self, request: wire.DeleteModel.Request) -> wire.DeleteModel.Response:
        """One body."""
        self._delete([request.id])
        return wire.DeleteModel.Response(success=True)

    def delete_all(self, request: wire.DeleteAll.Request) -> wire.DeleteAll.Response:
        """All bodies that have such a tag; it is no failure if there is none."""

        def is_meant(body: Body) -> bool:
            return any(
                tag.type == request.type_to_delete
                and tag.key == request.key_to_delete
                and (request.ignore_value or tag.value == request.value_to_delete)
                for tag in body.tags
            )

        self._delete([body.id for body in self._sight.world().bodies if is_meant(body)])
        return wire.DeleteAll.Response(success=True)

    def _delete(self, ids: Sequence[str]) -> None:
        self._stage.call(lambda engine: engine.delete(tuple(map(BodyId, ids))), what="delete", edits=True)

    # -- places --------------------------------------------------------------------------------------------------------

    def set_model_pose(self, request: wire.SetModelPose.Request) -> wire.SetModelPose.Response:
        """Puts a body somewhere else."""
        self._set_pose(request.id, request)
        return wire.SetModelPose.Response(success=True)

    def move_object(self, request: wire.MoveObject.Request) -> wire.MoveObject.Response:
        """The same by the name of an actor: an id, or a label that only one body has."""
        self._set_pose(self._id_of_actor(request.Name), request)
        return wire.MoveObject.Response(success=True)

    def get_model_pose(self, request: wire.GetModelPose.Request) -> wire.GetModelPose.Response:
        """Where a body is."""
        return wire.GetModelPose.Response(pose=wire_pose(self._sight.row(request.id)), success=True)

    def get_model_socket_pose(self, request: wire.GetModelSocketPose.Request) -> wire.GetModelSocketPose.Response:
        """Where a place on a body is: what hangs on it is such a place, and so is the body itself, without a name."""
        row = socket_pose(self._sight, request.id, request.socket)
        return wire.GetModelSocketPose.Response(pose=wire_pose(row), success=True)

    def object_to_object_state(self, request: wire.ObjectToObjectState.Request) -> wire.ObjectToObjectState.Response:
        """How one body stands to another: on, inside, above, below, next_to, or apart."""
        self._sight.require([request.source_object_id, request.other_object_id])
        state = how_they_stand(self._stage.log(), request.source_object_id, request.other_object_id)
        return wire.ObjectToObjectState.Response(state=state, success=True)

    def attach(self, request: wire.AttachModelToParent.Request) -> wire.AttachModelToParent.Response:
        """Hangs one body on another, where both are now."""
        parent, child = BodyId(request.parent_id), BodyId(request.child_id)
        if parent == child:
            raise AttachmentRefused(parent, child, reason="nothing hangs on itself")
        self._stage.call(lambda engine: engine.attach(parent, child), what="attach", edits=True)
        return wire.AttachModelToParent.Response(success=True)

    def _set_pose(self, id: str, request: wire.SetModelPose.Request | wire.MoveObject.Request) -> None:
        pose = pose_from(request.pose)
        self._stage.call(lambda engine: engine.set_pose(BodyId(id), pose), what="set pose")

    def _id_of_actor(self, name: str) -> str:
        bodies = self._sight.world().bodies
        labelled = [body.id for body in bodies if body.label == name]
        if len(labelled) == 1 and name not in {body.id for body in bodies}:
            return labelled[0]
        if len(labelled) > 1:
            raise BodyUnknown(name, known=labelled, world=f"{len(labelled)} bodies of that label")
        return name

    # -- looks and physics ---------------------------------------------------------------------------------------------

    def highlight(self, request: wire.HighlightModel.Request) -> wire.HighlightModel.Response:
        """Lights a body up in one of five colours, or puts it out."""
        self._stage.highlight([BodyId(request.id)], colour_from_code(request.color))
        return wire.HighlightModel.Response(success=True)

    def set_material(self, request: wire.SetMaterial.Request) -> wire.SetMaterial.Response:
        """Changes a body's surface."""
        materials = materials_from(request.material_names, request.material_paths)
        id = BodyId(request.id)
        self._stage.call(lambda engine: engine.set_materials(id, materials), what="set materials", edits=True)
        return wire.SetMaterial.Response(success=True)

    def set_physics(self, request: wire.SetPhysicsProperties.Request) -> wire.SetPhysicsProperties.Response:
        """Changes how a body takes part in the physics."""
        id, physics = BodyId(request.id), physics_from(request.physics_properties)
        self._stage.call(lambda engine: engine.set_physics(id, physics), what="set physics", edits=True)
        return wire.SetPhysicsProperties.Response(success=True)

    # -- the whole -----------------------------------------------------------------------------------------------------

    def checkpoint(self, request: wire.Checkpoint.Request) -> wire.Checkpoint.Response:
        """Keeps the whole state under a name (`save`), brings it back (`restore`), throws it away (`forget`)."""
        refusal = self._checkpoints.obey(request.command, request.args)
        if refusal:
            raise WorldError(refusal)
        return wire.Checkpoint.Response(success=True)

    def reset_level(self, request: wire.ResetLevel.Request) -> wire.ResetLevel.Response:
        """Brings back the world as it was right after it was spawned; there is one level, whatever its id."""
        self._stage.reset()
        return wire.ResetLevel.Response(success=True)

    # -- names ---------------------------------------------------------------------------------------------------------

    def _id(self, told: str, stem: str) -> str:
        return told or free_id(stem or "Model", self._sight.rows(self._sight.frame()))

    def _known_map(self, request: wire.SpawnSemanticMap.Request) -> Iri | None:
        """The map that models come from which tell their IRIs, if it is known; questions then mean the same things."""
        told = (
            tag.value for model in request.models for tag in model.tags if (tag.type, tag.key) == ("Mindstage", "Iri")
        )
        spaces = {namespace_of(iri) for iri in told}
        spawned = {world.iri for world in self._stage.worlds}
        maps = (map for map in self._stage.knowledge.maps() if map not in spawned)
        return next((map for map in maps if namespace_of(map) in spaces), None)

    def _iri(self) -> Iri:
        worlds = self._stage.worlds
        return worlds[0].iri if worlds else map_iri("spawned")

    def _namespace(self) -> str:
        return namespace_of(self._iri())


def _labelled(body: Body, label: str) -> Body:
    return replace(body, label=label)


def _name(body: Body) -> str:
    return body.label or body.id
