"""Qualitative spatial relations between bodies, computed from their oriented bounding boxes.

Down is the world's -z. A box includes the free space within it (below a table, inside a fridge), and round bodies fill
their box. In the rules below, the *footprint* of a body is the vertical projection of its box, its *container* is the
smallest body that it is inside of, and bodies of one *rigid group* are connected by attachments.

- **inside**: the larger box contains at least 80 % of the smaller one along each of its own axes. The gap is the
  smallest distance of the inner box to a side of the container (negative if it sticks out); the overlap is the fraction
  of the inner box that is inside.
- **on**: the underside of the body is at the top of the other one, from 20 mm below it (but at most half of either
  height) to 5 mm above it; the footprints overlap by at least 10 % of the smaller one; both have the same container. A
  body that is held by a joint is on nothing else, as a drawer rests on its slides, and supports only dynamic bodies: a
  counter is not on the door below it. The gap is from the top to the underside; the overlap is relative to the smaller
  footprint.
- **above**: as "on", but up to 3 m higher, which is one story, and not "on". Gap and overlap are the same.
- **below**: the inverse of both "on" and "above".
- **next to**: the horizontal gap between the footprints is at most 0.25 m; the footprints overlap by less than 10 %,
  the heights by at least half of the smaller one, which is the overlap. Both have the same container, are in different
  rigid groups, and no joint connects these: milk in a fridge is not next to a cup outside, nor is a door next to the
  cupboard that it closes.

Enclosing bodies, such as walls and panoramas, contain everything else: the bounding box of the walls of a kitchen
contains the whole kitchen. They take part in no relation, and neither do bodies without a size.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Container, Iterable, Iterator
from copy import copy
from enum import StrEnum
from functools import cached_property
from math import isfinite
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mindstage.scene.bounding_boxes import (
    Indices,
    OrientedBoxes,
    contains,
    footprints,
    overlapping_pairs,
    polygon_areas,
    polygon_gaps,
    polygon_overlap_areas,
)
from mindstage.scene.joint_kinematics import RigidGroups
from mindstage.scene.transforms import Array, normalize, pose_array
from mindstage.scene.world_model import Body, BodyId, Vector, World

__all__ = [
    "ENCLOSURE_MIN_CONTENTS",
    "ENCLOSURE_MIN_SIZE_M",
    "SCENERY_MIN_SIZE_M",
    "RelatedPair",
    "SpatialRelation",
    "SpatialRelations",
    "find_enclosing_bodies",
]


ENCLOSURE_MIN_SIZE_M = (1.0, 2.0, 2.0)
"""Smallest sorted extents of an enclosing body: a person fits in it."""
SCENERY_MIN_SIZE_M = 30.0
"""Larger bodies are scenery, such as a panorama, and do not belong to the place [m]."""
ENCLOSURE_MIN_CONTENTS = 3
"""Smallest number of furniture groups in an enclosing body that no joint connects to it."""


def find_enclosing_bodies(
    boxes: OrientedBoxes,
    containing_pairs: tuple[Indices, Indices],
    *,
    is_dynamic: NDArray[np.bool_],
    is_free: NDArray[np.bool_],
    group: NDArray[np.intp],
    jointed_pairs: Container[tuple[int, int]],
) -> dict[int, int]:
    """Returns the rows of enclosing bodies, and the number of furniture groups in each.

    Scenery that is larger than `SCENERY_MIN_SIZE_M` in all directions, such as a sky sphere, encloses whatever is in
    it, and its number is that of the bodies.

    Args:
        boxes: the boxes of all bodies.
        containing_pairs: rows (outer, inner) of bodies of different rigid groups, of which one contains the other.
        is_dynamic: for each body, whether the physics simulation moves it.
        is_free: for each body, whether it is dynamic and not held by a joint; all others are furniture.
        group: for each body, the number of its rigid group.
        jointed_pairs: pairs of groups, in either order, that a joint connects.
    """
    large = np.all(np.sort(2 * boxes.half_extents, axis=1) >= ENCLOSURE_MIN_SIZE_M, axis=1) & ~is_dynamic
    outer, inner = containing_pairs
    furniture = large[outer] & ~is_free[inner]
    is_scenery = (2 * boxes.half_extents).min(axis=1) > SCENERY_MIN_SIZE_M
    found = dict(Counter(outer[is_scenery[outer] & large[outer]].tolist()))
    held: dict[int, set[int]] = {}
    for o, i in zip(outer[furniture].tolist(), group[inner[furniture]].tolist(), strict=True):
        held.setdefault(o, set()).add(i)
    for o, inside in sorted(held.items()):
        own = int(group[o])
        if (
            sum((own, i) not in jointed_pairs and (i, own) not in jointed_pairs for i in inside)
            >= ENCLOSURE_MIN_CONTENTS
        ):
            found[o] = len(inside)
    return found


_MIN_INSIDE_FRACTION = 0.8
_ON_MAX_GAP_M, _ON_MAX_DEPTH_M = 0.005, 0.02
_ABOVE_MAX_GAP_M = 3.0
_MIN_FOOTPRINT_FRACTION = 0.1
_NEXT_TO_MAX_GAP_M, _MIN_HEIGHT_FRACTION = 0.25, 0.5
_MAX_COMPARED = 64
"""Number of bodies that are compared with all others instead of sorting all."""
_ROUNDING_TOLERANCE = 1e-9
"""Tolerance of all thresholds, so that the result does not depend on the pose of the scene as a whole."""


class SpatialRelation(StrEnum):
    """The spatial relation of one body to another."""

    ON = "on"
    INSIDE = "inside"
    ABOVE = "above"
    BELOW = "below"
    NEXT_TO = "next_to"


class RelatedPair(NamedTuple):
    """Two bodies and the relation of the first to the second."""

    body: Body
    relation: SpatialRelation
    other: Body
    gap: float
    """[m], rounded to micrometers; see the module for its definition."""
    overlap: float
    """0 to 1; see the module for its definition."""


class _RelationRows(NamedTuple):
    """Pairs of one relation, as rows of the bodies."""

    relation: SpatialRelation
    body: Indices
    other: Indices
    gap: Array
    overlap: Array


class _ContainingPairs(NamedTuple):
    """Pairs of bodies of which one contains at least most of the other, as rows."""

    outer: Indices
    inner: Indices
    is_whole: NDArray[np.bool_]
    """Whether all of the inner body is inside, and it is in another rigid group."""


class SpatialRelations:
    """The spatial relations between the bodies of a world."""

    def __init__(self, world: World) -> None:
        rows = [row for row, body in enumerate(world.bodies) if _has_extent(body)]
        self._rows = np.full(len(world.bodies), -1)
        self._rows[rows] = np.arange(len(rows))
        self.bodies = tuple(world.bodies[row] for row in rows)
        self._row_by_id = {body.id: row for row, body in enumerate(self.bodies)}
        sizes = np.array([body.size for body in self.bodies], dtype=np.float64).reshape(-1, 3)
        self._volume = np.prod(sizes, axis=1)
        groups = RigidGroups.from_world(world)
        self._group, self._is_jointed = groups.root_row[rows], groups.is_jointed[rows]
        self._is_dynamic, self._jointed_pairs = groups.is_dynamic[rows], groups.jointed_pairs
        self._boxes = OrientedBoxes.from_poses(_unit_poses(self.bodies), sizes)
        self._bounds = self._boxes.bounds()
        self._footprints = footprints(self._boxes)
        self._areas = polygon_areas(self._footprints)
        everything = np.ones(len(rows), dtype=bool)
        self._containing = self._containing_pairs(overlapping_pairs(self._boxes, everything, everything))
        self._find_enclosing()
        self._container = self._smallest_container(self._outer, self._inner)

    def moved(self, world: World, rows: Indices) -> SpatialRelations:
        """The relations of a world in which only the poses of some bodies, and of joints, are others.

        The time is that of the moved bodies, and of copies of arrays.

        Args:
            world: the world, with the same bodies, joints and attachments in the same order.
            rows: the bodies that have moved, as indices into its bodies.
        """
        changed = [world.bodies[row] for row in rows.tolist()]
        own = self._rows[rows]
        if [_has_extent(body) for body in changed] != (own >= 0).tolist():
            return SpatialRelations(world)
        changed, own = [body for body, row in zip(changed, own.tolist(), strict=True) if row >= 0], own[own >= 0]
        new = copy(self)
        bodies = list(self.bodies)
        for row, body in zip(own.tolist(), changed, strict=True):
            bodies[row] = body
        new.bodies = tuple(bodies)
        new._boxes = self._boxes.with_poses(own, _unit_poses(changed))
        part = new._boxes.rows(own)
        low, high = part.bounds()
        new._bounds = _with_rows(self._bounds[0], own, low), _with_rows(self._bounds[1], own, high)
        outlines = footprints(part)
        new._footprints = _with_rows(self._footprints, own, outlines)
        new._areas = _with_rows(self._areas, own, polygon_areas(outlines))
        is_moved = np.zeros(len(bodies), dtype=bool)
        is_moved[own] = True
        before = self._containing
        stays = ~(is_moved[before.outer] | is_moved[before.inner])
        found = new._containing_pairs(new._close_pairs(is_moved, np.ones(len(bodies), dtype=bool)))
        new._containing = _ContainingPairs(
            *(np.concatenate([old[stays], added]) for old, added in zip(before, found, strict=True))
        )
        new._find_enclosing()
        if new._enclosing.keys() == self._enclosing.keys():
            is_moved[before.inner[~stays]] = True
            is_moved[found.inner] = True
            concerned = is_moved[new._inner]
            new._container = np.where(
                is_moved, new._smallest_container(new._outer[concerned], new._inner[concerned]), self._container
            )
        else:
            new._container = new._smallest_container(new._outer, new._inner)
        return new

    def _find_enclosing(self) -> None:
        """Finds the enclosing bodies, and the pairs without them."""
        outer, inner, is_whole = self._containing
        self._enclosing = find_enclosing_bodies(
            self._boxes,
            (outer[is_whole], inner[is_whole]),
            is_dynamic=self._is_dynamic,
            is_free=self._is_dynamic & ~self._is_jointed,
            group=self._group,
            jointed_pairs=self._jointed_pairs,
        )
        self._is_related = np.ones(len(self.bodies), dtype=bool)
        self._is_related[list(self._enclosing)] = False
        related = self._is_related[outer] & self._is_related[inner]
        self._outer, self._inner = outer[related], inner[related]

    @property
    def enclosing_bodies(self) -> tuple[BodyId, ...]:
        """Bodies that contain everything else, which take part in no relation."""
        return tuple(self.bodies[row].id for row in self._enclosing)

    def related(
        self,
        *,
        subjects: Collection[BodyId] | None = None,
        others: Collection[BodyId] | None = None,
        relations: Collection[SpatialRelation] = tuple(SpatialRelation),
    ) -> Iterator[RelatedPair]:
        """Yields related pairs of bodies, each relation once, in no particular order.

        Args:
            subjects: restricts the first body; None for all.
            others: restricts the second body; None for all.
            relations: the relations to compute.
        """
        subject_mask, other_mask = self._mask(subjects), self._mask(others)
        for found in self._pairs(subject_mask, other_mask, frozenset(relations)):
            kept = subject_mask[found.body] & other_mask[found.other]
            columns = (found.body[kept], found.other[kept], found.gap[kept].round(6), found.overlap[kept].round(6))
            for body, other, gap, overlap in zip(*(column.tolist() for column in columns), strict=True):
                yield RelatedPair(self.bodies[body], found.relation, self.bodies[other], gap + 0.0, overlap)

    def _mask(self, ids: Collection[BodyId] | None) -> NDArray[np.bool_]:
        if ids is None:
            return self._is_related
        mask = np.zeros(len(self.bodies), dtype=bool)
        mask[[self._row_by_id[id] for id in ids if id in self._row_by_id]] = True
        return mask & self._is_related

    def _pairs(
        self, subjects: NDArray[np.bool_], others: NDArray[np.bool_], relations: frozenset[SpatialRelation]
    ) -> Iterator[_RelationRows]:
        if SpatialRelation.INSIDE in relations:
            concerned = subjects[self._inner] & others[self._outer]
            yield self._inside_rows(self._outer[concerned], self._inner[concerned])
        if relations & {SpatialRelation.ON, SpatialRelation.ABOVE, SpatialRelation.BELOW}:
            for a, b in self._close_pairs(subjects, others, (0.0, 0.0, _ABOVE_MAX_GAP_M)):
                yield from (each for each in self._vertical_rows(a, b) if each.relation in relations)
        if SpatialRelation.NEXT_TO in relations:
            for a, b in self._close_pairs(subjects, others, (_NEXT_TO_MAX_GAP_M, _NEXT_TO_MAX_GAP_M, 0.0)):
                yield self._next_to_rows(a, b)

    def _close_pairs(
        self, first: NDArray[np.bool_], second: NDArray[np.bool_], margin: Vector = (0.0, 0.0, 0.0)
    ) -> Iterator[tuple[Indices, Indices]]:
        """As `overlapping_pairs`, which sorts all bodies; a few are compared with all instead."""
        few, many = sorted((first, second), key=np.count_nonzero)
        rows = np.flatnonzero(few)
        if len(rows) <= _MAX_COMPARED:
            return self._pairs_of(rows, many, margin=margin)
        return overlapping_pairs(self._boxes, first, second, margin=margin)

    def _pairs_of(
        self, rows: Indices, others: NDArray[np.bool_], *, margin: Vector = (0.0, 0.0, 0.0)
    ) -> Iterator[tuple[Indices, Indices]]:
        """Yields pairs of some bodies with others whose bounds overlap, each once, for one body at a time."""
        low, high = self._bounds
        reach = np.asarray(margin) + _ROUNDING_TOLERANCE
        left = others.copy()
        for row in rows.tolist():
            left[row] = False  # its pairs with later ones are found now
            least, most = low[row] - reach, high[row] + reach
            near = np.flatnonzero((low[:, 0] <= most[0]) & (high[:, 0] >= least[0]) & left)
            near = near[np.all((low[near] <= most) & (high[near] >= least), axis=1)]
            yield np.full(len(near), row), near

    # -- inside --------------------------------------------------------------------------------------------------------

    def _containing_pairs(self, overlapping: Iterable[tuple[Indices, Indices]]) -> _ContainingPairs:
        """Those of the overlapping pairs of which one body contains the other."""
        found = []
        for a, b in overlapping:
            larger = self._volume[a] > self._volume[b]
            outer, inner = np.where(larger, a, b), np.where(larger, b, a)
            holds = contains(self._boxes, outer, inner, min_fraction=_MIN_INSIDE_FRACTION) & (
                self._volume[a] != self._volume[b]
            )
            found.append(np.stack([outer[holds], inner[holds]]))
        outer, inner = np.concatenate([np.zeros((2, 0), dtype=np.intp), *found], axis=1)
        is_whole = (self._group[outer] != self._group[inner]) & contains(self._boxes, outer, inner)
        return _ContainingPairs(outer, inner, is_whole)

    def _smallest_container(self, outer: Indices, inner: Indices) -> Indices:
        """Returns, for each body, the row of the smallest body that it is inside of; -1 for none."""
        container = np.full(len(self.bodies), -1)
        order = np.lexsort((outer, -self._volume[outer]))
        container[inner[order]] = outer[order]  # the last assignment wins
        return container

    def _inside_rows(self, outer: Indices, inner: Indices) -> _RelationRows:
        boxes = self._boxes
        turn = np.swapaxes(boxes.rotation[outer], 1, 2)
        offset = np.abs(np.einsum("pij,pj->pi", turn, boxes.center[inner] - boxes.center[outer]))
        reach = np.einsum("pij,pj->pi", np.abs(turn @ boxes.rotation[inner]), boxes.half_extents[inner])
        room = boxes.half_extents[outer] - offset
        held = np.clip((np.minimum(room, reach) + reach) / np.maximum(2 * reach, _ROUNDING_TOLERANCE), 0.0, 1.0)
        return _RelationRows(SpatialRelation.INSIDE, inner, outer, (room - reach).min(axis=1), held.prod(axis=1))

    # -- on, above and below -------------------------------------------------------------------------------------------

    def _vertical_rows(self, a: Indices, b: Indices) -> Iterator[_RelationRows]:
        a, b = self._in_same_container(a, b)
        low, high = (side[:, 2] for side in self._bounds)
        middle_a, middle_b = low[a] + high[a], low[b] + high[b]
        over = middle_a > middle_b
        upper, lower = np.where(over, a, b), np.where(over, b, a)
        gap = low[upper] - high[lower]
        half_heights = (high[upper] - low[upper]) / 2, (high[lower] - low[lower]) / 2
        sinks = np.minimum(_ON_MAX_DEPTH_M, np.minimum(*half_heights))
        clear = (
            (middle_a != middle_b)
            & (gap >= -sinks - _ROUNDING_TOLERANCE)
            & (gap <= _ABOVE_MAX_GAP_M + _ROUNDING_TOLERANCE)
        )
        upper, lower, gap = upper[clear], lower[clear], gap[clear]
        overlap = self._footprint_overlap(upper, lower)
        over = overlap >= _MIN_FOOTPRINT_FRACTION - _ROUNDING_TOLERANCE
        upper, lower, gap, overlap = upper[over], lower[over], gap[over], overlap[over]
        rests = (
            (gap <= _ON_MAX_GAP_M + _ROUNDING_TOLERANCE)
            & ~self._is_jointed[upper]
            & (self._is_dynamic[upper] | ~self._is_jointed[lower])
        )
        yield _RelationRows(SpatialRelation.ON, upper[rests], lower[rests], gap[rests], overlap[rests])
        yield _RelationRows(SpatialRelation.ABOVE, upper[~rests], lower[~rests], gap[~rests], overlap[~rests])
        yield _RelationRows(SpatialRelation.BELOW, lower, upper, gap, overlap)

    def _footprint_overlap(self, a: Indices, b: Indices) -> Array:
        """Returns the area of the intersection of each pair relative to the smaller footprint."""
        smaller = np.minimum(self._areas[a], self._areas[b])
        both = polygon_overlap_areas(self._footprints, a, b)
        return np.divide(both, smaller, out=np.zeros(len(a)), where=smaller > 0.0).clip(0.0, 1.0)

    # -- next to -------------------------------------------------------------------------------------------------------

    def _next_to_rows(self, a: Indices, b: Indices) -> _RelationRows:
        a, b = self._in_same_container(a, b)
        low, high = (side[:, 2] for side in self._bounds)
        shared = np.minimum(high[a], high[b]) - np.maximum(low[a], low[b])
        lower = np.minimum(high[a] - low[a], high[b] - low[b])
        overlap = np.divide(shared, lower, out=np.zeros(len(a)), where=lower > 0.0)
        level = (overlap >= _MIN_HEIGHT_FRACTION - _ROUNDING_TOLERANCE) & self._unconnected(a, b)
        a, b, overlap = a[level], b[level], overlap[level]
        covered = self._footprint_overlap(a, b)
        aside = covered < _MIN_FOOTPRINT_FRACTION - _ROUNDING_TOLERANCE
        a, b, overlap, covered = a[aside], b[aside], overlap[aside], covered[aside]
        gap = np.where(covered > 0.0, 0.0, polygon_gaps(self._footprints, a, b))
        near = gap <= _NEXT_TO_MAX_GAP_M + _ROUNDING_TOLERANCE
        a, b, gap, overlap = a[near], b[near], gap[near], overlap[near]
        both = (np.concatenate([a, b]), np.concatenate([b, a]))
        return _RelationRows(SpatialRelation.NEXT_TO, *both, np.tile(gap, 2), np.tile(overlap, 2).clip(0.0, 1.0))

    def _unconnected(self, a: Indices, b: Indices) -> NDArray[np.bool_]:
        """Returns whether two bodies are in different rigid groups that no joint connects."""
        one, other = self._group[a], self._group[b]
        pairs = one * self._group_count + other
        joined = self._joined_groups
        # np.isin would load numpy.ma, which is slow.
        return np.asarray((one != other) & (joined[np.searchsorted(joined[:-1], pairs)] != pairs))

    @cached_property
    def _group_count(self) -> int:
        return int(self._group.max(initial=0)) + 1

    @cached_property
    def _joined_groups(self) -> Indices:
        """The pairs of groups that a joint connects, as sorted numbers, and -1."""
        pairs = (each for pair in self._jointed_pairs for each in (pair, pair[::-1]))
        return np.array([*sorted(first * self._group_count + second for first, second in pairs), -1], dtype=np.intp)

    def _in_same_container(self, a: Indices, b: Indices) -> tuple[Indices, Indices]:
        """Returns the pairs of related bodies with the same container, or both without one."""
        same = (self._container[a] == self._container[b]) & self._is_related[a] & self._is_related[b]
        return a[same], b[same]


def _unit_poses(bodies: Iterable[Body]) -> Array:
    poses = pose_array(body.pose for body in bodies)
    poses[:, 3:] = normalize(poses[:, 3:])
    return poses


def _with_rows(array: Array, rows: Indices, values: Array) -> Array:
    """A copy in which some rows have other values."""
    changed = array.copy()
    changed[rows] = values
    return changed


def _has_extent(body: Body) -> bool:
    size, pose = body.size, body.pose
    return size is not None and all(map(isfinite, (*size, *pose.position, *pose.quaternion))) and any(pose.quaternion)
