"""Conventions: in which units, frame and order of a quaternion's parts a map writes its numbers.

Few maps say it. A reader decides it from what it finds (see `assumptions`), unless whoever loads the map knows better.
"""

from __future__ import annotations

from enum import StrEnum

import msgspec

__all__ = ["SI", "Conventions", "Frame", "QuaternionOrder", "Units"]


class Units(StrEnum):
    """What lengths are counted in."""

    METRES = "m"
    CENTIMETRES = "cm"
    MILLIMETRES = "mm"

    @property
    def per_metre(self) -> float:
        """How many of them make a metre."""
        return {Units.METRES: 1.0, Units.CENTIMETRES: 100.0, Units.MILLIMETRES: 1000.0}[self]


class Frame(StrEnum):
    """Which way the axes point; z is up in both."""

    ROS = "ros"
    """Right-handed: x forward, y left."""
    UNREAL = "unreal"
    """Left-handed: x forward, y right."""


class QuaternionOrder(StrEnum):
    """Where a quaternion has its scalar."""

    WXYZ = "wxyz"
    XYZW = "xyzw"


class Conventions(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How the numbers of one map are meant; what is None is decided by whoever reads it."""

    units: Units | None = None
    frame: Frame | None = None
    quaternion: QuaternionOrder | None = None


SI = Conventions(units=Units.METRES, frame=Frame.ROS, quaternion=QuaternionOrder.WXYZ)
"""What a world is in."""
