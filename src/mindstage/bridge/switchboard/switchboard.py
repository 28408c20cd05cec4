"""Switchboard: what a hub does with each thing that a peer says. Belongs to the loop, and waits for nothing."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from typing import Any

import msgspec

from mindstage.bridge.protocol import (
    ActionFeedback,
    ActionResult,
    Advertise,
    AdvertiseAction,
    AdvertiseService,
    CallService,
    CancelActionGoal,
    Level,
    Limits,
    Operation,
    Publish,
    SendActionGoal,
    ServiceResponse,
    SetLevel,
    Subscribe,
    Unadvertise,
    UnadvertiseAction,
    UnadvertiseService,
    Unsubscribe,
)
from mindstage.bridge.switchboard.actions import Actions
from mindstage.bridge.switchboard.peers import Peer
from mindstage.bridge.switchboard.services import Services
from mindstage.bridge.switchboard.topics import Topics

__all__ = ["Directory", "Listing", "Switchboard", "TopicListing"]


class Listing(msgspec.Struct, frozen=True):
    """A service or an action, and who provides it."""

    name: str
    type: str
    provider: str


class TopicListing(msgspec.Struct, frozen=True):
    """A topic, and who is at its ends."""

    name: str
    type: str
    """Empty where nobody said it."""
    publishers: tuple[str, ...]
    subscribers: tuple[str, ...]


class Directory(msgspec.Struct, frozen=True):
    """Who and what is at a hub at one moment."""

    peers: tuple[str, ...]
    services: tuple[Listing, ...]
    actions: tuple[Listing, ...]
    topics: tuple[TopicListing, ...]


class Switchboard:
    """Brings peers together."""

    def __init__(self, loop: asyncio.AbstractEventLoop, limits: Limits) -> None:
        self.services = Services(loop, limits)
        self.actions = Actions(loop, limits)
        self.topics = Topics(loop, limits)
        self._peers: list[Peer] = []
        self._ways: Mapping[type, Callable[[Peer, Any], None]] = {
            Advertise: self.topics.advertise,
            Unadvertise: self.topics.unadvertise,
            Publish: self.topics.publish,
            Subscribe: self.topics.subscribe,
            Unsubscribe: self.topics.unsubscribe,
            AdvertiseService: self.services.advertise,
            UnadvertiseService: self.services.unadvertise,
            CallService: self.services.call,
            ServiceResponse: self.services.respond,
            AdvertiseAction: self.actions.advertise,
            UnadvertiseAction: self.actions.unadvertise,
            SendActionGoal: self.actions.send,
            CancelActionGoal: self.actions.cancel,
            ActionFeedback: self.actions.feedback,
            ActionResult: self.actions.result,
            SetLevel: _set_level,
        }

    def join(self, peer: Peer) -> None:
        """A peer is here."""
        self._peers.append(peer)

    def leave(self, peer: Peer) -> None:
        """A peer is gone: its offers end, its goals are cancelled, and whoever waits for it is told."""
        if peer in self._peers:
            self._peers.remove(peer)
            peer.gone = True
            self.services.leave(peer)
            self.actions.leave(peer)
            self.topics.leave(peer)

    def receive(self, peer: Peer, operation: Operation) -> None:
        """Does what a peer says.

        Raises:
            OfferRefused: it cannot offer that.
            MessageRefused: it cannot say that.
        """
        way = self._ways.get(type(operation))
        if way is None:
            peer.remark(Level.WARNING, f"a {type(operation).__name__} makes no sense here", operation.id)
        else:
            way(peer, operation)

    def directory(self) -> Directory:
        """Who and what is here now."""
        return Directory(
            peers=tuple(peer.name for peer in self._peers),
            services=tuple(Listing(each.name, each.type, each.provider.name) for each in self.services.exchange.offers),
            actions=tuple(Listing(each.name, each.type, each.provider.name) for each in self.actions.exchange.offers),
            topics=tuple(
                TopicListing(
                    topic.name,
                    topic.type,
                    tuple(peer.name for peer in topic.publishers),
                    tuple(peer.name for peer in topic.feeds),
                )
                for topic in self.topics.all()
            ),
        )


def _set_level(peer: Peer, wish: SetLevel) -> None:
    peer.level = wish.level
