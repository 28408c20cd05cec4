"""The copy of the statements in SWI-Prolog's rdf_db: reads give what the store contains and implies."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from threading import Thread

import pytest
from benchmarks.prolog_triples import GOALS
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mindstage.engines import NullEngine
from mindstage.errors import PrologGoalError
from mindstage.knowledge import KnowledgeBase, change_feed
from mindstage.knowledge.assertion_file import TripleStoreView
from mindstage.prolog import PrologConsole
from mindstage.rdf import RdfTerm
from mindstage.simulation import Simulation
from tests.cases import each_case

EXAMPLE = "http://example.org/e#"
OWL = "http://www.w3.org/2002/07/owl#"
RDFS = "http://www.w3.org/2000/01/rdf-schema#"
TYPE = "http://www.w3.org/1999/02/22-rdf-syntax-ns#type"
XSD = "http://www.w3.org/2001/XMLSchema#"

NAMES = [f"{EXAMPLE}{letter}" for letter in "abcd"]
PROPERTIES = [f"{EXAMPLE}p{number}" for number in range(4)]
VALUES = [
    *(RdfTerm("iri", name) for name in NAMES),
    RdfTerm("blank", "x1"),
    RdfTerm("literal", "dynamic", XSD + "string"),
    RdfTerm("literal", "Dynamic", XSD + "string"),
    RdfTerm("literal", 'a "b"\n\\ü', XSD + "string"),
    RdfTerm("literal", "3", XSD + "integer"),
    RdfTerm("literal", "Tür", "http://www.w3.org/1999/02/22-rdf-syntax-ns#langString", "de"),
]
AXIOMS = [
    *((f"{EXAMPLE}p0", f"{RDFS}subPropertyOf", f"{EXAMPLE}p{number}") for number in (1, 2)),
    (f"{EXAMPLE}p2", f"{RDFS}subPropertyOf", f"{EXAMPLE}p1"),
    (f"{EXAMPLE}p3", f"{OWL}inverseOf", f"{EXAMPLE}p1"),
    (f"{EXAMPLE}p2", TYPE, f"{OWL}SymmetricProperty"),
    (f"{EXAMPLE}a", TYPE, f"{EXAMPLE}C"),
    (f"{EXAMPLE}C", f"{RDFS}subClassOf", f"{EXAMPLE}D"),
]

statements = st.one_of(
    st.tuples(st.sampled_from(NAMES), st.sampled_from(PROPERTIES), st.sampled_from(VALUES)),
    st.sampled_from([(one, property, RdfTerm("iri", other)) for one, property, other in AXIOMS]),
)
graphs = st.sampled_from([None, "http://example.org/g", "urn:graph:mine"])
edits = st.lists(st.tuples(st.booleans(), st.booleans(), statements, graphs), min_size=1, max_size=8)


@pytest.fixture
def small(prolog: Path) -> Iterator[tuple[KnowledgeBase, PrologConsole]]:
    """A knowledge base without the bundled ontology, and a console of it."""
    knowledge = KnowledgeBase(bundled_ontology=False)
    with Simulation(knowledge, NullEngine()) as simulation, PrologConsole(simulation) as console:
        yield knowledge, console


def test_class_expressions_are_terms(small: tuple[KnowledgeBase, PrologConsole], tmp_path: Path) -> None:
    knowledge, console = small
    path = tmp_path / "classes.ttl"
    path.write_text(
        """
        @prefix : <http://a/> . @prefix owl: <http://www.w3.org/2002/07/owl#> .
        :A a owl:Class . :B a owl:Class . :a a :A . :b a :B . :p a owl:ObjectProperty .
        :one owl:equivalentClass [ a owl:Class ; owl:oneOf ( :a :b ) ] .
        :union owl:equivalentClass [ a owl:Class ; owl:unionOf ( :A :B ) ] .
        :both owl:equivalentClass [ a owl:Class ; owl:intersectionOf ( :A :B ) ] .
        :not owl:equivalentClass [ a owl:Class ; owl:complementOf :A ] .
        :some owl:equivalentClass [ a owl:Restriction ; owl:onProperty :p ; owl:someValuesFrom :A ] .
        :all owl:equivalentClass [ a owl:Restriction ; owl:onProperty :p ; owl:allValuesFrom :A ] .
        :value owl:equivalentClass [ a owl:Restriction ; owl:onProperty :p ; owl:hasValue :a ] .
        :min owl:equivalentClass [ a owl:Restriction ; owl:onProperty :p ; owl:minCardinality 2 ] .
        :max owl:equivalentClass [ a owl:Restriction ; owl:onProperty :p ; owl:maxCardinality 2 ] .
        :exactly owl:equivalentClass [ a owl:Restriction ; owl:onProperty :p ; owl:cardinality 2 ] .
        """,
        encoding="utf-8",
    )
    knowledge.load(path)
    of_p = "restriction('http://a/p', {})"
    expected = {
        "one": "one_of(['http://a/a', 'http://a/b'])",
        "union": "union_of(['http://a/A', 'http://a/B'])",
        "both": "intersection_of(['http://a/A', 'http://a/B'])",
        "not": "complement_of('http://a/A')",
        "some": of_p.format("some_values_from('http://a/A')"),
        "all": of_p.format("all_values_from('http://a/A')"),
        "value": of_p.format("has_value('http://a/a')"),
        "min": of_p.format("cardinality(2, inf)"),
        "max": of_p.format("cardinality(0, 2)"),
        "exactly": of_p.format("cardinality(2, 2)"),
    }
    for name, term in expected.items():
        node = f"rdf('http://a/{name}', owl:equivalentClass, Node)"
        assert console.holds(f"{node}, owl_description(Node, {term})"), name


def test_a_restriction_within_a_restriction_has_its_own_filler(
    small: tuple[KnowledgeBase, PrologConsole], tmp_path: Path
) -> None:
    knowledge, console = small
    path = tmp_path / "nested.ttl"
    path.write_text(
        """
        @prefix : <http://n/> . @prefix owl: <http://www.w3.org/2002/07/owl#> .
        @prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
        :A a owl:Class . :p a owl:ObjectProperty . :q a owl:ObjectProperty .
        :Outer a owl:Class ; rdfs:subClassOf [ a owl:Restriction ; owl:onProperty :p ; owl:someValuesFrom
            [ a owl:Restriction ; owl:onProperty :q ; owl:someValuesFrom :A ] ] .
        """,
        encoding="utf-8",
    )
    knowledge.load(path)
    goal = "mindstage:owl_class_properties('http://n/Outer', 'http://n/p', restriction(Property, _, Filler))"
    assert [(row["Property"], row["Filler"]) for row in console.solutions(goal)] == [("http://n/q", "http://n/A")]


def as_prolog(term: RdfTerm) -> str:
    text = term.value.replace("\\", "\\\\").replace("'", "\\'").replace("\n", "\\n")
    match term.kind:
        case "literal" if term.language:
            return f"literal(lang({term.language}, '{text}'))"
        case "literal":
            return f"literal(type('{term.datatype}', '{text}'))"
        case "blank":
            return f"'_:{text}'"
        case _:
            return f"'{text}'"


def written(goal: str, console: PrologConsole) -> set[str]:
    """The solutions S, P, O of a goal, as `writeq/1` prints them; each must occur once."""
    rows = console.solutions(f"{goal}, format(atom(Row), '~q', [[S, P, O]])", limit=10_000)
    found = [row["Row"] for row in rows]
    assert len(found) == len(set(found))
    return set(found)


def expected(triples: Iterator[tuple[str, str, RdfTerm]], console: PrologConsole) -> set[str]:
    listed = ", ".join(f"['{one}', '{property}', {as_prolog(value)}]" for one, property, value in triples)
    rows = console.solutions(f"member(Each, [{listed}]), format(atom(Row), '~q', [Each])", limit=10_000)
    return {row["Row"] for row in rows}


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(edits=edits)
def test_after_any_changes_prolog_reads_what_the_store_has(
    edits: list[tuple[bool, bool, tuple[str, str, RdfTerm], str | None]], small: tuple[KnowledgeBase, PrologConsole]
) -> None:
    knowledge, console = small
    triples = TripleStoreView(knowledge)
    for adds, in_prolog, (one, property, value), graph in edits:
        name = "user" if graph is None else graph.removeprefix("urn:graph:")
        if in_prolog:
            predicate = "rdf_assert" if adds else "rdf_retractall"
            console.holds(f"{predicate}('{one}', '{property}', {as_prolog(value)}, '{name}')")
        elif adds:
            triples.add(one, property, value, graph)
        else:
            triples.remove(one, property, value)
    assert written("rdf(S, P, O)", console) == expected(triples.find(), console)
    for property in PROPERTIES:
        entailed = expected(triples.find_entailed(None, property), console)
        assert written(f"P = '{property}', rdf_has(S, P, O)", console) == entailed
        for one in NAMES:
            here = expected(triples.find_entailed(one, property), console)
            assert written(f"S = '{one}', P = '{property}', rdf_has(S, P, O)", console) == here
    members = {row["X"] for row in console.solutions(f"rdfs_individual_of(X, '{EXAMPLE}D')")}
    assert members == set(knowledge.reasoner.members(f"{EXAMPLE}D"))
    triples.remove()
    assert written("rdf(S, P, O)", console) == set()


def test_the_graph_of_a_statement_is_its_source_or_where_it_was_asserted(console: PrologConsole) -> None:
    console.holds(
        "rdf_assert(kitchen:a, knowrob:note, literal(x)), rdf_assert(kitchen:a, knowrob:note, literal(y), own)"
    )
    rows = console.solutions("rdf(kitchen:a, knowrob:note, literal(T), G)")
    assert {(row["G"]) for row in rows} == {"user", "own"}
    (row,) = console.solutions("rdf(kitchen:fridge_door, knowrob:child, kitchen:fridge_door_handle, G)")
    assert row["G"] == "urn:mindstage:bundled:kitchen.owl"
    console.holds("rdf_retractall(kitchen:a, _, _, own)")
    assert [row["G"] for row in console.solutions("rdf(kitchen:a, knowrob:note, _, G)")] == ["user"]


def test_changes_from_another_thread_are_seen_by_the_next_goal(console: PrologConsole, simulation: Simulation) -> None:
    assert not console.holds(f"rdf('{EXAMPLE}a', _, _)")
    triples = TripleStoreView(simulation.knowledge)
    thread = Thread(target=triples.add, args=(f"{EXAMPLE}a", f"{EXAMPLE}p", RdfTerm("iri", f"{EXAMPLE}b")))
    thread.start()
    thread.join(timeout=30.0)
    assert console.holds(f"rdf('{EXAMPLE}a', _, '{EXAMPLE}b')")


def test_rules_may_assert_while_they_read(console: PrologConsole) -> None:
    goal = "forall(rdf(X, knowrob:child, Y), rdf_assert(Y, knowrob:partOf, X))"
    assert console.holds(goal)
    assert console.holds("forall(rdf(X, knowrob:child, Y), rdf_has(Y, knowrob:partOf, X))")
    assert console.holds(
        "rdf_has(X, knowrob:child, Y, Asserted), Asserted == 'http://knowrob.org/kb/knowrob.owl#child'"
    )


def test_a_store_that_is_too_large_is_asked_instead(console: PrologConsole, monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = console.solutions("rdf_has(kitchen:fridge_door, knowrob:child, X)")
    monkeypatch.setattr(change_feed, "MAX_COPIED_STATEMENTS", 10)
    console.holds("rdf_assert(kitchen:fridge_door, knowrob:note, literal(x))")
    assert console.solutions("rdf_has(kitchen:fridge_door, knowrob:child, X)") == wanted
    assert console.holds("rdf(kitchen:fridge_door, knowrob:note, literal(x))")
    assert console.holds("rdfs_individual_of(kitchen:fridge_door_handle, knowrob:'Handle')")
    with pytest.raises(PrologGoalError, match="not available for a store that is asked by queries"):
        console.holds("rdf(_, _, _, _)")


@each_case(("what", "ours", "theirs"), GOALS, ids=[what for what, _, _ in GOALS])
def test_the_goals_of_the_benchmark_have_as_many_answers_as_in_swi_prolog(
    what: str, ours: str, theirs: str, kitchen: PrologConsole
) -> None:
    kitchen.holds("mindstage_rdf_mirror:mirrored, use_module(library(semweb/rdfs), [])")
    (row,) = kitchen.solutions(f"aggregate_all(count, ({ours}), Ours), aggregate_all(count, ({theirs}), Theirs)")
    assert row["Ours"] == row["Theirs"] > 0


# -- computed properties -----------------------------------------------------------------------------------------------


def test_computed_properties_answer_after_statements_and_each_once(console: PrologConsole, tmp_path: Path) -> None:
    rules = tmp_path / "computed.pl"
    rules.write_text(
        ":- multifile mindstage_semweb:computable/3.\n"
        f"mindstage_semweb:computable('{EXAMPLE}near', '{EXAMPLE}a', Value) :- "
        f"member(Value, ['{EXAMPLE}b', '{EXAMPLE}c', '{EXAMPLE}b']).\n",
        encoding="utf-8",
    )
    assert console.consult(rules) == 0
    console.holds(f"rdf_assert('{EXAMPLE}a', '{EXAMPLE}near', '{EXAMPLE}c')")
    console.holds(f"rdf_assert('{EXAMPLE}near', rdfs:subPropertyOf, '{EXAMPLE}around')")
    for property in ("near", "around"):
        for goal in ("rdf_has('{e}a', '{e}{p}', X)", "rdf_triple('{e}{p}', '{e}a', X)", "owl_has('{e}a', '{e}{p}', X)"):
            rows = console.solutions(goal.format(e=EXAMPLE, p=property))
            assert [row["X"] for row in rows] == [f"{EXAMPLE}c", f"{EXAMPLE}b"]
    assert console.holds(f"retractall(mindstage_semweb:computable('{EXAMPLE}near', _, _))")  # no clause of the product


def test_a_computable_of_an_ontology_calls_predicates_of_users_only(console: PrologConsole, tmp_path: Path) -> None:
    rules = tmp_path / "far.pl"
    rules.write_text(f"far_from('{EXAMPLE}a', '{EXAMPLE}z').\n", encoding="utf-8")
    assert console.consult(rules) == 0
    for name, command in (("far", "far_from"), ("evil", "shell"), ("copy", "copy_file")):
        console.holds(
            "T = 'http://knowrob.org/kb/computable.owl#target', C = 'http://knowrob.org/kb/computable.owl#command', "
            f"rdf_assert('{EXAMPLE}computes-{name}', T, '{EXAMPLE}{name}'), "
            f"rdf_assert('{EXAMPLE}computes-{name}', C, literal({command}))"
        )
    assert console.solutions(f"rdf_has(X, '{EXAMPLE}far', Y)") == [{"X": f"{EXAMPLE}a", "Y": f"{EXAMPLE}z"}]
    assert console.solutions(f"rdf_has('true', '{EXAMPLE}evil', _)") == []
    assert console.solutions(f"rdf_has('{rules}', '{EXAMPLE}copy', '{tmp_path}/other')") == []
    assert not (tmp_path / "other").exists()
