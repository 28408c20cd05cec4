"""What is below loose bodies, and the ground for those with nothing below them.

Maps of episodes often have no floor, and loose bodies would fall into nothing. A body has something below it if a fixed
body is in the column below its footprint, or another loose one for which that holds. For the others a ground is
assumed, which is at the lowest side of the fixed bodies around them: what hangs in the air falls onto it.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mindstage.engines.base import SpawnNote, SpawnNoteKind
from mindstage.scene import BodyId
from mindstage.scene.bounding_boxes import (
    Indices,
    OrientedBoxes,
    clip_polygons,
    footprints,
    overlapping_pairs,
    polygon_areas,
)
from mindstage.scene.collision_shapes import CollisionShapeBatch
from mindstage.scene.display import counted
from mindstage.scene.transforms import Array

__all__ = [
    "Columns",
    "Ground",
    "find_balanced",
    "find_columns",
    "find_ground_height",
    "find_resting",
    "find_supported",
    "ground_area",
    "ground_notes",
]

_MIN_COMMON_AREA_M2 = 1e-7
"""Footprints with a smaller intersection only touch."""
_MAX_SUNK_M = 0.02
"""A body is a support if another one is in it by at most this, or by half of its height if that is more [m]."""
_MIN_GROUND_AREA_M2 = 0.05
"""Fixed bodies with a smaller footprint, such as handles, say nothing about the ground."""
_MAX_GROUND_DISTANCE_M = 3.0
"""Fixed bodies that are farther from all loose ones say nothing about the ground either."""
_MAX_OUTLIER_FRACTION = 0.1
_MIN_OUTLIER_GAP_M = 1.0
"""The lowest bodies are ignored for the ground if they are few, and farther below all others."""
_MAX_PAIRS = 2_000_000
"""Largest number of pairs of a point and a box that are compared at once."""
_AREA_MARGIN_M = 2.0
"""How far a ground that has something below it reaches beyond the bodies for which it is assumed [m]."""


class Ground(NamedTuple):
    """An assumed ground, which only loose bodies that began above it collide with."""

    height_m: float
    bodies: tuple[BodyId, ...]
    """The loose bodies for which it is assumed."""
    area: tuple[float, float, float, float] | None = None
    """Its rectangle, least x and y and largest x and y [m]; None for a plane, which has nothing below it anywhere."""

    @property
    def assumption(self) -> str:
        """The assumption in words."""
        about = self.bodies[0] if len(self.bodies) == 1 else counted(len(self.bodies), "loose body")
        return f"a ground is assumed at a height of {self.height_m:.3f} m, since the map has none below {about}"


class Columns(NamedTuple):
    """Pairs of bodies, the second of which is below the first one, in the column of its footprint; k pairs."""

    upper: Indices
    lower: Indices
    gaps: Array
    """From the underside of the upper one to the top of the lower one, negative if they overlap, k [m]."""
    common: Array
    """Corners of the intersection of their footprints, k x c x 2 [m]."""


def find_columns(
    shapes: CollisionShapeBatch,
    *,
    is_upper: NDArray[np.bool_],
    tree: Indices,
    excluded: Collection[tuple[int, int]] = (),
) -> Columns:
    """Finds what is below some of n bodies, one pair for each pair of their collision shapes.

    Each shape counts as its box. A body beside another one that it slightly overlaps is not below it.

    Args:
        shapes: the collision shapes of the bodies that collide.
        is_upper: whether to look below each body.
        tree: the number of each body's tree, whose bodies are not below one another.
        excluded: pairs of bodies that do not collide, in either order.
    """
    boxes, counts = shapes.boxes, np.diff(shapes.first_shape)
    owner = np.repeat(np.arange(len(counts)), counts)
    polygons, (low, high) = footprints(boxes), boxes.bounds()
    flat = OrientedBoxes(boxes.center * (1.0, 1.0, 0.0), boxes.rotation, boxes.half_extents)
    height_m = 2.0 * float(np.linalg.norm(boxes.half_extents, axis=1).max(initial=0.0))
    mask, everything, found = is_upper[owner], np.ones(len(owner), dtype=bool), list[Columns]()
    for first, second in overlapping_pairs(flat, mask, everything, margin=(0.0, 0.0, height_m)):
        a, b = np.concatenate([first, second]), np.concatenate([second, first])
        kept = mask[a] & (tree[owner[a]] != tree[owner[b]]) & (low[b, 2] < high[a, 2])
        a, b = a[kept], b[kept]
        common = polygons[a]
        for corner in range(polygons.shape[1]):
            common = clip_polygons(common, polygons[b, corner], polygons[b, (corner + 1) % polygons.shape[1]])
        kept = polygon_areas(common) > _MIN_COMMON_AREA_M2
        a, b, common = a[kept], b[kept], common[kept]
        middle = common.mean(axis=1)
        (bottom_a, top_a), (bottom_b, top_b) = _vertical_spans(boxes, a, middle), _vertical_spans(boxes, b, middle)
        gaps = bottom_a - top_b
        kept = (bottom_b < bottom_a) & (gaps >= -np.maximum(_MAX_SUNK_M, (top_a - bottom_a) / 2))
        found.append(Columns(owner[a[kept]], owner[b[kept]], gaps[kept], common[kept]))
    if not found:
        none = np.zeros(0, dtype=np.intp)
        return Columns(none, none, np.zeros(0), np.zeros((0, 1, 2)))
    uppers, lowers, depths, corners = zip(*found, strict=True)
    upper, lower = np.concatenate(uppers), np.concatenate(lowers)
    numbers = np.array([(a * len(counts) + b, b * len(counts) + a) for a, b in excluded], dtype=np.intp)
    kept = ~np.isin(upper * len(counts) + lower, numbers)
    return Columns(upper[kept], lower[kept], np.concatenate(depths)[kept], np.concatenate(corners)[kept])


def find_resting(centers: Array, supports: OrientedBoxes) -> NDArray[np.bool_]:
    """Whether a box is below each of some points, which is the fast part of `find_columns`.

    Args:
        centers: the centers of mass of trees, n x 3 [m].
        supports: boxes around fixed collision shapes.
    """
    found = np.zeros(len(centers), dtype=bool)
    low, high = supports.bounds()
    largest_first = np.argsort(-np.prod(high[:, :2] - low[:, :2], axis=1), kind="stable")
    chunk = max(1, _MAX_PAIRS // max(1, len(centers)))
    for first in range(0, len(largest_first), chunk):
        boxes, rows = largest_first[first : first + chunk], np.flatnonzero(~found)
        x, y, z = (column[:, None] for column in centers[rows].T)
        is_over = (x >= low[boxes, 0]) & (x <= high[boxes, 0]) & (y >= low[boxes, 1]) & (y <= high[boxes, 1])
        points, hit = np.nonzero(is_over & (z >= low[boxes, 2]))
        points, hit = rows[points], boxes[hit]
        bottom, top = _vertical_spans(supports, hit, centers[points, :2])
        found[points[(bottom <= top) & (top <= centers[points, 2])]] = True
    return found


def _vertical_spans(boxes: OrientedBoxes, rows: Indices, points: Array) -> tuple[Array, Array]:
    """The heights between which a vertical line through each point is in the box of its row (slab method) [m].

    The first one is higher if it is not in the box at all.
    """
    rotation, half = boxes.rotation[rows], boxes.half_extents[rows]
    start = np.einsum("ni,nij->nj", np.pad(points, ((0, 0), (0, 1))) - boxes.center[rows], rotation)
    direction = rotation[:, 2]
    parallel = np.abs(direction) < 1e-9
    inverse = np.where(parallel, 1.0, 1.0 / np.where(parallel, 1.0, direction))
    first, second = (-half - start) * inverse, (half - start) * inverse
    beside = np.where(np.abs(start) <= half, -np.inf, np.inf)
    near = np.where(parallel, beside, np.minimum(first, second)).max(axis=1)
    return near, np.where(parallel, -beside, np.maximum(first, second)).min(axis=1)


def find_supported(columns: Columns, tree: Indices, is_loose: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """For each of n bodies, whether it is fixed, or something fixed is below it or below loose bodies under it."""
    supported = np.zeros(int(tree.max(initial=-1)) + 1, dtype=bool)
    supported[tree[~is_loose]] = True
    upper, lower, count = tree[columns.upper], tree[columns.lower], -1
    while count != (count := int(np.count_nonzero(supported))):
        supported[upper[supported[lower]]] = True
    return np.asarray(supported[tree])


def find_balanced(columns: Columns, tree: Indices, is_loose: NDArray[np.bool_], centers: Array) -> NDArray[np.bool_]:
    """For each of n bodies, whether it is fixed, or its tree's center of mass is above the hull of what is below it.

    Only what is balanced itself counts; a tree that is not may fall past what is below it.

    Args:
        columns: what is below the bodies.
        tree: the number of each body's tree.
        is_loose: whether each body is loose.
        centers: the center of mass of each tree, k x 3 [m].
    """
    offsets = columns.common - centers[tree[columns.upper], None, :2]
    corners = columns.common.shape[1]
    angles = np.arctan2(offsets[..., 1], offsets[..., 0]).reshape(-1)
    upper, lower = np.repeat(tree[columns.upper], corners), np.repeat(tree[columns.lower], corners)
    order = np.lexsort((angles, upper))
    angles, upper, lower = angles[order], upper[order], lower[order]
    balanced = np.ones(len(centers), dtype=bool)
    while True:
        kept = balanced[lower]
        trees, first = np.unique(upper[kept], return_index=True)
        around = np.append(angles[kept], 0.0)
        last = np.append(first, len(around) - 1)[1:] - 1
        gaps = np.diff(around)
        gaps[last] = around[first] + 2 * np.pi - around[last]
        now = np.zeros(len(centers), dtype=bool)
        if len(trees):  # the center is inside if its directions to the corners leave no half-plane out
            now[trees] = np.maximum.reduceat(gaps, first) < np.pi - 1e-9
        now[tree[~is_loose]] = True
        now &= balanced
        if (now == balanced).all():
            return np.asarray(balanced[tree])
        balanced = now


def find_ground_height(
    boxes: OrientedBoxes,
    *,
    belongs: NDArray[np.bool_],
    is_loose: NDArray[np.bool_],
    unsupported: NDArray[np.bool_],
    is_certain: NDArray[np.bool_],
) -> float:
    """The height of the ground: the lowest side of fixed bodies around loose ones, or of bodies without support [m].

    Small fixed bodies do not count, nor do those far from all loose ones, or with an uncertain pose. If none is left,
    all bodies count with a pose that is certain, or else all. A few bodies without support that are far below all
    others do not count: they had fallen when the map was recorded.

    Args:
        boxes: a box around each of n bodies.
        belongs: whether each belongs to the place, at least one.
        is_loose: whether each is loose.
        unsupported: whether each is loose and has nothing below it.
        is_certain: whether nothing is known against the pose of each.
    """
    low, high = boxes.bounds()
    loose = np.flatnonzero(is_loose & belongs)
    areas = polygon_areas(footprints(boxes))
    candidates = np.flatnonzero(~is_loose & belongs & is_certain & (areas >= _MIN_GROUND_AREA_M2))
    fixed_m = np.inf
    for row in candidates[np.argsort(low[candidates, 2], kind="stable")].tolist():
        apart = np.maximum(np.maximum(low[loose] - high[row], low[row] - high[loose]), 0.0)
        if (np.einsum("ni,ni->n", apart, apart) <= _MAX_GROUND_DISTANCE_M**2).any():
            fixed_m = float(low[row, 2])
            break
    if fixed_m < np.inf:
        considered = candidates[low[candidates, 2] >= fixed_m]
    else:
        counts = belongs & is_certain
        considered = np.flatnonzero(counts if counts.any() else belongs)
    heights = np.sort(np.concatenate([low[considered, 2], low[unsupported & belongs & is_certain, 2]]))
    gaps = np.diff(heights[: int(len(heights) * _MAX_OUTLIER_FRACTION) + 1])
    outliers = np.flatnonzero(gaps > _MIN_OUTLIER_GAP_M)
    return min(fixed_m, float(heights[outliers[-1] + 1 if len(outliers) else 0]))


def ground_area(boxes: OrientedBoxes, *, needs: Indices) -> tuple[float, float, float, float]:
    """The rectangle of a ground for some bodies that has something below it elsewhere."""
    low, high = boxes.bounds()
    x, y = (low[needs, :2].min(axis=0) - _AREA_MARGIN_M).tolist()
    far_x, far_y = (high[needs, :2].max(axis=0) + _AREA_MARGIN_M).tolist()
    return x, y, far_x, far_y


def ground_notes(height_m: float, *, hanging: Sequence[BodyId], unbalanced: Sequence[BodyId]) -> list[SpawnNote]:
    """Notes on the bodies for which a ground is assumed."""
    notes = []
    for ids, text in (
        (tuple(hanging), f"nothing is below {counted(len(hanging), 'loose body')}"),
        (tuple(unbalanced), f"too much of {counted(len(unbalanced), 'loose body')} is beyond what is below"),
    ):
        if ids:
            text = f"{text}: a ground is assumed at a height of {height_m:.3f} m"
            notes.append(SpawnNote(SpawnNoteKind.GROUND, ids, text))
    return notes
