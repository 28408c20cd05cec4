"""Peers: who is at the hub, as the hub sees them, whether behind a socket or in the same process."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple

from mindstage.bridge.protocol import Compression, Id, MessageEncoder, Status, StatusLevel

__all__ = ["PLAIN_FORMAT", "Peer", "ReplyFormat"]


class ReplyFormat(NamedTuple):
    """How a peer wants to be sent something."""

    compression: Compression = Compression.NONE
    fragment_size: int | None = None


PLAIN_FORMAT = ReplyFormat()
"""As JSON, and whole."""


class Peer(ABC):
    """Someone at the hub; compared by identity."""

    is_local = False
    """Whether it lives in this process: then its offers are the hub's own, and nobody else may take their names."""

    def __init__(self, name: str) -> None:
        self.name = name
        """Such as `/client_3`, as tools that look around show it."""
        self.has_left = False
        """Whether it has left."""
        self.level = StatusLevel.ERROR
        """Which remarks it wants to hear."""

    @property
    @abstractmethod
    def congested(self) -> bool:
        """Whether it reads more slowly than it is sent to; what can wait should wait."""

    @abstractmethod
    def deliver(
        self, outgoing: MessageEncoder, route: ReplyFormat = PLAIN_FORMAT, *, sender: Peer | None = None
    ) -> None:
        """Sends it something; never waits.

        Args:
            outgoing: what.
            route: how.
            sender: on whose behalf.
        """

    def send_status(self, level: StatusLevel, message: str, id: Id | None = None) -> None:
        """Tells it something about what it sent, if it wants to hear it."""
        if self.level.includes(level):
            self.deliver(MessageEncoder(Status(id=id, level=level, msg=message)))
