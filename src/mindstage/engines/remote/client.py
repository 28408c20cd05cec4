"""ServiceClient: calls the services of one remote engine over rosbridge, with timeouts and engine errors.

A lost connection is re-established in the background, and a call waits for it for a moment. Calls in progress at the
time of the loss are not repeated, since they may already have been executed.

`RemoteUrl` is the address of such an engine: `ros://HOST:PORT/NAMESPACE?token=…`. Only the host is required; the port
is rosbridge's 9090, the namespace that of Unreal's plugin, and the profile is detected. `ros+tls://` connects over TLS
and checks the certificate; `?ca=FILE` names the certificate of an authority of one's own.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
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

__all__ = ["SCHEME", "TIMEOUT_PER_ENTITY_S", "RemoteProfile", "RemoteUrl", "ServiceClient", "ServiceTransport"]


SCHEME, TLS_SCHEME = "ros://", "ros+tls://"
TIMEOUT_PER_ENTITY_S = 0.05
"""Additional timeout of a call for each body or joint in it [s]."""
_FORMAT_HINT = f"write {SCHEME} or {TLS_SCHEME}HOST:PORT/NAMESPACE, with ?token=… if a token is required"


class RemoteProfile(StrEnum):
    """The set of services that a remote engine offers."""

    MINDSTAGE = "mindstage"
    """Another Mindstage: the whole `Engine` protocol, without loss."""
    UNREAL = "unreal"
    """Unreal's plugin UROSWorldControl, or a compatible one: the services of `world_control_msgs`."""


class RemoteUrl(msgspec.Struct, frozen=True, kw_only=True):
    """The address of a rosbridge server and a namespace on it."""

    host: str
    port: int = 9090
    namespace: str = "unreal"
    token: str = ""
    profile: RemoteProfile | None = None
    """None to detect it."""
    secure: bool = False
    """Whether to connect over TLS."""
    authorities: Path | None = None
    """Certificates of authorities that are trusted besides those of the system."""

    @classmethod
    def parse(cls, text: str) -> RemoteUrl:
        """Parses an address.

        Raises:
            EngineUnavailableError: the text is not a valid address.
        """
        parts = _split(text)
        params = _parse_query(text, parts.query)
        profile = params.get("profile")
        if profile is not None and profile not in {each.value for each in RemoteProfile}:
            known = " or ".join(each.value for each in RemoteProfile)
            raise EngineUnavailableError(
                _without_query(text), cause=f"unknown profile {profile!r}", remedy=f"choose {known}"
            )
        return cls(
            host=parts.hostname or "",
            port=9090 if parts.port is None else parts.port,
            namespace=unquote(parts.path).strip("/") or "unreal",
            token=params.get("token", ""),
            profile=None if profile is None else RemoteProfile(profile),
            secure=f"{parts.scheme}://" == TLS_SCHEME,
            authorities=Path(params["ca"]) if "ca" in params else None,
        )

    @property
    def url(self) -> str:
        """Of the websocket, without the token."""
        return f"{'wss' if self.secure else 'ws'}://{self._authority}"

    def __str__(self) -> str:
        """The address without the token, for display."""
        return f"{TLS_SCHEME if self.secure else SCHEME}{self._authority}/{quote(self.namespace)}"

    @property
    def _authority(self) -> str:
        return f"{f'[{self.host}]' if ':' in self.host else self.host}:{self.port}"


def _split(text: str) -> SplitResult:
    try:
        parts = urlsplit(text)
        _ = parts.port  # validated on access only
    except ValueError as error:
        raise EngineUnavailableError(
            _without_query(text), cause=f"it is not a valid address: {error}", remedy=_FORMAT_HINT
        ) from error
    if f"{parts.scheme}://" not in {SCHEME, TLS_SCHEME} or not parts.hostname or "@" in parts.netloc:
        raise EngineUnavailableError(_without_query(text), cause="it is not a valid address", remedy=_FORMAT_HINT)
    return parts


def _parse_query(text: str, query: str) -> dict[str, str]:
    """The query parameters, `token`, `profile` and `ca`."""
    params = parse_qs(query, keep_blank_values=True)
    unknown = [key for key in params if key not in {"token", "profile", "ca"}]
    if unknown:
        cause = f"unknown parameter {unknown[0]!r}"
        raise EngineUnavailableError(
            _without_query(text), cause=cause, remedy="the parameters are token, profile and ca"
        )
    return {key: values[-1] for key, values in params.items()}


def _without_query(text: str) -> str:
    """The text without its query, which may contain the token."""
    return text.partition("?")[0]


_LIMITS = BridgeLimits(message_bytes=256 << 20, waiting_bytes=256 << 20)
"""A whole world may come in one message, and the peer was chosen by the user."""
_MAX_MESSAGE_BYTES = BridgeLimits().message_bytes
"""The message size that a server with default limits accepts."""
_RECONNECT_INTERVAL_S = 1.0
"""Longest delay between attempts to reconnect [s]."""
_RECONNECT_WAIT_S = 2.0
"""How long calls wait for a lost connection, counted from its loss; later calls fail at once [s]."""
_NOT_RUNNING_REMEDY = "is mindstage serve, or a rosbridge, running there?"
_TOKEN_REMEDY = "append ?token=… to the address"
_MAX_CONCURRENT_CALLS = 64
"""Maximum number of calls in progress in `call_each`."""


class ServiceTransport(Protocol):
    """The part of `RosbridgeClient` that a `ServiceClient` needs."""

    @property
    def connected(self) -> bool:
        """Whether the connection is established."""

    def wait_connected(self, timeout_s: float) -> object:
        """Waits until the connection is established."""

    def call_service_async(self, name: str, args: object = None, *, timeout_s: float) -> Future[Any]:
        """Calls a service without waiting for the response."""

    def call_service(self, name: str, args: object = None, *, timeout_s: float) -> Any:
        """Calls a service and waits for the response."""

    def close(self) -> None:
        """Closes the connection; closing it again has no effect."""


class ServiceClient:
    """Calls the services of one server; connects when created, and reconnects after a loss."""

    def __init__(self, address: RemoteUrl, *, timeout_s: float, transport: ServiceTransport | None = None) -> None:
        """Connects.

        Args:
            address: address of the server.
            timeout_s: default timeout of a call [s].
            transport: the connection to use; by default a new `RosbridgeClient`.

        Raises:
            EngineUnavailableError: the server does not answer, or rejects the token.
        """
        self.address = address
        self.name = str(address)
        self.timeout_s = timeout_s
        self.connection_count = 0
        """Number of connections made so far; it changes with every reconnection."""
        self._lost_time_s = 0.0
        self._transport: ServiceTransport = transport or RosbridgeClient(
            address.url,
            token=address.token or None,
            tls_authorities=address.authorities,
            limits=_LIMITS,
            max_reconnect_delay_s=_RECONNECT_INTERVAL_S,
            on_state=self._on_state,
        )
        try:
            self._transport.wait_connected(timeout_s)
        except BridgeError as error:
            self._transport.close()
            remedy = _NOT_RUNNING_REMEDY if isinstance(error, ConnectionLostError) else _TOKEN_REMEDY
            raise EngineUnavailableError(self.name, cause=str(error), remedy=remedy) from error

    def wait_ready(self) -> None:
        """Waits a moment for a lost connection to be re-established.

        Raises:
            EngineUnavailableError: the connection is still lost.
        """
        if self._transport.connected:
            return
        left_s = max(0.0, self._lost_time_s + _RECONNECT_WAIT_S - time.monotonic())
        with self._translating_errors(""):
            self._transport.wait_connected(left_s)

    def call(self, name: str, service: type[Service], request: Message, *, timeout_s: float | None = None) -> Any:
        """Calls a service and returns its response.

        Raises:
            EngineError: the engine failed, did not answer in time, or cannot be reached.
            MessageValidationError: the request cannot be encoded, or is too large.
        """
        return next(self.call_each(name, service, [request], timeout_s=timeout_s))

    def call_each(
        self, name: str, service: type[Service], requests: Iterable[Message], *, timeout_s: float | None = None
    ) -> Iterator[Any]:
        """Calls a service once for each request, concurrently; yields the responses in the order of the requests."""
        timeout = self.timeout_s if timeout_s is None else timeout_s
        pending: deque[Future[Any]] = deque()
        for request in requests:
            encoded = _encode_request(request)
            with self._translating_errors(name):
                pending.append(self._transport.call_service_async(name, encoded, timeout_s=timeout))
            if len(pending) >= _MAX_CONCURRENT_CALLS:
                yield self._response(name, service, pending.popleft(), timeout)
        while pending:
            yield self._response(name, service, pending.popleft(), timeout)

    def is_available(self, name: str, service: type[Service], request: Message) -> bool:
        """Whether a service exists; a call that returns an error counts.

        Raises:
            EngineError: the call did not get far enough to find out.
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
        """Calls a service outside the engine protocol, such as rosapi's, and returns the decoded JSON.

        Raises:
            BridgeError: the call failed.
        """
        return self._transport.call_service(name, timeout_s=timeout_s)

    def close(self) -> None:
        """Closes the connection; closing it again has no effect."""
        self._transport.close()

    @contextmanager
    def validating(self, name: str) -> Iterator[None]:
        """Maps errors in reading a response to `EngineUnavailableError`.

        Raises:
            EngineUnavailableError: the response is invalid.
        """
        try:
            yield
        except (MessageValidationError, msgspec.MsgspecError, ValueError) as error:
            cause = f"the response of {name} is invalid: {error}"
            raise EngineUnavailableError(
                self.name, cause=cause, remedy="use the same version on both machines"
            ) from error

    def _response(self, name: str, service: type[Service], answer: Future[Any], timeout_s: float) -> Any:
        with self._translating_errors(name):
            values = answer.result(timeout_s + 10.0)  # the transport's own timeout expires long before
        with self.validating(name):
            return decode(service.Response, values, strict=True)

    @contextmanager
    def _translating_errors(self, name: str) -> Iterator[None]:
        """Maps errors of the bridge to errors of the engine."""
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
        """The error that the remote engine reported; a plain `EngineError` gets the engine's name."""
        reported = error_from_text(error.cause)
        return (
            EngineError(f"the engine {self.name!r} failed: {reported}") if type(reported) is EngineError else reported
        )

    def _on_state(self, state: ConnectionState) -> None:
        if state is ConnectionState.CONNECTED:
            self.connection_count += 1
        elif state is ConnectionState.LOST:
            self._lost_time_s = time.monotonic()


def _encode_request(request: Message) -> msgspec.Raw:
    """The encoded request.

    Raises:
        MessageValidationError: it contains invalid values, or is too large.
    """
    encoded = msgspec.json.encode(encode(request))
    if len(encoded) > _MAX_MESSAGE_BYTES:
        cause = f"it has {len(encoded) >> 20} MiB, and one message can have {_MAX_MESSAGE_BYTES >> 20} MiB"
        raise MessageValidationError(type_name(type(request)), cause=cause, remedy="send it in several parts")
    return msgspec.Raw(encoded)
