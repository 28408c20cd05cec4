"""Operations: what the two ends of a rosbridge connection say to one another, one struct for each `op`.

What a message carries (`msg`, `args`, `call_raw`) stays the JSON text it came as until somebody needs to look into it,
so that a hub passes it on untouched and unread. Fields nobody knows are ignored, as rosbridge does.
The fields are those of the rosbridge v2 protocol document of rosbridge_suite; `auth` is rosauth's.

Limits: how much one end of a connection lets the other one ask for.

Every queue, table and wait of the bridge has its bound here, so that no peer can fill the memory or keep the loop.

Fragments: a text cut into pieces for one who cannot take it whole, and put together again.

The pieces of several messages may come in any order and mixed; each message is held until it is complete, too large
or too old.

Codec: frames in, operations out, and back; no socket, no clock, no thread.

One `MessageDecoder` stands at the receiving end of a connection and joins what was cut in pieces; an `MessageEncoder` is an
operation on its way out, encoded once however many peers it goes to.

Protocol: rosbridge v2 without I/O; text or bytes in, typed operations out, and back.
"""

from __future__ import annotations

import re
from collections.abc import Hashable
from enum import IntEnum, StrEnum
from itertools import count
from typing import Annotated

import msgspec
from msgspec import UNSET, Meta, Raw, Struct, UnsetType

from mindstage.bridge.encodings import json_depth, read_cbor, read_png, write_cbor, write_png
from mindstage.errors import MessageValidationError

__all__ = [
    "DEFAULT_LIMITS",
    "ActionFeedback",
    "ActionResult",
    "Advertise",
    "AdvertiseAction",
    "AdvertiseService",
    "Auth",
    "BridgeLimits",
    "CallService",
    "CancelActionGoal",
    "Compression",
    "Fragment",
    "FragmentBuffer",
    "Frame",
    "GoalStatus",
    "Id",
    "MessageDecoder",
    "MessageEncoder",
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
    "split_fragments",
]


_MIB = 1 << 20


class BridgeLimits(msgspec.Struct, frozen=True, kw_only=True):
    """The defaults are generous for a robot and its tools, and small beside a machine's memory."""

    message_bytes: int = 32 * _MIB
    """One message, after its fragments were joined and its compression undone."""
    png_bytes: int = 1 * _MIB
    """What one PNG may hold: undoing its filters is slow work for Python."""
    cbor_bytes: int = 8 * _MIB
    """One binary frame: its typed arrays become many times larger while they are read."""
    depth: int = 64
    """How deep arrays and objects may nest."""
    fragments: int = 4096
    """Of one message, in both directions."""
    fragmented_messages: int = 16
    """Begun and not yet complete, of one connection."""
    fragment_timeout_s: float = 30.0
    """A message whose next fragment does not come for so long is forgotten [s]."""
    connections: int = 256
    """At one server."""
    calls: int = 256
    """Service calls of one client that wait for their answer."""
    goals: int = 64
    """Action goals of one client that are under way."""
    orphaned_goal_timeout_s: float = 60.0
    """So long does the hub wait for the end of a goal that it canceled because its sender is gone [s]."""
    advertisements: int = 1024
    """Services, actions and topics that one client may offer."""
    subscriptions: int = 1024
    """Of one client."""
    waiting_messages: int = 16384
    """Ready to be sent to one peer; a peer that reads so slowly that there are more is dropped."""
    waiting_bytes: int = 64 * _MIB
    """The same, counted in bytes."""
    call_timeout_s: float = 10.0
    """A service call that names no timeout has this one [s]."""
    max_call_timeout_s: float = 3600.0
    """No call may wait longer, whatever it names [s]."""
    auth_timeout_s: float = 10.0
    """So long may a client that needs a token take to show it [s]."""


DEFAULT_LIMITS = BridgeLimits()
"""What holds where nobody says otherwise."""


def split_fragments(text: str, size: int, *, max_fragments: int) -> list[str]:
    """Pieces of that many characters; of more, if there would be more than `most` of them."""
    size = max(size, -(-len(text) // max_fragments), 1)
    return [text[start : start + size] for start in range(0, len(text), size)] or [""]


class _PartialMessage:
    def __init__(self, total: int, now_s: float) -> None:
        self.total = total
        self.pieces: dict[int, str] = {}
        self.length = 0
        self.last_update_s = now_s


class FragmentBuffer:
    """What has come of messages whose other pieces are still on their way."""

    def __init__(self, limits: BridgeLimits) -> None:
        self._limits = limits
        self._partial: dict[Hashable, _PartialMessage] = {}

    def __len__(self) -> int:
        return len(self._partial)

    def add(self, key: Hashable, num: int, total: int, data: str, now_s: float) -> str | None:
        """Takes a piece; gives the whole text with the last one.

        Args:
            key: which message it belongs to.
            num: which piece it is, from 0.
            total: of how many.
            data: the piece.
            now_s: the present moment, on any clock that only goes forward [s].

        Raises:
            MessageValidationError: it fits no message or exceeds a limit; the message is forgotten.
        """
        message = self._partial.get(key)
        try:
            if message is None:
                message = self._begin(key, total, now_s)
            self._add_fragment(message, num, total, data)
        except MessageValidationError:
            self._partial.pop(key, None)
            raise
        message.last_update_s = now_s
        if len(message.pieces) < message.total:
            return None
        del self._partial[key]
        return "".join(message.pieces[number] for number in range(message.total))

    def expire(self, now_s: float) -> list[Hashable]:
        """Forgets messages whose next piece did not come in time, and says which."""
        old = [
            key for key, each in self._partial.items() if now_s - each.last_update_s > self._limits.fragment_timeout_s
        ]
        for key in old:
            del self._partial[key]
        return old

    def _begin(self, key: Hashable, total: int, now_s: float) -> _PartialMessage:
        if total > self._limits.fragments:
            raise _fragment_error(f"{total} pieces are too many", f"at most {self._limits.fragments}")
        if len(self._partial) >= self._limits.fragmented_messages:
            raise _fragment_error(f"{len(self._partial)} messages are incomplete already", "finish one of them first")
        self._partial[key] = message = _PartialMessage(total, now_s)
        return message

    def _add_fragment(self, message: _PartialMessage, num: int, total: int, data: str) -> None:
        if total != message.total:
            raise _fragment_error(
                f"a piece of {total}, where the others are of {message.total}", "begin the message again"
            )
        if num >= total:
            raise _fragment_error(f"there is no piece {num} of {total}", "pieces are counted from 0")
        if message.pieces.get(num, data) != data:
            raise _fragment_error(f"piece {num} came twice, and differs", "begin the message again")
        if num not in message.pieces:
            message.pieces[num] = data
            message.length += len(data)
        held = sum(each.length for each in self._partial.values())
        if held > self._limits.message_bytes:
            raise _fragment_error(f"{held} bytes in pieces are too many", f"at most {self._limits.message_bytes}")


def _fragment_error(cause: str, remedy: str) -> MessageValidationError:
    return MessageValidationError("fragment", cause=cause, remedy=remedy)


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


Frame = str | bytes
"""What a websocket carries: a text frame, or a binary one."""

_decoder: msgspec.json.Decoder[Operation] = msgspec.json.Decoder(Operation)
_encoder = msgspec.json.Encoder()
_fragment_numbers = count(1)


class _Envelope(msgspec.Struct):
    """What can be told of a message that is otherwise wrong."""

    id: Id | None = None
    op: str = "message"


_envelope_decoder = msgspec.json.Decoder(_Envelope)


class MessageDecoder:
    """Understands what one peer sends."""

    def __init__(self, limits: BridgeLimits) -> None:
        self._limits = limits
        self._fragments = FragmentBuffer(limits)

    @property
    def pending_messages(self) -> int:
        """How many messages wait for more of their fragments."""
        return len(self._fragments)

    def decode(self, frame: Frame, now_s: float) -> Operation | None:
        """What a frame says, or None where it is a fragment of something larger.

        Args:
            frame: as it came.
            now_s: the present moment, on any clock that only goes forward [s]; fragments grow old by it.

        Raises:
            MessageValidationError: with the message's id, where it can be read.
        """
        return self._unwrap(self._decompress(frame), now_s, allowed=(Fragment, Png))

    def expire(self, now_s: float) -> list[Id]:
        """Forgets messages whose fragments stopped coming, and says which."""
        return [key[1] for key in self._fragments.expire(now_s) if isinstance(key, tuple)]

    def _decompress(self, frame: Frame) -> str:
        most = self._limits.message_bytes if isinstance(frame, str) else self._limits.cbor_bytes
        if len(frame) > most:
            raise MessageValidationError("frame", cause=f"{len(frame)} bytes are too many", remedy=f"at most {most}")
        return frame if isinstance(frame, str) else read_cbor(frame, depth=self._limits.depth).decode()

    def _parse(self, text: str) -> Operation:
        if json_depth(text, limit=self._limits.depth) > self._limits.depth:
            raise MessageValidationError("message", cause=f"it nests deeper than {self._limits.depth} levels")
        try:
            return _decoder.decode(text)
        except msgspec.ValidationError as error:
            raise _decode_error(text, error) from None
        except (msgspec.DecodeError, UnicodeEncodeError, RecursionError) as error:
            raise MessageValidationError("message", cause=str(error)) from None

    def _unwrap(self, text: str, now_s: float, allowed: tuple[type[Fragment | Png], ...]) -> Operation | None:
        """The operation itself; a PNG may come in fragments, and nothing else may be wrapped twice."""
        operation = self._parse(text)
        if not isinstance(operation, Fragment | Png):
            return operation
        kind = type(operation)
        try:
            if kind not in allowed:
                raise MessageValidationError(
                    _type_name(kind), cause="it comes out of another wrapping, which is too much"
                )
            inner = self._decode_inner(operation, now_s)
        except MessageValidationError as error:
            error.id = operation.id
            raise
        return None if inner is None else self._unwrap(inner, now_s, allowed[allowed.index(kind) + 1 :])

    def _decode_inner(self, wrapping: Fragment | Png, now_s: float) -> str | None:
        data: str | None = wrapping.data
        if wrapping.num is not None and wrapping.total is not None:
            key = (type(wrapping), wrapping.id)
            data = self._fragments.add(key, wrapping.num, wrapping.total, wrapping.data, now_s)
        if data is None or isinstance(wrapping, Fragment):
            return data
        return read_png(data, max_bytes=self._limits.png_bytes)


class MessageEncoder:
    """One operation on its way out; each encoding of it is made when first wanted, and once."""

    __slots__ = ("_frames", "_text", "operation")

    def __init__(self, operation: Operation) -> None:
        self.operation = operation
        self._text = ""
        self._frames: dict[tuple[Compression, int | None], tuple[Frame, ...]] = {}

    def frames(
        self,
        compression: Compression = Compression.NONE,
        fragment_size: int | None = None,
        *,
        max_fragments: int = 4096,
    ) -> tuple[Frame, ...]:
        """What to send, in this order.

        Args:
            compression: how it is packed; CBOR is never cut in fragments, for it is no text.
            fragment_size: the most characters one piece may have, if the other end asked for that.
            most: into how many pieces it may be cut; they grow if there would be more.
        """
        key = (compression, fragment_size)
        if key not in self._frames:
            self._frames[key] = self._encode(compression, fragment_size, max_fragments)
        return self._frames[key]

    def _encode(self, compression: Compression, fragment_size: int | None, max_fragments: int) -> tuple[Frame, ...]:
        text = self._text = self._text or _encoder.encode(self.operation).decode()
        if compression is Compression.CBOR:
            return (write_cbor(text),)
        if compression is Compression.PNG:
            text = _encoder.encode(Png(id=self.operation.id, data=write_png(text))).decode()
        if fragment_size is None or len(text) <= fragment_size:
            return (text,)
        pieces = split_fragments(text, fragment_size, max_fragments=max_fragments)
        id = f"fragment:{next(_fragment_numbers)}"
        return tuple(
            _encoder.encode(Fragment(id=id, data=piece, num=number, total=len(pieces))).decode()
            for number, piece in enumerate(pieces)
        )


def _type_name(operation: type[Operation]) -> str:
    return str(operation.__struct_config__.tag)


def _decode_error(text: str, error: msgspec.ValidationError) -> MessageValidationError:
    """What is wrong, where, and in which message."""
    cause, _, path = str(error).partition(" - at `$")
    try:
        envelope = _envelope_decoder.decode(text)
    except (msgspec.DecodeError, RecursionError):  # further on it is worse
        envelope = _Envelope()
    return MessageValidationError(envelope.op[:64], path=path.strip("`.") or "", cause=cause, id=envelope.id)
