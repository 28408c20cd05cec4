"""CBOR: messages as binary frames (RFC 8949), long arrays of numbers as typed arrays (RFC 8746).

What came as CBOR becomes JSON text at once, byte strings as base64 as rosbridge has them, so that everything behind
knows one form only. Tags other than typed arrays are refused: some of them let a short frame grow without end.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Mapping
from typing import Any

import cbor2
import msgspec

from mindstage.errors import MessageValidationError

__all__ = ["read_cbor", "write_cbor"]

_FLOAT64_ARRAY_TAG = 86
"""The tag of little-endian doubles."""
_SELF_DESCRIBED_TAG = 55799
_BUILTIN_TAGS = (0, 1, 2, 3, 4, 5, 25, 28, 29, 30, 35, 36, 37, 52, 54, 100, 256, 258, 260, 261, 1004, 43000)
_TYPED_ARRAY_TAGS = {
    65: ">H", 66: ">I", 67: ">Q", 69: "<H", 70: "<I", 71: "<Q",
    72: "<b", 73: ">h", 74: ">i", 75: ">q", 77: "<h", 78: "<i", 79: "<q",
    80: ">e", 81: ">f", 82: ">d", 84: "<e", 85: "<f", 86: "<d",
}  # fmt: skip
"""Tag to byte order and kind of one number. Bytes (64, 68) stay bytes; nobody has 128-bit floats (83, 87)."""


def write_cbor(text: str | bytes) -> bytes:
    """A JSON text as CBOR; arrays of doubles become typed arrays."""
    return cbor2.dumps(_encode_arrays(msgspec.json.decode(text)))


def read_cbor(data: bytes, *, depth: int) -> bytes:
    """CBOR as JSON text.

    Args:
        data: one value.
        depth: how deep it may nest.

    Raises:
        MessageValidationError: it is no CBOR, nests deeper, or holds what JSON cannot say.
    """
    try:
        value = cbor2.loads(data, max_depth=depth, semantic_decoders=_DECODERS, tag_hook=_reject_tag)
        return msgspec.json.encode(value)
    except (cbor2.CBORDecodeError, ValueError, TypeError, OverflowError, RecursionError, MemoryError) as error:
        raise MessageValidationError("binary frame", cause=f"it is no CBOR that JSON could say ({error})") from None


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


def _inflate(format: str) -> Callable[..., list[float]]:
    from struct import Struct, calcsize

    width = calcsize(format)

    def unpack(data: object, *_: object) -> list[float]:
        if not isinstance(data, bytes) or len(data) % width:
            raise ValueError("a typed array of another length")
        return list(Struct(f"{format[0]}{len(data) // width}{format[1]}").unpack(data))

    return unpack


def _reject_text_default(data: object, *_: object) -> bytes:
    if not isinstance(data, bytes):
        raise ValueError("a typed array that is no byte string")
    return data


def _reject(*_: object) -> object:
    raise ValueError("a tag other than those of typed arrays")


def _reject_tag(*_: object) -> object:
    return _reject()


_DECODERS: Mapping[int, Callable[..., Any]] = {
    **dict.fromkeys(_BUILTIN_TAGS, _reject),
    **{tag: _inflate(kind) for tag, kind in _TYPED_ARRAY_TAGS.items()},
    64: _reject_text_default,
    68: _reject_text_default,
    _SELF_DESCRIBED_TAG: lambda value, *_: value,
}
