"""A guest: the page's side of the channel, with a real socket and without a browser."""

from __future__ import annotations

import json
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from typing import Any

from websockets.sync.client import ClientConnection, connect

from tests.viewport.waiting import PATIENCE_S, wait_until

__all__ = ["Guest", "No", "guest_at"]


class No(Exception):
    """The server said no."""

    def __init__(self, kind: str, text: str) -> None:
        self.kind = kind
        super().__init__(f"{kind}: {text}")


class Guest:
    """Asks, and keeps what it is told by topic."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self.told: dict[str, Any] = {}
        self.events: list[tuple[str, Any]] = []
        self._replies: dict[int, Any] = {}
        self._numbers = count(1)

    def ask(self, what: str, **arguments: Any) -> Any:
        """Asks and waits for the answer."""
        number = next(self._numbers)
        self.socket.send(json.dumps({"id": number, "method": what, "params": arguments}))
        wait_until(lambda: self.hear() and number in self._replies, f"{what!r} is answered")
        reply = self._replies.pop(number)
        if "error" in reply:
            raise No(reply["error"]["type"], reply["error"]["message"])
        return reply["result"]

    def hear(self) -> bool:
        """Takes in what has come meanwhile."""
        while True:
            try:
                message = json.loads(self.socket.recv(timeout=0.02))
            except TimeoutError:
                return True
            if "topic" in message:
                self.told[message["topic"]] = message["value"]
                self.events.append((message["topic"], message["value"]))
            else:
                self._replies[message["id"]] = message

    def sees(self, topic: str) -> Any:
        """What it was told last; None if it was told nothing."""
        self.hear()
        return self.told.get(topic)


@contextmanager
def guest_at(url: str, *, key: str | None = None, headers: dict[str, str] | None = None) -> Iterator[Guest]:
    """A guest at the page of that address."""
    address = f"{url.replace('http', 'ws', 1)}/mindstage/channel?client={key or secrets.token_hex(8)}"
    with connect(address, additional_headers=headers, open_timeout=PATIENCE_S, max_size=None) as socket:
        yield Guest(socket)
