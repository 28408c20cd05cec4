"""Channel: what the page asks and is told, as small JSON messages over one websocket for each visitor.

    page → server   {"id": 7, "method": "select", "params": {"id": "Mug"}}
    server → page   {"id": 7, "result": …}   or   {"id": 7, "error": {"type": "BodyUnknown", "message": "no body …"}}
    server → page   {"topic": "clock", "value": …}                                                  (unasked)

Every request is answered. Requests are typed: what is not in the struct of its kind is refused with the path to it.
They are carried out in worker threads, never on the socket's own loop, so that nobody's question stops anybody's
picture; within one lane a visitor's requests keep their order.
"""

from __future__ import annotations

import asyncio
import logging
import re
import secrets
import time
from collections import defaultdict
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar
from urllib.parse import parse_qs, urlsplit

import msgspec

from mindstage.errors import InvalidRequestError, MindstageError
from mindstage.viewport.sockets import ConnectionClosed, WebSocket
from mindstage.viewport.visitor import ClientSession, event_message

__all__ = ["Handler", "RpcChannel", "RpcLimits"]

R = TypeVar("R", bound=msgspec.Struct)
Handler = Callable[[ClientSession, R], object]
"""Gets who asks and what, and gives whatever JSON can hold; a `MindstageError` says no."""

_log = logging.getLogger(__name__)


class RpcLimits(msgspec.Struct, frozen=True, kw_only=True):
    """What strangers and broken pages cannot exceed."""

    max_sessions: int = 64
    message_bytes: int = 24 * 1024 * 1024
    """Enough for a large map."""
    max_pending: int = 64
    """Requests of one visitor that are not answered yet."""
    max_requests_per_second: float = 120.0
    """Requests of one visitor; twice as many in a burst."""


class _Request(msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename={"arguments": "params"}):
    id: int
    method: str
    arguments: msgspec.Raw = msgspec.Raw(b"{}")


class _Method(msgspec.Struct, frozen=True):
    request_type: type[msgspec.Struct]
    handler: Handler[Any]
    queue: str


class RpcChannel:
    """All visitors' websockets; calls may come from any thread."""

    def __init__(self, limits: RpcLimits = RpcLimits()) -> None:  # noqa: B008 - it is frozen
        """Nobody is there yet, and nothing can be asked.

        Args:
            limits: of what pages send.
        """
        self.limits = limits
        self._methods: dict[str, _Method] = {}
        self._states: dict[str, bytes] = {}
        self._sessions: dict[str, ClientSession] = {}
        self._connect_callbacks: list[Callable[[ClientSession], None]] = []
        self._disconnect_callbacks: list[Callable[[ClientSession], None]] = []
        self._executor = ThreadPoolExecutor(max_workers=32, thread_name_prefix="mindstage-page")

    # -- what the page can ask -----------------------------------------------------------------------------------------

    def register(self, name: str, request_type: type[R], handler: Handler[R], *, queue: str = "world") -> None:
        """Lets pages ask for something.

        Args:
            name: the request's `method`.
            kind: a struct of its `params`; it should forbid unknown fields.
            handler: called in a worker thread.
            lane: requests of one lane and one visitor are carried out one after the other.

        Raises:
            ValueError: the name is taken.
        """
        if name in self._methods:
            raise ValueError(f"{name!r} is offered already")
        self._methods[name] = _Method(request_type, handler, queue)

    def on_connect(self, callback: Callable[[ClientSession], None]) -> None:
        """Calls a function with each visitor that comes, in a worker thread."""
        self._connect_callbacks.append(callback)

    def on_disconnect(self, callback: Callable[[ClientSession], None]) -> None:
        """Calls a function with each visitor that left, in a worker thread."""
        self._disconnect_callbacks.append(callback)

    # -- what the page is told -----------------------------------------------------------------------------------------

    @property
    def sessions(self) -> tuple[ClientSession, ...]:
        """Who is there."""
        return tuple(self._sessions.values())

    def session(self, key: str | None) -> ClientSession | None:
        """The visitor of that key, if that one is there."""
        return self._sessions.get(key or "")

    def publish(self, topic: str, value: object) -> None:
        """Tells all how something is now, those who come later too; nothing is sent if it is as it was."""
        text = event_message(topic, value)
        if self._states.get(topic) != text:
            self._states[topic] = text
            for visitor in self.sessions:
                visitor.send_latest(topic, text)

    def broadcast(self, topic: str, value: object) -> None:
        """Tells all who are there of something that happened."""
        text = event_message(topic, value)
        for visitor in self.sessions:
            visitor.send(text)

    def close(self) -> None:
        """Takes no requests any more."""
        self._executor.shutdown(wait=False, cancel_futures=True)

    # -- on the server's own loop --------------------------------------------------------------------------------------

    async def serve_session(self, socket: WebSocket) -> None:
        """Serves one visitor until the page is closed."""
        if len(self._sessions) >= self.limits.max_sessions:
            await socket.close(1013, "too many visitors are here already")
            return
        visitor = ClientSession(_session_key(socket.request.path), socket)
        socket.protocol.max_message_size = self.limits.message_bytes
        # Whoever comes back by the same key is the same page, whose old socket has not noticed yet.
        self._sessions[visitor.key] = visitor
        for topic, text in list(self._states.items()):
            visitor.send_latest(topic, text)
        tasks = [asyncio.create_task(visitor.run_sender())]
        await self._run_callbacks(self._connect_callbacks, visitor)
        try:
            await self._receive(socket, visitor, tasks)
        except ConnectionClosed:
            pass
        finally:
            for task in tasks:
                task.cancel()
            if self._sessions.get(visitor.key) is visitor:
                del self._sessions[visitor.key]
            await self._run_callbacks(self._disconnect_callbacks, visitor)

    async def _receive(self, socket: WebSocket, session: ClientSession, tasks: list[asyncio.Task[None]]) -> None:
        lanes: dict[str, asyncio.Lock] = defaultdict(asyncio.Lock)
        budget = _RateLimiter(self.limits.max_requests_per_second)
        waiting: set[asyncio.Task[None]] = set()
        while True:
            message = await socket.recv()
            request = self._read(message, session)
            if request is None:
                continue
            if len(waiting) >= self.limits.max_pending or not budget.try_acquire():
                session.send(_error_message(request.id, "TooMany", "too much is asked at once; wait for the answers"))
                continue
            task = asyncio.create_task(self._reply(session, request, lanes[self._methods[request.method].queue]))
            waiting.add(task)
            task.add_done_callback(waiting.discard)
            tasks[1:] = waiting

    def _read(self, message: str | bytes, session: ClientSession) -> _Request | None:
        """A request that somebody offers to answer; all else is answered here."""
        try:
            request = msgspec.json.decode(message, type=_Request)
        except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
            session.send(
                _error_message(None, "RequestRefused", str(InvalidRequestError("a message", cause=str(error))))
            )
            return None
        if request.method not in self._methods:
            refused = InvalidRequestError(repr(request.method), cause="nobody answers that", known=self._methods)
            session.send(_error_message(request.id, "RequestRefused", str(refused)))
            return None
        return request

    async def _reply(self, session: ClientSession, request: _Request, queue: asyncio.Lock) -> None:
        async with queue:
            loop = asyncio.get_running_loop()
            try:
                text = await loop.run_in_executor(self._executor, self._run_handler, session, request)
            except RuntimeError:  # the workers have been sent home: the server is closing
                return
        session.enqueue(text)

    def _run_handler(self, session: ClientSession, request: _Request) -> bytes:
        offer = self._methods[request.method]
        try:
            arguments = msgspec.json.decode(request.arguments, type=offer.request_type)
        except (msgspec.DecodeError, RecursionError) as error:
            refused = InvalidRequestError(repr(request.method), cause=str(error))
            return _error_message(request.id, "RequestRefused", str(refused))
        try:
            return msgspec.json.encode({"id": request.id, "result": offer.handler(session, arguments)})
        except MindstageError as error:
            return _error_message(request.id, error.code, str(error))
        except Exception as error:  # whatever it is, the page is told, and whoever runs the server
            _log.error("a page's request %r failed", request.method, exc_info=error)
            return _error_message(
                request.id, "Defect", f"{type(error).__name__}: {error}; this is a defect of Mindstage"
            )

    async def _run_callbacks(self, callbacks: list[Callable[[ClientSession], None]], session: ClientSession) -> None:
        loop = asyncio.get_running_loop()
        for react in callbacks:
            try:
                await loop.run_in_executor(self._executor, react, session)
            except RuntimeError:
                return


class _RateLimiter:
    """So many in a second, and twice as many in a burst."""

    def __init__(self, per_second: float) -> None:
        self._per_second = per_second
        self._left = 2 * per_second
        self._last = time.monotonic()

    def try_acquire(self) -> bool:
        """Whether one more is allowed."""
        now = time.monotonic()
        self._left = min(2 * self._per_second, self._left + (now - self._last) * self._per_second)
        self._last = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


def _error_message(id: int | None, type: str, text: str) -> bytes:
    return msgspec.json.encode({"id": id, "error": {"type": type, "message": text}})


def _session_key(path: str) -> str:
    shown = parse_qs(urlsplit(path).query).get("client", [""])[0]
    return shown if re.fullmatch("[a-z0-9]{8,40}", shown) else secrets.token_hex(8)
