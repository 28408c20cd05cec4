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
        if not (math.isfinite(value) and self.minimum <= value <= self.maximum):
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
STEP_DURATION = _limit(
    "step duration",
    3600.0,
    "simulated time of one call; longer runs are divided, so that they can be observed and canceled",
    unit="s",
)
XACRO_STEPS = _limit(
    "steps of a xacro expansion",
    5_000_000,
    "about ten seconds; the largest descriptions of robots take some hundred thousand",
)
XACRO_EXPRESSION_LENGTH = _limit(
    "length of a xacro expression",
    10_000,
    "the longest in descriptions of robots have some hundred; longer ones could only exhaust the parser",
    unit="characters",
)
XACRO_VALUE_SIZE = _limit(
    "size of a xacro value",
    1_000_000,
    "a value is held in memory and printed; strings that double in each property would fill it",
    unit="characters and elements",
)
XACRO_INTEGER_BITS = _limit(
    "integer in a xacro expression",
    4096,
    "far beyond the range of floating point numbers; powers of integers could fill the memory",
    unit="bits",
)
XACRO_FORMAT_WIDTH = _limit(
    "width of a formatted xacro number",
    1000,
    "no number has more digits; the width is allocated before it is filled",
    unit="characters",
)
