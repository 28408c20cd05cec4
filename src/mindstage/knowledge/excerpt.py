"""Excerpts: what is known of one map, gathered for whoever can read its dialect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mindstage.knowledge.census import Census
from mindstage.knowledge.findings import Report
from mindstage.knowledge.graph import Graph
from mindstage.knowledge.hierarchy import ClassHierarchy
from mindstage.world import Fact, Iri

__all__ = ["Excerpt"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Excerpt:
    """What a reader gets."""

    map: Iri
    graph: Graph
    """What the map's sources say."""
    census: Census
    """Who lives in which map, as the graph tells."""
    background: Mapping[Iri, Sequence[Fact]]
    """What ontologies say about sizes, by class."""
    hierarchy: ClassHierarchy
    """All that is known about classes."""
    report: Report
