"""What the page asks and is told, over a real socket at a server without a world."""

from __future__ import annotations

import json
import logging
import threading
from collections.abc import Iterator

import msgspec
import pytest

from mindstage.errors import BodyNotFoundError
from mindstage.viewer.server import ClientSession, RpcChannel, RpcLimits, address, serve, shut_down
from tests.viewer.guest import PageClient, RequestFailed, connect_page_client
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
    yield address(server)
    shut_down(server)
    channel.close()


@pytest.fixture
def guest(url: str) -> Iterator[PageClient]:
    with connect_page_client(url) as guest:
        yield guest


def test_an_answer_can_be_a_refusal_of_the_world(channel: RpcChannel, guest: PageClient) -> None:
    def refuse(_: ClientSession, __: Nothing) -> None:
        raise BodyNotFoundError("Cupp", known=["Cup"])

    channel.register("look", Nothing, refuse)
    with pytest.raises(RequestFailed, match="BodyUnknown: no body 'Cupp'; near: 'Cup'"):
        guest.ask("look")


def test_a_defect_of_ours_is_told_to_the_page_and_to_the_log(
    channel: RpcChannel, guest: PageClient, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(_: ClientSession, __: Nothing) -> None:
        raise KeyError("oops")

    channel.register("fail", Nothing, fail)
    with caplog.at_level(logging.ERROR), pytest.raises(RequestFailed, match="Defect: KeyError: 'oops'"):
        guest.ask("fail")
    assert [record.exc_info is not None for record in caplog.records] == [True]


def test_a_name_is_offered_once(channel: RpcChannel) -> None:
    channel.register("look", Nothing, lambda *_: None)
    with pytest.raises(ValueError, match="offered already"):
        channel.register("look", Nothing, lambda *_: None)


def test_what_is_published_reaches_all_and_those_who_come_later(
    channel: RpcChannel, url: str, guest: PageClient
) -> None:
    channel.publish("clock", {"time": 1})
    wait_until(lambda: guest.latest_value("clock") == {"time": 1}, "who is there is told")
    channel.publish("clock", {"time": 2})
    with connect_page_client(url) as late:
        wait_until(lambda: late.latest_value("clock") == {"time": 2}, "who comes later is told how it is then")
        assert [value for topic, value in late.events if topic == "clock"] == [{"time": 2}]


def test_what_has_not_changed_is_not_sent_again(channel: RpcChannel, guest: PageClient) -> None:
    for value in (1, 1, 1, 2, 2, 1):
        channel.publish("value", value)
        wait_until(lambda value=value: guest.latest_value("value") == value, "it is told")
    assert [value for topic, value in guest.events if topic == "value"] == [1, 2, 1]


def test_what_happened_is_told_once_and_not_to_those_who_come_later(
    channel: RpcChannel, url: str, guest: PageClient
) -> None:
    wait_until(lambda: channel.sessions, "somebody is there")
    channel.broadcast("toast", "bread")
    wait_until(lambda: guest.latest_value("toast") == "bread", "who is there is told")
    channel.publish("after", True)
    with connect_page_client(url) as late:
        wait_until(lambda: late.latest_value("after"), "the late one has heard all that there is")
        assert "toast" not in late.latest


def test_one_visitor_is_told_what_others_are_not(channel: RpcChannel, url: str) -> None:
    with connect_page_client(url, key="a" * 8) as ann, connect_page_client(url, key="b" * 8) as bob:
        wait_until(lambda: len(channel.sessions) == 2, "both are there")
        visitor = channel.session("a" * 8)
        assert visitor is not None
        for value in (1, 1, 2):
            visitor.publish_to("mine", value)
        visitor.send_event("mine too", 3)
        channel.publish("end", True)
        wait_until(lambda: ann.latest_value("end") and bob.latest_value("end"), "all is told")
        assert (ann.latest["mine"], ann.latest["mine too"]) == (2, 3)
        assert not {"mine", "mine too"} & bob.latest.keys()


def test_a_long_answer_stops_nothing_but_its_own_lane(channel: RpcChannel, guest: PageClient) -> None:
    let_go, done = threading.Event(), list[int]()

    def wait(_: ClientSession, wish: Number) -> None:
        let_go.wait(TIMEOUT_S)
        done.append(wish.number)

    channel.register("slow", Number, wait, queue="slow")
    channel.register("quick", Number, lambda _, wish: wish.number)
    for number in (1, 2, 3):
        guest.socket.send(json.dumps({"id": -number, "method": "slow", "params": {"number": number}}))
    assert guest.ask("quick", number=7) == 7
    assert done == []
    let_go.set()
    wait_until(lambda: len(done) == 3, "the others are answered")
    assert done == [1, 2, 3], "in their order"


def test_who_asks_too_much_at_once_is_told_so(channel: RpcChannel, guest: PageClient) -> None:
    let_go = threading.Event()
    channel.register("wait", Nothing, lambda *_: let_go.wait(TIMEOUT_S))
    for number in range(-6, 0):
        guest.socket.send(json.dumps({"id": number, "method": "wait"}))
    refused = [json.loads(guest.socket.recv(timeout=TIMEOUT_S)) for _ in range(2)]
    assert [reply["error"]["type"] for reply in refused] == ["TooMany", "TooMany"]
    let_go.set()
    answered = [json.loads(guest.socket.recv(timeout=TIMEOUT_S)) for _ in range(4)]
    assert all(reply["result"] is True for reply in answered)


def test_requests_have_a_rate() -> None:
    slow = RpcChannel(RpcLimits(max_requests_per_second=0.001))
    slow.register("ask", Nothing, lambda *_: True)
    server = serve("127.0.0.1", 0, title="T", channel=slow)
    try:
        with connect_page_client(address(server)) as guest:
            for number in range(4):
                guest.socket.send(json.dumps({"id": number, "method": "ask"}))
            replies = [json.loads(guest.socket.recv(timeout=TIMEOUT_S)) for _ in range(4)]
            assert {reply["error"]["type"] for reply in replies} == {"TooMany"}
    finally:
        shut_down(server)
        slow.close()


def test_whoever_comes_and_leaves_is_noticed(channel: RpcChannel, url: str) -> None:
    seen: list[tuple[str, str]] = []
    channel.on_connect(lambda visitor: seen.append(("came", visitor.key)))
    channel.on_disconnect(lambda visitor: seen.append(("left", visitor.key)))
    with connect_page_client(url, key="c" * 8):
        wait_until(lambda: seen == [("came", "c" * 8)], "it came")
    wait_until(lambda: seen == [("came", "c" * 8), ("left", "c" * 8)], "it left")
