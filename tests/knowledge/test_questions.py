"""The answers and explanations of all questions, for the thesis's laboratory and the bundled kitchen."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from itertools import chain, combinations
from pathlib import Path

import pytest

from mindstage.errors import AmbiguousNameError, InvalidArgumentError, NameNotFoundError, QuestionNotFoundError
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.knowledge_base import AnswerCache
from mindstage.knowledge.queries import (
    HandleOf,
    Question,
    StoragePlace,
    cell_text,
    handle_of,
    list_questions,
    question,
    storage_place,
)
from mindstage.maps import bundled_kitchen
from mindstage.rdf.graphs import local_name
from mindstage.scene import Iri
from tests.maps.small_maps import KNOWROB, ROOM_NAMESPACE, body_turtle, knowledge_base_from, room_map

IAI = "iai-kitchen-original.owl"


@pytest.fixture(scope="module")
def kitchen() -> KnowledgeBase:
    kb = KnowledgeBase()
    kb.load(bundled_kitchen())
    return kb


@pytest.fixture(scope="module")
def second_kitchen() -> KnowledgeBase:
    """The same map, read a second time."""
    kb = KnowledgeBase()
    kb.load(bundled_kitchen())
    return kb


@pytest.fixture(scope="module", params=["community", "bundled"])
def laboratory(request: pytest.FixtureRequest, shared_data: Path) -> KnowledgeBase:
    """The thesis's kitchen, with the ontologies of its time, or with the bundled ontology only."""
    community = request.param == "community"
    kb = KnowledgeBase(bundled_ontology=not community)
    kb.load(shared_data / "maps" / IAI, ontologies=[shared_data / "ontology"] if community else [])
    return kb


def classes(kb: KnowledgeBase, individuals: list[Iri]) -> list[str]:
    return sorted(local_name(str(kb.reasoner.class_of(individual))) for individual in individuals)


# -- the thesis --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("cls", "count"), [("Handle", 18), ("Door", 13), ("StorageConstruct", 18), ("ElectricalDevice", 14)]
)
def test_the_number_of_individuals_of_a_class_equals_the_thesis(
    laboratory: KnowledgeBase, cls: str, count: int
) -> None:
    assert len({row.individual for row in laboratory.ask("individual_of_class", cls=cls)}) == count


def test_milk_is_stored_in_the_refrigerator_which_is_the_fridge_casing_here(laboratory: KnowledgeBase) -> None:
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
    assert laboratory.reasoner.is_member(row.handle, Iri(KNOWROB + "Handle"))


def test_map_statistics_equal_those_of_the_thesis(laboratory: KnowledgeBase) -> None:
    (row,) = laboratory.ask("analyze")
    assert (row.classes, row.individuals, row.objects, row.constraints, row.relations) == (64, 136, 114, 22, 55)
    assert len(laboratory.ask("everything_in_map")) == 136


def test_the_maps_of_the_thesis_differ_by_what_it_left_out(shared_data: Path) -> None:
    kb = knowledge_base_from(shared_data / "maps" / IAI, shared_data / "maps" / "iai-kitchen-spawned.owl")
    one, other = (row.map for row in kb.ask("maps"))
    (row,) = kb.ask("identical_maps", a=one, b=other, tolerance=2e-6)
    assert not row.identical
    assert len(row.differing) < len(kb.ask("identical_maps", a=one, b=other)[0].differing)


def test_each_difference_of_the_thesis_maps_has_its_error(shared_data: Path) -> None:
    kb = knowledge_base_from(shared_data / "maps" / IAI, shared_data / "maps" / "iai-kitchen-spawned.owl")
    one, other = kb.maps()
    rows = kb.ask("differences", a=one, b=other)
    (same,) = kb.ask("identical_maps", a=one, b=other)
    assert {row.id for row in rows} == set(same.differing)
    assert max(row.error or 0.0 for row in rows if row.field == "pose.position") == pytest.approx(1e-6)
    # The panorama, 126 m and 21 m at a yaw of 50 degrees: bounds of 177.51 and 29.59 m.
    (panorama,) = [row for row in rows if row.field == "size" and "125.99" in str(row.in_a)]
    assert panorama.error == pytest.approx(105.0, abs=0.01)
    swapped = kb.ask("differences", a=other, b=one)
    assert {(row.id, row.field, row.in_b, row.in_a) for row in swapped} >= {
        (row.id, row.field, row.in_a, row.in_b) for row in rows if row.field == "size"
    }


def test_an_individual_that_only_one_map_has_is_a_difference(tmp_path: Path) -> None:
    one, other = tmp_path / "one.ttl", tmp_path / "other.ttl"
    one.write_text(room_map(body_turtle("cup"), body_turtle("mug")), encoding="utf-8")
    other.write_text(
        room_map(body_turtle("cup", position="1.0 2.0 3.5"), map="room").replace(
            ROOM_NAMESPACE, f"{ROOM_NAMESPACE[:-1]}2#"
        ),
        encoding="utf-8",
    )
    kb = knowledge_base_from(one, other)
    a, b = (row.map for row in kb.ask("maps"))
    rows = kb.ask("differences", a=a, b=b)
    assert [(row.id, row.in_b) for row in rows if not row.field] == [("mug", None)]
    assert [(row.id, row.error) for row in rows if row.field == "pose.position"] == [("cup", 0.5)]
    assert not [row for row in kb.ask("differences", a=a, b=b, tolerance=0.6) if row.field == "pose.position"]


# -- every question ----------------------------------------------------------------------------------------------------


each_question = pytest.mark.parametrize("declared", list_questions(), ids=lambda declared: declared.name)


@each_question
def test_answers_agree_for_all_combinations_of_given_arguments(declared: Question, kitchen: KnowledgeBase) -> None:
    all_answers = kitchen.ask(declared.name)
    names = [argument.name for argument in declared.arguments if argument.name in declared.columns]
    subsets = list(chain.from_iterable(combinations(names, size) for size in range(1, len(names) + 1)))
    for row in all_answers[:: max(1, len(all_answers) // 12)]:
        for subset in subsets:
            bound = {name: getattr(row, name) for name in subset}
            expected = {each for each in all_answers if all(getattr(each, name) == bound[name] for name in subset)}
            assert set(kitchen.ask(declared.name, **bound)) == expected, bound


@each_question
def test_answers_are_unique_and_in_a_stable_order(
    declared: Question, kitchen: KnowledgeBase, second_kitchen: KnowledgeBase
) -> None:
    answers = list(kitchen.ask(declared.name))
    assert len(answers) == len(set(answers))
    assert list(second_kitchen.ask(declared)) == answers


@each_question
def test_every_question_has_a_description_and_examples(declared: Question) -> None:
    assert declared.text.splitlines()[0].endswith(".")
    assert declared.examples
    assert all(example.split()[0] == declared.name for example in declared.examples)
    assert all(argument.default is None or argument.name == "tolerance" for argument in declared.arguments)


@each_question
def test_every_answer_has_an_explanation(declared: Question, kitchen: KnowledgeBase) -> None:
    answers = kitchen.ask(declared)
    for row in answers[:: max(1, len(answers) // 20)]:
        lines = kitchen.explain(declared, row)
        assert lines, row
        assert all(lines), lines
        assert not any("http" in line for line in lines), "names are short where people read"


def test_the_comparison_of_two_maps_is_explained_by_their_differences(shared_data: Path) -> None:
    kb = knowledge_base_from(shared_data / "maps" / IAI, shared_data / "maps" / "iai-kitchen-spawned.owl")
    one, other = kb.maps()
    (row,) = kb.ask("identical_maps", a=one, b=other)
    first, *lines = kb.explain("identical_maps", row)
    assert first.startswith("114 and 114 bodies, 22 and 22 joints were compared")
    assert {line.split()[0] for line in lines} == set(row.differing)
    assert any(" size: " in line and "125.99" in line and "20.99" in line and line.endswith(" apart") for line in lines)
    rows = kb.ask("differences", a=one, b=other)
    assert [line for row in rows for line in kb.explain("differences", row)] == lines


def test_an_explanation_is_a_chain_of_statements(kitchen: KnowledgeBase) -> None:
    (row,) = kitchen.ask(storage_place, item="CowsMilk")
    assert kitchen.explain(storage_place, row) == (
        "CowsMilk is a CowsMilk-Product is a DairyProduct is a Perishable",
        "every Refrigerator: typePrimaryFunction-containerFor some Perishable",
    )


def test_bread_is_kept_in_the_breadbasket_before_the_refrigerator(kitchen: KnowledgeBase) -> None:
    places = [local_name(row.place) for row in kitchen.ask("storage_place", item="Bread")]
    assert places == ["Breadbasket", "Refrigerator"]
    here = [local_name(row.place) for row in kitchen.ask("storage_place_in_environment", item="Bread")]
    assert here == places


def test_the_description_of_an_individual_comes_from_its_world(kitchen: KnowledgeBase) -> None:
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


def test_the_description_of_a_joint_has_its_bodies_and_limits(kitchen: KnowledgeBase) -> None:
    (row,) = kitchen.ask("what_is", individual="fridge_door_hinge")
    (hinge,) = (each for each in kitchen.world().joints if each.iri == row.individual)
    assert (row.pose, row.tags, row.facts) == (hinge.pose, hinge.tags, hinge.facts)
    assert (row.joint.linear, row.joint.angular) == (hinge.linear, hinge.angular)
    assert [local_name(end) for end in (row.joint.parent, row.joint.child)] == ["fridge", "fridge_door"]
    assert cell_text(row.joint) == "fridge to fridge_door, swing1 limited -1.5708 to 0 rad"


# -- names and arguments -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["CowsMilk", "knowrob:CowsMilk", f"{KNOWROB}CowsMilk", f"<{KNOWROB}CowsMilk>"])
def test_names_may_be_short_prefixed_or_whole(name: str, kitchen: KnowledgeBase) -> None:
    assert len(kitchen.ask("storage_place", item=name)) == 1


@pytest.mark.parametrize("name", ["CowsMilc", "cowsmilk", "knowrob:CowMilk", f"{KNOWROB}CowsMilkk"])
def test_a_misspelled_name_gets_suggestions(name: str, kitchen: KnowledgeBase) -> None:
    with pytest.raises(NameNotFoundError, match=r"no class '.*' is known; near: 'CowsMilk'"):
        kitchen.ask("storage_place", item=name)


def test_an_ambiguous_class_name_must_be_given_as_an_iri(tmp_path: Path) -> None:
    path = tmp_path / "room.ttl"
    path.write_text(room_map(body_turtle("cup"), body_turtle("trophy", cls=":Cup")), encoding="utf-8")
    kb = knowledge_base_from(path)
    with pytest.raises(AmbiguousNameError, match=f"{ROOM_NAMESPACE}Cup"):
        kb.ask("individual_of_class", cls="Cup")
    assert len(kb.ask("individual_of_class", cls="knowrob:Cup")) == 1


def test_the_name_of_a_class_stands_for_its_only_individual(tmp_path: Path) -> None:
    path = tmp_path / "room.ttl"
    path.write_text(room_map(body_turtle("a", cls="k:Oven"), body_turtle("b"), body_turtle("c")), encoding="utf-8")
    kb = knowledge_base_from(path)
    (row,) = kb.ask("everything_in_map", individual="Oven")
    assert row.individual == ROOM_NAMESPACE + "a"
    assert [local_name(row.individual) for row in kb.ask("everything_in_map", individual="Cup")] == ["b", "c"]
    with pytest.raises(NameNotFoundError, match="no individual 'Ovn' is known; near: 'Oven'"):
        kb.ask("everything_in_map", individual="Ovn")


@pytest.mark.parametrize("name", ["storage_plce", "STORAGE_PLACE"])
def test_an_unknown_question_gets_suggestions(name: str, kitchen: KnowledgeBase) -> None:
    with pytest.raises(QuestionNotFoundError, match="near: 'storage_place'"):
        kitchen.ask(name)


def test_a_question_unlike_any_other_does_not_list_all_of_them(kitchen: KnowledgeBase) -> None:
    with pytest.raises(QuestionNotFoundError, match=r"^no question 'xyzzy'; `mindstage questions` lists all of them$"):
        kitchen.ask("xyzzy")


@pytest.mark.parametrize(
    ("args", "message"),
    [
        ({"thing": "Bread"}, "it has no argument 'thing'; there is item, place"),
        ({"item": 3}, "3 is no class's name"),
    ],
)
def test_wrong_arguments_are_refused(args: dict[str, object], message: str, kitchen: KnowledgeBase) -> None:
    with pytest.raises(InvalidArgumentError, match=message):
        kitchen.ask("storage_place", **args)


@pytest.mark.parametrize("tolerance", ["much", -1.0, float("nan")])
def test_a_tolerance_is_a_number_from_0(tolerance: object, kitchen: KnowledgeBase) -> None:
    with pytest.raises(InvalidArgumentError, match="tolerance"):
        kitchen.ask("identical_maps", a="kitchen", b="kitchen", tolerance=tolerance)


def test_a_row_of_another_question_cannot_be_explained(kitchen: KnowledgeBase) -> None:
    (row,) = kitchen.ask(handle_of, individual="fridge_door")
    assert isinstance(row, HandleOf)
    with pytest.raises(InvalidArgumentError, match="HandleOf is no answer to it"):
        kitchen.explain("storage_place", row)


def test_questions_can_be_asked_without_importing_them() -> None:
    script = (
        "from mindstage.knowledge import KnowledgeBase; print(len(KnowledgeBase().ask('storage_place', item='Bread')))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=120)
    assert done.stdout == "2\n"


def test_two_questions_cannot_have_one_name() -> None:
    def find_storage_place(kb: KnowledgeBase) -> Iterator[StoragePlace]:
        """Another one."""
        yield from ()

    find_storage_place.__name__ = "storage_place"
    with pytest.raises(ValueError, match=r"two questions storage_place: of .*test_questions and of mindstage"):
        question(find_storage_place)


def test_a_question_without_any_map_or_ontology_has_no_answers() -> None:
    kb = KnowledgeBase(bundled_ontology=False)
    assert [declared.name for declared in list_questions() if kb.ask(declared)] == []


# -- values -----------------------------------------------------------------------------------------------------------


def test_a_class_can_be_asked_for_by_the_value_of_a_property(kitchen: KnowledgeBase) -> None:
    rows = kitchen.ask("class_properties", property="typePrimaryFunction-containerFor", value="Perishable")
    assert {local_name(row.source) for row in rows} == {"Refrigerator"}
    assert {row.value for row in rows} == {f"{KNOWROB}Perishable"}
    widths = kitchen.ask("class_properties", property="widthOfObject", value=0.6)
    assert widths
    assert {row.value for row in widths} == {"0.6"}


def test_answers_are_cached_until_a_statement_changes() -> None:
    kb = KnowledgeBase()
    before = kb.ask("storage_place", item="Bread")
    assert kb.ask("storage_place", item="Bread") is before
    kb.tell("Cupboard", "typePrimaryFunction-containerFor", "Bread")
    after = kb.ask("storage_place", item="Bread")
    assert [*after] != [*before]
    kb.retract("Cupboard", "typePrimaryFunction-containerFor", "Bread")
    assert [*kb.ask("storage_place", item="Bread")] == [*before]
    with pytest.raises(TypeError):
        before.args["item"] = "Milk"


def test_answers_are_a_sequence_of_typed_rows(kitchen: KnowledgeBase) -> None:
    answers = kitchen.ask(storage_place, item="Bread")
    assert isinstance(answers[0], StoragePlace)
    assert list(answers[:1]) == [answers[0]]
    assert "Breadbasket" in repr(answers)


# -- caching -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "use", [lambda kb: kb.world(), lambda kb: kb.map_statistics(), lambda kb: kb.ancestors(Iri(KNOWROB + "Door"))]
)
def test_only_questions_build_the_reasoner(use: Callable[[KnowledgeBase], object]) -> None:
    kb = KnowledgeBase()
    kb.load(bundled_kitchen())
    use(kb)
    assert "reasoner" not in vars(kb)
    kb.ask("maps")
    assert "reasoner" in vars(kb)


def test_the_next_answer_includes_sources_loaded_later(tmp_path: Path) -> None:
    path = tmp_path / "room.ttl"
    path.write_text(room_map(body_turtle("cup", cls="k:Refrigerator")), encoding="utf-8")
    kb = KnowledgeBase()
    assert not kb.ask("storage_place_in_environment", item="CowsMilk")
    kb.load(path)
    assert [row.individual for row in kb.ask("storage_place_in_environment", item="CowsMilk")] == [
        ROOM_NAMESPACE + "cup"
    ]


def test_the_cache_has_a_maximum_number_of_rows(kitchen: KnowledgeBase) -> None:
    cache = AnswerCache(max_rows=30)
    few, more = kitchen.ask("subclass_of", cls="Refrigerator"), kitchen.ask("subclass_of", cls="CowsMilk")
    assert 10 < len(few) <= 30 < len(few) + len(more)
    cache.put(("few",), few)
    cache.put(("all",), kitchen.ask("subclass_of"))
    assert (cache.get(("few",)), cache.get(("all",))) == (few, None)
    cache.put(("more",), more)
    assert (cache.get(("few",)), cache.get(("more",))) == (None, more)
