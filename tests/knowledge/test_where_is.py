"""Spatial relations in the bundled kitchen, in the map and in an engine."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from mindstage.engines import NullEngine
from mindstage.engines.mujoco import MujocoEngine
from mindstage.errors import InvalidArgumentError, NameNotFoundError
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.queries import answers_to_builtins, cell_text, handle_of, where_is
from mindstage.knowledge.questions import StateAccess, WorldState
from mindstage.maps import bundled_kitchen
from mindstage.rdf.graphs import local_name
from mindstage.scene import BodyId, Pose
from mindstage.scene.edits import Delete, SetPoses
from mindstage.scene.spatial import SpatialRelation
from mindstage.simulation import Simulation
from tests.cases import each_case
from tests.engines.scenes import body, world
from tests.maps.small_maps import KNOWROB, ROOM_NAMESPACE, knowledge_base_from, room_map
from tests.maps.small_maps import body_turtle as individual


@pytest.fixture(scope="module")
def kitchen() -> KnowledgeBase:
    kb = KnowledgeBase()
    kb.load(bundled_kitchen())
    return kb


@pytest.fixture
def sim(kitchen: KnowledgeBase) -> Iterator[Simulation]:
    with Simulation(kitchen, NullEngine()) as sim:
        sim.spawn()
        yield sim


def relations_of(source: KnowledgeBase | Simulation, **args: object) -> set[tuple[str, str, str]]:
    rows = source.ask(where_is, **args)
    return {(local_name(row.thing), row.relation.value, local_name(row.other)) for row in rows}


@each_case(
    ("thing", "relation", "other"),
    [
        ("milk_carton_1", "inside", "fridge"),
        ("milk_carton_1", "next_to", "milk_carton_2"),
        ("milk_carton_1", "above", "egg_box_1"),
        ("egg_box_1", "below", "milk_carton_1"),
        ("fridge", "on", "freezer"),
        ("freezer", "below", "fridge"),
        ("fridge", "next_to", "pantry"),
        ("plate_3", "on", "table"),
        ("table", "below", "plate_3"),
        ("oak_board_1", "on", "counter_left"),
        ("serrated_knife_1", "on", "oak_board_1"),
        ("serrated_knife_1", "above", "counter_left"),
        ("counter_left", "on", "drawer_unit_left"),
        ("hob", "on", "counter_left"),
        ("small_saucepan_1", "on", "hob"),
        ("saucepan_lid_1", "on", "small_saucepan_1"),
        ("table_fork_1", "inside", "drawer_left_1"),
        ("table_fork_1", "inside", "drawer_unit_left"),
        ("table_fork_1", "next_to", "table_fork_2"),
        ("drawer_left_1", "inside", "drawer_unit_left"),
        ("drawer_left_1", "above", "drawer_left_2"),
        ("red_apple_1", "inside", "wide_fruit_bowl_1"),
        ("bread_loaf_1", "inside", "woven_breadbasket_1"),
        ("cereal_bowl_1", "inside", "sink"),
        ("pendant_lamp", "above", "table"),
        ("chair_1", "on", "floor"),
        ("hood", "above", "hob"),
    ],
)
def test_relations_in_the_kitchen_are_as_expected(
    kitchen: KnowledgeBase, thing: str, relation: str, other: str
) -> None:
    assert (thing, relation, other) in relations_of(kitchen, thing=thing, other=other)


@each_case(
    ("thing", "relation", "other"),
    [
        ("milk_carton_1", "on", "freezer"),
        ("milk_carton_1", "next_to", "fridge"),
        ("lettuce_head_1", "above", "freezer"),
        ("table_fork_1", "next_to", "oven"),
        ("drawer_left_1", "on", "drawer_left_2"),
        ("counter_west", "on", "base_cupboard_door_left"),
        ("fridge_door", "next_to", "fridge"),
        ("room_door", "on", "floor"),
        ("bread_loaf_1", "on", "counter_west"),
        ("plate_3", "inside", "table"),
    ],
)
def test_unexpected_relations_do_not_hold(kitchen: KnowledgeBase, thing: str, relation: str, other: str) -> None:
    assert (thing, relation, other) not in relations_of(kitchen, thing=thing, other=other)


def test_answers_are_sorted_by_body_and_then_by_distance(kitchen: KnowledgeBase) -> None:
    rows = kitchen.ask(where_is, thing="milk_carton_1")
    kinds = list(SpatialRelation)
    assert [(kinds.index(row.relation), row.gap) for row in rows] == sorted(
        (kinds.index(row.relation), row.gap) for row in rows
    )
    everything = kitchen.ask(where_is)
    assert [row.thing for row in everything] == sorted(row.thing for row in everything)


def test_an_explanation_has_the_numbers_and_the_source(kitchen: KnowledgeBase, sim: Simulation) -> None:
    (inside,) = kitchen.ask(where_is, thing="milk_carton_1", relation="inside")
    assert kitchen.explain(where_is, inside) == (
        "100% of milk_carton_1 is in fridge, 0.048 m from its nearest side",
        "as the map has it; no simulation is running",
    )
    (row,) = sim.ask(where_is, thing="milk_carton_1", relation="above", other="egg_box_1")
    assert kitchen.explain(where_is, row) == (
        "0.31 m from the top of egg_box_1 up to milk_carton_1, which share 89% of the smaller footprint",
        "as null has it now",
    )
    (row,) = kitchen.ask(where_is, thing="egg_box_1", relation="below", other="milk_carton_1")
    assert kitchen.explain(where_is, row)[0].startswith("0.31 m from the top of egg_box_1 up to milk_carton_1")
    (row,) = kitchen.ask(where_is, thing="milk_carton_1", relation="next_to", other="milk_carton_2")
    assert "0.028 m between milk_carton_1 and milk_carton_2" in kitchen.explain(where_is, row)[0]


def test_answers_convert_to_plain_values(kitchen: KnowledgeBase) -> None:
    answers = kitchen.ask(where_is, thing="milk_carton_1", relation="inside")
    (answer,) = answers_to_builtins(kitchen, answers)["answers"]
    assert (answer["id"], answer["relation"], answer["gap"], answer["source"]) == ("fridge", "inside", 0.048, "map")
    assert cell_text(answers[0].relation) == "inside"
    (argument,) = [each for each in where_is.arguments if each.name == "relation"]
    assert argument.choices == ("on", "inside", "above", "below", "next_to")
    assert "present" not in [each.name for each in where_is.arguments]


def test_an_unknown_relation_is_refused_with_the_known_ones(kitchen: KnowledgeBase) -> None:
    with pytest.raises(InvalidArgumentError, match="there is on, inside, above, below, next_to"):
        kitchen.ask(where_is, relation="beside")


# -- current state -----------------------------------------------------------------------------------------------------


def test_a_moved_body_has_its_current_relations_and_the_map_its_own(sim: Simulation) -> None:
    assert ("plate_3", "on", "table") in relations_of(sim, thing="plate_3")
    top = sim.knowledge.world().body("counter_right").pose.position
    x, y, z = top
    sim.engine.run(lambda engine: engine.apply(SetPoses({BodyId("plate_3"): Pose((x, y, z + 0.032))})))
    assert ("plate_3", "on", "counter_right") in relations_of(sim, thing="plate_3")
    assert ("plate_3", "on", "table") not in relations_of(sim, thing="plate_3")
    assert ("plate_3", "on", "table") in relations_of(sim.knowledge, thing="plate_3")
    assert {row.source for row in sim.ask(where_is, thing="plate_3")} == {"null"}


def test_falling_milk_comes_to_rest_on_the_table(kitchen: KnowledgeBase) -> None:
    with Simulation(kitchen, MujocoEngine()) as sim:
        sim.spawn()
        sim.engine.run(lambda engine: engine.apply(SetPoses({BodyId("milk_carton_1"): Pose((-0.1, -0.7, 0.9))})))
        assert ("milk_carton_1", "above", "table") in relations_of(sim, thing="milk_carton_1")
        sim.step(1.0)
        assert ("milk_carton_1", "on", "table") in relations_of(sim, thing="milk_carton_1")
        assert ("milk_carton_1", "inside", "fridge") not in relations_of(sim, thing="milk_carton_1")


def test_a_deleted_body_has_no_pose_and_a_spawned_one_has(sim: Simulation) -> None:
    sim.engine.run(lambda engine: engine.apply(Delete((BodyId("milk_carton_1"),))), edits=True)
    answers = sim.ask(where_is, thing="milk_carton_1")
    assert not answers
    assert "milk_carton_1 has no pose" in answers.missing[0].reason
    sim.spawn(world(body("parcel", (-0.1, -0.55, 0.85), (0.2, 0.2, 0.2), "dynamic")))
    assert ("parcel", "on", "table") in relations_of(sim, thing="parcel")
    with pytest.raises(NameNotFoundError, match="parcel"):
        sim.knowledge.ask(where_is, thing="parcel")
    with pytest.raises(NameNotFoundError, match="parcel"):
        sim.ask("handle_of", individual="parcel")


def test_maps_that_are_not_spawned_are_read_from_their_files(tmp_path: Path) -> None:
    first, second = tmp_path / "room.ttl", tmp_path / "hall.ttl"
    size = "k:depthOfObject 1.0 ; k:widthOfObject 1.0 ; k:heightOfObject 1.0"
    for path, name in ((first, "room"), (second, "hall")):
        parts = [individual(f"{name}-{n}", size, position=f"0.0 0.0 {n}.0") for n in (1, 2)]
        text = room_map(*parts, map=name).replace("describedInMap :room", f"describedInMap :{name}")
        path.write_text(text, encoding="utf-8")
    kb = knowledge_base_from(first, second)
    with Simulation(kb, NullEngine()) as sim:
        sim.spawn("room")
        rows = sim.ask(where_is, relation="on")
        sources = {(local_name(row.map), local_name(row.thing), row.source) for row in rows}
        assert sources == {("room", "room-2", "null"), ("hall", "hall-2", "map")}
        assert {local_name(row.map) for row in sim.ask(where_is, map="hall")} == {"hall"}
        sim.spawn("hall")
        assert {row.source for row in sim.ask(where_is)} == {"null"}
        assert {local_name(row.map) for row in sim.ask(where_is, thing="hall-2")} == {"hall"}


def test_the_engine_state_is_fetched_at_most_once(kitchen: KnowledgeBase) -> None:
    taken: list[WorldState] = []

    def take() -> WorldState:
        taken.append(WorldState(world=kitchen.world(), spawned=(kitchen.world(),), source="counted"))
        return taken[-1]

    handle_of.ask(kitchen, {}, present=StateAccess(kitchen, take))
    assert taken == []
    where_is.ask(kitchen, {"thing": "milk_carton_1", "relation": "on"}, present=StateAccess(kitchen, take))
    assert len(taken) == 1


# -- missing statements ------------------------------------------------------------------------------------------------


def test_a_missing_pose_or_size_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "room.ttl"
    lost = ":lost a owl:NamedIndividual, k:Cup ; k:describedInMap :room ."
    path.write_text(room_map(individual("sizeless"), lost), encoding="utf-8")
    kb = knowledge_base_from(path, bundled_ontology=True)
    (missing,) = kb.ask(where_is, thing="sizeless").missing
    assert (missing.cls, missing.property) == (KNOWROB + "Cup", KNOWROB + "depthOfObject")
    assert missing.reason == "sizeless has no size: neither it nor Cup states one"
    (missing,) = kb.ask(where_is, other="lost", relation="on").missing
    assert (missing.cls, missing.property) == (KNOWROB + "Cup", KNOWROB + "pose")
    assert missing.reason.startswith("lost has no pose")
    assert ROOM_NAMESPACE + "lost" not in missing.reason
