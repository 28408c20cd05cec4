"""Floor plans: paths that keep the clearance and are nearly shortest, what blocks them, and rooms within walls."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.engines.scenes import body, world

from mindstage.scene import NO_GEOMETRY, Body, World
from mindstage.scene.bounding_boxes import footprints
from mindstage.scene.floor_plan import FloorPath, FloorPlan, find_floor, free_floor_place, wall_rooms
from mindstage.scene.joint_kinematics import RigidGroups
from mindstage.scene.proximity import BodyBoxes
from mindstage.scene.ray_casting import ShapeScene
from mindstage.scene.transforms import normalize


def floor_plan(scene: World, *, radius: float, level: float = 0.0, **options: object) -> FloorPlan:
    shapes = ShapeScene(scene.bodies, NO_GEOMETRY)
    return FloorPlan(RigidGroups.from_world(scene), shapes, radius=radius, height=1.5, level=level, **options)  # type: ignore[arg-type]


def way(plan: FloorPlan, start: tuple[float, float], goal: tuple[float, float]) -> FloorPath | None:
    cells = [plan.nearest_cell(np.array(each), free=True) for each in (start, goal)]
    if None in cells:
        return None
    return plan.path(np.array([cells[0]]), np.array([cells[1]]))


def least_distance(points: np.ndarray, bodies: tuple[Body, ...]) -> float:
    """The least distance of densely sampled points to upright boxes, in each box's frame."""
    samples = np.concatenate([np.linspace(a, b, 200) for a, b in pairwise(points)])
    placed, found = BodyBoxes.from_bodies(bodies), np.inf
    for center, rotation, half in zip(
        placed.boxes.center, placed.boxes.rotation, placed.boxes.half_extents, strict=True
    ):
        local = np.abs((samples - center[:2]) @ rotation[:2, :2])
        found = min(found, float(np.linalg.norm(np.maximum(local - half[:2], 0.0), axis=1).min()))
    return found


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000), radius=st.floats(0.0, 0.4))
def test_a_path_never_comes_nearer_to_a_footprint_than_the_radius(seed: int, radius: float) -> None:
    random = np.random.default_rng(seed)
    bodies = []
    for at in range(14):
        yaw, size = random.uniform(0, np.pi), random.uniform(0.2, 1.5, 2)
        position = (*random.uniform(-3, 3, 2).tolist(), 0.5)
        quaternion = (float(np.cos(yaw / 2)), 0.0, 0.0, float(np.sin(yaw / 2)))
        bodies.append(body(f"b{at}", position, (*size.tolist(), 1.0), quaternion=quaternion))
    scene = world(*bodies)
    found = way(floor_plan(scene, radius=radius), (-4.0, -4.0), (4.0, 4.0))
    if found is not None and len(found.points) > 1:
        clearance = least_distance(found.points, scene.bodies)
        assert clearance >= radius - 1e-9
        assert found.clearance == pytest.approx(clearance - radius, abs=0.01)
        steps = np.diff(found.points, axis=0)
        assert found.length == pytest.approx(np.linalg.norm(steps, axis=1).sum())
        assert found.length >= np.linalg.norm(found.points[-1] - found.points[0]) - 1e-9


def corridor(gap: float) -> World:
    """Two walls along y with a gap at y = 2, and a door that is open aside."""
    return world(
        body("floor", (0.0, 0.0, -0.05), (8.0, 8.0, 0.1)),
        body("south", (0.0, -1.0 - gap / 4, 0.5), (0.1, 6.0 - gap / 2, 1.0)),
        body("north", (0.0, 3.0 + gap / 4, 0.5), (0.1, 2.0 - gap / 2, 1.0)),
    )


def test_a_path_through_a_gap_has_the_length_of_the_taut_string() -> None:
    scene = corridor(1.0)
    level, floor = find_floor(BodyBoxes.from_bodies(scene.bodies))
    assert (level, floor) == (0.0, (0,))
    plan = floor_plan(scene, radius=0.2, floor=floor)
    found = way(plan, (-2.0, -2.0), (2.0, -2.0))
    assert found is not None
    assert found.clearance >= 0.0
    corner = np.array([0.0, 1.5 + 0.2])  # the gap begins at 1.5 m
    string = 2 * np.linalg.norm(corner - (-2.0, -2.0))
    assert string * 0.98 <= found.length <= string * 1.05
    assert way(floor_plan(scene, radius=0.6, floor=floor), (-2.0, -2.0), (2.0, -2.0)) is None


def test_what_blocks_a_way_is_named_with_movable_bodies_before_walls() -> None:
    closed = world(*corridor(1.0).bodies, body("crate", (0.0, 2.0, 0.5), (0.5, 1.2, 1.0), "dynamic", 5.0))
    plan = floor_plan(closed, radius=0.2, floor=(0,))
    assert way(plan, (-2.0, -2.0), (2.0, -2.0)) is None
    ends = [plan.nearest_cell(np.array(each), free=True) for each in ((-2.0, -2.0), (2.0, -2.0))]
    blockers = plan.blockers(np.array([ends[0]]), np.array([ends[1]]))
    assert "crate" in [closed.bodies[row].id for row in blockers]
    assert way(floor_plan(closed, radius=0.2, floor=(0,), ignored=(3,)), (-2.0, -2.0), (2.0, -2.0)) is not None


def test_low_and_high_bodies_are_no_obstacles() -> None:
    scene = world(
        body("carpet", (0.0, 0.0, 0.01), (8.0, 0.5, 0.02)),
        body("beam", (0.0, 0.0, 2.0), (8.0, 0.5, 0.2)),
    )
    assert floor_plan(scene, radius=0.3).is_free.all()
    assert not floor_plan(scene, radius=0.3, level=0.8).is_free.all(), "the beam is 1.1 m above this floor"


def test_the_floor_is_the_highest_slab_below_a_height() -> None:
    placed = BodyBoxes.from_bodies(
        [
            body("ground", (0.0, 0.0, -0.1), (10.0, 10.0, 0.2)),
            body("upper", (0.0, 0.0, 3.0), (10.0, 10.0, 0.2)),
            body("table", (0.0, 0.0, 0.7), (1.0, 1.0, 0.1)),
        ]
    )
    assert find_floor(placed) == (0.0, (0,))
    assert find_floor(placed, below=1.0) == (0.0, (0,))
    assert find_floor(placed, below=4.0) == (pytest.approx(3.1), (1,))
    assert find_floor(BodyBoxes.from_bodies([body("box", (0, 0, 1), (1, 1, 1))])) == (0.5, ())


def walls_of_two_rooms(turn: float) -> np.ndarray:
    """A house of 8 x 4 m with a wall in the middle, which has a door of 0.9 m, turned about the origin."""
    parts = [
        ((0.0, 2.0), (8.0, 0.1)),
        ((0.0, -2.0), (8.0, 0.1)),
        ((-4.0, 0.0), (0.1, 4.0)),
        ((4.0, 0.0), (0.1, 4.0)),
        ((1.0, -1.275), (0.1, 1.45)),
        ((1.0, 1.175), (0.1, 1.65)),
    ]
    cosine, sine = np.cos(turn), np.sin(turn)
    quaternion = tuple(normalize([np.cos(turn / 2), 0.0, 0.0, np.sin(turn / 2)]).tolist())
    bodies = [
        body(f"w{at}", (cosine * x - sine * y, sine * x + cosine * y, 1.0), (*size, 2.0), quaternion=quaternion)
        for at, ((x, y), size) in enumerate(parts)
    ]
    return footprints(BodyBoxes.from_bodies(bodies).boxes)


@pytest.mark.parametrize("turn", [0.0, 0.7, 2.0])
def test_a_door_separates_two_rooms_however_the_house_is_turned(turn: float) -> None:
    rooms = wall_rooms(walls_of_two_rooms(turn))
    assert rooms.areas == pytest.approx((5.0 * 3.9, 3.0 * 3.9), rel=0.1)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    points = np.array([[-2.0, 0.0], [-3.8, 1.8], [2.5, 0.0], [6.0, 0.0], [30.0, 0.0]]) @ rotation.T
    assert rooms.room_at(points).tolist() == [1, 1, 2, 0, 0]
    assert rooms.walls[1] == (0, 1, 3, 4, 5)


def test_walls_that_surround_nothing_make_no_room() -> None:
    assert wall_rooms(walls_of_two_rooms(0.0)[:3]).areas == ()
    assert wall_rooms(np.zeros((0, 6, 2))).areas == ()


@pytest.mark.parametrize("radius", [0.0, 0.3, 2.0])
def test_free_cells_are_those_that_a_search_through_all_footprints_finds(radius: float) -> None:
    random = np.random.default_rng(7)
    bodies = [body("floor", (0.3, -0.2, -0.05), (9.0, 6.0, 0.1), quaternion=(0.98, 0.0, 0.0, 0.199))]
    for at in range(60):
        yaw = random.uniform(0, np.pi)
        size = tuple(random.uniform(0.02, 0.8, 2).tolist()) if at else (12.0, 0.05)
        position = (*random.uniform(-5, 5, 2).tolist(), 0.5)
        quaternion = (float(np.cos(yaw / 2)), 0.0, 0.0, float(np.sin(yaw / 2)))
        bodies.append(body(f"b{at}", position, (*size, 1.0), quaternion=quaternion))
    scene = world(*bodies)
    plan = floor_plan(scene, radius=radius, floor=(0,))
    cells = plan.centers(np.arange(plan.is_free.size))
    placed = BodyBoxes.from_bodies(scene.bodies).boxes
    apart = np.stack(
        [
            np.linalg.norm(np.maximum(np.abs((cells - center[:2]) @ rotation[:2, :2]) - half[:2], 0.0), axis=1)
            for center, rotation, half in zip(placed.center, placed.rotation, placed.half_extents, strict=True)
        ]
    )
    required = np.sqrt(radius**2 + plan.cell**2 / 2)
    assert np.array_equal(plan.is_free.reshape(-1), (apart[0] == 0.0) & (apart[1:].min(axis=0) >= required))
    lengths = plan.lengths_to(np.array([plan.nearest_cell(np.zeros(2), free=False)]), footprints(placed)[1:], 0.4)
    for at, length in enumerate(lengths):
        near = plan.cells_near(footprints(placed)[at + 1][None], 0.4)
        assert np.array_equal(near, np.flatnonzero((apart[at + 1] <= 0.4) & plan.is_free.reshape(-1)))
        assert np.isinf(length) or len(near)


def test_a_free_place_is_on_the_floor_and_away_from_everything_tall() -> None:
    floor = body("floor", (0.0, 0.0, 0.45), (4.0, 4.0, 0.1))
    table, rug = body("table", (0.0, 0.0, 0.9), (1.0, 1.0, 0.8)), body("rug", (1.2, 1.2, 0.505), (0.5, 0.5, 0.01))
    scene = world(floor, table, rug)
    place = free_floor_place(scene, NO_GEOMETRY, radius=0.3, height=1.5)
    assert place is not None
    x, y, level = place
    assert level == pytest.approx(0.5)
    assert max(abs(x), abs(y)) <= 2.0
    assert np.hypot(max(abs(x) - 0.5, 0.0), max(abs(y) - 0.5, 0.0)) >= 0.3
    assert free_floor_place(scene, NO_GEOMETRY, radius=1.9, height=1.5) is None


def test_a_free_place_keeps_the_largest_clearance_that_there_is() -> None:
    floor, pillar = body("floor", (0.0, 0.0, -0.05), (6.0, 4.0, 0.1)), body("pillar", (-2.0, 0.0, 1.0), (0.4, 0.4, 2.0))
    place = free_floor_place(world(floor, pillar), NO_GEOMETRY, radius=0.3, height=1.5)
    assert place is not None
    assert np.hypot(place[0] + 2.0, place[1]) - 0.2 >= 0.3 + 0.8 - 0.05
