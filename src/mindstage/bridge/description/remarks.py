"""Remarks: what does not cross the border between a world and the wire, or is assumed there."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable

import msgspec

__all__ = ["ConversionNote", "merge_notes"]


class ConversionNote(msgspec.Struct, frozen=True):
    """One thing that the other side will not know, or that was assumed because it was not told."""

    field: str
    """What it is about, such as `facts` or `class`."""
    ids: tuple[str, ...]
    """Of the bodies, constraints or lights."""
    text: str


def merge_notes(notes: Iterable[ConversionNote]) -> tuple[ConversionNote, ...]:
    """The same with one remark for each field and text, which has all the ids."""
    ids: defaultdict[tuple[str, str], dict[str, None]] = defaultdict(dict)
    for remark in notes:
        ids[remark.field, remark.text].update(dict.fromkeys(remark.ids))
    return tuple(ConversionNote(field, tuple(about), text) for (field, text), about in ids.items())
