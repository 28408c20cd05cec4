"""SPARQL straight on the store."""

from __future__ import annotations

import pytest

from mindstage.errors import QueryRefused, QueryTimedOut
from mindstage.knowledge import KnowledgeBase, Term
from tests.knowledge.maps import KNOWROB, XSD

LONG = "SELECT (COUNT(*) AS ?n) WHERE { ?a ?b ?c . ?d ?e ?f }"
"""Takes seconds, not for ever: nobody can stop it, and other tests want the processor."""


@pytest.fixture(scope="module")
def kb() -> KnowledgeBase:
    return KnowledgeBase()


def test_select_gives_columns_and_rows(kb: KnowledgeBase) -> None:
    table = kb.sparql("SELECT ?super ?none WHERE { knowrob:Refrigerator rdfs:subClassOf ?super FILTER isIRI(?super) }")
    assert table.columns == ("super", "none")
    assert (Term("iri", f"{KNOWROB}Box-Container"), None) in table.rows
    assert table.truth is None


def test_ask_gives_a_truth(kb: KnowledgeBase) -> None:
    assert kb.sparql("ASK { knowrob:Bread rdfs:subClassOf+ knowrob:Perishable }").truth is True
    assert kb.sparql("ASK { knowrob:Perishable rdfs:subClassOf+ knowrob:Bread }").truth is False


def test_construct_gives_triples_each_once(kb: KnowledgeBase) -> None:
    table = kb.sparql("CONSTRUCT { ?s a owl:Class } WHERE { ?s a owl:Class . ?s rdfs:label ?l . ?s ?p ?o }")
    assert table.columns == ("subject", "predicate", "object")
    assert len(table.rows) == len(set(table.rows)) > 100


def test_literals_keep_their_type_and_language(kb: KnowledgeBase) -> None:
    ((label,),) = kb.sparql("SELECT ?l { knowrob:Refrigerator rdfs:label ?l }").rows
    assert label is not None
    assert (label.kind, label.language) == ("literal", "en")
    assert kb.sparql("SELECT (1 AS ?n) {}").rows == ((Term("literal", "1", f"{XSD}integer"),),)


@pytest.mark.parametrize(
    "query", ["", "SELEC ?x", "SELECT ?x WHERE { nowhere:x ?y ?x }", "INSERT DATA { <a:a> <a:b> <a:c> }"]
)
def test_what_is_no_query_is_refused_with_its_place(query: str, kb: KnowledgeBase) -> None:
    with pytest.raises(
        QueryRefused, match=r"^the query cannot be answered: error at .{1,60}; it must be .* of SPARQL 1\.1$"
    ):
        kb.sparql(query)


def test_a_server_that_is_not_there_is_named_as_the_cause(kb: KnowledgeBase) -> None:
    with pytest.raises(QueryRefused, match=r"the query cannot be answered: .+") as refused:
        kb.sparql("SELECT * { SERVICE <http://127.0.0.1:9/none> { ?s ?p ?o } }")
    assert "SELECT, ASK" not in str(refused.value)


def test_a_query_that_takes_too_long_is_given_up(kb: KnowledgeBase) -> None:
    with pytest.raises(QueryTimedOut, match=r"did not end within 0\.05 s"):
        kb.sparql(LONG, timeout_s=0.05)
    assert kb.sparql("ASK {}").truth, "and the next one is answered"
