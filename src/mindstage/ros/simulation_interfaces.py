"""Spawning: new entities after the pattern of what the maps know, of files, or of a text; and what this face can do."""

from __future__ import annotations

import json
from collections.abc import Iterator

from mindstage.bridge.description import pose_from_message
from mindstage.errors import BodyNotFoundError
from mindstage.knowledge.names import local_name
from mindstage.msgs import modul_spawner_msgs
from mindstage.msgs import simulation_interfaces as wire
from mindstage.ros.diagnostics import DiagnosticsPublisher
from mindstage.ros.names import free_id, map_iri
from mindstage.ros.offer import ServiceSpec
from mindstage.ros.resources import FORMATS, ResourceError, ResourceErrorType, ResourceLoader
from mindstage.ros.results import OK, ResultError
from mindstage.ros.sight import StateReader
from mindstage.ros.simulation.entities import bounds_of
from mindstage.ros.templates import clone_at, root_body, subtree
from mindstage.world import Body, Pose, World

__all__ = ["SpawnServices"]

_TIMEOUT_S = 120.0
_UNSUPPORTED_FEATURES = {
    wire.Feature.NAMED_POSES,
    wire.Feature.POSE_BOUNDS,
    wire.Feature.ENTITY_BOUNDS_CONVEX,
    wire.Feature.ENTITY_INFO_SETTING,
    wire.Feature.SIMULATION_RESET_TIME,
}
_RESULT_CODES = {
    ResourceErrorType.NOT_FOUND: wire.SpawnCode.NO_RESOURCE,
    ResourceErrorType.UNSUPPORTED_FORMAT: wire.SpawnCode.UNSUPPORTED_FORMAT,
    ResourceErrorType.PARSE_ERROR: wire.SpawnCode.RESOURCE_PARSE_ERROR,
}
_Request = wire.SpawnEntity.Request | wire.SpawnEntityMessage


class SpawnServices:
    """Spawns."""

    def __init__(
        self, state_reader: StateReader, resources: ResourceLoader, diagnostics: DiagnosticsPublisher, *, step_s: float
    ) -> None:
        self._state_reader = state_reader
        self._simulation = state_reader.simulation
        self._resources = resources
        self._diagnostics = diagnostics
        self._step_s = step_s

    def services(self) -> Iterator[ServiceSpec]:
        """All services."""
        yield ServiceSpec(wire.GetSimulatorFeatures, self.get_features)
        yield ServiceSpec(wire.GetSpawnables, self.get_spawnables, timeout_s=_TIMEOUT_S)
        yield ServiceSpec(wire.SpawnEntity, self.spawn_entity, timeout_s=_TIMEOUT_S)
        yield ServiceSpec(wire.SpawnEntities, self.spawn_entities, timeout_s=_TIMEOUT_S)
        yield ServiceSpec(modul_spawner_msgs.SpawnRobot, self.spawn_robot, timeout_s=_TIMEOUT_S)

    def get_features(self, _: wire.GetSimulatorFeatures.Request) -> wire.GetSimulatorFeatures.Response:
        """What works here."""
        told = {"engine": self._simulation.engine_name, "step_s": self._step_s}
        features = wire.SimulatorFeatures(
            features=tuple(feature for feature in wire.Feature if feature not in _UNSUPPORTED_FEATURES),
            spawn_formats=tuple(FORMATS.values()),
            custom_info=json.dumps(told),
        )
        return wire.GetSimulatorFeatures.Response(features=features)

    def get_spawnables(self, request: wire.GetSpawnables.Request) -> wire.GetSpawnables.Response:
        """Each thing of a known map, and each file of the folder; sources, where given, are the maps' IRIs."""
        chosen = set(request.sources)
        found: list[wire.Spawnable] = []
        for map in self._resources.knowledge.maps():
            if not chosen or map in chosen:
                found += (_spawnable(body) for body in self._resources.knowledge.world(map).bodies)
        if not chosen:
            files = self._resources.files()
            found += (
                wire.Spawnable(entity_resource=wire.Resource(uri=name), description=f"the file {name}")
                for name in files
            )
        return wire.GetSpawnables.Response(result=OK, spawnables=tuple(found))

    def spawn_entity(self, request: wire.SpawnEntity.Request) -> wire.SpawnEntity.Response:
        """One entity."""
        return wire.SpawnEntity.Response(result=OK, entity_name=self._spawn(request))

    def spawn_entities(self, request: wire.SpawnEntities.Request) -> wire.SpawnEntities.Response:
        """Some, one after the other; one that fails does not stop the rest."""
        results = tuple(self._spawn_result(each) for each in request.spawn_requests)
        lost = sum(each.result.result != OK.result for each in results)
        if not lost:
            return wire.SpawnEntities.Response(result=OK, results=results)
        text = f"{lost} of {len(results)} were not spawned"
        result = wire.Result(result=wire.SpawnEntitiesCode.ENTITIES_SPAWN_FAILED, error_message=text)
        return wire.SpawnEntities.Response(result=result, results=results)

    def spawn_robot(self, request: modul_spawner_msgs.SpawnRobot.Request) -> modul_spawner_msgs.SpawnRobot.Response:
        """A robot from a file of the folder, or from the text of a URDF in the place of its name."""
        is_text = request.name.lstrip().startswith("<")
        name = request.id or self._free_id("Robot" if is_text else request.name.rpartition("/")[2].partition(".")[0])
        try:
            world = self._resources.load_world("" if is_text else request.name, request.name if is_text else "")
            self._spawn_clone(world, root_body(world), name=name, pose=None)
        except (ResourceError, ResultError) as error:
            self._diagnostics.report_failures("spawn_robot", [(name, str(error))])
            return modul_spawner_msgs.SpawnRobot.Response(id=name)
        return modul_spawner_msgs.SpawnRobot.Response(id=name, name=name, success=True)

    def _spawn_result(self, request: wire.SpawnEntityMessage) -> wire.SpawnResult:
        try:
            return wire.SpawnResult(result=OK, entity_name=self._spawn(request))
        except ResultError as error:
            self._diagnostics.report_failures("spawn_entities", [(request.name, str(error))])
            return wire.SpawnResult(result=error.result, entity_name=request.name)

    def _spawn(self, request: _Request) -> str:
        world, root = self._template(request.entity_resource)
        name = self._entity_name(request, root)
        try:
            pose = self._state_reader.to_world_frame(
                pose_from_message(request.initial_pose.pose), request.initial_pose.header.frame_id
            )
        except BodyNotFoundError as error:
            raise ResultError(wire.SpawnCode.INVALID_POSE, str(error)) from error
        self._spawn_clone(world, root, name=name, pose=pose)
        return name

    def _spawn_clone(self, world: World, root: Body | None, *, name: str, pose: Pose | None) -> None:
        if root is None:
            raise ResultError(wire.SpawnCode.RESOURCE_PARSE_ERROR, "there is no body in it")
        worlds = self._simulation.worlds
        report = self._simulation.spawn(
            clone_at(world, root, name=name, pose=pose, map=worlds[0].iri if worlds else map_iri("spawned"))
        )
        self._diagnostics.report_spawn("spawn", report)
        if report.failed_bodies:
            raise ResultError(wire.SpawnCode.INVALID_POSE, "; ".join(each.reason for each in report.failed_bodies[:3]))

    def _template(self, resource: wire.Resource) -> tuple[World, Body | None]:
        if resource.uri and (known := self._resources.find_body(resource.uri)):
            world, body = known
            return subtree(world, body.id), body
        try:
            world = self._resources.load_world(resource.uri, resource.resource_string)
        except ResourceError as trouble:
            raise ResultError(_RESULT_CODES[trouble.type], str(trouble)) from trouble
        return world, root_body(world)

    def _entity_name(self, request: _Request, root: Body | None) -> str:
        taken = self._state_reader.row_by_id(self._state_reader.state())
        if not request.name and not request.allow_renaming:
            raise ResultError(wire.SpawnCode.NAME_INVALID, "it needs a name, unless it may be renamed")
        if request.name and request.name not in taken:
            return request.name
        if not request.allow_renaming:
            raise ResultError(wire.SpawnCode.NAME_NOT_UNIQUE, f"{request.name!r} is taken")
        return free_id(request.name or (local_name(root.cls) if root else "Entity"), taken)

    def _free_id(self, stem: str) -> str:
        return free_id(stem or "Robot", self._state_reader.row_by_id(self._state_reader.state()))


def _spawnable(body: Body) -> wire.Spawnable:
    return wire.Spawnable(
        entity_resource=wire.Resource(uri=body.iri),
        description=body.label or local_name(body.cls),
        spawn_bounds=bounds_of(body.size),
    )
