"""Predicates that spawn, attach and highlight bodies."""

from __future__ import annotations

from pathlib import Path

import pytest

from mindstage.engines import NullEngine
from mindstage.errors import PrologGoalError
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import bundled_kitchen
from mindstage.prolog import PrologConsole
from mindstage.scene import BodyId, Pose, diff
from mindstage.scene.colors import COLORS
from mindstage.scene.edits import SetPoses
from mindstage.simulation import Simulation
from tests.cli.runner import map_text


def test_a_map_is_spawned_completely(console: PrologConsole, simulation: Simulation) -> None:
    (row,) = console.solutions("spawn_semantic_map(Map)")
    assert row["Map"] == simulation.knowledge.world().iri
    assert len(simulation.state.ids) == len(simulation.knowledge.world().bodies)


def test_a_map_spawned_part_by_part_is_the_same_world(console: PrologConsole, simulation: Simulation) -> None:
    goal = "map_instance(M), spawn_models(M, Bodies), spawn_constraints(M, Joints), spawn_relations(M, Ps, Cs)"
    (row,) = console.solutions(goal)
    world = simulation.knowledge.world()
    assert row["Bodies"] == [body.iri for body in world.bodies]
    assert len(row["Joints"]) == len(world.joints) > 0
    assert len(row["Ps"]) == len(row["Cs"]) == len(world.attachments) > 0
    with Simulation(simulation.knowledge, NullEngine()) as whole:
        whole.spawn()
        assert diff(whole.snapshot(), simulation.snapshot()).identical(0.0)


def test_parts_of_a_map_are_spawned(console: PrologConsole, simulation: Simulation) -> None:
    assert console.holds("spawn_models(kitchen, [fridge, kitchen:fridge_door])")
    assert simulation.state.ids == ("fridge", "fridge_door")
    assert console.holds("spawn_relations(kitchen, [fridge], [fridge_door])")
    with pytest.raises(PrologGoalError, match="1 parents and 2 children are not pairs"):
        console.holds("spawn_relations(kitchen, [fridge], [fridge_door, fridge])")
    with pytest.raises(PrologGoalError, match="fridge: it is none of the joints of kitchen"):
        console.holds("spawn_constraints(kitchen, [fridge])")


def test_spawning_fails_if_items_fail_which_can_be_listed(
    console: PrologConsole, capfd: pytest.CaptureFixture[str]
) -> None:
    assert console.holds("spawn_semantic_map(kitchen), \\+ failed_item(_, _, _)")
    assert not console.holds("spawn_semantic_map(kitchen)")
    assert "334 items could not be spawned; debug_failed_items lists them" in capfd.readouterr().err
    assert console.holds("failed_item(body, fridge, Reason), sub_string(Reason, _, _, _, 'is taken')")
    assert console.holds("debug_failed_items")
    assert "body fridge: the id 'fridge' is taken" in capfd.readouterr().out


def test_models_are_attached_to_one_another(console: PrologConsole, simulation: Simulation) -> None:
    assert console.holds("spawn_semantic_map(_), attach_model(fridge, milk_carton_1)")
    assert ("fridge", "milk_carton_1") in {(each.parent, each.child) for each in simulation.snapshot().attachments}
    with pytest.raises(PrologGoalError) as refused:
        console.holds("attach_model(milk_carton_1, fridge)")
    assert refused.value.error_type == "AttachmentError"


# -- highlights --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("goal", "highlighted"),
    [
        ("highlight_everything_that_is(Map, knowrob:'Refrigerator')", {"fridge"}),
        ("highlight_likely_storage_place(Map, knowrob:'CowsMilk')", {"fridge"}),
        ("highlight_handle_of(Map, fridge_door)", {"fridge_door_handle"}),
        ("highlight_device_for_action(Map, knowrob:'BakingFood', _)", {"hob", "oven"}),
        ("highlight_device_for_action(Map, knowrob:'BakingFood', knowrob:'HeatSource')", {"hob", "oven"}),
        ("highlight_device_for_action(Map, knowrob:'BakingFood')", {"hob", "oven"}),
        ("highlight_handle_of(Map, fridge_door, kitchen:fridge_door_handle)", {"fridge_door_handle"}),
        ('highlight_models(["fridge", oven])', {"fridge", "oven"}),
        ("highlight(fridge)", {"fridge"}),
        ("highlight([fridge, kitchen:oven])", {"fridge", "oven"}),
    ],
)
def test_answers_are_highlighted(
    goal: str, highlighted: set[str], console: PrologConsole, simulation: Simulation
) -> None:
    assert console.holds(f"spawn_semantic_map(Map), {goal}")
    assert dict(simulation.state.highlights) == dict.fromkeys(highlighted, COLORS["green"])


def test_the_classes_of_devices_for_an_action_are_answers(console: PrologConsole) -> None:
    goal = "spawn_semantic_map(Map), highlight_device_for_action(Map, knowrob:'BakingFood', X)"
    assert [row["X"].partition("#")[2] for row in console.solutions(goal)] == ["HeatSource"]


def test_the_handles_of_an_individual_are_answers_while_all_are_highlighted(console: PrologConsole) -> None:
    goal = "spawn_semantic_map(Map), highlight_handle_of(Map, X, Handle)"
    rows = console.solutions("handle_of(_, X, Handle)")
    handles = dict.fromkeys(row["Handle"] for row in rows)
    assert [row["Handle"] for row in console.solutions(goal)] == list(handles)


def test_highlights_are_labeled_with_the_question(console: PrologConsole, simulation: Simulation) -> None:
    console.holds("spawn_semantic_map(_), highlight_handle_of(kitchen, fridge_door)")
    assert [group.label for group in simulation.state.highlight_groups] == ["handle_of(kitchen,fridge_door,_)"]


@pytest.mark.parametrize(
    ("color", "expected"),
    [("red", COLORS["red"]), ("'#ff0080'", (1.0, 0.0, 128 / 255)), ("rgb(1, 0, 0.5)", (1.0, 0.0, 0.5))],
)
def test_highlights_have_colors(
    color: str, expected: tuple[float, float, float], console: PrologConsole, simulation: Simulation
) -> None:
    console.holds(f"spawn_semantic_map(_), highlight(oven, blue), highlight(fridge, {color})")
    assert dict(simulation.state.highlights) == {"oven": COLORS["blue"], "fridge": expected}
    assert console.holds("highlight(fridge, none)")
    assert dict(simulation.state.highlights) == {"oven": COLORS["blue"]}
    assert console.holds("unhighlight")
    assert not simulation.state.highlights


def test_without_an_answer_nothing_is_highlighted(console: PrologConsole, simulation: Simulation) -> None:
    assert console.holds("spawn_semantic_map(_)")
    assert not console.holds("highlight_everything_that_is(_, knowrob:'Robot')")
    assert not simulation.state.highlights


def test_bodies_that_do_not_exist_cannot_be_highlighted(
    console: PrologConsole, capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(PrologGoalError, match=r"fridge cannot be highlighted: .*; spawn_semantic_map") as refused:
        console.holds("highlight(fridge)")
    assert refused.value.error_type == "BodyNotFoundError"
    assert console.holds("spawn_semantic_map(_), highlight([fridge, fridge_door_hinge])")
    assert "fridge_door_hinge cannot be highlighted: it is a joint, which has no body" in capfd.readouterr().err
    with pytest.raises(PrologGoalError, match="pink") as refused:
        console.holds("highlight(fridge, pink)")
    assert refused.value.error_type == "InvalidColorError"


# -- the current state -------------------------------------------------------------------------------------------------


def test_questions_use_the_current_state_of_the_simulation(console: PrologConsole, simulation: Simulation) -> None:
    inside = "where_is(_, milk_carton_1, inside, fridge)"
    assert console.holds(f"spawn_semantic_map(_), {inside}")
    simulation.engine.run(
        lambda engine: engine.apply(SetPoses({BodyId("milk_carton_1"): Pose((0.0, 0.0, 5.0))})), edits=True
    )
    assert not console.holds(inside)


def test_one_of_several_maps_is_spawned(prolog: Path, tmp_path: Path) -> None:
    path = tmp_path / "room.owl"
    path.write_text(map_text(["Room"], {"Mug1": "0 0 0", "Mug2": "5 0 0"}), encoding="utf-8")
    knowledge = KnowledgeBase()
    knowledge.load([path, bundled_kitchen()])
    with Simulation(knowledge, NullEngine()) as simulation, PrologConsole(simulation) as console:
        assert len(console.solutions("map_instance(_)")) == 2
        assert console.holds("spawn_semantic_map(room:'Room')")
        assert simulation.state.ids == ("Mug1", "Mug2")
