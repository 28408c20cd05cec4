"""Questions about the places of bodies relative to one another: directions, distances, neighbors, betweenness.

They are measured between bounding boxes (`scene.proximity`), in the current state. Bodies that enclose all others, such
as walls that are one body, are left out, and so are bodies without a size.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from math import atan2, isfinite

import numpy as np
from numpy.typing import NDArray

from mindstage.errors import InvalidArgumentError
from mindstage.knowledge.claims import Claim, ClaimKind
from mindstage.knowledge.explain import individual_text, source_text
from mindstage.knowledge.queries.spatial import body_claims, missing_pose
from mindstage.knowledge.questions import (
    AnswerRow,
    AskedArguments,
    ClassName,
    IndividualName,
    MapName,
    MissingKnowledge,
    QuestionContext,
    StateAccess,
    WorldState,
    question,
)
from mindstage.ranges import Count
from mindstage.rdf.graphs import local_name
from mindstage.rdf.vocabulary import HAS_POSE, THING
from mindstage.scene import Iri
from mindstage.scene.bounding_boxes import Indices, footprints, polygon_areas, polygon_overlap_areas
from mindstage.scene.proximity import (
    BodyBoxes,
    Direction,
    betweenness,
    box_gaps,
    box_point_gaps,
    directions,
    nearest_boxes,
)
from mindstage.scene.transforms import Array, normalize, quat_rotate

__all__ = [
    "BetweenRow",
    "DirectionRow",
    "DistanceRow",
    "NeighborRow",
    "PlacedBodies",
    "ReferenceFrame",
    "Viewpoint",
    "direction_of",
    "distance",
    "is_between",
    "nearest",
    "parse_numbers",
]

_MAX_HEIGHT_GAP_M = 0.3
"""Largest vertical gap of two bodies that are beside each other (KnowRob's comp_spatial uses it for centers)."""
_MAX_OVERLAP_FRACTION = 0.1
_MIN_BETWEEN_FRACTION = 0.5
_SEEN_FROM_VIEWER = {Direction.FRONT: Direction.BEHIND, Direction.BEHIND: Direction.FRONT}
"""What lies farther along the view is behind; left and right are those of the view."""
_MIN_HEADING = 1e-6
"""Least horizontal part of a unit vector that has a heading; a fraction."""


def parse_numbers(text: str, name: str, counts: tuple[int, ...]) -> list[float]:
    """Parses numbers that are separated by spaces or commas.

    Raises:
        InvalidArgumentError: they are not finite numbers, or of another count.
    """
    parts = re.findall(r"[^\s,()\[\]]+", text)
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        numbers = []
    if len(numbers) not in counts or not all(map(isfinite, numbers)):
        wanted = " or ".join(map(str, counts))
        raise InvalidArgumentError(
            name, cause=f"{text!r} is not a list of {wanted} numbers", remedy="as in '1.5 0 1.6'"
        )
    return numbers


@dataclass(frozen=True, slots=True)
class Viewpoint:
    """The position and the heading of a viewer."""

    position: Array
    """[m]."""
    heading: float | None
    """The angle of the view about z [rad]; None if only the position is known."""

    @classmethod
    def find(cls, bodies: PlacedBodies, viewer: Iri | None, pose: str | None) -> Viewpoint | None:
        """The viewpoint of a body, which looks along its x axis, or of a pose; None without either.

        Args:
            bodies: the bodies of one state.
            viewer: a body, such as a camera, a robot or a person.
            pose: "x y z", "x y z yaw" or "x y z w x y z" [m, rad].

        Raises:
            InvalidArgumentError: the pose is none.
        """
        if pose is not None:
            numbers = parse_numbers(pose, "viewer_pose", (3, 4, 7))
            position = np.array(numbers[:3])
            if len(numbers) == 7:
                if not any(numbers[3:]):
                    raise InvalidArgumentError("viewer_pose", cause=f"the quaternion in {pose!r} is zero")
                return cls(position, _heading(quat_rotate(normalize(numbers[3:]), (1.0, 0.0, 0.0))))
            return cls(position, numbers[3] if len(numbers) == 4 else None)
        row = bodies.row_of(viewer) if viewer is not None else None
        if row is None:
            return None
        boxes = bodies.placed.boxes
        return cls(boxes.center[row], _heading(boxes.rotation[row, :, 0]))


def _heading(axis: Array) -> float | None:
    """The angle of an axis about z; None if it is vertical."""
    return float(atan2(axis[1], axis[0])) if float(np.hypot(axis[0], axis[1])) > _MIN_HEADING else None


class PlacedBodies:
    """The bodies of one state with their boxes."""

    def __init__(self, state: WorldState) -> None:
        self.state = state
        self.placed = BodyBoxes.from_bodies(state.world.bodies)
        self._row_by_iri = {body.iri: row for row, body in reversed(list(enumerate(self.placed.bodies)))}

    @classmethod
    def of(cls, state: WorldState) -> PlacedBodies:
        """Those of a state, which are kept with it."""
        return state.derived(PlacedBodies, PlacedBodies._moved)

    def _moved(self, state: WorldState, rows: Indices) -> PlacedBodies:
        if len(self.placed.bodies) < len(state.world.bodies):  # some have no place, and may have one now
            return PlacedBodies(state)
        placed = self.placed.moved(state.world.bodies, rows)
        if placed is None:
            return PlacedBodies(state)
        moved = copy(self)
        moved.__dict__.pop("comparable", None)
        moved.state, moved.placed = state, placed
        return moved

    def row_of(self, iri: Iri) -> int | None:
        """The row of an individual; None if it has no pose here."""
        return self._row_by_iri.get(iri)

    def iri(self, row: int) -> Iri:
        """The individual in a row."""
        return self.placed.bodies[row].iri

    def map(self, row: int) -> Iri:
        """The map of the individual in a row."""
        return self.state.map_of_body[self.placed.bodies[row].id]

    @cached_property
    def comparable(self) -> NDArray[np.bool_]:
        """For each row, whether the body has a size and does not enclose all others; read-only."""
        mask = self._has_size.copy()
        mask[[self.placed.row_by_id[id] for id in self.state.relations.enclosing_bodies]] = False
        mask.flags.writeable = False
        return mask

    def rows_of_classes(self, is_wanted: Callable[[Iri], bool]) -> list[int]:
        """The rows of the bodies whose class is one of those that are wanted."""
        return sorted(row for cls, rows in self._rows_by_class.items() if is_wanted(cls) for row in rows)

    @cached_property
    def _rows_by_class(self) -> Mapping[Iri, Sequence[int]]:
        found: dict[Iri, list[int]] = {}
        for row, body in enumerate(self.placed.bodies):
            found.setdefault(body.cls, []).append(row)
        return found

    @cached_property
    def _has_size(self) -> NDArray[np.bool_]:
        return np.array([body.size is not None for body in self.placed.bodies], dtype=bool)

    def candidates(self, *excluded: int) -> Indices:
        """The rows of all comparable bodies but some."""
        mask = self.comparable.copy()
        mask[list(excluded)] = False
        return np.flatnonzero(mask)

    def pairs(self, thing: Iri | None, other: Iri | None) -> tuple[int, Indices] | None:
        """The row of the first individual that is given, and the rows that it is compared with: the other one or all.

        None if an individual that is given is not here or not comparable. At least one must be given.
        """
        given = [self.row_of(each) for each in (thing, other) if each is not None]
        rows = [row for row in given if row is not None]
        if len(rows) < len(given) or not self.comparable[rows].all():
            return None
        return rows[0], np.array(rows[1:]) if len(rows) == 2 else self.candidates(rows[0])

    def group_of(self, row: int) -> frozenset[Iri]:
        """The individuals that attachments connect rigidly to the body in a row, with itself."""
        world = self.state.world
        groups = self.state.rigid_groups.root_row
        at = self.state.row_of_id[self.placed.bodies[row].id]
        return frozenset(world.bodies[other].iri for other in np.flatnonzero(groups == groups[at]).tolist())


def placed_states(present: StateAccess, map: Iri | None) -> Iterator[PlacedBodies]:
    """The bodies of each state."""
    for state in present.states(map):
        yield PlacedBodies.of(state)


def missing_arguments(text: str) -> MissingKnowledge:
    """What an open question lacks."""
    return MissingKnowledge(THING, HAS_POSE, text)


def missing_about(
    kb: QuestionContext,
    individual: Iri,
    reason: str,
    *others: Iri | None,
    present: StateAccess,
    map: Iri | None,
    claims: Iterable[Claim] = (),
) -> MissingKnowledge:
    """Why an individual with a pose is no answer, with the others that were given, and what else is claimed."""
    claims = (*body_claims((individual, *others), present.states(map), map), *claims)
    return MissingKnowledge(kb.reasoner.class_of(individual) or THING, HAS_POSE, reason, claims=claims)


def missing_bodies(
    kb: QuestionContext, individuals: tuple[Iri | None, ...], map: Iri | None, present: StateAccess
) -> Iterator[MissingKnowledge]:
    """The missing poses and sizes of the individuals that were asked for."""
    states = present.states(map)
    for each in dict.fromkeys(individuals):
        if each is not None:
            yield from missing_pose(each, kb.reasoner.class_of(each) or THING, states, map)


_FindMissing = Callable[[QuestionContext, AskedArguments], Iterator[MissingKnowledge]]


def unless_bodies_are_missing(*names: str) -> Callable[[_FindMissing], _FindMissing]:
    """Decorates a function that finds missing statements, so that missing poses and sizes are found instead of these.

    Args:
        names: the arguments that are bodies.
    """

    def decorate(function: _FindMissing) -> _FindMissing:
        def find_missing(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
            bodies = tuple(getattr(asked, name) for name in names)
            yield from list(missing_bodies(kb, bodies, asked.map, asked.present)) or function(kb, asked)

        return find_missing

    return decorate


# -- left, right, in front, behind -------------------------------------------------------------------------------------


class ReferenceFrame(StrEnum):
    """The frame that left, right, front and behind refer to (Levinson 2003, "Space in Language and Cognition")."""

    OBJECT = "object"
    """The other body's own front: its x axis (intrinsic frame)."""
    VIEWER = "viewer"
    """The viewer's left and right; in front is what is nearer to the viewer (relative frame)."""
    MAP = "map"
    """Front is along the map's x axis, left along its y axis (absolute frame), as in KnowRob."""


class DirectionRow(AnswerRow, frozen=True, kw_only=True):
    """The direction of a body from another one."""

    thing: IndividualName
    direction: Direction
    other: IndividualName
    """The reference."""
    frame: ReferenceFrame
    map: MapName
    """The map that `thing` is described in."""
    angle: float
    """Deviation from the axis of the direction [rad], from 0 to pi/4."""
    distance: float
    """Horizontal distance of the centers [m]."""
    source: str
    """Where the poses come from: the name of the engine, or "map"."""


@question(
    needs="thing or other: the directions of all pairs of bodies are not listed",
    sentences=(
        "(what|which thing) is {direction} {other}",
        "is {thing} {direction} {other}",
        "which {thing} is {direction} {other}",
        "where is {thing} relative to {other}",
        "on which side of {other} is {thing}",
        "what is {direction} {other} seen from {viewer} {frame=viewer}",
        "what is {direction} {other} on the map {frame=map}",
    ),
)
def direction_of(
    kb: QuestionContext,
    thing: IndividualName | None = None,
    direction: Direction | None = None,
    other: IndividualName | None = None,
    frame: ReferenceFrame | None = None,
    map: MapName | None = None,
    viewer: IndividualName | None = None,
    viewer_pose: str | None = None,
    *,
    present: StateAccess,
) -> Iterator[DirectionRow]:
    """Which bodies are to the left or right of another one, in front of it or behind it; the nearest first.

    `thing` or `other` must be given. A direction is where the center of `thing` is from the center of `other`, seen
    from above: at most 45 degrees off the axis of the direction, in one of three frames. In the frame `object`, the
    front of `other` is its own x axis. In the frame `map`, front is +x and left is +y, as in KnowRob's comp_spatial.
    In the frame `viewer`, left and right are those of a viewer, and a thing that is nearer to the viewer is in front:
    give `viewer`, a body that looks along its x axis, or `viewer_pose`: "x y z yaw" [m, rad], "x y z w x y z" (a
    quaternion), or "x y z" for a viewer who faces `other`. Without `frame`, all that are possible are used.

    The bodies are at most 0.3 m apart vertically (as in comp_spatial, which compares centers), and their footprints
    overlap by at most 10 % of the smaller one: what is on top of another body is not beside it. Unlike there, rotations
    and sizes count, and sideways offsets are limited by the angle instead of 0.3 m.

    Examples:
        direction_of milk_carton_1 other=milk_carton_2
        direction_of other=table direction=left frame=viewer viewer_pose='0 1.5 1.6'
    """
    for bodies in placed_states(present, map):
        view = Viewpoint.find(bodies, viewer, viewer_pose)
        yield from _directions_in(bodies, thing, other, view, frame, direction)


def _directions_in(
    bodies: PlacedBodies,
    thing: Iri | None,
    other: Iri | None,
    view: Viewpoint | None,
    frame: ReferenceFrame | None,
    wanted: Direction | None = None,
) -> Iterator[DirectionRow]:
    pairs = bodies.pairs(thing, other)
    if pairs is None:
        return
    fixed, free = pairs
    boxes = bodies.placed.boxes
    free = free[(free != fixed) & _is_beside(bodies.placed, fixed, free)] if len(free) else free
    things, others = (np.full(len(free), fixed), free) if thing is not None else (free, np.full(len(free), fixed))
    offsets = boxes.center[things, :2] - boxes.center[others, :2]
    apart = np.linalg.norm(offsets, axis=1)
    order = np.lexsort((free, apart.round(9)))
    for each, headings, known in _frames(bodies, others, view):
        if frame in {None, each}:
            for direction, (holds, angle) in directions(offsets, headings).items():
                named = _SEEN_FROM_VIEWER.get(direction, direction) if each is ReferenceFrame.VIEWER else direction
                if wanted not in {None, named}:
                    continue
                for at in order[(holds & known)[order]].tolist():
                    yield DirectionRow(
                        thing=bodies.iri(things[at]),
                        direction=named,
                        other=bodies.iri(others[at]),
                        frame=each,
                        map=bodies.map(things[at]),
                        angle=round(float(angle[at]), 6),
                        distance=round(float(apart[at]), 6),
                        source=bodies.state.source,
                    )


def _frames(
    bodies: PlacedBodies, others: Indices, view: Viewpoint | None
) -> Iterator[tuple[ReferenceFrame, Array, NDArray[np.bool_]]]:
    """The frames, with the headings of their fronts at each of the reference bodies, and whether they have one."""
    boxes = bodies.placed.boxes
    front = boxes.rotation[others, :2, 0]
    is_level = np.linalg.norm(front, axis=1) > _MIN_HEADING
    yield ReferenceFrame.OBJECT, np.arctan2(front[:, 1], front[:, 0]), is_level
    everywhere = np.ones(len(others), dtype=bool)
    if view is not None:
        if view.heading is not None:
            yield ReferenceFrame.VIEWER, np.full(len(others), view.heading), everywhere
        else:
            sight = boxes.center[others, :2] - view.position[:2]
            is_apart = np.linalg.norm(sight, axis=1) > _MIN_HEADING
            yield ReferenceFrame.VIEWER, np.arctan2(sight[:, 1], sight[:, 0]), is_apart
    yield ReferenceFrame.MAP, np.zeros(len(others)), everywhere


def _is_beside(placed: BodyBoxes, fixed: int, free: Indices) -> NDArray[np.bool_]:
    gap = np.maximum(placed.low[free, 2] - placed.high[fixed, 2], placed.low[fixed, 2] - placed.high[free, 2])
    is_beside: NDArray[np.bool_] = gap <= _MAX_HEIGHT_GAP_M + 1e-9
    low, high = placed.low[:, :2], placed.high[:, :2]
    near = np.flatnonzero(is_beside & np.all((low[free] <= high[fixed]) & (high[free] >= low[fixed]), axis=1))
    prints = footprints(placed.boxes.rows(np.array([fixed, *free[near]])))
    areas = polygon_areas(prints)
    smaller = np.minimum(areas[1:], areas[0])
    both = polygon_overlap_areas(prints, np.arange(1, len(prints)), np.zeros(len(near), dtype=np.intp))
    share = np.divide(both, smaller, out=np.zeros(len(near)), where=smaller > 1e-12)
    is_beside[near] = share <= _MAX_OVERLAP_FRACTION + 1e-9
    return is_beside


@direction_of.explain
def _explain_direction(kb: QuestionContext, row: DirectionRow) -> Iterator[str]:
    thing, other = local_name(row.thing), local_name(row.other)
    front = {
        ReferenceFrame.OBJECT: f"the front of {other} is along its own x axis",
        ReferenceFrame.VIEWER: "left and right are the viewer's, and nearer to the viewer is in front",
        ReferenceFrame.MAP: "front is along the map's x axis, left along its y axis",
    }
    angle = f"{np.degrees(row.angle):.3g} degrees off the axis {row.direction}"
    yield f"{thing} is {row.distance:g} m from {other}, {angle}"
    yield f"in the frame {row.frame}: {front[row.frame]}"
    yield source_text(row.source)


@direction_of.missing
@unless_bodies_are_missing("thing", "other", "viewer")
def _missing_direction(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    frame = asked.plain("frame", ReferenceFrame)
    if frame is ReferenceFrame.VIEWER and asked.viewer is None and asked.viewer_pose is None:
        yield missing_arguments("the frame viewer needs a viewer: give viewer or viewer_pose")
        return
    if asked.thing is not None and asked.other is not None:
        rows = [
            row
            for bodies in placed_states(asked.present, asked.map)
            for row in _directions_in(
                bodies, asked.thing, asked.other, Viewpoint.find(bodies, asked.viewer, asked.viewer_pose), frame
            )
        ]
        where = ", ".join(f"{row.direction} in the frame {row.frame}" for row in rows)
        how = f"it is {where}" if where else "one is above, below or around the other, or they are in different maps"
        wanted = f" {asked.direction}" if asked.direction else ""
        away = f"such direction{wanted} from {local_name(asked.other)}"
        reason = f"{individual_text(kb.reasoner, asked.thing)} has no {away}: {how}"
        claims = [
            Claim(
                kind=ClaimKind.IN_DIRECTION,
                subject=asked.thing,
                object=asked.other,
                detail=row.direction,
                map=asked.map,
            )
            for row in rows
            if row.frame is ReferenceFrame.MAP
        ]
        yield missing_about(
            kb, asked.thing, reason, asked.other, asked.viewer, present=asked.present, map=asked.map, claims=claims
        )


# -- distance ----------------------------------------------------------------------------------------------------------


class DistanceRow(AnswerRow, frozen=True, kw_only=True):
    """The distance of two bodies."""

    thing: IndividualName
    other: IndividualName
    gap: float
    """The smallest distance between their boxes [m]; negative if they overlap, by the depth."""
    center_distance: float
    """The distance of the centers of their boxes [m]."""
    map: MapName
    """The map that `thing` is described in."""
    source: str
    """Where the poses come from: the name of the engine, or "map"."""


@question(
    needs="thing or other: the distances of all pairs of bodies are not listed",
    sentences=("how far from {thing} is {other}",),
)
def distance(
    kb: QuestionContext,
    thing: IndividualName | None = None,
    other: IndividualName | None = None,
    map: MapName | None = None,
    *,
    present: StateAccess,
) -> Iterator[DistanceRow]:
    """How far bodies are from one another, box to box and center to center; the nearest first.

    `thing` or `other` must be given. The gap is the exact distance of the two oriented bounding boxes; of boxes that
    overlap it is negative, the length of the shortest translation that separates them.

    Examples:
        distance milk_carton_1 table
        distance other=fridge
    """
    for bodies in placed_states(present, map):
        pairs = bodies.pairs(thing, other)
        if pairs is None:
            continue
        fixed, free = pairs
        gaps = box_gaps(bodies.placed.boxes, np.full(len(free), fixed), free)
        centers = bodies.placed.boxes.center
        apart = np.linalg.norm(centers[free] - centers[fixed], axis=1)
        for at in np.lexsort((free, apart.round(9), gaps.round(9))).tolist():
            pair = (fixed, int(free[at])) if thing is not None else (int(free[at]), fixed)
            yield DistanceRow(
                thing=bodies.iri(pair[0]),
                other=bodies.iri(pair[1]),
                gap=round(float(gaps[at]), 6) + 0.0,
                center_distance=round(float(apart[at]), 6),
                map=bodies.map(pair[0]),
                source=bodies.state.source,
            )


@distance.explain
def _explain_distance(kb: QuestionContext, row: DistanceRow) -> Iterator[str]:
    thing, other = local_name(row.thing), local_name(row.other)
    if row.gap < 0.0:
        yield f"the boxes of {thing} and {other} overlap by {-row.gap:g} m"
    else:
        yield f"{row.gap:g} m between the boxes of {thing} and {other}"
    yield f"{row.center_distance:g} m between their centers"
    yield source_text(row.source)


@distance.missing
@unless_bodies_are_missing("thing", "other")
def _missing_distance(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    yield from _not_comparable(kb, (asked.thing, asked.other), asked.map, asked.present)


def _not_comparable(
    kb: QuestionContext, individuals: tuple[Iri | None, ...], map: Iri | None, present: StateAccess
) -> Iterator[MissingKnowledge]:
    """Why bodies with poses and sizes are not compared: one encloses everything, or no state has all of them."""
    given = [each for each in individuals if each is not None]
    for bodies in placed_states(present, map):
        rows = [bodies.row_of(each) for each in given]
        for each, row in zip(given, rows, strict=True):
            if row is not None and not bodies.comparable[row]:
                reason = (
                    f"{individual_text(kb.reasoner, each)} encloses all other bodies, and is not compared with them"
                )
                yield missing_about(kb, each, reason, *given, present=present, map=map)
                return
    if len(given) > 1:
        names = " and ".join(local_name(each) for each in given)
        reason = f"{names} are in different maps, which have no common frame"
        yield missing_about(kb, given[0], reason, *given[1:], present=present, map=map)


# -- nearest -----------------------------------------------------------------------------------------------------------


class NeighborRow(AnswerRow, frozen=True, kw_only=True):
    """One of the bodies that are nearest to another one."""

    thing: IndividualName | None
    """The body that distances start from; None for a position."""
    other: IndividualName
    rank: int
    """1 for the nearest."""
    gap: float
    """Distance to the box of `other` [m]; negative if they overlap."""
    center_distance: float
    """[m]."""
    map: MapName
    """The map that `other` is described in."""
    source: str
    """Where the poses come from: the name of the engine, or "map"."""


@question(
    needs="thing or position: the neighbors of all bodies are not listed",
    sentences=(
        "what is (nearest|closest) to {thing}",
        "what are the {count} (nearest|closest) (things|objects) to {thing}",
        "which {count} {cls} are (nearest|closest) to {thing}",
        "what is (nearest|closest) to the position {position}",
    ),
)
def nearest(
    kb: QuestionContext,
    thing: IndividualName | None = None,
    other: IndividualName | None = None,
    cls: ClassName | None = None,
    count: Count | None = None,
    position: str | None = None,
    map: MapName | None = None,
    *,
    present: StateAccess,
) -> Iterator[NeighborRow]:
    """Which bodies are nearest to a body or a position, at any distance; the nearest first.

    Give `thing`, or `position`: "x y z" [m]. Distances are those of the question `distance`; bodies that overlap are
    equally near, and of those the one with the nearer center comes first. `cls` restricts the answers to a class;
    `count` is their number, 1 if it is left out. Bodies that are attached to `thing`, such as its handle, are left out.

    Examples:
        nearest milk_carton_1
        nearest table cls=Chair-PieceOfFurniture count=3
        nearest position='0 0 1' cls=Cup
    """
    limit = 1 if count is None else count
    for bodies in placed_states(present, map):
        yield from _neighbors(kb, bodies, thing, position, cls, limit)


def _neighbors(
    kb: QuestionContext, bodies: PlacedBodies, thing: Iri | None, position: str | None, cls: Iri | None, limit: int
) -> Iterator[NeighborRow]:
    boxes = bodies.placed.boxes
    start = bodies.row_of(thing) if thing is not None else None
    if thing is not None and (start is None or bodies.placed.bodies[start].size is None):
        return
    own = bodies.group_of(start) if start is not None else frozenset()
    candidates = bodies.candidates(*(row for each in own if (row := bodies.row_of(each)) is not None))
    if cls is not None:
        candidates = candidates[[_is_of_class(kb, bodies, row, cls) for row in candidates.tolist()]]
    if start is not None:
        found, gaps = nearest_boxes(boxes, start, candidates, limit)
        origin = boxes.center[start]
    else:
        origin = np.array(parse_numbers(position or "", "position", (3,)))
        every = box_point_gaps(boxes, origin)[candidates]
        centers = np.linalg.norm(boxes.center[candidates] - origin, axis=1)
        order = np.lexsort((candidates, centers.round(9), np.maximum(every, 0.0).round(9)))[:limit]
        found, gaps = candidates[order], every[order]
    for rank, (row, gap) in enumerate(zip(found.tolist(), gaps.tolist(), strict=True), start=1):
        yield NeighborRow(
            thing=thing,
            other=bodies.iri(row),
            rank=rank,
            gap=round(gap, 6) + 0.0,
            center_distance=round(float(np.linalg.norm(boxes.center[row] - origin)), 6),
            map=bodies.map(row),
            source=bodies.state.source,
        )


def _is_of_class(kb: QuestionContext, bodies: PlacedBodies, row: int, cls: Iri) -> bool:
    return kb.reasoner.is_member(bodies.iri(row), cls) or kb.reasoner.is_a(bodies.placed.bodies[row].cls, cls)


@nearest.explain
def _explain_neighbor(kb: QuestionContext, row: NeighborRow) -> Iterator[str]:
    start = local_name(row.thing) if row.thing is not None else "the position"
    overlap = f"{start} is in the box of {local_name(row.other)}, or overlaps it, by {-row.gap:g} m"
    apart = f"{row.gap:g} m from {start} to the box of {local_name(row.other)}"
    yield f"{overlap if row.gap < 0.0 else apart}, {row.center_distance:g} m to its center: rank {row.rank}"
    yield source_text(row.source)


@nearest.missing
@unless_bodies_are_missing("thing", "other")
def _missing_neighbor(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    start = local_name(asked.thing) if asked.thing is not None else "the position"
    if asked.other is not None:
        yield _missing_rank(
            kb, asked.thing, asked.other, asked.cls, asked.plain("count", int) or 1, start, asked.map, asked.present
        )
    else:
        kind = f"of class {local_name(asked.cls)} " if asked.cls is not None else ""
        reason = f"no other body {kind}with a pose and a size is where {start} is"
        claims = body_claims((asked.thing,), asked.present.states(asked.map), asked.map)
        yield MissingKnowledge(asked.cls or THING, HAS_POSE, reason, claims=claims)


def _missing_rank(
    kb: QuestionContext,
    thing: Iri | None,
    other: Iri,
    cls: Iri | None,
    count: int,
    start: str,
    map: Iri | None,
    present: StateAccess,
) -> MissingKnowledge:
    """Why a body is not among the nearest: it is left out, elsewhere, or farther than others."""
    states = list(placed_states(present, map))
    here = [bodies for bodies in states if thing is None or bodies.row_of(thing) is not None]
    bodies = next((each for each in here if each.row_of(other) is not None), None)
    claims: list[Claim] = []
    if bodies is None:
        reason = f"{local_name(other)} is in another map than {start}, and maps have no common frame"
    elif not bodies.comparable[bodies.row_of(other) or 0]:
        reason = f"{local_name(other)} encloses all other bodies, and is not compared with them"
    elif thing is not None and other in bodies.group_of(bodies.row_of(thing) or 0):
        reason = f"{local_name(other)} is attached to {start}, and is not its neighbor"
        claims = [Claim(kind=ClaimKind.ATTACHED, subject=other, object=thing, map=map)]
        if other == thing:
            reason, claims = f"{start} is not its own neighbor", []
    elif cls is not None and not _is_of_class(kb, bodies, bodies.row_of(other) or 0, cls):
        reason = f"{individual_text(kb.reasoner, other)} is no {local_name(cls)}"
        claims = [Claim(kind=ClaimKind.NOT_INSTANCE, subject=other, object=cls)]
    else:
        reason = f"{local_name(other)} is not among the {count} nearest to {start}: ask for more with count"
        if thing is not None and cls is None:
            claim = Claim(kind=ClaimKind.NOT_NEAREST, subject=other, other=thing, detail=str(count), map=map)
            claims = [claim]
    return missing_about(kb, other, reason, thing, present=present, map=map, claims=claims)


# -- between -----------------------------------------------------------------------------------------------------------


class BetweenRow(AnswerRow, frozen=True, kw_only=True):
    """A body between two others."""

    thing: IndividualName
    one: IndividualName
    other: IndividualName
    share: float
    """The fraction of its footprint that is between the other two, 0.5 to 1."""
    map: MapName
    """The map that `thing` is described in."""
    source: str
    """Where the poses come from: the name of the engine, or "map"."""


@question(
    needs="one and other: the bodies between all pairs of bodies are not listed",
)
def is_between(
    kb: QuestionContext,
    thing: IndividualName | None = None,
    one: IndividualName | None = None,
    other: IndividualName | None = None,
    map: MapName | None = None,
    *,
    present: StateAccess,
) -> Iterator[BetweenRow]:
    """Which bodies are between two others, seen from above; the most central first.

    `one` and `other` must be given. At least half of the footprint of `thing` is in the convex hull of the footprints
    of the two (Bloch, Colliot, Cesar 2006, "On the ternary spatial relation between"), at most 10 % of it is in one
    of them, and at least half of its height is within the heights that the two span.

    Examples:
        is_between one=fridge other=oven
    """
    if one is None or other is None:
        return
    for bodies in placed_states(present, map):
        ends = [bodies.row_of(each) for each in (one, other)]
        if ends[0] is None or ends[1] is None or one == other:
            continue
        low, high = bodies.placed.low[:, 2], bodies.placed.high[:, 2]
        rows = bodies.candidates(ends[0], ends[1])
        shares, hidden = betweenness(bodies.placed.boxes, ends[0], ends[1], rows)
        height = np.maximum(high[rows] - low[rows], 1e-9)
        spanned = np.minimum(high[rows], max(high[ends[0]], high[ends[1]])) - np.maximum(
            low[rows], min(low[ends[0]], low[ends[1]])
        )
        kept = (shares >= _MIN_BETWEEN_FRACTION) & (hidden <= _MAX_OVERLAP_FRACTION) & (spanned >= height / 2)
        for at in np.lexsort((rows, -shares.round(6))).tolist():
            if kept[at]:
                yield BetweenRow(
                    thing=bodies.iri(rows[at]),
                    one=one,
                    other=other,
                    share=round(float(shares[at]), 6),
                    map=bodies.map(rows[at]),
                    source=bodies.state.source,
                )


@is_between.explain
def _explain_between(kb: QuestionContext, row: BetweenRow) -> Iterator[str]:
    one, other = local_name(row.one), local_name(row.other)
    yield f"{row.share:.0%} of the footprint of {local_name(row.thing)} is in the convex hull of {one} and {other}"
    yield source_text(row.source)


@is_between.missing
@unless_bodies_are_missing("thing", "one", "other")
def _missing_between(kb: QuestionContext, asked: AskedArguments) -> Iterator[MissingKnowledge]:
    one, other = asked.needed("one"), asked.needed("other")
    what = local_name(asked.thing) if asked.thing is not None else "no other body"
    ends = f"{local_name(one)} and {local_name(other)}"
    reason = f"{what} is {'not ' if asked.thing is not None else ''}between {ends}"
    reason += ": half of a footprint and half of a height must be"
    claims = body_claims((asked.thing, one, other), asked.present.states(asked.map), asked.map)
    if one != other:
        claims += (Claim(kind=ClaimKind.NOT_BETWEEN, subject=asked.thing, object=one, other=other, map=asked.map),)
    else:
        reason = f"nothing is between {local_name(one)} and itself"
    yield MissingKnowledge(THING, HAS_POSE, reason, claims=claims)
