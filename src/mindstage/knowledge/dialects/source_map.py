"""Excerpts: what is known of one map, gathered for whoever can read its dialect."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from mindstage.knowledge.dialects.conventions import Assumption, AssumptionSink, UnitConventions
from mindstage.knowledge.rdf import FindingSink, Graph
from mindstage.knowledge.taxonomy import ClassHierarchy
from mindstage.scene import Iri

__all__ = ["SourceMap"]


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceMap:
    """What a reader gets."""

    map: Iri
    graph: Graph
    """What the map's sources say, nested, but for what belongs to other maps."""
    members: Sequence[Iri]
    """The individuals that are described in the map."""
    ontologies: Sequence[Graph]
    """Ontologies that say something about sizes."""
    hierarchy: ClassHierarchy
    """All that is known about classes."""
    report: FindingSink
    add_assumption: AssumptionSink
    conventions: UnitConventions = field(default_factory=UnitConventions)
    """What the user says about the map's numbers; None in it is the reader's to decide."""

    def record_assumption(self, topic: str, value: str, evidence: str) -> None:
        """Says aloud what was decided about the whole map; one of `conventions`' fields counts as told by the user.

        Args:
            about: what was decided; the field's name where it is one of `conventions`.
            value: what the reader goes by.
            evidence: what speaks for it, or what would have been decided where the user said otherwise.
        """
        overridden = getattr(self.conventions, topic, None) is not None
        self.add_assumption(Assumption(self.map, topic, value, evidence, overridden))
