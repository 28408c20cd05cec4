"""Collision: which pairs may touch, decided once for all engines.

Maps hold the boxes around things, and those stand in one another: a drawer in its cabinet, milk in the fridge, the
whole kitchen in a box named "walls". Taken literally such a world explodes. What is decided instead:

- a **shell**, a body larger than a room's corner that holds several pieces of furniture, collides with nothing;
- a body that holds something loose is **hollow**: it gets walls, an opening, and a floor where its contents stand;
- any other pair that overlaps when spawned does not collide, nor do pairs joined by a constraint.

Where a body has a form, its solids decide and not the box around them: a form has its inside already, two forms
overlap only if solids of theirs do, and what is loose and a little too deep in what it stands on is pushed out of it.
What hangs in joints may not even graze what it does not hang on: pressed in by a millimetre, a drawer jams.

Every decision is a note in the spawn report; none is silent.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mindstage.engines.base import SpawnNote, SpawnNoteKind
from mindstage.engines.collision_shapes import CollisionShapeBatch, WallPanel, hollow_box
from mindstage.scene import BodyId
from mindstage.scene.bounding_boxes import Indices, OrientedBoxes, contains, overlapping_pairs, penetration_depths
from mindstage.scene.spatial import find_enclosing_bodies
from mindstage.scene.transforms import Array

__all__ = [
    "JOINT_TOUCH_TOLERANCE_M",
    "MAX_RESOLVED_PENETRATION_M",
    "TOUCH_TOLERANCE_M",
    "CollisionFilter",
    "CollisionFilterInput",
    "compute_collision_filter",
]

TOUCH_TOLERANCE_M = 0.002
"""Boxes that stand in one another by less than this only touch: maps round to a micrometre, people to a millimetre."""

JOINT_TOUCH_TOLERANCE_M = 0.00005
"""What hangs in a joint and what does not move only touch if the solids stand in one another by less than this.

An engine should feel nothing of that: faces without a gap between them would rub, and two such drawers jam.
"""

MAX_RESOLVED_PENETRATION_M = 0.01
"""What is loose and stands in solids by no more than this (and half its thickness) is pushed out of them."""

_MAX_OVERLAPS = 256
"""A body that overlaps more others than this is not told apart from each of them."""

_MAX_NEIGHBORS = 1024
"""Of bodies that have more neighbors than this, pairs are not even looked at: ten thousand have fifty million."""


@dataclass(frozen=True, slots=True)
class CollisionFilterInput:
    """What is to be decided about: n bodies as they stand now."""

    ids: tuple[BodyId, ...]
    poses: Array
    """n x 7, unit quaternions."""
    sizes: Array
    """n x 3 [m]."""
    group: NDArray[np.intp]
    """A number for each body's assembly; bodies of one never collide."""
    is_dynamic: NDArray[np.bool_]
    """Whether the physics moves the body's assembly."""
    is_free: NDArray[np.bool_]
    """Whether it is on its own: the physics moves it and no constraint holds it."""
    is_new: NDArray[np.bool_]
    """Whether it came just now; pairs of old ones are not looked at again."""
    jointed_pairs: frozenset[tuple[int, int]]
    """Pairs of assemblies (lower number first) that are joined by a constraint and must not collide."""
    overlap_boxes: OrientedBoxes
    """The boxes that count for overlaps: what is round does not fill the corners of its own."""
    collision_shapes: CollisionShapeBatch | None = None
    """What the bodies are made of; None where none of them has a form."""
    has_geometry: NDArray[np.bool_] | None = None
    """Whether a body has a form of its own, which is not just the box of its size."""
    could_collide_before: Callable[[int, int], bool] = lambda a, b: False
    """Whether a pair could collide before the edit in question: then it still may, however deep it is just now."""


@dataclass(slots=True)
class CollisionFilter:
    """The decisions, kept as long as the bodies are."""

    excluded_pairs: set[tuple[BodyId, BodyId]] = field(default_factory=set)
    """Pairs that do not collide, in the order of their ids."""
    non_colliding: set[BodyId] = field(default_factory=set)
    """Bodies that collide with nothing."""
    wall_panels: dict[BodyId, tuple[WallPanel, ...]] = field(default_factory=dict)
    """The plates that a hollow body is made of, in its own frame."""
    contents: dict[BodyId, tuple[BodyId, ...]] = field(default_factory=dict)
    """What each hollow body was made hollow for."""

    def copy(self) -> CollisionFilter:
        """The same decisions, to be changed on their own."""
        return CollisionFilter(
            set(self.excluded_pairs), set(self.non_colliding), dict(self.wall_panels), dict(self.contents)
        )

    def remove(self, ids: Iterable[BodyId]) -> None:
        """Drops what was decided about bodies that are no longer there."""
        gone = set(ids)
        self.excluded_pairs = {pair for pair in self.excluded_pairs if not gone.intersection(pair)}
        self.non_colliding -= gone
        for id in gone:
            self.wall_panels.pop(id, None)
            self.contents.pop(id, None)


def compute_collision_filter(
    scene: CollisionFilterInput, previous: CollisionFilter
) -> tuple[CollisionFilter, list[SpawnNote]]:
    """Decides about all that is fresh, on top of what was decided before."""
    collisions, notes = previous.copy(), list[SpawnNote]()
    boxes = OrientedBoxes.from_poses(scene.poses, scene.sizes)
    thronged = _overcrowded(scene)
    a, b, depth = _overlapping(scene, thronged)
    holds = _containing_pairs(scene, boxes, a, b)
    shells = find_enclosing_bodies(
        boxes,
        holds,
        is_dynamic=scene.is_dynamic,
        is_free=scene.is_free,
        group=scene.group,
        jointed_pairs=scene.jointed_pairs,
    )
    for index, count in shells.items():
        id = scene.ids[index]
        collisions.non_colliding.add(id)
        text = f"{id} encloses {count} pieces of furniture: it is seen through and collides with nothing"
        notes.append(SpawnNote(SpawnNoteKind.ENCLOSURE, (id,), text))
    contents = _contents(scene, boxes, shells, collisions, a, b)
    fronts = _front_positions(scene)
    for outer, inner in contents.items():
        notes.append(_make_hollow(scene, boxes, collisions, outer, inner, fronts.get(int(scene.group[outer]), ())))
    resting = {(outer, item) for outer, inner in contents.items() for item in inner}
    a, b, depth, sunk = _refine_overlaps(scene, a, b, depth)
    notes += sunk
    notes += _disable_collisions(scene, collisions, _crowded_mask(scene, a, b) | thronged)
    notes += _exclude_overlapping_pairs(scene, collisions, (a, b, depth), resting)
    return collisions, notes


def _overcrowded(scene: CollisionFilterInput) -> NDArray[np.bool_]:
    """Which bodies have so many neighbors that the pairs among them are too many to look at."""
    everything = np.ones(len(scene.ids), dtype=bool)
    count = np.zeros(len(scene.ids), dtype=np.intp)
    if len(scene.ids) > _MAX_NEIGHBORS:
        for a, b in overlapping_pairs(scene.overlap_boxes, scene.is_new, everything):
            count += np.bincount(a, minlength=len(count)) + np.bincount(b, minlength=len(count))
    return np.asarray(count > _MAX_NEIGHBORS)


def _overlapping(scene: CollisionFilterInput, overcrowded: NDArray[np.bool_]) -> tuple[Indices, Indices, Array]:
    """All pairs of different assemblies that stand in one another, at least one of them fresh."""
    everything = np.ones(len(scene.ids), dtype=bool)
    found_a, found_b, found_depth = [], [], []
    for a, b in overlapping_pairs(scene.overlap_boxes, scene.is_new, everything):
        apart = (scene.group[a] != scene.group[b]) & ~(overcrowded[a] & overcrowded[b])
        a, b = a[apart], b[apart]
        depth = penetration_depths(scene.overlap_boxes, a, b)
        deep = depth > _allowed_depth(scene, a, b)
        deep[deep] = [
            not scene.could_collide_before(i, j) for i, j in zip(a[deep].tolist(), b[deep].tolist(), strict=True)
        ]
        found_a.append(a[deep])
        found_b.append(b[deep])
        found_depth.append(depth[deep])
    if not found_a:
        none = np.zeros(0, dtype=np.intp)
        return none, none, np.zeros(0)
    return np.concatenate(found_a), np.concatenate(found_b), np.concatenate(found_depth)


def _refine_overlaps(
    scene: CollisionFilterInput, a: Indices, b: Indices, depth: Array
) -> tuple[Indices, Indices, Array, list[SpawnNote]]:
    """Of pairs whose boxes overlap those whose solids do, and how deep these stand in one another.

    What is loose and sunk in something by a little is none of them: it is pushed out, for else it would fall through
    what it stands on.
    """
    if scene.collision_shapes is None or scene.has_geometry is None:
        return a, b, depth, []
    formed = scene.has_geometry[a] | scene.has_geometry[b]
    depth = depth.copy()
    depth[formed] = scene.collision_shapes.penetration_depths(a[formed], b[formed], depth[formed])
    deep = depth > _allowed_depth(scene, a, b)
    thickness = np.where(scene.is_free, scene.sizes.min(axis=1), np.inf)
    bearable = np.minimum(MAX_RESOLVED_PENETRATION_M, np.minimum(thickness[a], thickness[b]) / 2)
    sunk = deep & formed & (scene.is_free[a] | scene.is_free[b]) & (depth <= bearable)
    deep &= ~sunk
    return a[deep], b[deep], depth[deep], _penetration_notes(scene, a[sunk], b[sunk], depth[sunk])


def _penetration_notes(scene: CollisionFilterInput, a: Indices, b: Indices, depth: Array) -> list[SpawnNote]:
    """One note for each body that is a little in something else, for the loose one or else the first."""
    others: dict[int, list[tuple[int, float]]] = {}
    for i, j, deep in zip(a.tolist(), b.tolist(), depth.tolist(), strict=True):
        loose, other = (i, j) if scene.is_free[i] else (j, i)
        others.setdefault(loose, []).append((other, deep))
    notes = []
    for loose, found in others.items():
        names = tuple(scene.ids[other] for other, _ in found)
        deepest = max(deep for _, deep in found) * 1000
        text = f"{scene.ids[loose]} stands in {', '.join(names)} by up to {deepest:.0f} mm and is pushed out of it"
        notes.append(SpawnNote(SpawnNoteKind.PENETRATION, (scene.ids[loose], *names), text))
    return notes


def _allowed_depth(scene: CollisionFilterInput, a: Indices, b: Indices) -> Array:
    """How deep the bodies of each pair may stand in one another and still only touch [m]."""
    return np.where(scene.is_free[a] | scene.is_free[b], TOUCH_TOLERANCE_M, JOINT_TOUCH_TOLERANCE_M)


def _containing_pairs(
    scene: CollisionFilterInput, boxes: OrientedBoxes, a: Indices, b: Indices
) -> tuple[Indices, Indices]:
    """Pairs (outer, inner) in which the outer box holds all of the inner one."""
    outer, inner = _outer_and_inner(scene, a, b)
    inside = contains(boxes, outer, inner)
    return outer[inside], inner[inside]


def _outer_and_inner(scene: CollisionFilterInput, a: Indices, b: Indices) -> tuple[Indices, Indices]:
    """Each pair both ways, but for those whose first one has a form: what is in that is its form's business."""
    outer, inner = np.concatenate([a, b]), np.concatenate([b, a])
    if scene.has_geometry is not None:
        plain = ~scene.has_geometry[outer]
        outer, inner = outer[plain], inner[plain]
    return outer, inner


def _contents(
    scene: CollisionFilterInput,
    boxes: OrientedBoxes,
    enclosing: Mapping[int, int],
    collisions: CollisionFilter,
    a: Indices,
    b: Indices,
) -> dict[int, list[int]]:
    """For each body that holds something loose: what. Of nested holders the smallest counts."""
    outer, inner = _outer_and_inner(scene, a, b)
    volume = np.prod(boxes.half_extents, axis=1)
    able = scene.is_free[inner] & (volume[outer] > 2 * volume[inner])
    outer, inner = outer[able], inner[able]
    inside = contains(boxes, outer, inner, min_fraction=0.8)
    outer, inner = outer[inside], inner[inside]
    smallest: dict[int, int] = {}
    for o, i in zip(outer.tolist(), inner.tolist(), strict=True):
        if o in enclosing or scene.ids[o] in collisions.non_colliding:
            continue
        if i not in smallest or volume[o] < volume[smallest[i]]:
            smallest[i] = o
    contents: dict[int, list[int]] = {}
    for i, o in sorted(smallest.items()):
        contents.setdefault(o, []).append(i)
    return contents


def _front_positions(scene: CollisionFilterInput) -> dict[int, list[Array]]:
    """For each assembly that does not move by itself: where what is joined to it (doors, drawers) stands."""
    backwards = range(len(scene.ids) - 1, -1, -1)
    first = dict(zip(scene.group[::-1].tolist(), backwards, strict=True))  # of several, the first comes last
    fronts: dict[int, list[Array]] = {}
    for pair in scene.jointed_pairs:
        for here, there in (pair, pair[::-1]):
            if not scene.is_dynamic[first[here]]:
                fronts.setdefault(here, []).append(scene.poses[first[there], :3])
    return fronts


def _make_hollow(
    scene: CollisionFilterInput,
    boxes: OrientedBoxes,
    collisions: CollisionFilter,
    outer: int,
    inner: list[int],
    fronts: Sequence[Array],
) -> SpawnNote:
    """Makes one body hollow around its contents: those that just came, and those that are still in it."""
    id = scene.ids[outer]
    before = set(collisions.contents.get(id, ()))
    old = np.array([i for i, other in enumerate(scene.ids) if other in before], dtype=np.intp) if before else inner[:0]
    still = [int(i) for i in old if contains(boxes, np.array([outer]), np.array([i]), min_fraction=0.8)[0]]
    inside = sorted({*inner, *still})
    hollow = hollow_box(boxes, outer, inside, fronts)
    names = tuple(scene.ids[i] for i in inside)
    collisions.wall_panels[id] = hollow.panels
    collisions.contents[id] = names
    text = f"{id} is hollow, open {hollow.opening}, so that {', '.join(names)} can be inside"
    return SpawnNote(SpawnNoteKind.HOLLOW, (id, *names), text)


def _crowded_mask(scene: CollisionFilterInput, a: Indices, b: Indices) -> NDArray[np.bool_]:
    """Which bodies overlap more others than can be told one by one."""
    matters = scene.is_dynamic[a] | scene.is_dynamic[b]
    partners = np.bincount(np.concatenate([a[matters], b[matters]]), minlength=len(scene.ids))
    return np.asarray(partners > _MAX_OVERLAPS)


def _disable_collisions(
    scene: CollisionFilterInput, collisions: CollisionFilter, crowded: NDArray[np.bool_]
) -> list[SpawnNote]:
    """Bodies in a crowd collide with nothing; what stands still is left as it is."""
    notes = []
    for index in np.flatnonzero(crowded & scene.is_dynamic).tolist():
        id = scene.ids[index]
        if id not in collisions.non_colliding:
            collisions.non_colliding.add(id)
            text = f"{id} overlaps more than {_MAX_OVERLAPS} others, so it collides with nothing"
            notes.append(SpawnNote(SpawnNoteKind.OVERLAP, (id,), text))
    return notes


def _exclude_overlapping_pairs(
    scene: CollisionFilterInput,
    collisions: CollisionFilter,
    overlaps: tuple[Indices, Indices, Array],
    supported: set[tuple[int, int]],
) -> list[SpawnNote]:
    """Overlapping pairs do not collide, unless one of them now has an inside for the other."""
    a, b, depth = overlaps
    matters = scene.is_dynamic[a] | scene.is_dynamic[b]
    a, b, depth = a[matters], b[matters], depth[matters]
    told: list[tuple[int, int, float]] = []
    for i, j, deep in zip(a.tolist(), b.tolist(), depth.tolist(), strict=True):
        first, second = scene.ids[i], scene.ids[j]
        ghost = first in collisions.non_colliding or second in collisions.non_colliding
        if ghost or (i, j) in supported or (j, i) in supported:
            continue
        collisions.excluded_pairs.add((first, second) if first < second else (second, first))
        if _sorted_pair(int(scene.group[i]), int(scene.group[j])) not in scene.jointed_pairs:
            told.append((i, j, deep))
    return _overlap_notes(scene.ids, told)


def _overlap_notes(ids: tuple[BodyId, ...], pairs: list[tuple[int, int, float]]) -> list[SpawnNote]:
    """One note for each body that overlaps others; a pair is told once, by the one with more partners."""
    partners = Counter(index for i, j, _ in pairs for index in (i, j))
    by_hub: dict[int, list[tuple[int, float]]] = {}
    for i, j, deep in pairs:
        hub, other = (i, j) if (partners[i], -i) > (partners[j], -j) else (j, i)
        by_hub.setdefault(hub, []).append((other, deep))
    notes = []
    for hub, others in by_hub.items():
        names = tuple(ids[other] for other, _ in others)
        deepest = max(deep for _, deep in others) * 1000
        text = f"{ids[hub]} overlaps {', '.join(names)} by up to {deepest:.0f} mm where they stand: they do not collide"
        notes.append(SpawnNote(SpawnNoteKind.OVERLAP, (ids[hub], *names), text))
    return notes


def _sorted_pair(a: int, b: int) -> tuple[int, int]:
    return (a, b) if a < b else (b, a)
