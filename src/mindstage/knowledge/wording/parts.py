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
from mindstage.knowledge.wording.statements import Heard, Said
from mindstage.knowledge.wording.words import Word
from mindstage.world import AngularMotion, Iri, LinearMotion, Motion, Pose, Soft

__all__ = ["ANGULAR_PART", "LINEAR_PART", "PARTS", "POSE_PART", "Part"]

T = TypeVar("T")

_OFF_UNIT = 1e-3
"""Six digits, as maps write them, leave a norm a thousand times nearer to 1."""


@dataclass(frozen=True, slots=True)
class Part(Generic[T]):
    """One kind of part."""

    property: Iri
    """Whole to part."""
    cls: Iri
    suffix: str
    """What a part without a name of its own is called, after the whole."""
    read: Callable[[Heard], T | None]
    write: Callable[[Said, T], None]


def _read_pose(heard: Heard) -> Pose | None:
    position, quaternion = heard.value(words.TRANSLATION), heard.value(words.QUATERNION)
    for word, value in ((words.TRANSLATION, position), (words.QUATERNION, quaternion)):
        if value is None and not heard.at(word.property):
            heard.warn(word.property, "a pose does not tell it", "it is no pose then")
    if position is None or quaternion is None:
        return None
    norm = math.hypot(*quaternion)
    if abs(norm - 1.0) > _OFF_UNIT:
        what, did = f"the quaternion has the norm {norm:.6g} and not 1", "it is normalised where it is used"
        heard.warn(words.QUATERNION.property, what, did)
    x, y, z = position
    w, i, j, k = quaternion
    return Pose((x, y, z), (w, i, j, k))


def _write_pose(said: Said, pose: Pose) -> None:
    said.value(words.QUATERNION, pose.quaternion)
    said.value(words.TRANSLATION, pose.position)


def _motion(heard: Heard, word: Word[Motion]) -> Motion:
    motion = heard.value(word)
    if motion is None:
        heard.warn(word.property, "nothing understandable is told", "it is taken as locked")
        return Motion.LOCKED
    return motion


def _limit(heard: Heard, word: Word[float], *motions: Motion) -> float:
    limit = heard.value(word)
    if limit is None and Motion.LIMITED in motions:
        heard.warn(word.property, "nothing understandable is told", "it is taken as 0")
    return limit or 0.0


def _middle(heard: Heard, word: Word[float]) -> float:
    """Not told is 0, and 0 is not told."""
    return heard.value(word, keep=lambda middle: not middle) or 0.0


def _soft(heard: Heard, enabled: Word[bool], stiffness: Word[float], damping: Word[float]) -> Soft:
    return Soft(
        enabled=heard.value(enabled) or False,
        stiffness=heard.value(stiffness) or 0.0,
        damping=heard.value(damping) or 0.0,
    )


def _write_soft(said: Said, soft: Soft, enabled: Word[bool], stiffness: Word[float], damping: Word[float]) -> None:
    said.value(enabled, soft.enabled)
    said.value(stiffness, soft.stiffness)
    said.value(damping, soft.damping)


def _read_linear(heard: Heard) -> LinearMotion:
    x, y, z = (_motion(heard, word) for word in (words.X_MOTION, words.Y_MOTION, words.Z_MOTION))
    soft = _soft(heard, words.SOFT, words.STIFFNESS, words.DAMPING)
    return LinearMotion(
        x=x,
        y=y,
        z=z,
        limit=_limit(heard, words.LIMIT, x, y, z),
        x_middle=_middle(heard, words.X_MIDDLE),
        y_middle=_middle(heard, words.Y_MIDDLE),
        z_middle=_middle(heard, words.Z_MIDDLE),
        soft=soft,
    )


def _write_linear(said: Said, linear: LinearMotion) -> None:
    said.value(words.X_MOTION, linear.x)
    said.value(words.Y_MOTION, linear.y)
    said.value(words.Z_MOTION, linear.z)
    said.value(words.LIMIT, linear.limit)
    said.value(words.X_MIDDLE, linear.x_middle or None)
    said.value(words.Y_MIDDLE, linear.y_middle or None)
    said.value(words.Z_MIDDLE, linear.z_middle or None)
    _write_soft(said, linear.soft, words.SOFT, words.STIFFNESS, words.DAMPING)


def _read_angular(heard: Heard) -> AngularMotion:
    swing1, swing2, twist = (_motion(heard, word) for word in (words.SWING1, words.SWING2, words.TWIST))
    return AngularMotion(
        swing1=swing1,
        swing2=swing2,
        twist=twist,
        swing1_limit=_limit(heard, words.SWING1_LIMIT, swing1),
        swing2_limit=_limit(heard, words.SWING2_LIMIT, swing2),
        twist_limit=_limit(heard, words.TWIST_LIMIT, twist),
        swing1_middle=_middle(heard, words.SWING1_MIDDLE),
        swing2_middle=_middle(heard, words.SWING2_MIDDLE),
        twist_middle=_middle(heard, words.TWIST_MIDDLE),
        swing_soft=_soft(heard, words.SWING_SOFT, words.SWING_STIFFNESS, words.SWING_DAMPING),
        twist_soft=_soft(heard, words.TWIST_SOFT, words.TWIST_STIFFNESS, words.TWIST_DAMPING),
    )


def _write_angular(said: Said, angular: AngularMotion) -> None:
    said.value(words.SWING1, angular.swing1)
    said.value(words.SWING2, angular.swing2)
    said.value(words.TWIST, angular.twist)
    said.value(words.SWING1_LIMIT, angular.swing1_limit)
    said.value(words.SWING2_LIMIT, angular.swing2_limit)
    said.value(words.TWIST_LIMIT, angular.twist_limit)
    said.value(words.SWING1_MIDDLE, angular.swing1_middle or None)
    said.value(words.SWING2_MIDDLE, angular.swing2_middle or None)
    said.value(words.TWIST_MIDDLE, angular.twist_middle or None)
    _write_soft(said, angular.swing_soft, words.SWING_SOFT, words.SWING_STIFFNESS, words.SWING_DAMPING)
    _write_soft(said, angular.twist_soft, words.TWIST_SOFT, words.TWIST_STIFFNESS, words.TWIST_DAMPING)


POSE_PART = Part(HAS_POSE, POSE, "pose", _read_pose, _write_pose)
LINEAR_PART = Part(HAS_LINEAR, LINEAR_CONSTRAINT, "linear", _read_linear, _write_linear)
ANGULAR_PART = Part(HAS_ANGULAR, ANGULAR_CONSTRAINT, "angular", _read_angular, _write_angular)
PARTS: tuple[Part[Any], ...] = (POSE_PART, LINEAR_PART, ANGULAR_PART)
