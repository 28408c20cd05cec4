"""Messages that mean harm, under the names of everything a stage offers: it stays up, and nobody else notices."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any

import pytest

from mindstage.bridge import LocalNode
from mindstage.ros import RosInterface
from mindstage.simulation import Simulation
from tests.bridge.talking import RawClient, eventually

MESSAGES = 2000
KEYS = (
    "id", "ids", "pose", "position", "x", "name", "models", "constraints", "args", "filter", "filters", "entity",
    "goal", "goal_id", "markers", "points",
)  # fmt: skip
VALUES = ("", "Mug", "x" * 500, "../..", "\0", 0, -1, 2**70, 1e308, 0.5, True, None)
LEFT_ALONE = ("simulation", "world", "clear", "delete", "reset", "restore", "map", "play", "pause", "step", "simulate")
"""Who may call these ends what the others look at; that is no harm but what they are for."""


def anything(dice: random.Random, depth: int = 0) -> Any:
    kind = dice.randrange(4 if depth < 3 else 2)
    if kind == 2:
        return [anything(dice, depth + 1) for _ in range(dice.randrange(4))]
    if kind == 3:
        return {dice.choice(KEYS): anything(dice, depth + 1) for _ in range(dice.randrange(4))}
    return dice.choice(VALUES)


def test_whatever_is_said_to_a_stage_it_stays_up_and_others_do_not_notice(
    talker: Callable[[], RawClient],
    hub: LocalNode,
    face: RosInterface,
    stage: Simulation,
    caplog: pytest.LogCaptureFixture,
) -> None:
    dice = random.Random(5)
    here = hub.graph_info()
    services = [each.name for each in here.services if not any(word in each.name for word in LEFT_ALONE)]
    topics, actions = [each.name for each in here.topics], [each.name for each in here.actions]
    hostile, good = talker(), talker()
    for number in range(MESSAGES):
        args = {dice.choice(KEYS): anything(dice) for _ in range(dice.randrange(4))}
        kind = dice.randrange(4)
        if kind < 2:
            hostile.send_operation(op="call_service", id=number, service=dice.choice(services), args=args)
        elif kind == 2:
            hostile.send_operation(op="publish", topic=dice.choice(topics), msg=args)
        else:
            hostile.send_operation(
                op="send_action_goal", id=number, action=dice.choice(actions), action_type="x", args=args
            )
        if number % 50 == 0:
            assert good.call_service("/unreal/get_model_pose", {"id": "Mug"})["values"]["success"] is True
            assert good.call_service("/unreal/highlight_models", {"id": "Mug", "color": 2})["values"]["success"] is True
    hostile.kill()
    eventually(lambda: hub.broker.actions.providers.pending_count() == 0)
    assert not [each for each in caplog.records if each.levelname == "ERROR"], "a defect, however harmless"
