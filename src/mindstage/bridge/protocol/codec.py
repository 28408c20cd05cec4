"""Codec: frames in, operations out, and back; no socket, no clock, no thread.

One `MessageDecoder` stands at the receiving end of a connection and joins what was cut in pieces; an `MessageEncoder` is an
operation on its way out, encoded once however many peers it goes to.
"""

from __future__ import annotations

from itertools import count

import msgspec

from mindstage.bridge.protocol.cbor import read_cbor, write_cbor
from mindstage.bridge.protocol.fragments import FragmentBuffer, split_fragments
from mindstage.bridge.protocol.limits import BridgeLimits
from mindstage.bridge.protocol.nesting import json_depth
from mindstage.bridge.protocol.operations import Compression, Fragment, Id, Operation, Png
from mindstage.bridge.protocol.png import read_png, write_png
from mindstage.errors import MessageValidationError

__all__ = ["Frame", "MessageDecoder", "MessageEncoder"]

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
