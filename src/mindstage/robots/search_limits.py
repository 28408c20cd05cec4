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

    def __init__(self, steps: int, *, cpu_s: float = CPU_S, part_of: SearchLimit | None = None) -> None:
        """Starts the clock; the search has to run in the same thread.

        Args:
            steps: the number of steps after which the search ends.
            cpu_s: the processor time after which it ends in any case [s].
            part_of: the limit of the search that this one is a part of: its steps are steps of that one, too, and it
                ends with it.
        """
        self.steps, self.cpu_s = steps, cpu_s
        self.done = 0
        """The number of steps so far."""
        self._whole, self._time_is_over = part_of, False
        self._end_s = time.thread_time() + cpu_s

    def count(self, steps: int = 1) -> None:
        """Counts steps."""
        self.done += steps
        if self._whole is not None:
            self._whole.count(steps)

    @property
    def is_over(self) -> bool:
        """Whether the search has to end now."""
        if self.done >= self.steps:
            return True
        if not self._time_is_over and time.thread_time() > self._end_s:
            self._time_is_over = True
        return self._time_is_over or (self._whole is not None and self._whole.is_over)

    @property
    def ended_by_time(self) -> bool:
        """Whether its processor time has ended the search before its steps were used up, or that of the whole one."""
        return self._time_is_over or (self._whole is not None and self._whole.ended_by_time)

    def extend(self, steps: int) -> None:
        """Allows at least some more steps."""
        self.steps = max(self.steps, self.done + steps)

    def __str__(self) -> str:
        """What has ended the search, as a part of a sentence."""
        if self._whole is not None and self.done < self.steps and not self._time_is_over and self._whole.is_over:
            return str(self._whole)
        if self._time_is_over:
            return (
                f"after {self.cpu_s:g} s of processor time, in which {self.done} of {self.steps} steps were done: "
                "a faster machine may find one"
            )
        return f"within {self.steps} steps"
