"""Decides which bodies collide, once for all engines.

Maps describe bounding boxes, which overlap: a drawer and its cabinet, milk and the fridge, the whole kitchen and a box
named "walls". Simulated literally, such a world explodes. Instead:

- an **enclosure**, a large body that contains several pieces of furniture, collides with nothing;
- a body that contains free bodies is **hollow**: it gets walls, an opening, and a floor under its contents;
- any other pair of fixed or jointed bodies that overlaps when spawned does not collide, nor do pairs connected by a
  joint: furniture is nested, and a drawer that penetrates its neighbor by a millimeter jams;
- what stands inside of a body, such as the shelf of a door, may overlap what that one is a part of or overlaps: the
  door and the fridge;
- a loose body that overlaps another one when spawned is moved out of it (see `settling`), since without the collision
  it would fall through its support.

Collision shapes of a geometry are used in place of the bounding box: such a body has its interior already, and pairs
overlap only if their shapes do. Edits of a running world move nothing: there, free bodies that penetrate others
slightly are pushed out by the physics, and pairs that overlap by more do not collide.

Every decision is a note in the spawn report.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from mindstage.engines.base import SpawnNote, SpawnNoteKind
from mindstage.engines.edits import SimulatedBodies
from mindstage.scene import BodyId
from mindstage.scene.bounding_boxes import Indices, OrientedBoxes, contains, overlapping_pairs, penetration_depths
from mindstage.scene.collision_shapes import CollisionShapeBatch, WallPanel, hollow_box
from mindstage.scene.spatial import find_enclosing_bodies
from mindstage.scene.transforms import Array

__all__ = [
    "JOINT_TOUCH_TOLERANCE_M",
    "MAX_RESOLVED_PENETRATION_M",
    "TOUCH_TOLERANCE_M",
    "CollisionFilter",
    "CollisionFilterInput",
    "InteriorFloors",
    "LooseOverlaps",
    "compute_collision_filter",
    "sorted_pair",
]

K = TypeVar("K", int, BodyId)

TOUCH_TOLERANCE_M = 0.002
"""Boxes that overlap by less only touch [m]; maps round to a micrometer, people to a millimeter."""

JOINT_TOUCH_TOLERANCE_M = 0.00005
"""The same for a body on a joint and a fixed one [m].

Engines must not resolve such contacts, since faces without a gap would rub and drawers jam.
"""

MAX_RESOLVED_PENETRATION_M = 0.01
"""Free bodies that penetrate others by at most this, and half their thickness, are pushed out [m]."""

_MAX_FLOOR_GAP_M = 0.03
"""What stands on a surface is above it or in it by at most this [m]."""

_MAX_OVERLAPS = 256
"""A body that overlaps more bodies than this is not compared with each of them."""

_MAX_NEIGHBORS = 1024
"""Pairs of bodies with more neighbors than this are skipped, since ten thousand bodies have fifty million pairs."""


class InteriorFloors(NamedTuple):
    """The k surfaces inside of bodies on which contents stand: shelves, and the bottoms of drawers."""

    owner: Indices
    """The body of each surface."""
    low: Array
    """Lower corner of the box around each surface, k x 3 [m]."""
    high: Array
    """Upper corner, k x 3 [m]."""


@dataclass(frozen=True, slots=True)
class CollisionFilterInput:
    """The n bodies whose collisions are decided."""

    ids: tuple[BodyId, ...]
    poses: Array
    """n x 7, with unit quaternions."""
    sizes: Array
    """n x 3 [m]."""
    group: NDArray[np.intp]
    """Index of each body's rigid group; bodies of one group never collide."""
    is_dynamic: NDArray[np.bool_]
    """Whether the body's group is dynamic."""
    is_free: NDArray[np.bool_]
    """Whether its group is dynamic and has no joints."""
    is_new: NDArray[np.bool_]
    """Whether it was just added; pairs of other bodies are not decided again."""
    jointed_pairs: frozenset[tuple[int, int]]
    """Pairs of groups (lower index first) that are connected by a joint and must not collide."""
    overlap_boxes: OrientedBoxes
    """Boxes for the overlap test; those of round shapes are smaller, since these do not fill their corners."""
    collision_shapes: CollisionShapeBatch | None = None
    """Collision shapes of the bodies; None if no body has geometry."""
    has_geometry: NDArray[np.bool_] | None = None
    """Whether a body's collision shapes differ from the box of its size."""
    tree: NDArray[np.intp] | None = None
    """Number of each body's tree: groups connected by joints. None if loose bodies are not moved."""
    is_loose: NDArray[np.bool_] | None = None
    """Whether all groups of the body's tree are dynamic, so that it falls unless it is supported."""
    floors: InteriorFloors | None = None
    """The surfaces inside of bodies; None if loose bodies are not moved."""
    could_collide_before: Callable[[int, int], bool] = lambda a, b: False
    """Whether a pair could collide before the edit; then it still can, however deep the overlap."""


@dataclass(slots=True)
class CollisionFilter:
    """The decisions on bodies that exist."""

    excluded_pairs: set[tuple[BodyId, BodyId]] = field(default_factory=set)
    """Pairs that do not collide, the lower id first."""
    non_colliding: set[BodyId] = field(default_factory=set)
    """Bodies that collide with nothing."""
    wall_panels: dict[BodyId, tuple[WallPanel, ...]] = field(default_factory=dict)
    """Wall panels of each hollow body, in its own frame."""
    contents: dict[BodyId, tuple[BodyId, ...]] = field(default_factory=dict)
    """The bodies for which each hollow body was made hollow."""
    temporary_pairs: set[tuple[BodyId, BodyId]] = field(default_factory=set)
    """Those of the excluded pairs that collide again once they were apart."""

    def copy(self) -> CollisionFilter:
        """An independent copy."""
        return CollisionFilter(
            set(self.excluded_pairs),
            set(self.non_colliding),
            dict(self.wall_panels),
            dict(self.contents),
            set(self.temporary_pairs),
        )

    def remove(self, ids: Iterable[BodyId]) -> None:
        """Removes the decisions on bodies."""
        removed = set(ids)
        self.excluded_pairs = {pair for pair in self.excluded_pairs if not removed.intersection(pair)}
        self.temporary_pairs &= self.excluded_pairs
        self.non_colliding -= removed
        for id in removed:
            self.wall_panels.pop(id, None)
            self.contents.pop(id, None)

    def restore(self, before: SimulatedBodies, *, existing: Container[BodyId]) -> None:
        """Adds the earlier decisions on bodies that were removed, as far as they are about existing ones."""
        self.excluded_pairs |= {(a, b) for a, b in before.excluded_pairs if a in existing and b in existing}
        self.temporary_pairs |= before.temporary_pairs & self.excluded_pairs
        self.non_colliding |= before.non_colliding
        self.wall_panels |= before.wall_panels
        self.contents |= before.contents


@dataclass(frozen=True, slots=True)
class LooseOverlaps:
    """The overlaps from which loose bodies have to be moved."""

    pairs: tuple[tuple[int, int, float], ...] = ()
    """Indices of two bodies, at least one of which is loose, and the depth of their overlap [m]."""
    nested: frozenset[tuple[int, int]] = frozenset()
    """Pairs of a hollow body and its contents, in both orders, whose overlap is intended."""

    def with_rows(self, rows: Sequence[int]) -> LooseOverlaps:
        """The same overlaps with other indices: `rows` has the new one for each."""
        return LooseOverlaps(
            tuple((rows[a], rows[b], depth) for a, b, depth in self.pairs),
            frozenset((rows[a], rows[b]) for a, b in self.nested),
        )


def compute_collision_filter(
    filter_input: CollisionFilterInput, previous: CollisionFilter
) -> tuple[CollisionFilter, list[SpawnNote], LooseOverlaps]:
    """Decides about all new bodies, given the previous decisions."""
    result, notes = previous.copy(), list[SpawnNote]()
    boxes = OrientedBoxes.from_poses(filter_input.poses, filter_input.sizes)
    overcrowded = _overcrowded(filter_input)
    a, b, depth = _overlapping(filter_input, overcrowded)
    containing = _containing_pairs(filter_input, boxes, a, b)
    enclosures = find_enclosing_bodies(
        boxes,
        containing,
        is_dynamic=filter_input.is_dynamic,
        is_free=filter_input.is_free,
        group=filter_input.group,
        jointed_pairs=filter_input.jointed_pairs,
    )
    for index, count in enclosures.items():
        id = filter_input.ids[index]
        result.non_colliding.add(id)
        text = f"{id} encloses {count} pieces of furniture: it collides with nothing"
        notes.append(SpawnNote(SpawnNoteKind.ENCLOSURE, (id,), text))
    contents, contained = _contents(filter_input, boxes, enclosures, result, a, b)
    around = _around_containers(filter_input, a, b)
    contained |= set(around)
    parts = _part_positions(filter_input)
    for outer, inner in contents.items():
        notes.append(
            _make_hollow(filter_input, boxes, result, outer, inner, parts.get(int(filter_input.group[outer]), ()))
        )
    resting = {(outer, item) for outer, inner in contents.items() for item in inner}
    a, b, depth, penetrating_notes = _refine_overlaps(filter_input, a, b, depth)
    notes += penetrating_notes
    notes += _disable_collisions(filter_input, result, _crowded_mask(filter_input, a, b) | overcrowded)
    is_settled = _is_settled(filter_input, result, a, b, contained)
    loose_pairs = zip(a[is_settled].tolist(), b[is_settled].tolist(), depth[is_settled].tolist(), strict=True)
    nested = frozenset((*resting, *((inner, outer) for outer, inner in resting)))
    loose = LooseOverlaps(tuple(pair for pair in loose_pairs if pair[:2] not in nested), nested)
    overlaps = a[~is_settled], b[~is_settled], depth[~is_settled]
    notes += _exclude_overlapping_pairs(filter_input, result, overlaps, resting)
    for (first, second), is_passing in around.items():
        pair = sorted_pair(filter_input.ids[first], filter_input.ids[second])
        if is_passing and pair in result.excluded_pairs:
            result.temporary_pairs.add(pair)
    return result, notes, loose


def _around_containers(filter_input: CollisionFilterInput, a: Indices, b: Indices) -> dict[tuple[int, int], bool]:
    """The pairs of a body that is not loose, and of what stands inside another one that is in it or a part of it.

    The value is whether the pair is to collide again once it was apart. It is not if the container moves relative to
    the first body: what is in a drawer has to return with it.
    """
    floors = filter_input.floors
    if floors is None or filter_input.is_loose is None or not len(floors.owner) or not len(a):
        return {}
    group, is_dynamic, is_loose = filter_input.group, filter_input.is_dynamic, filter_input.is_loose
    overlapping: dict[int, set[int]] = {}
    for i, j in zip(a.tolist(), b.tolist(), strict=True):
        overlapping.setdefault(i, set()).add(j)
        overlapping.setdefault(j, set()).add(i)
    low, high = filter_input.overlap_boxes.bounds()
    middle, volume = (low + high) / 2, np.prod(high - low, axis=1)
    found: dict[tuple[int, int], bool] = {}
    for thing in np.flatnonzero(is_loose).tolist():
        near = overlapping.get(thing, set())
        rows = np.flatnonzero(np.isin(floors.owner, list(near)))
        is_over = np.all(
            (middle[thing, :2] > floors.low[rows, :2]) & (middle[thing, :2] < floors.high[rows, :2]), axis=1
        )
        gap = low[thing, 2] - floors.high[rows, 2]
        containers = set(floors.owner[rows[is_over & (np.abs(gap) <= _MAX_FLOOR_GAP_M)]].tolist())
        if not containers:
            continue
        container = min(containers, key=lambda row: (volume[row], row))
        for other in near - {container}:
            carries = low[thing, 2] >= high[other, 2] - _MAX_FLOOR_GAP_M
            is_part = bool(group[other] == group[container])
            if not is_loose[other] and not carries and (is_part or other in overlapping.get(container, ())):
                found[other, thing] = is_part or not (is_dynamic[container] or is_dynamic[other])
    return found


def _is_settled(
    filter_input: CollisionFilterInput,
    result: CollisionFilter,
    a: Indices,
    b: Indices,
    contained: set[tuple[int, int]],
) -> NDArray[np.bool_]:
    """Whether the overlap of a pair is resolved by moving a loose body out of it.

    That of a body and the larger ones of its containers is not: what is in a drawer is also in the cabinet.
    """
    if filter_input.is_loose is None or filter_input.tree is None or not len(a):
        return np.zeros(len(a), dtype=bool)
    is_settled: NDArray[np.bool_] = (filter_input.is_loose[a] | filter_input.is_loose[b]) & (
        filter_input.tree[a] != filter_input.tree[b]
    )
    if result.non_colliding and is_settled.any():
        collides = np.array([id not in result.non_colliding for id in filter_input.ids], dtype=bool)
        is_settled &= collides[a] & collides[b]
    if contained and is_settled.any():
        pairs = zip(a.tolist(), b.tolist(), strict=True)
        is_settled &= np.array([pair not in contained and pair[::-1] not in contained for pair in pairs], dtype=bool)
    return is_settled


def _overcrowded(filter_input: CollisionFilterInput) -> NDArray[np.bool_]:
    """Bodies with more neighbors than `_MAX_NEIGHBORS`."""
    every_body = np.ones(len(filter_input.ids), dtype=bool)
    count = np.zeros(len(filter_input.ids), dtype=np.intp)
    if len(filter_input.ids) > _MAX_NEIGHBORS:
        for a, b in overlapping_pairs(filter_input.overlap_boxes, filter_input.is_new, every_body):
            count += np.bincount(a, minlength=len(count)) + np.bincount(b, minlength=len(count))
    return np.asarray(count > _MAX_NEIGHBORS)


def _overlapping(filter_input: CollisionFilterInput, overcrowded: NDArray[np.bool_]) -> tuple[Indices, Indices, Array]:
    """Overlapping pairs of different groups, at least one body of which is new, and their depths [m]."""
    every_body = np.ones(len(filter_input.ids), dtype=bool)
    found_a, found_b, found_depth = [], [], []
    for a, b in overlapping_pairs(filter_input.overlap_boxes, filter_input.is_new, every_body):
        is_candidate = (filter_input.group[a] != filter_input.group[b]) & ~(overcrowded[a] & overcrowded[b])
        a, b = a[is_candidate], b[is_candidate]
        depth = penetration_depths(filter_input.overlap_boxes, a, b)
        is_overlapping = depth > _allowed_depth(filter_input, a, b)
        is_overlapping[is_overlapping] = [
            not filter_input.could_collide_before(i, j)
            for i, j in zip(a[is_overlapping].tolist(), b[is_overlapping].tolist(), strict=True)
        ]
        found_a.append(a[is_overlapping])
        found_b.append(b[is_overlapping])
        found_depth.append(depth[is_overlapping])
    if not found_a:
        none = np.zeros(0, dtype=np.intp)
        return none, none, np.zeros(0)
    return np.concatenate(found_a), np.concatenate(found_b), np.concatenate(found_depth)


def _refine_overlaps(
    filter_input: CollisionFilterInput, a: Indices, b: Indices, depth: Array
) -> tuple[Indices, Indices, Array, list[SpawnNote]]:
    """The pairs whose collision shapes overlap, and their depths [m].

    Free bodies that penetrate others slightly are left out: they are pushed out, and without the collision they would
    fall through their support.
    """
    if filter_input.collision_shapes is None or filter_input.has_geometry is None:
        return a, b, depth, []
    has_shapes = filter_input.has_geometry[a] | filter_input.has_geometry[b]
    depth = depth.copy()
    depth[has_shapes] = filter_input.collision_shapes.penetration_depths(
        a[has_shapes], b[has_shapes], depth[has_shapes]
    )
    is_overlapping = depth > _allowed_depth(filter_input, a, b)
    thickness = np.where(filter_input.is_free, filter_input.sizes.min(axis=1), np.inf)
    resolvable = np.minimum(MAX_RESOLVED_PENETRATION_M, np.minimum(thickness[a], thickness[b]) / 2)
    if filter_input.is_loose is not None:
        resolvable = np.zeros(len(a))
    is_penetrating = (
        is_overlapping & has_shapes & (filter_input.is_free[a] | filter_input.is_free[b]) & (depth <= resolvable)
    )
    is_overlapping &= ~is_penetrating
    return (
        a[is_overlapping],
        b[is_overlapping],
        depth[is_overlapping],
        _penetration_notes(filter_input, a[is_penetrating], b[is_penetrating], depth[is_penetrating]),
    )


def _penetration_notes(filter_input: CollisionFilterInput, a: Indices, b: Indices, depth: Array) -> list[SpawnNote]:
    """One note for each body that penetrates others slightly."""
    others: dict[int, list[tuple[int, float]]] = {}
    for i, j, deep in zip(a.tolist(), b.tolist(), depth.tolist(), strict=True):
        free_index, other = (i, j) if filter_input.is_free[i] else (j, i)
        others.setdefault(free_index, []).append((other, deep))
    notes = []
    for free_index, penetrated in others.items():
        names = tuple(filter_input.ids[other] for other, _ in penetrated)
        deepest = max(deep for _, deep in penetrated) * 1000
        text = (
            f"{filter_input.ids[free_index]} penetrates {', '.join(names)} by up to {deepest:.0f} mm and is pushed out"
        )
        notes.append(SpawnNote(SpawnNoteKind.EMBEDDED, (filter_input.ids[free_index], *names), text))
    return notes


def _allowed_depth(filter_input: CollisionFilterInput, a: Indices, b: Indices) -> Array:
    """Overlap of each pair up to which it only touches [m]."""
    is_free = filter_input.is_free if filter_input.is_loose is None else filter_input.is_free | filter_input.is_loose
    return np.where(is_free[a] | is_free[b], TOUCH_TOLERANCE_M, JOINT_TOUCH_TOLERANCE_M)


def _containing_pairs(
    filter_input: CollisionFilterInput, boxes: OrientedBoxes, a: Indices, b: Indices
) -> tuple[Indices, Indices]:
    """Pairs (outer, inner) in which the outer box contains the inner one."""
    outer, inner = _outer_and_inner(filter_input, a, b)
    inside = contains(boxes, outer, inner)
    return outer[inside], inner[inside]


def _outer_and_inner(filter_input: CollisionFilterInput, a: Indices, b: Indices) -> tuple[Indices, Indices]:
    """Each pair in both orders, without those whose outer body has collision shapes with an interior of their own."""
    outer, inner = np.concatenate([a, b]), np.concatenate([b, a])
    if filter_input.has_geometry is not None:
        without_geometry = ~filter_input.has_geometry[outer]
        outer, inner = outer[without_geometry], inner[without_geometry]
    return outer, inner


def _contents(
    filter_input: CollisionFilterInput,
    boxes: OrientedBoxes,
    enclosing: Mapping[int, int],
    result: CollisionFilter,
    a: Indices,
    b: Indices,
) -> tuple[dict[int, list[int]], set[tuple[int, int]]]:
    """The free bodies inside each body, of nested containers the smallest; and the pairs with the larger ones."""
    outer, inner = _outer_and_inner(filter_input, a, b)
    volume = np.prod(boxes.half_extents, axis=1)
    is_content = filter_input.is_free[inner] & (volume[outer] > 2 * volume[inner])
    outer, inner = outer[is_content], inner[is_content]
    inside = contains(boxes, outer, inner, min_fraction=0.8)
    outer, inner = outer[inside], inner[inside]
    smallest: dict[int, int] = {}
    for o, i in zip(outer.tolist(), inner.tolist(), strict=True):
        if o in enclosing or filter_input.ids[o] in result.non_colliding:
            continue
        if i not in smallest or volume[o] < volume[smallest[i]]:
            smallest[i] = o
    contents: dict[int, list[int]] = {}
    for i, o in sorted(smallest.items()):
        contents.setdefault(o, []).append(i)
    larger = {pair for pair in zip(outer.tolist(), inner.tolist(), strict=True) if smallest.get(pair[1]) != pair[0]}
    return contents, larger


def _part_positions(filter_input: CollisionFilterInput) -> dict[int, list[Array]]:
    """Positions of doors and drawers: the groups that are jointed to each fixed group."""
    reverse_rows = range(len(filter_input.ids) - 1, -1, -1)
    # Later entries replace earlier ones, so this is the first body of each group.
    first = dict(zip(filter_input.group[::-1].tolist(), reverse_rows, strict=True))
    parts: dict[int, list[Array]] = {}
    for pair in filter_input.jointed_pairs:
        for group, other in (pair, pair[::-1]):
            if not filter_input.is_dynamic[first[group]]:
                parts.setdefault(group, []).append(filter_input.poses[first[other], :3])
    return parts


def _make_hollow(
    filter_input: CollisionFilterInput,
    boxes: OrientedBoxes,
    result: CollisionFilter,
    outer: int,
    inner: list[int],
    parts: Sequence[Array],
) -> SpawnNote:
    """Makes a body hollow around its contents, new ones and those that are still inside."""
    id = filter_input.ids[outer]
    before = set(result.contents.get(id, ()))
    old = (
        np.array([i for i, other in enumerate(filter_input.ids) if other in before], dtype=np.intp)
        if before
        else inner[:0]
    )
    remaining = [int(i) for i in old if contains(boxes, np.array([outer]), np.array([i]), min_fraction=0.8)[0]]
    contents = sorted({*inner, *remaining})
    hollow = hollow_box(boxes, outer, contents, parts)
    names = tuple(filter_input.ids[i] for i in contents)
    result.wall_panels[id] = hollow.panels
    result.contents[id] = names
    text = f"{id} is hollow, open {hollow.opening}, so that {', '.join(names)} can be inside"
    return SpawnNote(SpawnNoteKind.HOLLOW, (id, *names), text)


def _crowded_mask(filter_input: CollisionFilterInput, a: Indices, b: Indices) -> NDArray[np.bool_]:
    """Bodies that overlap more than `_MAX_OVERLAPS` others."""
    is_dynamic = filter_input.is_dynamic[a] | filter_input.is_dynamic[b]
    partners = np.bincount(np.concatenate([a[is_dynamic], b[is_dynamic]]), minlength=len(filter_input.ids))
    return np.asarray(partners > _MAX_OVERLAPS)


def _disable_collisions(
    filter_input: CollisionFilterInput, result: CollisionFilter, crowded: NDArray[np.bool_]
) -> list[SpawnNote]:
    """Disables all collisions of dynamic bodies among the given ones."""
    notes = []
    for index in np.flatnonzero(crowded & filter_input.is_dynamic).tolist():
        id = filter_input.ids[index]
        if id not in result.non_colliding:
            result.non_colliding.add(id)
            text = f"{id} overlaps more than {_MAX_OVERLAPS} others, so it collides with nothing"
            notes.append(SpawnNote(SpawnNoteKind.OVERLAP, (id,), text))
    return notes


def _exclude_overlapping_pairs(
    filter_input: CollisionFilterInput,
    result: CollisionFilter,
    overlaps: tuple[Indices, Indices, Array],
    supported: set[tuple[int, int]],
) -> list[SpawnNote]:
    """Disables collisions of overlapping pairs, except between a hollow body and its contents."""
    a, b, depth = overlaps
    is_dynamic = filter_input.is_dynamic[a] | filter_input.is_dynamic[b]
    a, b, depth = a[is_dynamic], b[is_dynamic], depth[is_dynamic]
    reported: list[tuple[int, int, float]] = []
    for i, j, deep in zip(a.tolist(), b.tolist(), depth.tolist(), strict=True):
        first, second = filter_input.ids[i], filter_input.ids[j]
        non_colliding = first in result.non_colliding or second in result.non_colliding
        if non_colliding or (i, j) in supported or (j, i) in supported:
            continue
        result.excluded_pairs.add(sorted_pair(first, second))
        if sorted_pair(int(filter_input.group[i]), int(filter_input.group[j])) not in filter_input.jointed_pairs:
            reported.append((i, j, deep))
    return _overlap_notes(filter_input.ids, reported)


def _overlap_notes(ids: tuple[BodyId, ...], pairs: list[tuple[int, int, float]]) -> list[SpawnNote]:
    """One note for each body that overlaps others; a pair is reported once, for the body with more partners."""
    partners = Counter(index for i, j, _ in pairs for index in (i, j))
    by_hub: dict[int, list[tuple[int, float]]] = {}
    for i, j, deep in pairs:
        hub, other = (i, j) if (partners[i], -i) > (partners[j], -j) else (j, i)
        by_hub.setdefault(hub, []).append((other, deep))
    notes = []
    for hub, others in by_hub.items():
        names = tuple(ids[other] for other, _ in others)
        deepest = max(deep for _, deep in others) * 1000
        text = f"{ids[hub]} overlaps {', '.join(names)} by up to {deepest:.0f} mm: they do not collide"
        notes.append(SpawnNote(SpawnNoteKind.OVERLAP, (ids[hub], *names), text))
    return notes


def sorted_pair(a: K, b: K) -> tuple[K, K]:
    """The pair with its lower element first."""
    return (a, b) if a < b else (b, a)
