"""RemoteEngine fulfills the contract with another Mindstage's MuJoCo, over a real socket."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing

import pytest

from mindstage.engines import SpawnNoteKind
from mindstage.engines.remote import RemoteEngine, connect
from mindstage.scene import BodyId
from mindstage.scene.edits import Spawn
from tests.engines.actuator_contract import ActuatorContract
from tests.engines.contract import PhysicsContract, current_pose, notes_of
from tests.engines.geometry_contract import GeometryContract
from tests.engines.remote.served_simulation import ServedSimulation
from tests.engines.scenes import FLOOR, body, world


class TestRemoteEngine(PhysicsContract, ActuatorContract, GeometryContract):
    @pytest.fixture
    def engine(self) -> Iterator[RemoteEngine]:
        with ServedSimulation() as served, closing(connect(served.address)) as engine:
            yield engine

    def test_an_immovable_body_stays_and_keeps_its_described_mobility(self, engine: RemoteEngine) -> None:
        """Unlike in the contract, the simulation at the other end decides by its own ontology; the report states it."""
        wall = body("wall", (0, 0, 1.5), (0.2, 4, 3), "dynamic", 500.0)
        report = engine.apply(Spawn(world(wall), immovable=frozenset({BodyId("wall")}))).report
        assert notes_of(report, SpawnNoteKind.UNSTATED) == [("wall",)]

    def test_excluded_pairs_do_not_collide(self, engine: RemoteEngine) -> None:
        """Unlike in the contract, they are not sent, which the report states."""
        pair = (BodyId("box"), BodyId("floor"))
        box = body("box", (0, 0, 0.1), (0.2, 0.2, 0.2), "dynamic", 1.0)
        report = engine.apply(Spawn(world(FLOOR, box), excluded_pairs=frozenset({pair}))).report
        assert notes_of(report, SpawnNoteKind.UNSTATED) == [("box", "floor")]

    def test_a_body_that_falls_out_of_the_place_is_stopped_and_reported_once(self, engine: RemoteEngine) -> None:
        """Unlike in the contract, the simulation at the other end has a ground, whatever the options are."""
        engine.apply(Spawn(world(FLOOR, body("box", (30, 0, 0.5), (0.2, 0.2, 0.2), "dynamic", 1.0))))
        engine.step(2.0)
        # The ground is at the bottom of the floor, 0.1 m below its top, and the box is 0.2 m high.
        assert current_pose(engine, "box")[2] == pytest.approx(0.0, abs=self.rest_tolerance_m)
