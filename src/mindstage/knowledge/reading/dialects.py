"""Dialects: the generations of semantic maps, each read by a file of its own.

To add one, write its reader and name it here, before those that would take its maps for their own.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from mindstage.knowledge.bulk import bulk_work
from mindstage.knowledge.readers.ameva import AMEVA, is_ameva, read_ameva
from mindstage.knowledge.readers.knowrob1 import is_knowrob1, read_knowrob1
from mindstage.knowledge.readers.semlog import read_semlog_map
from mindstage.knowledge.readers.semlog_early import is_early_semlog, read_early_semlog
from mindstage.knowledge.readers.soma import is_soma, read_soma
from mindstage.knowledge.reading.crowds import report_crowds
from mindstage.knowledge.reading.excerpt import Excerpt
from mindstage.knowledge.reading.restating import compare_restated, restated_extents, restored
from mindstage.world import World

__all__ = ["DIALECTS", "Dialect", "dialect_of", "read_world"]


class Dialect(NamedTuple):
    """One generation of maps."""

    name: str
    holds: Callable[[Excerpt], bool]
    """Whether a map is of this dialect, from what its sources say."""
    read: Callable[[Excerpt], World]


def _always(excerpt: Excerpt) -> bool:
    return True


DIALECTS: tuple[Dialect, ...] = (
    Dialect("KnowRob 1", is_knowrob1, read_knowrob1),
    Dialect("SOMA", is_soma, read_soma),
    Dialect(AMEVA, is_ameva, read_ameva),
    Dialect("SemLog, early", is_early_semlog, read_early_semlog),
    Dialect("SemLog", _always, read_semlog_map),
)
"""The first that holds reads; the last one holds for every map, and says of each individual why it has no place."""


def dialect_of(excerpt: Excerpt) -> Dialect:
    """What a map is written in."""
    return next(dialect for dialect in DIALECTS if dialect.holds(excerpt))


def read_world(excerpt: Excerpt) -> World:
    """Reads a map, whatever its dialect."""
    with bulk_work():
        told = restored(excerpt)
        world = dialect_of(told).read(told)
    compare_restated(restated_extents(excerpt), world, excerpt.report)
    report_crowds(world, excerpt.report)
    return world
