"""The client: at somebody else's hub, through losses, and with the right error at once."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from websockets.sync.server import ServerConnection, serve

from mindstage.bridge import Compression, ConnectionState, LocalNode, Node, RosbridgeClient, RosbridgeServer, Status
from mindstage.errors import (
    AuthenticationError,
    BridgeError,
    ConnectionLostError,
    ServiceCallError,
    ServiceNotFoundError,
    ServiceTimeoutError,
)
from tests.bridge.talking import TIMEOUT_S, eventually

Clients = Callable[..., RosbridgeClient]


def add(args: dict[str, int]) -> dict[str, int]:
    return {"sum": args["a"] + args["b"]}


def test_hub_and_client_take_part_in_the_same_way(hub: LocalNode, client: Clients) -> None:
    far = client()
    heard: list[Any] = []

    def take_part(one: Node, other: Node, name: str) -> None:
        one.create_service(f"/{name}/add", "x/Add", add)
        one.subscribe(f"/{name}/words", heard.append)
        eventually(lambda: any(each.name == f"/{name}/add" for each in hub.graph_info().services))
        eventually(lambda: any(each.name == f"/{name}/words" for each in hub.graph_info().topics))
        assert other.call_service(f"/{name}/add", {"a": 1, "b": 2}) == {"sum": 3}
        other.publish(f"/{name}/words", "x/Words", {"from": name})
        eventually(lambda: {"from": name} in heard)

    take_part(hub, far, "here")
    take_part(far, hub, "there")


def test_each_way_to_fail_has_its_error(hub: LocalNode, client: Clients) -> None:
    def refuse(_: object) -> None:
        raise BridgeError("not today")

    hub.create_service("/refuse", "x/X", refuse)
    hub.create_service("/never", "x/X", lambda _: threading.Event().wait(1.0))
    far = client()
    with pytest.raises(ServiceCallError, match="/refuse failed: not today"):
        far.call_service("/refuse")
    with pytest.raises(ServiceNotFoundError, match="/nobody"):
        far.call_service("/nobody")
    with pytest.raises(ServiceTimeoutError):
        far.call_service("/never", timeout_s=0.05)
    assert far.connected


@pytest.mark.parametrize("compression", Compression)
def test_messages_come_in_every_form(hub: LocalNode, client: Clients, compression: Compression) -> None:
    heard: list[Any] = []
    client().subscribe("/map", heard.append, compression=compression)
    eventually(lambda: hub.has_subscribers("/map"))
    message = {"cells": [0.0, 0.5, 1.0] * 100, "name": "küche"}
    hub.publish("/map", "x/Map", message)
    eventually(lambda: heard == [message])


def test_a_client_waits_for_nobody_who_is_not_there() -> None:
    with RosbridgeClient(f"ws://127.0.0.1:{free_port()}") as client:
        with pytest.raises(ConnectionLostError, match="Connect call failed"):
            eventually_raises(client)
        with pytest.raises(ConnectionLostError):
            client.call_service("/add", timeout_s=TIMEOUT_S)
        with pytest.raises(ConnectionLostError):
            client.send_goal("/go", "x/Go").wait(TIMEOUT_S)
        client.publish("/words", "x/Words", {})
        assert client.state is ConnectionState.CONNECTING
    assert client.state is ConnectionState.CLOSED
    with pytest.raises(BridgeError, match="closed"):
        client.call_service("/add")


def eventually_raises(client: RosbridgeClient) -> None:
    eventually(lambda: "Connect call failed" in str(client._cause))
    client.wait_connected(0.01)


@pytest.mark.parametrize("url", ["", "127.0.0.1:9090", "http://127.0.0.1:9090"])
def test_an_address_that_is_none_is_refused_at_once(url: str) -> None:
    with pytest.raises(ConnectionLostError, match="must begin with ws://"):
        RosbridgeClient(url)


@pytest.mark.parametrize("url", ["ws://", "ws://127.0.0.1:99999"])
def test_an_address_that_nobody_can_have_ends_the_wait(url: str) -> None:
    with RosbridgeClient(url) as client, pytest.raises(ConnectionLostError):
        client.wait_connected(0.2)


def test_a_loss_ends_what_waits_and_is_told_at_once(hub: LocalNode, server: RosbridgeServer, client: Clients) -> None:
    states: list[ConnectionState] = []
    called = threading.Event()

    def never(_: object) -> None:
        called.set()
        threading.Event().wait(2.0)

    hub.create_service("/never", "x/X", never)
    hub.create_action_server("/never", "x/X", lambda goal: goal.wait_for_cancel(TIMEOUT_S))
    far = client(on_state=states.append)
    call = far.call_service_async("/never", timeout_s=600.0)
    goal = far.send_goal("/never", "x/X")
    assert called.wait(TIMEOUT_S)
    server.close()
    with pytest.raises(ConnectionLostError, match="the server is closing"):
        call.result(TIMEOUT_S)
    with pytest.raises(ConnectionLostError):
        goal.wait(TIMEOUT_S)
    assert states[:2] == [ConnectionState.CONNECTED, ConnectionState.LOST]
    with pytest.raises(ConnectionLostError):
        far.call_service("/never", timeout_s=600.0)


def test_a_client_comes_back_with_all_that_it_offered(hub: LocalNode, server: RosbridgeServer, client: Clients) -> None:
    far = client()
    heard: list[Any] = []
    far.create_service("/far/add", "x/Add", add)
    far.create_service("/far/gone", "x/Add", add)
    far.create_action_server("/far/go", "x/Go", lambda goal: {"got": goal.args})
    far.advertise("/far/words", "x/Words")
    subscription = far.subscribe("/here/words", heard.append)
    far.subscribe("/here/silence", heard.append).close()
    far.destroy_service("/far/gone")
    server.close()
    eventually(lambda: not hub.graph_info().services)
    server.start()
    far.wait_connected(TIMEOUT_S)
    eventually(lambda: len(hub.graph_info().topics) == 2)
    told = hub.graph_info()
    assert [each.name for each in told.services] == ["/far/add"]
    assert [each.name for each in told.actions] == ["/far/go"]
    assert [each.name for each in told.topics] == ["/far/words", "/here/words"]
    assert hub.call_service("/far/add", {"a": 1, "b": 2}) == {"sum": 3}
    assert hub.send_goal("/far/go", "x/Go", {"to": 1}).wait(TIMEOUT_S).values == {"got": {"to": 1}}
    hub.publish("/here/words", "x/Words", {"data": "again"})
    eventually(lambda: heard == [{"data": "again"}])
    subscription.close()


def test_it_tries_again_until_someone_is_there(hub: LocalNode) -> None:
    port = free_port()
    with RosbridgeClient(f"ws://127.0.0.1:{port}") as client:
        client.create_service("/far/add", "x/Add", add)
        with RosbridgeServer(hub, port=port):
            client.wait_connected(TIMEOUT_S)
            eventually(lambda: hub.graph_info().services)
            assert hub.call_service("/far/add", {"a": 1, "b": 2}) == {"sum": 3}


def test_the_stage_of_one_hub_can_serve_the_callers_of_another(hub: LocalNode, server: RosbridgeServer) -> None:
    with LocalNode() as other, RosbridgeServer(other, port=0) as others, RosbridgeClient(others.url) as bridge:
        bridge.wait_connected(TIMEOUT_S)
        hub.create_service("/here/add", "x/Add", add)
        bridge.create_service("/here/add", "x/Add", lambda args: hub.call_service("/here/add", args))
        eventually(lambda: other.graph_info().services)
        with RosbridgeClient(others.url) as caller:
            caller.wait_connected(TIMEOUT_S)
            assert caller.call_service("/here/add", {"a": 1, "b": 2}) == {"sum": 3}


def test_what_the_hub_remarks_is_heard(hub: LocalNode, client: Clients) -> None:
    remarks: list[Status] = []
    hub.create_service("/ours", "x/X", add)
    far = client(on_status=remarks.append)
    far.create_service("/ours", "x/X", add)
    eventually(lambda: remarks)
    assert "belongs to the local node" in remarks[0].msg


def test_a_handler_that_breaks_breaks_no_connection(
    hub: LocalNode, server: RosbridgeServer, caplog: pytest.LogCaptureFixture
) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError

    hub.create_service("/add", "x/Add", add)
    hub.create_action_server("/go", "x/Go", lambda goal: goal.feedback({}))
    with RosbridgeClient(server.url, on_state=broken, on_status=broken) as client:
        client.wait_connected(TIMEOUT_S)
        client.create_service("/add", "x/Add", add)  # which makes the hub remark something
        client.send_goal("/go", "x/Go", on_feedback=broken).wait(TIMEOUT_S)
        assert client.call_service("/add", {"a": 1, "b": 2}) == {"sum": 3}
    for what in ("state", "status", "feedback"):
        assert f"the {what} handler" in caplog.text


def test_the_right_token_opens_and_another_does_not(hub: LocalNode) -> None:
    with RosbridgeServer(hub, port=0, token="öpen sesame") as server:
        with RosbridgeClient(server.url, token="öpen sesame") as client:
            hub.create_service("/add", "x/Add", add)
            assert client.wait_connected(TIMEOUT_S).call_service("/add", {"a": 1, "b": 2}) == {"sum": 3}
        with RosbridgeClient(server.url) as client, pytest.raises(AuthenticationError, match="a token is required"):
            client.wait_connected(TIMEOUT_S)
        with RosbridgeClient(f"{server.url}/?token=%C3%B6pen%20sesame") as client:
            client.wait_connected(TIMEOUT_S)
        with (
            RosbridgeClient(server.url, token="close sesame") as client,
            pytest.raises(AuthenticationError, match="invalid token"),
        ):
            client.wait_connected(TIMEOUT_S)


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

    with RosbridgeClient(odd_hub(behave)) as client:
        client.wait_connected(TIMEOUT_S)
        assert client.call_service("/double") == {"answer": 0}
        with pytest.raises(ServiceTimeoutError):
            client.call_service("/late", timeout_s=0.05)
        with pytest.raises(BridgeError):
            client.call_service("/garbage", timeout_s=0.5)
        assert client.call_service("/double") == {"answer": 0}


def test_a_hub_that_hangs_up_in_the_middle_is_a_loss(odd_hub: Callable[..., str]) -> None:
    def behave(connection: ServerConnection) -> None:
        connection.recv()
        connection.socket.shutdown(socket.SHUT_RDWR)

    with RosbridgeClient(odd_hub(behave)) as client:
        client.wait_connected(TIMEOUT_S)
        with pytest.raises(ConnectionLostError, match="the connection was lost"):
            client.call_service("/add", timeout_s=TIMEOUT_S)


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port: int = taken.getsockname()[1]
        return port
