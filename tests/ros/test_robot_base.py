"""The base of a robot over rosbridge: velocities, odometry and navigation, as programs use those of a real one."""

from __future__ import annotations

from collections.abc import Callable
from math import atan2, cos, hypot, sin
from typing import Any

import pytest

from tests.bridge.raw_client import eventually
from tests.ros.robot_client import RobotClient, seconds

TWIST, STAMPED = "geometry_msgs/Twist", "geometry_msgs/TwistStamped"
MOVE_BASE, NAVIGATE = ("move_base", "move_base_msgs/MoveBase"), ("navigate_to_pose", "nav2_msgs/NavigateToPose")


def twist(x: float = 0.0, y: float = 0.0, turn: float = 0.0) -> dict[str, Any]:
    return {"linear": {"x": x, "y": y, "z": 0.0}, "angular": {"x": 0.0, "y": 0.0, "z": turn}}


def pose_stamped(x: float, y: float, yaw: float, frame: str = "map") -> dict[str, Any]:
    orientation = {"x": 0.0, "y": 0.0, "z": sin(yaw / 2), "w": cos(yaw / 2)}
    return {"header": {"frame_id": frame}, "pose": {"position": {"x": x, "y": y, "z": 0.0}, "orientation": orientation}}


def planar(pose: dict[str, Any]) -> tuple[float, float, float]:
    position, q = pose.get("position") or pose["translation"], pose.get("orientation") or pose["rotation"]
    return position["x"], position["y"], 2.0 * atan2(q["z"], q["w"])


def odometry(client: RobotClient) -> tuple[float, float, float]:
    """The pose of the base relative to where it was added."""
    return planar(client.wait_for("odom", 2)["pose"]["pose"])


def drive_until(client: RobotClient, message: dict[str, Any], done: Callable[[], bool], topic: str = "cmd_vel") -> None:
    """Sends a velocity again and again, as a teleoperation does."""

    def is_done() -> bool:
        client.publish(topic, STAMPED if "twist" in message else TWIST, message)
        return done()

    eventually(is_done)


@pytest.mark.parametrize(("topic", "type"), [("cmd_vel", TWIST), ("base_controller/cmd_vel", STAMPED)])
def test_velocities_drive_the_base_until_they_stop_coming(robot_client: RobotClient, topic: str, type: str) -> None:
    robot_client.subscribe("odom")
    message = twist(-0.3, 0.0, 0.4)
    message = {"twist": message} if type == STAMPED else message
    drive_until(robot_client, message, lambda: odometry(robot_client)[2] > 0.4, topic)
    last_s = robot_client.now()
    velocities = [each["twist"]["twist"] for each in robot_client.messages["/odom"]]
    assert any(each["linear"]["x"] == pytest.approx(-0.3, abs=0.02) for each in velocities)
    assert any(each["angular"]["z"] == pytest.approx(0.4, abs=0.02) for each in velocities)
    x, y, _ = odometry(robot_client)
    assert x < -0.1
    assert y < 0.0  # backward on an arc to the left
    eventually(lambda: robot_client.now() > last_s + 1.2)
    held = odometry(robot_client)
    robot_client.wait_for("odom", 10)
    assert odometry(robot_client) == pytest.approx(held, abs=1e-3)
    stopped = [m for m in robot_client.messages["/odom"] if seconds(m["header"]["stamp"]) > last_s + 1.0]
    assert stopped
    assert all(abs(each["twist"]["twist"]["linear"]["x"]) < 0.01 for each in stopped)


def test_a_velocity_above_the_limit_is_reduced_to_it(robot_client: RobotClient) -> None:
    drive_until(robot_client, twist(-3.0), lambda: odometry(robot_client)[0] < -0.9)
    speeds = [-each["twist"]["twist"]["linear"]["x"] for each in robot_client.messages["/odom"]]
    assert max(speeds) == pytest.approx(0.7, abs=0.03)


def test_odometry_is_the_transform_of_tf(robot_client: RobotClient) -> None:
    drive_until(robot_client, twist(-0.3, -0.2, 0.5), lambda: odometry(robot_client)[0] < -0.2)
    robot_client.wait_for("/tf", 60)  # it stands
    odom = robot_client.wait_for("odom", 2)
    assert (odom["header"]["frame_id"], odom["child_frame_id"]) == ("odom", "base_footprint")
    transforms = {each["child_frame_id"]: each for each in robot_client.wait_for("/tf", 2)["transforms"]}
    base = transforms["base_footprint"]
    assert base["header"]["frame_id"] == "odom"
    assert planar(base["transform"]) == pytest.approx(planar(odom["pose"]["pose"]), abs=1e-4)


def test_a_robot_that_drives_into_a_wall_stops_and_says_so(robot_client: RobotClient) -> None:
    diagnostics = robot_client.subscribe("/mindstage/diagnostics", "diagnostic_msgs/DiagnosticArray")
    drive_until(robot_client, twist(0.4, -0.1), lambda: "blocked by" in str(diagnostics))
    (status,) = (each for array in diagnostics for each in array["status"] if "blocked by" in each["message"])
    assert status["name"] == "mindstage: cmd_vel"
    assert "Cupboard" in str(diagnostics) or "Drawer" in str(diagnostics) or "Fridge" in str(diagnostics)
    robot_client.wait_for("odom", 50)
    held = odometry(robot_client)
    robot_client.wait_for("odom", 15)
    assert odometry(robot_client) == pytest.approx(held, abs=2e-3)


@pytest.mark.parametrize("action", [MOVE_BASE, NAVIGATE], ids=lambda action: action[0])
def test_a_goal_of_navigation_is_reached(robot_client: RobotClient, action: tuple[str, str]) -> None:
    pose = pose_stamped(0.2, -1.0, 1.0)
    goal = robot_client.send_goal(*action, {"target_pose" if action is MOVE_BASE else "pose": pose})
    status, _ = goal.wait(40.0)
    assert status == "SUCCEEDED"
    x, y, yaw = odometry(robot_client)
    assert (x - 0.3, y + 0.5, yaw) == pytest.approx((0.2, -1.0, 1.0), abs=0.02)
    if action is NAVIGATE:
        left = [each["distance_remaining"] for each in goal.feedback]
        assert left[0] > 1.0 > 0.2 > left[-1]
        last = goal.feedback[-1]["current_pose"]
        assert last["header"]["frame_id"] == "map"
        assert hypot(last["pose"]["position"]["x"] - 0.2, last["pose"]["position"]["y"] + 1.0) < 0.2
    else:
        assert goal.feedback[-1]["base_position"]["header"]["frame_id"] == "map"


def test_a_goal_in_the_frame_of_the_robot_is_relative_to_it(robot_client: RobotClient) -> None:
    goal = robot_client.send_goal(*NAVIGATE, {"pose": pose_stamped(-0.3, 0.0, 0.5, "base_link")})
    assert goal.wait(40.0)[0] == "SUCCEEDED"
    assert odometry(robot_client) == pytest.approx((-0.3, 0.0, 0.5), abs=0.02)


def test_a_goal_inside_of_furniture_is_aborted_with_the_reason(robot_client: RobotClient) -> None:
    status, result = robot_client.send_goal(*NAVIGATE, {"pose": pose_stamped(2.0, 0.0, 0.0)}).wait(40.0)
    assert (status, result["error_code"]) == ("ABORTED", 208)
    assert "Cupboard" in result["error_msg"]
    assert odometry(robot_client) == pytest.approx((0.0, 0.0, 0.0), abs=2e-3)


def test_a_canceled_goal_of_navigation_stops_the_base(robot_client: RobotClient) -> None:
    goal = robot_client.send_goal(*NAVIGATE, {"pose": pose_stamped(-0.3, -1.8, 0.0)})
    eventually(lambda: odometry(robot_client)[1] < -0.2)
    goal.cancel()
    assert goal.wait()[0] == "CANCELED"
    robot_client.wait_for("odom", 30)
    held = odometry(robot_client)
    robot_client.wait_for("odom", 15)
    assert odometry(robot_client) == pytest.approx(held, abs=2e-3)
    assert held[1] > -1.5


def test_a_goal_on_the_topic_of_rviz_is_driven_to(robot_client: RobotClient) -> None:
    robot_client.publish("goal_pose", "geometry_msgs/PoseStamped", pose_stamped(-0.6, 0.5, 0.0))
    eventually(lambda: abs(odometry(robot_client)[0] + 0.3) < 0.02)
