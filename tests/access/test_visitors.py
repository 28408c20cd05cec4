"""Limits of what one client address may use."""

from __future__ import annotations

import json
from collections.abc import Callable

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from mindstage.access.limits import VISITORS, VisitorLimits
from mindstage.access.visitors import TokenBucket, VisitorRegistry
from mindstage.bridge import LocalNode, RosbridgeServer
from tests.bridge.raw_client import TIMEOUT_S, RawClient
from tests.cases import each_case

HERE, THERE = ("127.0.0.1", 4000), ("192.0.2.7", 4000)


@pytest.fixture
def from_elsewhere(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets connections of this machine count as those of another one."""
    monkeypatch.setattr("mindstage.access.visitors.is_loopback", lambda host: False)


@given(
    rate=st.floats(0.1, 100.0),
    burst=st.integers(1, 50),
    waits=st.lists(st.floats(0.0, 5.0), min_size=1, max_size=200),
)
def test_no_more_is_taken_than_the_burst_and_the_rate_allow(rate: float, burst: int, waits: list[float]) -> None:
    bucket, now_s, taken = TokenBucket(rate, burst), 0.0, 0
    for wait_s in waits:
        now_s += wait_s
        taken += bucket.try_take(now_s)
        assert taken <= burst + rate * now_s + 1e-6
    assert bucket.try_take(now_s + burst / rate + 1.0 / rate), "it is refilled"


@given(rate=st.floats(1.0, 1000.0), sizes=st.lists(st.floats(0.0, 500.0), max_size=100))
def test_waiting_as_long_as_asked_keeps_the_rate(rate: float, sizes: list[float]) -> None:
    bucket, now_s = TokenBucket(rate, 10.0), 0.0
    for size in sizes:
        now_s += bucket.take(size, now_s)
    assert sum(sizes) <= 10.0 + rate * now_s + 1e-6


def test_this_machine_is_limited_in_failed_tokens_only() -> None:
    limits = VisitorLimits(connections=1, messages_per_second=1, queries_per_second=1, failed_tokens_per_minute=2)
    registry = VisitorRegistry(limits)
    here, there = registry.visitor(HERE), registry.visitor(THERE)
    here.connections = there.connections = 1
    assert here.may_connect
    assert not there.may_connect
    assert here.receive_delay is None
    assert there.receive_delay is not None
    assert [there.receive_delay(10, 0.0) for _ in range(5)] == [0.0, 0.0, 0.0, 0.0, 1.0]
    assert all(here.may_query(0.0) for _ in range(100))
    assert [there.may_query(0.0) for _ in range(6)] == [True] * 4 + [False] * 2
    assert there.may_query(1.0)
    for visitor in (here, there):
        visitor.add_failed_token(0.0)
        assert visitor.may_try_token(0.0)
        visitor.add_failed_token(0.0)
        assert not visitor.may_try_token(0.0)
        assert visitor.may_try_token(31.0)


def test_large_messages_are_limited_by_their_bytes() -> None:
    delay = VisitorRegistry(VisitorLimits(bytes_per_second=1000)).visitor(THERE).receive_delay
    assert delay is not None
    assert delay(4000, 0.0) == 0.0
    assert delay(3000, 0.0) == pytest.approx(3.0)


@each_case(
    ("one", "other", "same"),
    [
        ("192.0.2.7", "192.0.2.7", True),
        ("192.0.2.7", "192.0.2.8", False),
        ("2001:db8::1", "2001:db8::ffff:2", True),
        ("2001:db8::1", "2001:db8:0:1::1", False),
        ("fe80::1%eth0", "fe80::1%eth1", True),
        ("::ffff:192.0.2.7", "192.0.2.7", True),
        ("::1", "::2", False),
    ],
)
def test_an_address_is_one_visitor(one: str, other: str, same: bool) -> None:
    registry = VisitorRegistry()
    assert (registry.visitor((one, 1)) is registry.visitor((other, 2))) is same


def test_few_visitors_are_remembered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mindstage.access.visitors.VISITORS", msgspec.structs.replace(VISITORS, maximum=3))
    registry = VisitorRegistry()
    connected = registry.visitor(("192.0.2.1", 1))
    connected.connections = 1
    idle = registry.visitor(("192.0.2.2", 1))
    for last in range(3, 9):
        registry.visitor((f"192.0.2.{last}", 1))
    assert len(registry._visitors) == 3
    assert registry.visitor(("192.0.2.1", 1)) is connected
    assert registry.visitor(("192.0.2.2", 1)) is not idle


# -- at the server -----------------------------------------------------------------------------------------------------


def test_after_many_wrong_tokens_even_the_right_one_is_not_checked(local_node: LocalNode) -> None:
    limits = VisitorLimits(failed_tokens_per_minute=3)
    with RosbridgeServer(local_node, port=0, token="sesame", visitor_limits=limits) as server:
        statuses = []
        for token in ("a", "b", "c", "sesame"):
            with pytest.raises(InvalidStatus) as refused:
                connect(f"{server.url}?token={token}", open_timeout=TIMEOUT_S)
            statuses.append(refused.value.response.status_code)
        assert statuses == [401, 401, 401, 429]


def test_wrong_tokens_in_auth_count_too(local_node: LocalNode) -> None:
    limits = VisitorLimits(failed_tokens_per_minute=2)
    with RosbridgeServer(local_node, port=0, token="sesame", visitor_limits=limits) as server:
        for token in ("a", "b"):
            with connect(server.url, open_timeout=TIMEOUT_S) as socket:
                socket.send(json.dumps({"op": "auth", "token": token}))
                assert "invalid token" in json.loads(socket.recv(TIMEOUT_S))["msg"]
        with pytest.raises(InvalidStatus, match="429"):
            connect(server.url, open_timeout=TIMEOUT_S)


def test_the_connections_of_an_address_are_limited(local_node: LocalNode, from_elsewhere: None) -> None:
    with RosbridgeServer(local_node, port=0, visitor_limits=VisitorLimits(connections=2)) as server:
        with (
            connect(server.url, open_timeout=TIMEOUT_S),
            connect(server.url, open_timeout=TIMEOUT_S),
            pytest.raises(InvalidStatus, match="429"),
        ):
            connect(server.url, open_timeout=TIMEOUT_S)
        with connect(server.url, open_timeout=TIMEOUT_S) as socket:  # a place is free again
            socket.ping().wait(TIMEOUT_S)


def test_a_visitor_that_sends_too_fast_is_answered_completely(
    local_node: LocalNode, make_raw_client: Callable[..., RawClient], from_elsewhere: None
) -> None:
    local_node.create_service("/echo", "test/Echo", lambda request: {"number": request["number"]})
    with RosbridgeServer(local_node, port=0, visitor_limits=VisitorLimits(messages_per_second=100)) as server:
        with connect(server.url, open_timeout=TIMEOUT_S) as socket:
            for number in range(440):  # 400 at once, the others at the rate
                call = {"op": "call_service", "service": "/echo", "args": {"number": number}, "id": str(number)}
                socket.send(json.dumps(call))
            answers = [json.loads(socket.recv(TIMEOUT_S)) for _ in range(440)]
        assert [answer["values"]["number"] for answer in answers] == list(range(440))
