"""Exchange: what services and actions have in common: one provider a name, and requests that wait for their end."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from itertools import count
from typing import Generic, NamedTuple, TypeVar

from mindstage.bridge.names import resolved
from mindstage.bridge.protocol import Id, Level, Limits
from mindstage.bridge.switchboard.peers import Peer, Route
from mindstage.errors import OfferRefused

__all__ = ["Exchange", "Offer", "Request"]


class Offer(NamedTuple):
    """Someone who answers."""

    name: str
    """As the provider says it, who knows no other spelling."""
    type: str
    provider: Peer


class Request:
    """Something that was passed on to a provider and has not ended."""

    def __init__(self, *, name: str, id: Id | None, caller: Peer, offer: Offer, route: Route) -> None:
        self.name = name
        """As the caller says it."""
        self.id = id
        """The caller's; the provider knows it by ours."""
        self.caller: Peer | None = caller
        """None once the caller is gone and only the provider is left to be heard."""
        self.offer = offer
        self.route = route


R = TypeVar("R", bound=Request)


class Exchange(Generic[R]):
    """Offers by name, and requests by the id that their provider was given."""

    def __init__(self, kind: str, limits: Limits) -> None:
        self._kind = kind
        self._limits = limits
        self._offers: dict[str, Offer] = {}
        self._requests: dict[Id, R] = {}
        self._of_caller: Counter[Peer] = Counter()
        self._of_provider: Counter[Peer] = Counter()
        self._numbers = count(1)

    @property
    def offers(self) -> Iterator[Offer]:
        """All of them, by name."""
        return (offer for _, offer in sorted(self._offers.items()))

    @property
    def names(self) -> tuple[str, ...]:
        """What is offered."""
        return tuple(self._offers)

    def waiting(self) -> int:
        """How many requests have not ended."""
        return len(self._requests)

    def offer(self, peer: Peer, name: str, type: str) -> None:
        """Makes a peer the provider; whoever was it before is told.

        Raises:
            OfferRefused: the hub itself provides it, or the peer offers too much.
        """
        former = self._offers.get(resolved(name))
        if former is not None and former.provider.local and not peer.local:
            raise OfferRefused(name, cause=f"this {self._kind} is the hub's own; choose another name")
        if former is None or former.provider is not peer:
            if self._of_provider[peer] >= self._limits.offers and not peer.local:
                raise OfferRefused(name, cause=f"{self._limits.offers} offers of one client are enough")
            self._of_provider[peer] += 1
        if former is not None and former.provider is not peer:
            self._forget(former.provider)
            former.provider.remark(Level.WARNING, f"{peer.name} offers the {self._kind} {name} now")
        self._offers[resolved(name)] = Offer(name, type, peer)

    def withdraw(self, peer: Peer, name: str) -> None:
        """Ends a peer's offer; calls that it has already may still be answered."""
        offer = self._offers.get(resolved(name))
        if offer is None or offer.provider is not peer:
            peer.remark(Level.WARNING, f"the {self._kind} {name} was not offered by you")
            return
        del self._offers[resolved(name)]
        self._forget(peer)

    def find(self, name: str) -> Offer | None:
        """Who provides it."""
        return self._offers.get(resolved(name))

    def asked_by(self, caller: Peer) -> int:
        """How many of its requests wait."""
        return self._of_caller[caller]

    def begin(self, request: R) -> Id:
        """Keeps a request until its end; the id is for the provider."""
        id = f"{self._kind}:{next(self._numbers)}"
        self._requests[id] = request
        if request.caller is not None:
            self._of_caller[request.caller] += 1
        return id

    def request(self, provider: Peer, id: Id | None) -> R | None:
        """The request that a provider speaks of; None, and a remark, if it has none of that id (any more)."""
        request = None if id is None else self._requests.get(id)
        if request is None or request.offer.provider is not provider:
            why = "it had its end, timed out, or its caller left"
            provider.remark(Level.WARNING, f"no {self._kind} call waits for {id!r}: {why}", id)
            return None
        return request

    def request_of(self, id: Id) -> R | None:
        """The request of one of our ids."""
        return self._requests.get(id)

    def end(self, id: Id) -> None:
        """Forgets a request."""
        request = self._requests.pop(id)
        if request.caller is not None and request.caller in self._of_caller:
            self._of_caller[request.caller] -= 1

    def forget(self, id: Id) -> None:
        """Forgets a request, if it is still known."""
        if id in self._requests:
            self.end(id)

    def leave(self, peer: Peer) -> tuple[list[tuple[Id, R]], list[tuple[Id, R]]]:
        """Ends a peer's offers; gives what it had still to answer, and what it had asked of others."""
        for name, offer in list(self._offers.items()):
            if offer.provider is peer:
                del self._offers[name]
        self._of_provider.pop(peer, None)
        self._of_caller.pop(peer, None)
        owed = [(id, each) for id, each in self._requests.items() if each.offer.provider is peer]
        asked = [(id, each) for id, each in self._requests.items() if each.caller is peer]
        return owed, asked

    def _forget(self, provider: Peer) -> None:
        self._of_provider[provider] -= 1
