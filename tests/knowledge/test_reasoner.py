"""The reasoner on unions, intersections, cardinalities, equivalent classes, parts and cycles."""

from __future__ import annotations

import pytest

from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.explain import expression_text
from mindstage.knowledge.owl import NamedClass, UnionOf, UnparsedExpression
from mindstage.knowledge.reasoner_classes import discard_from_group
from mindstage.rdf.graphs import local_name
from mindstage.scene import Iri
from tests.maps.small_maps import MakeKnowledgeBase, body_turtle, individual

RDF = "http://www.w3.org/1999/02/22-rdf-syntax-ns#"
CONTAINER = "k:typePrimaryFunction-containerFor"


def some(filler: str, property: str = CONTAINER) -> str:
    return f"[ a owl:Restriction ; owl:onProperty {property} ; owl:someValuesFrom {filler} ]"


def places(kb: KnowledgeBase, item: str) -> list[str]:
    return [local_name(row.place) for row in kb.ask("storage_place", item=item)]


def supers(kb: KnowledgeBase, cls: str) -> set[str]:
    return {local_name(row.superclass) for row in kb.ask("subclass_of", cls=cls)}


def test_a_container_for_a_union_stores_every_member(make_knowledge_base: MakeKnowledgeBase) -> None:
    union = "[ a owl:Class ; owl:unionOf ( e:Fork e:Plate ) ]"
    kb = make_knowledge_base(
        f"e:Dishwasher rdfs:subClassOf {some(union)} . e:Cup a owl:Class . e:SoupPlate rdfs:subClassOf e:Plate ."
    )
    assert places(kb, "Fork") == places(kb, "SoupPlate") == ["Dishwasher"]
    assert places(kb, "Cup") == []


def test_a_container_for_an_intersection_stores_common_subclasses(make_knowledge_base: MakeKnowledgeBase) -> None:
    both = "[ a owl:Class ; owl:intersectionOf ( e:Food e:Liquid ) ]"
    kb = make_knowledge_base(
        f"e:Jug rdfs:subClassOf {some(both)} . e:Soup rdfs:subClassOf e:Food, e:Liquid .",
        "e:Oil rdfs:subClassOf e:Liquid .",
    )
    assert places(kb, "Soup") == ["Jug"]
    assert places(kb, "Oil") == places(kb, "Food") == []


def test_unions_and_intersections_can_be_nested(make_knowledge_base: MakeKnowledgeBase) -> None:
    nested = "[ owl:intersectionOf ( e:Food [ owl:unionOf ( e:Liquid e:Powder ) ] ) ]"
    kb = make_knowledge_base(
        f"e:Jar rdfs:subClassOf {some(nested)} . e:Flour rdfs:subClassOf e:Food, e:Powder .",
        "e:Sand rdfs:subClassOf e:Powder .",
    )
    assert places(kb, "Flour") == ["Jar"]
    assert places(kb, "Sand") == []


@pytest.mark.parametrize(
    ("restriction", "is_place"),
    [
        ("owl:someValuesFrom e:Bread", True),
        ("owl:allValuesFrom e:Bread", False),
        ("owl:minQualifiedCardinality 1 ; owl:onClass e:Bread", True),
        ("owl:qualifiedCardinality 2 ; owl:onClass e:Bread", True),
        ("owl:qualifiedCardinality 0 ; owl:onClass e:Bread", False),
        ("owl:maxQualifiedCardinality 2 ; owl:onClass e:Bread", False),
        ("owl:minCardinality 1", False),
        ("owl:hasValue e:Bread", False),
    ],
)
def test_only_restrictions_that_imply_existence_make_a_storage_place(
    make_knowledge_base: MakeKnowledgeBase, restriction: str, is_place: bool
) -> None:
    kb = make_knowledge_base(
        f"e:Basket rdfs:subClassOf [ a owl:Restriction ; owl:onProperty {CONTAINER} ; {restriction} ] .",
        "e:Bread a owl:Class .",
    )
    assert places(kb, "Bread") == (["Basket"] if is_place else [])


def test_subproperties_count_as_the_property(make_knowledge_base: MakeKnowledgeBase) -> None:
    kb = make_knowledge_base(
        f"e:keeps rdfs:subPropertyOf {CONTAINER} . e:Shelf rdfs:subClassOf {some('e:Book', 'e:keeps')} ."
    )
    (row,) = kb.ask("storage_place", item="Book")
    assert kb.explain("storage_place", row)[-1] == "keeps implies typePrimaryFunction-containerFor"


def test_a_restriction_on_the_inverse_property_is_not_used(make_knowledge_base: MakeKnowledgeBase) -> None:
    kb = make_knowledge_base(
        f"e:Shelf rdfs:subClassOf {some('e:Book', f'[ owl:inverseOf {CONTAINER} ]')} . e:Book a owl:Class ."
    )
    assert places(kb, "Book") == []
    (row,) = kb.ask("class_properties", cls="Shelf")
    assert kb.explain("class_properties", row) == (
        "every Shelf: inverse of typePrimaryFunction-containerFor some Book",
    )


def test_equivalent_classes_are_subclasses_of_each_other(make_knowledge_base: MakeKnowledgeBase) -> None:
    kb = make_knowledge_base("e:Fridge owl:equivalentClass e:Refrigerator . e:Refrigerator rdfs:subClassOf e:Device .")
    assert supers(kb, "Fridge") == {"Refrigerator", "Device"}
    assert supers(kb, "Refrigerator") == {"Fridge", "Device"}


def test_a_class_equivalent_to_an_intersection_is_below_its_members(make_knowledge_base: MakeKnowledgeBase) -> None:
    kb = make_knowledge_base(f"e:BreadBox owl:equivalentClass [ owl:intersectionOf ( e:Box {some('e:Bread')} ) ] .")
    assert supers(kb, "BreadBox") == {"Box"}
    assert places(kb, "Bread") == ["BreadBox"]


def test_a_class_equivalent_to_a_union_is_above_its_members(make_knowledge_base: MakeKnowledgeBase) -> None:
    kb = make_knowledge_base(
        "e:Cutlery owl:equivalentClass [ owl:unionOf ( e:Fork e:Knife ) ] . e:Tool owl:unionOf ( e:Saw ) ."
    )
    assert supers(kb, "Fork") == {"Cutlery"}
    assert supers(kb, "Saw") == {"Tool"}
    assert supers(kb, "Cutlery") == set()


def test_the_most_specific_place_comes_first_for_any_number_of_steps(make_knowledge_base: MakeKnowledgeBase) -> None:
    # Rye bread is also directly a subclass of Perishable: one step, yet the most general class.
    kb = make_knowledge_base(
        "e:Rye rdfs:subClassOf e:Bread, e:Perishable . e:Bread rdfs:subClassOf e:Baked .",
        "e:Baked rdfs:subClassOf e:Perishable .",
        f"e:Fridge rdfs:subClassOf {some('e:Perishable')} . e:Basket rdfs:subClassOf {some('e:Bread')} .",
        f"e:Tin rdfs:subClassOf {some('e:Baked')} . e:RyeBox rdfs:subClassOf {some('e:Rye')} .",
    )
    assert places(kb, "Rye") == ["RyeBox", "Basket", "Tin", "Fridge"]


def test_cyclic_and_unterminated_lists_are_read_up_to_the_error(make_knowledge_base: MakeKnowledgeBase) -> None:
    kb = make_knowledge_base(
        f"@prefix rdf: <{RDF}> . _:list rdf:first e:Fork ; rdf:rest _:list . _:open rdf:first e:Knife .",
        f"e:Drawer rdfs:subClassOf {some('[ owl:unionOf _:list ]')} .",
        f"e:Block rdfs:subClassOf {some('[ owl:unionOf _:open ]')} .",
        "e:Odd rdfs:subClassOf [ a owl:Restriction ; owl:onProperty 3 ; owl:someValuesFrom e:Fork ] .",
        'e:Odd rdfs:subClassOf [ a owl:Restriction ; owl:onProperty e:p ; owl:cardinality "many" ] .',
        f"_:me owl:unionOf ( _:me e:Spoon ) . e:Rack rdfs:subClassOf {some('_:me')} . e:Odd a owl:Class .",
    )
    assert places(kb, "Fork") == ["Drawer"]
    assert places(kb, "Knife") == ["Block"]
    assert places(kb, "Spoon") == ["Rack"]
    assert list(kb.ask("class_properties", cls="Odd")) == []


def test_restrictions_name_the_class_they_are_inherited_from(make_knowledge_base: MakeKnowledgeBase) -> None:
    kb = make_knowledge_base(
        f"e:Fridge rdfs:subClassOf e:Device, {some('e:Food')} . e:Device rdfs:subClassOf "
        "[ a owl:Restriction ; owl:onProperty e:plug ; owl:cardinality 1 ], "
        '[ a owl:Restriction ; owl:onProperty e:colour ; owl:hasValue "white" ] .'
    )
    rows = kb.ask("class_properties", cls="Fridge")
    assert [(local_name(row.source), row.kind, row.count, local_name(row.value)) for row in rows] == [
        ("Fridge", "someValuesFrom", None, "Food"),
        ("Device", "hasValue", None, "white"),
        ("Device", "cardinality", 1, "anything"),
    ]
    assert kb.explain("class_properties", rows[2]) == ("Fridge is a Device", "every Device: plug exactly 1 anything")


def test_parts_follow_from_all_part_properties_to_any_depth(make_knowledge_base: MakeKnowledgeBase) -> None:
    kb = make_knowledge_base(
        body_turtle("door", "k:child :panel"),
        body_turtle("panel"),
        body_turtle("handle", "k:parent :panel", cls="k:Handle"),
        body_turtle("screw"),
        ":handle k:properPhysicalParts :screw . e:bit rdfs:subPropertyOf k:properPhysicalParts .",
        ":screw e:bit :thread .",
        body_turtle("thread"),
    )
    rows = kb.ask("part_of", whole="door")
    assert [(local_name(row.part), row.depth) for row in rows] == [
        ("panel", 1),
        ("handle", 2),
        ("screw", 3),
        ("thread", 4),
    ]
    assert kb.explain("part_of", rows[1]) == ("door child panel", "handle parent panel")
    assert {local_name(row.whole) for row in kb.ask("part_of", part="thread")} == {"door", "panel", "handle", "screw"}
    assert [row.handle for row in kb.ask("handle_of", individual="door")] == [individual("handle")]


def test_a_cycle_of_parts_terminates_and_nothing_is_its_own_part(make_knowledge_base: MakeKnowledgeBase) -> None:
    kb = make_knowledge_base(
        body_turtle("a", "k:child :b"), body_turtle("b", "k:child :c"), body_turtle("c", "k:child :a")
    )
    assert [local_name(row.part) for row in kb.ask("part_of", whole="a")] == ["b", "c"]


def test_a_jointed_body_is_not_a_part_but_its_handle_counts(make_knowledge_base: MakeKnowledgeBase) -> None:
    kb = make_knowledge_base(
        body_turtle("oven"),
        body_turtle("door", "k:child :handle"),
        body_turtle("handle", cls="k:Handle"),
        ":hinge a k:Constraint ; k:describedInMap :room ; k:parent :oven ; k:child :door .",
    )
    assert list(kb.ask("part_of", whole="oven")) == []
    (row,) = kb.ask("handle_of", individual="oven")
    assert kb.explain("handle_of", row)[:3] == ("hinge parent oven", "hinge child door", "door child handle")


def test_an_individual_in_two_maps_has_an_answer_for_each(make_knowledge_base: MakeKnowledgeBase) -> None:
    kb = make_knowledge_base(body_turtle("cup", "k:describedInMap :other"), ":other a k:SemanticEnvironmentMap .")
    assert [local_name(row.map) for row in kb.ask("individual_of_class", cls="Cup", individual="cup")] == [
        "other",
        "room",
    ]
    (row,) = kb.ask("everything_in_map", map="other")
    assert row.individual == individual("cup")


def test_removing_what_is_in_no_group_changes_nothing() -> None:
    groups: dict[str, dict[str, None]] = {"a": {"x": None, "y": None}}
    discard_from_group(groups, "b", "x")
    discard_from_group(groups, "a", "x")
    assert groups == {"a": {"y": None}}
    discard_from_group(groups, "a", "y")
    assert groups == {}, "an empty group is removed"


def test_an_expression_without_a_meaning_is_shown_as_dots() -> None:
    fork = NamedClass(Iri("http://example.org/e#Fork"))
    assert expression_text(UnionOf((fork, UnparsedExpression()))) == "(Fork or …)"
