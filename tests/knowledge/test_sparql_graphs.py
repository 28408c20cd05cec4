"""SPARQL over named graphs: their names, FROM, prefixes of loaded files, the order of columns, and results."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mindstage.errors import InvalidArgumentError, SparqlSyntaxError
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.sparql_query import SparqlText
from mindstage.maps import bundled_kitchen
from mindstage.rdf import RdfTerm, SparqlResult
from mindstage.rdf.graphs import PREFIXES

COUNT = "SELECT (COUNT(*) AS ?n) {dataset} {{ ?s ?p ?o }}"
OWL_ONTOLOGY = "<http://www.w3.org/2002/07/owl#Ontology>"


@pytest.fixture(scope="module")
def kitchen() -> KnowledgeBase:
    kb = KnowledgeBase()
    kb.load(bundled_kitchen())
    return kb


def loaded(tmp_path: Path, **files: str) -> KnowledgeBase:
    """A knowledge base with Turtle files of these names, loaded in their order."""
    kb = KnowledgeBase(bundled_ontology=False)
    for name, text in files.items():
        path = tmp_path / f"{name}.ttl"
        path.write_text(text, encoding="utf-8")
        kb.load((), ontologies=path)
    return kb


def graphs(kb: KnowledgeBase) -> set[str]:
    return {term.value for term in kb.sparql("SELECT DISTINCT ?g { GRAPH ?g { ?s ?p ?o } }")["g"]}


def number(kb: KnowledgeBase, dataset: str = "") -> int:
    return int(kb.sparql(COUNT.format(dataset=dataset))["n"][0].value)


# -- names of graphs ---------------------------------------------------------------------------------------------------


def test_a_graph_has_the_name_of_its_ontology_or_file_and_no_path(tmp_path: Path) -> None:
    named = f"<http://e.org/words> a {OWL_ONTOLOGY} . <e:a> <e:b> <e:c> ."
    kb = loaded(tmp_path, words=named, plain="<e:a> <e:b> <e:d> .", relative=f"<> a {OWL_ONTOLOGY} .")
    assert graphs(kb) == {"http://e.org/words", "urn:mindstage:file:plain.ttl", "urn:mindstage:file:relative.ttl"}
    assert kb.source_graph(tmp_path / "plain.ttl").value == "urn:mindstage:file:plain.ttl"


def test_files_with_the_same_ontology_or_name_have_different_graphs(tmp_path: Path) -> None:
    text = f"<http://e.org/words> a {OWL_ONTOLOGY} ; <e:b> "
    kb = loaded(tmp_path, one=f"{text} 1 .", two=f"{text} 2 .")
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "two.ttl").write_text(f"{text} 3 .")
    kb.load((), ontologies=tmp_path / "folder" / "two.ttl")
    assert graphs(kb) == {"http://e.org/words", "urn:mindstage:file:two.ttl", "urn:mindstage:file:two.ttl-2"}
    with pytest.raises(SparqlSyntaxError, match=r"no graph is named <two\.ttl>"):
        kb.sparql("SELECT * FROM <two.ttl> { ?s ?p ?o }")  # of two files


@pytest.mark.parametrize("name", ["http://mindstage.org/told", "http://mindstage.org/derived", "urn:mindstage:present"])
def test_no_file_takes_the_name_of_a_graph_of_mindstage(name: str, tmp_path: Path) -> None:
    kb = loaded(tmp_path, words=f"<{name}> a {OWL_ONTOLOGY} .")
    assert graphs(kb) == {"urn:mindstage:file:words.ttl"}


def test_an_ontology_anywhere_in_n_triples_names_the_graph(tmp_path: Path) -> None:
    path = tmp_path / "many.nt"
    lines = [f"<e:a> <e:b> <e:{number}> .\n" for number in range(60_000)]
    lines[55_555] = f"<http://e.org/late> <http://www.w3.org/1999/02/22-rdf-syntax-ns#type> {OWL_ONTOLOGY} .\n"
    path.write_text("".join(lines))
    kb = KnowledgeBase(bundled_ontology=False)
    kb.load((), ontologies=path)
    assert kb.source_graph(path).value == "http://e.org/late"


def test_graph_names_persist_in_a_store(tmp_path: Path) -> None:
    (tmp_path / "words.ttl").write_text(f"@prefix w: <http://e.org/words#> . <http://e.org/words> a {OWL_ONTOLOGY} .")
    with KnowledgeBase(store=tmp_path / "store") as kb:
        kb.load((), ontologies=tmp_path / "words.ttl")
    with KnowledgeBase(store=tmp_path / "store") as kb:
        assert graphs(kb) == {"http://e.org/words", "urn:mindstage:bundled:household.ttl"}
        assert number(kb, "FROM <words.ttl>") == 1
        assert kb.sparql("ASK { w:a w:b w:c }").boolean is False


# -- FROM --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name",
    [
        "kitchen.owl",
        "urn:mindstage:bundled:kitchen.owl",
        "http://mindstage.org/maps/kitchen.owl",
        bundled_kitchen().as_uri(),
    ],
)
def test_from_selects_a_graph_by_each_of_its_names(name: str, kitchen: KnowledgeBase) -> None:
    whole, part = number(kitchen), number(kitchen, f"FROM <{name}>")
    assert 0 < part < whole
    assert number(kitchen, f"FROM <household.ttl> FROM # comment\n<{name}>") == whole
    assert number(kitchen, f"FROM NAMED <{name}>") == 0, "the default graph is empty then"
    in_graph = f"SELECT ?g (COUNT(*) AS ?n) FROM NAMED <{name}> {{ GRAPH ?g {{ ?s ?p ?o }} }} GROUP BY ?g"
    ((graph, count),) = kitchen.sparql(in_graph)
    assert graph is not None
    assert count is not None
    assert (graph.value, int(count.value)) == ("urn:mindstage:bundled:kitchen.owl", part)
    assert len(kitchen.sparql(f"SELECT ?s {{ GRAPH <{name}> {{ ?s ?p ?o }} }}")) == part


def test_an_unknown_graph_in_from_is_an_error_that_names_similar_ones(kitchen: KnowledgeBase) -> None:
    with pytest.raises(SparqlSyntaxError, match=r"no graph is named <kitchn\.owl>, .* near: <kitchen\.owl>"):
        kitchen.sparql("SELECT * FROM <kitchn.owl> { ?s ?p ?o }")
    with pytest.raises(SparqlSyntaxError, match=r"there is <http://mindstage\.org/derived>, .*<urn:mindstage:"):
        kitchen.sparql("ASK FROM NAMED <z:z> { ?s ?p ?o }")


def test_the_word_from_selects_nothing_elsewhere(kitchen: KnowledgeBase) -> None:
    assert kitchen.sparql("ASK { ?s ?p ?o FILTER(?o != 'FROM <nowhere.owl>') } # FROM <nowhere.owl>")


# -- prefixes ----------------------------------------------------------------------------------------------------------


def test_prefixes_of_loaded_files_are_declared(kitchen: KnowledgeBase) -> None:
    assert kitchen.sparql("ASK { kitchen:milk_carton_1 knowrob:pose ?pose }")
    assert kitchen.sparql("ASK { :milk_carton_1 knowrob:pose ?pose }"), "also the empty one"


def test_a_prefix_with_two_meanings_must_be_declared_in_the_query(tmp_path: Path) -> None:
    kb = loaded(
        tmp_path,
        one="@prefix e: <http://one/> . @prefix same: <http://same/> . e:a e:a e:a .",
        two="@prefix e: <http://two/> . @prefix same: <http://same/> . same:a e:a e:a .",
    )
    cause = (
        r"e: has several meanings .*<http://one/> in one\.ttl and <http://two/> in two\.ttl; declare .*PREFIX e: <…>"
    )
    with pytest.raises(SparqlSyntaxError, match=cause):
        kb.sparql("ASK { e:a ?p ?o }")
    assert kb.sparql("PREFIX e: <http://two/> ASK { ?s e:a e:a }")
    assert kb.sparql("ASK { same:a ?p ?o . FILTER(STR(?o) != 'e:a') }")


def test_a_file_cannot_change_a_prefix_of_mindstage(tmp_path: Path) -> None:
    kb = loaded(tmp_path, one="@prefix knowrob: <http://other/> . knowrob:a knowrob:a knowrob:a .")
    assert not kb.sparql("ASK { knowrob:a ?p ?o }")
    assert kb.sparql("PREFIX knowrob: <http://other/> ASK { knowrob:a ?p ?o }")


# -- results -----------------------------------------------------------------------------------------------------------


@given(st.permutations(["zebra", "s", "alpha", "M1", "ö"]), st.sampled_from(["", "DISTINCT ", "REDUCED "]))
@settings(max_examples=10, deadline=None)
def test_select_star_has_the_variables_in_the_order_of_the_query(names: list[str], modifier: str) -> None:
    body = " ".join(f"BIND({at} AS ?{name})" for at, name in enumerate(names))
    result = KITCHENLESS.sparql(f"# ?alpha\nSELECT {modifier}* {{ {body} FILTER('?M1' != ?s) }}")
    assert result.columns == tuple(names)
    assert [term.value for (row,) in [result.rows] for term in row if term] == [str(at) for at in range(len(names))]


KITCHENLESS = KnowledgeBase(bundled_ontology=False)


def test_named_variables_keep_the_order_of_select() -> None:
    assert KITCHENLESS.sparql("SELECT ?b ?a { BIND(1 AS ?a) BIND(2 AS ?b) }").columns == ("b", "a")


def test_a_result_is_a_sequence_of_rows_with_columns_by_name() -> None:
    result = KITCHENLESS.sparql("SELECT * { VALUES (?n ?name) { (1 'one') (2 UNDEF) } }")
    assert [n.value for n, _ in result if n] == ["1", "2"]
    assert len(result) == 2
    assert result[1] == result.rows[1]
    assert result[-1:] == result.rows[1:]
    assert result["name"] == (RdfTerm("literal", "one", "http://www.w3.org/2001/XMLSchema#string"), None)
    assert result.to_dicts() == [{"n": "1", "name": "one"}, {"n": "2", "name": None}]
    with pytest.raises(InvalidArgumentError, match="column 'nme': the result has none; there is n, name"):
        result["nme"]


def test_a_result_is_true_if_it_has_rows_or_the_boolean_is() -> None:
    assert not SparqlResult((), (), False)
    assert SparqlResult((), (), True)
    assert not SparqlResult(("a",), ())
    assert SparqlResult(("a",), ((None,),))


# -- tokens ------------------------------------------------------------------------------------------------------------


@given(st.text(max_size=40))
@settings(max_examples=100, deadline=None)
def test_any_text_has_tokens(text: str) -> None:
    query = SparqlText(text)
    assert query.with_graph_names({}, frozenset(), PREFIXES) is query or "FROM" in text.upper()
    assert query.sorted_columns(("b", "a")) in (("b", "a"), ["a", "b"], ["b", "a"])


def test_an_iri_is_found_with_a_prefix_of_the_query_or_in_full() -> None:
    for text in ("ASK { GRAPH <urn:x:now> {} }", "PREFIX x: <urn:x:> ASK { GRAPH x:now {} }", "ASK { ?g ?p y:now }"):
        assert SparqlText(text).mentions("urn:x:now", {"y": "urn:x:"})
    for text in ("ASK { ?g ?p 'urn:x:now' } # <urn:x:now>", "ASK { y:no ?p 'y:now' }"):
        assert not SparqlText(text).mentions("urn:x:now", {"y": "urn:x:"})
