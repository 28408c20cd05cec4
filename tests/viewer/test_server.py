"""The web server: routes of the page and of viser at one port, with real sockets."""

from __future__ import annotations

import http.client
import json
import socket
from collections.abc import Iterator
from contextlib import closing

import msgspec
import pytest
import viser
from viser.infra import _infra
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from mindstage.access.limits import RpcLimits
from mindstage.access.policies import EDIT
from mindstage.errors import AuthenticationError, ViewerUnavailableError
from mindstage.viewer import server as sockets
from mindstage.viewer.http import page_files
from mindstage.viewer.server import ClientSession, RpcChannel, address, serve, session_key_of, shut_down
from tests.viewer.page_client import RequestFailedError, connect_page_client
from tests.viewer.waiting import TIMEOUT_S, wait_until

KEY = "0123456789abcdef"


class Echo(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    text: str


@pytest.fixture
def channel() -> RpcChannel:
    channel = RpcChannel(RpcLimits(message_bytes=10_000, max_sessions=2))
    channel.register("echo", Echo, lambda _, request: request.text, EDIT)
    return channel


@pytest.fixture
def server(channel: RpcChannel) -> Iterator[viser.ViserServer]:
    server = serve("127.0.0.1", 0, title="T", channel=channel)
    server.open()
    yield server
    shut_down(server)
    channel.close()


def get(server: viser.ViserServer, path: str, **headers: str) -> tuple[int, http.client.HTTPMessage, bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", server.get_port(), timeout=TIMEOUT_S)
    with closing(connection):
        connection.request("GET", path, headers=headers)
        response = connection.getresponse()
        return response.status, response.headers, response.read()


# -- pages -------------------------------------------------------------------------------------------------------------


def test_the_page_is_served_at_the_root_and_the_view_below(server: viser.ViserServer) -> None:
    status, headers, page = get(server, "/")
    assert (status, headers["Content-Type"]) == (200, "text/html; charset=utf-8")
    assert page == page_files()["index.html"].content
    status, headers, view = get(server, f"/view/{KEY}/")
    assert status == 200
    assert b"/mindstage/viserOverrides.css" in view
    assert len(view) > 100_000
    assert "frame-ancestors 'self'" in headers["Content-Security-Policy"]
    _, headers, small = get(server, f"/view/{KEY}/", **{"Accept-Encoding": "gzip"})
    assert headers["Content-Encoding"] == "gzip"
    assert len(small) < len(view)
    status, _, nothing = get(server, f"/view/{KEY}/", **{"If-None-Match": headers["ETag"]})
    assert (status, nothing) == (304, b"")


def test_every_file_that_the_page_refers_to_exists(server: viser.ViserServer) -> None:
    named = {
        word.strip("'\";()")
        for file in page_files().values()
        for word in file.content.decode().split('"')
        if word.startswith(("./", "/mindstage/")) and word.endswith((".js", ".css", ".svg"))
    }
    assert {"./rpcChannel.js", "/mindstage/style.css"} <= named
    for name in named:
        status, headers, _ = get(server, f"/mindstage/{name.rpartition('/')[2]}")
        assert status == 200, name
        assert headers["X-Content-Type-Options"] == "nosniff"


def test_paths_outside_the_page_are_not_served(server: viser.ViserServer) -> None:
    for path in (
        "/mindstage/../http.py",
        "/mindstage/%2e%2e/http.py",
        "/view/../../../etc/passwd",
        "/client/index.html",
    ):
        status, _, body = get(server, path)
        assert status == 404, path
        assert b"root:" not in body


def test_foreign_hosts_origins_and_malformed_requests_are_refused(server: viser.ViserServer) -> None:
    assert get(server, "/", Host="evil.example")[0] == 421
    for path in ("/mindstage/channel", f"/view/{KEY}", "/"):
        with (
            pytest.raises(InvalidStatus) as refused,
            connect(f"ws://127.0.0.1:{server.get_port()}{path}", origin="http://evil.example"),
        ):  # type: ignore[arg-type]
            pass
        assert refused.value.response.status_code == 403
    with socket.create_connection(("127.0.0.1", server.get_port()), timeout=TIMEOUT_S) as raw:
        raw.sendall(b"\x16\x03\x01 this is no request\r\n\r\n")
        assert b"200" not in raw.recv(1000)
    assert get(server, "/")[0] == 200, "the server still answers"


def test_the_request_filter_applies_to_files_of_viser(server: viser.ViserServer) -> None:
    assert _infra.websockets.asyncio.server.serve is sockets._serve, "the patch of viser is undone"
    for path in ("/", "/index.html"):
        assert b"Viser client" not in get(server, path)[2]


def test_a_viser_that_cannot_be_patched_is_not_served(channel: RpcChannel, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sockets, "_infra", type("Elsewhere", (), {"websockets": _infra.websockets}))
    with pytest.raises(ViewerUnavailableError, match="request filter"):
        serve("127.0.0.1", 0, title="T", channel=channel)


# -- tokens ------------------------------------------------------------------------------------------------------------


def test_the_token_is_exchanged_for_a_cookie(channel: RpcChannel) -> None:
    with pytest.raises(AuthenticationError):
        serve("0.0.0.0", 0, title="T", channel=channel)
    server = serve("0.0.0.0", 0, title="T", channel=channel, token="sesame")
    server.open()
    try:
        assert get(server, "/")[0] == 401
        assert get(server, "/mindstage/main.js")[0] == 401
        assert get(server, f"/view/{KEY}/")[0] == 401
        with pytest.raises(InvalidStatus) as refused, connect_page_client(address(server)):
            pass
        assert refused.value.response.status_code == 401
        status, headers, _ = get(server, "/?token=sesame")
        assert (status, headers["Location"]) == (303, "/")
        cookie = headers["Set-Cookie"].partition(";")[0]
        assert get(server, "/", Cookie=cookie)[0] == 200
        with connect_page_client(address(server), headers={"Cookie": cookie}) as client:
            assert client.ask("echo", text="hi") == "hi"
    finally:
        shut_down(server)


# -- the channel -------------------------------------------------------------------------------------------------------


def test_a_request_is_answered_and_an_invalid_one_refused_with_the_reason(server: viser.ViserServer) -> None:
    with connect_page_client(address(server)) as client:
        assert client.ask("echo", text="grüß \N{SNOWMAN}") == "grüß ☃"
        with pytest.raises(RequestFailedError, match=r"InvalidRequestError: 'echo' .*`\$\.text`"):
            client.ask("echo", text=5)
        with pytest.raises(RequestFailedError, match="unknown field `more`"):
            client.ask("echo", text="", more=1)
        with pytest.raises(RequestFailedError, match="there is no such method; near: 'echo'"):
            client.ask("ecko")


def test_malformed_messages_are_answered_with_errors(server: viser.ViserServer) -> None:
    with connect_page_client(address(server)) as client:
        for garbage in (
            "",
            "[]",
            "null",
            "{",
            '{"id": "x", "method": "echo"}',
            "[" * 5000,
            b"\xff\x00",
            '{"id":1}',
            '{"id":1,"method":"echo","extra":1}',
        ):
            client.socket.send(garbage)
            reply = json.loads(client.socket.recv(timeout=TIMEOUT_S))
            assert reply["error"]["code"] == "InvalidRequestError", garbage
        assert client.ask("echo", text="still there") == "still there"


def test_the_size_of_messages_is_limited(server: viser.ViserServer) -> None:
    with connect_page_client(address(server)) as client:
        client.socket.send(json.dumps({"id": 1, "method": "echo", "params": {"text": "x" * 20_000}}))
        with pytest.raises(ConnectionClosed) as closed:
            client.socket.recv(timeout=TIMEOUT_S)
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 1009


def test_the_number_of_sessions_is_limited(server: viser.ViserServer, channel: RpcChannel) -> None:
    with connect_page_client(address(server)), connect_page_client(address(server)):
        wait_until(lambda: len(channel.sessions) == 2, "two sessions are open")
        with connect_page_client(address(server)) as third, pytest.raises(ConnectionClosed) as closed:
            third.socket.recv(timeout=TIMEOUT_S)
        assert closed.value.rcvd is not None
        assert "too many" in closed.value.rcvd.reason
    wait_until(lambda: not channel.sessions, "both sessions are closed")


def test_a_reconnecting_page_replaces_its_session(server: viser.ViserServer, channel: RpcChannel) -> None:
    left: list[ClientSession] = []
    channel.on_disconnect(left.append)
    with connect_page_client(address(server), key=KEY):
        wait_until(lambda: channel.session(KEY), "the session is open")
        first = channel.session(KEY)
        with connect_page_client(address(server), key=KEY) as again:
            wait_until(lambda: channel.session(KEY) is not first, "the new session replaces the old one")
            assert again.ask("echo", text="hi") == "hi"
    wait_until(lambda: len(left) == 2 and not channel.sessions, "both websockets are closed")


def test_a_view_belongs_to_the_session_with_its_key(server: viser.ViserServer) -> None:
    connections = server._websock_server._live_connections
    protocol = f"viser-v{viser.__version__}"
    with connect(f"ws://127.0.0.1:{server.get_port()}/view/{KEY}", subprotocols=[protocol]):  # type: ignore[list-item]
        wait_until(lambda: connections, "viser has accepted the connection")
        client = type("Client", (), {"client_id": next(iter(connections))})
        assert session_key_of(client, server) == KEY  # type: ignore[arg-type]
    assert session_key_of(type("Client", (), {"client_id": 99}), server) is None  # type: ignore[arg-type]
