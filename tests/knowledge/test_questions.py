"""The questions: what they answer, in the thesis's laboratory and in the bundled kitchen, and how they explain it."""

from __future__ import annotations

from collections.abc import Callable
from itertools import chain, combinations
from pathlib import Path

import pytest

from mindstage.errors import ArgumentRefused, NameAmbiguous, NameUnknown, QuestionUnknown
from mindstage.knowledge import KnowledgeBase, bundled_kitchen
from mindstage.knowledge.names import local_name
from mindstage.knowledge.questions import (
    HandleOf,
    Question,
    Storage,
    answers_to_builtins,
    handle_of,
    question,
    questions,
    storage_place,
)
from mindstage.world import Iri
from tests.knowledge.maps import KNOWROB, M, body, knowing, room

IAI = "iai-kitchen-original.owl"


@pytest.fixture(scope="module")
def kitchen() -> KnowledgeBase:
    kb = KnowledgeBase()
    kb.load(bundled_kitchen())
    return kb


@pytest.fixture(scope="module", params=["community", "bundled"])
def laboratory(request: pytest.FixtureRequest, shared_data: Path) -> KnowledgeBase:
    """The thesis's kitchen, with the ontologies of its time, and with the bundled one alone."""
    community = request.param == "community"
    kb = KnowledgeBase(bundled_ontology=not community)
    kb.load(shared_data / "maps" / IAI, ontologies=[shared_data / "ontology"] if community else [])
    return kb


def classes(kb: KnowledgeBase, individuals: list[Iri]) -> list[str]:
    return sorted(local_name(str(kb.index.class_of(individual))) for individual in individuals)


# -- the thesis --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("cls", "count"), [("Handle", 18), ("Door", 13), ("StorageConstruct", 18), ("ElectricalDevice", 14)]
)
def test_there_are_as_many_of_a_class_as_the_thesis_counted(laboratory: KnowledgeBase, cls: str, count: int) -> None:
    assert len({row.individual for row in laboratory.ask("individual_of_class", cls=cls)}) == count


def test_milk_is_stored_in_the_refrigerator_which_is_here_the_fridge_s_casing(laboratory: KnowledgeBase) -> None:
    assert [local_name(row.place) for row in laboratory.ask("storage_place", item="CowsMilk")] == ["Refrigerator"]
    here = laboratory.ask("storage_place_in_environment", item="CowsMilk")
    assert classes(laboratory, [row.individual for row in here]) == ["IAIFridgeCasing"]


@pytest.mark.parametrize(
    ("action", "devices", "here"),
    [
        ("BakingFood", ["HeatSource"], ["IAICooktop", "IAIOvenCase"]),
        ("WashingDishesByMachine", ["Dishwasher"], ["IAIDishwasherCase"]),
    ],
)
def test_an_action_has_its_devices(laboratory: KnowledgeBase, action: str, devices: list[str], here: list[str]) -> None:
    assert [local_name(row.device) for row in laboratory.ask("device_for_action", action=action)] == devices
    rows = laboratory.ask("device_for_action_in_environment", action=action)
    assert classes(laboratory, [row.individual for row in rows]) == here


@pytest.mark.parametrize("individual", ["IAIFridgeDoor", "IAIOvenDoor", "IAIOvenCase"])
def test_the_fridge_door_and_the_oven_have_one_handle_each(laboratory: KnowledgeBase, individual: str) -> None:
    (row,) = laboratory.ask("handle_of", individual=individual)
    assert laboratory.index.is_member(row.handle, Iri(KNOWROB + "Handle"))


def test_the_numbers_of_the_thesis(laboratory: KnowledgeBase) -> None:
    (row,) = laboratory.ask("analyse")
    assert (row.classes, row.individuals, row.objects, row.constraints, row.relations) == (64, 136, 114, 22, 55)
    assert len(laboratory.ask("everything_in_map")) == 136


def test_the_maps_of_the_thesis_differ_by_what_it_left_out(shared_data: Path) -> None:
    kb = knowing(shared_data / "maps" / IAI, shared_data / "maps" / "iai-kitchen-spawned.owl")
    one, other = (row.map for row in kb.ask("maps"))
    (row,) = kb.ask("identical_maps", a=one, b=other, tolerance=2e-6)
    assert not row.identical
    assert len(row.differing) < len(kb.ask("identical_maps", a=one, b=other)[0].differing)


# -- every question ----------------------------------------------------------------------------------------------------


each_question = pytest.mark.parametrize("asked", questions(), ids=lambda asked: asked.name)


@each_question
def test_whatever_is_bound_the_answers_agree(asked: Question, kitchen: KnowledgeBase) -> None:
    every = kitchen.ask(asked.name)
    names = [argument.name for argument in asked.arguments if argument.name in asked.columns]
    subsets = list(chain.from_iterable(combinations(names, size) for size in range(1, len(names) + 1)))
    for row in every[:: max(1, len(every) // 12)]:
        for subset in subsets:
            bound = {name: getattr(row, name) for name in subset}
            expected = {each for each in every if all(getattr(each, name) == bound[name] for name in subset)}
            assert set(kitchen.ask(asked.name, **bound)) == expected, bound


@each_question
def test_no_answer_comes_twice_and_the_order_stays(asked: Question, kitchen: KnowledgeBase) -> None:
    answers = list(kitchen.ask(asked.name))
    assert len(answers) == len(set(answers))
    again = KnowledgeBase()
    again.load(bundled_kitchen())
    assert list(again.ask(asked)) == answers


@each_question
def test_a_question_says_what_it_asks_and_shows_how(asked: Question) -> None:
    assert asked.text.splitlines()[0].endswith(".")
    assert asked.examples
    assert all(example.split()[0] == asked.name for example in asked.examples)
    assert all(argument.default is None or argument.name == "tolerance" for argument in asked.arguments)


@pytest.mark.parametrize(
    ("name", "args"),
    [
        ("storage_place", {"item": "Bread"}),
        ("storage_place_in_environment", {"item": "CowsMilk"}),
        ("device_for_action", {"action": "BakingFood"}),
        ("device_for_action_in_environment", {"action": "BakingFood"}),
        ("handle_of", {"individual": "fridge_door"}),
        ("part_of", {"whole": "fridge_door"}),
        ("class_properties", {"cls": "Dishwasher"}),
        ("subclass_of", {"cls": "Dishwasher"}),
        ("siblings", {"cls": "Dishwasher"}),
        ("individual_of_class", {"cls": "Handle"}),
        ("everything_in_map", {"individual": "fridge_door"}),
        ("what_is", {"individual": "fridge_door"}),
    ],
)
def test_each_answer_tells_why(name: str, args: dict[str, str], kitchen: KnowledgeBase) -> None:
    answers = kitchen.ask(name, **args)
    assert answers
    for row in answers:
        lines = kitchen.why(name, row)
        assert lines
        assert all(lines), lines


def test_the_reason_is_a_chain_of_what_was_told(kitchen: KnowledgeBase) -> None:
    (row,) = kitchen.ask(storage_place, item="CowsMilk")
    assert kitchen.why(storage_place, row) == (
        "CowsMilk is a CowsMilk-Product is a DairyProduct is a Perishable",
        "every Refrigerator: typePrimaryFunction-containerFor some Perishable",
    )


def test_bread_is_kept_in_the_breadbasket_before_the_refrigerator(kitchen: KnowledgeBase) -> None:
    places = [local_name(row.place) for row in kitchen.ask("storage_place", item="Bread")]
    assert places == ["Breadbasket", "Refrigerator"]
    here = [local_name(row.place) for row in kitchen.ask("storage_place_in_environment", item="Bread")]
    assert here == places


def test_what_an_individual_is_comes_from_its_world(kitchen: KnowledgeBase) -> None:
    (row,) = kitchen.ask("what_is", individual="fridge_door")
    door = kitchen.world().body("fridge_door")
    assert (row.pose, row.size, row.mass_kg, row.tags, row.facts) == (
        door.pose,
        door.size,
        door.physics.mass_kg,
        door.tags,
        door.facts,
    )
    assert row.classes[0] == door.cls


# -- what is missing ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "args", "why"),
    [
        (
            "storage_place",
            {"item": "Robot"},
            "Robot has no container: no typePrimaryFunction-containerFor names Robot or an ancestor of it",
        ),
        (
            "storage_place",
            {"item": "Bread", "place": "Dishwasher"},
            "Bread is not kept in Dishwasher: no typePrimaryFunction-containerFor of Dishwasher names Bread or an "
            "ancestor of it",
        ),
        (
            "storage_place",
            {"place": "Spoon"},
            "Spoon keeps nothing: it does not say typePrimaryFunction-containerFor some …",
        ),
        ("device_for_action", {"action": "Robot"}, "Robot has no such deviceUsed: neither it nor an ancestor of it"),
        ("device_for_action", {"action": "BakingFood", "device": "Dishwasher"}, "it needs HeatSource"),
        ("device_for_action", {"device": "Cup"}, "no action needs a Cup: no deviceUsed names it"),
        ("handle_of", {"individual": "fridge_door_handle"}, "has no handle: none of its parts is a Handle"),
        ("part_of", {"whole": "fridge_door_handle"}, "fridge_door_handle has no such part"),
    ],
)
def test_without_an_answer_it_says_what_nobody_told(
    name: str, args: dict[str, str], why: str, kitchen: KnowledgeBase
) -> None:
    answers = kitchen.ask(name, **args)
    assert not answers
    assert why in answers.missing[0].why


def test_what_is_known_but_not_here_is_said_so(tmp_path: Path) -> None:
    path = tmp_path / "room.ttl"
    path.write_text(room(body("cup")), encoding="utf-8")
    kb = knowing(path, bundled_ontology=True)
    (lack,) = kb.ask("storage_place_in_environment", item="CowsMilk").missing
    assert lack.why == "no individual in any map is a Refrigerator"
    (lack,) = kb.ask("device_for_action_in_environment", action="BakingFood", map="room").missing
    assert lack.why == "no individual in room is a HeatSource"
    assert kb.ask("storage_place_in_environment", item="Robot").missing == kb.ask("storage_place", item="Robot").missing


# -- names and arguments -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["CowsMilk", "knowrob:CowsMilk", f"{KNOWROB}CowsMilk", f"<{KNOWROB}CowsMilk>"])
def test_names_may_be_short_prefixed_or_whole(name: str, kitchen: KnowledgeBase) -> None:
    assert len(kitchen.ask("storage_place", item=name)) == 1


@pytest.mark.parametrize("name", ["CowsMilc", "cowsmilk", "knowrob:CowMilk", f"{KNOWROB}CowsMilkk"])
def test_a_misspelt_name_gets_the_near_ones(name: str, kitchen: KnowledgeBase) -> None:
    with pytest.raises(NameUnknown, match=r"no class '.*' is known; near: 'CowsMilk'"):
        kitchen.ask("storage_place", item=name)


def test_a_name_that_two_classes_have_must_be_given_whole(tmp_path: Path) -> None:
    path = tmp_path / "room.ttl"
    path.write_text(room(body("cup"), ":Cup a owl:Class ."), encoding="utf-8")
    kb = knowing(path)
    with pytest.raises(NameAmbiguous, match=f"{M}Cup"):
        kb.ask("individual_of_class", cls="Cup")
    assert len(kb.ask("individual_of_class", cls="knowrob:Cup")) == 1


def test_the_name_of_a_class_stands_for_its_only_individual(tmp_path: Path) -> None:
    path = tmp_path / "room.ttl"
    path.write_text(room(body("a", cls="k:Oven"), body("b"), body("c")), encoding="utf-8")
    kb = knowing(path)
    (row,) = kb.ask("everything_in_map", individual="Oven")
    assert row.individual == M + "a"
    with pytest.raises(NameAmbiguous, match="2 individual names"):
        kb.ask("everything_in_map", individual="Cup")


@pytest.mark.parametrize("name", ["storage_plce", "STORAGE_PLACE"])
def test_an_unknown_question_gets_the_near_ones(name: str, kitchen: KnowledgeBase) -> None:
    with pytest.raises(QuestionUnknown, match="near: 'storage_place'"):
        kitchen.ask(name)


def test_a_question_unlike_any_other_gets_the_whole_list(kitchen: KnowledgeBase) -> None:
    with pytest.raises(QuestionUnknown, match=r"there is .*handle_of"):
        kitchen.ask("xyzzy")


@pytest.mark.parametrize(
    ("args", "message"),
    [
        ({"thing": "Bread"}, "it has no argument 'thing'; there is item, place"),
        ({"item": 3}, "3 is no class's name"),
    ],
)
def test_wrong_arguments_are_refused(args: dict[str, object], message: str, kitchen: KnowledgeBase) -> None:
    with pytest.raises(ArgumentRefused, match=message):
        kitchen.ask("storage_place", **args)


@pytest.mark.parametrize("tolerance", ["much", -1.0, float("nan")])
def test_a_tolerance_is_a_number_from_0(tolerance: object, kitchen: KnowledgeBase) -> None:
    with pytest.raises(ArgumentRefused, match="tolerance"):
        kitchen.ask("identical_maps", a="kitchen", b="kitchen", tolerance=tolerance)


def test_a_row_of_another_question_has_no_reason_here(kitchen: KnowledgeBase) -> None:
    (row,) = kitchen.ask(handle_of, individual="fridge_door")
    assert isinstance(row, HandleOf)
    with pytest.raises(ArgumentRefused, match="HandleOf is no answer to it"):
        kitchen.why("storage_place", row)


def test_two_questions_cannot_have_one_name() -> None:
    with pytest.raises(ValueError, match="two questions storage_place"):
        question(storage_place._function)


def test_a_question_without_any_map_or_ontology_has_no_answers() -> None:
    kb = KnowledgeBase(bundled_ontology=False)
    assert [asked.name for asked in questions() if kb.ask(asked)] == []


# -- plain values ------------------------------------------------------------------------------------------------------


def test_answers_become_what_other_programs_read(kitchen: KnowledgeBase) -> None:
    told = answers_to_builtins(kitchen, kitchen.ask("storage_place_in_environment", item="CowsMilk"), why=True)
    (answer,) = told["answers"]
    assert told["question"] == "storage_place_in_environment"
    assert told["args"] == {"item": f"{KNOWROB}CowsMilk"}
    assert answer["iri"] == answer["individual"]
    assert answer["id"] == "fridge"
    assert answer["class"] == kitchen.index.class_of(answer["iri"])
    assert answer["why"]
    assert told["missing"] == []


def test_answers_are_a_sequence_of_typed_rows(kitchen: KnowledgeBase) -> None:
    answers = kitchen.ask(storage_place, item="Bread")
    assert isinstance(answers[0], Storage)
    assert list(answers[:1]) == [answers[0]]
    assert "Breadbasket" in repr(answers)


# -- laziness ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "use", [lambda kb: kb.world(), lambda kb: kb.analyse(), lambda kb: kb.ancestors(Iri(KNOWROB + "Door"))]
)
def test_only_questions_build_the_index(use: Callable[[KnowledgeBase], object]) -> None:
    kb = KnowledgeBase()
    kb.load(bundled_kitchen())
    use(kb)
    assert "index" not in vars(kb)
    kb.ask("maps")
    assert "index" in vars(kb)


def test_what_is_loaded_later_is_in_the_next_answer(tmp_path: Path) -> None:
    path = tmp_path / "room.ttl"
    path.write_text(room(body("cup", cls="k:Refrigerator")), encoding="utf-8")
    kb = KnowledgeBase()
    assert not kb.ask("storage_place_in_environment", item="CowsMilk")
    kb.load(path)
    assert [row.individual for row in kb.ask("storage_place_in_environment", item="CowsMilk")] == [M + "cup"]
