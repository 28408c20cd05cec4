"""Origins: what a map was before it became a world, for those who hold the two against each other."""

from __future__ import annotations

from dataclasses import dataclass, replace

from mindstage.knowledge.reading.conversion import declared, given_conventions, unconverted
from mindstage.knowledge.reading.dialects import dialect_of
from mindstage.knowledge.reading.excerpt import Excerpt
from mindstage.knowledge.reading.restating import restored
from mindstage.world import Iri

__all__ = ["Origin"]


@dataclass(frozen=True, slots=True)
class Origin:
    """One map as its sources tell it."""

    excerpt: Excerpt
    """All that the reader of its dialect has at hand."""

    def given(self) -> Origin | None:
        """The map as it was before its numbers were converted; None where it does not say that they were."""
        graph, map = self.excerpt.graph, self.excerpt.map
        conventions = given_conventions(graph.get(map, ()))
        if conventions is None:
            return None
        before = {subject: unconverted(facts, conventions) for subject, facts in graph.items()}
        before[map] = declared(before[map], conventions)
        return Origin(replace(self.excerpt, graph=before))

    @property
    def map(self) -> Iri:
        """Which one it is."""
        return self.excerpt.map

    @property
    def dialect(self) -> str:
        """What kind of map it is."""
        return dialect_of(restored(self.excerpt)).name
