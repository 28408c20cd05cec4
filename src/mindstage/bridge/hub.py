"""Hub: where clients and this process meet, as rosbridge_server with a ROS master behind it.

Clients advertise services, topics and actions to each other through it. This process takes part by the same words:
the hub itself is a `MarkerNode`, and its offers are answered without leaving the process.
"""

from __future__ import annotations

from collections.abc import Coroutine
from typing import Any, TypeVar

from mindstage.bridge.names import resolve_name
from mindstage.bridge.participant import Node
from mindstage.bridge.protocol import DEFAULT_LIMITS, BridgeLimits, MessageEncoder, Operation
from mindstage.bridge.switchboard import PLAIN_FORMAT, Broker, GraphInfo, Peer, ReplyFormat
from mindstage.errors import ConnectionLostError

__all__ = ["LocalNode"]

T = TypeVar("T")


class _LocalPeer(Peer):
    """The hub's own process, as a peer at the hub."""

    is_local = True

    def __init__(self, name: str, hub: LocalNode) -> None:
        super().__init__(name)
        self._hub = hub

    @property
    def congested(self) -> bool:
        return False

    def deliver(
        self, outgoing: MessageEncoder, route: ReplyFormat = PLAIN_FORMAT, *, sender: Peer | None = None
    ) -> None:
        self._hub._receive(outgoing.operation, sender)


class LocalNode(Node):
    """Starts its thread when made; `Server` lets clients in, `close` ends it all."""

    def __init__(self, *, limits: BridgeLimits = DEFAULT_LIMITS, name: str = "/mindstage") -> None:
        """A hub that nobody has joined yet.

        Args:
            limits: what each client may ask for.
            name: of this process, as tools that look around show it.
        """
        super().__init__(name="mindstage-hub")
        self.limits = limits
        self.broker = Broker(self._loop.loop, limits)
        """Where clients are plugged in; it belongs to the loop."""
        self._local_peer = _LocalPeer(resolve_name(name), self)
        self._loop.call(self.broker.add_peer, self._local_peer)

    @property
    def name(self) -> str:
        """Of this process, in the directory."""
        return self._local_peer.name

    def graph_info(self) -> GraphInfo:
        """Who and what is here now: what `rosapi` tells."""
        return self._loop.call(self.broker.graph_info)

    def set_service_timeout(self, service: str, timeout_s: float) -> None:
        """Gives a service longer than the limits' `call_timeout_s` where the caller does not say how long it waits."""
        self._loop.call(self.broker.services.timeouts_s.__setitem__, resolve_name(service), timeout_s)

    def has_subscribers(self, topic: str) -> bool:
        """Whether anyone subscribed; asks without waiting, so that making a message may be left out."""
        return self.broker.topics.has_subscribers(topic)

    @property
    def closed(self) -> bool:
        """Whether nothing goes on here any more."""
        return self._loop.closed

    def run(self, coroutine: Coroutine[Any, Any, T]) -> T:
        """Runs a coroutine on the hub's loop and waits for its end: how a server starts and stops."""
        return self._loop.run(coroutine)

    def close(self) -> None:
        """Ends it, any number of times; close its servers first."""
        self._close(ConnectionLostError("the hub", cause="it was closed"))

    def __enter__(self) -> LocalNode:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _send(self, operation: Operation) -> None:
        self.broker.handle(self._local_peer, operation)
