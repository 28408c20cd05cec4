"""Origins: what a map was before it became a world, for those who hold the two against each other."""

from __future__ import annotations

from dataclasses import dataclass, replace

from mindstage.knowledge.reading.conversion import original_conventions, restore_declarations, restore_facts
from mindstage.knowledge.reading.dialects import detect_dialect
from mindstage.knowledge.reading.excerpt import SourceMap
from mindstage.knowledge.reading.restating import without_restatements
from mindstage.world import Iri

__all__ = ["SourceMapView"]


@dataclass(frozen=True, slots=True)
class SourceMapView:
    """One map as its sources tell it."""

    source_map: SourceMap
    """All that the reader of its dialect has at hand."""

    def before_conversion(self) -> SourceMapView | None:
        """The map as it was before its numbers were converted; None where it does not say that they were."""
        graph, map = self.source_map.graph, self.source_map.map
        conventions = original_conventions(graph.get(map, ()))
        if conventions is None:
            return None
        before = {subject: restore_facts(facts, conventions) for subject, facts in graph.items()}
        before[map] = restore_declarations(before[map], conventions)
        return SourceMapView(replace(self.source_map, graph=before))

    @property
    def map(self) -> Iri:
        """Which one it is."""
        return self.source_map.map

    @property
    def dialect(self) -> str:
        """What kind of map it is."""
        return detect_dialect(without_restatements(self.source_map)).name
