"""Conventions: in which units, frame and order of a quaternion's parts a map writes its numbers.

Few maps say it. A reader decides it from what it finds (see `assumption_notes`), unless whoever loads the map knows better.

Assumptions: what a map does not say and a reader had to decide, with what speaks for it.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Protocol

import msgspec

from mindstage.scene import Iri

__all__ = ["SI", "Assumption", "AssumptionSink", "Handedness", "LengthUnit", "QuaternionOrder", "UnitConventions"]


class Assumption(msgspec.Struct, frozen=True, rename={"topic": "about"}):
    """One decision about a whole map. If it is wrong, all that was read is wrong with it, so it is said aloud."""

    map: Iri
    topic: str
    """What had to be decided, such as "units", "frame" or "quaternion"."""
    value: str
    evidence: str
    """What speaks for it, in numbers where there are any."""
    overridden: bool = False
    """Whether the user decided it; `evidence` then says what would have been decided."""

    def __str__(self) -> str:
        how = "as told" if self.overridden else "assumed"
        return f"{self.topic}: {self.value}, {how}: {self.evidence}"


class AssumptionSink(Protocol):
    """Where assumptions go while a map is read."""

    def __call__(self, assumption: Assumption) -> None:
        """Keeps one."""


class LengthUnit(StrEnum):
    """What lengths are counted in."""

    METERS = "m"
    CENTIMETERS = "cm"
    MILLIMETERS = "mm"

    @property
    def per_meter(self) -> float:
        """How many of them make a meter."""
        return {LengthUnit.METERS: 1.0, LengthUnit.CENTIMETERS: 100.0, LengthUnit.MILLIMETERS: 1000.0}[self]


class Handedness(StrEnum):
    """Which way the axes point; z is up in both."""

    ROS = "ros"
    """Right-handed: x forward, y left."""
    UNREAL = "unreal"
    """Left-handed: x forward, y right."""


class QuaternionOrder(StrEnum):
    """Where a quaternion has its scalar."""

    WXYZ = "wxyz"
    XYZW = "xyzw"


class UnitConventions(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How the numbers of one map are meant; what is None is decided by whoever reads it."""

    units: LengthUnit | None = None
    frame: Handedness | None = None
    quaternion: QuaternionOrder | None = None


SI = UnitConventions(units=LengthUnit.METERS, frame=Handedness.ROS, quaternion=QuaternionOrder.WXYZ)
"""What a world is in."""
