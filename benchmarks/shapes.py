"""Kitchens with fitted geometry, compared with the same kitchens of primitive boxes: cost and quality."""

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
from mindstage.engines import SpawnNoteKind
from mindstage.engines.mujoco import MujocoEngine
from mindstage.geometry.fit import fit_geometry
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import bundled_kitchen
from mindstage.scene import NO_GEOMETRY, GeometryMap, World
from mindstage.scene.edits import Spawn

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


class _Scene(NamedTuple):
    name: str
    path: Path
    world: World
    knowledge: KnowledgeBase
    geometry: GeometryMap


def measure() -> Iterator[Measure]:
    for name, path in _maps():
        knowledge = KnowledgeBase()
        knowledge.load([path])
        world = knowledge.world()
        scene = _Scene(name, path, world, knowledge, fit_geometry(world, knowledge).geometry)
        yield from _building(scene)
        yield _spawning(scene)
        yield from _stepping(scene)
        yield from _quality(scene)


def _maps() -> Iterator[tuple[str, Path]]:
    yield "bundled kitchen", bundled_kitchen()
    data = Path(os.environ.get("MINDSTAGE_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data")
    laboratory = data / "maps" / "iai-kitchen-original.owl"
    if laboratory.is_file():
        yield "kitchen of the thesis", laboratory


def _building(scene: _Scene) -> Iterator[Measure]:
    cold = median(_cold_s(scene.path) for _ in range(3))
    (warm,) = _timed(lambda: fit_geometry(scene.world, scene.knowledge))
    what = f"{scene.name}: geometry of {len(scene.world.bodies)} bodies"
    yield Measure(what=f"{what}, cold", ours=1000 * cold, unit="ms")
    yield Measure(
        what=f"{what}, cached", ours=1000 * warm, unit="ms", peer="cold", theirs=1000 * cold, at_most=1.0
    )  # fmt: skip


def _cold_s(path: Path) -> float:
    """In a new process with empty caches [s]."""
    output = Path(os.environ.get("TMPDIR", "/tmp")) / f"mindstage-geometry-{os.getpid()}"
    try:
        run([sys.executable, "-c", _COLD, str(path), str(output)])
        return float(output.read_text(encoding="utf-8"))
    finally:
        output.unlink(missing_ok=True)


def _spawning(scene: _Scene) -> Measure:
    ours, theirs = _timed(lambda: _spawned(scene, scene.geometry), lambda: _spawned(scene, NO_GEOMETRY))
    return Measure(
        what=f"{scene.name}: spawn", ours=1000 * ours, unit="ms", peer=_BOXES, theirs=1000 * theirs, at_most=2.0
    )  # fmt: skip


def _stepping(scene: _Scene) -> Iterator[Measure]:
    fitted_engine, box_engine = _spawned(scene, scene.geometry), _spawned(scene, NO_GEOMETRY)
    fresh = iter([_spawned(scene, scene.geometry) for _ in range(RUNS)])
    (seconds,) = _timed(lambda: next(fresh).step(10.0))
    yield Measure(
        what=f"{scene.name}: real-time factor, for 10 s",
        ours=10.0 / seconds,
        unit="s/s",
        at_least=5.0,
    )
    for engine in (fitted_engine, box_engine):
        engine.step(2.0)
    ours, theirs = _timed(lambda: fitted_engine.step(1.0), lambda: box_engine.step(1.0))
    yield Measure(
        what=f"{scene.name}: step 1 s at rest",
        ours=1000 * ours,
        unit="ms",
        peer=_BOXES,
        theirs=1000 * theirs,
        at_most=1.5,
    )
    for engine in (fitted_engine, box_engine):
        engine._cache.model().model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    ours, theirs = _timed(lambda: fitted_engine.step(0.2), lambda: box_engine.step(0.2))
    yield Measure(
        what=f"{scene.name}: step 0.2 s, sleeping disabled", ours=1000 * ours, unit="ms", peer=_BOXES,
        theirs=1000 * theirs, at_most=1.5,
    )  # fmt: skip


class _Quality(NamedTuple):
    pairs: int
    """Overlapping pairs, which are excluded from contact."""
    contacts: int
    deep: int
    """Contacts deeper than 1 mm."""
    moved_mm: float
    """Maximal motion of a body in 10 s [mm]."""


def _quality(scene: _Scene) -> Iterator[Measure]:
    ours, theirs = _quality_of(scene, scene.geometry), _quality_of(scene, NO_GEOMETRY)
    for what, mine, other in (
        ("overlapping pairs, excluded from contact", ours.pairs, theirs.pairs),
        ("contacts at rest", ours.contacts, theirs.contacts),
        ("contacts deeper than 1 mm", ours.deep, theirs.deep),
    ):
        yield Measure(what=f"{scene.name}: {what}", ours=mine, unit="", peer=_BOXES, theirs=other or None)
    yield Measure(what=f"{scene.name}: maximal motion in 10 s", ours=ours.moved_mm, unit="mm", at_most=10.0)


def _quality_of(scene: _Scene, geometry: GeometryMap) -> _Quality:
    engine = MujocoEngine()
    report = engine.apply(Spawn(scene.world, geometry=geometry)).report
    before = engine.poses()[1]
    engine.step(10.0)
    moved = np.linalg.norm(engine.poses()[1][:, :3] - before[:, :3], axis=1).max()
    live = engine._cache.model()
    live.model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)  # sleeping bodies have no contacts
    engine.step(0.01)
    pairs = sum(len(note.ids) - 1 for note in report.notes if note.kind is SpawnNoteKind.OVERLAP)
    deep = int((live.data.contact.dist < -_DEEP_M).sum())
    return _Quality(pairs, int(live.data.ncon), deep, 1000 * float(moved))


def _spawned(scene: _Scene, geometry: GeometryMap) -> MujocoEngine:
    engine = MujocoEngine()
    engine.apply(Spawn(scene.world, geometry=geometry))
    engine.step(0.002)
    return engine


def _timed(*actions: Callable[[], object]) -> list[float]:
    """The median CPU time of each action [s]; they alternate, so that other load affects all equally."""
    seconds: list[list[float]] = [[] for _ in actions]
    for _ in range(RUNS):
        for action, taken in zip(actions, seconds, strict=True):
            start = time.process_time()
            action()
            taken.append(time.process_time() - start)
    return [median(taken) for taken in seconds]
