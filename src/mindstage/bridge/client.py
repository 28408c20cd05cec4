"""A client of a rosbridge server, which reconnects and then advertises and subscribes again.

When the connection is lost, all pending calls and goals fail at once with `ConnectionLostError`.
"""

from __future__ import annotations

import asyncio
import logging
import random
import threading
from collections.abc import Callable
from concurrent.futures import Future
from enum import StrEnum
from pathlib import Path
from ssl import SSLCertVerificationError, SSLError

from websockets.asyncio.client import connect
from websockets.exceptions import InvalidStatus, InvalidURI, WebSocketException

from mindstage.bridge.access import client_tls_context
from mindstage.bridge.node import Node
from mindstage.bridge.protocol import DEFAULT_LIMITS, BridgeLimits, Id, MessageEncoder, Operation, Status
from mindstage.bridge.server import Connection
from mindstage.errors import AuthenticationError, BridgeError, CertificateError, ConnectionLostError

__all__ = ["ConnectionState", "RosbridgeClient"]

_MIN_RECONNECT_DELAY_S = 0.2
_MAX_RECONNECT_DELAY_S = 15.0
_OPEN_TIMEOUT_S = 10.0
_PING_INTERVAL_S = 10.0
_AUTH_ERROR_CODES = (401, 403)
_log = logging.getLogger("mindstage.bridge")


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

    def __init__(
        self,
        url: str,
        *,
        token: str | None = None,
        tls_authorities: Path | None = None,
        limits: BridgeLimits = DEFAULT_LIMITS,
        max_reconnect_delay_s: float = _MAX_RECONNECT_DELAY_S,
        on_state: Callable[[ConnectionState], object] | None = None,
        on_status: Callable[[Status], object] | None = None,
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

    def wait_connected(self, timeout_s: float = 10.0) -> RosbridgeClient:
        """Waits for the connection, over as many attempts as fit into the time.

        Raises:
            ConnectionLostError: there is no connection.
            AuthenticationError: the server rejects the token.
        """
        self._require_other_thread("wait_connected")
        if not self._first_attempt_done.wait(timeout_s) or not self.connected:
            raise self._cause
        return self

    def has_subscribers(self, topic: str) -> bool:
        """Whether a message might be received; the subscribers at the server are unknown, so it is `connected`."""
        return self.connected

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
                await self._run_connection()
                if self._loop.loop.time() - start_s > delay_s:  # not closed right after the handshake
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

    async def _run_connection(self) -> None:
        """Connects, and returns when the connection has ended."""
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
        self._connection = connection = Connection(
            socket, self._limits, receive=self._receive, send_error=self._send_error_status
        )
        for operation in self._advertise_operations():
            connection.send(MessageEncoder(operation))
        self._set_state(ConnectionState.CONNECTED)
        self._first_attempt_done.set()
        try:
            await connection.run()
        finally:
            self._connection = None
            self._cause = ConnectionLostError(self.url, cause=connection.close_reason)
            if not self.closed:
                self._first_attempt_done.clear()
                self._set_state(ConnectionState.LOST)
            self._pending_calls.fail_all(self._cause)
            self._dispatcher.cancel_all()

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

    def _send(self, operation: Operation) -> None:
        if self._connection is None:
            raise self._cause
        self._connection.send(MessageEncoder(operation))

    def _send_error_status(self, text: str, id: Id | None) -> None:
        _log.warning("invalid message from %s: %s (id %r)", self.url, text, id)

    def _on_status(self, status: Status) -> None:
        if self._status_callback is None:
            super()._on_status(status)
            return
        try:
            self._status_callback(status)
        except Exception:
            _log.exception("the status handler failed")


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
