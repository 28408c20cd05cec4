"""Random calls of everything that a simulation offers: it keeps running, and other clients are not affected."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any

import pytest

from mindstage.bridge import LocalNode
from mindstage.ros import RosInterface
from mindstage.simulation import Simulation
from tests.bridge.raw_client import RawClient, eventually

MESSAGES = 2000
KEYS = (
    "id", "ids", "pose", "position", "x", "name", "models", "constraints", "args", "filter", "filters", "entity",
    "goal", "goal_id", "markers", "points",
)  # fmt: skip
VALUES = ("", "Mug", "x" * 500, "../..", "\0", 0, -1, 2**70, 1e308, 0.5, True, None)
EXCLUDED_WORDS = (
    "simulation",
    "world",
    "clear",
    "delete",
    "reset",
    "restore",
    "map",
    "play",
    "pause",
    "step",
    "simulate",
)
"""Words in the names of services that would affect the other client."""


def random_value(rng: random.Random, depth: int = 0) -> Any:
    kind = rng.randrange(4 if depth < 3 else 2)
    if kind == 2:
        return [random_value(rng, depth + 1) for _ in range(rng.randrange(4))]
    if kind == 3:
        return {rng.choice(KEYS): random_value(rng, depth + 1) for _ in range(rng.randrange(4))}
    return rng.choice(VALUES)


def test_random_calls_do_not_affect_other_clients(
    make_raw_client: Callable[[], RawClient],
    local_node: LocalNode,
    ros_interface: RosInterface,
    simulation: Simulation,
    caplog: pytest.LogCaptureFixture,
) -> None:
    rng = random.Random(5)
    here = local_node.graph_info()
    services = [each.name for each in here.services if not any(word in each.name for word in EXCLUDED_WORDS)]
    topics, actions = [each.name for each in here.topics], [each.name for each in here.actions]
    hostile, good = make_raw_client(), make_raw_client()
    for number in range(MESSAGES):
        args = {rng.choice(KEYS): random_value(rng) for _ in range(rng.randrange(4))}
        kind = rng.randrange(4)
        if kind < 2:
            hostile.send_operation(op="call_service", id=number, service=rng.choice(services), args=args)
        elif kind == 2:
            hostile.send_operation(op="publish", topic=rng.choice(topics), msg=args)
        else:
            hostile.send_operation(
                op="send_action_goal", id=number, action=rng.choice(actions), action_type="x", args=args
            )
        if number % 50 == 0:
            assert good.call_service("/unreal/get_model_pose", {"id": "Mug"})["values"]["success"] is True
            assert good.call_service("/unreal/highlight_models", {"id": "Mug", "color": 2})["values"]["success"] is True
    hostile.kill()
    eventually(lambda: local_node.broker.actions.providers.pending_count() == 0)
    assert not [each for each in caplog.records if each.levelname == "ERROR"], "an internal error was logged"
