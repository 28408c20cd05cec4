"""How busy an engine is: told by those that declare it, at any time, and without any work for the engine."""

from __future__ import annotations

import pytest

from mindstage import MujocoEngine, NullEngine, World
from mindstage.engines import Ability, Engine, Statistics
from mindstage.errors import EngineClosed
from mindstage.world import Body, BodyId, Iri, Mobility, Physics, Pose

NOTHING = Statistics(movable=0, awake=0, contacts=0)


def room(height_m: float) -> World:
    """A brick above a floor."""
    floor = Body(
        id=BodyId("floor"), iri=Iri("urn:floor"), cls=Iri("urn:Floor"), pose=Pose((0.0, 0.0, -0.05)),
        size=(4.0, 4.0, 0.1), physics=Physics(mobility=Mobility.STATIC),
    )  # fmt: skip
    brick = Body(
        id=BodyId("brick"), iri=Iri("urn:brick"), cls=Iri("urn:Brick"), pose=Pose((0.0, 0.0, 0.05 + height_m)),
        size=(0.1, 0.1, 0.1), physics=Physics(mobility=Mobility.DYNAMIC, gravity=True, mass_kg=1.0),
    )  # fmt: skip
    return World(iri=Iri("urn:room"), bodies=(floor, brick))


def test_what_falls_is_awake_and_what_lies_touches_and_falls_asleep() -> None:
    engine = MujocoEngine(timestep_s=0.002)
    assert engine.statistics() == Statistics(movable=0, awake=0, contacts=0, timestep_s=0.002)
    engine.spawn(room(0.3))
    engine.step(0.1)
    falling = engine.statistics()
    assert (falling.movable, falling.awake, falling.contacts) == (1, 1, 0)
    touching = []
    for _ in range(50):
        engine.step(0.01)
        touching.append(engine.statistics())
    assert max(now.contacts for now in touching if now.awake) >= 3
    engine.step(5.0)
    resting = engine.statistics()
    assert (resting.movable, resting.awake, resting.contacts) == (1, 0, 0)


def test_an_edit_is_not_carried_out_because_somebody_looks() -> None:
    engine = MujocoEngine()
    engine.spawn(room(0.0))
    engine.step(0.1)
    before = engine.statistics()
    engine.delete([BodyId("brick")])
    assert engine.statistics() == before
    engine.step(0.1)
    assert engine.statistics().movable == 0


def test_where_nothing_ever_moves_nothing_is_awake() -> None:
    engine = NullEngine()
    engine.spawn(room(1.0))
    assert engine.statistics() == NOTHING


@pytest.mark.parametrize("engine", [NullEngine(), MujocoEngine()], ids=lambda engine: engine.name)
def test_a_closed_engine_says_nothing(engine: Engine) -> None:
    assert Ability.STATISTICS in engine.abilities
    engine.close()
    with pytest.raises(EngineClosed):
        engine.statistics()
