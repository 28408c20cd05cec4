"""A client of a robot over rosbridge: roslibpy and the standard names of ROS, nothing of this project."""

from __future__ import annotations

import threading
import time
from collections import defaultdict
from typing import Any

import roslibpy

__all__ = ["RobotClient", "SentGoal", "duration", "point", "seconds"]

TIMEOUT_S = 20.0
TYPES = {
    "joint_states": "sensor_msgs/JointState",
    "odom": "nav_msgs/Odometry",
    "tf": "tf2_msgs/TFMessage",
    "tf_static": "tf2_msgs/TFMessage",
    "clock": "rosgraph_msgs/Clock",
    "robot_description": "std_msgs/String",
    "diagnostics": "diagnostic_msgs/DiagnosticArray",
}


def seconds(stamp: dict[str, int]) -> float:
    """A time in the format of ROS 1 or ROS 2 [s]."""
    return stamp.get("sec", stamp.get("secs", 0)) + stamp.get("nanosec", stamp.get("nsecs", 0)) * 1e-9


def duration(time_s: float) -> dict[str, int]:
    return {"sec": int(time_s), "nanosec": round((time_s - int(time_s)) * 1e9)}


def point(positions: list[float], time_s: float, velocities: list[float] | None = None) -> dict[str, Any]:
    return {
        "positions": positions,
        "velocities": [0.0] * len(positions) if velocities is None else velocities,
        "time_from_start": duration(time_s),
    }


class SentGoal:
    """A goal of a ROS 2 action."""

    def __init__(self, client: roslibpy.ActionClient, goal: dict[str, Any]) -> None:
        self.feedback: list[Any] = []
        self._result: Any = None
        self._done = threading.Event()
        self._client = client
        self._id = client.send_goal(roslibpy.Goal(goal), self._end, self.feedback.append, self._end)

    def _end(self, result: Any) -> None:
        self._result = result
        self._done.set()

    def cancel(self) -> None:
        self._client.cancel_goal(self._id)

    def wait(self, timeout_s: float = TIMEOUT_S) -> tuple[str, dict[str, Any]]:
        """The status and the values of the result."""
        assert self._done.wait(timeout_s), "the goal has no result"
        return self._result["status"].name, self._result["values"]


class RobotClient:
    """A connection, with the last messages of each topic that was subscribed to."""

    def __init__(self, port: int, namespace: str = "") -> None:
        self.ros = roslibpy.Ros("127.0.0.1", port, transport="asyncio")
        self.ros.run(TIMEOUT_S)
        self.namespace = namespace
        self.messages: dict[str, list[Any]] = defaultdict(list)
        self._topics: dict[str, roslibpy.Topic] = {}

    def close(self) -> None:
        self.ros.close()

    def subscribe(self, name: str, type: str = "") -> list[Any]:
        """All messages of a topic from now on."""
        full = name if name.startswith("/") else f"{self.namespace}/{name}"
        if full not in self._topics:
            topic = roslibpy.Topic(self.ros, full, type or TYPES[full.rpartition("/")[2]])
            self._topics[full] = topic
            topic.subscribe(self.messages[full].append)
        return self.messages[full]

    def publish(self, name: str, type: str, message: dict[str, Any]) -> None:
        full = name if name.startswith("/") else f"{self.namespace}/{name}"
        roslibpy.Topic(self.ros, full, type).publish(roslibpy.Message(message))

    def wait_for(self, name: str, count: int = 1, type: str = "") -> Any:
        """The last message of a topic, after at least so many new ones."""
        full = name if name.startswith("/") else f"{self.namespace}/{name}"
        before, until_s = len(self.messages[full]), time.monotonic() + TIMEOUT_S
        messages = self.subscribe(name, type)
        while len(messages) < before + count:
            assert time.monotonic() < until_s, f"no message on {name}"
            time.sleep(0.005)
        return messages[-1]

    def joints(self) -> dict[str, float]:
        """The current positions of the joints."""
        message = self.wait_for("joint_states", 2)
        return dict(zip(message["name"], message["position"], strict=True))

    def now(self) -> float:
        """Simulated time [s]."""
        return seconds(self.wait_for("/clock")["clock"])

    def send_goal(self, action: str, type: str, goal: dict[str, Any]) -> SentGoal:
        full = action if action.startswith("/") else f"{self.namespace}/{action}"
        return SentGoal(roslibpy.ActionClient(self.ros, full, type), goal)

    def follow(self, positions: dict[str, float], time_s: float, *, controller: str = "arm_controller",
               **goal: Any) -> SentGoal:  # fmt: skip
        """Sends a trajectory with one point."""
        trajectory = {"joint_names": list(positions), "points": [point(list(positions.values()), time_s)]}
        action = f"{controller}/follow_joint_trajectory"
        return self.send_goal(action, "control_msgs/FollowJointTrajectory", {"trajectory": trajectory, **goal})

    def call(self, name: str, type: str, /, **args: Any) -> dict[str, Any]:
        full = name if name.startswith("/") else f"{self.namespace}/{name}"
        service = roslibpy.Service(self.ros, full, type)
        return dict(service.call(roslibpy.ServiceRequest(args), timeout=TIMEOUT_S))
