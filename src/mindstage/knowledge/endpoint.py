"""SPARQL endpoints over HTTP, and a triple store on top of one.

A request has a time limit for the whole exchange, and a reply has a size limit. No other address is contacted: proxies
and redirections are not followed.

The store fetches statements in bulk and caches them: those that reasoning needs in one request, and every other
property in one request when it is first used. Later changes at the endpoint by others are not noticed. Blank nodes are
identified within one request only, unless the server keeps their labels.
"""

from __future__ import annotations

import base64
import re
import threading
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import chain, count
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import SplitResult, unquote, urlencode, urlsplit, urlunsplit

import pyoxigraph as ox

from mindstage.access.limits import Timeout
from mindstage.errors import (
    EndpointError,
    EndpointUnreachableError,
    InvalidArgumentError,
    SparqlSyntaxError,
    SparqlTimeoutError,
)
from mindstage.knowledge.owl_rl import INFERRED_GRAPH
from mindstage.knowledge.sparql_worker import REPLY_LIMIT
from mindstage.knowledge.store import OxigraphStore, check_text, solutions_table, triples_table
from mindstage.knowledge.tell import RUNTIME_GRAPH
from mindstage.maps.dialects.membership import inferred_membership
from mindstage.maps.io.files import Source, SourceFile
from mindstage.ranges import checked
from mindstage.rdf.graphs import (
    PREFIXES,
    ObjectNode,
    SparqlResult,
    SubjectNode,
    graph_from_quads,
    has_blank_node,
    node_from_label,
)
from mindstage.rdf.vocabulary import (
    CHILD,
    DESCRIBED_IN_MAP,
    OWL,
    PARENT,
    POSE_PROPERTIES,
    RDF,
    RDFS,
    dul,
    soma,
)
from mindstage.scene import Iri, IriRef

if TYPE_CHECKING:
    import http.client

__all__ = ["JSON_RESULTS", "N_TRIPLES", "HttpReply", "SparqlEndpoint", "SparqlEndpointStore"]


JSON_RESULTS = "application/sparql-results+json"
N_TRIPLES = "application/n-triples"

_CHUNK_BYTES = 256 * 1024
_MAX_SHOWN = 300
"""The number of characters of a server's message that an error repeats."""

_RDF_NAMES = "type first rest"
_RDFS_NAMES = "subClassOf subPropertyOf domain range"
_OWL_NAMES = """allValuesFrom cardinality complementOf disjointWith disjointUnionOf equivalentClass equivalentProperty
    hasSelf hasValue imports intersectionOf inverseOf maxCardinality maxQualifiedCardinality members minCardinality
    minQualifiedCardinality onClass onDataRange onDatatype onProperty oneOf propertyChainAxiom propertyDisjointWith
    qualifiedCardinality sameAs someValuesFrom unionOf versionIRI withRestrictions"""
_BULK_PREDICATES = (
    *(RDF + name for name in _RDF_NAMES.split()),
    *(RDFS + name for name in _RDFS_NAMES.split()),
    *(OWL + name for name in _OWL_NAMES.split()),
    *map(dul, ("hasPart", "hasComponent", "isPartOf", "isComponentOf")),
    *map(soma, ("hasPhysicalComponent", "isPhysicalComponentOf")),
    *(CHILD, PARENT, DESCRIBED_IN_MAP),
    *POSE_PROPERTIES,
)
"""The properties that reasoning reads, that relate blank nodes, and from which members of maps are inferred."""
_FETCHING_WORD = re.compile(
    "service|from|load|define|insert|delete|clear|create|drop|copy|move|add|with", re.IGNORECASE
)
"""Keywords of SPARQL and of endpoints' extensions that fetch or change data. Matches other Unicode cases too."""
_BATCH_SIZE = 1000
"""The number of names in one request."""
_STATEMENTS_QUERY = """SELECT ?s ?p ?o ?g WHERE {
    %s { GRAPH ?g { ?s ?p ?o } } UNION { ?s ?p ?o FILTER NOT EXISTS { GRAPH ?other { ?s ?p ?o } } }
}"""
"""Statements with their graphs; each once, even if the default graph of the endpoint is the union of all graphs."""
_NAMED_GRAPH_QUERY = "CONSTRUCT {{ ?s ?p ?o }} WHERE {{ GRAPH {graph} {{ ?s ?p ?o }} }}"
_DEFAULT_GRAPH_QUERY = "CONSTRUCT { ?s ?p ?o } WHERE { ?s ?p ?o FILTER NOT EXISTS { GRAPH ?g { ?s ?p ?o } } }"


class HttpReply:
    """A successful response."""

    def __init__(self, media_type: str, body: bytes) -> None:
        self.media_type = media_type
        """The media type, without parameters."""
        self.body = body


class SparqlEndpoint:
    """The address of a SPARQL server; a connection is made for each request."""

    @checked
    def __init__(self, url: str, *, update_url: str | None = None, timeout_s: Timeout = 30.0) -> None:
        """Checks the addresses; sends nothing yet.

        Args:
            url: the query URL, such as `http://localhost:7878/query`; it may contain a user name and password.
            update_url: the update URL; by default `url` with `update` in place of a final `query` or `sparql`.
            timeout_s: the time limit of a request [s].

        Raises:
            InvalidArgumentError: an address is not a URL of HTTP.
        """
        self._url_parts = _parse_url(url)
        self._update_url_parts = _parse_url(update_url) if update_url else _update_url(self._url_parts)
        self.timeout_s = timeout_s

    def __str__(self) -> str:
        return _redacted_url(self._url_parts)

    @checked
    def query(
        self, query: str, *, accept: str = f"{JSON_RESULTS}, {N_TRIPLES}", timeout_s: Timeout | None = None
    ) -> HttpReply:
        """Sends a query.

        Raises:
            EndpointUnreachableError: the server does not respond, or not in time.
            EndpointError: the server refuses the query, or the response is too large.
        """
        return self._post(self._url_parts, {"query": query}, accept, timeout_s or self.timeout_s)

    def update(self, update: str) -> None:
        """Sends an update, which not all servers allow.

        Raises:
            EndpointUnreachableError: the server does not respond, or not in time.
            EndpointError: the server refuses the update.
        """
        self._post(self._update_url_parts, {"update": update}, "*/*", self.timeout_s)

    def _post(self, url_parts: SplitResult, fields: Mapping[str, str], accept: str, timeout_s: float) -> HttpReply:
        from http.client import HTTPException

        deadline = time.monotonic() + timeout_s
        connection = _connection(url_parts, timeout_s)
        headers = {"Accept": accept, "Content-Type": "application/x-www-form-urlencoded", "User-Agent": "mindstage"}
        if url_parts.username is not None:
            user = f"{unquote(url_parts.username)}:{unquote(url_parts.password or '')}"
            headers["Authorization"] = f"Basic {base64.b64encode(user.encode()).decode('ascii')}"
        try:
            target = urlunsplit(("", "", url_parts.path or "/", url_parts.query, ""))
            connection.request("POST", target, urlencode(fields).encode("ascii"), headers)
            _set_deadline(deadline, connection)
            response = connection.getresponse()
            kind = response.headers.get_content_type()
            limit = REPLY_LIMIT if response.status < 300 else _CHUNK_BYTES
            body = _read(response, connection, deadline, limit)
        except TimeoutError as error:
            raise EndpointUnreachableError(
                _redacted_url(url_parts), cause=f"no answer within {timeout_s:g} s"
            ) from error
        except (OSError, HTTPException) as error:
            raise EndpointUnreachableError(_redacted_url(url_parts), cause=_error_cause(error)) from error
        finally:
            connection.close()
        if len(body) > limit and limit == REPLY_LIMIT:
            cause = f"the reply is larger than {REPLY_LIMIT // 1024**2} MiB"
            raise EndpointError(_redacted_url(url_parts), cause=cause, remedy="ask for less")
        if not 200 <= response.status < 300:
            raise _http_error(url_parts, response, body)
        return HttpReply(kind, body)


def _read(
    response: http.client.HTTPResponse, connection: http.client.HTTPConnection, deadline: float, limit: int
) -> bytes:
    """The body, or slightly more than the limit of it."""
    from http.client import IncompleteRead

    body = bytearray()
    while len(body) <= limit:
        _set_deadline(deadline, connection)
        chunk = response.read1(_CHUNK_BYTES)
        if not chunk:
            break
        body += chunk
    if response.length:
        raise IncompleteRead(bytes(body[:0]), response.length)
    return bytes(body)


def _set_deadline(deadline: float, connection: http.client.HTTPConnection) -> None:
    remaining = deadline - time.monotonic()
    if remaining <= 0:
        raise TimeoutError
    if connection.sock is not None:  # else the server has closed the connection after the response
        connection.sock.settimeout(remaining)


def _connection(url_parts: SplitResult, timeout_s: float) -> http.client.HTTPConnection:
    import ssl
    from http.client import HTTPConnection, HTTPSConnection

    host = url_parts.hostname or ""
    if url_parts.scheme == "https":
        return HTTPSConnection(host, url_parts.port, timeout=timeout_s, context=ssl.create_default_context())
    return HTTPConnection(host, url_parts.port, timeout=timeout_s)


def _parse_url(url: str) -> SplitResult:
    remedy = "give one such as http://localhost:7878/query"
    try:
        parts = urlsplit(url)
        if parts.scheme in {"http", "https"} and parts.hostname and parts.port != 0:
            return parts
    except ValueError as error:
        raise InvalidArgumentError("the endpoint", cause=str(error), remedy=remedy) from error
    raise InvalidArgumentError(f"the endpoint {url!r}", cause="it is no address of HTTP", remedy=remedy)


def _update_url(url_parts: SplitResult) -> SplitResult:
    before, slash, last = url_parts.path.rpartition("/")
    return url_parts._replace(path=f"{before}{slash}update") if last in {"query", "sparql"} else url_parts


def _redacted_url(url_parts: SplitResult) -> str:
    """The URL without user name and password."""
    return urlunsplit(url_parts._replace(netloc=url_parts.netloc.rpartition("@")[2]))


def _http_error(url_parts: SplitResult, response: http.client.HTTPResponse, body: bytes) -> EndpointError:
    location = response.headers.get("Location")
    message = " ".join(body.decode("utf-8", "replace").split())[:_MAX_SHOWN]
    remedy = {
        401: "give a name and password in the address: http://NAME:PASSWORD@HOST/…",
        403: "the server denies access; ask its administrator",
        404: "is that the address where it takes SPARQL?",
        405: "is that the address where it takes SPARQL, and does it allow that?",
    }.get(response.status, f"it points to {location}; give that address, if you trust it" if location else "")
    cause = f"{response.status} {response.reason}" + (f": {message}" if message and message != response.reason else "")
    return EndpointError(_redacted_url(url_parts), cause=cause, remedy=remedy, status=response.status)


def _error_cause(error: Exception) -> str:
    from http.client import HTTPException, IncompleteRead

    if isinstance(error, IncompleteRead):
        return "the connection ended in the middle of the reply"
    if isinstance(error, HTTPException):
        return f"it does not speak HTTP ({type(error).__name__})"
    return (error.strerror if isinstance(error, OSError) else None) or str(error) or type(error).__name__


class SparqlEndpointStore:
    """A `TripleStore` of a local part, with the loaded sources, and an endpoint, which assertions are written to."""

    def __init__(self, endpoint: SparqlEndpoint) -> None:
        """Sends nothing yet."""
        self._endpoint = endpoint
        self._local = OxigraphStore()
        self._local_graphs: set[object] = {INFERRED_GRAPH}
        """The graphs of the local part."""
        self._cache = ox.Store()
        self._fetched: set[tuple[str, str]] = set()
        self._fetch_lock = threading.Lock()
        self._unassigned: set[ox.NamedNode | ox.DefaultGraph] = set()
        """The graphs of the endpoint whose members of maps are inferred."""

    def infer_membership(self) -> None:
        """Adds the membership in maps that is not stated at the endpoint to the local part, as for files.

        Raises:
            EndpointUnreachableError: the server does not respond, or not in time.
            EndpointError: the server refuses the request.
        """
        self._fetch("p", _BULK_PREDICATES)
        posed = {
            quad.graph_name
            for property in POSE_PROPERTIES
            for quad in self._cache.quads_for_pattern(None, ox.NamedNode(property), None)
        }
        for graph in posed:
            if isinstance(graph, ox.BlankNode):
                continue
            inferred = [quad for quad in self._inferred(self._fetch_graph(graph)) if not has_blank_node(quad)]
            self._local.extend(ox.Quad(quad.subject, quad.predicate, quad.object, graph) for quad in inferred)
            if inferred:
                self._unassigned.add(graph)

    def sources(self) -> list[Source]:
        """The graphs of the endpoint, sorted by name, as sources that worlds can be read from.

        Raises:
            EndpointUnreachableError: the server does not respond, or not in time.
            EndpointError: the server refuses the request.
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

    def terms_of(self, namespaces: Iterable[str]) -> list[Iri]:
        """The classes of individuals at the endpoint in some namespaces, and the properties of parts there; sorted.

        Raises:
            EndpointUnreachableError: the server does not respond, or not in time.
            EndpointError: the server refuses the request.
        """
        self._fetch("p", _BULK_PREDICATES)
        starts = " || ".join(f'STRSTARTS(STR(?term), "{namespace}")' for namespace in namespaces)
        query = f"SELECT DISTINCT ?term {{ {{ ?s a ?term }} UNION {{ ?s ?term ?o }} FILTER({starts}) }}"
        rows: Any = self._cache.query(query, use_default_graph_as_union=True)
        return sorted(Iri(row["term"].value) for row in rows if isinstance(row["term"], ox.NamedNode))

    # -- reading -------------------------------------------------------------------------------------------------------

    def quads_for_pattern(
        self,
        subject: SubjectNode | ox.Triple | None,
        predicate: ox.NamedNode | None,
        object: ObjectNode | None,
        graph_name: ox.NamedNode | ox.BlankNode | ox.DefaultGraph | None = None,
        /,
    ) -> Iterator[ox.Quad]:
        """All matching statements of one graph, or of all graphs; None matches everything.

        Raises:
            EndpointUnreachableError: the server does not respond, or not in time.
            EndpointError: the server refuses the request.
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

    def query(
        self,
        query: str,
        *,
        timeout_s: float,
        allow_service: bool = False,
        prefixes: Mapping[str, str] = PREFIXES,
        present: bytes | None = None,
    ) -> SparqlResult:
        """Sends a query to the endpoint; the sources that are loaded here are not queried.

        The endpoint may fetch what SERVICE and FROM name, so both need `allow_service`. A query that cannot be parsed
        here is sent for the endpoint's own error message, unless a word in it could make an endpoint fetch something.

        Raises:
            SparqlSyntaxError: the query is not valid or not allowed.
            SparqlTimeoutError: the time limit was exceeded.
            EndpointUnreachableError: the server does not respond.
            EndpointError: the server refuses the request.
        """
        if not timeout_s > 0:
            raise SparqlTimeoutError(timeout_s=timeout_s)
        if present is not None:
            cause = f"{self._endpoint} evaluates it, and does not contain the current state or episodes"
            remedy = "use the questions pose_of, where_is and articulated_parts, or load the map here"
            raise SparqlSyntaxError(cause, remedy=remedy)
        if not allow_service:
            self._require_no_fetching(query, timeout_s)
        prologue = "".join(f"PREFIX {name}: <{iri}> " for name, iri in prefixes.items() if f"{name}:" in query)
        try:
            reply = self._endpoint.query(prologue + query, timeout_s=timeout_s)
        except EndpointUnreachableError as error:
            if isinstance(error.__cause__, TimeoutError):
                raise SparqlTimeoutError(timeout_s=timeout_s) from error
            raise
        except EndpointError as error:
            if error.status == 400:
                raise SparqlSyntaxError(error.cause, remedy=f"the error was reported by {self._endpoint}") from error
            raise
        if reply.media_type == N_TRIPLES:
            return triples_table(self._parse(reply.body))
        try:
            return solutions_table(reply.body)
        except SyntaxError as error:
            raise self._invalid_reply(error) from error

    def _require_no_fetching(self, query: str, timeout_s: float) -> None:
        """Refuses a query that could make the endpoint access another server."""
        check_text(query, allow_service=False)
        try:
            clauses = self._local.clauses(query, timeout_s=timeout_s)
        except SparqlSyntaxError:
            if _FETCHING_WORD.search(query) or "\\u" in query.lower():
                raise
            return
        for clause in sorted(clauses, reverse=True):  # SERVICE first
            cause = f"it has {clause}, and {self._endpoint} may fetch what it names from another server"
            remedy = "allow it with --allow-service (in Python: allow_service=True)"
            raise SparqlSyntaxError(cause, remedy=remedy + (", or use GRAPH" if clause == "FROM" else ""))

    def _fetch(self, position: str, names: Iterable[str]) -> None:
        """Fetches all statements with one of the names at a position (s, p, o, or "" for all statements), once."""
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
        """An individual and all others in its map, which are likely to be needed next."""
        within = ox.NamedNode(DESCRIBED_IN_MAP)
        parts = (self._cache, self._local)
        maps = [quad.object for part in parts for quad in part.quads_for_pattern(individual, within, None)]
        found = (quad.subject for map in maps for part in parts for quad in part.quads_for_pattern(None, within, map))
        return list(
            dict.fromkeys([individual.value, *(node.value for node in found if isinstance(node, ox.NamedNode))])
        )

    def _fetch_graph(self, graph: ox.NamedNode | ox.DefaultGraph) -> bytes:
        """The statements of a graph of the endpoint in N-Triples, sorted."""
        query = _DEFAULT_GRAPH_QUERY if isinstance(graph, ox.DefaultGraph) else _NAMED_GRAPH_QUERY.format(graph=graph)
        # A server has no order of statements, and the order of bodies follows from it.
        data = b"\n".join(sorted(self._endpoint.query(query, accept=N_TRIPLES).body.splitlines())) + b"\n"
        for _ in self._parse(data):
            pass
        return data

    def _inferred(self, data: bytes) -> Iterator[ox.Quad]:
        """The statements about membership in maps that follow from a graph."""
        for subject, facts in inferred_membership(graph_from_quads(self._parse(data), set())).items():
            for fact in facts:
                if isinstance(fact.value, IriRef):
                    yield ox.Quad(node_from_label(subject), ox.NamedNode(fact.property), ox.NamedNode(fact.value.iri))

    def _read_graph(self, graph: ox.NamedNode | ox.DefaultGraph) -> SourceFile:
        data = self._fetch_graph(graph)
        if graph in self._unassigned:
            data += ox.serialize((quad.triple for quad in self._inferred(data)), format=ox.RdfFormat.N_TRIPLES) or b""
        return SourceFile(Path(str(self._endpoint)), data, ox.RdfFormat.N_TRIPLES)

    def _parse(self, data: bytes) -> Iterator[ox.Quad]:
        try:
            yield from ox.parse(data, ox.RdfFormat.N_TRIPLES)
        except SyntaxError as error:
            raise self._invalid_reply(error) from error

    def _invalid_reply(self, error: Exception) -> EndpointError:
        remedy = "is that the address where it takes SPARQL?"
        return EndpointError(str(self._endpoint), cause=f"its reply is not in a SPARQL format: {error}", remedy=remedy)

    # -- loaded sources ------------------------------------------------------------------------------------------------

    def load(self, data: bytes, format: ox.RdfFormat, *, base_iri: str, to_graph: ox.NamedNode) -> None:
        """Parses a document into a graph of the local part.

        Raises:
            SyntaxError: the document is not in that format; nothing was added.
        """
        self._local.load(data, format, base_iri=base_iri, to_graph=to_graph)
        self._local_graphs.add(to_graph)

    def remove_graph(self, graph: ox.NamedNode | ox.DefaultGraph, /) -> None:
        """Removes all statements of a graph of the local part."""
        self._local.remove_graph(graph)
        self._local_graphs -= {graph} - {INFERRED_GRAPH}

    # -- assertions ----------------------------------------------------------------------------------------------------

    def add(self, quad: ox.Quad, /) -> None:
        """Adds a statement at the endpoint.

        Raises:
            EndpointUnreachableError: the server does not respond, or not in time.
            EndpointError: the server refuses the request.
        """
        self.extend([quad])

    def extend(self, quads: Iterable[ox.Quad], /) -> None:
        """Adds statements with common blank nodes at the endpoint; materialized statements stay in the local part.

        Raises:
            EndpointUnreachableError: the server does not respond, or not in time.
            EndpointError: the server refuses the request.
        """
        all_quads = list(quads)
        self._local.extend(quad for quad in all_quads if quad.graph_name == INFERRED_GRAPH)
        asserted = [quad for quad in all_quads if quad.graph_name != INFERRED_GRAPH]
        if not asserted:
            return
        parts = " ".join(_in_graph(quad, f"{quad.subject} {quad.predicate} {quad.object} .") for quad in asserted)
        self._endpoint.update(f"INSERT DATA {{ {parts} }}")
        self._cache.extend(asserted)

    def remove(self, quad: ox.Quad, /) -> None:
        """Removes a statement at the endpoint; a blank node is identified there by its statements.

        Raises:
            InvalidArgumentError: the statement is in a source that is loaded here.
            EndpointUnreachableError: the server does not respond, or not in time.
            EndpointError: the server refuses the request.
        """
        if next(self._local.quads_for_pattern(quad.subject, quad.predicate, quad.object, quad.graph_name), None):
            raise InvalidArgumentError(
                f"{quad.subject} {quad.predicate}",
                cause="it is in a source that is loaded here, such as the bundled ontology, and not at the endpoint",
                remedy="to use the endpoint's statements only, give --no-bundled-ontology",
            )
        names: dict[ox.BlankNode, str] = {}
        pattern = " ".join(_sparql_pattern(self._cache, quad, names, (f"?b{number}" for number in count())))
        taken = f"{_sparql_term(quad.subject, names)} {quad.predicate} {_sparql_term(quad.object, names)} ."
        blank = " ".join(f"FILTER isBlank({name})" for name in names.values())
        where = _in_graph(quad, f"{pattern} {blank}")
        self._endpoint.update(f"DELETE {{ {_in_graph(quad, taken)} }} WHERE {{ {where} }}")
        self._cache.remove(quad)

    def close(self) -> None:
        """Drops everything that was fetched and loaded."""
        self._local.close()
        self._cache = ox.Store()
        self._fetched.clear()


def _in_graph(quad: ox.Quad, statements: str) -> str:
    return statements if isinstance(quad.graph_name, ox.DefaultGraph) else f"GRAPH {quad.graph_name} {{ {statements} }}"


def _sparql_pattern(
    store: ox.Store, quad: ox.Quad, names: dict[ox.BlankNode, str], variables: Iterator[str]
) -> Iterator[str]:
    """A statement and all statements about the blank nodes in it, with variables for these."""
    new = [node for node in (quad.subject, quad.object) if isinstance(node, ox.BlankNode) and node not in names]
    names.update((node, next(variables)) for node in new)
    yield f"{_sparql_term(quad.subject, names)} {quad.predicate} {_sparql_term(quad.object, names)} ."
    for node in new:
        for more in store.quads_for_pattern(node, None, None, quad.graph_name):
            if more != quad:
                yield from _sparql_pattern(store, more, names, variables)


def _sparql_term(node: object, names: dict[ox.BlankNode, str]) -> str:
    return names[node] if isinstance(node, ox.BlankNode) else str(node)
