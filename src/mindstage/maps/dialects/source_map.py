"""The statements and class hierarchy of one map, as the dialect readers receive them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from mindstage.maps.dialects.conventions import Assumption, AssumptionSink, UnitConventions
from mindstage.rdf.graphs import FindingSink, Graph, Severity
from mindstage.rdf.taxonomy import ClassHierarchy
from mindstage.scene import Iri, Vector, World

__all__ = ["Dialect", "MeshBounds", "SourceMap", "ignore_finding"]

MeshBounds = Callable[[Sequence[tuple[str | None, Iri]]], Sequence[tuple[Vector, Vector] | None]]
"""Returns the lower and upper corners of meshes in their own frames, by mesh name and class; None for missing files."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceMap:
    """The input of a dialect reader: one map of a graph."""

    map: Iri
    graph: Graph
    """The nested statements of the map's sources, without those of other maps."""
    members: Sequence[Iri]
    """The individuals that belong to the map."""
    ontologies: Sequence[Graph]
    """Ontologies that give sizes or meshes of classes."""
    hierarchy: ClassHierarchy
    """The subclass relations of all sources and ontologies."""
    report: FindingSink
    add_assumption: AssumptionSink
    conventions: UnitConventions = field(default_factory=UnitConventions)
    """Conventions chosen by the user; None in a field leaves the decision to the reader."""
    mesh_bounds: MeshBounds | None = None
    """Reads the bounds of mesh files; None without any."""
    is_untrusted: bool = False
    """Whether it came over a port; it is then read only by dialects that are offered there."""
    implied_members: frozenset[Iri] = frozenset()
    """The individuals, and the map, whose membership statements are not in the sources but follow from them."""

    current_names: frozenset[str] | None = None
    """If the sources use the namespaces that KnowRob had until 2013, the names that are not written in these."""

    def record_assumption(self, topic: str, value: str, evidence: str) -> None:
        """Records a decision about the whole map; a field of `conventions` that is set counts as chosen by the user.

        Args:
            topic: what was decided; the field's name if it is one of `conventions`.
            value: the decision.
            evidence: the reason, or what would have been decided without the user's choice.
        """
        overridden = getattr(self.conventions, topic, None) is not None
        self.add_assumption(Assumption(self.map, topic, value, evidence, overridden))


class Dialect(NamedTuple):
    """A map dialect; the entry points `mindstage.dialects` name these."""

    name: str
    matches: Callable[[SourceMap], bool]
    """Whether a map is written in this dialect, judged by its statements."""
    read: Callable[[SourceMap], World]
    """Converts a map of this dialect to a world."""
    order: int = 0
    """Those with lower numbers are asked first whether they match; Mindstage's own have numbers from 10 to 50."""


def ignore_finding(severity: Severity, individual: str, property: str, problem: str, action: str) -> None:
    """Discards a finding; a `FindingSink` for repeated reading of statements whose findings are already reported."""
