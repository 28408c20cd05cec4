"""Running: plays, pauses, steps and resets a simulation."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from mindstage.errors import SimulationTimeoutError
from mindstage.msgs import simulation_interfaces as wire
from mindstage.ros.job import GoalCanceled, GoalContext
from mindstage.ros.offer import ActionSpec, ServiceSpec
from mindstage.ros.results import OK, ResultError, incorrect_state, unsupported
from mindstage.stage import Simulation

__all__ = ["SimulationControlServices"]

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
