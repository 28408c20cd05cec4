"""Control of a simulation as in simulation_interfaces: play, pause, step, reset; load and unload worlds."""

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
"""Tag of the worlds of maps; that of a file is its suffix."""
_RESULT_CODES = {
    ResourceErrorType.NOT_FOUND: wire.LoadWorldCode.NO_RESOURCE,
    ResourceErrorType.UNSUPPORTED_FORMAT: wire.LoadWorldCode.UNSUPPORTED_FORMAT,
    ResourceErrorType.PARSE_ERROR: wire.LoadWorldCode.RESOURCE_PARSE_ERROR,
}
_STEP_CHUNK_S = 0.1
"""Approximate length into which steps are divided, so that other calls run in between [s]."""
_TIMEOUT_S = 300.0


class WorldServices:
    """Services that load and unload worlds."""

    def __init__(self, simulation: Simulation, resources: ResourceLoader, diagnostics: DiagnosticsPublisher) -> None:
        self._simulation = simulation
        self._resources = resources
        self._diagnostics = diagnostics

    def services(self) -> Iterator[ServiceSpec]:
        """Yields all services."""
        yield ServiceSpec(wire.LoadWorld, self.load_world, timeout_s=_LOAD_TIMEOUT_S)
        yield ServiceSpec(wire.UnloadWorld, self.unload_world)
        yield ServiceSpec(wire.GetCurrentWorld, self.get_current_world)
        yield ServiceSpec(wire.GetAvailableWorlds, self.get_available_worlds, timeout_s=_LOAD_TIMEOUT_S)

    def load_world(self, request: wire.LoadWorld.Request) -> wire.LoadWorld.Response:
        """Loads a world, then replaces the current one."""
        resource = request.world_resource
        try:
            world = self._resources.load_world(resource.uri, resource.resource_string)
        except ResourceError as error:
            raise ResultError(_RESULT_CODES[error.type], str(error)) from error
        self._simulation.clear()
        report = self._simulation.spawn(world)
        self._diagnostics.report_spawn("load_world", report)
        if not report.ok and request.fail_on_unsupported_element:
            self._simulation.clear()
            raise ResultError(wire.LoadWorldCode.UNSUPPORTED_ELEMENTS, "some elements cannot be spawned")
        return wire.LoadWorld.Response(result=OK, world=_resource(world))

    def unload_world(self, _: wire.UnloadWorld.Request) -> wire.UnloadWorld.Response:
        """Removes everything."""
        if not self._simulation.worlds:
            raise ResultError(wire.UnloadWorldCode.NO_WORLD_LOADED, "no world is loaded")
        self._simulation.clear()
        return wire.UnloadWorld.Response(result=OK)

    def get_current_world(self, _: wire.GetCurrentWorld.Request) -> wire.GetCurrentWorld.Response:
        """Returns the world that was loaded first."""
        if not self._simulation.worlds:
            raise failed("no world is loaded")
        return wire.GetCurrentWorld.Response(result=OK, world=_resource(self._simulation.worlds[0]))

    def get_available_worlds(self, request: wire.GetAvailableWorlds.Request) -> wire.GetAvailableWorlds.Response:
        """Returns the maps of the knowledge base and the files of the folder; no other sources are searched."""
        maps = (_resource(self._resources.knowledge.world(map)) for map in self._resources.knowledge.maps())
        files = (_file(name) for name in self._resources.files())
        worlds = tuple(world for world in (*maps, *files) if has_tags(world.tags, request.filter))
        if request.additional_sources and not request.continue_on_error:
            raise failed(
                "additional sources are not supported; set continue_on_error to list the worlds of this server"
            )
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


class SimulationControlServices:
    """Services that advance, pause and reset the simulation."""

    def __init__(self, simulation: Simulation, *, step_s: float, on_quit: Callable[[], object] | None) -> None:
        """Creates the services; the simulation is not changed.

        Args:
            simulation: the simulation.
            step_s: length of one step [s].
            on_quit: called when a client ends the simulation; None if clients may not.
        """
        self._simulation = simulation
        self._step_s = step_s
        self._on_quit = on_quit
        self._stopped_state: float | None = None
        self._step_lock = threading.Lock()

    def services(self) -> Iterator[ServiceSpec]:
        """Yields all services."""
        yield ServiceSpec(wire.GetSimulationState, self.get_state, quick=True)
        yield ServiceSpec(wire.SetSimulationState, self.set_state)
        yield ServiceSpec(wire.StepSimulation, self.step, timeout_s=_TIMEOUT_S)
        yield ServiceSpec(wire.ResetSimulation, self.reset)

    def actions(self) -> Iterator[ActionSpec]:
        """Yields all actions."""
        yield ActionSpec(wire.SimulateSteps, self.simulate_steps)

    def state(self) -> wire.StateCode:
        """Returns the state of the simulation."""
        snapshot = self._simulation.state
        if not snapshot.ids and not self._simulation.worlds:
            return wire.StateCode.STATE_NO_WORLD
        if snapshot.playing:
            return wire.StateCode.STATE_PLAYING
        return wire.StateCode.STATE_STOPPED if self._stopped_state == snapshot.time_s else wire.StateCode.STATE_PAUSED

    def get_state(self, _: wire.GetSimulationState.Request) -> wire.GetSimulationState.Response:
        """Returns the state of the simulation."""
        if self._simulation.engine_error is not None:
            raise self._simulation.engine_error
        return wire.GetSimulationState.Response(state=wire.SimulationState(state=self.state()), result=OK)

    def set_state(self, request: wire.SetSimulationState.Request) -> wire.SetSimulationState.Response:
        """Plays, pauses, stops (pauses and resets), or quits."""
        target, current = request.state.state, self.state()
        if target is current:
            raise ResultError(
                wire.SetSimulationStateCode.ALREADY_IN_TARGET_STATE, f"it is {_state_name(current)} already"
            )
        match target:
            case wire.StateCode.STATE_QUITTING:
                if self._on_quit is None:
                    raise unsupported("clients cannot end this simulation")
                self._on_quit()
            case _ if current is wire.StateCode.STATE_NO_WORLD:
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
                text = f"{_state_name(target)} cannot be requested"
                raise ResultError(wire.SetSimulationStateCode.INCORRECT_TRANSITION, text)
        return wire.SetSimulationState.Response(result=OK)

    def step(self, request: wire.StepSimulation.Request) -> wire.StepSimulation.Response:
        """Advances a simulation that is not playing by a number of steps."""
        end_s = time.monotonic() + _TIMEOUT_S
        with self._exclusive():
            for count in _step_chunks(request.steps, self._step_s):
                if time.monotonic() > end_s:
                    raise SimulationTimeoutError("step_simulation", timeout_s=_TIMEOUT_S)
                self._simulation.step(count * self._step_s)
        return wire.StepSimulation.Response(result=OK)

    def reset(self, request: wire.ResetSimulation.Request) -> wire.ResetSimulation.Response:
        """Returns to the state after the last spawn: time, poses and deleted bodies together."""
        if request.scope == wire.ResetScope.SCOPE_TIME:
            raise unsupported("time cannot be reset without the state; use SCOPE_STATE or SCOPE_ALL")
        if request.scope == wire.ResetScope.SCOPE_SPAWNED:
            self._delete_later_spawns()
        else:
            self._simulation.reset()
        return wire.ResetSimulation.Response(result=OK)

    def simulate_steps(self, goal: wire.SimulateSteps.Goal, context: GoalContext) -> wire.SimulateSteps.Result:
        """Advances the simulation by a number of steps, with feedback."""
        done = 0

        def feedback() -> wire.SimulateSteps.Feedback:
            return wire.SimulateSteps.Feedback(completed_steps=done, remaining_steps=goal.steps - done)

        with self._exclusive():
            for count in _step_chunks(goal.steps, self._step_s):
                context.check(feedback)
                self._simulation.step(count * self._step_s)
                done += count
        if context.cancelled:
            raise GoalCanceled
        context.send_feedback(feedback())
        return wire.SimulateSteps.Result(result=OK)

    @contextmanager
    def _exclusive(self) -> Iterator[None]:
        """Makes sure that nothing else advances the simulation.

        Raises:
            ResultError: the simulation is playing, or another call is stepping it.
        """
        if self._simulation.state.playing:
            raise incorrect_state("it is playing; pause it first")
        if not self._step_lock.acquire(blocking=False):
            raise incorrect_state("another call is stepping it")
        try:
            yield
        finally:
            self._step_lock.release()

    def _delete_later_spawns(self) -> None:
        first = {body.id for body in self._simulation.worlds[0].bodies} if self._simulation.worlds else set()
        spawned = [id for id in self._simulation.state.ids if id not in first]
        self._simulation.run_on_engine(lambda engine: engine.delete(spawned), label="delete", edits=True)


def _step_chunks(steps: int, step_s: float) -> Iterator[int]:
    """Yields the number of steps of each chunk."""
    chunk = max(1, round(_STEP_CHUNK_S / step_s))
    for start in range(0, steps, chunk):
        yield min(chunk, steps - start)


def _state_name(state: wire.StateCode) -> str:
    return state.name.removeprefix("STATE_").lower().replace("_", " ")
