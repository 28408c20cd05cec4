"""The limits of everything that can be reached from outside, in one table with reasons.

Servers and handlers refer to the limits of this table and define none of their own.
"""

from __future__ import annotations

import math
from enum import StrEnum

import msgspec

from mindstage.errors import InvalidArgumentError

__all__ = ["LIMITS", "Excess", "Limit"]


class Excess(StrEnum):
    """What happens to a request beyond a limit."""

    REFUSED = "refused"
    """It is refused with the name of the limit and its range; nothing was done."""
    SLOWED = "slowed"
    """It is processed later; nothing is lost."""
    CUT = "cut"
    """A part of the result is left out, and the result says so."""


class Limit(msgspec.Struct, frozen=True, kw_only=True):
    """A range of a number that comes from outside."""

    name: str
    """The name, as errors and the documentation show it."""
    maximum: float
    """The largest allowed value."""
    minimum: float = 0.0
    """The smallest allowed value."""
    unit: str = ""
    """The unit; empty for counts and ratios."""
    excess: Excess = Excess.REFUSED
    """What happens beyond the range."""
    reason: str
    """Why the limit exists and why it has this value."""

    def check(self, value: float) -> float:
        """Returns a value that is in the range.

        Raises:
            InvalidArgumentError: it is not a number, not finite, or out of the range.
        """
        if not (self.minimum <= value <= self.maximum and math.isfinite(value)):
            unit = f" {self.unit}" if self.unit else ""
            cause = f"it must be a number from {self.minimum:g} to {self.maximum:g}{unit}"
            raise InvalidArgumentError(f"{self.name} {value}", cause=cause)
        return value


LIMITS: dict[str, Limit] = {}
"""All limits by name."""


def _limit(name: str, maximum: float, reason: str, **fields: object) -> Limit:
    limit = LIMITS[name] = msgspec.convert(
        {"name": name, "maximum": maximum, "reason": reason, **fields}, Limit, strict=False
    )
    return limit


SPEED = _limit(
    "speed",
    1000.0,
    "a multiple of real time that no engine reaches; larger numbers could only overflow",
)
CONTROLLER_PERIOD = _limit(
    "controller period",
    3600.0,
    "each update is a call of Python between two time steps; more than ten for a time step have no effect",
    minimum=1e-4,
    unit="s",
)
OBSERVER_INTERVAL = _limit(
    "observer interval",
    3600.0,
    "each state that an observer gets costs a reading of all poses; a thousand for each second is a frame of a time "
    "step or two",
    minimum=1e-3,
    unit="s",
)
CALL_TIMEOUT = _limit(
    "timeout",
    86400.0,
    "how long a call of the simulation waits; a whole day is longer than any, and clocks overflow at far more",
    unit="s",
)
MARKER_LIFETIME = _limit(
    "lifetime of a marker",
    86400.0 * 366,
    "a year; a marker without a lifetime stays until it is removed",
    unit="s",
)
MOTION_TIMEOUT = _limit(
    "timeout of a motion",
    3600.0,
    "simulated time for which a joint is pulled if it does not arrive",
    unit="s",
)
PUBLISH_RATE = _limit(
    "publish rate",
    1000.0,
    "messages of a topic for each second of real time; 0 disables it, and more than this takes all of a core",
    unit="Hz",
)
STEP_DURATION = _limit(
    "step duration",
    3600.0,
    "simulated time of one call; longer runs are divided, so that they can be observed and canceled",
    unit="s",
)
