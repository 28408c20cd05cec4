"""Message: what a ROS message, a service and an action are here.

A message is a frozen struct. The module it stands in is called like its ROS package, so `geometry_msgs.Pose` is
`geometry_msgs/Pose`. Its defaults are ROS's own, zero and empty, unless the definition gives another. A service is a
class that holds two messages, an action one that holds three:

    class DeleteModel(Service):
        class Request(Message, frozen=True):
            id: String = ""

        class Response(Message, frozen=True):
            success: Bool = False
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum
from typing import ClassVar

import msgspec

__all__ = ["Action", "Message", "Ros", "Service"]


class Ros(IntEnum):
    """The two generations of ROS, which write the same message a little differently."""

    ONE = 1
    TWO = 2


class Message(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What travels: frozen, hashable, every field checked."""

    constants: ClassVar[tuple[type[IntEnum], ...]] = ()
    """Sets of codes that belong to its definition and are the type of none of its fields."""
    spellings: ClassVar[Mapping[str, str]] = {}
    """Other names under which a field is understood; it is never written so."""
    ros1_names: ClassVar[Mapping[str, str]] = {}
    """Fields that have another name in ROS 1: understood always, written for ROS 1."""
    only_in: ClassVar[Mapping[str, Ros]] = {}
    """Fields that one generation does not have: never required, and written for the other one only."""


class Service:
    """One question and one reply: subclasses hold a `Request` and a `Response`."""

    Request: ClassVar[type[Message]]
    Response: ClassVar[type[Message]]


class Action:
    """Something that takes time: subclasses hold a `Goal`, a `Result` and a `Feedback`."""

    Goal: ClassVar[type[Message]]
    Result: ClassVar[type[Message]]
    Feedback: ClassVar[type[Message]]
