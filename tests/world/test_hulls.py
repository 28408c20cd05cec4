"""Hulls: closed, convex, round all points, and as heavy as they are."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mindstage.world.geometry import rotation_matrix, unit
from mindstage.world.hulls import hull_round

numbers = st.floats(-1, 1)
clouds = st.lists(st.tuples(numbers, numbers, numbers), min_size=4, max_size=40, unique=True)
CUBE = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])


@given(clouds)
def test_a_hull_is_closed_and_holds_all_its_points(cloud: list[tuple[float, float, float]]) -> None:
    points = np.array(cloud)
    hull = hull_round(points)
    if hull is None:
        spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        assert spread[2] < 1e-5 * max(spread[0], 1e-3), "points that span a body were taken for flat"
        return
    edges = Counter((a, b) for face in hull.faces.tolist() for a, b in zip(face, face[1:] + face[:1], strict=True))
    assert set(edges.values()) == {1}
    assert all((b, a) in edges for a, b in edges)
    planes = np.einsum("fi,fi->f", hull.normals, points[hull.faces[:, 0]])
    sharp = np.linalg.norm(hull.normals, axis=1) > 0.5  # a sliver of no area has no side
    assert (points @ hull.normals[sharp].T - planes[sharp]).max() < 1e-5
    assert hull.moments()[0] > 0.0


@given(
    st.tuples(*[st.floats(0.1, 3.0)] * 3), st.tuples(*[st.floats(0.1, 1.0)] * 4), st.tuples(numbers, numbers, numbers)
)
def test_a_hull_of_a_boxs_corners_weighs_what_the_box_does(
    size: tuple[float, ...], turn: tuple[float, ...], centre: tuple[float, ...]
) -> None:
    turned = rotation_matrix(unit(turn))
    hull = hull_round((CUBE * size) @ turned.T + centre)
    assert hull is not None
    volume, middle, second = hull.moments()
    assert volume == pytest.approx(np.prod(size))
    np.testing.assert_allclose(middle, centre, atol=1e-9)
    expected = turned @ np.diag(np.square(size) / 12 * volume) @ turned.T
    np.testing.assert_allclose(second, expected, atol=1e-9 * max(1.0, volume))


def test_a_tetrahedron_has_its_middle_at_the_mean_of_its_corners() -> None:
    corners = np.array([(0.0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)])
    hull = hull_round(corners)
    assert hull is not None
    volume, middle, _ = hull.moments()
    assert volume == pytest.approx(1 / 6)
    np.testing.assert_allclose(middle, corners.mean(axis=0), atol=1e-12)


@pytest.mark.parametrize("flat", [np.zeros((0, 3)), np.zeros((9, 3)), CUBE[:3], CUBE * (1, 1, 0), CUBE * (1, 0, 0)])
def test_what_is_flat_has_no_hull(flat: np.ndarray) -> None:
    assert hull_round(flat) is None
