"""Topics: what anyone publishes goes to everyone who subscribed, in the order it came."""

from __future__ import annotations

import asyncio
from collections import Counter

from mindstage.bridge.names import resolved, same_type
from mindstage.bridge.protocol import (
    Advertise,
    Level,
    Limits,
    Outgoing,
    Publish,
    Subscribe,
    Unadvertise,
    Unsubscribe,
)
from mindstage.bridge.switchboard.feeds import Feed
from mindstage.bridge.switchboard.peers import Peer
from mindstage.errors import MessageRefused, OfferRefused

__all__ = ["Topic", "Topics"]


class Topic:
    """One of them; it exists while anyone publishes or listens."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.type = ""
        """Empty until someone says it."""
        self.publishers: dict[Peer, bool] = {}
        """And whether each one's last message is kept."""
        self.latched: dict[Peer, Publish] = {}
        self.feeds: dict[Peer, Feed] = {}


class Topics:
    """All topics at the hub."""

    def __init__(self, loop: asyncio.AbstractEventLoop, limits: Limits) -> None:
        self._loop = loop
        self._limits = limits
        self._topics: dict[str, Topic] = {}
        self._subscriptions: Counter[Peer] = Counter()
        self._adverts: Counter[Peer] = Counter()

    def all(self) -> list[Topic]:
        """By name."""
        return [topic for _, topic in sorted(self._topics.items())]

    def has_listeners(self, name: str) -> bool:
        """Whether anyone would hear a message."""
        topic = self._topics.get(resolved(name))
        return topic is not None and bool(topic.feeds)

    def advertise(self, peer: Peer, offer: Advertise) -> None:
        """A peer will publish.

        Raises:
            OfferRefused: the topic is of another type, or the peer offers too much.
        """
        known = self._topics.get(resolved(offer.topic))
        if known is not None and not same_type(known.type, offer.type):
            raise OfferRefused(offer.topic, cause=f"it is of the type {known.type}, not {offer.type}")
        if known is None or peer not in known.publishers:
            if self._adverts[peer] >= self._limits.offers and not peer.local:
                raise OfferRefused(offer.topic, cause=f"{self._limits.offers} topics of one client are enough")
            self._adverts[peer] += 1
        topic = self._topic(offer.topic)
        topic.type = topic.type or offer.type
        topic.publishers[peer] = offer.latch

    def unadvertise(self, peer: Peer, offer: Unadvertise) -> None:
        """It will not any more."""
        topic = self._topics.get(resolved(offer.topic))
        if topic is None or peer not in topic.publishers:
            peer.remark(Level.WARNING, f"you did not advertise {offer.topic}", offer.id)
            return
        self._silence(topic, peer)

    def publish(self, peer: Peer, message: Publish) -> None:
        """Passes a message on to all who listen.

        Raises:
            MessageRefused: nobody ever said what the topic's messages are.
        """
        topic = self._topics.get(resolved(message.topic))
        if topic is None or not (topic.type or topic.publishers):
            raise MessageRefused(
                "publish", path="topic", cause=f"{message.topic} is not known", remedy="advertise it first"
            )
        if message.latch or topic.publishers.get(peer):
            topic.publishers.setdefault(peer, True)
            topic.latched[peer] = message
        spelled: dict[str, Outgoing] = {}
        for feed in list(topic.feeds.values()):
            if feed.name not in spelled:
                spelled[feed.name] = Outgoing(Publish(topic=feed.name, msg=message.msg))
            feed.push(spelled[feed.name], peer)

    def subscribe(self, peer: Peer, request: Subscribe) -> None:
        """A peer listens from now on; it gets what was latched at once.

        Raises:
            MessageRefused: the topic is of another type, or the peer has too many subscriptions.
        """
        known = self._topics.get(resolved(request.topic))
        if known is not None and not same_type(known.type, request.type):
            cause = f"{request.topic} is of the type {known.type}, not {request.type}"
            raise MessageRefused("subscribe", path="type", cause=cause)
        if self._subscriptions[peer] >= self._limits.subscriptions and not peer.local:
            cause = f"{self._limits.subscriptions} subscriptions of one client are enough"
            raise MessageRefused("subscribe", cause=cause)
        topic = self._topic(request.topic)
        topic.type = topic.type or request.type or ""
        feed = topic.feeds.get(peer)
        if feed is None:
            feed = topic.feeds[peer] = Feed(self._loop, peer)
        before = len(feed)
        feed.add(request)
        self._subscriptions[peer] += len(feed) - before
        if not before:
            for publisher, message in topic.latched.items():
                feed.push(Outgoing(Publish(topic=feed.name, msg=message.msg)), publisher)

    def unsubscribe(self, peer: Peer, request: Unsubscribe) -> None:
        """It does not listen any more, or one of its subscriptions ends."""
        topic = self._topics.get(resolved(request.topic))
        feed = None if topic is None else topic.feeds.get(peer)
        before = 0 if feed is None else len(feed)
        if topic is None or feed is None or not feed.remove(request.id):
            peer.remark(Level.WARNING, f"you are not subscribed to {request.topic}", request.id)
            return
        self._subscriptions[peer] -= before - len(feed)
        if not feed:
            del topic.feeds[peer]
            self._forget_if_unused(topic)

    def leave(self, peer: Peer) -> None:
        """Forgets a peer that is gone."""
        for topic in self.all():
            if feed := topic.feeds.pop(peer, None):
                feed.stop()
            self._silence(topic, peer)
        self._subscriptions.pop(peer, None)
        self._adverts.pop(peer, None)

    def _topic(self, name: str) -> Topic:
        return self._topics.setdefault(resolved(name), Topic(resolved(name)))

    def _silence(self, topic: Topic, peer: Peer) -> None:
        if topic.publishers.pop(peer, None) is not None:
            self._adverts[peer] -= 1
        topic.latched.pop(peer, None)
        self._forget_if_unused(topic)

    def _forget_if_unused(self, topic: Topic) -> None:
        if not topic.publishers and not topic.feeds:
            self._topics.pop(topic.name, None)
