"""The RPC channel with real websockets, without a simulation."""

from __future__ import annotations

import json
import logging
import threading
from collections.abc import Iterator

import msgspec
import pytest

from mindstage.access.limits import RpcLimits
from mindstage.access.policies import EDIT
from mindstage.errors import BodyNotFoundError
from mindstage.viewer.server import ClientSession, RpcChannel, address, serve, shut_down
from tests.viewer.page_client import PageClient, RequestFailedError, connect_page_client
from tests.viewer.waiting import TIMEOUT_S, wait_until


class Nothing(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    pass


class Number(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    number: int


@pytest.fixture
def channel() -> RpcChannel:
    return RpcChannel(RpcLimits(max_pending=4, max_requests_per_second=1000.0))


@pytest.fixture
def url(channel: RpcChannel) -> Iterator[str]:
    server = serve("127.0.0.1", 0, title="T", channel=channel)
    server.open()
    yield address(server)
    shut_down(server)
    channel.close()


@pytest.fixture
def client(url: str) -> Iterator[PageClient]:
    with connect_page_client(url) as client:
        yield client


def test_a_mindstage_error_is_an_error_response(channel: RpcChannel, client: PageClient) -> None:
    def refuse(_: ClientSession, __: Nothing) -> None:
        raise BodyNotFoundError("Cupp", known=["Cup"])

    channel.register("look", Nothing, refuse, EDIT)
    with pytest.raises(RequestFailedError, match="BodyNotFoundError: no body 'Cupp'; near: 'Cup'"):
        client.ask("look")


def test_an_unexpected_exception_is_sent_to_the_page_and_logged(
    channel: RpcChannel, client: PageClient, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(_: ClientSession, __: Nothing) -> None:
        raise KeyError("oops")

    channel.register("fail", Nothing, fail, EDIT)
    with caplog.at_level(logging.ERROR), pytest.raises(RequestFailedError, match="Defect: KeyError: 'oops'"):
        client.ask("fail")
    assert [record.exc_info is not None for record in caplog.records] == [True]


def test_a_method_is_registered_once(channel: RpcChannel) -> None:
    channel.register("look", Nothing, lambda *_: None, EDIT)
    with pytest.raises(ValueError, match="registered already"):
        channel.register("look", Nothing, lambda *_: None, EDIT)


def test_closing_waits_for_no_request_that_is_being_handled(channel: RpcChannel, client: PageClient) -> None:
    begun, may_end, ended = threading.Event(), threading.Event(), threading.Event()

    def block(_: ClientSession, __: Nothing) -> None:
        begun.set()
        may_end.wait(5.0)
        ended.set()

    channel.register("block", Nothing, block, EDIT)
    client.socket.send(json.dumps({"id": 1, "method": "block"}))
    assert begun.wait(TIMEOUT_S)
    channel.close()
    assert not ended.is_set()
    may_end.set()


def test_published_values_reach_all_sessions_and_later_ones(channel: RpcChannel, url: str, client: PageClient) -> None:
    channel.publish("clock", {"time": 1})
    wait_until(lambda: client.latest_value("clock") == {"time": 1}, "open sessions receive it")
    channel.publish("clock", {"time": 2})
    with connect_page_client(url) as late:
        wait_until(lambda: late.latest_value("clock") == {"time": 2}, "later sessions receive the latest value")
        assert [value for topic, value in late.events if topic == "clock"] == [{"time": 2}]


def test_unchanged_values_are_not_sent_again(channel: RpcChannel, client: PageClient) -> None:
    for value in (1, 1, 1, 2, 2, 1):
        channel.publish("value", value)
        wait_until(lambda value=value: client.latest_value("value") == value, "the value is received")
    assert [value for topic, value in client.events if topic == "value"] == [1, 2, 1]


def test_events_are_sent_once_and_not_to_later_sessions(channel: RpcChannel, url: str, client: PageClient) -> None:
    wait_until(lambda: channel.sessions, "the session is open")
    channel.broadcast("toast", "bread")
    wait_until(lambda: client.latest_value("toast") == "bread", "open sessions receive it")
    channel.publish("after", True)
    with connect_page_client(url) as late:
        wait_until(lambda: late.latest_value("after"), "the later session has received everything")
        assert "toast" not in late.latest


def test_events_can_be_sent_to_one_session(channel: RpcChannel, url: str) -> None:
    with connect_page_client(url, key="a" * 8) as ann, connect_page_client(url, key="b" * 8) as bob:
        wait_until(lambda: len(channel.sessions) == 2, "both sessions are open")
        session = channel.session("a" * 8)
        assert session is not None
        for value in (1, 1, 2):
            session.publish_to("mine", value)
        session.send_event("mine too", 3)
        channel.publish("end", True)
        wait_until(lambda: ann.latest_value("end") and bob.latest_value("end"), "everything is received")
        assert (ann.latest["mine"], ann.latest["mine too"]) == (2, 3)
        assert not {"mine", "mine too"} & bob.latest.keys()


def test_a_slow_request_blocks_only_its_own_queue(channel: RpcChannel, client: PageClient) -> None:
    released, done = threading.Event(), list[int]()

    def wait(_: ClientSession, request: Number) -> None:
        released.wait(TIMEOUT_S)
        done.append(request.number)

    channel.register("slow", Number, wait, EDIT, queue="slow")
    channel.register("quick", Number, lambda _, request: request.number, EDIT)
    for number in (1, 2, 3):
        client.socket.send(json.dumps({"id": -number, "method": "slow", "params": {"number": number}}))
    assert client.ask("quick", number=7) == 7
    assert done == []
    released.set()
    wait_until(lambda: len(done) == 3, "the slow requests are answered")
    assert done == [1, 2, 3], "they are handled in order"


def test_too_many_pending_requests_are_refused(channel: RpcChannel, client: PageClient) -> None:
    released = threading.Event()
    channel.register("wait", Nothing, lambda *_: released.wait(TIMEOUT_S), EDIT)
    for number in range(-6, 0):
        client.socket.send(json.dumps({"id": number, "method": "wait"}))
    refused = [json.loads(client.socket.recv(timeout=TIMEOUT_S)) for _ in range(2)]
    assert [reply["error"]["code"] for reply in refused] == ["RequestLimitError", "RequestLimitError"]
    released.set()
    answered = [json.loads(client.socket.recv(timeout=TIMEOUT_S)) for _ in range(4)]
    assert all(reply["result"] is True for reply in answered)


def test_the_rate_of_requests_is_limited() -> None:
    slow = RpcChannel(RpcLimits(max_requests_per_second=0.001))
    slow.register("ask", Nothing, lambda *_: True, EDIT)
    server = serve("127.0.0.1", 0, title="T", channel=slow)
    server.open()
    try:
        with connect_page_client(address(server)) as client:
            for number in range(4):
                client.socket.send(json.dumps({"id": number, "method": "ask"}))
            replies = [json.loads(client.socket.recv(timeout=TIMEOUT_S)) for _ in range(4)]
            assert {reply["error"]["code"] for reply in replies} == {"RequestLimitError"}
    finally:
        shut_down(server)
        slow.close()


def test_callbacks_are_called_for_connects_and_disconnects(channel: RpcChannel, url: str) -> None:
    events: list[tuple[str, str]] = []
    channel.on_connect(lambda session: events.append(("connected", session.key)))
    channel.on_disconnect(lambda session: events.append(("disconnected", session.key)))
    with connect_page_client(url, key="c" * 8):
        wait_until(lambda: events == [("connected", "c" * 8)], "the session is connected")
    wait_until(lambda: events == [("connected", "c" * 8), ("disconnected", "c" * 8)], "the session is disconnected")
