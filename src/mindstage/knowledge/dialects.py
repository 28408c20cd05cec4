"""Dialects: the generations of semantic maps, each read by a file of its own.

To add one, write its reader and name it here, before those that would take its maps for their own.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from mindstage.knowledge.bulk import bulk_work
from mindstage.knowledge.excerpt import Excerpt
from mindstage.knowledge.semlog import read_semlog
from mindstage.world import World

__all__ = ["DIALECTS", "Dialect", "read_world"]


class Dialect(NamedTuple):
    """One generation of maps."""

    name: str
    holds: Callable[[Excerpt], bool]
    """Whether a map is of this dialect, from what its sources say."""
    read: Callable[[Excerpt], World]


def _always(excerpt: Excerpt) -> bool:
    return True


DIALECTS: tuple[Dialect, ...] = (Dialect("SemLog", _always, read_semlog),)
"""The first that holds reads; the last one holds for every map, and says of each individual why it has no place."""


def read_world(excerpt: Excerpt) -> World:
    """Reads a map, whatever its dialect."""
    dialect = next(dialect for dialect in DIALECTS if dialect.holds(excerpt))
    with bulk_work():
        return dialect.read(excerpt)
