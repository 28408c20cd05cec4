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
    BridgeLimits,
    CallService,
    CancelActionGoal,
    Operation,
    Publish,
    SendActionGoal,
    ServiceResponse,
    SetLevel,
    StatusLevel,
    Subscribe,
    Unadvertise,
    UnadvertiseAction,
    UnadvertiseService,
    Unsubscribe,
)
from mindstage.bridge.switchboard.actions import ActionRouter
from mindstage.bridge.switchboard.peers import Peer
from mindstage.bridge.switchboard.services import ServiceRouter
from mindstage.bridge.switchboard.topics import TopicRouter

__all__ = ["Broker", "GraphInfo", "ProviderInfo", "TopicInfo"]


class ProviderInfo(msgspec.Struct, frozen=True):
    """A service or an action, and who provides it."""

    name: str
    type: str
    provider: str


class TopicInfo(msgspec.Struct, frozen=True):
    """A topic, and who is at its ends."""

    name: str
    type: str
    """Empty where nobody said it."""
    publishers: tuple[str, ...]
    subscribers: tuple[str, ...]


class GraphInfo(msgspec.Struct, frozen=True):
    """Who and what is at a hub at one moment."""

    peers: tuple[str, ...]
    services: tuple[ProviderInfo, ...]
    actions: tuple[ProviderInfo, ...]
    topics: tuple[TopicInfo, ...]


class Broker:
    """Brings peers together."""

    def __init__(self, loop: asyncio.AbstractEventLoop, limits: BridgeLimits) -> None:
        self.services = ServiceRouter(loop, limits)
        self.actions = ActionRouter(loop, limits)
        self.topics = TopicRouter(loop, limits)
        self._peers: list[Peer] = []
        self._handlers: Mapping[type, Callable[[Peer, Any], None]] = {
            Advertise: self.topics.advertise,
            Unadvertise: self.topics.unadvertise,
            Publish: self.topics.publish,
            Subscribe: self.topics.subscribe,
            Unsubscribe: self.topics.unsubscribe,
            AdvertiseService: self.services.advertise,
            UnadvertiseService: self.services.unadvertise,
            CallService: self.services.forward_call,
            ServiceResponse: self.services.forward_response,
            AdvertiseAction: self.actions.advertise,
            UnadvertiseAction: self.actions.unadvertise,
            SendActionGoal: self.actions.send_goal,
            CancelActionGoal: self.actions.cancel_goal,
            ActionFeedback: self.actions.forward_feedback,
            ActionResult: self.actions.forward_result,
            SetLevel: _set_level,
        }

    def add_peer(self, peer: Peer) -> None:
        """A peer is here."""
        self._peers.append(peer)

    def remove_peer(self, peer: Peer) -> None:
        """A peer is gone: its offers end, its goals are canceled, and whoever waits for it is told."""
        if peer in self._peers:
            self._peers.remove(peer)
            peer.has_left = True
            self.services.remove_peer(peer)
            self.actions.remove_peer(peer)
            self.topics.remove_peer(peer)

    def handle(self, peer: Peer, operation: Operation) -> None:
        """Does what a peer says.

        Raises:
            AdvertiseError: it cannot offer that.
            MessageValidationError: it cannot say that.
        """
        way = self._handlers.get(type(operation))
        if way is None:
            peer.send_status(StatusLevel.WARNING, f"a {type(operation).__name__} makes no sense here", operation.id)
        else:
            way(peer, operation)

    def graph_info(self) -> GraphInfo:
        """Who and what is here now."""
        return GraphInfo(
            peers=tuple(peer.name for peer in self._peers),
            services=tuple(
                ProviderInfo(each.name, each.type, each.peer.name) for each in self.services.providers.providers
            ),
            actions=tuple(
                ProviderInfo(each.name, each.type, each.peer.name) for each in self.actions.providers.providers
            ),
            topics=tuple(
                TopicInfo(
                    topic.name,
                    topic.type,
                    tuple(peer.name for peer in topic.publishers),
                    tuple(peer.name for peer in topic.queues),
                )
                for topic in self.topics.all()
            ),
        )


def _set_level(peer: Peer, request: SetLevel) -> None:
    peer.level = request.level
