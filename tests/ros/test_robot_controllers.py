"""Controllers of a robot over rosbridge, as roslibpy uses those of a real one."""

from __future__ import annotations

import time
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from mindstage.robots.control import MotionGoal
from mindstage.simulation import Simulation
from tests.bridge.raw_client import eventually
from tests.ros.robot_client import RobotClient, duration, point, seconds

TYPE = "control_msgs/FollowJointTrajectory"
HOME: dict[str, float] = {}


def moved(client: RobotClient, **changes: float) -> dict[str, float]:
    """Positions that differ from the current ones."""
    now = client.joints()
    return {name: now[name] + change for name, change in changes.items()}


def off(client: RobotClient, target: dict[str, float]) -> float:
    """The largest distance from a target [m or rad]."""
    now = client.joints()
    return max(abs(now[name] - value) for name, value in target.items())


def track(client: RobotClient, joint: str) -> list[tuple[float, float]]:
    """Times and positions of a joint in all messages so far."""
    messages = list(client.subscribe("joint_states"))
    return [(seconds(each["header"]["stamp"]), each["position"][each["name"].index(joint)]) for each in messages]


def speeds(client: RobotClient, joint: str) -> list[tuple[float, float]]:
    """Times and speeds of a joint in all messages so far [s], [rad/s]."""
    messages = list(client.subscribe("joint_states"))
    return [(seconds(each["header"]["stamp"]), abs(each["velocity"][each["name"].index(joint)])) for each in messages]


# -- trajectories ------------------------------------------------------------------------------------------------------


def test_a_trajectory_is_reached_within_a_fiftieth_of_a_radian(robot_client: RobotClient) -> None:
    target = moved(robot_client, lift_joint=0.05, elbow_joint=-0.4, shoulder_pitch_joint=-0.3)
    goal = robot_client.follow(target, 0.8)
    status, result = goal.wait()
    assert (status, result["error_code"], result["error_string"]) == ("SUCCEEDED", 0, "")
    assert off(robot_client, target) < 0.02
    last = goal.feedback[-1]
    assert last["joint_names"] == list(target)
    assert last["error"]["positions"] == pytest.approx(
        np.subtract(last["desired"]["positions"], last["actual"]["positions"])
    )
    times = [seconds(each["desired"]["time_from_start"]) for each in goal.feedback]
    assert times == sorted(times)
    assert 0.0 <= times[0] < 0.3
    assert 0.6 < times[-1] < 1.2


def test_a_canceled_trajectory_stands_still_a_fifth_of_a_second_after_the_cancel_is_received(
    robot_client: RobotClient, robot_simulation: Simulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    received_s: list[float] = []
    cancel = MotionGoal.cancel

    def record(motion: MotionGoal) -> None:  # called by the thread that receives the request
        received_s.append(robot_simulation.state.time_s)
        cancel(motion)

    monkeypatch.setattr(MotionGoal, "cancel", record)
    joint = "elbow_joint"
    goal = robot_client.follow(moved(robot_client, **{joint: -1.5}), 3.0)
    eventually(lambda: len(goal.feedback) >= 18)
    robot_simulation.play(speed=0.2)  # more states per simulated second
    robot_client.wait_for("joint_states", 3)
    goal.cancel()
    assert goal.wait()[0] == "CANCELED"
    eventually(lambda: speeds(robot_client, joint)[-1][0] > received_s[0] + 0.4)
    before = [speed for time_s, speed in speeds(robot_client, joint) if time_s <= received_s[0]]
    after = [(time_s - received_s[0], speed) for time_s, speed in speeds(robot_client, joint) if time_s > received_s[0]]
    assert before[-1] > 0.2, "it was moving"
    stands_s = next(time_s for number, (time_s, _) in enumerate(after) if max(v for _, v in after[number:]) < 0.01)
    print(f"stands still {stands_s:.3f} s of simulated time after the cancel was received")
    assert stands_s <= 0.2
    robot_simulation.play()
    held = robot_client.joints()[joint]
    robot_client.wait_for("joint_states", 12)
    assert robot_client.joints()[joint] == pytest.approx(held, abs=2e-3)


def test_a_newer_goal_replaces_one_for_the_same_joints_only(robot_client: RobotClient) -> None:
    first = robot_client.follow(moved(robot_client, elbow_joint=-0.8), 3.0)
    head = robot_client.follow(moved(robot_client, head_pan_joint=0.2), 0.8, controller="head_controller")
    eventually(lambda: len(first.feedback) >= 3)
    target = moved(robot_client, elbow_joint=-0.1)
    second = robot_client.follow(target, 0.6)
    assert first.wait()[0] == "CANCELED"
    assert head.wait()[0] == second.wait()[0] == "SUCCEEDED"
    assert off(robot_client, target) < 0.02


@pytest.mark.parametrize(
    ("change", "code", "words"),
    [
        ({"names": ["wheel_joint"]}, -2, ["wheel_joint", "arm_controller", "elbow_joint"]),
        ({"positions": [9.0]}, -1, ["elbow_joint = 9 rad", "limit"]),
        ({"time_s": 0.01}, -1, ["elbow_joint", "rad/s", "velocity limit"]),
        ({"points": []}, -1, ["no points"]),
        ({"stamp": duration(0.001)}, -3, ["ago"]),
        ({"points": "backward"}, -1, ["time of point 2"]),
    ],
)  # fmt: skip
def test_a_bad_trajectory_is_refused_with_its_reason_and_moves_nothing(
    robot_client: RobotClient, change: dict[str, Any], code: int, words: list[str]
) -> None:
    eventually(lambda: robot_client.now() > 0.6)
    before = robot_client.joints()
    near = before["elbow_joint"] - 0.4
    points: Any = [point(change.get("positions", [near]), change.get("time_s", 0.5))]
    if change.get("points") == "backward":
        points = [point([near], 0.5), point([near], 0.4)]
    elif "points" in change:
        points = change["points"]
    header = {"stamp": change.get("stamp", duration(0.0)), "frame_id": ""}
    trajectory = {"header": header, "joint_names": change.get("names", ["elbow_joint"]), "points": points}
    status, result = robot_client.send_goal(
        "arm_controller/follow_joint_trajectory", TYPE, {"trajectory": trajectory}
    ).wait()
    assert status == "ABORTED"
    assert result["error_code"] == code
    assert all(word in result["error_string"] for word in words), result["error_string"]
    assert robot_client.joints() == pytest.approx(before, abs=2e-3)


def test_tolerances_that_are_not_kept_abort_the_goal(robot_client: RobotClient) -> None:
    target = moved(robot_client, elbow_joint=-0.9)
    path = robot_client.follow(target, 0.8, path_tolerance=[{"name": "elbow_joint", "position": 1e-7}])
    status, result = path.wait()
    assert (status, result["error_code"]) == ("ABORTED", -4)
    assert "elbow_joint" in result["error_string"]
    target = moved(robot_client, elbow_joint=-0.2)
    tight = [{"name": "elbow_joint", "position": 1e-12}]
    end = robot_client.follow(target, 0.5, goal_tolerance=tight, goal_time_tolerance=duration(0.2))
    status, result = end.wait()
    assert (status, result["error_code"]) == ("ABORTED", -5)
    assert "elbow_joint" in result["error_string"]


def test_a_reset_of_the_world_ends_a_goal_with_the_reason(
    robot_client: RobotClient, robot_simulation: Simulation
) -> None:
    goal = robot_client.follow(moved(robot_client, elbow_joint=-0.8), 3.0)
    eventually(lambda: len(goal.feedback) >= 3)
    robot_simulation.reset()
    status, result = goal.wait()
    assert status == "ABORTED"
    assert "reset" in result["error_string"]
    again = moved(robot_client, elbow_joint=-0.1)
    assert robot_client.follow(again, 0.5).wait()[0] == "SUCCEEDED"


@pytest.mark.parametrize("clock", ["simulated", "wall"])
def test_a_trajectory_with_a_later_start_waits_for_it(robot_client: RobotClient, clock: str) -> None:
    before = robot_client.joints()["elbow_joint"]
    start_s = robot_client.now() + 0.6
    trajectory = {
        "header": {"stamp": duration(start_s if clock == "simulated" else time.time() + 0.6), "frame_id": ""},
        "joint_names": ["elbow_joint"],
        "points": [point([before - 0.3], 0.5)],
    }
    goal = robot_client.send_goal("arm_controller/follow_joint_trajectory", TYPE, {"trajectory": trajectory})
    assert goal.wait()[0] == "SUCCEEDED"
    positions = track(robot_client, "elbow_joint")
    assert all(abs(value - before) < 2e-3 for time_s, value in positions if time_s < start_s - 0.1)
    assert any(abs(value - before) > 0.02 for time_s, value in positions if start_s < time_s < start_s + 0.5)


def test_a_trajectory_that_has_begun_is_joined(robot_client: RobotClient) -> None:
    now = robot_client.joints()["elbow_joint"]
    eventually(lambda: robot_client.now() > 0.5)
    trajectory = {
        "header": {"stamp": duration(robot_client.now() - 0.4), "frame_id": ""},
        "joint_names": ["elbow_joint"],
        "points": [point([now - 3.0], 0.1), point([now - 0.2], 1.0)],  # the first point is over, and would be refused
    }
    goal = robot_client.send_goal("arm_controller/follow_joint_trajectory", TYPE, {"trajectory": trajectory})
    assert goal.wait()[0] == "SUCCEEDED"
    assert off(robot_client, {"elbow_joint": now - 0.2}) < 0.02


@pytest.mark.parametrize("topic", ["command", "joint_trajectory"])
def test_a_trajectory_on_the_topic_of_a_controller_is_followed_and_an_empty_one_stops_it(
    robot_client: RobotClient, topic: str
) -> None:
    name, type = f"arm_controller/{topic}", "trajectory_msgs/JointTrajectory"
    target = moved(robot_client, elbow_joint=-0.2)
    robot_client.publish(name, type, {"joint_names": list(target), "points": [point(list(target.values()), 0.5)]})
    eventually(lambda: off(robot_client, target) < 0.01)
    far = moved(robot_client, elbow_joint=-1.0)
    robot_client.publish(name, type, {"joint_names": list(far), "points": [point(list(far.values()), 3.0)]})
    eventually(lambda: off(robot_client, target) > 0.05)
    robot_client.publish(name, type, {"joint_names": [], "points": []})
    robot_client.wait_for("joint_states", 12)
    held = robot_client.joints()["elbow_joint"]
    robot_client.wait_for("joint_states", 12)
    assert robot_client.joints()["elbow_joint"] == pytest.approx(held, abs=2e-3)
    assert off(robot_client, far) > 0.3


def test_a_trajectory_on_a_topic_that_is_refused_is_reported(robot_client: RobotClient) -> None:
    diagnostics = robot_client.subscribe("/mindstage/diagnostics", "diagnostic_msgs/DiagnosticArray")
    robot_client.publish(
        "arm_controller/command",
        "trajectory_msgs/JointTrajectory",
        {"joint_names": ["x"], "points": [point([0.0], 1.0)]},
    )
    eventually(lambda: any("arm_controller" in str(each) and "'message'" in str(each) for each in diagnostics))


def test_the_state_of_a_controller_has_its_error(robot_client: RobotClient) -> None:
    goal = robot_client.follow(moved(robot_client, elbow_joint=-0.5), 1.0)
    eventually(lambda: len(goal.feedback) >= 3)
    for topic in ("state", "controller_state"):
        name = f"arm_controller/{topic}"
        message = robot_client.wait_for(name, type="control_msgs/JointTrajectoryControllerState")
        reference, feedback = message["reference"]["positions"], message["feedback"]["positions"]
        assert len(reference) == len(feedback) == len(message["joint_names"]) == 8
        assert message["error"]["positions"] == pytest.approx(np.subtract(reference, feedback))
        assert message["feedback"]["velocities"][message["joint_names"].index("elbow_joint")] < -0.05
    goal.cancel()
    goal.wait()


# -- gripper and head --------------------------------------------------------------------------------------------------


def test_a_gripper_closes_and_opens(robot_client: RobotClient) -> None:
    type = "control_msgs/GripperCommand"
    for name, opening in (("gripper_cmd", 0.02), ("gripper_action", 0.09)):
        command = {"command": {"position": opening, "max_effort": 500.0}}
        goal = robot_client.send_goal(f"gripper_controller/{name}", type, command)
        status, result = goal.wait()
        assert (status, result["reached_goal"], result["stalled"]) == ("SUCCEEDED", True, False)
        assert result["position"] == pytest.approx(opening, abs=0.003)
        positions = [each["position"] for each in goal.feedback]
        assert all(0.0 < each < 0.13 for each in positions)
        assert max(abs(b - a) for a, b in pairwise(positions)) > 0.001, "the fingers move"
    command = {"command": {"position": 0.5, "max_effort": 0.0}}
    goal = robot_client.send_goal("gripper_controller/gripper_cmd", type, command)
    status, result = goal.wait()
    assert (status, result["reached_goal"]) == ("ABORTED", False)
    assert result["position"] == pytest.approx(0.09, abs=0.003)


def test_a_refused_actionlib_goal_is_never_active_and_does_not_say_successful(robot_client: RobotClient) -> None:
    def send(action: str, type: str, id: str, goal: dict[str, Any]) -> tuple[list[int], dict[str, Any]]:
        """The states of a goal in the topic of states and of its result, and the result."""
        states = robot_client.subscribe(f"{action}/status", "actionlib_msgs/GoalStatusArray")
        results = robot_client.subscribe(f"{action}/result", f"{type}ActionResult")
        robot_client.wait_for(f"{action}/status", 1, "actionlib_msgs/GoalStatusArray")
        robot_client.publish(f"{action}/goal", f"{type}ActionGoal", {"goal_id": {"id": id}, "goal": goal})
        eventually(lambda: any(each["status"]["goal_id"]["id"] == id for each in results))
        (result,) = (each for each in results if each["status"]["goal_id"]["id"] == id)
        seen = [one["status"] for each in states for one in each["status_list"] if one["goal_id"]["id"] == id]
        return [*seen, result["status"]["status"]], result["result"]

    too_wide = {"command": {"position": 0.5, "max_effort": 0.0}}
    states, _ = send("gripper_controller/gripper_cmd", "control_msgs/GripperCommand", "wide", too_wide)
    assert set(states) <= {0, 5}
    assert states[-1] == 5
    follow = "arm_controller/follow_joint_trajectory"
    states, result = send(follow, TYPE, "malformed", {"trajectory": {"joint_names": 7}})
    assert states == [5]
    assert result["error_code"] == -1
    assert "joint_names" in result["error_string"]


def test_a_head_points_its_camera_to_a_frame(robot_client: RobotClient) -> None:
    goal = {
        "target": {"header": {"frame_id": "Mug"}, "point": {"x": 0.0, "y": 0.0, "z": 0.0}},
        "pointing_frame": "head_camera_optical_frame",
        "pointing_axis": {"x": 0.0, "y": 0.0, "z": 1.0},
        "min_duration": duration(0.5),
    }
    status, _ = robot_client.send_goal("head_controller/point_head_action", "control_msgs/PointHead", goal).wait()
    assert status == "SUCCEEDED"
    behind = {**goal, "target": {"header": {"frame_id": "base_link"}, "point": {"x": -1.0, "y": 0.0, "z": 0.2}}}
    diagnostics = robot_client.subscribe("/mindstage/diagnostics", "diagnostic_msgs/DiagnosticArray")
    status, _ = robot_client.send_goal("head_controller/point_head_action", "control_msgs/PointHead", behind).wait()
    if status == "ABORTED":
        eventually(lambda: "rad are left" in str(diagnostics))


# -- the manager of controllers ----------------------------------------------------------------------------------------


def test_the_controllers_are_listed(robot_client: RobotClient) -> None:
    found = robot_client.call("controller_manager/list_controllers", "controller_manager_msgs/ListControllers")
    controllers = {each["name"]: each for each in found["controller"]}
    arm = controllers["arm_controller"]
    assert (arm["state"], arm["type"]) == ("active", "joint_trajectory_controller/JointTrajectoryController")
    assert "elbow_joint/position" in arm["claimed_interfaces"]
    assert controllers["gripper_controller"]["type"] == "position_controllers/GripperActionController"
    assert {"joint_state_broadcaster", "joint_trajectory_controller", "head_controller"} <= controllers.keys()
