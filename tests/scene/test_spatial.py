"""Spatial relations: each rule at its threshold, and invariants of all of them."""

from __future__ import annotations

from math import cos, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from tests.cases import each_case
from tests.engines.scenes import attachment, body, prismatic_joint, revolute_joint, world

from mindstage.scene import AngularLimits, AxisMotion, Body, LinearLimits, Pose, Quaternion, Vector, World
from mindstage.scene.spatial import SpatialRelation, SpatialRelations
from mindstage.scene.transforms import normalized_pose_array, pose_from_array, pose_multiply, quat_multiply

ON, INSIDE, ABOVE, BELOW, NEXT_TO = SpatialRelation


def relation_keys(scene: World, **only: object) -> set[tuple[str, SpatialRelation, str]]:
    return {(each.body.id, each.relation, each.other.id) for each in SpatialRelations(scene).related(**only)}  # type: ignore[arg-type]


def between(a: Body, b: Body, *more: object) -> set[SpatialRelation]:
    """Returns the relations of the first body to the second."""
    keys = relation_keys(world(a, b, *more))  # type: ignore[arg-type]
    return {relation for body_id, relation, other in keys if (body_id, other) == (a.id, b.id)}


TABLE = body("table", (0, 0, 0.5), (1, 1, 1))


def cup(x: float, y: float, z: float, size: Vector = (0.1, 0.1, 0.1), **more: object) -> Body:
    return body("cup", (x, y, z), size, **({"mobility": "dynamic"} | more))  # type: ignore[arg-type]


@each_case(
    ("item", "expected"),
    [
        (cup(0, 0, 1.05), {ON}),
        (cup(0, 0, 1.0549), {ON}),
        (cup(0, 0, 1.0551), {ABOVE}),
        (cup(0, 0, 1.0301), {ON}),
        (cup(0, 0, 1.0299), set()),
        (cup(0, 0, 1.006, (0.1, 0.1, 0.02)), {ON}),
        (cup(0, 0, 0.999, (0.1, 0.1, 0.02)), set()),
        (cup(0, 0, 0.9939, (0.1, 0.1, 0.02)), {INSIDE}),
        (cup(0.5399, 0, 1.05), {ON}),
        (cup(0.5401, 0, 1.05), set()),
        (cup(0, 0, 4.0499), {ABOVE}),
        (cup(0, 0, 4.0501), set()),
        (cup(0.7999, 0, 0.5), {NEXT_TO}),
        (cup(0.8001, 0, 0.5), set()),
        (cup(0.6, 0, 0.9999), {NEXT_TO}),
        (cup(0.6, 0, 1.0001), set()),
        (cup(0.4199, 0, 0.5), {INSIDE}),
        (cup(0.4201, 0, 0.5), {INSIDE}),
        (cup(0.4699, 0, 0.5), {INSIDE}),
        (cup(0.4701, 0, 0.5), set()),
        (cup(0.5399, 0, 0.5), set()),
        (cup(0.5401, 0, 0.5), {NEXT_TO}),
    ],
)
def test_each_relation_holds_up_to_its_threshold(item: Body, expected: set[SpatialRelation]) -> None:
    assert between(item, TABLE) == expected
    assert between(TABLE, item) == {BELOW for each in expected if each in {ON, ABOVE}} | (expected & {NEXT_TO})


def test_relations_report_gap_and_overlap() -> None:
    scene = world(
        TABLE, cup(0.45, 0, 1.052), body("in", (0.4, 0, 0.3), (0.2, 0.1, 0.1)), body("by", (0, 0.7, 0.9), (1, 0.2, 0.4))
    )
    found = {
        (each.body.id, each.relation): (each.gap, each.overlap)
        for each in SpatialRelations(scene).related(others=["table"])
    }
    assert found[("cup", ON)] == (0.002, 1.0)
    assert found[("in", INSIDE)] == (0.0, 1.0)
    assert found[("by", NEXT_TO)] == (0.1, 0.75)
    half_over = SpatialRelations(world(TABLE, cup(0.5, 0.5, 1.15))).related(subjects=["cup"])
    assert [(each.relation, each.gap, each.overlap) for each in half_over] == [(ABOVE, 0.1, 0.25)]


def test_rotated_boxes_are_measured_along_their_own_axes() -> None:
    eighth = (cos(np.pi / 8), 0.0, 0.0, sin(np.pi / 8))
    stick = body("stick", (0, 0, 1.01), (2.0, 0.02, 0.02), quaternion=eighth)
    # The stick runs from corner to corner: the upright box around it meets the cup, the stick does not.
    assert between(cup(0.5, -0.5, 1.0), stick) == set()
    assert between(cup(0.5, 0.5, 1.07), stick) == {ON}
    lying = body("lying", (0, 0, 1.1), (0.4, 0.2, 0.2), quaternion=(cos(np.pi / 4), 0.0, sin(np.pi / 4), 0.0))
    assert between(lying, TABLE) == set(), "on its end it is 0.4 m high and sinks in by half"
    assert between(replace(lying, pose=replace(lying.pose, position=(0, 0, 1.2))), TABLE) == {ON}


# -- joints and attachments --------------------------------------------------------------------------------------------

FRIDGE = body("fridge", (0, 0, 1), (0.6, 0.6, 2))
DOOR = body("door", (0.32, 0, 1), (0.04, 0.6, 2), "dynamic")
HINGE = revolute_joint("hinge", "fridge", "door", (0.32, 0.3, 1))
GRIP = body("grip", (0.36, 0.2, 1), (0.04, 0.04, 0.3), "kinematic")


def test_bodies_inside_are_not_next_to_bodies_outside() -> None:
    milk, jar = body("milk", (0, 0.2, 1), (0.1, 0.1, 0.2)), body("jar", (0, 0, 1), (0.1, 0.1, 0.2))
    outside = body("outside", (0, 0.4, 1), (0.1, 0.1, 0.2))
    found = relation_keys(world(FRIDGE, milk, jar, outside))
    assert {("milk", INSIDE, "fridge"), ("milk", NEXT_TO, "jar"), ("outside", NEXT_TO, "fridge")} <= found
    assert not {("milk", NEXT_TO, "outside"), ("milk", NEXT_TO, "fridge"), ("outside", INSIDE, "fridge")} & found


def test_containment_is_transitive() -> None:
    box, egg = body("box", (0, 0, 1), (0.3, 0.3, 0.2)), body("egg", (0, 0, 1), (0.05, 0.05, 0.06))
    beside = body("beside", (0.05, 0.2, 1), (0.05, 0.05, 0.2))
    found = relation_keys(world(FRIDGE, box, egg, beside))
    assert {("egg", INSIDE, "box"), ("egg", INSIDE, "fridge"), ("box", NEXT_TO, "beside")} <= found
    assert ("egg", NEXT_TO, "beside") not in found


def test_a_door_is_next_to_neither_its_cabinet_nor_its_handle() -> None:
    scene = world(FRIDGE, DOOR, GRIP, HINGE, attachment("door", "grip"))
    assert relation_keys(scene, relations=[NEXT_TO]) == set()
    assert relation_keys(world(FRIDGE, DOOR, GRIP), relations=[NEXT_TO], subjects=["door"]) == {
        ("door", NEXT_TO, "fridge"),
        ("door", NEXT_TO, "grip"),
    }


def test_jointed_bodies_are_on_nothing_and_support_only_dynamic_ones() -> None:
    floor, counter = body("floor", (0, 0, -0.05), (9, 9, 0.1)), body("counter", (0.3, 0, 2.02), (0.8, 0.8, 0.04))
    scene = world(floor, FRIDGE, DOOR, HINGE, counter, body("cup", (0.32, 0, 2.09), (0.02, 0.1, 0.1), "dynamic"))
    found = relation_keys(scene, relations=[ON])
    assert found == {("fridge", ON, "floor"), ("counter", ON, "fridge"), ("cup", ON, "counter")}
    without = replace(scene, bodies=tuple(each for each in scene.bodies if each.id != "counter"))
    lower = replace(without.body("cup"), pose=Pose((0.32, 0.0, 2.05)))
    on_door = replace(without, bodies=(*(each for each in without.bodies if each.id != "cup"), lower))
    assert ("cup", ON, "door") in relation_keys(on_door)


def test_a_thing_on_a_floating_joint_is_on_what_is_below_it() -> None:
    free = AxisMotion.FREE
    floating = replace(
        prismatic_joint("of_cup", "table", "cup", (0, 0, 0)),
        linear=LinearLimits(x=free, y=free, z=free),
        angular=AngularLimits(twist=free, swing1=free, swing2=free),
    )
    table, cup = body("table", (0, 0, 0.4), (1, 1, 0.8)), body("cup", (0, 0, 0.85), (0.1, 0.1, 0.1), "dynamic")
    assert relation_keys(world(table, cup, floating), relations=[ON]) == {("cup", ON, "table")}


def test_parent_and_child_of_a_joint_may_be_swapped() -> None:
    upside_down = prismatic_joint("slide", "drawer", "cabinet", (0, 0, 0.2))
    cabinet, drawer = (
        body("cabinet", (0, 0, 0.5), (0.6, 0.6, 1)),
        body("drawer", (0.7, 0, 0.2), (0.5, 0.5, 0.2), "dynamic"),
    )
    low = body("low", (0.7, 0, 0.05), (0.5, 0.5, 0.1))
    assert ("drawer", ON, "low") not in relation_keys(world(cabinet, drawer, low, upside_down))
    assert ("drawer", ON, "low") in relation_keys(world(cabinet, drawer, low))


# -- excluded bodies ---------------------------------------------------------------------------------------------------


def test_enclosing_bodies_take_part_in_no_relation() -> None:
    walls = body("walls", (0, 0, 1.5), (5, 5, 3))
    shelves = [body(f"shelf{n}", (n - 1.0, 0, 0.5), (0.3, 0.3, 1)) for n in range(3)]
    scene = world(walls, *shelves)
    assert SpatialRelations(scene).enclosing_bodies == ("walls",)
    assert relation_keys(scene) == set()
    assert relation_keys(scene, subjects=["walls"]) == set()
    two = replace(scene, bodies=scene.bodies[:-1])
    assert ("shelf0", INSIDE, "walls") in relation_keys(two), "two pieces of furniture are too few"


def test_bodies_without_a_size_take_part_in_no_relation() -> None:
    assert relation_keys(world(TABLE, replace(cup(0, 0, 1.05), size=None))) == set()
    assert relation_keys(world()) == set()


def test_coplanar_flat_bodies_are_not_on_each_other() -> None:
    sheets = [body(name, (0, 0, 1), (1, 1, 0)) for name in ("a", "b")]
    assert relation_keys(world(*sheets), relations=[ON, ABOVE, BELOW]) == set()


def test_only_requested_relations_are_returned() -> None:
    scene = world(TABLE, cup(0, 0, 1.05), body("jar", (0.2, 0, 1.05), (0.1, 0.1, 0.1)))
    all_relations = relation_keys(scene)
    for body_id in ("table", "cup", "jar", "missing"):
        assert relation_keys(scene, subjects=[body_id]) == {each for each in all_relations if each[0] == body_id}
        assert relation_keys(scene, others=[body_id]) == {each for each in all_relations if each[2] == body_id}
    assert relation_keys(scene, relations=[BELOW]) == {each for each in all_relations if each[1] is BELOW}


# -- invariants --------------------------------------------------------------------------------------------------------

# No sum of these equals a threshold, so rounding does not matter.
lengths = st.integers(1, 120).map(lambda n: n * 0.0137)
places = st.integers(-90, 90).map(lambda n: n * 0.0137)
turns = st.integers(0, 23).map(lambda n: n * np.pi / 12)
leans = st.sampled_from([0.0, 0.0, 0.0, 0.3, 1.0])
placements = st.tuples(places, places, places, turns, leans, lengths, lengths, lengths)


def _turned(turn: float, lean: float) -> Quaternion:
    """Returns a rotation about x, followed by one about the vertical."""
    lean_x, turn_z = (cos(lean / 2), sin(lean / 2), 0.0, 0.0), (cos(turn / 2), 0.0, 0.0, sin(turn / 2))
    w, x, y, z = quat_multiply(turn_z, lean_x).tolist()
    return w, x, y, z


@st.composite
def scenes(draw: st.DrawFn) -> World:
    drawn = draw(st.lists(placements, min_size=2, max_size=6))
    mobilities = st.sampled_from(["static", "dynamic"])
    return world(
        *(
            body(f"b{row}", (x, y, z), (a, b, c), draw(mobilities), quaternion=_turned(turn, lean))
            for row, (x, y, z, turn, lean, a, b, c) in enumerate(drawn)
        )
    )


@given(scenes())
def test_relations_are_irreflexive_and_inverses_come_in_pairs(scene: World) -> None:
    found = relation_keys(scene)
    for body_id, relation, other in found:
        assert body_id != other
        back = {each for one, each, two in found if (one, two) == (other, body_id)}
        match relation:
            case SpatialRelation.ON | SpatialRelation.ABOVE:
                assert back == {BELOW}
            case SpatialRelation.BELOW:
                assert back in ({ON}, {ABOVE})
            case SpatialRelation.INSIDE:
                assert INSIDE not in back
            case SpatialRelation.NEXT_TO:
                assert NEXT_TO in back


@given(scenes(), st.tuples(*(st.integers(-500, 500).map(lambda n: n * 0.1) for _ in range(3))), turns)
def test_relations_are_invariant_under_a_rigid_motion_of_the_scene(scene: World, by: Vector, turn: float) -> None:
    pose = normalized_pose_array(Pose(by, (cos(turn / 2), 0.0, 0.0, sin(turn / 2))))
    moved = tuple(
        replace(each, pose=pose_from_array(pose_multiply(pose, normalized_pose_array(each.pose))))
        for each in scene.bodies
    )
    before = {(each.body.id, each.relation, each.other.id): each for each in SpatialRelations(scene).related()}
    after = {
        (each.body.id, each.relation, each.other.id): each
        for each in SpatialRelations(replace(scene, bodies=moved)).related()
    }
    assert before.keys() == after.keys()
    for key, each in before.items():
        assert (each.gap, each.overlap) == pytest.approx((after[key].gap, after[key].overlap), abs=5e-6)


@given(scenes())
def test_the_order_of_bodies_does_not_affect_relations(scene: World) -> None:
    assert relation_keys(replace(scene, bodies=scene.bodies[::-1])) == relation_keys(scene)


def test_relations_of_a_large_scene_are_those_of_its_parts() -> None:
    tables = [
        part
        for n in range(500)
        for part in (
            body(f"table{n}", (n % 25 * 3.0, n // 25 * 3.0, 0.5), (1, 1, 1)),
            body(f"cup{n}", (n % 25 * 3.0, n // 25 * 3.0, 1.05), (0.1, 0.1, 0.1)),
        )
    ]
    found = relation_keys(world(*tables))
    assert len(found) == 1000
    assert all(body_id.strip("tablecup") == other.strip("tablecup") for body_id, _, other in found)


def random_room(rng: np.random.Generator) -> World:
    """Boxes in a heap: a room around it, containers, furniture with doors, things that stick together."""
    sizes = [(8.0, 8.0, 3.0), *(tuple(rng.uniform(0.05, 2.0, 3)) for _ in range(rng.integers(3, 25)))]
    bodies = [
        body(
            f"b{row}",
            (0, 0, 1.5) if row == 0 else tuple(rng.uniform((-3, -3, 0), (3, 3, 2.5))),
            size,
            mobility="static" if row == 0 or rng.random() < 0.5 else "dynamic",
        )
        for row, size in enumerate(sizes)
    ]
    ends = [rng.choice(len(bodies), 2, replace=False) for _ in range(rng.integers(0, 5))]
    joints = [revolute_joint(f"j{at}", f"b{a}", f"b{b}", (0, 0, 0)) for at, (a, b) in enumerate(ends)]
    return world(*bodies, *joints, *(attachment(f"b{rng.integers(1, row)}", f"b{row}") for row in range(2, 5, 2)))


def rows_of(relations: SpatialRelations) -> set[tuple[object, ...]]:
    return {(each.body, each.relation, each.other, each.gap, each.overlap) for each in relations.related()}


@pytest.mark.parametrize("seed", range(40))
def test_moved_relations_are_those_of_the_moved_world(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scene = random_room(rng)
    relations = SpatialRelations(scene)
    for _ in range(4):
        rows = np.sort(rng.choice(len(scene.bodies), rng.integers(1, 4), replace=False))
        bodies = list(scene.bodies)
        for row in rows.tolist():
            turn = normalized_pose_array(Pose((0, 0, 0), tuple(rng.normal(size=4))))
            turn[:3] = rng.uniform((-3, -3, 0), (3, 3, 2.5))
            bodies[row] = replace(bodies[row], pose=pose_from_array(turn))
        scene = replace(scene, bodies=tuple(bodies))
        relations, anew = relations.moved(scene, rows), SpatialRelations(scene)
        assert rows_of(relations) == rows_of(anew)
        assert set(relations.enclosing_bodies) == set(anew.enclosing_bodies)
        some = [f"b{row}" for row in rng.choice(len(bodies), 2, replace=False)]
        found = [(each.body, each.relation, each.other) for each in relations.related(subjects=some)]
        wanted = [row[:3] for row in rows_of(anew) if row[0].id in some]
        assert len(found) == len(wanted)
        assert set(found) == set(wanted)


def test_a_body_that_loses_its_place_is_no_longer_related() -> None:
    scene = world(TABLE, cup(0, 0, 1.05))
    lost = replace(scene, bodies=(TABLE, replace(scene.bodies[1], pose=Pose((float("nan"), 0, 0)))))
    relations = SpatialRelations(scene).moved(lost, np.array([1]))
    assert not rows_of(relations)
    assert rows_of(relations.moved(scene, np.array([1]))) == rows_of(SpatialRelations(scene))
