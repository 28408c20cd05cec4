"""Robots perform skills in samples: what succeeds, how a failure is reported, and what is stopped."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from contextlib import ExitStack
from typing import Any

import pytest

from mindstage.engines.mujoco import MujocoEngine
from mindstage.errors import PlanError
from mindstage.imagination import (
    EventKind,
    Outcome,
    Perform,
    Plan,
    PlanBuilder,
    SampleResult,
    Uncertainty,
    evaluate_plan,
    load_plan,
    run_plan,
    validate_plan,
)
from mindstage.knowledge import KnowledgeBase
from mindstage.registry import Group, added
from mindstage.robots import add_robot, find_robot
from mindstage.robots.skill_declaration import ThingName, skill
from mindstage.robots.skill_task import SkillTask
from mindstage.scene import BodyId, Pose
from mindstage.scene.edits import Attach, Detach, SetPoses
from mindstage.simulation import Simulation, SimulationImage
from tests.engines.scenes import body, world

FLOOR = body("floor", (0.0, 0.0, -0.05), (10.0, 10.0, 0.1))
CUBE = body("cube", (2.0, 0.0, 0.03), (0.06, 0.06, 0.06), "dynamic", 0.2)
closed: list[str] = []
"""The skills whose generators were closed before their end."""


@skill(needs=())
def approach(task: SkillTask, thing: ThingName) -> Generator[float, None, None]:
    """Drives half a meter towards x; the real base moves.

    Args:
        thing: is not used.
    """
    task.assume("the way is free")
    with task.step("drive", "drive 0.5 m"):
        done = yield from task.robot.driving([(0.5, 0.0, 0.0)])  # type: ignore[attr-defined]
    if not done:
        raise task.failure(done.reason, "clear the way")


@skill(needs=())
def give_up(task: SkillTask, thing: ThingName) -> Generator[float, None, None]:
    """Fails after a while.

    Args:
        thing: what it is about.
    """
    yield 0.1
    raise task.failure(f"{thing} is glued to the floor", "try another thing")


@skill(needs=())
def doubt(task: SkillTask) -> Generator[float, None, None]:
    """Ends with an unknown outcome."""
    yield 0.1
    raise task.failure("nothing was seen", "look again", is_known=False)


@skill(needs=())
def dawdle(task: SkillTask) -> Generator[float, None, None]:
    """Never ends."""
    try:
        while True:
            yield 0.05
    except GeneratorExit:
        closed.append("dawdle")
        raise


@skill(needs=())
def lower(task: SkillTask, thing: ThingName) -> Generator[float, None, None]:
    """Carries a thing down from 0.5 m with the lift of the robot, and lets it go 2 cm above the floor.

    Args:
        thing: what is carried.
    """
    yield from carry_down(task, BodyId(thing), to_m=0.06)


@skill(needs=())
def drop(task: SkillTask, thing: ThingName) -> Generator[float, None, None]:
    """Lets a thing go at a height of half a meter.

    Args:
        thing: what is dropped.
    """
    yield from carry_down(task, BodyId(thing), to_m=0.45)


def carry_down(task: SkillTask, id: BodyId, *, to_m: float) -> Generator[float, None, None]:
    """Attaches a thing to the gripper, lowers it with the lift, and detaches it."""
    robot: Any = task.robot
    hand = robot.link_ids[robot.gripper().link]
    top = 0.5
    yield from robot.moving_to({"lift_joint": 0.9})
    x, y, _ = robot.link_pose(robot.gripper().link)[:3].tolist()
    task.session.engine.run(lambda engine: engine.apply(SetPoses({id: Pose((x, y + 1.0, top))})), edits=True)
    task.session.engine.run(lambda engine: engine.apply(Attach(hand, id)), edits=True)
    yield 0.05
    yield from robot.moving_to({"lift_joint": 0.9 - (top - to_m)})
    task.session.engine.run(lambda engine: engine.apply(Detach(id)), edits=True)
    yield 0.6


@pytest.fixture(autouse=True)
def fake_skills() -> Iterator[None]:
    """Skills of known behavior beside the real ones; the robot is real."""
    closed.clear()
    with ExitStack() as stack:
        for each in (approach, give_up, doubt, dawdle, lower, drop):
            stack.enter_context(added(Group.SKILLS, each.spec.name, each))
        yield


@pytest.fixture(scope="module")
def room() -> Iterator[SimulationImage]:
    with Simulation(KnowledgeBase(), MujocoEngine(), primitive_shapes=True, threaded=False) as sim:
        sim.spawn(world(FLOOR, CUBE))
        add_robot(sim, "mobile_manipulator")
        sim.step(0.5)
        yield SimulationImage.capture(sim)


def perform(room: SimulationImage, skill: str, *, deadline_s: float = 30.0, **args: str | float) -> SampleResult:
    with room.restore() as sim:
        return run_plan(sim, Plan(steps=(Perform(skill=skill, args=args, deadline_s=deadline_s),)))


def test_a_skill_moves_the_robot_of_the_sample(room: SimulationImage) -> None:
    with room.restore() as sim:
        result = run_plan(sim, PlanBuilder().perform("approach", thing="cube").build())
        assert find_robot(sim).base_pose()[0] == pytest.approx(0.5, abs=0.02)
    assert result.outcome is Outcome.SUCCEEDED, result.cause
    (done,) = result.skills
    assert (done.skill, done.args, done.assumptions) == ("approach", {"thing": "cube"}, ("the way is free",))
    assert done.duration_s == pytest.approx(result.duration_s, abs=2.0)
    with room.restore() as again:
        assert find_robot(again).base_pose()[0] == pytest.approx(0.0, abs=1e-3)


def test_a_failed_skill_fails_the_sample_with_reason_and_state(room: SimulationImage) -> None:
    result = perform(room, "give_up", thing="cube")
    assert result.outcome is Outcome.FAILED
    assert result.cause is not None
    assert (result.cause.kind, result.cause.thing, result.cause.step) == (EventKind.SKILL, "cube", 0)
    assert result.cause.text.startswith("mobile_manipulator failed to give_up cube: cube is glued to the floor")
    assert "the robot stands at" in result.cause.text


def test_a_skill_of_which_the_effect_is_unknown_makes_the_sample_unknown(room: SimulationImage) -> None:
    result = perform(room, "doubt")
    assert (result.outcome, result.is_interrupted) == (Outcome.UNKNOWN, False)
    assert result.cause is not None
    assert "may not have done doubt: nothing was seen" in result.cause.text


def test_a_skill_that_is_late_fails_and_is_closed(room: SimulationImage) -> None:
    result = perform(room, "dawdle", deadline_s=0.5)
    assert result.outcome is Outcome.FAILED
    assert result.duration_s <= 0.5 + 1e-6
    assert result.cause is not None
    assert "did not end within" in result.cause.text
    assert closed == ["dawdle"]


def test_a_sample_that_is_stopped_closes_the_skill(room: SimulationImage) -> None:
    calls = iter([False] * 5 + [True] * 100)
    with room.restore() as sim:
        plan = PlanBuilder().perform("dawdle").build()
        result = run_plan(sim, plan, stop=lambda: next(calls))
    assert (result.outcome, result.is_interrupted) == (Outcome.UNKNOWN, True)
    assert closed == ["dawdle"]


def test_what_is_lowered_by_a_gripper_does_not_fall_but_what_is_dropped_does(room: SimulationImage) -> None:
    lowered = perform(room, "lower", thing="cube")
    assert lowered.outcome is Outcome.SUCCEEDED, lowered.cause
    assert lowered.end_poses["cube"].position[2] == pytest.approx(0.03, abs=0.005)
    dropped = perform(room, "drop", thing="cube")
    assert dropped.cause is not None
    assert (dropped.cause.kind, dropped.cause.thing) == (EventKind.FELL, "cube")


def test_the_links_of_a_robot_neither_fall_nor_tip(room: SimulationImage) -> None:
    result = perform(room, "approach", thing="cube")
    assert result.events == ()


def test_a_plan_has_time_for_its_skills() -> None:
    plan = PlanBuilder().perform("approach", thing="cube", deadline_s=60.0).wait(1.0).build()
    assert plan.time_limit_s == 60.0 + (1.0 + 10.0) + 30.0  # of the skill, of the wait with its margin, of the plan
    assert Plan(steps=()).time_limit_s == 30.0
    assert PlanBuilder().perform("dawdle").deadline(5.0).build().time_limit_s == 5.0


def test_a_verdict_states_what_skills_assumed(room: SimulationImage) -> None:
    plan = PlanBuilder().perform("approach", thing="cube").uncertain("cube", position_m=0.01).build()
    with room.restore() as sim:
        verdict = evaluate_plan(sim, plan, samples=2, fixed=True)
    assert verdict.succeeded == 2
    assert "the way is free" in verdict.assumptions
    with room.restore() as sim:
        failed = evaluate_plan(sim, PlanBuilder().perform("give_up", thing="cube").build())
    assert failed.outcome is Outcome.FAILED
    assert [(cause.kind, cause.thing) for cause in failed.causes] == [(EventKind.SKILL, "cube")]
    assert '"glued' not in failed.to_json()
    assert "glued to the floor" in failed.to_json()


@pytest.mark.parametrize(
    ("step", "place", "cause"),
    [
        ("skill: approch\n    args: {thing: cube}", "steps[0].skill", "no skill 'approch'; near: 'approach'"),
        ("skill: approach", "steps[0].args", "thing is missing"),
        ("skill: approach\n    args: {think: cube}", "steps[0].args", "no argument 'think'"),
        ("skill: approach\n    args: {thing: cub}", "steps[0].args.thing", "near: 'cube'"),
        ("skill: doubt\n    robot: r2d2", "steps[0].robot", "no robot 'r2d2'"),
    ],
)
def test_a_plan_that_no_robot_can_follow_is_refused_with_its_line(
    room: SimulationImage, step: str, place: str, cause: str
) -> None:
    file = load_plan(f"steps:\n  - do: perform\n    {step}\n", name="plan.yaml")
    with room.restore() as sim, pytest.raises(PlanError) as refused:
        validate_plan(file, sim)
    assert place in str(refused.value)
    assert cause in str(refused.value)
    assert "plan.yaml:" in str(refused.value)


def test_a_world_without_a_robot_refuses_skills() -> None:
    with Simulation(KnowledgeBase(), MujocoEngine(), primitive_shapes=True, threaded=False) as sim:
        sim.spawn(world(FLOOR, CUBE))
        with pytest.raises(PlanError, match="add one with `add_robot`"):
            validate_plan(PlanBuilder().perform("doubt").build(), sim)


def test_uncertainty_is_that_of_each_sample(room: SimulationImage) -> None:
    plan = Plan(
        steps=(Perform(skill="approach", args={"thing": "cube"}),),
        uncertainty=(Uncertainty(thing="cube", position_m=0.05),),
    )
    with room.restore() as sim:
        first = run_plan(sim, plan, index=0)
    with room.restore() as sim:
        second = run_plan(sim, plan, index=1)
    with room.restore() as sim:
        again = run_plan(sim, plan, index=1)
    assert first.end_poses["cube"] != second.end_poses["cube"]
    assert again == second
