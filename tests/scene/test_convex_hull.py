"""Convex hulls: closed, convex, containing all points, with analytic volumes and moments."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from tests.cases import each_case

from mindstage.scene.mesh import convex_hull
from mindstage.scene.transforms import normalize, rotation_matrix

numbers = st.floats(-1, 1)
clouds = st.lists(st.tuples(numbers, numbers, numbers), min_size=4, max_size=40, unique=True)
CUBE = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])


@given(clouds)
def test_a_hull_is_closed_and_contains_all_points(cloud: list[tuple[float, float, float]]) -> None:
    points = np.array(cloud)
    hull = convex_hull(points)
    if hull is None:
        spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        assert spread[2] < 1e-5 * max(spread[0], 1e-3), "points that span a body were taken for flat"
        return
    edges = Counter((a, b) for face in hull.faces.tolist() for a, b in zip(face, face[1:] + face[:1], strict=True))
    assert set(edges.values()) == {1}
    assert all((b, a) in edges for a, b in edges)
    planes = np.einsum("fi,fi->f", hull.normals, hull.points[hull.faces[:, 0]])
    np.testing.assert_allclose(np.linalg.norm(hull.normals, axis=1), 1.0)
    assert (points @ hull.normals.T - planes).max() < 1e-9
    assert 0.0 < hull.moments()[0] <= np.ptp(points, axis=0).prod() * (1 + 1e-9)
    assert {*map(tuple, hull.points)} <= {*map(tuple, points)}


@given(
    st.tuples(*[st.floats(0.1, 3.0)] * 3), st.tuples(*[st.floats(0.1, 1.0)] * 4), st.tuples(numbers, numbers, numbers)
)
def test_the_hull_of_box_corners_has_the_moments_of_the_box(
    size: tuple[float, ...], turn: tuple[float, ...], center: tuple[float, ...]
) -> None:
    turned = rotation_matrix(normalize(turn))
    hull = convex_hull((CUBE * size) @ turned.T + center)
    assert hull is not None
    volume, middle, second = hull.moments()
    assert volume == pytest.approx(np.prod(size))
    np.testing.assert_allclose(middle, center, atol=1e-9)
    expected = turned @ np.diag(np.square(size) / 12 * volume) @ turned.T
    np.testing.assert_allclose(second, expected, atol=1e-9 * max(1.0, volume))


def test_the_centroid_of_a_tetrahedron_is_the_mean_of_its_vertices() -> None:
    corners = np.array([(0.0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)])
    hull = convex_hull(corners)
    assert hull is not None
    volume, middle, _ = hull.moments()
    assert volume == pytest.approx(1 / 6)
    np.testing.assert_allclose(middle, corners.mean(axis=0), atol=1e-12)


def cylinder(radius: float, height: float, around: int) -> np.ndarray:
    angle = np.arange(around) * 2 * np.pi / around
    circle = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    return np.concatenate([np.column_stack([circle, np.full(around, z)]) for z in (-height / 2, height / 2)])


@given(
    st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda turn: np.linalg.norm(turn) > 0.1),
    st.tuples(st.floats(-5, 5), st.floats(-5, 5), st.floats(-5, 5)),
    st.sampled_from([8, 24, 32, 100]),
)
@example((0.9, 0.3, 0.2, 0.1), (1.0, 2.0, 3.0), 32)
def test_a_tilted_cylinder_in_single_precision_has_its_analytic_volume(
    turn: tuple[float, ...], center: tuple[float, ...], around: int
) -> None:
    """Returns a cylinder with caps of many points that are coplanar except for rounding, as in STL files."""
    radius, height = 0.03, 0.2
    tilted = cylinder(radius, height, around) @ rotation_matrix(normalize(turn)).T + center
    hull = convex_hull(tilted.astype(np.float32).astype(np.float64))
    assert hull is not None
    volume, middle, _ = hull.moments()
    assert volume == pytest.approx(around / 2 * np.sin(2 * np.pi / around) * radius**2 * height, rel=1e-4)
    np.testing.assert_allclose(middle, center, atol=1e-5)


@given(st.tuples(*[st.floats(0.1, 1.0)] * 4), st.integers(0, 2**32 - 1))
def test_the_volume_grows_with_the_points_and_with_the_scale(turn: tuple[float, ...], seed: int) -> None:
    cloud = np.random.default_rng(seed).normal(size=(30, 3)) @ rotation_matrix(normalize(turn)).T
    few, many, large = convex_hull(cloud[:10]), convex_hull(cloud), convex_hull(1000.0 * cloud + 5.0)
    assert few is not None
    assert many is not None
    assert large is not None
    assert few.moments()[0] <= many.moments()[0] * (1 + 1e-12)
    assert large.moments()[0] == pytest.approx(1e9 * many.moments()[0])


def test_interior_points_are_not_vertices() -> None:
    hull = convex_hull(np.concatenate([CUBE * 0.5, CUBE, np.zeros((1, 3))]))
    assert hull is not None
    np.testing.assert_array_equal(hull.points, CUBE)
    assert hull.faces.shape == (12, 3)


def tilted_plate(thickness: float) -> np.ndarray:
    turned = CUBE * (1.0, 0.5, thickness) @ rotation_matrix(normalize((0.9, 0.3, 0.2, 0.1))).T + (1.0, 2.0, 3.0)
    return turned.astype(np.float32).astype(np.float64)


def test_a_tilted_plate_of_one_millimeter_has_a_hull() -> None:
    hull = convex_hull(tilted_plate(0.001))
    assert hull is not None
    assert hull.moments()[0] == pytest.approx(0.0005, rel=1e-2)


@each_case(
    "flat",
    [np.zeros((0, 3)), np.zeros((9, 3)), CUBE[:3], CUBE * (1, 1, 0), CUBE * (1, 0, 0), tilted_plate(0.0),
     np.outer(np.arange(9), (1.0, 2.0, 3.0)), CUBE * (1, 1, np.nan), CUBE * (1, 1, np.inf)],
)  # fmt: skip
def test_coplanar_points_have_no_hull(flat: np.ndarray) -> None:
    assert convex_hull(flat) is None
