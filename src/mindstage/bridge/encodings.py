"""CBOR: messages as binary frames (RFC 8949), long arrays of numbers as typed arrays (RFC 8746).

What came as CBOR becomes JSON text at once, byte strings as base64 as rosbridge has them, so that everything behind
knows one form only. Tags other than typed arrays are refused: some of them let a short frame grow without end.

Nesting: how deep a JSON text goes, measured before anybody walks down into it.

Text as the pixels of a PNG image in base64, which is how rosbridge compresses messages for browsers.

Images of 8 bits a channel are read: grayscale, RGB and RGBA (whose alpha carries no text), not interlaced. The last row
is filled up with line feeds, which JSON ignores.
"""

from __future__ import annotations

import base64
import binascii
import io
import re
import struct
from array import array
from collections.abc import Callable, Mapping
from itertools import accumulate
from math import isqrt
from typing import Any

import cbor2
import msgspec

from mindstage.errors import MessageValidationError

__all__ = ["json_depth", "read_cbor", "read_png", "write_cbor", "write_png"]


_STRING = re.compile(rb'"[^"\\]*(?:\\.[^"\\]*)*"', re.DOTALL)
_DEPTH_STEPS = bytes.maketrans(b"[{]}", b"\x01\x01\xff\xff")
"""Into one level, and (-1 as a signed byte) out of it again."""
_OTHER_BYTES = bytes(set(range(256)) - set(b"[{]}"))


def json_depth(text: str, *, limit: int) -> int:
    """How deep arrays and objects nest; a text with too few of them to exceed the limit is not looked at (0).

    The text need not be JSON: what it says of another text means nothing, and that text is refused later.
    """
    if text.count("[") + text.count("{") <= limit:
        return 0
    bare = _STRING.sub(b"", text.encode("utf-8", "surrogatepass"))
    steps = memoryview(bare.translate(_DEPTH_STEPS, _OTHER_BYTES)).cast("b")
    return max(accumulate(steps), default=0)


_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_HEADER = struct.Struct(">4x4xIIBBBBB")
"""The first chunk: its length and type, then its fields (ISO/IEC 15948, 11.2.2)."""
_CHANNELS = {0: 1, 2: 3, 6: 4}
"""By color type."""


def write_png(text: str) -> str:
    """The text as an image, nearly square, in base64."""
    from PIL import Image

    data = text.encode()
    width = max(1, isqrt(len(data) // 3))
    height = max(1, -(-len(data) // (3 * width)))
    image = Image.frombytes("RGB", (width, height), data.ljust(3 * width * height, b"\n"))
    # The event loop waits for this: fast is better than small.
    image.save(file := io.BytesIO(), "png", compress_level=1)
    return base64.b64encode(file.getvalue()).decode()


def read_png(data: str, *, max_bytes: int) -> str:
    """The text in an image.

    The size is checked before any pixel is decompressed, and no more pixels are than the header says.

    Args:
        data: the image, in base64.
        most: how many bytes of pixels are read at most.

    Raises:
        MessageValidationError: not such an image, too large, or its pixels are not UTF-8.
    """
    from PIL import Image

    try:
        file = base64.b64decode(data, validate=True)
        if not file.startswith(_SIGNATURE):
            raise ValueError("another signature")
        width, height, bits, color, _, _, interlaced = _HEADER.unpack_from(file, len(_SIGNATURE))
    except (binascii.Error, struct.error, ValueError) as error:
        raise MessageValidationError("png", cause=f"it is no PNG in base64 ({error})") from None
    if bits != 8 or interlaced or color not in _CHANNELS or not width or not height:
        raise MessageValidationError("png", cause="only 8-bit grayscale, RGB and RGBA images are read, not interlaced")
    if (size := height * width * _CHANNELS[color]) > max_bytes:
        raise MessageValidationError("png", cause=f"{size} bytes of pixels are too many", remedy=f"at most {max_bytes}")
    try:
        with Image.open(io.BytesIO(file), formats=["PNG"]) as image:
            pixels = (image.convert("RGB") if color == 6 else image).tobytes()
    except (OSError, SyntaxError, ValueError, EOFError, struct.error) as error:  # what Pillow raises for broken files
        raise MessageValidationError("png", cause=f"its pixels cannot be read ({error})") from None
    try:
        return pixels.decode()
    except UnicodeDecodeError as error:
        raise MessageValidationError("png", cause=f"its pixels are no text ({error.reason})") from None


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
