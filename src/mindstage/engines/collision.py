"""Collision: which pairs may touch, decided once for all engines.

Maps hold the boxes around things, and those stand in one another: a drawer in its cabinet, milk in the fridge, the
whole kitchen in a box named "walls". Taken literally such a world explodes. What is decided instead:

- a **shell**, a body larger than a room's corner that holds several pieces of furniture, collides with nothing;
- a body that holds something loose is **hollow**: it gets walls, an opening, and a floor where its contents stand;
- any other pair that overlaps when spawned does not collide, nor do pairs joined by a constraint.

Every decision is a note in the spawn report; none is silent.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mindstage.engines.contract import Note, NoteKind
from mindstage.engines.hollow import Plate, hollow_out
from mindstage.world import BodyId
from mindstage.world.boxes import Boxes, contains, depths, neighbours
from mindstage.world.geometry import Array
from mindstage.world.shells import find_shells

__all__ = ["TOUCH_M", "Collisions", "Scene", "decide"]

TOUCH_M = 0.002
"""Boxes that stand in one another by less than this only touch: maps round to a micrometre, people to a millimetre."""

_CROWD = 256
"""A body that overlaps more others than this is not told apart from each of them."""

_THRONG = 1024
"""Of bodies that have more neighbours than this, pairs are not even looked at: ten thousand have fifty million."""


@dataclass(frozen=True, slots=True)
class Scene:
    """What is to be decided about: n bodies as they stand now."""

    ids: tuple[BodyId, ...]
    poses: Array
    """n x 7, unit quaternions."""
    sizes: Array
    """n x 3 [m]."""
    assembly: NDArray[np.intp]
    """A number for each body's assembly; bodies of one never collide."""
    simulates: NDArray[np.bool_]
    """Whether the physics moves the body's assembly."""
    loose: NDArray[np.bool_]
    """Whether it is on its own: the physics moves it and no constraint holds it."""
    fresh: NDArray[np.bool_]
    """Whether it came just now; pairs of old ones are not looked at again."""
    joined: frozenset[tuple[int, int]]
    """Pairs of assemblies (lower number first) that are joined by a constraint and must not collide."""
    cores: Boxes
    """The boxes that count for overlaps: what is round does not fill the corners of its own."""
    settled: Callable[[int, int], bool] = lambda a, b: False
    """Whether a pair could collide before the edit in question: then it still may, however deep it is just now."""


@dataclass(slots=True)
class Collisions:
    """The decisions, kept as long as the bodies are."""

    apart: set[tuple[BodyId, BodyId]] = field(default_factory=set)
    """Pairs that do not collide, in the order of their ids."""
    ghosts: set[BodyId] = field(default_factory=set)
    """Bodies that collide with nothing."""
    hollows: dict[BodyId, tuple[Plate, ...]] = field(default_factory=dict)
    """The plates that a hollow body is made of, in its own frame."""
    contents: dict[BodyId, tuple[BodyId, ...]] = field(default_factory=dict)
    """What each hollow body was made hollow for."""

    def copy(self) -> Collisions:
        """The same decisions, to be changed on their own."""
        return Collisions(set(self.apart), set(self.ghosts), dict(self.hollows), dict(self.contents))

    def forget(self, ids: Iterable[BodyId]) -> None:
        """Drops what was decided about bodies that are no longer there."""
        gone = set(ids)
        self.apart = {pair for pair in self.apart if not gone.intersection(pair)}
        self.ghosts -= gone
        for id in gone:
            self.hollows.pop(id, None)
            self.contents.pop(id, None)


def decide(scene: Scene, so_far: Collisions) -> tuple[Collisions, list[Note]]:
    """Decides about all that is fresh, on top of what was decided before."""
    collisions, notes = so_far.copy(), list[Note]()
    boxes = Boxes.of(scene.poses, scene.sizes)
    thronged = _thronged(scene)
    a, b, depth = _overlapping(scene, thronged)
    holds = _holding(boxes, a, b)
    shells = find_shells(
        boxes, holds, moves=scene.simulates, loose=scene.loose, assembly=scene.assembly, joined=scene.joined
    )
    for index, count in shells.items():
        id = scene.ids[index]
        collisions.ghosts.add(id)
        text = f"{id} encloses {count} pieces of furniture: it is seen through and collides with nothing"
        notes.append(Note(NoteKind.SHELL, (id,), text))
    contents = _contents(scene, boxes, shells, collisions, a, b)
    fronts = _fronts(scene)
    for outer, inner in contents.items():
        notes.append(_hollow(scene, boxes, collisions, outer, inner, fronts.get(int(scene.assembly[outer]), ())))
    resting = {(outer, item) for outer, inner in contents.items() for item in inner}
    notes += _make_ghosts(scene, collisions, _crowded(scene, a, b) | thronged)
    notes += _keep_apart(scene, collisions, (a, b, depth), resting)
    return collisions, notes


def _thronged(scene: Scene) -> NDArray[np.bool_]:
    """Which bodies have so many neighbours that the pairs among them are too many to look at."""
    everything = np.ones(len(scene.ids), dtype=bool)
    count = np.zeros(len(scene.ids), dtype=np.intp)
    if len(scene.ids) > _THRONG:
        for a, b in neighbours(scene.cores, scene.fresh, everything):
            count += np.bincount(a, minlength=len(count)) + np.bincount(b, minlength=len(count))
    return np.asarray(count > _THRONG)


def _overlapping(scene: Scene, thronged: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """All pairs of different assemblies that stand in one another, at least one of them fresh."""
    everything = np.ones(len(scene.ids), dtype=bool)
    found_a, found_b, found_depth = [], [], []
    for a, b in neighbours(scene.cores, scene.fresh, everything):
        apart = (scene.assembly[a] != scene.assembly[b]) & ~(thronged[a] & thronged[b])
        a, b = a[apart], b[apart]
        depth = depths(scene.cores, a, b)
        deep = depth > TOUCH_M
        deep[deep] = [not scene.settled(i, j) for i, j in zip(a[deep].tolist(), b[deep].tolist(), strict=True)]
        found_a.append(a[deep])
        found_b.append(b[deep])
        found_depth.append(depth[deep])
    if not found_a:
        none = np.zeros(0, dtype=np.intp)
        return none, none, np.zeros(0)
    return np.concatenate(found_a), np.concatenate(found_b), np.concatenate(found_depth)


def _holding(boxes: Boxes, a: NDArray[np.intp], b: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Pairs (outer, inner) in which the outer box holds all of the inner one."""
    outer, inner = np.concatenate([a, b]), np.concatenate([b, a])
    inside = contains(boxes, outer, inner)
    return outer[inside], inner[inside]


def _contents(
    scene: Scene,
    boxes: Boxes,
    shells: Mapping[int, int],
    collisions: Collisions,
    a: NDArray[np.intp],
    b: NDArray[np.intp],
) -> dict[int, list[int]]:
    """For each body that holds something loose: what. Of nested holders the smallest counts."""
    outer, inner = np.concatenate([a, b]), np.concatenate([b, a])
    volume = np.prod(boxes.half, axis=1)
    able = scene.loose[inner] & (volume[outer] > 2 * volume[inner])
    outer, inner = outer[able], inner[able]
    inside = contains(boxes, outer, inner, share=0.8)
    outer, inner = outer[inside], inner[inside]
    smallest: dict[int, int] = {}
    for o, i in zip(outer.tolist(), inner.tolist(), strict=True):
        if o in shells or scene.ids[o] in collisions.ghosts:
            continue
        if i not in smallest or volume[o] < volume[smallest[i]]:
            smallest[i] = o
    contents: dict[int, list[int]] = {}
    for i, o in sorted(smallest.items()):
        contents.setdefault(o, []).append(i)
    return contents


def _fronts(scene: Scene) -> dict[int, list[Array]]:
    """For each assembly that does not move by itself: where what is joined to it (doors, drawers) stands."""
    backwards = range(len(scene.ids) - 1, -1, -1)
    first = dict(zip(scene.assembly[::-1].tolist(), backwards, strict=True))  # of several, the first comes last
    fronts: dict[int, list[Array]] = {}
    for pair in scene.joined:
        for here, there in (pair, pair[::-1]):
            if not scene.simulates[first[here]]:
                fronts.setdefault(here, []).append(scene.poses[first[there], :3])
    return fronts


def _hollow(
    scene: Scene, boxes: Boxes, collisions: Collisions, outer: int, inner: list[int], fronts: Sequence[Array]
) -> Note:
    """Makes one body hollow around its contents: those that just came, and those that are still in it."""
    id = scene.ids[outer]
    before = set(collisions.contents.get(id, ()))
    old = np.array([i for i, other in enumerate(scene.ids) if other in before], dtype=np.intp) if before else inner[:0]
    still = [int(i) for i in old if contains(boxes, np.array([outer]), np.array([i]), share=0.8)[0]]
    inside = sorted({*inner, *still})
    hollow = hollow_out(boxes, outer, inside, fronts)
    names = tuple(scene.ids[i] for i in inside)
    collisions.hollows[id] = hollow.plates
    collisions.contents[id] = names
    text = f"{id} is hollow, open {hollow.opening}, so that {', '.join(names)} can be inside"
    return Note(NoteKind.HOLLOW, (id, *names), text)


def _crowded(scene: Scene, a: NDArray[np.intp], b: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Which bodies overlap more others than can be told one by one."""
    matters = scene.simulates[a] | scene.simulates[b]
    partners = np.bincount(np.concatenate([a[matters], b[matters]]), minlength=len(scene.ids))
    return np.asarray(partners > _CROWD)


def _make_ghosts(scene: Scene, collisions: Collisions, crowded: NDArray[np.bool_]) -> list[Note]:
    """Bodies in a crowd collide with nothing; what stands still is left as it is."""
    notes = []
    for index in np.flatnonzero(crowded & scene.simulates).tolist():
        id = scene.ids[index]
        if id not in collisions.ghosts:
            collisions.ghosts.add(id)
            text = f"{id} overlaps more than {_CROWD} others, so it collides with nothing"
            notes.append(Note(NoteKind.OVERLAP, (id,), text))
    return notes


def _keep_apart(
    scene: Scene,
    collisions: Collisions,
    overlaps: tuple[NDArray[np.intp], NDArray[np.intp], Array],
    resting: set[tuple[int, int]],
) -> list[Note]:
    """Overlapping pairs do not collide, unless one of them now has an inside for the other."""
    a, b, depth = overlaps
    matters = scene.simulates[a] | scene.simulates[b]
    a, b, depth = a[matters], b[matters], depth[matters]
    told: list[tuple[int, int, float]] = []
    for i, j, deep in zip(a.tolist(), b.tolist(), depth.tolist(), strict=True):
        first, second = scene.ids[i], scene.ids[j]
        ghost = first in collisions.ghosts or second in collisions.ghosts
        if ghost or (i, j) in resting or (j, i) in resting:
            continue
        collisions.apart.add((first, second) if first < second else (second, first))
        if _pair(int(scene.assembly[i]), int(scene.assembly[j])) not in scene.joined:
            told.append((i, j, deep))
    return _overlap_notes(scene.ids, told)


def _overlap_notes(ids: tuple[BodyId, ...], pairs: list[tuple[int, int, float]]) -> list[Note]:
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
        notes.append(Note(NoteKind.OVERLAP, (ids[hub], *names), text))
    return notes


def _pair(a: int, b: int) -> tuple[int, int]:
    return (a, b) if a < b else (b, a)
