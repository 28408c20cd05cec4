"""A client of a rosbridge server, which reconnects and then advertises and subscribes again.

When the connection is lost, all pending calls and goals fail at once with `ConnectionLostError`.

What the server refuses is kept as a `Refusal`. Mindstage's own server sends a `status` message about it. The servers of
rosbridge_suite only log it, in both branches (`Protocol.log` in `rosbridge_library/protocol.py`), and every ROS log is
published on `/rosout`; so the client subscribes to that topic before anything else, and each operation has an id, which
the log repeats. A server that is not Mindstage's has only the types of packages that it finds (`paced_advertising`).
Those of rosbridge_suite accept only objects as the `values` of a response and ignore `result` (`service_response.py`,
`action_result.py`); an error is therefore sent as the type's own failure or as an empty object, beside a `reason`.
"""

from __future__ import annotations

import asyncio
import logging
import random
import re
import secrets
import threading
from collections.abc import Callable, Hashable
from concurrent.futures import Future
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from ssl import SSLCertVerificationError, SSLError
from typing import Any

import msgspec
from websockets.asyncio.client import connect
from websockets.exceptions import InvalidStatus, InvalidURI, WebSocketException

from mindstage.access.certificates import client_tls_context
from mindstage.access.limits import DEFAULT_BRIDGE_LIMITS, LOOP_TIME, BridgeLimits, Timeout
from mindstage.bridge.broker import resolve_name
from mindstage.bridge.calls import encode_values
from mindstage.bridge.node import MessageSender, Node
from mindstage.bridge.paced_advertising import ADVERTISEMENT_BATCH, PacedAdvertising, package_of
from mindstage.bridge.protocol import (
    ActionResult,
    Advertise,
    AdvertiseAction,
    AdvertiseService,
    GoalStatus,
    Id,
    MessageEncoder,
    Operation,
    Publish,
    ServiceResponse,
    Status,
    StatusLevel,
    Subscribe,
    Unsubscribe,
    content,
)
from mindstage.bridge.server import SERVER_NAME, Connection
from mindstage.errors import (
    AuthenticationError,
    BridgeError,
    CertificateError,
    ConnectionLostError,
    ServiceCallError,
)
from mindstage.ranges import checked

__all__ = ["ConnectionState", "Refusal", "RosbridgeClient"]

_MIN_RECONNECT_DELAY_S = 0.2
_MAX_RECONNECT_DELAY_S = 15.0
_OPEN_TIMEOUT_S = 10.0
_PING_INTERVAL_S = 10.0
_AUTH_ERROR_CODES = (401, 403)
_LOG_TOPIC = "/rosout"
_CLOCK_SERVICE = "/rosapi/get_time"
_LOG_TIMEOUT_S = 1.0
"""Longest time for which operations wait for the server's log, so that no refusal is missed [s]."""
_LOG_INTERVAL_S = 0.1
_PACE_S = 0.1
"""Time after a batch of advertisements at a server without rosapi, whose answer would end it [s]."""
_ROUND_TRIP_TIMEOUT_S = 5.0
_TRY_AGAIN_LATER = 1013
"""Code with which a server closes a connection because too much is waiting, in RFC 6455's registry."""
_LOGGING_SERVERS = ("AutobahnPython", "TornadoServer")
"""Names of the websocket servers of rosbridge_suite, in the header `Server` of the handshake."""
_SEVERE_LEVELS = frozenset({4, 8, 16, 30, 40, 50})
"""Warnings and errors: 4, 8, 16 in `rosgraph_msgs/Log` of ROS 1, and 30, 40, 50 in `rcl_interfaces/Log` of ROS 2."""
_LOG_WITH_ID = re.compile(r"\[Client [^\]]*\] \[id: (?P<id>.+?)\] (?P<text>.*)", re.DOTALL)
_LOG_OF_FILTER = re.compile(r"\[Client [^\]]*\] (?P<text>No match found for \w+, cancelling .*[ :](?P<name>/\S+))")
"""rosbridge_suite logs this if the topic or service is not among those that it was started for (`topics_glob`)."""
_REQUEST_IDS = {"service_request": "service_response", "action_goal": "action_result"}
"""What the ids of the server's requests begin with, and the operation that answers them."""
_MAX_REFUSALS = 1000
_log = logging.getLogger("mindstage.bridge")


@dataclass(frozen=True, slots=True, kw_only=True)
class Refusal:
    """An operation that the server refused."""

    operation: str
    """Such as `subscribe` or `advertise_service`."""
    name: str
    """Name of the topic, service or action."""
    cause: str
    """The server's message."""
    package: str = ""
    """The package of ROS that the server lacks, if that is the reason; all that needs it is left out."""

    def __str__(self) -> str:
        return f"{self.operation} {self.name}: {self.cause}"


class _LogEntry(msgspec.Struct):
    """The common fields of a log message in ROS 1 and ROS 2."""

    level: int
    msg: str


_log_decoder = msgspec.json.Decoder(_LogEntry)


class ConnectionState(StrEnum):
    """State of a connection."""

    CONNECTING = "connecting"
    CONNECTED = "connected"
    LOST = "lost"
    """The connection was lost; the client tries to reconnect."""
    CLOSED = "closed"


class RosbridgeClient(Node):
    """A node at a rosbridge server; connects from its creation until `close`.

    `wait_connected` waits for the connection. All callers of its services share the one connection to the server: plain
    functions handle their calls one at a time, in the order of arrival.
    """

    @checked
    def __init__(
        self,
        url: str,
        *,
        token: str | None = None,
        tls_authorities: Path | None = None,
        limits: BridgeLimits = DEFAULT_BRIDGE_LIMITS,
        max_reconnect_delay_s: Timeout = _MAX_RECONNECT_DELAY_S,
        on_state: Callable[[ConnectionState], object] | None = None,
        on_status: Callable[[Status], object] | None = None,
        on_refusal: Callable[[Refusal], object] | None = None,
    ) -> None:
        """Starts to connect, without waiting.

        Args:
            url: such as `ws://127.0.0.1:9090`, or `wss://robot.example:9090`, whose certificate is checked.
            token: sent to the server, if it requires one.
            tls_authorities: certificates of authorities that are trusted for `wss://` besides those of the system.
            limits: limits for what the server sends.
            max_reconnect_delay_s: longest time between two attempts to reconnect; each delay is twice the one before
                [s].
            on_state: called with every change of `state`, on the bridge's thread; must not block.
            on_status: called with status messages of the server, likewise; by default, they are logged.
            on_refusal: called with each operation that the server refuses, likewise; by default, a warning is logged.

        Raises:
            ConnectionLostError: the URL is invalid.
            CertificateError: the file of authorities cannot be used, or the URL needs none.
        """
        if not url.startswith(("ws://", "wss://")):
            raise ConnectionLostError(url, cause="the URL must begin with ws:// or wss://")
        is_secure = url.startswith("wss://")
        if tls_authorities is not None and not is_secure:
            cause, remedy = f"{url} is not encrypted", "connect to wss://, or give no authorities"
            raise CertificateError(str(tls_authorities), cause=cause, remedy=remedy)
        tls = client_tls_context(tls_authorities) if is_secure else None
        super().__init__(name="mindstage-client")
        self._tls = tls
        self.url = url
        self.state: ConnectionState = ConnectionState.CONNECTING
        self._token = token
        self._limits = limits
        self._max_reconnect_delay_s = max_reconnect_delay_s
        self._on_state = on_state
        self._status_callback = on_status
        self._refusal_callback = on_refusal
        self._refusal_listeners = [] if on_refusal is None else [on_refusal]
        self._refusals: dict[tuple[str, str], Refusal] = {}
        self._session = secrets.token_hex(4)
        """A part of the ids, since the log of the server also has the ids of its other clients."""
        self._answered_again: set[Id] = set()
        self._log_opened: asyncio.Event | None = None
        self.is_rosbridge_suite = False
        """Whether the server is rosbridge_suite's; known once it is connected."""
        self.needs_packages = False
        """Whether the server is one of ROS, which has only the types of packages that it finds; likewise."""
        self.has_rosapi: bool | None = None
        """Whether the server answers the services of rosapi; None until it is known."""
        self._batch = ADVERTISEMENT_BATCH
        self._pacing: PacedAdvertising | None = None
        self._connection: Connection | None = None
        self._first_attempt_done = threading.Event()
        self._cause: BridgeError = ConnectionLostError(url, cause="not connected yet")
        self._connect_task: Future[None] = asyncio.run_coroutine_threadsafe(self._connect_loop(), self._loop.loop)

    @property
    def closed(self) -> bool:
        """Whether `close` was called."""
        return self.state is ConnectionState.CLOSED

    @property
    def connected(self) -> bool:
        """Whether there is a connection now."""
        return self.state is ConnectionState.CONNECTED

    @property
    def refusals(self) -> tuple[Refusal, ...]:
        """What the server has refused since the connection was opened, the first for each operation and name."""
        return tuple(self._refusals.copy().values())

    def add_refusal_listener(self, listener: Callable[[Refusal], object]) -> Callable[[], None]:
        """Registers a function that is called with each new refusal, on the bridge's thread; it must not block.

        It is first called with the refusals so far. The returned function removes it.
        """

        def add() -> None:
            self._refusal_listeners.append(listener)
            for refusal in self.refusals:
                self._notify(listener, refusal)

        def remove() -> None:
            if listener in self._refusal_listeners:
                self._refusal_listeners.remove(listener)

        self._loop.call(add)
        return remove

    def report_refusal(self, refusal: Refusal) -> None:
        """Adds a refusal that was found in another way, from any thread."""
        self._loop.call(self._refuse, refusal)

    @checked
    def wait_connected(self, timeout_s: Timeout = 10.0) -> RosbridgeClient:
        """Waits for the connection, over as many attempts as fit into the time.

        Raises:
            ConnectionLostError: there is no connection.
            AuthenticationError: the server rejects the token.
        """
        self._require_other_thread("wait_connected")
        if not self._first_attempt_done.wait(timeout_s) or not self.connected:
            raise self._cause
        return self

    @checked
    def wait_advertised(self, timeout_s: Timeout = 30.0) -> bool:
        """Waits until the server has handled all advertisements and subscriptions so far.

        Returns:
            Whether it has; False after the time, or without a connection.
        """
        self._require_other_thread("wait_advertised")

        async def wait() -> bool:
            pacing = self._pacing
            if pacing is None:
                return self.connected
            try:
                async with asyncio.timeout(timeout_s):
                    await pacing.is_idle.wait()
            except TimeoutError:
                return False
            return self._pacing is pacing

        return self._loop.run(wait(), timeout_s=timeout_s + LOOP_TIME.maximum)

    def has_subscribers(self, topic: str) -> bool:
        """Whether a message might be received; the subscribers at the server are unknown, so it is `connected`."""
        return self.connected and ("advertise", resolve_name(topic)) not in self._refusals

    def close(self) -> None:
        """Closes the connection for good; calling it again is harmless."""
        if self.closed:
            return
        self._require_other_thread("close")
        self._loop.call(self._set_state, ConnectionState.CLOSED)
        self._cause = ConnectionLostError(self.url, cause="this client was closed")
        self._loop.run(self._send_unadvertise(), timeout_s=_OPEN_TIMEOUT_S)
        self._first_attempt_done.set()
        self._close(self._cause)

    def __enter__(self) -> RosbridgeClient:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # -- on the loop ---------------------------------------------------------------------------------------------------

    async def _connect_loop(self) -> None:
        delay_s = _MIN_RECONNECT_DELAY_S
        while not self.closed:
            start_s = self._loop.loop.time()
            try:
                code = await self._run_connection()
                if code == _TRY_AGAIN_LATER:
                    self._batch = max(1, self._batch // 2)
                elif self._loop.loop.time() - start_s > delay_s:  # not closed right after the handshake
                    delay_s = _MIN_RECONNECT_DELAY_S
            except (OSError, WebSocketException, TimeoutError) as error:
                self._cause = _connection_error(self.url, error)
                if isinstance(self._cause, AuthenticationError) or isinstance(error, InvalidURI | SSLError):
                    self._first_attempt_done.set()  # retries continue, but the caller need not wait for them
            except Exception as error:  # an unexpected error must not end the retries silently
                _log.exception("the connection to %s failed", self.url)
                self._cause = ConnectionLostError(self.url, cause=f"{type(error).__name__}: {error}")
            if self.closed:
                return
            # The random factor spreads the reconnections of many clients after a restart of the server.
            await asyncio.sleep(delay_s * random.uniform(0.5, 1.0))
            delay_s = min(2.0 * delay_s, self._max_reconnect_delay_s)

    async def _run_connection(self) -> int | None:
        """Connects, and returns the code of the close when the connection has ended."""
        # Sent without a token too, so that a server that needs one rejects the handshake instead of waiting for `auth`.
        headers = {"Authorization": f"Bearer {self._token or ''}"}
        socket = await connect(
            self.url,
            additional_headers=headers,
            compression=None,
            max_size=self._limits.message_bytes,
            ssl=self._tls,
            open_timeout=_OPEN_TIMEOUT_S,
            ping_interval=_PING_INTERVAL_S,
            ping_timeout=_PING_INTERVAL_S,
            close_timeout=2.0,
            proxy=None,
        )
        connection = Connection(
            socket,
            self._limits,
            receive=lambda operation, _: self._receive(operation),
            send_error=self._send_error_status,
        )
        self._refusals.clear()
        self._answered_again.clear()
        running = asyncio.ensure_future(connection.run())
        advertising: asyncio.Future[None] | None = None
        try:
            server = socket.response.headers.get("Server", "") if socket.response else ""
            self.is_rosbridge_suite = server.startswith(_LOGGING_SERVERS)
            if self.is_rosbridge_suite:
                await self._open_log(connection, running)
            self._connection = connection
            self.needs_packages = server != SERVER_NAME
            advertising = self._start_advertising()
            self._set_state(ConnectionState.CONNECTED)
            self._first_attempt_done.set()
            if advertising is not None:
                await asyncio.wait((running, advertising), return_when=asyncio.FIRST_COMPLETED)
                if advertising.done():
                    await advertising  # raises its error
            await running
            return socket.close_code
        finally:
            running.cancel()
            if advertising is not None:
                advertising.cancel()
            if self._pacing is not None:
                self._pacing.is_idle.set()  # nobody waits for this connection any longer
            self._connection, self._pacing, self.has_rosapi = None, None, None
            self._cause = ConnectionLostError(self.url, cause=connection.close_reason)
            if not self.closed:
                self._first_attempt_done.clear()
                self._set_state(ConnectionState.LOST)
            self._pending_calls.fail_all(self._cause)
            self._dispatcher.cancel_all()

    def _start_advertising(self) -> asyncio.Future[None] | None:
        """Advertises and subscribes at a new connection; returns the task that does it at a server of ROS."""
        advertising = None
        if self.needs_packages:
            self._pacing = PacedAdvertising(
                self._send_now, self._round_trip, self._leave_out, self._send_if_possible, batch=self._batch
            )
            advertising = asyncio.ensure_future(self._pacing.run())
        for key, operation in self._advertisements.items():
            self._send_advertisement(key, operation)
        return advertising

    async def _open_log(self, connection: Connection, running: asyncio.Future[None]) -> None:
        """Subscribes to the log of the server, and waits until it is received or the time is over.

        What the server logs before its own subscription exists is lost. Each request is logged itself ("Subscribed to
        /rosout"), so it is repeated until the first log message arrives.
        """
        self._log_opened = opened = asyncio.Event()
        request = Subscribe(id=f"subscribe:{_LOG_TOPIC}:{self._session}", topic=_LOG_TOPIC)
        waiting = asyncio.ensure_future(opened.wait())
        end_s = self._loop.loop.time() + _LOG_TIMEOUT_S
        while not waiting.done() and not running.done() and self._loop.loop.time() < end_s:
            connection.send(MessageEncoder(request))
            await asyncio.wait((waiting, running), timeout=_LOG_INTERVAL_S, return_when=asyncio.FIRST_COMPLETED)
        waiting.cancel()

    async def _send_unadvertise(self) -> None:
        connection = self._connection
        if connection is not None:
            connection.close("the client was closed")
            await asyncio.wait([asyncio.wrap_future(self._connect_task)], timeout=5.0)
        self._connect_task.cancel()

    def _set_state(self, state: ConnectionState) -> None:
        self.state = state
        if self._on_state is not None:
            try:
                self._on_state(state)
            except Exception:
                _log.exception("the state handler failed")

    # -- advertisements ------------------------------------------------------------------------------------------------

    def _advertise(self, key: Hashable, operation: Operation) -> None:
        self._advertisements[key] = operation
        if self._connection is not None:
            self._send_advertisement(key, operation)

    def _unadvertise(self, key: Hashable, operation: Operation) -> None:
        advertised = self._advertisements.pop(key, None)
        if advertised is None or _key(advertised) in self._refusals:
            return
        if self._pacing is None:
            self._send_if_possible(operation)
        else:
            self._pacing.withdraw(key, operation)

    def _send_advertisement(self, key: Hashable, operation: Operation) -> None:
        if self._pacing is None:
            self._send_now(operation)
        else:
            self._pacing.add(key, operation)

    async def _round_trip(self) -> None:
        """Returns when the server has handled what was sent before, as far as that can be known."""
        if self.has_rosapi is not False:
            answer: Future[Any] = Future()
            self._pending_calls.call_service(_CLOCK_SERVICE, encode_values({}), _ROUND_TRIP_TIMEOUT_S, answer)
            try:
                await asyncio.wrap_future(answer)
                self.has_rosapi = True
            except BridgeError as error:
                _log.info("%s has no rosapi: %s", self.url, error)
                self.has_rosapi = False
        if self.has_rosapi is False or self.is_rosbridge_suite:  # which logs refusals, beside the answer
            await asyncio.sleep(_PACE_S)

    def _leave_out(self, operation: Operation, package: str) -> None:
        operation_tag, name = _key(operation)
        cause = f"the server lacks the package {package}"
        self._refusals[operation_tag, name] = Refusal(operation=operation_tag, name=name, cause=cause, package=package)

    def _send(self, operation: Operation) -> None:
        if self._connection is None:
            raise self._cause
        if isinstance(operation, Publish):
            if ("advertise", resolve_name(operation.topic)) in self._refusals:
                return  # each message would be refused and logged again
            if self._pacing is not None and self._pacing.hold(operation):
                return
        self._send_now(operation)

    def _send_now(self, operation: Operation) -> None:
        if self._connection is not None:
            self._connection.send(MessageEncoder(self._prepared(operation)))

    def _prepared(self, operation: Operation) -> Operation:
        """Returns an operation as the servers of rosbridge_suite accept it, with an id that its refusal repeats."""
        match operation:
            case ServiceResponse(result=False) | ActionResult(result=False):
                return _with_object(operation)
            case Publish(id=None):
                latch = True if self._is_latched(operation.topic) else operation.latch
                return self._with_id(msgspec.structs.replace(operation, latch=latch), operation.topic)
            case Advertise(id=None):
                return self._with_id(operation, operation.topic)
            case AdvertiseService(id=None, service=name) | AdvertiseAction(id=None, action=name):
                return self._with_id(operation, name)
            case Subscribe() | Unsubscribe() if operation.id is not None:
                return msgspec.structs.replace(operation, id=f"{operation.id}:{self._session}")
            case _:
                return operation

    def _is_latched(self, topic: str) -> bool:
        """Whether later subscribers receive its last message, which rosbridge_suite wants to hear with each message."""
        known = self._advertisements.get(("topic", resolve_name(topic)))
        return isinstance(known, Advertise) and known.latch

    def _with_id(self, operation: Operation, name: str) -> Operation:
        return msgspec.structs.replace(operation, id=f"{_tag(operation)}:{name}:{self._session}")

    # -- refusals ------------------------------------------------------------------------------------------------------

    def _receive(self, operation: Operation, sender: MessageSender | None = None) -> None:
        if isinstance(operation, Publish) and resolve_name(operation.topic) == _LOG_TOPIC:
            if self._log_opened is not None:
                self._log_opened.set()
            self._read_log(operation.msg)
        super()._receive(operation, sender)

    def _read_log(self, message: msgspec.Raw) -> None:
        """Finds refusals of this client's operations in a log message of the server."""
        raw = bytes(message)
        if b"[id: " not in raw and b"No match found" not in raw:
            return
        try:
            entry = _log_decoder.decode(raw)
        except msgspec.DecodeError as error:
            _log.debug("a log message of the server is not readable: %s", error)
            return
        if entry.level not in _SEVERE_LEVELS:
            return
        if found := _LOG_WITH_ID.search(entry.msg):
            self._refuse_id(found["id"], found["text"])
        elif found := _LOG_OF_FILTER.search(entry.msg):
            self._refuse_name(found["name"], found["text"])

    def _refuse_id(self, id: str, cause: str) -> bool:
        """Handles the refusal of the operation with an id; returns whether it is one of this client."""
        tag, _, rest = id.partition(":")
        name = rest.partition(":")[0]
        if id.endswith(f":{self._session}"):
            self._refuse_advertisement(tag, resolve_name(name), cause)
        elif tag in _REQUEST_IDS and self._provides(name):
            self._refuse(Refusal(operation=_REQUEST_IDS[tag], name=resolve_name(name), cause=cause))
            self._answer_again(id, tag, name)
        else:
            # A failed call is logged as "call_service SomeException: ..." and has a response with the cause; one whose
            # fields are wrong is logged as "call_service: ..." and has none.
            answered = re.match(r"(call_service|send_action_goal) \w+: ", cause)
            return not answered and self._pending_calls.fail(id, ServiceCallError(name, cause=cause))
        return True

    def _refuse_advertisement(self, tag: str, name: str, cause: str) -> None:
        package = ""
        if self._pacing is not None and (tag, name) not in self._refusals:
            refused = next((each for each in self._advertisements.values() if _key(each) == (tag, name)), None)
            if refused is not None and self._pacing.on_refusal(refused, cause):
                package = package_of(refused)
        self._refuse(Refusal(operation=tag, name=name, cause=cause, package=package))

    def _refuse_name(self, name: str, cause: str) -> None:
        for operation in self._advertisements.values():
            tag, named = _key(operation)
            if named == resolve_name(name):
                self._refuse(Refusal(operation=tag, name=named, cause=cause))

    def _refuse(self, refusal: Refusal) -> None:
        key = (refusal.operation, refusal.name)
        if key in self._refusals or len(self._refusals) >= _MAX_REFUSALS:
            return
        self._refusals[key] = refusal
        level = logging.WARNING if self._refusal_callback is None else logging.INFO
        _log.log(level, "%s refused an operation: %s", self.url, refusal)
        for listener in tuple(self._refusal_listeners):
            self._notify(listener, refusal)

    def _notify(self, listener: Callable[[Refusal], object], refusal: Refusal) -> None:
        try:
            listener(refusal)
        except Exception:
            _log.exception("the handler of refusals failed")

    def _provides(self, name: str) -> bool:
        return any((kind, resolve_name(name)) in self._advertisements for kind in ("service", "action"))

    def _answer_again(self, id: str, tag: str, name: str) -> None:
        """Ends a call whose response was refused, once, by an empty response; its caller would wait forever."""
        if id in self._answered_again or len(self._answered_again) >= _MAX_REFUSALS:
            return
        self._answered_again.add(id)
        reason = f"the response of {name} was refused by {self.url}"
        empty = msgspec.Raw(b"{}")
        if tag == "service_request":
            response = ServiceResponse(id=id, service=name, values=empty, result=False, reason=reason)
            self._send_if_possible(response)
        else:
            status = GoalStatus.ABORTED
            self._send_if_possible(
                ActionResult(id=id, action=name, values=empty, status=status, result=False, reason=reason)
            )

    def _send_error_status(self, text: str, id: Id | None, answer: Operation | None) -> None:
        _log.warning("invalid message from %s: %s (id %r)", self.url, text, id)
        if answer is not None:
            self._send_if_possible(answer)

    def _on_status(self, status: Status) -> None:
        is_severe = status.level in {StatusLevel.ERROR, StatusLevel.WARNING} and status.id is not None
        is_refusal = is_severe and self._refuse_id(str(status.id), status.msg)
        if self._status_callback is None:
            if not is_refusal:  # which is logged, or handled by its own callback
                super()._on_status(status)
            return
        try:
            self._status_callback(status)
        except Exception:
            _log.exception("the status handler failed")


def _tag(operation: Operation) -> str:
    return str(operation.__struct_config__.tag)


def _key(operation: Operation) -> tuple[str, str]:
    """The operation and the name of what it advertises or subscribes to, as in a `Refusal`."""
    names = (getattr(operation, field, None) for field in ("topic", "service", "action"))
    return _tag(operation), resolve_name(next(filter(None, names), ""))


def _with_object(response: ServiceResponse | ActionResult) -> ServiceResponse | ActionResult:
    """Returns a failed response whose values are an object; an error message becomes the reason."""
    values = content(response.values)
    if bytes(values).startswith(b"{"):
        return response
    text = msgspec.json.decode(values)
    reason = text if isinstance(text, str) else bytes(values).decode()
    return msgspec.structs.replace(response, values=msgspec.Raw(b"{}"), reason=response.reason or reason)


def _connection_error(url: str, error: Exception) -> BridgeError:
    if isinstance(error, InvalidStatus) and error.response.status_code in _AUTH_ERROR_CODES:
        body = (error.response.body or b"").decode("utf-8", "replace").strip()
        return AuthenticationError(url, cause=body or f"the server answered {error.response.status_code}")
    if isinstance(error, SSLCertVerificationError):
        cause = f"its certificate is not accepted: {error.verify_message}"
        return ConnectionLostError(url, cause=f"{cause}; an authority of your own is trusted with --tls-ca")
    if isinstance(error, SSLError):
        return ConnectionLostError(url, cause=f"no TLS connection ({error.reason or error}); is it a ws:// server?")
    if isinstance(error, TimeoutError):
        return ConnectionLostError(url, cause=f"no reply within {_OPEN_TIMEOUT_S:g} s")
    cause = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return ConnectionLostError(url, cause=cause or type(error).__name__)
