"""roslibpy, a client that is not ours, at our hub: as caller, provider, publisher and subscriber."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import roslibpy
from roslibpy.comm.comm_asyncio import AsyncioRosBridgeClientFactory

from mindstage.bridge import LocalNode, RosbridgeClient, RosbridgeServer, ServerGoalHandle
from tests.bridge.talking import TIMEOUT_S, eventually

Ros = Callable[[], roslibpy.Ros]


@pytest.fixture
def ros(server: RosbridgeServer, monkeypatch: pytest.MonkeyPatch) -> Iterator[Ros]:
    # A client that is killed shall stay so: its thread would go on trying long after the test.
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


def test_it_calls_a_service_of_ours(hub: LocalNode, ros: Ros) -> None:
    hub.create_service("/add", "x/Add", lambda args: {"sum": args["a"] + args["b"]})
    service = roslibpy.Service(ros(), "/add", "x/Add")
    answer = service.call(roslibpy.ServiceRequest({"a": 1, "b": 2}), timeout=TIMEOUT_S)
    assert dict(answer) == {"sum": 3}
    with pytest.raises(roslibpy.core.ServiceException, match="KeyError"):
        service.call(roslibpy.ServiceRequest({"a": 1}), timeout=TIMEOUT_S)
    with pytest.raises(roslibpy.core.ServiceException, match="Service /nobody does not exist"):
        roslibpy.Service(ros(), "/nobody", "x/X").call(roslibpy.ServiceRequest(), timeout=TIMEOUT_S)


def test_it_provides_a_service_that_another_one_and_we_call(hub: LocalNode, ros: Ros, server: RosbridgeServer) -> None:
    def add(request: dict[str, Any], response: dict[str, Any]) -> bool:
        response["sum"] = request["a"] + request["b"]
        return True

    provider = roslibpy.Service(ros(), "/far/add", "x/Add")
    provider.advertise(add)
    eventually(lambda: hub.graph_info().services)
    assert hub.call_service("/far/add", {"a": 1, "b": 2}) == {"sum": 3}
    with RosbridgeClient(server.url) as client:
        assert client.wait_connected(TIMEOUT_S).call_service("far/add", {"a": 2, "b": 2}) == {"sum": 4}
    caller = roslibpy.Service(ros(), "/far/add", "x/Add")
    for number in range(50):
        answer = caller.call(roslibpy.ServiceRequest({"a": number, "b": 1}), timeout=TIMEOUT_S)
        assert dict(answer) == {"sum": number + 1}
    provider.unadvertise()
    eventually(lambda: not hub.graph_info().services)


def test_it_publishes_and_subscribes(hub: LocalNode, ros: Ros) -> None:
    heard: list[Any] = []
    hub.subscribe("/words", lambda message: heard.append(("here", message["n"])))
    listener = roslibpy.Topic(ros(), "/words", "std_msgs/String")
    listener.subscribe(lambda message: heard.append(("there", message["n"])))
    eventually(lambda: hub.graph_info().topics and len(hub.graph_info().topics[0].subscribers) == 2)
    speaker = roslibpy.Topic(ros(), "/words", "std_msgs/String")
    for number in range(100):
        speaker.publish(roslibpy.Message({"n": number}))
    hub.publish("/words", "std_msgs/String", {"n": -1})
    eventually(lambda: len(heard) == 202)
    for who in ("here", "there"):
        assert [n for name, n in heard if name == who and n >= 0] == list(range(100))
    listener.unsubscribe()
    eventually(lambda: len(hub.graph_info().topics[0].subscribers) == 1)


def test_it_sends_a_goal_hears_of_it_and_gives_it_up(hub: LocalNode, ros: Ros) -> None:
    def work(goal: ServerGoalHandle) -> Any:
        goal.feedback({"begun": True})
        return goal.canceled({"given": "up"}) if goal.wait_for_cancel(goal.args["for_s"]) else {"done": True}

    hub.create_action_server("/work", "x/Work", work)
    client = roslibpy.ActionClient(ros(), "/work", "x/Work")
    told: list[Any] = []
    results: list[Any] = []
    begun = threading.Event()

    def feedback(values: Any) -> None:
        told.append(dict(values))
        begun.set()

    def send(for_s: float) -> Any:
        return client.send_goal(roslibpy.Goal({"for_s": for_s}), results.append, feedback, results.append)

    client.wait_goal(send(0.0), TIMEOUT_S)
    assert told == [{"begun": True}]
    assert results[0]["values"] == {"done": True}
    assert results[0]["status"] is roslibpy.GoalStatus.SUCCEEDED
    begun.clear()
    goal = send(TIMEOUT_S)
    assert begun.wait(TIMEOUT_S)
    client.cancel_goal(goal)
    client.wait_goal(goal, TIMEOUT_S)
    assert results[1]["status"] is roslibpy.GoalStatus.CANCELED
    assert results[1]["values"] == {"given": "up"}


def test_its_provider_that_is_killed_leaves_no_caller_waiting(hub: LocalNode, ros: Ros) -> None:
    called = threading.Event()
    provider = ros()

    def die(_: Any, __: Any) -> bool:
        called.set()
        provider.factory._proto.transport.abort()
        return True

    roslibpy.Service(provider, "/far/die", "x/X", reconnect_on_close=False).advertise(die)
    eventually(lambda: hub.graph_info().services)
    with pytest.raises(roslibpy.core.ServiceException, match="the provider of /far/die disconnected"):
        roslibpy.Service(ros(), "/far/die", "x/X").call(roslibpy.ServiceRequest(), timeout=TIMEOUT_S)
    assert called.is_set()
