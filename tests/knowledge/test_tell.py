"""Assertions and retractions at run time."""

from __future__ import annotations

from pathlib import Path

import pytest

from mindstage.errors import InvalidArgumentError, NameNotFoundError
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.queries import cell_text
from mindstage.maps import bundled_kitchen
from mindstage.rdf.graphs import local_name
from mindstage.scene import Literal
from tests.maps.small_maps import KNOWROB, ROOM_NAMESPACE, body_turtle, knowledge_base_from, room_map

CONTAINER_FOR = "typePrimaryFunction-containerFor"


@pytest.fixture
def kb() -> KnowledgeBase:
    kb = KnowledgeBase()
    kb.load(bundled_kitchen())
    return kb


def places(kb: KnowledgeBase, item: str) -> list[str]:
    return [local_name(row.place) for row in kb.ask("storage_place", item=item)]


def test_asserting_a_missing_statement_gives_an_answer(kb: KnowledgeBase) -> None:
    (missing,) = kb.ask("storage_place", item="Robot").missing
    kb.tell("Cupboard", missing.property, missing.cls)
    assert places(kb, "Robot") == ["Cupboard"]
    assert kb.ask("storage_place_in_environment", item="Robot")
    assert kb.retract("Cupboard", missing.property, missing.cls)
    assert places(kb, "Robot") == []


def test_an_asserted_more_specific_place_comes_first(kb: KnowledgeBase) -> None:
    assert places(kb, "CowsMilk") == ["Refrigerator"]
    kb.tell("ms:MilkRack", "subClassOf", "Refrigerator")
    kb.tell("MilkRack", CONTAINER_FOR, "CowsMilk")
    assert places(kb, "CowsMilk") == ["MilkRack", "Refrigerator"]


def test_an_asserted_breadbasket_comes_before_the_fridge(tmp_path: Path) -> None:
    path = tmp_path / "room.ttl"
    perishable = "[ a owl:Restriction ; owl:onProperty k:typePrimaryFunction-containerFor ; owl:someValuesFrom k:Food ]"
    path.write_text(
        room_map(
            f"k:Bread rdfs:subClassOf k:Food . k:Fridge rdfs:subClassOf {perishable} . k:Basket a owl:Class .",
            body_turtle("a_fridge", cls="k:Fridge"),
            body_turtle("a_basket", cls="k:Basket"),
        ),
        encoding="utf-8",
    )
    kb = knowledge_base_from(path)
    assert places(kb, "Bread") == ["Fridge"]
    kb.tell("Basket", CONTAINER_FOR, "Bread")
    assert places(kb, "Bread") == ["Basket", "Fridge"]
    here = kb.ask("storage_place_in_environment", item="Bread")
    assert [local_name(row.individual) for row in here] == ["a_basket", "a_fridge"]
    assert kb.explain("storage_place_in_environment", here[0]) == (
        "every Basket: typePrimaryFunction-containerFor some Bread",
        "a_basket type Basket",
    )
    kb.retract("Basket", CONTAINER_FOR, "Bread")
    assert places(kb, "Bread") == ["Fridge"]


def test_assertions_are_among_the_facts_of_an_individual(kb: KnowledgeBase) -> None:
    (before,) = kb.ask("what_is", individual="fridge_door")
    kb.tell("fridge_door", "label", "the cold door")
    (after,) = kb.ask("what_is", individual="fridge_door")
    (fact,) = set(after.facts) - set(before.facts)
    assert isinstance(fact.value, Literal)
    assert fact.value.text == "the cold door"
    kb.tell("knowrob:cup_of_joe", "type", "Cup")
    kb.tell("cup_of_joe", "label", "Joe's")
    (row,) = kb.ask("what_is", individual="cup_of_joe")
    assert [cell_text(fact) for fact in row.facts] == ["label Joe's"]


def test_asserting_a_fact_keeps_worlds_and_reasoner(kb: KnowledgeBase) -> None:
    world, index, hierarchy = kb.world(), kb.reasoner, kb.reasoner.classes
    kb.tell("fridge_door", "label", "the cold door")
    assert kb.world() is world
    assert kb.reasoner is index
    kb.tell("ms:MilkRack", "subClassOf", "Refrigerator")
    assert kb.reasoner is index
    assert kb.reasoner.classes is hierarchy


def test_asserting_twice_has_no_effect(kb: KnowledgeBase) -> None:
    for _ in range(2):
        kb.tell("Cupboard", CONTAINER_FOR, "Robot")
    assert len(kb.ask("class_properties", cls="Cupboard", property=CONTAINER_FOR)) == len(
        {row.value for row in kb.ask("class_properties", cls="Cupboard", property=CONTAINER_FOR)}
    )
    assert kb.retract("Cupboard", CONTAINER_FOR, "Robot")
    assert not kb.retract("Cupboard", CONTAINER_FOR, "Robot")
    assert places(kb, "Robot") == []


def test_statements_of_sources_can_be_retracted(kb: KnowledgeBase) -> None:
    assert kb.retract("Refrigerator", CONTAINER_FOR, "Perishable")
    assert places(kb, "CowsMilk") == []


def test_an_individual_gets_a_class_a_part_and_a_value(tmp_path: Path) -> None:
    path = tmp_path / "room.ttl"
    path.write_text(
        room_map(body_turtle("door"), body_turtle("bar"), "k:mass a owl:DatatypeProperty ."), encoding="utf-8"
    )
    kb = knowledge_base_from(path, bundled_ontology=True)
    kb.tell("bar", "type", "Handle")
    kb.tell("door", "child", "bar")
    kb.tell("door", "mass", 2.5)
    assert [row.handle for row in kb.ask("handle_of", individual="door")] == [ROOM_NAMESPACE + "bar"]
    assert kb.sparql(f"ASK {{ <{ROOM_NAMESPACE}door> knowrob:mass 2.5e0 }}").boolean
    assert kb.retract("door", "mass", 2.5)
    assert not kb.sparql(f"ASK {{ <{ROOM_NAMESPACE}door> knowrob:mass 2.5e0 }}").boolean


def test_a_new_subject_is_created_by_its_class(kb: KnowledgeBase) -> None:
    kb.tell("knowrob:cup_of_joe", "type", "Cup")
    (row,) = kb.ask("what_is", individual="cup_of_joe")
    assert row.classes == (KNOWROB + "Cup",)
    assert row.map is None
    kb.tell("cup_of_joe", "describedInMap", "kitchen")
    assert len(kb.ask("everything_in_map", individual="cup_of_joe")) == 1


def test_a_property_can_be_asserted_as_subproperty(kb: KnowledgeBase) -> None:
    kb.tell("contains", "subPropertyOf", CONTAINER_FOR)
    kb.tell("Cupboard", "contains", "Robot")
    assert places(kb, "Robot") == ["Cupboard"]


def test_labels_are_strings(kb: KnowledgeBase) -> None:
    kb.tell("Cupboard", "label", "press")
    assert kb.sparql('ASK { knowrob:Cupboard rdfs:label "press" }').boolean
    assert kb.retract("Cupboard", "label", "press")


def test_assertions_do_not_change_the_world_of_a_map(kb: KnowledgeBase) -> None:
    before = kb.world()
    kb.tell("fridge_door", "child", "fridge")
    assert kb.world() == before


def test_an_asserted_map_has_individuals_but_no_world(kb: KnowledgeBase) -> None:
    kb.tell("ms:shed", "type", "SemanticEnvironmentMap")
    kb.tell("ms:rake", "type", "Tool")
    kb.tell("rake", "describedInMap", "shed")
    assert [local_name(row.individual) for row in kb.ask("everything_in_map", map="shed")] == ["rake"]
    (row,) = kb.ask("what_is", individual="rake")
    assert row.pose is None
    assert not kb.ask("analyze", map="shed")
    assert not kb.ask("identical_maps", a="shed", b="kitchen")
    assert len(kb.ask("analyze")) == 1


def test_numbers_are_retracted_by_value_and_strings_in_any_language(kb: KnowledgeBase) -> None:
    (row,) = kb.ask("what_is", individual="milk_carton_1")
    assert row.mass_kg
    assert kb.retract("milk_carton_1", "mass", row.mass_kg)
    assert not kb.sparql("ASK { <http://mindstage.org/maps/kitchen.owl#milk_carton_1> knowrob:mass ?mass }").boolean
    assert kb.retract("Refrigerator", "label", "refrigerator")
    assert kb.retract("FridgeW60H140", "widthOfObject", 0.6)


def test_retracting_another_value_of_a_class_changes_nothing(kb: KnowledgeBase) -> None:
    has_mass = "ASK { knowrob:Cup rdfs:subClassOf [ owl:onProperty knowrob:mass ; owl:hasValue ?mass ] }"
    kb.tell("Cup", "mass", 0.3)
    assert not kb.retract("Cup", "mass", 0.4)
    assert kb.sparql(has_mass).boolean
    assert kb.retract("Cup", "mass", 0.3)
    assert not kb.sparql(has_mass).boolean


def test_asserted_classes_have_ancestors(kb: KnowledgeBase) -> None:
    kb.tell("ms:MilkRack", "subClassOf", "Refrigerator")
    milk_rack = kb.names.find_any("MilkRack")
    assert milk_rack is not None
    assert KNOWROB + "Refrigerator" in kb.ancestors(milk_rack[0])


@pytest.mark.parametrize(
    ("statement", "error", "message"),
    [
        (("Cupbord", CONTAINER_FOR, "Bread"), NameNotFoundError, "near: 'Cupboard'"),
        (("Cupboard", "typePrimaryFunction-containerFr", "Bread"), NameNotFoundError, f"near: '{CONTAINER_FOR}'"),
        (("Cupboard", CONTAINER_FOR, "Braed"), NameNotFoundError, "no class or individual 'Braed'"),
        (("Cupboard", CONTAINER_FOR, 3), InvalidArgumentError, "it leads to resources, and 3 is none"),
        (("Cupboard", "subClassOf", True), InvalidArgumentError, "it leads to resources, and True is none"),
        (("NewThing", "subClassOf", "Cupboard"), NameNotFoundError, "no class, individual or property 'NewThing'"),
        (("ms:New Thing", "subClassOf", "Cupboard"), InvalidArgumentError, "New Thing"),
        (("ms:NewThing", "child", "fridge"), NameNotFoundError, "'ms:NewThing'"),
    ],
)
def test_an_invalid_statement_is_refused_without_effect(
    statement: tuple[str, str, object], error: type[Exception], message: str, kb: KnowledgeBase
) -> None:
    before = len(kb.sparql("SELECT * { ?s ?p ?o }").rows)
    with pytest.raises(error, match=message):
        kb.tell(*statement)
    with pytest.raises(error, match=message):
        kb.retract(*statement)
    assert len(kb.sparql("SELECT * { ?s ?p ?o }").rows) == before
