"""Skills as actions over rosbridge, with their steps, results, refusals, cancellation and replacement."""

from __future__ import annotations

import json
from typing import Any

import pytest

from mindstage.robots import find_robot
from mindstage.robots.skills import skill_specs
from mindstage.simulation import Simulation
from tests.bridge.raw_client import eventually
from tests.ros.robot_client import RobotClient, SentGoal

PERFORM = "mindstage_msgs/Perform"


def perform(client: RobotClient, skill: str, action: str = "perform", **fields: Any) -> SentGoal:
    args = json.dumps(fields.pop("args", {}))
    return client.send_goal(f"/unreal/mindstage/{action}", PERFORM, {"skill": skill, "args": args, **fields})


def test_a_skill_is_performed_with_its_steps_as_feedback(robot_client: RobotClient) -> None:
    goal = perform(robot_client, "go_to", args={"x": -0.8, "y": 0.0, "yaw": 0.5})
    status, result = goal.wait(60.0)
    assert (status, result["success"], result["outcome"]) == ("SUCCEEDED", True, "succeeded")
    assert json.loads(result["args"])["x"] == -0.8
    assert result["duration_s"] > 0.5
    assert json.loads(result["result"])["skill"] == "go_to"
    assert "-0.8" in result["state"]
    assert any(each["step"] for each in goal.feedback)
    elapsed = [each["elapsed_s"] for each in goal.feedback]
    assert elapsed == sorted(elapsed)


def test_each_skill_has_an_action_of_its_own(robot_client: RobotClient) -> None:
    status, result = perform(robot_client, "", "skills/go_to", args={"x": -0.5, "y": 0.5}).wait(60.0)
    assert (status, result["skill"]) == ("SUCCEEDED", "go_to")
    status, result = perform(robot_client, "pick", "skills/go_to").wait()
    assert status == "ABORTED"
    assert "this action is for go_to" in result["refusal"]["text"]


@pytest.mark.parametrize(
    ("skill", "fields", "words"),
    [
        ("fly", {}, ["there is no skill 'fly'"]),
        ("go_to", {"args": {"height": 3}}, ["height"]),
        ("go_to", {"args": {}}, ["no destination"]),
        ("go_to", {"args": {"x": 0, "y": 0}, "robot": "r2d2"}, ["r2d2", "mobile_manipulator"]),
    ],
)  # fmt: skip
def test_a_skill_that_cannot_begin_is_refused(
    robot_client: RobotClient, skill: str, fields: dict[str, Any], words: list[str]
) -> None:
    status, result = perform(robot_client, skill, **fields).wait()
    assert (status, result["success"]) == ("ABORTED", False)
    assert all(word in result["refusal"]["text"] for word in words), result["refusal"]


def test_a_skill_that_fails_says_why_and_what_to_try(robot_client: RobotClient) -> None:
    status, result = perform(robot_client, "go_to", args={"x": 2.0, "y": 0.0}).wait(60.0)
    assert (status, result["outcome"], result["success"]) == ("ABORTED", "failed", False)
    assert result["reason"]
    assert result["suggestion"]
    assert result["refusal"]["text"] == ""


def test_a_canceled_skill_stops_the_robot(robot_client: RobotClient, robot_simulation: Simulation) -> None:
    robot = find_robot(robot_simulation)
    before = robot.base_pose()
    goal = perform(robot_client, "go_to", args={"x": -0.3, "y": -1.8})
    eventually(lambda: robot.base_pose()[1] < before[1] - 0.2)
    goal.cancel()
    status, result = goal.wait()
    assert (status, result["outcome"]) == ("CANCELED", "unknown")
    eventually(lambda: not robot.controller.goals)
    assert robot.base_pose()[1] > -1.7


def test_a_newer_skill_replaces_the_one_before(robot_client: RobotClient) -> None:
    first = perform(robot_client, "go_to", args={"x": -0.3, "y": -1.8})
    eventually(lambda: first.feedback)
    second = perform(robot_client, "go_to", args={"x": -0.6, "y": 0.5})
    status, result = first.wait()
    assert status == "CANCELED"
    assert "replaced" in result["reason"]
    assert second.wait(60.0)[0] == "SUCCEEDED"


def test_a_deadline_ends_a_skill(robot_client: RobotClient) -> None:
    status, result = perform(robot_client, "go_to", args={"x": -0.3, "y": -1.8}, deadline_s=0.5).wait(60.0)
    assert (status, result["outcome"]) == ("ABORTED", "failed")
    assert "0.5 s" in result["reason"]


def test_the_skills_are_listed_with_their_arguments(robot_client: RobotClient) -> None:
    found = robot_client.call("/unreal/mindstage/list_skills", "mindstage_msgs/ListSkills")
    assert found["skills"] == list(skill_specs())
    assert found["robots"] == ["mobile_manipulator"]
    specs = {each["name"]: each for each in json.loads(found["specs"])}
    assert specs["go_to"]["summary"]
    assert {each["name"]: each["type"] for each in specs["go_to"]["parameters"]}["x"] == "length"
