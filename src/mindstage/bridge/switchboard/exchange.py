"""Exchange: what services and actions have in common: one provider a name, and requests that wait for their end."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from itertools import count
from typing import Generic, NamedTuple, TypeVar

from mindstage.bridge.names import resolve_name
from mindstage.bridge.protocol import BridgeLimits, Id, StatusLevel
from mindstage.bridge.switchboard.peers import Peer, ReplyFormat
from mindstage.errors import AdvertiseError

__all__ = ["PendingRequest", "Provider", "ProviderTable"]


class Provider(NamedTuple):
    """Someone who answers."""

    name: str
    """As the provider says it, who knows no other spelling."""
    type: str
    peer: Peer


class PendingRequest:
    """Something that was passed on to a provider and has not ended."""

    def __init__(
        self, *, name: str, id: Id | None, caller: Peer, provider: Provider, reply_format: ReplyFormat
    ) -> None:
        self.name = name
        """As the caller says it."""
        self.id = id
        """The caller's; the provider knows it by ours."""
        self.caller: Peer | None = caller
        """None once the caller is gone and only the provider is left to be heard."""
        self.provider = provider
        self.reply_format = reply_format


R = TypeVar("R", bound=PendingRequest)


class ProviderTable(Generic[R]):
    """Offers by name, and requests by the id that their provider was given."""

    def __init__(self, type_name: str, limits: BridgeLimits) -> None:
        self._type_name = type_name
        self._limits = limits
        self._offers: dict[str, Provider] = {}
        self._requests: dict[Id, R] = {}
        self._by_caller: Counter[Peer] = Counter()
        self._by_provider: Counter[Peer] = Counter()
        self._next_id = count(1)

    @property
    def providers(self) -> Iterator[Provider]:
        """All of them, by name."""
        return (offer for _, offer in sorted(self._offers.items()))

    @property
    def names(self) -> tuple[str, ...]:
        """What is offered."""
        return tuple(self._offers)

    def pending_count(self) -> int:
        """How many requests have not ended."""
        return len(self._requests)

    def register(self, peer: Peer, name: str, type: str) -> None:
        """Makes a peer the provider; whoever was it before is told.

        Raises:
            AdvertiseError: the hub itself provides it, or the peer offers too much.
        """
        former = self._offers.get(resolve_name(name))
        if former is not None and former.peer.is_local and not peer.is_local:
            raise AdvertiseError(name, cause=f"this {self._type_name} is the hub's own; choose another name")
        if former is None or former.peer is not peer:
            if self._by_provider[peer] >= self._limits.advertisements and not peer.is_local:
                raise AdvertiseError(name, cause=f"{self._limits.advertisements} offers of one client are enough")
            self._by_provider[peer] += 1
        if former is not None and former.peer is not peer:
            self._remove_provider(former.peer)
            former.peer.send_status(StatusLevel.WARNING, f"{peer.name} offers the {self._type_name} {name} now")
        self._offers[resolve_name(name)] = Provider(name, type, peer)

    def unregister(self, peer: Peer, name: str) -> None:
        """Ends a peer's offer; calls that it has already may still be answered."""
        offer = self._offers.get(resolve_name(name))
        if offer is None or offer.peer is not peer:
            peer.send_status(StatusLevel.WARNING, f"the {self._type_name} {name} was not offered by you")
            return
        del self._offers[resolve_name(name)]
        self._remove_provider(peer)

    def find(self, name: str) -> Provider | None:
        """Who provides it."""
        return self._offers.get(resolve_name(name))

    def request_count(self, caller: Peer) -> int:
        """How many of its requests wait."""
        return self._by_caller[caller]

    def add_request(self, request: R) -> Id:
        """Keeps a request until its end; the id is for the provider."""
        id = f"{self._type_name}:{next(self._next_id)}"
        self._requests[id] = request
        if request.caller is not None:
            self._by_caller[request.caller] += 1
        return id

    def request(self, provider: Peer, id: Id | None) -> R | None:
        """The request that a provider speaks of; None, and a remark, if it has none of that id (any more)."""
        request = None if id is None else self._requests.get(id)
        if request is None or request.provider.peer is not provider:
            why = "it had its end, timed out, or its caller left"
            provider.send_status(StatusLevel.WARNING, f"no {self._type_name} call waits for {id!r}: {why}", id)
            return None
        return request

    def pending_request(self, id: Id) -> R | None:
        """The request of one of our ids."""
        return self._requests.get(id)

    def pop_request(self, id: Id) -> None:
        """Forgets a request."""
        request = self._requests.pop(id)
        if request.caller is not None and request.caller in self._by_caller:
            self._by_caller[request.caller] -= 1

    def discard_request(self, id: Id) -> None:
        """Forgets a request, if it is still known."""
        if id in self._requests:
            self.pop_request(id)

    def remove_peer(self, peer: Peer) -> tuple[list[tuple[Id, R]], list[tuple[Id, R]]]:
        """Ends a peer's offers; gives what it had still to answer, and what it had asked of others."""
        for name, offer in list(self._offers.items()):
            if offer.peer is peer:
                del self._offers[name]
        self._by_provider.pop(peer, None)
        self._by_caller.pop(peer, None)
        owed = [(id, each) for id, each in self._requests.items() if each.provider.peer is peer]
        asked = [(id, each) for id, each in self._requests.items() if each.caller is peer]
        return owed, asked

    def _remove_provider(self, provider: Peer) -> None:
        self._by_provider[provider] -= 1
