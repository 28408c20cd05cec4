"""Control of a simulation as in simulation_interfaces: play, pause, step, reset; load and unload worlds.

The start, to which a stop and a reset return, is the world that was loaded last, or else the one that was there when
the services were created. Where two texts of the package contradict each other, this one is followed:

- `StepSimulation` and `SimulateSteps` while playing: their own texts (`RESULT_OPERATION_FAILED`), not that of
  `Result` (`RESULT_INCORRECT_STATE`).
- Pausing a stopped simulation: `SimulationState` (it starts paused), not the example of `INCORRECT_TRANSITION`.
- `SCOPE_STATE` includes `SCOPE_TIME`: the saved state of an engine holds its clock.
- A world that cannot be read, or is refused for its assets or elements, does not replace the current one, although
  `LoadWorld` unloads that first.
- `SimulateSteps` sends feedback after each step up to 1000 steps, of a longer goal every 0.4 s.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from msgspec.structs import replace

from mindstage.access.limits import FEEDBACK_STEPS, STEP_DURATION, STEPS_TIME
from mindstage.access.policies import EDIT, FILE, GOAL, READ, RUN
from mindstage.engines.base import Capability
from mindstage.errors import KnowledgeError, MindstageError, SimulationTimeoutError
from mindstage.msgs import simulation_interfaces as wire
from mindstage.rdf.graphs import local_name
from mindstage.ros.diagnostics import DiagnosticsPublisher
from mindstage.ros.service import (
    OK,
    ActionSpec,
    GoalCanceledError,
    GoalContext,
    ResultError,
    ServiceSpec,
    failed,
    unsupported,
)
from mindstage.ros.simulation_interfaces import (
    AssetProblem,
    ResourceError,
    ResourceErrorType,
    ResourceLoader,
    asset_problem,
    has_tags,
)
from mindstage.scene import World
from mindstage.scene.edits import Delete
from mindstage.simulation import Simulation

__all__ = ["SimulationControlServices", "WorldServices"]


_MAP_TAG = "map"
"""Tag of the worlds of maps; that of a file is its suffix."""
_RESULT_CODES = {
    ResourceErrorType.NOT_GIVEN: wire.LoadWorldCode.NO_RESOURCE,
    ResourceErrorType.NOT_FOUND: wire.ResultCode.RESULT_NOT_FOUND,
    ResourceErrorType.UNSUPPORTED_FORMAT: wire.LoadWorldCode.UNSUPPORTED_FORMAT,
    ResourceErrorType.PARSE_ERROR: wire.LoadWorldCode.RESOURCE_PARSE_ERROR,
}
_KNOWN_SCOPES = wire.ResetScope.SCOPE_TIME | wire.ResetScope.SCOPE_STATE | wire.ResetScope.SCOPE_SPAWNED
_STEP_CHUNK_S = 0.1
"""Approximate length into which steps are divided, so that other calls run in between [s]."""


class WorldServices:
    """Services that load and unload worlds."""

    def __init__(
        self,
        simulation: Simulation,
        control: SimulationControlServices,
        resources: ResourceLoader,
        diagnostics: DiagnosticsPublisher,
    ) -> None:
        self._simulation = simulation
        self._control = control
        self._resources = resources
        self._diagnostics = diagnostics

    def services(self) -> Iterator[ServiceSpec]:
        """Yields all services."""
        yield ServiceSpec(wire.LoadWorld, self.load_world, FILE)
        yield ServiceSpec(wire.UnloadWorld, self.unload_world, EDIT)
        yield ServiceSpec(wire.GetCurrentWorld, self.get_current_world, READ)
        yield ServiceSpec(wire.GetAvailableWorlds, self.get_available_worlds, FILE)

    def load_world(self, request: wire.LoadWorld.Request) -> wire.LoadWorld.Response:
        """Loads a world, which replaces the current one and everything that was spawned; it is stopped then.

        If it is refused, the former world is restored, paused; if the engine cannot save its state, nothing is left.
        """
        resource = request.world_resource
        try:
            world = self._resources.load_world(resource.uri, resource.resource_string)
        except ResourceError as error:
            raise ResultError(_RESULT_CODES[error.type], str(error)) from error
        self._simulation.pause()
        report = self._simulation.replace_world(world)
        self._diagnostics.report_spawn("load_world", report)
        code, problem = wire.LoadWorldCode.UNSUPPORTED_ELEMENTS, None
        if not request.ignore_missing_or_unsupported_assets:
            problem = asset_problem(world, self._simulation, report, any_geometry=False)
        if problem is not None:
            code = wire.LoadWorldCode.UNSUPPORTED_ASSETS if problem.found else wire.LoadWorldCode.MISSING_ASSETS
        elif request.fail_on_unsupported_element and not report.ok:
            problem = AssetProblem(found=True, text="some elements cannot be spawned; the diagnostics list them")
        if problem is not None:
            if Capability.SAVE in self._simulation.engine.capabilities:
                self._simulation.edits.undo()
            else:
                self._simulation.clear()
            raise ResultError(code, problem.text)
        self._simulation.mark_start()
        self._control.mark_stopped()
        return wire.LoadWorld.Response(result=OK, world=_resource(world))

    def unload_world(self, _: wire.UnloadWorld.Request) -> wire.UnloadWorld.Response:
        """Removes everything, and pauses the simulation."""
        if not self._simulation.worlds:
            raise ResultError(wire.UnloadWorldCode.NO_WORLD_LOADED, "no world is loaded")
        self._simulation.pause()
        self._simulation.clear()
        return wire.UnloadWorld.Response(result=OK)

    def get_current_world(self, _: wire.GetCurrentWorld.Request) -> wire.GetCurrentWorld.Response:
        """Returns the world that was loaded first."""
        if not self._simulation.worlds:
            raise ResultError(wire.CurrentWorldCode.NO_WORLD_LOADED, "no world is loaded")
        return wire.GetCurrentWorld.Response(result=OK, world=_resource(self._simulation.worlds[0]))

    def get_available_worlds(self, request: wire.GetAvailableWorlds.Request) -> wire.GetAvailableWorlds.Response:
        """Returns the maps of the knowledge base and the files of the folder; no other sources are searched."""
        found, unread = list[wire.WorldResource](), list[str]()
        for map in self._resources.knowledge.maps():
            try:
                found.append(_resource(self._resources.knowledge.world(map)))
            except KnowledgeError as error:
                unread.append(f"{local_name(map)}: {error}")
        if unread and not request.continue_on_error:
            raise ResultError(wire.AvailableWorldsCode.DEFAULT_SOURCES_FAILED, "; ".join(unread[:3]))
        if request.additional_sources and not request.continue_on_error:
            raise failed(
                "additional sources are not supported; set continue_on_error to list the worlds of this server"
            )
        found += (_file(name) for name in self._resources.files())
        worlds = tuple(world for world in found if has_tags(world.tags, request.filter))
        return wire.GetAvailableWorlds.Response(result=replace(OK, error_message="; ".join(unread[:3])), worlds=worlds)


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
        yield ServiceSpec(wire.GetSimulationState, self.get_state, READ, quick=True)
        yield ServiceSpec(wire.SetSimulationState, self.set_state, EDIT)
        yield ServiceSpec(wire.StepSimulation, self.step, RUN)
        yield ServiceSpec(wire.ResetSimulation, self.reset, EDIT)

    def actions(self) -> Iterator[ActionSpec]:
        """Yields all actions."""
        yield ActionSpec(wire.SimulateSteps, self.simulate_steps, GOAL)

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
        if self._simulation.engine.error is not None:
            raise self._simulation.engine.error
        return wire.GetSimulationState.Response(state=wire.SimulationState(state=self.state()), result=OK)

    def mark_stopped(self) -> None:
        """Makes the state `STATE_STOPPED` until simulated time advances."""
        self._stopped_state = self._simulation.state.time_s

    def set_state(self, request: wire.SetSimulationState.Request) -> wire.SetSimulationState.Response:
        """Plays, pauses, stops (pauses and returns to the start), or stops and quits."""
        target, current = request.state.state, self.state()
        if target is current:
            raise ResultError(
                wire.SetSimulationStateCode.ALREADY_IN_TARGET_STATE, f"it is {_state_name(current)} already"
            )
        if target in {wire.StateCode.STATE_NO_WORLD, wire.StateCode.STATE_LOADING_WORLD}:
            text = f"{_state_name(target)} cannot be requested; call load_world or unload_world"
            raise ResultError(wire.SetSimulationStateCode.INCORRECT_TRANSITION, text)
        if target is wire.StateCode.STATE_QUITTING and self._on_quit is None:
            raise unsupported("clients cannot end this simulation")
        has_world = current is not wire.StateCode.STATE_NO_WORLD
        if not has_world and target is not wire.StateCode.STATE_QUITTING:
            text = f"no world is loaded, so it cannot become {_state_name(target)}; call load_world first"
            raise ResultError(wire.SetSimulationStateCode.INCORRECT_TRANSITION, text)
        try:
            self._enter(target, has_world=has_world)
        except MindstageError as error:
            raise ResultError(wire.SetSimulationStateCode.STATE_TRANSITION_ERROR, str(error)) from error
        return wire.SetSimulationState.Response(result=OK)

    def _enter(self, target: wire.StateCode, *, has_world: bool) -> None:
        match target:
            case wire.StateCode.STATE_PLAYING:
                self._simulation.play()
            case wire.StateCode.STATE_PAUSED:
                self._simulation.pause()
                self._stopped_state = None
            case _:
                self._simulation.pause()
                if has_world:
                    self._simulation.reset(to_start=True)
                self.mark_stopped()
        if target is wire.StateCode.STATE_QUITTING and self._on_quit is not None:
            self._on_quit()

    def step(self, request: wire.StepSimulation.Request) -> wire.StepSimulation.Response:
        """Advances a simulation that is not playing by a number of steps."""
        end_s = time.monotonic() + STEPS_TIME.maximum
        STEP_DURATION.check(request.steps * self._step_s)
        with self._exclusive():
            for count in _step_chunks(request.steps, self._step_s):
                if time.monotonic() > end_s:
                    raise SimulationTimeoutError("step_simulation", timeout_s=STEPS_TIME.maximum)
                self._simulation.step(count * self._step_s)
        return wire.StepSimulation.Response(result=OK)

    def reset(self, request: wire.ResetSimulation.Request) -> wire.ResetSimulation.Response:
        """Returns to the start as far as requested: the state of its bodies, and without what was spawned later."""
        scope = request.scope or wire.ResetScope.SCOPE_ALL
        if scope == wire.ResetScope.SCOPE_TIME or not scope & _KNOWN_SCOPES:
            raise unsupported("time cannot be reset without the state; use SCOPE_STATE, SCOPE_SPAWNED or SCOPE_ALL")
        if scope & wire.ResetScope.SCOPE_STATE:
            self._simulation.reset(to_start=True, keep_spawned=not scope & wire.ResetScope.SCOPE_SPAWNED)
        elif scope & wire.ResetScope.SCOPE_TIME:
            raise unsupported("time cannot be reset without the state; add SCOPE_STATE")
        else:
            self._delete_later_spawns()
        return wire.ResetSimulation.Response(result=OK)

    def simulate_steps(self, goal: wire.SimulateSteps.Goal, context: GoalContext) -> wire.SimulateSteps.Result:
        """Advances the simulation by a number of steps, with feedback."""
        done = 0

        def feedback() -> wire.SimulateSteps.Feedback:
            return wire.SimulateSteps.Feedback(completed_steps=done, remaining_steps=goal.steps - done)

        after_each = goal.steps <= FEEDBACK_STEPS.count
        with self._exclusive():
            for count in _step_chunks(goal.steps, self._step_s, single=after_each):
                context.check(None if after_each else feedback)
                self._simulation.step(count * self._step_s)
                done += count
                if after_each:
                    context.send_feedback(feedback())
        if context.cancelled:
            raise GoalCanceledError
        if not after_each or not goal.steps:
            context.send_feedback(feedback())
        return wire.SimulateSteps.Result(result=OK)

    @contextmanager
    def _exclusive(self) -> Iterator[None]:
        """Makes sure that nothing else advances the simulation.

        Raises:
            ResultError: no world is loaded, the simulation is playing, or another call is stepping it.
        """
        if self.state() is wire.StateCode.STATE_NO_WORLD:
            raise failed("no world is loaded")
        if self._simulation.state.playing:
            raise failed("it is playing; pause it first")
        if not self._step_lock.acquire(blocking=False):
            raise failed("another call is stepping it")
        try:
            yield
        finally:
            self._step_lock.release()

    def _delete_later_spawns(self) -> None:
        start = self._simulation.start_ids
        self._simulation.apply(Delete(tuple(id for id in self._simulation.state.ids if id not in start)))


def _step_chunks(steps: int, step_s: float, *, single: bool = False) -> Iterator[int]:
    """Yields the number of steps of each chunk; 1 if `single`."""
    chunk = 1 if single else max(1, round(_STEP_CHUNK_S / step_s))
    for start in range(0, steps, chunk):
        yield min(chunk, steps - start)


def _state_name(state: wire.StateCode) -> str:
    return state.name.removeprefix("STATE_").lower().replace("_", " ")
