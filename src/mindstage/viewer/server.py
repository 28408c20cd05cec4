"""The web server of the page: viser's server with additional routes, and the RPC channel between page and server.

The channel is one websocket per page with small JSON messages:

    page → server   {"id": 7, "method": "select", "params": {"id": "Mug"}}
    server → page   {"id": 7, "result": …}   or   {"id": 7, "error": {"code": "BodyNotFoundError", "message": "…"}}
    server → page   {"topic": "clock", "value": …}                                                  (event)

Every request gets a response. Parameters are typed, unknown fields are refused with the path to them. Requests run in
worker threads, never on the event loop; requests of one client in the same queue keep their order.

viser serves its page and its websocket by one call of `websockets.asyncio.server.serve`. While a server is created,
that call is redirected to `HttpRoutes.serve`: the request filter checks each request first, paths of Mindstage are
answered here, all others by viser. Nothing else of viser is patched, and a server without the routes is closed at once.
"""

from __future__ import annotations

import asyncio
import errno
import io
import json
import logging
import re
import secrets
import socket
import ssl
import threading
import time
import warnings
from collections import defaultdict, deque
from collections.abc import Awaitable, Callable, Collection, Hashable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, redirect_stdout
from contextvars import copy_context
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Annotated, Any, Protocol, TypeVar
from urllib.parse import parse_qs, urlsplit

import msgspec
import viser
from viser.infra import _infra as _viser

from mindstage.access.certificates import TlsCertificate
from mindstage.access.gate import Gate
from mindstage.access.limits import (
    DEFAULT_VISITOR_LIMITS,
    HANDSHAKE,
    UNSENT_EVENTS,
    VIEW_NUMBER,
    WINDOW,
    RpcLimits,
    VisitorLimits,
)
from mindstage.access.policies import CONTROL, Cost, EntryKind, EntryPoint, Policy
from mindstage.access.ports import PAGE_PORT, is_taken, moved_text, ports_to_try, unavailable_text
from mindstage.access.resources import without_paths
from mindstage.access.visitors import TokenBucket, Visitor
from mindstage.errors import (
    InvalidRequestError,
    MindstageError,
    QueryLimitError,
    QuestionTimeoutError,
    RequestLimitError,
    ViewerUnavailableError,
)
from mindstage.simulation.observation import as_client
from mindstage.unicode_json import encode_json
from mindstage.viewer.http import (
    CHANNEL,
    STARTING,
    HttpResponse,
    RequestFilter,
    ViserPage,
    is_texture_path,
    request_path,
    view_key,
)

__all__ = [
    "CLIENT",
    "BoundedExecutor",
    "ClientSession",
    "ConnectionClosed",
    "EmptyRequest",
    "Handler",
    "HttpRoutes",
    "Later",
    "RpcChannel",
    "ViewerServer",
    "WebSocket",
    "address",
    "event_message",
    "patched_viser",
    "serve",
    "session_key_of",
    "shut_down",
]


CLIENT = "viewer"
"""The client that edits and questions of pages are recorded of."""
T = TypeVar("T")


class BoundedExecutor:
    """Runs functions in threads, with a limit on how many run at once and how long the caller waits.

    A Python thread cannot be stopped: after a timeout the function goes on and occupies one of the workers until it
    returns.
    """

    def __init__(self, *, max_workers: int = 4, timeout_s: float = 30.0) -> None:
        """Starts no thread yet.

        Args:
            max_workers: the maximum number of functions that run at once.
            timeout_s: how long callers wait for a result [s].
        """
        self._max_workers = max_workers
        self._semaphore = threading.BoundedSemaphore(max_workers)
        self._timeout_s = timeout_s

    def run(self, function: Callable[[], T], *, label: str) -> T:
        """Calls a function and returns its result.

        Args:
            label: what it computes, for error messages.

        Raises:
            QuestionTimeoutError: there is no result in time.
            QueryLimitError: all workers are busy.
        """
        if not self._semaphore.acquire(blocking=False):
            raise QueryLimitError(label, pending=self._max_workers)
        future: Future[T] = Future()
        run = partial(copy_context().run, self._execute, function, future)
        threading.Thread(target=run, name="mindstage-asking", daemon=True).start()
        try:
            return future.result(self._timeout_s)
        except TimeoutError:
            if future.done():  # raised by the function
                raise
            raise QuestionTimeoutError(label, timeout_s=self._timeout_s) from None

    def _execute(self, function: Callable[[], T], future: Future[T]) -> None:
        try:
            future.set_result(function())
        except BaseException as error:
            future.set_exception(error)
        finally:
            self._semaphore.release()


_infra: Any = _viser  # imported by viser, but not exported
ConnectionClosed: type[Exception] = _infra.websockets.exceptions.ConnectionClosed
_serve = _infra.websockets.asyncio.server.serve
_patch_lock = threading.Lock()
_handshake_log = logging.getLogger("mindstage.viewer.handshakes")
_handshake_log.addHandler(logging.NullHandler())  # failed handshakes appear only if logging is configured


class WebSocket(Protocol):
    """The part of a websocket of the `websockets` library that is used."""

    request: Any
    protocol: Any
    remote_address: Any

    async def send(self, message: bytes, /, *, text: bool) -> None:
        """Sends a message; waits while the buffer is full."""

    async def recv(self) -> str | bytes:
        """Waits for the next message."""

    async def close(self, code: int = 1000, reason: str = "") -> None:
        """Closes the connection."""


class HttpRoutes:
    """The routes of Mindstage in viser's server: the page's files, its websocket, and the filter of all requests."""

    def __init__(
        self,
        request_filter: RequestFilter,
        *,
        channel: Callable[[WebSocket, Visitor], Awaitable[None]],
        tls: ssl.SSLContext | None = None,
    ) -> None:
        """Creates the routes of one server.

        Args:
            request_filter: decides which requests are allowed.
            channel: serves a page's websocket until it is closed.
            tls: the certificate of the server; None serves without encryption.
        """
        self.filter, self._channel = request_filter, channel
        self._tls = tls
        self._view: ViserPage | None = None
        self.patched = False
        """Whether a server uses these routes."""
        self.is_open = False
        """Whether requests are answered."""

    def serve(self, handler: Callable[[Any], Awaitable[None]], *args: Any, **options: Any) -> Any:
        """Replaces `websockets.asyncio.server.serve`, with the same arguments."""
        page = options["process_request"]

        async def handle(socket: Any) -> None:
            visitor = self.filter.gate.visitors.visitor(socket.remote_address)
            visitor.connections += 1
            try:
                is_channel = request_path(socket.request.path) == CHANNEL
                await (self._channel(socket, visitor) if is_channel else handler(socket))
            finally:
                visitor.connections -= 1

        def process(socket: Any, request: Any) -> Any:
            return self._process(socket, request, page)

        self.patched = True
        ours: dict[str, Any] = {"process_request": process, "server_header": None, "logger": _handshake_log}
        if self._tls is not None:
            ours |= {"ssl": self._tls, "ssl_handshake_timeout": HANDSHAKE.maximum}
        return _serve(handle, *args, **options | ours)

    def _process(self, socket: Any, request: Any, page: Callable[[Any, Any], Any]) -> Any:
        if not self.is_open:
            return _response(socket, STARTING)
        headers = request.headers
        visitor, now_s = self.filter.gate.visitors.visitor(socket.remote_address), time.monotonic()
        if (headers.get("Upgrade") or "").lower() == "websocket":
            refusal = self.filter.socket_error(request.path, headers, visitor=visitor, now_s=now_s)
            return None if refusal is None else _response(socket, refusal)
        if is_texture_path(request.path):
            return self._texture(socket, request, visitor, now_s)
        answer = self.filter.respond(request.path, headers, visitor=visitor, now_s=now_s)
        if answer is None:
            answer = self._view_answer(request, lambda plain: page(socket, plain))
        return _response(socket, answer)

    async def _texture(self, socket: Any, request: Any, visitor: Visitor, now_s: float) -> Any:
        """Serves an image of a texture, in a thread: the first request of all computes it."""
        answer = await asyncio.to_thread(
            self.filter.respond, request.path, request.headers, visitor=visitor, now_s=now_s
        )
        assert answer is not None
        return _response(socket, answer)

    def _view_answer(self, request: Any, page: Callable[[Any], Any]) -> HttpResponse:
        """Serves viser's page with the additional scripts and headers."""
        if self._view is None:
            plain = page(replace(request, path="/", headers=type(request.headers)()))
            self._view = ViserPage(plain.body)
        return self._view.answer(request.headers, self.filter.view_headers(request.headers))


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
    """A module in which some names are replaced."""

    def __init__(self, module: Any, **names: Any) -> None:
        self._module = module
        self.__dict__.update(names)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._module, name)


async def _consume_messages(socket: Any, handle: Callable[[Any], None], message_class: Any) -> None:
    """Handles the messages of a 3D view, and drops those that are not of their declared type, as viser does not."""
    while True:
        data = await socket.recv()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                message = message_class.deserialize(data)
            values = {each.name: getattr(message, each.name) for each in fields(message)}
            msgspec.convert(values, type(message))
            _check_numbers(values.values())
        except Exception as error:  # whatever an arbitrary message makes viser raise
            _handshake_log.debug("a message of a 3D view was dropped: %s", error)
            continue
        handle(message)


def _check_numbers(values: Iterable[object]) -> None:
    """Checks the numbers of a message, in all depths.

    Raises:
        ValueError: one is not finite, or far beyond every scene.
    """
    for value in values:
        if isinstance(value, (list, tuple)):
            _check_numbers(value)
        elif isinstance(value, (int, float)) and not abs(value) <= VIEW_NUMBER.maximum:
            raise ValueError(f"{value} is out of range")


_infra._message_consumer = _consume_messages


@contextmanager
def patched_viser(routes: HttpRoutes) -> Iterator[None]:
    """While active, servers that viser creates use these routes."""
    with _patch_lock:
        library = _infra.websockets
        server = _ModuleProxy(library.asyncio.server, serve=routes.serve)
        _infra.websockets = _ModuleProxy(library, asyncio=_ModuleProxy(library.asyncio, server=server))
        try:
            yield
        finally:
            _infra.websockets = library


def event_message(topic: str, value: object) -> bytes:
    """Encodes an event."""
    return encode_json({"topic": topic, "value": value})


class ClientSession:
    """The connection of one page; a page that reconnects gets a new one. Methods may be called from any thread."""

    def __init__(self, key: str, socket: WebSocket) -> None:
        """Creates the session of an accepted websocket, on the event loop.

        Args:
            key: identifies the page and the 3D view in it.
            socket: the page's websocket.
        """
        self.key = key
        self.name = "a window"
        """What the people at other pages read."""
        self.state: dict[Hashable, Any] = {}
        """Values that request handlers keep for this session."""
        self._socket = socket
        self._loop = asyncio.get_running_loop()
        self._queue: deque[bytes] = deque()
        self._latest: dict[str, bytes] = {}
        self._sent: dict[str, bytes] = {}
        self._has_output = asyncio.Event()

    def send_event(self, topic: str, value: object) -> None:
        """Sends an event to this page only."""
        self.send(event_message(topic, value))

    def publish_to(self, topic: str, value: object) -> None:
        """Sends the current value of a topic to this page only, unless it is the value sent last."""
        text = event_message(topic, value)
        if self._sent.get(topic) != text:
            self._sent[topic] = text
            self.send_latest(topic, text)

    def send(self, text: bytes) -> None:
        """Sends a message."""
        self._call_soon(self.enqueue, text)

    def send_latest(self, topic: str, text: bytes) -> None:
        """Sends the current value of a topic; replaces an older value that is still queued."""
        self._call_soon(self._enqueue_latest, topic, text)

    def _call_soon(self, function: Callable[..., None], *args: object) -> None:
        try:
            self._loop.call_soon_threadsafe(function, *args)
        except RuntimeError:
            return  # the event loop is closed

    # -- on the event loop ---------------------------------------------------------------------------------------------

    def enqueue(self, text: bytes) -> None:
        """Queues a message."""
        self._queue.append(text)
        self._has_output.set()

    def _enqueue_latest(self, topic: str, text: bytes) -> None:
        self._latest[topic] = text
        self._has_output.set()

    async def run_sender(self) -> None:
        """Sends queued messages until the connection is closed."""
        try:
            while await self._has_output.wait():
                self._has_output.clear()
                while self._queue or self._latest:
                    if len(self._queue) > UNSENT_EVENTS.count:
                        await self._socket.close(1013, "the page is too slow")
                        return
                    text = self._queue.popleft() if self._queue else self._latest.pop(next(iter(self._latest)))
                    await self._socket.send(text, text=True)
        except ConnectionClosed:
            return


R = TypeVar("R", bound=msgspec.Struct)


@dataclass(frozen=True, slots=True)
class Later:
    """What a handler returns to wait without a thread."""

    future: Future[Any]
    finish: Callable[[], object]
    """Called in a worker thread when the future has ended; returns the result of the request, or raises its error."""


Handler = Callable[[ClientSession, R], object]
"""Handles a request of a session; returns a value for JSON, or raises a `MindstageError`."""

_log = logging.getLogger(__name__)


class _Request(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    id: Annotated[int, msgspec.Meta(ge=-(2**53), le=2**53)]
    method: str
    params: msgspec.Raw = msgspec.Raw(b"{}")


class _Method(msgspec.Struct, frozen=True):
    request_type: type[msgspec.Struct]
    handler: Handler[Any]
    queue: str
    policy: Policy


class EmptyRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The parameters of a request without parameters."""


class RpcChannel:
    """Requests from and events to all pages. Methods may be called from any thread."""

    def __init__(
        self,
        limits: RpcLimits = RpcLimits(),  # noqa: B008 - frozen
        *,
        expected_rebuild_s: Callable[[], float] = lambda: 0.0,
    ) -> None:
        """Creates a channel without methods and sessions.

        Args:
            limits: limits of what pages send.
            expected_rebuild_s: how long the model is expected to be rebuilt before time goes on [s]; it is part of the
                answers to all requests that may edit the world.
        """
        self.limits = limits
        self._expected_rebuild_s = expected_rebuild_s
        self._methods: dict[str, _Method] = {}
        self._states: dict[str, bytes] = {}
        self._sessions: dict[str, ClientSession] = {}
        self._windows: dict[str, int] = {}
        """The numbers of all pages that were open since the start, by key."""
        self._connect_callbacks: list[Callable[[ClientSession], None]] = []
        self._disconnect_callbacks: list[Callable[[ClientSession], None]] = []
        self._executor = ThreadPoolExecutor(max_workers=32, thread_name_prefix="mindstage-page")
        # Pages send it when nothing was received for some seconds, to notice that a server or network has stalled.
        self.register("ping", EmptyRequest, lambda _, __: None, CONTROL, queue="ping")

    # -- requests ------------------------------------------------------------------------------------------------------

    def register(
        self, name: str, request_type: type[R], handler: Handler[R], policy: Policy, *, queue: str = "world"
    ) -> None:
        """Registers the handler of a method.

        Args:
            name: the `method` of requests.
            request_type: the type of their `params`; it should forbid unknown fields.
            handler: called in a worker thread.
            policy: the limits of its requests.
            queue: requests of one session in the same queue are handled one after the other.

        Raises:
            ValueError: the method is registered already.
        """
        if name in self._methods:
            raise ValueError(f"the method {name!r} is registered already")
        self._methods[name] = _Method(request_type, handler, queue, policy)

    def entry_points(self) -> tuple[EntryPoint, ...]:
        """The methods that pages can call."""
        return tuple(EntryPoint(EntryKind.METHOD, name, method.policy) for name, method in self._methods.items())

    def on_connect(self, callback: Callable[[ClientSession], None]) -> None:
        """Registers a callback for new sessions; called in a worker thread."""
        self._connect_callbacks.append(callback)

    def on_disconnect(self, callback: Callable[[ClientSession], None]) -> None:
        """Registers a callback for closed sessions; called in a worker thread."""
        self._disconnect_callbacks.append(callback)

    # -- events --------------------------------------------------------------------------------------------------------

    @property
    def sessions(self) -> tuple[ClientSession, ...]:
        """The open sessions."""
        return tuple(self._sessions.values())

    def session(self, key: str | None) -> ClientSession | None:
        """The open session with a key, or None."""
        return self._sessions.get(key or "")

    def publish(self, topic: str, value: object) -> None:
        """Sets the value of a topic: sent to all sessions, and to later ones when they connect, if it has changed."""
        text = event_message(topic, value)
        if self._states.get(topic) != text:
            self._states[topic] = text
            for session in self.sessions:
                session.send_latest(topic, text)

    def broadcast(self, topic: str, value: object) -> None:
        """Sends an event to all open sessions."""
        text = event_message(topic, value)
        for session in self.sessions:
            session.send(text)

    def tell_others(self, session: ClientSession, text: str) -> None:
        """Tells all other pages what the people at a page did: "Window 2 loaded kitchen.owl"."""
        event = event_message("toast", {"text": f"{session.name} {without_paths(text)}.", "kind": "info"})
        for other in self.sessions:
            if other is not session:
                other.send(event)

    def close(self) -> None:
        """Stops handling requests."""
        self._executor.shutdown(wait=False, cancel_futures=True)

    # -- on the event loop ---------------------------------------------------------------------------------------------

    async def serve_session(self, socket: WebSocket, visitor: Visitor) -> None:
        """Serves one page until its websocket is closed.

        Args:
            socket: the page's websocket.
            visitor: where the page is open.
        """
        if len(self._sessions) >= self.limits.max_sessions:
            await socket.close(1013, "too many pages are open")
            return
        session = ClientSession(_session_key(socket.request.path), socket)
        socket.protocol.max_message_size = self.limits.message_bytes
        # A page that reconnects has the same key; its old session may not be closed yet.
        self._sessions[session.key] = session
        session.name = f"Window {self._windows.setdefault(session.key, len(self._windows) + 1)}"
        for topic, text in list(self._states.items()):
            session.send_latest(topic, text)
        tasks = [asyncio.create_task(session.run_sender())]
        await self._run_callbacks(self._connect_callbacks, session)
        try:
            await self._receive(socket, session, tasks, visitor)
        except ConnectionClosed:
            pass
        finally:
            for task in tasks:
                task.cancel()
            if self._sessions.get(session.key) is session:
                del self._sessions[session.key]
            await self._run_callbacks(self._disconnect_callbacks, session)

    async def _receive(
        self, socket: WebSocket, session: ClientSession, tasks: list[asyncio.Task[None]], visitor: Visitor
    ) -> None:
        queues: dict[str, asyncio.Lock] = defaultdict(asyncio.Lock)
        rate = TokenBucket(self.limits.max_requests_per_second, 2 * self.limits.max_requests_per_second)
        pending: set[asyncio.Task[None]] = set()
        while True:
            message = await socket.recv()
            if visitor.receive_delay and (delay_s := visitor.receive_delay(len(message), time.monotonic())) > 0.0:
                await asyncio.sleep(delay_s)
            request = self._read(message, session)
            if request is None:
                continue
            now_s, method = time.monotonic(), self._methods[request.method]
            try:
                if len(pending) >= self.limits.max_pending or not rate.try_take(now_s):
                    raise RequestLimitError(request.method, cause="too many requests at once; wait for the responses")
                method.policy.admit(request.method, len(bytes(request.params)), visitor, now_s)
            except RequestLimitError as error:
                session.send(_error_message(request.id, error.code, str(error)))
                continue
            task = asyncio.create_task(self._reply(session, request, queues[method.queue]))
            pending.add(task)
            task.add_done_callback(pending.discard)
            tasks[1:] = pending

    def _read(self, message: str | bytes, session: ClientSession) -> _Request | None:
        """Decodes a request of a registered method; anything else is answered with an error."""
        try:
            request = msgspec.json.decode(message, type=_Request)
        except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
            refused = InvalidRequestError("a message", cause=str(error))
            session.send(_error_message(_request_id(message), "InvalidRequestError", str(refused)))
            return None
        if request.method not in self._methods:
            refused = InvalidRequestError(repr(request.method), cause="there is no such method", known=self._methods)
            session.send(_error_message(request.id, "InvalidRequestError", str(refused)))
            return None
        return request

    async def _reply(self, session: ClientSession, request: _Request, queue: asyncio.Lock) -> None:
        async with queue:
            deadline_s = self._methods[request.method].policy.deadline_s
            try:
                running = asyncio.ensure_future(self._run(session, request))
                done, _ = await asyncio.wait([running], timeout=deadline_s)
                if not done:
                    text = f"{request.method} has not ended within {deadline_s:g} s; it goes on"
                    session.enqueue(_error_message(request.id, "TimedOut", text))
                    await running  # requests of a queue keep their order
                    return
                session.enqueue(running.result())
            except RuntimeError:  # the executor is shut down
                return

    async def _run(self, session: ClientSession, request: _Request) -> bytes:
        loop = asyncio.get_running_loop()
        reply = await loop.run_in_executor(self._executor, self._run_handler, session, request)
        while isinstance(reply, Later):
            answer = asyncio.wrap_future(reply.future)
            # The reply has its exception; asyncio reports one that nobody reads.
            answer.add_done_callback(lambda done: done.cancelled() or done.exception())
            await asyncio.wait([answer])
            reply = await loop.run_in_executor(self._executor, self._run_handler, session, request, reply)
        return reply

    def _run_handler(self, session: ClientSession, request: _Request, later: Later | None = None) -> bytes | Later:
        """Calls the handler of a request, or finishes it; returns the reply, or what to wait for."""
        method = self._methods[request.method]
        try:
            arguments = msgspec.json.decode(request.params, type=method.request_type)
        except (msgspec.DecodeError, RecursionError) as error:
            refused = InvalidRequestError(repr(request.method), cause=str(error))
            return _error_message(request.id, "InvalidRequestError", str(refused))
        try:
            with as_client(CLIENT):
                result = method.handler(session, arguments) if later is None else later.finish()
                if isinstance(result, Later):
                    return result
                answer: dict[str, object] = {"id": request.id, "result": result}
                if method.policy.cost in (Cost.EDIT, Cost.FILE):
                    answer["expected_rebuild_s"] = round(self._expected_rebuild_s(), 6)
                return encode_json(answer)
        except MindstageError as error:
            return _error_message(
                request.id, error.code, without_paths(str(error), given=bytes(request.params).decode())
            )
        except Exception as error:  # reported to the page and logged
            _log.error("request %r failed", request.method, exc_info=error)
            return _error_message(
                request.id, "Defect", without_paths(f"{type(error).__name__}: {error}; this is a defect of Mindstage")
            )

    async def _run_callbacks(self, callbacks: list[Callable[[ClientSession], None]], session: ClientSession) -> None:
        loop = asyncio.get_running_loop()
        for callback in callbacks:
            try:
                await loop.run_in_executor(self._executor, callback, session)
            except RuntimeError:
                return


def _request_id(message: str | bytes) -> int | None:
    """The id of a request that is JSON but for NaN and Infinity, or that is otherwise invalid; None without one."""
    try:
        request = json.loads(message, parse_int=lambda digits: int(digits) if len(digits) < 20 else None)
    except (ValueError, RecursionError):
        return None
    id = request.get("id") if isinstance(request, dict) else None
    return id if isinstance(id, int) and not isinstance(id, bool) else None


def _error_message(id: int | None, code: str, text: str) -> bytes:
    return encode_json({"id": id, "error": {"code": code, "message": text}})


def _session_key(path: str) -> str:
    key = parse_qs(urlsplit(path).query).get("client", [""])[0]
    return key if re.fullmatch("[a-z0-9]{8,40}", key) else secrets.token_hex(8)


_output_lock = threading.Lock()


class ViewerServer(viser.ViserServer):
    """Viser's server with the routes of Mindstage."""

    secure = False
    """Whether it serves https://."""
    routes: HttpRoutes
    """Answers the requests."""

    @property
    def filter(self) -> RequestFilter:
        """Decides which requests are answered."""
        return self.routes.filter

    def open(self) -> None:
        """Begins to answer requests, when everything that they need exists."""
        self.routes.is_open = True

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Returns None: viser would publish the page on the internet whenever a client asks for it."""
        return None


def serve(
    host: str,
    port: int | None,
    *,
    title: str,
    channel: RpcChannel,
    token: str | None = None,
    origins: Collection[str] = (),
    tls: TlsCertificate | None = None,
    visitor_limits: VisitorLimits = DEFAULT_VISITOR_LIMITS,
) -> ViewerServer:
    """Starts a server, which answers 503 until it is opened (`ViewerServer.open`).

    Args:
        host: the address to listen on; any other than a loopback address needs a token.
        port: the port; 0 lets the system choose, and None is `PAGE_PORT`, or the next free one.
        title: the title of the page.
        channel: serves the websockets of pages.
        token: the token that clients need.
        origins: further origins under which the page may be opened.
        tls: the certificate for https://; None serves http://.
        visitor_limits: limits of each client address.

    Raises:
        AuthenticationError: the host is not a loopback address, and there is no token.
        CertificateError: the certificate cannot be used.
        ViewerUnavailableError: the host is not an address of this machine, or the port is in use.
    """
    gate = Gate(host=host, token=token, origins=origins, secure=tls is not None, limits=visitor_limits)
    context = None if tls is None else tls.server_context()
    routes = HttpRoutes(RequestFilter(gate), channel=channel.serve_session, tls=context)
    free = _free_port(host, port)
    with _without_output(), patched_viser(routes):
        server = ViewerServer(host=host, port=free, label=title, verbose=False)
    if not routes.patched:
        shut_down(server)
        raise ViewerUnavailableError(
            host, free, cause="this release of viser cannot be patched with the request filter"
        )
    if free and server.get_port() != free:  # taken by another process in the meantime
        shut_down(server)
        raise ViewerUnavailableError(host, free, cause=unavailable_text(OSError(errno.EADDRINUSE, ""), free))
    if port is None and free != PAGE_PORT:
        _log.warning("%s", moved_text("the page", default=PAGE_PORT, port=free))
    server.secure, server.routes = tls is not None, routes
    server._websock_server._broadcast_buffer.max_window_size = WINDOW.count
    server.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(232, 93, 4))
    return server


def session_key_of(client: viser.ClientHandle, server: viser.ViserServer) -> str | None:
    """The session key of the page that contains a view; None if the view was opened without the page."""
    connection = server._websock_server._live_connections.get(client.client_id)
    return view_key(connection.request.path) if connection is not None and connection.request is not None else None


def shut_down(server: viser.ViserServer) -> None:
    """Stops a server; open pages show that the connection is lost."""
    with _without_output():
        server.stop()


def address(server: viser.ViserServer) -> str:
    """The URL of the page."""
    scheme = "https" if isinstance(server, ViewerServer) and server.secure else "http"
    host = {"0.0.0.0": "127.0.0.1", "::": "::1", "": "127.0.0.1"}.get(server.get_host(), server.get_host())
    return f"{scheme}://{f'[{host}]' if ':' in host else host}:{server.get_port()}"


def _free_port(host: str, port: int | None) -> int:
    cause: OSError | None = None
    ports = ports_to_try(port, default=PAGE_PORT)
    for candidate in ports:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        try:
            with socket.create_server((host, candidate), family=family):
                return candidate
        except OverflowError as error:
            raise ViewerUnavailableError(host, candidate, cause="there is no such port") from error
        except OSError as error:
            cause = cause or error  # of the port that is wanted
            if not is_taken(error):
                break
    assert cause is not None
    raise ViewerUnavailableError(host, ports[0], cause=unavailable_text(cause, ports[0])) from cause


@contextmanager
def _without_output() -> Iterator[None]:
    # viser prints to stdout. The lock is needed because overlapping redirections would restore each other's stdout.
    with _output_lock, redirect_stdout(io.StringIO()):
        yield
