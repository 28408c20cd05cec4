"""The registry of map dialects: detection of the vocabulary that a semantic map is written in, and its reader.

`DIALECTS` is searched in order, so a new dialect has to precede those that would also match its maps.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from mindstage.maps.dialects.ameva import AMEVA_DIALECT, is_ameva, read_ameva
from mindstage.maps.dialects.knowrob1 import is_knowrob1, read_knowrob1
from mindstage.maps.dialects.membership import check_dependency_circles
from mindstage.maps.dialects.semlog import (
    check_duplicate_poses,
    is_early_semlog,
    read_early_semlog,
    read_semlog_map,
)
from mindstage.maps.dialects.soma import is_soma, read_soma
from mindstage.maps.dialects.soma_nodes import check_restated_sizes, restated_sizes, without_restatements
from mindstage.maps.dialects.source_map import SourceMap
from mindstage.rdf.graphs import gc_paused
from mindstage.scene import World

__all__ = ["DIALECTS", "Dialect", "detect_dialect", "read_world"]


class Dialect(NamedTuple):
    """A map dialect: a name, a test for it and a reader."""

    name: str
    matches: Callable[[SourceMap], bool]
    """Whether a map is written in this dialect, judged by its statements."""
    read: Callable[[SourceMap], World]
    """Converts a map of this dialect to a world."""


def _match_any(source_map: SourceMap) -> bool:
    return True


DIALECTS: tuple[Dialect, ...] = (
    Dialect("KnowRob 1", is_knowrob1, read_knowrob1),
    Dialect("SOMA", is_soma, read_soma),
    Dialect(AMEVA_DIALECT, is_ameva, read_ameva),
    Dialect("SemLog, early", is_early_semlog, read_early_semlog),
    Dialect("SemLog", _match_any, read_semlog_map),
)
"""The first entry that matches reads the map. The last matches every map and reports each individual without a pose."""


def detect_dialect(source_map: SourceMap) -> Dialect:
    """Returns the dialect that a map is written in."""
    return next(dialect for dialect in DIALECTS if dialect.matches(source_map))


def read_world(source_map: SourceMap) -> World:
    """Reads a map of any dialect, and reports contradicting sizes, poses that many bodies share, and circles."""
    with gc_paused():
        stripped = without_restatements(source_map)
        world = detect_dialect(stripped).read(stripped)
    check_restated_sizes(restated_sizes(source_map), world, source_map.report)
    check_duplicate_poses(world, source_map.report)
    check_dependency_circles(source_map.graph, source_map.report)
    return world
