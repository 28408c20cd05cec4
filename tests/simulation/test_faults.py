"""What controllers, observers, callbacks and engines raise pauses the simulation; it is reported and nothing hangs."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator

import mujoco
import pytest

from mindstage.engines import NullEngine
from mindstage.engines.base import Engine
from mindstage.engines.mujoco import MujocoEngine
from mindstage.errors import (
    InvalidArgumentError,
    SimulationFaultError,
    SimulationThreadError,
    SimulationTimeoutError,
)
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import BodyId
from mindstage.scene.edits import SetLabel
from mindstage.simulation import Simulation
from mindstage.simulation.observation import as_client
from tests.cases import each_case
from tests.kitchenette import kitchenette

TIMEOUT_S = 20.0
MUG = BodyId("Mug")


class Controller:
    """Calls a function at each update."""

    def __init__(self, on_update: Callable[[], object] = lambda: None, period_s: float = 0.01) -> None:
        self.on_update, self.period_s = on_update, period_s
        self.updates = 0

    @property
    def is_active(self) -> bool:
        return True

    def update(self, engine: Engine, time_s: float) -> None:
        self.updates += 1
        self.on_update()

    def copy(self) -> Controller:
        return Controller(self.on_update, self.period_s)

    def reset(self, engine: Engine) -> None:
        pass


class UnprintableError(Exception):
    def __str__(self) -> str:
        raise ValueError("no text")


ERRORS = [
    ValueError("a wrong value"),
    KeyError("arm"),
    SystemExit(3),
    KeyboardInterrupt(),
    MemoryError(),
    GeneratorExit(),
    mujoco.FatalError("out of memory"),
    TimeoutError("of its own"),
    UnprintableError(),
]


def raising(error: BaseException) -> Callable[[], object]:
    def fail() -> object:
        raise error

    return fail


@pytest.fixture
def sim() -> Iterator[Simulation]:
    with Simulation(KnowledgeBase(), MujocoEngine(), primitive_shapes=True, timeout_s=TIMEOUT_S) as sim:
        sim.spawn(kitchenette())
        sim.step(0.01)
        yield sim


def wait_until(condition: Callable[[], object]) -> None:
    end_s = time.monotonic() + TIMEOUT_S
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.005)


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
def test_a_controller_that_raises_pauses_the_simulation_and_is_removed(sim: Simulation, error: BaseException) -> None:
    good, bad = Controller(), Controller(raising(error))
    sim.add_controller("good", good)
    sim.add_controller("bad arm", bad)
    sim.play()
    wait_until(lambda: not sim.state.playing)
    assert "the controller 'bad arm' raised " in sim.state.error
    assert type(error).__name__ in sim.state.error
    with pytest.raises(SimulationFaultError, match=r"'bad arm'.*it was removed") as raised:
        sim.snapshot()
    assert raised.value.__cause__ is error
    assert MUG in {body.id for body in sim.snapshot().bodies}  # once only
    assert sim.state.error
    sim.play()
    updates = good.updates
    wait_until(lambda: good.updates > updates + 5)
    assert (sim.state.playing, sim.state.error, bad.updates) == (True, "", 1)


def test_a_controller_that_raises_in_a_step_raises_there_and_only_there(sim: Simulation) -> None:
    error = ValueError("a wrong value")
    sim.add_controller("arm", Controller(raising(error)))
    with pytest.raises(SimulationFaultError, match="the controller 'arm' raised ValueError: a wrong value") as raised:
        sim.step(0.1)
    assert raised.value.__cause__ is error
    assert "'arm'" in sim.state.error
    before_s = sim.state.time_s
    sim.step(0.1)
    assert sim.state.time_s == pytest.approx(before_s + 0.1)
    sim.reset()
    assert sim.state.error == ""


def test_an_interrupt_of_a_simulation_without_a_thread_reaches_its_caller() -> None:
    with Simulation(KnowledgeBase(), NullEngine(), primitive_shapes=True, threaded=False) as sim:
        controller = Controller(raising(KeyboardInterrupt()))
        sim.add_controller("arm", controller)
        with pytest.raises(KeyboardInterrupt):
            sim.step(0.1)
        controller.on_update = raising(ValueError("wrong"))
        with pytest.raises(SimulationFaultError, match="'arm'"):
            sim.step(0.1)


def test_an_error_is_raised_for_callers_in_python_and_not_for_clients(sim: Simulation) -> None:
    sim.add_controller("arm", Controller(raising(ValueError("wrong"))))
    sim.play()
    wait_until(lambda: not sim.state.playing)
    with as_client("viewer"):
        sim.snapshot()
        assert "'arm'" in sim.state.error
    with pytest.raises(SimulationFaultError):
        sim.play()
    sim.play()
    assert sim.state.playing


def test_the_other_controllers_are_not_updated_again_after_an_error(sim: Simulation) -> None:
    times: list[float] = []
    first = Controller()
    engine = sim.engine.run(lambda engine: engine)
    first.on_update = lambda: times.append(engine.time_s)
    sim.add_controller("first", first)
    sim.add_controller("second", Controller(raising(ValueError("wrong"))))
    with pytest.raises(SimulationFaultError):
        sim.step(0.1)
    sim.step(0.05)
    assert len(times) == len(set(times))


class Observer:
    interval_s = 0.05

    def __init__(self, on_state: Callable[[], object], on_edit: Callable[[], object] = lambda: None) -> None:
        self.state_function, self.edit_function = on_state, on_edit

    def on_state(self, state, engine, *, edited, rebuild_pending) -> None:  # type: ignore[no-untyped-def]
        self.state_function()

    def on_edit(self, kind, *, client, ids, details) -> None:  # type: ignore[no-untyped-def]
        self.edit_function()


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
def test_an_observer_that_raises_is_removed_and_the_others_get_the_state(sim: Simulation, error: BaseException) -> None:
    seen: list[int] = []
    calls: list[int] = []
    is_due = threading.Event()

    def fail() -> None:
        if is_due.is_set():
            calls.append(1)
            raise error

    sim.observers.add(Observer(fail))
    sim.observers.add(Observer(lambda: seen.append(1)))
    sim.play()
    is_due.set()
    wait_until(lambda: not sim.state.playing)
    assert "the observer Observer raised " in sim.state.error
    wait_until(lambda: seen)
    with pytest.raises(SimulationFaultError, match="the observer Observer"):
        sim.step(0.01)
    count = len(seen)
    sim.step(0.2)
    assert (len(calls), len(seen) > count) == (1, True)


def test_an_observer_that_raises_at_an_edit_does_not_fail_the_edit(sim: Simulation) -> None:
    sim.observers.add(Observer(lambda: None, raising(ValueError("wrong"))))
    sim.engine.run(lambda engine: engine.apply(SetLabel(MUG, "My mug")), edits=True)
    with pytest.raises(SimulationFaultError, match="the observer Observer raised ValueError: wrong"):
        sim.snapshot()
    assert next(body.label for body in sim.snapshot().bodies if body.id == MUG) == "My mug"
    sim.engine.run(lambda engine: engine.apply(SetLabel(MUG, "Mug")), edits=True)
    sim.snapshot()


@pytest.mark.parametrize("error", [ValueError("wrong"), SystemExit()], ids=repr)
def test_a_callback_of_edits_that_raises_is_removed(sim: Simulation, error: BaseException) -> None:
    others: list[int] = []
    sim.clients.on_edit(raising(error))
    sim.clients.on_edit(lambda: others.append(1))
    sim.engine.run(lambda engine: engine.apply(SetLabel(MUG, "My mug")), edits=True)
    with pytest.raises(SimulationFaultError, match="a callback of edits"):
        sim.snapshot()
    sim.engine.run(lambda engine: engine.apply(SetLabel(MUG, "Mug")), edits=True)
    sim.snapshot()
    assert others == [1, 1]


def test_a_callback_of_late_ends_that_raises_does_not_end_the_thread(sim: Simulation) -> None:
    ends: list[str] = []
    may_end = threading.Event()

    def fail(label: str, error: BaseException | None) -> None:
        raise SystemExit

    sim.engine.on_late_end(fail)
    sim.engine.on_late_end(lambda label, error: ends.append(label))
    with pytest.raises(SimulationTimeoutError):
        sim.engine.run(lambda _: may_end.wait(TIMEOUT_S), label="late", timeout_s=0.05)
    may_end.set()
    wait_until(lambda: "late ends" in sim.state.error)
    assert ends == ["late"]
    with pytest.raises(SimulationFaultError, match="a callback of late ends"):
        sim.snapshot()
    sim.snapshot()


class FailingEngine(NullEngine):
    name = "failing"
    error: BaseException | None = None

    def step(self, duration_s: float) -> None:
        if self.error is not None:
            raise self.error
        super().step(duration_s)


@each_case("error", ERRORS, ids=lambda error: type(error).__name__)
def test_an_engine_that_raises_pauses_the_simulation(error: BaseException) -> None:
    engine = FailingEngine()
    with Simulation(KnowledgeBase(), engine, primitive_shapes=True, timeout_s=TIMEOUT_S) as sim:
        sim.play()
        wait_until(lambda: sim.state.time_s > 0.0)
        engine.error = error
        wait_until(lambda: not sim.state.playing)
        assert "the engine 'failing' raised " in sim.state.error
        with pytest.raises(SimulationFaultError, match="the engine 'failing'") as raised:
            sim.snapshot()
        assert raised.value.__cause__ is error
        with pytest.raises(SimulationFaultError, match="the engine 'failing'"):
            sim.step(0.1)
        engine.error = None
        before_s = sim.state.time_s
        sim.step(0.1)
        assert sim.state.time_s == pytest.approx(before_s + 0.1)


def test_a_controller_that_does_not_return_is_named_after_the_timeout() -> None:
    may_end = threading.Event()
    with Simulation(KnowledgeBase(), MujocoEngine(), primitive_shapes=True, timeout_s=0.5) as sim:
        sim.spawn(kitchenette(), timeout_s=TIMEOUT_S)
        stuck = Controller(lambda: may_end.wait(TIMEOUT_S))
        sim.add_controller("stuck arm", stuck)
        sim.play()  # with a pending rebuild, which is not what takes so long
        wait_until(lambda: stuck.updates)
        start_s = time.monotonic()
        message = "busy with the controller 'stuck arm', which does not return"
        with pytest.raises(SimulationTimeoutError, match=message) as raised:
            sim.snapshot()
        assert (raised.value.busy_with, raised.value.begun) == (
            "the controller 'stuck arm', which does not return",
            False,
        )
        with pytest.raises(SimulationTimeoutError, match="'stuck arm'"):
            sim.step(0.1)
        sim.pause()
        assert not sim.state.playing
        assert time.monotonic() - start_s < TIMEOUT_S / 2
        may_end.set()
        sim.snapshot()


@pytest.mark.parametrize("period_s", [0.0, -0.01, math.nan, math.inf, 1e-12, 1e308])
def test_the_period_of_a_controller_is_limited(sim: Simulation, period_s: float) -> None:
    with pytest.raises(InvalidArgumentError, match=r"controller period .*from 0.0001 to 3600 s"):
        sim.add_controller("arm", Controller(period_s=period_s))
    controller = Controller()
    controller.on_update = lambda: setattr(controller, "period_s", period_s)
    sim.add_controller("arm", controller)
    with pytest.raises(SimulationFaultError, match=r"the controller 'arm' raised .*controller period"):
        sim.step(0.1)
    sim.step(0.1)
    assert controller.updates == 1


def test_a_controller_that_removes_itself_is_not_waited_for(sim: Simulation) -> None:
    controller, other = Controller(), Controller(period_s=0.02)
    remove = sim.add_controller("once", controller)
    controller.on_update = remove
    sim.add_controller("other", other)
    sim.step(0.2)
    assert (controller.updates, other.updates) == (1, 10)


def test_calls_of_a_thread_that_has_ended_raise_at_once(sim: Simulation) -> None:
    sim._thread.stop()  # as after a fork: the child has no such thread
    start_s = time.monotonic()
    calls: list[Callable[[], object]] = [sim.snapshot, lambda: sim.step(0.1), sim.pause, sim.engine.ping, sim.reset]
    for call in calls:
        with pytest.raises(SimulationThreadError, match="the thread of the simulation has ended"):
            call()
    assert time.monotonic() - start_s < TIMEOUT_S / 4
