"""Server: authentication, origins and limits."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable
from http.client import HTTPConnection
from typing import Any

import pytest
from websockets.exceptions import InvalidStatus

from mindstage.access.gate import Gate
from mindstage.access.limits import BridgeLimits
from mindstage.access.visitors import is_loopback
from mindstage.bridge import LocalNode, RosbridgeServer
from mindstage.errors import AuthenticationError, BridgeUnavailableError
from tests.bridge.raw_client import TIMEOUT_S, RawClient, eventually, raw_subscriber
from tests.cases import each_case

RawClientFactory = Callable[..., RawClient]


def greet(local_node: LocalNode) -> None:
    local_node.create_service("/settle", "x/X", lambda _: {"hello": True})


# -- the door ----------------------------------------------------------------------------------------------------------


def test_other_hosts_require_a_token(local_node: LocalNode) -> None:
    assert RosbridgeServer(local_node).host == "127.0.0.1"
    for host in ("0.0.0.0", "::", "", "192.168.1.2", "robot.local"):
        for token in (None, ""):
            with pytest.raises(AuthenticationError, match="give a token, or serve at 127"):
                RosbridgeServer(local_node, host=host, token=token)
    RosbridgeServer(local_node, host="0.0.0.0", token="secret")


@each_case("host", ["127.0.0.1", "127.8.9.1", "::1", "[::1]", "localhost", "LOCALHOST"])
def test_loopback_hosts_are_recognized(host: str) -> None:
    assert is_loopback(host)


@each_case("host", ["0.0.0.0", "::", "", "10.0.0.1", "localhost.evil.example", "127.0.0.1.evil.example"])
def test_other_hosts_are_not_loopback(host: str) -> None:
    assert not is_loopback(host)


def test_an_unavailable_address_is_named_in_the_error(local_node: LocalNode, server: RosbridgeServer) -> None:
    for host, port in [("127.0.0.1", server.port), ("192.0.2.1", 0), ("no.such.host.invalid", 0)]:
        with pytest.raises(BridgeUnavailableError, match="or another port"):
            RosbridgeServer(local_node, host=host, port=port, token="secret").start()


def test_closing_twice_is_harmless_and_a_server_can_restart(
    local_node: LocalNode, make_raw_client: RawClientFactory
) -> None:
    greet(local_node)
    server = RosbridgeServer(local_node, port=0).start()
    client = make_raw_client(server.url)
    assert client.call_service("/settle")["result"]
    server.close()
    server.close()
    assert client.wait_closed() == (1001, "the server is closing")
    assert server.client_count == 0
    with server:
        assert make_raw_client(server.url).call_service("/settle")["result"]


def test_two_servers_can_share_a_node(
    local_node: LocalNode, server: RosbridgeServer, make_raw_client: RawClientFactory
) -> None:
    greet(local_node)
    with RosbridgeServer(local_node, port=0, token="secret") as other:
        subscriber, publisher = make_raw_client(), make_raw_client(f"{other.url}/?token=secret")
        subscriber.send_operation(op="subscribe", topic="/words")
        subscriber.call_service("/settle")
        publisher.send_operation(op="advertise", topic="/words", type="x/Words")
        publisher.send_operation(op="publish", topic="/words", msg={"data": 1})
        assert subscriber.receive("publish")["msg"] == {"data": 1}


# -- tokens ------------------------------------------------------------------------------------------------------------

SECRET = "a s3cret/+&é"


@pytest.fixture
def locked(local_node: LocalNode) -> Any:
    greet(local_node)
    with RosbridgeServer(local_node, port=0, token=SECRET) as server:
        yield server


def proof(token: str, now_s: int, **changes: Any) -> dict[str, Any]:
    """Returns rosauth's hash of the token and the other fields, in this order."""
    fields = {"client": "me", "dest": "you", "rand": "42", "t": now_s, "level": "admin", "end": now_s + 60}
    text = token + "".join(str(each) for each in fields.values())
    return fields | {"mac": hashlib.sha512(text.encode()).hexdigest()} | changes


def test_a_token_in_the_url_or_the_header_is_accepted(
    locked: RosbridgeServer, make_raw_client: RawClientFactory
) -> None:
    assert make_raw_client(f"{locked.url}/?token=a%20s3cret%2F%2B%26%C3%A9").call_service("/settle")["result"]
    header = {"Authorization": f"Bearer {SECRET}"}
    assert make_raw_client(locked.url, additional_headers=header).call_service("/settle")["result"]


def test_a_token_in_an_auth_operation_is_accepted(locked: RosbridgeServer, make_raw_client: RawClientFactory) -> None:
    client = make_raw_client(locked.url)
    client.send_operation(op="auth", token=SECRET)
    assert client.call_service("/settle")["result"]
    client = make_raw_client(locked.url)
    client.send_operation(op="auth", **proof(SECRET, int(time.time())))
    assert client.call_service("/settle")["result"]


@pytest.mark.parametrize("path", ["/?token=wrong", "/?token=", "/x?a=b&token=wrong", f"/?token=wrong&token={SECRET}"])
def test_a_wrong_token_in_the_url_rejects_the_handshake(
    locked: RosbridgeServer, make_raw_client: RawClientFactory, path: str
) -> None:
    with pytest.raises(InvalidStatus, match="401"):
        make_raw_client(locked.url + path)


@pytest.mark.parametrize("header", ["Bearer wrong", "Bearer", "Basic abc"])
def test_a_wrong_token_in_the_header_rejects_the_handshake(
    locked: RosbridgeServer, make_raw_client: RawClientFactory, header: str
) -> None:
    with pytest.raises(InvalidStatus, match="401"):
        make_raw_client(locked.url, additional_headers={"Authorization": header})


@pytest.mark.parametrize(
    "auth",
    [
        {"token": "wrong"},
        {"token": ""},
        {},
        proof("wrong", int(time.time())),
        proof(SECRET, int(time.time()) - 3600),
        proof(SECRET, int(time.time()), end=0),
        proof(SECRET, int(time.time()), level="root"),
    ],
)
def test_a_wrong_auth_ends_the_connection(
    locked: RosbridgeServer, make_raw_client: RawClientFactory, auth: dict[str, Any]
) -> None:
    client = make_raw_client(locked.url)
    client.send_operation(op="auth", **auth)
    assert client.receive("status")["msg"] == "invalid token"
    assert client.wait_closed() == (1008, "invalid token")


def test_other_operations_before_authentication_are_rejected(
    local_node: LocalNode, locked: RosbridgeServer, make_raw_client: RawClientFactory
) -> None:
    client = make_raw_client(locked.url)
    client.send_operation(op="advertise_service", service="/mine", type="x/X")
    code, reason = client.wait_closed()
    assert code == 1008
    assert "a token is required" in reason
    assert [each.name for each in local_node.graph_info().services] == ["/settle"]


def test_a_client_that_does_not_authenticate_is_disconnected(make_raw_client: RawClientFactory) -> None:
    with (
        LocalNode(limits=BridgeLimits(auth_timeout_s=3.0)) as local_node,
        RosbridgeServer(local_node, port=0, token=SECRET) as server,
    ):
        greet(local_node)
        friend = make_raw_client(server.url)
        friend.send_operation(op="auth", token=SECRET)
        assert friend.call_service("/settle")["result"]
        assert make_raw_client(server.url).wait_closed() == (1008, "no token was sent in time")
        assert friend.call_service("/settle")["result"]  # its time has passed, too


def test_messages_before_authentication_are_limited(locked: RosbridgeServer, make_raw_client: RawClientFactory) -> None:
    other_client, friend = make_raw_client(locked.url), make_raw_client(locked.url)
    other_client.send_operation(op="auth", token="x" * 100_000)
    assert other_client.wait_closed()[0] == 1009
    friend.send_operation(op="auth", token=SECRET)
    friend.call_service("/settle")
    assert friend.call_service("/settle", {"large": "x" * 1_000_000})["result"]


def test_a_server_without_a_token_accepts_any_auth(
    local_node: LocalNode, make_raw_client: RawClientFactory, server: RosbridgeServer
) -> None:
    greet(local_node)
    client = make_raw_client()
    client.send_operation(op="auth", token="whatever")
    assert client.call_service("/settle")["result"]


# -- pages -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("origin", "admitted"),
    [
        ("http://localhost:8080", True),
        ("http://127.0.0.1", True),
        ("http://[::1]:3000", True),
        ("https://robot.example", True),
        ("https://ROBOT.example/", True),
        ("https://evil.example", False),
        ("http://robot.example", False),
        ("http://localhost.evil.example", False),
        ("null", False),
        ("http://[", False),
        ("", False),
    ],
)
def test_pages_of_this_machine_and_listed_origins_may_connect(
    local_node: LocalNode, make_raw_client: RawClientFactory, origin: str, admitted: bool
) -> None:
    greet(local_node)
    with RosbridgeServer(local_node, port=0, origins=["https://robot.example"]) as server:
        if admitted:
            assert make_raw_client(server.url, origin=origin).call_service("/settle")["result"]
        else:
            with pytest.raises(InvalidStatus, match="403"):
                make_raw_client(server.url, origin=origin)


def test_pages_opened_as_files_may_connect_if_listed(local_node: LocalNode, make_raw_client: RawClientFactory) -> None:
    greet(local_node)
    with RosbridgeServer(local_node, port=0, origins=["null"]) as server:
        assert make_raw_client(server.url, origin="null").call_service("/settle")["result"]


def test_pages_of_the_same_host_may_connect_only_with_a_token() -> None:
    def status(gate: Gate, origin: str, host: str, path: str = "/") -> int:
        denial = gate.socket_denial(path, {"Origin": origin, "Host": host}, gate.visitors.visitor(None), 0.0)
        return 200 if denial is None else denial.status

    # The owner of a host name can let it resolve to this machine; origin and host are then equal.
    at_home = Gate(host="127.0.0.1", local_pages=True)
    abroad = Gate(host="0.0.0.0", token="secret", local_pages=True)
    assert status(at_home, "http://rebound.example", "rebound.example:9090") == 421
    assert status(abroad, "http://robot.local", "robot.local:9090", "/?token=secret") == 200
    assert status(abroad, "http://other.local", "robot.local:9090", "/?token=secret") == 403
    assert status(abroad, "http://", "robot.local:9090", "/?token=secret") == 403


@pytest.mark.parametrize("host", ["rebound.example", "rebound.example:9090", "192.168.1.7:9090"])
def test_a_host_name_of_another_machine_is_refused(local_node: LocalNode, host: str) -> None:
    with RosbridgeServer(local_node, port=0) as server:
        client = HTTPConnection("127.0.0.1", server.port, timeout=TIMEOUT_S)
        key = {"Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==", "Sec-WebSocket-Version": "13"}
        client.request("GET", "/", headers={"Host": host, "Upgrade": "websocket", "Connection": "Upgrade", **key})
        assert client.getresponse().status == 421


# -- limits ------------------------------------------------------------------------------------------------------------


def test_the_number_of_clients_is_limited(make_raw_client: RawClientFactory) -> None:
    with LocalNode(limits=BridgeLimits(connections=2)) as local_node, RosbridgeServer(local_node, port=0) as server:
        greet(local_node)
        first, _ = make_raw_client(server.url), make_raw_client(server.url)
        with pytest.raises(InvalidStatus, match="503"):
            make_raw_client(server.url)
        first.close()
        eventually(lambda: server.client_count == 1)
        assert make_raw_client(server.url).call_service("/settle")["result"]


def test_a_message_that_is_too_large_closes_only_its_connection(make_raw_client: RawClientFactory) -> None:
    with (
        LocalNode(limits=BridgeLimits(message_bytes=10_000)) as local_node,
        RosbridgeServer(local_node, port=0) as server,
    ):
        greet(local_node)
        large, other = make_raw_client(server.url), make_raw_client(server.url)
        large.send("x" * 10_001)
        assert large.wait_closed()[0] == 1009
        assert other.call_service("/settle")["result"]


def test_incomplete_fragments_expire_with_a_status(make_raw_client: RawClientFactory) -> None:
    with (
        LocalNode(limits=BridgeLimits(fragment_timeout_s=0.05)) as local_node,
        RosbridgeServer(local_node, port=0) as server,
    ):
        client = make_raw_client(server.url)
        client.send_operation(op="fragment", id="f", data="{", num=0, total=2)
        assert "did not arrive in time" in client.receive("status", id="f")["msg"]


def test_a_client_that_does_not_read_is_disconnected(make_raw_client: RawClientFactory) -> None:
    with (
        LocalNode(limits=BridgeLimits(waiting_messages=200)) as local_node,
        RosbridgeServer(local_node, port=0) as server,
    ):
        greet(local_node)
        reader = make_raw_client(server.url)
        sleeper = raw_subscriber(server.port)
        reader.send_operation(op="subscribe", topic="/noise")
        reader.call_service("/settle")
        eventually(lambda: len(local_node.graph_info().topics[0].subscribers) == 2)
        number = 0
        while server.client_count == 2:
            assert number < 100_000
            for _ in range(20):
                local_node.publish("/noise", "x/Noise", {"n": number, "noise": "x" * 20_000})
                number += 1
            reader.receive("publish", msg={"n": number - 1, "noise": "x" * 20_000})
            reader.received.clear()
        assert reader.call_service("/settle")["result"]
        assert len(local_node.graph_info().topics[0].subscribers) == 1
        sleeper.close()


def test_a_slow_client_with_a_queue_receives_the_newest_messages(make_raw_client: RawClientFactory) -> None:
    with (
        LocalNode(limits=BridgeLimits(waiting_messages=2000)) as local_node,
        RosbridgeServer(local_node, port=0) as server,
    ):
        greet(local_node)
        sleeper = raw_subscriber(server.port, queue_length=1)
        eventually(lambda: local_node.has_subscribers("/noise"))
        for number in range(3000):
            local_node.publish("/noise", "x/Noise", {"n": number, "noise": "x" * 20_000})
        local_node.graph_info()
        assert server.client_count == 1
        data = bytearray()
        sleeper.settimeout(TIMEOUT_S)
        while b'"n":2999,' not in data[-100_000:]:
            data += sleeper.recv(1 << 16)
        assert data.count(b'"n":') < 2000
        sleeper.close()
