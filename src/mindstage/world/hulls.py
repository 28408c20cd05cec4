"""Convex hulls of point sets: triangles, face normals, volume and second moments.

`scipy.spatial` (Qhull) is imported by the first call, since it takes a tenth of a second to load.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mindstage.world.geometry import Array, cross

__all__ = ["Hull", "convex_hull"]

_FLAT = 1e-6
"""Points whose least extent is at most this part of the largest one are coplanar: float32 files round by 1e-7."""


@dataclass(frozen=True, slots=True, eq=False)
class Hull:
    """A convex polyhedron with triangular faces."""

    points: Array
    """n x 3, the vertices, in the order in which they were given."""
    faces: NDArray[np.intp]
    """m x 3 indices of points, counterclockwise seen from outside."""
    normals: Array
    """m x 3, outward unit normals of the faces."""

    def moments(self) -> tuple[float, Array, Array]:
        """Returns the volume, the centroid, and the second moments (the integral of x xT) about it, 3 x 3.

        Summed over the tetrahedra between the faces and an interior point.
        """
        inside = self.points.mean(axis=0)
        corners = self.points[self.faces] - inside
        sixfold = np.linalg.det(corners)
        volume = float(sixfold.sum() / 6)
        total = corners.sum(axis=1)
        middle = (sixfold[:, None] * total).sum(axis=0) / (24 * volume)
        squares = np.einsum("fki,fkj->fij", corners, corners) + np.einsum("fi,fj->fij", total, total)
        second = np.einsum("f,fij->ij", sixfold, squares) / 120
        return volume, inside + middle, second - volume * np.outer(middle, middle)


def convex_hull(points: Array) -> Hull | None:
    """Returns the convex hull of n x 3 points; None where they are coplanar, fewer than four, or not finite."""
    if len(points) < 4 or not np.isfinite(points).all():
        return None
    centered = points - points.mean(axis=0)
    extent = float(np.ptp(centered, axis=0).max())
    if extent <= 0.0:
        return None
    scaled = centered / extent  # Qhull's tolerances are meant for coordinates near 1
    least = np.linalg.svd(scaled, full_matrices=False)[2][2]
    if np.ptp(scaled @ least) <= _FLAT:
        return None

    from scipy.spatial import ConvexHull, QhullError

    try:
        found = ConvexHull(scaled)
    except QhullError:  # coplanar to Qhull, whose bound is the rounding of float64
        return None
    normals = found.equations[:, :3]
    a, b, c = scaled[found.simplices].transpose(1, 0, 2)
    inward = np.einsum("fi,fi->f", cross(b - a, c - a), normals) < 0.0
    faces = np.where(inward[:, None], found.simplices[:, ::-1], found.simplices)
    used, faces = np.unique(faces, return_inverse=True)
    return Hull(np.asarray(points[used], dtype=np.float64), faces.reshape(-1, 3), normals.copy())
