"""A client of the RPC channel, with a real websocket and without a browser."""

from __future__ import annotations

import json
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from typing import Any

from websockets.sync.client import ClientConnection, connect

from tests.viewer.waiting import TIMEOUT_S, wait_until

__all__ = ["PageClient", "RequestFailedError", "connect_page_client"]


class RequestFailedError(Exception):
    """The server responded with an error."""

    def __init__(self, code: str, text: str) -> None:
        self.code = code
        super().__init__(f"{code}: {text}")


class PageClient:
    """Sends requests, and collects events by topic."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self.latest: dict[str, Any] = {}
        self.events: list[tuple[str, Any]] = []
        self._replies: dict[int, Any] = {}
        self._numbers = count(1)

    def ask(self, method: str, **arguments: Any) -> Any:
        """Sends a request and returns its result, when that arrives."""
        return self.answer(method, **arguments)["result"]

    def answer(self, method: str, **arguments: Any) -> Any:
        """Sends a request and returns the whole response, when that arrives."""
        number = next(self._numbers)
        self.socket.send(json.dumps({"id": number, "method": method, "params": arguments}))
        wait_until(lambda: self.receive() and number in self._replies, f"{method!r} is answered")
        reply = self._replies.pop(number)
        if "error" in reply:
            raise RequestFailedError(reply["error"]["code"], reply["error"]["message"])
        return reply

    def receive(self) -> bool:
        """Reads the messages that have arrived."""
        while True:
            try:
                message = json.loads(self.socket.recv(timeout=0.02))
            except TimeoutError:
                return True
            if "topic" in message:
                self.latest[message["topic"]] = message["value"]
                self.events.append((message["topic"], message["value"]))
            else:
                self._replies[message["id"]] = message

    def latest_value(self, topic: str) -> Any:
        """The latest value of a topic, or None."""
        self.receive()
        return self.latest.get(topic)


@contextmanager
def connect_page_client(
    url: str, *, key: str | None = None, headers: dict[str, str] | None = None, **options: Any
) -> Iterator[PageClient]:
    """Connects a client to the page at an address."""
    address = f"{url.replace('http', 'ws', 1)}/mindstage/channel?client={key or secrets.token_hex(8)}"
    with connect(address, additional_headers=headers, open_timeout=TIMEOUT_S, max_size=None, **options) as socket:
        yield PageClient(socket)
