"""Patience: long work for pages, so that it holds up neither the world nor what else a page asks for."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import TypeVar

from mindstage.errors import QuestionTimedOut, TooManyQuestions

__all__ = ["Patience"]

T = TypeVar("T")


class Patience:
    """So many pieces of work at once, and so long that anybody waits for each.

    Nothing in Python can be stopped from outside: what never ends keeps its place, and ends with the process.
    """

    def __init__(self, *, places: int = 4, timeout_s: float = 30.0) -> None:
        """Nobody works yet.

        Args:
            places: so much is done at once.
            timeout_s: how long anybody waits for it [s].
        """
        self._places = places
        self._free = threading.BoundedSemaphore(places)
        self._timeout_s = timeout_s

    def run(self, work: Callable[[], T], *, what: str) -> T:
        """Does it, and gives what comes of it.

        Args:
            work: may take its time.
            what: it is, for the sentence that says that it takes too long.

        Raises:
            QuestionTimedOut: it took too long.
            TooManyQuestions: as much as can be is being done already.
        """
        if not self._free.acquire(blocking=False):
            raise TooManyQuestions(what, asked=self._places)
        future: Future[T] = Future()
        threading.Thread(target=self._do, args=(work, future), name="mindstage-asking", daemon=True).start()
        try:
            return future.result(self._timeout_s)
        except TimeoutError:
            if future.done():  # the work itself raised it
                raise
            raise QuestionTimedOut(what, timeout_s=self._timeout_s) from None

    def _do(self, work: Callable[[], T], future: Future[T]) -> None:
        try:
            future.set_result(work())
        except BaseException as error:
            future.set_exception(error)
        finally:
            self._free.release()
