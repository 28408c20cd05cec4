"""Sources: what was read from one place, as statements in the store and, where a world is made of it, as exact text."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pyoxigraph as ox

from mindstage.knowledge.sources.files import SourceFile
from mindstage.knowledge.stores.triplestore import ObjectNode, QuadSource
from mindstage.knowledge.vocabulary import DESCRIBED_IN_MAP, IMPORTS, ON_PROPERTY, SEMANTIC_MAP, TYPE
from mindstage.knowledge.wording.words import SIZE
from mindstage.world import Iri

__all__ = ["Source"]


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """One file, or one graph of an endpoint."""

    name: str
    """Its path, or the graph's name."""
    graph: ox.NamedNode | ox.DefaultGraph
    store: QuadSource
    load_text: Callable[[], SourceFile]
    """Gives its text, which may have to be fetched from where it is kept."""
    is_map: bool
    """Whether it was named as a map, and not only imported or given as an ontology."""
    is_explicit: bool
    """Whether it was named at all, and not only imported."""

    @property
    def path(self) -> Path:
        """Where it lies, if it is a file."""
        return Path(self.name)

    def quads(self) -> Iterator[ox.Quad]:
        """What it says, to the letter: the store itself writes numbers its own way."""
        file = self.load_text()
        base = self.graph.value if isinstance(self.graph, ox.NamedNode) else None
        return ox.parse(file.data, file.format, base_iri=base)

    def imported_iris(self) -> list[str]:
        """What it names as its imports, in one order."""
        return sorted(
            quad.object.value for quad in self._quads_with_predicate(IMPORTS) if isinstance(quad.object, ox.NamedNode)
        )

    def maps(self) -> frozenset[Iri]:
        """The maps that it tells of, or of something in them; a label stands for one without a name."""
        nodes: set[object] = {quad.subject for quad in self._quads_with_predicate(TYPE, SEMANTIC_MAP)}
        nodes.update(quad.object for quad in self._quads_with_predicate(DESCRIBED_IN_MAP))
        named = {Iri(node.value) for node in nodes if isinstance(node, ox.NamedNode)}
        return frozenset(named | {Iri(f"_:{node.value}") for node in nodes if isinstance(node, ox.BlankNode)})

    def has_maps(self) -> bool:
        """Whether it tells of a map or of something in one."""
        return any(True for _ in self._quads_with_predicate(DESCRIBED_IN_MAP)) or any(
            True for _ in self._quads_with_predicate(TYPE, SEMANTIC_MAP)
        )

    def has_class_sizes(self) -> bool:
        """Whether it tells how large the things of some class are."""
        return any(True for word in SIZE for _ in self._quads_with_predicate(ON_PROPERTY, word.property))

    def _quads_with_predicate(self, property: Iri, value: Iri | None = None) -> Iterator[ox.Quad]:
        node: ObjectNode | None = None if value is None else ox.NamedNode(value)
        return self.store.quads_for_pattern(None, ox.NamedNode(property), node, self.graph)
