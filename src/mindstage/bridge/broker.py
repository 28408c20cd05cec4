"""Topics: what anyone publishes goes to everyone who subscribed, in the order it came."""

from __future__ import annotations

import asyncio
from collections import Counter

from mindstage.bridge.names import resolve_name, same_type
from mindstage.bridge.protocol import (
    Advertise,
    BridgeLimits,
    MessageEncoder,
    Publish,
    StatusLevel,
    Subscribe,
    Unadvertise,
    Unsubscribe,
)
from mindstage.bridge.switchboard.feeds import ThrottledQueue
from mindstage.bridge.switchboard.peers import Peer
from mindstage.errors import AdvertiseError, MessageValidationError

__all__ = ["Topic", "TopicRouter"]


class Topic:
    """One of them; it exists while anyone publishes or listens."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.type = ""
        """Empty until someone says it."""
        self.publishers: dict[Peer, bool] = {}
        """And whether each one's last message is kept."""
        self.latched: dict[Peer, Publish] = {}
        self.queues: dict[Peer, ThrottledQueue] = {}


class TopicRouter:
    """All topics at the hub."""

    def __init__(self, loop: asyncio.AbstractEventLoop, limits: BridgeLimits) -> None:
        self._loop = loop
        self._limits = limits
        self._topics: dict[str, Topic] = {}
        self._subscriptions: Counter[Peer] = Counter()
        self._advertisements: Counter[Peer] = Counter()

    def all(self) -> list[Topic]:
        """By name."""
        return [topic for _, topic in sorted(self._topics.items())]

    def has_subscribers(self, name: str) -> bool:
        """Whether anyone would hear a message."""
        topic = self._topics.get(resolve_name(name))
        return topic is not None and bool(topic.queues)

    def advertise(self, peer: Peer, offer: Advertise) -> None:
        """A peer will publish.

        Raises:
            AdvertiseError: the topic is of another type, or the peer offers too much.
        """
        known = self._topics.get(resolve_name(offer.topic))
        if known is not None and not same_type(known.type, offer.type):
            raise AdvertiseError(offer.topic, cause=f"it is of the type {known.type}, not {offer.type}")
        if known is None or peer not in known.publishers:
            if self._advertisements[peer] >= self._limits.advertisements and not peer.is_local:
                raise AdvertiseError(
                    offer.topic, cause=f"{self._limits.advertisements} topics of one client are enough"
                )
            self._advertisements[peer] += 1
        topic = self._topic(offer.topic)
        topic.type = topic.type or offer.type
        topic.publishers[peer] = offer.latch

    def unadvertise(self, peer: Peer, offer: Unadvertise) -> None:
        """It will not any more."""
        topic = self._topics.get(resolve_name(offer.topic))
        if topic is None or peer not in topic.publishers:
            peer.send_status(StatusLevel.WARNING, f"you did not advertise {offer.topic}", offer.id)
            return
        self._remove_subscriber(topic, peer)

    def publish(self, peer: Peer, message: Publish) -> None:
        """Passes a message on to all who listen.

        Raises:
            MessageValidationError: nobody ever said what the topic's messages are.
        """
        topic = self._topics.get(resolve_name(message.topic))
        if topic is None or not (topic.type or topic.publishers):
            raise MessageValidationError(
                "publish", path="topic", cause=f"{message.topic} is not known", remedy="advertise it first"
            )
        if message.latch or topic.publishers.get(peer):
            topic.publishers.setdefault(peer, True)
            topic.latched[peer] = message
        spelled: dict[str, MessageEncoder] = {}
        for feed in list(topic.queues.values()):
            if feed.name not in spelled:
                spelled[feed.name] = MessageEncoder(Publish(topic=feed.name, msg=message.msg))
            feed.push(spelled[feed.name], peer)

    def subscribe(self, peer: Peer, request: Subscribe) -> None:
        """A peer listens from now on; it gets what was latched at once.

        Raises:
            MessageValidationError: the topic is of another type, or the peer has too many subscriptions.
        """
        known = self._topics.get(resolve_name(request.topic))
        if known is not None and not same_type(known.type, request.type):
            cause = f"{request.topic} is of the type {known.type}, not {request.type}"
            raise MessageValidationError("subscribe", path="type", cause=cause)
        if self._subscriptions[peer] >= self._limits.subscriptions and not peer.is_local:
            cause = f"{self._limits.subscriptions} subscriptions of one client are enough"
            raise MessageValidationError("subscribe", cause=cause)
        topic = self._topic(request.topic)
        topic.type = topic.type or request.type or ""
        feed = topic.queues.get(peer)
        if feed is None:
            feed = topic.queues[peer] = ThrottledQueue(self._loop, peer)
        before = len(feed)
        feed.add(request)
        self._subscriptions[peer] += len(feed) - before
        if not before:
            for publisher, message in topic.latched.items():
                feed.push(MessageEncoder(Publish(topic=feed.name, msg=message.msg)), publisher)

    def unsubscribe(self, peer: Peer, request: Unsubscribe) -> None:
        """It does not listen any more, or one of its subscriptions ends."""
        topic = self._topics.get(resolve_name(request.topic))
        feed = None if topic is None else topic.queues.get(peer)
        before = 0 if feed is None else len(feed)
        if topic is None or feed is None or not feed.remove(request.id):
            peer.send_status(StatusLevel.WARNING, f"you are not subscribed to {request.topic}", request.id)
            return
        self._subscriptions[peer] -= before - len(feed)
        if not feed:
            del topic.queues[peer]
            self._remove_if_unused(topic)

    def remove_peer(self, peer: Peer) -> None:
        """Forgets a peer that is gone."""
        for topic in self.all():
            if feed := topic.queues.pop(peer, None):
                feed.stop()
            self._remove_subscriber(topic, peer)
        self._subscriptions.pop(peer, None)
        self._advertisements.pop(peer, None)

    def _topic(self, name: str) -> Topic:
        return self._topics.setdefault(resolve_name(name), Topic(resolve_name(name)))

    def _remove_subscriber(self, topic: Topic, peer: Peer) -> None:
        if topic.publishers.pop(peer, None) is not None:
            self._advertisements[peer] -= 1
        topic.latched.pop(peer, None)
        self._remove_if_unused(topic)

    def _remove_if_unused(self, topic: Topic) -> None:
        if not topic.publishers and not topic.queues:
            self._topics.pop(topic.name, None)
