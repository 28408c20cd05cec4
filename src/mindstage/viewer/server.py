"""Server: the web server of the page, on a free port: our page and its channel, and viser's view in it.

Patience: long work for pages, so that it holds up neither the world nor what else a page asks for.

Sockets: our own doors in viser's web server, at the one port that both share.

viser serves its page and its websocket by one call of `websockets.asyncio.server.serve`. While one of our servers is
being made, that call goes through here: the gate judges each request first, our own paths are answered by us, and the
rest is viser's. Nothing else of viser is touched, and a server whose doors were not put in is never opened.

Visitor: one page that somebody has open, and what waits to be sent to it.

Channel: what the page asks and is told, as small JSON messages over one websocket for each visitor.

page → server   {"id": 7, "method": "select", "params": {"id": "Mug"}}
    server → page   {"id": 7, "result": …}   or   {"id": 7, "error": {"type": "BodyUnknown", "message": "no body …"}}
    server → page   {"topic": "clock", "value": …}                                                  (unasked)

Every request is answered. Requests are typed: what is not in the struct of its kind is refused with the path to it.
They are carried out in worker threads, never on the socket's own loop, so that nobody's question stops anybody's
picture; within one lane a visitor's requests keep their order.
"""

from __future__ import annotations

import asyncio
import errno
import io
import logging
import re
import secrets
import socket
import threading
import time
from collections import defaultdict, deque
from collections.abc import Awaitable, Callable, Collection, Hashable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, redirect_stdout
from dataclasses import replace
from typing import Any, Protocol, TypeVar
from urllib.parse import parse_qs, urlsplit

import msgspec
import viser
from viser.infra import _infra as _viser

from mindstage.errors import (
    InvalidRequestError,
    MindstageError,
    QueryLimitError,
    QuestionTimeoutError,
    ViewerUnavailableError,
)
from mindstage.viewer.http import CHANNEL, HttpResponse, RequestFilter, ViserPage, request_path, view_key

__all__ = [
    "BoundedExecutor",
    "ClientSession",
    "ConnectionClosed",
    "EmptyRequest",
    "Handler",
    "HttpRoutes",
    "RpcChannel",
    "RpcLimits",
    "WebSocket",
    "address",
    "event_message",
    "patched_viser",
    "serve",
    "session_key_of",
    "shut_down",
]


T = TypeVar("T")


class BoundedExecutor:
    """So many pieces of work at once, and so long that anybody waits for each.

    Nothing in Python can be stopped from outside: what never ends keeps its place, and ends with the process.
    """

    def __init__(self, *, max_workers: int = 4, timeout_s: float = 30.0) -> None:
        """Nobody works yet.

        Args:
            places: so much is done at once.
            timeout_s: how long anybody waits for it [s].
        """
        self._max_workers = max_workers
        self._semaphore = threading.BoundedSemaphore(max_workers)
        self._timeout_s = timeout_s

    def run(self, function: Callable[[], T], *, label: str) -> T:
        """Does it, and gives what comes of it.

        Args:
            work: may take its time.
            what: it is, for the sentence that says that it takes too long.

        Raises:
            QuestionTimeoutError: it took too long.
            QueryLimitError: as much as can be is being done already.
        """
        if not self._semaphore.acquire(blocking=False):
            raise QueryLimitError(label, pending=self._max_workers)
        future: Future[T] = Future()
        threading.Thread(target=self._execute, args=(function, future), name="mindstage-asking", daemon=True).start()
        try:
            return future.result(self._timeout_s)
        except TimeoutError:
            if future.done():  # the work itself raised it
                raise
            raise QuestionTimeoutError(label, timeout_s=self._timeout_s) from None

    def _execute(self, function: Callable[[], T], future: Future[T]) -> None:
        try:
            future.set_result(function())
        except BaseException as error:
            future.set_exception(error)
        finally:
            self._semaphore.release()


_infra: Any = _viser  # what it imports is not exported
ConnectionClosed: type[Exception] = _infra.websockets.exceptions.ConnectionClosed
_serve = _infra.websockets.asyncio.server.serve
_patch_lock = threading.Lock()
_handshake_log = logging.getLogger("mindstage.viewer.handshakes")
_handshake_log.addHandler(logging.NullHandler())  # what strangers try is told to those who configured logging


class WebSocket(Protocol):
    """What is used of a websocket."""

    request: Any
    protocol: Any

    async def send(self, message: bytes, /, *, text: bool) -> None:
        """Sends a message when there is room for it."""

    async def recv(self) -> str | bytes:
        """Waits for the next message."""

    async def close(self, code: int = 1000, reason: str = "") -> None:
        """Says goodbye."""


class HttpRoutes:
    """Our side of the port."""

    def __init__(self, gate: RequestFilter, *, channel: Callable[[WebSocket], Awaitable[None]]) -> None:
        """The doors of one server.

        Args:
            gate: who may come in.
            channel: keeps a page's own websocket until it is closed.
        """
        self._filter, self._channel = gate, channel
        self._view: ViserPage | None = None
        self.patched = False
        """Whether a server has them."""

    def serve(self, handler: Callable[[Any], Awaitable[None]], *args: Any, **options: Any) -> Any:
        """Called by viser in place of `websockets.asyncio.server.serve`."""
        page = options["process_request"]

        async def handle(socket: Any) -> None:
            await (self._channel(socket) if request_path(socket.request.path) == CHANNEL else handler(socket))

        def process(socket: Any, request: Any) -> Any:
            return self._process(socket, request, page)

        self.patched = True
        return _serve(
            handle, *args, **options | {"process_request": process, "server_header": None, "logger": _handshake_log}
        )

    def _process(self, socket: Any, request: Any, page: Callable[[Any, Any], Any]) -> Any:
        headers = request.headers
        if (headers.get("Upgrade") or "").lower() == "websocket":
            refusal = self._filter.socket_error(request.path, headers)
            return None if refusal is None else _response(socket, refusal)
        answer = self._filter.respond(request.path, headers)
        if answer is None:
            answer = self._view_answer(request, lambda plain: page(socket, plain))
        return _response(socket, answer)

    def _view_answer(self, request: Any, page: Callable[[Any], Any]) -> HttpResponse:
        """Viser's page, with our words in its head."""
        if self._view is None:
            plain = page(replace(request, path="/", headers=type(request.headers)()))
            self._view = ViserPage(plain.body)
        return self._view.answer(request.headers, self._filter.view_headers(request.headers))


def _response(socket: Any, answer: HttpResponse) -> Any:
    response = socket.respond(answer.status, "")
    response.body = answer.body
    for name in ("Content-Type", "Content-Length"):
        response.headers.pop(name, None)
    for name, value in answer.headers.items():
        response.headers[name] = value
    response.headers["Content-Length"] = str(len(answer.body))
    return response


class _ModuleProxy:
    """A module, but for some of its names."""

    def __init__(self, module: Any, **names: Any) -> None:
        self._module = module
        self.__dict__.update(names)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._module, name)


@contextmanager
def patched_viser(routes: HttpRoutes) -> Iterator[None]:
    """Whatever server viser makes meanwhile has these doors."""
    with _patch_lock:
        library = _infra.websockets
        server = _ModuleProxy(library.asyncio.server, serve=routes.serve)
        _infra.websockets = _ModuleProxy(library, asyncio=_ModuleProxy(library.asyncio, server=server))
        try:
            yield
        finally:
            _infra.websockets = library


_MAX_QUEUE = 1000
"""A page that has so many messages before it does not keep up, and is sent away; it comes back by itself."""


def event_message(topic: str, value: object) -> bytes:
    """A message that nobody asked for."""
    return msgspec.json.encode({"topic": topic, "value": value})


class ClientSession:
    """Whom the channel talks to; kept while the page is open, a new one when it comes back."""

    def __init__(self, key: str, socket: WebSocket) -> None:
        """Somebody who just came.

        Args:
            key: what the page calls itself; the view in it has the same.
            socket: to it.
        """
        self.key = key
        self.state: dict[Hashable, Any] = {}
        """What whoever answers requests wants to remember of this visitor."""
        self._socket = socket
        self._loop = asyncio.get_running_loop()
        self._queue: deque[bytes] = deque()
        self._latest: dict[str, bytes] = {}
        self._sent: dict[str, bytes] = {}
        self._has_output = asyncio.Event()

    def send_event(self, topic: str, value: object) -> None:
        """Tells this visitor only of something that happened; from any thread."""
        self.send(event_message(topic, value))

    def publish_to(self, topic: str, value: object) -> None:
        """Tells this visitor only how something is now, unless that was told last; from any thread."""
        text = event_message(topic, value)
        if self._sent.get(topic) != text:
            self._sent[topic] = text
            self.send_latest(topic, text)

    def send(self, text: bytes) -> None:
        """Sends a message; from any thread."""
        self._call_soon(self.enqueue, text)

    def send_latest(self, topic: str, text: bytes) -> None:
        """Sends how something is now, in place of how it was where that is not on its way yet; from any thread."""
        self._call_soon(self._enqueue_latest, topic, text)

    def _call_soon(self, function: Callable[..., None], *args: object) -> None:
        try:
            self._loop.call_soon_threadsafe(function, *args)
        except RuntimeError:
            return  # the server has just closed: nobody is there any more

    # -- on the server's own loop --------------------------------------------------------------------------------------

    def enqueue(self, text: bytes) -> None:
        """Queues a message."""
        self._queue.append(text)
        self._has_output.set()

    def _enqueue_latest(self, topic: str, text: bytes) -> None:
        self._latest[topic] = text
        self._has_output.set()

    async def run_sender(self) -> None:
        """Sends what waits, until the page is gone."""
        try:
            while await self._has_output.wait():
                self._has_output.clear()
                while self._queue or self._latest:
                    if len(self._queue) > _MAX_QUEUE:
                        await self._socket.close(1013, "too slow: more is to be told than can be sent")
                        return
                    text = self._queue.popleft() if self._queue else self._latest.pop(next(iter(self._latest)))
                    await self._socket.send(text, text=True)
        except ConnectionClosed:
            return


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


class EmptyRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The parameters of a request that has none."""


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


_MAX_PORT_TRIES = 200
"""So many ports are tried, one after the other."""
_output_lock = threading.Lock()


class _Server(viser.ViserServer):
    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refuses: any visitor could ask for it, and the page would be open to the whole world."""
        return None


def serve(
    host: str,
    port: int,
    *,
    title: str,
    channel: RpcChannel,
    token: str | None = None,
    origins: Collection[str] = (),
) -> viser.ViserServer:
    """Starts a server at the port, or at the next one that is free.

    Args:
        host: where to listen; others than this machine's own need a token.
        port: where to listen; 0 lets the system choose.
        title: of the page.
        channel: keeps the visitors' websockets.
        token: what visitors must know.
        origins: addresses under which the page may be opened beside its own.

    Raises:
        AuthenticationError: others could reach it, and there is no token.
        ViewerUnavailableError: the host is not this machine, or no port is free.
    """
    doors = HttpRoutes(RequestFilter(host=host, token=token, origins=origins), channel=channel.serve_session)
    free = _free_port(host, port)
    with _without_output(), patched_viser(doors):
        server = _Server(host=host, port=free, label=title, verbose=False)
    if not doors.patched:
        shut_down(server)
        raise ViewerUnavailableError(host, port, cause="this release of viser has no place for the gate before it")
    server.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(232, 93, 4))
    return server


def session_key_of(client: viser.ClientHandle, server: viser.ViserServer) -> str | None:
    """The key of the visitor in whose page a view is; None where somebody opened the view by itself."""
    connection = server._websock_server._live_connections.get(client.client_id)
    return view_key(connection.request.path) if connection is not None and connection.request is not None else None


def shut_down(server: viser.ViserServer) -> None:
    """Ends a server; its visitors are told that the connection is lost."""
    with _without_output():
        server.stop()


def address(server: viser.ViserServer) -> str:
    """What to type into a browser."""
    host = {"0.0.0.0": "127.0.0.1", "::": "::1", "": "127.0.0.1"}.get(server.get_host(), server.get_host())
    return f"http://{f'[{host}]' if ':' in host else host}:{server.get_port()}"


def _free_port(host: str, port: int) -> int:
    cause: OSError | None = None
    for candidate in range(port, min(port + _MAX_PORT_TRIES, 65536)):
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        try:
            with socket.create_server((host, candidate), family=family):
                return candidate
        except OSError as error:
            cause = error
            if error.errno not in (errno.EADDRINUSE, errno.EACCES):
                break
    reason = (cause.strerror or str(cause)) if cause else "there is no such port"
    raise ViewerUnavailableError(host, port, cause=reason) from cause


@contextmanager
def _without_output() -> Iterator[None]:
    # viser greets and says goodbye on stdout, where a program's own output belongs. One at a time: two that overlap
    # would put back each other's stdout.
    with _output_lock, redirect_stdout(io.StringIO()):
        yield
