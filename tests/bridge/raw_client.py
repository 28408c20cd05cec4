"""A client that sends and receives raw messages, valid or not."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from typing import Any

import msgspec
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

TIMEOUT_S = 20.0
"""Timeout on slow machines; it is reached only if a test fails [s]."""

Message = dict[str, Any]


class RawClient:
    """A websocket."""

    def __init__(self, url: str, **options: Any) -> None:
        self.socket: ClientConnection = connect(url, open_timeout=TIMEOUT_S, max_size=None, compression=None, **options)
        self.received: list[Message] = []

    def send_operation(self, **message: Any) -> None:
        self.send(msgspec.json.encode(message).decode())

    def send(self, frame: str | bytes) -> None:
        self.socket.send(frame)

    def receive(self, op: str, timeout_s: float = TIMEOUT_S, **fields: Any) -> Message:
        """Returns the next message with this operation and these fields; others stay in `received`."""
        until = time.monotonic() + timeout_s
        while True:
            for number, message in enumerate(self.received):
                if message.get("op") == op and all(message.get(key) == value for key, value in fields.items()):
                    return self.received.pop(number)
            frame = self.socket.recv(timeout=max(0.0, until - time.monotonic()))
            assert isinstance(frame, str), "a binary frame where text was expected"
            self.received.append(msgspec.json.decode(frame))

    def call_service(self, service: str, args: Any = None, **fields: Any) -> Message:
        """Calls a service and waits for the response."""
        id = f"ask:{service}:{time.monotonic_ns()}"
        self.send_operation(op="call_service", id=id, service=service, args={} if args is None else args, **fields)
        return self.receive("service_response", id=id)

    def flush(self) -> None:
        """Waits until the server has handled all messages that were sent, since it handles them in order."""
        self.call_service("/settle")

    def wait_closed(self, timeout_s: float = TIMEOUT_S) -> tuple[int, str]:
        """Waits until the server closes the connection; returns the code and the reason."""
        try:
            while True:
                self.socket.recv(timeout=timeout_s)
        except ConnectionClosed as error:
            return (error.rcvd.code, error.rcvd.reason) if error.rcvd else (1006, "")

    def kill(self) -> None:
        """Closes the socket without a closing handshake, as a killed process does."""
        self.socket.socket.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        self.socket.close()


def eventually(condition: Callable[[], object], *, timeout_s: float = TIMEOUT_S) -> None:
    """Waits until a condition is true."""
    until = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < until, "the condition did not become true"
        time.sleep(0.005)


def raw_subscriber(port: int, **subscribe_options: Any) -> socket.socket:
    """Subscribes to a topic by a socket without a websocket library, and does not read."""
    bare = socket.create_connection(("127.0.0.1", port), timeout=TIMEOUT_S)
    bare.sendall(
        b"GET / HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        b"Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n"
    )
    while not bare.recv(4096).endswith(b"\r\n\r\n"):
        pass
    text = msgspec.json.encode({"op": "subscribe", "topic": "/noise", **subscribe_options})
    bare.sendall(bytes([0x81, 0x80 | len(text)]) + bytes(4) + text)
    return bare
