"""Client: services, topics and actions at a server, reconnection, and errors."""

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
from tests.bridge.raw_client import TIMEOUT_S, eventually

Clients = Callable[..., RosbridgeClient]


def add(args: dict[str, int]) -> dict[str, int]:
    return {"sum": args["a"] + args["b"]}


def test_a_local_node_and_a_client_have_the_same_methods(local_node: LocalNode, client: Clients) -> None:
    remote = client()
    received: list[Any] = []

    def take_part(one: Node, other: Node, name: str) -> None:
        one.create_service(f"/{name}/add", "x/Add", add)
        one.subscribe(f"/{name}/words", received.append)
        eventually(lambda: any(each.name == f"/{name}/add" for each in local_node.graph_info().services))
        eventually(lambda: any(each.name == f"/{name}/words" for each in local_node.graph_info().topics))
        assert other.call_service(f"/{name}/add", {"a": 1, "b": 2}) == {"sum": 3}
        other.publish(f"/{name}/words", "x/Words", {"from": name})
        eventually(lambda: {"from": name} in received)

    take_part(local_node, remote, "here")
    take_part(remote, local_node, "there")


def test_each_failure_raises_its_error(local_node: LocalNode, client: Clients) -> None:
    def refuse(_: object) -> None:
        raise BridgeError("not today")

    local_node.create_service("/refuse", "x/X", refuse)
    local_node.create_service("/never", "x/X", lambda _: threading.Event().wait(1.0))
    remote = client()
    with pytest.raises(ServiceCallError, match="/refuse failed: not today"):
        remote.call_service("/refuse")
    with pytest.raises(ServiceNotFoundError, match="/nobody"):
        remote.call_service("/nobody")
    with pytest.raises(ServiceTimeoutError):
        remote.call_service("/never", timeout_s=0.05)
    assert remote.connected


@pytest.mark.parametrize("compression", [Compression.NONE, Compression.PNG, Compression.CBOR])
def test_messages_arrive_in_every_encoding(local_node: LocalNode, client: Clients, compression: Compression) -> None:
    received: list[Any] = []
    client().subscribe("/map", received.append, compression=compression)
    eventually(lambda: local_node.has_subscribers("/map"))
    message = {"cells": [0.0, 0.5, 1.0] * 100, "name": "küche"}
    local_node.publish("/map", "x/Map", message)
    eventually(lambda: received == [message])


def test_a_call_without_a_connection_fails_at_once() -> None:
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
def test_an_invalid_url_is_rejected_at_once(url: str) -> None:
    with pytest.raises(ConnectionLostError, match="must begin with ws://"):
        RosbridgeClient(url)


@pytest.mark.parametrize("url", ["ws://", "ws://127.0.0.1:99999"])
def test_an_unreachable_url_ends_the_wait(url: str) -> None:
    with RosbridgeClient(url) as client, pytest.raises(ConnectionLostError):
        client.wait_connected(0.2)


def test_a_lost_connection_fails_pending_calls_and_is_reported_at_once(
    local_node: LocalNode, server: RosbridgeServer, client: Clients
) -> None:
    states: list[ConnectionState] = []
    called = threading.Event()

    def never(_: object) -> None:
        called.set()
        threading.Event().wait(2.0)

    local_node.create_service("/never", "x/X", never)
    local_node.create_action_server("/never", "x/X", lambda goal: goal.wait_for_cancel(TIMEOUT_S))
    remote = client(on_state=states.append)
    call = remote.call_service_async("/never", timeout_s=600.0)
    goal = remote.send_goal("/never", "x/X")
    assert called.wait(TIMEOUT_S)
    server.close()
    with pytest.raises(ConnectionLostError, match="the server is closing"):
        call.result(TIMEOUT_S)
    with pytest.raises(ConnectionLostError):
        goal.wait(TIMEOUT_S)
    assert states[:2] == [ConnectionState.CONNECTED, ConnectionState.LOST]
    with pytest.raises(ConnectionLostError):
        remote.call_service("/never", timeout_s=600.0)


def test_a_client_reconnects_and_advertises_again(
    local_node: LocalNode, server: RosbridgeServer, client: Clients
) -> None:
    remote = client()
    received: list[Any] = []
    remote.create_service("/far/add", "x/Add", add)
    remote.create_service("/far/gone", "x/Add", add)
    remote.create_action_server("/far/go", "x/Go", lambda goal: {"got": goal.args})
    remote.advertise("/far/words", "x/Words")
    subscription = remote.subscribe("/here/words", received.append)
    remote.subscribe("/here/silence", received.append).close()
    remote.destroy_service("/far/gone")
    server.close()
    eventually(lambda: not local_node.graph_info().services)
    server.start()
    remote.wait_connected(TIMEOUT_S)
    eventually(lambda: len(local_node.graph_info().topics) == 2)
    graph = local_node.graph_info()
    assert [each.name for each in graph.services] == ["/far/add"]
    assert [each.name for each in graph.actions] == ["/far/go"]
    assert [each.name for each in graph.topics] == ["/far/words", "/here/words"]
    assert local_node.call_service("/far/add", {"a": 1, "b": 2}) == {"sum": 3}
    assert local_node.send_goal("/far/go", "x/Go", {"to": 1}).wait(TIMEOUT_S).values == {"got": {"to": 1}}
    local_node.publish("/here/words", "x/Words", {"data": "again"})
    eventually(lambda: received == [{"data": "again"}])
    subscription.close()


def test_a_client_retries_until_there_is_a_server(local_node: LocalNode) -> None:
    port = free_port()
    with RosbridgeClient(f"ws://127.0.0.1:{port}") as client:
        client.create_service("/far/add", "x/Add", add)
        with RosbridgeServer(local_node, port=port):
            client.wait_connected(TIMEOUT_S)
            eventually(lambda: local_node.graph_info().services)
            assert local_node.call_service("/far/add", {"a": 1, "b": 2}) == {"sum": 3}


def test_a_node_can_serve_the_clients_of_another_server(local_node: LocalNode, server: RosbridgeServer) -> None:
    with LocalNode() as other, RosbridgeServer(other, port=0) as others, RosbridgeClient(others.url) as bridge:
        bridge.wait_connected(TIMEOUT_S)
        local_node.create_service("/here/add", "x/Add", add)
        bridge.create_service("/here/add", "x/Add", lambda args: local_node.call_service("/here/add", args))
        eventually(lambda: other.graph_info().services)
        with RosbridgeClient(others.url) as caller:
            caller.wait_connected(TIMEOUT_S)
            assert caller.call_service("/here/add", {"a": 1, "b": 2}) == {"sum": 3}


def test_status_messages_of_the_server_are_reported(local_node: LocalNode, client: Clients) -> None:
    notes: list[Status] = []
    local_node.create_service("/ours", "x/X", add)
    remote = client(on_status=notes.append)
    remote.create_service("/ours", "x/X", add)
    eventually(lambda: notes)
    assert "belongs to the local node" in notes[0].msg


def test_a_failing_handler_does_not_end_the_connection(
    local_node: LocalNode, server: RosbridgeServer, caplog: pytest.LogCaptureFixture
) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError

    local_node.create_service("/add", "x/Add", add)
    local_node.create_action_server("/go", "x/Go", lambda goal: goal.feedback({}))
    with RosbridgeClient(server.url, on_state=broken, on_status=broken) as client:
        client.wait_connected(TIMEOUT_S)
        client.create_service("/add", "x/Add", add)  # which the server rejects with a status
        client.send_goal("/go", "x/Go", on_feedback=broken).wait(TIMEOUT_S)
        assert client.call_service("/add", {"a": 1, "b": 2}) == {"sum": 3}
    for what in ("state", "status", "feedback"):
        assert f"the {what} handler" in caplog.text


def test_only_the_right_token_is_accepted(local_node: LocalNode) -> None:
    with RosbridgeServer(local_node, port=0, token="öpen sesame") as server:
        with RosbridgeClient(server.url, token="öpen sesame") as client:
            local_node.create_service("/add", "x/Add", add)
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
def fake_server() -> Iterator[Callable[[Callable[[ServerConnection], None]], str]]:
    """Starts a server with one function as its handler, and returns its URL."""
    servers = []

    def make(behave: Callable[[ServerConnection], None]) -> str:
        server = serve(behave, "127.0.0.1", 0)
        servers.append(server)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        return f"ws://127.0.0.1:{server.socket.getsockname()[1]}"

    yield make
    for server in servers:
        server.shutdown()


def test_invalid_late_and_duplicate_responses_are_harmless(fake_server: Callable[..., str]) -> None:
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

    with RosbridgeClient(fake_server(behave)) as client:
        client.wait_connected(TIMEOUT_S)
        assert client.call_service("/double") == {"answer": 0}
        with pytest.raises(ServiceTimeoutError):
            client.call_service("/late", timeout_s=0.05)
        with pytest.raises(BridgeError):
            client.call_service("/garbage", timeout_s=0.5)
        assert client.call_service("/double") == {"answer": 0}


def test_a_server_that_closes_the_socket_is_a_lost_connection(fake_server: Callable[..., str]) -> None:
    def behave(connection: ServerConnection) -> None:
        connection.recv()
        connection.socket.shutdown(socket.SHUT_RDWR)

    with RosbridgeClient(fake_server(behave)) as client:
        client.wait_connected(TIMEOUT_S)
        with pytest.raises(ConnectionLostError, match="the connection was lost"):
            client.call_service("/add", timeout_s=TIMEOUT_S)


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port: int = taken.getsockname()[1]
        return port
