"""Parts: how deep the solids of different bodies stand in one another, in bulk.

Two convex solids are apart if along any axis their shadows are. For boxes fifteen axes settle it; round ones and hulls
are held against those and a few of their own, which may find them a little deeper than they are, never less deep.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mindstage.engines.solids import MAX_HULL_FACES, SHAPE_TYPES, CompiledGeometry
from mindstage.world import CollisionShapeType
from mindstage.world.boxes import Indices, OrientedBoxes, penetration_depths
from mindstage.world.geometry import Array, pose_multiply

__all__ = ["CollisionShapeBatch"]

_BOX, _SPHERE, _CYLINDER, _HULL = (
    SHAPE_TYPES.index(kind)
    for kind in (
        CollisionShapeType.BOX,
        CollisionShapeType.SPHERE,
        CollisionShapeType.CYLINDER,
        CollisionShapeType.HULL,
    )
)
_CHUNK_SIZE = 1 << 14
"""So many pairs are looked at in one go; it bounds the memory."""
_MAX_SHAPE_PAIRS = 1 << 18
"""So many pairs of solids are looked at in all; bodies beyond that are as deep in one another as their boxes are."""


@dataclass(frozen=True, slots=True, eq=False)
class CollisionShapeBatch:
    """The solids of n bodies as they stand."""

    boxes: OrientedBoxes
    """Round each of the solids."""
    types: NDArray[np.intp]
    first_shape: Indices
    """n + 1: where each body's solids begin."""
    hulls: dict[int, tuple[Array, Array]]
    """Of those that are hulls: their corners and the normals of their faces, in the world."""

    @classmethod
    def from_compiled(cls, poses: Array, compiled: Sequence[CompiledGeometry]) -> CollisionShapeBatch:
        """From the bodies' poses (n x 7) and what each is made of."""
        counts = np.array([len(each.shapes) for each in compiled], dtype=np.intp)
        first = np.concatenate([[0], np.cumsum(counts)]).astype(np.intp)
        local = np.concatenate([each.poses for each in compiled] or [np.zeros((0, 7))])
        sizes = np.concatenate([each.sizes for each in compiled] or [np.zeros((0, 3))])
        kinds = np.concatenate([each.types for each in compiled] or [np.zeros(0, dtype=np.intp)])
        boxes = OrientedBoxes.from_poses(pose_multiply(np.repeat(poses, counts, axis=0), local), sizes)
        hulls = {}
        for begin, each in zip(first.tolist(), compiled, strict=False):
            for row, corners, directions in each.hulls:
                turn = boxes.rotation[begin + row].T
                hulls[begin + row] = (corners @ turn + boxes.center[begin + row], directions @ turn)
        return cls(boxes, kinds, first, hulls)

    def penetration_depths(self, a: Indices, b: Indices, fallback: Array) -> Array:
        """How deep the bodies of each pair stand in one another: as deep as their deepest solids do [m].

        Args:
            a: numbers of bodies.
            b: the same.
            otherwise: what to say of pairs of so many solids that looking at all of them would take too long.
        """
        count_a, count_b = (self.first_shape[each + 1] - self.first_shape[each] for each in (a, b))
        products = count_a * count_b
        order = np.argsort(products, kind="stable")
        looked_at = np.zeros(len(a), dtype=bool)
        looked_at[order] = np.cumsum(products[order]) <= _MAX_SHAPE_PAIRS
        deepest = np.where(looked_at, -np.inf, fallback)
        rows = np.flatnonzero(looked_at)
        pair = np.repeat(rows, products[rows])
        step = np.arange(len(pair)) - np.repeat(np.cumsum(products[rows]) - products[rows], products[rows])
        i, j = self.first_shape[a[pair]] + step // count_b[pair], self.first_shape[b[pair]] + step % count_b[pair]
        low, high = self.boxes.bounds()
        meet = np.all((low[i] <= high[j]) & (low[j] <= high[i]), axis=1)
        pair, i, j = pair[meet], i[meet], j[meet]
        for start in range(0, len(pair), _CHUNK_SIZE):
            piece = slice(start, start + _CHUNK_SIZE)
            np.maximum.at(deepest, pair[piece], self._shape_depths(i[piece], j[piece]))
        return deepest

    def _shape_depths(self, i: Indices, j: Indices) -> Array:
        found = penetration_depths(self.boxes, i, j)
        others = np.flatnonzero((found > 0.0) & ((self.types[i] != _BOX) | (self.types[j] != _BOX)))
        if len(others):
            found[others] = np.minimum(found[others], self._projection_depths(i[others], j[others]))
        return found

    def _projection_depths(self, i: Indices, j: Indices) -> Array:
        """The least overlap of the shadows along the axes of both, between both, and of the faces of hulls."""
        boxes = self.boxes
        between = boxes.center[j] - boxes.center[i]
        axes = [np.swapaxes(boxes.rotation[i], 1, 2), np.swapaxes(boxes.rotation[j], 1, 2), between[:, None]]
        axes += [self._perpendicular_axis(each, between)[:, None] for each in (i, j)]
        if self.hulls:
            axes += [self._normals(i), self._normals(j)]
        every = np.concatenate(axes, axis=1)
        length = np.linalg.norm(every, axis=2, keepdims=True)
        none = length[..., 0] < 1e-9
        every = np.divide(every, length, out=np.zeros_like(every), where=length >= 1e-9)
        (low_i, high_i), (low_j, high_j) = self._projections(i, every), self._projections(j, every)
        overlap = np.minimum(high_i - low_j, high_j - low_i)
        overlap[none] = np.inf
        return np.asarray(overlap.min(axis=1))

    def _perpendicular_axis(self, rows: Indices, between: Array) -> Array:
        """The way between two middles without what of it goes along the axis of a cylinder."""
        axis = self.boxes.rotation[rows][:, :, 2]
        return np.asarray(between - np.einsum("pi,pi->p", between, axis)[:, None] * axis)

    def _normals(self, rows: Indices) -> Array:
        out = np.zeros((len(rows), MAX_HULL_FACES, 3))
        for row in set(rows.tolist()) & self.hulls.keys():
            normals = self.hulls[row][1]
            out[rows == row, : len(normals)] = normals
        return out

    def _projections(self, rows: Indices, axes: Array) -> tuple[Array, Array]:
        """From where to where the solids reach along axes, p x k x 3."""
        boxes = self.boxes
        along = np.einsum("pki,pij->pkj", axes, boxes.rotation[rows]) * boxes.half_extents[rows][:, None]
        kinds = self.types[rows][:, None]
        flat = np.abs(along)
        level = np.linalg.norm(along[..., :2], axis=2)
        reach = np.where(kinds == _SPHERE, np.linalg.norm(along, axis=2), flat.sum(axis=2))
        reach = np.where(kinds == _CYLINDER, level + flat[..., 2], reach)
        middle = np.einsum("pki,pi->pk", axes, boxes.center[rows])
        low, high = middle - reach, middle + reach
        for row in set(rows.tolist()) & self.hulls.keys():
            mine = rows == row
            shadow = np.einsum("pki,ni->pkn", axes[mine], self.hulls[row][0])
            low[mine], high[mine] = shadow.min(axis=2), shadow.max(axis=2)
        return low, high
