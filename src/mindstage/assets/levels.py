"""Levels: where a mesh is flat and looks up, so that things can be put on it or into it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mindstage.world import CollisionShape, SupportSurface, VisualMesh
from mindstage.world.geometry import Array

__all__ = ["find_support_surfaces"]

_MIN_UP_COSINE = 0.985
"""Cosine of the steepest slope on which things stay."""
_SAME_LEVEL_M = 0.005
"""Faces whose heights differ by less are of one level."""
_MIN_AREA_FRACTION = 0.2
"""A level is at least so much of what its mesh covers of the ground."""
_MAX_HULL_BULGE = 1 / 30
"""Convex pieces are cut out of a grid; they stand out by so much of the largest extent at most."""
_MIN_CLEARANCE_M = 0.01
"""With less room above it nothing can be put on a level."""


def find_support_surfaces(
    visuals: Sequence[VisualMesh], collision_shapes: Sequence[CollisionShape] = ()
) -> tuple[SupportSurface, ...]:
    """The highest level of a mesh as a place on it, and those that are lower and have room above them as places in it.

    Each is the rectangle round its faces, which may be more than they fill: whether something stays where it is put is
    for an engine to find out.

    Args:
        skins: what is seen of it.
        solids: what can be touched of it, which may bulge a little over a level.
    """
    faces = np.concatenate([skin.points[skin.faces.astype(np.intp)] for skin in visuals])
    low, high = faces.min(axis=(0, 1)), faces.max(axis=(0, 1))
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    twice = np.linalg.norm(normals, axis=1)
    up = normals[:, 2] > _MIN_UP_COSINE * twice
    found = _flat_levels(faces[up], twice[up] / 2, _MIN_AREA_FRACTION * float(np.prod((high - low)[:2])))
    touched = np.array(
        [np.add(point, each.pose.position) for each in collision_shapes for point in each.points]
    ).reshape(-1, 3)
    places = []
    above: float | None = None
    for first, last in found:
        level = _contact_height(first, last, touched, _MAX_HULL_BULGE * float((high - low).max()))
        if above is None or above - level > _MIN_CLEARANCE_M:
            middle = (first + last) / 2
            places.append(
                SupportSurface(
                    center=(float(middle[0]), float(middle[1]), level),
                    size=(float(last[0] - first[0]), float(last[1] - first[1])),
                    clearance=None if above is None else above - level,
                    is_inside=above is not None,
                )
            )
            above = level
    return tuple(places)


def _flat_levels(faces: Array, areas: Array, min_area: float) -> list[tuple[Array, Array]]:
    """The corners round the faces of each level that is large enough, the highest first."""
    heights = faces[:, :, 2].mean(axis=1) if len(faces) else np.zeros(0)
    order = np.argsort(-heights, kind="stable")
    starts = np.flatnonzero(np.diff(heights[order], prepend=np.inf) < -_SAME_LEVEL_M)
    return [
        (faces[rows].min(axis=(0, 1)), faces[rows].max(axis=(0, 1)))
        for rows in np.split(order, starts[1:] if len(starts) else [])
        if len(rows) and areas[rows].sum() >= min_area
    ]


def _contact_height(first: Array, last: Array, collision_points: Array, max_bulge: float) -> float:
    """The height at which something stands on a level: that of its faces, or of what bulges over them."""
    level = float(last[2])
    over = np.all(
        (collision_points[:, :2] >= first[:2] - max_bulge) & (collision_points[:, :2] <= last[:2] + max_bulge), axis=1
    )
    bulges = collision_points[
        over & (collision_points[:, 2] > level) & (collision_points[:, 2] <= level + max_bulge), 2
    ]
    return float(bulges.max(initial=level))
