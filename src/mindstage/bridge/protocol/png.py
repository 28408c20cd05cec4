"""PNG: a text as the pixels of an image, which is how rosbridge compresses for browsers.

Only what such images need is read: 8 bit a channel, grey, RGB or RGBA, not interlaced (ISO/IEC 15948). Whoever wrote
the image filled its last row up with line feeds, which mean nothing in JSON.
"""

from __future__ import annotations

import base64
import binascii
import struct
import zlib
from collections.abc import Iterator
from math import isqrt

from mindstage.errors import MessageRefused

__all__ = ["read_png", "write_png"]

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_CHANNELS = {0: 1, 2: 3, 6: 4}
"""By colour type: grey, RGB, RGB with alpha."""


def write_png(text: str) -> str:
    """The text as an image, nearly square, in base64."""
    data = text.encode()
    width = max(1, isqrt(len(data) // 3))
    row = 3 * width
    height = max(1, -(-len(data) // row))
    data = data.ljust(row * height, b"\n")
    rows = b"".join(b"\0" + data[start : start + row] for start in range(0, len(data), row))
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    # The loop waits for this: fast is better than small.
    chunks = (_chunk(b"IHDR", header), _chunk(b"IDAT", zlib.compress(rows, 1)), _chunk(b"IEND", b""))
    return base64.b64encode(_SIGNATURE + b"".join(chunks)).decode()


def read_png(data: str, *, most: int) -> str:
    """The text that an image in base64 holds.

    Args:
        data: the image.
        most: how many bytes the text may have; more is never unpacked.

    Raises:
        MessageRefused: it is no such image, too large, or holds no text.
    """
    try:
        chunks = dict(_chunks(base64.b64decode(data, validate=True)))
        width, height, bits, colour, _, _, interlaced = struct.unpack(">IIBBBBB", chunks[b"IHDR"])
        packed = chunks[b"IDAT"]
    except (binascii.Error, struct.error, KeyError, ValueError) as error:
        raise MessageRefused("png", cause=f"it is no PNG in base64 ({error})") from None
    if bits != 8 or interlaced or colour not in _CHANNELS or not width or not height:
        raise MessageRefused("png", cause="only 8-bit grey, RGB and RGBA images are read, not interlaced")
    channels = _CHANNELS[colour]
    size = height * (1 + width * channels)
    if size > most + height:
        raise MessageRefused("png", cause=f"{size} bytes of pixels are too many", remedy=f"at most {most}")
    pixels = _unfiltered(_unpacked(packed, size), width * channels, channels)
    if channels == 4:
        del pixels[3::4]
    try:
        return pixels.decode()
    except UnicodeDecodeError as error:
        raise MessageRefused("png", cause=f"its pixels are no text ({error.reason})") from None


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def _chunks(image: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Kind and content; the pieces of the pixel data as one, at the end."""
    if not image.startswith(_SIGNATURE):
        raise ValueError("another signature")
    at, pixels = len(_SIGNATURE), []
    while at < len(image):
        (length,) = struct.unpack_from(">I", image, at)
        kind, content = image[at + 4 : at + 8], image[at + 8 : at + 8 + length]
        (checksum,) = struct.unpack_from(">I", image, at + 8 + length)
        if checksum != zlib.crc32(kind + content):
            raise ValueError("a wrong checksum")
        if kind == b"IDAT":
            pixels.append(content)
        else:
            yield kind, content
        at += 12 + length
    yield b"IDAT", b"".join(pixels)


def _unpacked(packed: bytes, size: int) -> bytes:
    inflate = zlib.decompressobj()
    try:
        rows = inflate.decompress(packed, size + 1)
    except zlib.error as error:
        raise MessageRefused("png", cause=f"its pixels cannot be unpacked ({error})") from None
    if len(rows) != size:
        raise MessageRefused("png", cause="it holds more or fewer pixels than it says")
    return rows


def _unfiltered(rows: bytes, width: int, step: int) -> bytearray:
    """The pixels, each row's filter undone; `step` is one pixel's bytes."""
    pixels = bytearray()
    above = bytearray(width)
    for start in range(0, len(rows), 1 + width):
        row = bytearray(rows[start + 1 : start + 1 + width])
        _undo(rows[start], row, above, step)
        pixels += row
        above = row
    return pixels


def _undo(kind: int, row: bytearray, above: bytearray, step: int) -> None:
    if kind == 0:
        return
    if kind == 1:
        for i in range(step, len(row)):
            row[i] = (row[i] + row[i - step]) & 255
    elif kind == 2:
        row[:] = bytes((here + up) & 255 for here, up in zip(row, above, strict=True))
    elif kind == 3:
        for i in range(len(row)):
            left = row[i - step] if i >= step else 0
            row[i] = (row[i] + (left + above[i]) // 2) & 255
    elif kind == 4:
        for i in range(len(row)):
            left, corner = (row[i - step], above[i - step]) if i >= step else (0, 0)
            row[i] = (row[i] + _nearest(left, above[i], corner)) & 255
    else:
        raise MessageRefused("png", cause=f"there is no filter {kind}")


def _nearest(left: int, up: int, corner: int) -> int:
    """Paeth's choice: whichever neighbour is nearest to left + up - corner."""
    guess = left + up - corner
    to_left, to_up, to_corner = abs(guess - left), abs(guess - up), abs(guess - corner)
    if to_left <= to_up and to_left <= to_corner:
        return left
    return up if to_up <= to_corner else corner
