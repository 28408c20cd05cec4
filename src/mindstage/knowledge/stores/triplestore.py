"""Triple stores: where statements are kept, whoever keeps them.

The index and the questions read patterns and know nothing else; whether they come from memory, from a folder or from a
server is the store's own affair.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Protocol

import pyoxigraph as ox

if TYPE_CHECKING:
    from mindstage.knowledge.stores.sparql import SparqlResult

__all__ = ["ObjectNode", "QuadSource", "SubjectNode", "TripleStore"]

SubjectNode = ox.NamedNode | ox.BlankNode
ObjectNode = ox.NamedNode | ox.BlankNode | ox.Literal | ox.Triple


class QuadSource(Protocol):
    """What the index reads from."""

    def quads_for_pattern(
        self,
        subject: SubjectNode | ox.Triple | None,
        predicate: ox.NamedNode | None,
        object: ObjectNode | None,
        graph_name: ox.NamedNode | ox.BlankNode | ox.DefaultGraph | None = None,
        /,
    ) -> Iterator[ox.Quad]:
        """All statements that fit, of one graph or of all; None fits everything."""


class TripleStore(QuadSource, Protocol):
    """What a knowledge base keeps its statements in.

    Each call is done whole or not at all. Reading is safe from several threads, writing from one at a time.
    """

    def add(self, quad: ox.Quad, /) -> None:
        """Adds a statement; adding it twice is adding it once."""

    def extend(self, quads: Iterable[ox.Quad], /) -> None:
        """Adds statements that share their things without a name."""

    def remove(self, quad: ox.Quad, /) -> None:
        """Takes a statement away, if it is there."""

    def load(self, data: bytes, format: ox.RdfFormat, *, base_iri: str, to_graph: ox.NamedNode) -> None:
        """Parses a text into a graph.

        Raises:
            SyntaxError: it is not in that format; nothing was added.
        """

    def remove_graph(self, graph: ox.NamedNode, /) -> None:
        """Takes all statements of a graph away."""

    def query(self, query: str, *, timeout_s: float, allow_service: bool = False) -> SparqlResult:
        """Answers a SPARQL query, or stops it when its time is over.

        Raises:
            SparqlSyntaxError: it is no query, asks for what it may not, or for more than can be had.
            SparqlTimeoutError: it did not end in time.
        """

    def close(self) -> None:
        """Lets go of files, processes and connections; any number of times."""
