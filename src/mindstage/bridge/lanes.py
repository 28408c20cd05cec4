"""Lanes: work for other threads, in order within a lane, lanes beside one another.

Handlers are plain functions that may take their time. The loop must not wait for them, and yet what one client sends
must be handled in the order it was sent: each client is a lane.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Hashable
from concurrent.futures import ThreadPoolExecutor

__all__ = ["Lanes"]

_WORKERS = 16


class Lanes:
    """A few threads that share whatever is to be done; they start when first needed."""

    def __init__(self, *, workers: int = _WORKERS, name: str = "mindstage-bridge-worker") -> None:
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

    def put(self, lane: Hashable, work: Callable[[], None], *, most: int | None = None) -> None:
        """Queues work, which must not raise; after `close`, nothing.

        Args:
            lane: whose turn it is.
            work: what to do.
            most: how much may wait in that lane; beyond it the oldest is dropped.
        """
        with self._lock:
            if self._closed:
                return
            queue = self._waiting.get(lane)
            if queue is not None:
                if most is not None and len(queue) >= most:
                    queue.popleft()
                queue.append(work)
                return
            self._waiting[lane] = deque([work])
            self._threads.submit(self._take_turn, lane)

    def busy(self, lane: Hashable) -> bool:
        """Whether something is waiting or being done in a lane."""
        with self._lock:
            return lane in self._waiting

    def close(self) -> None:
        """Drops what waits; what is being done ends by itself."""
        with self._lock:
            self._closed = True
            self._waiting.clear()
        self._threads.shutdown(wait=False, cancel_futures=True)

    def _take_turn(self, lane: Hashable) -> None:
        with self._lock:
            queue = self._waiting.get(lane)
            if not queue:
                return
            work = queue.popleft()
        try:
            work()
        finally:
            with self._lock:
                if not queue:
                    self._waiting.pop(lane, None)
                elif not self._closed:
                    self._threads.submit(self._take_turn, lane)
