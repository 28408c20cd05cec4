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

A shell (see `shells`) is where everything is and takes part in nothing, and neither does what has no size.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from enum import StrEnum
from math import isfinite
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mindstage.world.assemblies import Assemblies
from mindstage.world.boxes import Boxes, Indices, contains, neighbours
from mindstage.world.footprints import areas, footprints, gaps, overlaps
from mindstage.world.geometry import Array, pose_array, unit
from mindstage.world.shells import find_shells
from mindstage.world.values import Body, BodyId, World

__all__ = ["Related", "Relation", "Space"]

_INSIDE = 0.8
_FLOATS_M, _SINKS_M = 0.005, 0.02
_STOREY_M = 3.0
_FOOTING = 0.1
_BESIDE_M, _BESIDE = 0.25, 0.5
_SLACK = 1e-9
"""A limit counts as kept within rounding, so that a world that is turned or moved as a whole answers the same."""


class Relation(StrEnum):
    """How one thing stands to another."""

    ON = "on"
    INSIDE = "inside"
    ABOVE = "above"
    BELOW = "below"
    NEXT_TO = "next_to"


class Related(NamedTuple):
    """One thing and another."""

    thing: Body
    relation: Relation
    other: Body
    gap: float
    """[m], to the micrometre."""
    share: float
    """0 to 1."""


class _Pairs(NamedTuple):
    """Many of one relation, as rows of the bodies."""

    relation: Relation
    thing: Indices
    other: Indices
    gap: Array
    share: Array


class Space:
    """The bodies of a world as boxes, at one moment."""

    def __init__(self, world: World) -> None:
        rows = [row for row, body in enumerate(world.bodies) if _has_extent(body)]
        self.bodies = tuple(world.bodies[row] for row in rows)
        self._rows = {body.id: row for row, body in enumerate(self.bodies)}
        poses = pose_array(body.pose for body in self.bodies)
        poses[:, 3:] = unit(poses[:, 3:])
        sizes = np.array([body.size for body in self.bodies], dtype=np.float64).reshape(-1, 3)
        self._boxes = Boxes.of(poses, sizes)
        low, high = self._boxes.bounds()
        self._low, self._high = low[:, 2], high[:, 2]
        self._footprints = footprints(self._boxes)
        self._areas = areas(self._footprints)
        self._volume = np.prod(sizes, axis=1)
        assemblies = Assemblies.of(world)
        self._assembly, self._hung = assemblies.number[rows], assemblies.hung[rows]
        self._moves, self._joined = assemblies.moves[rows], assemblies.joined
        outer, inner = self._holding()
        apart = self._assembly[outer] != self._assembly[inner]
        apart &= contains(self._boxes, outer, inner)
        self._shells = find_shells(
            self._boxes,
            (outer[apart], inner[apart]),
            moves=self._moves,
            loose=self._moves & ~self._hung,
            assembly=self._assembly,
            joined=self._joined,
        )
        self._is_thing = np.ones(len(rows), dtype=bool)
        self._is_thing[list(self._shells)] = False
        things = self._is_thing[outer] & self._is_thing[inner]
        self._outer, self._inner = outer[things], inner[things]
        self._place = self._smallest(self._outer, self._inner)

    @property
    def shells(self) -> tuple[BodyId, ...]:
        """What takes part in nothing because everything is in it."""
        return tuple(self.bodies[row].id for row in self._shells)

    def related(
        self,
        *,
        things: Collection[BodyId] | None = None,
        others: Collection[BodyId] | None = None,
        relations: Collection[Relation] = tuple(Relation),
    ) -> Iterator[Related]:
        """How things stand to one another, each relation once, in no order that means anything.

        Args:
            things: only of these; None for all.
            others: only to these; None for all.
            relations: only these.
        """
        chosen = self._mask(things), self._mask(others)
        for found in self._pairs(*chosen, frozenset(relations)):
            kept = chosen[0][found.thing] & chosen[1][found.other]
            columns = (found.thing[kept], found.other[kept], found.gap[kept].round(6), found.share[kept].round(6))
            for thing, other, gap, share in zip(*(column.tolist() for column in columns), strict=True):
                yield Related(self.bodies[thing], found.relation, self.bodies[other], gap + 0.0, share)

    def _mask(self, ids: Collection[BodyId] | None) -> NDArray[np.bool_]:
        if ids is None:
            return self._is_thing
        mask = np.zeros(len(self.bodies), dtype=bool)
        mask[[self._rows[id] for id in ids if id in self._rows]] = True
        return mask & self._is_thing

    def _pairs(
        self, things: NDArray[np.bool_], others: NDArray[np.bool_], relations: frozenset[Relation]
    ) -> Iterator[_Pairs]:
        if Relation.INSIDE in relations:
            yield self._insides()
        if relations & {Relation.ON, Relation.ABOVE, Relation.BELOW}:
            for a, b in neighbours(self._boxes, things, others, within=(0.0, 0.0, _STOREY_M)):
                yield from (each for each in self._stacked(a, b) if each.relation in relations)
        if Relation.NEXT_TO in relations:
            for a, b in neighbours(self._boxes, things, others, within=(_BESIDE_M, _BESIDE_M, 0.0)):
                yield self._beside(a, b)

    # -- inside ------------------------------------------------------------------------------------------------

    def _holding(self) -> tuple[Indices, Indices]:
        """Pairs (outer, inner), shells among them."""
        everything = np.ones(len(self.bodies), dtype=bool)
        found = [np.zeros((2, 0), dtype=np.intp)]
        for a, b in neighbours(self._boxes, everything, everything):
            larger = self._volume[a] > self._volume[b]
            outer, inner = np.where(larger, a, b), np.where(larger, b, a)
            holds = contains(self._boxes, outer, inner, share=_INSIDE) & (self._volume[a] != self._volume[b])
            found.append(np.stack([outer[holds], inner[holds]]))
        outer, inner = np.concatenate(found, axis=1)
        return outer, inner

    def _smallest(self, outer: Indices, inner: Indices) -> Indices:
        """For each body, the smallest one that it is inside of; -1 for none."""
        place = np.full(len(self.bodies), -1)
        order = np.lexsort((outer, -self._volume[outer]))
        place[inner[order]] = outer[order]  # of several the last one stays
        return place

    def _insides(self) -> _Pairs:
        boxes, outer, inner = self._boxes, self._outer, self._inner
        turn = np.swapaxes(boxes.rotation[outer], 1, 2)
        offset = np.abs(np.einsum("pij,pj->pi", turn, boxes.centre[inner] - boxes.centre[outer]))
        reach = np.einsum("pij,pj->pi", np.abs(turn @ boxes.rotation[inner]), boxes.half[inner])
        room = boxes.half[outer] - offset
        held = np.clip((np.minimum(room, reach) + reach) / np.maximum(2 * reach, _SLACK), 0.0, 1.0)
        return _Pairs(Relation.INSIDE, inner, outer, (room - reach).min(axis=1), held.prod(axis=1))

    # -- over and under ----------------------------------------------------------------------------------------

    def _stacked(self, a: Indices, b: Indices) -> Iterator[_Pairs]:
        a, b = self._in_one_place(a, b)
        middle = self._low + self._high
        over = middle[a] > middle[b]
        upper, lower = np.where(over, a, b), np.where(over, b, a)
        gap = self._low[upper] - self._high[lower]
        height = (self._high - self._low) / 2
        sinks = np.minimum(_SINKS_M, np.minimum(height[upper], height[lower]))
        clear = (middle[a] != middle[b]) & (gap >= -sinks - _SLACK) & (gap <= _STOREY_M + _SLACK)
        upper, lower, gap = upper[clear], lower[clear], gap[clear]
        share = self._shared(upper, lower)
        over = share >= _FOOTING - _SLACK
        upper, lower, gap, share = upper[over], lower[over], gap[over], share[over]
        rests = (gap <= _FLOATS_M + _SLACK) & ~self._hung[upper] & (self._moves[upper] | ~self._hung[lower])
        yield _Pairs(Relation.ON, upper[rests], lower[rests], gap[rests], share[rests])
        yield _Pairs(Relation.ABOVE, upper[~rests], lower[~rests], gap[~rests], share[~rests])
        yield _Pairs(Relation.BELOW, lower, upper, gap, share)

    def _shared(self, a: Indices, b: Indices) -> Array:
        """How much of the smaller footprint of each pair both cover."""
        smaller = np.minimum(self._areas[a], self._areas[b])
        both = overlaps(self._footprints, a, b)
        return np.divide(both, smaller, out=np.zeros(len(a)), where=smaller > 0.0).clip(0.0, 1.0)

    # -- side by side ------------------------------------------------------------------------------------------

    def _beside(self, a: Indices, b: Indices) -> _Pairs:
        a, b = self._in_one_place(a, b)
        shared = np.minimum(self._high[a], self._high[b]) - np.maximum(self._low[a], self._low[b])
        lower = np.minimum(self._high[a] - self._low[a], self._high[b] - self._low[b])
        share = np.divide(shared, lower, out=np.zeros(len(a)), where=lower > 0.0)
        level = (share >= _BESIDE - _SLACK) & self._apart(a, b)
        a, b, share = a[level], b[level], share[level]
        covered = self._shared(a, b)
        aside = covered < _FOOTING - _SLACK
        a, b, share, covered = a[aside], b[aside], share[aside], covered[aside]
        gap = np.where(covered > 0.0, 0.0, gaps(self._footprints, a, b))
        near = gap <= _BESIDE_M + _SLACK
        a, b, gap, share = a[near], b[near], gap[near], share[near]
        both = (np.concatenate([a, b]), np.concatenate([b, a]))
        return _Pairs(Relation.NEXT_TO, *both, np.tile(gap, 2), np.tile(share, 2).clip(0.0, 1.0))

    def _apart(self, a: Indices, b: Indices) -> NDArray[np.bool_]:
        """Whether two bodies neither hang together nor are joined by a constraint."""
        one, other, count = self._assembly[a], self._assembly[b], int(self._assembly.max(initial=0)) + 1
        joined = [first * count + second for pair in self._joined for first, second in (pair, pair[::-1])]
        return np.asarray((one != other) & ~np.isin(one * count + other, joined))

    def _in_one_place(self, a: Indices, b: Indices) -> tuple[Indices, Indices]:
        """The pairs of things that are inside of the same one, or both of none."""
        same = (self._place[a] == self._place[b]) & self._is_thing[a] & self._is_thing[b]
        return a[same], b[same]


def _has_extent(body: Body) -> bool:
    size, pose = body.size, body.pose
    return size is not None and all(map(isfinite, (*size, *pose.position, *pose.quaternion))) and any(pose.quaternion)
