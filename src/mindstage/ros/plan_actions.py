"""The action `mindstage/evaluate_plan`: plans are tried in copies of the simulation, with feedback, until a deadline.

The samples run in a thread that the goal supervises, so that a goal ends when it is canceled or its time is over, even
if a sample does not.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from contextvars import copy_context
from functools import partial
from typing import Any

import msgspec

from mindstage.access.limits import PLAN_SAMPLES
from mindstage.access.policies import GOAL
from mindstage.errors import InvalidArgumentError, MessageValidationError, PlanError
from mindstage.imagination.plan_files import PlanFile
from mindstage.imagination.plans import Check, GivenUncertainty
from mindstage.imagination.results import Outcome
from mindstage.imagination.trials import physical_simulation, plan_from_text
from mindstage.imagination.verdicts import Progress, Verdict, evaluate_plan
from mindstage.msgs import mindstage_msgs as wire
from mindstage.ros.service import ActionSpec, GoalCanceledError, GoalContext
from mindstage.simulation import Simulation

__all__ = ["PlanActions"]

_DEFAULT_SAMPLES = 100
_DEFAULT_BUDGET_S = 60.0
_DEFAULT_THRESHOLD = 0.9
"""A probability."""
_POLL_S = 0.05
"""Interval at which a goal looks for its cancellation [s]."""
_CANCEL_GRACE_S = 0.25
"""Time for the samples to end after a cancellation [s]; the goal then ends without them."""
_END_GRACE_S = 1.0
"""Time for the samples to end after the budget [s]; the goal then ends without them."""


class PlanActions:
    """The action that tries plans."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation

    def actions(self) -> Iterator[ActionSpec]:
        """Yields the action."""
        yield ActionSpec(wire.EvaluatePlan, self.evaluate_plan, GOAL, name="mindstage/evaluate_plan")

    def evaluate_plan(self, goal: wire.EvaluatePlan.Goal, context: GoalContext) -> wire.EvaluatePlan.Result:
        """Tries a plan; a plan that cannot be tried is refused, with the place in it.

        Raises:
            GoalCanceledError: the goal was canceled; with what is known by then.
        """
        budget_s = goal.budget_s if goal.budget_s > 0.0 else min(_DEFAULT_BUDGET_S, context.timeout_s)
        trial = _SupervisedTrial(self._simulation, goal, context, budget_s)
        try:
            return trial.run()
        except (PlanError, InvalidArgumentError, MessageValidationError) as error:
            place = getattr(error, "place", "") or getattr(error, "path", "")
            refusal = wire.Refusal(code=type(error).__name__, text=str(error), reason=str(place))
            return _without_samples(str(error), refusal=refusal)


class _SupervisedTrial:
    """One goal: its samples run in a thread of their own."""

    def __init__(
        self, simulation: Simulation, goal: wire.EvaluatePlan.Goal, context: GoalContext, budget_s: float
    ) -> None:
        self._simulation, self._goal, self._context, self._budget_s = simulation, goal, context, budget_s
        self._canceled, self._ended = threading.Event(), threading.Event()
        self._abandoned = threading.Event()
        self._verdict: Verdict | None = None
        self._error: BaseException | None = None

    def run(self) -> wire.EvaluatePlan.Result:
        """Waits for the verdict, the cancellation or the end of the budget."""
        plan, arguments = self._parsed()
        deadline_s = time.monotonic() + self._budget_s + _END_GRACE_S
        run = partial(copy_context().run, self._try, plan, arguments)  # what it may use is decided by the context
        threading.Thread(target=run, name="mindstage-try-plan", daemon=True).start()
        try:
            while not self._ended.wait(_POLL_S):
                if self._context.cancelled:
                    self._canceled.set()
                    self._ended.wait(_CANCEL_GRACE_S)
                    break
                if time.monotonic() > deadline_s:
                    self._canceled.set()
                    return _without_samples(f"the samples did not end within the budget of {self._budget_s:g} s")
        finally:
            self._abandoned.set()
        if self._context.cancelled:
            known = _without_samples("it was canceled") if self._verdict is None else _result(self._verdict)
            raise GoalCanceledError(known)
        if self._error is not None:
            raise self._error
        assert self._verdict is not None
        return _result(self._verdict)

    def _parsed(self) -> tuple[PlanFile, dict[str, Any]]:
        goal = self._goal
        plan = plan_from_text(goal.plan)
        if not self._budget_s <= self._context.timeout_s:
            cause = f"{self._budget_s:g} s is more than {self._context.timeout_s:g} s, the longest goal of this server"
            raise MessageValidationError("mindstage_msgs/EvaluatePlanGoal", path="budget_s", cause=cause)
        most = os.cpu_count() or 1
        workers = _limited("workers", goal.workers or 1, most, f"this machine has {most} processors")
        samples = _limited("samples", goal.samples or _DEFAULT_SAMPLES, PLAN_SAMPLES.count, "use several goals")
        if not 0.0 <= goal.threshold <= 1.0:
            cause = f"{goal.threshold:g} is no probability"
            raise MessageValidationError("mindstage_msgs/EvaluatePlanGoal", path="threshold", cause=cause)
        return plan, {
            "check": _decoded("check", goal.check, Check) if goal.check else None,
            "uncertainty": _decoded("uncertainty", goal.uncertainty, GivenUncertainty) if goal.uncertainty else (),
            "samples": samples,
            "seed": goal.seed,
            "threshold": goal.threshold or _DEFAULT_THRESHOLD,
            "workers": workers,
        }

    def _try(self, plan: PlanFile, arguments: dict[str, Any]) -> None:
        try:
            with physical_simulation(self._simulation) as simulation:
                self._verdict = evaluate_plan(
                    simulation,
                    plan,
                    budget_s=self._budget_s,
                    progress=self._send_progress,
                    cancel=self._canceled.is_set,
                    **arguments,
                )
        except BaseException as error:  # raised in the thread of the goal
            self._error = error
        finally:
            self._ended.set()

    def _send_progress(self, progress: Progress) -> None:
        if self._abandoned.is_set():
            return
        known = progress.succeeded + progress.failed
        self._context.send_feedback(
            wire.EvaluatePlan.Feedback(
                done=progress.done,
                samples=progress.samples,
                succeeded=progress.succeeded,
                failed=progress.failed,
                probability=progress.succeeded / known if known else -1.0,
                lower=progress.interval[0],
                upper=progress.interval[1],
            )
        )


def _limited(name: str, value: int, most: int, why: str) -> int:
    if value > most:
        cause = f"{value:,} is more than {most:,}"
        raise MessageValidationError("mindstage_msgs/EvaluatePlanGoal", path=name, cause=cause, remedy=why)
    return value


def _decoded(name: str, text: str, type: Any) -> Any:
    try:
        return msgspec.json.decode(text, type=type)
    except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
        raise MessageValidationError("mindstage_msgs/EvaluatePlanGoal", path=name, cause=str(error)) from error


def _result(verdict: Verdict) -> wire.EvaluatePlan.Result:
    failure = verdict.first_failure
    cause = failure.cause if failure is not None else None
    return wire.EvaluatePlan.Result(
        success=True,
        outcome=verdict.outcome.value,
        probability=-1.0 if verdict.probability is None else verdict.probability,
        lower=verdict.interval[0],
        upper=verdict.interval[1],
        samples=verdict.samples,
        succeeded=verdict.succeeded,
        failed=verdict.failed,
        unknown=verdict.unknown,
        stopped=verdict.stopped,
        why=str(verdict),
        failing_sample=-1 if failure is None else failure.index,
        cause="" if cause is None else cause.kind.value,
        thing=(cause.thing or "") if cause is not None else "",
        other=(cause.other or "") if cause is not None else "",
        verdict=verdict.to_json(),
    )


def _without_samples(why: str, *, refusal: wire.Refusal | None = None) -> wire.EvaluatePlan.Result:
    """The result without a verdict: nothing is known."""
    return wire.EvaluatePlan.Result(
        success=refusal is None,
        refusal=refusal or wire.Refusal(),
        outcome=Outcome.UNKNOWN.value,
        probability=-1.0,
        upper=1.0,
        stopped=why,
        why=why,
        failing_sample=-1,
    )
