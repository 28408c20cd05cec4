"""Nesting: how deep a JSON text goes, measured before anybody walks down into it."""

from __future__ import annotations

import re
from itertools import accumulate

__all__ = ["json_depth"]

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
