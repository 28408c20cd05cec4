"""Meshes of primitives."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mindstage.scene import Vector
from mindstage.scene.mesh import TriangleMesh, arrow, box, box_edges, cone, cut_above, cylinder, sphere

lengths = st.floats(0.005, 3.0)
sizes = st.tuples(lengths, lengths, lengths)


def volume(mesh: TriangleMesh) -> float:
    """Returns the volume of a closed mesh; negative if its faces point inwards."""
    a, b, c = np.moveaxis(mesh.points.astype(float)[mesh.faces], 1, 0)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def extents(mesh: TriangleMesh) -> np.ndarray:
    return np.ptp(mesh.points, axis=0)


def is_closed(mesh: TriangleMesh) -> bool:
    """Returns whether each edge is used equally often in both directions."""
    places = np.unique(mesh.points.round(5), axis=0, return_inverse=True)[1].reshape(-1)
    face = places[mesh.faces]
    face = face[(face[:, 0] != face[:, 1]) & (face[:, 1] != face[:, 2]) & (face[:, 2] != face[:, 0])]
    forth = np.concatenate([face[:, [0, 1]], face[:, [1, 2]], face[:, [2, 0]]])
    counts: dict[tuple[int, int], int] = {}
    for start, end in forth.tolist():
        counts[start, end] = counts.get((start, end), 0) + 1
        counts[end, start] = counts.get((end, start), 0) - 1
    return not any(counts.values())


@given(size=sizes)
def test_a_box_is_closed_faces_outwards_and_fills_its_size(size: Vector) -> None:
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
def test_a_sphere_fills_its_size(size: Vector) -> None:
    mesh = sphere(size)
    assert is_closed(mesh)
    assert np.allclose(extents(mesh), size, rtol=0.02, atol=1e-5)
    assert 0.95 * np.pi / 6 * np.prod(size) < volume(mesh) <= np.pi / 6 * np.prod(size)


def test_an_arrow_starts_at_the_origin_and_a_cone_has_its_apex_at_the_top() -> None:
    vertices = arrow((2.0, 0.2, 0.1)).points
    assert vertices.min(axis=0) == pytest.approx([0.0, -0.1, -0.05])
    assert vertices.max(axis=0) == pytest.approx([2.0, 0.1, 0.05])
    tip = vertices[vertices[:, 0].argmax()]
    assert tip == pytest.approx([2.0, 0.0, 0.0], abs=1e-6)
    vertices = cone((0.2, 0.2, 1.0)).points
    assert vertices[vertices[:, 2].argmax()] == pytest.approx([0.0, 0.0, 0.5], abs=1e-6)


def test_the_normals_of_a_sphere_point_away_from_its_center() -> None:
    mesh = sphere((1.0, 1.0, 1.0))
    assert mesh.normals is not None
    outwards = mesh.points / np.linalg.norm(mesh.points, axis=1, keepdims=True)
    assert np.einsum("ij,ij->i", mesh.normals, outwards).min() > 0.99


@given(size=sizes)
def test_every_primitive_is_closed_and_has_unit_normals(size: Vector) -> None:
    for mesh in (box(size), cylinder(size), sphere(size), arrow(size), cone(size)):
        assert is_closed(mesh)
        assert volume(mesh) > 0.0
        assert mesh.normals is not None
        assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1.0)


def test_faces_and_vertex_normals_agree() -> None:
    size = (0.3, 0.2, 0.5)
    for mesh in (box(size), cylinder(size), sphere(size), arrow((1.0, 0.1, 0.1)), cone((0.1, 0.1, 0.3))):
        assert mesh.normals is not None
        a, b, c = np.moveaxis(mesh.points[mesh.faces], 1, 0)
        facing = np.cross(b - a, c - a)
        assert (np.einsum("ij,ikj->ik", facing, mesh.normals[mesh.faces]) > 0.0).all()


def test_a_box_has_twelve_edges() -> None:
    ends = box_edges((1.0, 2.0, 3.0), margin=0.5)
    assert ends.shape == (12, 2, 3)
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    assert sorted(lengths.tolist()) == [2.0] * 4 + [3.0] * 4 + [4.0] * 4


@given(size=st.tuples(*[st.sampled_from([0.0, 1e-9, 1e-3, 200.0])] * 3))
def test_meshes_of_any_size_are_finite(size: Vector) -> None:
    for mesh in (box(size), cylinder(size), sphere(size), arrow(size), cone(size)):
        assert np.isfinite(mesh.points).all()
        assert mesh.faces.max() < len(mesh.points)
        assert mesh.normals is not None
        assert np.isfinite(mesh.normals).all()


@given(size=sizes, part=st.floats(0.05, 0.95), seed=st.integers(0, 1000))
def test_a_cut_mesh_is_what_is_below_with_interpolated_columns(size: Vector, part: float, seed: int) -> None:
    mesh = sphere(size[0]) if seed % 2 else box(size)
    up = np.random.default_rng(seed).normal(size=3)
    up /= np.linalg.norm(up)
    points = mesh.points.astype(float)
    heights, weights = points @ up, np.array([0.3, -2.0, 0.7])
    limit = float(heights.min() + part * np.ptp(heights))
    columns, faces = cut_above(np.column_stack([points, points @ weights]), mesh.faces, heights, limit)
    used = columns[np.unique(faces)]
    assert (used[:, :3] @ up).max() == pytest.approx(limit, abs=1e-6)
    assert used[:, 3] == pytest.approx(used[:, :3] @ weights, abs=1e-6)
    other, upper = cut_above(points, mesh.faces, -heights, -limit)
    both = TriangleMesh(
        np.concatenate([columns[:, :3], other]),
        np.concatenate([faces, upper + len(columns)]).astype(np.uint32),
        np.zeros((len(columns) + len(other), 3)),
    )
    assert is_closed(both), "the lower and the upper part fit together"
    assert volume(both) == pytest.approx(volume(mesh), rel=1e-5)
