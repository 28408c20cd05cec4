"""Boxes: oriented ones in bulk: which of them meet, how deep they stand in one another, and which holds which.

Candidates come from a sweep along the axis on which the boxes are spread most, so that the cost follows the number of
boxes and of real neighbors, not its square; the depth is exact (separating axes), and all of it is vectorized.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mindstage.world.geometry import Array, cross, rotation_matrix
from mindstage.world.values import Vector

__all__ = ["Indices", "OrientedBoxes", "contains", "face_coverage", "overlapping_pairs", "penetration_depths"]

Indices = NDArray[np.intp]

_CHUNK_SIZE = 1 << 20
"""So many candidate pairs are looked at in one go; it bounds the memory."""


@dataclass(frozen=True, slots=True)
class OrientedBoxes:
    """n oriented boxes."""

    center: Array
    """n x 3 [m]."""
    rotation: Array
    """n x 3 x 3, the boxes' axes in columns."""
    half_extents: Array
    """n x 3, half the extents along the boxes' own axes [m]."""

    @classmethod
    def from_poses(cls, poses: Array, sizes: Array) -> OrientedBoxes:
        """From n x 7 poses with unit quaternions and n x 3 sizes."""
        return cls(poses[:, :3], rotation_matrix(poses[:, 3:]), sizes / 2)

    def bounds(self) -> tuple[Array, Array]:
        """The lower and upper corners of the upright boxes around them, each n x 3."""
        reach = np.einsum("nij,nj->ni", np.abs(self.rotation), self.half_extents)
        return self.center - reach, self.center + reach


def overlapping_pairs(
    boxes: OrientedBoxes,
    first_mask: NDArray[np.bool_],
    second_mask: NDArray[np.bool_],
    *,
    margin: Vector = (0.0, 0.0, 0.0),
) -> Iterator[tuple[Indices, Indices]]:
    """Pairs whose upright boxes meet, each once, in chunks; one of the two is `wanted` and one is `other`.

    Args:
        boxes: all of them.
        wanted: for each box, whether it is looked for.
        other: for each box, whether it counts as a neighbor.
        within: a gap of so much along the world's axes still counts as meeting [m].
    """
    low, high = boxes.bounds()
    high = high + np.asarray(margin)
    if len(low) < 2:
        return
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


def penetration_depths(boxes: OrientedBoxes, a: Indices, b: Indices) -> Array:
    """How far each pair would have to move apart [m]; negative for a gap.

    The least overlap over the fifteen axes that can separate two boxes (Gottschalk, Lin, Manocha 1996).
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
    """Whether the outer box holds the inner one, pair by pair.

    Args:
        boxes: all of them.
        outer: indices of the holding boxes.
        inner: indices of the held ones.
        share: how much of the inner box must be inside along each axis of the outer one; 1 is all of it.
    """
    turn = np.swapaxes(boxes.rotation[outer], 1, 2)
    offset = np.abs(np.einsum("pij,pj->pi", turn, boxes.center[inner] - boxes.center[outer]))
    reach = np.einsum("pij,pj->pi", np.abs(turn @ boxes.rotation[inner]), boxes.half_extents[inner])
    inside = np.minimum(offset + reach, boxes.half_extents[outer]) - np.maximum(
        offset - reach, -boxes.half_extents[outer]
    )
    return np.asarray(np.all(inside >= min_fraction * 2 * reach - 1e-9, axis=1))


def face_coverage(boxes: OrientedBoxes, cover: int, targets: Indices, *, tolerance: float = 0.005) -> Array:
    """How much of a side of other boxes one box covers, as a door does: 1 is all of it, 0 that it is elsewhere.

    Args:
        boxes: all of them.
        front: the index of the one that covers.
        things: indices of those that may be covered.
        reach: a gap of so much still counts as touching [m].
    """
    turn = np.swapaxes(boxes.rotation[targets], 1, 2)
    offset = np.abs(np.einsum("pij,pj->pi", turn, boxes.center[cover] - boxes.center[targets]))
    half = np.einsum("pij,j->pi", np.abs(turn @ boxes.rotation[cover]), boxes.half_extents[cover])
    both = np.minimum(offset + half, boxes.half_extents[targets]) - np.maximum(
        offset - half, -boxes.half_extents[targets]
    )
    shares = np.sort(both.clip(0.0) / np.maximum(2 * boxes.half_extents[targets], 1e-9), axis=1)
    return np.asarray(np.where(np.all(both >= -tolerance, axis=1), shares[:, 1] * shares[:, 2], 0.0))
