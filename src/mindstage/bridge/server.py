"""Server: lets clients join a hub over websockets, as rosbridge_server does.

Only this machine reaches it unless told otherwise, and then a token is needed.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Collection
from http import HTTPStatus
from itertools import count

from websockets.asyncio.server import Server as Sockets
from websockets.asyncio.server import ServerConnection, serve
from websockets.frames import CloseCode
from websockets.http11 import Request, Response

from mindstage.bridge.access import TokenAuth, is_loopback
from mindstage.bridge.connection import Connection
from mindstage.bridge.hub import LocalNode
from mindstage.bridge.protocol import Auth, Id, MessageEncoder, Operation, StatusLevel
from mindstage.bridge.switchboard import PLAIN_FORMAT, Peer, ReplyFormat
from mindstage.errors import AuthenticationError, BridgeUnavailableError

__all__ = ["RosbridgeServer"]

_handshake_log = logging.getLogger("mindstage.bridge.handshakes")
_handshake_log.addHandler(logging.NullHandler())  # what strangers try is told to those who configured logging
_client_numbers = count(1)
_PING_INTERVAL_S = 20.0
_MAX_UNAUTHENTICATED_BYTES = 16 * 1024
"""Enough for a token: nobody fills the memory before it is known who it is."""


class _ServerPeer(Peer):
    """A peer behind a socket."""

    def __init__(self, socket: ServerConnection, server: RosbridgeServer) -> None:
        super().__init__(f"/client_{next(_client_numbers)}")
        self.socket = socket
        self.connection = Connection(
            socket, server.node.limits, receive=self._receive, send_error=self._send_error_status
        )
        self.authenticated = False
        """Whether it has shown what it must; until then it is no peer at the hub."""
        self._server = server

    @property
    def congested(self) -> bool:
        return self.connection.congested

    def deliver(
        self, outgoing: MessageEncoder, route: ReplyFormat = PLAIN_FORMAT, *, sender: Peer | None = None
    ) -> None:
        self.connection.send(outgoing, route)

    def _receive(self, operation: Operation) -> None:
        if isinstance(operation, Auth):
            self._server.authenticate(self, operation)
        elif self.authenticated:
            self._server.node.broker.handle(self, operation)
        else:
            self.reject("a token is needed: send it by `auth`, by ?token= or as a bearer")

    def _send_error_status(self, text: str, id: Id | None) -> None:
        self.send_status(StatusLevel.ERROR, text, id)

    def reject(self, reason: str) -> None:
        """Tells why, and closes."""
        self.send_status(StatusLevel.ERROR, reason)
        self.connection.close(reason, CloseCode.POLICY_VIOLATION)


class RosbridgeServer:
    """Serves from `start` to `close`; usable as a context."""

    def __init__(
        self,
        node: LocalNode,
        *,
        host: str = "127.0.0.1",
        port: int = 9090,
        token: str | None = None,
        origins: Collection[str] = (),
        ping_interval_s: float | None = _PING_INTERVAL_S,
    ) -> None:
        """Nothing is served yet.

        Args:
            hub: what clients join; its limits hold.
            host: where to listen; anything but this machine's own needs a token.
            port: where to listen; 0 takes a free one.
            token: what clients must know: shown by rosbridge's `auth`, by `?token=`, or as `Authorization: Bearer`.
            origins: pages that browsers may come from, beside those of this machine.
            ping_s: so often are clients asked for a sign of life, and so long may they take for it [s]; None for those
                that may be busy for long, and whose end is noticed otherwise.

        Raises:
            AuthenticationError: others could reach it, and there is no token.
        """
        if not token and not is_loopback(host):
            cause = "everyone in the network could join; give a token, or serve at 127.0.0.1"
            raise AuthenticationError(host, cause=cause)
        self.node = node
        self.host = host
        self.port = port
        self._ping_interval_s = ping_interval_s
        self._auth = TokenAuth(host=host, token=token or None, origins=origins)
        self._sockets: Sockets | None = None
        self._clients: set[_ServerPeer] = set()

    @property
    def url(self) -> str:
        """What a client on this machine connects to."""
        host = {"0.0.0.0": "127.0.0.1", "::": "::1", "": "127.0.0.1"}.get(self.host, self.host)
        return f"ws://{f'[{host}]' if ':' in host else host}:{self.port}"

    @property
    def client_count(self) -> int:
        """How many are here."""
        return len(self._clients)

    def start(self) -> RosbridgeServer:
        """Lets clients in from now on.

        Raises:
            BridgeUnavailableError: the address cannot be had.
        """
        if self._sockets is None:
            self.node.run(self._serve())
        return self

    def close(self) -> None:
        """Sends everyone away and stops listening; any number of times."""
        if self._sockets is not None and not self.node.closed:
            self.node.run(self._stop())
        self._sockets = None

    def __enter__(self) -> RosbridgeServer:
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.close()

    def authenticate(self, client: _ServerPeer, auth: Auth) -> None:
        """A client says who it is."""
        if not self._auth.needs_token or self._auth.check_auth(auth, time.time()):
            self._accept(client)
        else:
            client.reject("that is not the token")

    # -- on the loop ---------------------------------------------------------------------------------------------------

    async def _serve(self) -> None:
        try:
            self._sockets = await serve(
                self._handle_connection, self.host, self.port, process_request=self._process_request, compression=None,
                max_size=_MAX_UNAUTHENTICATED_BYTES, ping_interval=self._ping_interval_s, ping_timeout=self._ping_interval_s, close_timeout=2.0,
                server_header=None, logger=_handshake_log,
            )  # fmt: skip
        except (OSError, OverflowError) as error:
            cause = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
            raise BridgeUnavailableError(self.host, self.port, cause=cause) from error
        self.port = next(iter(self._sockets.sockets)).getsockname()[1]

    async def _stop(self) -> None:
        if self._sockets is not None:
            self._sockets.close(code=CloseCode.GOING_AWAY, reason="the server is closing")
            await self._sockets.wait_closed()

    def _process_request(self, socket: ServerConnection, request: Request) -> Response | None:
        """Answers a handshake that may not go on."""
        headers = request.headers
        if not self._auth.allows_origin(headers.get("Origin"), headers.get("Host")):
            return socket.respond(HTTPStatus.FORBIDDEN, "pages of that origin may not come in\n")
        bearer = headers.get("Authorization")
        if self._auth.needs_token and self._auth.check_handshake(request.path, bearer) is False:
            why = "a token is needed" if bearer is not None and not bearer.split()[1:] else "that is not the token"
            return socket.respond(HTTPStatus.UNAUTHORIZED, f"{why}\n")
        if len(self._clients) >= self.node.limits.connections:
            return socket.respond(HTTPStatus.SERVICE_UNAVAILABLE, "too many clients are here already\n")
        return None

    async def _handle_connection(self, socket: ServerConnection) -> None:
        request = socket.request
        path, bearer = (request.path, request.headers.get("Authorization")) if request else ("", None)
        trusted = not self._auth.needs_token or self._auth.check_handshake(path, bearer) is True
        client = _ServerPeer(socket, self)
        self._clients.add(client)
        if trusted:
            self._accept(client)
        late = asyncio.get_running_loop().call_later(self.node.limits.auth_timeout_s, self._disconnect, client)
        try:
            await client.connection.run()
        finally:
            late.cancel()
            self._clients.discard(client)
            self.node.broker.remove_peer(client)

    def _accept(self, client: _ServerPeer) -> None:
        if not client.authenticated:
            client.authenticated = True
            client.socket.protocol.max_message_size = self.node.limits.message_bytes
            self.node.broker.add_peer(client)

    def _disconnect(self, client: _ServerPeer) -> None:
        if not client.authenticated:
            client.reject("no token was shown in time")
