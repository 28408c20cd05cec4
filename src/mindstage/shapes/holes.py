"""Holes: what is left of a plate where there are openings in it."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from mindstage.world.geometry import Array

__all__ = ["Hole", "grid_cells", "merge_narrow_strips"]

Hole = tuple[Array, Array]
"""Its lower and its upper corner, across the plate."""

_MIN_FILL = 0.6
"""So much of the rectangle round two holes that meet they must fill to become one."""


def grid_cells(low: Array, high: Array, holes: Sequence[Hole]) -> tuple[tuple[Array, Array], NDArray[np.bool_]]:
    """A plate divided where its holes begin and end, and which cells are left of it."""
    cuts = []
    for axis in range(2):
        marks = _each_once([low[axis], high[axis], *(corner[axis] for hole in holes for corner in hole)])
        inner = marks[(marks > low[axis] + 1e-4) & (marks < high[axis] - 1e-4)]
        inner = inner[np.diff(inner, prepend=-np.inf) > 1e-6]
        cuts.append(np.array([low[axis], *inner, high[axis]]))
    x, y = ((cut[:-1] + cut[1:]) / 2 for cut in cuts)
    kept = np.ones((len(x), len(y)), dtype=bool)
    for start, end in holes:
        kept &= ~(((x > start[0]) & (x < end[0]))[:, None] & ((y > start[1]) & (y < end[1]))[None])
    return (cuts[0], cuts[1]), kept


def merge_narrow_strips(low: Array, high: Array, holes: Sequence[Hole], min_width: float) -> list[Hole]:
    """Holes that are widened so that hardly any strip between their edges is narrower than asked.

    Nothing can stand on such strips, none is worth a look, and every one costs an engine a part to look at.

    Args:
        low: the plate's lower corner, across it [m].
        high: its upper corner.
        holes: what is free.
        least: how wide strips should be [m].
    """
    starts, ends = (np.array([hole[end] for hole in holes]).reshape(-1, 2) for end in (0, 1))
    for axis in range(2):
        marks = _each_once([low[axis], high[axis], *starts[:, axis], *ends[:, axis]])
        first, last = _merge_marks(marks, min_width)
        starts[:, axis] = first[np.searchsorted(marks, starts[:, axis])]
        ends[:, axis] = last[np.searchsorted(marks, ends[:, axis])]
    return _merge_holes(list(zip(starts, ends, strict=True)))


def _each_once(marks: Sequence[float]) -> Array:
    """The same numbers in order, each once: `numpy.unique` for few of them, which needs no `numpy.ma`."""
    return np.array(sorted(set(marks)))


def _merge_marks(marks: Array, min_width: float) -> tuple[Array, Array]:
    """For each mark the first and the last of those so near each other that they are taken as one."""
    first, last = marks.copy(), marks.copy()
    begin = 0
    for index in range(1, len(marks) + 1):
        if index == len(marks) or marks[index] - marks[begin] >= min_width:
            first[begin:index], last[begin:index] = marks[begin], marks[index - 1]
            begin = index
    return first, last


def _merge_holes(holes: list[Hole]) -> list[Hole]:
    """The same holes, those that meet as one where they fill most of the rectangle round them."""
    for one, other in combinations(range(len(holes)), 2):
        (low_a, high_a), (low_b, high_b) = holes[one], holes[other]
        common = np.minimum(high_a, high_b) - np.maximum(low_a, low_b)
        low, high = np.minimum(low_a, low_b), np.maximum(high_a, high_b)
        fills = np.prod(high_a - low_a) + np.prod(high_b - low_b) - np.prod(np.maximum(common, 0.0))
        if common.min() >= 0.0 and fills >= _MIN_FILL * np.prod(high - low):
            rest = [hole for number, hole in enumerate(holes) if number not in (one, other)]
            return _merge_holes([*rest, (low, high)])
    return holes
