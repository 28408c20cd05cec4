"""Feeds: one topic's messages on their way to one peer, as fast as it wants and can take them.

A throttled feed keeps the newest messages while it waits, so that the last one always arrives; so does one with a
queue whose peer reads too slowly. One with neither sends at once, and the connection drops a peer that cannot follow.
"""

from __future__ import annotations

import asyncio
from collections import deque

from mindstage.bridge.protocol import Compression, Id, MessageEncoder, Subscribe
from mindstage.bridge.switchboard.peers import PLAIN_FORMAT, Peer, ReplyFormat

__all__ = ["ThrottledQueue"]

_RETRY_S = 0.02
"""A congested peer is looked at again after so long [s]."""


class ThrottledQueue:
    """The subscriptions of one peer to one topic, which it hears once however many they are."""

    def __init__(self, loop: asyncio.AbstractEventLoop, peer: Peer) -> None:
        self._loop = loop
        self._peer = peer
        self._requests: dict[Id | None, Subscribe] = {}
        self._timer: asyncio.TimerHandle | None = None
        self._waiting: deque[tuple[MessageEncoder, Peer | None]] = deque(maxlen=1)
        self._throttle_s = 0.0
        self._queues = False
        self._reply_format = PLAIN_FORMAT
        self.name = ""
        """The topic as the peer says it."""

    def __len__(self) -> int:
        return len(self._requests)

    def add(self, request: Subscribe) -> None:
        """Another subscription, or the same one with other wishes."""
        self._requests[request.id] = request
        self.name = request.topic
        self._merge_options()

    def remove(self, id: Id | None) -> bool:
        """Ends one subscription, or all where no id is given; tells whether there was any."""
        if id is None:
            found = bool(self._requests)
            self._requests.clear()
        else:
            found = self._requests.pop(id, None) is not None
        if self._requests:
            self._merge_options()
        else:
            self.stop()
        return found

    def push(self, message: MessageEncoder, publisher: Peer | None = None) -> None:
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

    def _send(self, message: MessageEncoder, publisher: Peer | None) -> None:
        self._peer.deliver(message, self._reply_format, sender=publisher)
        if self._throttle_s > 0.0:
            self._timer = self._loop.call_later(self._throttle_s, self._flush)

    def _flush(self) -> None:
        self._timer = None
        while self._waiting and self._timer is None:
            if self._queues and self._peer.congested:
                self._timer = self._loop.call_later(_RETRY_S, self._flush)
            else:
                self._send(*self._waiting.popleft())

    def _merge_options(self) -> None:
        """One rate and one form for all subscriptions: the fastest, the longest queue, the smallest fragments."""
        requests = self._requests.values()
        self._throttle_s = min(each.throttle_rate or 0.0 for each in requests) / 1000.0
        length = max(each.queue_length or 0 for each in requests)
        self._queues = length > 0
        self._waiting = deque(self._waiting, maxlen=min(max(1, length), _MAX_QUEUE_LENGTH))
        compressions = {each.compression or Compression.NONE for each in requests}
        wanted = (Compression.CBOR, Compression.PNG, Compression.NONE)
        sizes = [each.fragment_size for each in requests if each.fragment_size is not None]
        self._reply_format = ReplyFormat(
            next(each for each in wanted if each in compressions), min(sizes, default=None)
        )


_MAX_QUEUE_LENGTH = 1000
"""No queue is longer, whatever was asked for."""
