"""Graphs keep the text of literals, and nest blank nodes."""

from __future__ import annotations

import pyoxigraph as ox
import pytest

from mindstage.maps.rdf_mapping.nested import MAX_NESTING, nest_blank_nodes
from mindstage.rdf.graphs import Graph, graph_from_quads
from mindstage.scene import BlankNode, FactValue, Iri, IriRef, Literal, PropertyAssertion
from tests.cases import each_case

XSD = "http://www.w3.org/2001/XMLSchema#"
PREFIXES = f"@prefix e: <http://e#> . @prefix xsd: <{XSD}> . "


def graph(turtle: str, taken: set[str] | None = None) -> Graph:
    quads = ox.parse(PREFIXES + turtle, ox.RdfFormat.TURTLE, base_iri="file:///x")
    return nest_blank_nodes(graph_from_quads(quads, set() if taken is None else taken))


def e(name: str) -> Iri:
    return Iri(f"http://e#{name}")


def only_value(statements: Graph, subject: Iri) -> FactValue:
    (fact,) = statements[subject]
    return fact.value


@each_case("text", ["177.512833", "0.0", "-0.000000", "1E+03", "007", " 1 "])
def test_numbers_keep_their_text(text: str) -> None:
    assert only_value(graph(f'e:a e:b "{text}"^^xsd:float .'), e("a")) == Literal(text, Iri(XSD + "float"))


def test_strings_with_and_without_language_have_no_datatype() -> None:
    assert only_value(graph('e:a e:b "x"^^xsd:string .'), e("a")) == Literal("x")
    assert only_value(graph('e:a e:b "x"@de .'), e("a")) == Literal("x", None, "de")


def test_duplicate_statements_are_merged() -> None:
    assert len(graph("e:a e:b e:c . e:a e:b e:c .")[e("a")]) == 1


def test_a_blank_node_with_one_reference_is_nested() -> None:
    statements = graph("e:a e:b [ e:d 1 ; e:c [ e:e e:f ] ] .")
    inner = BlankNode((PropertyAssertion(e("e"), IriRef(e("f"))),))
    one = Literal("1", Iri(XSD + "integer"))
    assert statements == {
        e("a"): [
            PropertyAssertion(e("b"), BlankNode((PropertyAssertion(e("c"), inner), PropertyAssertion(e("d"), one))))
        ]
    }


def test_labeled_and_empty_blank_nodes_are_nested() -> None:
    assert graph("e:a e:b _:x . _:x e:c e:d .") == graph("e:a e:b [ e:c e:d ] .")
    assert only_value(graph("e:a e:b _:x ."), e("a")) == BlankNode()


def test_equal_blank_nodes_are_kept_apart() -> None:
    assert len(graph("e:a e:b [ e:c e:d ], [ e:c e:d ] .")[e("a")]) == 2


def test_a_blank_node_with_two_references_keeps_its_label() -> None:
    statements = graph("e:a e:b _:x ; e:c _:x . _:x e:d e:e .")
    assert list(statements) == [e("a"), "_:x"]
    assert [fact.value for fact in statements[e("a")]] == [IriRef(Iri("_:x"))] * 2


def test_a_blank_node_without_references_gets_a_label() -> None:
    assert list(graph("[] e:a e:b . [] e:a e:c . _:b1 e:a e:d .")) == ["_:b2", "_:b3", "_:b1"]


@pytest.mark.parametrize(
    ("circle", "labels"),
    [("_:x e:a _:x .", {"_:x"}), ("_:x e:a _:y . _:y e:a _:z . _:z e:a _:x .", {"_:x", "_:y", "_:z"})],
)
def test_blank_nodes_in_a_cycle_keep_their_labels(circle: str, labels: set[str]) -> None:
    assert set(graph(circle)) == labels


def test_a_blank_node_below_a_cycle_is_nested() -> None:
    statements = graph("_:x e:a _:y . _:y e:a _:x ; e:b [ e:c e:d ] .")
    assert set(statements) == {"_:x", "_:y"}
    assert statements[Iri("_:y")][1].value == BlankNode((PropertyAssertion(e("c"), IriRef(e("d"))),))


def test_labels_are_unique_across_graphs() -> None:
    taken: set[str] = set()
    first = graph("_:x e:a e:b .", taken)
    second = graph("_:x e:a e:c . e:d e:e _:x .", taken)
    assert list(first) == ["_:x"]
    assert list(second) == [e("d")]
    third = graph("_:x e:a e:c .", taken)
    assert list(third) == ["_:x-3"]


def test_a_long_list_is_split_at_the_maximum_nesting() -> None:
    items = " ".join(str(number) for number in range(3 * MAX_NESTING))
    statements = graph(f"e:a e:b ({items}) .")
    assert len(statements) == 4
    assert sum(_count(fact) for facts in statements.values() for fact in facts) == 6 * MAX_NESTING + 1


def _count(fact: PropertyAssertion) -> int:
    return 1 + sum(map(_count, fact.value.facts)) if isinstance(fact.value, BlankNode) else 1
