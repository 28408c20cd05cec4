"""Worlds: one in the place of another, and which there are."""

from __future__ import annotations

from collections.abc import Iterator

from mindstage.knowledge.names import local_name
from mindstage.msgs import simulation_interfaces as wire
from mindstage.ros.diagnostics import Diagnostics
from mindstage.ros.offer import ServiceOffer
from mindstage.ros.resources import Resources, Trouble, TroubleKind
from mindstage.ros.results import OK, ResultError, failed
from mindstage.ros.simulation.filters import has_tags
from mindstage.stage import Stage
from mindstage.world import World

__all__ = ["Worlds"]

_LOADING_S = 300.0
_MAP = "map"
"""The tag of what comes from a map that is known; what lies in the folder has its suffix."""
_CODES = {
    TroubleKind.MISSING: wire.LoadWorldCode.NO_RESOURCE,
    TroubleKind.FORMAT: wire.LoadWorldCode.UNSUPPORTED_FORMAT,
    TroubleKind.BROKEN: wire.LoadWorldCode.RESOURCE_PARSE_ERROR,
}


class Worlds:
    """Loads and unloads."""

    def __init__(self, stage: Stage, resources: Resources, diagnostics: Diagnostics) -> None:
        self._stage = stage
        self._resources = resources
        self._diagnostics = diagnostics

    def offers(self) -> Iterator[ServiceOffer]:
        """All services."""
        yield ServiceOffer(wire.LoadWorld, self.load, patience_s=_LOADING_S)
        yield ServiceOffer(wire.UnloadWorld, self.unload)
        yield ServiceOffer(wire.GetCurrentWorld, self.current)
        yield ServiceOffer(wire.GetAvailableWorlds, self.available, patience_s=_LOADING_S)

    def load(self, request: wire.LoadWorld.Request) -> wire.LoadWorld.Response:
        """Reads a world first, and only then takes away what is there."""
        resource = request.world_resource
        try:
            world = self._resources.world(resource.uri, resource.resource_string)
        except Trouble as trouble:
            raise ResultError(_CODES[trouble.kind], str(trouble)) from trouble
        self._stage.clear()
        report = self._stage.spawn(world)
        self._diagnostics.spawned("load_world", report)
        if not report.ok and request.fail_on_unsupported_element:
            self._stage.clear()
            raise ResultError(wire.LoadWorldCode.UNSUPPORTED_ELEMENTS, "not everything of it can be spawned")
        return wire.LoadWorld.Response(result=OK, world=_resource(world))

    def unload(self, _: wire.UnloadWorld.Request) -> wire.UnloadWorld.Response:
        """Takes everything away."""
        if not self._stage.worlds:
            raise ResultError(wire.UnloadWorldCode.NO_WORLD_LOADED, "no world is loaded")
        self._stage.clear()
        return wire.UnloadWorld.Response(result=OK)

    def current(self, _: wire.GetCurrentWorld.Request) -> wire.GetCurrentWorld.Response:
        """The world that was loaded first; what was spawned later stands in it."""
        if not self._stage.worlds:
            raise failed("no world is loaded")
        return wire.GetCurrentWorld.Response(result=OK, world=_resource(self._stage.worlds[0]))

    def available(self, request: wire.GetAvailableWorlds.Request) -> wire.GetAvailableWorlds.Response:
        """The maps that are known, and the files of the folder; others are looked for nowhere."""
        maps = (_resource(self._resources.knowledge.world(map)) for map in self._resources.knowledge.maps())
        files = (_file(name) for name in self._resources.files())
        worlds = tuple(world for world in (*maps, *files) if has_tags(world.tags, request.filter))
        if request.additional_sources and not request.continue_on_error:
            raise failed("worlds are looked for in no other sources; set continue_on_error to hear of those here")
        return wire.GetAvailableWorlds.Response(result=OK, worlds=worlds)


def _resource(world: World) -> wire.WorldResource:
    text = f"{len(world.bodies)} bodies, {len(world.constraints)} constraints"
    name = world.name or local_name(world.iri)
    return wire.WorldResource(name=name, world_resource=wire.Resource(uri=world.iri), description=text, tags=(_MAP,))


def _file(name: str) -> wire.WorldResource:
    suffix = name.rpartition(".")[2].lower()
    return wire.WorldResource(
        name=name, world_resource=wire.Resource(uri=name), description=f"a file ({suffix})", tags=(suffix,)
    )
