"""The engine thread: order, withdrawal of calls, late ends, and ticks that are delayed by edits."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from queue import SimpleQueue

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mindstage.engines.base import RebuildTime
from mindstage.errors import SimulationThreadError, SimulationTimeoutError
from mindstage.simulation.engine_thread import EngineThread, TickDelay

TIMEOUT_S = 20.0
SHORT_S = 0.2


class Blocked:
    """An engine thread whose first call blocks until the test allows it to end."""

    def __init__(self) -> None:
        self.late: SimpleQueue[tuple[str, BaseException | None]] = SimpleQueue()
        self.rebuild: RebuildTime | None = None
        self.thread = EngineThread(
            lambda: None,
            on_late_end=lambda label, error: self.late.put((label, error)),
            last_rebuild=lambda: self.rebuild,
        )
        self.begun, self.may_end = threading.Event(), threading.Event()
        self.pool = ThreadPoolExecutor(8)

    def block(self, *, timeout_s: float = TIMEOUT_S, error: Exception | None = None) -> None:
        """The blocking call."""

        def wait() -> None:
            self.begun.set()
            assert self.may_end.wait(TIMEOUT_S)
            if error is not None:
                raise error

        self.thread.run(wait, label="block", timeout_s=timeout_s)

    def close(self) -> None:
        self.may_end.set()
        self.pool.shutdown()
        self.thread.stop()


@pytest.fixture
def blocked() -> Iterator[Blocked]:
    blocked = Blocked()
    yield blocked
    blocked.close()


def test_a_call_that_has_not_begun_is_withdrawn(blocked: Blocked) -> None:
    first = blocked.pool.submit(blocked.block)
    assert blocked.begun.wait(TIMEOUT_S)
    ran: list[str] = []
    with pytest.raises(SimulationTimeoutError) as raised:
        blocked.thread.run(lambda: ran.append("late"), label="queued", timeout_s=SHORT_S)
    assert not raised.value.begun
    assert "queued did not finish within 0.2 s; the simulation" in str(raised.value)
    blocked.may_end.set()
    first.result(TIMEOUT_S)
    blocked.thread.run(lambda: None, label="after", timeout_s=TIMEOUT_S)
    assert ran == []
    assert blocked.late.empty()


@pytest.mark.parametrize("error", [None, ValueError("it broke")], ids=str)
def test_the_end_of_a_call_that_has_begun_is_reported(blocked: Blocked, error: Exception | None) -> None:
    with pytest.raises(SimulationTimeoutError, match="it has begun: it is not interrupted") as raised:
        blocked.block(timeout_s=SHORT_S, error=error)
    assert raised.value.begun
    assert blocked.late.empty()
    blocked.may_end.set()
    assert blocked.late.get(timeout=TIMEOUT_S) == ("block", error)


def test_a_call_waits_while_the_queue_moves(blocked: Blocked) -> None:
    """Each call ends before the timeout of the next one, but together they take longer than it."""
    gates = [threading.Event() for _ in range(3)]
    closed = iter(gates)  # the calls may be queued in any order
    calls = [
        blocked.pool.submit(blocked.thread.run, lambda: next(closed).wait(TIMEOUT_S), label="x", timeout_s=TIMEOUT_S)
        for _ in gates
    ]
    last = blocked.pool.submit(blocked.thread.run, lambda: "done", label="last", timeout_s=2.0)
    for gate in gates:
        threading.Event().wait(0.8)
        gate.set()
    for call in calls:
        assert call.result(TIMEOUT_S)
    assert last.result(TIMEOUT_S) == "done"


def test_no_call_times_out_during_a_rebuild(blocked: Blocked) -> None:
    begun, may_end = threading.Event(), threading.Event()

    def rebuild() -> str:
        blocked.rebuild = RebuildTime(began_s=time.monotonic())
        begun.set()
        assert may_end.wait(TIMEOUT_S)
        blocked.rebuild = RebuildTime(began_s=blocked.rebuild.began_s, ended_s=time.monotonic())
        return "rebuilt"

    first = blocked.pool.submit(blocked.thread.run, rebuild, label="rebuild", timeout_s=SHORT_S)
    assert begun.wait(TIMEOUT_S)
    second = blocked.pool.submit(blocked.thread.run, lambda: "done", label="waits", timeout_s=SHORT_S)
    threading.Event().wait(3 * SHORT_S)
    assert not first.done()
    assert not second.done()
    may_end.set()
    assert (first.result(TIMEOUT_S), second.result(TIMEOUT_S)) == ("rebuilt", "done")
    with pytest.raises(SimulationTimeoutError):  # after it, timeouts are as before
        blocked.block(timeout_s=SHORT_S)


def test_a_timeout_error_of_the_function_itself_reaches_the_caller(blocked: Blocked) -> None:
    def fail() -> None:
        raise TimeoutError("of the function")

    with pytest.raises(TimeoutError, match="of the function"):
        blocked.thread.run(fail, label="fail", timeout_s=TIMEOUT_S)


def test_a_stopped_thread_refuses_calls(blocked: Blocked) -> None:
    blocked.thread.stop()
    with pytest.raises(SimulationThreadError, match="late was not executed"):
        blocked.thread.run(lambda: None, label="late", timeout_s=TIMEOUT_S)


def test_calls_that_wait_when_the_thread_is_stopped_are_not_left_waiting(blocked: Blocked) -> None:
    first = blocked.pool.submit(blocked.block)
    assert blocked.begun.wait(TIMEOUT_S)
    blocked.thread.stop(timeout_s=0.0)
    with pytest.raises(SimulationThreadError):
        blocked.thread.run(lambda: None, label="waits", timeout_s=TIMEOUT_S)
    blocked.may_end.set()
    first.result(TIMEOUT_S)


@pytest.mark.parametrize("error", [ValueError("wrong"), SystemExit(), KeyboardInterrupt()], ids=repr)
def test_a_tick_that_raises_is_reported_and_calls_go_on(error: BaseException) -> None:
    reported: SimpleQueue[BaseException] = SimpleQueue()
    is_due = threading.Event()

    def tick() -> float:
        if is_due.is_set():
            is_due.clear()
            raise error
        return 0.01

    thread = EngineThread(tick, on_fault=reported.put)
    is_due.set()
    thread.run(lambda: None, label="first", timeout_s=TIMEOUT_S)
    assert reported.get(timeout=TIMEOUT_S) is error
    assert thread.run(lambda: "done", label="after", timeout_s=TIMEOUT_S) == "done"
    thread.stop()


def test_a_thread_that_ends_although_it_should_not_is_noticed_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The report of an error raises itself."""
    monkeypatch.setattr(threading, "excepthook", lambda _: None)

    def fail(error: BaseException | None = None) -> float:
        raise SystemExit

    thread = EngineThread(fail, on_fault=fail)
    start_s = time.monotonic()

    def call_repeatedly() -> None:
        for _ in range(1000):
            thread.run(lambda: None, label="call", timeout_s=TIMEOUT_S)
            time.sleep(0.005)

    with pytest.raises(SimulationThreadError):
        call_repeatedly()
    assert time.monotonic() - start_s < TIMEOUT_S / 2


def test_calls_and_ticks_take_turns_when_both_are_always_due() -> None:
    ticks, calls = SimpleQueue[int](), SimpleQueue[int]()

    def tick() -> float:
        time.sleep(0.01)
        ticks.put(1)
        return 0.0

    thread = EngineThread(tick)

    def call() -> None:
        for _ in range(20):
            thread.run(lambda: calls.put(1), label="call", timeout_s=TIMEOUT_S)

    callers = [threading.Thread(target=call) for _ in range(4)]
    for each in callers:
        each.start()
    for each in callers:
        each.join(TIMEOUT_S)
    assert calls.qsize() == 80
    assert not ticks.empty()
    thread.stop()


def test_a_thread_without_callbacks_withdraws_a_call_that_waits_for_too_long() -> None:
    thread, may_end = EngineThread(lambda: None), threading.Event()
    blocking = threading.Thread(target=lambda: thread.run(may_end.wait, label="block", timeout_s=TIMEOUT_S))
    blocking.start()
    with pytest.raises(SimulationTimeoutError):
        thread.run(lambda: None, label="call", timeout_s=SHORT_S)
    may_end.set()
    blocking.join(TIMEOUT_S)
    thread.stop()


class Clock:
    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def test_edits_in_a_row_delay_the_ticks_until_they_pause() -> None:
    clock = Clock()
    hold = TickDelay(now=clock)
    assert hold.remaining_s() == 0.0
    for _ in range(10):
        hold.add_edit()
        clock.now_s += 0.02
        assert hold.remaining_s() == pytest.approx(0.01)
    clock.now_s += 0.02
    assert hold.remaining_s() == 0.0


def test_an_edit_that_is_prepared_extends_a_delay_but_starts_none() -> None:
    clock = Clock()
    hold = TickDelay(now=clock)
    with hold.preparing():
        assert hold.remaining_s() == 0.0
        hold.add_edit()
        clock.now_s += 1.0
        assert hold.remaining_s() == pytest.approx(0.03)
        clock.now_s += 5.0
        assert hold.remaining_s() == 0.0
    hold.add_edit()
    clock.now_s += 0.02
    with hold.rebuilding():
        assert hold.remaining_s() == 0.0


def test_edits_without_a_pause_delay_the_ticks_for_a_limited_time() -> None:
    clock = Clock()
    hold = TickDelay(now=clock)
    start_s = clock.now_s
    while True:
        hold.add_edit()
        if hold.remaining_s() == 0.0:
            break
        clock.now_s += 0.02
    assert clock.now_s - start_s == pytest.approx(5.0, abs=0.03)


@given(st.floats(0.0, 100.0))
def test_the_delay_grows_with_the_time_of_a_rebuild(rebuild_s: float) -> None:
    clock = Clock()
    hold = TickDelay(now=clock)
    hold.add_edit()
    with hold.rebuilding():
        assert hold.remaining_s() == 0.0
        clock.now_s += rebuild_s
    hold.add_edit()
    assert hold.remaining_s() == pytest.approx(min(max(0.03, 0.25 * rebuild_s), 0.5))


def test_a_tick_without_edits_is_no_rebuild() -> None:
    clock = Clock()
    hold = TickDelay(now=clock)
    with hold.rebuilding():
        clock.now_s += 2.0
    hold.add_edit()
    assert hold.remaining_s() == pytest.approx(0.03)
