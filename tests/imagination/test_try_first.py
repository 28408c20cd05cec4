"""A plan is tried before it is done, and is not done if it is improbable or the world has changed."""

from __future__ import annotations

import time
from collections.abc import Iterator

import msgspec
import pytest

from mindstage.engines.mujoco import MujocoEngine
from mindstage.errors import PlanError
from mindstage.imagination import (
    EventKind,
    Move,
    Outcome,
    Plan,
    PlanBuilder,
    Push,
    Uncertainty,
    Wait,
    act,
    evaluate_plan,
    try_first,
)
from mindstage.knowledge import KnowledgeBase
from mindstage.robots import add_robot, find_robot
from mindstage.scene import Pose
from mindstage.scene.edits import SetPoses
from mindstage.simulation import Simulation
from tests.engines.scenes import body, world
from tests.imagination.scenes import TABLE_HEIGHT_M, on_table

BOX_Z = TABLE_HEIGHT_M + 0.05
BOX = body("box", (-0.5, 0.0, BOX_Z), (0.2, 0.1, 0.1), "dynamic", 1.0)
ASIDE = Plan(steps=(Move(thing="box", by=(0.1, 0.0, 0.0)),))
OVER_THE_EDGE = Plan(steps=(Move(thing="box", by=(0.7, 0.0, 0.0)),))
NEAR_THE_EDGE = Plan(
    steps=(Move(thing="box", by=(0.45, 0.0, 0.0)),), uncertainty=(Uncertainty(thing="box", position_m=0.05),)
)
"""The box falls in about one of five samples."""


@pytest.fixture
def table() -> Iterator[Simulation]:
    with on_table(BOX) as sim:
        sim.step(0.5)
        yield sim


def box_x(sim: Simulation) -> float:
    return float(sim.state.poses[sim.state.ids.index("box"), 0])


def test_a_plan_that_succeeds_in_copies_is_done(table: Simulation) -> None:
    found = try_first(table, ASIDE)
    assert found
    assert (found.acted, found.reason) == (True, "")
    assert found.verdict.outcome is Outcome.SUCCEEDED
    assert found.result is not None
    assert box_x(table) == pytest.approx(-0.4, abs=1e-3)
    assert str(found).startswith("succeeded after ")


def test_a_plan_that_fails_in_copies_is_not_done_and_the_reason_is_named(table: Simulation) -> None:
    found = try_first(table, OVER_THE_EDGE)
    assert not found
    assert found.result is None
    assert box_x(table) == pytest.approx(-0.5, abs=1e-3)
    assert found.reason.startswith("the probability is 0.00, and at least 0.90 is required; box fell by 0.7")


def test_the_whole_interval_counts_unless_an_estimate_is_enough(table: Simulation) -> None:
    unsure = try_first(table, NEAR_THE_EDGE, at_least=0.5, samples=10)
    low, high = unsure.verdict.interval
    assert low < 0.5 < (unsure.verdict.probability or 0.0) < high
    assert not unsure.acted
    assert f"({low:.2f} to {high:.2f})" in unsure.reason
    estimated = try_first(table, NEAR_THE_EDGE, at_least=0.5, samples=10, certain=False)
    assert estimated.acted
    assert box_x(table) == pytest.approx(-0.05, abs=1e-3)  # without the uncertainty


def test_what_is_done_may_fail_and_that_is_no_success(table: Simulation) -> None:
    found = try_first(table, NEAR_THE_EDGE, at_least=0.0)
    assert found
    pushed = act(table, Plan(steps=(Push(thing="box", force=(60.0, 0.0, 0.0)), Wait(duration_s=1.0))))
    assert pushed.outcome is Outcome.FAILED
    assert pushed.cause is not None
    assert pushed.cause.kind is EventKind.FELL


def test_nothing_is_done_if_the_world_changes_meanwhile(table: Simulation) -> None:
    def disturb(verdict: object) -> None:
        table.engine.run(lambda engine: engine.apply(SetPoses({"box": Pose((-0.3, 0.0, BOX_Z))})), edits=True)

    found = try_first(table, ASIDE, on_verdict=disturb)
    assert not found.acted
    assert found.reason == "box has moved while the plan was tried"
    assert box_x(table) == pytest.approx(-0.3, abs=1e-3)


def test_a_canceled_trial_does_nothing(table: Simulation) -> None:
    found = try_first(table, ASIDE, cancel=lambda: True)
    assert (found.acted, found.reason) == (False, "canceled")
    assert (found.verdict.stopped, found.verdict.samples) == ("canceled", 0)
    assert box_x(table) == pytest.approx(-0.5, abs=1e-3)


def test_a_plan_that_does_not_fit_is_refused_before_it_is_tried(table: Simulation) -> None:
    with pytest.raises(PlanError, match="no body 'bax'"):
        try_first(table, PlanBuilder().push("bax", force=(1.0, 0.0, 0.0)).build())
    with pytest.raises(PlanError, match="no body 'bax'"):
        act(table, PlanBuilder().push("bax", force=(1.0, 0.0, 0.0)).build())


def test_time_stands_still_during_the_trial_of_a_playing_simulation() -> None:
    with Simulation(KnowledgeBase(), MujocoEngine(), primitive_shapes=True) as sim:
        sim.spawn(
            world(body("floor", (0.0, 0.0, -0.05), (9.0, 9.0, 0.1)), body("box", (0.0, 0.0, 0.05), (0.1, 0.1, 0.1)))
        )
        sim.play(speed=2.0)
        times: list[float] = []

        def note(verdict: object) -> None:
            times.append(sim.state.time_s)
            time.sleep(0.1)
            times.append(sim.state.time_s)

        start_s = time.monotonic()
        found = try_first(sim, Plan(steps=(Wait(duration_s=0.5),)), on_verdict=note)
        assert found
        assert times[0] == times[1]
        assert (sim.state.playing, sim.state.speed) == (True, 2.0)
        assert found.result is not None
        assert time.monotonic() - start_s > 0.9 * found.result.duration_s / 2.0  # in real time


def test_a_stopped_plan_stops_its_robot() -> None:
    with Simulation(KnowledgeBase(), MujocoEngine(), primitive_shapes=True, threaded=False) as sim:
        sim.spawn(world(body("floor", (0.0, 0.0, -0.05), (9.0, 9.0, 0.1))))
        robot = add_robot(sim, "mobile_manipulator")
        calls = iter([False] * 6 + [True] * 1000)
        result = act(sim, PlanBuilder().perform("go_to", x=3.0, y=0.0).build(), stop=lambda: next(calls))
        assert (result.outcome, result.is_interrupted) == (Outcome.UNKNOWN, True)
        sim.step(0.5)
        before = robot.base_pose()
        sim.step(0.5)
        assert robot.base_pose() == pytest.approx(before, abs=1e-3)
        assert 0.0 <= before[0] < 2.5


def test_samples_with_skills_are_the_same_in_other_processes_and_again() -> None:
    with Simulation(KnowledgeBase(), MujocoEngine(), primitive_shapes=True) as sim:
        box = body("box", (2.0, 2.0, 0.05), (0.1, 0.1, 0.1), "dynamic", 1.0)
        sim.spawn(world(body("floor", (0.0, 0.0, -0.05), (9.0, 9.0, 0.1)), box))
        add_robot(sim, "mobile_manipulator")
        plan = PlanBuilder().perform("go_to", x=0.3, y=0.2).perform("park").uncertain("box", mass=0.1).build()
        here = evaluate_plan(sim, plan, samples=2, fixed=True)
        there = evaluate_plan(sim, plan, samples=2, fixed=True, workers=2)
        assert here.succeeded == 2, here
        assert here.results == there.results
        assert [done.skill for done in here.results[0].skills] == ["go_to", "park"]
        assert here.replay(1).result == here.results[1]
        assert find_robot(sim).base_pose() == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)


def test_what_a_plan_did_is_one_step_of_the_history(table: Simulation) -> None:
    before_s = table.state.time_s
    assert act(table, msgspec.structs.replace(ASIDE, name="push it")).outcome is Outcome.SUCCEEDED
    assert box_x(table) == pytest.approx(-0.4, abs=1e-3)
    assert table.edits.history.undo == ("push it",)
    table.edits.undo()
    assert box_x(table) == pytest.approx(-0.5, abs=1e-3)
    assert table.state.time_s == before_s
    table.edits.redo()
    assert box_x(table) == pytest.approx(-0.4, abs=1e-3)
    try_first(table, OVER_THE_EDGE)
    assert table.edits.history.undo == ("push it",), "a plan that is only tried changes nothing"
