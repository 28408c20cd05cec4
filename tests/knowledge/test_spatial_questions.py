"""Questions about directions, distances, ways, rooms, views and places, in the kitchen, small worlds and real maps."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage.engines import NullEngine
from mindstage.engines.mujoco import MujocoEngine
from mindstage.errors import InvalidArgumentError
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.queries import (
    Answers,
    LiquidBasis,
    Question,
    ReferenceFrame,
    RoomBasis,
    direction_of,
    distance,
    fits,
    free_place,
    nearest,
    path,
    reachable,
    visible_from,
)
from mindstage.knowledge.questions import StateAccess, WorldState
from mindstage.maps import bundled_kitchen
from mindstage.rdf.graphs import local_name
from mindstage.scene import BodyId, Pose, World
from mindstage.scene.edits import SetPoses
from mindstage.scene.proximity import Direction
from mindstage.scene.transforms import normalized_pose_array, pose_from_array, pose_multiply
from mindstage.simulation import Simulation
from tests.engines.scenes import body, world
from tests.maps.small_maps import body_turtle, knowledge_base_from, room_map

MIRRORED = {
    Direction.LEFT: Direction.RIGHT,
    Direction.RIGHT: Direction.LEFT,
    Direction.FRONT: Direction.BEHIND,
    Direction.BEHIND: Direction.FRONT,
}
NO_ROTATION = (1.0, 0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def kitchen() -> KnowledgeBase:
    kb = KnowledgeBase()
    kb.load(bundled_kitchen())
    return kb


@pytest.fixture(scope="module")
def simulated(kitchen: KnowledgeBase) -> Iterator[Simulation]:
    with Simulation(kitchen, MujocoEngine()) as sim:
        sim.spawn()
        yield sim


@pytest.fixture(scope="module")
def empty() -> KnowledgeBase:
    return KnowledgeBase(bundled_ontology=False)


def asked(kb: KnowledgeBase, question: Question, scene: World, **args: object) -> Answers:
    """The answers in a world that an engine has."""
    state = WorldState(world=scene, spawned=(scene,), source="test")
    return question.ask(kb, args, present=StateAccess(kb, lambda: state))


def names(rows: object, column: str = "thing") -> list[str]:
    return [local_name(getattr(row, column)) for row in rows]  # type: ignore[attr-defined]


def moved(scene: World, yaw: float, offset: tuple[float, float, float]) -> World:
    """A world that is turned about z and moved as a whole."""
    motion = np.array([*offset, np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])
    bodies = tuple(
        replace(each, pose=pose_from_array(pose_multiply(motion, normalized_pose_array(each.pose))))
        for each in scene.bodies
    )
    return replace(scene, bodies=bodies)


# -- directions --------------------------------------------------------------------------------------------------------


def table_scene() -> World:
    """A table with four things around a cup that looks along y."""
    half = np.sqrt(0.5)
    return world(
        body("cup", (0.0, 0.0, 1.0), (0.1, 0.1, 0.1), quaternion=(half, 0.0, 0.0, half)),
        body("east", (0.5, 0.05, 1.0), (0.1, 0.1, 0.1)),
        body("north", (0.0, 0.5, 1.0), (0.1, 0.1, 0.1)),
        body("west", (-0.5, 0.0, 1.0), (0.1, 0.1, 0.1)),
        body("south", (0.05, -0.5, 1.0), (0.1, 0.1, 0.1)),
        body("lamp", (0.5, 0.0, 2.0), (0.1, 0.1, 0.1)),
        body("saucer", (0.01, 0.0, 0.94), (0.2, 0.2, 0.02)),
    )


def directions_from_cup(kb: KnowledgeBase, scene: World, frame: ReferenceFrame, **args: object) -> dict[str, Direction]:
    rows = asked(kb, direction_of, scene, other="cup", frame=frame, **args)
    assert len({row.thing for row in rows}) == len(rows)
    return {local_name(row.thing): row.direction for row in rows}


def test_each_frame_has_its_own_front(empty: KnowledgeBase) -> None:
    scene = table_scene()
    front, left, behind, right = Direction.FRONT, Direction.LEFT, Direction.BEHIND, Direction.RIGHT
    by_map = {"east": front, "north": left, "west": behind, "south": right}
    assert directions_from_cup(empty, scene, ReferenceFrame.MAP) == by_map
    by_cup = {"north": front, "west": left, "south": behind, "east": right}
    assert directions_from_cup(empty, scene, ReferenceFrame.OBJECT) == by_cup
    # A viewer in the west who looks east has the north on the left, and the nearer west in front.
    seen = {"west": front, "north": left, "east": behind, "south": right}
    for pose in ("-3 0 1.5 0", "-3 0 1.5 1 0 0 0", "-3 0 1.5"):
        assert directions_from_cup(empty, scene, ReferenceFrame.VIEWER, viewer_pose=pose) == seen


def test_a_viewer_who_turns_around_exchanges_left_and_right(empty: KnowledgeBase) -> None:
    scene = table_scene()
    for yaw in (0.3, 2.0, -1.1):
        before, after = (
            directions_from_cup(empty, scene, ReferenceFrame.VIEWER, viewer_pose=f"1 1 1 {angle}")
            for angle in (yaw, yaw + np.pi)
        )
        assert after == {name: MIRRORED[direction] for name, direction in before.items()}


def test_a_viewer_can_be_a_body(empty: KnowledgeBase) -> None:
    half = np.sqrt(0.5)
    camera = body("camera", (0.0, -3.0, 1.0), (0.1, 0.1, 0.1), quaternion=(half, 0.0, 0.0, half))
    scene = replace(table_scene(), bodies=(*table_scene().bodies, camera))
    by_body = directions_from_cup(empty, scene, ReferenceFrame.VIEWER, viewer="camera")
    assert by_body["west"] is Direction.LEFT
    assert by_body["south"] is Direction.FRONT
    assert by_body == directions_from_cup(empty, scene, ReferenceFrame.VIEWER, viewer_pose=f"0 -3 1 {np.pi / 2}")


def test_moving_everything_changes_the_map_s_directions_only(empty: KnowledgeBase) -> None:
    scene = table_scene()
    turned = moved(scene, 0.9, (3.0, -2.0, 0.5))
    frame = ReferenceFrame.OBJECT
    assert directions_from_cup(empty, turned, frame) == directions_from_cup(empty, scene, frame)
    assert directions_from_cup(empty, turned, ReferenceFrame.MAP) != directions_from_cup(
        empty, scene, ReferenceFrame.MAP
    )
    for a, b in combinations(["cup", "east", "lamp", "saucer"], 2):
        (one,), (other,) = (asked(empty, distance, each, thing=a, other=b) for each in (scene, turned))
        assert (one.gap, one.center_distance) == pytest.approx((other.gap, other.center_distance), abs=2e-6)


def test_the_inverse_of_a_direction_holds_in_a_common_frame(kitchen: KnowledgeBase) -> None:
    rows = kitchen.ask(direction_of, thing="table", frame="map")
    assert len(rows) > 20
    inverse = {(row.thing, row.direction) for row in kitchen.ask(direction_of, other="table", frame="map")}
    assert {(row.other, MIRRORED[row.direction]) for row in rows} == inverse


def test_open_directions_name_what_to_give(kitchen: KnowledgeBase) -> None:
    assert "give thing or other" in kitchen.ask(direction_of).missing[0].reason
    assert "needs a viewer" in kitchen.ask(direction_of, thing="table", frame="viewer").missing[0].reason
    (missing,) = kitchen.ask(direction_of, thing="fridge", other="freezer").missing
    assert "one is above, below or around the other" in missing.reason
    with pytest.raises(InvalidArgumentError, match="3 or 4 or 7 numbers"):
        kitchen.ask(direction_of, thing="table", viewer_pose="here")


# -- distances ---------------------------------------------------------------------------------------------------------


def test_distances_in_the_kitchen_are_those_of_the_map(kitchen: KnowledgeBase) -> None:
    (row,) = kitchen.ask(distance, thing="milk_carton_1", other="milk_carton_2")
    assert row.gap == pytest.approx(0.028)
    (same,) = kitchen.ask(distance, thing="milk_carton_2", other="milk_carton_1")
    assert (same.gap, same.center_distance) == (row.gap, row.center_distance)
    (inside,) = kitchen.ask(distance, thing="milk_carton_1", other="fridge")
    assert inside.gap < 0.0
    assert "overlap by" in kitchen.explain(distance, inside)[0]


def test_the_nearest_are_the_first_of_all_distances(kitchen: KnowledgeBase) -> None:
    chairs = kitchen.ask(nearest, thing="table", cls="Chair-PieceOfFurniture", count=3)
    apart = {row.other: row.gap for row in kitchen.ask(distance, thing="table")}
    members = kitchen.reasoner.members(kitchen.ask("individual_of_class", cls="Chair-PieceOfFurniture")[0].cls)
    assert [row.gap for row in chairs] == sorted(apart[each] for each in members)[:3]
    assert [row.rank for row in chairs] == [1, 2, 3]
    (cup,) = kitchen.ask(nearest, position="-0.1 -0.6 0.8", cls="Cup")
    assert local_name(cup.other) == "coffee_mug_4"
    with pytest.raises(InvalidArgumentError, match="count 0: it must be an integer from 1"):
        kitchen.ask(nearest, thing="table", count=0)
    assert "give thing or position" in kitchen.ask(nearest).missing[0].reason
    assert "no other body of class Robot" in kitchen.ask(nearest, thing="table", cls="Robot").missing[0].reason


def test_between_two_bodies_is_symmetric(kitchen: KnowledgeBase) -> None:
    rows = kitchen.ask("is_between", one="fridge", other="oven")
    assert "drawer_unit_left" in names(rows)
    assert "table" not in names(rows)
    assert set(names(rows)) == set(names(kitchen.ask("is_between", one="oven", other="fridge")))


# -- sizes and numbers -------------------------------------------------------------------------------------------------


def test_larger_and_smaller_are_inverse(kitchen: KnowledgeBase) -> None:
    (row,) = kitchen.ask("larger_than", thing="fridge", measure="height", other="oven")
    assert (row.value, row.other_value) == (1.4, 0.72)
    assert not kitchen.ask("larger_than", thing="oven", measure="height", other="fridge")
    larger = set(names(kitchen.ask("larger_than", other="fridge", measure="volume")))
    smaller = set(names(kitchen.ask("larger_than", thing="fridge", measure="volume"), "other"))
    assert len(larger) + len(smaller) == len(kitchen.world().bodies) - 1
    assert not larger & smaller


def test_counts_are_those_of_the_individuals(kitchen: KnowledgeBase) -> None:
    for cls in ("Cup", "Plate", "Handle", "Drawer"):
        (row,) = kitchen.ask("how_many", cls=cls)
        assert row.count == len(kitchen.ask("individual_of_class", cls=cls))
    (row,) = kitchen.ask("how_many", cls="Plate", place="table")
    on_table = {each.thing for each in kitchen.ask("where_is", other="table", relation="on")}
    plates = {each.individual for each in kitchen.ask("individual_of_class", cls="Plate")}
    assert row.count == len(on_table & plates)
    assert "on or inside table" in kitchen.explain("how_many", row)[0]
    assert "no individual in any map is a Robot" in kitchen.ask("how_many", cls="Robot").missing[0].reason


def test_the_most_similar_body_has_the_same_class_and_size(kitchen: KnowledgeBase) -> None:
    first, *others = kitchen.ask("similar_to", thing="milk_carton_1")
    assert local_name(first.other) == "milk_carton_2"
    assert (first.same_class, first.size_difference) == (True, 0.0)
    assert not any(row.same_class for row in others[1:])
    assert [row.rank for row in others] == list(range(2, len(others) + 2))


# -- belonging and states ----------------------------------------------------------------------------------------------


def test_milk_on_the_table_is_misplaced_until_it_is_back(kitchen: KnowledgeBase) -> None:
    with Simulation(kitchen, NullEngine()) as sim:
        sim.spawn()
        assert not sim.ask("misplaced", thing="milk_carton_1")
        assert "is where it belongs: on or in fridge" in sim.ask("misplaced", thing="milk_carton_1").missing[0].reason
        before = kitchen.world().body("milk_carton_1").pose
        sim.engine.run(lambda engine: engine.apply(SetPoses({BodyId("milk_carton_1"): Pose((-0.1, -0.7, 0.85))})))
        (row,) = sim.ask("misplaced", thing="milk_carton_1")
        assert (names([row], "thing"), [local_name(each) for each in row.now]) == (["milk_carton_1"], ["table"])
        assert [local_name(each) for each in row.homes] == ["fridge"]
        assert row.source == "null"
        assert "milk_carton_1" in names(sim.ask("misplaced", cls="CowsMilk-Product"))
        sim.engine.run(lambda engine: engine.apply(SetPoses({BodyId("milk_carton_1"): before})))
        assert not sim.ask("misplaced", thing="milk_carton_1")
    (missing,) = kitchen.ask("misplaced", thing="room_door").missing
    assert missing.reason.startswith("RoomDoorW90H205 has no ")


def test_a_told_state_can_be_asked_for_until_it_is_retracted() -> None:
    kb = KnowledgeBase()
    kb.load(bundled_kitchen())
    assert "no state of anything was asserted" in kb.ask("states").missing[0].reason
    kb.tell("coffee_mug_1", "state", "clean")
    kb.tell("hob", "state", "on")
    kb.tell("coffee_mug_2", "on-Physical", "table")
    rows = kb.ask("states")
    assert {(*names([row]), local_name(row.property), local_name(row.value)) for row in rows} == {
        ("coffee_mug_1", "state", "clean"),
        ("hob", "state", "on"),
        ("coffee_mug_2", "on-Physical", "table"),
    }
    assert names(kb.ask("states", value="clean")) == ["coffee_mug_1"]
    assert names(kb.ask("states", property="on-Physical", value="table")) == ["coffee_mug_2"]
    kb.retract("coffee_mug_1", "state", "clean")
    assert not kb.ask("states", thing="coffee_mug_1")


def test_a_state_that_a_map_states_is_answered_too(tmp_path: Path) -> None:
    file = tmp_path / "room.ttl"
    file.write_text(room_map(body_turtle("cup", 'ms:state "dirty"')), encoding="utf-8")
    (row,) = knowledge_base_from(file, bundled_ontology=True).ask("states")
    assert (row.value, row.asserted) == ("dirty", False)


# -- ways --------------------------------------------------------------------------------------------------------------


def test_a_way_leads_around_the_table_and_its_blockers_are_named(simulated: Simulation) -> None:
    (row,) = simulated.ask(path, start_position="1.5 -1", goal="fridge", radius=0.2)
    assert row.source == "mujoco"
    assert row.clearance is not None
    assert row.clearance >= 0.0
    assert row.length >= np.hypot(*np.subtract(row.points[0], row.points[-1])) - 1e-6
    (blocked,) = simulated.ask(reachable, start_position="1.5 -1", goal="fridge", radius=0.5)
    assert not blocked.reachable
    assert blocked.blocked_by
    assert "in the way to fridge" in simulated.knowledge.explain(reachable, blocked)[0]


def test_a_door_that_opens_makes_a_room_reachable(empty: KnowledgeBase) -> None:
    def house(door: float) -> World:
        return world(
            body("floor", (0.0, 0.0, -0.05), (8.0, 4.0, 0.1)),
            body("south", (0.0, -1.25, 1.0), (0.1, 1.5, 2.0)),
            body("north", (0.0, 1.25, 1.0), (0.1, 1.5, 2.0)),
            body("door", (0.0, door, 1.0), (0.05, 1.0, 2.0), "dynamic", 5.0),
            body("sofa", (3.0, 0.0, 0.4), (0.8, 1.5, 0.8)),
        )

    (row,) = asked(empty, reachable, house(0.0), start_position="-3 0", goal="sofa")
    assert (row.reachable, names([row], "goal")) == (False, ["sofa"])
    assert [local_name(each) for each in row.blocked_by] == ["door"]
    assert "door in the way" in asked(empty, path, house(0.0), start_position="-3 0", goal="sofa").missing[0].reason
    (row,) = asked(empty, reachable, house(9.0), start_position="-3 0", goal="sofa")
    assert row.reachable
    (row,) = asked(empty, path, house(9.0), start_position="-3 0", goal="sofa")
    assert row.source == "test, bounding boxes"
    assert row.length == pytest.approx(3.0 + 3.0 - 0.4 - 0.9, abs=0.1)
    with pytest.raises(InvalidArgumentError, match=r"radius -1\.0: it must be a number from 0"):
        asked(empty, path, house(0.0), start_position="-3 0", goal="sofa", radius=-1.0)


# -- views -------------------------------------------------------------------------------------------------------------


def test_milk_is_seen_only_after_the_fridge_door_is_open(kitchen: KnowledgeBase) -> None:
    hidden = kitchen.ask(visible_from, thing="milk_carton_1", viewer_pose="0 0 1.6")
    assert "is hidden by fridge_door" in hidden.missing[0].reason
    shown = kitchen.ask(visible_from, thing="plate_3", viewer_pose="0 0 1.6")
    assert names(shown) == ["plate_3"]
    assert shown[0].source == "map, bounding boxes"


def test_the_view_of_the_simulation_has_its_shapes_and_poses(simulated: Simulation) -> None:
    rows = simulated.ask(visible_from, viewer_pose="0 0 1.6")
    assert len(rows) > 50
    assert {row.source for row in rows} == {"mujoco"}
    assert [row.distance for row in rows] == sorted(row.distance for row in rows)
    assert "milk_carton_1" not in names(rows)
    alone = {
        row.thing: row
        for name in ("table", "plate_3")
        for row in simulated.ask(visible_from, thing=name, viewer_pose="0 0 1.6")
    }
    assert all(row in rows for row in alone.values())
    assert "give viewer or viewer_pose" in simulated.ask(visible_from).missing[0].reason


# -- places ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("relation", "support"), [("onto", "table"), ("onto", "counter_left"), ("into", "fridge")])
def test_a_body_stays_at_the_free_place(simulated: Simulation, relation: str, support: str) -> None:
    (row,) = simulated.ask(free_place, thing="orange_juice_carton_1", relation=relation, support=support)
    assert row.margin >= 0.0
    assert row.source == "mujoco"
    id = BodyId("orange_juice_carton_1")

    def simulate(engine: MujocoEngine) -> Pose:
        before = engine.save_state()
        engine.apply(SetPoses({id: row.pose}))
        engine.step(0.5)
        after = engine.snapshot().body(id).pose
        engine.restore_state(before)
        return after

    after = simulated.engine.run(simulate)
    assert after.position == pytest.approx(row.pose.position, abs=0.004)
    assert abs(np.dot(after.quaternion, row.pose.quaternion)) == pytest.approx(1.0, abs=1e-3)


def test_several_places_for_a_class_are_apart(kitchen: KnowledgeBase) -> None:
    rows = kitchen.ask(free_place, support="counter_left", cls="Cup", count=3)
    assert len(rows) == 3
    assert [row.margin for row in rows] == sorted((row.margin for row in rows), reverse=True)
    for one, other in combinations(rows, 2):
        assert np.linalg.norm(np.subtract(one.pose.position, other.pose.position)) > 0.08
    missing = kitchen.ask(free_place, thing="table", support="plate_3").missing
    assert "larger than the support surface" in missing[0].reason


def test_what_fits_has_room_to_spare(simulated: Simulation) -> None:
    into = simulated.ask(fits, thing="milk_carton_1", relation="into", place="fridge")
    assert names(into, "place") == ["fridge"]
    assert not simulated.ask(fits, thing="fridge", place="drawer_left_1")
    assert "does not fit" in simulated.ask(fits, thing="fridge", place="drawer_left_1").missing[0].reason
    margins = [row.margin for row in simulated.ask(fits, place="drawer_left_1")]
    assert margins == sorted(margins, reverse=True)
    assert min(margins) >= 0.0


def test_cups_hold_liquid_by_class_and_by_shape(simulated: Simulation, kitchen: KnowledgeBase) -> None:
    by_class, by_shape = simulated.ask("can_hold_liquid", thing="coffee_mug_1")
    assert (by_class.basis, local_name(by_class.liquid or "")) == (LiquidBasis.CLASS, "Drink")
    x, y, z = kitchen.world().body("coffee_mug_1").size or (0.0, 0.0, 0.0)
    assert by_shape.volume is not None
    assert 0.2 * x * y * z * 1000 < by_shape.volume < x * y * z * 1000
    holding = set(names(simulated.ask("can_hold_liquid", basis="shape")))
    assert "sink" in holding
    assert not holding & {"table", "plate_board", "west_wall", "oak_board_1", "red_apple_1"}
    missing = kitchen.ask("can_hold_liquid", thing="table").missing
    assert [each.reason.rpartition(": ")[2] for each in missing] == [
        "no typePrimaryFunction-containerFor names a liquid",
        "its shape is known to a running simulation only",
    ]


# -- rooms and real maps -----------------------------------------------------------------------------------------------


def test_everything_in_the_kitchen_is_in_one_room(kitchen: KnowledgeBase) -> None:
    rows = kitchen.ask("in_room", thing="milk_carton_1")
    assert [(row.region, row.basis) for row in rows] == [("room 1", RoomBasis.WALLS)]
    assert rows[0].area == pytest.approx(4.5 * 3.6, rel=0.05)
    assert "west_wall" in [local_name(each) for each in rows[0].walls]
    outside = {body.iri for body in kitchen.world().bodies} - {row.thing for row in kitchen.ask("in_room")}
    assert len(outside) < 20
    assert "nothing is in room 2: there is room 1" in kitchen.ask("in_room", region="room 2").missing[0].reason


def test_an_individual_of_a_class_of_rooms_is_a_room(tmp_path: Path) -> None:
    size = "k:depthOfObject {0} ; k:widthOfObject {0} ; k:heightOfObject {0}".format
    parts = [
        body_turtle("hall", size(4.0), cls="k:Kitchen", position="0.0 0.0 2.0"),
        body_turtle("cup", size(0.1), position="1.0 1.0 1.0"),
        body_turtle("stray", size(0.1), position="9.0 1.0 1.0"),
        body_turtle("told", size(0.1), "k:properPhysicalParts :cup", position="9.0 2.0 1.0"),
    ]
    file = tmp_path / "room.ttl"
    file.write_text(room_map(*parts), encoding="utf-8")
    kb = knowledge_base_from(file, bundled_ontology=True)
    assert [(local_name(row.room or ""), row.basis) for row in kb.ask("in_room", thing="cup")] == [
        ("hall", RoomBasis.BOX)
    ]
    assert not kb.ask("in_room", thing="stray")
    assert "is in no room" in kb.ask("in_room", thing="stray").missing[0].reason


@pytest.fixture(scope="module", params=["soma-iai-room", "iai-kitchen-original"])
def real_map(request: pytest.FixtureRequest, shared_data: Path) -> KnowledgeBase:
    """A map of the SOMA dialect, with single walls, and one whose walls are one body."""
    kb = KnowledgeBase()
    kb.load(shared_data / "maps" / f"{request.param}.owl")
    return kb


def test_the_nearest_in_a_real_map_are_those_of_a_search_through_all(real_map: KnowledgeBase) -> None:
    fridge = next(body for body in real_map.world().bodies if "ridge" in body.cls + body.id and body.size is not None)
    every = real_map.ask(distance, thing=fridge.iri)
    assert len(every) > 30
    attached = {attachment.child for attachment in real_map.world().attachments}
    free = [row for row in every if local_name(row.other) not in attached]
    first = real_map.ask(nearest, thing=fridge.iri, count=len(every))
    gaps = [max(row.gap, 0.0) for row in first]
    assert gaps == sorted(gaps)
    assert {row.other for row in free} <= {row.other for row in first} | {fridge.iri}
    by_other = {row.other: row.gap for row in every}
    assert all(row.gap == pytest.approx(by_other[row.other], abs=2e-6) for row in first)


def test_things_in_a_real_map_are_in_a_room(real_map: KnowledgeBase) -> None:
    fridge = next(body for body in real_map.world().bodies if "ridge" in body.cls + body.id and body.size is not None)
    (row,) = real_map.ask("in_room", thing=fridge.iri)
    has_walls = sum("Wall" in body.cls for body in real_map.world().bodies) > 3
    assert row.basis is (RoomBasis.WALLS if row.walls else RoomBasis.ENCLOSURE)
    assert has_walls == (len(row.walls) > 3 or row.basis is RoomBasis.ENCLOSURE) or row.room is not None


def test_a_way_in_the_soma_kitchen_begins_where_nothing_stands(shared_data: Path) -> None:
    kb = KnowledgeBase()
    kb.load(shared_data / "maps" / "soma-iai-room.owl")
    assert all(row.reachable for row in kb.ask(reachable, start_position="-0.2 0", radius=0.2))
    (row,) = kb.ask(reachable, start_position="-1 0", goal="drawer_fridge_upper", radius=0.2)
    assert [local_name(each) for each in row.blocked_by] == ["pancake_table"], "the start is in it"
