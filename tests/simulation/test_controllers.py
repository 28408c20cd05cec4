"""Controllers are updated at their periods of simulated time, and copied and reset with the simulation."""

from __future__ import annotations

import pickle
import time
from collections.abc import Iterator

import pytest

from mindstage.engines.base import Engine
from mindstage.engines.mujoco import MujocoEngine
from mindstage.knowledge import KnowledgeBase
from mindstage.simulation import Simulation
from tests.kitchenette import kitchenette


class Counter:
    """Records the times of its updates."""

    def __init__(self, period_s: float = 0.01, *, is_active: bool = True) -> None:
        self.period_s = period_s
        self.is_active = is_active
        self.times: list[float] = []
        self.resets = 0

    def update(self, engine: Engine, time_s: float) -> None:
        assert engine.time_s == time_s
        self.times.append(time_s)

    def copy(self) -> Counter:
        copied = Counter(self.period_s, is_active=self.is_active)
        copied.times = list(self.times)
        return copied

    def reset(self, engine: Engine) -> None:
        self.times, self.resets = [], self.resets + 1


@pytest.fixture
def sim() -> Iterator[Simulation]:
    with Simulation(KnowledgeBase(), MujocoEngine(), primitive_shapes=True) as sim:
        sim.spawn(kitchenette())
        yield sim


def test_updates_come_at_the_period_whatever_the_steps_are(sim: Simulation) -> None:
    counter = Counter(0.01)
    sim.add_controller("counter", counter)
    start_s = sim.state.time_s
    for step_s in (0.1, 0.004, 0.03, 0.006, 1 / 60, 1 / 60, 1 / 60, 0.03):
        sim.step(step_s)
    expected = [start_s + 0.01 * index for index in range(22)]
    assert counter.times == pytest.approx(expected, abs=0.0021)


def test_two_controllers_keep_their_own_periods(sim: Simulation) -> None:
    fast, slow = Counter(0.01), Counter(0.035)
    sim.add_controller("fast", fast)
    sim.add_controller("slow", slow)
    sim.step(0.35)
    assert (len(fast.times), len(slow.times)) == (35, 10)


def test_an_inactive_controller_is_not_updated_until_it_is_active(sim: Simulation) -> None:
    counter = Counter(is_active=False)
    sim.add_controller("counter", counter)
    sim.step(0.1)
    assert counter.times == []
    counter.is_active = True
    sim.step(0.05)
    assert len(counter.times) == 5


def test_updates_come_while_it_plays(sim: Simulation) -> None:
    counter = Counter()
    sim.add_controller("counter", counter)
    sim.play(speed=5.0)
    deadline = time.monotonic() + 60.0
    while len(counter.times) < 50 and time.monotonic() < deadline:
        time.sleep(0.02)
    sim.pause()
    gaps = [later - earlier for earlier, later in zip(counter.times, counter.times[1:], strict=False)]
    assert len(gaps) >= 49
    assert max(gaps) < 0.0141


def test_a_removed_controller_is_not_updated(sim: Simulation) -> None:
    counter, other = Counter(), Counter()
    remove = sim.add_controller("counter", counter)
    sim.step(0.05)
    remove()
    sim.step(0.05)
    assert len(counter.times) == 5
    sim.add_controller("counter", other)
    remove()  # the one that replaced it stays
    sim.step(0.05)
    assert len(other.times) == 5


def test_a_copy_has_its_own_controllers(sim: Simulation) -> None:
    counter = Counter()
    sim.add_controller("counter", counter)
    sim.step(0.05)
    with sim.fork(threaded=False) as copy:
        copied = copy._controllers.controllers["counter"]
        copy.step(0.1)
        assert len(copied.times) == 15
        sent = pickle.loads(pickle.dumps(copy))
        sent.step(0.1)
        assert len(sent._controllers.controllers["counter"].times) == 25
    assert len(counter.times) == 5


def test_reset_resets_controllers(sim: Simulation) -> None:
    counter = Counter()
    sim.add_controller("counter", counter)
    sim.step(0.05)
    sim.reset()
    assert (counter.times, counter.resets) == ([], 1)
