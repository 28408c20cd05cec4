"""Hulls: the smallest convex body round some points, as triangles, and what it weighs.

Points are added one by one (a beneath-beyond hull); what lies within rounding of a face belongs to that face.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mindstage.world.geometry import Array, cross

__all__ = ["Hull", "hull_round"]

_FLAT = 1e-7
"""Points nearer than this part of the extent to a plane lie in it."""


@dataclass(frozen=True, slots=True, eq=False)
class Hull:
    """A convex body of triangles."""

    points: Array
    """n x 3, those that were given."""
    faces: NDArray[np.intp]
    """m x 3 numbers of points, counterclockwise seen from outside."""
    normals: Array
    """Of the faces, m x 3, of norm 1 (but for slivers that have no area)."""

    def moments(self) -> tuple[float, Array, Array]:
        """Its volume, its middle, and the second moments (the integral of x xT) about that middle, 3 x 3.

        Summed over the tetrahedra between the faces and one point inside.
        """
        inside = self.points[np.unique(self.faces)].mean(axis=0)
        corners = self.points[self.faces] - inside
        sixfold = np.linalg.det(corners)
        volume = float(sixfold.sum() / 6)
        total = corners.sum(axis=1)
        middle = (sixfold[:, None] * total).sum(axis=0) / (24 * volume)
        squares = np.einsum("fki,fkj->fij", corners, corners) + np.einsum("fi,fj->fij", total, total)
        second = np.einsum("f,fij->ij", sixfold, squares) / 120
        return volume, inside + middle, second - volume * np.outer(middle, middle)


def hull_round(points: Array) -> Hull | None:
    """The hull of n x 3 points; None where they all lie in one plane, or are none at all."""
    if len(points) < 4:
        return None
    slack = _FLAT * float(np.ptp(points, axis=0).max())
    first = _first_four(points, slack)
    if first is None:
        return None
    inside = points[first].mean(axis=0)
    faces = np.array([[first[i] for i in range(4) if i != left] for left in range(4)], dtype=np.intp)
    normals, offsets = _planes(points, faces)
    wrong = offsets < normals @ inside
    faces[wrong] = faces[wrong][:, ::-1]
    normals[wrong], offsets[wrong] = -normals[wrong], -offsets[wrong]
    for number in set(range(len(points))).difference(first):
        seen = normals @ points[number] - offsets > slack
        if seen.any():
            rim = _rim(faces[seen].tolist(), number)
            new_normals, new_offsets = _planes(points, rim)
            faces = np.concatenate([faces[~seen], rim])
            normals = np.concatenate([normals[~seen], new_normals])
            offsets = np.concatenate([offsets[~seen], new_offsets])
    return Hull(points, faces, normals)


def _first_four(points: Array, slack: float) -> list[int] | None:
    """Four points that span a body as large as can easily be found."""
    one = int(np.argmin(points[:, np.argmax(np.ptp(points, axis=0))]))
    away = points - points[one]
    two = int(np.argmax(np.linalg.norm(away, axis=1)))
    along = away[two] / max(float(np.linalg.norm(away[two])), 1e-300)
    aside = away - np.outer(away @ along, along)
    three = int(np.argmax(np.linalg.norm(aside, axis=1)))
    upright = np.cross(along, aside[three])
    heights = away @ upright
    four = int(np.argmax(np.abs(heights)))
    wide = float(np.linalg.norm(aside[three]))
    if wide <= slack or abs(float(heights[four])) <= slack * wide:
        return None
    return [one, two, three, four]


def _planes(points: Array, faces: NDArray[np.intp]) -> tuple[Array, Array]:
    """The normals of faces, and how far from the origin their planes are."""
    a, b, c = points[faces[:, 0]], points[faces[:, 1]], points[faces[:, 2]]
    crossed = cross(b - a, c - a)
    lengths = np.sqrt(np.einsum("fi,fi->f", crossed, crossed))
    normals = crossed / np.maximum(lengths, 1e-300)[:, None]
    return normals, np.einsum("fi,fi->f", normals, a)


def _rim(seen: list[list[int]], number: int) -> NDArray[np.intp]:
    """Faces from a new point to the rim of those that it sees, which go."""
    edges = {edge for a, b, c in seen for edge in ((a, b), (b, c), (c, a))}
    return np.array([(a, b, number) for a, b in edges if (b, a) not in edges], dtype=np.intp).reshape(-1, 3)
