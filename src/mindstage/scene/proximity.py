"""Distances, directions and betweenness of bodies, from their oriented bounding boxes.

Bodies without a size are points; bodies whose numbers are not finite are left out. All functions are vectorized over
pairs of boxes, and their cost grows linearly with the number of pairs that they are given.

- The **gap** of two boxes is the smallest distance between their points [m]. Of boxes that overlap it is negative: the
  length of the shortest translation that separates them (Gottschalk, Lin, Manocha 1996).
- A **direction** is front, left, behind or right of a reference point, in a horizontal frame whose x axis points to the
  front and whose y axis to the left (REP 103): each covers the 90 degrees about its axis, both borders included. This
  is the cone-based model of Frank (1991, "Qualitative spatial reasoning with cardinal directions").
- A body is **between** two others by the fraction of its footprint that is in the convex hull of their footprints,
  which
  is the crisp case of Bloch, Colliot and Cesar (2006, "On the ternary spatial relation between").
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from mindstage.scene.bounding_boxes import (
    Indices,
    OrientedBoxes,
    clip_polygons,
    footprints,
    penetration_depths,
    polygon_areas,
)
from mindstage.scene.transforms import Array, normalize, pose_array
from mindstage.scene.world_model import Body, BodyId

__all__ = [
    "BodyBoxes",
    "Direction",
    "betweenness",
    "box_gaps",
    "box_point_gaps",
    "directions",
    "nearest_boxes",
]

_CHUNK_SIZE = 1 << 11
"""Number of pairs per chunk: each has 144 pairs of edges."""
_TOLERANCE = 1e-9
"""Distances [m] and angles [rad] that differ by less are equal."""
_CORNER_SIGNS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
_EDGES = np.array([[a, b] for a in range(8) for b in range(a + 1, 8) if bin(a ^ b).count("1") == 1])


@dataclass(frozen=True, slots=True, eq=False)
class BodyBoxes:
    """The bounding boxes of bodies, in one order."""

    bodies: tuple[Body, ...]
    boxes: OrientedBoxes
    low: Array
    """n x 3, the lower corners of the axis-aligned bounds [m]."""
    high: Array
    """n x 3 [m]."""
    row_by_id: dict[BodyId, int]

    @classmethod
    def from_bodies(cls, bodies: Sequence[Body]) -> BodyBoxes:
        """The boxes of all bodies whose poses and sizes are finite."""
        kept = tuple(body for body in bodies if _is_finite(body))
        poses = pose_array(body.pose for body in kept)
        poses[:, 3:] = normalize(poses[:, 3:])
        sizes = np.array([body.size or (0.0, 0.0, 0.0) for body in kept], dtype=np.float64).reshape(-1, 3)
        boxes = OrientedBoxes.from_poses(poses, sizes)
        low, high = boxes.bounds()
        return cls(kept, boxes, low, high, {body.id: row for row, body in enumerate(kept)})

    def moved(self, bodies: Sequence[Body], rows: Indices) -> BodyBoxes | None:
        """The boxes of the same bodies, of which some are elsewhere; None if a pose is not finite.

        Args:
            bodies: the bodies, in the same order.
            rows: those that have moved.
        """
        changed, kept = [bodies[row] for row in rows.tolist()], list(self.bodies)
        if not all(map(_is_finite, changed)):
            return None
        for row, body in zip(rows.tolist(), changed, strict=True):
            kept[row] = body
        poses = pose_array(body.pose for body in changed)
        poses[:, 3:] = normalize(poses[:, 3:])
        boxes = self.boxes.with_poses(rows, poses)
        low, high = self.low.copy(), self.high.copy()
        low[rows], high[rows] = boxes.rows(rows).bounds()
        return BodyBoxes(tuple(kept), boxes, low, high, self.row_by_id)


def _is_finite(body: Body) -> bool:
    numbers = (*(body.size or ()), *body.pose.position, *body.pose.quaternion)
    return all(map(isfinite, numbers)) and any(body.pose.quaternion)


# -- distances ---------------------------------------------------------------------------------------------------------


def box_gaps(boxes: OrientedBoxes, a: Indices, b: Indices) -> Array:
    """Returns the gap of each pair of boxes [m]; negative if they overlap."""
    found = np.zeros(len(a))
    for start in range(0, len(a), _CHUNK_SIZE):
        part = slice(start, start + _CHUNK_SIZE)
        found[part] = _gaps(boxes, a[part], b[part])
    return found


def _gaps(boxes: OrientedBoxes, a: Indices, b: Indices) -> Array:
    depth = penetration_depths(boxes, a, b)
    corners_a, corners_b = _corners(boxes, a), _corners(boxes, b)
    gap = np.minimum(
        _point_distances(boxes, a, corners_b).min(axis=1), _point_distances(boxes, b, corners_a).min(axis=1)
    )
    gap = np.minimum(gap, _edge_distances(corners_a, corners_b))
    return np.asarray(np.where(depth > 0.0, -depth, gap))


def _corners(boxes: OrientedBoxes, rows: Indices) -> Array:
    """The eight corners of boxes, n x 8 x 3."""
    offsets = _CORNER_SIGNS * boxes.half_extents[rows][:, None, :]
    return np.asarray(boxes.center[rows][:, None, :] + np.einsum("nij,nkj->nki", boxes.rotation[rows], offsets))


def _point_distances(boxes: OrientedBoxes, rows: Indices, points: Array) -> Array:
    """The distances of points, n x k x 3, to one box each, n x k."""
    local = np.einsum("nji,nkj->nki", boxes.rotation[rows], points - boxes.center[rows][:, None, :])
    outside = np.maximum(np.abs(local) - boxes.half_extents[rows][:, None, :], 0.0)
    return np.asarray(np.linalg.norm(outside, axis=2))


def _edge_distances(corners_a: Array, corners_b: Array) -> Array:
    """The smallest distance between inner points of two edges; infinite where the nearest points are corners.

    The common perpendicular of two lines (Ericson 2005, section 5.1.8).
    """
    start_a, start_b = corners_a[:, _EDGES[:, 0]], corners_b[:, _EDGES[:, 0]]
    along_a, along_b = corners_a[:, _EDGES[:, 1]] - start_a, corners_b[:, _EDGES[:, 1]] - start_b
    between = start_a[:, :, None] - start_b[:, None, :]
    aa, bb = np.sum(along_a**2, axis=2)[:, :, None], np.sum(along_b**2, axis=2)[:, None, :]
    ab = np.einsum("nik,njk->nij", along_a, along_b)
    da, db = np.einsum("nijk,nik->nij", between, along_a), np.einsum("nijk,njk->nij", between, along_b)
    determinant = aa * bb - ab * ab
    crossing = determinant > 1e-12 * np.maximum(aa * bb, 1e-300)
    safe = np.where(crossing, determinant, 1.0)
    s, t = (ab * db - bb * da) / safe, (aa * db - ab * da) / safe
    crossing &= (s >= 0.0) & (s <= 1.0) & (t >= 0.0) & (t <= 1.0)
    apart = between + s[..., None] * along_a[:, :, None] - t[..., None] * along_b[:, None]
    return np.asarray(np.where(crossing, np.linalg.norm(apart, axis=3), np.inf).min(axis=(1, 2)))


def box_point_gaps(boxes: OrientedBoxes, point: Array) -> Array:
    """Returns the distance of a point to each box [m]; negative within a box, by the depth below its nearest side."""
    local = np.einsum("nji,nj->ni", boxes.rotation, point - boxes.center)
    beyond = np.abs(local) - boxes.half_extents
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    return np.asarray(np.where(np.all(beyond < 0.0, axis=1), beyond.max(axis=1), outside))


def nearest_boxes(boxes: OrientedBoxes, row: int, candidates: Indices, count: int) -> tuple[Indices, Array]:
    """Returns the rows of the nearest boxes to one box and their gaps, the nearest first.

    Overlapping boxes are equally near; among equals the nearer center comes first, then the lower row. The bounds along
    the axes of the world give a lower bound of each gap, so that exact gaps are computed for the nearest few only.

    Args:
        row: the box to start from.
        candidates: rows of the boxes that may be returned.
        count: the largest number of rows to return.
    """
    if not len(candidates) or count < 1:
        return np.zeros(0, dtype=np.intp), np.zeros(0)
    low, high = boxes.bounds()
    apart = np.maximum(low[candidates] - high[row], low[row] - high[candidates])
    bound = np.linalg.norm(np.maximum(apart, 0.0), axis=1)
    order = np.argsort(bound, kind="stable")
    candidates, bound = candidates[order], bound[order]
    tested = min(len(candidates), 2 * count + 16)
    gaps = box_gaps(boxes, np.full(tested, row), candidates[:tested])
    reached = np.sort(np.maximum(gaps, 0.0))[min(count, tested) - 1]
    more = int(np.searchsorted(bound, reached + _TOLERANCE, side="right"))
    if more > tested:
        gaps = np.concatenate([gaps, box_gaps(boxes, np.full(more - tested, row), candidates[tested:more])])
        tested = more
    candidates = candidates[:tested]
    apart = np.linalg.norm(boxes.center[candidates] - boxes.center[row], axis=1)
    best = np.lexsort((candidates, apart.round(9), np.maximum(gaps, 0.0).round(9)))[:count]
    return candidates[best], gaps[best]


# -- directions --------------------------------------------------------------------------------------------------------


class Direction(StrEnum):
    """A horizontal direction from a reference body, in a reference frame."""

    FRONT = "front"
    LEFT = "left"
    BEHIND = "behind"
    RIGHT = "right"


_AXIS_ANGLE = {Direction.FRONT: 0.0, Direction.LEFT: np.pi / 2, Direction.BEHIND: np.pi, Direction.RIGHT: -np.pi / 2}


def directions(offsets: Array, headings: Array) -> dict[Direction, tuple[NDArray[np.bool_], Array]]:
    """Returns, for each direction, which offsets have it, and their deviation from its axis.

    Args:
        offsets: n x 2, from the reference point to the other one [m]; a zero offset has no direction.
        headings: n, or a scalar: the angle of the front of the frame about z [rad].

    Returns:
        A mask of length n, and angles of length n [rad], from 0 on the axis to pi/4 at the border.
    """
    angle = np.arctan2(offsets[:, 1], offsets[:, 0]) - headings
    apart = np.linalg.norm(offsets, axis=1) > _TOLERANCE
    found = {}
    for direction, axis in _AXIS_ANGLE.items():
        deviation = np.abs((angle - axis + np.pi) % (2 * np.pi) - np.pi)
        found[direction] = (apart & (deviation <= np.pi / 4 + _TOLERANCE), deviation)
    return found


# -- betweenness -------------------------------------------------------------------------------------------------------


def betweenness(boxes: OrientedBoxes, one: int, other: int, rows: Indices) -> tuple[Array, Array]:
    """Returns how far each box is between two others, seen from above.

    Returns:
        The fraction of each footprint that is within the convex hull of the footprints of both, and the larger fraction
        that is within one of the two. A footprint without area counts by its center.
    """
    ends = footprints(boxes.rows(np.array([one, other])))
    hull = _convex_polygon(ends.reshape(-1, 2))
    low, high = (side[rows, :2] for side in boxes.bounds())
    near = np.flatnonzero(np.all((low <= hull.max(axis=0)) & (high >= hull.min(axis=0)), axis=1))
    prints = footprints(boxes.rows(rows[near]))
    share, hidden = np.zeros((2, len(rows)))
    share[near] = _fraction_within(prints, hull)
    hidden[near] = np.maximum(*(_fraction_within(prints, end) for end in ends))
    return share, hidden


def _fraction_within(polygons: Array, convex: Array) -> Array:
    """The fraction of each polygon's area within a convex polygon."""
    area = polygon_areas(polygons)
    clipped = polygons
    inside = np.ones(len(polygons), dtype=bool)
    middle = polygons.mean(axis=1)
    for at in range(len(convex)):
        start, end = convex[at], convex[(at + 1) % len(convex)]
        if np.linalg.norm(end - start) <= _TOLERANCE:
            continue
        inside &= (end[0] - start[0]) * (middle[:, 1] - start[1]) >= (end[1] - start[1]) * (middle[:, 0] - start[0])
        clipped = clip_polygons(clipped, np.tile(start, (len(polygons), 1)), np.tile(end, (len(polygons), 1)))
    extended = area > 1e-12
    share = np.divide(polygon_areas(clipped), area, out=np.zeros(len(area)), where=extended)
    return np.asarray(np.where(extended, share.clip(0.0, 1.0), inside & (polygon_areas(convex[None])[0] > 1e-12)))


def _convex_polygon(points: Array) -> Array:
    """The convex hull of points, counterclockwise (Andrew's monotone chain, 1979)."""
    ordered = sorted({(round(x, 12), round(y, 12)) for x, y in points.tolist()})
    if len(ordered) < 3:
        return np.array(ordered)

    def chain(walk: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
        kept: list[tuple[float, float]] = []
        for x, y in walk:
            while len(kept) > 1 and (kept[-1][0] - kept[-2][0]) * (y - kept[-2][1]) <= (kept[-1][1] - kept[-2][1]) * (
                x - kept[-2][0]
            ):
                kept.pop()
            kept.append((x, y))
        return kept[:-1]

    return np.array(chain(ordered) + chain(ordered[::-1]))
