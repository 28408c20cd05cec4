"""Hints: the end of an error's sentence, which says what exists or what to try."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from difflib import get_close_matches

__all__ = ["also", "near", "near_names"]

_WORD = 3
"""Fewer letters than this stand in nearly every name."""


def near(name: str, known: Iterable[str]) -> tuple[str, ...]:
    """Up to three known names that are like one, whatever their case: spelt alike, then those with it inside."""
    by_small = {each.lower(): each for each in known}
    small = name.lower()
    alike = get_close_matches(small, list(by_small), n=3, cutoff=0.6)
    longer = sorted(
        (each for each in by_small if len(small) >= _WORD and small in each), key=lambda each: (len(each), each)
    )
    return tuple(by_small[each] for each in list(dict.fromkeys([*alike, *longer]))[:3])


def near_names(near: Sequence[str]) -> str:
    """Names that were perhaps meant, in words."""
    return f"near: {', '.join(map(repr, near))}" if near else ""


def also(hint: str) -> str:
    """The end of a sentence that says what exists or what to try, where there is something to say."""
    return f"; {hint}" if hint else ""
