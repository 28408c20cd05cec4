"""Policies of entry points: how much of each thing that a client can reach may be used, and by whom.

A handler is registered together with its policy, and the dispatcher of its server applies it before the handler is
called; handlers check nothing of this themselves.
"""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple

import msgspec

from mindstage.access.limits import (
    CONTROL_BYTES,
    EDIT_BYTES,
    FILE_BYTES,
    FILE_TIME,
    GOAL_TIME,
    MESSAGE_BYTES,
    PLAIN_BYTES,
    QUERY_SERVICE_TIME,
    Limit,
)
from mindstage.access.visitors import Visitor
from mindstage.errors import RequestLimitError

__all__ = [
    "CONTROL",
    "EDIT",
    "FILE",
    "GOAL",
    "PAYLOAD",
    "QUERY",
    "READ",
    "RUN",
    "SPAWN",
    "TRUSTED",
    "Access",
    "Cost",
    "EntryKind",
    "EntryPoint",
    "Policy",
]


class EntryKind(StrEnum):
    """A way by which clients reach something."""

    ROUTE = "page: request"
    SOCKET = "page: websocket"
    METHOD = "page: method"
    OPERATION = "rosbridge: operation"
    SERVICE = "ROS: service"
    ACTION = "ROS: action"
    TOPIC = "ROS: subscribed topic"
    PREDICATE = "Prolog: request"


class Access(StrEnum):
    """What something that a package adds does, as its entry point declares; see `mindstage.registry`."""

    READ = "read"
    """It computes something, and changes nothing."""
    EDIT = "edit"
    """It changes the world, or a file."""
    ACT = "act"
    """It commands a robot, or simulates."""


class Cost(StrEnum):
    """What a request costs."""

    READ = "read"
    EDIT = "edit"
    QUERY = "query"
    """It computes for long; the `queries_per_second` of an address are counted."""
    FILE = "file"
    """It reads or writes a file, or a whole map; counted as a query."""
    TRUSTED = "trusted"
    """It is refused to clients of ports: only the command line and Python calls reach it."""


class Policy(msgspec.Struct, frozen=True, kw_only=True):
    """The limits of an entry point."""

    name: str
    cost: Cost
    size: Limit
    """Largest request [B]."""
    deadline: Limit | None = None
    """Longest time for the answer; None for that of the node, or of the handler's own calls [s]."""

    @property
    def deadline_s(self) -> float | None:
        """The deadline [s]."""
        return None if self.deadline is None else self.deadline.maximum

    def admit(self, subject: str, size: int, visitor: Visitor | None, now_s: float) -> None:
        """Counts a request.

        Args:
            subject: what is requested, for the error.
            size: the size of the request [B].
            visitor: where it comes from; None for this process.
            now_s: the time, of any clock [s].

        Raises:
            RequestLimitError: it is too large, or one too many.
        """
        if size > self.size.maximum:
            cause = f"a request has at most {self.size.count:,} bytes, not {size:,}"
            raise RequestLimitError(subject, cause=cause)
        if self.cost in {Cost.QUERY, Cost.FILE} and visitor is not None and not visitor.may_query(now_s):
            raise RequestLimitError(subject, cause="too many requests at once; wait for the responses")


class EntryPoint(NamedTuple):
    """Something that a client can reach."""

    kind: EntryKind
    name: str
    policy: Policy | None
    """None if it was registered without a policy, which is a defect."""


READ = Policy(name="read", cost=Cost.READ, size=PLAIN_BYTES)
CONTROL = Policy(name="control", cost=Cost.READ, size=CONTROL_BYTES)
EDIT = Policy(name="edit", cost=Cost.EDIT, size=EDIT_BYTES)
SPAWN = Policy(name="spawn", cost=Cost.EDIT, size=FILE_BYTES, deadline=FILE_TIME)
RUN = Policy(name="run", cost=Cost.EDIT, size=PLAIN_BYTES, deadline=FILE_TIME)
GOAL = Policy(name="goal", cost=Cost.EDIT, size=FILE_BYTES, deadline=GOAL_TIME)
QUERY = Policy(name="query", cost=Cost.QUERY, size=PLAIN_BYTES, deadline=QUERY_SERVICE_TIME)
FILE = Policy(name="file", cost=Cost.FILE, size=FILE_BYTES, deadline=FILE_TIME)
PAYLOAD = Policy(name="payload", cost=Cost.READ, size=MESSAGE_BYTES)
TRUSTED = Policy(name="trusted", cost=Cost.TRUSTED, size=FILE_BYTES)
