"""Excerpts: what is known of one map, gathered for whoever can read its dialect."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mindstage.knowledge.findings import Report
from mindstage.knowledge.graph import Graph
from mindstage.knowledge.hierarchy import ClassHierarchy
from mindstage.world import Iri

__all__ = ["Excerpt"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Excerpt:
    """What a reader gets."""

    map: Iri
    graph: Graph
    """What the map's sources say, nested, but for what belongs to other maps."""
    members: Sequence[Iri]
    """The individuals that are described in the map."""
    background: Sequence[Graph]
    """Ontologies that say something about sizes."""
    hierarchy: ClassHierarchy
    """All that is known about classes."""
    report: Report
