"""The dialect that a semantic map is written in, of those that are installed, and the world that it describes."""

from __future__ import annotations

from operator import attrgetter

from mindstage.access.resources import from_outside
from mindstage.maps.dialects.membership import check_dependency_circles
from mindstage.maps.dialects.semlog import check_duplicate_poses
from mindstage.maps.dialects.soma_nodes import check_restated_sizes, restated_sizes, without_restatements
from mindstage.maps.dialects.source_map import Dialect, SourceMap
from mindstage.rdf.graphs import gc_paused
from mindstage.registry import Group, load_all
from mindstage.scene import World

__all__ = ["detect_dialect", "read_world"]


def detect_dialect(source_map: SourceMap) -> Dialect:
    """Returns the dialect that a map is written in.

    The first that matches, by `Dialect.order`; SemLog's matches every map and reports each individual without a pose.
    """
    with from_outside(source_map.is_untrusted):
        known = load_all(Group.DIALECTS, Dialect).values()
    return next(dialect for dialect in sorted(known, key=attrgetter("order")) if dialect.matches(source_map))


def read_world(source_map: SourceMap) -> World:
    """Reads a map of any dialect, and reports contradicting sizes, poses that many bodies share, and circles."""
    with gc_paused():
        stripped = without_restatements(source_map)
        world = detect_dialect(stripped).read(stripped)
    check_restated_sizes(restated_sizes(source_map), world, source_map.report)
    check_duplicate_poses(world, source_map.report)
    check_dependency_circles(source_map.graph, source_map.report)
    return world
