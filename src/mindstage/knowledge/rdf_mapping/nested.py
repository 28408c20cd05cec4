"""Parts: the individuals that belong to another one and have no meaning without it.

An object has a pose, a constraint has a pose, a linear and an angular part, and each of them is an individual of its
own in a map. Here stands how each is read and how it is written.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from mindstage.knowledge.vocabulary import (
    ANGULAR_CONSTRAINT,
    HAS_ANGULAR,
    HAS_LINEAR,
    HAS_POSE,
    LINEAR_CONSTRAINT,
    POSE,
)
from mindstage.knowledge.wording import words
from mindstage.knowledge.wording.statements import SubjectReader, SubjectWriter
from mindstage.knowledge.wording.words import PropertyCodec
from mindstage.world import AngularLimits, AxisMotion, Iri, LinearLimits, Pose, SoftLimit

__all__ = ["NESTED_ANGULAR_LIMITS", "NESTED_LINEAR_LIMITS", "NESTED_POSE", "NESTED_RESOURCES", "NestedResource"]

T = TypeVar("T")

_UNIT_TOLERANCE = 1e-3
"""Six digits, as maps write them, leave a norm a thousand times nearer to 1."""


@dataclass(frozen=True, slots=True)
class NestedResource(Generic[T]):
    """One kind of part."""

    property: Iri
    """Whole to part."""
    cls: Iri
    suffix: str
    """What a part without a name of its own is called, after the whole."""
    read: Callable[[SubjectReader], T | None]
    write: Callable[[SubjectWriter, T], None]


def _read_pose(reader: SubjectReader) -> Pose | None:
    position, quaternion = reader.read(words.TRANSLATION), reader.read(words.QUATERNION)
    for word, value in ((words.TRANSLATION, position), (words.QUATERNION, quaternion)):
        if value is None and not reader.indexes_of(word.property):
            reader.warn(word.property, "a pose does not tell it", "it is no pose then")
    if position is None or quaternion is None:
        return None
    norm = math.hypot(*quaternion)
    if abs(norm - 1.0) > _UNIT_TOLERANCE:
        what, did = f"the quaternion has the norm {norm:.6g} and not 1", "it is normalised where it is used"
        reader.warn(words.QUATERNION.property, what, did)
    x, y, z = position
    w, i, j, k = quaternion
    return Pose((x, y, z), (w, i, j, k))


def _write_pose(writer: SubjectWriter, pose: Pose) -> None:
    writer.write(words.QUATERNION, pose.quaternion)
    writer.write(words.TRANSLATION, pose.position)


def _read_motion(reader: SubjectReader, codec: PropertyCodec[AxisMotion]) -> AxisMotion:
    motion = reader.read(codec)
    if motion is None:
        reader.warn(codec.property, "nothing understandable is told", "it is taken as locked")
        return AxisMotion.LOCKED
    return motion


def _read_limit(reader: SubjectReader, codec: PropertyCodec[float], *motions: AxisMotion) -> float:
    limit = reader.read(codec)
    if limit is None and AxisMotion.LIMITED in motions:
        reader.warn(codec.property, "nothing understandable is told", "it is taken as 0")
    return limit or 0.0


def _read_center(reader: SubjectReader, codec: PropertyCodec[float]) -> float:
    """Not told is 0, and 0 is not told."""
    return reader.read(codec, keep_if=lambda middle: not middle) or 0.0


def _read_soft_limit(
    reader: SubjectReader, enabled: PropertyCodec[bool], stiffness: PropertyCodec[float], damping: PropertyCodec[float]
) -> SoftLimit:
    return SoftLimit(
        enabled=reader.read(enabled) or False,
        stiffness=reader.read(stiffness) or 0.0,
        damping=reader.read(damping) or 0.0,
    )


def _write_soft_limit(
    writer: SubjectWriter,
    soft: SoftLimit,
    enabled: PropertyCodec[bool],
    stiffness: PropertyCodec[float],
    damping: PropertyCodec[float],
) -> None:
    writer.write(enabled, soft.enabled)
    writer.write(stiffness, soft.stiffness)
    writer.write(damping, soft.damping)


def _read_linear(reader: SubjectReader) -> LinearLimits:
    x, y, z = (_read_motion(reader, word) for word in (words.X_MOTION, words.Y_MOTION, words.Z_MOTION))
    soft = _read_soft_limit(reader, words.SOFT, words.STIFFNESS, words.DAMPING)
    return LinearLimits(
        x=x,
        y=y,
        z=z,
        limit=_read_limit(reader, words.LIMIT, x, y, z),
        x_middle=_read_center(reader, words.X_MIDDLE),
        y_middle=_read_center(reader, words.Y_MIDDLE),
        z_middle=_read_center(reader, words.Z_MIDDLE),
        soft_limit=soft,
    )


def _write_linear(writer: SubjectWriter, linear: LinearLimits) -> None:
    writer.write(words.X_MOTION, linear.x)
    writer.write(words.Y_MOTION, linear.y)
    writer.write(words.Z_MOTION, linear.z)
    writer.write(words.LIMIT, linear.limit)
    writer.write(words.X_MIDDLE, linear.x_middle or None)
    writer.write(words.Y_MIDDLE, linear.y_middle or None)
    writer.write(words.Z_MIDDLE, linear.z_middle or None)
    _write_soft_limit(writer, linear.soft_limit, words.SOFT, words.STIFFNESS, words.DAMPING)


def _read_angular(reader: SubjectReader) -> AngularLimits:
    swing1, swing2, twist = (_read_motion(reader, word) for word in (words.SWING1, words.SWING2, words.TWIST))
    return AngularLimits(
        swing1=swing1,
        swing2=swing2,
        twist=twist,
        swing1_limit=_read_limit(reader, words.SWING1_LIMIT, swing1),
        swing2_limit=_read_limit(reader, words.SWING2_LIMIT, swing2),
        twist_limit=_read_limit(reader, words.TWIST_LIMIT, twist),
        swing1_middle=_read_center(reader, words.SWING1_MIDDLE),
        swing2_middle=_read_center(reader, words.SWING2_MIDDLE),
        twist_middle=_read_center(reader, words.TWIST_MIDDLE),
        swing_soft_limit=_read_soft_limit(reader, words.SWING_SOFT, words.SWING_STIFFNESS, words.SWING_DAMPING),
        twist_soft_limit=_read_soft_limit(reader, words.TWIST_SOFT, words.TWIST_STIFFNESS, words.TWIST_DAMPING),
    )


def _write_angular(writer: SubjectWriter, angular: AngularLimits) -> None:
    writer.write(words.SWING1, angular.swing1)
    writer.write(words.SWING2, angular.swing2)
    writer.write(words.TWIST, angular.twist)
    writer.write(words.SWING1_LIMIT, angular.swing1_limit)
    writer.write(words.SWING2_LIMIT, angular.swing2_limit)
    writer.write(words.TWIST_LIMIT, angular.twist_limit)
    writer.write(words.SWING1_MIDDLE, angular.swing1_middle or None)
    writer.write(words.SWING2_MIDDLE, angular.swing2_middle or None)
    writer.write(words.TWIST_MIDDLE, angular.twist_middle or None)
    _write_soft_limit(writer, angular.swing_soft_limit, words.SWING_SOFT, words.SWING_STIFFNESS, words.SWING_DAMPING)
    _write_soft_limit(writer, angular.twist_soft_limit, words.TWIST_SOFT, words.TWIST_STIFFNESS, words.TWIST_DAMPING)


NESTED_POSE = NestedResource(HAS_POSE, POSE, "pose", _read_pose, _write_pose)
NESTED_LINEAR_LIMITS = NestedResource(HAS_LINEAR, LINEAR_CONSTRAINT, "linear", _read_linear, _write_linear)
NESTED_ANGULAR_LIMITS = NestedResource(HAS_ANGULAR, ANGULAR_CONSTRAINT, "angular", _read_angular, _write_angular)
NESTED_RESOURCES: tuple[NestedResource[Any], ...] = (NESTED_POSE, NESTED_LINEAR_LIMITS, NESTED_ANGULAR_LIMITS)
