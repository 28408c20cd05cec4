"""The server: who may come in, and what becomes of those who ask too much."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable
from typing import Any

import msgspec
import pytest
from websockets.exceptions import InvalidStatus

from mindstage.bridge import Hub, Limits, Server
from mindstage.bridge.access import Access, is_loopback
from mindstage.bridge.protocol import Auth
from mindstage.errors import AccessRefused, BridgeUnavailable

from .talking import PATIENCE_S, Talker, bare_subscriber, eventually

Talkers = Callable[..., Talker]


def greet(hub: Hub) -> None:
    hub.offer_service("/settle", "x/X", lambda _: {"hello": True})


# -- the door ----------------------------------------------------------------------------------------------------------


def test_only_this_machine_is_served_unless_there_is_a_token(hub: Hub) -> None:
    assert Server(hub).host == "127.0.0.1"
    for host in ("0.0.0.0", "::", "", "192.168.1.2", "robot.local"):
        for token in (None, ""):
            with pytest.raises(AccessRefused, match="give a token, or serve at 127"):
                Server(hub, host=host, token=token)
    Server(hub, host="0.0.0.0", token="secret")


@pytest.mark.parametrize("host", ["127.0.0.1", "127.8.9.1", "::1", "[::1]", "localhost", "LOCALHOST"])
def test_this_machine_has_several_names(host: str) -> None:
    assert is_loopback(host)


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "", "10.0.0.1", "localhost.evil.example", "127.0.0.1.evil.example"])
def test_other_names_are_not_this_machine(host: str) -> None:
    assert not is_loopback(host)


def test_an_address_that_cannot_be_had_is_named(hub: Hub, server: Server) -> None:
    for host, port in [("127.0.0.1", server.port), ("127.0.0.1", 99999), ("192.0.2.1", 0), ("no.such.host.invalid", 0)]:
        with pytest.raises(BridgeUnavailable, match="or another port"):
            Server(hub, host=host, port=port, token="secret").start()


def test_closing_twice_and_opening_again(hub: Hub, talker: Talkers) -> None:
    greet(hub)
    server = Server(hub, port=0).start()
    client = talker(server.url)
    assert client.ask("/settle")["result"]
    server.close()
    server.close()
    assert client.closed() == (1001, "the server is closing")
    assert server.clients == 0
    with server:
        assert talker(server.url).ask("/settle")["result"]


def test_two_doors_lead_to_one_hub(hub: Hub, server: Server, talker: Talkers) -> None:
    greet(hub)
    with Server(hub, port=0, token="secret") as other:
        listener, speaker = talker(), talker(f"{other.url}/?token=secret")
        listener.say(op="subscribe", topic="/words")
        listener.ask("/settle")
        speaker.say(op="advertise", topic="/words", type="x/Words")
        speaker.say(op="publish", topic="/words", msg={"data": 1})
        assert listener.hear("publish")["msg"] == {"data": 1}


# -- tokens ------------------------------------------------------------------------------------------------------------

SECRET = "a s3cret/+&é"


@pytest.fixture
def locked(hub: Hub) -> Any:
    greet(hub)
    with Server(hub, port=0, token=SECRET) as server:
        yield server


def proof(token: str, now_s: int, **changes: Any) -> dict[str, Any]:
    """rosauth's: the hash of the token and everything else, in this order."""
    fields = {"client": "me", "dest": "you", "rand": "42", "t": now_s, "level": "admin", "end": now_s + 60}
    text = token + "".join(str(each) for each in fields.values())
    return fields | {"mac": hashlib.sha512(text.encode()).hexdigest()} | changes


def test_a_token_in_the_address_or_the_header_opens(locked: Server, talker: Talkers) -> None:
    assert talker(f"{locked.url}/?token=a%20s3cret%2F%2B%26%C3%A9").ask("/settle")["result"]
    header = {"Authorization": f"Bearer {SECRET}"}
    assert talker(locked.url, additional_headers=header).ask("/settle")["result"]


def test_a_token_in_an_auth_opens(locked: Server, talker: Talkers) -> None:
    client = talker(locked.url)
    client.say(op="auth", token=SECRET)
    assert client.ask("/settle")["result"]
    client = talker(locked.url)
    client.say(op="auth", **proof(SECRET, int(time.time())))
    assert client.ask("/settle")["result"]


@pytest.mark.parametrize("path", ["/?token=wrong", "/?token=", "/x?a=b&token=wrong", f"/?token=wrong&token={SECRET}"])
def test_a_wrong_token_in_the_address_is_refused_at_the_door(locked: Server, talker: Talkers, path: str) -> None:
    with pytest.raises(InvalidStatus, match="401"):
        talker(locked.url + path)


@pytest.mark.parametrize("header", ["Bearer wrong", "Bearer", "Basic abc"])
def test_a_wrong_token_in_the_header_is_refused_at_the_door(locked: Server, talker: Talkers, header: str) -> None:
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
def test_a_wrong_auth_ends_the_connection(locked: Server, talker: Talkers, auth: dict[str, Any]) -> None:
    client = talker(locked.url)
    client.say(op="auth", **auth)
    assert client.hear("status")["msg"] == "that is not the token"
    assert client.closed() == (1008, "that is not the token")


def test_nothing_else_is_heard_from_a_stranger(hub: Hub, locked: Server, talker: Talkers) -> None:
    client = talker(locked.url)
    client.say(op="advertise_service", service="/mine", type="x/X")
    code, reason = client.closed()
    assert code == 1008
    assert "a token is needed" in reason
    assert [each.name for each in hub.directory().services] == ["/settle"]


def test_a_stranger_who_says_nothing_is_sent_away(talker: Talkers) -> None:
    with Hub(limits=Limits(sign_in_s=0.05)) as hub, Server(hub, port=0, token=SECRET) as server:
        greet(hub)
        assert talker(server.url).closed() == (1008, "no token was shown in time")
        friend = talker(server.url)
        friend.say(op="auth", token=SECRET)
        time.sleep(0.1)
        assert friend.ask("/settle")["result"]


def test_a_stranger_cannot_fill_the_memory(locked: Server, talker: Talkers) -> None:
    stranger, friend = talker(locked.url), talker(locked.url)
    stranger.say(op="auth", token="x" * 100_000)
    assert stranger.closed()[0] == 1009
    friend.say(op="auth", token=SECRET)
    friend.ask("/settle")
    assert friend.ask("/settle", {"large": "x" * 1_000_000})["result"]


def test_an_open_server_takes_any_auth_kindly(hub: Hub, talker: Talkers, server: Server) -> None:
    greet(hub)
    client = talker()
    client.say(op="auth", token="whatever")
    assert client.ask("/settle")["result"]


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
    hub: Hub, talker: Talkers, origin: str, admitted: bool
) -> None:
    greet(hub)
    with Server(hub, port=0, origins=["https://robot.example"]) as server:
        if admitted:
            assert talker(server.url, origin=origin).ask("/settle")["result"]
        else:
            with pytest.raises(InvalidStatus, match="403"):
                talker(server.url, origin=origin)


def test_a_page_that_was_opened_as_a_file_may_come_in_where_that_is_wanted(hub: Hub, talker: Talkers) -> None:
    greet(hub)
    with Server(hub, port=0, origins=["null"]) as server:
        assert talker(server.url, origin="null").ask("/settle")["result"]


def test_a_page_of_the_very_host_may_come_in_only_where_a_token_protects_it() -> None:
    # Whoever owns a name can let it point here, and then page and host have the same name.
    at_home = Access(host="127.0.0.1", token=None, origins=())
    abroad = Access(host="0.0.0.0", token="secret", origins=())
    assert not at_home.admits_page("http://rebound.example", "rebound.example:9090")
    assert abroad.admits_page("http://robot.local", "robot.local:9090")
    assert not abroad.admits_page("http://other.local", "robot.local:9090")
    assert not abroad.admits_page("http://", "")


def test_a_proof_without_a_token_to_prove_is_none() -> None:
    access = Access(host="127.0.0.1", token=None, origins=())
    now = int(time.time())
    assert not access.proven_by(msgspec.convert(proof("", now), Auth), now)
    assert not access.proven_by(Auth(token=""), now)


# -- limits ------------------------------------------------------------------------------------------------------------


def test_only_so_many_clients_may_be_here(talker: Talkers) -> None:
    with Hub(limits=Limits(connections=2)) as hub, Server(hub, port=0) as server:
        greet(hub)
        first, _ = talker(server.url), talker(server.url)
        with pytest.raises(InvalidStatus, match="503"):
            talker(server.url)
        first.close()
        eventually(lambda: server.clients == 1)
        assert talker(server.url).ask("/settle")["result"]


def test_a_message_that_is_too_large_ends_its_connection_only(talker: Talkers) -> None:
    with Hub(limits=Limits(message_bytes=10_000)) as hub, Server(hub, port=0) as server:
        greet(hub)
        large, other = talker(server.url), talker(server.url)
        large.send("x" * 10_001)
        assert large.closed()[0] == 1009
        assert other.ask("/settle")["result"]


def test_fragments_that_stop_coming_are_forgotten_with_a_remark(talker: Talkers) -> None:
    with Hub(limits=Limits(fragment_age_s=0.05)) as hub, Server(hub, port=0) as server:
        client = talker(server.url)
        client.say(op="fragment", id="f", data="{", num=0, total=2)
        assert "did not come in time" in client.hear("status", id="f")["msg"]


def test_one_who_does_not_read_is_dropped_and_nobody_else_notices(talker: Talkers) -> None:
    with Hub(limits=Limits(waiting_messages=200)) as hub, Server(hub, port=0) as server:
        greet(hub)
        reader = talker(server.url)
        sleeper = bare_subscriber(server.port)
        reader.say(op="subscribe", topic="/noise")
        reader.ask("/settle")
        eventually(lambda: len(hub.directory().topics[0].subscribers) == 2)
        number = 0
        while server.clients == 2:
            assert number < 100_000
            for _ in range(20):
                hub.publish("/noise", "x/Noise", {"n": number, "noise": "x" * 20_000})
                number += 1
            reader.hear("publish", msg={"n": number - 1, "noise": "x" * 20_000})
            reader.heard.clear()
        assert reader.ask("/settle")["result"]
        assert len(hub.directory().topics[0].subscribers) == 1
        sleeper.close()


def test_one_who_reads_slowly_but_has_a_queue_stays_and_hears_the_newest(talker: Talkers) -> None:
    with Hub(limits=Limits(waiting_messages=2000)) as hub, Server(hub, port=0) as server:
        greet(hub)
        sleeper = bare_subscriber(server.port, queue_length=1)
        eventually(lambda: hub.has_listeners("/noise"))
        for number in range(3000):
            hub.publish("/noise", "x/Noise", {"n": number, "noise": "x" * 20_000})
        hub.directory()
        assert server.clients == 1
        data = bytearray()
        sleeper.settimeout(PATIENCE_S)
        while b'"n":2999,' not in data[-100_000:]:
            data += sleeper.recv(1 << 16)
        assert data.count(b'"n":') < 2000
        sleeper.close()
