"""Inferred classes of individuals: from domains and ranges, definitions and anonymous types."""

from __future__ import annotations

import pytest

from mindstage.errors import NameNotFoundError
from mindstage.knowledge import KnowledgeBase
from mindstage.rdf.graphs import local_name
from mindstage.scene import Iri
from tests.maps.small_maps import ROOM_NAMESPACE, MakeKnowledgeBase, body_turtle, individual


def members(kb: KnowledgeBase, cls: str) -> list[str]:
    return [local_name(row.individual) for row in kb.ask("individual_of_class", cls=cls)]


def why(kb: KnowledgeBase, cls: str, individual: str) -> tuple[str, ...]:
    (row,) = kb.ask("individual_of_class", cls=cls, individual=individual)
    return kb.explain("individual_of_class", row)


def some(property: str, filler: str) -> str:
    return f"[ a owl:Restriction ; owl:onProperty {property} ; owl:someValuesFrom {filler} ]"


# -- domain and range --------------------------------------------------------------------------------------------------


def test_untyped_individuals_get_classes_from_domains_and_ranges(make_knowledge_base: MakeKnowledgeBase) -> None:
    kb = make_knowledge_base(
        "e:opens rdfs:domain e:Key ; rdfs:range e:Lock . e:Key rdfs:subClassOf e:Tool . e:opens rdfs:label 'opens' .",
        ":a k:describedInMap :room ; e:opens :b . :b k:describedInMap :room .",
    )
    assert members(kb, "Tool") == ["a"]
    assert why(kb, "Tool", "a") == ("a opens b", "whatever has a opens is a Key", "Key is a Tool")
    assert why(kb, "Lock", "b") == ("a opens b", "whatever is a opens of something is a Lock")
    (row,) = kb.ask("what_is", individual="a")
    assert [local_name(cls) for cls in row.classes] == ["Key"]
    assert kb.explain("what_is", row) == ("a opens b", "whatever has a opens is a Key", "Key is a Tool")


def test_typed_individuals_get_no_class_from_domains_and_ranges(make_knowledge_base: MakeKnowledgeBase) -> None:
    kb = make_knowledge_base("e:opens rdfs:domain e:Key . e:Key a owl:Class .", body_turtle("a", "e:opens :b"))
    assert members(kb, "Key") == []
    kb.retract("a", "type", "Cup")
    assert members(kb, "Key") == ["a"]
    kb.tell("a", "type", "Key")
    assert why(kb, "Key", "a") == ("a type Key",)


def test_domains_hold_for_subproperties_and_inverses(make_knowledge_base: MakeKnowledgeBase) -> None:
    kb = make_knowledge_base(
        "e:opens rdfs:domain e:Key . e:unlocks rdfs:subPropertyOf e:opens . e:openedBy owl:inverseOf e:opens .",
        ":a k:describedInMap :room ; e:unlocks 'all' . :b k:describedInMap :room . :c e:openedBy :b .",
    )
    assert members(kb, "Key") == ["a", "b"]
    assert why(kb, "Key", "a") == ("a unlocks all", "unlocks implies opens", "whatever has a opens is a Key")
    assert why(kb, "Key", "b")[0] == "c openedBy b"


def test_an_intersection_as_domain_implies_its_members_and_a_union_nothing(
    make_knowledge_base: MakeKnowledgeBase,
) -> None:
    kb = make_knowledge_base(
        "e:p rdfs:domain [ owl:intersectionOf ( e:A e:B ) ] . e:q rdfs:domain [ owl:unionOf ( e:C e:D ) ] .",
        ":x k:describedInMap :room ; e:p 1 ; e:q 2 . e:C a owl:Class .",
    )
    assert members(kb, "A") == members(kb, "B") == ["x"]
    assert members(kb, "C") == []


def test_a_resource_that_is_only_referred_to_can_be_given_by_its_iri(make_knowledge_base: MakeKnowledgeBase) -> None:
    kb = make_knowledge_base("e:opens rdfs:range e:Lock .", body_turtle("a", "e:opens :b"))
    (row,) = kb.ask("what_is", individual=f"{ROOM_NAMESPACE}b")
    assert ([local_name(cls) for cls in row.classes], row.map) == (["Lock"], None)
    with pytest.raises(NameNotFoundError):
        kb.ask("what_is", individual=f"{ROOM_NAMESPACE}unknown")


# -- definitions -------------------------------------------------------------------------------------------------------


def test_individuals_that_satisfy_a_definition_are_members(make_knowledge_base: MakeKnowledgeBase) -> None:
    full = f"[ owl:intersectionOf ( k:Cup {some('e:holds', 'e:Drink')} ) ]"
    kb = make_knowledge_base(
        f"e:FullCup owl:equivalentClass {full} . e:FullCup rdfs:subClassOf e:Treat . e:Tea rdfs:subClassOf e:Drink .",
        body_turtle("a", "e:holds :tea"),
        body_turtle("b"),
        ":tea a e:Tea .",
    )
    assert members(kb, "Treat") == ["a"]
    lines = ("a holds tea", "whatever is (Cup and (holds some Drink)) is a FullCup", "FullCup is a Treat")
    assert why(kb, "Treat", "a") == lines
    kb.tell("b", "holds", "tea")
    assert members(kb, "Treat") == ["a", "b"]
    kb.retract("tea", "type", "Tea")
    assert members(kb, "Treat") == []


@pytest.mark.parametrize(
    ("definition", "is_member"),
    [
        (some("e:holds", "e:Drink"), True),
        (some("e:holds", "e:Food"), False),
        (some("[ owl:inverseOf e:heldBy ]", "e:Drink"), True),
        (some("e:holds", some("e:madeOf", "e:Leaf")), True),
        ("[ a owl:Restriction ; owl:onProperty e:holds ; owl:hasValue :tea ]", True),
        ("[ a owl:Restriction ; owl:onProperty e:holds ; owl:hasValue :milk ]", False),
        ("[ a owl:Restriction ; owl:onProperty e:colour ; owl:hasValue 'red' ]", True),
        ("[ a owl:Restriction ; owl:onProperty e:colour ; owl:hasValue 'blue' ]", False),
        ("[ a owl:Restriction ; owl:onProperty e:colour ; owl:someValuesFrom xsd:string ]", True),
        ("[ a owl:Restriction ; owl:onProperty e:holds ; owl:minCardinality 1 ]", True),
        ("[ a owl:Restriction ; owl:onProperty e:holds ; owl:minQualifiedCardinality 1 ; owl:onClass e:Drink ]", True),
        ("[ a owl:Restriction ; owl:onProperty e:likes ; owl:hasSelf true ]", True),
        ("[ a owl:Class ; owl:oneOf ( :a :c ) ]", True),
        ("[ a owl:Class ; owl:oneOf ( :c :tea ) ]", False),
        ("[ a owl:Class ; owl:intersectionOf ( [ owl:oneOf ( :a :c ) ] [ owl:oneOf ( :c :tea ) ] ) ]", False),
        ("[ a owl:Class ; owl:intersectionOf ( [ owl:oneOf ( :a :c ) ] [ owl:oneOf ( :tea :a ) ] ) ]", True),
        ("[ a owl:Class ; owl:unionOf ( e:Nothing [ owl:oneOf ( :a ) ] ) ]", True),
        # Upper bounds and different individuals cannot be proved without further axioms.
        ("[ a owl:Restriction ; owl:onProperty e:holds ; owl:maxCardinality 1 ]", False),
        ("[ a owl:Restriction ; owl:onProperty e:holds ; owl:cardinality 1 ]", False),
        ("[ a owl:Restriction ; owl:onProperty e:holds ; owl:minCardinality 2 ]", False),
        ("[ a owl:Restriction ; owl:onProperty e:holds ; owl:allValuesFrom e:Drink ]", False),
        ("[ a owl:Class ; owl:complementOf e:Food ]", False),
    ],
)
def test_definitions_are_satisfied_by_statements_only(
    make_knowledge_base: MakeKnowledgeBase, definition: str, is_member: bool
) -> None:
    kb = make_knowledge_base(
        f"e:Special owl:equivalentClass {definition} . e:heldBy a owl:ObjectProperty ; owl:inverseOf e:holds .",
        body_turtle("a", "e:holds :tea, :water", "e:colour 'red'", "e:likes :a"),
        ":tea a e:Drink ; e:madeOf :leaf . :leaf a e:Leaf . :water a e:Water . :milk a e:Drink . :c a e:Other .",
    )
    assert members(kb, "Special") == (["a"] if is_member else [])


def test_definitions_build_on_each_other_and_cycles_terminate(make_knowledge_base: MakeKnowledgeBase) -> None:
    kb = make_knowledge_base(
        f"e:A owl:equivalentClass {some('e:next', 'e:B')} . e:B owl:equivalentClass {some('e:next', 'e:C')} .",
        f"e:X owl:equivalentClass {some('e:next', 'e:Y')} . e:Y owl:equivalentClass {some('e:next', 'e:X')} .",
        body_turtle("a", "e:next :b"),
        body_turtle("b", "e:next :c"),
        body_turtle("c", "e:next :a", cls="e:C"),
    )
    assert (members(kb, "A"), members(kb, "B"), members(kb, "X")) == (["a"], ["b"], [])


def test_an_anonymous_type_implies_its_named_classes(make_knowledge_base: MakeKnowledgeBase) -> None:
    kb = make_knowledge_base(
        f":a k:describedInMap :room ; a [ owl:intersectionOf ( k:Cup {some('e:holds', 'e:Drink')} ) ] .",
        f"e:Full owl:equivalentClass {some('e:holds', 'e:Drink')} .",
        f":b k:describedInMap :room ; a {some('e:holds', 'e:Drink')} .",
    )
    assert members(kb, "Cup") == ["a"]
    assert why(kb, "Cup", "a") == ("a type (Cup and (holds some Drink))",)
    assert members(kb, "Full") == ["b"]


# -- complements and property chains -----------------------------------------------------------------------------------


def test_a_container_for_a_complement_stores_disjoint_classes(make_knowledge_base: MakeKnowledgeBase) -> None:
    dry = "[ owl:intersectionOf ( e:Food [ owl:complementOf e:Perishable ] ) ]"
    kb = make_knowledge_base(
        f"e:Pantry rdfs:subClassOf {some('k:typePrimaryFunction-containerFor', dry)} .",
        "e:Rice rdfs:subClassOf e:Dry . e:Dry rdfs:subClassOf e:Food ; owl:disjointWith e:Perishable .",
        "e:Milk rdfs:subClassOf e:Food, e:Perishable . e:Salt rdfs:subClassOf e:Food .",
        "e:Tea rdfs:subClassOf e:Food, [ owl:complementOf e:Perishable ] .",
    )
    stored = {local_name(row.item) for row in kb.ask("storage_place", place="Pantry")}
    assert {"Rice", "Tea"} <= stored
    assert not {"Milk", "Salt", "Perishable"} & stored  # salt is not asserted to be disjoint from anything
    (row,) = kb.ask("storage_place", item="Rice")
    assert kb.explain("storage_place", row)[-1] == (
        "every Pantry: typePrimaryFunction-containerFor some (Food and (not Perishable))"
    )


def test_a_property_chain_implies_parts(make_knowledge_base: MakeKnowledgeBase) -> None:
    kb = make_knowledge_base(
        "k:properPhysicalParts owl:propertyChainAxiom ( e:hasSide [ owl:inverseOf e:screwedTo ] ) .",
        body_turtle("shelf", "e:hasSide :left"),
        body_turtle("left"),
        body_turtle("board", "e:screwedTo :left"),
    )
    (row,) = kb.ask("part_of", whole="shelf")
    assert local_name(row.part) == "board"
    assert kb.explain("part_of", row) == ("shelf hasSide left", "board screwedTo left")
    assert [local_name(row.whole) for row in kb.ask("part_of", part="board")] == ["shelf"]


def test_a_property_chain_can_be_recursive(make_knowledge_base: MakeKnowledgeBase) -> None:
    kb = make_knowledge_base(
        "e:locatedIn owl:propertyChainAxiom ( e:locatedIn e:partOf ) . e:partOf a owl:TransitiveProperty .",
        ":cup e:locatedIn :drawer . :drawer e:partOf :desk . :desk e:partOf :room1 . :room1 e:partOf :house .",
        ":house e:partOf :room1 .",
    )
    located = Iri("http://example.org/terms#locatedIn")
    values = kb.reasoner.properties.values(located, individual("cup"))
    assert {local_name(value) for value in values} == {"drawer", "desk", "room1", "house"}
    assert {
        local_name(value) for value in kb.reasoner.properties.values(located, individual("house"), backwards=True)
    } == {"cup"}
