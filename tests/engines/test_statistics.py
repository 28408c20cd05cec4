"""Statistics of engines: available at any time, without work for the engine."""

from __future__ import annotations

import pytest

from mindstage import MujocoEngine, NullEngine, World
from mindstage.engines import Capability, Engine, EngineStats
from mindstage.errors import EngineClosedError
from mindstage.scene import Body, BodyId, BodyPhysics, Iri, Mobility, Pose
from mindstage.scene.edits import Delete, Spawn

NOTHING = EngineStats(movable=0, awake=0, contacts=0)


def room(height_m: float) -> World:
    """A brick above a floor."""
    floor = Body(
        id=BodyId("floor"), iri=Iri("urn:floor"), cls=Iri("urn:Floor"), pose=Pose((0.0, 0.0, -0.05)),
        size=(4.0, 4.0, 0.1), physics=BodyPhysics(mobility=Mobility.STATIC),
    )  # fmt: skip
    brick = Body(
        id=BodyId("brick"), iri=Iri("urn:brick"), cls=Iri("urn:Brick"), pose=Pose((0.0, 0.0, 0.05 + height_m)),
        size=(0.1, 0.1, 0.1), physics=BodyPhysics(mobility=Mobility.DYNAMIC, gravity=True, mass_kg=1.0),
    )  # fmt: skip
    return World(iri=Iri("urn:room"), bodies=(floor, brick))


def test_a_falling_body_is_awake_and_a_resting_one_has_contacts_and_falls_asleep() -> None:
    engine = MujocoEngine(timestep_s=0.002)
    assert engine.stats() == EngineStats(movable=0, awake=0, contacts=0, timestep_s=0.002)
    engine.apply(Spawn(room(0.3)))
    engine.step(0.1)
    falling = engine.stats()
    assert (falling.movable, falling.awake, falling.contacts) == (1, 1, 0)
    touching = []
    for _ in range(50):
        engine.step(0.01)
        touching.append(engine.stats())
    assert max(now.contacts for now in touching if now.awake) >= 3
    engine.step(5.0)
    resting = engine.stats()
    assert (resting.movable, resting.awake, resting.contacts) == (1, 0, 0)


def test_reading_statistics_does_not_compile_pending_edits() -> None:
    engine = MujocoEngine()
    engine.apply(Spawn(room(0.0)))
    engine.step(0.1)
    assert engine.stats().movable == 1
    engine.apply(Delete((BodyId("brick"),)))
    assert engine.stats().movable == 0
    assert engine.rebuild_pending


def test_a_static_world_has_nothing_awake() -> None:
    engine = NullEngine()
    engine.apply(Spawn(room(1.0)))
    assert engine.stats() == NOTHING


@pytest.mark.parametrize("engine", [NullEngine(), MujocoEngine()], ids=lambda engine: engine.name)
def test_a_closed_engine_has_no_statistics(engine: Engine) -> None:
    assert Capability.STATISTICS in engine.capabilities
    engine.close()
    with pytest.raises(EngineClosedError):
        engine.stats()


def test_the_repr_of_a_report_counts_failures() -> None:
    engine = NullEngine()
    assert "nothing failed" in repr(engine.apply(Spawn(room(1.0))).report)
    assert "2 failed" in repr(engine.apply(Spawn(room(1.0))).report), "the ids are taken"
