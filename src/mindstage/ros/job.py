"""Job: a goal that is being reached for: it tells how it goes, and looks whether it shall be given up.

Whoever works at it does so in pieces and calls `proceed` between them. It raises what ends the work early, so that the
work itself is written as if it always went through.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from mindstage.errors import StageTimedOut
from mindstage.msgs import Message

__all__ = ["FEEDBACK_S", "GoalGivenUp", "Job"]

FEEDBACK_S = 0.4
"""Whoever waits hears at least this often how it goes [s]."""


class GoalGivenUp(Exception):
    """The goal shall not be reached any more."""


class Job:
    """One goal under way."""

    def __init__(
        self, name: str, *, timeout_s: float, is_cancelled: Callable[[], bool], tell: Callable[[Message], None]
    ) -> None:
        """It begins now.

        Args:
            name: the action's, for errors.
            timeout_s: how long it may take [s].
            is_cancelled: whether it shall be given up.
            tell: passes feedback on.
        """
        self.name = name
        self.timeout_s = timeout_s
        self._deadline = time.monotonic() + timeout_s
        self._is_cancelled = is_cancelled
        self._tell = tell
        self._told_at = 0.0

    @property
    def cancelled(self) -> bool:
        """Whether it shall be given up."""
        return self._is_cancelled()

    def tell(self, feedback: Message) -> None:
        """Tells how it goes, now."""
        self._tell(feedback)

    def proceed(self, feedback: Callable[[], Message]) -> None:
        """Tells how it goes if it is time to, and lets the work go on.

        Args:
            feedback: makes the message, when one is due.

        Raises:
            GoalGivenUp: it was cancelled.
            StageTimedOut: it takes too long.
        """
        if self._is_cancelled():
            raise GoalGivenUp
        now = time.monotonic()
        if now > self._deadline:
            raise StageTimedOut(self.name, timeout_s=self.timeout_s)
        if now - self._told_at >= FEEDBACK_S:
            self._told_at = now
            self._tell(feedback())

    @contextmanager
    def telling(self, feedback: Callable[[], Message]) -> Iterator[None]:
        """Tells how it goes, again and again, while something goes on that cannot be divided."""
        over = threading.Event()

        def tell() -> None:
            while True:
                self._tell(feedback())
                if over.wait(FEEDBACK_S):
                    return

        teller = threading.Thread(target=tell, name="mindstage-feedback", daemon=True)
        teller.start()
        try:
            yield
        finally:
            over.set()
            teller.join()
