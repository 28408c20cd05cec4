"""Worlds: one in the place of another, and which there are."""

from __future__ import annotations

from collections.abc import Iterator

from mindstage.knowledge.names import local_name
from mindstage.msgs import simulation_interfaces as wire
from mindstage.ros.diagnostics import DiagnosticsPublisher
from mindstage.ros.offer import ServiceSpec
from mindstage.ros.resources import ResourceError, ResourceErrorType, ResourceLoader
from mindstage.ros.results import OK, ResultError, failed
from mindstage.ros.simulation.filters import has_tags
from mindstage.stage import Simulation
from mindstage.world import World

__all__ = ["WorldServices"]

_LOAD_TIMEOUT_S = 300.0
_MAP_TAG = "map"
"""The tag of what comes from a map that is known; what lies in the folder has its suffix."""
_RESULT_CODES = {
    ResourceErrorType.NOT_FOUND: wire.LoadWorldCode.NO_RESOURCE,
    ResourceErrorType.UNSUPPORTED_FORMAT: wire.LoadWorldCode.UNSUPPORTED_FORMAT,
    ResourceErrorType.PARSE_ERROR: wire.LoadWorldCode.RESOURCE_PARSE_ERROR,
}


class WorldServices:
    """Loads and unloads."""

    def __init__(self, simulation: Simulation, resources: ResourceLoader, diagnostics: DiagnosticsPublisher) -> None:
        self._simulation = simulation
        self._resources = resources
        self._diagnostics = diagnostics

    def services(self) -> Iterator[ServiceSpec]:
        """All services."""
        yield ServiceSpec(wire.LoadWorld, self.load_world, timeout_s=_LOAD_TIMEOUT_S)
        yield ServiceSpec(wire.UnloadWorld, self.unload_world)
        yield ServiceSpec(wire.GetCurrentWorld, self.get_current_world)
        yield ServiceSpec(wire.GetAvailableWorlds, self.get_available_worlds, timeout_s=_LOAD_TIMEOUT_S)

    def load_world(self, request: wire.LoadWorld.Request) -> wire.LoadWorld.Response:
        """Reads a world first, and only then takes away what is there."""
        resource = request.world_resource
        try:
            world = self._resources.load_world(resource.uri, resource.resource_string)
        except ResourceError as trouble:
            raise ResultError(_RESULT_CODES[trouble.type], str(trouble)) from trouble
        self._simulation.clear()
        report = self._simulation.spawn(world)
        self._diagnostics.report_spawn("load_world", report)
        if not report.ok and request.fail_on_unsupported_element:
            self._simulation.clear()
            raise ResultError(wire.LoadWorldCode.UNSUPPORTED_ELEMENTS, "not everything of it can be spawned")
        return wire.LoadWorld.Response(result=OK, world=_resource(world))

    def unload_world(self, _: wire.UnloadWorld.Request) -> wire.UnloadWorld.Response:
        """Takes everything away."""
        if not self._simulation.worlds:
            raise ResultError(wire.UnloadWorldCode.NO_WORLD_LOADED, "no world is loaded")
        self._simulation.clear()
        return wire.UnloadWorld.Response(result=OK)

    def get_current_world(self, _: wire.GetCurrentWorld.Request) -> wire.GetCurrentWorld.Response:
        """The world that was loaded first; what was spawned later stands in it."""
        if not self._simulation.worlds:
            raise failed("no world is loaded")
        return wire.GetCurrentWorld.Response(result=OK, world=_resource(self._simulation.worlds[0]))

    def get_available_worlds(self, request: wire.GetAvailableWorlds.Request) -> wire.GetAvailableWorlds.Response:
        """The maps that are known, and the files of the folder; others are looked for nowhere."""
        maps = (_resource(self._resources.knowledge.world(map)) for map in self._resources.knowledge.maps())
        files = (_file(name) for name in self._resources.files())
        worlds = tuple(world for world in (*maps, *files) if has_tags(world.tags, request.filter))
        if request.additional_sources and not request.continue_on_error:
            raise failed("worlds are looked for in no other sources; set continue_on_error to hear of those here")
        return wire.GetAvailableWorlds.Response(result=OK, worlds=worlds)


def _resource(world: World) -> wire.WorldResource:
    text = f"{len(world.bodies)} bodies, {len(world.joints)} constraints"
    name = world.name or local_name(world.iri)
    return wire.WorldResource(
        name=name, world_resource=wire.Resource(uri=world.iri), description=text, tags=(_MAP_TAG,)
    )


def _file(name: str) -> wire.WorldResource:
    suffix = name.rpartition(".")[2].lower()
    return wire.WorldResource(
        name=name, world_resource=wire.Resource(uri=name), description=f"a file ({suffix})", tags=(suffix,)
    )
