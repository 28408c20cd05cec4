"""Space: where things are relative to one another, by the boxes around them.

Down is where things fall, along the world's -z. Every rule below measures boxes: what a box stands round (the room
under a table, the inside of a fridge) belongs to it, and what is round fills its box. In the words of the rules, a
thing's *footprint* is the shadow of its box on the ground, its *place* is the smallest thing that it is inside of, and
two things *hang together* by attachments.

- **inside**: the larger box holds at least 80 % of the thing's box along each of its own axes. The gap is the way from
  the thing to the nearest side of what it is in (negative where it sticks out), the share how much of it is inside.
- **on**: the thing's underside is where the other one's top is, from 20 mm below it (yet no more than half of either
  height) to 5 mm above it, and the footprints share at least 10 % of the smaller one; both have the same place. What a
  constraint holds is on nothing else, as a drawer rests on its slides, and carries only what the physics moves: the
  counter is not on the door below it. The gap runs from the top to the underside, the share is that of the smaller
  footprint.
- **above**: likewise up to 3 m higher, which is one storey, and whatever holds it; what is on something is not above
  it. Gap and share are the same.
- **below**: the other way round of both, on and above.
- **next to**: no more than 0.25 m of level ground lies between the footprints, which is the gap; they share less than
  10 %, the heights at least half of the smaller one, which is the share. Both have the same place, do not hang
  together, and no constraint joins them: the milk in the fridge is not next to the cup outside, nor is a door next to
  the cupboard that it closes.

A shell (see `enclosing_bodies`) is where everything is and takes part in nothing, and neither does what has no size.

Shells: bodies that everything is in, such as walls or a panorama.

Maps give each body the box around it, and the box around the walls of a kitchen holds the whole kitchen. Such a body
is where things are, not one of them.
"""

from __future__ import annotations

from collections.abc import Collection, Container, Iterator
from enum import StrEnum
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
from mindstage.scene.kinematics import RigidGroups
from mindstage.scene.model import Body, BodyId, World
from mindstage.scene.transforms import Array, normalize, pose_array

__all__ = [
    "ENCLOSURE_MIN_CONTENTS",
    "ENCLOSURE_MIN_SIZE_M",
    "RelatedPair",
    "SpatialRelation",
    "SpatialRelations",
    "find_enclosing_bodies",
]


ENCLOSURE_MIN_SIZE_M = (1.0, 2.0, 2.0)
"""A shell is at least so large along its shortest, middle and longest side: one can stand in it."""
ENCLOSURE_MIN_CONTENTS = 3
"""A shell holds at least so many pieces of furniture that do not hang on it."""


def find_enclosing_bodies(
    boxes: OrientedBoxes,
    containing_pairs: tuple[Indices, Indices],
    *,
    is_dynamic: NDArray[np.bool_],
    is_free: NDArray[np.bool_],
    group: NDArray[np.intp],
    jointed_pairs: Container[tuple[int, int]],
) -> dict[int, int]:
    """Shells, and how many pieces of furniture each holds.

    Args:
        boxes: all bodies.
        holds: pairs (outer, inner) of bodies of different assemblies, of which the one holds the other.
        moves: for each body, whether the physics moves it.
        loose: for each body, whether it stands on its own and could be taken away; all others are furniture.
        assembly: for each body, the number of those that hang together rigidly.
        joined: pairs of assemblies, in one order or the other, that a constraint joins.
    """
    large = np.all(np.sort(2 * boxes.half_extents, axis=1) >= ENCLOSURE_MIN_SIZE_M, axis=1) & ~is_dynamic
    outer, inner = containing_pairs
    furniture = large[outer] & ~is_free[inner]
    held: dict[int, set[int]] = {}
    for o, i in zip(outer[furniture].tolist(), group[inner[furniture]].tolist(), strict=True):
        held.setdefault(o, set()).add(i)
    found = {}
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
_MIN_FOOTPRINT_OVERLAP = 0.1
_NEXT_TO_MAX_GAP_M, _MIN_HEIGHT_OVERLAP = 0.25, 0.5
_ROUNDING_TOLERANCE = 1e-9
"""A limit counts as kept within rounding, so that a world that is turned or moved as a whole answers the same."""


class SpatialRelation(StrEnum):
    """How one thing stands to another."""

    ON = "on"
    INSIDE = "inside"
    ABOVE = "above"
    BELOW = "below"
    NEXT_TO = "next_to"


class RelatedPair(NamedTuple):
    """One thing and another."""

    body: Body
    relation: SpatialRelation
    other: Body
    gap: float
    """[m], to the micrometre."""
    overlap: float
    """0 to 1."""


class _RelationRows(NamedTuple):
    """Many of one relation, as rows of the bodies."""

    relation: SpatialRelation
    body: Indices
    other: Indices
    gap: Array
    overlap: Array


class SpatialRelations:
    """The bodies of a world as boxes, at one moment."""

    def __init__(self, world: World) -> None:
        rows = [row for row, body in enumerate(world.bodies) if _has_extent(body)]
        self.bodies = tuple(world.bodies[row] for row in rows)
        self._row_by_id = {body.id: row for row, body in enumerate(self.bodies)}
        poses = pose_array(body.pose for body in self.bodies)
        poses[:, 3:] = normalize(poses[:, 3:])
        sizes = np.array([body.size for body in self.bodies], dtype=np.float64).reshape(-1, 3)
        self._boxes = OrientedBoxes.from_poses(poses, sizes)
        low, high = self._boxes.bounds()
        self._low, self._high = low[:, 2], high[:, 2]
        self._footprints = footprints(self._boxes)
        self._areas = polygon_areas(self._footprints)
        self._volume = np.prod(sizes, axis=1)
        assemblies = RigidGroups.from_world(world)
        self._group, self._is_jointed = assemblies.root_row[rows], assemblies.is_jointed[rows]
        self._is_dynamic, self._jointed_pairs = assemblies.is_dynamic[rows], assemblies.jointed_pairs
        outer, inner = self._containing_pairs()
        apart = self._group[outer] != self._group[inner]
        apart &= contains(self._boxes, outer, inner)
        self._enclosing = find_enclosing_bodies(
            self._boxes,
            (outer[apart], inner[apart]),
            is_dynamic=self._is_dynamic,
            is_free=self._is_dynamic & ~self._is_jointed,
            group=self._group,
            jointed_pairs=self._jointed_pairs,
        )
        self._is_related = np.ones(len(rows), dtype=bool)
        self._is_related[list(self._enclosing)] = False
        things = self._is_related[outer] & self._is_related[inner]
        self._outer, self._inner = outer[things], inner[things]
        self._container = self._smallest_container(self._outer, self._inner)

    @property
    def enclosing_bodies(self) -> tuple[BodyId, ...]:
        """What takes part in nothing because everything is in it."""
        return tuple(self.bodies[row].id for row in self._enclosing)

    def related(
        self,
        *,
        subjects: Collection[BodyId] | None = None,
        others: Collection[BodyId] | None = None,
        relations: Collection[SpatialRelation] = tuple(SpatialRelation),
    ) -> Iterator[RelatedPair]:
        """How things stand to one another, each relation once, in no order that means anything.

        Args:
            things: only of these; None for all.
            others: only to these; None for all.
            relations: only these.
        """
        chosen = self._mask(subjects), self._mask(others)
        for found in self._pairs(*chosen, frozenset(relations)):
            kept = chosen[0][found.body] & chosen[1][found.other]
            columns = (found.body[kept], found.other[kept], found.gap[kept].round(6), found.overlap[kept].round(6))
            for thing, other, gap, share in zip(*(column.tolist() for column in columns), strict=True):
                yield RelatedPair(self.bodies[thing], found.relation, self.bodies[other], gap + 0.0, share)

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
            yield self._inside_rows()
        if relations & {SpatialRelation.ON, SpatialRelation.ABOVE, SpatialRelation.BELOW}:
            for a, b in overlapping_pairs(self._boxes, subjects, others, margin=(0.0, 0.0, _ABOVE_MAX_GAP_M)):
                yield from (each for each in self._vertical_rows(a, b) if each.relation in relations)
        if SpatialRelation.NEXT_TO in relations:
            for a, b in overlapping_pairs(
                self._boxes, subjects, others, margin=(_NEXT_TO_MAX_GAP_M, _NEXT_TO_MAX_GAP_M, 0.0)
            ):
                yield self._next_to_rows(a, b)

    # -- inside ------------------------------------------------------------------------------------------------

    def _containing_pairs(self) -> tuple[Indices, Indices]:
        """Pairs (outer, inner), shells among them."""
        everything = np.ones(len(self.bodies), dtype=bool)
        found = [np.zeros((2, 0), dtype=np.intp)]
        for a, b in overlapping_pairs(self._boxes, everything, everything):
            larger = self._volume[a] > self._volume[b]
            outer, inner = np.where(larger, a, b), np.where(larger, b, a)
            holds = contains(self._boxes, outer, inner, min_fraction=_MIN_INSIDE_FRACTION) & (
                self._volume[a] != self._volume[b]
            )
            found.append(np.stack([outer[holds], inner[holds]]))
        outer, inner = np.concatenate(found, axis=1)
        return outer, inner

    def _smallest_container(self, outer: Indices, inner: Indices) -> Indices:
        """For each body, the smallest one that it is inside of; -1 for none."""
        place = np.full(len(self.bodies), -1)
        order = np.lexsort((outer, -self._volume[outer]))
        place[inner[order]] = outer[order]  # of several the last one stays
        return place

    def _inside_rows(self) -> _RelationRows:
        boxes, outer, inner = self._boxes, self._outer, self._inner
        turn = np.swapaxes(boxes.rotation[outer], 1, 2)
        offset = np.abs(np.einsum("pij,pj->pi", turn, boxes.center[inner] - boxes.center[outer]))
        reach = np.einsum("pij,pj->pi", np.abs(turn @ boxes.rotation[inner]), boxes.half_extents[inner])
        room = boxes.half_extents[outer] - offset
        held = np.clip((np.minimum(room, reach) + reach) / np.maximum(2 * reach, _ROUNDING_TOLERANCE), 0.0, 1.0)
        return _RelationRows(SpatialRelation.INSIDE, inner, outer, (room - reach).min(axis=1), held.prod(axis=1))

    # -- over and under ----------------------------------------------------------------------------------------

    def _vertical_rows(self, a: Indices, b: Indices) -> Iterator[_RelationRows]:
        a, b = self._in_same_container(a, b)
        middle = self._low + self._high
        over = middle[a] > middle[b]
        upper, lower = np.where(over, a, b), np.where(over, b, a)
        gap = self._low[upper] - self._high[lower]
        height = (self._high - self._low) / 2
        sinks = np.minimum(_ON_MAX_DEPTH_M, np.minimum(height[upper], height[lower]))
        clear = (
            (middle[a] != middle[b])
            & (gap >= -sinks - _ROUNDING_TOLERANCE)
            & (gap <= _ABOVE_MAX_GAP_M + _ROUNDING_TOLERANCE)
        )
        upper, lower, gap = upper[clear], lower[clear], gap[clear]
        share = self._footprint_overlap(upper, lower)
        over = share >= _MIN_FOOTPRINT_OVERLAP - _ROUNDING_TOLERANCE
        upper, lower, gap, share = upper[over], lower[over], gap[over], share[over]
        rests = (
            (gap <= _ON_MAX_GAP_M + _ROUNDING_TOLERANCE)
            & ~self._is_jointed[upper]
            & (self._is_dynamic[upper] | ~self._is_jointed[lower])
        )
        yield _RelationRows(SpatialRelation.ON, upper[rests], lower[rests], gap[rests], share[rests])
        yield _RelationRows(SpatialRelation.ABOVE, upper[~rests], lower[~rests], gap[~rests], share[~rests])
        yield _RelationRows(SpatialRelation.BELOW, lower, upper, gap, share)

    def _footprint_overlap(self, a: Indices, b: Indices) -> Array:
        """How much of the smaller footprint of each pair both cover."""
        smaller = np.minimum(self._areas[a], self._areas[b])
        both = polygon_overlap_areas(self._footprints, a, b)
        return np.divide(both, smaller, out=np.zeros(len(a)), where=smaller > 0.0).clip(0.0, 1.0)

    # -- side by side ------------------------------------------------------------------------------------------

    def _next_to_rows(self, a: Indices, b: Indices) -> _RelationRows:
        a, b = self._in_same_container(a, b)
        shared = np.minimum(self._high[a], self._high[b]) - np.maximum(self._low[a], self._low[b])
        lower = np.minimum(self._high[a] - self._low[a], self._high[b] - self._low[b])
        share = np.divide(shared, lower, out=np.zeros(len(a)), where=lower > 0.0)
        level = (share >= _MIN_HEIGHT_OVERLAP - _ROUNDING_TOLERANCE) & self._unconnected(a, b)
        a, b, share = a[level], b[level], share[level]
        covered = self._footprint_overlap(a, b)
        aside = covered < _MIN_FOOTPRINT_OVERLAP - _ROUNDING_TOLERANCE
        a, b, share, covered = a[aside], b[aside], share[aside], covered[aside]
        gap = np.where(covered > 0.0, 0.0, polygon_gaps(self._footprints, a, b))
        near = gap <= _NEXT_TO_MAX_GAP_M + _ROUNDING_TOLERANCE
        a, b, gap, share = a[near], b[near], gap[near], share[near]
        both = (np.concatenate([a, b]), np.concatenate([b, a]))
        return _RelationRows(SpatialRelation.NEXT_TO, *both, np.tile(gap, 2), np.tile(share, 2).clip(0.0, 1.0))

    def _unconnected(self, a: Indices, b: Indices) -> NDArray[np.bool_]:
        """Whether two bodies neither hang together nor are joined by a constraint."""
        one, other, count = self._group[a], self._group[b], int(self._group.max(initial=0)) + 1
        joined = [first * count + second for pair in self._jointed_pairs for first, second in (pair, pair[::-1])]
        return np.asarray((one != other) & ~np.isin(one * count + other, joined))

    def _in_same_container(self, a: Indices, b: Indices) -> tuple[Indices, Indices]:
        """The pairs of things that are inside of the same one, or both of none."""
        same = (self._container[a] == self._container[b]) & self._is_related[a] & self._is_related[b]
        return a[same], b[same]


def _has_extent(body: Body) -> bool:
    size, pose = body.size, body.pose
    return size is not None and all(map(isfinite, (*size, *pose.position, *pose.quaternion))) and any(pose.quaternion)
