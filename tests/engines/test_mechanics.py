"""MujocoEngine agrees with mechanics on paper."""

from __future__ import annotations

import math
import pickle
from contextlib import closing

import numpy as np
import pytest

import mindstage as ms
from mindstage.engines import SpawnNoteKind
from mindstage.engines.mujoco import MujocoEngine
from mindstage.scene import BodyId, Pose
from mindstage.scene.edits import SetPoses
from mindstage.scene.transforms import quat_angle
from tests.engines.contract import current_pose
from tests.engines.mechanics_contract import MechanicsContract, relative, spawn
from tests.engines.scenes import FLOOR, body, revolute_joint


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


THINGS = [
    pytest.param((0.015, 0.015, 0.015), 0.003, id="a cube of 3 g"),
    pytest.param((0.002, 0.1, 0.2), 0.08, id="a blade of 2 mm"),
    pytest.param((0.1, 0.1, 0.1), 0.5, id="a box"),
]


@pytest.mark.parametrize(("size", "mass_kg"), THINGS)
@pytest.mark.parametrize("speed", [1.0, 2.0, 4.5])
def test_a_fast_kinematic_plate_passes_through_nothing(
    size: tuple[float, float, float], mass_kg: float, speed: float
) -> None:
    """What is in the way of a plate of 5 mm is before it from then on; an elastic hit gives it twice the speed."""
    with closing(MujocoEngine()) as engine:
        plate = body("plate", (-0.5, 0, 0.151), (0.005, 0.3, 0.3), "kinematic")
        spawn(engine, FLOOR, plate, body("thing", (0, 0, size[2] / 2), size, "dynamic", mass_kg))
        engine.step(0.5)
        x, now, cycle_s, fastest, before_m = -0.5, 0.0, 0.02, 0.0, 0.0
        while x < 1.0:
            now = min(speed, now + min(20.0, 10 * speed) * cycle_s)
            x += now * cycle_s
            engine.apply(SetPoses({BodyId("plate"): Pose((x, 0.0, 0.151))}))
            engine.step(cycle_s)
            thing_m = float(current_pose(engine, "thing")[0])
            fastest, before_m = max(fastest, (thing_m - before_m) / cycle_s), thing_m
            assert current_pose(engine, "plate")[0] == pytest.approx(x, abs=1e-12)
        assert thing_m > x
        assert fastest < 2.5 * speed


@pytest.mark.parametrize(("size", "mass_kg"), THINGS)
@pytest.mark.parametrize("push_n", [60.0, 180.0, 480.0])
def test_a_fast_door_passes_through_nothing(size: tuple[float, float, float], mass_kg: float, push_n: float) -> None:
    """A door of 2 cm that swings at up to 14 rad/s: what it hits does not get to its other side through it."""
    with closing(MujocoEngine()) as engine:
        spawn(
            engine, FLOOR, body("post", (0, -0.35, 0.5), (0.04, 0.04, 1.0)),
            body("door", (0, 0, 0.5), (0.02, 0.6, 0.9), "dynamic", 8.0),
            revolute_joint("axle", "post", "door", (0, -0.32, 0.5), limit=3.0),
            body("block", (-0.35, 0.02, 0.025), (0.05, 0.1, 0.05)),
            body("thing", (-0.35, 0.02, 0.05 + size[2] / 2), size, "dynamic", mass_kg),
        )  # fmt: skip
        engine.step(0.3)
        while (angle := quat_angle(current_pose(engine, "door")[3:], np.array([1.0, 0.0, 0.0, 0.0]))) < 0.5:
            x, y, z = current_pose(engine, "door")[:3].tolist()
            force = (-push_n * math.cos(float(angle)), -push_n * math.sin(float(angle)), 0.0)
            engine.apply_force(BodyId("door"), force, (x, y, z))
            engine.step(0.004)
        side = [relative(engine, "thing", "door")]
        for _ in range(200):
            engine.step(0.01)
            side.append(relative(engine, "thing", "door"))
            crossed = side[-2][0] < 0.0 < side[-1][0] and abs(side[-1][1]) < 0.3 and abs(side[-1][2]) < 0.45
            assert not crossed


def test_what_a_fast_plate_hits_flies_the_same_however_its_steps_are_divided_copied_and_pickled() -> None:
    poses = []
    for parts in (1, 10):
        with closing(MujocoEngine()) as engine:
            thing = body("thing", (0, 0, 0.1), (0.002, 0.1, 0.2), "dynamic", 0.08)
            spawn(engine, FLOOR, body("plate", (-0.2, 0, 0.151), (0.005, 0.3, 0.3), "kinematic"), thing)
            engine.step(0.1)
            for cycle in range(1, 12):
                engine.apply(SetPoses({BodyId("plate"): Pose((-0.2 + 0.04 * cycle, 0.0, 0.151))}))
                for _ in range(parts):
                    engine.step(0.02 / parts)
                if parts > 1 and cycle % 2:
                    engine.restore_state(pickle.loads(pickle.dumps(engine.fork().save_state())))
            engine.step(0.2)
            poses.append(engine.poses()[1])
    np.testing.assert_array_equal(*poses)
