"""Hub: where clients and this process meet, as rosbridge_server with a ROS master behind it.

Clients advertise services, topics and actions to each other through it. This process takes part by the same words:
the hub itself is a `Participant`, and its offers are answered without leaving the process.
"""

from __future__ import annotations

from collections.abc import Coroutine
from typing import Any, TypeVar

from mindstage.bridge.names import resolved
from mindstage.bridge.participant import Participant
from mindstage.bridge.protocol import USUAL_LIMITS, Limits, Operation, Outgoing
from mindstage.bridge.switchboard import PLAIN, Directory, Peer, Route, Switchboard
from mindstage.errors import ConnectionLost

__all__ = ["Hub"]

T = TypeVar("T")


class _Here(Peer):
    """The hub's own process, as a peer at the hub."""

    local = True

    def __init__(self, name: str, hub: Hub) -> None:
        super().__init__(name)
        self._hub = hub

    @property
    def congested(self) -> bool:
        return False

    def deliver(self, outgoing: Outgoing, route: Route = PLAIN, *, sender: Peer | None = None) -> None:
        self._hub._receive(outgoing.operation, sender)


class Hub(Participant):
    """Starts its thread when made; `Server` lets clients in, `close` ends it all."""

    def __init__(self, *, limits: Limits = USUAL_LIMITS, name: str = "/mindstage") -> None:
        """A hub that nobody has joined yet.

        Args:
            limits: what each client may ask for.
            name: of this process, as tools that look around show it.
        """
        super().__init__(name="mindstage-hub")
        self.limits = limits
        self.switchboard = Switchboard(self._loop.loop, limits)
        """Where clients are plugged in; it belongs to the loop."""
        self._here = _Here(resolved(name), self)
        self._loop.do(self.switchboard.join, self._here)

    @property
    def name(self) -> str:
        """Of this process, in the directory."""
        return self._here.name

    def directory(self) -> Directory:
        """Who and what is here now: what `rosapi` tells."""
        return self._loop.do(self.switchboard.directory)

    def be_patient(self, service: str, patience_s: float) -> None:
        """Gives a service longer than the limits' `call_s` where the caller does not say how long it waits."""
        self._loop.do(self.switchboard.services.patience_s.__setitem__, resolved(service), patience_s)

    def has_listeners(self, topic: str) -> bool:
        """Whether anyone subscribed; asks without waiting, so that making a message may be left out."""
        return self.switchboard.topics.has_listeners(topic)

    @property
    def closed(self) -> bool:
        """Whether nothing goes on here any more."""
        return self._loop.closed

    def run(self, coroutine: Coroutine[Any, Any, T]) -> T:
        """Runs a coroutine on the hub's loop and waits for its end: how a server starts and stops."""
        return self._loop.run(coroutine)

    def close(self) -> None:
        """Ends it, any number of times; close its servers first."""
        self._close(ConnectionLost("the hub", cause="it was closed"))

    def __enter__(self) -> Hub:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _send(self, operation: Operation) -> None:
        self.switchboard.receive(self._here, operation)
