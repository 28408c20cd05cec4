"""The thread that owns an engine, and the clock that paces it in real time.

Calls from any thread are queued and executed between two ticks, so that an engine is used by one thread only. Each call
has a timeout; a call that has not started by then is canceled and never executed.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from queue import Empty, SimpleQueue
from typing import TypeVar

from mindstage.errors import SimulationTimeoutError

__all__ = ["EngineThread", "RealTimeClock"]


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


T = TypeVar("T")

_Call = tuple["Future[object]", Callable[[], object]]


class EngineThread:
    """Runs a tick function repeatedly, and queued calls in between, in one thread."""

    def __init__(self, tick: Callable[[], float | None], *, name: str = "mindstage-simulation") -> None:
        """Starts the thread.

        Args:
            tick: called in the thread; returns the delay until its next call [s], or None to wait for the next queued
                call.
            name: name of the thread.
        """
        self._tick = tick
        self._calls: SimpleQueue[_Call | None] = SimpleQueue()
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def run(self, function: Callable[[], T], *, label: str, timeout_s: float) -> T:
        """Runs a function in the thread, and returns its result or raises its exception.

        Raises:
            SimulationTimeoutError: the function did not finish in time, or the thread has stopped.
        """
        if threading.current_thread() is self._thread:
            return function()
        if self._stopping:
            raise SimulationTimeoutError(label, timeout_s=0.0)
        future: Future[T] = Future()
        self._calls.put((future, function))  # type: ignore[arg-type]  # Future is invariant
        try:
            return future.result(timeout=timeout_s)
        except (TimeoutError, CancelledError):
            if future.done() and not future.cancelled():
                return future.result()  # the function itself raised TimeoutError, or finished just now
            future.cancel()
            raise SimulationTimeoutError(label, timeout_s=timeout_s) from None

    def stop(self, *, timeout_s: float = 10.0) -> None:
        """Stops the thread after the current call; may be called repeatedly."""
        if not self._stopping:
            self._stopping = True
            self._calls.put(None)
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout_s)

    def _run(self) -> None:
        due: float | None = None
        while True:
            wait = None if due is None else max(0.0, due - time.monotonic())
            try:
                entry = self._calls.get(timeout=wait)
            except Empty:
                entry = (Future(), lambda: None)
            if entry is None:
                self._cancel_pending()
                return
            self._execute(*entry)
            if self._calls.empty() or (due is not None and time.monotonic() >= due):
                delay = self._tick()
                due = None if delay is None else time.monotonic() + delay

    @staticmethod
    def _execute(future: Future[object], function: Callable[[], object]) -> None:
        if not future.set_running_or_notify_cancel():
            return
        try:
            result = function()
        except BaseException as error:
            future.set_exception(error)
        else:
            future.set_result(result)

    def _cancel_pending(self) -> None:
        while True:
            try:
                entry = self._calls.get_nowait()
            except Empty:
                return
            if entry is not None:
                entry[0].cancel()
