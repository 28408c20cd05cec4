"""Lanes: work for other threads, in order within a lane, lanes beside one another.

Handlers are plain functions that may take their time. The loop must not wait for them, and yet what one client sends
must be handled in the order it was sent: each client is a lane.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Hashable
from concurrent.futures import ThreadPoolExecutor

__all__ = ["KeyedSerialExecutor"]

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
