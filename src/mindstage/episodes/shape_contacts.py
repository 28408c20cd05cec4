"""Contacts, supports and containment as geometry shows them, where no engine has reported contacts.

Bodies touch whose collision shapes are closer than a threshold; the direction of the gap is that of the separating axis
(Gottschalk, Lin, Manocha 1996), which for a body that rests on a surface is the normal of the surface. Only pairs with
a body that has moved are computed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mindstage.engines.base import PoseArray
from mindstage.episodes.tracking import BodyTable
from mindstage.scene import GeometryMap
from mindstage.scene.bounding_boxes import Indices, OrientedBoxes, contains, overlapping_pairs
from mindstage.scene.collision_shapes import (
    CollisionShapeBatch,
    CompiledGeometry,
    compile_geometry,
    fallback_collision_shape,
)
from mindstage.scene.transforms import Array, rotation_matrix

__all__ = ["GapPairs", "ShapeContacts"]


class GapPairs(NamedTuple):
    """The gaps of m pairs of bodies."""

    a: Indices
    b: Indices
    gap: Array
    """Smallest distance [m], negative if they overlap. Of shapes apart from each other it may be too small, by the
    part that is along no separating axis."""
    normal: Array
    """m x 3: from `a` to `b`, at the nearest shapes."""
    a_below: Array
    """Largest vertical part of the normals from `a` to `b` of the shapes that are near each other; -1 without any."""
    b_below: Array
    """The same from `b` to `a`."""


class ShapeContacts:
    """Finds pairs of near bodies from their shapes."""

    def __init__(self, geometry: GeometryMap, *, margin_m: float, max_depth_m: float) -> None:
        """Takes the geometry of the bodies.

        Args:
            geometry: the geometry of the bodies; a body without an entry is its primitive shape.
            margin_m: the largest gap of a pair that is found [m].
            max_depth_m: shapes that overlap by more are left out [m].
        """
        self._geometry = geometry
        self._margin_m = margin_m
        self._max_depth_m = max_depth_m
        self._table: BodyTable | None = None
        self._compiled: list[CompiledGeometry | None] = []
        self._poses = np.zeros((0, 7))
        self._rotation = np.zeros((0, 3, 3))
        self._low = np.zeros((0, 3))
        self._high = np.zeros((0, 3))
        self._neighbors: list[set[int]] = []
        self._listed_low = np.zeros((0, 3))
        """The bounds for which the neighbors of a body were found; NaN if they were not."""
        self._listed_high = np.zeros((0, 3))
        self._volume = np.zeros(0)
        self._centers = np.zeros((0, 3))
        self._reach = np.zeros((0, 3))

    def set_bodies(self, table: BodyTable, poses: PoseArray) -> None:
        """Replaces the bodies; those of the same structure keep their shapes."""
        shapes: list[CompiledGeometry | None] = []
        by_id = {body.id: body for body in table.structure.bodies}
        for id in table.ids:
            body, known = by_id[id], self._geometry.get(id)
            if known is not None and known.collision_shapes:
                shapes.append(compile_geometry(known.collision_shapes))
            elif known is None and body.size is not None:
                shapes.append(compile_geometry((fallback_collision_shape(body, body.size),)))
            else:
                shapes.append(None)
        self._table, self._compiled = table, [each if each is not None and each.shapes else None for each in shapes]
        low = np.array([np.zeros(3) if each is None else each.bounds[0] for each in self._compiled]).reshape(-1, 3)
        high = np.array([np.zeros(3) if each is None else each.bounds[1] for each in self._compiled]).reshape(-1, 3)
        self._centers, self._reach = (low + high) / 2, (high - low) / 2
        self._poses = np.full_like(poses, np.nan)
        self._rotation, self._low, self._high = np.zeros((len(poses), 3, 3)), low, high
        self._neighbors = [set() for _ in range(len(poses))]
        self._listed_low, self._listed_high = np.full_like(low, np.nan), np.full_like(high, np.nan)
        self._volume = np.prod(table.sizes, axis=1)
        self.move(np.arange(len(poses)), poses)

    def move(self, rows: Indices, poses: PoseArray) -> None:
        """Updates the bounds of bodies that have moved."""
        if not len(rows):
            return
        self._poses[rows] = poses[rows]
        rotation = rotation_matrix(poses[rows, 3:])
        self._rotation[rows] = rotation
        center = poses[rows, :3] + np.einsum("nij,nj->ni", rotation, self._centers[rows])
        reach = np.einsum("nij,nj->ni", np.abs(rotation), self._reach[rows])
        # Containment is a relation of the bounding boxes in the map, which may be larger than the shapes.
        assert self._table is not None
        box = np.einsum("nij,nj->ni", np.abs(rotation), self._table.sizes[rows] / 2)
        self._low[rows] = np.minimum(center - reach, poses[rows, :3] - box)
        self._high[rows] = np.maximum(center + reach, poses[rows, :3] + box)

    def near(self, rows: Indices) -> tuple[Indices, Indices]:
        """The pairs of a body of `rows` and another body with overlapping bounds, each once.

        The neighbors of a body within `_NEIGHBOR_M` are kept until it has moved by half of that.
        """
        shift = np.maximum(
            np.abs(self._low[rows] - self._listed_low[rows]), np.abs(self._high[rows] - self._listed_high[rows])
        )
        stale = rows[~(shift.max(axis=1, initial=0.0) <= _NEIGHBOR_M / 2)]
        if len(stale):
            self._list_neighbors(stale)
        lists = [self._neighbors[row] for row in rows.tolist()]
        a = np.repeat(rows, [len(each) for each in lists])
        b = np.fromiter((other for each in lists for other in each), dtype=np.intp, count=len(a))
        is_row = np.zeros(len(self._poses), dtype=bool)
        is_row[rows] = True
        kept = ~(is_row[b] & (b < a))
        kept &= np.all(
            (self._low[a] - self._margin_m <= self._high[b]) & (self._low[b] - self._margin_m <= self._high[a]), axis=1
        )
        return a[kept], b[kept]

    def _list_neighbors(self, rows: Indices) -> None:
        """Finds the neighbors of some bodies."""
        low, high = self._low - _NEIGHBOR_M, self._high + _NEIGHBOR_M
        for row in rows.tolist():
            self._neighbors[row] = set()
        if len(rows) > _MAX_BROAD_ROWS:
            mask = np.zeros(len(self._poses), dtype=bool)
            mask[rows] = True
            unturned = np.broadcast_to(np.eye(3), (len(low), 3, 3))
            boxes = OrientedBoxes((low + high) / 2, unturned, (high - low) / 2)
            for a, b in overlapping_pairs(boxes, mask, np.ones_like(mask)):
                for one, other in zip(a.tolist(), b.tolist(), strict=True):
                    self._neighbors[one].add(other)
                    self._neighbors[other].add(one)
        else:
            for row in rows.tolist():
                x = np.flatnonzero((low[:, 0] <= high[row, 0]) & (high[:, 0] >= low[row, 0]))
                meet = (low[x] <= high[row]) & (high[x] >= low[row])
                found = x[meet[:, 1] & meet[:, 2]].tolist()
                self._neighbors[row].update(found)
                self._neighbors[row].discard(row)
                for other in found:
                    if other != row:
                        self._neighbors[other].add(row)
        self._listed_low[rows], self._listed_high[rows] = self._low[rows], self._high[rows]

    def has_shapes(self, *rows: int) -> bool:
        """Whether the shapes of all these bodies are known."""
        return all(self._compiled[row] is not None for row in rows)

    def gaps(self, a: Indices, b: Indices, *, deeper: Array) -> GapPairs:
        """The gaps of pairs of bodies; pairs that are farther apart than the margin are left out.

        Args:
            a: rows of the first bodies.
            b: rows of the second bodies.
            deeper: for each body, by how much deeper it may be in another one, since it moves fast [m].
        """
        if not len(a):
            return GapPairs(a, b, np.zeros(0), np.zeros((0, 3)), np.zeros(0), np.zeros(0))
        known = np.array([self._compiled[i] is not None and self._compiled[j] is not None
                          for i, j in zip(a.tolist(), b.tolist(), strict=True)], dtype=bool)  # fmt: skip
        a, b = a[known], b[known]
        rows, inverse = np.unique(np.concatenate([a, b]), return_inverse=True)
        compiled = [each for row in rows.tolist() if (each := self._compiled[row]) is not None]
        batch = CollisionShapeBatch.from_compiled(self._poses[rows], compiled)
        first, second = inverse[: len(a)], inverse[len(a) :]
        count_a = batch.first_shape[first + 1] - batch.first_shape[first]
        count_b = batch.first_shape[second + 1] - batch.first_shape[second]
        products = count_a * count_b
        pair = np.repeat(np.arange(len(a)), products)
        step = np.arange(len(pair)) - np.repeat(np.cumsum(products) - products, products)
        i = batch.first_shape[first[pair]] + step // count_b[pair]
        j = batch.first_shape[second[pair]] + step % count_b[pair]
        low, high = batch.boxes.bounds()
        meet = np.all((low[i] - self._margin_m <= high[j]) & (low[j] - self._margin_m <= high[i]), axis=1)
        pair, i, j = pair[meet], i[meet], j[meet]
        gap = np.full(len(a), np.inf)
        a_below, b_below, normal = np.full(len(a), -1.0), np.full(len(a), -1.0), np.zeros((len(a), 3))
        if len(pair):
            distances, directions = batch.separations(i, j, np.zeros((len(i), 3)))
            best = np.argmin(distances, axis=1)
            each = np.arange(len(i))
            depth, away = distances[each, best], -directions[each, best]  # the direction moves the first one away
            counts = depth <= self._max_depth_m + (deeper[a] + deeper[b])[pair]
            pair, depth, away = pair[counts], depth[counts], away[counts]
            up = away[:, 2]
            order = np.argsort(depth, kind="stable")
            gap[pair[order]], normal[pair[order]] = -depth[order], away[order]  # the last assignment wins
            near = -depth <= self._margin_m
            np.maximum.at(a_below, pair[near], up[near])
            np.maximum.at(b_below, pair[near], -up[near])
        found = gap <= self._margin_m
        return GapPairs(a[found], b[found], gap[found], normal[found], a_below[found], b_below[found])

    def contained(self, a: Indices, b: Indices, *, min_fraction: float) -> tuple[Indices, Indices]:
        """The pairs (outer, inner) of which one box contains the other, in the rule of `scene.spatial`."""
        assert self._table is not None
        sizes, volume = self._table.sizes, self._volume
        larger = volume[a] > volume[b]
        outer, inner = np.where(larger, a, b), np.where(larger, b, a)
        differ = (volume[a] != volume[b]) & np.all(sizes[a] > 0.0, axis=1) & np.all(sizes[b] > 0.0, axis=1)
        outer, inner = outer[differ], inner[differ]
        boxes = OrientedBoxes(self._poses[:, :3], self._rotation, sizes / 2)
        holds = contains(boxes, outer, inner, min_fraction=min_fraction)
        return outer[holds], inner[holds]


_NEIGHBOR_M = 0.1
"""Gap within which bodies are neighbors [m]."""
_MAX_BROAD_ROWS = 512
"""The bounds of more bodies are compared by a sweep, which costs the same for any number of them."""
