"""No SPARQL query reaches another server unless it is allowed: a server counts the requests of generated queries."""

from __future__ import annotations

import http.server
import json
import os
import re
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import ClassVar

import pyoxigraph as ox
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mindstage.errors import SparqlSyntaxError
from mindstage.knowledge import KnowledgeBase, sparql_worker
from mindstage.knowledge.endpoint import SparqlEndpoint, SparqlEndpointStore
from mindstage.knowledge.store import OxigraphStore
from mindstage.sandbox import deny_network

GRAPH_A, GRAPH_B = "http://graphs.example/a", "http://graphs.example/b"


class _CountingHandler(http.server.BaseHTTPRequestHandler):
    """Answers every query with one solution, as an internal server would."""

    requests: ClassVar[list[str]] = []

    def do_GET(self) -> None:
        self.requests.append(self.path)
        solution = {"secret": {"type": "literal", "value": "x"}}
        body = json.dumps({"head": {"vars": ["secret"]}, "results": {"bindings": [solution]}}).encode()
        self.send_response(200)
        self.send_header("Content-Type", "application/sparql-results+json")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    do_POST = do_GET  # noqa: N815

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture(scope="module")
def internal() -> Iterator[str]:
    """The URL of a server that nobody may ask."""
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), _CountingHandler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()


@pytest.fixture(scope="module")
def store() -> Iterator[OxigraphStore]:
    store = OxigraphStore()
    for graph in (GRAPH_A, GRAPH_B):
        node = ox.NamedNode(graph)
        store.add(ox.Quad(node, ox.NamedNode("http://p.example/is"), ox.Literal(graph[-1]), node))
    yield store
    store.close()


@pytest.fixture
def unguarded(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leaves the parser's decision alone: sockets are not denied to the workers."""
    monkeypatch.setattr(sparql_worker, "deny_network", lambda *, no_new_files: False)


BYPASSES = (
    "SELECT * { SERVICE <{url}> {{ ?a ?b ?c }} }",
    "PREFIX ex: <{url}> SELECT * {{ SERVICEex:b {{ ?a ?b ?c }} }}",
    "SELECT * {{ ?s ?p 1SERVICE <{url}> {{ ?a ?b ?c }} }}",
    "SELECT * {{ ?s ?p trueSERVICE<{url}>{{ ?a ?b ?c }} }}",
    "SELECT * {{ SERVICESILENT <{url}> {{ ?a ?b ?c }} }}",
    "SELECT * {{ servicesilent<{url}>{{}} }}",
    "SELECT * {{ ?s ?p 'x'@enSERVICE <{url}> {{ }} }}",
    "SELECT * {{ {{ SELECT * {{ SERVICE <{url}> {{ ?a ?b ?c }} }} }} }}",
    "SELECT * {{ FILTER EXISTS {{ SERVICE <{url}> {{ ?a ?b ?c }} }} }}",
    "SELECT * {{ BIND(EXISTS {{SERVICE<{url}>{{}}}} AS ?x) }}",
    "ASK {{ MINUS {{ VALUES ?w {{ <{url}> }} SERVICE ?w {{ ?a ?b ?c }} }} }}",
    "ASK {{ VALUES ?w {{ <{url}> }} SERVICE SILENT ?w {{ ?a ?b ?c }} }}",
    "ASK {{ \\u0053ERVICE <{url}> {{ ?a ?b ?c }} }}",
    "ASK {{ \\U00000053ERVICE <{url}> {{ ?a ?b ?c }} }}",
    "ASK {{ # <\nSERVICE#>\n<{url}> {{ ?a ?b ?c }} }}",
    "ASK {{ ?a ?b ?c FILTER(?a<?b||?c>?a)SERVICE<{url}>{{}} }}",
    "CONSTRUCT {{ ?a ?b ?c }} {{ SERVICE <{url}> {{ ?a ?b ?c }} }}",
    "DESCRIBE ?a {{ SERVICE <{url}> {{ ?a ?b ?c }} }}",
    "BASE <{url}> ASK {{ SERVICE <> {{ }} }}",
    "PREFIX SERVICE: <{url}> ASK {{ SERVICESERVICE:x {{ }} }}",
    "PREFIX SERVICEx: <{url}> ASK {{ [ ?p ?o ] SERVICEx:y {{ }} }}",
    "PREFIX x: <{url}> PREFIX SERVICEx: <{url}> ASK {{ ?s ?p 1 SERVICEx:y {{ }} }}",
    "LOAD <{url}>",
    "LOAD SILENT <{url}> INTO GRAPH <{url}>",
    "INSERT {{ ?a ?b ?c }} WHERE {{ SERVICE <{url}> {{ ?a ?b ?c }} }}",
    "SELECT * FROM <{url}> {{ ?a ?b ?c }}",
    "SELECT * FROM NAMED <{url}> {{ GRAPH <{url}> {{ ?a ?b ?c }} }}",
)


@pytest.mark.parametrize("query", BYPASSES)
def test_no_known_bypass_reaches_a_server(query: str, internal: str, store: OxigraphStore, unguarded: None) -> None:
    text = query.replace("{url}", internal).replace("{{", "{").replace("}}", "}")
    _CountingHandler.requests.clear()
    try:
        found = store.query(text, timeout_s=30.0)
    except SparqlSyntaxError:
        pass
    else:
        assert "FROM" in text
        assert found.rows == ()
    assert _CountingHandler.requests == []


def test_the_counting_server_is_reached_if_it_is_allowed(internal: str, store: OxigraphStore) -> None:
    _CountingHandler.requests.clear()
    found = store.query(f"SELECT * {{ SERVICE <{internal}> {{ ?a ?b ?c }} }}", timeout_s=30.0, allow_service=True)
    assert _CountingHandler.requests
    assert len(found.rows) == 1


# -- fuzzing -----------------------------------------------------------------------------------------------------------

URL = "<URL>"
_space = st.sampled_from(["", "", " ", "\n", "#c\n", "# <\n", "#'\n", "\t"])
_service_word = st.sampled_from(
    ["SERVICE", "service", "SeRvIcE", "SERVICE SILENT", "SERVICESILENT", "servicesilent ", "\\u0053ERVICE",
     "SER\\u0056ICE", "\\U00000073ervice", "SERVI\\u0043E", "\u017fERVICE", "SERV\u0130CE"]
)  # fmt: skip
_iri = st.sampled_from([URL, URL, "ex:b", ":b", "SERVICE:b", "SERVICEex:b", "?w", "<>", "ex:", ":"])
_term = st.one_of(
    st.sampled_from(
        ["?s", "$p", "?service", "?SERVICE", "<http://e/SERVICE>", "ex:SERVICE", "ex:a.SERVICE", "SERVICE:x",
         "_:SERVICE", "1", "1.", "1.5", "1e5", "true", "false", "[]", "()", "'SERVICE'", '"it\\"s"',
         "'''SERVICE '' x'''",
         '"""a " SERVICE """', "'x'@en", "'x'@service", "'1'^^ex:SERVICE",
         "ex:a\\#", "ex:%53ERVICE", "a",
         "'\\u0053ERVICE'", "'\\u0027 . '", "<http://e/\\u0053ERVICE>", "<<( ?s ?p ?o )>>"]
    ),
    _iri,
)  # fmt: skip
_expression = st.sampled_from(
    ["?a<?b", "?a<?b&&?c>?a", "(1 <2 && ?o> 3)", "'SERVICE'='x'", "EXISTS{GROUP}", "NOT EXISTS {GROUP}",
     "ex:SERVICE('x')", "STR(?s)='#'", "?a IN (1,2)", "REGEX(?s,'SERVICE')", "EXISTS{SERVICE<URL>{}}", "IF(true,1,2)"]
)  # fmt: skip


def _joined(*parts: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    return st.tuples(*(each for part in parts for each in (part, _space))).map("".join)


_triple = _joined(_term, _term, _term, st.sampled_from(["", ".", ";", ",", ". ."]))
_service = _joined(_service_word, _iri, st.just("{"), st.sampled_from(["", "?a ?b ?c", "SELECT * {}"]), st.just("}"))


def _group(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    body = st.lists(
        st.one_of(
            _triple,
            _service,
            inner,
            _joined(st.sampled_from(["OPTIONAL", "MINUS", "GRAPH ?g", "GRAPH SERVICE:x", "union"]), inner),
            _joined(st.just("FILTER("), _expression, st.just(")")),
            _joined(st.just("BIND("), _expression, st.just("AS ?x"), st.just(")")),
            _joined(st.just("VALUES ?w {"), _iri, st.just("}")),
            _joined(st.just("{SELECT * "), inner, st.just("}")),
        ),
        max_size=3,
    )
    return st.tuples(body, _space).map(lambda parts: "{" + parts[1].join(parts[0]) + "}")


_groups = st.recursive(st.just("{}") | _group(st.just("{}")), _group, max_leaves=4)
_prefixes = ("ex:", ":", "SERVICE:", "SERVICEex:")
_prologue = st.lists(
    st.sampled_from([*(f"PREFIX {prefix} <URL_>" for prefix in _prefixes), "BASE <URL_>"]), unique=True
).map(" ".join)
_dataset = st.sampled_from(["", "", "", "FROM <URL_>", "FROM NAMED <URL_>", "FROM SERVICE:b ", "from<URL_>"])
_form = st.sampled_from(
    ["SELECT *", "SELECT ?from ?service", "ASK", "DESCRIBE *", "CONSTRUCT {?a ?b ?c}", "SELECT(1 AS ?x)"]
)
_query = st.one_of(
    _joined(_prologue, _form, _dataset, st.sampled_from(["", "WHERE"]), _groups, st.sampled_from(["", "LIMIT 3"])),
    _joined(_prologue, st.sampled_from(["LOAD", "LOAD SILENT", "load"]), _iri),
    _joined(_prologue, st.just("INSERT {} WHERE"), _groups),
)


@settings(max_examples=700, deadline=None, suppress_health_check=list(HealthCheck))
@given(query=_query, group=_groups)
def test_no_generated_query_reaches_a_server(query: str, group: str, internal: str, store: OxigraphStore) -> None:
    text = query.replace("GROUP", group).replace("URL_", internal).replace("URL", internal)
    _CountingHandler.requests.clear()
    with suppress(SparqlSyntaxError):
        store.query(text, timeout_s=30.0)
    assert _CountingHandler.requests == [], text


@pytest.fixture(autouse=True)
def _fuzz_without_guard(request: pytest.FixtureRequest) -> None:
    if "generated" in request.node.name:
        request.getfixturevalue("unguarded")


class _RecordingEndpoint(SparqlEndpoint):
    """Stands for another vendor's endpoint, whose parser reads the text that it is sent."""

    def __init__(self) -> None:
        super().__init__("http://endpoint.example/query")
        self.sent: list[str] = []

    def query(self, query: str, *, accept: str = "", timeout_s: float | None = None) -> object:  # type: ignore[override]
        self.sent.append(query)
        raise SparqlSyntaxError("not answered here")


@settings(max_examples=250, deadline=None, suppress_health_check=list(HealthCheck))
@given(query=_query, group=_groups)
def test_no_generated_query_with_service_is_sent_to_an_endpoint(query: str, group: str) -> None:
    text = query.replace("GROUP", group).replace("URL_", "http://h/").replace("URL", "http://h/")
    endpoint = _RecordingEndpoint()
    store = _endpoint_store(endpoint)
    with suppress(SparqlSyntaxError):
        store.query(text, timeout_s=30.0)
    for sent in endpoint.sent:
        assert not _tokens(sent) & {"SERVICE", "SERVICESILENT", "FROM", "LOAD", "INSERT"}, sent


def _endpoint_store(endpoint: SparqlEndpoint, *, _kept: list[SparqlEndpointStore] = []) -> SparqlEndpointStore:  # noqa: B006
    """One store for all examples, since each has a worker process."""
    if not _kept:
        _kept.append(SparqlEndpointStore(endpoint))
    _kept[0]._endpoint = endpoint
    return _kept[0]


_TOKEN = re.compile(
    r'''\s+|\#[^\n\r]*|<[^<>"{}|^`\\\x00-\x20]*>|"""(?:"{0,2}(?:[^"\\]|\\.))*"""|\'\'\'(?:'{0,2}(?:[^'\\]|\\.))*\'\'\''''
    r"""|"(?:[^"\\\n\r]|\\.)*"|'(?:[^'\\\n\r]|\\.)*'|@[a-zA-Z]+(?:-[a-zA-Z0-9]+)*|[?$]\w+|_:[\w.-]+"""
    r"""|[^\W\d_]?[\w.-]*:(?:[\w.:-]|%[0-9A-Fa-f]{2}|\\.)*|\d+\.?\d*(?:[eE][+-]?\d+)?|[A-Za-z]+|.""",
    re.DOTALL,
)
"""The terminals of SPARQL 1.1, section 19.8, the longest match first, as a tokenizer in another parser has them."""


def _tokens(query: str) -> set[str]:
    return {token.upper() for token in _TOKEN.findall(query) if token.isalpha()}


# -- the operating system's own limit ----------------------------------------------------------------------------------


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such limits")
def test_a_worker_cannot_open_a_connection(internal: str) -> None:
    """With the parser's decision switched off, the process itself is refused the socket."""
    store = OxigraphStore()
    _CountingHandler.requests.clear()
    answer = sparql_worker._answer
    try:
        sparql_worker._answer = lambda store, query, prefixes, *, allow_service: answer(  # type: ignore[assignment]
            store, query, prefixes, allow_service=True
        )
        with pytest.raises(SparqlSyntaxError, match="the query cannot be answered"):
            store.query(f"SELECT * {{ SERVICE <{internal}> {{ ?a ?b ?c }} }}", timeout_s=30.0)
    finally:
        sparql_worker._answer = answer
        store.close()
    assert _CountingHandler.requests == []


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux filters system calls")
def test_the_filter_of_system_calls_denies_sockets_and_allows_files(tmp_path: Path) -> None:
    if os.uname().machine not in {"x86_64", "aarch64"}:
        pytest.skip(f"no system calls are listed for {os.uname().machine}")
    reading, writing = os.pipe()
    if (child := os.fork()) == 0:
        report = "no filter"
        try:
            if deny_network(no_new_files=False):
                (tmp_path / "file").write_text("allowed")
                socket.socket()
                report = "a socket was opened"
        except OSError as error:
            report = f"{type(error).__name__} {(tmp_path / 'file').read_text()}"
        finally:
            os.write(writing, report.encode())
            os._exit(0)
    os.waitpid(child, 0)
    os.close(writing)
    with os.fdopen(reading) as report_file:
        assert report_file.read() == "PermissionError allowed"


def test_a_store_on_disk_is_queried_without_network(tmp_path: Path, internal: str) -> None:
    _CountingHandler.requests.clear()
    with KnowledgeBase(store=tmp_path / "kitchen", bundled_ontology=False) as kb:
        with pytest.raises(SparqlSyntaxError, match="SERVICE"):
            kb.sparql(f"PREFIX ex: <{internal}> SELECT * {{ SERVICEex:b {{ ?a ?b ?c }} }}")
        assert kb.sparql("ASK {}").boolean
        assert kb.sparql(f"ASK {{ SERVICE <{internal}> {{ }} }}", allow_service=True).boolean
    assert len(_CountingHandler.requests) == 1


# -- FROM --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("query", "values"),
    [
        ("SELECT ?o { ?s ?p ?o }", {"a", "b"}),
        (f"SELECT ?o FROM <{GRAPH_A}> {{ ?s ?p ?o }}", {"a"}),
        (f"SELECT ?o FROM <{GRAPH_A}> FROM <{GRAPH_B}> {{ ?s ?p ?o }}", {"a", "b"}),
        (f"SELECT ?o FROM NAMED <{GRAPH_B}> {{ GRAPH ?g {{ ?s ?p ?o }} }}", {"b"}),
        (f"SELECT ?o FROM NAMED <{GRAPH_B}> {{ ?s ?p ?o }}", set()),
        ("SELECT ?o FROM <http://graphs.example/none> { ?s ?p ?o }", set()),
        ("SELECT ?o { ?s ?p ?o FILTER(?o != 'FROM' && ?o != '\\u0046ROM') } # FROM", {"a", "b"}),
    ],
)
def test_from_selects_graphs_of_the_store(query: str, values: set[str], store: OxigraphStore) -> None:
    found = store.query(query, timeout_s=30.0)
    assert {row[0].value for row in found.rows if row[0]} == values


# -- endpoints ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "query",
    [
        "SELECT * FROM <http://h/x> { ?s ?p ?o }",
        "ASK { ?s ?p 1SERVICE <http://h/> { } }",
        "PREFIX ex: <http://h/> ASK { SERVICEex:b { } }",
        'DEFINE get:soft "replace" SELECT * { ?s ?p ?o }',
        "SELECT * { \\u0053ERVICE <http://h/> { } }",
        "SELECT * { \u017fERVICE <http://h/> { } }",
    ],
)
def test_an_endpoint_is_sent_nothing_that_it_may_fetch(query: str) -> None:
    endpoint = _RecordingEndpoint()
    with pytest.raises(SparqlSyntaxError) as refused:
        SparqlEndpointStore(endpoint).query(query, timeout_s=30.0)
    assert endpoint.sent == []
    assert "not answered here" not in str(refused.value)


def test_an_endpoint_is_sent_everything_that_is_allowed() -> None:
    endpoint = _RecordingEndpoint()
    for query, allowed in (("SELECT * { SERVICE <http://h/> { } }", True), ("ASK { ?service a 'SERVICE' }", False)):
        with pytest.raises(SparqlSyntaxError, match="not answered here"):
            SparqlEndpointStore(endpoint).query(query, timeout_s=30.0, allow_service=allowed)
    assert len(endpoint.sent) == 2
