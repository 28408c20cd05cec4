"""An asyncio event loop in a thread of its own, and an executor that keeps the order of tasks with the same key.

All state of the bridge belongs to its loop. Other threads submit functions and wait for their results with a timeout.
Handlers are plain functions that may block, so they run in worker threads; the messages of one client are handled in
the order in which they were sent, those of several clients concurrently.
"""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from collections.abc import Callable, Coroutine, Hashable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from mindstage.access.limits import LOOP_TIME, WORKERS
from mindstage.errors import BridgeError

__all__ = ["EventLoopThread", "KeyedSerialExecutor"]


T = TypeVar("T")


@dataclass(frozen=True)
class _Batch(Generic[T]):
    """A queued task with several items."""

    run: Callable[[list[T]], None]
    items: list[T]

    def __call__(self) -> None:
        self.run(self.items)


class KeyedSerialExecutor:
    """A thread pool in which tasks with the same key run one after the other, in their order."""

    def __init__(self, *, workers: int = WORKERS.count, name: str = "mindstage-bridge-worker") -> None:
        """Creates the executor; threads start with the first task.

        Args:
            workers: largest number of threads.
            name: prefix of the names of the threads, for debuggers.
        """
        self._threads = ThreadPoolExecutor(workers, thread_name_prefix=name)
        self._lock = threading.Lock()
        self._waiting: dict[Hashable, deque[Callable[[], None]]] = {}
        """Queued tasks by key; a key exists while one of its tasks is queued or running."""
        self._closed = False

    def submit(self, key: Hashable, task: Callable[[], None], *, max_waiting: int | None = None) -> None:
        """Queues a task; after `close` it does nothing.

        Args:
            key: tasks with the same key run in the order in which they were submitted.
            task: must not raise.
            max_waiting: largest number of queued tasks with this key; beyond it, the oldest is dropped.
        """
        with self._lock:
            if self._closed:
                return
            queue = self._waiting.get(key)
            if queue is not None:
                if max_waiting is not None and len(queue) >= max_waiting:
                    queue.popleft()
                queue.append(task)
                return
            self._waiting[key] = deque([task])
            self._threads.submit(self._run_next, key)

    def submit_to_batch(self, key: Hashable, run: Callable[[list[T]], None], item: T) -> None:
        """Queues an item; consecutive items with the same key and function are passed to one call of the function.

        Args:
            key: as of `submit`.
            run: called with the items in the order in which they were submitted; must not raise.
        """
        with self._lock:
            queue = self._waiting.get(key)
            last = queue[-1] if queue else None
            if isinstance(last, _Batch) and last.run is run:  # not begun, else it would not be in the queue
                last.items.append(item)
                return
        self.submit(key, _Batch(run, [item]))

    def close(self) -> None:
        """Drops the queued tasks; running tasks are not interrupted."""
        with self._lock:
            self._closed = True
            self._waiting.clear()
        self._threads.shutdown(wait=False, cancel_futures=True)

    def _run_next(self, key: Hashable) -> None:
        with self._lock:
            queue = self._waiting.get(key)
            if not queue:
                return
            task = queue.popleft()
        try:
            task()
        finally:
            with self._lock:
                if not queue:
                    self._waiting.pop(key, None)
                elif not self._closed:
                    self._threads.submit(self._run_next, key)


class EventLoopThread:
    """An event loop that runs until `close`; its thread is a daemon and does not keep the process alive."""

    def __init__(self, name: str = "mindstage-bridge") -> None:
        """Starts the thread.

        Args:
            name: name of the thread, for debuggers.
        """
        self.loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    @property
    def closed(self) -> bool:
        """Whether the loop has ended."""
        return self.loop.is_closed() or not self._thread.is_alive()

    def is_current_thread(self) -> bool:
        """Whether the caller runs in the thread of the loop, where waiting for the loop would be a deadlock."""
        return threading.current_thread() is self._thread

    def call_soon(self, function: Callable[..., object], *args: object) -> None:
        """Calls a function on the loop, from any thread, without waiting; does nothing once the loop is closed."""
        try:
            self.loop.call_soon_threadsafe(function, *args)
        except RuntimeError:
            if not self.closed:
                raise

    def call(self, function: Callable[..., T], *args: object) -> T:
        """Calls a function on the loop, from any thread, and returns its result or raises its exception.

        Raises:
            BridgeError: the loop is closed or does not respond.
        """
        if self.is_current_thread():
            return function(*args)
        future: Future[T] = Future()

        def run() -> None:
            try:
                future.set_result(function(*args))
            except BaseException as error:
                future.set_exception(error)

        self._require_open()
        self.call_soon(run)
        return self._result(future, LOOP_TIME.maximum)

    def run(self, coroutine: Coroutine[Any, Any, T], *, timeout_s: float = LOOP_TIME.maximum) -> T:
        """Runs a coroutine on the loop and waits for its result, from any other thread.

        Raises:
            BridgeError: the loop is closed, or the coroutine did not finish in time and was canceled.
        """
        try:
            self._require_open()
        except BridgeError:
            coroutine.close()
            raise
        future = asyncio.run_coroutine_threadsafe(coroutine, self.loop)
        return self._result(future, timeout_s)

    def close(self) -> None:
        """Ends the thread and cancels its tasks; calling it again is harmless."""
        if self.loop.is_closed() or self.is_current_thread():
            return
        self.call_soon(self.loop.stop)
        self._thread.join(LOOP_TIME.maximum)

    def _run(self) -> None:
        asyncio.set_event_loop(self.loop)
        try:
            self.loop.run_forever()
            tasks = asyncio.all_tasks(self.loop)
            for task in tasks:
                task.cancel()
            self.loop.run_until_complete(asyncio.gather(*tasks, return_exceptions=True))
            self.loop.run_until_complete(self.loop.shutdown_asyncgens())
        finally:
            self.loop.close()

    def _require_open(self) -> None:
        if self.closed:
            raise BridgeError("the bridge is closed; create a new one")

    @staticmethod
    def _result(future: Future[T], timeout_s: float) -> T:
        try:
            return future.result(timeout_s)
        except TimeoutError:
            if future.done():
                return future.result()  # the function itself raised TimeoutError
            future.cancel()
            raise BridgeError(f"the bridge's thread did not respond within {timeout_s:g} s") from None
