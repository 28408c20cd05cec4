"""Levels: where a mesh is flat and looks up, so that things can be put on it or into it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mindstage.world import Place, Skin, Solid
from mindstage.world.geometry import Array

__all__ = ["levels_of"]

_LEVEL = 0.985
"""Cosine of the steepest slope on which things stay."""
_APART_M = 0.005
"""Faces whose heights differ by less are of one level."""
_SHARE = 0.2
"""A level is at least so much of what its mesh covers of the ground."""
_BULGE = 1 / 30
"""Convex pieces are cut out of a grid; they stand out by so much of the largest extent at most."""
_THIN_M = 0.01
"""With less room above it nothing can be put on a level."""


def levels_of(skins: Sequence[Skin], solids: Sequence[Solid] = ()) -> tuple[Place, ...]:
    """The highest level of a mesh as a place on it, and those that are lower and have room above them as places in it.

    Each is the rectangle round its faces, which may be more than they fill: whether something stays where it is put is
    for an engine to find out.

    Args:
        skins: what is seen of it.
        solids: what can be touched of it, which may bulge a little over a level.
    """
    faces = np.concatenate([skin.points[skin.faces.astype(np.intp)] for skin in skins])
    low, high = faces.min(axis=(0, 1)), faces.max(axis=(0, 1))
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    twice = np.linalg.norm(normals, axis=1)
    up = normals[:, 2] > _LEVEL * twice
    found = _levels(faces[up], twice[up] / 2, _SHARE * float(np.prod((high - low)[:2])))
    touched = np.array([np.add(point, each.pose.position) for each in solids for point in each.points]).reshape(-1, 3)
    places = []
    above: float | None = None
    for first, last in found:
        level = _raised(first, last, touched, _BULGE * float((high - low).max()))
        if above is None or above - level > _THIN_M:
            middle = (first + last) / 2
            places.append(
                Place(
                    centre=(float(middle[0]), float(middle[1]), level),
                    size=(float(last[0] - first[0]), float(last[1] - first[1])),
                    height=None if above is None else above - level,
                    inside=above is not None,
                )
            )
            above = level
    return tuple(places)


def _levels(faces: Array, areas: Array, least: float) -> list[tuple[Array, Array]]:
    """The corners round the faces of each level that is large enough, the highest first."""
    heights = faces[:, :, 2].mean(axis=1) if len(faces) else np.zeros(0)
    order = np.argsort(-heights, kind="stable")
    starts = np.flatnonzero(np.diff(heights[order], prepend=np.inf) < -_APART_M)
    return [
        (faces[rows].min(axis=(0, 1)), faces[rows].max(axis=(0, 1)))
        for rows in np.split(order, starts[1:] if len(starts) else [])
        if len(rows) and areas[rows].sum() >= least
    ]


def _raised(first: Array, last: Array, touched: Array, most: float) -> float:
    """The height at which something stands on a level: that of its faces, or of what bulges over them."""
    level = float(last[2])
    over = np.all((touched[:, :2] >= first[:2] - most) & (touched[:, :2] <= last[:2] + most), axis=1)
    bulges = touched[over & (touched[:, 2] > level) & (touched[:, 2] <= level + most), 2]
    return float(bulges.max(initial=level))
