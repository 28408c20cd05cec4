"""Connection: one websocket with the protocol on it, the same at both of its ends.

What comes is read in order and handed on at once. What goes waits in a queue with a bound: a peer that lets it fill
reads too slowly, and is dropped, for the sake of all the others.
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable

from websockets.asyncio.connection import Connection as Socket
from websockets.exceptions import ConnectionClosed
from websockets.frames import CloseCode

from mindstage.bridge.protocol import BridgeLimits, Frame, Id, MessageDecoder, MessageEncoder, Operation
from mindstage.bridge.switchboard import PLAIN_FORMAT, ReplyFormat
from mindstage.errors import BridgeError

__all__ = ["Connection"]

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
