"""The action that tries plans: feedback, cancellation, its deadline, refusals, over rosbridge and actionlib."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from mindstage.bridge import GoalStatus, LocalNode, RosbridgeClient
from mindstage.bridge.conversions import world_to_json
from mindstage.errors import ImaginationError
from mindstage.ros import RosInterface, plan_actions
from mindstage.simulation import Simulation
from tests.bridge.raw_client import TIMEOUT_S, RawClient

ACTION, TYPE = "/unreal/mindstage/evaluate_plan", "mindstage_msgs/EvaluatePlan"
UNCERTAIN = {"thing": "Mug", "position_m": 0.02}
EDGE = json.dumps(
    {"steps": [{"do": "move", "thing": "Mug", "to": {"position": [1.74, 0.2, 0.85], "quaternion": [1, 0, 0, 0]}},
               {"do": "wait", "duration_s": 0.5}], "uncertainty": [UNCERTAIN]}
)  # fmt: skip
"""The edge of the cupboard is at x = 1.7, and the mug is 8 cm wide: its center is 4 cm from the edge."""
OPEN_DOOR = "steps:\n  - do: open\n    thing: FridgeDoor\n"
ENDLESS = json.dumps({"steps": [{"do": "wait", "duration_s": 3000.0, "deadline_s": 4000.0}], "deadline_s": 4000.0})


@pytest.fixture
def send(ros_interface: RosInterface, client: RosbridgeClient) -> Iterator[Callable[..., Any]]:
    """Sends a goal from a client over a socket."""
    sent: list[Any] = []

    def send(plan: str, **goal: Any) -> Any:
        on_feedback = goal.pop("on_feedback", None)
        sent.append(client.send_goal(ACTION, TYPE, {"plan": plan, **goal}, on_feedback=on_feedback))
        return sent[-1]

    yield send
    for goal in sent:
        goal.cancel()


def test_a_plan_that_succeeds_has_one_sample_without_uncertainty(send: Any, simulation: Simulation) -> None:
    before = world_to_json(simulation.snapshot())
    outcome = send(OPEN_DOOR).wait(TIMEOUT_S)
    assert outcome.status is GoalStatus.SUCCEEDED
    result = outcome.values
    assert (result["success"], result["outcome"], result["samples"], result["probability"]) == (
        True,
        "succeeded",
        1,
        1.0,
    )
    assert result["failing_sample"] == -1
    assert json.loads(result["verdict"])["why"] == result["why"]
    assert world_to_json(simulation.snapshot()) == before


def test_feedback_is_sent_for_each_batch_and_the_result_names_what_broke_it(send: Any) -> None:
    feedback: list[Any] = []
    uncertainty = json.dumps([{"thing": "Mug", "position_m": 0.05}])
    goal = send(EDGE, samples=30, seed=4, uncertainty=uncertainty, on_feedback=feedback.append)
    outcome = goal.wait(TIMEOUT_S)
    result = outcome.values
    assert outcome.status is GoalStatus.SUCCEEDED
    assert result["outcome"] == "failed"
    assert (result["cause"], result["thing"]) in {("fell", "Mug"), ("tipped", "Mug")}
    assert f"sample {result['failing_sample']}: Mug" in result["why"]
    assert 0.0 <= result["lower"] < result["probability"] < result["upper"] < 0.9
    assert result["samples"] == result["succeeded"] + result["failed"] + result["unknown"]
    assert [each["done"] for each in feedback] == list(range(10, result["samples"] + 1, 10))
    last = feedback[-1]
    assert last["probability"] == pytest.approx(last["succeeded"] / last["done"])
    assert (last["lower"], last["upper"]) == (result["lower"], result["upper"])


def test_the_same_seed_gives_the_same_verdict(send: Any) -> None:
    one, other = (send(EDGE, samples=10, seed=7).wait(TIMEOUT_S).values["verdict"] for _ in range(2))
    assert one == other
    assert json.loads(one)["seed"] == 7


def test_a_check_in_the_goal_replaces_that_of_the_plan(send: Any) -> None:
    check = {"question": "where_is", "args": {"thing": "Mug", "relation": "on", "other": "Fridge"}}
    result = send(OPEN_DOOR, check=json.dumps(check)).wait(TIMEOUT_S).values
    assert (result["outcome"], result["cause"]) == ("failed", "check")


def test_a_canceled_goal_ends_with_what_is_known(send: Any) -> None:
    running = threading.Event()
    goal = send(EDGE, samples=100_000, on_feedback=lambda _: running.set())
    assert running.wait(TIMEOUT_S)
    goal.cancel()
    outcome = goal.wait(TIMEOUT_S)
    assert outcome.status is GoalStatus.CANCELED
    assert outcome.values["stopped"] == "canceled"
    assert 10 <= outcome.values["succeeded"] + outcome.values["failed"] < 100_000


def test_a_goal_ends_at_its_cancellation_even_if_a_sample_does_not(send: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    released, begun = _never_ending_trial(monkeypatch)
    goal = send(OPEN_DOOR)
    assert begun.wait(TIMEOUT_S)
    goal.cancel()
    outcome = goal.wait(TIMEOUT_S)
    released.set()
    assert outcome.status is GoalStatus.CANCELED
    assert (outcome.values["outcome"], outcome.values["why"]) == ("unknown", "it was canceled")


def test_a_plan_that_never_ends_is_unknown_at_its_budget(send: Any) -> None:
    result = send(ENDLESS, budget_s=0.3).wait(TIMEOUT_S).values
    assert (result["outcome"], result["unknown"], result["probability"]) == ("unknown", 1, -1.0)
    assert (result["lower"], result["upper"]) == (0.0, 1.0)


def test_a_goal_ends_at_its_deadline_even_if_a_sample_does_not(send: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    released, _ = _never_ending_trial(monkeypatch)
    monkeypatch.setattr(plan_actions, "_END_GRACE_S", 0.1)
    outcome = send(OPEN_DOOR, budget_s=0.1).wait(TIMEOUT_S)
    released.set()
    assert outcome.status is GoalStatus.SUCCEEDED
    assert outcome.values["outcome"] == "unknown"
    assert outcome.values["why"] == "the samples did not end within the budget of 0.1 s"


def _never_ending_trial(monkeypatch: pytest.MonkeyPatch) -> tuple[threading.Event, threading.Event]:
    released, begun = threading.Event(), threading.Event()

    def evaluate_plan(*_: Any, **__: Any) -> Any:
        begun.set()
        released.wait(TIMEOUT_S)
        raise ImaginationError("it was released")

    monkeypatch.setattr(plan_actions, "evaluate_plan", evaluate_plan)
    return released, begun


@pytest.mark.parametrize(
    ("goal", "place", "cause"),
    [
        ({"plan": OPEN_DOOR + "  - do: open\n    thing: Frdge\n"}, "the plan:5: steps[1].thing", "Frdge"),
        ({"plan": "steps:\n  - do: fly\n"}, "the plan:2: steps[0].do", "fly"),
        ({"plan": "/etc/passwd"}, "the plan:1", "an object with the key `steps`"),
        ({"plan": OPEN_DOOR, "check": "{"}, "check", "truncated"),
        ({"plan": OPEN_DOOR, "uncertainty": '[{"thing": "Mug", "weight": 1}]'}, "uncertainty", "weight"),
        ({"plan": OPEN_DOOR, "workers": 100_000}, "workers", "100,000 is more than"),
        ({"plan": OPEN_DOOR, "samples": 2_000_000}, "samples", "2,000,000 is more than"),
        ({"plan": OPEN_DOOR, "threshold": 2.0}, "threshold", "no probability"),
    ],
)  # fmt: skip
def test_a_bad_goal_is_refused_with_the_place_before_anything_runs(
    send: Any, goal: dict[str, Any], place: str, cause: str
) -> None:
    outcome = send(**goal).wait(TIMEOUT_S)
    assert outcome.status is GoalStatus.ABORTED
    assert (outcome.values["success"], outcome.values["outcome"]) == (False, "unknown")
    assert outcome.values["refusal"]["reason"] == place
    assert cause in outcome.values["refusal"]["text"]
    assert outcome.values["samples"] == 0


def test_a_goal_over_actionlib_gets_feedback_and_a_result(make_raw_client: Callable[[], RawClient]) -> None:
    client = make_raw_client()
    for topic in ("feedback", "result"):
        client.send_operation(op="subscribe", topic=f"{ACTION}/{topic}")
    client.send_operation(
        op="publish",
        topic=f"{ACTION}/goal",
        msg={"goal_id": {"id": "try"}, "goal": {"plan": EDGE, "samples": 10, "seed": 2}},
    )
    messages: dict[str, Any] = {}
    deadline_s = time.monotonic() + TIMEOUT_S
    while len(messages) < 2 and time.monotonic() < deadline_s:
        message = client.receive("publish")
        messages[message["topic"].rpartition("/")[2]] = message["msg"]
    assert messages["feedback"]["feedback"]["done"] == 10
    assert messages["result"]["status"]["status"] == 3
    assert messages["result"]["result"]["samples"] == 10


def test_several_goals_at_once_do_not_disturb_one_another(send: Any, local_node: LocalNode) -> None:
    goals = [send(EDGE, samples=10, seed=seed) for seed in (1, 2, 1)]
    verdicts = [goal.wait(TIMEOUT_S).values["verdict"] for goal in goals]
    assert verdicts[0] == verdicts[2] != verdicts[1]
