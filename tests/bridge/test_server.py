"""The server: who may come in, and what becomes of those who ask too much."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable
from typing import Any

import msgspec
import pytest
from websockets.exceptions import InvalidStatus

from mindstage.bridge import BridgeLimits, LocalNode, RosbridgeServer
from mindstage.bridge.protocol import Auth
from mindstage.bridge.server import TokenAuth, is_loopback
from mindstage.errors import AuthenticationError, BridgeUnavailableError
from tests.bridge.talking import TIMEOUT_S, RawClient, eventually, raw_subscriber

Talkers = Callable[..., RawClient]


def greet(hub: LocalNode) -> None:
    hub.create_service("/settle", "x/X", lambda _: {"hello": True})


# -- the door ----------------------------------------------------------------------------------------------------------


def test_only_this_machine_is_served_unless_there_is_a_token(hub: LocalNode) -> None:
    assert RosbridgeServer(hub).host == "127.0.0.1"
    for host in ("0.0.0.0", "::", "", "192.168.1.2", "robot.local"):
        for token in (None, ""):
            with pytest.raises(AuthenticationError, match="give a token, or serve at 127"):
                RosbridgeServer(hub, host=host, token=token)
    RosbridgeServer(hub, host="0.0.0.0", token="secret")


@pytest.mark.parametrize("host", ["127.0.0.1", "127.8.9.1", "::1", "[::1]", "localhost", "LOCALHOST"])
def test_this_machine_has_several_names(host: str) -> None:
    assert is_loopback(host)


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "", "10.0.0.1", "localhost.evil.example", "127.0.0.1.evil.example"])
def test_other_names_are_not_this_machine(host: str) -> None:
    assert not is_loopback(host)


def test_an_address_that_cannot_be_had_is_named(hub: LocalNode, server: RosbridgeServer) -> None:
    for host, port in [("127.0.0.1", server.port), ("127.0.0.1", 99999), ("192.0.2.1", 0), ("no.such.host.invalid", 0)]:
        with pytest.raises(BridgeUnavailableError, match="or another port"):
            RosbridgeServer(hub, host=host, port=port, token="secret").start()


def test_closing_twice_and_opening_again(hub: LocalNode, talker: Talkers) -> None:
    greet(hub)
    server = RosbridgeServer(hub, port=0).start()
    client = talker(server.url)
    assert client.call_service("/settle")["result"]
    server.close()
    server.close()
    assert client.wait_closed() == (1001, "the server is closing")
    assert server.client_count == 0
    with server:
        assert talker(server.url).call_service("/settle")["result"]


def test_two_doors_lead_to_one_hub(hub: LocalNode, server: RosbridgeServer, talker: Talkers) -> None:
    greet(hub)
    with RosbridgeServer(hub, port=0, token="secret") as other:
        listener, speaker = talker(), talker(f"{other.url}/?token=secret")
        listener.send_operation(op="subscribe", topic="/words")
        listener.call_service("/settle")
        speaker.send_operation(op="advertise", topic="/words", type="x/Words")
        speaker.send_operation(op="publish", topic="/words", msg={"data": 1})
        assert listener.receive("publish")["msg"] == {"data": 1}


# -- tokens ------------------------------------------------------------------------------------------------------------

SECRET = "a s3cret/+&é"


@pytest.fixture
def locked(hub: LocalNode) -> Any:
    greet(hub)
    with RosbridgeServer(hub, port=0, token=SECRET) as server:
        yield server


def proof(token: str, now_s: int, **changes: Any) -> dict[str, Any]:
    """rosauth's: the hash of the token and everything else, in this order."""
    fields = {"client": "me", "dest": "you", "rand": "42", "t": now_s, "level": "admin", "end": now_s + 60}
    text = token + "".join(str(each) for each in fields.values())
    return fields | {"mac": hashlib.sha512(text.encode()).hexdigest()} | changes


def test_a_token_in_the_address_or_the_header_opens(locked: RosbridgeServer, talker: Talkers) -> None:
    assert talker(f"{locked.url}/?token=a%20s3cret%2F%2B%26%C3%A9").call_service("/settle")["result"]
    header = {"Authorization": f"Bearer {SECRET}"}
    assert talker(locked.url, additional_headers=header).call_service("/settle")["result"]


def test_a_token_in_an_auth_opens(locked: RosbridgeServer, talker: Talkers) -> None:
    client = talker(locked.url)
    client.send_operation(op="auth", token=SECRET)
    assert client.call_service("/settle")["result"]
    client = talker(locked.url)
    client.send_operation(op="auth", **proof(SECRET, int(time.time())))
    assert client.call_service("/settle")["result"]


@pytest.mark.parametrize("path", ["/?token=wrong", "/?token=", "/x?a=b&token=wrong", f"/?token=wrong&token={SECRET}"])
def test_a_wrong_token_in_the_address_is_refused_at_the_door(
    locked: RosbridgeServer, talker: Talkers, path: str
) -> None:
    with pytest.raises(InvalidStatus, match="401"):
        talker(locked.url + path)


@pytest.mark.parametrize("header", ["Bearer wrong", "Bearer", "Basic abc"])
def test_a_wrong_token_in_the_header_is_refused_at_the_door(
    locked: RosbridgeServer, talker: Talkers, header: str
) -> None:
    with pytest.raises(InvalidStatus, match="401"):
        talker(locked.url, additional_headers={"Authorization": header})


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
def test_a_wrong_auth_ends_the_connection(locked: RosbridgeServer, talker: Talkers, auth: dict[str, Any]) -> None:
    client = talker(locked.url)
    client.send_operation(op="auth", **auth)
    assert client.receive("status")["msg"] == "invalid token"
    assert client.wait_closed() == (1008, "invalid token")


def test_nothing_else_is_heard_from_a_stranger(hub: LocalNode, locked: RosbridgeServer, talker: Talkers) -> None:
    client = talker(locked.url)
    client.send_operation(op="advertise_service", service="/mine", type="x/X")
    code, reason = client.wait_closed()
    assert code == 1008
    assert "a token is required" in reason
    assert [each.name for each in hub.graph_info().services] == ["/settle"]


def test_a_stranger_who_says_nothing_is_sent_away(talker: Talkers) -> None:
    with (
        LocalNode(limits=BridgeLimits(auth_timeout_s=0.05)) as hub,
        RosbridgeServer(hub, port=0, token=SECRET) as server,
    ):
        greet(hub)
        assert talker(server.url).wait_closed() == (1008, "no token was sent in time")
        friend = talker(server.url)
        friend.send_operation(op="auth", token=SECRET)
        time.sleep(0.1)
        assert friend.call_service("/settle")["result"]


def test_a_stranger_cannot_fill_the_memory(locked: RosbridgeServer, talker: Talkers) -> None:
    stranger, friend = talker(locked.url), talker(locked.url)
    stranger.send_operation(op="auth", token="x" * 100_000)
    assert stranger.wait_closed()[0] == 1009
    friend.send_operation(op="auth", token=SECRET)
    friend.call_service("/settle")
    assert friend.call_service("/settle", {"large": "x" * 1_000_000})["result"]


def test_an_open_server_takes_any_auth_kindly(hub: LocalNode, talker: Talkers, server: RosbridgeServer) -> None:
    greet(hub)
    client = talker()
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
def test_pages_of_this_machine_and_of_the_list_may_come_in(
    hub: LocalNode, talker: Talkers, origin: str, admitted: bool
) -> None:
    greet(hub)
    with RosbridgeServer(hub, port=0, origins=["https://robot.example"]) as server:
        if admitted:
            assert talker(server.url, origin=origin).call_service("/settle")["result"]
        else:
            with pytest.raises(InvalidStatus, match="403"):
                talker(server.url, origin=origin)


def test_a_page_that_was_opened_as_a_file_may_come_in_where_that_is_wanted(hub: LocalNode, talker: Talkers) -> None:
    greet(hub)
    with RosbridgeServer(hub, port=0, origins=["null"]) as server:
        assert talker(server.url, origin="null").call_service("/settle")["result"]


def test_a_page_of_the_very_host_may_come_in_only_where_a_token_protects_it() -> None:
    # Whoever owns a name can let it point here, and then page and host have the same name.
    at_home = TokenAuth(host="127.0.0.1", token=None, origins=())
    abroad = TokenAuth(host="0.0.0.0", token="secret", origins=())
    assert not at_home.allows_origin("http://rebound.example", "rebound.example:9090")
    assert abroad.allows_origin("http://robot.local", "robot.local:9090")
    assert not abroad.allows_origin("http://other.local", "robot.local:9090")
    assert not abroad.allows_origin("http://", "")


def test_a_proof_without_a_token_to_prove_is_none() -> None:
    access = TokenAuth(host="127.0.0.1", token=None, origins=())
    now = int(time.time())
    assert not access.check_auth(msgspec.convert(proof("", now), Auth), now)
    assert not access.check_auth(Auth(token=""), now)


# -- limits ------------------------------------------------------------------------------------------------------------


def test_only_so_many_clients_may_be_here(talker: Talkers) -> None:
    with LocalNode(limits=BridgeLimits(connections=2)) as hub, RosbridgeServer(hub, port=0) as server:
        greet(hub)
        first, _ = talker(server.url), talker(server.url)
        with pytest.raises(InvalidStatus, match="503"):
            talker(server.url)
        first.close()
        eventually(lambda: server.client_count == 1)
        assert talker(server.url).call_service("/settle")["result"]


def test_a_message_that_is_too_large_ends_its_connection_only(talker: Talkers) -> None:
    with LocalNode(limits=BridgeLimits(message_bytes=10_000)) as hub, RosbridgeServer(hub, port=0) as server:
        greet(hub)
        large, other = talker(server.url), talker(server.url)
        large.send("x" * 10_001)
        assert large.wait_closed()[0] == 1009
        assert other.call_service("/settle")["result"]


def test_fragments_that_stop_coming_are_forgotten_with_a_remark(talker: Talkers) -> None:
    with LocalNode(limits=BridgeLimits(fragment_timeout_s=0.05)) as hub, RosbridgeServer(hub, port=0) as server:
        client = talker(server.url)
        client.send_operation(op="fragment", id="f", data="{", num=0, total=2)
        assert "did not arrive in time" in client.receive("status", id="f")["msg"]


def test_one_who_does_not_read_is_dropped_and_nobody_else_notices(talker: Talkers) -> None:
    with LocalNode(limits=BridgeLimits(waiting_messages=200)) as hub, RosbridgeServer(hub, port=0) as server:
        greet(hub)
        reader = talker(server.url)
        sleeper = raw_subscriber(server.port)
        reader.send_operation(op="subscribe", topic="/noise")
        reader.call_service("/settle")
        eventually(lambda: len(hub.graph_info().topics[0].subscribers) == 2)
        number = 0
        while server.client_count == 2:
            assert number < 100_000
            for _ in range(20):
                hub.publish("/noise", "x/Noise", {"n": number, "noise": "x" * 20_000})
                number += 1
            reader.receive("publish", msg={"n": number - 1, "noise": "x" * 20_000})
            reader.received.clear()
        assert reader.call_service("/settle")["result"]
        assert len(hub.graph_info().topics[0].subscribers) == 1
        sleeper.close()


def test_one_who_reads_slowly_but_has_a_queue_stays_and_hears_the_newest(talker: Talkers) -> None:
    with LocalNode(limits=BridgeLimits(waiting_messages=2000)) as hub, RosbridgeServer(hub, port=0) as server:
        greet(hub)
        sleeper = raw_subscriber(server.port, queue_length=1)
        eventually(lambda: hub.has_subscribers("/noise"))
        for number in range(3000):
            hub.publish("/noise", "x/Noise", {"n": number, "noise": "x" * 20_000})
        hub.graph_info()
        assert server.client_count == 1
        data = bytearray()
        sleeper.settimeout(TIMEOUT_S)
        while b'"n":2999,' not in data[-100_000:]:
            data += sleeper.recv(1 << 16)
        assert data.count(b'"n":') < 2000
        sleeper.close()
