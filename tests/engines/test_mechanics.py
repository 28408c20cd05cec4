"""MujocoEngine agrees with mechanics on paper."""

from __future__ import annotations

import numpy as np
import pytest

import mindstage as ms
from mindstage.engines import SpawnNoteKind
from mindstage.engines.mujoco import MujocoEngine
from mindstage.scene import BodyId, Pose
from mindstage.scene.edits import SetPoses
from tests.engines.contract import current_pose
from tests.engines.mechanics_contract import MechanicsContract, spawn
from tests.engines.scenes import FLOOR, body


class TestMujocoMechanics(MechanicsContract):
    turned_tolerance_m = 0.008
    """The velocity of a contact's constraint follows from J q' without the derivative of J: on what turns at w, a body
    creeps outwards by w² r times half of the time constant of contacts, 10 ms."""

    @pytest.fixture
    def engine(self) -> MujocoEngine:
        return MujocoEngine()

    def test_the_tray_moves_the_same_however_its_steps_are_divided_forked_and_restored(
        self, engine: MujocoEngine
    ) -> None:
        tray = body("tray", (0, 0, 0.5), (0.4, 0.4, 0.02), "kinematic")
        cup = body("cup", (0.05, 0, 0.56), (0.1, 0.1, 0.1), "dynamic", 0.3)
        spawn(engine, FLOOR, tray, cup)
        engine.step(0.5)
        engine.apply(SetPoses({BodyId("tray"): Pose((0.0, 0.0, 0.5))}))
        start = engine.save_state()
        results = []
        for parts in ((10,), (1,) * 10, (3, 3, 4)):
            engine.restore_state(start)
            running = engine
            for cycle in range(1, 31):
                running.apply(SetPoses({BodyId("tray"): Pose((0.002 * cycle, 0.0001 * cycle**2, 0.5))}))
                for number, part in enumerate(parts):
                    running.step(0.002 * part)
                    if number == 1:
                        state, running = running.save_state(), running.fork()
                        running.restore_state(state)
                assert current_pose(running, "tray").tolist() == [0.002 * cycle, 0.0001 * cycle**2, 0.5, 1, 0, 0, 0]
            running.step(1.0)
            results.append(running.poses()[1])
        assert np.array_equal(results[0], results[1])
        assert np.array_equal(results[0], results[2])

    @pytest.mark.parametrize(("drop_m", "is_reported"), [(1.0, False), (30.0, True)])
    def test_what_may_pass_through_a_plate_is_reported(
        self, engine: MujocoEngine, drop_m: float, is_reported: bool
    ) -> None:
        plate = body("plate", (0, 0, 0.999), (0.8, 0.4, 0.002))
        blade = body("blade", (0, 0, 1.001 + drop_m), (0.2, 0.02, 0.002), "dynamic", 0.08)
        spawn(engine, FLOOR, plate, blade)
        engine.step(4.0)
        reported = [note.ids for note in engine.notes if note.kind is SpawnNoteKind.FAST]
        assert reported == [("blade",)] * is_reported


def test_the_bundled_kitchen_falls_asleep_and_is_the_same_each_time() -> None:
    results = []
    for _ in range(2):
        with ms.open("bundled:kitchen") as sim:
            sim.step(3.0)
            stats = sim.engine.run(lambda engine: engine.stats())
            assert stats.awake == 0, stats
            assert stats.movable > 150
            results.append(sim.state.poses)
    assert np.array_equal(results[0], results[1])
