"""Questions that imagine: their answers, reasons and sources, and that the world stays as it is."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

from mindstage.engines import Capability, NullEngine
from mindstage.engines.mujoco import MujocoEngine
from mindstage.errors import InvalidArgumentError, NameNotFoundError, PlanError
from mindstage.imagination import trials
from mindstage.imagination.plans import Plan, Wait
from mindstage.imagination.trials import Trial, Trials, parse_uncertainty, plan_from_text
from mindstage.imagination.verdicts import evaluate_plan
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.queries import get_question, list_questions
from mindstage.maps import bundled_kitchen
from mindstage.maps.io.write import write_map
from mindstage.scene import Body, BodyId, BodyPhysics, Iri, Mobility, Pose, World, diff
from mindstage.scene.edits import SetPoses
from mindstage.simulation import Simulation
from tests.cases import each_case
from tests.kitchenette import KNOWROB, MAP, kitchenette

IMAGINING = {"stays", "fits_now", "would_tip", "can_open", "reachable_by_pull", "would_spill", "what_if"}
MUG, DRAWER, DOOR = MAP + "Mug", MAP + "Drawer", MAP + "FridgeDoor"


def box(id: str, position: tuple[float, float, float], size: tuple[float, float, float], *, kg: float = 0.5) -> Body:
    physics = BodyPhysics(mobility=Mobility.DYNAMIC, mass_kg=kg)
    return Body(
        id=BodyId(id), iri=Iri(MAP + id), cls=Iri(KNOWROB + "Box"), pose=Pose(position), size=size, physics=physics
    )


@pytest.fixture(scope="module")
def sim() -> Iterator[Simulation]:
    """The kitchenette, with a box that overhangs the cupboard's edge, one in front of the fridge, and a pillar."""
    added = (
        box("Overhanging", (1.68, 0.2, 0.85), (0.1, 0.1, 0.1)),
        box("Obstacle", (1.45, 1.1, 0.5), (0.3, 0.3, 1.0), kg=400.0),
        box("Pillar", (3.5, -1.5, 0.2), (0.1, 0.1, 0.4), kg=1.0),
    )
    with Simulation(KnowledgeBase(), MujocoEngine(), primitive_shapes=True) as sim:
        sim.spawn(kitchenette())
        sim.spawn(World(iri=Iri(MAP + "map"), bodies=added))
        before, revision = sim.snapshot(), sim.state.revision
        yield sim
        assert diff(before, sim.snapshot()).identical(0.0)
        assert (sim.state.revision, sim.state.time_s, sim.forks) == (revision, 0.0, ())


@pytest.fixture(scope="module")
def kitchen() -> Iterator[KnowledgeBase]:
    with KnowledgeBase() as knowledge:
        knowledge.load(bundled_kitchen())
        yield knowledge


@pytest.mark.parametrize("has_floor", [True, False])
def test_a_carton_that_overhangs_falls_and_answers_and_verdicts_name_the_assumed_ground(has_floor: bool) -> None:
    def part(id: str, position: Any, size: Any, mobility: Mobility) -> Body:
        return msgspec.structs.replace(box(id, position, size), physics=BodyPhysics(mobility=mobility))

    bodies = [
        part("table", (-0.5, 0.0, 0.35), (1.0, 1.0, 0.7), Mobility.STATIC),
        part("carton", (0.02, 0.0, 0.75), (0.1, 0.1, 0.1), Mobility.DYNAMIC),
        part("cup", (-0.5, 0.0, 0.75), (0.1, 0.1, 0.1), Mobility.DYNAMIC),
        *([part("floor", (0.0, 0.0, -0.05), (6.0, 6.0, 0.1), Mobility.STATIC)] if has_floor else []),
    ]
    assumption = "a ground is assumed at a height of 0.000 m, since the map has none below carton"
    with Simulation(KnowledgeBase(), MujocoEngine(), primitive_shapes=True) as simulation:
        simulation.spawn(World(iri=Iri(MAP + "map"), bodies=tuple(bodies)))
        assert (assumption in simulation.ask("stays", thing="cup")[0].why) is not has_floor
        answers = simulation.ask("stays", thing="carton")
        assert not answers
        assert "carton fell by 0.70 m from table" in reasons(answers)
        assert (assumption in reasons(answers)) is not has_floor
        verdict = evaluate_plan(simulation, Plan(steps=(Wait(duration_s=1.0),)))
        assert (assumption in verdict.assumptions) is not has_floor


def reasons(answers: Any) -> str:
    return "; ".join(each.reason for each in answers.missing)


# -- what would stay, and tip ------------------------------------------------------------------------------------------


def test_a_mug_on_a_cupboard_stays_and_a_box_over_its_edge_falls(sim: Simulation) -> None:
    (row,) = sim.ask("stays", "Mug")
    assert (row.thing, row.place, row.probability, row.interval, row.tried) == (
        MUG,
        MAP + "Cupboard",
        1.0,
        (1.0, 1.0),
        1,
    )
    assert row.moved_m < 0.005
    assert "no uncertainty is stated" in row.why
    falls = sim.ask("stays", "Overhanging")
    assert not falls
    assert "Overhanging does not stay: Overhanging " in reasons(falls)
    assert "fell" in reasons(falls) or "tipped" in reasons(falls)
    assert "probability 0% (0% to 0%), tried 1 times" in reasons(falls)


def test_what_does_not_hold_is_an_answer_with_its_probability_if_that_is_asked_for(sim: Simulation) -> None:
    (row,) = sim.ask("stays", "Overhanging", min_probability=0)
    assert (row.probability, row.interval) == (0.0, (0.0, 0.0))
    assert row.moved_m > 0.5


def test_an_uncertain_position_gives_a_probability_between(sim: Simulation) -> None:
    asked = {"uncertainty": "position_m=0.03", "samples": 20, "min_probability": 0}
    (one,) = sim.ask("stays", "Overhanging", seed=1, **asked)
    (same,) = sim.ask("stays", "Overhanging", seed=1, **asked)
    assert 0.0 < one.interval[0] < one.probability < one.interval[1] < 1.0
    assert one.tried == 20
    assert "but in sample" in one.why
    assert one == same


def test_a_thing_is_first_put_where_it_is_asked_about(sim: Simulation) -> None:
    (row,) = sim.ask("stays", "Mug", place="Fridge")
    assert row.place == MAP + "Fridge"
    no_room = sim.ask("stays", "Obstacle", place="Mug")
    assert not no_room
    assert "Obstacle does not stay" in reasons(no_room)


def test_the_friction_and_the_height_of_a_push_decide_whether_a_pillar_tips(sim: Simulation) -> None:
    """Tips if F h > m g b / 2: with 1 kg, 0.1 m wide, at 0.4 m from 1.2 N on, if it lasts."""
    rows = sim.ask("would_tip", "Pillar", 6.0)
    assert {row.heading_deg for row in rows} == {0.0, 90.0, -180.0, -90.0}
    assert all(row.height_m == pytest.approx(0.4) and row.tilted_deg > 45 for row in rows)
    assert not sim.ask("would_tip", "Pillar", 1.0)
    assert {row.push_n for row in sim.ask("would_tip", "Pillar")} == {5.0}
    low = sim.ask("would_tip", "Pillar", 6.0, height_m=0.02)
    assert not low
    assert "Pillar is not tipped by 6 N: it tilts by" in reasons(low)
    assert "Pillar is not tipped by 0 N: it tilts by" in reasons(sim.ask("would_tip", "Pillar", 0.0))


# -- what fits, and opens ----------------------------------------------------------------------------------------------


def test_a_thing_fits_where_there_is_room_now(sim: Simulation) -> None:
    (row,) = sim.ask("fits_now", "Mug", "Cupboard", "onto")
    assert row.pose.position[2] == pytest.approx(0.85, abs=0.01)
    refused = sim.ask("fits_now", "Obstacle", "Mug", "onto")
    assert not refused
    assert "Obstacle cannot be put onto Mug" in reasons(refused)


def test_a_free_door_opens_to_its_limit_and_a_blocked_one_names_what_is_in_the_way(sim: Simulation) -> None:
    (drawer,) = sim.ask("can_open", "Drawer")
    assert (drawer.part, drawer.unit, drawer.obstacles, drawer.probability) == (DRAWER, "m", (), 1.0)
    assert drawer.way == pytest.approx(-0.45, abs=0.02) or drawer.way == pytest.approx(0.45, abs=0.02)
    (door,) = sim.ask("can_open", "Fridge")
    assert (door.thing, door.part, door.unit) == (MAP + "Fridge", DOOR, "rad")
    assert 0.02 < door.share < 0.95
    assert door.obstacles == (MAP + "Obstacle",)
    assert "Obstacle is in the way" in door.why
    assert door.probability == 0.0


def test_a_thing_of_one_of_two_maps_is_opened_in_that_map(tmp_path: Path) -> None:
    with KnowledgeBase() as knowledge:
        knowledge.load(bundled_kitchen())
        (tmp_path / "small.owl").write_text(write_map(kitchenette()), encoding="utf-8")
        knowledge.load(tmp_path / "small.owl")
        (row,) = knowledge.ask("can_open", DRAWER)
        assert (row.part, row.map) == (DRAWER, MAP + "map")
        assert knowledge.ask("stays", "milk_carton_1", for_s=0.1)[0].map.endswith("kitchen")


def test_what_no_joint_moves_cannot_be_opened(sim: Simulation) -> None:
    assert reasons(sim.ask("can_open", "Mug")) == "no joint moves Mug, or a part of it"


def test_a_pull_at_a_handle_opens_its_part_with_the_force_that_is_needed(sim: Simulation) -> None:
    (row,) = sim.ask("reachable_by_pull", "DrawerHandle")
    assert (row.handle, row.part) == (MAP + "DrawerHandle", DRAWER)
    assert row.share > 0.9
    assert 0.5 <= row.force_n < 150.0
    half = sim.ask("reachable_by_pull", "DrawerHandle", max_force_n=row.force_n * 2)
    assert half[0].force_n == pytest.approx(row.force_n, rel=0.25)
    assert reasons(sim.ask("reachable_by_pull", "Mug")) == "no joint moves Mug, or a part of it"


# -- vessels -----------------------------------------------------------------------------------------------------------


def test_a_mug_spills_from_the_tilt_at_which_its_level_reaches_the_rim(kitchen: KnowledgeBase) -> None:
    """For a cylinder of radius r and depth h the level reaches the rim at tan(tilt) = h (1 - fill) / r, above half."""
    (row,) = kitchen.ask("would_spill", "coffee_mug_1", fill_share=0.8)
    radius = math.sqrt(row.capacity_l / 1000 / math.pi / (row.fill_height_m / 0.8))
    expected = math.degrees(math.atan(row.fill_height_m / 0.8 * 0.2 / radius))
    assert row.spills_from_deg == pytest.approx(expected, abs=2.5)
    assert "no liquid is simulated" in row.source
    assert row.spilled_l == pytest.approx(0.0, abs=1e-3)
    (tilted,) = kitchen.ask("would_spill", "coffee_mug_1", 60, fill_share=0.8)
    assert 0.0 < tilted.spilled_l < 0.8 * tilted.capacity_l
    upright = kitchen.ask("would_spill", "coffee_mug_1", 10)
    assert not upright
    assert "assumed to be filled to 80%" in reasons(upright)


def test_an_uncertain_tilt_gives_a_probability(kitchen: KnowledgeBase) -> None:
    (row,) = kitchen.ask("would_spill", "coffee_mug_1", 32, fill_share=0.8, tilt_std_deg=5)
    assert 0.0 < row.interval[0] < row.probability < row.interval[1] < 1.0
    assert row.tried == 50


def test_what_has_no_depression_holds_no_liquid(kitchen: KnowledgeBase) -> None:
    assert "table holds no liquid" in reasons(kitchen.ask("would_spill", "table", 30))


# -- after an edit -----------------------------------------------------------------------------------------------------


def fields(row: Any) -> dict[str, Any]:
    return {field.name: field.value for field in row.answer}


@each_case(
    "edit",
    [
        "open the Drawer",
        '{"do": "open", "thing": "Drawer"}',
        '[{"do": "open", "thing": "Drawer"}]',
        '{"steps": [{"do": "open", "thing": "DrawerSlide"}]}',
        "steps:\n  - do: open\n    thing: Drawer\n",
    ],
)
def test_an_edit_is_words_or_a_plan_a_step_or_a_list_of_steps(sim: Simulation, edit: str) -> None:
    rows = sim.ask("what_if", edit, "articulated_parts Cupboard", wait_s=0.2)
    assert [fields(row)["state"] for row in rows] == ["open"]
    assert rows[0].asked == "articulated_parts"
    assert fields(rows[0])["share"] > 0.9


def test_any_question_is_asked_in_the_world_after_an_edit(sim: Simulation) -> None:
    rows = sim.ask("what_if", "put the Mug on the Fridge then wait 0.5 s", "where_is thing=Mug relation=on")
    assert [fields(row)["other"] for row in rows] == [MAP + "Fridge"]
    (row,) = sim.ask("what_if", "put Mug on Fridge", "stays Mug", wait_s=0)
    assert fields(row)["place"] == MAP + "Fridge"


def test_an_uncertain_edit_gives_each_answer_its_share_of_the_samples(sim: Simulation) -> None:
    uncertain = '"uncertainty": [{"thing": "Overhanging", "position_m": 0.03}]'
    plan = f'{{"steps": [{{"do": "wait", "duration_s": 0.5}}], {uncertain}}}'
    rows = sim.ask(
        "what_if", plan, "where_is thing=Overhanging relation=on", wait_s=0.5, samples=10, seed=1, min_probability=0
    )
    shares = {fields(row)["other"].rpartition("#")[2]: row.probability for row in rows}
    assert set(shares) == {"Cupboard", "Floor"}
    assert sum(shares.values()) == pytest.approx(1.0)
    assert all(row.tried == 10 for row in rows)


def test_a_busy_machine_tries_one_sample_and_says_what_it_did_not_try(
    sim: Simulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trials, "_BUDGET_S", 0.0)
    (row,) = sim.ask("what_if", "open Drawer", "articulated_parts Cupboard", wait_s=0.2)
    assert (row.probability, row.tried) == (1.0, 1)
    edit = '{"steps": [{"do": "open", "thing": "Drawer"}], "uncertainty": [{"thing": "Mug", "mass": 0.1}]}'
    (row,) = sim.ask("what_if", edit, "articulated_parts Cupboard", wait_s=0.2, samples=3)
    assert (row.probability, row.tried) == (1.0, 1)
    assert "2 samples not tried" in row.why
    monkeypatch.setattr(trials, "_FIRST_SAMPLE_S", 0.0)
    answers = sim.ask("what_if", "open Drawer", "articulated_parts Cupboard", wait_s=0.2)
    assert not answers
    assert reasons(answers).startswith("no sample ended: ")


def test_without_an_answer_the_reasons_are_those_after_the_edit(sim: Simulation) -> None:
    answers = sim.ask("what_if", "open Drawer", "where_is thing=Mug other=Fridge relation=inside", wait_s=0)
    assert not answers
    assert reasons(answers).startswith("after the edit, ")


@each_case(
    ("edit", "question", "error"),
    [
        ("juggle the Mug", "where_is Mug", InvalidArgumentError),
        ("open the Nonsense", "where_is Mug", NameNotFoundError),
        ("open the Mug", "where_is Mug", InvalidArgumentError),
        ("steps:\n  - do: open\n    thing: Nonsense\n", "where_is Mug", PlanError),
        ("open Drawer", "what_if 'open Drawer' 'where_is Mug'", InvalidArgumentError),
        ("/etc/passwd", "where_is Mug", InvalidArgumentError),
    ],
)
def test_a_bad_edit_or_question_is_an_error(sim: Simulation, edit: str, question: str, error: type[Exception]) -> None:
    with pytest.raises(error):
        sim.ask("what_if", edit, question, wait_s=0)


def test_a_text_is_never_read_as_a_path() -> None:
    with pytest.raises(PlanError, match="the plan:1"):
        plan_from_text("/etc/passwd")


# -- in all interfaces -------------------------------------------------------------------------------------------------


def test_they_are_declared_like_all_others(sim: Simulation) -> None:
    declared = {each.name: each for each in list_questions() if each.imagines}
    assert declared.keys() == IMAGINING
    for question in declared.values():
        assert {"probability", "interval", "tried", "why", "source"} <= question.columns.keys()
        assert question.uses_current_state
        assert question.has_explanation
    assert get_question("would-tip") is declared["would_tip"]


@each_case(
    ("sentence", "question"),
    [
        ("would the Mug stay on the Cupboard?", "stays"),
        ("is the Mug safe on the Cupboard?", "stays"),
        ("can the Fridge be opened?", "can_open"),
        ("would the Pillar tip over with 6 N?", "would_tip"),
        ("can I put the Mug on the Fridge?", "fits_now"),
    ],
)
def test_plain_sentences_ask_them(sim: Simulation, sentence: str, question: str) -> None:
    assert sim.ask(sentence).question.name == question


@each_case("question", sorted(IMAGINING))
def test_without_arguments_they_say_what_to_give(sim: Simulation, question: str) -> None:
    answers = sim.ask(question)
    assert not answers
    assert reasons(answers).startswith("give ")


@each_case(
    ("question", "args"),
    [
        ("stays", {"thing": "Mug", "uncertainty": "weight=2"}),
        ("stays", {"thing": "Mug", "uncertainty": "mass=-1"}),
        ("stays", {"thing": "Mug", "for_s": -1}),
        ("stays", {"thing": "Mug", "samples": 0, "uncertainty": "mass=0.1"}),
        ("would_tip", {"thing": "Mug", "height_m": 3}),
        ("can_open", {"thing": "Drawer", "to_share": 2}),
    ],
)
def test_bad_arguments_are_named(sim: Simulation, question: str, args: dict[str, Any]) -> None:
    with pytest.raises(InvalidArgumentError):
        sim.ask(question, **args)


def test_nothing_that_is_asked_changes_the_world(sim: Simulation) -> None:
    """The fixture compares the world with that before all tests of this module as well."""
    before, revision = sim.snapshot(), sim.state.revision
    assert not sim.ask("stays", "Overhanging")
    assert sim.ask("what_if", "open Drawer then put Mug on Fridge", "where_is Mug", wait_s=0.2)
    assert diff(before, sim.snapshot()).identical(0.0)
    assert (sim.state.revision, sim.state.time_s, sim.forks) == (revision, 0.0, ())


# -- sources -----------------------------------------------------------------------------------------------------------


def test_without_a_simulation_one_is_made_from_the_map_and_kept_until_the_knowledge_changes(
    kitchen: KnowledgeBase,
) -> None:
    (row,) = kitchen.ask("stays", "milk_carton_1", for_s=0.2)
    assert row.source == "mujoco, a simulation made from the map kitchen, since none is running"
    kept = kitchen._derived
    assert sum(key[0] != "state" for key in kept) == 1
    kitchen.ask("stays", "coffee_mug_1", for_s=0.2)
    assert kitchen._derived is kept
    kitchen.tell("milk_carton_1", "label", "test")
    assert not kitchen._derived
    kitchen.retract("milk_carton_1", "label", "test")


def test_a_running_simulation_is_imagined_from_its_state(sim: Simulation) -> None:
    (row,) = sim.ask("stays", "Mug", for_s=0.2)
    assert row.source == "mujoco, a copy of the running simulation"


class Unforkable(MujocoEngine):
    """An engine that cannot be forked, as that of another process."""

    name = "distant"
    capabilities = MujocoEngine.capabilities - {Capability.FORK}


@pytest.mark.parametrize(
    ("engine", "note"),
    [(Unforkable, "distant cannot be forked"), (NullEngine, "null has no physics")],
)
def test_an_engine_without_copies_is_imagined_in_mujoco_from_its_snapshot(engine: type, note: str) -> None:
    with Simulation(KnowledgeBase(), engine(), primitive_shapes=True) as sim:
        sim.spawn(kitchenette())
        sim.engine.run(lambda running: running.apply(SetPoses({BodyId("Mug"): Pose((1.69, 0.2, 0.85))})), edits=True)
        before = sim.snapshot()
        answers = sim.ask("stays", "Mug")
        assert not answers  # it overhangs in the present state, not in the map
        (row,) = sim.ask("can_open", "Drawer")
        assert row.source == f"mujoco; {note}: the copy is simulated by mujoco, from a snapshot at rest"
        assert diff(before, sim.snapshot()).identical(0.0)


# -- counting ----------------------------------------------------------------------------------------------------------


def test_unknown_samples_widen_the_interval_and_are_neither_yes_nor_no() -> None:
    known = tuple(Trial(holds=each < 8, why="") for each in range(10))
    unknown = tuple(Trial(holds=None, why="lost") for _ in range(10))
    some, more = Trials(known, is_uncertain=True), Trials(known + unknown, is_uncertain=True)
    assert some.probability == more.probability == 0.8
    assert (some.tried, more.tried) == (10, 10)
    assert more.interval[0] < some.interval[0] < 0.8 < some.interval[1] < more.interval[1]
    assert Trials(unknown).probability is None
    assert Trials(unknown).interval == (0.0, 1.0)


def test_words_are_standard_deviations() -> None:
    (found,) = parse_uncertainty("Mug", "position_m=0.01, mass=0.2")
    assert (found.thing, found.position_m, found.mass) == ("Mug", 0.01, 0.2)
    assert parse_uncertainty("Mug", None) == ()
