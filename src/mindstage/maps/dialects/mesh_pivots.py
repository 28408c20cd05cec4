"""Where the origins of meshes are in their boxes, by evidence over a whole map.

Unreal logs the origin of a mesh, which is where its author put it: in the middle, at the foot, at a hinge. All bodies
of a class have the same mesh. For each class, the center and the sides of its box are tried as origins along each axis.
They are compared by how well bodies are then held by what is below them, around them, or what they are parts of, and by
how far they are in each other. Without a clear difference the origin counts as the center.

The largest classes are decided first. What is not decided yet counts at the height that fits best.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mindstage.scene.bounding_boxes import Indices, OrientedBoxes, overlapping_pairs
from mindstage.scene.transforms import Array

__all__ = ["PivotChoice", "find_pivots"]

_SIDES = np.array(sorted(product((0.0, 1.0, -1.0), repeat=3), key=lambda sides: sum(map(abs, sides))))
"""Centers of boxes relative to origins, in half extents; the first one is the center."""
_AT_CENTER = np.zeros(len(_SIDES), dtype=np.intp)
_AT_SIDE_CENTER = np.argmax((_SIDES * (1.0, 1.0, 0.0) == 0.0).all(axis=1) & (_SIDES[:, 2] == _SIDES[:, 2:]), axis=1)
"""For each of them, the one at the same height that is not beside the center."""
_MAX_PASSES, _MAX_PASSES_OF_MANY, _MANY_PAIRS = 5, 2, 150_000
"""Number of passes, and for maps with many pairs of neighbors."""
_MAX_LEVELS = 48
"""Number of groups of classes of similar size; those of a group are decided at once, the largest ones alone."""
_MAX_EVALUATED_PAIRS = 8_000_000
"""Number of pairs of bodies that are evaluated for all groups of a pass."""
_MAX_NEIGHBORS = 32
"""Number of neighbors of a body that are looked at, the largest ones."""
_LEVEL_COSINE = 0.999
"""A body counts if one of its axes is this vertical: one that leans or has been thrown says nothing."""
_SMALL_M, _CONTACT_SHARE, _MIN_CONTACT_M, _MAX_CONTACT_M = 0.05, 0.2, 0.002, 0.02
"""A gap up to this share of what a half extent is more than small, within these limits, is a contact [m]."""
_THIN_M = 0.004
"""Half extents below this do not matter for that [m]."""
_BELOW, _PART, _ABOVE, _BESIDE, _AROUND = 1.0, 1.0, 0.35, 0.3, 0.3
"""How well a body is held by what is below it, what it is a part of, what is above, beside and around it."""
_COVERED = 0.75
"""How much of that is the share of the side that is covered; the rest is that its middle is."""
_ON_SHELL = 0.5
"""How much less it says that something stands on what may be the walls of a room."""
_INSIDE = 0.9
"""A box is in another one if this share of its extent is, along each axis."""
_PANEL_M, _PANEL_OFFSET_M = 0.05, 0.01
"""Panels up to this thickness, such as a poster and its frame, are in each other up to this offset [m]."""
_SUNK_SHARE = 0.5
"""A box that is in another one by this share of the smaller extent is as wrong as one that nothing holds."""
_SUNK, _SUNK_PART, _TOGETHER = 0.5, 0.25, 0.2
"""Evidence against boxes that are partly in each other, those of parts and wholes, and for boxes that are wholly."""
_PRIOR, _PRIOR_PER_BODY, _AXIS_PRIOR = 0.15, 0.04, np.array([3.0, 3.0, 1.0])
"""Evidence from which another origin than the center counts, times those for each axis."""
_TIE, _TIE_PER_BODY = 0.1, 0.02
"""Difference of evidence, and for each body, up to which two origins fit equally well."""
_MIN_BETTER, _MIN_HELD_BETTER, _MIN_HELD_BETTER_BESIDE = 0.45, 0.3, 0.5
"""Per body, how much less wrong and better held bodies have to be than at the center: both of these, or ..."""
_MIN_ONLY_HELD, _MIN_ONLY_HELD_PER_BODY = 0.72, 0.2
"""... how much better held, or ..."""
_MIN_OTHERS, _MIN_OTHERS_PER_BODY, _MIN_OTHERS_SHARE = 0.9, 0.3, 0.25
"""... how much better others are held by them, also as a share of those that are anyway."""
_MAX_WORSE = 0.1
"""Per body, how much more wrong bodies may be than at the center."""
_SAME_FOOTPRINT = 0.01
"""Relative difference of extents up to which two footprints are the same."""


class PivotChoice(NamedTuple):
    """The origin of the mesh of a class."""

    sides: Array
    """Center of the box relative to the origin, in half extents along the axes of the body: 1 in z is a foot."""
    margin: float
    """Difference of the evidence from that of the center; 1 is one body that is held instead of none."""
    holds_others: bool
    """Whether others are then better held by its bodies; otherwise these are better held."""
    tied: tuple[int, ...] = ()
    """Axes along which opposite origins fit better than the center, but equally well; the center is kept."""


def find_pivots(boxes: OrientedBoxes, classes: Indices, links: Indices) -> list[PivotChoice]:
    """Finds the origin of the mesh of each class.

    The time is linear in the number of bodies, if each overlaps a limited number of others.

    Args:
        boxes: the boxes of n bodies, with origins of meshes in place of centers.
        classes: the number of each body's class, n; negative for bodies whose origin is the center.
        links: rows of parts or moved bodies and of what they belong to, m x 2, the whole first.
    """
    number = int(classes.max(initial=-1)) + 1
    return _PivotSolver(boxes, classes, links).choices() if number else []


@dataclass(frozen=True, slots=True)
class _Pairs:
    """Neighbors, as seen from bodies a."""

    a: Indices
    b: Indices
    is_part: NDArray[np.bool_]
    """Whether a is a part of b, or moves relative to it."""
    is_whole: NDArray[np.bool_]
    """Whether b is a part of a."""
    frame: Array
    """The axes of the larger body, as columns."""
    can_contain_a: NDArray[np.bool_]
    can_contain_b: NDArray[np.bool_]
    """Whether b, and a, can be a container: what is as large as a room is none."""
    half_a: Array
    half_b: Array
    """Half extents along these axes [m]."""
    up: Array
    """The vertical in this frame."""

    @property
    def shells(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Whether b is larger than a in all directions, as a room is, and the other way round."""
        return (
            ~self.can_contain_a & (self.half_b.min(axis=1) > self.half_a.max(axis=1)),
            ~self.can_contain_b & (self.half_a.min(axis=1) > self.half_b.max(axis=1)),
        )

    def rows(self, kept: Indices) -> _Pairs:
        return _Pairs(*(getattr(self, name)[kept] for name in self.__slots__))


class _Evidence(NamedTuple):
    """What speaks for origins, classes x origins each."""

    total: Array
    held: Array
    """How well bodies of a class are held, summed."""
    wrong: Array
    """How many of them are not held at all, and how far they are in others."""
    others: Array
    """How much better bodies of other classes are held by them than by anything else."""


class _PivotSolver:
    def __init__(self, boxes: OrientedBoxes, classes: Indices, links: Indices) -> None:
        self.boxes, self.classes = boxes, classes
        count = int(classes.max()) + 1
        self.sides, self.margins = np.zeros((count, 3)), np.zeros(count)
        self.tied, self.holds_others = np.zeros((count, 3), dtype=bool), np.zeros(count, dtype=bool)
        self.is_open = np.append(np.ones(count, dtype=bool), False)
        """Whether the origin of each class has not been decided yet; the last one is that of bodies without a class."""
        self.centers = boxes.center.copy()
        self.pairs = self._neighbors(links)
        looked_at = self.pairs.a[np.diff(self.pairs.a, prepend=-1) != 0]
        self.counts = np.maximum(np.bincount(classes[looked_at][classes[looked_at] >= 0], minlength=count), 1)
        self.held = np.zeros(len(self.pairs.a))
        """How well b can hold a, for all pairs, if undecided origins are at the best height."""
        self._update_held(np.arange(len(self.pairs.a)))

    def _neighbors(self, links: Indices) -> _Pairs:
        boxes, classes = self.boxes, self.classes
        count = len(classes)
        volume = np.prod(boxes.half_extents, axis=1)
        is_level = np.abs(boxes.rotation[:, 2]).max(axis=1) > _LEVEL_COSINE
        reach = np.where(classes < 0, 1.0, 2.0)[:, None] * boxes.half_extents
        wide = OrientedBoxes(boxes.center, boxes.rotation, reach)
        found = [np.zeros((0, 2), dtype=np.intp), links]
        seen = np.zeros(count, dtype=np.intp)
        for pair in overlapping_pairs(wide, is_level & (classes >= 0), is_level, margin=(_MAX_CONTACT_M,) * 3):
            # In a heap, some of the neighbors of each body are enough.
            kept = np.logical_or(*(seen[ends] + _numbers_in_groups(ends) < 2 * _MAX_NEIGHBORS for ends in pair))
            both = np.stack(pair, axis=1)[kept]
            seen += np.bincount(both.ravel(), minlength=count)
            found.append(both)
        both = np.concatenate(found)
        both = np.concatenate([both, both[:, ::-1]])
        keys = both[:, 0] * count + both[:, 1]
        order = np.argsort(keys, kind="stable")
        order = order[np.diff(keys[order], prepend=-1) != 0]
        a, b = both[order].T
        is_part, is_whole = np.isin(keys[order], links @ [1, count]), np.isin(keys[order], links @ [count, 1])
        order = np.lexsort((-volume[b], ~(is_part | is_whole), a))
        a, b, is_part, is_whole = a[order], b[order], is_part[order], is_whole[order]
        kept = _numbers_in_groups(a) < _MAX_NEIGHBORS
        a, b, is_part, is_whole = a[kept], b[kept], is_part[kept], is_whole[kept]
        frame = boxes.rotation[np.where(volume[a] > volume[b], a, b)]
        to_frame = np.swapaxes(frame, 1, 2)
        half_a, half_b = (
            np.einsum("nij,nj->ni", np.abs(to_frame @ boxes.rotation[row]), boxes.half_extents[row]) for row in (a, b)
        )
        spread = np.median(np.abs(boxes.center - np.median(boxes.center, axis=0)), axis=0).max()
        is_container = np.sort(boxes.half_extents, axis=1)[:, 1] < spread
        return _Pairs(a, b, is_part, is_whole, frame, is_container[b], is_container[a], half_a, half_b, frame[:, 2])

    def choices(self) -> list[PivotChoice]:
        levels = self._levels()
        for _ in range(_MAX_PASSES if len(self.pairs.a) < _MANY_PAIRS else _MAX_PASSES_OF_MANY):
            before = self.sides.copy()
            for level in levels:
                self._decide(level)
            if np.array_equal(before, self.sides):
                break
        self.sides[self.tied] = 0.0
        self._align_footprints()
        tied = (tuple(np.flatnonzero(row).tolist()) for row in self.tied)
        return [
            PivotChoice(*each)
            for each in zip(self.sides, self.margins.tolist(), self.holds_others.tolist(), tied, strict=True)
        ]

    def _align_footprints(self) -> None:
        """Moves floors and walls over each other whose footprints have the same extents, to where more bodies are."""
        pairs, boxes, classes = self.pairs, self.boxes, self.classes
        large = ~pairs.can_contain_a & ~pairs.can_contain_b & (classes[pairs.a] >= 0) & (pairs.a < pairs.b)
        for at in np.flatnonzero(large & (classes[pairs.b] >= 0)).tolist():
            ends, flat = [int(pairs.a[at]), int(pairs.b[at])], np.abs(pairs.up[at]) < 0.5
            half = np.stack([pairs.half_a[at], pairs.half_b[at]])[:, flat]
            apart = pairs.frame[at].T @ (self.centers[ends[1]] - self.centers[ends[0]])
            same = np.abs(half[1] - half[0]) <= _SAME_FOOTPRINT * half.max(axis=0)
            if not (same.all() and (self.counts[classes[ends]] == 1).all()) or np.abs(apart[flat]).max() < _THIN_M:
                continue
            offsets = np.abs((boxes.center[:, None] - self.centers[ends]) @ pairs.frame[at])[:, :, flat]
            number = (offsets <= half).all(axis=2).sum(axis=0)
            moved = ends[int(number[0] >= number[1])]
            step = pairs.frame[at][:, flat] @ apart[flat] * (1.0 if moved == ends[0] else -1.0)
            self.centers[moved] += step
            self.sides[classes[moved]] += boxes.rotation[moved].T @ step / boxes.half_extents[moved]

    def _levels(self) -> list[Indices]:
        """Returns groups of classes, those with the largest boxes first."""
        number = len(self.sides)
        first = np.zeros(number, dtype=np.intp)
        rows = np.flatnonzero(self.classes >= 0)[::-1]
        first[self.classes[rows]] = rows
        order = np.argsort(-np.prod(self.boxes.half_extents[first], axis=1), kind="stable")
        most = int(np.clip(_MAX_EVALUATED_PAIRS // max(1, len(self.pairs.a)), 4, _MAX_LEVELS))
        first_ones, rest = np.split(order, [min(most // 2, number)])
        return [level for level in [*first_ones[:, None], *np.array_split(rest, most - most // 2)] if len(level)]

    def _decide(self, level: Indices) -> None:
        """Decides the origins of some classes, while those of all others stay as they are."""
        in_level = np.zeros(len(self.sides) + 1, dtype=bool)
        in_level[level] = True
        own = np.flatnonzero(in_level[self.classes[self.pairs.a]])
        if len(own):
            self._choose(level, self._evidence(self.pairs.rows(own)))
        self.is_open[level] = False
        moved = np.flatnonzero(in_level[self.classes])
        offset = self.sides[self.classes[moved]] * self.boxes.half_extents[moved]
        turned = np.einsum("nij,nj->ni", self.boxes.rotation[moved], offset)
        self.centers[moved] = self.boxes.center[moved] + turned
        self._update_held(np.flatnonzero(in_level[self.classes[self.pairs.a]] | in_level[self.classes[self.pairs.b]]))

    def _choose(self, level: Indices, evidence: _Evidence) -> None:
        bodies = self.counts[level, None]
        held, wrong, others = evidence.held[level], evidence.wrong[level], evidence.others[level]
        scores = evidence.total[level] - (_SIDES != 0.0) @ _AXIS_PRIOR * (_PRIOR + _PRIOR_PER_BODY * bodies)
        for reference, held_better in ((_AT_CENTER, _MIN_HELD_BETTER), (_AT_SIDE_CENTER, _MIN_HELD_BETTER_BESIDE)):
            better = wrong[:, reference] - wrong
            more_held, more_others = held - held[:, reference], others - others[:, reference]
            is_clear = (better >= _MIN_BETTER * bodies) & (more_held >= held_better * bodies)
            is_clear |= more_held >= np.maximum(_MIN_ONLY_HELD_PER_BODY * bodies, _MIN_ONLY_HELD)
            least = np.maximum(_MIN_OTHERS_PER_BODY * bodies, _MIN_OTHERS) + _MIN_OTHERS_SHARE * others[:, reference]
            is_clear |= more_others >= least
            is_clear &= better >= -_MAX_WORSE * bodies
            scores[~is_clear & (reference != np.arange(len(_SIDES)))] = -np.inf
        best = scores.argmax(axis=1)
        rows = np.arange(len(level))
        near = scores >= (scores[rows, best] - _TIE - _TIE_PER_BODY * bodies[:, 0])[:, None]
        near &= wrong <= (wrong[rows, best] + _MIN_BETTER * bodies[:, 0])[:, None]
        opposite = (near[:, :, None] & (-_SIDES[best][:, None] == _SIDES)).any(axis=1)
        self.sides[level] = _SIDES[best]
        self.tied[level] = opposite & (_SIDES[best] != 0.0)
        self.margins[level] = scores[rows, best] - scores[:, 0]
        self.holds_others[level] = (others[rows, best] - others[:, 0]) > (held[rows, best] - held[:, 0])

    def _update_held(self, rows: Indices) -> None:
        """Updates how well bodies can be held, for some pairs."""
        pairs, classes, boxes = self.pairs.rows(rows), self.classes, self.boxes
        to_frame = np.swapaxes(pairs.frame, 1, 2)
        base = np.einsum("nij,nj->ni", to_frame, self.centers[pairs.a] - self.centers[pairs.b])
        up_a, up_b = (
            np.einsum("nij,nj->ni", to_frame, boxes.rotation[at, :, 2] * boxes.half_extents[at, 2:])
            for at in (pairs.a, pairs.b)
        )
        open_a, open_b = self.is_open[classes[pairs.a]], self.is_open[classes[pairs.b]]
        is_same = classes[pairs.a] == classes[pairs.b]
        self.held[rows] = 0.0
        for level_a, level_b in product((0.0, 1.0, -1.0), repeat=2):
            some = np.flatnonzero(
                (open_a | (level_a == 0.0)) & (open_b | (level_b == 0.0)) & (~is_same | (level_a == level_b))
            )
            if len(some):
                offsets = base[some] + level_a * up_a[some] - level_b * up_b[some]
                held = _evaluate(pairs.rows(some), offsets[:, None])[0][:, 0]
                self.held[rows[some]] = np.maximum(self.held[rows[some]], held)

    def _evidence(self, pairs: _Pairs) -> _Evidence:
        """Returns the evidence for all origins of all classes that have bodies a in some pairs."""
        classes, count = self.classes, len(self.sides)
        best, best_class, second = self._holders()
        same = classes[pairs.a] == classes[pairs.b]
        to_frame = np.swapaxes(pairs.frame, 1, 2)
        step = (to_frame @ self.boxes.rotation[pairs.a]) * self.boxes.half_extents[pairs.a][:, None, :]
        other = (to_frame @ self.boxes.rotation[pairs.b]) * self.boxes.half_extents[pairs.b][:, None, :]
        at_b = np.where(same[:, None], self.boxes.center[pairs.b], self.centers[pairs.b])
        base = np.einsum("nij,nj->ni", to_frame, self.boxes.center[pairs.a] - at_b)
        step = step - np.where(same[:, None, None], other, 0.0)
        offsets = base[:, None] + np.einsum("nij,mj->nmi", step, _SIDES)
        held, holds, sunk = _evaluate(pairs, offsets)
        cls, cls_b = classes[pairs.a], classes[pairs.b]
        # Pairs by class of a, class of b, and b; a body counts as held if any body of the class holds it.
        order = np.lexsort((pairs.b, cls_b, cls))
        order = order[~same[order]]
        starts = np.flatnonzero(np.diff(cls[order] * len(classes) + pairs.b[order], prepend=-1))
        bodies = order[starts]
        groups = np.flatnonzero(np.diff(cls[bodies] * (count + 1) + cls_b[bodies], prepend=-1))
        without = np.where(best_class[pairs.b[bodies]] == cls[bodies], second[pairs.b[bodies]], best[pairs.b[bodies]])
        message, holding = np.full((2, len(groups), len(_SIDES)), -np.inf)
        is_open, best_held, least_sunk = self.is_open[cls_b], held, sunk.copy()
        for level in (0.0, 1.0, -1.0) if len(order) else ():
            each_held, each_holds, each_sunk = held, holds, sunk
            if level:
                some = np.flatnonzero(is_open & ~same)
                each_held, each_holds, each_sunk = held.copy(), holds.copy(), sunk.copy()
                shifted = offsets[some] - level * other[some][:, None, :, 2]
                each_held[some], each_holds[some], each_sunk[some] = _evaluate(pairs.rows(some), shifted)
            gain = np.maximum(np.maximum.reduceat(each_holds[order], starts, axis=0) - without[:, None], 0.0)
            holding = np.maximum(holding, np.add.reduceat(gain, groups, axis=0))
            gain = gain - np.add.reduceat(each_sunk[order], starts, axis=0)
            message = np.maximum(message, np.add.reduceat(gain, groups, axis=0))
            best_held, least_sunk = np.maximum(best_held, each_held), np.minimum(least_sunk, each_sunk)
        total, own, wrong, others = (np.zeros((count, len(_SIDES))) for _ in range(4))
        np.add.at(total, cls[bodies[groups]], message)
        np.add.at(others, cls[bodies[groups]], holding)
        np.add.at(total, cls[same], -0.5 * sunk[same])
        # A shell around a body that cuts it is wrong itself.
        least_sunk[pairs.shells[0]] = 0.0
        starts = np.flatnonzero(np.diff(pairs.a, prepend=-1))
        best_held, worst = (np.maximum.reduceat(each, starts, axis=0) for each in (best_held, least_sunk))
        np.add.at(own, cls[starts], best_held)
        np.add.at(wrong, cls[starts], np.maximum(1.0 - best_held / _AROUND, 0.0) + np.maximum(worst / _SUNK, 0.0))
        return _Evidence(total + own, own, wrong, others)

    def _holders(self) -> tuple[Array, Indices, Array]:
        """Returns how well each body can be held, by which class, and how well by bodies of any other class."""
        pairs, count = self.pairs, len(self.classes)
        by = self.classes[pairs.b]
        best, best_class, second = np.zeros(count), np.full(count, -2), np.zeros(count)
        order = np.lexsort((-self.held, pairs.a))
        first = order[np.diff(pairs.a[order], prepend=-1) != 0]
        best[pairs.a[first]], best_class[pairs.a[first]] = self.held[first], by[first]
        rest = by != best_class[pairs.a]
        np.maximum.at(second, pairs.a[rest], self.held[rest])
        return best, best_class, second


def _numbers_in_groups(groups: Indices) -> Indices:
    """Numbers the elements that belong to the same group."""
    order = np.argsort(groups, kind="stable")
    numbers = np.empty(len(groups), dtype=np.intp)
    numbers[order] = np.arange(len(groups)) - np.searchsorted(groups[order], groups[order])
    return numbers


def _evaluate(pairs: _Pairs, offsets: Array) -> tuple[Array, Array, Array]:
    """Returns how well a is held by b, b is held by a, and how far they are in each other, n x m each.

    The last one is negative for boxes that are wholly in each other.

    Args:
        pairs: n pairs.
        offsets: m centers of a relative to b in the frame of each pair, n x m x 3 [m].
    """
    half_a, half_b = pairs.half_a[:, None], pairs.half_b[:, None]
    apart = np.abs(offsets) - half_a - half_b
    common = np.minimum(offsets + half_a, half_b) - np.maximum(offsets - half_a, -half_b)
    common = np.maximum(common, 0.0)
    share_a, share_b = common / np.maximum(2 * half_a, 1e-9), common / np.maximum(2 * half_b, 1e-9)
    smaller = np.minimum(half_a, half_b)
    step = np.where(smaller < _THIN_M, np.maximum(half_a, half_b), smaller)
    tolerance = np.clip(_CONTACT_SHARE * (step - _SMALL_M), _MIN_CONTACT_M, _MAX_CONTACT_M)
    contact = np.clip(2.0 - np.abs(apart) / tolerance, 0.0, 1.0)
    over_a, over_b = np.abs(offsets) <= half_b, np.abs(offsets) <= half_a
    held_a, held_b = (np.zeros(offsets.shape[:2]) for _ in range(2))
    for axis in range(3):
        one, two = (axis + 1) % 3, (axis + 2) % 3
        is_vertical = np.abs(pairs.up[:, axis]) > _LEVEL_COSINE
        above = offsets[:, :, axis] * np.sign(pairs.up[:, axis])[:, None] > 0.0
        weight_a = np.where(is_vertical[:, None], np.where(above, _BELOW, _ABOVE), _BESIDE)
        weight_b = np.where(is_vertical[:, None], np.where(above, _ABOVE, _BELOW), _BESIDE)
        weight_a = np.where(pairs.is_part[:, None], _PART, weight_a)
        weight_b = np.where(pairs.is_whole[:, None], _PART, weight_b)
        for held, weight, share, over in ((held_a, weight_a, share_a, over_a), (held_b, weight_b, share_b, over_b)):
            covered = share[:, :, one] * share[:, :, two]
            balanced = over[:, :, one] & over[:, :, two]
            np.maximum(
                held, weight * contact[:, :, axis] * (_COVERED * covered + (1.0 - _COVERED) * balanced), out=held
            )
    depth = np.where(apart < -tolerance, -apart, 0.0) / np.maximum(2 * smaller, 1e-9)
    sunk = np.clip(depth.min(axis=2) / _SUNK_SHARE, 0.0, 1.0)
    for held, is_shell in zip((held_a, held_b), pairs.shells, strict=True):
        held[is_shell] *= _ON_SHELL
    inside_a, inside_b = (
        ((share >= _INSIDE) | ((2 * half - common <= _PANEL_OFFSET_M) & (2 * other <= _PANEL_M))).all(axis=2)
        for share, half, other in ((share_a, half_a, half_b), (share_b, half_b, half_a))
    )
    np.maximum(held_a, _AROUND * (inside_a & pairs.can_contain_a[:, None]), out=held_a)
    np.maximum(held_b, _AROUND * (inside_b & pairs.can_contain_b[:, None]), out=held_b)
    weight = np.where(pairs.is_part | pairs.is_whole, _SUNK_PART, _SUNK)[:, None]
    return held_a, held_b, np.where(inside_a | inside_b, -_TOGETHER, weight * sunk)
