"""roslibpy as a client: caller, provider, publisher and subscriber."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import roslibpy
from roslibpy.comm.comm_asyncio import AsyncioRosBridgeClientFactory

from mindstage.bridge import LocalNode, RosbridgeClient, RosbridgeServer, ServerGoalHandle
from tests.bridge.raw_client import TIMEOUT_S, eventually

Ros = Callable[[], roslibpy.Ros]


@pytest.fixture
def ros(server: RosbridgeServer, monkeypatch: pytest.MonkeyPatch) -> Iterator[Ros]:
    # A killed client must not reconnect after the test.
    monkeypatch.setattr(AsyncioRosBridgeClientFactory, "maxRetries", 0)
    made = []

    def make() -> roslibpy.Ros:
        connection = roslibpy.Ros("127.0.0.1", server.port, transport="asyncio")
        connection.run(TIMEOUT_S)
        made.append(connection)
        return connection

    yield make
    for connection in made:
        connection.close()


def test_roslibpy_calls_a_service(local_node: LocalNode, ros: Ros) -> None:
    local_node.create_service("/add", "x/Add", lambda args: {"sum": args["a"] + args["b"]})
    service = roslibpy.Service(ros(), "/add", "x/Add")
    answer = service.call(roslibpy.ServiceRequest({"a": 1, "b": 2}), timeout=TIMEOUT_S)
    assert dict(answer) == {"sum": 3}
    with pytest.raises(roslibpy.core.ServiceException, match="KeyError"):
        service.call(roslibpy.ServiceRequest({"a": 1}), timeout=TIMEOUT_S)
    with pytest.raises(roslibpy.core.ServiceException, match="Service /nobody does not exist"):
        roslibpy.Service(ros(), "/nobody", "x/X").call(roslibpy.ServiceRequest(), timeout=TIMEOUT_S)


def test_roslibpy_provides_a_service(local_node: LocalNode, ros: Ros, server: RosbridgeServer) -> None:
    def add(request: dict[str, Any], response: dict[str, Any]) -> bool:
        response["sum"] = request["a"] + request["b"]
        return True

    provider = roslibpy.Service(ros(), "/far/add", "x/Add")
    provider.advertise(add)
    eventually(lambda: local_node.graph_info().services)
    assert local_node.call_service("/far/add", {"a": 1, "b": 2}) == {"sum": 3}
    with RosbridgeClient(server.url) as client:
        assert client.wait_connected(TIMEOUT_S).call_service("far/add", {"a": 2, "b": 2}) == {"sum": 4}
    caller = roslibpy.Service(ros(), "/far/add", "x/Add")
    for number in range(50):
        answer = caller.call(roslibpy.ServiceRequest({"a": number, "b": 1}), timeout=TIMEOUT_S)
        assert dict(answer) == {"sum": number + 1}
    provider.unadvertise()
    eventually(lambda: not local_node.graph_info().services)


def test_roslibpy_publishes_and_subscribes(local_node: LocalNode, ros: Ros) -> None:
    received: list[Any] = []
    local_node.subscribe("/numbers", lambda message: received.append(("here", message["data"])))
    subscriber = roslibpy.Topic(ros(), "/numbers", "std_msgs/Int32")
    subscriber.subscribe(lambda message: received.append(("there", message["data"])))
    eventually(lambda: local_node.graph_info().topics and len(local_node.graph_info().topics[0].subscribers) == 2)
    publisher = roslibpy.Topic(ros(), "/numbers", "std_msgs/Int32")
    for number in range(100):
        publisher.publish(roslibpy.Message({"data": number}))
    local_node.publish("/numbers", "std_msgs/Int32", {"data": -1})
    eventually(lambda: len(received) == 202)
    for who in ("here", "there"):
        assert [n for name, n in received if name == who and n >= 0] == list(range(100))
    subscriber.unsubscribe()
    eventually(lambda: len(local_node.graph_info().topics[0].subscribers) == 1)


def test_roslibpy_sends_and_cancels_a_goal(local_node: LocalNode, ros: Ros) -> None:
    def work(goal: ServerGoalHandle) -> Any:
        goal.feedback({"begun": True})
        return goal.canceled({"given": "up"}) if goal.wait_for_cancel(goal.args["for_s"]) else {"done": True}

    local_node.create_action_server("/work", "x/Work", work)
    client = roslibpy.ActionClient(ros(), "/work", "x/Work")
    feedback_values: list[Any] = []
    results: list[Any] = []
    begun = threading.Event()

    def feedback(values: Any) -> None:
        feedback_values.append(dict(values))
        begun.set()

    def send(for_s: float) -> Any:
        return client.send_goal(roslibpy.Goal({"for_s": for_s}), results.append, feedback, results.append)

    client.wait_goal(send(0.0), TIMEOUT_S)
    assert feedback_values == [{"begun": True}]
    assert results[0]["values"] == {"done": True}
    assert results[0]["status"] is roslibpy.GoalStatus.SUCCEEDED
    begun.clear()
    goal = send(TIMEOUT_S)
    assert begun.wait(TIMEOUT_S)
    client.cancel_goal(goal)
    client.wait_goal(goal, TIMEOUT_S)
    assert results[1]["status"] is roslibpy.GoalStatus.CANCELED
    assert results[1]["values"] == {"given": "up"}


def test_calls_to_a_killed_roslibpy_provider_fail(local_node: LocalNode, ros: Ros) -> None:
    called = threading.Event()
    provider = ros()

    def die(_: Any, __: Any) -> bool:
        called.set()
        provider.factory._proto.transport.abort()
        return True

    roslibpy.Service(provider, "/far/die", "x/X", reconnect_on_close=False).advertise(die)
    eventually(lambda: local_node.graph_info().services)
    with pytest.raises(roslibpy.core.ServiceException, match="the provider of /far/die disconnected"):
        roslibpy.Service(ros(), "/far/die", "x/X").call(roslibpy.ServiceRequest(), timeout=TIMEOUT_S)
    assert called.is_set()
