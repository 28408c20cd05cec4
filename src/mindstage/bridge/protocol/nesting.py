"""Nesting: how deep a JSON text goes, measured before anybody walks down into it."""

from __future__ import annotations

import re
from itertools import accumulate

__all__ = ["depth_of"]

_STRING = re.compile(rb'"[^"\\]*(?:\\.[^"\\]*)*"', re.DOTALL)
_STEPS = bytes.maketrans(b"[{]}", b"\x01\x01\xff\xff")
"""Into one level, and (-1 as a signed byte) out of it again."""
_REST = bytes(set(range(256)) - set(b"[{]}"))


def depth_of(text: str, *, limit: int) -> int:
    """How deep arrays and objects nest; a text with too few of them to exceed the limit is not looked at (0).

    The text need not be JSON: what it says of another text means nothing, and that text is refused later.
    """
    if text.count("[") + text.count("{") <= limit:
        return 0
    bare = _STRING.sub(b"", text.encode("utf-8", "surrogatepass"))
    steps = memoryview(bare.translate(_STEPS, _REST)).cast("b")
    return max(accumulate(steps), default=0)
