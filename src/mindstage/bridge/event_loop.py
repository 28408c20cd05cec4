"""LoopThread: an asyncio loop in a thread of its own, and the ways in from the others.

All state of the bridge belongs to its loop. Other threads hand functions in and wait for at most a while.

Lanes: work for other threads, in order within a lane, lanes beside one another.

Handlers are plain functions that may take their time. The loop must not wait for them, and yet what one client sends
must be handled in the order it was sent: each client is a lane.
"""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from collections.abc import Callable, Coroutine, Hashable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, TypeVar

from mindstage.errors import BridgeError

__all__ = ["EventLoopThread", "KeyedSerialExecutor"]


_MAX_WORKERS = 16


class KeyedSerialExecutor:
    """A few threads that share whatever is to be done; they start when first needed."""

    def __init__(self, *, workers: int = _MAX_WORKERS, name: str = "mindstage-bridge-worker") -> None:
        """The threads start with the first work.

        Args:
            workers: how many lanes move at once.
            name: of the threads, for debuggers.
        """
        self._threads = ThreadPoolExecutor(workers, thread_name_prefix=name)
        self._lock = threading.Lock()
        self._waiting: dict[Hashable, deque[Callable[[], None]]] = {}
        """Lanes that have work or are at it."""
        self._closed = False

    def submit(self, key: Hashable, task: Callable[[], None], *, max_waiting: int | None = None) -> None:
        """Queues work, which must not raise; after `close`, nothing.

        Args:
            lane: whose turn it is.
            work: what to do.
            most: how much may wait in that lane; beyond it the oldest is dropped.
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

    def is_busy(self, key: Hashable) -> bool:
        """Whether something is waiting or being done in a lane."""
        with self._lock:
            return key in self._waiting

    def close(self) -> None:
        """Drops what waits; what is being done ends by itself."""
        with self._lock:
            self._closed = True
            self._waiting.clear()
        self._threads.shutdown(wait=False, cancel_futures=True)

    def _run_next(self, key: Hashable) -> None:
        with self._lock:
            queue = self._waiting.get(key)
            if not queue:
                return
            work = queue.popleft()
        try:
            work()
        finally:
            with self._lock:
                if not queue:
                    self._waiting.pop(key, None)
                elif not self._closed:
                    self._threads.submit(self._run_next, key)


T = TypeVar("T")

_TIMEOUT_S = 10.0
"""How long the loop may take for what should take no time; it is stuck if it takes longer."""


class EventLoopThread:
    """Runs until `close`; a daemon, so that a forgotten one does not keep the process alive."""

    def __init__(self, name: str = "mindstage-bridge") -> None:
        """Starts the thread.

        Args:
            name: of the thread, for debuggers.
        """
        self.loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    @property
    def closed(self) -> bool:
        """Whether nothing runs here any more."""
        return self.loop.is_closed() or not self._thread.is_alive()

    def is_current_thread(self) -> bool:
        """Whether the caller is in this very thread, where waiting for the loop would be waiting for oneself."""
        return threading.current_thread() is self._thread

    def call_soon(self, function: Callable[..., object], *args: object) -> None:
        """Has the loop call a function, from any thread, without waiting; once closed, nothing is called."""
        try:
            self.loop.call_soon_threadsafe(function, *args)
        except RuntimeError:
            if not self.closed:
                raise

    def call(self, function: Callable[..., T], *args: object) -> T:
        """Has the loop call a function, from any thread, and gives back what it returns or raises.

        Raises:
            BridgeError: the loop is closed, or does not come to it.
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
        return self._result(future, _TIMEOUT_S)

    def run(self, coroutine: Coroutine[Any, Any, T], *, timeout_s: float = _TIMEOUT_S) -> T:
        """Runs a coroutine on the loop and waits for its end, from any other thread.

        Raises:
            BridgeError: the loop is closed, or it did not end in time and was canceled.
        """
        try:
            self._require_open()
        except BridgeError:
            coroutine.close()
            raise
        future = asyncio.run_coroutine_threadsafe(coroutine, self.loop)
        return self._result(future, timeout_s)

    def close(self) -> None:
        """Ends the thread and whatever still runs in it; any number of times."""
        if self.loop.is_closed() or self.is_current_thread():
            return
        self.call_soon(self.loop.stop)
        self._thread.join(_TIMEOUT_S)

    def _run(self) -> None:
        asyncio.set_event_loop(self.loop)
        try:
            self.loop.run_forever()
            left = asyncio.all_tasks(self.loop)
            for task in left:
                task.cancel()
            self.loop.run_until_complete(asyncio.gather(*left, return_exceptions=True))
            self.loop.run_until_complete(self.loop.shutdown_asyncgens())
        finally:
            self.loop.close()

    def _require_open(self) -> None:
        if self.closed:
            raise BridgeError("the bridge is closed; make a new one")

    @staticmethod
    def _result(future: Future[T], timeout_s: float) -> T:
        try:
            return future.result(timeout_s)
        except TimeoutError:
            if future.done():
                return future.result()  # the function itself raised it
            future.cancel()
            raise BridgeError(f"the bridge's own thread did not come to it within {timeout_s:g} s") from None
