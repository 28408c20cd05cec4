"""Skills as behaviors of py_trees."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import pytest

from mindstage.errors import InvalidArgumentError
from mindstage.robots.robot import Robot
from mindstage.robots.skills import SkillOutcome
from mindstage.simulation import Simulation
from tests.conftest import missing
from tests.robots.rooms import robot_in


@pytest.fixture(scope="module")
def py_trees() -> Any:
    try:
        import py_trees
    except ImportError as error:
        missing(f"py_trees is not installed: {error}")
    return py_trees


@pytest.fixture
def robot() -> Iterator[Robot]:
    with robot_in() as robot:
        yield robot


def step(robot: Robot, duration_s: float) -> None:
    assert isinstance(robot.session, Simulation)
    robot.session.step(duration_s)


def test_a_sequence_of_skills_runs_over_ticks_and_succeeds(py_trees: Any, robot: Robot) -> None:
    from mindstage.robots.behaviors import SkillBehavior

    drive, park = SkillBehavior(robot, "go_to", x=0.5, y=0.0), SkillBehavior(robot, "park")
    tree = py_trees.composites.Sequence("move", memory=True, children=[drive, park])
    seen = []
    for _ in range(2000):
        tree.tick_once()
        seen.append((drive.status, park.status))
        if tree.status is not py_trees.common.Status.RUNNING:
            break
        step(robot, 0.05)
    running, success = py_trees.common.Status.RUNNING, py_trees.common.Status.SUCCESS
    assert seen[0][0] is running
    assert seen[-1] == (success, success)
    assert (running, py_trees.common.Status.INVALID) in seen
    assert drive.name == "go_to 0.5 0.0"
    assert drive.result is not None
    assert drive.result.outcome is SkillOutcome.SUCCEEDED
    assert robot.base_pose()[:2] == pytest.approx((0.5, 0.0), abs=0.03)


def test_a_skill_that_fails_is_a_failure_with_its_reason(py_trees: Any, robot: Robot) -> None:
    from mindstage.robots.behaviors import SkillBehavior, run_tree

    impossible, turn = SkillBehavior(robot, "pick", thing="unicorn"), SkillBehavior(robot, "park")
    tree = py_trees.composites.Selector("either", memory=True, children=[impossible, turn])
    assert run_tree(tree, robot) is py_trees.common.Status.SUCCESS
    assert impossible.status is py_trees.common.Status.FAILURE
    assert impossible.result is not None
    assert "unicorn" in impossible.result.reason
    assert impossible.feedback_message == impossible.result.reason
    assert turn.status is py_trees.common.Status.SUCCESS


def test_an_interrupted_skill_stops_the_robot_and_starts_anew_later(py_trees: Any, robot: Robot) -> None:
    from mindstage.robots.behaviors import SkillBehavior

    class Stop(py_trees.behaviour.Behaviour):  # type: ignore[misc, name-defined]
        is_pressed = False

        def update(self) -> Any:
            return py_trees.common.Status.SUCCESS if self.is_pressed else py_trees.common.Status.FAILURE

    stop, drive = Stop("stop"), SkillBehavior(robot, "go_to", x=2.0, y=0.0)
    tree = py_trees.composites.Selector("drive unless stopped", memory=False, children=[stop, drive])
    for _ in range(40):
        tree.tick_once()
        step(robot, 0.05)
    assert drive.status is py_trees.common.Status.RUNNING
    assert robot.base_pose()[0] > 0.1
    stop.is_pressed = True
    tree.tick_once()
    assert drive.status is py_trees.common.Status.INVALID
    assert (drive.result, drive.feedback_message) == (None, "interrupted")
    step(robot, 0.5)
    stopped = robot.base_pose()
    step(robot, 0.5)
    assert robot.base_pose() == pytest.approx(stopped, abs=1e-3)
    assert stopped[0] < 1.9
    stop.is_pressed = False
    for _ in range(2000):
        tree.tick_once()
        if tree.status is not py_trees.common.Status.RUNNING:
            break
        step(robot, 0.05)
    assert drive.status is py_trees.common.Status.SUCCESS
    assert robot.base_pose()[:2] == pytest.approx((2.0, 0.0), abs=0.03)


def test_a_tree_that_takes_too_long_is_interrupted(py_trees: Any, robot: Robot) -> None:
    from mindstage.robots.behaviors import SkillBehavior, run_tree

    drive = SkillBehavior(robot, "go_to", behavior_name="away", x=2.5, y=0.0)
    assert run_tree(drive, robot, timeout_s=1.0) is py_trees.common.Status.INVALID
    assert drive.name == "away"
    step(robot, 0.5)
    assert not robot.controller.is_active
    late = SkillBehavior(robot, "go_to", x=-2.5, y=0.0, deadline_s=0.5)
    assert run_tree(late, robot) is py_trees.common.Status.FAILURE
    assert "did not end within 0.5 s" in late.feedback_message


@pytest.mark.usefixtures("py_trees")
def test_wrong_arguments_are_refused_before_the_first_tick(robot: Robot) -> None:
    from mindstage.robots.behaviors import SkillBehavior, run_tree

    with pytest.raises(InvalidArgumentError, match="there is no skill 'juggle'"):
        SkillBehavior(robot, "juggle")
    with pytest.raises(InvalidArgumentError, match="thing is missing"):
        SkillBehavior(robot, "pick")
    with pytest.raises(InvalidArgumentError, match="no interval"):
        run_tree(SkillBehavior(robot, "park"), robot, tick_s=0.0)


def test_without_the_library_the_error_says_what_to_install() -> None:
    code = "import sys; sys.modules['py_trees'] = None; import mindstage.robots.behaviors"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=120)
    assert "RobotLibraryError: py_trees" in run.stderr
    assert "pip install 'mindstage[py_trees]'" in run.stderr
