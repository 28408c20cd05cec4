"""Kitchens of forms against the same kitchens of plain boxes: what it costs, and what is true of them."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import median
from typing import NamedTuple

import mujoco
import numpy as np

from benchmarks import Measure, run
from mindstage.engines import MujocoEngine, SpawnNoteKind
from mindstage.geometry.fit import fit_geometry
from mindstage.knowledge import KnowledgeBase, bundled_kitchen
from mindstage.scene import NO_GEOMETRY, GeometryMap, World

RUNS = 9
_DEEP_M = 0.001
_BOXES = "plain boxes"
_COLD = """
import sys, time
from pathlib import Path
from mindstage.knowledge import KnowledgeBase
from mindstage.geometry import fit_geometry
knowledge = KnowledgeBase()
knowledge.load([Path(sys.argv[1])])
world = knowledge.world()
start = time.process_time()
fit_geometry(world, knowledge)
Path(sys.argv[2]).write_text(str(time.process_time() - start), encoding="utf-8")
"""


class _Place(NamedTuple):
    name: str
    path: Path
    world: World
    knowledge: KnowledgeBase
    forms: GeometryMap


def measure() -> Iterator[Measure]:
    for name, path in _maps():
        knowledge = KnowledgeBase()
        knowledge.load([path])
        world = knowledge.world()
        place = _Place(name, path, world, knowledge, fit_geometry(world, knowledge).geometry)
        yield from _building(place)
        yield _spawning(place)
        yield from _stepping(place)
        yield from _truth(place)


def _maps() -> Iterator[tuple[str, Path]]:
    yield "bundled kitchen", bundled_kitchen()
    data = Path(os.environ.get("MINDSTAGE_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data")
    laboratory = data / "maps" / "iai-kitchen-original.owl"
    if laboratory.is_file():
        yield "thesis's kitchen", laboratory


def _building(place: _Place) -> Iterator[Measure]:
    cold = median(_cold_s(place.path) for _ in range(3))
    (warm,) = _timed(lambda: fit_geometry(place.world, place.knowledge))
    what = f"{place.name}: forms of {len(place.world.bodies)} bodies"
    yield Measure(what=f"{what}, cold", ours=1000 * cold, unit="ms")
    yield Measure(
        what=f"{what}, again", ours=1000 * warm, unit="ms", peer="cold", theirs=1000 * cold, at_most=1.0
    )  # fmt: skip


def _cold_s(path: Path) -> float:
    """In a process of its own, whose caches are empty [s]."""
    told = Path(os.environ.get("TMPDIR", "/tmp")) / f"mindstage-forms-{os.getpid()}"
    try:
        run([sys.executable, "-c", _COLD, str(path), str(told)])
        return float(told.read_text(encoding="utf-8"))
    finally:
        told.unlink(missing_ok=True)


def _spawning(place: _Place) -> Measure:
    ours, theirs = _timed(lambda: _spawned(place, place.forms), lambda: _spawned(place, NO_GEOMETRY))
    return Measure(
        what=f"{place.name}: spawn", ours=1000 * ours, unit="ms", peer=_BOXES, theirs=1000 * theirs, at_most=2.0
    )  # fmt: skip


def _stepping(place: _Place) -> Iterator[Measure]:
    formed, plain = _spawned(place, place.forms), _spawned(place, NO_GEOMETRY)
    fresh = iter([_spawned(place, place.forms) for _ in range(RUNS)])
    (left_alone,) = _timed(lambda: next(fresh).step(10.0))
    yield Measure(
        what=f"{place.name}: simulated seconds a second, left alone for 10 s",
        ours=10.0 / left_alone,
        unit="s/s",
        at_least=5.0,
    )
    for engine in (formed, plain):
        engine.step(2.0)
    ours, theirs = _timed(lambda: formed.step(1.0), lambda: plain.step(1.0))
    yield Measure(
        what=f"{place.name}: one second at rest",
        ours=1000 * ours,
        unit="ms",
        peer=_BOXES,
        theirs=1000 * theirs,
        at_most=1.5,
    )
    for engine in (formed, plain):
        engine._cache.model().model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    ours, theirs = _timed(lambda: formed.step(0.2), lambda: plain.step(0.2))
    yield Measure(
        what=f"{place.name}: a fifth of a second, nothing asleep", ours=1000 * ours, unit="ms", peer=_BOXES,
        theirs=1000 * theirs, at_most=1.5,
    )  # fmt: skip


class _Truth(NamedTuple):
    pairs: int
    """That stand in one another, so that they do not collide."""
    contacts: int
    deep: int
    """Contacts of more than a millimetre."""
    moved_mm: float
    """In ten seconds, at most."""


def _truth(place: _Place) -> Iterator[Measure]:
    ours, theirs = _true_of(place, place.forms), _true_of(place, NO_GEOMETRY)
    for what, mine, other in (
        ("pairs that overlap, so do not collide", ours.pairs, theirs.pairs),
        ("contacts at rest", ours.contacts, theirs.contacts),
        ("contacts deeper than 1 mm", ours.deep, theirs.deep),
    ):
        yield Measure(what=f"{place.name}: {what}", ours=mine, unit="", peer=_BOXES, theirs=other or None)
    yield Measure(what=f"{place.name}: moved in 10 s, at most", ours=ours.moved_mm, unit="mm", at_most=10.0)


def _true_of(place: _Place, forms: GeometryMap) -> _Truth:
    engine = MujocoEngine()
    report = engine.spawn(place.world, geometry=forms)
    before = engine.poses()[1]
    engine.step(10.0)
    moved = np.linalg.norm(engine.poses()[1][:, :3] - before[:, :3], axis=1).max()
    live = engine._cache.model()
    live.model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)  # what sleeps has no contacts
    engine.step(0.01)
    pairs = sum(len(note.ids) - 1 for note in report.notes if note.kind is SpawnNoteKind.OVERLAP)
    deep = int((live.data.contact.dist < -_DEEP_M).sum())
    return _Truth(pairs, int(live.data.ncon), deep, 1000 * float(moved))


def _spawned(place: _Place, forms: GeometryMap) -> MujocoEngine:
    engine = MujocoEngine()
    engine.spawn(place.world, geometry=forms)
    engine.step(0.002)
    return engine


def _timed(*actions: Callable[[], object]) -> list[float]:
    """The median of each on one core [s of it]; they take turns, so that a busy machine slows all alike."""
    seconds: list[list[float]] = [[] for _ in actions]
    for _ in range(RUNS):
        for action, taken in zip(actions, seconds, strict=True):
            start = time.process_time()
            action()
            taken.append(time.process_time() - start)
    return [median(taken) for taken in seconds]
