"""Acting: a plan is done in a running world, at once or only if trials in copies of it succeed often enough.

>>> import mindstage as ms
>>> from mindstage.imagination import Plan, Push, Uncertainty
>>> with ms.open("bundled:kitchen") as sim:
...     push = Plan(steps=(Push(thing="milk_carton_1", force=(200.0, 0.0, 0.0)),))
...     tried = ms.try_first(sim, push, at_least=0.9)
>>> tried.acted
False
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Literal

import msgspec
import numpy as np

from mindstage.access.limits import Samples, Timeout
from mindstage.engines.base import PoseArray
from mindstage.imagination.execution import PlanRunner, complete, never
from mindstage.imagination.executors import Executor
from mindstage.imagination.plan_files import PlanLike, load_plan
from mindstage.imagination.plans import Check, Uncertainty
from mindstage.imagination.results import Outcome, SampleResult
from mindstage.imagination.verdicts import Progress, Verdict, evaluate_plan
from mindstage.ranges import Fraction, Seed, Workers, checked
from mindstage.robots.skill_declaration import SkillStep
from mindstage.scene import BodyId
from mindstage.simulation import Simulation, StateSnapshot

__all__ = ["TryFirstResult", "act", "is_changed", "try_first"]

_CHANGED_M = 1e-3
"""A body that has moved farther while a plan was tried changes the world [m, and parts of a unit quaternion]."""
_POLL_S = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class TryFirstResult:
    """What a trial predicted, and what happened if the plan was then done; truthy if it was done and succeeded."""

    verdict: Verdict
    at_least: float
    """The required probability."""
    result: SampleResult | None
    """What happened in the world itself; None if nothing was done."""
    reason: str
    """Why nothing was done; empty if the plan was done."""

    @property
    def acted(self) -> bool:
        """Whether the plan was done, with success or not."""
        return self.result is not None

    def __bool__(self) -> bool:
        return self.result is not None and self.result.outcome is Outcome.SUCCEEDED

    def __str__(self) -> str:
        if self.result is None:
            return f"not done: {self.reason}"
        cause = f": {self.result.cause.text}" if self.result.cause is not None else ""
        return f"{self.result.outcome} after {self.result.duration_s:.1f} s{cause}"

    def to_dict(self) -> dict[str, Any]:
        """The result as plain data."""
        return {
            "acted": self.acted,
            "at_least": self.at_least,
            "reason": self.reason,
            "result": msgspec.to_builtins(self.result),
            "verdict": self.verdict.to_dict(),
        }


@checked
def act(
    simulation: Simulation,
    plan: PlanLike,
    *,
    seed: Seed = 0,
    stop: Callable[[], bool] = never,
    on_poses: Callable[[float, tuple[BodyId, ...], PoseArray], None] | None = None,
    on_step: Callable[[SkillStep], object] | None = None,
) -> SampleResult:
    """Does a plan in a running simulation, without its uncertainty. It is one edit, which `undo` takes back.

    Simulated time is stepped; while the simulation plays, it passes in real time.

    Args:
        simulation: the simulation, which changes.
        plan: the plan, a dict, or the path or text of one; see `load_plan`.
        seed: of what skills sample.
        stop: asked at least every 0.1 s of simulated time; true ends the plan, and robots stop.
        on_poses: called with the time since the start [s], the ids and the poses (n x 7), at least every 0.1 s.
        on_step: called when a step of a skill begins, and when it ends.

    Raises:
        PlanError: the plan does not fit the world; nothing was done.
    """
    file = load_plan(plan)
    certain = msgspec.structs.replace(file, plan=msgspec.structs.replace(file.plan, uncertainty=(), guesses=False))
    runner = PlanRunner(simulation, certain, seed=seed)
    with simulation.edits.one_step(file.plan.name or "plan"):
        sample = runner.begin(simulation, 0, on_poses=on_poses, on_step=on_step)
        return complete(sample, lambda duration_s: _let_pass(simulation, duration_s), stop=stop)


@checked
def try_first(
    simulation: Simulation,
    plan: PlanLike,
    *,
    at_least: Fraction = 0.9,
    certain: bool = True,
    check: Check | None = None,
    uncertainty: Iterable[Uncertainty | Literal["guesses"]] | Literal["guesses"] = (),
    samples: Samples = 100,
    seed: Seed = 0,
    budget_s: Timeout = 60.0,
    workers: Workers | str | Executor = 1,
    progress: Callable[[Progress], object] = lambda progress: None,
    cancel: Callable[[], bool] = never,
    on_verdict: Callable[[Verdict], object] = lambda verdict: None,
    on_poses: Callable[[float, tuple[BodyId, ...], PoseArray], None] | None = None,
    on_step: Callable[[SkillStep], object] | None = None,
) -> TryFirstResult:
    """Tries a plan in copies of a simulation, and does it in the simulation itself if it is probable enough.

    Simulated time stands still while the plan is tried. If something moves nevertheless, nothing is done.

    Args:
        plan: the plan, a dict, or the path or text of one; see `load_plan`.
        at_least: the probability of success that the plan must have.
        certain: whether the whole 95 % interval of the probability has to be as high, rather than the estimate.
        check: a question at the end, instead of the plan's.
        uncertainty: see `evaluate_plan`, as for the following arguments.
        samples: the largest number of samples.
        seed: determines the random numbers.
        budget_s: limit of the wall time of the trial [s].
        workers: what runs the samples.
        progress: called after each batch of samples.
        cancel: asked at least every 0.2 s; true ends the trial, or the plan itself.
        on_verdict: called with the verdict, before anything is done.
        on_poses: see `act`.
        on_step: see `act`.

    Raises:
        PlanError: the plan does not fit the world; nothing was tried.
        ImaginationError: the executor is not available.
    """
    with _standing_still(simulation):
        before = simulation.state
        verdict = evaluate_plan(
            simulation,
            plan,
            check=check,
            uncertainty=uncertainty,
            samples=samples,
            seed=seed,
            budget_s=budget_s,
            threshold=at_least,
            workers=workers,
            progress=progress,
            cancel=cancel,
        )
        on_verdict(verdict)
        reason = "canceled" if cancel() else _objection(verdict, at_least, certain=certain)
        reason = reason or _change(before, simulation.state)
    if reason:
        return TryFirstResult(verdict=verdict, at_least=at_least, result=None, reason=reason)
    result = act(simulation, verdict.plan, seed=seed, stop=cancel, on_poses=on_poses, on_step=on_step)
    return TryFirstResult(verdict=verdict, at_least=at_least, result=result, reason="")


def _objection(verdict: Verdict, at_least: float, *, certain: bool) -> str:
    """Why a plan is not probable enough; empty if it is."""
    if verdict.probability is None:
        return f"the probability is unknown: {verdict.stopped}"
    low, high = verdict.interval
    if (low if certain else verdict.probability) >= at_least:
        return ""
    found = f"{verdict.probability:.2f}" if low == high else f"{verdict.probability:.2f} ({low:.2f} to {high:.2f})"
    failure = verdict.first_failure.cause if verdict.first_failure is not None else None
    why = f"; {failure.text}" if failure is not None else ""
    return f"the probability is {found}, and at least {at_least:.2f} is required{why}"


def is_changed(before: StateSnapshot, now: StateSnapshot) -> bool:
    """Whether a world was edited, or something moved in it, so that a verdict about it does not hold any more."""
    return before.revision != now.revision or bool(_change(before, now))


def _change(before: StateSnapshot, now: StateSnapshot) -> str:
    """What has changed between two states, in words; empty if nothing has."""
    if now.ids != before.ids:
        names = sorted(set(now.ids) ^ set(before.ids))
        return f"bodies were added or removed while the plan was tried: {', '.join(names[:3])}"
    moved = np.abs(now.poses - before.poses).max(axis=1, initial=0.0) > _CHANGED_M
    return f"{now.ids[int(np.argmax(moved))]} has moved while the plan was tried" if moved.any() else ""


@contextmanager
def _standing_still(simulation: Simulation) -> Iterator[None]:
    """Pauses a playing simulation in the context."""
    state = simulation.state
    if not state.playing:
        yield
        return
    simulation.pause()
    try:
        yield
    finally:
        simulation.play(speed=state.speed)


def _let_pass(simulation: Simulation, duration_s: float) -> None:
    """Lets simulated time pass [s]: by steps, or while the simulation plays by waiting."""
    end_s = simulation.state.time_s + duration_s
    while simulation.state.playing and simulation.state.time_s < end_s - 1e-9:
        time.sleep(min(duration_s, _POLL_S))
    if (left_s := end_s - simulation.state.time_s) > 1e-9:
        simulation.step(left_s)
