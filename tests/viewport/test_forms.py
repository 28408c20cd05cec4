"""The meshes that things are drawn with."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mindstage.viewport.forms import Mesh, ball, box, cylinder, edges, inside, open_box, pierced_box, vessel
from mindstage.world import Vector

lengths = st.floats(0.005, 3.0)
sizes = st.tuples(lengths, lengths, lengths)

WORKTOP: Vector = (0.6, 2.0, 0.04)


def corners(mesh: Mesh) -> np.ndarray:
    return mesh.vertices.astype(float)[mesh.faces]


def volume(mesh: Mesh) -> float:
    """Of a mesh whose triangles look outwards; negative, if they look inwards."""
    a, b, c = np.moveaxis(corners(mesh), 1, 0)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def extents(mesh: Mesh) -> np.ndarray:
    return np.ptp(mesh.vertices, axis=0)


def is_closed(mesh: Mesh) -> bool:
    """Whether each edge between two places is run along as often forth as back."""
    places = np.unique(mesh.vertices.round(5), axis=0, return_inverse=True)[1].reshape(-1)
    face = places[mesh.faces]
    face = face[(face[:, 0] != face[:, 1]) & (face[:, 1] != face[:, 2]) & (face[:, 2] != face[:, 0])]
    forth = np.concatenate([face[:, [0, 1]], face[:, [1, 2]], face[:, [2, 0]]])
    counts: dict[tuple[int, int], int] = {}
    for start, end in forth.tolist():
        counts[start, end] = counts.get((start, end), 0) + 1
        counts[end, start] = counts.get((end, start), 0) - 1
    return not any(counts.values())


@given(size=sizes)
def test_a_box_is_closed_looks_outwards_and_fills_its_size(size: Vector) -> None:
    mesh = box(size)
    assert is_closed(mesh)
    assert np.allclose(extents(mesh), size, atol=1e-5)
    assert 0.75 * np.prod(size) < volume(mesh) <= np.prod(size) * 1.001


@given(size=sizes)
def test_a_cylinder_fills_its_size(size: Vector) -> None:
    mesh = cylinder(size)
    assert is_closed(mesh)
    assert np.allclose(extents(mesh), size, rtol=0.02, atol=1e-5)
    assert 0.8 * np.pi / 4 * np.prod(size) < volume(mesh) <= np.pi / 4 * np.prod(size)


@given(size=sizes)
def test_a_ball_fills_its_size(size: Vector) -> None:
    mesh = ball(size)
    assert is_closed(mesh)
    assert np.allclose(extents(mesh), size, rtol=0.02, atol=1e-5)
    assert 0.95 * np.pi / 6 * np.prod(size) < volume(mesh) <= np.pi / 6 * np.prod(size)


@given(size=st.tuples(*[st.floats(0.05, 0.5)] * 3), foot=st.floats(0.3, 1.0))
def test_a_vessel_is_hollow_and_open_at_the_top(size: Vector, foot: float) -> None:
    mesh = vessel(size, foot=foot)
    assert is_closed(mesh)
    assert np.allclose(extents(mesh), size, rtol=0.02, atol=1e-4)
    assert 0.0 < volume(mesh) < 0.5 * np.pi / 4 * np.prod(size)
    in_the_middle = corners(mesh)[np.abs(corners(mesh)[:, :, :2]).max(axis=(1, 2)) < 0.2 * min(size[:2])]
    assert in_the_middle[:, :, 2].max(initial=-1.0) < 0.25 * size[2], "nothing lies across its mouth"


def across(mesh: Mesh, axis: int, at: float) -> float:
    """How much of a plane across an axis the mesh's faces cover [m2]."""
    lying = corners(mesh)[np.all(np.abs(corners(mesh)[:, :, axis] - at) < 1e-4, axis=1)]
    return float(np.linalg.norm(np.cross(lying[:, 1] - lying[:, 0], lying[:, 2] - lying[:, 0]), axis=1).sum() / 2)


@pytest.mark.parametrize(("axis", "direction"), [(0, 1), (0, -1), (1, 1), (1, -1), (2, 1), (2, -1)])
def test_an_open_box_has_five_walls(axis: int, direction: int) -> None:
    size = (0.5, 0.6, 0.7)
    mesh = open_box(size, [(axis, direction)])
    whole = np.prod(size) / size[axis]
    assert across(mesh, axis, direction * size[axis] / 2) < 0.3 * whole
    assert across(mesh, axis, -direction * size[axis] / 2) > 0.9 * whole
    assert np.allclose(extents(mesh), size, atol=1e-5)


def test_shelves_stand_where_things_stand() -> None:
    plain, shelved = (open_box((0.5, 0.5, 1.0), [(0, 1)], levels=levels) for levels in ((), (0.1,)))
    assert across(plain, 2, 0.1) == 0.0
    assert across(shelved, 2, 0.1) > 0.15
    outside = open_box((0.5, 0.5, 1.0), [(0, 1)], levels=[5.0])
    assert np.allclose(extents(outside), (0.5, 0.5, 1.0), atol=1e-5)


def test_a_hole_goes_through_a_worktop() -> None:
    whole, pierced = box(WORKTOP), pierced_box(WORKTOP, [(-0.2, 0.2, 0.3, 0.8)])
    lost = volume(whole) - volume(pierced)
    assert lost == pytest.approx(0.4 * 0.5 * 0.04, rel=0.25)
    middles = corners(pierced).mean(axis=1)
    in_the_hole = (np.abs(middles[:, 0]) < 0.18) & (np.abs(middles[:, 1] - 0.55) < 0.23)
    assert not in_the_hole.any()


def test_a_hole_that_reaches_over_the_edge_takes_the_edge_away() -> None:
    pierced = pierced_box(WORKTOP, [(-1.0, 1.0, 0.5, 3.0)])
    assert np.allclose(extents(pierced), (0.6, 1.5, 0.04), atol=1e-5)


@pytest.mark.parametrize(("axis", "direction"), [(0, 1), (0, -1), (1, 1), (1, -1), (2, 1), (2, -1)])
def test_the_inside_of_a_wall_looks_to_one_side(axis: int, direction: int) -> None:
    mesh = inside((2.0, 3.0, 4.0), (axis, direction))
    a, b, c = np.moveaxis(corners(mesh), 1, 0)
    normals = np.cross(b - a, c - a)
    assert np.all(normals[:, axis] * direction > 0)
    assert np.allclose(mesh.vertices[:, axis], direction * (1.0, 1.5, 2.0)[axis])


def test_a_box_has_twelve_edges() -> None:
    ends = edges((1.0, 2.0, 3.0), margin=0.5)
    assert ends.shape == (12, 2, 3)
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    assert sorted(lengths.tolist()) == [2.0] * 4 + [3.0] * 4 + [4.0] * 4


@given(size=st.tuples(*[st.sampled_from([0.0, 1e-9, 1e-3, 200.0])] * 3))
def test_no_size_breaks_a_form(size: Vector) -> None:
    for mesh in (box(size), cylinder(size), ball(size), vessel(size), open_box(size, [(2, 1)])):
        assert np.isfinite(mesh.vertices).all()
        assert mesh.faces.max() < len(mesh.vertices)
