"""Running: plays, pauses, steps and resets a simulation.

Worlds: one in the place of another, and which there are.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from mindstage.errors import SimulationTimeoutError
from mindstage.knowledge.rdf import local_name
from mindstage.msgs import simulation_interfaces as wire
from mindstage.ros.diagnostics import DiagnosticsPublisher
from mindstage.ros.service import (
    OK,
    ActionSpec,
    GoalCanceled,
    GoalContext,
    ResultError,
    ServiceSpec,
    failed,
    incorrect_state,
    unsupported,
)
from mindstage.ros.simulation_interfaces import ResourceError, ResourceErrorType, ResourceLoader, has_tags
from mindstage.scene import World
from mindstage.simulation import Simulation

__all__ = ["SimulationControlServices", "WorldServices"]


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


_STEP_CHUNK_S = 0.1
"""Steps are taken in pieces of about this length, so that others get their turn [s]."""
_TIMEOUT_S = 300.0


class SimulationControlServices:
    """Lets time pass, or not."""

    def __init__(self, simulation: Simulation, *, step_s: float, on_quit: Callable[[], object] | None) -> None:
        """Leaves everything as it is.

        Args:
            stage: whose time it is.
            step_s: how long one step is [s].
            on_quit: called when someone wants the simulation to end; None where nobody may.
        """
        self._simulation = simulation
        self._step_s = step_s
        self._on_quit = on_quit
        self._stopped_state: float | None = None
        self._step_lock = threading.Lock()

    def services(self) -> Iterator[ServiceSpec]:
        """All services."""
        yield ServiceSpec(wire.GetSimulationState, self.get_state, quick=True)
        yield ServiceSpec(wire.SetSimulationState, self.set_state)
        yield ServiceSpec(wire.StepSimulation, self.step, timeout_s=_TIMEOUT_S)
        yield ServiceSpec(wire.ResetSimulation, self.reset)

    def actions(self) -> Iterator[ActionSpec]:
        """What takes time."""
        yield ActionSpec(wire.SimulateSteps, self.simulate_steps)

    def state(self) -> wire.StateCode:
        """How the simulation is."""
        frame = self._simulation.state
        if not frame.ids and not self._simulation.worlds:
            return wire.StateCode.STATE_NO_WORLD
        if frame.playing:
            return wire.StateCode.STATE_PLAYING
        return wire.StateCode.STATE_STOPPED if self._stopped_state == frame.time_s else wire.StateCode.STATE_PAUSED

    def get_state(self, _: wire.GetSimulationState.Request) -> wire.GetSimulationState.Response:
        """How the simulation is."""
        if self._simulation.engine_error is not None:
            raise self._simulation.engine_error
        return wire.GetSimulationState.Response(state=wire.SimulationState(state=self.state()), result=OK)

    def set_state(self, request: wire.SetSimulationState.Request) -> wire.SetSimulationState.Response:
        """Plays, pauses, stops (which is a pause at the start), or quits."""
        wanted, now = request.state.state, self.state()
        if wanted is now:
            raise ResultError(wire.SetSimulationStateCode.ALREADY_IN_TARGET_STATE, f"it is {_state_name(now)} already")
        match wanted:
            case wire.StateCode.STATE_QUITTING:
                if self._on_quit is None:
                    raise unsupported("whoever serves this stage ends it")
                self._on_quit()
            case _ if now is wire.StateCode.STATE_NO_WORLD:
                raise incorrect_state("no world is loaded")
            case wire.StateCode.STATE_PLAYING:
                self._simulation.play()
            case wire.StateCode.STATE_PAUSED:
                self._simulation.pause()
                self._stopped_state = None
            case wire.StateCode.STATE_STOPPED:
                self._simulation.pause()
                self._simulation.reset()
                self._stopped_state = self._simulation.state.time_s
            case _:
                text = f"{_state_name(wanted)} is no state that can be asked for"
                raise ResultError(wire.SetSimulationStateCode.INCORRECT_TRANSITION, text)
        return wire.SetSimulationState.Response(result=OK)

    def step(self, request: wire.StepSimulation.Request) -> wire.StepSimulation.Response:
        """Takes so many steps of a simulation that is not playing."""
        end = time.monotonic() + _TIMEOUT_S
        with self._exclusive():
            for piece in _step_chunks(request.steps, self._step_s):
                if time.monotonic() > end:
                    raise SimulationTimeoutError("step_simulation", timeout_s=_TIMEOUT_S)
                self._simulation.step(piece * self._step_s)
        return wire.StepSimulation.Response(result=OK)

    def reset(self, request: wire.ResetSimulation.Request) -> wire.ResetSimulation.Response:
        """Goes back to right after the last spawn: time, state and what was deleted since, which belong together."""
        if request.scope == wire.ResetScope.SCOPE_TIME:
            raise unsupported("time goes back with the state only; use SCOPE_STATE or SCOPE_ALL")
        if request.scope == wire.ResetScope.SCOPE_SPAWNED:
            self._delete_later_spawns()
        else:
            self._simulation.reset()
        return wire.ResetSimulation.Response(result=OK)

    def simulate_steps(self, goal: wire.SimulateSteps.Goal, context: GoalContext) -> wire.SimulateSteps.Result:
        """Takes so many steps, and tells how far it is."""
        done = 0

        def told() -> wire.SimulateSteps.Feedback:
            return wire.SimulateSteps.Feedback(completed_steps=done, remaining_steps=goal.steps - done)

        with self._exclusive():
            for piece in _step_chunks(goal.steps, self._step_s):
                context.check(told)
                self._simulation.step(piece * self._step_s)
                done += piece
        if context.cancelled:
            raise GoalCanceled
        context.send_feedback(told())
        return wire.SimulateSteps.Result(result=OK)

    @contextmanager
    def _exclusive(self) -> Iterator[None]:
        """Makes sure that time passes for one reason only.

        Raises:
            ResultError: it plays, or somebody else steps.
        """
        if self._simulation.state.playing:
            raise incorrect_state("it is playing; pause it first")
        if not self._step_lock.acquire(blocking=False):
            raise incorrect_state("somebody else is stepping it already")
        try:
            yield
        finally:
            self._step_lock.release()

    def _delete_later_spawns(self) -> None:
        first = {body.id for body in self._simulation.worlds[0].bodies} if self._simulation.worlds else set()
        later = [id for id in self._simulation.state.ids if id not in first]
        self._simulation.run_on_engine(lambda engine: engine.delete(later), label="delete", edits=True)


def _step_chunks(steps: int, step_s: float) -> Iterator[int]:
    """So many steps in handfuls."""
    handful = max(1, round(_STEP_CHUNK_S / step_s))
    for begun in range(0, steps, handful):
        yield min(handful, steps - begun)


def _state_name(state: wire.StateCode) -> str:
    return state.name.removeprefix("STATE_").lower().replace("_", " ")
