"""Messages as MoveIt and PyCRAM send them to a real robot, replayed against the simulated one.

The files in `sequences` hold the operations of rosbridge in their order, and what must come back. They were written
from the published sources and message definitions of these programs, which are not run here.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from mindstage.bridge import LocalNode, RosbridgeServer
from mindstage.robots import find_robot
from mindstage.ros import RosInterface, RosVersion
from mindstage.simulation import Simulation
from tests.bridge.raw_client import TIMEOUT_S, RawClient

FOLDER = Path(__file__).resolve().parent / "sequences"
SEQUENCES = sorted(FOLDER.glob("*.json"))


@pytest.fixture(params=SEQUENCES, ids=lambda path: path.stem)
def sequence(request: pytest.FixtureRequest) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(request.param.read_text(encoding="utf-8"))
    return found


@pytest.fixture
def client(robot_simulation: Simulation, sequence: dict[str, Any]) -> Iterator[RawClient]:
    robot_simulation.reset()
    robot_simulation.play()
    with (
        LocalNode() as node,
        RosbridgeServer(node, port=0) as server,
        RosInterface(robot_simulation, node, ros=RosVersion(sequence["ros"])),
        closing(RawClient(server.url)) as client,
    ):
        yield client
    robot_simulation.pause()


def value_at(message: Any, path: str) -> Any:
    for part in path.split("."):
        message = message[int(part)] if part.isdigit() else message[part]
    return message


def await_message(client: RawClient, fields: dict[str, Any], **operation: Any) -> None:
    """Waits for an operation whose message has certain fields."""
    last: Any = None
    deadline_s = time.monotonic() + TIMEOUT_S
    while time.monotonic() < deadline_s:
        last = client.receive(**operation)
        message = last.get("msg", last)
        try:
            found = {path: value_at(message, path) for path in fields}
        except (KeyError, IndexError):
            continue
        if found == fields:
            return
        if operation["op"] == "action_result" or str(last.get("topic", "")).endswith("/result"):
            break
    pytest.fail(f"expected {fields} in {operation}, the last was {last}")


def joint_positions(client: RawClient) -> dict[str, float]:
    client.received.clear()
    for _ in range(3):  # the first may be from before the end of the motion
        message = client.receive("publish", topic="/joint_states")["msg"]
    return dict(zip(message["name"], message["position"], strict=True))


def test_a_sequence_of_a_program_for_real_robots_is_carried_out(
    client: RawClient, robot_simulation: Simulation, sequence: dict[str, Any]
) -> None:
    for step in sequence["steps"]:
        if "send" in step:
            client.send_operation(**step["send"])
        elif "await" in step:
            await_message(client, step["fields"], op="publish", topic=step["await"])
        elif "await_op" in step:
            await_message(client, step["fields"], op=step["await_op"])
        elif "joints" in step:
            positions = joint_positions(client)
            found = {name: positions[name] for name in step["joints"]}
            assert found == pytest.approx(step["joints"], abs=step["within"])
        else:
            assert find_robot(robot_simulation).base_pose() == pytest.approx(step["base"], abs=step["within"])
