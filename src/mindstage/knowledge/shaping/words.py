"""Words: what the name of a class says about its things, where nobody else does."""

from __future__ import annotations

import re
from collections.abc import Iterator
from hashlib import blake2s

from mindstage.knowledge.names import local_name

__all__ = ["name_suffixes", "name_tokens", "singular_forms", "stable_hash"]

_PARTS = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+\d*|\d+")


def name_tokens(iri: str) -> tuple[str, ...]:
    """The words of a name in lower case: codes, numbers and what tells homonyms apart are left out.

    `IAIDrawerW60H29` is a drawer, `Table-PieceOfFurniture` a table.
    """
    parts = _PARTS.findall(local_name(iri).split("-")[0])
    return tuple(part.lower() for part in parts if len(part) > 1 and not (part.isupper() or part.isdigit()))


def name_suffixes(words: tuple[str, ...]) -> Iterator[str]:
    """What a name may be about, the most telling first: how it ends, the longest first, then each word before that."""
    for start in range(len(words)):
        yield from singular_forms(" ".join(words[start:]))
    for word in reversed(words[:-1]):
        yield from singular_forms(word)


def singular_forms(word: str) -> tuple[str, ...]:
    """A word, and what it may be the plural of."""
    return tuple(dict.fromkeys((word, word.removesuffix("s"), word.removesuffix("es"))))


def stable_hash(text: str) -> int:
    """A number that a text falls on, the same every time."""
    return int.from_bytes(blake2s(text.encode(), digest_size=4).digest(), "big")
