"""Outlet: a topic on which the face publishes, and whether it is worth the trouble."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, Generic, TypeVar

from mindstage.bridge import LocalNode, Node
from mindstage.errors import BridgeError, ServiceCallError, ServiceNotFoundError
from mindstage.msgs import Message, RosVersion, encode, type_name

__all__ = ["Publisher", "SubscriberCount"]

M = TypeVar("M", bound=Message)

_POLL_INTERVAL_S = 1.0
"""So often someone else's hub is asked who listens [s]."""


class Publisher(Generic[M]):
    """Publishes one type on one topic, in the words of one ROS."""

    def __init__(
        self,
        node: Node,
        topic: str,
        type: type[M],
        *,
        ros: RosVersion = RosVersion.TWO,
        latch: bool = False,
    ) -> None:
        self.topic = topic
        self._node = node
        self._type = type_name(type, ros)
        self._ros = ros
        self._subscribers = SubscriberCount(node, topic)
        node.advertise(topic, self._type, latch=latch)

    @property
    def has_subscribers(self) -> bool:
        """Whether anyone may be listening; what nobody hears need not be made."""
        return self._subscribers.has_any

    def publish(self, message: M) -> None:
        """Publishes; a message that nobody hears is no error."""
        self.publish_encoded(encode(message, ros=self._ros))

    def publish_encoded(self, values: object) -> None:
        """Publishes what somebody else has written as JSON objects, for speed."""
        self._node.publish(self.topic, self._type, values)

    def close(self) -> None:
        """Publishes nothing more."""
        self._node.unadvertise(self.topic)


class SubscriberCount:
    """Whether a topic has any: our own hub knows it, another one is asked now and then."""

    def __init__(self, node: Node, topic: str, *, now: Callable[[], float] = time.monotonic) -> None:
        self._node = node
        self._topic = topic
        self._now = now
        self._last_answer = True
        self._last_poll_s = -_POLL_INTERVAL_S
        self._pending: Future[Any] | None = None

    @property
    def has_any(self) -> bool:
        """Whether there are; also where nobody can tell."""
        here = self._node.has_subscribers(self._topic)
        if isinstance(self._node, LocalNode) or not here:
            return here
        if self._pending is not None and self._pending.done():
            self._last_answer, self._pending = _has_subscribers(self._pending), None
        if self._pending is None and self._now() - self._last_poll_s >= _POLL_INTERVAL_S:
            self._last_poll_s = self._now()
            self._poll()
        return self._last_answer

    def _poll(self) -> None:
        try:
            self._pending = self._node.call_service_async("/rosapi/subscribers", {"topic": self._topic}, timeout_s=5.0)
        except BridgeError:
            self._last_answer = True


def _has_subscribers(asked: Future[Any]) -> bool:
    """What the other hub says; one that cannot tell may have listeners."""
    try:
        return bool(asked.result()["subscribers"])
    except (ServiceNotFoundError, ServiceCallError, KeyError, TypeError):
        return True
    except BridgeError:
        return True
