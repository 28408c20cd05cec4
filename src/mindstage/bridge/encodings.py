"""Encodings of messages: CBOR frames, PNG compression and the binary formats of ROS; and the nesting depth of JSON.

CBOR (RFC 8949) is converted to and from JSON text: long arrays of numbers are typed arrays (RFC 8746), and byte strings
are base64, as in rosbridge. Other tags are rejected, since some of them let a short frame expand without bound.

In PNG compression, as in rosbridge, the pixels of an image in base64 are the JSON text. Images of 8 bits a channel,
grayscale, RGB or RGBA (without the alpha channel), not interlaced, can be read. The last row is padded with line feeds,
which JSON ignores.

`serialize` writes the bytes of a message as ROS does: little-endian without padding in ROS 1, CDR with its header and
padding (XCDR version 1, as DDS implementations write it) in ROS 2.
"""

from __future__ import annotations

import base64
import binascii
import io
import re
import struct
from array import array
from collections.abc import Callable, Mapping
from functools import cache, lru_cache
from itertools import accumulate
from math import isqrt
from operator import attrgetter
from typing import Any, NamedTuple

import cbor2
import msgspec

from mindstage.errors import MessageValidationError
from mindstage.msgs import Message, RosVersion, type_name
from mindstage.msgs.schema.base import fields_of, struct_of

__all__ = [
    "json_depth",
    "read_cbor",
    "read_png",
    "serialize",
    "write_cbor",
    "write_cbor_raw",
    "write_png",
]


_STRING = re.compile(rb'"[^"\\]*(?:\\.[^"\\]*)*"', re.DOTALL)
_DEPTH_STEPS = bytes.maketrans(b"[{]}", b"\x01\x01\xff\xff")
"""Maps opening brackets to +1 and closing brackets to -1, as a signed byte."""
_OTHER_BYTES = bytes(set(range(256)) - set(b"[{]}"))
_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_HEADER = struct.Struct(">4x4xIIBBBBB")
"""Layout of the first chunk: its length and type, then its fields (ISO/IEC 15948, 11.2.2)."""
_CHANNELS = {0: 1, 2: 3, 6: 4}
"""Number of channels by color type."""
_FLOAT64_ARRAY_TAG = 86
"""Tag of arrays of little-endian float64."""
_SELF_DESCRIBED_TAG = 55799
"""The number of a tag of CBOR."""
_BUILTIN_TAGS = (0, 1, 2, 3, 4, 5, 25, 28, 29, 30, 35, 36, 37, 52, 54, 100, 256, 258, 260, 261, 1004, 43000)
_TYPED_ARRAY_TAGS = {
    65: ">H", 66: ">I", 67: ">Q", 69: "<H", 70: "<I", 71: "<Q",
    72: "<b", 73: ">h", 74: ">i", 75: ">q", 77: "<h", 78: "<i", 79: "<q",
    80: ">e", 81: ">f", 82: ">d", 84: "<e", 85: "<f", 86: "<d",
}  # fmt: skip
"""Byte order and type of the numbers by tag. uint8 arrays (64, 68) stay bytes; float128 (83, 87) is rejected."""


def json_depth(text: str, *, limit: int) -> int:
    """Returns how deep arrays and objects nest, without parsing; 0 if there are too few brackets to exceed the limit.

    The text need not be JSON: for another text the result is meaningless, and the parser rejects that text later.
    """
    if text.count("[") + text.count("{") <= limit:
        return 0
    bare = _STRING.sub(b"", text.encode("utf-8", "surrogatepass"))
    steps = memoryview(bare.translate(_DEPTH_STEPS, _OTHER_BYTES)).cast("b")
    return max(accumulate(steps), default=0)


def write_png(text: str) -> str:
    """Encodes a text as the pixels of a nearly square image, in base64."""
    from PIL import Image

    data = text.encode()
    width = max(1, isqrt(len(data) // 3))
    height = max(1, -(-len(data) // (3 * width)))
    image = Image.frombytes("RGB", (width, height), data.ljust(3 * width * height, b"\n"))
    # This runs on the event loop, so speed matters more than size.
    image.save(file := io.BytesIO(), "png", compress_level=1)
    return base64.b64encode(file.getvalue()).decode()


def read_png(data: str, *, max_bytes: int) -> str:
    """Decodes the text in the pixels of an image.

    The size is checked before any pixel is decompressed, and no more pixels are read than the header declares.

    Args:
        data: the image, in base64.
        max_bytes: largest size of the pixels.

    Raises:
        MessageValidationError: it is not such an image, it is too large, or its pixels are not UTF-8.
    """
    from PIL import Image

    try:
        file = base64.b64decode(data, validate=True)
        if not file.startswith(_SIGNATURE):
            raise ValueError("wrong signature")
        width, height, bits, color, _, _, interlaced = _HEADER.unpack_from(file, len(_SIGNATURE))
    except (binascii.Error, struct.error, ValueError) as error:
        raise MessageValidationError("png", cause=f"it is not a PNG in base64 ({error})") from None
    if bits != 8 or interlaced or color not in _CHANNELS or not width or not height:
        raise MessageValidationError(
            "png", cause="only 8-bit grayscale, RGB and RGBA images are supported, not interlaced"
        )
    if (size := height * width * _CHANNELS[color]) > max_bytes:
        raise MessageValidationError("png", cause=f"its pixels have {size} bytes", remedy=f"at most {max_bytes}")
    try:
        with Image.open(io.BytesIO(file), formats=["PNG"]) as image:
            pixels = (image.convert("RGB") if color == 6 else image).tobytes()
    except (OSError, SyntaxError, ValueError, EOFError, struct.error) as error:  # what Pillow raises for broken files
        raise MessageValidationError("png", cause=f"its pixels cannot be decoded ({error})") from None
    try:
        return pixels.decode()
    except UnicodeDecodeError as error:
        raise MessageValidationError("png", cause=f"its pixels are not UTF-8 ({error.reason})") from None


def write_cbor(text: str | bytes) -> bytes:
    """Converts JSON text to CBOR; arrays of floats become typed arrays."""
    return cbor2.dumps(_encode_arrays(msgspec.json.decode(text)))


def read_cbor(data: bytes, *, depth: int) -> bytes:
    """Converts CBOR to JSON text.

    Args:
        data: one encoded value.
        depth: largest nesting depth.

    Raises:
        MessageValidationError: it is not CBOR, it nests deeper, or it has values that JSON cannot represent. `answer`
            is the message without these values, if only they prevent its decoding.
    """
    try:
        value = cbor2.loads(data, max_depth=depth, semantic_decoders=_DECODERS, tag_hook=_reject_tag)
        return msgspec.json.encode(value)
    except (cbor2.CBORDecodeError, ValueError, TypeError, OverflowError, RecursionError, MemoryError) as error:
        cause = f"it is not CBOR, or JSON cannot represent it ({error})"
        raise MessageValidationError("binary frame", cause=cause, answer=_readable_cbor(data, depth)) from None


def write_cbor_raw(topic: str, data: bytes, *, time_s: float) -> bytes:
    """Returns the frame of a serialized message, as rosbridge_suite writes it for the compression `cbor-raw`.

    Args:
        topic: name of the topic.
        data: the serialized message.
        time_s: when it was received [s].
    """
    secs, nsecs = divmod(round(time_s * 1e9), 1_000_000_000)
    return cbor2.dumps({"op": "publish", "topic": topic, "msg": {"secs": secs, "nsecs": nsecs, "bytes": data}})


def _readable_cbor(data: bytes, depth: int) -> object:
    """Returns a message without the values that have no representation in JSON; None if it is no message."""
    try:
        return cbor2.loads(data, max_depth=depth, semantic_decoders=_IGNORING_DECODERS, tag_hook=_ignore)
    except (cbor2.CBORDecodeError, ValueError, TypeError, OverflowError, RecursionError, MemoryError):
        return None


def _encode_arrays(value: object) -> object:
    if isinstance(value, dict):
        return {key: _encode_arrays(each) for key, each in value.items()}
    if not isinstance(value, list):
        return value
    if len(value) > 1 and all(type(each) is float for each in value):
        return cbor2.CBORTag(_FLOAT64_ARRAY_TAG, _little_endian(array("d", value)))
    return [_encode_arrays(each) for each in value]


def _little_endian(numbers: array[float]) -> bytes:
    if memoryview(b"\1\0").cast("H")[0] != 1:  # pragma: no cover  # a big-endian machine
        numbers.byteswap()
    return numbers.tobytes()


def _typed_array_decoder(format: str) -> Callable[..., list[float]]:
    width = struct.calcsize(format)

    def unpack(data: object, *_: object) -> list[float]:
        if not isinstance(data, bytes) or len(data) % width:
            raise ValueError("a typed array of the wrong length")
        return list(struct.Struct(f"{format[0]}{len(data) // width}{format[1]}").unpack(data))

    return unpack


def _decode_byte_array(data: object, *_: object) -> bytes:
    if not isinstance(data, bytes):
        raise ValueError("a typed array that is not a byte string")
    return data


def _reject(*_: object) -> object:
    raise ValueError("a tag that is not of a typed array")


def _reject_tag(*_: object) -> object:
    return _reject()


def _ignore(*_: object) -> object:
    return None


_DECODERS: Mapping[int, Callable[..., Any]] = {
    **dict.fromkeys(_BUILTIN_TAGS, _reject),
    **{tag: _typed_array_decoder(kind) for tag, kind in _TYPED_ARRAY_TAGS.items()},
    64: _decode_byte_array,
    68: _decode_byte_array,
    _SELF_DESCRIBED_TAG: lambda value, *_: value,
}
_IGNORING_DECODERS: Mapping[int, Callable[..., Any]] = dict.fromkeys(
    (*_BUILTIN_TAGS, *_TYPED_ARRAY_TAGS, 64, 68), _ignore
) | {_SELF_DESCRIBED_TAG: _DECODERS[_SELF_DESCRIBED_TAG]}


# -- binary formats of ROS ---------------------------------------------------------------------------------------------

_CDR_HEADER = b"\0\1\0\0"
"""Little-endian CDR, without options."""
_CODES = {
    "bool": "?", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I", "int64": "q",
    "uint64": "Q", "float32": "f", "float64": "d",
}  # fmt: skip


class _Numbers(NamedTuple):
    """Consecutive numbers."""

    codes: str
    get: Callable[[Any], Any]


class _Text(NamedTuple):
    get: Callable[[Any], Any]


class _Sequence(NamedTuple):
    """An array of numbers, texts or messages."""

    get: Callable[[Any], Any]
    code: str
    """Of numbers; `s` for texts, empty for messages."""
    steps: tuple[Any, ...]
    """Of messages."""
    length: int
    """0 for any length."""


def serialize(message: Message, *, ros: RosVersion) -> bytes:
    """Returns the bytes of a message in the binary format of a version of ROS.

    Raises:
        MessageValidationError: a value does not fit its type, or an array does not have its length.
    """
    data = bytearray()
    try:
        _write(data, _steps(type(message), ros), message, ros)
    except (struct.error, OverflowError, UnicodeEncodeError) as error:
        raise MessageValidationError(type_name(type(message), ros), cause=str(error)) from error
    return bytes(data) if ros is RosVersion.ONE else _CDR_HEADER + data


@cache
def _steps(cls: Any, ros: RosVersion) -> tuple[Any, ...]:
    """Returns how a message type is written; nested messages become parts of their parent."""
    numbers: list[tuple[str, str]] = []
    steps: list[Any] = []

    def end_numbers() -> None:
        if numbers:
            get = attrgetter(*(path for _, path in numbers))
            codes = "".join(code for code, _ in numbers)
            steps.append(_Numbers(codes, get if len(numbers) > 1 else lambda value: (get(value),)))
            numbers.clear()

    def visit(cls: Any, prefix: str) -> None:
        fields = [field for field in fields_of(cls) if struct_of(cls).only_in.get(field.name, ros) is ros]
        if not fields and ros is RosVersion.TWO:
            steps.append(_Text(lambda _: None))  # structure_needs_at_least_one_member
        for field in fields:
            path = prefix + field.name
            if field.length is not None:
                end_numbers()
                inner = _steps(field.message, ros) if field.message else ()
                code = "" if field.message else _CODES.get(field.primitive, "s")
                steps.append(_Sequence(attrgetter(path), code, inner, field.length))
            elif field.message:
                visit(field.message, f"{path}.")
            elif field.primitive == "string":
                end_numbers()
                steps.append(_Text(attrgetter(path)))
            else:
                numbers.append((_CODES[field.primitive], path))

    visit(cls, "")
    end_numbers()
    return tuple(steps)


@lru_cache(maxsize=4096)
def _layout(codes: str, offset: int, ros: RosVersion) -> struct.Struct:
    """Returns the layout of numbers that begin at an offset (modulo 8), with padding in ROS 2."""
    if ros is RosVersion.ONE:
        return struct.Struct(f"<{codes}")
    parts = []
    for code in codes:
        size = struct.calcsize(f"<{code}")
        parts.append("x" * (-offset % size) + code)
        offset += -offset % size + size
    return struct.Struct(f"<{''.join(parts)}")


def _write(data: bytearray, steps: tuple[Any, ...], message: Any, ros: RosVersion) -> None:
    for step in steps:
        if isinstance(step, _Numbers):
            data += _layout(step.codes, len(data) % 8, ros).pack(*step.get(message))
        elif isinstance(step, _Text):
            _write_text(data, step.get(message), ros)
        else:
            _write_sequence(data, step, step.get(message), ros)


def _write_text(data: bytearray, text: str | None, ros: RosVersion) -> None:
    if text is None:
        data.append(0)
        return
    encoded = text.encode() + (b"\0" if ros is RosVersion.TWO else b"")
    data += _layout("I", len(data) % 8, ros).pack(len(encoded)) + encoded


def _write_sequence(data: bytearray, step: _Sequence, values: Any, ros: RosVersion) -> None:
    if step.length and len(values) != step.length:
        raise OverflowError(f"an array has {len(values)} elements, not {step.length}")
    if not step.length:
        data += _layout("I", len(data) % 8, ros).pack(len(values))
    if isinstance(values, bytes):
        data += values
    elif step.code == "s":
        for text in values:
            _write_text(data, text, ros)
    elif step.code:
        if values:
            data += _layout(step.code, len(data) % 8, ros).pack(values[0])
            data += struct.pack(f"<{len(values) - 1}{step.code}", *values[1:])
    else:
        for value in values:
            _write(data, step.steps, value, ros)
