"""Highlighting answers and bodies; groups with labels."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from msgspec.structs import replace

from mindstage.engines import NullEngine
from mindstage.engines.mujoco import MujocoEngine
from mindstage.errors import BodyNotFoundError, InvalidColorError
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.questions import WorldState
from mindstage.maps import bundled_kitchen, save_map
from mindstage.scene import BodyId
from mindstage.scene.colors import COLORS
from mindstage.scene.edits import Delete
from mindstage.simulation import HighlightGroup, Simulation, UnhighlightedItem
from tests.kitchenette import kitchenette

RED, GREEN = COLORS["red"], COLORS["green"]
MUG, FRIDGE = BodyId("Mug"), BodyId("Fridge")


@pytest.fixture(scope="module")
def knowledge(tmp_path_factory: pytest.TempPathFactory) -> KnowledgeBase:
    path = tmp_path_factory.mktemp("maps") / "kitchenette.owl"
    save_map(kitchenette(), path)
    knowledge = KnowledgeBase()
    knowledge.load(path)
    return knowledge


@pytest.fixture(params=[NullEngine, MujocoEngine])
def sim(request: pytest.FixtureRequest, knowledge: KnowledgeBase) -> Iterator[Simulation]:
    with Simulation(knowledge, request.param()) as sim:
        sim.spawn()
        yield sim


def groups_by_label(sim: Simulation) -> dict[str, tuple[str, ...]]:
    """The ids of each group by its label; together they are the bodies that the engine highlights."""
    groups = {group.label: group.ids for group in sim.state.highlight_groups}
    assert {id for ids in groups.values() for id in ids} == set(sim.state.highlights)
    return groups


def test_of_a_question_about_a_door_its_handle_is_highlighted(sim: Simulation) -> None:
    shown = sim.highlight(sim.ask("handle_of", individual="FridgeDoor"), RED)
    assert (shown.highlighted, shown.unhighlighted) == (("FridgeHandle",), ())
    assert sim.state.highlights == {"FridgeHandle": RED}
    assert sim.state.highlight_groups == (
        HighlightGroup(
            ids=(BodyId("FridgeHandle"),),
            color=RED,
            label="handle_of individual=FridgeDoor",
            question="handle_of",
            args={"individual": "FridgeDoor"},
        ),
    )


@pytest.mark.parametrize(
    ("question", "args", "ids"),
    [
        ("handle_of", {"handle": "FridgeHandle"}, {"FridgeDoor", "Fridge"}),
        ("handle_of", {"handle": "FridgeHandle", "individual": "FridgeDoor"}, {"FridgeHandle"}),
        ("storage_place_in_environment", {"item": "CowsMilk"}, {"Fridge"}),
        ("individual_of_class", {"cls": "Handle"}, {"FridgeHandle", "DrawerHandle"}),
        ("where_is", {"other": "Cupboard", "relation": "on"}, {"Mug"}),
        ("where_is", {"thing": "Mug", "relation": "on"}, {"Cupboard"}),
        ("articulated_parts", {"state": "closed"}, {"Fridge", "Cupboard"}),
        ("articulated_parts", {"thing": "Fridge"}, {"FridgeDoor"}),
    ],
)
def test_the_column_that_was_asked_for_is_highlighted(
    sim: Simulation, question: str, args: dict[str, str], ids: set[str]
) -> None:
    assert set(sim.highlight(sim.ask(question, **args), RED).highlighted) == ids


def test_items_without_a_body_are_listed_with_the_reason(sim: Simulation) -> None:
    shown = sim.highlight(sim.ask("storage_place", item="CowsMilk"), RED)
    assert shown.unhighlighted == (UnhighlightedItem("Refrigerator", "it is a class, which has no body"),)
    shown = sim.highlight(sim.ask("maps"), RED)
    assert shown.unhighlighted == (UnhighlightedItem("map", "it is a map, which has no body"),)
    shown = sim.highlight(sim.ask("everything_in_map"), RED)
    assert UnhighlightedItem("DrawerSlide", "it is a joint, which has no body") in shown.unhighlighted
    assert len(shown.highlighted) == len(kitchenette().bodies)
    shown = sim.highlight(
        ["Mug", "Mugg", "http://example.org/maps/M.owl#nobody"], GREEN, label="manual", missing_ok=True
    )
    assert shown.highlighted == ("Mug",)
    assert shown.unhighlighted == (
        UnhighlightedItem("Mugg", "no body 'Mugg' in 'map'; near: 'Mug'"),
        UnhighlightedItem("nobody", "it has no body here"),
    )
    assert groups_by_label(sim)["manual"] == ("Mug",)


def test_empty_answers_highlight_nothing(sim: Simulation) -> None:
    shown = sim.highlight(sim.ask("handle_of", individual="Mug"), RED)
    assert (shown.highlighted, shown.unhighlighted, sim.state.highlight_groups) == ((), (), ())


def test_a_later_highlight_adds_and_overrides_the_color(sim: Simulation) -> None:
    sim.highlight([MUG, FRIDGE], RED, label="first")
    sim.highlight([FRIDGE], GREEN, label="second")
    assert groups_by_label(sim) == {"first": ("Mug",), "second": ("Fridge",)}
    assert sim.state.highlights == {"Mug": RED, "Fridge": GREEN}


def test_the_same_label_replaces_its_group(sim: Simulation) -> None:
    sim.highlight([MUG, FRIDGE], RED, label="this")
    sim.highlight(["Drawer"], GREEN, label="that")
    sim.highlight([FRIDGE, BodyId("Floor")], GREEN, label="this")
    assert groups_by_label(sim) == {"that": ("Drawer",), "this": ("Fridge", "Floor")}


def test_replace_removes_all_other_highlights(sim: Simulation) -> None:
    sim.highlight([MUG], RED, label="first")
    sim.highlight([FRIDGE], GREEN)
    sim.highlight(["Drawer"], GREEN, label="second", replace=True)
    assert groups_by_label(sim) == {"second": ("Drawer",)}


def test_no_color_removes_the_highlight_of_these_bodies_only(sim: Simulation) -> None:
    sim.highlight([MUG, FRIDGE], RED, label="first")
    assert sim.highlight([MUG], None).highlighted == ("Mug",)
    assert groups_by_label(sim) == {"first": ("Fridge",)}
    sim.clear_highlights()
    assert groups_by_label(sim) == {}


def test_highlights_without_a_label_form_groups_by_color(sim: Simulation) -> None:
    sim.highlight([MUG], RED)
    sim.engine.run(lambda engine: engine.highlight([FRIDGE], RED))
    assert sim.state.highlight_groups == (HighlightGroup(ids=(MUG, FRIDGE), color=RED),)
    sim.highlight([MUG], GREEN)
    assert {group.color: group.ids for group in sim.state.highlight_groups} == {RED: (FRIDGE,), GREEN: (MUG,)}
    with pytest.raises(BodyNotFoundError):
        sim.highlight([BodyId("nobody")], RED)


def test_deleting_and_clearing_remove_highlights(sim: Simulation) -> None:
    sim.highlight([MUG, FRIDGE], RED, label="both")
    sim.engine.run(lambda engine: engine.apply(Delete((FRIDGE,))), edits=True)
    assert groups_by_label(sim) == {"both": ("Mug",)}
    sim.clear()
    assert groups_by_label(sim) == {}
    sim.spawn()
    assert groups_by_label(sim) == {}, "a new body of the same id is not highlighted"


def test_a_reset_keeps_highlights(sim: Simulation) -> None:
    sim.highlight([MUG], RED, label="first")
    sim.step(0.1)
    sim.highlight([FRIDGE], GREEN, label="second")
    sim.highlight([MUG], None)
    sim.reset()
    assert groups_by_label(sim) == {"second": ("Fridge",)}


def test_groups_are_the_same_object_while_nothing_changes(sim: Simulation) -> None:
    sim.highlight([MUG], RED, label="first")
    before = sim.state
    sim.step(0.1)
    assert sim.state is not before
    assert sim.state.highlight_groups is before.highlight_groups


def test_concurrent_questions_each_see_one_state(sim: Simulation) -> None:
    sim.play()
    with ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(lambda _: sim.ask("where_is", other="Cupboard", relation="on"), range(24)))
    assert all(
        [(row.thing.rpartition("#")[2], row.source) for row in each] == [("Mug", sim.engine.name)] for each in answers
    )


def test_the_current_state_is_that_of_the_engine(sim: Simulation) -> None:
    current = sim.current_state()
    assert isinstance(current, WorldState)
    assert current.world == sim.snapshot()
    assert current.spawned == sim.worlds
    assert (current.joint_positions is not None) == (sim.engine.name == "mujoco")
    assert set(current.map_of_body.values()) == {kitchenette().iri}


def test_of_two_worlds_with_one_id_the_spawned_body_counts(sim: Simulation) -> None:
    other = replace(
        kitchenette(), iri=kitchenette().iri + "2", bodies=kitchenette().bodies[-1:], joints=(), attachments=()
    )
    assert sim.spawn(other).failed_bodies
    assert sim.current_state().map_of_body[MUG] == kitchenette().iri


def test_the_bundled_kitchen_highlights_the_storage_place_of_milk_and_its_contents() -> None:
    knowledge = KnowledgeBase()
    knowledge.load(Path(bundled_kitchen()))
    with Simulation(knowledge, NullEngine()) as sim:
        sim.spawn()
        assert sim.highlight(sim.ask("storage_place_in_environment", item="CowsMilk"), RED).highlighted == ("fridge",)
        inside = sim.highlight(sim.ask("where_is", relation="inside", other="fridge"), GREEN)
        assert {"milk_carton_1", "egg_box_1"} <= set(inside.highlighted)
        assert len(sim.state.highlights) == 1 + len(inside.highlighted)


# -- one way to highlight ----------------------------------------------------------------------------------------------


TEXT = ",".join(map(str, GREEN))


@pytest.mark.parametrize("color", ["green", "#1FA83C", GREEN, list(GREEN), TEXT])
def test_a_color_is_a_name_or_numbers(sim: Simulation, color: str | tuple[float, float, float]) -> None:
    sim.highlight("Mug", color)
    assert sim.state.highlights == {"Mug": pytest.approx(GREEN)}


def test_an_id_an_iri_and_answers_are_highlighted_alike(sim: Simulation) -> None:
    answers = sim.ask("storage_place_in_environment", item="CowsMilk")
    iri = answers[0].individual
    for shown in (
        "Fridge",
        iri,
        answers[0],
        answers,
        ["Fridge"],
        [iri, answers[0]],
        list(answers),
        {"Fridge": 1},
        iter([iri]),
    ):
        assert sim.highlight(shown, "red").highlighted == ("Fridge",)
        assert sim.state.highlights == {"Fridge": RED}
        sim.clear_highlights()


def test_a_loop_over_answers_adds_up(sim: Simulation) -> None:
    for answer in sim.ask("individual_of_class", cls="Handle"):
        sim.highlight(answer.individual, color="blue")
    assert sim.state.highlights.keys() == {"FridgeHandle", "DrawerHandle"}
    assert [set(group.ids) for group in sim.state.highlight_groups] == [{"FridgeHandle", "DrawerHandle"}]


def test_an_answer_that_is_a_class_has_no_body(sim: Simulation) -> None:
    (answer,) = sim.ask("storage_place", item="CowsMilk")
    shown = sim.highlight(answer, "green")
    assert shown.unhighlighted == (UnhighlightedItem("Refrigerator", "it is a class, which has no body"),)
    assert sim.highlight(answer.individual, "green").highlighted == ("Fridge",)


def test_an_unknown_id_changes_nothing(sim: Simulation) -> None:
    sim.highlight("Mug", "red", label="first")
    for shown in ("Mugg", ["Fridge", "Mugg"]):
        with pytest.raises(BodyNotFoundError, match="near: 'Mug'"):
            sim.highlight(shown, "green", replace=True)
        with pytest.raises(BodyNotFoundError):
            sim.highlight(shown, None)
    assert groups_by_label(sim) == {"first": ("Mug",)}
    with pytest.raises(InvalidColorError):
        sim.highlight("Mug", "greenish")
    with pytest.raises(InvalidColorError):
        sim.highlight("Mug", (2.0, 0.0, 0.0))
    shown = sim.highlight("http://example.org/nobody", "green")
    assert shown.unhighlighted == (UnhighlightedItem("nobody", "it has no body here"),)


def test_a_simulation_has_a_repr_and_runs_callbacks_when_it_closes(knowledge: KnowledgeBase) -> None:
    called: list[str] = []
    with Simulation(knowledge, NullEngine()) as sim:
        assert repr(sim) == "<Simulation: 0 bodies, null, paused at 0.00 s>"
        sim.spawn()
        sim.on_close(lambda: called.append(f"first {sim.closed}"))
        sim.on_close(lambda: called.append(f"second {len(sim.snapshot().bodies) > 0}"))
        assert repr(sim).startswith("<Simulation map: ")
    assert called == ["second True", "first False"]
    assert "closed" in repr(sim)
    sim.close()
    assert len(called) == 2
