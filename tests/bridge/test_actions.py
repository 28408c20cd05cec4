"""Actions: goals with feedback and results, which succeed, are canceled, or lose their client or provider."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from typing import Any

import pytest

from mindstage.access.limits import NODE_GOALS, BridgeLimits
from mindstage.bridge import GoalResult, GoalStatus, LocalNode, RosbridgeClient, RosbridgeServer, ServerGoalHandle
from mindstage.errors import ServiceCallError, ServiceNotFoundError, ServiceTimeoutError
from tests.bridge.raw_client import RawClient, eventually

RawClientFactory = Callable[..., RawClient]
Clients = Callable[..., RosbridgeClient]


@pytest.fixture(autouse=True)
def settling(local_node: LocalNode) -> None:
    async def settle(_: object) -> None:
        pass

    local_node.create_service("/settle", "std_srvs/Empty", settle)


def count_down(goal: ServerGoalHandle) -> GoalResult | dict[str, Any]:
    """Counts to the number in the goal; from 1000 on it waits for cancellation."""
    for number in range(goal.args["to"]):
        goal.feedback({"at": number})
        if number >= 5 and goal.wait_for_cancel(20.0):
            return goal.canceled({"reached": number})
    return {"reached": goal.args["to"]}


def test_a_goal_sends_feedback_and_a_result(local_node: LocalNode) -> None:
    local_node.create_action_server("/count", "x/Count", count_down)
    feedback_values: list[Any] = []
    goal = local_node.send_goal("/count", "x/Count", {"to": 3}, on_feedback=feedback_values.append)
    assert goal.wait(20.0) == GoalResult(GoalStatus.SUCCEEDED, {"reached": 3})
    assert feedback_values == [{"at": 0}, {"at": 1}, {"at": 2}]
    assert goal.done


def test_a_coroutine_function_can_handle_goals(local_node: LocalNode) -> None:
    async def hurry(goal: ServerGoalHandle) -> Any:
        for number in range(3):
            goal.feedback({"at": number})
            await asyncio.sleep(0)
        return goal.aborted({"reached": 3})

    local_node.create_action_server("/hurry", "x/Count", hurry)
    assert local_node.send_goal("/hurry", "x/Count").wait(20.0) == GoalResult(GoalStatus.ABORTED, {"reached": 3})


def test_a_goal_can_be_canceled(local_node: LocalNode) -> None:
    local_node.create_action_server("/count", "x/Count", count_down)
    feedback_values: list[Any] = []
    goal = local_node.send_goal("/count", "x/Count", {"to": 1000}, on_feedback=feedback_values.append)
    eventually(lambda: {"at": 5} in feedback_values)
    with pytest.raises(ServiceTimeoutError):
        goal.wait(0.01)
    goal.cancel()
    assert goal.wait(20.0) == GoalResult(GoalStatus.CANCELED, {"reached": 5})
    goal.cancel()


def test_each_failure_raises_its_error(local_node: LocalNode) -> None:
    def broken(_: ServerGoalHandle) -> None:
        raise ZeroDivisionError("by naught")

    local_node.create_action_server("/broken", "x/X", broken)
    with pytest.raises(ServiceCallError, match="by naught"):
        local_node.send_goal("/broken", "x/X").wait(20.0)
    with pytest.raises(ServiceNotFoundError, match="/nobody does not exist"):
        local_node.send_goal("/nobody", "x/X").wait(20.0)
    local_node.destroy_action_server("/broken")
    with pytest.raises(ServiceNotFoundError):
        local_node.send_goal("/broken", "x/X").wait(20.0)


def test_goals_run_concurrently_and_do_not_block_services(
    local_node: LocalNode, make_raw_client: RawClientFactory
) -> None:
    together = threading.Barrier(3)
    local_node.create_action_server("/meet", "x/Meet", lambda _: together.wait(20.0) and None)
    local_node.create_service("/quick", "x/X", lambda _: {"quick": True})
    client = make_raw_client()
    for id in range(2):
        client.send_operation(op="send_action_goal", id=id, action="/meet", action_type="x/Meet")
    assert client.call_service("/quick")["values"] == {"quick": True}
    together.wait(20.0)
    assert {client.receive("action_result")["id"] for _ in range(2)} == {0, 1}


def test_endless_goals_do_not_block_calls_and_their_number_is_limited(
    local_node: LocalNode, make_raw_client: RawClientFactory
) -> None:
    local_node.create_action_server("/count", "x/Count", count_down)
    local_node.create_service("/quick", "x/X", lambda _: {"quick": True})
    greedy, other = make_raw_client(), make_raw_client()
    for id in range(NODE_GOALS.count + 1):
        greedy.send_operation(op="send_action_goal", id=id, action="/count", action_type="x/Count", args={"to": 1000})
    refused = greedy.receive("action_result")
    assert refused["id"] == NODE_GOALS.count
    assert "goals are active already; wait" in refused["values"]
    assert other.call_service("/quick")["values"] == {"quick": True}
    greedy.kill()
    eventually(lambda: local_node.broker.actions.providers.pending_count() == 0)
    assert local_node.send_goal("/count", "x/Count", {"to": 1}).wait(20.0).status is GoalStatus.SUCCEEDED


def test_a_goal_of_a_client_follows_the_protocol(local_node: LocalNode, make_raw_client: RawClientFactory) -> None:
    local_node.create_action_server("/count", "x/Count", count_down)
    client = make_raw_client()
    order = {"op": "send_action_goal", "action": "/count", "action_type": "x/Count"}
    client.send_operation(**order, id="g", args={"to": 1}, feedback=True)
    assert client.receive("action_feedback") == {
        "op": "action_feedback", "id": "g", "action": "/count", "values": {"at": 0},
    }  # fmt: skip
    assert client.receive("action_result") == {
        "op": "action_result", "id": "g", "action": "/count", "values": {"reached": 1}, "status": 4, "result": True,
    }  # fmt: skip
    client.send_operation(**order, id="quiet", args={"to": 2})
    assert client.receive("action_result", id="quiet")["status"] == 4
    assert not [each for each in client.received if each["op"] == "action_feedback"]
    client.send_operation(**order, id="long", args={"to": 1000}, feedback=True)
    client.receive("action_feedback", id="long", values={"at": 5})
    client.send_operation(**order, id="long", args={"to": 1})
    assert "active already" in client.receive("action_result", id="long")["values"]
    client.send_operation(op="cancel_action_goal", id="long", action="/count")
    ended = client.receive("action_result", id="long")
    assert (ended["status"], ended["result"], ended["values"]) == (5, True, {"reached": 5})
    client.send_operation(op="set_level", level="warning")
    client.send_operation(op="cancel_action_goal", id="long", action="/count")
    assert "you have no active goal 'long'" in client.receive("status", id="long")["msg"]
    client.send_operation(op="send_action_goal", id="u", action="/nobody", action_type="x/X")
    refused = client.receive("action_result", id="u")
    assert (refused["status"], refused["result"]) == (6, False)
    assert refused["values"] == "Action /nobody does not exist"


def test_a_client_cannot_cancel_the_goal_of_another(local_node: LocalNode, make_raw_client: RawClientFactory) -> None:
    local_node.create_action_server("/count", "x/Count", count_down)
    owner, thief = make_raw_client(), make_raw_client()
    owner.send_operation(
        op="send_action_goal", id="g", action="/count", action_type="x/C", args={"to": 1000}, feedback=True
    )
    owner.receive("action_feedback", values={"at": 5})
    thief.send_operation(op="cancel_action_goal", id="g", action="/count")
    thief.flush()
    owner.flush()
    assert not [each for each in owner.received if each["op"] == "action_result"]


def test_a_goal_whose_client_disconnected_is_canceled(local_node: LocalNode, make_raw_client: RawClientFactory) -> None:
    ended = threading.Event()
    begun = threading.Event()

    def wait(goal: ServerGoalHandle) -> GoalResult:
        begun.set()
        if goal.wait_for_cancel(20.0):
            ended.set()
        return goal.canceled()

    local_node.create_action_server("/wait", "x/Wait", wait)
    client = make_raw_client()
    client.send_operation(op="send_action_goal", id="g", action="/wait", action_type="x/Wait")
    assert begun.wait(20.0)
    client.kill()
    assert ended.wait(20.0)


def test_a_goal_whose_provider_disconnected_is_aborted(
    local_node: LocalNode, make_raw_client: RawClientFactory
) -> None:
    provider, caller = make_raw_client(), make_raw_client()
    provider.send_operation(op="advertise_action", action="/far", type="x/Far")
    provider.flush()
    caller.send_operation(op="send_action_goal", id="g", action="/far", action_type="x/Far", feedback=True)
    order = provider.receive("send_action_goal")
    provider.send_operation(op="action_feedback", id=order["id"], action="/far", values={"half": 1})
    assert caller.receive("action_feedback")["values"] == {"half": 1}
    mine = local_node.send_goal("/far", "x/Far")
    provider.receive("send_action_goal")
    provider.kill()
    ended = caller.receive("action_result", id="g")
    assert (ended["status"], ended["result"], ended["values"]) == (6, False, "the provider of /far disconnected")
    with pytest.raises(ServiceCallError, match="disconnected"):
        mine.wait(20.0)


def test_late_and_foreign_messages_about_a_goal_are_dropped_with_a_status(make_raw_client: RawClientFactory) -> None:
    provider, caller, other_client = make_raw_client(), make_raw_client(), make_raw_client()
    for each in (provider, other_client):
        each.send_operation(op="set_level", level="warning")
    provider.send_operation(op="advertise_action", action="/far", type="x/Far")
    provider.flush()
    caller.send_operation(op="send_action_goal", id="g", action="/far", action_type="x/Far", feedback=True)
    id = provider.receive("send_action_goal")["id"]
    other_client.send_operation(op="action_result", id=id, action="/far", values={}, status=4, result=True)
    assert "no pending action request" in other_client.receive("status", id=id)["msg"]
    provider.send_operation(op="action_result", id=id, action="/far", values={"fine": 1}, status=4, result=True)
    assert caller.receive("action_result", id="g")["values"] == {"fine": 1}
    provider.send_operation(op="action_feedback", id=id, action="/far", values={"late": 1})
    assert "no pending action request" in provider.receive("status", id=id)["msg"]
    provider.send_operation(op="action_result", id=id, action="/far", status=4, result=True)
    assert "no pending action request" in provider.receive("status", id=id)["msg"]
    caller.flush()
    assert caller.received == []


def test_a_client_provides_an_action_until_it_disconnects(
    local_node: LocalNode, server: RosbridgeServer, client: Clients
) -> None:
    provider = client()
    cancelled = threading.Event()

    def work(goal: ServerGoalHandle) -> GoalResult:
        goal.feedback({"begun": True})
        if goal.wait_for_cancel(20.0):
            cancelled.set()
        return goal.canceled({"given": "up"})

    provider.create_action_server("/work", "x/Work", work)
    eventually(lambda: local_node.graph_info().actions)
    feedback_values: list[Any] = []
    goal = local_node.send_goal("/work", "x/Work", on_feedback=feedback_values.append)
    eventually(lambda: feedback_values)
    goal.cancel()
    assert goal.wait(20.0) == GoalResult(GoalStatus.CANCELED, {"given": "up"})
    cancelled.clear()
    goal = local_node.send_goal("/work", "x/Work", on_feedback=feedback_values.append)
    eventually(lambda: len(feedback_values) == 2)
    server.close()
    with pytest.raises(ServiceCallError, match="disconnected"):
        goal.wait(20.0)
    assert cancelled.wait(20.0)


def test_goals_of_a_client_are_limited_and_orphaned_goals_expire(make_raw_client: RawClientFactory) -> None:
    with (
        LocalNode(limits=BridgeLimits(goals=2, orphaned_goal_timeout_s=0.05)) as local_node,
        RosbridgeServer(local_node, port=0) as server,
    ):
        provider, caller = make_raw_client(server.url), make_raw_client(server.url)
        provider.send_operation(op="advertise_action", action="/far", type="x/Far")
        eventually(lambda: local_node.graph_info().actions)
        for id in range(3):
            caller.send_operation(op="send_action_goal", id=id, action="/far", action_type="x/Far")
        assert "you have 2 active goals already" in caller.receive("action_result", id=2)["values"]
        caller.close()
        for _ in range(2):
            provider.receive("cancel_action_goal")  # and never returns a result
        eventually(lambda: local_node.broker.actions.providers.pending_count() == 0)
