"""Calls that wait: withdrawal at their timeout, extension while the queue moves, and clients that send too many."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import pytest

from mindstage.access.limits import BridgeLimits
from mindstage.bridge import LocalNode, RosbridgeServer
from tests.bridge.raw_client import TIMEOUT_S, RawClient, eventually

SHORT_S = 0.5


class Gate:
    """A service that blocks until the test allows a call to end, and records the calls that began."""

    def __init__(self) -> None:
        self.begun: list[int] = []
        self.entered = threading.Semaphore(0)
        self.may_end = threading.Semaphore(0)

    def handle(self, args: dict[str, Any]) -> dict[str, Any]:
        self.begun.append(args["number"])
        self.entered.release()
        assert self.may_end.acquire(timeout=TIMEOUT_S)
        return {"number": args["number"]}

    def wait_begun(self) -> None:
        assert self.entered.acquire(timeout=TIMEOUT_S)

    def open(self, calls: int = 1000) -> None:
        self.may_end.release(calls)


@pytest.fixture
def gate() -> Iterator[Gate]:
    gate = Gate()
    yield gate
    gate.open()


@pytest.fixture
def limited_node(gate: Gate) -> Iterator[LocalNode]:
    with LocalNode(limits=BridgeLimits(calls=4, call_timeout_s=SHORT_S)) as local_node:
        local_node.create_service("/gate", "x/Gate", gate.handle)
        local_node.create_service("/quick", "x/Quick", lambda _: {"now": True}, quick=True)
        local_node.create_service("/settle", "x/X", lambda _: None)
        yield local_node


@pytest.fixture
def raw_client(limited_node: LocalNode) -> Iterator[RawClient]:
    with RosbridgeServer(limited_node, port=0) as server, closing(RawClient(server.url)) as client:
        yield client


def send(client: RawClient, number: int, **fields: Any) -> None:
    client.send_operation(op="call_service", id=number, service="/gate", args={"number": number}, **fields)


def answer(client: RawClient, number: int) -> dict[str, Any]:
    return client.receive("service_response", id=number)


def test_a_call_that_timed_out_before_it_began_is_never_carried_out(raw_client: RawClient, gate: Gate) -> None:
    send(raw_client, 1, timeout=TIMEOUT_S)
    gate.wait_begun()
    send(raw_client, 2, timeout=SHORT_S)
    late = answer(raw_client, 2)
    assert late["result"] is False
    assert late["values"] == f"/gate did not begin within {SHORT_S:g} s; it was withdrawn"
    gate.open()
    assert answer(raw_client, 1)["values"] == {"number": 1}
    raw_client.flush()
    assert gate.begun == [1]


def test_a_call_that_has_begun_is_answered_at_its_end(raw_client: RawClient, gate: Gate) -> None:
    send(raw_client, 1, timeout=SHORT_S)
    gate.wait_begun()
    send(raw_client, 2, timeout=2 * SHORT_S)
    assert "withdrawn" in answer(raw_client, 2)["values"]  # the time of the first call is over as well
    gate.open()
    assert answer(raw_client, 1) == {
        "op": "service_response", "id": 1, "service": "/gate", "values": {"number": 1}, "result": True,
    }  # fmt: skip


def test_the_default_timeout_starts_anew_while_the_queue_moves(
    raw_client: RawClient, gate: Gate, limited_node: LocalNode
) -> None:
    for number in range(3):
        send(raw_client, number)
    for number in range(3):
        gate.wait_begun()
        expired = threading.Event()
        limited_node._loop.call(limited_node._loop.loop.call_later, 0.6 * SHORT_S, expired.set)
        assert expired.wait(TIMEOUT_S)
        gate.open(1)
        assert answer(raw_client, number)["result"] is True


def test_calls_of_a_client_that_left_are_withdrawn(raw_client: RawClient, gate: Gate, limited_node: LocalNode) -> None:
    for number in range(3):
        send(raw_client, number, timeout=TIMEOUT_S)
    gate.wait_begun()
    eventually(lambda: limited_node.broker.services.providers.pending_count() == 3)
    raw_client.close()
    eventually(lambda: limited_node.broker.services.providers.pending_count() == 0)
    gate.open()
    eventually(lambda: not limited_node._executor._waiting)
    assert gate.begun == [0]


def test_a_client_with_many_calls_is_held_up_and_none_fails(raw_client: RawClient, gate: Gate) -> None:
    count = 40
    for number in range(count):
        send(raw_client, number, timeout=TIMEOUT_S)
    gate.open()
    answers = [raw_client.receive("service_response") for _ in range(count)]
    assert [each["id"] for each in answers] == list(range(count))
    assert all(each["result"] for each in answers)
    assert gate.begun == list(range(count))


def test_reading_stops_at_the_limit_and_continues_when_half_of_the_calls_ended(
    raw_client: RawClient, gate: Gate, limited_node: LocalNode
) -> None:
    assert raw_client.call_service("/quick")["result"] is True
    for number in range(8):
        send(raw_client, number, timeout=TIMEOUT_S)
    pending = limited_node.broker.services.providers.pending_count
    (peer,) = [each for each in limited_node.broker._peers if not each.is_local]
    eventually(lambda: peer.is_paused)
    assert pending() == 4
    gate.open(1)
    assert answer(raw_client, 0)["result"] is True
    assert peer.is_paused
    gate.open(1)
    assert answer(raw_client, 1)["result"] is True
    eventually(lambda: pending() == 4)  # two more were read
    gate.open()
    assert answer(raw_client, 7)["result"] is True


def test_a_held_up_client_that_is_lost_does_not_keep_the_server_open(gate: Gate, limited_node: LocalNode) -> None:
    with RosbridgeServer(limited_node, port=0) as server:
        client = RawClient(server.url)
        for number in range(8):
            send(client, number, timeout=TIMEOUT_S)
        gate.wait_begun()
        client.kill()
    assert server.client_count == 0


def test_other_clients_are_answered_while_one_is_held_up(
    raw_client: RawClient, gate: Gate, limited_node: LocalNode
) -> None:
    for number in range(8):
        send(raw_client, number, timeout=TIMEOUT_S)
    gate.wait_begun()
    with RosbridgeServer(limited_node, port=0) as server, closing(RawClient(server.url)) as other:
        assert other.call_service("/quick")["values"] == {"now": True}
        assert other.call_service("/settle")["result"] is True


def test_a_quick_service_keeps_the_order_of_the_calls_of_a_client(raw_client: RawClient, gate: Gate) -> None:
    send(raw_client, 1, timeout=TIMEOUT_S)
    raw_client.send_operation(op="call_service", id="quick", service="/quick")
    gate.wait_begun()
    gate.open()
    assert [raw_client.receive("service_response")["id"] for _ in range(2)] == [1, "quick"]


def test_a_quick_response_that_is_not_an_object_is_an_error(raw_client: RawClient, limited_node: LocalNode) -> None:
    limited_node.create_service("/wrong", "x/Wrong", lambda _: "text", quick=True)
    response = raw_client.call_service("/wrong")
    assert response["result"] is False
    assert response["values"] == "the response of /wrong is not an object"


def test_calls_with_the_same_id_are_all_carried_out(raw_client: RawClient, gate: Gate) -> None:
    for number in range(3):
        raw_client.send_operation(op="call_service", id="same", service="/gate", args={"number": number})
        raw_client.send_operation(op="call_service", service="/gate", args={"number": 10 + number})
    gate.open()
    answers = [raw_client.receive("service_response")["values"]["number"] for _ in range(6)]
    assert answers == gate.begun == [0, 10, 1, 11, 2, 12]
