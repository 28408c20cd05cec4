"""Moves loose bodies out of what they overlap, before the simulation starts.

Perceived poses are easily a centimeter off, and boxes around chairs reach into the floor. A pair that overlaps deeply
can neither be simulated, since the contact force would throw the bodies apart, nor be excluded from contact, since the
loose body would fall through its support. Each loose body is therefore translated by the least distance after which it
overlaps nothing; downward motion counts threefold, since what is below a support is seldom free.

Bodies are placed one after the other, from the ground up and larger ones first, so that a stack is lifted as a whole.
Fixed bodies, and loose ones that are already placed, are obstacles. Bodies connected by joints or attachments are one
tree. A tree that would have to be moved by more than its own size stays where it is:

- of two loose bodies that stand inside each other, neither is the support of the other: they do not collide;
- a body that is stuck in fixed ones is made static, and does not collide with them, since a door could be among them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mindstage.engines.base import SpawnNote, SpawnNoteKind
from mindstage.scene import BodyId
from mindstage.scene.bounding_boxes import Indices
from mindstage.scene.collision_shapes import CollisionShapeBatch
from mindstage.scene.transforms import Array

__all__ = ["KEPT_POSE_TOLERANCE_M", "Settlement", "SettlingInput", "nested_notes", "settle"]

KEPT_POSE_TOLERANCE_M = 0.02
"""A body that is moved by at most this keeps its described pose in snapshots, as long as it stays there [m]."""

_CONTACT_M = 1e-6
"""Smaller overlaps are contacts [m]."""
_DOWNWARD_WEIGHT = 3.0
_MAX_GREEDY_STEPS = 12
_MAX_LINE_STEPS = 24
_CHEAP_SHIFT_M = 0.03
"""Below this shift, the pairwise way out is taken without a comparison with straight ways."""
_MAX_FRACTION_OF_SIZE = 1.05
"""Largest shift out of fixed bodies, relative to the extent of the tree along the shift."""
_MAX_FRACTION_BESIDE = 0.5
"""The same out of loose bodies, sideways."""
_MAX_FRACTION_ABOVE = 0.75
"""The same out of loose bodies, upward."""
_LEVEL_M = 0.05
"""Trees whose lower sides differ by less are placed in the order of their volumes."""
_WORLD_DIRECTIONS = np.array([(0, 0, 1), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, -1)], dtype=np.float64)


@dataclass(frozen=True, slots=True, kw_only=True)
class SettlingInput:
    """The n bodies of a world, some of which overlap."""

    ids: tuple[BodyId, ...]
    shapes: CollisionShapeBatch
    """Their collision shapes."""
    tree: NDArray[np.intp]
    """Number of each body's tree: bodies connected by attachments and joints."""
    is_loose: NDArray[np.bool_]
    """Whether nothing connects the body's tree with a fixed body."""
    is_new: NDArray[np.bool_]
    """Whether the body was just added; others are moved only out of new bodies that are not loose."""
    is_ignored: NDArray[np.bool_]
    """Whether the body collides with nothing."""
    excluded_pairs: frozenset[tuple[int, int]]
    """Pairs of bodies, in either order, that may overlap: contents and their container, and excluded pairs."""
    overlaps: Sequence[tuple[int, int, float]]
    """The overlapping pairs of which at least one body is loose, with their depths [m]."""


@dataclass(slots=True)
class Settlement:
    """The result of `settle`."""

    shifts: dict[int, Array] = field(default_factory=dict)
    """Translation of each moved body [m]."""
    stuck: list[int] = field(default_factory=list)
    """Bodies that cannot be moved out of fixed ones."""
    stuck_pairs: list[tuple[int, int]] = field(default_factory=list)
    """Pairs of such a body and of what it is stuck in, which must not push each other away."""
    nested_pairs: list[tuple[int, int]] = field(default_factory=list)
    """Pairs of loose bodies that are inside each other, and must not collide."""
    notes: list[SpawnNote] = field(default_factory=list)


def settle(settling_input: SettlingInput) -> Settlement:
    """Computes where loose bodies have to be so that they overlap nothing."""
    return _Settler(settling_input).run()


class _Settler:
    """Places the trees of one world."""

    def __init__(self, settling_input: SettlingInput) -> None:
        self._input = settling_input
        shapes = settling_input.shapes
        counts = np.diff(shapes.first_shape)
        self._owner = np.repeat(np.arange(len(counts)), counts)
        """Body of each shape."""
        self._low, self._high = (each.copy() for each in shapes.boxes.bounds())
        self._shift = np.zeros((len(self._owner), 3))
        """Translation of each shape so far."""
        self._first_low, self._first_high = self._low.copy(), self._high.copy()
        """Bounds of the shapes at the described poses."""
        self._carried: dict[int, Array] = {}
        """Translations of trees that stand on a moved one [m]."""
        self._trees = self._rows_by_tree()
        self._result = Settlement()

    def run(self) -> Settlement:
        pending = self._overlapping_trees()
        order = self._order(list(self._trees))
        placed = ~self._input.is_loose | ~self._input.is_new
        for tree in order:
            rows = self._trees[tree]
            if tree in pending:
                self._place(tree, placed, pending)
            placed[rows] = True
        return self._result

    def _rows_by_tree(self) -> dict[int, Indices]:
        """The bodies of each loose tree."""
        rows = np.flatnonzero(self._input.is_loose)
        if not len(rows):
            return {}
        rows = rows[np.argsort(self._input.tree[rows], kind="stable")]
        trees, first = np.unique(self._input.tree[rows], return_index=True)
        return dict(zip(trees.tolist(), np.split(rows, first[1:]), strict=True))

    def _overlapping_trees(self) -> set[int]:
        """Trees that have to be moved: the new ones, and others that a new fixed body was added to."""
        pending = set()
        for a, b, _ in self._input.overlaps:
            for row, other in ((a, b), (b, a)):
                is_hit = self._input.is_new[row] or not self._input.is_loose[other]
                if self._input.is_loose[row] and is_hit:
                    pending.add(int(self._input.tree[row]))
        return pending

    def _order(self, trees: list[int]) -> list[int]:
        """Earlier bodies first, then from the ground up, then larger ones first."""

        def key(tree: int) -> tuple[bool, float, float]:
            shapes = self._shapes_of(self._trees[tree])
            if not len(shapes):
                return False, 0.0, 0.0
            low, high = self._low[shapes].min(axis=0), self._high[shapes].max(axis=0)
            is_new = bool(self._input.is_new[self._trees[tree]].any())
            return is_new, float(np.floor(low[2] / _LEVEL_M)), -float(np.prod(high - low))

        return sorted(trees, key=key)

    def _shapes_of(self, rows: Indices) -> Indices:
        first = self._input.shapes.first_shape
        ranges = [np.arange(first[row], first[row + 1]) for row in rows.tolist() if not self._input.is_ignored[row]]
        return np.concatenate(ranges) if ranges else np.zeros(0, dtype=np.intp)

    # -- one tree ------------------------------------------------------------------------------------------------------

    def _place(self, tree: int, placed: NDArray[np.bool_], pending: set[int]) -> None:
        """Moves a tree out of all placed bodies, or else records why it cannot be."""
        rows = self._trees[tree]
        own = self._shapes_of(rows)
        if not len(own):
            return
        carried = self._carried.get(tree, np.zeros(3))
        self._apply(own, carried)
        is_obstacle = placed & ~self._input.is_ignored
        is_obstacle[rows] = False
        extent = self._high[own].max(axis=0) - self._low[own].min(axis=0)
        hits = self._hit_bodies(own, is_obstacle)
        loose_hits = [row for row in hits if self._input.is_loose[row]]
        beside, above = (_MAX_FRACTION_BESIDE, _MAX_FRACTION_ABOVE) if loose_hits else (_MAX_FRACTION_OF_SIZE,) * 2
        shift = self._way_out(own, is_obstacle, extent, beside=beside, above=above)
        if shift is None and loose_hits:
            is_obstacle &= ~self._input.is_loose
            shift = self._way_out(own, is_obstacle, extent, beside=_MAX_FRACTION_OF_SIZE, above=_MAX_FRACTION_OF_SIZE)
            if shift is not None:
                self._apply(own, shift)
                self._exclude_nested(rows, own, placed)
        elif shift is not None:
            self._apply(own, shift)
        if shift is None:
            self._result.stuck += rows.tolist()
            self._result.stuck_pairs += [(row, hit) for row in rows.tolist() for hit in hits]
            text = f"{self._name(rows)} is stuck in {self._names(hits)}: it is simulated as static"
            self._result.notes.append(SpawnNote(SpawnNoteKind.SETTLED, self._note_ids(rows, hits), text))
        elif np.any(shift + carried):
            self._result.shifts |= dict.fromkeys(rows.tolist(), shift + carried)
            self._note_shift(rows, hits, shift + carried)
            pending |= self._trees_in_the_way(own, placed)
            if shift[2] + carried[2] > 0.0:
                pending |= self._carry(own, shift + carried, placed)

    def _apply(self, own: Indices, shift: Array) -> None:
        self._shift[own] += shift
        self._low[own] += shift
        self._high[own] += shift

    def _way_out(
        self, own: Indices, is_obstacle: NDArray[np.bool_], extent: Array, *, beside: float, above: float
    ) -> Array | None:
        """The least shift after which a tree overlaps no obstacle; None if it is too far."""
        found = [shift for shift in [self._pairwise_way(own, is_obstacle)] if shift is not None]
        if not found or float(np.linalg.norm(found[0])) > _CHEAP_SHIFT_M:
            found += self._straight_ways(own, is_obstacle, extent)
        usable = [shift for shift in found if _fraction_of(shift, extent) <= (above if _is_upward(shift) else beside)]
        return min(usable, key=_cost, default=None)

    def _pairwise_way(self, own: Indices, is_obstacle: NDArray[np.bool_]) -> Array | None:
        """The shift that resolves one pair of shapes after the other, the deepest first; None if that does not end."""
        shift = np.zeros(3)
        for _ in range(_MAX_GREEDY_STEPS):
            i, j = self._near(own, is_obstacle, shift)
            if not len(i):
                return shift
            distances, directions = self._input.shapes.separations(i, j, self._shift[i] + shift - self._shift[j])
            weighted = distances * _weights(directions)
            best = weighted.argmin(axis=1)
            row = np.arange(len(i))
            is_deep = distances.min(axis=1) > _CONTACT_M
            if not is_deep.any():
                return shift
            worst = int(np.where(is_deep, weighted[row, best], -np.inf).argmax())
            shift = shift + distances[worst, best[worst]] * directions[worst, best[worst]]
        return None

    def _straight_ways(self, own: Indices, is_obstacle: NDArray[np.bool_], extent: Array) -> list[Array]:
        """The shifts along the axes of the world after which nothing overlaps."""
        ways = []
        for direction in _WORLD_DIRECTIONS:
            limit = float(np.abs(direction) @ extent) * _MAX_FRACTION_OF_SIZE
            distance = 0.0
            for _ in range(_MAX_LINE_STEPS):
                step = self._step_along(own, is_obstacle, direction * distance, direction)
                if step <= 0.0:
                    ways.append(direction * distance)
                    break
                distance += step
                if distance > limit:
                    break
        return ways

    def _step_along(self, own: Indices, is_obstacle: NDArray[np.bool_], shift: Array, direction: Array) -> float:
        """How far a shifted tree has to be moved on so that its present overlaps end; 0 if there are none."""
        i, j = self._near(own, is_obstacle, shift)
        if not len(i):
            return 0.0
        relative = self._shift[i] + shift - self._shift[j]
        distances, _ = self._input.shapes.separations(i, j, relative)
        is_deep = distances.min(axis=1) > _CONTACT_M
        if not is_deep.any():
            return 0.0
        along = self._input.shapes.overlaps_along(i[is_deep], j[is_deep], relative[is_deep], direction)
        return float(along.max()) + _CONTACT_M / 10

    def _near(self, own: Indices, is_obstacle: NDArray[np.bool_], shift: Array) -> tuple[Indices, Indices]:
        """Pairs of a tree's shapes and obstacles' shapes whose bounds overlap."""
        low, high = self._low[own] + shift, self._high[own] + shift
        first, last = low.min(axis=0), high.max(axis=0)
        others = np.flatnonzero(is_obstacle[self._owner] & np.all((self._low < last) & (self._high > first), axis=1))
        meets = np.all(
            (low[:, None] + _CONTACT_M < self._high[others]) & (self._low[others] + _CONTACT_M < high[:, None]), axis=2
        )
        a, b = np.nonzero(meets)
        i, j = own[a], others[b]
        if self._input.excluded_pairs and len(i):
            pairs = zip(self._owner[i].tolist(), self._owner[j].tolist(), strict=True)
            kept = [pair not in self._input.excluded_pairs for pair in pairs]
            i, j = i[kept], j[kept]
        return i, j

    # -- decisions and notes -------------------------------------------------------------------------------------------

    def _hit_bodies(self, own: Indices, is_obstacle: NDArray[np.bool_]) -> list[int]:
        """The bodies that a tree overlaps."""
        i, j = self._near(own, is_obstacle, np.zeros(3))
        if not len(i):
            return []
        distances, _ = self._input.shapes.separations(i, j, self._shift[i] - self._shift[j])
        return list(dict.fromkeys(self._owner[j[distances.min(axis=1) > _CONTACT_M]].tolist()))

    def _exclude_nested(self, rows: Indices, own: Indices, placed: NDArray[np.bool_]) -> None:
        """Excludes contact with the loose bodies that a tree still overlaps."""
        is_loose_obstacle = placed & self._input.is_loose & ~self._input.is_ignored
        is_loose_obstacle[rows] = False
        i, j = self._near(own, is_loose_obstacle, np.zeros(3))
        if not len(i):
            return
        distances, _ = self._input.shapes.separations(i, j, self._shift[i] - self._shift[j])
        is_deep = distances.min(axis=1) > _CONTACT_M
        pairs = zip(self._owner[i[is_deep]].tolist(), self._owner[j[is_deep]].tolist(), strict=True)
        self._result.nested_pairs += list(dict.fromkeys(pairs))

    def _carry(self, own: Indices, shift: Array, placed: NDArray[np.bool_]) -> set[int]:
        """Translates what stands on a lifted tree with it; returns those trees."""
        found = set()
        for shape in own.tolist():
            gap = self._first_low[:, 2] - self._first_high[shape, 2]
            is_over = (self._first_low[:, :2] < self._first_high[shape, :2]) & (
                self._first_high[:, :2] > self._first_low[shape, :2]
            )
            stands = (np.abs(gap) <= KEPT_POSE_TOLERANCE_M) & is_over.all(axis=1)
            found |= set(self._input.tree[self._owner[stands & ~placed[self._owner]]].tolist())
        carried = {tree for tree in found if tree in self._trees and tree not in self._carried}
        self._carried |= dict.fromkeys(carried - {int(self._input.tree[self._owner[own[0]]])}, shift)
        return carried

    def _trees_in_the_way(self, own: Indices, placed: NDArray[np.bool_]) -> set[int]:
        """Trees that are not placed yet, and that a moved one may overlap now."""
        first, last = self._low[own].min(axis=0), self._high[own].max(axis=0)
        meets = np.all((self._low < last) & (self._high > first), axis=1) & ~placed[self._owner]
        return set(self._input.tree[self._owner[meets]].tolist())

    def _note_shift(self, rows: Indices, hits: Sequence[int], shift: Array) -> None:
        distance_mm = float(np.linalg.norm(shift)) * 1000
        ids = self._note_ids(rows, hits)
        if distance_mm <= KEPT_POSE_TOLERANCE_M * 1000:
            text = f"{self._name(rows)} penetrates {self._names(hits)} by up to {distance_mm:.0f} mm and is pushed out"
            self._result.notes.append(SpawnNote(SpawnNoteKind.EMBEDDED, ids, text))
            return
        x, y, z = shift.tolist()
        text = (
            f"{self._name(rows)} overlaps {self._names(hits)}: it is moved by {distance_mm:.0f} mm, "
            f"({x:.3f}, {y:.3f}, {z:.3f}) m"
        )
        self._result.notes.append(SpawnNote(SpawnNoteKind.SETTLED, ids, text))

    def _note_ids(self, rows: Indices, hits: Sequence[int]) -> tuple[BodyId, ...]:
        return tuple(self._input.ids[row] for row in (int(rows[0]), *hits))

    def _name(self, rows: Indices) -> str:
        first = self._input.ids[int(rows[0])]
        return first if len(rows) == 1 else f"{first} with {len(rows) - 1} connected bodies"

    def _names(self, rows: Sequence[int]) -> str:
        return ", ".join(self._input.ids[row] for row in rows) or "what is below it"


def _weights(directions: Array) -> Array:
    """The weight of a distance in each direction."""
    return np.asarray(1.0 + (_DOWNWARD_WEIGHT - 1.0) * np.maximum(-directions[..., 2], 0.0))


def _cost(shift: Array) -> float:
    distance = float(np.linalg.norm(shift))
    return distance * float(_weights(shift / distance)) if distance > 0.0 else 0.0


def _is_upward(shift: Array) -> bool:
    return float(shift[2]) >= 0.7 * float(np.linalg.norm(shift))


def _fraction_of(shift: Array, extent: Array) -> float:
    """A shift relative to the extent of a box along it."""
    distance = float(np.linalg.norm(shift))
    return 0.0 if distance == 0.0 else distance**2 / max(float(np.abs(shift) @ extent), 1e-12)


def nested_notes(pairs: Sequence[tuple[BodyId, BodyId]]) -> list[SpawnNote]:
    """Notes on loose bodies that stand inside each other, one for each that was placed later."""
    others: dict[BodyId, list[BodyId]] = {}
    for later, earlier in pairs:
        others.setdefault(later, []).append(earlier)
    notes = []
    for id, names in others.items():
        text = f"{id} and {', '.join(names)} stand inside each other: they do not collide"
        notes.append(SpawnNote(SpawnNoteKind.OVERLAP, (id, *names), text))
    return notes
