"""Visitor: one page that somebody has open, and what waits to be sent to it."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Hashable
from typing import Any

import msgspec

from mindstage.viewport.sockets import ConnectionClosed, WebSocket

__all__ = ["ClientSession", "event_message"]

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
