"""Limits of searches: a number of steps, so that a result does not depend on the speed or the load of the machine.

A search that was ended by its processor time instead states it, since another machine may find more. It is that of the
thread, as wall time depends on what else the machine does.
"""

from __future__ import annotations

import time

__all__ = ["CPU_S", "SearchLimit"]

CPU_S = 120.0
"""The processor time after which a search ends in any case [s]; far more than its steps take."""


class SearchLimit:
    """Counts the steps of one search."""

    def __init__(self, steps: int, *, cpu_s: float = CPU_S) -> None:
        """Starts the clock; the search has to run in the same thread.

        Args:
            steps: the number of steps after which the search ends.
            cpu_s: the processor time after which it ends in any case [s].
        """
        self.steps, self.cpu_s = steps, cpu_s
        self.done = 0
        """The number of steps so far."""
        self.ended_by_time = False
        """Whether the processor time has ended the search before its steps were used up."""
        self._end_s = time.thread_time() + cpu_s

    def count(self, steps: int = 1) -> None:
        """Counts steps."""
        self.done += steps

    @property
    def is_over(self) -> bool:
        """Whether the search has to end now."""
        if self.done >= self.steps:
            return True
        if not self.ended_by_time and time.thread_time() > self._end_s:
            self.ended_by_time = True
        return self.ended_by_time

    def extend(self, steps: int) -> None:
        """Allows at least some more steps."""
        self.steps = max(self.steps, self.done + steps)

    def __str__(self) -> str:
        """What has ended the search, as a part of a sentence."""
        if self.ended_by_time:
            return (
                f"after {self.cpu_s:g} s of processor time, in which {self.done} of {self.steps} steps were done: "
                "a faster machine may find one"
            )
        return f"within {self.steps} steps"
