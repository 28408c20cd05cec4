"""Text as the pixels of a PNG image in base64, which is how rosbridge compresses messages for browsers.

Images of 8 bits a channel are read: grayscale, RGB and RGBA (whose alpha carries no text), not interlaced. The last row
is filled up with line feeds, which JSON ignores.
"""

from __future__ import annotations

import base64
import binascii
import io
import struct
from math import isqrt

from mindstage.errors import MessageValidationError

__all__ = ["read_png", "write_png"]

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
