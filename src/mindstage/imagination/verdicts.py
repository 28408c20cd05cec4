"""Verdicts: a plan is tried many times in copies of a world, and judged with a probability and a reason.

>>> import mindstage as ms
>>> from mindstage.imagination import Plan, Push, Uncertainty
>>> with ms.open("bundled:kitchen") as sim:
...     push = Plan(steps=(Push(thing="milk_carton_1", force=(2.0, 0.0, 0.0)),))
...     verdict = ms.evaluate_plan(sim, push)
>>> verdict.outcome
<Outcome.SUCCEEDED: 'succeeded'>
"""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import partial
from typing import Any, Literal

import msgspec
import numpy as np

from mindstage.access.limits import Samples, Timeout
from mindstage.engines.base import PoseArray
from mindstage.errors import ImaginationError, PlanError
from mindstage.imagination.confidence import (
    MAX_ESTIMATE,
    confidence_sequence,
    samples_to_decide,
    wilson_interval,
)
from mindstage.imagination.execution import is_uncertain, named_bodies, never, validate_plan
from mindstage.imagination.executors import Executor, InProcessExecutor, Job, SampleRunner, WorkerPoolExecutor
from mindstage.imagination.guesses import Guess, Guesses
from mindstage.imagination.plan_files import PlanLike, load_plan
from mindstage.imagination.plans import GUESSES, Check, Plan, Uncertainty
from mindstage.imagination.results import EventKind, ImaginedEvent, Outcome, SampleResult
from mindstage.imagination.stated_uncertainty import stated_uncertainty
from mindstage.ranges import Fraction, Index, Seed, Workers, checked
from mindstage.scene import BodyId
from mindstage.scene.display import counted, html_table
from mindstage.simulation import Simulation
from mindstage.simulation.image import SimulationImage

__all__ = ["CauseCount", "IntervalKind", "Progress", "Replay", "ReplayFrame", "Verdict", "evaluate_plan"]

_BATCH = 10
"""The interval is looked at after each such number of samples, in their order, however many workers there are."""
_CORRECTIONS = (EventKind.CORRECTED, EventKind.MOVED)
_MAX_KEPT = 1000
"""Number of samples whose results are kept; the counts are of all."""


class IntervalKind(StrEnum):
    """How the interval of a verdict was computed."""

    ALWAYS_VALID = "always valid"
    """`confidence_sequence`: it holds whenever a trial ends."""
    WILSON = "Wilson"
    """`wilson_interval`, of a number of samples that was fixed, all of which were run."""
    CERTAIN = "certain"
    """Nothing is uncertain: both bounds are the outcome of the only sample, or 0 and 1 if that is unknown."""


class CauseCount(msgspec.Struct, frozen=True, kw_only=True):
    """How many samples did not succeed for one cause."""

    kind: EventKind
    thing: BodyId | None
    other: BodyId | None
    count: int


class Progress(msgspec.Struct, frozen=True, kw_only=True):
    """The state of a trial after some samples."""

    done: int
    """Number of samples that have ended."""
    samples: int
    """The largest number of samples."""
    succeeded: int
    failed: int
    interval: tuple[float, float]
    """The always-valid interval of the probability so far."""


class ReplayFrame(msgspec.Struct, frozen=True, eq=False):
    """The poses of all bodies at one time of a sample."""

    time_s: float
    """Simulated time since the start [s]."""
    ids: tuple[BodyId, ...]
    poses: PoseArray
    """n x 7, in the order of `ids`: position [m] and quaternion (w, x, y, z)."""

    def __repr__(self) -> str:
        return f"<{type(self).__name__} at {self.time_s:.2f} s, {counted(len(self.ids), 'body')}>"


@dataclass(frozen=True, slots=True, eq=False)
class Replay:
    """One sample, executed again."""

    result: SampleResult
    frames: tuple[ReplayFrame, ...]
    """At least one for each 0.1 s of simulated time."""

    def __repr__(self) -> str:
        result = self.result
        cause = f": {result.cause.text}" if result.cause is not None else ""
        frames = counted(len(self.frames), "frame")
        return f"<{type(self).__name__} of sample {result.index}, {result.outcome}{cause}; {frames}>"


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """The result of many samples of a plan. Verdicts with the same plan, world and seed are equal."""

    outcome: Outcome
    """Succeeded if the whole interval is at least the threshold, failed if it is below, else unknown."""
    probability: float | None
    """Part of the samples with a known outcome that succeeded; None without any."""
    interval: tuple[float, float]
    """95 % interval of the probability; a sample that is unknown counts as failed for the lower bound, and as succeeded
    for the upper one. Both are equal for a plan without uncertainty."""
    interval_kind: IntervalKind
    """How it was computed."""
    samples: int
    """Number of samples that were begun."""
    succeeded: int
    failed: int
    unknown: int
    began_in_collision: int
    """Number of samples in which a thing was inside of another one at the start, or where a step has set it."""
    seed: int
    threshold: float
    """The required probability."""
    stopped: str
    """Why there are no more samples, in words."""
    more_samples: int | None
    """About how many more samples would decide an unknown verdict, if they went on as before; 0 if it is decided, None
    if more than ten million, or if no number would."""
    first_failure: SampleResult | None
    """The sample with the lowest index that failed."""
    causes: tuple[CauseCount, ...]
    """Why samples did not succeed, the most frequent cause first."""
    sensitivity: str
    """Which guess matters most, in words; empty unless guesses vary."""
    assumptions: tuple[str, ...]
    """What the verdict rests on, one sentence each."""
    plan: Plan
    results: tuple[SampleResult, ...] = field(repr=False)
    """The first samples, at most 1,000, in the order of their indices."""
    _image: SimulationImage | None = field(default=None, repr=False, compare=False)

    def __bool__(self) -> bool:
        return self.outcome is Outcome.SUCCEEDED

    def __str__(self) -> str:
        if self.probability is None:
            return f"{self.outcome}: no sample has a known outcome ({self.stopped}{self._why_unknown})"
        low, high = self.interval
        known = self.succeeded + self.failed
        parts = [f"{self.succeeded:,} of {known:,} samples succeeded"]
        if is_uncertain(self.plan):
            kind = " after Wilson" if self.interval_kind is IntervalKind.WILSON else ""
            parts = [f"{parts[0]} ({self.probability:.2f}, 95 % interval{kind} {low:.2f} to {high:.2f})"]
        if self.began_in_collision:
            share = f"{self.began_in_collision / self.samples:.0%} began in collision"
            corrections = (event for each in self.results for event in each.events if event.kind in _CORRECTIONS)
            first = next(corrections, None)
            parts.append(share if first is None else f"{share}, such as: {first.text}")
        if self.unknown:
            parts.append(f"{self.unknown:,} {'is' if self.unknown == 1 else 'are'} unknown{self._why_unknown}")
        if self.outcome is Outcome.UNKNOWN:
            parts.append(f"it ended since {self.stopped}")
            if is_uncertain(self.plan):
                more = (
                    f"not even {MAX_ESTIMATE:,}" if self.more_samples is None else f"about {self.more_samples:,} more"
                )
                parts.append(f"{more} samples would decide whether it is at least {self.threshold:g}")
        if self.first_failure is not None and self.first_failure.cause is not None:
            parts.append(f"sample {self.first_failure.index}: {self.first_failure.cause.text}")
        if self.sensitivity:
            parts.append(self.sensitivity)
        return f"{self.outcome}: {'; '.join(parts)}"

    @property
    def _why_unknown(self) -> str:
        """The cause of the first sample that is unknown, after a colon; empty without one."""
        causes = (each.cause for each in self.results if each.outcome is Outcome.UNKNOWN)
        return next((f": {cause.text}" for cause in causes if cause is not None), "")

    def end_poses(self, body: str) -> PoseArray:
        """The poses of a body at the end of the kept samples in which it is reported, k x 7.

        Args:
            body: the id of a body that the plan names, that is uncertain, or that moved by more than 1 cm.
        """
        poses = [each.end_poses[body] for each in self.results if body in each.end_poses]
        return np.array([[*pose.position, *pose.quaternion] for pose in poses], dtype=float).reshape(-1, 7)

    @checked
    def replay(self, index: Index | None = None, *, stop: Callable[[], bool] = never) -> Replay:
        """Executes one sample again, exactly as before.

        Args:
            index: the number of the sample; by default the first one that failed, else the first one.
            stop: ends the replay when it returns true.

        Raises:
            ImaginationError: the world is not known any more, as of a verdict that was read from JSON.
        """
        if self._image is None:
            raise ImaginationError("the world of this verdict is not known any more; imagine the plan again")
        failed = self.first_failure.index if self.first_failure is not None else 0
        frames: list[ReplayFrame] = []
        runner = SampleRunner(Job(self._image, self.plan, self.seed))
        result = runner.run(
            failed if index is None else index,
            stop=stop,
            on_poses=lambda time_s, ids, poses: frames.append(ReplayFrame(time_s, ids, poses)),
        )
        return Replay(result, tuple(frames))

    def to_dict(self) -> dict[str, Any]:
        """The verdict as plain data: the fields of this class except `results`, with the distribution of end poses."""
        names = sorted({id for each in self.results for id in each.end_poses})
        positions = {id: self.end_poses(id)[:, :3] for id in names}
        return {
            "outcome": self.outcome.value,
            "probability": self.probability,
            "interval": list(self.interval),
            "interval_kind": self.interval_kind.value,
            "samples": self.samples,
            "succeeded": self.succeeded,
            "failed": self.failed,
            "unknown": self.unknown,
            "began_in_collision": self.began_in_collision,
            "seed": self.seed,
            "threshold": self.threshold,
            "stopped": self.stopped,
            "more_samples": self.more_samples,
            "why": str(self),
            "first_failure": msgspec.to_builtins(self.first_failure),
            "causes": [msgspec.to_builtins(each) for each in self.causes],
            "sensitivity": self.sensitivity,
            "assumptions": list(self.assumptions),
            "end_positions": {
                id: {"count": len(each), "mean": each.mean(axis=0).tolist(), "deviation": each.std(axis=0).tolist()}
                for id, each in positions.items()
            },
            "plan": msgspec.to_builtins(self.plan),
        }

    def to_json(self) -> str:
        """`to_dict` as JSON: the same text for the same world, plan and seed, unless time ran out."""
        return json.dumps(self.to_dict(), ensure_ascii=False, sort_keys=True)

    def _repr_html_(self) -> str:
        """Causes as an HTML table, for notebooks."""
        rows = [(each.kind.value, each.thing or "", each.other or "", str(each.count)) for each in self.causes]
        return html_table(str(self), ("cause", "thing", "other", "samples"), rows)


@checked
def evaluate_plan(
    simulation: Simulation,
    plan: PlanLike,
    *,
    check: Check | None = None,
    uncertainty: Iterable[Uncertainty | Literal["guesses"]] | Literal["guesses"] = (),
    samples: Samples = 100,
    seed: Seed = 0,
    budget_s: Timeout = 60.0,
    threshold: Fraction = 0.9,
    fixed: bool = False,
    workers: Workers | str | Executor = 1,
    progress: Callable[[Progress], object] = lambda progress: None,
    cancel: Callable[[], bool] = never,
) -> Verdict:
    """Tries a plan in copies of a simulation, which stays as it is, and judges it.

    Args:
        simulation: the simulation in whose current state each sample begins.
        plan: the plan, a dict, or the path or text of one in JSON or YAML; see `load_plan`.
        check: a question at the end, instead of the plan's.
        uncertainty: added to the plan's, before which comes that of the maps (`stated_uncertainty`); what is stated
            later precedes. With "guesses", alone or among them, masses and frictions that no map states vary, and the
            verdict says which of them matters, from at most as many further samples.
        samples: the largest number of samples; a plan without uncertainty has one, since all would be equal.
        seed: determines the random numbers.
        budget_s: limit of the wall time [s]; samples that have not ended by then are unknown.
        threshold: the probability that the plan must have to succeed. The trial ends as soon as the interval does not
            contain it, which is wrong for at most 2.5 % of the seeds, however near the true probability is.
        fixed: whether exactly `samples` are run; the interval is Wilson's then.
        workers: number of processes; "ray" or "ray://HOST:PORT" for a Ray cluster; "gpu" or "gpu:WORLDS" for
            MuJoCo Warp on a GPU, "gpu:cpu" without one; or an executor, which remains open.
        progress: called after each batch of samples.
        cancel: asked at least every 0.2 s; true ends the trial with what is known.

    Raises:
        PlanError: the plan does not fit the world; nothing was run.
        ImaginationError: the executor is not available, or its workers cannot be started.
    """
    deadline_s = time.monotonic() + budget_s
    file = load_plan(plan)
    given = file.plan
    stated = stated_uncertainty(simulation)
    added = (uncertainty,) if isinstance(uncertainty, str) else tuple(uncertainty)
    if unknown := [each for each in added if isinstance(each, str) and each != GUESSES]:
        raise PlanError("uncertainty", cause=f"{unknown[0]!r} is neither an Uncertainty nor {GUESSES!r}")
    plan = msgspec.structs.replace(given, check=check or given.check, uncertainty=(*given.stated, *added))
    validate_plan(msgspec.structs.replace(file, plan=plan), simulation)
    plan = msgspec.structs.replace(plan, uncertainty=(*stated.uncertainty, *plan.stated))
    guesses = Guesses.of(simulation)
    guessed = guesses.sentences(named_bodies(plan, simulation))
    image = SimulationImage.capture(simulation)
    limit = samples if is_uncertain(plan) else 1
    executor, is_own = (workers, False) if not isinstance(workers, int | str) else (make_executor(workers, limit), True)
    job, sensitivity = Job(image, plan, seed), ""
    trial = _Trial(limit, threshold=None if fixed or not is_uncertain(plan) else threshold)
    try:
        run = partial(executor.run, deadline_s=deadline_s, cancel=cancel)
        trial.collect(run(job, range(limit)), progress)
        if plan.guesses and trial.is_decided:
            sensitivity = _sensitivity(job, guesses, trial.counted(), run)
    except PlanError as error:  # a step that this executor cannot run
        raise PlanError(file.place(error.place), cause=error.cause) from error
    finally:
        if is_own:
            executor.close()
    stopped = trial.stopped
    if not stopped or trial.has_interrupted_samples:
        stopped = "canceled" if cancel() else f"the budget of {budget_s:g} s was used up"
    return _verdict(
        trial.counted(),
        plan,
        image,
        seed=seed,
        threshold=threshold,
        is_fixed=fixed and trial.is_complete,
        stopped=stopped,
        sensitivity=sensitivity,
        assumptions=(*stated.notes, *executor.notes, *guessed),
    )


def make_executor(workers: int | str, samples: int = 1) -> Executor:
    """The executor for a number of processes, or a name; see `evaluate_plan`.

    Raises:
        ImaginationError: the name is unknown, or the executor cannot be used.
    """
    if isinstance(workers, str) and workers.isdecimal():
        workers = int(workers)
    if isinstance(workers, int):
        if workers < 1:
            raise ImaginationError(f"there must be at least one worker, not {workers}")
        return InProcessExecutor() if workers == 1 or samples == 1 else WorkerPoolExecutor(min(workers, samples))
    if workers == "ray" or workers.startswith("ray://"):
        from mindstage.imagination.ray_executor import RayExecutor

        return RayExecutor(workers)
    if workers == "gpu" or workers.startswith("gpu:"):
        from mindstage.imagination.warp_executor import WarpExecutor

        return WarpExecutor.from_name(workers, samples)
    raise ImaginationError(f"no executor is named {workers!r}: give a number of processes, ray, ray://HOST:PORT or gpu")


class _Trial:
    """Collects results, and decides after each batch whether more are needed."""

    def __init__(self, limit: int, *, threshold: float | None) -> None:
        self._limit, self._threshold = limit, threshold
        self._results: dict[int, SampleResult] = {}
        self._prefix = 0
        self._counts: Counter[Outcome] = Counter()
        self.stopped = ""

    @property
    def is_decided(self) -> bool:
        return bool(self.stopped)

    @property
    def is_complete(self) -> bool:
        """Whether all samples were run to their end, or to the loss of their worker."""
        return self._prefix == self._limit and not self.has_interrupted_samples

    @property
    def has_interrupted_samples(self) -> bool:
        """Whether a sample was ended by the caller or by the deadline."""
        return any(each.is_interrupted for each in self._results.values())

    def add(self, result: SampleResult) -> bool:
        """Adds a result; true if a batch has become complete."""
        self._results[result.index] = result
        is_complete = False
        while self._prefix in self._results and not self.stopped:
            self._counts[self._results[self._prefix].outcome] += 1
            self._prefix += 1
            if self._prefix == self._limit:
                self.stopped = "all samples were run"
            if self._prefix % _BATCH == 0 or self.stopped:
                is_complete = True
                if not self.stopped and self._threshold is not None:
                    low, high = _interval(self._counts)
                    if not low < self._threshold <= high:
                        side = "at least" if low >= self._threshold else "below"
                        self.stopped = f"the interval is {side} {self._threshold:g}"
        return is_complete

    def collect(self, results: Iterator[SampleResult], progress: Callable[[Progress], object]) -> None:
        """Adds results until it is decided, and ends the others."""
        for result in results:
            if self.add(result):
                progress(self.progress())
            if self.is_decided:
                break
        close = getattr(results, "close", None)
        if close is not None:
            close()

    def progress(self) -> Progress:
        return Progress(
            done=self._prefix,
            samples=self._limit,
            succeeded=self._counts[Outcome.SUCCEEDED],
            failed=self._counts[Outcome.FAILED],
            interval=_interval(self._counts),
        )

    def counted(self) -> list[SampleResult]:
        """The results of the verdict in order: without those after the one with which it was decided."""
        last = self._prefix if self.stopped else self._limit
        return [self._results[index] for index in sorted(self._results) if index < last]


def _interval(
    counts: Mapping[Outcome, int], interval: Callable[[int, int], tuple[float, float]] = confidence_sequence
) -> tuple[float, float]:
    succeeded, unknown = counts.get(Outcome.SUCCEEDED, 0), counts.get(Outcome.UNKNOWN, 0)
    total = succeeded + unknown + counts.get(Outcome.FAILED, 0)
    return interval(succeeded, total)[0], interval(succeeded + unknown, total)[1]


def _verdict(
    results: list[SampleResult],
    plan: Plan,
    image: SimulationImage,
    *,
    seed: int,
    threshold: float,
    is_fixed: bool,
    stopped: str,
    sensitivity: str = "",
    assumptions: Iterable[str] = (),
) -> Verdict:
    counts = Counter(result.outcome for result in results)
    succeeded, failed = counts[Outcome.SUCCEEDED], counts[Outcome.FAILED]
    known = succeeded + failed
    rests_on = [*image.notes, *image.assumptions, *assumptions]
    if is_uncertain(plan):
        kind = IntervalKind.WILSON if is_fixed else IntervalKind.ALWAYS_VALID
        interval = _interval(counts, wilson_interval if is_fixed else confidence_sequence)
    else:
        kind = IntervalKind.CERTAIN
        interval = (float(succeeded), float(succeeded)) if known else (0.0, 1.0)
        rests_on.append(
            "no uncertainty is stated: guesses are taken as true, all else is as in the world, and one sample suffices"
        )
    rests_on += _skill_assumptions(results)
    fast = Counter(event.thing for result in results for event in result.events if event.kind is EventKind.FAST)
    rests_on += [f"in {counted(n, 'sample')} {thing} may have passed through something" for thing, n in fast.items()]
    outcome = Outcome.UNKNOWN
    if results and interval[0] >= threshold:
        outcome = Outcome.SUCCEEDED
    elif results and interval[1] < threshold:
        outcome = Outcome.FAILED
    more: int | None = 0
    if outcome is Outcome.UNKNOWN:
        more = samples_to_decide(succeeded, len(results), threshold, unknown=counts[Outcome.UNKNOWN])
    return Verdict(
        outcome=outcome,
        probability=succeeded / known if known else None,
        interval=interval,
        interval_kind=kind,
        samples=len(results),
        succeeded=succeeded,
        failed=failed,
        unknown=counts[Outcome.UNKNOWN],
        began_in_collision=sum(result.began_in_collision for result in results),
        seed=seed,
        threshold=threshold,
        stopped=stopped,
        more_samples=more,
        first_failure=next((each for each in results if each.outcome is Outcome.FAILED), None),
        causes=_counted_causes(results),
        sensitivity=sensitivity,
        assumptions=tuple(rests_on),
        plan=plan,
        results=tuple(results[:_MAX_KEPT]),
        _image=image,
    )


def _counted_causes(results: Iterable[SampleResult]) -> tuple[CauseCount, ...]:
    causes = Counter(_cause_key(result.cause) for result in results if result.cause is not None)
    return tuple(
        CauseCount(kind=kind, thing=thing, other=other, count=count)
        for (kind, thing, other), count in sorted(causes.items(), key=lambda item: (-item[1], str(item[0])))
    )


_CANDIDATES = 3
"""Number of guesses that are examined, with together as many samples as there were."""


def _sensitivity(
    job: Job,
    guesses: Guesses,
    results: Sequence[SampleResult],
    run: Callable[[Job, Iterable[int]], Iterator[SampleResult]],
) -> str:
    """Which guess matters most, in words.

    Those whose random numbers correlate most with success are fixed one by one: of the same samples, with the same
    random numbers of all else, some end otherwise.
    """
    outcomes = {each.index: each.outcome for each in results if each.outcome is not Outcome.UNKNOWN}
    if len(set(outcomes.values())) < 2:
        return f"no guess matters: all {counted(len(outcomes), 'sample')} ended alike" if outcomes else ""
    succeeded = np.array([each is Outcome.SUCCEEDED for each in outcomes.values()], dtype=float)
    numbers = np.array([list(guesses.numbers(job.seed, index).values()) for index in outcomes])
    influence = np.abs((succeeded - succeeded.mean()) @ (numbers - numbers.mean(axis=0))) / numbers.std(axis=0)
    candidates = [guesses.all()[column] for column in np.argsort(-influence, kind="stable")[:_CANDIDATES].tolist()]
    indices = list(outcomes)[: max(1, len(outcomes) // len(candidates))]
    changed: dict[Guess, tuple[int, int]] = {}
    for guess in candidates:
        again = [each for each in run(replace(job, fixed_guesses=(guess,)), indices) if not each.is_interrupted]
        changed[guess] = sum(each.outcome is not outcomes[each.index] for each in again), len(again)
    guess, (count, tried) = max(changed.items(), key=lambda item: item[1][0])
    if not count:
        return f"no single guess matters: fixing one changed none of {counted(tried, 'sample')}"
    return f"{guess} matters most of what is guessed: without its spread, {count} of {tried} samples end otherwise"


def _skill_assumptions(results: Sequence[SampleResult]) -> Iterator[str]:
    """What the skills in samples assumed, with the number of samples."""
    counts = Counter(
        text for result in results for text in {text for each in result.skills for text in each.assumptions}
    )
    for text, count in sorted(counts.items(), key=lambda item: (-item[1], item[0])):
        yield text if count == len(results) else f"in {counted(count, 'sample')} of {len(results)}: {text}"


def _cause_key(cause: ImaginedEvent) -> tuple[EventKind, BodyId | None, BodyId | None]:
    return cause.kind, cause.thing, cause.other
