"""The memory of MuJoCo for contacts and constraints: it grows by need, without a trace in the result, up to a limit."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from mindstage.engines.mujoco import MujocoEngine
from mindstage.engines.mujoco import compiler as mujoco_compiler
from mindstage.errors import EngineMemoryError
from mindstage.scene import Body, BodyId, BodyPhysics, Iri, Mobility, Pose, World
from mindstage.scene.edits import Delete, SetPoses, Spawn

_BOX_M = 0.1
_HUGE_BYTES = 2 * 2**30
_TIGHT_BYTES = 2**20


def _heap(count: int, *, gap_m: float = -0.0005, mobility: Mobility = Mobility.DYNAMIC) -> World:
    """Boxes in a cube, which touch their neighbors if the gap between them is negative."""
    along = round(count ** (1 / 3)) + 1
    step = _BOX_M + gap_m
    cells = [(number % along, number // along % along, number // along**2) for number in range(count)]
    return World(
        iri=Iri("http://example.org/heap.owl#map"),
        bodies=tuple(
            Body(
                id=BodyId(f"box{number}"),
                iri=Iri(f"http://example.org/heap.owl#box{number}"),
                cls=Iri("http://example.org/heap.owl#Box"),
                pose=Pose((x * step, y * step, _BOX_M / 2 + z * step)),
                size=(_BOX_M, _BOX_M, _BOX_M),
                physics=BodyPhysics(mobility=mobility, mass_kg=1.0),
            )
            for number, (x, y, z) in enumerate(cells)
        ),
    )


def _engine(world: World, monkeypatch: pytest.MonkeyPatch, first_bytes: int, **options: int) -> MujocoEngine:
    """An engine whose first model has an arena of a given size."""
    engine = MujocoEngine(**options)
    engine.apply(Spawn(world, settle=False))
    with monkeypatch.context() as patch:
        patch.setattr(mujoco_compiler, "first_arena_size", lambda *values, **names: first_bytes)
        engine.compiled()
    return engine


def _falling(count: int) -> World:
    """Boxes above each other that fall on a floor, so that contacts begin while time passes."""
    heap = _heap(count, gap_m=0.004)
    floor = Body(
        id=BodyId("floor"),
        iri=Iri("http://example.org/heap.owl#floor"),
        cls=Iri("http://example.org/heap.owl#Box"),
        pose=Pose((0.0, 0.0, -0.06)),
        size=(4.0, 4.0, _BOX_M),
        physics=BodyPhysics(mobility=Mobility.STATIC),
    )
    return World(iri=heap.iri, bodies=(floor, *heap.bodies))


def test_a_heap_has_all_contacts_and_moves_as_with_a_huge_arena(monkeypatch: pytest.MonkeyPatch) -> None:
    """The referee is the same model with an arena of 2 GB, of which almost nothing is used."""
    world = _heap(60)
    engine = _engine(world, monkeypatch, _TIGHT_BYTES)
    referee = _engine(world, monkeypatch, _HUGE_BYTES)
    assert referee.compiled().model.narena == _HUGE_BYTES
    for _ in range(3):
        engine.step(0.004)
        referee.step(0.004)
        assert engine.stats() == referee.stats()
        assert engine.contacts() == referee.contacts()
        assert np.array_equal(engine.poses()[1], referee.poses()[1])
    assert engine.stats().contacts > 500
    assert engine.notes == referee.notes == ()
    assert _TIGHT_BYTES < engine.compiled().model.narena < _HUGE_BYTES // 8


def test_contacts_that_begin_within_a_long_step_are_not_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    world = _falling(60)
    engine = _engine(world, monkeypatch, 400_000)
    referee = _engine(world, monkeypatch, _HUGE_BYTES)
    fork = engine.fork()
    engine.apply_force(BodyId("box3"), (30.0, 0.0, 0.0))
    referee.apply_force(BodyId("box3"), (30.0, 0.0, 0.0))
    engine.step(0.2)
    referee.step(0.2)
    assert engine.stats().contacts > 100
    assert np.array_equal(engine.poses()[1], referee.poses()[1])
    assert engine.time_s == referee.time_s == pytest.approx(0.2)
    assert fork.time_s == 0.0
    assert fork.compiled().model.narena == 400_000, "a fork grows on its own"


def test_a_ram_moves_a_heap_as_with_a_huge_arena_though_the_memory_grows_in_its_steps(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One call has a part with the motion of the ram, and one without: the steps of both are repeated."""
    falling = _falling(60)
    ram = Body(
        id=BodyId("ram"), iri=Iri("http://example.org/heap.owl#ram"), cls=Iri("http://example.org/heap.owl#Box"),
        pose=Pose((-0.19, 0.15, 0.05)), size=(0.2, 0.6, 0.08), physics=BodyPhysics(mobility=Mobility.KINEMATIC),
    )  # fmt: skip
    world = World(iri=falling.iri, bodies=(*falling.bodies, ram))
    engines, arenas = list[MujocoEngine](), list[int]()
    for first_bytes in (400_000, _HUGE_BYTES):
        engines.append(_engine(world, monkeypatch, first_bytes))
        with monkeypatch.context() as patch:  # from now on the ram is moved, in another model
            patch.setattr(mujoco_compiler, "first_arena_size", lambda *values, size=first_bytes, **names: size)
            engines[-1].apply(SetPoses({BodyId("ram"): Pose((-0.14, 0.15, 0.05))}))
    for cycle in range(4):
        for each in engines:
            each.step(0.12)  # longer than the motion of the ram
            each.apply(SetPoses({BodyId("ram"): Pose((-0.13 + 0.02 * cycle, 0.15, 0.05))}))
        arenas.append(engines[0].compiled().model.narena)
        assert np.array_equal(engines[0].poses()[1], engines[1].poses()[1])
    assert 400_000 < arenas[-1] < engines[1].compiled().model.narena


def test_sleeping_bodies_stay_asleep_when_the_memory_grows(monkeypatch: pytest.MonkeyPatch) -> None:
    resting = World(iri=Iri("http://example.org/heap.owl#map"), bodies=_heap(8, gap_m=1.0).bodies[:2])
    engines = [_engine(resting, monkeypatch, size) for size in (_TIGHT_BYTES // 4, _HUGE_BYTES)]
    for engine in engines:
        engine.step(3.0)
        assert engine.stats().awake == 0
        falling = [
            Body(
                id=BodyId(f"new{each.id}"), iri=each.iri, cls=each.cls, size=each.size, physics=each.physics,
                pose=Pose((each.pose.position[0] + 5.0, each.pose.position[1], each.pose.position[2])),
            )
            for each in _heap(60).bodies
        ]  # fmt: skip
        engine.apply(Spawn(World(iri=resting.iri, bodies=tuple(falling)), settle=False))
    small, large = engines
    with monkeypatch.context() as patch:
        patch.setattr(mujoco_compiler, "first_arena_size", lambda *values, **names: _TIGHT_BYTES)
        small.compiled()
    with monkeypatch.context() as patch:
        patch.setattr(mujoco_compiler, "first_arena_size", lambda *values, **names: _HUGE_BYTES)
        large.compiled()
    for engine in engines:
        engine.step(0.01)
    assert small.stats() == large.stats()
    assert np.array_equal(small.poses()[1], large.poses()[1])


def test_what_exceeds_the_limit_while_time_passes_is_an_error_and_nothing_has_changed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    engine = _engine(_falling(300), monkeypatch, 1_000_000, memory_cap_bytes=1_450_000)
    with pytest.raises(EngineMemoryError, match=r"contacts need 2\.8 MB, more than the 1\.4 MB") as raised:
        engine.step(0.5)
    assert raised.value.cap_mb == pytest.approx(1_450_000 / 2**20)
    time_s, (_, poses) = engine.time_s, engine.poses()
    assert time_s < 0.5
    fork = engine.fork()
    with pytest.raises(EngineMemoryError):
        fork.step(0.5)
    assert fork.time_s == time_s
    assert np.array_equal(fork.poses()[1], poses)
    engine.apply(Delete(tuple([BodyId(f"box{number}") for number in range(2, 300)])))
    engine.step(0.5)
    assert engine.time_s > 0.5


def test_a_spawn_that_cannot_be_simulated_is_refused_with_the_numbers_and_changes_nothing() -> None:
    engine = MujocoEngine(memory_cap_bytes=2**20 + 4 * 50**2)
    engine.apply(Spawn(_heap(30, gap_m=0.2)))
    engine.step(0.01)
    ids, before = engine.poses()
    more = _heap(25, gap_m=0.2)
    renamed = World(
        iri=more.iri,
        bodies=tuple(
            Body(id=BodyId(f"new{each.id}"), iri=each.iri, cls=each.cls, size=each.size, physics=each.physics,
                 pose=Pose((each.pose.position[0] + 9.0, *each.pose.position[1:])))
            for each in more.bodies
        ),
    )  # fmt: skip
    with pytest.raises(EngineMemoryError, match="55 bodies that can move need") as raised:
        engine.apply(Spawn(renamed))
    assert raised.value.needed_mb > raised.value.cap_mb
    assert engine.poses()[0] == ids
    assert np.array_equal(engine.poses()[1], before)
    engine.step(0.01)
    static = tuple(
        Body(id=each.id, iri=each.iri, cls=each.cls, size=each.size, pose=each.pose,
             physics=BodyPhysics(mobility=Mobility.STATIC))
        for each in renamed.bodies
    )  # fmt: skip
    engine.apply(Spawn(World(iri=more.iri, bodies=static)))  # what is fixed needs none of this memory
    assert len(engine.poses()[0]) == 55


def _address_space_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    return pages * 4096 / 2**20


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="the system has no /proc/self/statm")
def test_a_thousand_loose_bodies_need_little_address_space_and_forks_too() -> None:
    """MuJoCo's default for them would be an arena of 450 MB, and as much again for each fork."""
    engine = MujocoEngine()
    engine.apply(Spawn(_heap(1000, gap_m=0.2), settle=False))
    before = _address_space_mb()
    engine.step(0.002)
    forks = [engine.fork() for _ in range(3)]
    for fork in forks:
        fork.step(0.002)
    assert _address_space_mb() - before < 450.0


def test_a_pickled_model_continues_with_a_growing_arena(monkeypatch: pytest.MonkeyPatch) -> None:
    engine = _engine(_falling(60), monkeypatch, 400_000)
    engine.step(0.01)
    copy = pickle.loads(pickle.dumps(engine.compiled()))
    copy.step(95)
    engine.step(0.19)
    assert engine.stats().contacts == copy.data.ncon > 100
    assert np.array_equal(engine.compiled().data.qpos, copy.data.qpos)
