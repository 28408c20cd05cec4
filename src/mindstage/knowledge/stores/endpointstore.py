"""The store that lives elsewhere: an endpoint's statements, fetched in bulk when somebody first asks for their like.

A statement's like are all with its property. What reasoning needs comes with one request, each further property with
one more, and all of it stays: what others change at the endpoint meanwhile is not seen. Things without a name hang
together as far as they come with one request, unless the server calls them the same each time.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from itertools import chain, count
from pathlib import Path
from typing import Any

import pyoxigraph as ox

from mindstage.errors import ArgumentRefused, EndpointRefused, EndpointUnreachable, QueryRefused, QueryTimedOut
from mindstage.knowledge.reading.other_words import dul, soma
from mindstage.knowledge.reasoning.derivation import DERIVED
from mindstage.knowledge.sources.files import SourceFile
from mindstage.knowledge.sources.source import Source
from mindstage.knowledge.stores.endpoint import SOLUTIONS, TRIPLES, Endpoint
from mindstage.knowledge.stores.localstore import LocalStore
from mindstage.knowledge.stores.sparql import PREFIXES, Table, check_query, solutions_table, triples_table
from mindstage.knowledge.stores.triplestore import Object, Subject
from mindstage.knowledge.teaching import TOLD
from mindstage.knowledge.vocabulary import CHILD, DESCRIBED_IN_MAP, OWL, PARENT, RDF, RDFS

__all__ = ["EndpointStore"]

_RDF = "type first rest"
_RDFS = "subClassOf subPropertyOf domain range"
_OWL = """allValuesFrom cardinality complementOf disjointWith disjointUnionOf equivalentClass equivalentProperty
    hasSelf hasValue imports intersectionOf inverseOf maxCardinality maxQualifiedCardinality members minCardinality
    minQualifiedCardinality onClass onDataRange onDatatype onProperty oneOf propertyChainAxiom propertyDisjointWith
    qualifiedCardinality sameAs someValuesFrom unionOf versionIRI withRestrictions"""

_BULK = (
    *(RDF + word for word in _RDF.split()),
    *(RDFS + word for word in _RDFS.split()),
    *(OWL + word for word in _OWL.split()),
    *map(dul, ("hasPart", "hasComponent", "isPartOf", "isComponentOf")),
    *map(soma, ("hasPhysicalComponent", "isPhysicalComponentOf")),
    *(CHILD, PARENT, DESCRIBED_IN_MAP),
)
"""What reasoning reads, and what blank nodes hang together by."""

_AT_ONCE = 1000
"""Names that one request asks about."""
_STATEMENTS = """SELECT ?s ?p ?o ?g WHERE {
    %s { GRAPH ?g { ?s ?p ?o } } UNION { ?s ?p ?o FILTER NOT EXISTS { GRAPH ?other { ?s ?p ?o } } }
}"""
"""Each with its graph; an endpoint whose default graph is all of them together tells each once all the same."""
_NAMED_GRAPH = "CONSTRUCT {{ ?s ?p ?o }} WHERE {{ GRAPH {graph} {{ ?s ?p ?o }} }}"
_DEFAULT_GRAPH = "CONSTRUCT { ?s ?p ?o } WHERE { ?s ?p ?o FILTER NOT EXISTS { GRAPH ?g { ?s ?p ?o } } }"


class EndpointStore:
    """A `TripleStore` of two: what is loaded here stays here, what is told goes to the endpoint."""

    def __init__(self, endpoint: Endpoint) -> None:
        """Asks nothing yet."""
        self._endpoint = endpoint
        self._local = LocalStore()
        self._here: set[object] = {DERIVED}
        """Graphs of this side."""
        self._mirror = ox.Store()
        self._fetched: set[tuple[str, str]] = set()
        self._fetching = threading.Lock()

    def sources(self) -> list[Source]:
        """The endpoint's graphs, in the order of their names, as what worlds can be made from.

        Raises:
            EndpointUnreachable: nobody answers there, or not in time.
            EndpointRefused: the server says no.
        """
        self._fetch("p", _BULK)
        named = [graph for graph in self._mirror.named_graphs() if isinstance(graph, ox.NamedNode) and graph != TOLD]
        graphs: list[ox.NamedNode | ox.DefaultGraph] = [*sorted(named, key=lambda graph: graph.value)]
        return [
            Source(
                name=str(self._endpoint) if isinstance(graph, ox.DefaultGraph) else graph.value,
                graph=graph,
                store=self,
                read=partial(self._text, graph),
                asked_for=False,
                given=True,
            )
            for graph in (ox.DefaultGraph(), *graphs)
        ]

    # -- reading -------------------------------------------------------------------------------------------------------

    def quads_for_pattern(
        self,
        subject: Subject | ox.Triple | None,
        predicate: ox.NamedNode | None,
        object: Object | None,
        graph_name: ox.NamedNode | ox.BlankNode | ox.DefaultGraph | None = None,
        /,
    ) -> Iterator[ox.Quad]:
        """All statements that fit, of one graph or of all; None fits everything.

        Raises:
            EndpointUnreachable: nobody answers there, or not in time.
            EndpointRefused: the server says no.
        """
        if graph_name in self._here:
            return self._local.quads_for_pattern(subject, predicate, object, graph_name)
        if predicate is not None:
            self._fetch("p", _BULK if predicate.value in _BULK else (predicate.value,))
        elif isinstance(subject, ox.NamedNode):
            self._fetch("s", self._neighbours(subject))
        elif isinstance(object, ox.NamedNode):
            self._fetch("o", (object.value,))
        elif subject is None and object is None:
            self._fetch("", ("",))
        pattern = (subject, predicate, object, graph_name)
        return chain(self._local.quads_for_pattern(*pattern), self._mirror.quads_for_pattern(*pattern))

    def query(self, query: str, *, timeout_s: float, allow_service: bool = False) -> Table:
        """Puts a query to the endpoint as it is; what was loaded here is not in it.

        Raises:
            QueryRefused: the server does not take it, or it asks for what it may not.
            QueryTimedOut: the answer did not come in time.
            EndpointUnreachable: nobody answers there.
            EndpointRefused: the server says no.
        """
        check_query(query, allow_service=allow_service)
        if not timeout_s > 0:
            raise QueryTimedOut(timeout_s=timeout_s)
        prologue = "".join(f"PREFIX {name}: <{iri}> " for name, iri in PREFIXES.items() if f"{name}:" in query)
        try:
            reply = self._endpoint.query(prologue + query, timeout_s=timeout_s)
        except EndpointUnreachable as error:
            if isinstance(error.__cause__, TimeoutError):
                raise QueryTimedOut(timeout_s=timeout_s) from error
            raise
        except EndpointRefused as error:
            if error.status == 400:
                raise QueryRefused(error.cause, remedy=f"so says {self._endpoint}") from error
            raise
        if reply.kind == TRIPLES:
            return triples_table(self._parsed(reply.body))
        try:
            return solutions_table(reply.body)
        except SyntaxError as error:
            raise self._gibberish(error) from error

    def _fetch(self, place: str, names: Iterable[str]) -> None:
        """Fetches all statements that have one of the names at a place (s, p, o, or "" for all there are), once."""
        with self._fetching:
            missing = [name for name in names if (place, name) not in self._fetched]
            for start in range(0, len(missing), _AT_ONCE):
                self._fetch_now(place, missing[start : start + _AT_ONCE])

    def _fetch_now(self, place: str, names: Sequence[str]) -> None:
        few = f"VALUES ?{place} {{ {' '.join(f'<{name}>' for name in names)} }}" if place else ""
        query = _STATEMENTS % few
        reply = self._endpoint.query(query, accept=SOLUTIONS)
        try:
            rows: Any = ox.parse_query_results(reply.body, ox.QueryResultsFormat.JSON)
            self._mirror.extend(ox.Quad(row["s"], row["p"], row["o"], row["g"] or ox.DefaultGraph()) for row in rows)
        except (SyntaxError, TypeError, KeyError) as error:
            raise self._gibberish(error) from error
        self._fetched.update((place, name) for name in names)

    def _neighbours(self, thing: ox.NamedNode) -> list[str]:
        """The thing, and everything else in its map: who looks at one individual will look at the others."""
        within = ox.NamedNode(DESCRIBED_IN_MAP)
        maps = [quad.object for quad in self._mirror.quads_for_pattern(thing, within, None)]
        found = (quad.subject for map in maps for quad in self._mirror.quads_for_pattern(None, within, map))
        return list(dict.fromkeys([thing.value, *(node.value for node in found if isinstance(node, ox.NamedNode))]))

    def _text(self, graph: ox.NamedNode | ox.DefaultGraph) -> SourceFile:
        query = _DEFAULT_GRAPH if isinstance(graph, ox.DefaultGraph) else _NAMED_GRAPH.format(graph=graph)
        data = self._endpoint.query(query, accept=TRIPLES).body
        for _ in self._parsed(data):
            pass
        return SourceFile(Path(str(self._endpoint)), data, ox.RdfFormat.N_TRIPLES)

    def _parsed(self, data: bytes) -> Iterator[ox.Quad]:
        try:
            yield from ox.parse(data, ox.RdfFormat.N_TRIPLES)
        except SyntaxError as error:
            raise self._gibberish(error) from error

    def _gibberish(self, error: Exception) -> EndpointRefused:
        remedy = "is that the address where it takes SPARQL?"
        return EndpointRefused(str(self._endpoint), cause=f"its reply is none of SPARQL's: {error}", remedy=remedy)

    # -- what is loaded here -------------------------------------------------------------------------------------------

    def load(self, data: bytes, format: ox.RdfFormat, *, base_iri: str, to_graph: ox.NamedNode) -> None:
        """Parses a text into a graph of this side.

        Raises:
            SyntaxError: it is not in that format; nothing was added.
        """
        self._local.load(data, format, base_iri=base_iri, to_graph=to_graph)
        self._here.add(to_graph)

    def remove_graph(self, graph: ox.NamedNode, /) -> None:
        """Takes all statements of a graph of this side away."""
        self._local.remove_graph(graph)
        self._here -= {graph} - {DERIVED}

    # -- what is told there --------------------------------------------------------------------------------------------

    def add(self, quad: ox.Quad, /) -> None:
        """Adds a statement at the endpoint.

        Raises:
            EndpointUnreachable: nobody answers there, or not in time.
            EndpointRefused: the server says no.
        """
        self.extend([quad])

    def extend(self, quads: Iterable[ox.Quad], /) -> None:
        """Adds statements at the endpoint that share their things without a name; what was derived stays here.

        Raises:
            EndpointUnreachable: nobody answers there, or not in time.
            EndpointRefused: the server says no.
        """
        told = list(quads)
        self._local.extend(quad for quad in told if quad.graph_name == DERIVED)
        told = [quad for quad in told if quad.graph_name != DERIVED]
        if not told:
            return
        parts = " ".join(_within(quad, f"{quad.subject} {quad.predicate} {quad.object} .") for quad in told)
        self._endpoint.update(f"INSERT DATA {{ {parts} }}")
        self._mirror.extend(told)

    def remove(self, quad: ox.Quad, /) -> None:
        """Takes a statement away at the endpoint; a thing without a name is known there by what is said of it.

        Raises:
            ArgumentRefused: a source of this side says it.
            EndpointUnreachable: nobody answers there, or not in time.
            EndpointRefused: the server says no.
        """
        if next(self._local.quads_for_pattern(quad.subject, quad.predicate, quad.object, quad.graph_name), None):
            raise ArgumentRefused(
                f"{quad.subject} {quad.predicate}",
                cause="a source of this side says it, such as the bundled ontology, and not the endpoint",
                remedy="for the endpoint's own word, ask it alone (--no-bundled-ontology)",
            )
        names: dict[ox.BlankNode, str] = {}
        pattern = " ".join(_pattern(self._mirror, quad, names, (f"?b{number}" for number in count())))
        taken = f"{_term(quad.subject, names)} {quad.predicate} {_term(quad.object, names)} ."
        blank = " ".join(f"FILTER isBlank({name})" for name in names.values())
        where = _within(quad, f"{pattern} {blank}")
        self._endpoint.update(f"DELETE {{ {_within(quad, taken)} }} WHERE {{ {where} }}")
        self._mirror.remove(quad)

    def close(self) -> None:
        """Forgets what was fetched and loaded."""
        self._local.close()
        self._mirror = ox.Store()
        self._fetched.clear()


def _within(quad: ox.Quad, statements: str) -> str:
    return statements if isinstance(quad.graph_name, ox.DefaultGraph) else f"GRAPH {quad.graph_name} {{ {statements} }}"


def _pattern(store: ox.Store, quad: ox.Quad, names: dict[ox.BlankNode, str], free: Iterator[str]) -> Iterator[str]:
    """A statement and all that is known of the blank nodes in it, with variables for these."""
    new = [node for node in (quad.subject, quad.object) if isinstance(node, ox.BlankNode) and node not in names]
    names.update((node, next(free)) for node in new)
    yield f"{_term(quad.subject, names)} {quad.predicate} {_term(quad.object, names)} ."
    for node in new:
        for more in store.quads_for_pattern(node, None, None, quad.graph_name):
            if more != quad:
                yield from _pattern(store, more, names, free)


def _term(node: object, names: dict[ox.BlankNode, str]) -> str:
    return names[node] if isinstance(node, ox.BlankNode) else str(node)
