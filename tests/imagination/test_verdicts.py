"""Verdicts: their numbers, their reason, the same for the same seed, within the budget, whatever runs the samples."""

from __future__ import annotations

import json
import os
import signal
import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import mindstage as ms
from mindstage.errors import ImaginationError, NumberRefusedError, PlanError
from mindstage.imagination import (
    Check,
    EventKind,
    ImaginedEvent,
    InProcessExecutor,
    Job,
    Move,
    Outcome,
    Plan,
    Progress,
    Push,
    SampleResult,
    Uncertainty,
    Wait,
    WorkerPoolExecutor,
    confidence_sequence,
    evaluate_plan,
    wilson_interval,
)
from mindstage.imagination.executors import lost_sample
from mindstage.robots.skill_declaration import SkillOutcome, SkillResult, SkillState
from mindstage.scene import BodyId, Pose, diff
from mindstage.simulation import Simulation, SimulationImage
from tests.engines.scenes import body
from tests.imagination.scenes import TABLE_HEIGHT_M, on_table

BOX_Z = TABLE_HEIGHT_M + 0.05
NEAR_EDGE = Plan(
    name="near the edge",
    steps=(Move(thing="box", to=Pose((0.0, 0.0, BOX_Z))), Wait(duration_s=1.0)),
    uncertainty=(Uncertainty(thing="box", position_m=(0.02, 0.0, 0.0), yaw_rad=0.3, mass=0.1),),
)
ENDLESS = Plan(
    steps=(Wait(duration_s=3600.0, deadline_s=1e7),),
    deadline_s=1e7,
    uncertainty=(Uncertainty(thing="box", mass=0.1),),
)


@pytest.fixture
def sim() -> Iterator[Simulation]:
    with on_table(body("box", (-0.5, 0.0, BOX_Z), (0.2, 0.1, 0.1), "dynamic", 1.0)) as sim:
        sim.step(0.5)
        yield sim


@pytest.fixture(scope="module")
def pool() -> Iterator[WorkerPoolExecutor]:
    with WorkerPoolExecutor(2) as pool:
        yield pool


def test_the_interval_is_that_of_published_tables() -> None:
    """Values of R's binom::binom.confint(method = "wilson"), also in Brown, Cai and DasGupta (2001)."""
    assert wilson_interval(0, 10) == pytest.approx((0.0, 0.2775328), abs=1e-6)
    assert wilson_interval(5, 10) == pytest.approx((0.2365931, 0.7634069), abs=1e-6)
    assert wilson_interval(10, 10) == pytest.approx((0.7224672, 1.0), abs=1e-6)
    assert wilson_interval(81, 263) == pytest.approx((0.2552901, 0.3661772), abs=1e-4)
    assert wilson_interval(0, 0) == (0.0, 1.0)


def test_a_verdict_counts_its_samples_and_names_the_first_failure(sim: Simulation) -> None:
    verdict = evaluate_plan(sim, NEAR_EDGE, samples=30, fixed=True)
    assert verdict.outcome is Outcome.FAILED
    assert not verdict
    assert (verdict.samples, verdict.succeeded + verdict.failed, verdict.unknown) == (30, 30, 0)
    assert 0.2 < (verdict.probability or 0.0) < 0.8
    assert verdict.interval == wilson_interval(verdict.succeeded, 30)
    assert [each.index for each in verdict.results] == list(range(30))
    first = next(each for each in verdict.results if each.outcome is Outcome.FAILED)
    assert verdict.first_failure == first
    assert first.cause is not None
    assert first.cause.thing == "box"
    if first.cause.kind is EventKind.FELL:
        assert first.cause.other == "table"
        assert first.cause.amount == pytest.approx(TABLE_HEIGHT_M, abs=0.06)
    assert sum(each.count for each in verdict.causes) == verdict.failed
    assert str(verdict).startswith("failed: ")
    assert f"sample {first.index}: box" in str(verdict)
    assert verdict.end_poses("box").shape == (30, 7)


def test_the_outcome_follows_from_the_interval_and_the_threshold(sim: Simulation) -> None:
    p = evaluate_plan(sim, NEAR_EDGE, samples=30, fixed=True).probability or 0.0
    for threshold, outcome in ((0.1, Outcome.SUCCEEDED), (p, Outcome.UNKNOWN), (0.95, Outcome.FAILED)):
        assert evaluate_plan(sim, NEAR_EDGE, samples=30, fixed=True, threshold=threshold).outcome is outcome


def test_a_plan_without_uncertainty_is_one_sample_with_a_certain_outcome(sim: Simulation) -> None:
    verdict = evaluate_plan(sim, Plan(steps=(Wait(duration_s=0.5),)), samples=100)
    assert (verdict.outcome, verdict.probability, verdict.interval) == (Outcome.SUCCEEDED, 1.0, (1.0, 1.0))
    assert verdict.samples == 1
    assert "no uncertainty is stated" in verdict.assumptions[-1]
    verdict = evaluate_plan(sim, Plan(steps=(Move(thing="box", by=(0.8, 0.0, 0.0)), Wait(duration_s=0.5))))
    assert (verdict.outcome, verdict.interval) == (Outcome.FAILED, (0.0, 0.0))


def test_it_ends_when_the_interval_does_not_contain_the_threshold(sim: Simulation) -> None:
    safe = Plan(steps=(Wait(duration_s=0.1),), uncertainty=(Uncertainty(thing="box", position_m=0.01),))
    verdict = evaluate_plan(sim, safe, samples=1000, threshold=0.7)
    assert verdict.samples == 20, "20 successes of 20 show at least 0.7, 10 of 10 do not"
    assert verdict.stopped == "the interval is at least 0.7"
    assert evaluate_plan(sim, safe, samples=30, threshold=0.7, workers=WorkerPoolStandIn()).samples == 20


class WorkerPoolStandIn(InProcessExecutor):
    """Gives results in another order, and more than are needed."""

    def run(self, job: Job, indices: object, **options: object) -> Iterator[SampleResult]:
        yield from reversed(list(super().run(job, indices, **options)))  # type: ignore[arg-type]


def test_the_same_seed_gives_the_same_json_on_one_and_on_two_workers(sim: Simulation, pool: WorkerPoolExecutor) -> None:
    alone = evaluate_plan(sim, NEAR_EDGE, samples=40, seed=7, threshold=0.3)
    assert alone.to_json() == evaluate_plan(sim, NEAR_EDGE, samples=40, seed=7, threshold=0.3).to_json()
    assert alone.to_json() == evaluate_plan(sim, NEAR_EDGE, samples=40, seed=7, threshold=0.3, workers=pool).to_json()
    shuffled = evaluate_plan(sim, NEAR_EDGE, samples=40, seed=7, threshold=0.3, workers=WorkerPoolStandIn())
    assert alone.to_json() == shuffled.to_json()
    assert alone != evaluate_plan(sim, NEAR_EDGE, samples=40, seed=8, threshold=0.3)


def test_the_json_has_the_promised_fields(sim: Simulation) -> None:
    content = json.loads(evaluate_plan(sim, NEAR_EDGE, samples=10).to_json())
    assert set(content) == {
        "outcome", "probability", "interval", "interval_kind", "samples", "succeeded", "failed", "unknown", "seed",
        "threshold", "stopped", "more_samples", "began_in_collision", "why", "first_failure", "causes", "assumptions",
        "sensitivity", "end_positions", "plan",
    }  # fmt: skip
    assert content["outcome"] == "failed"
    assert content["first_failure"]["cause"]["thing"] == "box"
    assert content["plan"]["steps"][1] == {"do": "wait", "duration_s": 1.0, "deadline_s": None}


def test_a_thousand_imaginations_leave_the_world_bit_for_bit_the_same(sim: Simulation) -> None:
    def bits(simulation: Simulation) -> bytes:
        data = simulation.engine.run(lambda engine: engine._cache.model().data)  # type: ignore[attr-defined]
        names = ("qpos", "qvel", "qacc_warmstart", "xpos", "xquat", "tree_asleep", "body_awake", "time")
        return b"".join(np.asarray(getattr(data, name)).tobytes() for name in names)

    before, world = bits(sim), sim.snapshot()
    plan = Plan(steps=(Push(thing="box", force=(5.0, 0.0, 0.0), duration_s=0.02),), uncertainty=NEAR_EDGE.uncertainty)
    assert evaluate_plan(sim, plan, samples=1000, fixed=True, budget_s=300).samples == 1000
    assert bits(sim) == before
    assert diff(world, sim.snapshot()).identical(0.0)


def test_a_sample_can_be_replayed_exactly(sim: Simulation) -> None:
    verdict = evaluate_plan(sim, NEAR_EDGE, samples=10)
    sim.edits.delete([BodyId("box")])  # the world of the verdict remains
    replay = verdict.replay()
    assert replay.result == verdict.first_failure
    heights = [frame.poses[frame.ids.index(BodyId("box"))][2] for frame in replay.frames]
    assert heights[0] > TABLE_HEIGHT_M > heights[-1] + 0.5
    assert max(np.diff([frame.time_s for frame in replay.frames])) <= 0.1 + 1e-9
    assert verdict.replay(3).result == verdict.results[3]


def test_a_check_decides_what_the_answer_at_the_end_must_be(sim: Simulation) -> None:
    still = Plan(steps=(Wait(duration_s=0.1),))
    on_table = Check(question="where_is", args={"thing": "box"}, expect={"relation": "on", "other": "table"})
    assert evaluate_plan(sim, still, check=on_table)
    verdict = evaluate_plan(
        sim, still, check=Check(question="where_is", args={"thing": "box"}, expect={"other": "floor", "relation": "on"})
    )
    assert verdict.outcome is Outcome.FAILED
    assert verdict.causes[0].kind is EventKind.CHECK
    assert "where_is" in str(verdict)
    assert verdict.results[0].answers
    assert not evaluate_plan(sim, still, check=Check(question="where_is", args={"thing": "box"}, expect="none"))


# -- time and losses ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("workers", [1, 2])
def test_a_plan_that_never_ends_ends_at_its_budget(sim: Simulation, pool: WorkerPoolExecutor, workers: int) -> None:
    verdict = evaluate_plan(sim, ENDLESS, samples=100, budget_s=1.5, workers=pool if workers == 2 else 1)
    assert verdict.outcome is Outcome.UNKNOWN
    assert verdict.probability is None
    assert verdict.failed == 0
    assert verdict.samples == verdict.unknown <= workers
    assert "budget of 1.5 s" in str(verdict)


@pytest.mark.parametrize("workers", [1, 2])
def test_it_can_be_canceled(sim: Simulation, pool: WorkerPoolExecutor, workers: int) -> None:
    canceled = threading.Event()
    timer = threading.Timer(0.3, canceled.set)
    timer.start()
    verdict = evaluate_plan(sim, ENDLESS, samples=100, workers=pool if workers == 2 else 1, cancel=canceled.is_set)
    assert verdict.outcome is Outcome.UNKNOWN
    assert verdict.stopped == "canceled"


def test_workers_that_die_while_a_plan_is_canceled_leave_samples_unknown(
    sim: Simulation, pool: WorkerPoolExecutor
) -> None:
    killed = set[int]()

    def cancel() -> bool:
        for process in set(pool.process_ids) - killed:
            killed.add(process)
            os.kill(process, signal.SIGKILL)
        return bool(killed)

    verdict = evaluate_plan(sim, ENDLESS, samples=100, workers=pool, cancel=cancel)
    assert (verdict.outcome, verdict.stopped) == (Outcome.UNKNOWN, "canceled")
    assert verdict.samples == verdict.unknown
    assert len(killed) == 2
    assert evaluate_plan(sim, NEAR_EDGE, samples=4, fixed=True, workers=pool).samples == 4, "they are replaced"


def test_a_killed_worker_makes_its_sample_unknown_and_is_replaced(sim: Simulation, pool: WorkerPoolExecutor) -> None:
    first_batch = threading.Event()

    def kill() -> None:
        assert first_batch.wait(60.0)
        os.kill(pool.process_ids[0], signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    verdict = evaluate_plan(
        sim, NEAR_EDGE, samples=120, fixed=True, workers=pool, progress=lambda progress: first_batch.set()
    )
    killer.join(60.0)
    assert (verdict.samples, verdict.unknown) == (120, 1)
    lost = next(each for each in verdict.results if each.outcome is Outcome.UNKNOWN)
    assert lost.cause is not None
    assert "signal 9" in lost.cause.text
    assert len(pool.process_ids) == 2
    alone = evaluate_plan(sim, NEAR_EDGE, samples=120, fixed=True)
    assert [each for each in alone.results if each.index != lost.index] == [
        each for each in verdict.results if each is not lost
    ]
    low, high = verdict.interval
    assert low == wilson_interval(verdict.succeeded, 120)[0]
    assert high == wilson_interval(verdict.succeeded + 1, 120)[1]


def test_workers_end_with_their_pool_and_with_their_parent(sim: Simulation) -> None:
    with WorkerPoolExecutor(2) as own:
        evaluate_plan(sim, NEAR_EDGE, samples=4, workers=own)
        processes = own.process_ids
        assert len(processes) == 2
    for process in processes:
        with pytest.raises(ProcessLookupError):
            os.kill(process, 0)


def test_an_error_of_all_samples_is_raised_and_the_pool_remains_usable(
    sim: Simulation, pool: WorkerPoolExecutor
) -> None:
    bad = Job(SimulationImage.capture(sim), Plan(steps=(Move(thing="no", by=(0.0, 0.0, 1.0)),)))
    with pytest.raises(ImaginationError, match="there is no body 'no'"):
        list(pool.run(bad, range(3), deadline_s=time.monotonic() + 60.0))
    assert evaluate_plan(sim, NEAR_EDGE, samples=10, workers=pool).samples == 10


def test_unknown_samples_are_never_failed() -> None:
    class Losing(InProcessExecutor):
        def run(self, job: Job, indices: object, **options: object) -> Iterator[SampleResult]:
            for result in super().run(job, indices, **options):  # type: ignore[arg-type]
                yield lost_sample(result.index, "the node is gone") if result.index % 2 else result

    with on_table(body("box", (-0.5, 0.0, BOX_Z), (0.2, 0.1, 0.1), "dynamic", 1.0)) as sim:
        safe = Plan(steps=(Wait(duration_s=0.1),), uncertainty=(Uncertainty(thing="box", position_m=0.01),))
        verdict = evaluate_plan(sim, safe, samples=20, fixed=True, workers=Losing())
    assert (verdict.succeeded, verdict.failed, verdict.unknown) == (10, 0, 10)
    assert verdict.probability == 1.0
    assert verdict.interval == (wilson_interval(10, 20)[0], 1.0)
    assert verdict.outcome is Outcome.UNKNOWN
    assert "10 are unknown" in str(verdict)


# -- from given samples ------------------------------------------------------------------------------------------------


class Given:
    """An executor whose results are given; it counts those that are taken."""

    name, notes = "given", ("the samples were made up",)

    def __init__(self, *results: SampleResult) -> None:
        self._results = results
        self.taken: list[int] = []

    def run(self, job: Job, indices: object, **options: object) -> Iterator[SampleResult]:
        for result in self._results:
            self.taken.append(result.index)
            yield result

    def close(self) -> None:
        raise AssertionError("an executor that was given remains open")


def fell(other: str, text: str = "box fell") -> ImaginedEvent:
    return ImaginedEvent(kind=EventKind.FELL, text=text, thing=BodyId("box"), other=BodyId(other), time_s=0.5)


def sample(index: int, cause: ImaginedEvent | None = None, x: float = 0.0, **fields: Any) -> SampleResult:
    outcome = Outcome.SUCCEEDED if cause is None else Outcome.FAILED
    pose = Pose((x, 2.0 * x, 1.0))
    return SampleResult(index=index, outcome=outcome, cause=cause, end_poses={"box": pose}, **fields)


LATE = ImaginedEvent(kind=EventKind.LATE, text="it took too long")
MIXED = (
    *(sample(index, x=0.1 * index) for index in (0, 1, 2)),
    sample(4, fell("table", "box fell from table, second"), x=9.0),
    sample(3, fell("shelf", "box fell from shelf"), x=-1.0),
    sample(6, fell("table"), x=9.0),
    sample(5, LATE, x=9.0),
    lost_sample(7, "the node is gone"),
    sample(9, fell("shelf"), x=9.0),
    sample(8, fell("table"), x=9.0),
)
"""Ten samples, not in their order: three succeeded, six failed, and one is unknown."""


def test_every_sample_is_counted_with_its_cause_whatever_order_they_end_in(sim: Simulation) -> None:
    verdict = evaluate_plan(sim, NEAR_EDGE, samples=10, fixed=True, workers=Given(*MIXED), threshold=0.2, seed=3)
    assert [each.index for each in verdict.results] == list(range(10))
    assert (verdict.samples, verdict.succeeded, verdict.failed, verdict.unknown) == (10, 3, 6, 1)
    assert verdict.probability == pytest.approx(3 / 9)
    assert verdict.interval == (wilson_interval(3, 10)[0], wilson_interval(4, 10)[1])
    assert verdict.outcome is Outcome.UNKNOWN
    assert verdict.first_failure == MIXED[4], "the one with the lowest index, not the one that ended first"
    causes = [(each.kind.value, each.thing, each.other, each.count) for each in verdict.causes]
    assert causes == [
        ("fell", "box", "table", 3),
        ("fell", "box", "shelf", 2),
        ("late", None, None, 1),
        ("lost", None, None, 1),
    ]
    low, high = verdict.interval
    assert str(verdict) == (
        f"unknown: 3 of 9 samples succeeded (0.33, 95 % interval after Wilson {low:.2f} to {high:.2f}); 1 is unknown: "
        f"the node is gone; it ended since all samples were run; about {verdict.more_samples} more samples would "
        "decide whether it is at least 0.2; sample 3: box fell from shelf"
    )
    assert verdict.stopped == "all samples were run"
    assert "the samples were made up" in verdict.assumptions
    assert verdict.end_poses("box")[:4].tolist() == [
        pytest.approx([x, 2 * x, 1.0, 1.0, 0.0, 0.0, 0.0]) for x in (0.0, 0.1, 0.2, -1.0)
    ]
    assert verdict.end_poses("table").shape == (0, 7)


def test_the_json_of_a_verdict_has_its_numbers(sim: Simulation) -> None:
    verdict = evaluate_plan(sim, NEAR_EDGE, samples=10, fixed=True, workers=Given(*MIXED), threshold=0.2, seed=3)
    found = json.loads(verdict.to_json())
    for name in ("outcome", "probability", "samples", "succeeded", "failed", "unknown", "seed", "threshold", "stopped"):
        assert found[name] == getattr(verdict, name), name
    assert (found["interval"], found["why"]) == (list(verdict.interval), str(verdict))
    assert found["first_failure"]["index"] == 3
    assert found["first_failure"]["cause"]["other"] == "shelf"
    assert [(each["kind"], each.get("other"), each["count"]) for each in found["causes"]] == [
        ("fell", "table", 3),
        ("fell", "shelf", 2),
        ("late", None, 1),
        ("lost", None, 1),
    ]
    xs = [0.0, 0.1, 0.2, -1.0, 9.0, 9.0, 9.0, 9.0, 9.0]
    assert found["end_positions"] == {
        "box": {
            "count": 9,
            "mean": pytest.approx([np.mean(xs), 2 * np.mean(xs), 1.0]),
            "deviation": pytest.approx([np.std(xs), 2 * np.std(xs), 0.0]),
        }
    }
    assert found["plan"]["name"] == "near the edge"
    assert found["assumptions"] == list(verdict.assumptions)
    table = verdict._repr_html_()
    for text in ("fell", "late", "lost", "shelf", "table", "<td>3</td>", "box"):
        assert text in table


def test_samples_after_the_one_that_decides_do_not_count(sim: Simulation) -> None:
    executor = Given(*(sample(index) for index in range(60)))
    verdict = evaluate_plan(sim, NEAR_EDGE, samples=60, workers=executor)
    assert (verdict.samples, verdict.succeeded) == (50, 50)
    assert verdict.stopped == "the interval is at least 0.9"
    assert verdict.outcome is Outcome.SUCCEEDED
    assert len(executor.taken) == 50
    backwards = Given(*(sample(index) for index in range(59, -1, -1)))
    assert evaluate_plan(sim, NEAR_EDGE, samples=60, workers=backwards) == verdict


def test_a_trial_without_all_of_its_samples_says_why(sim: Simulation) -> None:
    early = Given(*(sample(index) for index in range(7)))
    verdict = evaluate_plan(sim, NEAR_EDGE, samples=10, fixed=True, workers=early, budget_s=55.0)
    assert (verdict.samples, verdict.stopped) == (7, "the budget of 55 s was used up")
    canceled = evaluate_plan(sim, NEAR_EDGE, samples=10, workers=Given(sample(0)), cancel=lambda: True)
    assert (canceled.samples, canceled.stopped) == (1, "canceled")
    nothing = evaluate_plan(sim, NEAR_EDGE, samples=10, workers=Given())
    assert (nothing.outcome, nothing.probability, nothing.interval) == (Outcome.UNKNOWN, None, (0.0, 1.0))
    assert str(nothing) == "unknown: no sample has a known outcome (the budget of 60 s was used up)"
    interrupted = [lost_sample(index, "stopped", is_interrupted=True) for index in range(10)]
    ended = evaluate_plan(sim, NEAR_EDGE, samples=10, fixed=True, workers=Given(*interrupted))
    assert ended.stopped == "the budget of 60 s was used up"
    assert ended.outcome is Outcome.UNKNOWN


def test_progress_counts_what_has_ended_so_far(sim: Simulation) -> None:
    seen: list[Progress] = []
    results = [sample(index, None if index % 5 else LATE) for index in range(25)]
    evaluate_plan(sim, NEAR_EDGE, samples=25, fixed=True, workers=Given(*results), progress=seen.append)
    assert [(each.done, each.samples, each.succeeded, each.failed) for each in seen] == [
        (10, 25, 8, 2),
        (20, 25, 16, 4),
        (25, 25, 20, 5),
    ]
    assert [each.interval for each in seen] == [
        confidence_sequence(8, 10),
        confidence_sequence(16, 20),
        confidence_sequence(20, 25),
    ]


def test_what_skills_assumed_is_listed_with_the_number_of_samples(sim: Simulation) -> None:
    def with_skills(index: int, *assumptions: str) -> SampleResult:
        skill = SkillResult(
            outcome=SkillOutcome.SUCCEEDED,
            skill="grasp",
            args={},
            reason="",
            assumptions=assumptions,
            suggestion="",
            state=SkillState(base=None, held={}, supports={}, openness={}),
            duration_s=1.0,
            steps=(),
        )
        return sample(index, skills=(skill, skill))

    results = (with_skills(0, "rare", "all"), with_skills(1, "all", "often"), with_skills(2, "often", "all"))
    verdict = evaluate_plan(sim, NEAR_EDGE, samples=3, fixed=True, workers=Given(*results))
    assert verdict.assumptions[-3:] == ("all", "in 2 samples of 3: often", "in 1 sample of 3: rare")


# -- bad input ---------------------------------------------------------------------------------------------------------


def where_is(**options: object) -> Check:
    return Check(question="where_is", **options)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("plan", "options", "message"),
    [
        (Plan(steps=(Move(thing="bx", by=(0.0, 0.0, 1.0)),)), {}, r"steps\[0\].thing: .*'bx'; near: 'box'"),
        (Plan(steps=(Move(thing="box"),)), {}, r"steps\[0\]: .*either `to`"),
        (NEAR_EDGE, {"check": Check(question="where_iss")}, r"check: .*where_is"),
        (NEAR_EDGE, {"check": where_is(args={"ting": 1})}, "check: .*ting"),
        (NEAR_EDGE, {"check": where_is(args={"thing": "bx"})}, "check: .*bx"),
        (NEAR_EDGE, {"check": where_is(expect={"plce": "x"})}, r"check.expect: .*'plce'"),
        (NEAR_EDGE, {"uncertainty": [Uncertainty(thing="bok")]}, r"uncertainty\[1\].thing: .*'box'"),
        (NEAR_EDGE, {"samples": 0}, "samples 0: it must be an integer from 1"),
        (NEAR_EDGE, {"workers": 0}, "workers 0: it must be an integer from 1"),
        (NEAR_EDGE, {"workers": "cloud"}, "no executor is named 'cloud'"),
        ("steps:\n  - do: wait\n    duration_s: 1\nforbid: [fel]\n", {}, r"the plan:4: forbid\[0\]: .*'fell'"),
    ],
)
def test_bad_input_is_named_before_anything_runs(
    sim: Simulation, plan: Plan | str, options: dict[str, Any], message: str
) -> None:
    with pytest.raises((PlanError, ImaginationError, NumberRefusedError), match=message):
        evaluate_plan(sim, plan, **options)


def test_progress_is_reported_after_each_batch(sim: Simulation) -> None:
    seen: list[Progress] = []
    verdict = ms.evaluate_plan(sim, NEAR_EDGE, samples=25, fixed=True, progress=seen.append)
    assert [each.done for each in seen] == [10, 20, 25]
    assert seen[-1].succeeded == verdict.succeeded
    assert seen[-1].interval == confidence_sequence(verdict.succeeded, 25)
