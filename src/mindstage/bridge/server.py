"""Server: lets clients join a hub over websockets, as rosbridge_server does.

Only this machine reaches it unless told otherwise, and then a token is needed.

Access: who may come in, told by a token and, for browsers, by the page that wants to.

A page from anywhere can open a websocket to this very machine; only its `SourceMapView` gives it away. Programs send none.

Connection: one websocket with the protocol on it, the same at both of its ends.

What comes is read in order and handed on at once. What goes waits in a queue with a bound: a peer that lets it fill
reads too slowly, and is dropped, for the sake of all the others.
"""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import ipaddress
import logging
import time
from collections import deque
from collections.abc import Callable, Collection
from http import HTTPStatus
from itertools import count
from urllib.parse import parse_qs, urlsplit

from websockets.asyncio.connection import Connection as Socket
from websockets.asyncio.server import Server as Sockets
from websockets.asyncio.server import ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.frames import CloseCode
from websockets.http11 import Request, Response

from mindstage.bridge.broker import PLAIN_FORMAT, Peer, ReplyFormat
from mindstage.bridge.node import LocalNode
from mindstage.bridge.protocol import (
    Auth,
    BridgeLimits,
    Frame,
    Id,
    MessageDecoder,
    MessageEncoder,
    Operation,
    StatusLevel,
)
from mindstage.errors import AuthenticationError, BridgeError, BridgeUnavailableError

__all__ = ["Connection", "RosbridgeServer", "TokenAuth", "is_loopback"]


_MAX_CLOCK_SKEW_S = 5.0
"""rosauth's bound: a proof is no older."""


def is_loopback(host: str) -> bool:
    """Whether only this machine itself reaches that host."""
    if host.strip("[]").lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


class TokenAuth:
    """Decides; holds the token and tells it to nobody."""

    def __init__(self, *, host: str, token: str | None, origins: Collection[str]) -> None:
        """The rules.

        Args:
            host: where the server listens.
            token: what a client must know, or None.
            origins: pages that may come in beside those of this machine, such as `https://robot.example`; `null` is
                what a page has that was opened as a file.
        """
        self._local_only = is_loopback(host)
        self._token = None if token is None else token.encode()
        self._origins = frozenset(origin.rstrip("/").lower() for origin in origins)

    @property
    def needs_token(self) -> bool:
        """Whether a client must show one."""
        return self._token is not None

    def allows_origin(self, origin: str | None, host: str | None) -> bool:
        """Whether a browser's page may come in.

        Args:
            origin: the handshake's `SourceMapView`; None for a program.
            host: the handshake's `Host`. A page of that very host may come in where a token protects it; without one
                its name proves nothing, for whoever owns a name can let it point to this machine.
        """
        if origin is None or origin.rstrip("/").lower() in self._origins:
            return True
        try:
            page = urlsplit(origin).hostname or ""
            here = urlsplit(f"//{host or ''}").hostname or ""
        except ValueError:
            return False
        return is_loopback(page) or (not self._local_only and page != "" and page == here)

    def check_handshake(self, path: str, authorization: str | None) -> bool | None:
        """Whether the handshake's `?token=` or `Authorization: Bearer` is the token; None if there is neither."""
        shown = parse_qs(urlsplit(path).query, keep_blank_values=True).get("token", [])
        if authorization is not None:
            scheme, _, value = authorization.partition(" ")
            bearer = value.strip() if scheme.lower() == "bearer" else ""
            shown = [bearer] if bearer or not shown else shown
        return self._token_matches(shown[0]) if shown else None

    def check_auth(self, auth: Auth, now_s: float) -> bool:
        """Whether an `auth` shows that the client knows the token: as it is, or by rosauth's hash with it.

        Args:
            auth: what the client says.
            now_s: the present moment, since 1970 [s].
        """
        if auth.token is not None:
            return self._token_matches(auth.token)
        if abs(now_s - auth.t) > _MAX_CLOCK_SKEW_S or auth.end <= now_s or self._token is None:
            return False
        said = f"{auth.client}{auth.dest}{auth.rand}{auth.t}{auth.level}{auth.end}"
        proof = hashlib.sha512(self._token + said.encode("utf-8", "surrogateescape")).hexdigest()
        return hmac.compare_digest(proof.encode(), auth.mac.encode("utf-8", "surrogateescape"))

    def _token_matches(self, token: str) -> bool:
        return self._token is not None and hmac.compare_digest(self._token, token.encode("utf-8", "surrogateescape"))


_CONGESTION_LIMIT_BYTES = 256 * 1024
"""With so much to be sent, what can wait should wait."""
_CLOSE_TIMEOUT_S = 5.0
_MAX_READ_SLICE_S = 0.002
"""So long are one peer's messages taken at a stretch before the others get their turn [s]."""
_log = logging.getLogger("mindstage.bridge")


class Connection:
    """Reads until the end, and sends meanwhile. Belongs to the loop."""

    def __init__(
        self,
        socket: Socket,
        limits: BridgeLimits,
        *,
        receive: Callable[[Operation], None],
        send_error: Callable[[str, Id | None], None],
    ) -> None:
        """The socket is open already.

        Args:
            socket: either end's.
            limits: what the other side may ask of us.
            receive: told every operation; it may raise a `BridgeError`.
            complain: told what is wrong with what came, and the id of the message.
        """
        self._socket = socket
        self._limits = limits
        self._receive = receive
        self._send_error = send_error
        self._reader = MessageDecoder(limits)
        self._outbox: deque[Frame] = deque()
        self._outbox_bytes = 0
        self._has_output = asyncio.Event()
        self._flushed = asyncio.Event()
        self._closing: asyncio.Task[None] | None = None
        self.close_reason = ""
        """Whose doing the end was, once it is here."""

    @property
    def congested(self) -> bool:
        """Whether the other side reads more slowly than it is sent to."""
        return self._outbox_bytes > _CONGESTION_LIMIT_BYTES

    async def run(self) -> None:
        """Reads and sends until the connection ends; returns then, and never raises for it."""
        writer = asyncio.create_task(self._write())
        watch = asyncio.create_task(self._expire_fragments())
        loop = asyncio.get_running_loop()
        turn_ends = 0.0
        try:
            async for frame in self._socket:  # does not wait while there is more, and so would keep the loop
                self._handle_frame(frame)
                if loop.time() > turn_ends:
                    await asyncio.sleep(0)
                    turn_ends = loop.time() + _MAX_READ_SLICE_S
        except ConnectionClosed as error:
            self._set_close_reason(_reason(error))
        finally:
            self._flushed.set()
            writer.cancel()
            watch.cancel()
            await asyncio.gather(writer, watch, return_exceptions=True)
            self._outbox.clear()
            self._outbox_bytes = 0
        self._set_close_reason(_close_message(self._socket.close_code, self._socket.close_reason))

    def send(self, outgoing: MessageEncoder, route: ReplyFormat = PLAIN_FORMAT) -> None:
        """Queues an operation; nobody waits for it to be sent."""
        if self._closing is not None:
            return
        for frame in outgoing.frames(route.compression, route.fragment_size, max_fragments=self._limits.fragments):
            self._outbox.append(frame)
            self._outbox_bytes += len(frame)
        self._flushed.clear()
        self._has_output.set()
        if len(self._outbox) > self._limits.waiting_messages or self._outbox_bytes > self._limits.waiting_bytes:
            self._abort_slow_reader()

    def close(self, reason: str, code: int = CloseCode.NORMAL_CLOSURE) -> None:
        """Ends the connection, saying why; returns at once."""
        if self._closing is None:
            self._set_close_reason(reason)
            self._closing = asyncio.ensure_future(self._close(code, reason))

    def abort(self, reason: str) -> None:
        """Ends the connection without a word: nobody would hear it."""
        self._set_close_reason(reason)
        if self._closing is None:
            self._closing = asyncio.get_running_loop().create_task(asyncio.sleep(0))
        self._socket.transport.abort()

    def _handle_frame(self, frame: Frame) -> None:
        if self._closing is not None:
            return
        operation = None
        try:
            operation = self._reader.decode(frame, asyncio.get_running_loop().time())
            if operation is not None:
                self._receive(operation)
        except BridgeError as error:
            id = operation.id if operation is not None else getattr(error, "id", None)
            self._send_error(str(error), id)
        except Exception as error:  # a defect of ours shall cost one message and not the connection
            _log.exception("a message of %s could not be handled", self._peer_name())
            self._send_error(f"it could not be handled: {type(error).__name__}", operation.id if operation else None)

    async def _write(self) -> None:
        try:
            while True:
                while self._outbox:
                    frame = self._outbox.popleft()
                    await self._socket.send(frame)
                    self._outbox_bytes -= len(frame)
                self._flushed.set()
                self._has_output.clear()
                await self._has_output.wait()
        except ConnectionClosed:
            return  # the reader notices as well, and tells

    async def _expire_fragments(self) -> None:
        while True:
            await asyncio.sleep(self._limits.fragment_timeout_s / 2)
            for id in self._reader.expire(asyncio.get_running_loop().time()):
                self._send_error(f"the other fragments of {id!r} did not come in time", id)

    async def _close(self, code: int, reason: str) -> None:
        try:
            async with asyncio.timeout(_CLOSE_TIMEOUT_S):
                if self._outbox:
                    await self._flushed.wait()  # what was said before is sent before
                await self._socket.close(code, reason[:120])
        except (TimeoutError, ConnectionClosed, OSError):
            self._socket.transport.abort()

    def _abort_slow_reader(self) -> None:
        _log.warning("%s reads too slowly and was dropped: %d messages waited", self._peer_name(), len(self._outbox))
        self._outbox.clear()
        self._outbox_bytes = 0
        self.abort("it reads too slowly")

    def _peer_name(self) -> str:
        address = self._socket.remote_address
        return f"{address[0]}:{address[1]}" if isinstance(address, tuple) else "a client"

    def _set_close_reason(self, reason: str) -> None:
        self.close_reason = self.close_reason or reason


def _reason(error: ConnectionClosed) -> str:
    close = error.rcvd or error.sent
    return _close_message(close.code, close.reason) if close else "it broke off"


def _close_message(code: int | None, reason: str | None) -> str:
    if reason:
        return reason
    return "it was closed" if code in (CloseCode.NORMAL_CLOSURE, CloseCode.GOING_AWAY) else "it broke off"


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
