"""Showing: answers light up, and the stage knows what is lit and why."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from msgspec.structs import replace

from mindstage.engines import MujocoEngine, NullEngine
from mindstage.errors import BodyNotFoundError, InvalidColorError
from mindstage.knowledge import KnowledgeBase, bundled_kitchen, save_map
from mindstage.knowledge.questions import WorldState
from mindstage.scene import BodyId
from mindstage.scene.colors import COLORS
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
def stage(request: pytest.FixtureRequest, knowledge: KnowledgeBase) -> Iterator[Simulation]:
    with Simulation(knowledge, request.param()) as stage:
        stage.spawn()
        yield stage


def lit(stage: Simulation) -> dict[str, tuple[str, ...]]:
    """The ids of each group by its reason; they are what the engine has lit."""
    groups = {group.label: group.ids for group in stage.state.highlight_groups}
    assert {id for ids in groups.values() for id in ids} == set(stage.state.highlights)
    return groups


def test_the_handle_of_a_door_lights_up_and_not_the_door(stage: Simulation) -> None:
    shown = stage.highlight(stage.ask("handle_of", individual="FridgeDoor"), RED)
    assert (shown.highlighted, shown.unhighlighted) == (("FridgeHandle",), ())
    assert stage.state.highlights == {"FridgeHandle": RED}
    assert stage.state.highlight_groups == (
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
        ("openings", {"state": "closed"}, {"Fridge", "Cupboard"}),
        ("openings", {"thing": "Fridge"}, {"FridgeDoor"}),
    ],
)
def test_what_was_asked_for_is_what_lights_up(
    stage: Simulation, question: str, args: dict[str, str], ids: set[str]
) -> None:
    assert set(stage.highlight(stage.ask(question, **args), RED).highlighted) == ids


def test_what_has_no_body_is_named_with_the_reason(stage: Simulation) -> None:
    shown = stage.highlight(stage.ask("storage_place", item="CowsMilk"), RED)
    assert shown.unhighlighted == (UnhighlightedItem("Refrigerator", "it is a class, which has no body"),)
    shown = stage.highlight(stage.ask("maps"), RED)
    assert shown.unhighlighted == (UnhighlightedItem("map", "it is a map, which has no body"),)
    shown = stage.highlight(stage.ask("everything_in_map"), RED)
    assert UnhighlightedItem("DrawerSlide", "it is a joint, which has no body") in shown.unhighlighted
    assert len(shown.highlighted) == len(kitchenette().bodies)
    shown = stage.highlight(
        ["Mug", "Mugg", "http://example.org/maps/M.owl#nobody"], GREEN, label="by hand", missing_ok=True
    )
    assert shown.highlighted == ("Mug",)
    assert shown.unhighlighted == (
        UnhighlightedItem("Mugg", "no body 'Mugg' in 'map'; near: 'Mug'"),
        UnhighlightedItem("nobody", "it has no body here"),
    )
    assert lit(stage)["by hand"] == ("Mug",)


def test_answers_without_any_row_light_nothing(stage: Simulation) -> None:
    shown = stage.highlight(stage.ask("handle_of", individual="Mug"), RED)
    assert (shown.highlighted, shown.unhighlighted, stage.state.highlight_groups) == ((), (), ())


def test_a_later_show_adds_and_what_is_in_both_has_its_color(stage: Simulation) -> None:
    stage.highlight([MUG, FRIDGE], RED, label="first")
    stage.highlight([FRIDGE], GREEN, label="second")
    assert lit(stage) == {"first": ("Mug",), "second": ("Fridge",)}
    assert stage.state.highlights == {"Mug": RED, "Fridge": GREEN}


def test_the_same_reason_again_replaces_what_it_lit(stage: Simulation) -> None:
    stage.highlight([MUG, FRIDGE], RED, label="this")
    stage.highlight(["Drawer"], GREEN, label="that")
    stage.highlight([FRIDGE, BodyId("Floor")], GREEN, label="this")
    assert lit(stage) == {"that": ("Drawer",), "this": ("Fridge", "Floor")}


def test_replacing_puts_all_else_out(stage: Simulation) -> None:
    stage.highlight([MUG], RED, label="first")
    stage.highlight([FRIDGE], GREEN)
    stage.highlight(["Drawer"], GREEN, label="second", replace=True)
    assert lit(stage) == {"second": ("Drawer",)}


def test_no_color_puts_out_what_is_shown_and_nothing_else(stage: Simulation) -> None:
    stage.highlight([MUG, FRIDGE], RED, label="first")
    assert stage.highlight([MUG], None).highlighted == ("Mug",)
    assert lit(stage) == {"first": ("Fridge",)}
    stage.clear_highlights()
    assert lit(stage) == {}


def test_what_is_lit_without_a_reason_is_a_group_too(stage: Simulation) -> None:
    stage.highlight([MUG], RED)
    stage.run_on_engine(lambda engine: engine.highlight([FRIDGE], RED))
    assert stage.state.highlight_groups == (HighlightGroup(ids=(MUG, FRIDGE), color=RED),)
    stage.highlight([MUG], GREEN)
    assert {group.color: group.ids for group in stage.state.highlight_groups} == {RED: (FRIDGE,), GREEN: (MUG,)}
    with pytest.raises(BodyNotFoundError):
        stage.highlight([BodyId("nobody")], RED)


def test_deleting_and_clearing_put_out(stage: Simulation) -> None:
    stage.highlight([MUG, FRIDGE], RED, label="both")
    stage.run_on_engine(lambda engine: engine.delete([FRIDGE]), edits=True)
    assert lit(stage) == {"both": ("Mug",)}
    stage.clear()
    assert lit(stage) == {}
    stage.spawn()
    assert lit(stage) == {}, "a body of the same name is another body"


def test_a_reset_leaves_lit_what_is_lit(stage: Simulation) -> None:
    stage.highlight([MUG], RED, label="first")
    stage.step(0.1)
    stage.highlight([FRIDGE], GREEN, label="second")
    stage.highlight([MUG], None)
    stage.reset()
    assert lit(stage) == {"second": ("Fridge",)}


def test_groups_stay_the_same_values_while_nothing_changes(stage: Simulation) -> None:
    stage.highlight([MUG], RED, label="first")
    before = stage.state
    stage.step(0.1)
    assert stage.state is not before
    assert stage.state.highlight_groups is before.highlight_groups


def test_many_ask_at_once_and_each_sees_one_moment(stage: Simulation) -> None:
    stage.play()
    with ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(lambda _: stage.ask("where_is", other="Cupboard", relation="on"), range(24)))
    assert all(
        [(row.thing.rpartition("#")[2], row.source) for row in each] == [("Mug", stage.engine_name)] for each in answers
    )


def test_a_moment_is_the_place_as_it_is(stage: Simulation) -> None:
    moment = stage.current_state()
    assert isinstance(moment, WorldState)
    assert moment.world == stage.snapshot()
    assert moment.spawned == stage.worlds
    assert (moment.joint_positions is not None) == (stage.engine_name == "mujoco")
    assert set(moment.map_of_body().values()) == {kitchenette().iri}


def test_of_two_worlds_with_one_id_the_body_that_stands_counts(stage: Simulation) -> None:
    other = replace(
        kitchenette(), iri=kitchenette().iri + "2", bodies=kitchenette().bodies[-1:], joints=(), attachments=()
    )
    assert stage.spawn(other).failed_bodies
    assert stage.current_state().map_of_body()[MUG] == kitchenette().iri


def test_the_bundled_kitchen_shows_where_milk_is_kept_and_what_is_there() -> None:
    knowledge = KnowledgeBase()
    knowledge.load(Path(bundled_kitchen()))
    with Simulation(knowledge, NullEngine()) as stage:
        stage.spawn()
        assert stage.highlight(stage.ask("storage_place_in_environment", item="CowsMilk"), RED).highlighted == (
            "fridge",
        )
        inside = stage.highlight(stage.ask("where_is", relation="inside", other="fridge"), GREEN)
        assert {"milk_carton_1", "egg_box_1"} <= set(inside.highlighted)
        assert len(stage.state.highlights) == 1 + len(inside.highlighted)


# -- one way to highlight ----------------------------------------------------------------------------------------------


TEXT = ",".join(map(str, GREEN))


@pytest.mark.parametrize("color", ["green", "#1FA83C", GREEN, list(GREEN), TEXT])
def test_a_color_is_a_name_or_numbers(stage: Simulation, color: str | tuple[float, float, float]) -> None:
    stage.highlight("Mug", color)
    assert stage.state.highlights == {"Mug": pytest.approx(GREEN)}


def test_an_id_an_iri_and_answers_are_highlighted_alike(stage: Simulation) -> None:
    answers = stage.ask("storage_place_in_environment", item="CowsMilk")
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
        assert stage.highlight(shown, "red").highlighted == ("Fridge",)
        assert stage.state.highlights == {"Fridge": RED}
        stage.clear_highlights()


def test_a_loop_over_answers_adds_up(stage: Simulation) -> None:
    for answer in stage.ask("individual_of_class", cls="Handle"):
        stage.highlight(answer.individual, color="blue")
    assert stage.state.highlights.keys() == {"FridgeHandle", "DrawerHandle"}
    assert [set(group.ids) for group in stage.state.highlight_groups] == [{"FridgeHandle", "DrawerHandle"}]


def test_an_answer_that_is_a_class_has_no_body(stage: Simulation) -> None:
    (answer,) = stage.ask("storage_place", item="CowsMilk")
    shown = stage.highlight(answer, "green")
    assert shown.unhighlighted == (UnhighlightedItem("Refrigerator", "it is a class, which has no body"),)
    assert stage.highlight(answer.individual, "green").highlighted == ("Fridge",)


def test_an_unknown_id_changes_nothing(stage: Simulation) -> None:
    stage.highlight("Mug", "red", label="first")
    for shown in ("Mugg", ["Fridge", "Mugg"]):
        with pytest.raises(BodyNotFoundError, match="near: 'Mug'"):
            stage.highlight(shown, "green", replace=True)
        with pytest.raises(BodyNotFoundError):
            stage.highlight(shown, None)
    assert lit(stage) == {"first": ("Mug",)}
    with pytest.raises(InvalidColorError):
        stage.highlight("Mug", "greenish")
    with pytest.raises(InvalidColorError):
        stage.highlight("Mug", (2.0, 0.0, 0.0))
    shown = stage.highlight("http://example.org/nobody", "green")
    assert shown.not_lit == (UnhighlightedItem("nobody", "it has no body here"),)


def test_a_simulation_says_what_it_is_and_calls_back_when_it_closes(knowledge: KnowledgeBase) -> None:
    called: list[str] = []
    with Simulation(knowledge, NullEngine()) as stage:
        assert repr(stage) == "<Stage: 0 bodies, null, paused at 0.00 s>"
        stage.spawn()
        stage.on_close(lambda: called.append(f"first {stage.closed}"))
        stage.on_close(lambda: called.append(f"second {len(stage.snapshot().bodies) > 0}"))
        assert repr(stage).startswith("<Stage map: ")
    assert called == ["second True", "first False"]
    assert "closed" in repr(stage)
    stage.close()
    assert len(called) == 2
