"""The rosbridge v2 protocol without I/O: operations as structs, and their codec.

There is one struct for each `op` of the rosbridge v2 protocol document of rosbridge_suite; `auth` is that of rosauth.
`MessageDecoder` converts frames to operations and joins fragments, `MessageEncoder` converts an operation to frames,
once for all recipients. `BridgeLimits` has a bound for every queue, table and timeout of the bridge, so that no peer
can exhaust the memory or block the event loop.

Payloads (`msg`, `args`, `values`) remain undecoded JSON text, so that a broker forwards them without parsing. Unknown
fields are ignored, as in rosbridge. Fragments of several messages may arrive interleaved and in any order; an
incomplete message is discarded when it becomes too large or too old.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Hashable
from enum import IntEnum, StrEnum
from itertools import count
from typing import Annotated, Any

import msgspec
from msgspec import UNSET, Meta, Raw, Struct, UnsetType

from mindstage.access.limits import BridgeLimits
from mindstage.bridge.encodings import json_depth, read_cbor, read_png, write_cbor, write_png
from mindstage.errors import MessageValidationError

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
    "non_finite_path",
    "read_lenient_json",
    "split_fragments",
]


_EMPTY_OBJECT = Raw(b"{}")


def split_fragments(text: str, size: int, *, max_fragments: int) -> list[str]:
    """Splits a text into fragments.

    Args:
        size: number of characters of a fragment.
        max_fragments: largest number of fragments; if there would be more, the fragments become larger.
    """
    size = max(size, -(-len(text) // max_fragments), 1)
    return [text[start : start + size] for start in range(0, len(text), size)] or [""]


class _PartialMessage:
    def __init__(self, total: int, now_s: float) -> None:
        self.total = total
        self.fragments: dict[int, str] = {}
        self.length = 0
        self.last_update_s = now_s


class FragmentBuffer:
    """Fragments of messages that are not complete yet."""

    def __init__(self, limits: BridgeLimits) -> None:
        self._limits = limits
        self._partial: dict[Hashable, _PartialMessage] = {}

    def __len__(self) -> int:
        return len(self._partial)

    def add(self, key: Hashable, num: int, total: int, data: str, now_s: float) -> str | None:
        """Adds a fragment; returns the whole text with the last one, else None.

        Args:
            key: identifies the message.
            num: index of the fragment, from 0.
            total: number of fragments of the message.
            data: text of the fragment.
            now_s: time of a monotonic clock [s].

        Raises:
            MessageValidationError: the fragment is inconsistent or exceeds a limit; the message is discarded.
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
        if len(message.fragments) < message.total:
            return None
        del self._partial[key]
        return "".join(message.fragments[number] for number in range(message.total))

    def expire(self, now_s: float) -> list[Hashable]:
        """Discards messages whose next fragment did not arrive in time, and returns their keys."""
        timeout_s = self._limits.fragment_timeout_s
        expired = [key for key, message in self._partial.items() if now_s - message.last_update_s > timeout_s]
        for key in expired:
            del self._partial[key]
        return expired

    def _begin(self, key: Hashable, total: int, now_s: float) -> _PartialMessage:
        if total > self._limits.fragments:
            raise _fragment_error(f"it has {total} fragments", f"at most {self._limits.fragments}")
        if len(self._partial) >= self._limits.fragmented_messages:
            raise _fragment_error(f"{len(self._partial)} messages are incomplete", "complete one of them first")
        self._partial[key] = message = _PartialMessage(total, now_s)
        return message

    def _add_fragment(self, message: _PartialMessage, num: int, total: int, data: str) -> None:
        if total != message.total:
            raise _fragment_error(
                f"total is {total}, and {message.total} in earlier fragments", "send the message again"
            )
        if num >= total:
            raise _fragment_error(f"num is {num} of {total}", "fragments are numbered from 0")
        if message.fragments.get(num, data) != data:
            raise _fragment_error(f"fragment {num} was received twice with different data", "send the message again")
        if num not in message.fragments:
            message.fragments[num] = data
            message.length += len(data)
        held = sum(each.length for each in self._partial.values())
        if held > self._limits.message_bytes:
            raise _fragment_error(f"incomplete messages have {held} bytes", f"at most {self._limits.message_bytes}")


def _fragment_error(cause: str, remedy: str) -> MessageValidationError:
    return MessageValidationError("fragment", cause=cause, remedy=remedy)


Id = str | int
"""Identifies an exchange, such as a call and its response; chosen by the side that starts it."""

_Size = Annotated[int, Meta(ge=1)]
_Count = Annotated[int, Meta(ge=0)]
_NotNegative = Annotated[float, Meta(ge=0.0)]
_Name = Annotated[str, Meta(min_length=1, max_length=1024)]
_Type = Annotated[str, Meta(max_length=1024)]


class Compression(StrEnum):
    """Encoding of the messages to a client, which chooses it."""

    NONE = "none"
    PNG = "png"
    """The JSON text as the pixels of an image."""
    CBOR = "cbor"
    """A binary frame."""
    CBOR_RAW = "cbor-raw"
    """A binary frame, in which the messages of topics are the bytes that ROS serializes; otherwise as `CBOR`."""


class StatusLevel(StrEnum):
    """Severity of a status message; a client receives those of its level and of more severe ones."""

    NONE = "none"
    ERROR = "error"
    WARNING = "warning"
    INFO = "info"

    def includes(self, other: StatusLevel) -> bool:
        """Whether a client at this level receives status messages of another level."""
        order = list(StatusLevel)
        return StatusLevel.NONE is not other and order.index(other) <= order.index(self)


class GoalStatus(IntEnum):
    """Status of the goal of an action, with the codes of `action_msgs/GoalStatus`."""

    UNKNOWN = 0
    ACCEPTED = 1
    EXECUTING = 2
    CANCELING = 3
    SUCCEEDED = 4
    CANCELED = 5
    ABORTED = 6

    @classmethod
    def _missing_(cls, value: object) -> GoalStatus:
        """A status of another server without a meaning here is unknown."""
        return cls.UNKNOWN


def _op(name: str) -> str:
    return re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()


class _Operation(Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="op", tag=_op):
    id: Id | None = None


# -- topics ------------------------------------------------------------------------------------------------------------


class Advertise(_Operation, frozen=True, kw_only=True):
    """Announces messages on a topic."""

    topic: _Name
    type: _Type
    latch: bool = False
    """Whether later subscribers receive the last message."""


class Unadvertise(_Operation, frozen=True, kw_only=True):
    """Ends the announcement of a topic."""

    topic: _Name


class Publish(_Operation, frozen=True, kw_only=True):
    """A message on a topic, in both directions."""

    topic: _Name
    msg: Raw
    latch: bool | None = None


class Subscribe(_Operation, frozen=True, kw_only=True):
    """Requests the messages of a topic."""

    topic: _Name
    type: _Type | None = None
    throttle_rate: _Count | None = None
    """Least time between two messages [ms]; an integer, since rosbridge_suite refuses other numbers."""
    queue_length: _Count | None = None
    fragment_size: _Size | None = None
    compression: Compression | None = None


class Unsubscribe(_Operation, frozen=True, kw_only=True):
    """Ends all subscriptions of a topic; with an id, only that one."""

    topic: _Name


# -- services ----------------------------------------------------------------------------------------------------------


class AdvertiseService(_Operation, frozen=True, kw_only=True):
    """Announces a service of this client."""

    service: _Name
    type: _Type


class UnadvertiseService(_Operation, frozen=True, kw_only=True):
    """Withdraws a service."""

    service: _Name


class CallService(_Operation, frozen=True, kw_only=True):
    """A service call, in both directions."""

    service: _Name
    args: Raw | UnsetType = UNSET
    """An object, or a list of its fields in order."""
    timeout: _NotNegative | None = None
    """Timeout of the call [s]."""
    fragment_size: _Size | None = None
    compression: Compression | None = None


class ServiceResponse(_Operation, frozen=True, kw_only=True):
    """The response to a service call."""

    service: _Name
    values: Raw | UnsetType = UNSET
    """The response message; if `result` is false, the error message, or with a `reason` a response message."""
    result: bool
    reason: str | None = None
    """The error message, where `values` must be an object. An extension, which rosbridge_suite ignores."""


# -- actions (ROS 2) ---------------------------------------------------------------------------------------------------


class AdvertiseAction(_Operation, frozen=True, kw_only=True):
    """Announces an action of this client."""

    action: _Name
    type: _Type


class UnadvertiseAction(_Operation, frozen=True, kw_only=True):
    """Withdraws an action."""

    action: _Name


class SendActionGoal(_Operation, frozen=True, kw_only=True):
    """A goal for an action, in both directions."""

    action: _Name
    action_type: _Type
    args: Raw | UnsetType = UNSET
    feedback: bool = False
    """Whether the client requests feedback."""
    fragment_size: _Size | None = None
    compression: Compression | None = None


class CancelActionGoal(_Operation, frozen=True, kw_only=True):
    """Cancels a goal."""

    id: Id
    action: _Name


class ActionFeedback(_Operation, frozen=True, kw_only=True):
    """Progress of a goal."""

    id: Id
    action: _Name
    values: Raw | UnsetType = UNSET


class ActionResult(_Operation, frozen=True, kw_only=True):
    """Result of a goal. Of a canceled goal, `result` is true and `status` is that of a canceled goal."""

    action: _Name
    values: Raw | UnsetType = UNSET
    status: int
    result: bool
    reason: str | None = None
    """As of a `ServiceResponse`."""


# -- the connection ----------------------------------------------------------------------------------------------------


class Status(_Operation, frozen=True, kw_only=True):
    """A message about an operation, which is identified by its id."""

    level: StatusLevel
    msg: str


class SetLevel(_Operation, frozen=True, kw_only=True):
    """Selects which status messages the client receives."""

    level: StatusLevel


class Auth(_Operation, frozen=True, kw_only=True):
    """Authentication, by the token itself or by rosauth's hash of it."""

    token: str | None = None
    mac: str = ""
    client: str = ""
    dest: str = ""
    rand: str = ""
    t: int = 0
    level: str = ""
    end: int = 0


# -- wrappers ----------------------------------------------------------------------------------------------------------


class Fragment(_Operation, frozen=True, kw_only=True):
    """A part of the text of another message."""

    id: Id
    data: str
    num: _Count
    """Index of the fragment, from 0."""
    total: _Size


class Png(_Operation, frozen=True, kw_only=True):
    """Another message, or a fragment of it, as the pixels of an image in base64."""

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
"""Any operation."""


def content(raw: Raw | UnsetType) -> Raw:
    """Returns the payload of a message; an empty object if it is missing or null."""
    return _EMPTY_OBJECT if raw is UNSET or bytes(raw) == b"null" else raw


Frame = str | bytes
"""Payload of a websocket frame: text or binary."""

_decoder: msgspec.json.Decoder[Operation] = msgspec.json.Decoder(Operation)
_encoder = msgspec.json.Encoder()
_fragment_numbers = count(1)


class _Envelope(msgspec.Struct):
    """The parts of an invalid message that can still be decoded."""

    id: Id | None = None
    op: str = "message"
    service: _Name | None = None
    action: _Name | None = None

    def answer(self, text: str) -> Operation | None:
        """The answer to a call or a goal, so that its client need not wait for the timeout; else None."""
        values = Raw(_encoder.encode(text))
        if self.op == _type_name(CallService) and self.service is not None and self.id is not None:
            return ServiceResponse(id=self.id, service=self.service, values=values, result=False)
        if self.op == _type_name(SendActionGoal) and self.action is not None and self.id is not None:
            status = GoalStatus.ABORTED
            return ActionResult(id=self.id, action=self.action, values=values, status=status, result=False)
        return None


_envelope_decoder = msgspec.json.Decoder(_Envelope)


class MessageDecoder:
    """Decodes the frames of one peer."""

    def __init__(self, limits: BridgeLimits) -> None:
        self._limits = limits
        self._fragments = FragmentBuffer(limits)
        self.size = 0
        """Size of the last message, after fragments were joined and compression was removed [characters]."""

    @property
    def pending_messages(self) -> int:
        """Number of incomplete messages."""
        return len(self._fragments)

    def decode(self, frame: Frame, now_s: float) -> Operation | None:
        """Decodes a frame; returns None if it is a fragment of an incomplete message.

        Args:
            frame: payload of the websocket frame.
            now_s: time of a monotonic clock [s], for the age of fragments.

        Raises:
            MessageValidationError: the frame is not a valid message; `id` is set if it can be decoded.
        """
        return self._unwrap(self._decompress(frame), now_s, allowed=(Fragment, Png))

    def expire(self, now_s: float) -> list[Id]:
        """Discards messages whose next fragment did not arrive in time, and returns their ids."""
        return [key[1] for key in self._fragments.expire(now_s) if isinstance(key, tuple)]

    def _decompress(self, frame: Frame) -> str:
        limit = self._limits.message_bytes if isinstance(frame, str) else self._limits.cbor_bytes
        if len(frame) > limit:
            raise MessageValidationError("frame", cause=f"it has {len(frame)} bytes", remedy=f"at most {limit}")
        if isinstance(frame, str):
            return frame
        try:
            return read_cbor(frame, depth=self._limits.depth).decode()
        except MessageValidationError as error:
            envelope = _envelope(error.answer)
            error.id, error.answer = envelope.id, envelope.answer(str(error))
            raise

    def _parse(self, text: str) -> Operation:
        self.size = len(text)
        if json_depth(text, limit=self._limits.depth) > self._limits.depth:
            raise MessageValidationError("message", cause=f"it nests deeper than {self._limits.depth} levels")
        try:
            return _decoder.decode(text)
        except (msgspec.DecodeError, UnicodeEncodeError, RecursionError) as error:
            raise _decode_error(text, error) from None

    def _unwrap(self, text: str, now_s: float, allowed: tuple[type[Fragment | Png], ...]) -> Operation | None:
        """Returns the operation itself; a PNG may be fragmented, other nesting of wrappers is an error."""
        operation = self._parse(text)
        if not isinstance(operation, Fragment | Png):
            return operation
        kind = type(operation)
        try:
            if kind not in allowed:
                raise MessageValidationError(_type_name(kind), cause="it is nested in another fragment or PNG")
            inner = self._decode_inner(operation, now_s)
        except MessageValidationError as error:
            error.id = operation.id
            raise
        return None if inner is None else self._unwrap(inner, now_s, allowed[allowed.index(kind) + 1 :])

    def _decode_inner(self, wrapper: Fragment | Png, now_s: float) -> str | None:
        data: str | None = wrapper.data
        if wrapper.num is not None and wrapper.total is not None:
            key = (type(wrapper), wrapper.id)
            data = self._fragments.add(key, wrapper.num, wrapper.total, wrapper.data, now_s)
        if data is None or isinstance(wrapper, Fragment):
            return data
        return read_png(data, max_bytes=self._limits.png_bytes)


class MessageEncoder:
    """An operation to be sent; each of its encodings is computed when it is first needed, and cached."""

    __slots__ = ("_data", "_frames", "_raw", "operation", "serialized")

    def __init__(self, operation: Operation, *, raw: bytes | None = None, serialized: bytes = b"") -> None:
        """Creates the encoder.

        Args:
            raw: its frame in the compression `cbor-raw`, if that differs from `cbor`.
            serialized: the message in that frame.
        """
        self.operation = operation
        self.serialized = serialized
        self._raw = raw
        self._data = b""
        self._frames: dict[tuple[Compression, int | None], tuple[Frame, ...]] = {}

    @property
    def data(self) -> bytes:
        """The operation as JSON in UTF-8."""
        self._data = self._data or _encoder.encode(self.operation)
        return self._data

    def frames(
        self,
        compression: Compression = Compression.NONE,
        fragment_size: int | None = None,
        *,
        max_fragments: int = 4096,
    ) -> tuple[Frame, ...]:
        """Returns the frames to send, in this order.

        Args:
            compression: encoding; CBOR is never fragmented, since it is not text.
            fragment_size: largest number of characters of a fragment, if the peer set one.
            max_fragments: largest number of fragments; if there would be more, the fragments become larger.
        """
        key = (compression, fragment_size)
        if key not in self._frames:
            self._frames[key] = self._encode(compression, fragment_size, max_fragments)
        return self._frames[key]

    def _encode(self, compression: Compression, fragment_size: int | None, max_fragments: int) -> tuple[Frame, ...]:
        if compression is Compression.CBOR_RAW and self._raw is not None:
            return (self._raw,)
        text = self.data.decode()
        if compression in {Compression.CBOR, Compression.CBOR_RAW}:
            return (write_cbor(text),)
        if compression is Compression.PNG:
            text = _encoder.encode(Png(id=self.operation.id, data=write_png(text))).decode()
        if fragment_size is None or len(text) <= fragment_size:
            return (text,)
        fragments = split_fragments(text, fragment_size, max_fragments=max_fragments)
        id = f"fragment:{next(_fragment_numbers)}"
        return tuple(
            _encoder.encode(Fragment(id=id, data=data, num=number, total=len(fragments))).decode()
            for number, data in enumerate(fragments)
        )


def _type_name(operation: type[Operation]) -> str:
    return str(operation.__struct_config__.tag)


def _decode_error(text: str, error: Exception) -> MessageValidationError:
    """Returns the error with its cause, its path, the id of the message, and the answer to a call or a goal."""
    cause, _, path = str(error).partition(" - at `$")
    path, remedy = path.strip("`."), ""
    try:
        envelope = _envelope_decoder.decode(text)
    except (msgspec.DecodeError, UnicodeEncodeError, RecursionError):  # invalid JSON, but perhaps for NaN and Infinity
        message = read_lenient_json(text)
        envelope = _envelope(message)
        if found := _find_non_finite(message, ""):
            path, cause, remedy = found, "expected a finite number", "JSON has no NaN and no Infinity; send null"
    refused = MessageValidationError(envelope.op[:64], path=path, cause=cause, remedy=remedy, id=envelope.id)
    refused.answer = envelope.answer(str(refused))
    return refused


def _envelope(message: object) -> _Envelope:
    try:
        return msgspec.convert(message, _Envelope)
    except msgspec.ValidationError:
        return _Envelope()


def read_lenient_json(text: str | bytes) -> Any:
    """Parses JSON that may have NaN, Infinity and integers of any length, which become infinite; None if it cannot."""
    try:
        return json.loads(text, parse_int=lambda digits: int(digits) if len(digits) < 300 else math.inf)
    except (ValueError, RecursionError):
        return None


def non_finite_path(text: str) -> str:
    """The path of the first number in a JSON text that is not finite; empty if there is none."""
    return _find_non_finite(read_lenient_json(text), "")


def _find_non_finite(value: object, path: str) -> str:
    match value:
        case float() if not math.isfinite(value):
            return path.lstrip(".")
        case dict():
            found = (_find_non_finite(each, f"{path}.{key}") for key, each in value.items())
        case list():
            found = (_find_non_finite(each, f"{path}[{at}]") for at, each in enumerate(value))
        case _:
            return ""
    return next(filter(None, found), "")
