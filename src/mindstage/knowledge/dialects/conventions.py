"""Conventions: in which units, frame and order of a quaternion's parts a map writes its numbers.

Few maps say it. A reader decides it from what it finds (see `assumption_notes`), unless whoever loads the map knows better.
"""

from __future__ import annotations

from enum import StrEnum

import msgspec

__all__ = ["SI", "Handedness", "LengthUnit", "QuaternionOrder", "UnitConventions"]


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
