"""Joining: a stage at somebody else's hub, in another process, is as good as one at our own; and it comes back."""

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
from tests.bridge.talking import TIMEOUT_S, eventually
from tests.ros.asking import pose_message, position_of
from tests.ros.test_actions import FOR_EVER, PREEMPTED, STEPS, STEPS_TYPE, Actionlib, stands_still

ROOT = Path(__file__).resolve().parents[2]


class Elsewhere:
    """A hub in a process of its own."""

    def __init__(self, port: int = 0) -> None:
        command = [sys.executable, "-m", "tests.ros.hub_process", str(port)]
        self.process = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        self.port = int(self.process.stdout.readline())
        self.url = f"ws://127.0.0.1:{self.port}"

    def end(self) -> None:
        """Without a word, as a machine that loses its power."""
        self.process.kill()
        self.process.communicate(timeout=TIMEOUT_S)


@pytest.fixture
def elsewhere() -> Iterator[Callable[..., Elsewhere]]:
    with ExitStack() as stack:

        def start(port: int = 0) -> Elsewhere:
            hub = Elsewhere(port)
            stack.callback(hub.end)
            return hub

        yield start


def call(client: RosbridgeClient, name: str, /, **args: Any) -> Any:
    return client.call_service(name, args, timeout_s=TIMEOUT_S)


def works(client: RosbridgeClient) -> bool:
    try:
        return bool(client.call_service("/unreal/get_model_pose", {"id": "Mug"}, timeout_s=1.0)["success"])
    except BridgeError:
        return False


def test_callers_at_another_hub_are_served(elsewhere: Callable[..., Elsewhere], stage: Simulation) -> None:
    hub = elsewhere()
    with (
        RosbridgeClient(hub.url) as joined,
        RosInterface(stage, joined.wait_connected(TIMEOUT_S)),
        RosbridgeClient(hub.url) as caller,
    ):
        caller.wait_connected(TIMEOUT_S)
        eventually(lambda: works(caller))
        assert call(caller, "/unreal/spawn_model", name="Cup", id="far", pose=pose_message(0, 9, 1))["success"]
        assert position_of(call(caller, "/unreal/get_model_pose", id="far")["pose"]) == (0, 9, 1)
        assert call(caller, "/unreal/get_model_pose", id="nobody")["success"] is False
        with pytest.raises(BridgeError, match="id: expected str, got int"):
            call(caller, "/unreal/get_model_pose", id=7)
        heard: list[Any] = []
        caller.subscribe("/tf", heard.append)
        eventually(lambda: heard)
        assert {each["child_frame_id"] for each in heard[-1]["transforms"]} == set(stage.state.ids)
        told: list[Any] = []
        goal = caller.send_goal(STEPS, STEPS_TYPE, {"steps": FOR_EVER}, on_feedback=told.append)
        eventually(lambda: len(told) >= 2)
        goal.cancel()
        assert goal.wait(TIMEOUT_S).status is GoalStatus.CANCELED
        actionlib = Actionlib(caller, STEPS, STEPS_TYPE)
        eventually(lambda: actionlib.heard["status"])
        actionlib.send("far", {"steps": FOR_EVER})
        eventually(lambda: actionlib.is_told_of("far"))
        actionlib.cancel(id="far")
        assert actionlib.ended("far")["status"]["status"] == PREEMPTED


def test_a_caller_that_vanished_there_leaves_no_goal_here(
    elsewhere: Callable[..., Elsewhere], stage: Simulation
) -> None:
    hub = elsewhere()
    with RosbridgeClient(hub.url) as joined, RosInterface(stage, joined.wait_connected(TIMEOUT_S)):
        told: list[Any] = []
        with RosbridgeClient(hub.url) as caller:
            eventually(lambda: works(caller.wait_connected(TIMEOUT_S)))
            caller.send_goal(STEPS, STEPS_TYPE, {"steps": FOR_EVER}, on_feedback=told.append)
            eventually(lambda: told)
        eventually(lambda: stands_still(stage))


def test_after_a_loss_everything_is_there_again(elsewhere: Callable[..., Elsewhere], stage: Simulation) -> None:
    hub = elsewhere()
    states: list[ConnectionState] = []
    with (
        RosbridgeClient(hub.url, on_state=states.append) as joined,
        RosInterface(stage, joined.wait_connected(TIMEOUT_S)),
    ):
        told: list[Any] = []
        with RosbridgeClient(hub.url) as caller:
            eventually(lambda: works(caller.wait_connected(TIMEOUT_S)))
            caller.send_goal(STEPS, STEPS_TYPE, {"steps": FOR_EVER}, on_feedback=told.append)
            eventually(lambda: told)
            hub.end()
            eventually(lambda: ConnectionState.LOST in states)
        eventually(lambda: stands_still(stage))
        elsewhere(hub.port)
        with RosbridgeClient(hub.url) as caller:
            eventually(lambda: works(caller.wait_connected(TIMEOUT_S)))
            heard: list[Any] = []
            caller.subscribe("/mindstage/health", heard.append)
            eventually(lambda: heard)
            assert caller.send_goal(STEPS, STEPS_TYPE, {"steps": 5}).wait(TIMEOUT_S).status is GoalStatus.SUCCEEDED
