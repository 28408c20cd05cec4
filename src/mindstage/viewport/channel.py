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

from mindstage.errors import MindstageError, RequestRefused
from mindstage.viewport.sockets import ConnectionClosed, Socket
from mindstage.viewport.visitor import Visitor, event

__all__ = ["Channel", "Handler", "Limits"]

R = TypeVar("R", bound=msgspec.Struct)
Handler = Callable[[Visitor, R], object]
"""Gets who asks and what, and gives whatever JSON can hold; a `MindstageError` says no."""

_log = logging.getLogger(__name__)


class Limits(msgspec.Struct, frozen=True, kw_only=True):
    """What strangers and broken pages cannot exceed."""

    visitors: int = 64
    message_bytes: int = 24 * 1024 * 1024
    """Enough for a large map."""
    waiting: int = 64
    """Requests of one visitor that are not answered yet."""
    per_second: float = 120.0
    """Requests of one visitor; twice as many in a burst."""


class _Request(msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename={"arguments": "params"}):
    id: int
    method: str
    arguments: msgspec.Raw = msgspec.Raw(b"{}")


class _Offer(msgspec.Struct, frozen=True):
    kind: type[msgspec.Struct]
    handler: Handler[Any]
    lane: str


class Channel:
    """All visitors' websockets; calls may come from any thread."""

    def __init__(self, limits: Limits = Limits()) -> None:  # noqa: B008 - it is frozen
        """Nobody is there yet, and nothing can be asked.

        Args:
            limits: of what pages send.
        """
        self.limits = limits
        self._offers: dict[str, _Offer] = {}
        self._states: dict[str, bytes] = {}
        self._visitors: dict[str, Visitor] = {}
        self._came: list[Callable[[Visitor], None]] = []
        self._left: list[Callable[[Visitor], None]] = []
        self._workers = ThreadPoolExecutor(max_workers=32, thread_name_prefix="mindstage-page")

    # -- what the page can ask -----------------------------------------------------------------------------------------

    def offer(self, name: str, kind: type[R], handler: Handler[R], *, lane: str = "world") -> None:
        """Lets pages ask for something.

        Args:
            name: the request's `method`.
            kind: a struct of its `params`; it should forbid unknown fields.
            handler: called in a worker thread.
            lane: requests of one lane and one visitor are carried out one after the other.

        Raises:
            ValueError: the name is taken.
        """
        if name in self._offers:
            raise ValueError(f"{name!r} is offered already")
        self._offers[name] = _Offer(kind, handler, lane)

    def on_come(self, react: Callable[[Visitor], None]) -> None:
        """Calls a function with each visitor that comes, in a worker thread."""
        self._came.append(react)

    def on_leave(self, react: Callable[[Visitor], None]) -> None:
        """Calls a function with each visitor that left, in a worker thread."""
        self._left.append(react)

    # -- what the page is told -----------------------------------------------------------------------------------------

    @property
    def visitors(self) -> tuple[Visitor, ...]:
        """Who is there."""
        return tuple(self._visitors.values())

    def visitor(self, key: str | None) -> Visitor | None:
        """The visitor of that key, if that one is there."""
        return self._visitors.get(key or "")

    def publish(self, topic: str, value: object) -> None:
        """Tells all how something is now, those who come later too; nothing is sent if it is as it was."""
        text = event(topic, value)
        if self._states.get(topic) != text:
            self._states[topic] = text
            for visitor in self.visitors:
                visitor.show(topic, text)

    def announce(self, topic: str, value: object) -> None:
        """Tells all who are there of something that happened."""
        text = event(topic, value)
        for visitor in self.visitors:
            visitor.send(text)

    def close(self) -> None:
        """Takes no requests any more."""
        self._workers.shutdown(wait=False, cancel_futures=True)

    # -- on the server's own loop --------------------------------------------------------------------------------------

    async def keep(self, socket: Socket) -> None:
        """Serves one visitor until the page is closed."""
        if len(self._visitors) >= self.limits.visitors:
            await socket.close(1013, "too many visitors are here already")
            return
        visitor = Visitor(_key(socket.request.path), socket)
        socket.protocol.max_message_size = self.limits.message_bytes
        # Whoever comes back by the same key is the same page, whose old socket has not noticed yet.
        self._visitors[visitor.key] = visitor
        for topic, text in list(self._states.items()):
            visitor.show(topic, text)
        tasks = [asyncio.create_task(visitor.deliver())]
        await self._run_all(self._came, visitor)
        try:
            await self._receive(socket, visitor, tasks)
        except ConnectionClosed:
            pass
        finally:
            for task in tasks:
                task.cancel()
            if self._visitors.get(visitor.key) is visitor:
                del self._visitors[visitor.key]
            await self._run_all(self._left, visitor)

    async def _receive(self, socket: Socket, visitor: Visitor, tasks: list[asyncio.Task[None]]) -> None:
        lanes: dict[str, asyncio.Lock] = defaultdict(asyncio.Lock)
        budget = _Budget(self.limits.per_second)
        waiting: set[asyncio.Task[None]] = set()
        while True:
            message = await socket.recv()
            request = self._read(message, visitor)
            if request is None:
                continue
            if len(waiting) >= self.limits.waiting or not budget.take():
                visitor.send(_refusal(request.id, "TooMany", "too much is asked at once; wait for the answers"))
                continue
            task = asyncio.create_task(self._answer(visitor, request, lanes[self._offers[request.method].lane]))
            waiting.add(task)
            task.add_done_callback(waiting.discard)
            tasks[1:] = waiting

    def _read(self, message: str | bytes, visitor: Visitor) -> _Request | None:
        """A request that somebody offers to answer; all else is answered here."""
        try:
            request = msgspec.json.decode(message, type=_Request)
        except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
            visitor.send(_refusal(None, "RequestRefused", str(RequestRefused("a message", cause=str(error)))))
            return None
        if request.method not in self._offers:
            refused = RequestRefused(repr(request.method), cause="nobody answers that", known=self._offers)
            visitor.send(_refusal(request.id, "RequestRefused", str(refused)))
            return None
        return request

    async def _answer(self, visitor: Visitor, request: _Request, lane: asyncio.Lock) -> None:
        async with lane:
            loop = asyncio.get_running_loop()
            try:
                text = await loop.run_in_executor(self._workers, self._carry_out, visitor, request)
            except RuntimeError:  # the workers have been sent home: the server is closing
                return
        visitor.put(text)

    def _carry_out(self, visitor: Visitor, request: _Request) -> bytes:
        offer = self._offers[request.method]
        try:
            arguments = msgspec.json.decode(request.arguments, type=offer.kind)
        except (msgspec.DecodeError, RecursionError) as error:
            refused = RequestRefused(repr(request.method), cause=str(error))
            return _refusal(request.id, "RequestRefused", str(refused))
        try:
            return msgspec.json.encode({"id": request.id, "result": offer.handler(visitor, arguments)})
        except MindstageError as error:
            return _refusal(request.id, type(error).__name__, str(error))
        except Exception as error:  # whatever it is, the page is told, and whoever runs the server
            _log.error("a page's request %r failed", request.method, exc_info=error)
            return _refusal(request.id, "Defect", f"{type(error).__name__}: {error}; this is a defect of Mindstage")

    async def _run_all(self, reactions: list[Callable[[Visitor], None]], visitor: Visitor) -> None:
        loop = asyncio.get_running_loop()
        for react in reactions:
            try:
                await loop.run_in_executor(self._workers, react, visitor)
            except RuntimeError:
                return


class _Budget:
    """So many in a second, and twice as many in a burst."""

    def __init__(self, per_second: float) -> None:
        self._per_second = per_second
        self._left = 2 * per_second
        self._last = time.monotonic()

    def take(self) -> bool:
        """Whether one more is allowed."""
        now = time.monotonic()
        self._left = min(2 * self._per_second, self._left + (now - self._last) * self._per_second)
        self._last = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


def _refusal(id: int | None, kind: str, text: str) -> bytes:
    return msgspec.json.encode({"id": id, "error": {"type": kind, "message": text}})


def _key(path: str) -> str:
    shown = parse_qs(urlsplit(path).query).get("client", [""])[0]
    return shown if re.fullmatch("[a-z0-9]{8,40}", shown) else secrets.token_hex(8)
