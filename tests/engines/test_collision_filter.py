"""Overlap depths, pairs of overlapping boxes, hollow bodies and crowds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mindstage.engines.collision_filter import CollisionFilter, CollisionFilterInput, compute_collision_filter
from mindstage.scene import BodyId
from mindstage.scene.bounding_boxes import OrientedBoxes, contains, overlapping_pairs, penetration_depths
from mindstage.scene.collision_shapes import hollow_box
from mindstage.scene.transforms import normalize, pose_multiply


def boxes_of(*rows: tuple[float, ...]) -> OrientedBoxes:
    """Boxes from rows of x y z, w x y z, and three sizes."""
    table = np.array(rows, dtype=float)
    table[:, 3:7] = normalize(table[:, 3:7])
    return OrientedBoxes.from_poses(table[:, :7], table[:, 7:])


def depth(*rows: tuple[float, ...]) -> float:
    return float(penetration_depths(boxes_of(*rows), np.array([0]), np.array([1]))[0])


UPRIGHT = (1.0, 0.0, 0.0, 0.0)
EIGHTH_TURN = (np.cos(np.pi / 8), 0.0, 0.0, np.sin(np.pi / 8))


@pytest.mark.parametrize(
    ("second", "expected"),
    [
        ((0.9, 0, 0, *UPRIGHT, 1, 1, 1), 0.1),
        ((1.5, 0, 0, *UPRIGHT, 1, 1, 1), -0.5),
        ((0, 0, 0.95, *UPRIGHT, 4, 4, 1), 0.05),
        ((0.5 + np.sqrt(0.5) - 0.02, 0, 0, *EIGHTH_TURN, 1, 1, 1), 0.02),
    ],
)
def test_the_depth_is_the_distance_that_separates_two_boxes(second: tuple[float, ...], expected: float) -> None:
    first = (0, 0, 0, *UPRIGHT, 1, 1, 1)
    assert depth(first, second) == pytest.approx(expected, abs=1e-12)
    assert depth(second, first) == pytest.approx(expected, abs=1e-12)


numbers = st.floats(-2, 2)
rows = st.tuples(numbers, numbers, numbers, *[st.floats(0.1, 1)] * 4, *[st.floats(0.05, 1.5)] * 3)


@given(st.lists(rows, min_size=2, max_size=25))
def test_the_sweep_finds_each_overlapping_pair_once(table: list[tuple[float, ...]]) -> None:
    boxes = boxes_of(*table)
    all_boxes = np.ones(len(table), dtype=bool)
    found = [
        tuple(sorted(pair))
        for a, b in overlapping_pairs(boxes, all_boxes, all_boxes)
        for pair in zip(a, b, strict=True)
    ]
    low, high = boxes.bounds()
    expected = {
        (i, j)
        for i in range(len(table))
        for j in range(i + 1, len(table))
        if (low[i] <= high[j]).all() and (low[j] <= high[i]).all()
    }
    assert len(found) == len(set(found))
    assert set(found) == expected


@given(rows, rows)
def test_moving_apart_by_the_depth_separates_boxes(first: tuple[float, ...], second: tuple[float, ...]) -> None:
    found = depth(first, second)
    moved = (second[0] + 20.0, *second[1:])
    assert depth(first, moved) < 0
    if found < 0:  # separated along some axis
        assert not contains(boxes_of(first, second), np.array([0]), np.array([1]))[0]


def test_a_large_box_contains_a_small_one_but_not_vice_versa() -> None:
    boxes = boxes_of((0, 0, 0, *UPRIGHT, 1, 1, 1), (0.2, 0.1, 0, *EIGHTH_TURN, 0.3, 0.3, 0.3))
    assert contains(boxes, np.array([0]), np.array([1]))[0]
    assert not contains(boxes, np.array([1]), np.array([0]))[0]


def inside(panels: list[tuple[np.ndarray, np.ndarray]], low: np.ndarray, high: np.ndarray) -> bool:
    """Whether a panel cuts into a box by more than rounding."""
    return any(np.all(np.minimum(c + s / 2, high) - np.maximum(c - s / 2, low) > 1e-9) for c, s in panels)


@pytest.mark.parametrize("turn", [(1.0, 0, 0, 0), (0.0, 0, 0, 1.0), (0.7071067811865476, 0, 0, 0.7071067811865476)])
def test_contents_get_walls_and_a_floor_under_each_level(turn: tuple[float, ...]) -> None:
    fridge, size = np.array([3.0, 2.0, 0.9, *turn]), np.array([0.6, 0.6, 1.8])
    local = [np.array([0.1, 0.1, -0.7, 1, 0, 0, 0]), np.array([0.0, -0.1, 0.2, 1, 0, 0, 0])]
    sizes = [np.array([0.1, 0.1, 0.2]), np.array([0.08, 0.08, 0.3])]
    poses = [pose_multiply(fridge, pose) for pose in local]
    boxes = OrientedBoxes.from_poses(np.array([fridge, *poses]), np.array([size, *sizes]))
    front = pose_multiply(fridge, np.array([0.32, 0, 0, 1, 0, 0, 0]))[:3]
    hollow = hollow_box(boxes, 0, [1, 2], [front])
    panels = [(np.array(panel.center), np.array(panel.size)) for panel in hollow.panels]
    assert hollow.opening == "to the front"
    for pose, extent in zip(local, sizes, strict=True):
        low, high = pose[:3] - extent / 2, pose[:3] + extent / 2
        assert not inside(panels, low, high)
        tops = [c[2] + s[2] / 2 for c, s in panels if s[0] > 0.5 and s[1] > 0.5]
        assert min(abs(top - low[2]) for top in tops) < 1e-9
    for center, extent in panels:
        assert (np.abs(center) + extent / 2 <= size / 2 + 1e-9).all()
    assert not any(center[0] - extent[0] / 2 > 0.2 for center, extent in panels), "the front is not open"


def test_without_a_door_the_top_is_open() -> None:
    bowl_and_apple = boxes_of((0, 0, 0.05, *UPRIGHT, 0.3, 0.3, 0.1), (0, 0, 0.05, *UPRIGHT, 0.07, 0.07, 0.07))
    assert hollow_box(bowl_and_apple, 0, [1], []).opening == "to the top"


@pytest.mark.parametrize(
    ("turn", "up", "opening"), [(UPRIGHT, 1.0, "to the front"), ((0.0, 1.0, 0.0, 0.0), -1.0, "to the front")]
)
def test_a_box_with_a_front_below_it_keeps_its_bottom(turn: tuple[float, ...], up: float, opening: str) -> None:
    boxes = boxes_of((0, 0, 0, *turn, 0.6, 0.6, 0.4), (0, 0, 0, *turn, 0.1, 0.1, 0.1))
    below, ahead = np.array([0.0, 0.0, -0.22]), np.array([0.32, 0.0, 0.0])
    assert hollow_box(boxes, 0, [1], [below, ahead]).opening == opening
    top = "to the top" if up > 0 else "to the bottom"
    assert hollow_box(boxes, 0, [1], [below]).opening == top, "the contents would fall out of the bottom"


def test_stacked_contents_get_no_floor_of_their_own() -> None:
    drawer, panel = (0, 0, 0, *UPRIGHT, 0.5, 0.5, 0.2), (0, 0, -0.06, *UPRIGHT, 0.2, 0.2, 0.02)
    cup = (0, 0, 0.0, *UPRIGHT, 0.08, 0.08, 0.1)
    hollow = hollow_box(boxes_of(drawer, panel, cup), 0, [1, 2], [])
    floors = [p for p in hollow.panels if p.size[0] > 0.4 and p.size[1] > 0.4]
    assert len(floors) == 1


def test_bodies_in_a_crowd_collide_with_nothing_and_are_reported() -> None:
    count = 1_500
    table = np.zeros((count, 7))
    table[:, 3] = 1.0
    poses, sizes = table, np.full((count, 3), 0.1)
    moves = np.ones(count, dtype=bool)
    filter_input = CollisionFilterInput(
        ids=tuple(BodyId(f"mug{i}") for i in range(count)),
        poses=poses,
        sizes=sizes,
        group=np.arange(count),
        is_dynamic=moves,
        is_free=moves,
        is_new=moves,
        jointed_pairs=frozenset(),
        overlap_boxes=OrientedBoxes.from_poses(poses, sizes),
    )
    collision_filter, notes, _ = compute_collision_filter(filter_input, CollisionFilter())
    assert collision_filter.non_colliding == set(filter_input.ids)
    assert not collision_filter.excluded_pairs
    assert {id for note in notes for id in note.ids} == set(filter_input.ids)
