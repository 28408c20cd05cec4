"""SPARQL queries on a store in memory."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from mindstage.errors import NumberRefusedError, SparqlSyntaxError, SparqlTimeoutError, StoreError
from mindstage.knowledge import KnowledgeBase, sparql_worker
from mindstage.knowledge.store import QueryWorkerPool
from mindstage.rdf import RdfTerm
from tests.cases import each_case
from tests.maps.small_maps import KNOWROB, XSD

ENDLESS = "SELECT (COUNT(*) AS ?n) WHERE { ?a ?b ?c . ?d ?e ?f . ?g ?h ?i }"
HOARDING = "SELECT DISTINCT ?a ?d ?g WHERE { ?a ?b ?c . ?d ?e ?f . ?g ?h ?i } ORDER BY ?g"
OVERFLOWING = "SELECT * WHERE { ?a ?b ?c . ?d ?e ?f . ?g ?h ?i }"
SERVICE = "SELECT * { SERVICE <http://127.0.0.1:9/none> { ?s ?p ?o } }"


@pytest.fixture(scope="module")
def kb() -> KnowledgeBase:
    return KnowledgeBase()


def test_select_gives_columns_and_rows(kb: KnowledgeBase) -> None:
    table = kb.sparql("SELECT ?super ?none WHERE { knowrob:Refrigerator rdfs:subClassOf ?super FILTER isIRI(?super) }")
    assert table.columns == ("super", "none")
    assert (RdfTerm("iri", f"{KNOWROB}Box-Container"), None) in table.rows
    assert table.boolean is None


def test_ask_gives_a_boolean(kb: KnowledgeBase) -> None:
    assert kb.sparql("ASK { knowrob:Bread rdfs:subClassOf+ knowrob:Perishable }").boolean is True
    assert kb.sparql("ASK { knowrob:Perishable rdfs:subClassOf+ knowrob:Bread }").boolean is False


def test_construct_gives_triples_each_once(kb: KnowledgeBase) -> None:
    table = kb.sparql("CONSTRUCT { ?s a owl:Class } WHERE { ?s a owl:Class . ?s rdfs:label ?l . ?s ?p ?o }")
    assert table.columns == ("subject", "predicate", "object")
    assert len(table.rows) == len(set(table.rows)) > 100


def test_literals_keep_their_type_and_language(kb: KnowledgeBase) -> None:
    ((label,),) = kb.sparql("SELECT ?l { knowrob:Refrigerator rdfs:label ?l }").rows
    assert label is not None
    assert (label.kind, label.language) == ("literal", "en")
    assert kb.sparql("SELECT (1 AS ?n) {}").rows == ((RdfTerm("literal", "1", f"{XSD}integer"),),)


@pytest.mark.parametrize("query", ["", "SELEC ?x", "SELECT ?x WHERE { nowhere:x ?y ?x }"])
def test_a_syntax_error_is_reported_with_its_position(query: str, kb: KnowledgeBase) -> None:
    with pytest.raises(
        SparqlSyntaxError, match=r"^the query cannot be answered: error at .{1,60}; it must be .* of SPARQL 1\.1$"
    ):
        kb.sparql(query)


@pytest.mark.parametrize(
    "update",
    [
        "INSERT DATA { <a:a> <a:b> <a:c> }",
        "# SELECT\nPREFIX a: <b:b> BASE <c:c>\n delete where { ?a ?b ?c }",
        "LOAD <file:///etc/passwd>",
        "DROP ALL",
    ],
)
def test_updates_are_refused_by_name(update: str, kb: KnowledgeBase) -> None:
    before = kb.sparql("SELECT (COUNT(*) AS ?n) { ?a ?b ?c }")
    with pytest.raises(SparqlSyntaxError, match=r"it is an update \([A-Z]+\), and queries only read; .* tell"):
        kb.sparql(update)
    assert kb.sparql("SELECT (COUNT(*) AS ?n) { ?a ?b ?c }") == before


# -- other servers -----------------------------------------------------------------------------------------------------


@each_case(
    "query",
    [
        SERVICE,
        "select*{service<http://127.0.0.1:9/>{?s ?p ?o}}",
        "SELECT * { SERVICE SILENT ?where { ?s ?p ?o } }",
        "SELECT * { ?s ?p ?o.SERVICE<http://127.0.0.1:9/>{ } }",
        "PREFIX : <http://127.0.0.1:9/> SELECT * { SERVICE:none { ?s ?p ?o } }",
        "PREFIX p: <p:p> SELECT * { ?s ?p p:a\\# SERVICE <http://127.0.0.1:9/> { } \n }",
        'SELECT * { ?s ?p "it\\"s" . SERVICE <http://127.0.0.1:9/> { ?s ?p "" } }',
        "SELECT * { \\u0053ERVICE <http://127.0.0.1:9/> { ?s ?p ?o } }",
        "# <\nSELECT * { SERVICE <http://127.0.0.1:9/> { ?s ?p ?o } }",
    ],
)
def test_service_is_refused_unless_allowed(query: str, kb: KnowledgeBase) -> None:
    with pytest.raises(SparqlSyntaxError, match=r"it asks another server \(SERVICE\).*--allow-service"):
        kb.sparql(query)


@each_case(
    "query",
    [
        'ASK { ?s ?p "SERVICE <x>" }',
        "ASK { ?s ?p 'SERVICE' } # SERVICE <x>",
        'ASK { ?s ?p """ " SERVICE """ }',
        "ASK { ?service ?SERVICE <http://e.org/SERVICE> }",
        "PREFIX e: <e:e> ASK { ?s e:SERVICE e:a.SERVICE }",
        'ASK { ?s ?p "x"@service }',
        "ASK { ?s ?p ?o FILTER(1 <2 && ?o> 3) }",
    ],
)
def test_the_word_service_is_harmless_elsewhere(query: str, kb: KnowledgeBase) -> None:
    assert kb.sparql(query).boolean is not None


def test_an_unreachable_service_is_named_as_the_cause(kb: KnowledgeBase) -> None:
    with pytest.raises(SparqlSyntaxError, match=r"the query cannot be answered: .+") as refused:
        kb.sparql(SERVICE, allow_service=True)
    assert "SELECT, ASK" not in str(refused.value)


# -- limits ------------------------------------------------------------------------------------------------------------


def test_an_endless_query_is_stopped(kb: KnowledgeBase) -> None:
    before = workers()
    with pytest.raises(SparqlTimeoutError, match=r"did not end within 0\.05 s"):
        kb.sparql(ENDLESS, timeout_s=0.05)
    assert workers() <= before, "nothing burns on"
    assert kb.sparql("ASK {}").boolean, "and the next one is answered"


def test_an_endless_query_ends_after_its_parent_died(tmp_path: Path) -> None:
    script = f"""
import os, threading, time
from mindstage.knowledge import KnowledgeBase
kb = KnowledgeBase()
threading.Thread(target=kb.sparql, args=({ENDLESS!r},), kwargs=dict(timeout_s=2.0), daemon=True).start()
children = lambda: open(f"/proc/{{os.getpid()}}/task/{{os.getpid()}}/children").read() + "".join(
    open(f"/proc/{{os.getpid()}}/task/{{task}}/children").read() for task in os.listdir(f"/proc/{{os.getpid()}}/task"))
while not children().strip():
    time.sleep(0.01)
print(children().split()[0], flush=True)
os.kill(os.getpid(), 9)
"""
    done = subprocess.run([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True, timeout=120, check=False)
    worker = Path("/proc", done.stdout.strip())
    assert done.stdout.strip()
    assert ended(lambda: not worker.exists() or " Z " in (worker / "stat").read_text())


def test_a_query_with_too_much_memory_is_stopped(kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sparql_worker, "MEMORY_LIMIT", 64 * 1024**2)
    kb.tell("ms:Second", "subClassOf", "Tool")  # so that the next query has a new process
    with pytest.raises(SparqlSyntaxError, match=r"it needs more than .* of memory; ask for less"):
        kb.sparql(HOARDING, timeout_s=120.0)


def test_an_answer_that_is_too_large_is_refused(kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sparql_worker, "REPLY_LIMIT", 1024**2)
    kb.tell("ms:Third", "subClassOf", "Tool")
    with pytest.raises(SparqlSyntaxError, match=r"its answer is larger than .* MiB; ask for less \(LIMIT"):
        kb.sparql(OVERFLOWING, timeout_s=120.0)


@pytest.mark.parametrize("timeout_s", [0.0, -1.0, float("nan"), float("inf")])
def test_a_timeout_of_zero_or_without_an_end_is_an_error(timeout_s: float, kb: KnowledgeBase) -> None:
    with pytest.raises((SparqlTimeoutError, NumberRefusedError)):
        kb.sparql("ASK {}", timeout_s=timeout_s)


def test_a_timeout_of_a_day_is_allowed(kb: KnowledgeBase) -> None:
    assert kb.sparql("ASK {}", timeout_s=86_400.0).boolean


# -- workers -----------------------------------------------------------------------------------------------------------


def test_a_query_sees_a_statement_asserted_just_before(kb: KnowledgeBase) -> None:
    ask = "ASK { ms:Rack rdfs:subClassOf ms:Tool }"
    assert not kb.sparql(ask).boolean
    kb.tell("ms:Rack", "subClassOf", "Tool")
    assert kb.sparql(ask).boolean
    kb.retract("Rack", "subClassOf", "Tool")
    assert not kb.sparql(ask).boolean


def test_several_threads_can_query_at_once(kb: KnowledgeBase) -> None:
    with ThreadPoolExecutor(4) as threads:
        queries = [f"SELECT ({number} AS ?n) {{ knowrob:Bread a ?c }} LIMIT 1" for number in range(20)]
        tables = list(threads.map(kb.sparql, queries))
    assert [table.rows[0][0].value for table in tables if table.rows[0][0]] == [str(number) for number in range(20)]


def test_worker_processes_end_with_their_knowledge_base() -> None:
    before = workers()
    with KnowledgeBase() as kb:
        assert kb.sparql("ASK {}").boolean
        assert len(workers()) == len(before) + 1
    assert workers() <= before
    with pytest.raises(StoreError, match="it is closed; open it again"):
        kb.sparql("ASK {}")


def workers() -> set[str]:
    """The ids of the running child processes."""
    tasks = Path("/proc/self/task")
    if not tasks.is_dir():
        pytest.skip("only Linux lists the children of a process")
    found: set[str] = set()
    for task in tasks.iterdir():
        with suppress(FileNotFoundError):  # a thread that has just ended
            found |= set((task / "children").read_text().split())
    return found


def ended(condition: Callable[[], bool]) -> bool:
    """Waits until a condition holds, at most for a minute."""
    deadline = time.monotonic() + 60.0
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.02)
    return True


class RecordedWorker:
    """Instead of a process: the store changes while the first query runs."""

    def __init__(self, pool: QueryWorkerPool) -> None:
        self.pool, self.is_killed = pool, False

    def query(self, query: str, timeout_s: float, *, check_only: bool, prefixes: object) -> tuple[str, bytes]:
        if query == "slow":
            self.pool.discard_all()
        return query, b""

    def kill(self) -> int:
        self.is_killed = True
        return 0


def test_a_worker_with_an_old_state_of_the_store_is_not_used_again() -> None:
    pool, started = QueryWorkerPool(), list[RecordedWorker]()

    def start() -> Any:
        started.append(RecordedWorker(pool))
        return started[-1]

    for query in ("quick", "quick", "slow", "quick", "quick"):
        assert pool.query(query, 1.0, check_only=False, start_worker=start) == (query, b"")
    assert [each.is_killed for each in started] == [True, False]
