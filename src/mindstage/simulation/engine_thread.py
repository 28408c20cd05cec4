"""The thread that owns an engine, and the clock that paces it in real time.

Calls from any thread are queued and executed between two ticks, so that an engine is used by one thread only. Each call
has a timeout, which is extended while other calls end and while the engine rebuilds its model. A call that has not
begun by then is withdrawn and never executed; one that has begun is not interrupted, and its end is reported. Nothing
that a tick or a call raises ends the thread; if it has ended all the same, calls raise at once.

`TickDelay` delays the ticks while edits follow one another.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager
from functools import partial
from queue import Empty, SimpleQueue
from typing import Any, Generic, TypeVar

from mindstage.access.limits import Timeout
from mindstage.engines.base import Capability, Engine, RebuildTime, SpawnNote
from mindstage.errors import EngineError, SimulationThreadError, SimulationTimeoutError
from mindstage.ranges import checked
from mindstage.simulation.controllers import fault_error

__all__ = ["DirectCalls", "EngineAccess", "EngineThread", "LateEndCallbacks", "RealTimeClock", "TickDelay"]


_MAX_LAG_S = 0.25
"""Upper bound of the simulated time that is made up for after a stall, per unit of speed [s]."""


class RealTimeClock:
    """Converts wall time to simulated time, at a multiple of real time."""

    def __init__(self, speed: float = 1.0) -> None:
        self.speed = speed
        self._last = time.monotonic()
        self._due_s = 0.0
        self._wall_s = 0.0
        self._simulated_s = 0.0

    def due_s(self) -> float:
        """Simulated time that is due now [s]."""
        now = time.monotonic()
        self._wall_s += now - self._last
        self._due_s = min(self._due_s + (now - self._last) * self.speed, _MAX_LAG_S * max(1.0, self.speed))
        self._last = now
        return self._due_s

    def advance(self, simulated_s: float) -> None:
        """Subtracts simulated time that was stepped [s] from the time that is due."""
        self._due_s -= simulated_s
        self._simulated_s += simulated_s
        if self._wall_s > 2.0:  # a moving average over the last seconds
            self._wall_s, self._simulated_s = self._wall_s / 2, self._simulated_s / 2

    @property
    def real_time_factor(self) -> float:
        """Simulated time per wall time, averaged over the last seconds."""
        return self._simulated_s / self._wall_s if self._wall_s > 0.0 else 0.0


_MIN_QUIET_S = 0.03
"""Time without an edit after which ticks go on [s]; longer than a client takes from a response to its next call."""
_QUIET_FRACTION = 0.25
"""The same as a fraction of the time that the last rebuild took: the more a rebuild costs, the longer it can wait."""
_MAX_QUIET_S = 0.5
_MAX_HOLD_S = 5.0
"""Longest delay of a tick by edits [s]; as long as the rebuild of a model of more than a thousand loose bodies."""


_MAX_REBUILD_S = 300.0
"""Longest time of a rebuild, by which the timeouts of waiting calls are extended [s]."""
_MAX_WAIT_S = 3600.0
"""Longest time between two ticks while a time is due [s]."""
_MAX_TURN_S = 0.1
"""Longest time for which waiting calls are executed between two ticks that follow at once [s]."""


class TickDelay:
    """Delays ticks while edits follow one another, so that an engine rebuilds its model once for all of them."""

    def __init__(self, *, now: Callable[[], float] = time.monotonic) -> None:
        """Creates a hold without edits.

        Args:
            now: a monotonic clock [s].
        """
        self._now = now
        self._first: float | None = None
        self._last = 0.0
        self._quiet_s = _MIN_QUIET_S
        self._prepared = 0
        self._lock = threading.Lock()

    def add_edit(self) -> None:
        """Starts or extends the delay: an edit was made that the model does not have yet."""
        self._last = self._now()
        if self._first is None:
            self._first = self._last

    def remaining_s(self) -> float:
        """Time for which the next tick is to be delayed [s]; 0 if it is not."""
        if self._first is None:
            return 0.0
        now = self._now()
        last = now if self._prepared else self._last
        return max(0.0, min(last + self._quiet_s, self._first + _MAX_HOLD_S) - now)

    @contextmanager
    def preparing(self) -> Iterator[None]:
        """In the context another edit is prepared, in any thread: a delay that has started is extended."""
        with self._lock:
            self._prepared += 1
        try:
            yield
        finally:
            with self._lock:
                self._prepared -= 1

    @contextmanager
    def rebuilding(self) -> Iterator[None]:
        """Ends the delay; if there were edits, the context is a rebuild, whose time is measured."""
        had_edits, self._first = self._first is not None, None
        start = self._now()
        yield
        if had_edits:
            self._quiet_s = min(max(_MIN_QUIET_S, _QUIET_FRACTION * (self._now() - start)), _MAX_QUIET_S)


T = TypeVar("T")


class LateEndCallbacks:
    """Callbacks for the ends of calls that were reported as begun, but not ended in time."""

    def __init__(self) -> None:
        self._callbacks: tuple[Callable[[str, BaseException | None], None], ...] = ()

    def add(self, callback: Callable[[str, BaseException | None], None]) -> Callable[[], None]:
        """Adds a callback, and returns a function that removes it."""
        self._callbacks = (*self._callbacks, callback)

        def remove() -> None:
            self._callbacks = tuple(each for each in self._callbacks if each is not callback)

        return remove

    def notify(self, label: str, error: BaseException | None) -> None:
        """Calls all with the label of a call, and its error or None; one that raises an exception is removed.

        Raises:
            SimulationFaultError: one raised; all were called.
        """
        raised: BaseException | None = None
        for callback in self._callbacks:
            try:
                callback(label, error)
            except BaseException as failure:
                raised = failure
                self._callbacks = tuple(each for each in self._callbacks if each is not callback)
        if raised is not None:
            raise fault_error("a callback of late ends", raised, remedy="it was removed") from raised


class EngineAccess:
    """The engine of a simulation, used from any thread: `sim.engine.run(lambda engine: engine.contacts())`."""

    def __init__(
        self, engine: Callable[[], Engine], run: Callable[..., Any], late_ends: LateEndCallbacks | None = None
    ) -> None:
        """Creates the access.

        Args:
            engine: returns the engine.
            run: runs a function in its thread, with the keyword arguments of `run`.
            late_ends: what is called at the ends of calls that were reported as begun.
        """
        self._engine, self._run, self._late_ends = engine, run, late_ends or LateEndCallbacks()
        self.error: EngineError | None = None
        """The error of the last access to the engine's state; None if it succeeded."""

    @property
    def name(self) -> str:
        """The name of the engine."""
        return self._engine().name

    @property
    def capabilities(self) -> frozenset[Capability]:
        """The optional capabilities of the engine."""
        return self._engine().capabilities

    @property
    def notes(self) -> tuple[SpawnNote, ...]:
        """Decisions and warnings of the engine that are in no report, since edits or the physics caused them."""
        return self.run(lambda engine: engine.notes, label="notes")

    @checked
    def ping(self, *, timeout_s: Timeout | None = None) -> float:
        """Calls the engine, and returns the round-trip time [s]; raises what `run` raises."""
        start = time.perf_counter()
        self.run(lambda engine: engine.time_s, label="ping", timeout_s=timeout_s)
        return time.perf_counter() - start

    @checked
    def run(
        self, function: Callable[[Engine], T], *, label: str = "", timeout_s: Timeout | None = None, edits: bool = False
    ) -> T:
        """Runs a function in the engine thread: `sim.engine.run(lambda engine: engine.save_state())`.

        Args:
            function: called with the engine, to which it must not keep a reference.
            label: the name of the call in errors.
            timeout_s: by default that of the simulation [s].
            edits: whether bodies, materials or highlights may change; increments `StateSnapshot.revision`.

        Raises:
            SimulationTimeoutError: the call did not begin in time and never will; or, with `begun`, it did not end in
                time: then its end is reported to the callbacks of `on_late_end`.
            SimulationFaultError: something raised while the simulation played; nothing was executed.
            SimulationError: the simulation is closed.
        """
        name = label or getattr(function, "__name__", "the call")
        result: T = self._run(function, label=name, timeout_s=timeout_s, edits=edits)
        return result

    def on_late_end(self, callback: Callable[[str, BaseException | None], None]) -> Callable[[], None]:
        """Registers a callback for the ends of calls that were reported as begun, but not ended in time.

        Args:
            callback: called in the engine thread with the label of the call, and its error or None; must not block.

        Returns:
            A function that removes the callback.
        """
        return self._late_ends.add(callback)


class _Call(Generic[T]):
    """A function that waits for the thread, and its result."""

    def __init__(self, function: Callable[[], T], label: str) -> None:
        self.function = function
        self.label = label
        self.future: Future[T] = Future()
        self.queued_s = time.monotonic()
        self.begun_s: float | None = None
        self.is_late = False
        """Whether its caller has stopped to wait for its end."""

    def execute(self) -> None:
        """Executes the function unless it was withdrawn."""
        if not self.future.set_running_or_notify_cancel():
            return
        self.begun_s = time.monotonic()
        try:
            result = self.function()
        except BaseException as error:
            self.future.set_exception(error)
        else:
            self.future.set_result(result)


class EngineThread:
    """Runs a tick function repeatedly, and queued calls in between, in one thread."""

    def __init__(
        self,
        tick: Callable[[], float | None],
        *,
        on_late_end: Callable[[str, BaseException | None], None] = lambda label, error: None,
        on_fault: Callable[[BaseException], None] = lambda error: None,
        last_rebuild: Callable[[], RebuildTime | None] = lambda: None,
        expected_rebuild_s: Callable[[], float] = lambda: 0.0,
        called: Callable[[], str] = lambda: "",
        name: str = "mindstage-simulation",
    ) -> None:
        """Starts the thread.

        Args:
            tick: called in the thread; returns the delay until its next call [s], or None to wait for the next queued
                call.
            on_late_end: called in the thread at the end of a call whose timeout was over: its label and its error.
            on_fault: called in the thread with what a tick, or `on_late_end`, raised; must not raise.
            last_rebuild: when the engine last rebuilt its model; timeouts are extended by that time. Called in any
                thread, as the two below are.
            expected_rebuild_s: how long the pending rebuild is expected to take [s], for errors; 0 without one.
            called: what the tick or call is waiting for, for errors; empty if there is nothing special.
            name: name of the thread.
        """
        self._tick = tick
        self._on_late_end, self._on_fault = on_late_end, on_fault
        self._last_rebuild, self._expected_rebuild_s, self._called = last_rebuild, expected_rebuild_s, called
        self._label = ""
        """The label of the call that is executed."""
        self._calls: SimpleQueue[_Call[Any] | None] = SimpleQueue()
        self._stopping = False
        self._last_progress_s = 0.0
        """Time at which the last call or tick ended."""
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def run(self, function: Callable[[], T], *, label: str, timeout_s: float) -> T:
        """Runs a function in the thread, and returns its result or raises its exception.

        Args:
            function: the function to run.
            label: name of the call in errors.
            timeout_s: how long nothing may happen [s]: while it waits, since the thread ended another call, and then
                since it began.

        Raises:
            SimulationTimeoutError: the function did not begin in time and never will; or, with `begun`, it did not end
                in time, and `on_late_end` is called at its end.
            SimulationThreadError: the thread has stopped or ended.
        """
        if self.is_current:
            return function()
        self.check_alive(label)
        call = _Call(function, label)
        self._calls.put(call)
        if self._stopping:  # the thread may have ended before the call was in the queue
            call.future.cancel()
        wait_s = timeout_s
        while True:
            try:
                return call.future.result(timeout=wait_s)
            except (TimeoutError, CancelledError):
                if call.future.done() and not call.future.cancelled():
                    return call.future.result()  # the function itself raised TimeoutError, or finished just now
                if call.future.cancelled():
                    raise SimulationThreadError(label) from None
            wait_s = self._remaining_s(call, timeout_s)
            if wait_s > 0.0:
                continue
            call.is_late = True
            if call.future.done() and not call.future.cancelled():
                continue  # it has ended meanwhile
            busy_with = self._called() or (f"the call {self._label!r}" if self._label else "")
            raise SimulationTimeoutError(
                label,
                timeout_s=timeout_s,
                begun=not call.future.cancelled(),
                busy_with=busy_with,
                expected_rebuild_s=self._expected_rebuild_s(),
            )

    def post(self, function: Callable[[], object], *, label: str) -> None:
        """Queues a function without waiting for it; does nothing if the thread has ended."""
        if not self._stopping:
            self._calls.put(_Call(function, label))

    def check_alive(self, label: str) -> None:
        """Raises if a call cannot be executed.

        Raises:
            SimulationThreadError: the thread has stopped or ended.
        """
        if self._stopping or not self._thread.is_alive():
            raise SimulationThreadError(label)

    @property
    def is_current(self) -> bool:
        """Whether this is the thread."""
        return threading.current_thread() is self._thread

    def stop(self, *, timeout_s: float = 10.0) -> None:
        """Stops the thread after the current call; may be called repeatedly."""
        if not self._stopping:
            self._stopping = True
            self._calls.put(None)
        if not self.is_current:
            self._thread.join(timeout_s)

    def _progress_s(self) -> float:
        """When the thread last ended something: a call, a tick, or a rebuild, which is that all the time."""
        rebuild, now_s = self._last_rebuild(), time.monotonic()
        if rebuild is None:
            return self._last_progress_s
        ended_s = now_s if rebuild.ended_s is None else rebuild.ended_s
        return max(self._last_progress_s, min(ended_s, rebuild.began_s + _MAX_REBUILD_S))

    def _remaining_s(self, call: _Call[Any], timeout_s: float) -> float:
        """How long to wait for a call [s]; 0 if its time is over, after which it cannot begin anymore."""
        if call.future.cancelled():
            return 0.0
        if call.begun_s is None:
            since_s = max(call.queued_s, self._progress_s())
            remaining_s = since_s + timeout_s - time.monotonic()
            if remaining_s > 0.0:
                return remaining_s
            if call.future.cancel():
                return 0.0
        # It has begun, perhaps just now.
        return max(0.0, max(call.begun_s or time.monotonic(), self._progress_s()) + timeout_s - time.monotonic())

    def _run(self) -> None:
        try:
            self._execute_all()
        finally:
            self._stopping = True
            self._cancel_pending()

    def _execute_all(self) -> None:
        due: float | None = None
        turn_end_s = 0.0
        """Until when waiting calls are executed before the next tick."""
        while True:
            wait = None if due is None else max(0.0, due - time.monotonic())
            try:
                call = self._calls.get(timeout=wait)
            except Empty:
                pass
            else:
                if call is None:
                    return
                self._label = call.label
                call.execute()
                self._label, self._last_progress_s = "", time.monotonic()
                if call.is_late and not call.future.cancelled():
                    self._guard(partial(self._on_late_end, call.label, call.future.exception()))
            now_s = time.monotonic()
            if self._calls.empty() or (due is not None and now_s >= max(due, turn_end_s)):
                delay = self._guard(self._tick)
                self._last_progress_s = time.monotonic()
                due = None if delay is None else self._last_progress_s + min(max(0.0, delay), _MAX_WAIT_S)
                turn_end_s = self._last_progress_s + min(self._last_progress_s - now_s, _MAX_TURN_S)

    def _guard(self, function: Callable[[], T]) -> T | None:
        try:
            return function()
        except BaseException as error:  # whatever it is, the thread has to go on
            self._on_fault(error)
            return None

    def _cancel_pending(self) -> None:
        while True:
            try:
                call = self._calls.get_nowait()
            except Empty:
                return
            if call is not None:
                call.future.cancel()


class DirectCalls:
    """Runs the calls of a simulation in the thread of their caller; it replaces `EngineThread` if there is only one."""

    def run(self, function: Callable[[], T], *, label: str, timeout_s: float) -> T:
        """Runs a function, and returns its result or raises its exception; the timeout is not applied."""
        return function()

    def post(self, function: Callable[[], object], *, label: str) -> None:
        """Runs a function."""
        function()

    def check_alive(self, label: str) -> None:
        """Does nothing, since there is no thread."""

    is_current = False
    """Whether this is a thread that executes the calls of others."""

    def stop(self, *, timeout_s: float = 10.0) -> None:
        """Does nothing, since there is no thread."""
