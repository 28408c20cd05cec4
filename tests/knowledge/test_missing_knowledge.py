"""Missing knowledge: the reasons that a question gives when it has no answer."""

from __future__ import annotations

from pathlib import Path

import pytest

from mindstage.knowledge import KnowledgeBase
from mindstage.maps import bundled_kitchen
from mindstage.rdf.graphs import local_name
from tests.cases import each_case
from tests.maps.small_maps import body_turtle, knowledge_base_from, room_map


@pytest.fixture(scope="module")
def kitchen() -> KnowledgeBase:
    kb = KnowledgeBase()
    kb.load(bundled_kitchen())
    return kb


@each_case(
    ("name", "args", "why"),
    [
        (
            "storage_place",
            {"item": "Robot"},
            "Robot has no storage place: no class has typePrimaryFunction-containerFor some Robot or some ancestor of "
            "it",
        ),
        (
            "storage_place",
            {"item": "Bread", "place": "Dishwasher"},
            "Bread is not stored in Dishwasher: neither Dishwasher nor an ancestor of it has "
            "typePrimaryFunction-containerFor some Bread or some ancestor of it",
        ),
        (
            "storage_place",
            {"place": "Spoon"},
            "Spoon stores nothing: neither it nor an ancestor of it has typePrimaryFunction-containerFor some …",
        ),
        ("device_for_action", {"action": "Robot"}, "Robot has no such deviceUsed: neither it nor an ancestor of it"),
        ("device_for_action", {"action": "BakingFood", "device": "Dishwasher"}, "it needs HeatSource"),
        ("device_for_action", {"device": "Cup"}, "no action needs a Cup: no deviceUsed names it"),
        ("handle_of", {"individual": "fridge_door_handle"}, "has no handle: it has no parts"),
        ("handle_of", {"handle": "plate_3"}, "plate_3 (Plate) is no Handle"),
        ("handle_of", {"individual": "fridge_door", "handle": "plate_3"}, "plate_3 (Plate) is no Handle"),
        (
            "handle_of",
            {"individual": "fridge_door", "handle": "oven_door_handle"},
            "fridge_door (ApplianceDoorW60H140) has another handle, fridge_door_handle",
        ),
        (
            "part_of",
            {"whole": "fridge_door_handle"},
            "fridge_door_handle is made of nothing: neither child, parent",
        ),
        ("part_of", {"part": "plate_3"}, "plate_3 is a part of nothing: neither child, parent nor a part-of property"),
        ("part_of", {"part": "plate_3", "whole": "fridge"}, "plate_3 is no part of fridge: neither child"),
        ("subclass_of", {"cls": "Refrigerator", "superclass": "Cup"}, "Refrigerator is no Cup: it is "),
        (
            "class_properties",
            {"cls": "Refrigerator", "property": "deviceUsed"},
            "nor an ancestor of it has deviceUsed",
        ),
        ("class_properties", {"cls": "Bread", "property": "deviceUsed", "value": "Oven"}, "of it has deviceUsed Oven"),
        ("class_properties", {"cls": "Bread", "value": "Oven"}, "neither Bread nor an ancestor of it has … Oven"),
        ("class_properties", {"property": "deviceUsed", "value": "Bread"}, "no class has deviceUsed Bread"),
        (
            "storage_place_in_environment",
            {"individual": "plate_3"},
            "plate_3 (Plate) stores nothing: none of its classes and their ancestors has "
            "typePrimaryFunction-containerFor some …",
        ),
        ("storage_place_in_environment", {"item": "CowsMilk", "individual": "oven"}, "oven is no Refrigerator"),
        (
            "device_for_action",
            {"device": "IAIOvenCase"},
            "no action needs a IAIOvenCase: no deviceUsed names it or a subclass of it; ask about its ancestor "
            "HeatSource",
        ),
        (
            "device_for_action_in_environment",
            {"individual": "plate_3"},
            "plate_3 (Plate) is needed by no action: no deviceUsed names one of its classes",
        ),
        ("individual_of_class", {"cls": "Robot"}, "no individual in any map is a Robot"),
        ("individual_of_class", {"cls": "Cup", "individual": "fridge_door"}, "fridge_door is no Cup"),
    ],
)
def test_a_question_without_answers_gives_the_missing_statement(
    name: str, args: dict[str, str], why: str, kitchen: KnowledgeBase
) -> None:
    answers = kitchen.ask(name, **args)
    assert not answers
    assert why in answers.missing[0].reason


@each_case(
    ("args", "why"),
    [
        ({"thing": "plate_3"}, "plate_3 (Plate) has no door, drawer or lid that a joint moves"),
        ({"part": "plate_3"}, "plate_3 (Plate) opens nothing: it is no door, drawer or lid that a joint moves"),
        ({"thing": "oven", "part": "fridge_door"}, "fridge_door opens fridge, not oven"),
        (
            {"thing": "fridge_door"},
            "nothing opens fridge_door, which itself opens fridge: ask for part=fridge_door",
        ),
        ({"thing": "fridge", "state": "open"}, "joint positions are unknown"),
    ],
)
def test_fixed_containers_differ_from_unmeasured_ones(args: dict[str, str], why: str, kitchen: KnowledgeBase) -> None:
    (missing,) = kitchen.ask("articulated_parts", **args).missing
    assert missing.reason.startswith(why)


def test_a_map_without_purposes_gives_the_missing_restrictions(tmp_path: Path) -> None:
    path = tmp_path / "room.ttl"
    path.write_text(room_map(body_turtle("cup")), encoding="utf-8")
    kb = knowledge_base_from(path)
    (missing,) = kb.ask("storage_place").missing
    assert missing.reason == "no class has typePrimaryFunction-containerFor some …"
    (missing,) = kb.ask("device_for_action").missing
    assert missing.reason == "no class has deviceUsed some …"
    (missing,) = kb.ask("storage_place_in_environment").missing
    assert missing.reason.startswith("everything in all maps stores nothing: none of its classes")
    (missing,) = kb.ask("class_properties").missing
    assert missing.reason == "no class has a restriction on its members"


def test_a_known_class_without_individuals_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "room.ttl"
    path.write_text(room_map(body_turtle("cup")), encoding="utf-8")
    kb = knowledge_base_from(path, bundled_ontology=True)
    (missing,) = kb.ask("storage_place_in_environment", item="CowsMilk").missing
    assert missing.reason == "no individual in any map is a Refrigerator"
    (missing,) = kb.ask("device_for_action_in_environment", action="BakingFood", map="room").missing
    assert missing.reason == "no individual in room is a HeatSource"
    assert kb.ask("storage_place_in_environment", item="Robot").missing == kb.ask("storage_place", item="Robot").missing


def test_empty_maps_and_individuals_without_a_map_are_reported(tmp_path: Path) -> None:
    path = tmp_path / "room.ttl"
    path.write_text(
        room_map("k:Cup a owl:Class . :cup a k:Cup . e:Lonely a owl:Class . e:Only rdfs:subClassOf k:Cup ."),
        encoding="utf-8",
    )
    kb = knowledge_base_from(path)
    assert kb.ask("everything_in_map").missing == ()
    (missing,) = kb.ask("everything_in_map", map="room").missing
    assert missing.reason == "nothing is in room: there is no describedInMap statement"
    (missing,) = kb.ask("everything_in_map", individual="cup").missing
    assert (local_name(missing.cls), local_name(missing.property)) == ("Cup", "describedInMap")
    (missing,) = kb.ask("subclass_of", cls="Lonely").missing
    assert missing.reason == "Lonely has no superclass: no subClassOf statement or definition names one"
    (missing,) = kb.ask("siblings", cls="Lonely").missing
    assert missing.reason == "Lonely has no sibling: it has no direct superclass"
    (missing,) = kb.ask("siblings", cls="Only", sibling="Lonely").missing
    assert missing.reason == "Lonely is no sibling of Only: it is not directly below Cup"
    (missing,) = kb.ask("identical_maps").missing
    assert missing.reason == "1 map is loaded, and a comparison needs two"
    (missing,) = KnowledgeBase(bundled_ontology=False).ask("maps").missing
    assert missing.reason.startswith("no semantic map is loaded")
