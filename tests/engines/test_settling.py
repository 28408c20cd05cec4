"""Loose bodies are moved out of what they overlap by the least distance, and nothing else is moved."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from mindstage.engines import SpawnNoteKind, SpawnReport
from mindstage.engines.collision_filter import TOUCH_TOLERANCE_M
from mindstage.engines.ground import find_ground_height, find_resting
from mindstage.engines.mujoco import MujocoEngine
from mindstage.engines.physics_model import PhysicsModelBuilder
from mindstage.scene import Body, BodyId, CollisionShapeType, GeometryMap, World
from mindstage.scene.bounding_boxes import OrientedBoxes, penetration_depths
from mindstage.scene.edits import Spawn
from mindstage.scene.transforms import normalize
from tests.engines.geometries import single_shape_geometry, table_geometry
from tests.engines.scenes import FLOOR, attachment, body, prismatic_joint, revolute_joint, world

NO_POSES = np.zeros((0, 7))
TABLE = body("table", (0, 0, 0.35), (1.2, 0.8, 0.7))


def spawned(described: World, geometry: GeometryMap | None = None) -> tuple[SpawnReport, dict[str, np.ndarray]]:
    """The report of a spawn, and the poses of the bodies that it moved."""
    performed = PhysicsModelBuilder().apply(Spawn(described, geometry=geometry or {}), NO_POSES)
    report, moved = performed.report, performed.moved
    return report, {str(id): pose for id, pose in moved.items()}


def shift_of(described: Body, moved: dict[str, np.ndarray]) -> np.ndarray:
    return moved[described.id][:3] - np.array(described.pose.position)


# -- the least way


@pytest.mark.parametrize(
    ("position", "expected"),
    [
        ((0.0, 0.0, 0.738), (0.0, 0.0, 0.012)),
        ((0.63, 0.0, 0.5), (0.01, 0.0, 0.0)),
        ((0.0, -0.41, 0.5), (0.0, -0.03, 0.0)),
        ((0.62, 0.0, 0.735), (0.0, 0.0, 0.015)),
    ],
)
def test_a_box_leaves_a_table_on_the_nearest_side(position: tuple[float, ...], expected: tuple[float, ...]) -> None:
    cup = body("cup", position, (0.08, 0.08, 0.1), "dynamic", 0.3)  # type: ignore[arg-type]
    _, moved = spawned(world(FLOOR, TABLE, cup))
    assert np.allclose(shift_of(cup, moved), expected, atol=1e-6)


def test_a_body_in_two_others_leaves_both() -> None:
    wall = body("wall", (0.55, 0, 1.2), (0.1, 1, 1.0))
    cup = body("cup", (0.47, 0, 0.74), (0.08, 0.08, 0.1), "dynamic", 0.3)
    _, moved = spawned(world(FLOOR, TABLE, wall, cup))
    assert np.allclose(shift_of(cup, moved), (-0.01, 0, 0.01), atol=1e-6)


def test_a_body_is_rather_lifted_through_a_thin_board_than_dropped() -> None:
    board = body("board", (0, 0, 1.0), (1, 1, 0.01))
    cup = body("cup", (0, 0, 0.98), (0.08, 0.08, 0.1), "dynamic", 0.3)
    _, moved = spawned(world(FLOOR, board, cup))
    assert np.allclose(shift_of(cup, moved), (0, 0, 0.075), atol=1e-6)


def test_the_legs_of_a_table_are_lifted_out_of_the_floor_as_a_whole() -> None:
    table = body("table", (0, 0, 0.3), (1.2, 0.8, 0.7), "dynamic", 20.0)
    _, moved = spawned(world(FLOOR, table), {BodyId("table"): table_geometry((1.2, 0.8, 0.7))})
    assert np.allclose(shift_of(table, moved), (0, 0, 0.05), atol=1e-6)


@pytest.mark.parametrize("kind", [CollisionShapeType.SPHERE, CollisionShapeType.CYLINDER])
def test_round_bodies_are_moved_by_what_their_shapes_overlap(kind: CollisionShapeType) -> None:
    ball = body("ball", (0, 0, 0.09), (0.2, 0.2, 0.2), "dynamic", 1.0)
    corner = body("block", (0.19, 0.19, 0.1), (0.2, 0.2, 0.2))
    geometry = {BodyId("ball"): single_shape_geometry(kind, (0.2, 0.2, 0.2))}
    _, moved = spawned(world(FLOOR, ball, corner), geometry)
    assert np.allclose(shift_of(ball, moved), (0, 0, 0.01), atol=1e-6), "only the corners of its box meet the block"


# -- what belongs together


def test_a_lifted_wardrobe_takes_its_doors_along() -> None:
    wardrobe = body("wardrobe", (0, 0, 0.9), (0.6, 1, 2), "dynamic", 50.0)
    door = body("door", (0.32, 0, 0.9), (0.04, 1, 2), "dynamic", 5.0)
    handle = body("handle", (0.36, 0.4, 1.0), (0.04, 0.02, 0.2), "dynamic", 0.1)
    hinge = revolute_joint("hinge", "wardrobe", "door", (0.32, -0.5, 0.9))
    report, moved = spawned(world(FLOOR, wardrobe, door, handle, hinge, attachment("door", "handle")))
    shifts = {each.id: shift_of(each, moved) for each in (wardrobe, door, handle)}
    assert all(np.allclose(shift, (0, 0, 0.1), atol=1e-6) for shift in shifts.values())
    assert [note.ids for note in report.notes if note.kind is SpawnNoteKind.SETTLED] == [("wardrobe", "floor")]


def test_doors_and_drawers_of_fixed_furniture_are_not_moved() -> None:
    cabinet = body("cabinet", (0, 0, 0.4), (0.6, 0.6, 0.8))
    drawer = body("drawer", (0.05, 0, 0.5), (0.6, 0.5, 0.2), "dynamic", 4.0)
    neighbor = body("neighbor", (0, 0.54, 0.4), (0.7, 0.6, 0.8))
    slide = prismatic_joint("slide", "cabinet", "drawer", (0.05, 0, 0.5))
    _, moved = spawned(world(FLOOR, cabinet, drawer, neighbor, slide))
    assert not moved


def test_the_contents_of_nested_containers_stay_inside() -> None:
    cabinet = body("cabinet", (0, 0, 0.4), (0.6, 0.6, 0.8))
    drawer = body("drawer", (0, 0, 0.5), (0.5, 0.5, 0.2), "dynamic", 4.0)
    spoon = body("spoon", (0, 0, 0.45), (0.2, 0.04, 0.02), "dynamic", 0.05)
    slide = prismatic_joint("slide", "cabinet", "drawer", (0, 0, 0.5))
    _, moved = spawned(world(FLOOR, cabinet, drawer, spoon, slide))
    assert not moved


def test_a_running_world_is_only_moved_out_of_what_is_new() -> None:
    engine = MujocoEngine()
    engine.apply(Spawn(world(FLOOR, body("cup", (0, 0, 0.05), (0.1, 0.1, 0.1), "dynamic", 0.3))))
    engine.step(0.5)
    engine.apply(Spawn(world(body("mat", (0, 0, 0.015), (0.5, 0.5, 0.03)))))
    engine.step(1.0)
    assert engine.poses()[1][1, 2] == pytest.approx(0.08, abs=0.002)


def test_without_settling_overlapping_pairs_do_not_collide() -> None:
    engine = MujocoEngine()
    box = body("box", (0, 0, 0.0), (0.2, 0.2, 0.2), "dynamic", 1.0)
    report = engine.apply(Spawn(world(FLOOR, box), settle=False)).report
    assert [note.kind for note in report.notes] == [SpawnNoteKind.OVERLAP]
    engine.step(0.5)
    assert engine.poses()[1][1, 2] < -1.0


# -- properties

coordinates = st.floats(-1.0, 1.0)
extents = st.floats(0.05, 0.6)
turns = st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda turn: np.linalg.norm(turn) > 0.1)


@st.composite
def cluttered_worlds(draw: st.DrawFn) -> World:
    """Fixed boxes on a floor, and loose boxes between and inside them, turned arbitrarily."""
    parts = []
    for index in range(draw(st.integers(1, 6))):
        mobility = draw(st.sampled_from(["static", "dynamic"]))
        position = (draw(coordinates), draw(coordinates), draw(st.floats(-0.1, 1.0)))
        size = (draw(extents), draw(extents), draw(extents))
        quaternion = tuple(normalize(np.array(draw(turns))).tolist())
        parts.append(body(f"{mobility}{index}", position, size, mobility, 1.0, quaternion=quaternion))
    return world(FLOOR, *parts)


@given(described=cluttered_worlds())
@example(world(FLOOR, body("dynamic0", (0.0, 0.0, 0.0), (0.5, 0.5, 0.5), "dynamic", 1.0)))
def test_after_the_spawn_no_pair_that_collides_overlaps(described: World) -> None:
    builder = PhysicsModelBuilder()
    builder.apply(Spawn(described), NO_POSES)
    ids, poses = builder.registry.ids, described_poses(described)
    for row, id in enumerate(ids):
        poses[row] = builder.settled[id].pose if id in builder.settled else poses[row]
    boxes = OrientedBoxes.from_poses(poses, builder.mass_properties.sizes(ids))
    excluded, hollow = builder.excluded_pairs(), builder.collision_filter.wall_panels
    for a in range(len(ids)):
        for b in range(a + 1, len(ids)):
            is_loose = builder.is_loose(ids[a]) or builder.is_loose(ids[b])
            apart = (min(ids[a], ids[b]), max(ids[a], ids[b])) in excluded
            if is_loose and not apart and ids[a] not in hollow and ids[b] not in hollow:
                depth = penetration_depths(boxes, np.array([a]), np.array([b]))[0]
                assert depth <= TOUCH_TOLERANCE_M + 1e-6, (ids[a], ids[b])


def described_poses(described: World) -> np.ndarray:
    return np.array([[*each.pose.position, *each.pose.quaternion] for each in described.bodies])


@given(described=cluttered_worlds())
def test_a_loose_and_a_fixed_body_are_never_excluded_from_contact(described: World) -> None:
    builder = PhysicsModelBuilder()
    builder.apply(Spawn(described), NO_POSES)
    for a, b in builder.excluded_pairs():
        contained = any({a, b} <= {outer, *inner} for outer, inner in builder.collision_filter.contents.items())
        assert (
            contained
            or (builder.is_loose(a) and builder.is_loose(b))
            or not (builder.is_loose(a) or builder.is_loose(b))
        )


@given(heights=st.lists(st.floats(0.0, 2.0), min_size=1, max_size=8))
def test_bodies_that_overlap_nothing_are_not_moved(heights: list[float]) -> None:
    boxes = [body(f"box{x}", (x, 0, 0.1 + height), (0.2, 0.2, 0.2), "dynamic", 1.0) for x, height in enumerate(heights)]
    report, moved = spawned(world(FLOOR, *boxes))
    assert not moved
    assert not [note for note in report.notes if note.kind in (SpawnNoteKind.SETTLED, SpawnNoteKind.EMBEDDED)]


# -- the ground


def ground_of(loose: list[float], fixed: list[float]) -> float:
    """The ground of cubes with these lower sides, where nothing is below the loose ones."""
    bottoms = np.array([*loose, *fixed])
    poses = np.tile([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], (len(bottoms), 1))
    poses[:, 2] = bottoms + 0.25
    boxes = OrientedBoxes.from_poses(poses, np.full((len(bottoms), 3), 0.5))
    is_loose = np.arange(len(bottoms)) < len(loose)
    everywhere = np.ones(len(bottoms), dtype=bool)
    return find_ground_height(boxes, belongs=everywhere, is_loose=is_loose, unsupported=is_loose, is_certain=everywhere)


def test_the_ground_is_at_the_lowest_body_unless_that_fell_before() -> None:
    assert ground_of([0.3, 0.0, 0.75], []) == 0.0
    assert ground_of([-7.0, *[0.0] * 12, 0.75], []) == 0.0
    assert ground_of([-0.5, *[0.0] * 12], []) == -0.5, "a step is not a fall"
    assert ground_of([1.0, 2.0], [0.4, 3.0]) == 0.4
    assert ground_of([0.0, 0.1], [0.7]) == 0.0, "what stands beside a mounted cabinet"


@given(st.tuples(coordinates, coordinates), turns)
def test_a_support_is_below_a_point_if_a_vertical_ray_hits_it(
    offset: tuple[float, float], turn: tuple[float, ...]
) -> None:
    pose = np.array([[*offset, 0.0, *normalize(np.array(turn))]])
    boxes = OrientedBoxes.from_poses(pose, np.array([[1.0, 0.6, 0.1]]))
    rays = np.array([[0.0, 0.0, 3.0], [0.0, 0.0, -3.0]])
    samples = np.linspace(-2.0, 2.0, 4001)[:, None] * np.array([[0.0, 0.0, 1.0]])
    local = np.abs((samples - boxes.center[0]) @ boxes.rotation[0])
    margin = np.abs(local - boxes.half_extents[0]).min()
    hits = bool(np.all(local <= boxes.half_extents[0], axis=1).any())
    if margin > 0.002:  # the samples are a millimeter apart
        assert find_resting(rays, boxes).tolist() == [hits, False]
