"""The thread that owns an engine, and the clock that paces it in real time.

Calls from any thread are queued and executed between two ticks, so that an engine is used by one thread only. Each call
has a timeout, which is extended while other calls end. A call that has not begun by then is withdrawn and never
executed; one that has begun is not interrupted, and its end is reported.

`EditHold` delays the ticks while edits follow one another.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager
from queue import Empty, SimpleQueue
from typing import Any, Generic, TypeVar

from mindstage.errors import SimulationTimeoutError

__all__ = ["DirectCalls", "EditHold", "EngineThread", "RealTimeClock"]


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


class EditHold:
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
        """Calls all with the label of a call, and its error or None."""
        for callback in self._callbacks:
            callback(label, error)


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
        name: str = "mindstage-simulation",
    ) -> None:
        """Starts the thread.

        Args:
            tick: called in the thread; returns the delay until its next call [s], or None to wait for the next queued
                call.
            on_late_end: called in the thread at the end of a call whose timeout was over: its label and its error.
            name: name of the thread.
        """
        self._tick = tick
        self._on_late_end = on_late_end
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
            SimulationTimeoutError: the function did not begin in time and never will, or the thread has stopped; or,
                with `begun`, it did not end in time, and `on_late_end` is called at its end.
        """
        if threading.current_thread() is self._thread:
            return function()
        if self._stopping:
            raise SimulationTimeoutError(label, timeout_s=0.0)
        call = _Call(function, label)
        self._calls.put(call)
        wait_s = timeout_s
        while True:
            try:
                return call.future.result(timeout=wait_s)
            except (TimeoutError, CancelledError):
                if call.future.done() and not call.future.cancelled():
                    return call.future.result()  # the function itself raised TimeoutError, or finished just now
            wait_s = self._remaining_s(call, timeout_s)
            if wait_s > 0.0:
                continue
            call.is_late = True
            if call.future.done() and not call.future.cancelled():
                continue  # it has ended meanwhile
            raise SimulationTimeoutError(label, timeout_s=timeout_s, begun=not call.future.cancelled())

    def stop(self, *, timeout_s: float = 10.0) -> None:
        """Stops the thread after the current call; may be called repeatedly."""
        if not self._stopping:
            self._stopping = True
            self._calls.put(None)
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout_s)

    def allow_rebuild(self) -> None:
        """Extends all timeouts while the current call or tick rebuilds a large model; called in the thread."""
        self._last_progress_s = time.monotonic() + _MAX_REBUILD_S

    def _remaining_s(self, call: _Call[Any], timeout_s: float) -> float:
        """How long to wait for a call [s]; 0 if its time is over, after which it cannot begin anymore."""
        if call.future.cancelled():
            return 0.0
        if call.begun_s is None:
            since_s = max(call.queued_s, self._last_progress_s)
            remaining_s = since_s + timeout_s - time.monotonic()
            if remaining_s > 0.0:
                return remaining_s
            if call.future.cancel():
                return 0.0
        # It has begun, perhaps just now.
        return max(0.0, max(call.begun_s or time.monotonic(), self._last_progress_s) + timeout_s - time.monotonic())

    def _run(self) -> None:
        due: float | None = None
        while True:
            wait = None if due is None else max(0.0, due - time.monotonic())
            try:
                call = self._calls.get(timeout=wait)
            except Empty:
                pass
            else:
                if call is None:
                    self._cancel_pending()
                    return
                call.execute()
                self._last_progress_s = time.monotonic()
                if call.is_late and not call.future.cancelled():
                    self._on_late_end(call.label, call.future.exception())
            if self._calls.empty() or (due is not None and time.monotonic() >= due):
                delay = self._tick()
                self._last_progress_s = time.monotonic()
                due = None if delay is None else self._last_progress_s + delay

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

    def allow_rebuild(self) -> None:
        """Does nothing, since there are no timeouts."""

    def stop(self, *, timeout_s: float = 10.0) -> None:
        """Does nothing, since there is no thread."""
