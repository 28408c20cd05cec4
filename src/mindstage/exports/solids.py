"""Solids: boxes, spheres and cylinders as triangles, with normals, around the origin."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mindstage.world import ShapeKind, Vector
from mindstage.world.geometry import Array

__all__ = ["Triangles", "solid"]

_AROUND = 24
"""Corners of what is round."""
_RINGS = 12


class Triangles(NamedTuple):
    """A surface."""

    points: Array
    """n x 3 [m]."""
    faces: NDArray[np.uint32]
    """m x 3 numbers of points, counterclockwise seen from outside."""
    normals: Array | None = None
    """n x 3, of norm 1; none where each face has its own."""


def solid(kind: ShapeKind, size: Vector) -> Triangles:
    """A solid of a size; round ones become as flat as their size says."""
    made = {ShapeKind.BOX: _box, ShapeKind.SPHERE: _sphere, ShapeKind.CYLINDER: _cylinder}[kind]()
    assert made.normals is not None
    extents = np.array(size)
    normals = made.normals / np.where(extents > 0.0, extents, 1.0)  # what is flattened faces more towards its flat side
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return Triangles(made.points * extents, made.faces, normals / lengths)


def _box() -> Triangles:
    points: list[Array] = []
    normals: list[Array] = []
    faces: list[tuple[int, int, int]] = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            normal, u, v = (np.zeros(3) for _ in range(3))
            normal[axis], u[(axis + 1) % 3], v[(axis + 2) % 3] = sign, sign, 1.0
            first = len(points)
            points += [(normal + a * u + b * v) / 2 for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
            normals += [normal] * 4
            faces += [(first, first + 1, first + 2), (first, first + 2, first + 3)]
    return Triangles(np.array(points), np.array(faces, dtype=np.uint32), np.array(normals))


def _sphere() -> Triangles:
    down = np.linspace(0.0, np.pi, _RINGS + 1)
    around = np.linspace(0.0, 2 * np.pi, _AROUND + 1)
    normals = np.array([(np.sin(d) * np.cos(a), np.sin(d) * np.sin(a), np.cos(d)) for d in down for a in around])
    faces = _grid(_RINGS, _AROUND)
    corners = normals[faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return Triangles(normals / 2, faces[areas > 1e-9], normals)  # at the poles, every other face is none


def _cylinder() -> Triangles:
    around = np.linspace(0.0, 2 * np.pi, _AROUND + 1)
    circle = np.stack([np.cos(around), np.sin(around)], axis=1)
    rows = [np.column_stack([circle / 2, np.full(len(circle), height)]) for height in (0.5, -0.5)]
    sides = np.column_stack([circle, np.zeros(len(circle))])
    points, normals, faces = [*rows], [sides, sides], [_grid(1, _AROUND)]
    for row, up in zip(rows, (1.0, -1.0), strict=True):
        first = sum(map(len, points))
        points.append(row[:-1])
        normals.append(np.tile([0.0, 0.0, up], (_AROUND, 1)))
        fan = np.array([(0, corner, corner + 1) for corner in range(1, _AROUND - 1)], dtype=np.uint32)
        faces.append((fan if up > 0.0 else fan[:, ::-1]) + np.uint32(first))
    return Triangles(np.concatenate(points), np.concatenate(faces), np.concatenate(normals))


def _grid(rows: int, columns: int) -> NDArray[np.uint32]:
    """The faces between rows of points; each row ends where it began."""
    faces = []
    for row in range(rows):
        for column in range(columns):
            upper = row * (columns + 1) + column
            lower = upper + columns + 1
            faces += [(upper, lower, lower + 1), (upper, lower + 1, upper + 1)]
    return np.array(faces, dtype=np.uint32)
