"""Footprints of boxes, against literal values and the invariants of areas."""

from __future__ import annotations

from math import pi, sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from tests.cases import each_case
from tests.worlds import vectors

from mindstage.scene.bounding_boxes import OrientedBoxes, footprints, polygon_areas, polygon_gaps, polygon_overlap_areas
from mindstage.scene.transforms import normalize

ONE, OTHER = np.array([0]), np.array([1])
UPRIGHT = (1.0, 0.0, 0.0, 0.0)
EIGHTH = (np.cos(pi / 8), 0.0, 0.0, np.sin(pi / 8))
"""An eighth of a turn about the vertical."""
TILTED = (np.cos(pi / 8), np.sin(pi / 8), 0.0, 0.0)
"""An eighth of a turn about x."""


def polygons(*rows: tuple[float, ...]) -> np.ndarray:
    """Returns footprints of rows x y z, w x y z, three extents."""
    table = np.array(rows, dtype=float)
    table[:, 3:7] = normalize(table[:, 3:7])
    return footprints(OrientedBoxes.from_poses(table[:, :7], table[:, 7:]))


@pytest.mark.parametrize(
    ("box", "expected"),
    [
        ((0, 0, 5, *UPRIGHT, 2, 3, 4), 6.0),
        ((7, -2, 0, *EIGHTH, 2, 3, 4), 6.0),
        ((0, 0, 0, *TILTED, 2, 3, 4), 2 * (3 + 4) * sqrt(0.5)),
        ((0, 0, 0, *UPRIGHT, 2, 0, 4), 0.0),
    ],
)
def test_the_footprint_of_a_box_has_its_analytic_area(box: tuple[float, ...], expected: float) -> None:
    assert_allclose(polygon_areas(polygons(box)), [expected], atol=1e-12)


@each_case(
    ("second", "both", "gap"),
    [
        ((1.5, 0, 9, *UPRIGHT, 2, 2, 2), 1.0, 0.0),
        ((0, 0, 0, *EIGHTH, 4, 4, 1), 4.0, 0.0),
        ((2.0, 0, 0, *UPRIGHT, 2, 2, 2), 0.0, 0.0),
        ((2.25, 0.3, 0, *UPRIGHT, 2, 2, 2), 0.0, 0.25),
        ((5, 6, 0, *UPRIGHT, 2, 2, 2), 0.0, 5.0),
        ((1 + sqrt(2) + 0.5, 0, 0, *EIGHTH, 2, 2, 2), 0.0, 0.5),
        ((0, 0, 0, *EIGHTH, 2, 2, 2), 8 * (sqrt(2) - 1), 0.0),
    ],
)
def test_two_footprints_have_their_analytic_overlap_or_gap(second: tuple[float, ...], both: float, gap: float) -> None:
    pair = polygons((0, 0, 0, *UPRIGHT, 2, 2, 2), second)
    assert_allclose(polygon_overlap_areas(pair, ONE, OTHER), [both], atol=1e-12)
    if both == 0.0:
        assert_allclose(polygon_gaps(pair, ONE, OTHER), [gap], atol=1e-12)


boxes = st.tuples(vectors(-2.0, 2.0), st.tuples(*(st.floats(-1, 1) for _ in range(4))), vectors(0.05, 1.0)).map(
    lambda drawn: (*drawn[0], *(drawn[1] if np.linalg.norm(drawn[1]) > 0.1 else UPRIGHT), *drawn[2])
)


@given(boxes, boxes)
def test_the_overlap_is_symmetric_and_at_most_the_smaller_area(a: tuple, b: tuple) -> None:
    pair = polygons(a, b)
    shared = polygon_overlap_areas(pair, ONE, OTHER)
    assert_allclose(shared, polygon_overlap_areas(pair, OTHER, ONE), atol=1e-9)
    assert -1e-12 <= shared[0] <= polygon_areas(pair).min() + 1e-9
    assert_allclose(polygon_overlap_areas(pair, ONE, ONE), polygon_areas(pair)[:1], atol=1e-9)


@given(boxes, boxes)
@settings(max_examples=30)
def test_the_overlap_agrees_with_monte_carlo_sampling(a: tuple, b: tuple) -> None:
    pair = polygons(a, b)
    low, high = pair.reshape(-1, 2).min(axis=0), pair.reshape(-1, 2).max(axis=0)
    points = np.random.default_rng(0).uniform(low, high, (4000, 2))
    hits = np.mean([_within(polygon, points) for polygon in pair], axis=0) == 1.0
    shared = polygon_overlap_areas(pair, ONE, OTHER)[0] / np.prod(high - low)
    assert shared == pytest.approx(hits.mean(), abs=0.04)


def _within(polygon: np.ndarray, points: np.ndarray) -> np.ndarray:
    sides = np.roll(polygon, -1, axis=0) - polygon
    away = points[:, None] - polygon
    return np.all(sides[:, 0] * away[..., 1] - sides[:, 1] * away[..., 0] >= 0.0, axis=1)


def test_chunked_pairs_give_the_same_result_as_single_ones() -> None:
    table = np.random.default_rng(1).uniform(0.1, 2.0, (300, 10))
    many = polygons(*table)
    a, b = np.divmod(np.arange(40_000), 200)
    together = polygon_overlap_areas(many, a, b)
    alone = [polygon_overlap_areas(many, a[[row]], b[[row]])[0] for row in (0, 16_383, 16_384, 39_999)]
    assert together[[0, 16_383, 16_384, 39_999]].tolist() == alone
