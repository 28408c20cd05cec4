"""Link: the way to one far engine. It asks, waits for at most so long, and tells what became of it as engines do.

A connection that broke comes back by itself, and a call that finds it broken waits a moment for that. What was under
way at the time is not asked again, for nobody knows whether it was done.

Address: where a far engine is, as people type it: `ros://HOST:PORT/NAMESPACE?token=…`.

Only the host must be there. The port is rosbridge's 9090, the namespace Unreal's plugin's, and the profile is found
out by asking.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from enum import StrEnum
from typing import Any, Protocol
from urllib.parse import SplitResult, parse_qs, quote, unquote, urlsplit

import msgspec

from mindstage.bridge import BridgeLimits, ConnectionState, RosbridgeClient
from mindstage.bridge.conversions import error_from_text
from mindstage.errors import (
    BridgeError,
    ConnectionLostError,
    EngineError,
    EngineTimeoutError,
    EngineUnavailableError,
    MessageValidationError,
    ServiceCallError,
    ServiceNotFoundError,
    ServiceTimeoutError,
)
from mindstage.msgs import Message, Service, decode, encode, type_name

__all__ = ["SCHEME", "RemoteProfile", "RemoteUrl", "ServiceClient", "ServiceTransport"]


SCHEME = "ros://"
_FORMAT_HINT = f"write {SCHEME}HOST:PORT/NAMESPACE, with ?token=… where one is needed"


class RemoteProfile(StrEnum):
    """Which services a far engine offers."""

    MINDSTAGE = "mindstage"
    """Another Mindstage: the whole contract, and nothing is lost on the way."""
    UNREAL = "unreal"
    """Unreal's plugin UROSWorldControl, or whoever speaks like it: what `world_control_msgs` has, and no more."""


class RemoteUrl(msgspec.Struct, frozen=True, kw_only=True):
    """A rosbridge, and the namespace at it."""

    host: str
    port: int = 9090
    namespace: str = "unreal"
    token: str = ""
    profile: RemoteProfile | None = None
    """None where the far side shall be asked."""

    @classmethod
    def parse(cls, text: str) -> RemoteUrl:
        """Reads what was typed.

        Raises:
            EngineUnavailableError: it is no such address.
        """
        parts = _split(text)
        asked = _parse_query(text, parts.query)
        profile = asked.get("profile")
        if profile is not None and profile not in {each.value for each in RemoteProfile}:
            known = " or ".join(each.value for each in RemoteProfile)
            raise EngineUnavailableError(
                _without_query(text), cause=f"no profile {profile!r}", remedy=f"choose {known}"
            )
        return cls(
            host=parts.hostname or "",
            port=9090 if parts.port is None else parts.port,
            namespace=unquote(parts.path).strip("/") or "unreal",
            token=asked.get("token", ""),
            profile=None if profile is None else RemoteProfile(profile),
        )

    @property
    def url(self) -> str:
        """Of the websocket, without the token."""
        return f"ws://{self._authority}"

    def __str__(self) -> str:
        """As it may be shown: without the token."""
        return f"{SCHEME}{self._authority}/{quote(self.namespace)}"

    @property
    def _authority(self) -> str:
        return f"{f'[{self.host}]' if ':' in self.host else self.host}:{self.port}"


def _split(text: str) -> SplitResult:
    try:
        parts = urlsplit(text)
        _ = parts.port  # is read only now, and refused only now
    except ValueError as error:
        raise EngineUnavailableError(
            _without_query(text), cause=f"it is no address: {error}", remedy=_FORMAT_HINT
        ) from error
    if f"{parts.scheme}://" != SCHEME or not parts.hostname or "@" in parts.netloc:
        raise EngineUnavailableError(_without_query(text), cause="it is no address", remedy=_FORMAT_HINT)
    return parts


def _parse_query(text: str, query: str) -> dict[str, str]:
    """What stands behind the question mark."""
    asked = parse_qs(query, keep_blank_values=True)
    unknown = [key for key in asked if key not in {"token", "profile"}]
    if unknown:
        cause = f"an address has no {unknown[0]!r}"
        raise EngineUnavailableError(_without_query(text), cause=cause, remedy="there is token and profile")
    return {key: values[-1] for key, values in asked.items()}


def _without_query(text: str) -> str:
    """What was typed, without what may be secret in it."""
    return text.partition("?")[0]


_LIMITS = BridgeLimits(message_bytes=256 << 20, waiting_bytes=256 << 20)
"""A whole world may come in one message, and whom we asked for one we let speak."""
_MAX_MESSAGE_BYTES = BridgeLimits().message_bytes
"""What a hub with the usual limits takes in one message."""
_CONNECT_TIMEOUT_S = 5.0
"""So long is tried to reach a far side for the first time [s]."""
_RECONNECT_INTERVAL_S = 1.0
"""At least so often is tried to come back after a loss [s]."""
_RECONNECT_WAIT_S = 2.0
"""So long after a loss do calls wait for the connection to come back; later, they fail at once [s]."""
_NOT_RUNNING_REMEDY = "is mindstage serve, or a rosbridge, running there?"
_TOKEN_REMEDY = "write ?token=… behind the address"
_MAX_CONCURRENT_CALLS = 64
"""So many calls are under way at a time where many are made."""


class ServiceTransport(Protocol):
    """What a link calls through: a `RosbridgeClient`, or whoever does as one does."""

    @property
    def connected(self) -> bool:
        """Whether someone is at the other end now."""

    def wait_connected(self, timeout_s: float) -> object:
        """Waits for that."""

    def call_service_async(self, name: str, args: object = None, *, timeout_s: float) -> Future[Any]:
        """Calls a service without waiting."""

    def call_service(self, name: str, args: object = None, *, timeout_s: float) -> Any:
        """Calls a service and waits."""

    def close(self) -> None:
        """Ends it; any number of times."""


class ServiceClient:
    """Calls the services of one peer; connected when made, and again after a loss."""

    def __init__(self, address: RemoteUrl, *, timeout_s: float, transport: ServiceTransport | None = None) -> None:
        """Connects.

        Args:
            address: whom to.
            timeout_s: how long a call may take that does not say otherwise [s].
            line: what to call through; by default a connection of its own.

        Raises:
            EngineUnavailableError: nobody is there, or does not let us in.
        """
        self.address = address
        self.name = str(address)
        self.timeout_s = timeout_s
        self.connection_count = 0
        """How often a connection was made; another number means that it is another one."""
        self._lost_time_s = 0.0
        self._transport: ServiceTransport = transport or RosbridgeClient(
            address.url,
            token=address.token or None,
            limits=_LIMITS,
            max_reconnect_delay_s=_RECONNECT_INTERVAL_S,
            on_state=self._on_state,
        )
        try:
            self._transport.wait_connected(min(timeout_s, _CONNECT_TIMEOUT_S))
        except BridgeError as error:
            self._transport.close()
            remedy = _NOT_RUNNING_REMEDY if isinstance(error, ConnectionLostError) else _TOKEN_REMEDY
            raise EngineUnavailableError(self.name, cause=str(error), remedy=remedy) from error

    def wait_ready(self) -> None:
        """Waits a moment for a connection that was lost.

        Raises:
            EngineUnavailableError: it is still lost.
        """
        if self._transport.connected:
            return
        left_s = max(0.0, self._lost_time_s + _RECONNECT_WAIT_S - time.monotonic())
        with self._translating_errors(""):
            self._transport.wait_connected(left_s)

    def call(self, name: str, service: type[Service], request: Message, *, timeout_s: float | None = None) -> Any:
        """Calls a service, and gives its response.

        Raises:
            EngineError: it broke, did not answer in time, or cannot be reached.
            MessageValidationError: the request holds what cannot travel.
        """
        return next(self.call_each(name, service, [request], timeout_s=timeout_s))

    def call_each(
        self, name: str, service: type[Service], requests: Iterable[Message], *, timeout_s: float | None = None
    ) -> Iterator[Any]:
        """Calls a service many times, several at once, and gives the responses in the requests' order."""
        patience_s = self.timeout_s if timeout_s is None else timeout_s
        waiting: deque[Future[Any]] = deque()
        for request in requests:
            written = _encode_request(request)
            with self._translating_errors(name):
                waiting.append(self._transport.call_service_async(name, written, timeout_s=patience_s))
            if len(waiting) >= _MAX_CONCURRENT_CALLS:
                yield self._response(name, service, waiting.popleft(), patience_s)
        while waiting:
            yield self._response(name, service, waiting.popleft(), patience_s)

    def is_available(self, name: str, service: type[Service], request: Message) -> bool:
        """Whether somebody answers a call, be it with an error.

        Raises:
            EngineError: nobody can tell.
        """
        try:
            self.call(name, service, request)
        except (EngineUnavailableError, EngineTimeoutError) as error:
            if isinstance(error.__cause__, ServiceNotFoundError):
                return False
            raise
        except EngineError:
            return True
        return True

    def call_raw(self, name: str, *, timeout_s: float) -> Any:
        """What a service answers that is none of the engine's, such as rosapi's.

        Raises:
            BridgeError: it does not.
        """
        return self._transport.call_service(name, timeout_s=timeout_s)

    def close(self) -> None:
        """Ends it; any number of times."""
        self._transport.close()

    @contextmanager
    def validating(self, name: str) -> Iterator[None]:
        """What cannot be understood of an answer is the engine's fault.

        Raises:
            EngineUnavailableError: it was not understood.
        """
        try:
            yield
        except (MessageValidationError, msgspec.MsgspecError, ValueError) as error:
            cause = f"what {name} answered makes no sense: {error}"
            raise EngineUnavailableError(self.name, cause=cause, remedy="use the same version on both sides") from error

    def _response(self, name: str, service: type[Service], answer: Future[Any], timeout_s: float) -> Any:
        with self._translating_errors(name):
            values = answer.result(timeout_s + 10.0)  # the client's own clock ends it long before
        with self.validating(name):
            return decode(service.Response, values, strict=True)

    @contextmanager
    def _translating_errors(self, name: str) -> Iterator[None]:
        """Makes errors of the bridge errors of an engine."""
        try:
            yield
        except ServiceTimeoutError as error:
            raise EngineTimeoutError(self.name, call=name, timeout_s=error.timeout_s) from error
        except ServiceCallError as error:
            raise self._engine_error(error) from error
        except ServiceNotFoundError as error:
            raise EngineUnavailableError(self.name, cause=str(error), remedy="is it still running there?") from error
        except BridgeError as error:
            raise EngineUnavailableError(self.name, cause=str(error)) from error

    def _engine_error(self, error: ServiceCallError) -> EngineError:
        """The error that the far side told; what is no engine's own says whose it is."""
        told = error_from_text(error.cause)
        return EngineError(f"the engine {self.name!r} failed: {told}") if type(told) is EngineError else told

    def _on_state(self, state: ConnectionState) -> None:
        if state is ConnectionState.CONNECTED:
            self.connection_count += 1
        elif state is ConnectionState.LOST:
            self._lost_time_s = time.monotonic()


def _encode_request(request: Message) -> msgspec.Raw:
    """A request as it travels.

    Raises:
        MessageValidationError: it holds what cannot, or too much.
    """
    written = msgspec.json.encode(encode(request))
    if len(written) > _MAX_MESSAGE_BYTES:
        cause = f"it has {len(written) >> 20} MiB, and {_MAX_MESSAGE_BYTES >> 20} can travel in one message"
        raise MessageValidationError(type_name(type(request)), cause=cause, remedy="send it in several parts")
    return msgspec.Raw(written)
