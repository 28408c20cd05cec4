"""Feeds: one topic's messages on their way to one peer, as fast as it wants and can take them.

A throttled feed keeps the newest messages while it waits, so that the last one always arrives; so does one with a
queue whose peer reads too slowly. One with neither sends at once, and the connection drops a peer that cannot follow.
"""

from __future__ import annotations

import asyncio
from collections import deque

from mindstage.bridge.protocol import Compression, Id, Outgoing, Subscribe
from mindstage.bridge.switchboard.peers import PLAIN, Peer, Route

__all__ = ["Feed"]

_RETRY_S = 0.02
"""A congested peer is looked at again after so long [s]."""


class Feed:
    """The subscriptions of one peer to one topic, which it hears once however many they are."""

    def __init__(self, loop: asyncio.AbstractEventLoop, peer: Peer) -> None:
        self._loop = loop
        self._peer = peer
        self._requests: dict[Id | None, Subscribe] = {}
        self._timer: asyncio.TimerHandle | None = None
        self._waiting: deque[tuple[Outgoing, Peer | None]] = deque(maxlen=1)
        self._throttle_s = 0.0
        self._queues = False
        self._route = PLAIN
        self.name = ""
        """The topic as the peer says it."""

    def __len__(self) -> int:
        return len(self._requests)

    def add(self, request: Subscribe) -> None:
        """Another subscription, or the same one with other wishes."""
        self._requests[request.id] = request
        self.name = request.topic
        self._agree()

    def remove(self, id: Id | None) -> bool:
        """Ends one subscription, or all where no id is given; tells whether there was any."""
        if id is None:
            found = bool(self._requests)
            self._requests.clear()
        else:
            found = self._requests.pop(id, None) is not None
        if self._requests:
            self._agree()
        else:
            self.stop()
        return found

    def push(self, message: Outgoing, publisher: Peer | None = None) -> None:
        """Sends a message now, or as soon as it is time."""
        if self._timer is None and not (self._queues and self._peer.congested):
            self._send(message, publisher)
            return
        self._waiting.append((message, publisher))
        if self._timer is None:
            self._timer = self._loop.call_later(_RETRY_S, self._flush)

    def stop(self) -> None:
        """Sends nothing more."""
        self._waiting.clear()
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _send(self, message: Outgoing, publisher: Peer | None) -> None:
        self._peer.deliver(message, self._route, sender=publisher)
        if self._throttle_s > 0.0:
            self._timer = self._loop.call_later(self._throttle_s, self._flush)

    def _flush(self) -> None:
        self._timer = None
        while self._waiting and self._timer is None:
            if self._queues and self._peer.congested:
                self._timer = self._loop.call_later(_RETRY_S, self._flush)
            else:
                self._send(*self._waiting.popleft())

    def _agree(self) -> None:
        """One rate and one form for all subscriptions: the fastest, the longest queue, the smallest fragments."""
        requests = self._requests.values()
        self._throttle_s = min(each.throttle_rate or 0.0 for each in requests) / 1000.0
        length = max(each.queue_length or 0 for each in requests)
        self._queues = length > 0
        self._waiting = deque(self._waiting, maxlen=min(max(1, length), _LONGEST))
        compressions = {each.compression or Compression.NONE for each in requests}
        wanted = (Compression.CBOR, Compression.PNG, Compression.NONE)
        sizes = [each.fragment_size for each in requests if each.fragment_size is not None]
        self._route = Route(next(each for each in wanted if each in compressions), min(sizes, default=None))


_LONGEST = 1000
"""No queue is longer, whatever was asked for."""
