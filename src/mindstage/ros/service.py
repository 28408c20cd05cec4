"""Job: a goal that is being reached for: it tells how it goes, and looks whether it shall be given up.

Whoever works at it does so in pieces and calls `check` between them. It raises what ends the work early, so that the
work itself is written as if it always went through.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from mindstage.errors import SimulationTimeoutError
from mindstage.msgs import Message

__all__ = ["FEEDBACK_INTERVAL_S", "GoalCanceled", "GoalContext"]

FEEDBACK_INTERVAL_S = 0.4
"""Whoever waits hears at least this often how it goes [s]."""


class GoalCanceled(Exception):
    """The goal shall not be reached any more."""


class GoalContext:
    """One goal under way."""

    def __init__(
        self, name: str, *, timeout_s: float, is_cancelled: Callable[[], bool], send_feedback: Callable[[Message], None]
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
        self._send_feedback = send_feedback
        self._last_feedback_s = 0.0

    @property
    def cancelled(self) -> bool:
        """Whether it shall be given up."""
        return self._is_cancelled()

    def send_feedback(self, feedback: Message) -> None:
        """Tells how it goes, now."""
        self._send_feedback(feedback)

    def check(self, make_feedback: Callable[[], Message]) -> None:
        """Tells how it goes if it is time to, and lets the work go on.

        Args:
            feedback: makes the message, when one is due.

        Raises:
            GoalCanceled: it was canceled.
            SimulationTimeoutError: it takes too long.
        """
        if self._is_cancelled():
            raise GoalCanceled
        now = time.monotonic()
        if now > self._deadline:
            raise SimulationTimeoutError(self.name, timeout_s=self.timeout_s)
        if now - self._last_feedback_s >= FEEDBACK_INTERVAL_S:
            self._last_feedback_s = now
            self._send_feedback(make_feedback())

    @contextmanager
    def sending_feedback(self, make_feedback: Callable[[], Message]) -> Iterator[None]:
        """Tells how it goes, again and again, while something goes on that cannot be divided."""
        over = threading.Event()

        def tell() -> None:
            while True:
                self._send_feedback(make_feedback())
                if over.wait(FEEDBACK_INTERVAL_S):
                    return

        teller = threading.Thread(target=tell, name="mindstage-feedback", daemon=True)
        teller.start()
        try:
            yield
        finally:
            over.set()
            teller.join()
