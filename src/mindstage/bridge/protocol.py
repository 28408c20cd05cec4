"""Operations: what the two ends of a rosbridge connection say to one another, one struct for each `op`.

What a message carries (`msg`, `args`, `call_raw`) stays the JSON text it came as until somebody needs to look into it,
so that a hub passes it on untouched and unread. Fields nobody knows are ignored, as rosbridge does.
The fields are those of the rosbridge v2 protocol document of rosbridge_suite; `auth` is rosauth's.
"""

from __future__ import annotations

import re
from enum import IntEnum, StrEnum
from typing import Annotated

from msgspec import UNSET, Meta, Raw, Struct, UnsetType

__all__ = [
    "ActionFeedback",
    "ActionResult",
    "Advertise",
    "AdvertiseAction",
    "AdvertiseService",
    "Auth",
    "CallService",
    "CancelActionGoal",
    "Compression",
    "Fragment",
    "GoalStatus",
    "Id",
    "Operation",
    "Png",
    "Publish",
    "SendActionGoal",
    "ServiceResponse",
    "SetLevel",
    "Status",
    "StatusLevel",
    "Subscribe",
    "Unadvertise",
    "UnadvertiseAction",
    "UnadvertiseService",
    "Unsubscribe",
    "content",
]

Id = str | int
"""Names an exchange, such as one call and its answer; whoever begins it chooses."""

_Size = Annotated[int, Meta(ge=1)]
_Count = Annotated[int, Meta(ge=0)]
_NotNegative = Annotated[float, Meta(ge=0.0)]
_Name = Annotated[str, Meta(min_length=1, max_length=1024)]
_Type = Annotated[str, Meta(max_length=1024)]


class Compression(StrEnum):
    """How a message is packed for the one who asked for it."""

    NONE = "none"
    PNG = "png"
    """The JSON text as the pixels of an image."""
    CBOR = "cbor"
    """A binary frame."""


class StatusLevel(StrEnum):
    """How grave a status message is; a client hears of its level and what is graver."""

    NONE = "none"
    ERROR = "error"
    WARNING = "warning"
    INFO = "info"

    def includes(self, other: StatusLevel) -> bool:
        """Whether a client that set this level is told of the other one."""
        order = list(StatusLevel)
        return StatusLevel.NONE is not other and order.index(other) <= order.index(self)


class GoalStatus(IntEnum):
    """What became of an action's goal, as `action_msgs/GoalStatus` counts it."""

    UNKNOWN = 0
    ACCEPTED = 1
    EXECUTING = 2
    CANCELING = 3
    SUCCEEDED = 4
    CANCELED = 5
    ABORTED = 6


def _op(name: str) -> str:
    return re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()


class _Operation(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="op", tag=_op):
    id: Id | None = None


# -- topics ------------------------------------------------------------------------------------------------------------


class Advertise(_Operation, frozen=True, kw_only=True):
    """I will publish on a topic."""

    topic: _Name
    type: _Type
    latch: bool = False
    """Whether the last message is kept for those who subscribe later."""


class Unadvertise(_Operation, frozen=True, kw_only=True):
    """I will not publish on it any more."""

    topic: _Name


class Publish(_Operation, frozen=True, kw_only=True):
    """A message on a topic, in both directions."""

    topic: _Name
    msg: Raw
    latch: bool | None = None


class Subscribe(_Operation, frozen=True, kw_only=True):
    """I want a topic's messages."""

    topic: _Name
    type: _Type | None = None
    throttle_rate: _NotNegative | None = None
    """The least time between two messages [ms]."""
    queue_length: _Count | None = None
    fragment_size: _Size | None = None
    compression: Compression | None = None


class Unsubscribe(_Operation, frozen=True, kw_only=True):
    """I do not want them any more; with an id, only that subscription ends."""

    topic: _Name


# -- services ----------------------------------------------------------------------------------------------------------


class AdvertiseService(_Operation, frozen=True, kw_only=True):
    """Calls of this service are mine to answer."""

    service: _Name
    type: _Type


class UnadvertiseService(_Operation, frozen=True, kw_only=True):
    """I do not answer it any more."""

    service: _Name


class CallService(_Operation, frozen=True, kw_only=True):
    """A question, in both directions."""

    service: _Name
    args: Raw | UnsetType = UNSET
    """An object, or a list of its fields in order."""
    timeout: _NotNegative | None = None
    """How long the caller waits [s]."""
    fragment_size: _Size | None = None
    compression: Compression | None = None


class ServiceResponse(_Operation, frozen=True, kw_only=True):
    """Its answer."""

    service: _Name
    values: Raw | UnsetType = UNSET
    """The answer; where `result` is false, the text of the error."""
    result: bool


# -- actions (ROS 2) ---------------------------------------------------------------------------------------------------


class AdvertiseAction(_Operation, frozen=True, kw_only=True):
    """Goals of this action are mine to reach."""

    action: _Name
    type: _Type


class UnadvertiseAction(_Operation, frozen=True, kw_only=True):
    """I do not take its goals any more."""

    action: _Name


class SendActionGoal(_Operation, frozen=True, kw_only=True):
    """A goal, in both directions."""

    action: _Name
    action_type: _Type
    args: Raw | UnsetType = UNSET
    feedback: bool = False
    """Whether the sender wants to hear how it goes."""
    fragment_size: _Size | None = None
    compression: Compression | None = None


class CancelActionGoal(_Operation, frozen=True, kw_only=True):
    """Give that goal up."""

    id: Id
    action: _Name


class ActionFeedback(_Operation, frozen=True, kw_only=True):
    """How a goal goes."""

    id: Id
    action: _Name
    values: Raw | UnsetType = UNSET


class ActionResult(_Operation, frozen=True, kw_only=True):
    """How it ended; a goal that was given up is no error: its `result` is true and its `status` says so."""

    action: _Name
    values: Raw | UnsetType = UNSET
    status: int
    result: bool


# -- about the connection itself ---------------------------------------------------------------------------------------


class Status(_Operation, frozen=True, kw_only=True):
    """A remark about something that was sent, by its id."""

    level: StatusLevel
    msg: str


class SetLevel(_Operation, frozen=True, kw_only=True):
    """Which remarks I want to hear."""

    level: StatusLevel


class Auth(_Operation, frozen=True, kw_only=True):
    """Who I am: either the token itself, or rosauth's proof that I know it."""

    token: str | None = None
    mac: str = ""
    client: str = ""
    dest: str = ""
    rand: str = ""
    t: int = 0
    level: str = ""
    end: int = 0


# -- wrappings ---------------------------------------------------------------------------------------------------------


class Fragment(_Operation, frozen=True, kw_only=True):
    """A piece of the text of another message."""

    id: Id
    data: str
    num: _Count
    """Which piece, from 0."""
    total: _Size


class Png(_Operation, frozen=True, kw_only=True):
    """Another message, or a piece of it, as the pixels of an image in base64."""

    data: str
    num: _Count | None = None
    total: _Size | None = None


Operation = (
    Advertise
    | Unadvertise
    | Publish
    | Subscribe
    | Unsubscribe
    | AdvertiseService
    | UnadvertiseService
    | CallService
    | ServiceResponse
    | AdvertiseAction
    | UnadvertiseAction
    | SendActionGoal
    | CancelActionGoal
    | ActionFeedback
    | ActionResult
    | Status
    | SetLevel
    | Auth
    | Fragment
    | Png
)
"""Everything that can be said."""

_NOTHING = Raw(b"{}")


def content(raw: Raw | UnsetType) -> Raw:
    """What a message carries; an empty object where it carries nothing, or null."""
    return _NOTHING if raw is UNSET or bytes(raw) == b"null" else raw
