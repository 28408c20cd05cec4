"""Answers as JSON values."""

from __future__ import annotations

import pytest

from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.queries import answers_to_builtins
from mindstage.maps import bundled_kitchen
from mindstage.rdf.graphs import local_name
from tests.cases import each_case
from tests.maps.small_maps import KNOWROB


@pytest.fixture(scope="module")
def kitchen() -> KnowledgeBase:
    kb = KnowledgeBase()
    kb.load(bundled_kitchen())
    return kb


def test_answers_convert_to_json_values(kitchen: KnowledgeBase) -> None:
    result = answers_to_builtins(kitchen, kitchen.ask("storage_place_in_environment", item="CowsMilk"), explain=True)
    (answer,) = result["answers"]
    assert result["question"] == "storage_place_in_environment"
    assert result["args"] == {"item": f"{KNOWROB}CowsMilk"}
    assert answer["iri"] == answer["individual"]
    assert answer["id"] == "fridge"
    assert answer["class"] == kitchen.reasoner.class_of(answer["iri"])
    assert answer["why"]
    assert result["missing"] == []


@each_case(
    ("name", "args", "about"),
    [
        ("what_is", {"individual": "oven"}, "oven"),
        ("everything_in_map", {"individual": "oven"}, "oven"),
        ("handle_of", {"individual": "oven_door"}, "oven_door_handle"),
        ("handle_of", {"handle": "oven_door_handle"}, "oven"),
        ("handle_of", {"individual": "oven", "handle": "oven_door_handle"}, "oven_door_handle"),
        ("storage_place_in_environment", {"item": "CowsMilk", "individual": "fridge"}, "fridge"),
        ("storage_place", {"item": "CowsMilk", "place": "Refrigerator"}, "Refrigerator"),
        ("where_is", {"thing": "plate_3", "relation": "on"}, "table"),
        ("maps", {}, "kitchen"),
    ],
)
def test_each_answer_has_the_name_of_its_subject(
    name: str, args: dict[str, str], about: str, kitchen: KnowledgeBase
) -> None:
    result = answers_to_builtins(kitchen, kitchen.ask(name, **args))
    assert about in {answer["id"] for answer in result["answers"]}


def test_handles_are_the_subject_without_arguments(kitchen: KnowledgeBase) -> None:
    result = answers_to_builtins(kitchen, kitchen.ask("handle_of"))
    assert {answer["id"] for answer in result["answers"]} == {
        local_name(row.handle) for row in kitchen.ask("handle_of")
    }
