"""The client: at somebody else's hub, through losses, and with the right error at once."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from websockets.sync.server import ServerConnection, serve

from mindstage.bridge import Client, Compression, Hub, LinkState, Participant, Server, Status
from mindstage.errors import (
    AccessRefused,
    BridgeError,
    ConnectionLost,
    ServiceFailed,
    ServiceTimedOut,
    ServiceUnknown,
)

from .talking import PATIENCE_S, eventually

Clients = Callable[..., Client]


def add(args: dict[str, int]) -> dict[str, int]:
    return {"sum": args["a"] + args["b"]}


def test_hub_and_client_take_part_in_the_same_way(hub: Hub, client: Clients) -> None:
    far = client()
    heard: list[Any] = []

    def take_part(one: Participant, other: Participant, name: str) -> None:
        one.offer_service(f"/{name}/add", "x/Add", add)
        one.subscribe(f"/{name}/words", heard.append)
        eventually(lambda: any(each.name == f"/{name}/add" for each in hub.directory().services))
        eventually(lambda: any(each.name == f"/{name}/words" for each in hub.directory().topics))
        assert other.call_service(f"/{name}/add", {"a": 1, "b": 2}) == {"sum": 3}
        other.publish(f"/{name}/words", "x/Words", {"from": name})
        eventually(lambda: {"from": name} in heard)

    take_part(hub, far, "here")
    take_part(far, hub, "there")


def test_each_way_to_fail_has_its_error(hub: Hub, client: Clients) -> None:
    def refuse(_: object) -> None:
        raise BridgeError("not today")

    hub.offer_service("/refuse", "x/X", refuse)
    hub.offer_service("/never", "x/X", lambda _: threading.Event().wait(1.0))
    far = client()
    with pytest.raises(ServiceFailed, match="/refuse failed: not today"):
        far.call_service("/refuse")
    with pytest.raises(ServiceUnknown, match="/nobody"):
        far.call_service("/nobody")
    with pytest.raises(ServiceTimedOut):
        far.call_service("/never", timeout_s=0.05)
    assert far.connected


@pytest.mark.parametrize("compression", Compression)
def test_messages_come_in_every_form(hub: Hub, client: Clients, compression: Compression) -> None:
    heard: list[Any] = []
    client().subscribe("/map", heard.append, compression=compression)
    eventually(lambda: hub.has_listeners("/map"))
    message = {"cells": [0.0, 0.5, 1.0] * 100, "name": "küche"}
    hub.publish("/map", "x/Map", message)
    eventually(lambda: heard == [message])


def test_a_client_waits_for_nobody_who_is_not_there() -> None:
    with Client(f"ws://127.0.0.1:{free_port()}") as client:
        with pytest.raises(ConnectionLost, match="Connect call failed"):
            eventually_raises(client)
        with pytest.raises(ConnectionLost):
            client.call_service("/add", timeout_s=PATIENCE_S)
        with pytest.raises(ConnectionLost):
            client.send_goal("/go", "x/Go").wait(PATIENCE_S)
        client.publish("/words", "x/Words", {})
        assert client.state is LinkState.CONNECTING
    assert client.state is LinkState.CLOSED
    with pytest.raises(BridgeError, match="closed"):
        client.call_service("/add")


def eventually_raises(client: Client) -> None:
    eventually(lambda: "Connect call failed" in str(client._cause))
    client.wait_connected(0.01)


@pytest.mark.parametrize("url", ["", "127.0.0.1:9090", "http://127.0.0.1:9090"])
def test_an_address_that_is_none_is_refused_at_once(url: str) -> None:
    with pytest.raises(ConnectionLost, match="must begin with ws://"):
        Client(url)


@pytest.mark.parametrize("url", ["ws://", "ws://127.0.0.1:99999"])
def test_an_address_that_nobody_can_have_ends_the_wait(url: str) -> None:
    with Client(url) as client, pytest.raises(ConnectionLost):
        client.wait_connected(0.2)


def test_a_loss_ends_what_waits_and_is_told_at_once(hub: Hub, server: Server, client: Clients) -> None:
    states: list[LinkState] = []
    called = threading.Event()

    def never(_: object) -> None:
        called.set()
        threading.Event().wait(2.0)

    hub.offer_service("/never", "x/X", never)
    hub.offer_action("/never", "x/X", lambda goal: goal.wait_for_cancel(PATIENCE_S))
    far = client(on_state=states.append)
    call = far.start_call("/never", timeout_s=600.0)
    goal = far.send_goal("/never", "x/X")
    assert called.wait(PATIENCE_S)
    server.close()
    with pytest.raises(ConnectionLost, match="the server is closing"):
        call.result(PATIENCE_S)
    with pytest.raises(ConnectionLost):
        goal.wait(PATIENCE_S)
    assert states[:2] == [LinkState.CONNECTED, LinkState.LOST]
    with pytest.raises(ConnectionLost):
        far.call_service("/never", timeout_s=600.0)


def test_a_client_comes_back_with_all_that_it_offered(hub: Hub, server: Server, client: Clients) -> None:
    far = client()
    heard: list[Any] = []
    far.offer_service("/far/add", "x/Add", add)
    far.offer_service("/far/gone", "x/Add", add)
    far.offer_action("/far/go", "x/Go", lambda goal: {"got": goal.args})
    far.advertise("/far/words", "x/Words")
    subscription = far.subscribe("/here/words", heard.append)
    far.subscribe("/here/silence", heard.append).close()
    far.withdraw_service("/far/gone")
    server.close()
    eventually(lambda: not hub.directory().services)
    server.start()
    far.wait_connected(PATIENCE_S)
    eventually(lambda: len(hub.directory().topics) == 2)
    told = hub.directory()
    assert [each.name for each in told.services] == ["/far/add"]
    assert [each.name for each in told.actions] == ["/far/go"]
    assert [each.name for each in told.topics] == ["/far/words", "/here/words"]
    assert hub.call_service("/far/add", {"a": 1, "b": 2}) == {"sum": 3}
    assert hub.send_goal("/far/go", "x/Go", {"to": 1}).wait(PATIENCE_S).values == {"got": {"to": 1}}
    hub.publish("/here/words", "x/Words", {"data": "again"})
    eventually(lambda: heard == [{"data": "again"}])
    subscription.close()


def test_it_tries_again_until_someone_is_there(hub: Hub) -> None:
    port = free_port()
    with Client(f"ws://127.0.0.1:{port}") as client:
        client.offer_service("/far/add", "x/Add", add)
        with Server(hub, port=port):
            client.wait_connected(PATIENCE_S)
            eventually(lambda: hub.directory().services)
            assert hub.call_service("/far/add", {"a": 1, "b": 2}) == {"sum": 3}


def test_the_stage_of_one_hub_can_serve_the_callers_of_another(hub: Hub, server: Server) -> None:
    with Hub() as other, Server(other, port=0) as others, Client(others.url) as bridge:
        bridge.wait_connected(PATIENCE_S)
        hub.offer_service("/here/add", "x/Add", add)
        bridge.offer_service("/here/add", "x/Add", lambda args: hub.call_service("/here/add", args))
        eventually(lambda: other.directory().services)
        with Client(others.url) as caller:
            caller.wait_connected(PATIENCE_S)
            assert caller.call_service("/here/add", {"a": 1, "b": 2}) == {"sum": 3}


def test_what_the_hub_remarks_is_heard(hub: Hub, client: Clients) -> None:
    remarks: list[Status] = []
    hub.offer_service("/ours", "x/X", add)
    far = client(on_status=remarks.append)
    far.offer_service("/ours", "x/X", add)
    eventually(lambda: remarks)
    assert "is the hub's own" in remarks[0].msg


def test_a_handler_that_breaks_breaks_no_connection(hub: Hub, server: Server, caplog: pytest.LogCaptureFixture) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError

    hub.offer_service("/add", "x/Add", add)
    hub.offer_action("/go", "x/Go", lambda goal: goal.feedback({}))
    with Client(server.url, on_state=broken, on_status=broken) as client:
        client.wait_connected(PATIENCE_S)
        client.offer_service("/add", "x/Add", add)  # which makes the hub remark something
        client.send_goal("/go", "x/Go", on_feedback=broken).wait(PATIENCE_S)
        assert client.call_service("/add", {"a": 1, "b": 2}) == {"sum": 3}
    for what in ("state", "status", "feedback"):
        assert f"the {what} handler" in caplog.text


def test_the_right_token_opens_and_another_does_not(hub: Hub) -> None:
    with Server(hub, port=0, token="öpen sesame") as server:
        with Client(server.url, token="öpen sesame") as client:
            hub.offer_service("/add", "x/Add", add)
            assert client.wait_connected(PATIENCE_S).call_service("/add", {"a": 1, "b": 2}) == {"sum": 3}
        with Client(server.url) as client, pytest.raises(AccessRefused, match="a token is needed"):
            client.wait_connected(PATIENCE_S)
        with Client(f"{server.url}/?token=%C3%B6pen%20sesame") as client:
            client.wait_connected(PATIENCE_S)
        with Client(server.url, token="close sesame") as client, pytest.raises(AccessRefused, match="not the token"):
            client.wait_connected(PATIENCE_S)


# -- at a hub that misbehaves ------------------------------------------------------------------------------------------


@pytest.fixture
def odd_hub() -> Iterator[Callable[[Callable[[ServerConnection], None]], str]]:
    """Makes servers of one function; gives their address."""
    servers = []

    def make(behave: Callable[[ServerConnection], None]) -> str:
        server = serve(behave, "127.0.0.1", 0)
        servers.append(server)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        return f"ws://127.0.0.1:{server.socket.getsockname()[1]}"

    yield make
    for server in servers:
        server.shutdown()


def test_garbage_late_and_double_answers_do_no_harm(odd_hub: Callable[..., str]) -> None:
    def behave(connection: ServerConnection) -> None:
        import json

        for frame in connection:
            call = json.loads(frame)
            answer = {"op": "service_response", "id": call["id"], "service": call["service"], "result": True}
            if call["service"] == "/late":
                continue
            for odd in ("no JSON", b"\xff", "[]", '{"op":"zip"}', json.dumps({**answer, "id": "made up"})):
                connection.send(odd)
            if call["service"] == "/garbage":
                connection.send(json.dumps({**answer, "values": "\\ud800"}).replace("\\\\", "\\"))
                continue
            for number in range(3):
                connection.send(json.dumps({**answer, "values": {"answer": number}}))

    with Client(odd_hub(behave)) as client:
        client.wait_connected(PATIENCE_S)
        assert client.call_service("/double") == {"answer": 0}
        with pytest.raises(ServiceTimedOut):
            client.call_service("/late", timeout_s=0.05)
        with pytest.raises(BridgeError):
            client.call_service("/garbage", timeout_s=0.5)
        assert client.call_service("/double") == {"answer": 0}


def test_a_hub_that_hangs_up_in_the_middle_is_a_loss(odd_hub: Callable[..., str]) -> None:
    def behave(connection: ServerConnection) -> None:
        connection.recv()
        connection.socket.shutdown(socket.SHUT_RDWR)

    with Client(odd_hub(behave)) as client:
        client.wait_connected(PATIENCE_S)
        with pytest.raises(ConnectionLost, match="broke off"):
            client.call_service("/add", timeout_s=PATIENCE_S)


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port: int = taken.getsockname()[1]
        return port
