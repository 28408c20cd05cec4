"""Distances, directions and betweenness of boxes, against independent computations and under rigid motions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear
from tests.engines.scenes import body

from mindstage.scene.bounding_boxes import OrientedBoxes, penetration_depths
from mindstage.scene.proximity import (
    BodyBoxes,
    Direction,
    betweenness,
    box_gaps,
    box_point_gaps,
    directions,
    nearest_boxes,
)
from mindstage.scene.transforms import normalize, rotation_matrix


def random_boxes(seed: int, count: int, *, spread: float = 2.0) -> OrientedBoxes:
    """Boxes of all orientations; some are flat, some have no extent."""
    random = np.random.default_rng(seed)
    sizes = random.uniform(0.05, 1.0, (count, 3)) * random.choice([1.0, 1.0, 0.0], (count, 3))
    poses = np.concatenate(
        [random.uniform(-spread, spread, (count, 3)), normalize(random.normal(size=(count, 4)))], axis=1
    )
    return OrientedBoxes.from_poses(poses, sizes)


def optimized_gap(boxes: OrientedBoxes, a: int, b: int) -> float:
    """The distance of two boxes as a bounded least-squares problem over a point in each."""
    matrix = np.concatenate([boxes.rotation[a], -boxes.rotation[b]], axis=1)
    half = np.maximum(np.concatenate([boxes.half_extents[a], boxes.half_extents[b]]), 1e-12)
    found = lsq_linear(matrix, boxes.center[b] - boxes.center[a], (-half, half), tol=1e-14, method="bvls")
    return float(np.sqrt(2 * found.cost))


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_the_gap_of_disjoint_boxes_is_the_least_distance_of_their_points(seed: int) -> None:
    boxes = random_boxes(seed, 6)
    a, b = np.triu_indices(6, 1)
    gaps = box_gaps(boxes, a, b)
    for one, other, gap in zip(a.tolist(), b.tolist(), gaps.tolist(), strict=True):
        assert max(gap, 0.0) == pytest.approx(optimized_gap(boxes, one, other), abs=1e-5)
    assert gaps == pytest.approx(box_gaps(boxes, b, a), abs=1e-9), "a distance is symmetric"
    overlapping = gaps < 0.0
    assert gaps[overlapping] == pytest.approx(-penetration_depths(boxes, a, b)[overlapping])


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000), count=st.integers(1, 30))
def test_the_nearest_boxes_are_those_of_a_search_through_all(seed: int, count: int) -> None:
    boxes = random_boxes(seed, 60, spread=3.0)
    others = np.arange(1, 60)
    rows, gaps = nearest_boxes(boxes, 0, others, count)
    every = box_gaps(boxes, np.zeros(59, dtype=int), others)
    assert np.maximum(gaps, 0.0) == pytest.approx(np.sort(np.maximum(every, 0.0))[:count], abs=1e-9)
    assert gaps == pytest.approx(every[rows - 1], abs=1e-12)
    assert len(set(rows.tolist())) == count


def test_the_gap_of_a_point_is_that_of_a_box_without_extent() -> None:
    boxes = random_boxes(7, 30)
    point = np.array([0.3, -0.2, 0.9])
    with_point = OrientedBoxes(
        np.concatenate([boxes.center, point[None]]),
        np.concatenate([boxes.rotation, np.eye(3)[None]]),
        np.concatenate([boxes.half_extents, np.zeros((1, 3))]),
    )
    expected = box_gaps(with_point, np.arange(30), np.full(30, 30))
    found = box_point_gaps(boxes, point)
    assert np.maximum(found, 0.0) == pytest.approx(np.maximum(expected, 0.0), abs=1e-9)


@settings(max_examples=50, deadline=None)
@given(
    x=st.floats(-5, 5), y=st.floats(-5, 5), heading=st.floats(-7, 7), turn=st.floats(-7, 7), far=st.floats(0.01, 100)
)
def test_directions_turn_with_the_frame(x: float, y: float, heading: float, turn: float, far: float) -> None:
    if np.hypot(x, y) < 1e-3:
        return
    offset = np.array([[x, y]])

    def holding(offsets: np.ndarray, angle: float) -> set[Direction]:
        return {name for name, (mask, _) in directions(offsets, np.array([angle])).items() if mask[0]}

    here = holding(offset, heading)
    assert 1 <= len(here) <= 2
    opposite = {
        Direction.LEFT: Direction.RIGHT,
        Direction.RIGHT: Direction.LEFT,
        Direction.FRONT: Direction.BEHIND,
        Direction.BEHIND: Direction.FRONT,
    }
    on_border = abs(np.sin(2 * (np.arctan2(y, x) - heading - np.pi / 4))) < 1e-6
    if not on_border:
        assert holding(offset, heading + np.pi) == {opposite[each] for each in here}
        assert holding(-offset, heading) == {opposite[each] for each in here}
        turned = offset @ rotation_matrix(np.array([np.cos(turn / 2), 0, 0, np.sin(turn / 2)]))[:2, :2].T
        assert holding(far * turned, heading + turn) == here


def test_a_diagonal_offset_has_both_directions_and_a_zero_one_none() -> None:
    found = directions(np.array([[1.0, 1.0], [0.0, 0.0]]), np.zeros(2))
    assert [name for name, (mask, _) in found.items() if mask[0]] == [Direction.FRONT, Direction.LEFT]
    assert not any(mask[1] for mask, _ in found.values())


def test_betweenness_is_the_fraction_within_the_convex_hull() -> None:
    bodies = [
        body("west", (-2.0, 0.0, 0.5), (1.0, 1.0, 1.0)),
        body("east", (2.0, 0.0, 0.5), (1.0, 1.0, 1.0)),
        body("center", (0.0, 0.0, 0.5), (0.5, 0.5, 1.0)),
        body("edge", (0.0, 0.5, 0.5), (0.4, 0.4, 1.0)),
        body("beside", (0.0, 2.0, 0.5), (0.4, 0.4, 1.0)),
        body("within", (2.0, 0.0, 0.5), (0.2, 0.2, 0.2)),
        body("point", (0.0, 0.1, 0.5), (0.0, 0.0, 0.0)),
    ]
    boxes = BodyBoxes.from_bodies(bodies).boxes
    share, hidden = betweenness(boxes, 0, 1, np.arange(2, 7))
    assert share == pytest.approx([1.0, 0.5, 0.0, 1.0, 1.0])
    assert hidden == pytest.approx([0.0, 0.0, 0.0, 1.0, 0.0])


def test_bodies_with_numbers_that_are_not_finite_are_left_out() -> None:
    placed = BodyBoxes.from_bodies(
        [
            body("a", (float("nan"), 0, 0), (1, 1, 1)),
            body("b", (0, 0, 0), (1, 1, 1)),
            body("c", (0, 0, 0), (1e308 * 10, 1, 1)),
        ]
    )
    assert [each.id for each in placed.bodies] == ["b"]


def test_the_nearest_box_is_found_behind_many_with_smaller_bounds() -> None:
    corner = [body(f"c{at}", (2.0 + 1e-3 * at, 2.0, 2.0), (1.0, 1.0, 1.0)) for at in range(60)]
    aligned = body("aligned", (2.2, 0.0, 0.0), (1.0, 1.0, 1.0))
    boxes = BodyBoxes.from_bodies([body("center", (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), *corner, aligned]).boxes
    bounds = -penetration_depths(boxes, np.zeros(61, dtype=int), np.arange(1, 62))
    assert (bounds[:60] < bounds[60]).all(), "the separating axes of the others are shorter than their distances"
    rows, gaps = nearest_boxes(boxes, 0, np.arange(1, 62), 1)
    assert rows.tolist() == [61]
    assert gaps == pytest.approx([1.2])
