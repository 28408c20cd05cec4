"""Pauses and edits are executed soon, whatever else the simulation does, and numbers beyond the limits are refused."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import accumulate, pairwise

import pytest

from mindstage.engines import NullEngine
from mindstage.engines.base import Engine
from mindstage.engines.mujoco import MujocoEngine
from mindstage.errors import InvalidArgumentError, SimulationError, SimulationTimeoutError
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import BodyId, BodyPhysics, Mobility
from mindstage.scene.edits import SetLabel, SetPhysics, Spawn
from mindstage.simulation import Simulation
from tests.kitchenette import kitchenette
from tests.simulation.slow_engines import RebuildingNullEngine, SlowEngine, SlowInterruptibleEngine

SOON_S = 2.0
"""Far more than the aim of 0.2 s, since tests run beside each other."""
TIMEOUT_S = 20.0
MUG = BodyId("Mug")
INVALID_SPEEDS = [0.0, -1.0, math.nan, math.inf, -math.inf, 1e308, 1000.1]
INVALID_DURATIONS = [-1.0, -1e-300, math.nan, math.inf, 1e308, 3600.5]


def simulation_of(engine: Engine) -> Simulation:
    simulation = Simulation(KnowledgeBase(), engine, primitive_shapes=True, timeout_s=TIMEOUT_S)
    simulation.spawn(kitchenette())
    return simulation


@pytest.fixture(
    params=[MujocoEngine, NullEngine, lambda: SlowEngine(3.0), lambda: SlowInterruptibleEngine(30.0)],
    ids=["MuJoCo", "null", "slow", "slow and interruptible"],
)
def sim(request: pytest.FixtureRequest) -> Iterator[Simulation]:
    with simulation_of(request.param()) as sim:
        yield sim


@pytest.fixture
def pool() -> Iterator[ThreadPoolExecutor]:
    with ThreadPoolExecutor(4) as pool:
        yield pool


def wait_until(condition: Callable[[], object]) -> None:
    end_s = time.monotonic() + TIMEOUT_S
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.005)


def took_s(function: Callable[[], object]) -> float:
    start_s = time.monotonic()
    function()
    return time.monotonic() - start_s


@pytest.mark.parametrize("speed", INVALID_SPEEDS)
def test_a_speed_beyond_the_limit_is_refused_with_its_range(speed: float) -> None:
    with simulation_of(MujocoEngine()) as sim:
        with pytest.raises(InvalidArgumentError, match=r"speed.*(from 0 to 1000|above 0)"):
            sim.play(speed=speed)
        assert not sim.state.playing
        sim.play(speed=2.0)
        with pytest.raises(InvalidArgumentError):
            sim.play(speed=speed)
        assert (sim.state.playing, sim.state.speed) == (True, 2.0)


@pytest.mark.parametrize("duration_s", INVALID_DURATIONS)
@pytest.mark.parametrize("threaded", [True, False], ids=["thread", "no thread"])
def test_a_duration_beyond_the_limit_is_refused_and_no_time_passes(duration_s: float, threaded: bool) -> None:
    with Simulation(KnowledgeBase(), NullEngine(), primitive_shapes=True, threaded=threaded) as sim:
        sim.step(0.5)
        with pytest.raises(InvalidArgumentError, match=r"duration_s.*from 0 to 3600 s"):
            sim.step(duration_s)
        assert sim.state.time_s == 0.5


def test_at_the_largest_speed_pauses_and_edits_are_executed_soon(sim: Simulation) -> None:
    for _ in range(5):
        sim.play(speed=1000.0)
        start_s = sim.state.time_s
        wait_until(lambda start_s=start_s: sim.state.time_s > start_s)  # type: ignore[misc]
        assert took_s(lambda: sim.engine.run(lambda engine: engine.apply(SetLabel(MUG, "M")), edits=True)) < SOON_S
        assert took_s(sim.pause) < SOON_S
        assert not sim.state.playing
        sim.engine.ping()  # on a busy machine the last tick may still be running
        paused = sim.state
        time.sleep(0.05)
        assert sim.state.time_s == paused.time_s


def test_other_calls_are_executed_while_a_long_step_runs(pool: ThreadPoolExecutor) -> None:
    """One time step takes so long that the step is divided by wall time and not only by simulated time."""
    with simulation_of(SlowInterruptibleEngine(5.0)) as sim:
        sim.play()
        long = pool.submit(sim.step, 1.0)
        wait_until(lambda: sim.state.time_s > 0.0)
        assert took_s(lambda: sim.engine.run(lambda engine: engine.apply(SetLabel(MUG, "M")), edits=True)) < SOON_S / 2
        assert took_s(sim.pause) < SOON_S / 2
        assert not sim.state.playing
        assert not long.done()
        long.result(TIMEOUT_S)
        assert sim.state.time_s >= 1.0 - 1e-9


def test_a_divided_step_is_as_long_as_one_in_one_piece() -> None:
    with simulation_of(SlowInterruptibleEngine(2.0)) as sim:
        for duration_s in (0.1, 0.03, 0.2, 0.004):
            before_s = sim.state.time_s
            sim.step(duration_s)
            assert sim.state.time_s == pytest.approx(before_s + duration_s, abs=1e-6)


@pytest.mark.parametrize("wall_s", [0.0, 1e-4, math.inf])
def test_interrupted_steps_of_mujoco_end_in_the_same_state_as_one_step(wall_s: float) -> None:
    engines = [MujocoEngine() for _ in range(2)]
    for engine in engines:
        engine.apply(Spawn(kitchenette()))
        engine.apply_force(MUG, (3.0, 0.0, 2.0))
    engines[0].step(0.3)
    left_s, calls = 0.3, 0
    while left_s > 0.0:
        left_s, calls = engines[1].step_for(left_s, wall_s=wall_s), calls + 1
    assert calls == 1 if wall_s == math.inf else calls > 1
    assert engines[1].time_s == engines[0].time_s == pytest.approx(0.3)
    assert (engines[0].poses()[1] == engines[1].poses()[1]).all()
    assert engines[0].poses()[1][engines[0].poses()[0].index(MUG)][0] != 2.0
    for engine in engines:  # the force has ended with the step
        engine.step(0.1)
    assert (engines[0].poses()[1] == engines[1].poses()[1]).all()


def test_a_pause_does_not_wait_for_a_rebuild_and_nothing_moves_after_it() -> None:
    engine = RebuildingNullEngine(1.5)
    with simulation_of(engine) as sim:
        sim.play(speed=5.0)
        wait_until(lambda: sim.state.time_s > 0.0)
        sim.engine.run(lambda engine: engine.apply(SetPhysics(MUG, BodyPhysics())), edits=True)
        wait_until(lambda: engine.last_rebuild is not None)
        assert took_s(sim.pause) < 1.0
        state = sim.state
        assert not state.playing
        assert (
            took_s(lambda: sim.engine.run(lambda engine: engine.apply(SetLabel(MUG, "M")), edits=True)) < 1.5 + SOON_S
        )
        assert sim.state.time_s == state.time_s


def test_a_pause_while_edits_delay_the_ticks(pool: ThreadPoolExecutor) -> None:
    with simulation_of(MujocoEngine()) as sim:
        sim.play(speed=1000.0)
        ended = threading.Event()

        def edit() -> None:
            while not ended.is_set():
                sim.engine.run(lambda engine: engine.apply(SetPhysics(MUG, BodyPhysics())), edits=True)

        edits = pool.submit(edit)
        try:
            for _ in range(5):
                assert took_s(sim.pause) < SOON_S
                assert not sim.state.playing
                assert took_s(lambda: sim.play(speed=1000.0)) < SOON_S
        finally:
            ended.set()
        edits.result(TIMEOUT_S)


def test_the_state_after_an_edit_has_the_time_that_a_rebuild_is_expected_to_take() -> None:
    with simulation_of(MujocoEngine()) as sim:
        assert sim.state.expected_rebuild_s > 0.0
        sim.step(0.1)
        assert sim.state.expected_rebuild_s == 0.0
        sim.engine.run(lambda engine: engine.apply(SetLabel(MUG, "M")), edits=True)
        assert sim.state.expected_rebuild_s == 0.0
        physics = BodyPhysics(mobility=Mobility.STATIC)
        start_s = time.monotonic()
        sim.engine.run(lambda engine: engine.apply(SetPhysics(MUG, physics)), edits=True)
        few_s = sim.state.expected_rebuild_s
        assert 0.0 < few_s < 10.0
        sim.step(0.1)
        assert sim.state.expected_rebuild_s == 0.0
        assert few_s < 100 * (time.monotonic() - start_s)


def test_the_reports_of_edits_have_the_time_that_a_rebuild_is_expected_to_take() -> None:
    with Simulation(KnowledgeBase(), MujocoEngine(), primitive_shapes=True, timeout_s=TIMEOUT_S) as sim:
        spawned = sim.spawn(kitchenette())
        assert spawned.expected_rebuild_s == sim.state.expected_rebuild_s > 0.0
        placed = sim.place("Mug", on="Fridge")
        assert placed.expected_rebuild_s == sim.state.expected_rebuild_s


def test_the_expected_time_of_a_rebuild_grows_with_the_world() -> None:
    engine = MujocoEngine()
    world = kitchenette()
    engine.apply(Spawn(world))
    engine.step(0.01)
    engine.apply(SetPhysics(MUG, BodyPhysics(mobility=Mobility.STATIC)))
    before_s = engine.expected_rebuild_s
    for number in range(20):
        copies = tuple(
            type(body)(id=BodyId(f"{body.id}{number}"), iri=body.iri, cls=body.cls, pose=body.pose, size=body.size)
            for body in world.bodies
        )
        engine.apply(Spawn(type(world)(iri=world.iri, bodies=copies)))
    assert engine.expected_rebuild_s > 10 * before_s


def test_a_call_that_times_out_says_how_long_the_rebuild_is_expected_to_take() -> None:
    """The timeout ends while a call of another caller runs, not while the model is rebuilt."""
    with simulation_of(RebuildingNullEngine(0.5)) as sim:
        may_end = threading.Event()
        sim.engine.run(lambda engine: engine.apply(SetPhysics(MUG, BodyPhysics())), edits=True)
        blocked = threading.Thread(target=lambda: sim.engine.run(lambda _: may_end.wait(TIMEOUT_S), label="long call"))
        blocked.start()
        try:
            with pytest.raises(SimulationTimeoutError) as raised:
                sim.engine.run(lambda _: None, label="short call", timeout_s=0.2)
        finally:
            may_end.set()
            blocked.join(TIMEOUT_S)
        assert raised.value.expected_rebuild_s == 0.5
        assert "busy with the call 'long call' (a rebuild of its model takes about 0.5 s)" in str(raised.value)


def test_timeouts_are_extended_by_a_rebuild_only() -> None:
    with simulation_of(RebuildingNullEngine(1.0)) as sim:
        sim.engine.run(lambda engine: engine.apply(SetPhysics(MUG, BodyPhysics())), edits=True)
        start_s = time.monotonic()
        sim.engine.run(lambda engine: engine.step(0.1), label="step", timeout_s=0.2)  # rebuilds for 1 s
        assert time.monotonic() - start_s >= 1.0
        sim.engine.run(lambda engine: engine.apply(SetPhysics(MUG, BodyPhysics())), edits=True)
        may_end = threading.Event()
        start_s = time.monotonic()
        with pytest.raises(SimulationTimeoutError):
            sim.engine.run(lambda _: may_end.wait(TIMEOUT_S), label="no rebuild", timeout_s=0.2)
        assert time.monotonic() - start_s < TIMEOUT_S / 2
        may_end.set()


def test_a_closed_simulation_ends_a_long_step(pool: ThreadPoolExecutor) -> None:
    sim = simulation_of(SlowEngine(1.0))
    long = pool.submit(sim.step, 3000.0)
    wait_until(lambda: sim.state.time_s > 0.0)
    assert took_s(sim.close) < SOON_S
    with pytest.raises(SimulationError):
        long.result(TIMEOUT_S)


class Observer:
    def __init__(self, interval_s: float) -> None:
        self.interval_s = interval_s
        self.times: list[float] = []

    def on_state(self, state, engine, *, edited, rebuild_pending) -> None:  # type: ignore[no-untyped-def]
        self.times.append(state.time_s)

    def on_edit(self, kind, *, client, ids, details) -> None:  # type: ignore[no-untyped-def]
        pass


@pytest.mark.parametrize("interval_s", [0.0, -1.0, math.nan, 1e-12, math.inf])
def test_the_interval_of_an_observer_is_limited(interval_s: float) -> None:
    with simulation_of(NullEngine()) as sim:
        with pytest.raises(InvalidArgumentError, match="observer interval"):
            sim.observers.add(Observer(interval_s))
        observer = Observer(0.05)
        sim.observers.add(observer)
        observer.interval_s = 0.0  # changed later
        sim.step(0.02)
        assert 10 < len(observer.times) < 40


def test_observers_get_states_at_their_interval_while_it_plays_faster_than_it_can() -> None:
    with simulation_of(MujocoEngine()) as sim:
        observer = Observer(0.05)
        sim.observers.add(observer)
        sim.play(speed=1000.0)
        wait_until(lambda: len(observer.times) > 40)
        sim.pause()
        gaps = [after - before for before, after in zip(observer.times, observer.times[1:], strict=False)]
        assert max(gaps) < 0.06


def test_steps_grow_again_by_doubling_after_an_engine_was_slow() -> None:
    class RecordingEngine(SlowEngine):
        def __init__(self) -> None:
            super().__init__(6.0)
            self.parts: list[float] = []

        def step(self, duration_s: float) -> None:
            self.parts.append(duration_s)
            super().step(duration_s)

    engine = RecordingEngine()
    with Simulation(KnowledgeBase(), engine, threaded=False) as sim:
        sim.step(0.2)
        assert min(engine.parts) < 0.05
        engine.wall_s_per_s = 0.0
        engine.parts.clear()
        sim.step(4.0)
    assert sum(engine.parts) == pytest.approx(4.0)
    largest = list(accumulate(engine.parts, max))
    assert all(after <= 2.0 * before * (1.0 + 1e-9) for before, after in pairwise(largest))
    assert largest[-1] > 2.0 * largest[0]
