"""Footprints: what oriented boxes cover of the ground, exactly, however they are tilted.

The shadow of a box is a convex polygon of up to six corners. Here it always has six, counter-clockwise, some of which
coincide where the box stands upright, so that many of them fit into one array n x 6 x 2 [m].
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from mindstage.world.boxes import Indices, OrientedBoxes
from mindstage.world.geometry import Array

__all__ = ["footprints", "polygon_areas", "polygon_gaps", "polygon_overlap_areas"]

_CORNERS = 6
_MIN_EDGE_M = 1e-9
"""An edge shorter than this comes from rounding; it has no direction to trust."""
_POLYGON_CHUNK_SIZE = 1 << 14
"""So many pairs are looked at in one go; it bounds the memory."""


def footprints(boxes: OrientedBoxes) -> Array:
    """The shadows of boxes on the ground: n x 6 x 2 corners, counter-clockwise."""
    # A box is the sum of three segments, so its shadow is that of three flat ones: walk along them by their angle.
    edges = np.swapaxes(boxes.rotation[:, :2, :] * boxes.half_extents[:, None, :], 1, 2)
    edges = np.where(np.linalg.norm(edges, axis=2, keepdims=True) < _MIN_EDGE_M, 0.0, edges)
    backwards = (edges[..., 1] < 0.0) | ((edges[..., 1] == 0.0) & (edges[..., 0] < 0.0))
    edges = np.where(backwards[..., None], -edges, edges)
    order = np.argsort(np.arctan2(edges[..., 1], edges[..., 0]), axis=1)
    edges = np.take_along_axis(edges, order[..., None], axis=1)
    round_it = np.concatenate([edges, -edges], axis=1) * 2
    corners = np.cumsum(round_it, axis=1) - round_it - edges.sum(axis=1, keepdims=True)
    return np.asarray(boxes.center[:, None, :2] + corners)


def polygon_areas(polygons: Array) -> Array:
    """The areas of convex polygons, n x k x 2 [m2]."""
    corners = polygons - polygons[:, :1]
    return np.asarray(_cross(corners, np.roll(corners, -1, axis=1)).sum(axis=1) / 2)


def polygon_overlap_areas(polygons: Array, a: Indices, b: Indices) -> Array:
    """How much of the ground both polygons of each pair cover [m2]."""
    return _in_chunks(_overlap_area, polygons, a, b)


def polygon_gaps(polygons: Array, a: Indices, b: Indices) -> Array:
    """The shortest way between the edges of each pair of polygons that do not overlap [m]."""
    return _in_chunks(_polygon_gap, polygons, a, b)


def _overlap_area(one: Array, other: Array) -> Array:
    clipped = one
    for at in range(_CORNERS):
        clipped = _clip(clipped, other[:, at], other[:, (at + 1) % _CORNERS])
    return polygon_areas(clipped)


def _clip(polygons: Array, start: Array, end: Array) -> Array:
    """What of convex polygons lies to the left of a line each (Sutherland and Hodgman 1974).

    Each side that crosses the line leaves a corner there. What comes out has one corner more; those to spare repeat
    the first one, which changes no area.
    """
    count = polygons.shape[1]
    height = _cross((end - start)[:, None], polygons - start[:, None])
    after, height_after = np.roll(polygons, -1, axis=1), np.roll(height, -1, axis=1)
    keeps = height >= 0.0
    crosses = keeps != (height_after >= 0.0)
    share = np.divide(height, height - height_after, out=np.zeros_like(height), where=crosses)
    crossing = polygons + share[..., None] * (after - polygons)
    corners = np.stack([polygons, crossing], axis=2).reshape(-1, 2 * count, 2)
    wanted = np.stack([keeps, crosses], axis=2).reshape(-1, 2 * count)
    order = np.argsort(~wanted, axis=1, kind="stable")[:, : count + 1]
    corners = np.take_along_axis(corners, order[..., None], axis=1)
    spare = ~np.take_along_axis(wanted, order, axis=1)
    return np.asarray(np.where(spare[..., None], corners[:, :1], corners))


def _polygon_gap(one: Array, other: Array) -> Array:
    return np.minimum(_corner_to_edge_distance(one, other), _corner_to_edge_distance(other, one))


def _corner_to_edge_distance(corners: Array, polygons: Array) -> Array:
    """The shortest way from any corner to any side."""
    sides = (np.roll(polygons, -1, axis=1) - polygons)[:, None]
    away = corners[:, :, None] - polygons[:, None]
    squared = np.sum(sides * sides, axis=-1)
    share = np.divide(np.sum(away * sides, axis=-1), squared, out=np.zeros(away.shape[:-1]), where=squared > 0.0)
    off = away - np.clip(share, 0.0, 1.0)[..., None] * sides
    return np.asarray(np.sqrt(np.sum(off * off, axis=-1).min(axis=(1, 2))))


def _in_chunks(function: Callable[[Array, Array], Array], polygons: Array, a: Indices, b: Indices) -> Array:
    found: NDArray[np.float64] = np.zeros(len(a))
    for start in range(0, len(a), _POLYGON_CHUNK_SIZE):
        part = slice(start, start + _POLYGON_CHUNK_SIZE)
        found[part] = function(polygons[a[part]], polygons[b[part]])
    return found


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
