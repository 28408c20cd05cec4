"""Oriented bounding boxes: overlapping pairs, penetration depths, containment, footprints, and the bounds of a world.

All functions are vectorized. Candidate pairs come from a sweep along the axis of the largest spread, so the cost grows
with the number of boxes and of overlaps, not with its square; penetration depths are exact (separating axes).

A footprint is the vertical projection of a box onto the ground: a convex polygon of up to six corners. It is always
stored with six corners, counterclockwise, some of which coincide if the box is upright: arrays n x 6 x 2 [m].
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from mindstage.scene.transforms import Array, cross, normalize, pose_array, rotation_matrix
from mindstage.scene.world_model import BodyId, Iri, Vector, World

__all__ = [
    "Bounds",
    "Indices",
    "OrientedBoxes",
    "clip_polygons",
    "connected_groups",
    "contains",
    "face_coverage",
    "footprints",
    "overlapping_pairs",
    "penetration_depths",
    "polygon_areas",
    "polygon_gaps",
    "polygon_overlap_areas",
    "world_bounds",
]


Indices = NDArray[np.intp]

_CHUNK_SIZE = 1 << 20
"""Number of candidate pairs per chunk, which bounds the memory."""


@dataclass(frozen=True, slots=True)
class OrientedBoxes:
    """n oriented boxes."""

    center: Array
    """n x 3 [m]."""
    rotation: Array
    """n x 3 x 3 rotation matrices; the columns are the axes of the box."""
    half_extents: Array
    """n x 3, half of the extents along the axes of the box [m]."""

    @classmethod
    def from_poses(cls, poses: Array, sizes: Array) -> OrientedBoxes:
        """Returns boxes with n x 7 poses (unit quaternions) and n x 3 sizes."""
        return cls(poses[:, :3], rotation_matrix(poses[:, 3:]), sizes / 2)

    def with_poses(self, rows: Indices, poses: Array) -> OrientedBoxes:
        """Returns the same boxes, some of which have other poses, len(rows) x 7 (unit quaternions)."""
        center, rotation = self.center.copy(), self.rotation.copy()
        center[rows], rotation[rows] = poses[:, :3], rotation_matrix(poses[:, 3:])
        return OrientedBoxes(center, rotation, self.half_extents)

    def rows(self, rows: Indices) -> OrientedBoxes:
        """Returns some of the boxes."""
        return OrientedBoxes(self.center[rows], self.rotation[rows], self.half_extents[rows])

    def bounds(self) -> tuple[Array, Array]:
        """Returns the lower and upper corners of the axis-aligned bounding boxes, each n x 3."""
        reach = np.einsum("nij,nj->ni", np.abs(self.rotation), self.half_extents)
        return self.center - reach, self.center + reach


def overlapping_pairs(
    boxes: OrientedBoxes,
    first_mask: NDArray[np.bool_],
    second_mask: NDArray[np.bool_],
    *,
    margin: Vector = (0.0, 0.0, 0.0),
) -> Iterator[tuple[Indices, Indices]]:
    """Yields pairs with overlapping axis-aligned bounds, each once, in chunks.

    One box of each pair is in the first mask and the other is in the second.

    Args:
        first_mask: for each box, whether it can be one of a pair.
        second_mask: for each box, whether it can be the other of a pair.
        margin: the largest gap along each world axis that still counts as an overlap [m].
    """
    low, high = boxes.bounds()
    high = high + np.asarray(margin)
    if len(low) < 2:
        return
    with np.errstate(over="ignore", invalid="ignore"):  # positions of any size
        axis = int(np.argmax(boxes.center.std(axis=0)))
    order = np.argsort(low[:, axis], kind="stable")
    start = low[order, axis]
    ends = np.searchsorted(start, high[order, axis], side="right")
    counts = np.maximum(ends - np.arange(len(order)) - 1, 0)
    if not counts.any():
        return
    starts = np.searchsorted(np.cumsum(counts), np.arange(0, counts.sum(), _CHUNK_SIZE), side="left")
    firsts = list(dict.fromkeys(starts.tolist()))
    for begin, end in zip(firsts, [*firsts[1:], len(order)], strict=True):
        rows = np.arange(begin, end)
        per_row = counts[rows]
        left = np.repeat(rows, per_row)
        right = np.arange(len(left)) - np.repeat(np.cumsum(per_row) - per_row, per_row) + left + 1
        a, b = order[left], order[right]
        keep = (first_mask[a] & second_mask[b]) | (second_mask[a] & first_mask[b])
        a, b = a[keep], b[keep]
        meet = np.all((low[a] <= high[b]) & (low[b] <= high[a]), axis=1)
        yield a[meet], b[meet]


def connected_groups(count: int, a: Indices, b: Indices) -> Indices:
    """Returns the number of the group of each of n things, in the order of the first of each group.

    Things of a group are connected, directly or through others.

    Args:
        count: n.
        a: the rows of one end of each connection.
        b: the rows of the other end.
    """
    first = np.arange(count)
    while True:
        one, other = first[a], first[b]
        if np.array_equal(one, other):
            return np.unique(first, return_inverse=True)[1].astype(np.intp)
        np.minimum.at(first, np.maximum(one, other), np.minimum(one, other))
        while not np.array_equal(first, first := first[first]):
            pass


def penetration_depths(boxes: OrientedBoxes, a: Indices, b: Indices) -> Array:
    """Returns the translation that separates each pair [m]; negative for a gap.

    The smallest overlap over the fifteen separating axes of two boxes (Gottschalk, Lin, Manocha 1996).
    """
    apart = boxes.center[b] - boxes.center[a]
    axes_a, axes_b = np.swapaxes(boxes.rotation[a], 1, 2), np.swapaxes(boxes.rotation[b], 1, 2)
    crossed = cross(axes_a[:, :, None, :], axes_b[:, None, :, :]).reshape(-1, 9, 3)
    length = np.linalg.norm(crossed, axis=2, keepdims=True)
    parallel = length[..., 0] < 1e-6
    crossed = np.divide(crossed, length, out=np.zeros_like(crossed), where=length >= 1e-6)
    axes = np.concatenate([axes_a, axes_b, crossed], axis=1)
    reach_a = np.einsum("paj,pj->pa", np.abs(np.einsum("pai,pji->paj", axes, axes_a)), boxes.half_extents[a])
    reach_b = np.einsum("paj,pj->pa", np.abs(np.einsum("pai,pji->paj", axes, axes_b)), boxes.half_extents[b])
    overlap = reach_a + reach_b - np.abs(np.einsum("pai,pi->pa", axes, apart))
    overlap[:, 6:][parallel] = np.inf
    return np.asarray(overlap.min(axis=1))


def contains(boxes: OrientedBoxes, outer: Indices, inner: Indices, *, min_fraction: float = 1.0) -> NDArray[np.bool_]:
    """Returns, for each pair, whether the outer box contains the inner one.

    Args:
        outer: indices of the containing boxes.
        inner: indices of the contained boxes.
        min_fraction: fraction of the inner box that must be inside along each axis of the outer one.
    """
    turn = np.swapaxes(boxes.rotation[outer], 1, 2)
    offset = np.abs(np.einsum("pij,pj->pi", turn, boxes.center[inner] - boxes.center[outer]))
    reach = np.einsum("pij,pj->pi", np.abs(turn @ boxes.rotation[inner]), boxes.half_extents[inner])
    inside = np.minimum(offset + reach, boxes.half_extents[outer]) - np.maximum(
        offset - reach, -boxes.half_extents[outer]
    )
    return np.asarray(np.all(inside >= min_fraction * 2 * reach - 1e-9, axis=1))


def face_coverage(boxes: OrientedBoxes, cover: int, targets: Indices, *, tolerance: float = 0.005) -> Array:
    """Returns the fraction of a face of other boxes that one box covers, as a door does; 0 if they do not touch.

    Args:
        cover: index of the covering box.
        targets: indices of the boxes that may be covered.
        tolerance: the largest gap that still counts as contact [m].
    """
    turn = np.swapaxes(boxes.rotation[targets], 1, 2)
    offset = np.abs(np.einsum("pij,pj->pi", turn, boxes.center[cover] - boxes.center[targets]))
    half = np.einsum("pij,j->pi", np.abs(turn @ boxes.rotation[cover]), boxes.half_extents[cover])
    both = np.minimum(offset + half, boxes.half_extents[targets]) - np.maximum(
        offset - half, -boxes.half_extents[targets]
    )
    shares = np.sort(both.clip(0.0) / np.maximum(2 * boxes.half_extents[targets], 1e-9), axis=1)
    return np.asarray(np.where(np.all(both >= -tolerance, axis=1), shares[:, 1] * shares[:, 2], 0.0))


class Bounds(msgspec.Struct, frozen=True, kw_only=True):
    """The axis-aligned bounding box of all bodies."""

    low: Vector
    """The lower corner [m]."""
    high: Vector
    """The upper corner [m]."""
    tallest: BodyId
    tallest_class: Iri
    height_m: float
    """Height of the tallest body, from its lowest to its highest point [m]."""

    @property
    def size(self) -> Vector:
        """Extents along x, y and z [m]."""
        (x, y, z), (left, back, bottom) = self.high, self.low
        return x - left, y - back, z - bottom


def world_bounds(world: World) -> Bounds | None:
    """Returns the bounds of a world, None if it has no bodies. Bodies without a size are points.

    Implausible bounds are the quickest sign of a misread map: a kitchen that is 400 m wide.
    """
    if not world.bodies:
        return None
    poses = pose_array(body.pose for body in world.bodies)
    poses[:, 3:] = normalize(poses[:, 3:])
    sizes = np.array([body.size or (0.0, 0.0, 0.0) for body in world.bodies])
    low, high = OrientedBoxes.from_poses(poses, sizes).bounds()
    heights = high[:, 2] - low[:, 2]
    tallest = world.bodies[int(np.argmax(heights))]
    left, back, bottom = low.min(axis=0).tolist()
    right, front, top = high.max(axis=0).tolist()
    return Bounds(
        low=(left, back, bottom),
        high=(right, front, top),
        tallest=tallest.id,
        tallest_class=tallest.cls,
        height_m=float(heights.max()),
    )


_CORNERS = 6
_MIN_EDGE_M = 1e-9
"""Shorter edges are due to rounding: their direction is undefined."""
_POLYGON_CHUNK_SIZE = 1 << 14
"""Number of pairs per chunk, which bounds the memory."""


def footprints(boxes: OrientedBoxes) -> Array:
    """Returns the footprints of boxes: n x 6 x 2 corners, counterclockwise [m]."""
    # A box is the Minkowski sum of three segments, and so is its projection: its sides are their projections by angle.
    edges = np.swapaxes(boxes.rotation[:, :2, :] * boxes.half_extents[:, None, :], 1, 2)
    edges = np.where(np.linalg.norm(edges, axis=2, keepdims=True) < _MIN_EDGE_M, 0.0, edges)
    backwards = (edges[..., 1] < 0.0) | ((edges[..., 1] == 0.0) & (edges[..., 0] < 0.0))
    edges = np.where(backwards[..., None], -edges, edges)
    order = np.argsort(np.arctan2(edges[..., 1], edges[..., 0]), axis=1)
    edges = np.take_along_axis(edges, order[..., None], axis=1)
    doubled_edges = np.concatenate([edges, -edges], axis=1) * 2
    corners = np.cumsum(doubled_edges, axis=1) - doubled_edges - edges.sum(axis=1, keepdims=True)
    return np.asarray(boxes.center[:, None, :2] + corners)


def polygon_areas(polygons: Array) -> Array:
    """Returns the areas of convex polygons, n x k x 2 [m²]."""
    corners = polygons - polygons[:, :1]
    return np.asarray(_cross(corners, np.roll(corners, -1, axis=1)).sum(axis=1) / 2)


def polygon_overlap_areas(polygons: Array, a: Indices, b: Indices) -> Array:
    """Returns the area of the intersection of each pair of polygons [m²]."""
    return _in_chunks(_overlap_area, polygons, a, b)


def polygon_gaps(polygons: Array, a: Indices, b: Indices) -> Array:
    """Returns the distance between the edges of each pair of disjoint polygons [m]."""
    return _in_chunks(_polygon_gap, polygons, a, b)


def _overlap_area(one: Array, other: Array) -> Array:
    clipped = one
    for at in range(_CORNERS):
        clipped = clip_polygons(clipped, other[:, at], other[:, (at + 1) % _CORNERS])
    return polygon_areas(clipped)


def clip_polygons(polygons: Array, start: Array, end: Array) -> Array:
    """Clips each convex polygon to the left half-plane of a line (Sutherland and Hodgman 1974).

    Each side that crosses the line adds a corner. The result has one corner more than the input; unused ones repeat
    the first corner, which does not change the area.
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
    """Returns the smallest distance from a corner to a side [m]."""
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
