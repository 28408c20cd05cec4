"""A rosbridge server: connects the clients at its websockets with a `LocalNode`, as rosbridge_server does.

By default it listens on the loopback interface; any other host requires a token. A web page of any origin can open a
websocket to this machine, and only the `Origin` header identifies it; programs send none.

`Connection` is one websocket with the protocol on it, and is used by clients too. Operations are handled in the order
in which they arrive. The send queue is bounded: a peer that reads so slowly that it fills up is disconnected.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections import deque
from collections.abc import Callable, Collection
from http import HTTPStatus
from itertools import count

from websockets.asyncio.connection import Connection as Socket
from websockets.asyncio.server import Server as Sockets
from websockets.asyncio.server import ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.frames import CloseCode
from websockets.http11 import Request, Response
from websockets.protocol import State

from mindstage.access.certificates import TlsCertificate
from mindstage.access.gate import Denial, Gate
from mindstage.access.limits import (
    CLOSE_TIME,
    CONGESTION,
    DEFAULT_VISITOR_LIMITS,
    HANDSHAKE,
    READ_SLICE,
    UNAUTHENTICATED_BYTES,
    BridgeLimits,
    Timeout,
    VisitorLimits,
)
from mindstage.access.ports import ROSBRIDGE_PORT, is_taken, moved_text, ports_to_try, unavailable_text
from mindstage.access.visitors import Visitor
from mindstage.bridge.broker import PLAIN_FORMAT, Peer, ReplyFormat
from mindstage.bridge.node import LocalNode
from mindstage.bridge.protocol import Auth, Frame, Id, MessageDecoder, MessageEncoder, Operation, StatusLevel
from mindstage.errors import BridgeError, BridgeUnavailableError, RequestLimitError
from mindstage.ranges import Port, checked

__all__ = ["Connection", "RosbridgeServer"]


_log = logging.getLogger("mindstage.bridge")
_PING_INTERVAL_S = 20.0


class Connection:
    """A websocket with the protocol on it. Belongs to the loop."""

    def __init__(
        self,
        socket: Socket,
        limits: BridgeLimits,
        *,
        receive: Callable[[Operation, int], None],
        send_error: Callable[[str, Id | None, Operation | None], None],
        receive_delay: Callable[[int, float], float] | None = None,
    ) -> None:
        """Creates the connection on an open websocket.

        Args:
            socket: the websocket, of a client or a server.
            limits: limits for what the peer sends.
            receive: called with every operation and its size [B]; may raise a `BridgeError`.
            send_error: called with the error message and the id of a message that was rejected, and what answers it.
            receive_delay: called with the size and the time of each frame; returns how long to wait before the next
                one is received [s].
        """
        self._socket = socket
        self._limits = limits
        self._receive = receive
        self._send_error = send_error
        self._receive_delay = receive_delay
        self._decoder = MessageDecoder(limits)
        self._outbox: deque[Frame] = deque()
        self._outbox_bytes = 0
        self._has_output = asyncio.Event()
        self._flushed = asyncio.Event()
        self._closing: asyncio.Task[None] | None = None
        self._may_read = asyncio.Event()
        self._may_read.set()
        self._was_paused = False
        """Whether reading was paused since the last check."""
        self._ping_timeout_s = socket.ping_timeout
        self.close_reason = ""
        """Why the connection ended; empty while it is open."""

    @property
    def congested(self) -> bool:
        """Whether the peer reads more slowly than messages are queued."""
        return self._outbox_bytes > CONGESTION.count

    async def run(self) -> None:
        """Receives and sends until the connection ends; the end of a connection is not an error."""
        writer = asyncio.create_task(self._write())
        watch = asyncio.create_task(self._expire_fragments())
        loop = asyncio.get_running_loop()
        handling_s = 0.0
        try:
            async for frame in self._socket:  # does not yield while frames are buffered
                start_s = loop.time()
                self._handle_frame(frame, start_s)
                handling_s += loop.time() - start_s
                if self._receive_delay is not None and (delay_s := self._receive_delay(len(frame), start_s)) > 0.0:
                    await asyncio.sleep(delay_s)
                if not self._may_read.is_set():
                    await self._wait_until_readable()
                if handling_s > READ_SLICE.maximum:
                    await asyncio.sleep(0)
                    handling_s = 0.0
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

    def send(self, outgoing: MessageEncoder, reply_format: ReplyFormat = PLAIN_FORMAT) -> None:
        """Writes an operation, or queues it if the peer does not read fast enough; does not wait."""
        if self._closing is not None:
            return
        if reply_format is PLAIN_FORMAT and self._can_write():
            self._socket.protocol.send_text(outgoing.data)
            self._socket.send_data()
            return
        for frame in outgoing.frames(
            reply_format.compression, reply_format.fragment_size, max_fragments=self._limits.fragments
        ):
            self._outbox.append(frame)
            self._outbox_bytes += len(frame)
        self._flushed.clear()
        self._has_output.set()
        if len(self._outbox) > self._limits.waiting_messages or self._outbox_bytes > self._limits.waiting_bytes:
            self._abort_slow_reader()

    def set_paused(self, paused: bool) -> None:
        """Stops to receive, or continues; the peer is held up when its messages fill the buffers on the way."""
        if not paused:
            self._may_read.set()
        elif self._may_read.is_set():
            self._may_read.clear()
            self._was_paused = True
            self._socket.ping_timeout = None  # the reply to a ping waits behind the messages that are not read

    def close(self, reason: str, code: int = CloseCode.NORMAL_CLOSURE) -> None:
        """Starts to close the connection with a reason; returns at once."""
        if self._closing is None:
            self._set_close_reason(reason)
            self._closing = asyncio.ensure_future(self._close(code, reason))

    def abort(self, reason: str) -> None:
        """Ends the connection without a closing handshake."""
        self._set_close_reason(reason)
        if self._closing is None:
            self._closing = asyncio.get_running_loop().create_task(asyncio.sleep(0))
        self._socket.transport.abort()

    def _handle_frame(self, frame: Frame, now_s: float) -> None:
        if self._closing is not None:
            return
        operation = None
        try:
            operation = self._decoder.decode(frame, now_s)
            if operation is not None:
                self._receive(operation, self._decoder.size)
        except (BridgeError, RequestLimitError) as error:
            id = operation.id if operation is not None else getattr(error, "id", None)
            self._send_error(str(error), id, getattr(error, "answer", None))
        except Exception as error:  # an unexpected error must not end the connection
            _log.exception("a message of %s could not be handled", self._peer_name())
            self._send_error(f"internal error: {type(error).__name__}", operation.id if operation else None, None)

    def _can_write(self) -> bool:
        """Whether everything before is written, so that a message need not be queued."""
        return (
            not self._outbox
            and self._flushed.is_set()
            and self._socket.protocol.state is State.OPEN
            and not self._socket.transport.get_write_buffer_size()
        )

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
            return  # `run` sets the reason

    async def _expire_fragments(self) -> None:
        while True:
            await asyncio.sleep(self._limits.fragment_timeout_s / 2)
            for id in self._decoder.expire(asyncio.get_running_loop().time()):
                self._send_error(f"the other fragments of {id!r} did not arrive in time", id, None)
            if not self._was_paused:
                self._socket.ping_timeout = self._ping_timeout_s
            self._was_paused = not self._may_read.is_set()

    async def _wait_until_readable(self) -> None:
        """Waits until reading continues, or the connection is lost."""
        waits = [asyncio.ensure_future(each) for each in (self._may_read.wait(), self._socket.wait_closed())]
        try:
            await asyncio.wait(waits, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for each in waits:
                each.cancel()

    async def _close(self, code: int, reason: str) -> None:
        try:
            async with asyncio.timeout(CLOSE_TIME.maximum):
                if self._outbox:
                    await self._flushed.wait()  # queued messages are sent before the close frame
                await self._socket.close(code, reason[:120])
        except (TimeoutError, ConnectionClosed, OSError):
            self._socket.transport.abort()

    def _abort_slow_reader(self) -> None:
        _log.warning(
            "%s reads too slowly and was disconnected: %d messages were queued", self._peer_name(), len(self._outbox)
        )
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
    return _close_message(close.code, close.reason) if close else "the connection was lost"


def _close_message(code: int | None, reason: str | None) -> str:
    if reason:
        return reason
    return (
        "the connection was closed"
        if code in (CloseCode.NORMAL_CLOSURE, CloseCode.GOING_AWAY)
        else "the connection was lost"
    )


SERVER_NAME = "Mindstage"
"""In the header `Server` of the handshake, so that clients know that they may use any type."""
_handshake_log = logging.getLogger("mindstage.bridge.handshakes")
_handshake_log.addHandler(logging.NullHandler())  # failed handshakes are logged only if logging is configured
_client_numbers = count(1)


class _ServerPeer(Peer):
    """A client of the server."""

    def __init__(self, socket: ServerConnection, server: RosbridgeServer, visitor: Visitor) -> None:
        super().__init__(f"/client_{next(_client_numbers)}")
        self.socket = socket
        self.visitor: Visitor = visitor
        self.connection = Connection(
            socket,
            server.node.limits,
            receive=self._receive,
            send_error=self._send_error_status,
            receive_delay=visitor.receive_delay,
        )
        self.authenticated = False
        """Whether the client is authenticated; it is added to the broker only then."""
        self._server = server

    @property
    def congested(self) -> bool:
        return self.connection.congested

    def deliver(
        self, outgoing: MessageEncoder, reply_format: ReplyFormat = PLAIN_FORMAT, *, sender: Peer | None = None
    ) -> None:
        self.connection.send(outgoing, reply_format)

    def set_paused(self, paused: bool) -> None:
        super().set_paused(paused)
        self.connection.set_paused(paused)

    def _receive(self, operation: Operation, size: int) -> None:
        if isinstance(operation, Auth):
            self._server.authenticate(self, operation)
        elif self.authenticated:
            self._server.node.broker.handle(self, operation, size)
        else:
            self.reject("a token is required: send it by `auth`, as ?token= or as a bearer token")

    def _send_error_status(self, text: str, id: Id | None, answer: Operation | None) -> None:
        if answer is not None and self.authenticated:
            self.deliver(MessageEncoder(answer))
        else:
            self.send_status(StatusLevel.ERROR, text, id)

    def reject(self, reason: str) -> None:
        """Sends the reason as a status and closes the connection."""
        self.send_status(StatusLevel.ERROR, reason)
        self.connection.close(reason, CloseCode.POLICY_VIOLATION)


class RosbridgeServer:
    """Accepts clients between `start` and `close`; can be used as a context manager."""

    @checked
    def __init__(
        self,
        node: LocalNode,
        *,
        host: str = "127.0.0.1",
        port: Port | None = None,
        token: str | None = None,
        origins: Collection[str] = (),
        tls: TlsCertificate | None = None,
        visitor_limits: VisitorLimits = DEFAULT_VISITOR_LIMITS,
        ping_interval_s: Timeout | None = _PING_INTERVAL_S,
    ) -> None:
        """Creates the server; `start` opens its socket.

        Args:
            node: the node that clients are connected to; its limits apply.
            host: host on which to listen; every host but this machine requires a token.
            port: port on which to listen; 0 selects a free one. By default 9090, or the next free one.
            token: token that clients must send: in rosbridge's `auth`, as `?token=`, or as `Authorization: Bearer`.
            origins: additional origins of web pages; pages of this machine are always allowed.
            tls: the certificate for wss://; None serves ws://.
            visitor_limits: limits of each client address.
            ping_interval_s: time between pings, and timeout for the reply [s]; None disables pings, for clients that
                may be blocked for long and whose end is detected otherwise.

        Raises:
            AuthenticationError: the host is not this machine, and there is no token.
            CertificateError: the certificate cannot be used.
        """
        self.node = node
        self.host = host
        self._ports = ports_to_try(port, default=ROSBRIDGE_PORT)
        self.port = self._ports[0]
        """The port, which is known after `start`."""
        self._ping_interval_s = ping_interval_s
        self._gate = Gate(host=host, token=token, origins=origins, local_pages=True, limits=visitor_limits)
        self._tls = None if tls is None else tls.server_context()
        self._sockets: Sockets | None = None
        self._clients: set[_ServerPeer] = set()

    @property
    def url(self) -> str:
        """URL for a client on this machine."""
        host = {"0.0.0.0": "127.0.0.1", "::": "::1", "": "127.0.0.1"}.get(self.host, self.host)
        return f"{'ws' if self._tls is None else 'wss'}://{f'[{host}]' if ':' in host else host}:{self.port}"

    @property
    def client_count(self) -> int:
        """Number of connected clients."""
        return len(self._clients)

    def start(self) -> RosbridgeServer:
        """Starts to accept clients.

        Raises:
            BridgeUnavailableError: the server cannot listen at this address.
        """
        if self._sockets is None:
            self.node.run(self._serve())
        return self

    def close(self) -> None:
        """Disconnects all clients and stops listening; calling it again is harmless."""
        if self._sockets is not None and not self.node.closed:
            self.node.run(self._stop())
        self._sockets = None

    def __enter__(self) -> RosbridgeServer:
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.close()

    def authenticate(self, client: _ServerPeer, auth: Auth) -> None:
        """Handles the `auth` operation of a client."""
        now_s = asyncio.get_running_loop().time()
        denial = self._gate.admit(auth, client.visitor, now_s=now_s, clock_s=time.time())
        if client.authenticated or denial is None:
            self._accept(client)
        else:
            client.reject(denial.text)

    # -- on the loop ---------------------------------------------------------------------------------------------------

    async def _serve(self) -> None:
        cause: OSError | OverflowError | None = None
        for port in self._ports:
            try:
                self._sockets = await self._listen(port)
            except (OSError, OverflowError) as error:
                cause = cause or error  # of the port that is wanted
                if isinstance(error, OverflowError) or not is_taken(error):
                    break
                continue
            self.port = next(iter(self._sockets.sockets)).getsockname()[1]
            if cause is not None:
                _log.warning("%s", moved_text("the rosbridge", default=self._ports[0], port=self.port))
            self._ports = (self.port,)  # clients connect again there if the server is started again
            return
        text = unavailable_text(cause, self._ports[0]) if isinstance(cause, OSError) else str(cause)
        raise BridgeUnavailableError(self.host, self._ports[0], cause=text) from cause

    async def _listen(self, port: int) -> Sockets:
        return await serve(
            self._handle_connection,
            self.host,
            port,
            process_request=self._process_request,
            ssl=self._tls,
            ssl_handshake_timeout=None if self._tls is None else HANDSHAKE.maximum,
            compression=None,
            max_size=UNAUTHENTICATED_BYTES.count,
            ping_interval=self._ping_interval_s,
            ping_timeout=self._ping_interval_s,
            close_timeout=2.0,
            server_header=SERVER_NAME,
            logger=_handshake_log,
        )

    async def _stop(self) -> None:
        if self._sockets is not None:
            self._sockets.close(code=CloseCode.GOING_AWAY, reason="the server is closing")
            await self._sockets.wait_closed()

    def _process_request(self, socket: ServerConnection, request: Request) -> Response | None:
        """Returns the response to a handshake that is rejected, else None."""
        visitor, now_s = self._gate.visitors.visitor(socket.remote_address), asyncio.get_running_loop().time()
        denial = self._gate.socket_denial(request.path, request.headers, visitor, now_s, token_may_follow=True)
        if denial is None and self.node.is_starting:
            denial = Denial(HTTPStatus.SERVICE_UNAVAILABLE, "starting")
        if denial is None and len(self._clients) >= self.node.limits.connections:
            denial = Denial(HTTPStatus.SERVICE_UNAVAILABLE, "too many clients")
        return None if denial is None else socket.respond(denial.status, f"{denial.text}\n")

    async def _handle_connection(self, socket: ServerConnection) -> None:
        request = socket.request
        authenticated = request is not None and self._gate.is_authenticated(request.path, request.headers)
        visitor = self._gate.visitors.visitor(socket.remote_address)
        visitor.connections += 1
        client = _ServerPeer(socket, self, visitor)
        self._clients.add(client)
        if authenticated:
            self._accept(client)
        auth_timer = asyncio.get_running_loop().call_later(self.node.limits.auth_timeout_s, self._disconnect, client)
        try:
            await client.connection.run()
        finally:
            auth_timer.cancel()
            visitor.connections -= 1
            self._clients.discard(client)
            self.node.broker.remove_peer(client)

    def _accept(self, client: _ServerPeer) -> None:
        if not client.authenticated:
            client.authenticated = True
            client.socket.protocol.max_message_size = self.node.limits.message_bytes
            self.node.broker.add_peer(client)

    def _disconnect(self, client: _ServerPeer) -> None:
        if not client.authenticated:
            client.reject("no token was sent in time")
