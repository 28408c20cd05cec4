"""Probabilities of the origins of meshes, from faces of boxes that are in one plane.

What stands, leans, hangs or was built side by side has faces in common planes: the lower side of a cup and the upper
side of a table, the lower sides of all that is on a shelf that no map mentions, the sides of two cupboards in a row.
For each class and each axis of its mesh, the origin is at the center or at one of two sides. Each pair of neighbors
says how likely their origins are together: how exactly faces coincide, compared with chance, and how far one box is in
the other. Belief propagation gives the probabilities of all of them at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mindstage.scene.bounding_boxes import Indices, OrientedBoxes, overlapping_pairs
from mindstage.scene.transforms import Array

__all__ = ["Anchors", "SideChoice", "choose_sides"]

_STATES = np.array([-1.0, 0.0, 1.0])
"""Centers of boxes relative to origins, in half extents."""
_PARALLEL_COSINE = 0.999999
_VERTICAL_COSINE = 0.999
_REACH_M = (0.5, 0.5, 0.02)
"""How far from each other bodies are compared [m]."""
_MAX_NEIGHBORS, _MIN_NEIGHBORS, _MAX_PAIRS = 40, 8, 40_000
"""Number of neighbors of a body that are compared, the nearest ones; fewer in maps with many bodies."""
_SCALES_M, _SCALE_WEIGHTS = np.array([0.0005, 0.002, 0.006, 0.015]), np.array([0.45, 0.25, 0.15, 0.15])
"""How exactly faces coincide that belong together: computed, placed, and with a gap for play [m]."""
_RANGE_M = 0.5
"""Faces that do not belong together are anywhere within this [m]."""
_MAX_NEAR, _SIMILAR_VOLUME = 4, 30.0
"""How many neighbors of similar volume may share a board that the map lacks, for each body."""
_TOUCHING = 0.2
"""Share of the smaller extent by which boxes overlap that are above or before each other."""
_ON, _AGAINST, _JOINED = 0.3, 0.1, 0.3
"""How often faces that are opposite to each other touch: vertically, horizontally, of bodies that a joint connects."""
_BOTTOMS, _TOPS, _SIDES = 0.15, 0.02, 0.05
"""How often equal faces of neighbors are in one plane."""
_CENTERED = 0.3
"""How often a part is in the middle of its whole."""
_OUT = 5.0
"""Logarithm of the odds against parts that are beside what they are parts of, in more than one direction."""
_WITHIN = 5.0
"""Odds of a body in a container against one in the air."""
_FLOOR, _FLOOR_M = 0.4, 0.03
"""How often what is in a container is on its floor, and how thick that is [m]."""
_PENETRATION, _PENETRATION_SHARE, _MIN_SHARE = 3.5, 0.3, 0.03
"""Logarithm of the odds against boxes that are this far in each other, relative to the smaller one."""
_GRAZE_M = 0.015
"""Depth of contacts in maps whose bodies were placed by hand [m]."""
_INSIDE_M = 0.005
_MAX_LOG_ODDS = 12.0
"""Most that the bodies of two classes say about their origins: one coincidence is not counted for each body."""
_VERTICAL_PRIOR = np.log([0.12, 0.44, 0.44])
_HORIZONTAL_PRIOR, _LOOSE_PRIOR = np.log([0.015, 0.97, 0.015]), np.log([0.004, 0.992, 0.004])
_LOOSE_M = 0.5
"""Largest extent of a thing that counts as loose if it is not part of anything [m]."""
_GIVEN = 2.0
"""Logarithm of the odds of a side that other evidence speaks for."""
_HELD_M, _MAX_SUNK = 0.02, 0.1
"""Gap up to which bodies hold each other [m], and how far they may be in each other, relative to the smaller one."""
_MAX_DEFECTS = 0.85
"""How many bodies may be in the air or in others, relative to those without the evidence of faces, if it is used."""
_MIN_SIDE, _MIN_CENTER, _MIN_MIDDLE = 0.9, 0.97, 0.75
"""Probabilities from which a side is chosen, the center of a height, and that of a depth or a width."""
_MIN_SURE, _MIN_RARE = 0.99, 0.999
"""Probabilities from which a choice is not reported, and a side other than the bottom, if other evidence agrees."""
_ROUNDS, _MESSAGES, _DAMPING = 3, 25, 0.5
"""Number of times that overlaps are computed, number of messages for each, and the share of a message that is kept."""


@dataclass(frozen=True, slots=True)
class Anchors:
    """Points that are on bodies, such as those of hinges."""

    rows: Indices
    """The body of each point."""
    points: Array
    """n x 3 [m]."""
    axes: Array
    """n x 3: unit vectors along which hinges turn; 0 if unknown."""


@dataclass(frozen=True, slots=True)
class _AxisPairs:
    """Parallel axes of two neighbors."""

    nodes: Indices
    """The class and axis of both, 2 x n; the last number is that of all whose origin is known."""
    pair: Indices
    axis: Indices
    """The axis of the first body."""
    sign: Array
    """Whether the axis of the second one has the same direction."""
    up: Array
    """1 or -1 if the axis of the first one is vertical, otherwise 0."""


class SideChoice(NamedTuple):
    """The origin of the mesh of a class."""

    sides: Array
    """Center of the box relative to the origin, in half extents along the axes of the body: 1 in z is a foot."""
    margins: Array
    """The logarithm of the odds of the chosen side against the second one, by axis."""
    chances: Array
    """The probabilities of the center being at -1, 0 and 1 half extents, by axis: 3 x 3."""
    undecided: tuple[int, ...]
    """The axes along which another side may be right, too; the center counts where none is clearly more likely. Also
    those of what is as large as a room, if nothing says where its origin is."""


def choose_sides(
    boxes: OrientedBoxes, classes: Indices, links: Indices, anchors: Anchors, sides: Array
) -> list[SideChoice]:
    """Chooses the origin of the mesh of each class.

    Args:
        boxes: the boxes of n bodies, with origins of meshes in place of centers.
        classes: the number of each body's class, n; negative for bodies whose origin is the center.
        links: rows of parts or moved bodies and of what they belong to, m x 2, the whole first.
        anchors: points that are on bodies.
        sides: what other evidence says, for each class and axis; of what is as large as a room, and where it is none
            of the three, it is certain.
    """
    if not len(sides):
        return []
    solver = _FaceSolver(boxes, classes, links, anchors, sides)
    chances = solver.probabilities()
    best = chances.argmax(axis=2)
    least = np.where(best == 1, np.where(solver.is_vertical, _MIN_CENTER, _MIN_MIDDLE), _MIN_SIDE)
    undecided = (chances.max(axis=2) < least) & ~solver.is_certain
    chosen = np.where(solver.is_certain, sides, np.where(undecided, 0.0, _STATES[best]))
    defects, given_defects = solver.defects(chosen), solver.defects(sides)
    if defects > _MAX_DEFECTS * given_defects:  # other evidence counts, which is better if that leaves fewer of them
        undecided = ~solver.is_certain & ~undecided & (chosen != sides) & (defects <= given_defects)
        chosen = sides
    else:
        is_rare = (best != 1) & (best != 1 + solver.up)
        is_doubtful = is_rare & ((chances.max(axis=2) < _MIN_RARE) | (sides != chosen))
        is_doubtful |= (chances.max(axis=2) < _MIN_SURE) & (solver.is_vertical | ~solver.is_loose[:, None])
        undecided |= np.where(solver.is_certain, sides == 0.0, is_doubtful)
    axes = (tuple(np.flatnonzero(row).tolist()) for row in undecided)
    margins = -np.diff(np.log(np.maximum(np.sort(chances, axis=2)[:, :, :0:-1], 1e-9)), axis=2)[:, :, 0]
    return [SideChoice(*each) for each in zip(chosen, margins, chances, axes, strict=True)]


class _FaceSolver:
    def __init__(self, boxes: OrientedBoxes, classes: Indices, links: Indices, anchors: Anchors, sides: Array) -> None:
        self.boxes, self.classes, self.links, self.anchors = boxes, classes, links, anchors
        self.count = len(sides)
        self.given = sides
        first = np.zeros(self.count, dtype=np.intp)
        rows = np.flatnonzero(classes >= 0)[::-1]
        first[classes[rows]] = rows
        self.first = first
        """The first body of each class."""
        linked = classes[np.unique(links)]
        self.is_loose = 2 * boxes.half_extents[first].max(axis=1) < _LOOSE_M
        self.is_loose[linked[linked >= 0]] = False
        vertical = boxes.rotation[first, 2]
        self.is_vertical = np.abs(vertical) > _VERTICAL_COSINE
        self.up = np.where(self.is_vertical, np.sign(vertical), 0.0).astype(np.intp)
        spread = np.median(np.abs(boxes.center - np.median(boxes.center, axis=0)), axis=0).max()
        large = np.sort(boxes.half_extents, axis=1)[:, 1] >= spread
        known = np.isin(sides, _STATES)
        known[classes[large & (classes >= 0)]] = False
        self.is_certain = ~known
        self.values = np.concatenate(
            [np.where(known[:, :, None], _STATES, sides[:, :, None]).reshape(-1, 3), [[0.0] * 3]]
        )
        self.sides = np.concatenate([sides, np.zeros((1, 3))])
        self.pairs = self._neighbors(links)
        keys = np.array([len(classes), 1])
        self.is_linked = np.isin(self.pairs @ keys, np.sort(links, axis=1) @ keys)
        a, b = self.pairs.T
        self.turns = np.swapaxes(boxes.rotation[a], 1, 2) @ boxes.rotation[b]
        self.base = np.einsum("nji,nj->ni", boxes.rotation[a], boxes.center[a] - boxes.center[b])
        self.half_a = boxes.half_extents[a]
        self.half_b = np.einsum("nij,nj->ni", np.abs(self.turns), boxes.half_extents[b])
        self.is_shell = (large[b] & (self.half_b.min(axis=1) > self.half_a.max(axis=1))) | (
            large[a] & (self.half_a.min(axis=1) > self.half_b.max(axis=1))
        )
        self.edges = self._edges()
        self.is_near = self._nearest()

    def _neighbors(self, links: Indices) -> Indices:
        """Returns the rows of bodies that may touch or be in line, the smaller row first."""
        boxes, count = self.boxes, len(self.classes)
        reach = np.where(self.classes < 0, 1.0, 2.0)[:, None] * boxes.half_extents
        wide = OrientedBoxes(boxes.center, boxes.rotation, reach)
        low, high = wide.bounds()
        found = [np.sort(links, axis=1).reshape(-1, 2)]
        for pair in overlapping_pairs(wide, self.classes >= 0, np.ones(count, dtype=bool), margin=_REACH_M):
            found.append(np.sort(np.stack(pair, axis=1), axis=1))
        both = np.concatenate(found)
        gap = np.maximum(np.maximum(low[both[:, 0]] - high[both[:, 1]], low[both[:, 1]] - high[both[:, 0]]), 0.0)
        distance = np.linalg.norm(gap, axis=1) - 1e-3 * (np.arange(len(both)) < len(links))
        volume = np.prod(boxes.half_extents, axis=1)
        most = int(np.clip(_MAX_PAIRS // max(count, 1), _MIN_NEIGHBORS, _MAX_NEIGHBORS))
        kept = np.zeros(len(both), dtype=bool)
        for end in (0, 1):
            order = np.lexsort((-volume[both[:, 1 - end]], distance, both[:, end]))
            starts = np.searchsorted(both[order, end], both[order, end])
            kept[order[np.arange(len(order)) - starts < most]] = True
        keys = np.unique(both[kept] @ [count, 1])
        return np.stack([keys // count, keys % count], axis=1)

    def _nearest(self) -> NDArray[np.bool_]:
        """Whether two bodies are of similar size and among the nearest ones to each other: they may share a board."""
        boxes = self.boxes
        volume = np.maximum(np.prod(boxes.half_extents, axis=1), 1e-12)
        ratio = np.abs(np.log(volume[self.pairs[:, 0]] / volume[self.pairs[:, 1]]))
        distance = np.linalg.norm(boxes.center[self.pairs[:, 0]] - boxes.center[self.pairs[:, 1]], axis=1)
        distance[ratio > np.log(_SIMILAR_VOLUME)] = np.inf
        rows = np.concatenate([self.pairs[:, 0], self.pairs[:, 1]])
        order = np.lexsort((np.concatenate([distance, distance]), rows))
        starts = np.searchsorted(rows[order], rows[order])
        near = np.zeros(len(rows), dtype=bool)
        near[order[np.arange(len(rows)) - starts < _MAX_NEAR]] = True
        near = near[: len(self.pairs)] | near[len(self.pairs) :]
        return np.asarray(near & np.isfinite(distance))

    def _edges(self) -> _AxisPairs:
        pair, axis = np.nonzero(np.abs(self.turns).max(axis=2, initial=0.0) > _PARALLEL_COSINE)
        other = np.abs(self.turns[pair, axis]).argmax(axis=1)
        a, b = self.pairs[pair].T
        last = 3 * self.count
        nodes = np.stack(
            [
                np.where(self.classes[row] < 0, last, 3 * self.classes[row] + number)
                for row, number in ((a, axis), (b, other))
            ]
        )
        vertical = self.boxes.rotation[a, 2, axis]
        up = np.where(np.abs(vertical) > _VERTICAL_COSINE, np.sign(vertical), 0.0)
        return _AxisPairs(nodes, pair, axis, np.sign(self.turns[pair, axis, other]), up)

    def probabilities(self) -> Array:
        result = np.zeros((self.count, 3, 3))
        for _ in range(_ROUNDS):
            single, joint = self._potentials()
            log = _propagated(single, *joint)[:-1].reshape(self.count, 3, 3)
            result = np.exp(log - log.max(axis=2, keepdims=True))
            result /= result.sum(axis=2, keepdims=True)
            best = self.values[:-1].reshape(self.count, 3, 3)
            self.sides[:-1] = np.take_along_axis(best, result.argmax(axis=2)[:, :, None], axis=2)[:, :, 0]
        return result

    def _offsets(self, sides: Array) -> Array:
        """Returns the centers of first bodies relative to second ones along the axes of the first, n x 3 [m]."""
        a, b = self.pairs.T
        other = np.einsum("nij,nj->ni", self.turns, sides[self.classes[b]] * self.boxes.half_extents[b])
        return np.asarray(self.base + sides[self.classes[a]] * self.half_a - other)

    def defects(self, sides: Array) -> int:
        """Returns the number of bodies that nothing touches, and of those that are in others."""
        (a, b), half_a, half_b = self.pairs.T, self.half_a, self.half_b
        now = self._offsets(np.concatenate([sides, np.zeros((1, 3))]))
        gap = np.abs(now) - half_a - half_b
        inner_a, inner_b = (
            (np.abs(now) + own <= its + _INSIDE_M).all(axis=1) for own, its in ((half_a, half_b), (half_b, half_a))
        )
        share = np.clip((-gap - _GRAZE_M) / np.maximum(2 * np.minimum(half_a, half_b), 1e-9), 0.0, 1.0).min(axis=1)
        share[inner_a | inner_b | self.is_shell] = 0.0
        touching = gap.max(axis=1) < _HELD_M
        held = np.zeros(len(self.classes), dtype=bool)
        held[a[touching & ~self.is_shell]] = held[b[touching & ~self.is_shell]] = True
        sunk = np.zeros(len(self.classes))
        np.maximum.at(sunk, a, share)
        np.maximum.at(sunk, b, share)
        counted = self.classes >= 0
        return int((~held[counted]).sum() + (sunk[counted] > _MAX_SUNK).sum())

    def _potentials(self) -> tuple[Array, tuple[Indices, Array]]:
        """Returns the logarithms of the odds of sides of each class and axis, and of those of pairs of them."""
        single = np.concatenate([self._prior().reshape(-1, 3), np.zeros((1, 3))])
        tables, nodes = self._tables(), self.edges.nodes.copy()
        swapped = nodes[0] > nodes[1]
        tables[swapped] = np.swapaxes(tables[swapped], 1, 2)
        nodes = np.sort(nodes, axis=0)
        same = nodes[0] == nodes[1]
        np.add.at(single, nodes[0, same], np.einsum("nii->ni", tables[same]))
        keys, which = np.unique(nodes[0, ~same] * (3 * self.count + 1) + nodes[1, ~same], return_inverse=True)
        summed = np.zeros((len(keys), 3, 3))
        np.add.at(summed, which, tables[~same])
        summed = np.clip(summed - summed.max(axis=(1, 2), keepdims=True), -_MAX_LOG_ODDS, 0.0)
        return single, (np.stack([keys // (3 * self.count + 1), keys % (3 * self.count + 1)]), summed)

    def _prior(self) -> Array:
        boxes, classes = self.boxes, self.classes
        across = np.where(self.is_loose[:, None, None], _LOOSE_PRIOR, _HORIZONTAL_PRIOR)
        prior = np.where(self.is_vertical[:, :, None], _VERTICAL_PRIOR, across)
        prior = np.where((self.up < 0)[:, :, None], prior[:, :, ::-1], prior)
        prior = prior + _GIVEN * ((self.given[:, :, None] == _STATES) & (_STATES != 0.0))
        rows = self.anchors.rows
        local = np.einsum("nji,nj->ni", boxes.rotation[rows], self.anchors.points - boxes.center[rows])
        axes = np.einsum("nji,nj->ni", boxes.rotation[rows], self.anchors.axes)
        known = classes[rows] >= 0
        np.add.at(prior, classes[rows][known], _anchored(local, axes, boxes.half_extents[rows])[known])
        return np.asarray(prior)

    def _tables(self) -> Array:
        """Returns the logarithms of the odds of the sides of both bodies of each edge, n x 3 x 3."""
        edges, now = self.edges, self._offsets(self.sides)
        smaller = np.minimum(self.half_a, self.half_b)
        shares = np.clip((self.half_a + self.half_b - np.abs(now)) / np.maximum(2 * smaller, 1e-9), 0.0, 1.0)
        inner = [
            np.abs(now) + own <= its + _INSIDE_M
            for own, its in ((self.half_a, self.half_b), (self.half_b, self.half_a))
        ]
        pair, axis = edges.pair, edges.axis
        across = np.array([[1, 2], [2, 0], [0, 1]])[axis]
        least = np.minimum(shares[pair, across[:, 0]], shares[pair, across[:, 1]])
        half_a, half_b = self.half_a[pair, axis][:, None, None], self.half_b[pair, axis][:, None, None]
        own_half = self.boxes.half_extents[self.pairs[pair, 1], edges.nodes[1] % 3]
        own_half = np.where(edges.nodes[1] == 3 * self.count, 0.0, own_half)
        values = self.values[edges.nodes]
        along = values[0][:, :, None] * half_a - (edges.sign * own_half)[:, None, None] * values[1][:, None, :]
        along = along + self.base[pair, axis][:, None, None]
        gap = np.abs(along) - half_a - half_b
        touching, linked = least > _TOUCHING, self.is_linked[pair]
        is_vertical = edges.up != 0.0
        odds = np.ones((len(pair), 3, 3))
        weight = np.where(linked, _JOINED, np.where(is_vertical, _ON, _AGAINST)) * touching
        odds += weight[:, None, None] * _coincidence(gap)
        flip = np.where(edges.up < 0.0, -1.0, 1.0)[:, None, None]
        lower, upper = along * flip - half_a + half_b, along * flip + half_a - half_b
        weights = np.where(
            is_vertical, np.where(touching, _SIDES, np.where(self.is_near[pair], [[_BOTTOMS], [_TOPS]], 0.0)), _SIDES
        )
        flush = [each[:, None, None] * _coincidence(face) for each, face in zip(weights, (lower, upper), strict=True)]
        odds += np.maximum(*flush) + np.where(np.abs(half_a - half_b) > 1e-4, np.minimum(*flush), 0.0)
        centered = np.where(linked, _CENTERED, np.where(touching & ~is_vertical, _SIDES, 0.0))
        odds += centered[:, None, None] * _coincidence(along)
        inside = [
            each[pair[:, None], across].all(axis=1)[:, None, None] & (np.abs(along) + own <= its + _INSIDE_M)
            for each, own, its in ((inner[0], half_a, half_b), (inner[1], half_b, half_a))
        ]
        within = (inside[0] | inside[1]) & ~(self.is_shell | self.is_linked)[pair][:, None, None]
        above = np.where(inside[0], lower, -lower)
        height = 2 * np.maximum(half_a, half_b)
        on_floor = _FLOOR * height / _FLOOR_M * (above < _FLOOR_M)
        odds += within * _WITHIN * np.where(is_vertical[:, None, None], 1.0 - _FLOOR + on_floor, 1.0)
        depth = np.clip((-gap - _GRAZE_M) / np.maximum(2 * np.minimum(half_a, half_b), 1e-9), 0.0, 1.0)
        sunk = np.clip((np.minimum(depth, least[:, None, None]) - _MIN_SHARE) / _PENETRATION_SHARE, 0.0, 1.0)
        cost = np.where(self.is_shell[pair], 0.0, np.where(linked, 0.5, 1.0) * _PENETRATION)
        contact = (np.abs(now) - self.half_a - self.half_b).argmax(axis=1)
        out = np.maximum(np.abs(along) + np.minimum(half_a, half_b) - np.maximum(half_a, half_b), 0.0)
        out = np.clip(out / np.maximum(2 * np.minimum(half_a, half_b), 1e-9), 0.0, 1.0)
        is_across = np.where(linked & (axis != contact[pair]), _OUT, 0.0)[:, None, None]
        cost = cost[:, None, None] * sunk * ~(inside[0] | inside[1]) + is_across * np.clip((out - 0.1) / 0.4, 0.0, 1.0)
        return np.asarray(np.log(odds) - cost)


def _anchored(points: Array, axes: Array, half: Array) -> Array:
    """Returns the logarithms of the odds of sides for points in frames of origins, n x 3 x 3.

    A point of a joint is in its body or at its side. A hinge is at an edge: it could not be in the middle of a door.
    """
    local = np.abs(points[:, :, None] - _STATES * half[:, :, None])
    tolerance = 0.005 + 0.02 * half[:, :, None]
    at_middle, at_side = local < tolerance, np.abs(local - half[:, :, None]) < tolerance
    odds = 0.1 + 2.0 * at_middle + 2.0 * at_side
    across = np.where(np.abs(axes) > _VERTICAL_COSINE, 0.0, half) * (np.abs(axes).max(axis=1, keepdims=True) > 0.99)
    is_width = (across == across.max(axis=1, keepdims=True)) & (across > 0.0)
    odds = np.where(is_width[:, :, None], 0.05 + 2.0 * at_side, odds)
    return np.asarray(np.log(np.where(local > half[:, :, None] + tolerance + 0.005, 0.01, odds)))


def _coincidence(distances: Array) -> Array:
    """Returns how much more likely distances are between faces that belong together than between others."""
    found = np.zeros_like(distances)
    for scale, weight in zip(_SCALES_M, _SCALE_WEIGHTS, strict=True):
        found += weight * _RANGE_M / (2 * scale) * np.exp(-np.abs(distances) / scale)
    return found


def _propagated(single: Array, nodes: Indices, tables: Array) -> Array:
    """Returns logarithms of the odds of each node by tree-reweighted belief propagation."""
    a, b = nodes
    degree = np.maximum(np.bincount(nodes.ravel(), minlength=len(single)), 1)
    share = np.minimum(1.0 / degree[a] + 1.0 / degree[b], 1.0)[:, None]
    tables = tables / share[:, :, None]
    to_b, to_a = np.zeros((2, len(a), 3))
    total = single
    for _ in range(_MESSAGES):
        total = single.copy()
        np.add.at(total, b, share * to_b)
        np.add.at(total, a, share * to_a)
        total -= total.max(axis=1, keepdims=True)
        new_b = _log_sum(tables + (total[a] - to_a)[:, :, None], axis=1)
        new_a = _log_sum(tables + (total[b] - to_b)[:, None, :], axis=2)
        to_b = _DAMPING * to_b + (1.0 - _DAMPING) * new_b
        to_a = _DAMPING * to_a + (1.0 - _DAMPING) * new_a
    return total


def _log_sum(values: Array, axis: int) -> Array:
    one, two, three = (values.take(number, axis=axis) for number in range(3))
    most = np.maximum(np.maximum(one, two), three)
    result = np.log(np.exp(one - most) + np.exp(two - most) + np.exp(three - most)) + most
    return np.asarray(result - np.maximum(np.maximum(result[:, 0], result[:, 1]), result[:, 2])[:, None])
