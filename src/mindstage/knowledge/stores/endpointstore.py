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

from mindstage.errors import (
    EndpointError,
    EndpointUnreachableError,
    InvalidArgumentError,
    SparqlSyntaxError,
    SparqlTimeoutError,
)
from mindstage.knowledge.reading.other_words import dul, soma
from mindstage.knowledge.reasoning.derivation import INFERRED_GRAPH
from mindstage.knowledge.sources.files import SourceFile
from mindstage.knowledge.sources.source import Source
from mindstage.knowledge.stores.endpoint import JSON_RESULTS, N_TRIPLES, SparqlEndpoint
from mindstage.knowledge.stores.localstore import OxigraphStore
from mindstage.knowledge.stores.sparql import PREFIXES, SparqlResult, check_query, solutions_table, triples_table
from mindstage.knowledge.stores.triplestore import ObjectNode, SubjectNode
from mindstage.knowledge.teaching import RUNTIME_GRAPH
from mindstage.knowledge.vocabulary import CHILD, DESCRIBED_IN_MAP, OWL, PARENT, RDF, RDFS

__all__ = ["SparqlEndpointStore"]

_RDF_NAMES = "type first rest"
_RDFS_NAMES = "subClassOf subPropertyOf domain range"
_OWL_NAMES = """allValuesFrom cardinality complementOf disjointWith disjointUnionOf equivalentClass equivalentProperty
    hasSelf hasValue imports intersectionOf inverseOf maxCardinality maxQualifiedCardinality members minCardinality
    minQualifiedCardinality onClass onDataRange onDatatype onProperty oneOf propertyChainAxiom propertyDisjointWith
    qualifiedCardinality sameAs someValuesFrom unionOf versionIRI withRestrictions"""

_BULK_PREDICATES = (
    *(RDF + word for word in _RDF_NAMES.split()),
    *(RDFS + word for word in _RDFS_NAMES.split()),
    *(OWL + word for word in _OWL_NAMES.split()),
    *map(dul, ("hasPart", "hasComponent", "isPartOf", "isComponentOf")),
    *map(soma, ("hasPhysicalComponent", "isPhysicalComponentOf")),
    *(CHILD, PARENT, DESCRIBED_IN_MAP),
)
"""What reasoning reads, and what blank nodes hang together by."""

_BATCH_SIZE = 1000
"""Names that one request asks about."""
_STATEMENTS_QUERY = """SELECT ?s ?p ?o ?g WHERE {
    %s { GRAPH ?g { ?s ?p ?o } } UNION { ?s ?p ?o FILTER NOT EXISTS { GRAPH ?other { ?s ?p ?o } } }
}"""
"""Each with its graph; an endpoint whose default graph is all of them together tells each once all the same."""
_NAMED_GRAPH_QUERY = "CONSTRUCT {{ ?s ?p ?o }} WHERE {{ GRAPH {graph} {{ ?s ?p ?o }} }}"
_DEFAULT_GRAPH_QUERY = "CONSTRUCT { ?s ?p ?o } WHERE { ?s ?p ?o FILTER NOT EXISTS { GRAPH ?g { ?s ?p ?o } } }"


class SparqlEndpointStore:
    """A `TripleStore` of two: what is loaded here stays here, what is told goes to the endpoint."""

    def __init__(self, endpoint: SparqlEndpoint) -> None:
        """Asks nothing yet."""
        self._endpoint = endpoint
        self._local = OxigraphStore()
        self._local_graphs: set[object] = {INFERRED_GRAPH}
        """Graphs of this side."""
        self._cache = ox.Store()
        self._fetched: set[tuple[str, str]] = set()
        self._fetch_lock = threading.Lock()

    def sources(self) -> list[Source]:
        """The endpoint's graphs, in the order of their names, as what worlds can be made from.

        Raises:
            EndpointUnreachableError: nobody answers there, or not in time.
            EndpointError: the server says no.
        """
        self._fetch("p", _BULK_PREDICATES)
        named = [
            graph for graph in self._cache.named_graphs() if isinstance(graph, ox.NamedNode) and graph != RUNTIME_GRAPH
        ]
        graphs: list[ox.NamedNode | ox.DefaultGraph] = [*sorted(named, key=lambda graph: graph.value)]
        return [
            Source(
                name=str(self._endpoint) if isinstance(graph, ox.DefaultGraph) else graph.value,
                graph=graph,
                store=self,
                load_text=partial(self._read_graph, graph),
                is_map=False,
                is_explicit=True,
            )
            for graph in (ox.DefaultGraph(), *graphs)
        ]

    # -- reading -------------------------------------------------------------------------------------------------------

    def quads_for_pattern(
        self,
        subject: SubjectNode | ox.Triple | None,
        predicate: ox.NamedNode | None,
        object: ObjectNode | None,
        graph_name: ox.NamedNode | ox.BlankNode | ox.DefaultGraph | None = None,
        /,
    ) -> Iterator[ox.Quad]:
        """All statements that fit, of one graph or of all; None fits everything.

        Raises:
            EndpointUnreachableError: nobody answers there, or not in time.
            EndpointError: the server says no.
        """
        if graph_name in self._local_graphs:
            return self._local.quads_for_pattern(subject, predicate, object, graph_name)
        if predicate is not None:
            self._fetch("p", _BULK_PREDICATES if predicate.value in _BULK_PREDICATES else (predicate.value,))
        elif isinstance(subject, ox.NamedNode):
            self._fetch("s", self._map_neighbors(subject))
        elif isinstance(object, ox.NamedNode):
            self._fetch("o", (object.value,))
        elif subject is None and object is None:
            self._fetch("", ("",))
        pattern = (subject, predicate, object, graph_name)
        return chain(self._local.quads_for_pattern(*pattern), self._cache.quads_for_pattern(*pattern))

    def query(self, query: str, *, timeout_s: float, allow_service: bool = False) -> SparqlResult:
        """Puts a query to the endpoint as it is; what was loaded here is not in it.

        Raises:
            SparqlSyntaxError: the server does not take it, or it asks for what it may not.
            SparqlTimeoutError: the answer did not come in time.
            EndpointUnreachableError: nobody answers there.
            EndpointError: the server says no.
        """
        check_query(query, allow_service=allow_service)
        if not timeout_s > 0:
            raise SparqlTimeoutError(timeout_s=timeout_s)
        prologue = "".join(f"PREFIX {name}: <{iri}> " for name, iri in PREFIXES.items() if f"{name}:" in query)
        try:
            reply = self._endpoint.query(prologue + query, timeout_s=timeout_s)
        except EndpointUnreachableError as error:
            if isinstance(error.__cause__, TimeoutError):
                raise SparqlTimeoutError(timeout_s=timeout_s) from error
            raise
        except EndpointError as error:
            if error.status == 400:
                raise SparqlSyntaxError(error.cause, remedy=f"so says {self._endpoint}") from error
            raise
        if reply.media_type == N_TRIPLES:
            return triples_table(self._parse(reply.body))
        try:
            return solutions_table(reply.body)
        except SyntaxError as error:
            raise self._invalid_reply(error) from error

    def _fetch(self, position: str, names: Iterable[str]) -> None:
        """Fetches all statements that have one of the names at a place (s, p, o, or "" for all there are), once."""
        with self._fetch_lock:
            missing = [name for name in names if (position, name) not in self._fetched]
            for start in range(0, len(missing), _BATCH_SIZE):
                self._fetch_batch(position, missing[start : start + _BATCH_SIZE])

    def _fetch_batch(self, position: str, names: Sequence[str]) -> None:
        few = f"VALUES ?{position} {{ {' '.join(f'<{name}>' for name in names)} }}" if position else ""
        query = _STATEMENTS_QUERY % few
        reply = self._endpoint.query(query, accept=JSON_RESULTS)
        try:
            rows: Any = ox.parse_query_results(reply.body, ox.QueryResultsFormat.JSON)
            self._cache.extend(ox.Quad(row["s"], row["p"], row["o"], row["g"] or ox.DefaultGraph()) for row in rows)
        except (SyntaxError, TypeError, KeyError) as error:
            raise self._invalid_reply(error) from error
        self._fetched.update((position, name) for name in names)

    def _map_neighbors(self, individual: ox.NamedNode) -> list[str]:
        """The thing, and everything else in its map: who looks at one individual will look at the others."""
        within = ox.NamedNode(DESCRIBED_IN_MAP)
        maps = [quad.object for quad in self._cache.quads_for_pattern(individual, within, None)]
        found = (quad.subject for map in maps for quad in self._cache.quads_for_pattern(None, within, map))
        return list(
            dict.fromkeys([individual.value, *(node.value for node in found if isinstance(node, ox.NamedNode))])
        )

    def _read_graph(self, graph: ox.NamedNode | ox.DefaultGraph) -> SourceFile:
        query = _DEFAULT_GRAPH_QUERY if isinstance(graph, ox.DefaultGraph) else _NAMED_GRAPH_QUERY.format(graph=graph)
        data = self._endpoint.query(query, accept=N_TRIPLES).body
        for _ in self._parse(data):
            pass
        return SourceFile(Path(str(self._endpoint)), data, ox.RdfFormat.N_TRIPLES)

    def _parse(self, data: bytes) -> Iterator[ox.Quad]:
        try:
            yield from ox.parse(data, ox.RdfFormat.N_TRIPLES)
        except SyntaxError as error:
            raise self._invalid_reply(error) from error

    def _invalid_reply(self, error: Exception) -> EndpointError:
        remedy = "is that the address where it takes SPARQL?"
        return EndpointError(str(self._endpoint), cause=f"its reply is none of SPARQL's: {error}", remedy=remedy)

    # -- what is loaded here -------------------------------------------------------------------------------------------

    def load(self, data: bytes, format: ox.RdfFormat, *, base_iri: str, to_graph: ox.NamedNode) -> None:
        """Parses a text into a graph of this side.

        Raises:
            SyntaxError: it is not in that format; nothing was added.
        """
        self._local.load(data, format, base_iri=base_iri, to_graph=to_graph)
        self._local_graphs.add(to_graph)

    def remove_graph(self, graph: ox.NamedNode, /) -> None:
        """Takes all statements of a graph of this side away."""
        self._local.remove_graph(graph)
        self._local_graphs -= {graph} - {INFERRED_GRAPH}

    # -- what is told there --------------------------------------------------------------------------------------------

    def add(self, quad: ox.Quad, /) -> None:
        """Adds a statement at the endpoint.

        Raises:
            EndpointUnreachableError: nobody answers there, or not in time.
            EndpointError: the server says no.
        """
        self.extend([quad])

    def extend(self, quads: Iterable[ox.Quad], /) -> None:
        """Adds statements at the endpoint that share their things without a name; what was derived stays here.

        Raises:
            EndpointUnreachableError: nobody answers there, or not in time.
            EndpointError: the server says no.
        """
        told = list(quads)
        self._local.extend(quad for quad in told if quad.graph_name == INFERRED_GRAPH)
        told = [quad for quad in told if quad.graph_name != INFERRED_GRAPH]
        if not told:
            return
        parts = " ".join(_in_graph(quad, f"{quad.subject} {quad.predicate} {quad.object} .") for quad in told)
        self._endpoint.update(f"INSERT DATA {{ {parts} }}")
        self._cache.extend(told)

    def remove(self, quad: ox.Quad, /) -> None:
        """Takes a statement away at the endpoint; a thing without a name is known there by what is said of it.

        Raises:
            InvalidArgumentError: a source of this side says it.
            EndpointUnreachableError: nobody answers there, or not in time.
            EndpointError: the server says no.
        """
        if next(self._local.quads_for_pattern(quad.subject, quad.predicate, quad.object, quad.graph_name), None):
            raise InvalidArgumentError(
                f"{quad.subject} {quad.predicate}",
                cause="a source of this side says it, such as the bundled ontology, and not the endpoint",
                remedy="for the endpoint's own word, ask it alone (--no-bundled-ontology)",
            )
        names: dict[ox.BlankNode, str] = {}
        pattern = " ".join(_sparql_pattern(self._cache, quad, names, (f"?b{number}" for number in count())))
        taken = f"{_sparql_term(quad.subject, names)} {quad.predicate} {_sparql_term(quad.object, names)} ."
        blank = " ".join(f"FILTER isBlank({name})" for name in names.values())
        where = _in_graph(quad, f"{pattern} {blank}")
        self._endpoint.update(f"DELETE {{ {_in_graph(quad, taken)} }} WHERE {{ {where} }}")
        self._cache.remove(quad)

    def close(self) -> None:
        """Forgets what was fetched and loaded."""
        self._local.close()
        self._cache = ox.Store()
        self._fetched.clear()


def _in_graph(quad: ox.Quad, statements: str) -> str:
    return statements if isinstance(quad.graph_name, ox.DefaultGraph) else f"GRAPH {quad.graph_name} {{ {statements} }}"


def _sparql_pattern(
    store: ox.Store, quad: ox.Quad, names: dict[ox.BlankNode, str], variables: Iterator[str]
) -> Iterator[str]:
    """A statement and all that is known of the blank nodes in it, with variables for these."""
    new = [node for node in (quad.subject, quad.object) if isinstance(node, ox.BlankNode) and node not in names]
    names.update((node, next(variables)) for node in new)
    yield f"{_sparql_term(quad.subject, names)} {quad.predicate} {_sparql_term(quad.object, names)} ."
    for node in new:
        for more in store.quads_for_pattern(node, None, None, quad.graph_name):
            if more != quad:
                yield from _sparql_pattern(store, more, names, variables)


def _sparql_term(node: object, names: dict[ox.BlankNode, str]) -> str:
    return names[node] if isinstance(node, ox.BlankNode) else str(node)
