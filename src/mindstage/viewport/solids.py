"""Solids: the meshes of markers, and of bodies of which nothing is known but their size.

Edges are rounded a little, which is what makes a box look like a thing: the vertices of each face are shared with the
narrow faces round it, so that the light runs over the edge while the face itself stays flat. A mesh is in the body's
own frame, centred, in metres.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise, product

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from mindstage.world import Vector

__all__ = ["Mesh", "arrow", "ball", "box", "cone", "cylinder", "edges", "smooth_normals"]

_ROUNDING_M = 0.008
_SEGMENTS = 40

Array = NDArray[np.float64]


class Mesh(msgspec.Struct, frozen=True, eq=False):
    """Triangles, counter-clockwise seen from outside."""

    vertices: NDArray[np.float32]
    """n x 3 [m]."""
    faces: NDArray[np.uint32]
    """m x 3."""
    uv: NDArray[np.float32] | None = None
    """n x 2: where on its picture each vertex is."""


def box(size: ArrayLike) -> Mesh:
    """A box with slightly rounded edges."""
    half = np.maximum(np.asarray(size, dtype=np.float64) / 2, 1e-4)
    inset = half - min(_ROUNDING_M, 0.3 * float(half.min()))
    # Vertex 3 * corner + axis lies on the face across that axis, at that corner.
    signs = _CORNERS[:, None, :]
    at_face = np.eye(3, dtype=bool)[None]
    vertices = np.where(at_face, signs * half, signs * inset).reshape(-1, 3)
    return Mesh(vertices.astype(np.float32), _BOX_FACES)


def cylinder(size: Vector) -> Mesh:
    """An upright cylinder; its footprint is an ellipse where depth and width differ."""
    radius = max(min(size[0], size[1]) / 2, 1e-4)
    r = 1.0 - min(_ROUNDING_M, 0.3 * radius) / radius
    h = 1.0 - min(_ROUNDING_M, 0.15 * size[2]) / max(size[2] / 2, 1e-4)
    return _lathe(size, [(0.0, -1.0), (r, -1.0), (1.0, -h), (1.0, h), (r, 1.0), (0.0, 1.0)])


def ball(size: Vector) -> Mesh:
    """A ball, or an ellipsoid where the extents differ."""
    angles = np.linspace(-np.pi / 2, np.pi / 2, _SEGMENTS // 2 + 1)
    return _lathe(size, list(zip(np.cos(angles).tolist(), np.sin(angles).tolist(), strict=True)))


def cone(size: Vector) -> Mesh:
    """An upright cone, its tip at the top."""
    return _lathe(size, [(0.0, -1.0), (1.0, -1.0), (0.0, 1.0)])


def arrow(size: Vector) -> Mesh:
    """An arrow from the origin along x: as long as the first extent, as thick as the others."""
    length, width, height = size
    upright = _lathe((width, height, length), [(0.0, -1.0), (0.5, -1.0), (0.5, 0.5), (1.0, 0.5), (0.0, 1.0)])
    vertices = upright.vertices[:, [2, 0, 1]] + np.array([length / 2, 0.0, 0.0])
    return Mesh(vertices.astype(np.float32), upright.faces)


def smooth_normals(mesh: Mesh) -> Array:
    """Of its vertices: the mean of the faces round each, the larger the more."""
    first, second, third = (mesh.vertices[mesh.faces[:, corner]].astype(float) for corner in range(3))
    normals = np.zeros(mesh.vertices.shape)
    for corner in range(3):
        np.add.at(normals, mesh.faces[:, corner], np.cross(second - first, third - first))
    lengths: Array = np.linalg.norm(normals, axis=1, keepdims=True)
    return normals / np.maximum(lengths, 1e-12)


def edges(size: Vector, *, margin: float = 0.0) -> NDArray[np.float32]:
    """The twelve edges of a box, as 12 x 2 x 3 ends; a little outside of it by the margin [m]."""
    corners = _CORNERS * (np.asarray(size) / 2 + margin)
    return np.asarray(corners[np.array(_EDGES)], dtype=np.float32)


_CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))
_EDGES = [(a, b) for a in range(8) for b in range(a + 1, 8) if np.sum(_CORNERS[a] != _CORNERS[b]) == 1]
"""Between which corners."""


def _box_faces() -> NDArray[np.uint32]:
    """Six faces, twelve edges and eight corners between the 24 vertices of a rounded box."""
    loops = [
        [3 * corner + axis for corner in range(8) if _CORNERS[corner, axis] == direction]
        for axis in range(3)
        for direction in (-1.0, 1.0)
    ]
    for start, end in _EDGES:
        along = int(np.flatnonzero(_CORNERS[start] != _CORNERS[end])[0])
        loops.append([3 * corner + axis for corner in (start, end) for axis in range(3) if axis != along])
    loops += [[3 * corner + axis for axis in range(3)] for corner in range(8)]
    # Around a unit shape each loop is put in order, and triangles made that look outwards.
    at = np.where(np.eye(3, dtype=bool)[None], _CORNERS[:, None, :], _CORNERS[:, None, :] * 0.8).reshape(-1, 3)
    return np.array([face for loop in loops for face in _triangles(loop, at)], dtype=np.uint32)


def _triangles(loop: Sequence[int], at: Array) -> list[tuple[int, int, int]]:
    middle = at[list(loop)].mean(axis=0)
    first = at[loop[0]] - middle
    second = np.cross(middle, first)
    round_it = sorted(loop, key=lambda v: float(np.arctan2((at[v] - middle) @ second, (at[v] - middle) @ first)))
    return [(round_it[0], b, c) for b, c in pairwise(round_it[1:])]


_BOX_FACES = _box_faces()


def _lathe(size: Vector, profile: Sequence[tuple[float, float]]) -> Mesh:
    """Turns a profile (radius, height; 1 is the extent) round z, from the bottom over the outside to the top.

    Each corner of the profile is kept sharp: the rings on both sides of it have vertices of their own.
    """
    angles = np.linspace(0, 2 * np.pi, _SEGMENTS, endpoint=False)
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    vertices: list[Array] = []
    faces = []
    smooth = _is_smooth(profile)
    for (r0, z0), (r1, z1) in pairwise(profile):
        start = len(vertices) * _SEGMENTS
        if not (smooth and vertices):
            vertices.append(_ring(circle, r0, z0))
        else:
            start -= _SEGMENTS
        vertices.append(_ring(circle, r1, z1))
        lower = start + np.arange(_SEGMENTS)
        upper, along = lower + _SEGMENTS, np.roll(np.arange(_SEGMENTS), -1) + start
        if r0 > 0:
            faces.append(np.stack([lower, along, upper], axis=1))
        if r1 > 0:
            faces.append(np.stack([along, along + _SEGMENTS, upper], axis=1))
    scaled = np.concatenate(vertices) * np.asarray(size) / 2
    return Mesh(scaled.astype(np.float32), np.concatenate(faces).astype(np.uint32))


def _ring(circle: Array, radius: float, height: float) -> Array:
    return np.column_stack([circle * radius, np.full(len(circle), height)])


def _is_smooth(profile: Sequence[tuple[float, float]]) -> bool:
    """Whether the profile turns by little everywhere, as a ball's does."""
    steps = np.diff(np.asarray(profile), axis=0)
    heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    return bool(np.all(np.abs(np.diff(heading)) < 0.3))
