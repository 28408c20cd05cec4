"""Running: plays, pauses, steps and resets a simulation."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from mindstage.errors import StageTimedOut
from mindstage.msgs import simulation_interfaces as wire
from mindstage.ros.job import GoalGivenUp, Job
from mindstage.ros.offer import ActionOffer, ServiceOffer
from mindstage.ros.results import OK, ResultError, incorrect_state, unsupported
from mindstage.stage import Stage

__all__ = ["Running"]

_PIECE_S = 0.1
"""Steps are taken in pieces of about this length, so that others get their turn [s]."""
_PATIENCE_S = 300.0


class Running:
    """Lets time pass, or not."""

    def __init__(self, stage: Stage, *, step_s: float, on_quit: Callable[[], object] | None) -> None:
        """Leaves everything as it is.

        Args:
            stage: whose time it is.
            step_s: how long one step is [s].
            on_quit: called when someone wants the simulation to end; None where nobody may.
        """
        self._stage = stage
        self._step_s = step_s
        self._on_quit = on_quit
        self._stopped_at: float | None = None
        self._stepping = threading.Lock()

    def offers(self) -> Iterator[ServiceOffer]:
        """All services."""
        yield ServiceOffer(wire.GetSimulationState, self.get_state, quick=True)
        yield ServiceOffer(wire.SetSimulationState, self.set_state)
        yield ServiceOffer(wire.StepSimulation, self.step, patience_s=_PATIENCE_S)
        yield ServiceOffer(wire.ResetSimulation, self.reset)

    def actions(self) -> Iterator[ActionOffer]:
        """What takes time."""
        yield ActionOffer(wire.SimulateSteps, self.simulate_steps)

    def state(self) -> wire.StateCode:
        """How the simulation is."""
        frame = self._stage.frame
        if not frame.ids and not self._stage.worlds:
            return wire.StateCode.STATE_NO_WORLD
        if frame.playing:
            return wire.StateCode.STATE_PLAYING
        return wire.StateCode.STATE_STOPPED if self._stopped_at == frame.time_s else wire.StateCode.STATE_PAUSED

    def get_state(self, _: wire.GetSimulationState.Request) -> wire.GetSimulationState.Response:
        """How the simulation is."""
        if self._stage.lost is not None:
            raise self._stage.lost
        return wire.GetSimulationState.Response(state=wire.SimulationState(state=self.state()), result=OK)

    def set_state(self, request: wire.SetSimulationState.Request) -> wire.SetSimulationState.Response:
        """Plays, pauses, stops (which is a pause at the start), or quits."""
        wanted, now = request.state.state, self.state()
        if wanted is now:
            raise ResultError(wire.SetSimulationStateCode.ALREADY_IN_TARGET_STATE, f"it is {_word(now)} already")
        match wanted:
            case wire.StateCode.STATE_QUITTING:
                if self._on_quit is None:
                    raise unsupported("whoever serves this stage ends it")
                self._on_quit()
            case _ if now is wire.StateCode.STATE_NO_WORLD:
                raise incorrect_state("no world is loaded")
            case wire.StateCode.STATE_PLAYING:
                self._stage.play()
            case wire.StateCode.STATE_PAUSED:
                self._stage.pause()
                self._stopped_at = None
            case wire.StateCode.STATE_STOPPED:
                self._stage.pause()
                self._stage.reset()
                self._stopped_at = self._stage.frame.time_s
            case _:
                text = f"{_word(wanted)} is no state that can be asked for"
                raise ResultError(wire.SetSimulationStateCode.INCORRECT_TRANSITION, text)
        return wire.SetSimulationState.Response(result=OK)

    def step(self, request: wire.StepSimulation.Request) -> wire.StepSimulation.Response:
        """Takes so many steps of a simulation that is not playing."""
        end = time.monotonic() + _PATIENCE_S
        with self._alone():
            for piece in _pieces(request.steps, self._step_s):
                if time.monotonic() > end:
                    raise StageTimedOut("step_simulation", timeout_s=_PATIENCE_S)
                self._stage.step(piece * self._step_s)
        return wire.StepSimulation.Response(result=OK)

    def reset(self, request: wire.ResetSimulation.Request) -> wire.ResetSimulation.Response:
        """Goes back to right after the last spawn: time, state and what was deleted since, which belong together."""
        if request.scope == wire.ResetScope.SCOPE_TIME:
            raise unsupported("time goes back with the state only; use SCOPE_STATE or SCOPE_ALL")
        if request.scope == wire.ResetScope.SCOPE_SPAWNED:
            self._remove_what_was_spawned_later()
        else:
            self._stage.reset()
        return wire.ResetSimulation.Response(result=OK)

    def simulate_steps(self, goal: wire.SimulateSteps.Goal, job: Job) -> wire.SimulateSteps.Result:
        """Takes so many steps, and tells how far it is."""
        done = 0

        def told() -> wire.SimulateSteps.Feedback:
            return wire.SimulateSteps.Feedback(completed_steps=done, remaining_steps=goal.steps - done)

        with self._alone():
            for piece in _pieces(goal.steps, self._step_s):
                job.proceed(told)
                self._stage.step(piece * self._step_s)
                done += piece
        if job.cancelled:
            raise GoalGivenUp
        job.tell(told())
        return wire.SimulateSteps.Result(result=OK)

    @contextmanager
    def _alone(self) -> Iterator[None]:
        """Makes sure that time passes for one reason only.

        Raises:
            ResultError: it plays, or somebody else steps.
        """
        if self._stage.frame.playing:
            raise incorrect_state("it is playing; pause it first")
        if not self._stepping.acquire(blocking=False):
            raise incorrect_state("somebody else is stepping it already")
        try:
            yield
        finally:
            self._stepping.release()

    def _remove_what_was_spawned_later(self) -> None:
        first = {body.id for body in self._stage.worlds[0].bodies} if self._stage.worlds else set()
        later = [id for id in self._stage.frame.ids if id not in first]
        self._stage.call(lambda engine: engine.delete(later), what="delete", edits=True)


def _pieces(steps: int, step_s: float) -> Iterator[int]:
    """So many steps in handfuls."""
    handful = max(1, round(_PIECE_S / step_s))
    for begun in range(0, steps, handful):
        yield min(handful, steps - begun)


def _word(state: wire.StateCode) -> str:
    return state.name.removeprefix("STATE_").lower().replace("_", " ")
