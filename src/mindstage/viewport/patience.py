"""Patience: long work for pages, so that it holds up neither the world nor what else a page asks for."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import TypeVar

from mindstage.errors import QueryLimitError, QuestionTimeoutError

__all__ = ["BoundedExecutor"]

T = TypeVar("T")


class BoundedExecutor:
    """So many pieces of work at once, and so long that anybody waits for each.

    Nothing in Python can be stopped from outside: what never ends keeps its place, and ends with the process.
    """

    def __init__(self, *, max_workers: int = 4, timeout_s: float = 30.0) -> None:
        """Nobody works yet.

        Args:
            places: so much is done at once.
            timeout_s: how long anybody waits for it [s].
        """
        self._max_workers = max_workers
        self._semaphore = threading.BoundedSemaphore(max_workers)
        self._timeout_s = timeout_s

    def run(self, function: Callable[[], T], *, label: str) -> T:
        """Does it, and gives what comes of it.

        Args:
            work: may take its time.
            what: it is, for the sentence that says that it takes too long.

        Raises:
            QuestionTimeoutError: it took too long.
            QueryLimitError: as much as can be is being done already.
        """
        if not self._semaphore.acquire(blocking=False):
            raise QueryLimitError(label, pending=self._max_workers)
        future: Future[T] = Future()
        threading.Thread(target=self._execute, args=(function, future), name="mindstage-asking", daemon=True).start()
        try:
            return future.result(self._timeout_s)
        except TimeoutError:
            if future.done():  # the work itself raised it
                raise
            raise QuestionTimeoutError(label, timeout_s=self._timeout_s) from None

    def _execute(self, function: Callable[[], T], future: Future[T]) -> None:
        try:
            future.set_result(function())
        except BaseException as error:
            future.set_exception(error)
        finally:
            self._semaphore.release()
