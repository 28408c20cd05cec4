"""Outlet: a topic on which the face publishes, and whether it is worth the trouble."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, Generic, TypeVar

from mindstage.bridge import Hub, Participant
from mindstage.errors import BridgeError, ServiceFailed, ServiceUnknown
from mindstage.msgs import Message, RosVersion, encode, type_name

__all__ = ["Listeners", "Outlet"]

M = TypeVar("M", bound=Message)

_ASK_S = 1.0
"""So often someone else's hub is asked who listens [s]."""


class Outlet(Generic[M]):
    """Publishes one type on one topic, in the words of one ROS."""

    def __init__(
        self,
        participant: Participant,
        topic: str,
        type: type[M],
        *,
        ros: RosVersion = RosVersion.TWO,
        latch: bool = False,
    ) -> None:
        self.topic = topic
        self._participant = participant
        self._type = type_name(type, ros)
        self._ros = ros
        self._listeners = Listeners(participant, topic)
        participant.advertise(topic, self._type, latch=latch)

    @property
    def wanted(self) -> bool:
        """Whether anyone may be listening; what nobody hears need not be made."""
        return self._listeners.any

    def publish(self, message: M) -> None:
        """Publishes; a message that nobody hears is no error."""
        self.publish_written(encode(message, ros=self._ros))

    def publish_written(self, written: object) -> None:
        """Publishes what somebody else has written as JSON objects, for speed."""
        self._participant.publish(self.topic, self._type, written)

    def close(self) -> None:
        """Publishes nothing more."""
        self._participant.unadvertise(self.topic)


class Listeners:
    """Whether a topic has any: our own hub knows it, another one is asked now and then."""

    def __init__(self, participant: Participant, topic: str, *, now: Callable[[], float] = time.monotonic) -> None:
        self._participant = participant
        self._topic = topic
        self._now = now
        self._known = True
        self._asked_at = -_ASK_S
        self._asking: Future[Any] | None = None

    @property
    def any(self) -> bool:
        """Whether there are; also where nobody can tell."""
        here = self._participant.has_listeners(self._topic)
        if isinstance(self._participant, Hub) or not here:
            return here
        if self._asking is not None and self._asking.done():
            self._known, self._asking = _told(self._asking), None
        if self._asking is None and self._now() - self._asked_at >= _ASK_S:
            self._asked_at = self._now()
            self._ask()
        return self._known

    def _ask(self) -> None:
        try:
            self._asking = self._participant.start_call("/rosapi/subscribers", {"topic": self._topic}, timeout_s=5.0)
        except BridgeError:
            self._known = True


def _told(asked: Future[Any]) -> bool:
    """What the other hub says; one that cannot tell may have listeners."""
    try:
        return bool(asked.result()["subscribers"])
    except (ServiceUnknown, ServiceFailed, KeyError, TypeError):
        return True
    except BridgeError:
        return True
