"""Clock: how far simulated time should have come by now, and how well that is kept."""

from __future__ import annotations

import time

__all__ = ["RealTimeClock"]

_MAX_LAG_S = 0.25
"""What the world is behind after a stall is forgiven beyond this, or it would race to catch up."""


class RealTimeClock:
    """Turns wall time into simulated time at a speed."""

    def __init__(self, speed: float = 1.0) -> None:
        self.speed = speed
        self._last = time.monotonic()
        self._due_s = 0.0
        self._wall_s = 0.0
        self._simulated_s = 0.0

    def due_s(self) -> float:
        """Simulated time that is due now [s]."""
        now = time.monotonic()
        self._wall_s += now - self._last
        self._due_s = min(self._due_s + (now - self._last) * self.speed, _MAX_LAG_S * max(1.0, self.speed))
        self._last = now
        return self._due_s

    def advance(self, simulated_s: float) -> None:
        """Some of it was stepped."""
        self._due_s -= simulated_s
        self._simulated_s += simulated_s
        if self._wall_s > 2.0:  # a sliding mean over the last seconds
            self._wall_s, self._simulated_s = self._wall_s / 2, self._simulated_s / 2

    @property
    def real_time_factor(self) -> float:
        """Simulated seconds in a second of wall time, lately."""
        return self._simulated_s / self._wall_s if self._wall_s > 0.0 else 0.0
