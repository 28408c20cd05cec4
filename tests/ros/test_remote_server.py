"""A simulation at a rosbridge server in another process, and its reconnection."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from mindstage.bridge import ConnectionState, GoalStatus, RosbridgeClient
from mindstage.errors import BridgeError
from mindstage.ros import RosInterface
from mindstage.simulation import Simulation
from tests.bridge.raw_client import TIMEOUT_S, eventually
from tests.ros.ros_messages import pose_message, position_of
from tests.ros.test_actions import FOR_EVER, PREEMPTED, STEPS, STEPS_TYPE, Actionlib, stands_still

ROOT = Path(__file__).resolve().parents[2]


class Elsewhere:
    """A server in a process of its own."""

    def __init__(self, port: int = 0) -> None:
        command = [sys.executable, "-m", "tests.ros.server_process", str(port)]
        self.process = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        self.port = int(self.process.stdout.readline())
        self.url = f"ws://127.0.0.1:{self.port}"

    def end(self) -> None:
        """Kills the process."""
        self.process.kill()
        self.process.communicate(timeout=TIMEOUT_S)


@pytest.fixture
def elsewhere() -> Iterator[Callable[..., Elsewhere]]:
    with ExitStack() as stack:

        def start(port: int = 0) -> Elsewhere:
            local_node = Elsewhere(port)
            stack.callback(local_node.end)
            return local_node

        yield start


def call(client: RosbridgeClient, name: str, /, **args: Any) -> Any:
    return client.call_service(name, args, timeout_s=TIMEOUT_S)


def works(client: RosbridgeClient) -> bool:
    try:
        return bool(client.call_service("/unreal/get_model_pose", {"id": "Mug"}, timeout_s=1.0)["success"])
    except BridgeError:
        return False


def test_clients_of_another_server_are_served(elsewhere: Callable[..., Elsewhere], simulation: Simulation) -> None:
    local_node = elsewhere()
    with (
        RosbridgeClient(local_node.url) as joined,
        RosInterface(simulation, joined.wait_connected(TIMEOUT_S)),
        RosbridgeClient(local_node.url) as caller,
    ):
        caller.wait_connected(TIMEOUT_S)
        eventually(lambda: works(caller))
        assert call(caller, "/unreal/spawn_model", name="Cup", id="far", pose=pose_message(0, 9, 1))["success"]
        assert position_of(call(caller, "/unreal/get_model_pose", id="far")["pose"]) == (0, 9, 1)
        assert call(caller, "/unreal/get_model_pose", id="nobody")["success"] is False
        with pytest.raises(BridgeError, match="id: expected str, got int"):
            call(caller, "/unreal/get_model_pose", id=7)
        received: list[Any] = []
        caller.subscribe("/tf", received.append)
        moving = {"DrawerSlide", "FridgeHinge", "Mug"}
        eventually(lambda: received and {each["child_frame_id"] for each in received[-1]["transforms"]} == moving)
        feedback_values: list[Any] = []
        goal = caller.send_goal(STEPS, STEPS_TYPE, {"steps": FOR_EVER}, on_feedback=feedback_values.append)
        eventually(lambda: len(feedback_values) >= 2)
        goal.cancel()
        assert goal.wait(TIMEOUT_S).status is GoalStatus.CANCELED
        actionlib = Actionlib(caller, STEPS, STEPS_TYPE)
        eventually(lambda: actionlib.received["status"])
        actionlib.send("far", {"steps": FOR_EVER})
        eventually(lambda: actionlib.has_feedback("far"))
        actionlib.cancel(id="far")
        assert actionlib.ended("far")["status"]["status"] == PREEMPTED


def test_a_goal_is_canceled_when_its_client_leaves_the_other_server(
    elsewhere: Callable[..., Elsewhere], simulation: Simulation
) -> None:
    local_node = elsewhere()
    with RosbridgeClient(local_node.url) as joined, RosInterface(simulation, joined.wait_connected(TIMEOUT_S)):
        feedback_values: list[Any] = []
        with RosbridgeClient(local_node.url) as caller:
            eventually(lambda: works(caller.wait_connected(TIMEOUT_S)))
            caller.send_goal(STEPS, STEPS_TYPE, {"steps": FOR_EVER}, on_feedback=feedback_values.append)
            eventually(lambda: feedback_values)
        eventually(lambda: stands_still(simulation))


def test_everything_is_advertised_again_after_a_reconnection(
    elsewhere: Callable[..., Elsewhere], simulation: Simulation
) -> None:
    local_node = elsewhere()
    states: list[ConnectionState] = []
    with (
        RosbridgeClient(local_node.url, on_state=states.append) as joined,
        RosInterface(simulation, joined.wait_connected(TIMEOUT_S)),
    ):
        feedback_values: list[Any] = []
        with RosbridgeClient(local_node.url) as caller:
            eventually(lambda: works(caller.wait_connected(TIMEOUT_S)))
            caller.send_goal(STEPS, STEPS_TYPE, {"steps": FOR_EVER}, on_feedback=feedback_values.append)
            eventually(lambda: feedback_values)
            local_node.end()
            eventually(lambda: ConnectionState.LOST in states)
        eventually(lambda: stands_still(simulation))
        elsewhere(local_node.port)
        with RosbridgeClient(local_node.url) as caller:
            eventually(lambda: works(caller.wait_connected(TIMEOUT_S)))
            received: list[Any] = []
            caller.subscribe("/mindstage/health", received.append)
            eventually(lambda: received)
            assert caller.send_goal(STEPS, STEPS_TYPE, {"steps": 5}).wait(TIMEOUT_S).status is GoalStatus.SUCCEEDED
