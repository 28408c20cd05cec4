"""Dialects: the generations of semantic maps, each read by a file of its own.

To add one, write its reader and name it here, before those that would take its maps for their own.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from mindstage.knowledge.dialects.ameva import AMEVA_DIALECT, is_ameva, read_ameva
from mindstage.knowledge.dialects.knowrob1 import is_knowrob1, read_knowrob1
from mindstage.knowledge.dialects.semlog import (
    check_duplicate_poses,
    is_early_semlog,
    read_early_semlog,
    read_semlog_map,
)
from mindstage.knowledge.dialects.soma import is_soma, read_soma
from mindstage.knowledge.dialects.soma_nodes import check_restated_sizes, restated_sizes, without_restatements
from mindstage.knowledge.dialects.source_map import SourceMap
from mindstage.knowledge.rdf import gc_paused
from mindstage.scene import World

__all__ = ["DIALECTS", "Dialect", "detect_dialect", "read_world"]


class Dialect(NamedTuple):
    """One generation of maps."""

    name: str
    matches: Callable[[SourceMap], bool]
    """Whether a map is of this dialect, from what its sources say."""
    read: Callable[[SourceMap], World]


def _match_any(source_map: SourceMap) -> bool:
    return True


DIALECTS: tuple[Dialect, ...] = (
    Dialect("KnowRob 1", is_knowrob1, read_knowrob1),
    Dialect("SOMA", is_soma, read_soma),
    Dialect(AMEVA_DIALECT, is_ameva, read_ameva),
    Dialect("SemLog, early", is_early_semlog, read_early_semlog),
    Dialect("SemLog", _match_any, read_semlog_map),
)
"""The first that holds reads; the last one holds for every map, and says of each individual why it has no place."""


def detect_dialect(source_map: SourceMap) -> Dialect:
    """What a map is written in."""
    return next(dialect for dialect in DIALECTS if dialect.matches(source_map))


def read_world(source_map: SourceMap) -> World:
    """Reads a map, whatever its dialect."""
    with gc_paused():
        told = without_restatements(source_map)
        world = detect_dialect(told).read(told)
    check_restated_sizes(restated_sizes(source_map), world, source_map.report)
    check_duplicate_poses(world, source_map.report)
    return world
