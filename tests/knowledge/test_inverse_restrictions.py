"""Restrictions on the inverse of a property: in the answers of `class_properties`, compared with rdflib."""

from __future__ import annotations

from pathlib import Path

import pytest
import rdflib
from rdflib.namespace import OWL, RDFS
from rdflib.term import URIRef

from mindstage.knowledge import KnowledgeBase
from mindstage.rdf.graphs import local_name
from tests.cases import each_case

EXAMPLE = "http://example.org/o#"
LIDS = f"""
@prefix : <{EXAMPLE}> .
@prefix owl: <http://www.w3.org/2002/07/owl#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
:holds a owl:ObjectProperty . :grips a owl:ObjectProperty ; rdfs:subPropertyOf :holds .
:Crate a owl:Class . :Shelf a owl:Class . :Screw a owl:Class . :Clamp a owl:Class .
:Lid a owl:Class ; rdfs:subClassOf
    [ a owl:Restriction ; owl:onProperty [ owl:inverseOf :holds ] ; owl:someValuesFrom :Crate ] ,
    [ a owl:Restriction ; owl:onProperty :holds ; owl:someValuesFrom :Screw ] .
:RoundLid a owl:Class ; rdfs:subClassOf :Lid ,
    [ a owl:Restriction ; owl:onProperty [ owl:inverseOf :grips ] ; owl:hasValue :clamp ] .
:clamp a :Clamp . :screw a :Screw . :crate a :Crate ; :holds :top . :top a owl:NamedIndividual .
:Covered a owl:Class ; owl:equivalentClass
    [ a owl:Restriction ; owl:onProperty [ owl:inverseOf :holds ] ; owl:someValuesFrom :Crate ] .
:Odd a owl:Class ; rdfs:subClassOf
    [ a owl:Restriction ; owl:onProperty :holds ; owl:someValuesFrom
        [ a owl:Restriction ; owl:onProperty [ owl:inverseOf :grips ] ; owl:someValuesFrom :Clamp ] ] .
"""


def lids_ontology(tmp_path: Path) -> Path:
    path = tmp_path / "lids.ttl"
    path.write_text(LIDS, encoding="utf-8")
    return path


def knowledge_of_lids(tmp_path: Path) -> KnowledgeBase:
    kb = KnowledgeBase(bundled_ontology=False)
    kb.load(lids_ontology(tmp_path))
    return kb


@pytest.fixture
def lids(tmp_path: Path) -> KnowledgeBase:
    return knowledge_of_lids(tmp_path)


@each_case(
    ("inverse", "expected"),
    [
        (None, {("holds", "Crate", True), ("holds", "Screw", False)}),
        (True, {("holds", "Crate", True)}),
        (False, {("holds", "Screw", False)}),
    ],
)
def test_a_restriction_on_an_inverse_is_told_from_a_forward_one(
    lids: KnowledgeBase, inverse: bool | None, expected: set[tuple[str, str, bool]]
) -> None:
    rows = lids.ask("class_properties", cls="Lid", inverse=inverse)
    assert {(local_name(row.property), local_name(row.value), row.inverse) for row in rows} == expected


def test_a_property_finds_the_inverses_of_its_subproperties(lids: KnowledgeBase) -> None:
    rows = lids.ask("class_properties", cls="RoundLid", property="holds", inverse=True)
    assert [(local_name(row.value), local_name(row.source)) for row in rows] == [
        ("clamp", "RoundLid"),
        ("Crate", "Lid"),
    ]
    expected = ("every RoundLid: inverse of grips clamp", "grips implies holds")
    assert lids.explain("class_properties", rows[0]) == expected


def test_without_an_answer_the_other_direction_is_named(lids: KnowledgeBase) -> None:
    (missing,) = lids.ask("class_properties", property="holds", value="Crate", inverse=False).missing
    assert missing.reason == "no class has holds Crate; Covered has a restriction on inverse of holds"
    (missing,) = lids.ask("class_properties", property="holds", value="Screw", inverse=True).missing
    assert missing.reason == "no class has inverse of holds Screw; Lid has a restriction on holds"


@each_case(
    ("sentence", "values"),
    [
        ("what is the holds of the class Lid", {"Screw"}),
        ("what does every Lid have", {"Screw"}),
        ("what has every Lid as holds", {"Crate"}),
        ("of what is every Lid the holds?", {"Crate"}),
        ("what are the restrictions on Lid", {"Crate", "Screw"}),
        ("what are the inverse restrictions on Lid", {"Crate"}),
    ],
)
def test_sentences_ask_for_one_direction(lids: KnowledgeBase, sentence: str, values: set[str]) -> None:
    assert {local_name(row.value) for row in lids.ask(sentence)} == values


def test_directions_are_those_that_rdflib_finds_in_all_ontologies(shared_data: Path) -> None:
    kb = KnowledgeBase(bundled_ontology=False)
    files = sorted((shared_data / "ontology").rglob("*.owl"))
    kb.load((), ontologies=files, follow_imports=False)
    graph = rdflib.Graph()
    for path in files:
        graph.parse(path, format="xml")
    stated = own_restrictions(graph)
    ours = {
        (str(row.source), str(row.property), row.inverse) for row in kb.ask("class_properties") if row.cls == row.source
    }
    assert sum(inverse for _, _, inverse in stated) >= 1
    assert ours == stated


def own_restrictions(graph: rdflib.Graph) -> set[tuple[str, str, bool]]:
    """Named classes with the properties of their own restrictions, and whether each is on the inverse."""
    found = set()
    for node in graph.subjects(OWL.onProperty, None):
        for owner in owners(graph, node):
            for on in graph.objects(node, OWL.onProperty):
                inverse = None if isinstance(on, URIRef) else graph.value(on, OWL.inverseOf)
                if isinstance(on, URIRef) or inverse is not None:
                    found.add((str(owner), str(on if inverse is None else inverse), inverse is not None))
    return found


def owners(graph: rdflib.Graph, node: rdflib.term.Node) -> set[URIRef]:
    """The named classes that are below an expression, directly or as a member of an intersection."""
    found = {
        each
        for axiom in (RDFS.subClassOf, OWL.equivalentClass)
        for each in graph.subjects(axiom, node)
        if isinstance(each, URIRef)
    }
    for cell in graph.subjects(rdflib.RDF.first, node):
        head = cell
        while (before := graph.value(predicate=rdflib.RDF.rest, object=head)) is not None:
            head = before
        for whole in graph.subjects(OWL.intersectionOf, head):
            found |= {whole} if isinstance(whole, URIRef) else owners(graph, whole)
    return found
