"""Conventions of a map's numbers (units, axes, quaternion order, sizes), and the assumptions that its reader makes.

Few maps declare their conventions. A reader infers them (see `mindstage.maps.dialects.units`) unless the user
chooses them, and records each decision as an `Assumption`.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Protocol

import msgspec

from mindstage.scene import Iri

__all__ = [
    "SI",
    "Assumption",
    "AssumptionSink",
    "Handedness",
    "LengthUnit",
    "QuaternionOrder",
    "SizeFrame",
    "UnitConventions",
    "UnstatedMobility",
]


class Assumption(msgspec.Struct, frozen=True):
    """A decision about a whole map that the map does not state; a wrong one affects everything read from the map."""

    map: Iri
    topic: str
    """What was decided, such as "units", "frame" or "quaternion"."""
    value: str
    evidence: str
    """The reason, with numbers where there are any."""
    overridden: bool = False
    """Whether the user made the decision; `evidence` then describes the alternative."""

    def __str__(self) -> str:
        how = "set" if self.overridden else "assumed"
        return f"{self.topic}: {self.value}, {how}: {self.evidence}"


class AssumptionSink(Protocol):
    """Callback that receives the assumptions made while a map is read."""

    def __call__(self, assumption: Assumption) -> None:
        """Receives one assumption."""


class LengthUnit(StrEnum):
    """Unit of lengths."""

    METERS = "m"
    CENTIMETERS = "cm"
    MILLIMETERS = "mm"

    @property
    def per_meter(self) -> float:
        """Number of these units in a meter."""
        return {LengthUnit.METERS: 1.0, LengthUnit.CENTIMETERS: 100.0, LengthUnit.MILLIMETERS: 1000.0}[self]


class Handedness(StrEnum):
    """Direction of the axes; z is up in both."""

    ROS = "ros"
    """Right-handed: x forward, y left."""
    UNREAL = "unreal"
    """Left-handed: x forward, y right."""


class QuaternionOrder(StrEnum):
    """Position of the scalar in a quaternion."""

    WXYZ = "wxyz"
    XYZW = "xyzw"


class SizeFrame(StrEnum):
    """Frame in which the sizes of classes were measured."""

    BODY = "body"
    """Along the axes of the body."""
    WORLD = "world"
    """Along the axes of the world, of one individual of the class (Unreal's loggers until June 2021)."""


class UnstatedMobility(StrEnum):
    """The mobility of bodies for which a map does not give it."""

    BY_CLASS = "by-class"
    """Dynamic if their class is portable and something is below them, otherwise static."""
    STATIC = "static"


class UnitConventions(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Conventions of one map's numbers; None in a field leaves the decision to the reader."""

    units: LengthUnit | None = None
    frame: Handedness | None = None
    quaternion: QuaternionOrder | None = None
    sizes: SizeFrame | None = None
    mobility: UnstatedMobility | None = None


SI = UnitConventions(units=LengthUnit.METERS, frame=Handedness.ROS, quaternion=QuaternionOrder.WXYZ)
"""The conventions of a `World`."""
