"""Words: how one value of a world is said by one statement, and understood again.

A word understands more than it says ("Dynamic" and "dynamic", 1 and true). What it would not say again in the same
way stays a fact beside the value, so that nothing is lost; numbers are the same when their values are.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Generic, TypeVar

from mindstage.knowledge.vocabulary import LABEL, knowrob, ms, xsd
from mindstage.world import Fact, FactValue, Iri, Literal, Mobility, Motion, Reference, ShapeKind

__all__ = [
    "COLOUR",
    "DAMPING",
    "DISABLE_COLLISION",
    "GRAVITY",
    "ID",
    "INDEX",
    "INTENSITY",
    "LABEL_WORD",
    "LIMIT",
    "MASS",
    "MATERIAL_NAME",
    "MATERIAL_PATH",
    "MESH",
    "MOBILITY",
    "OVERLAP_EVENTS",
    "QUATERNION",
    "SHAPE",
    "SIZE",
    "SOFT",
    "STIFFNESS",
    "SWING1",
    "SWING1_LIMIT",
    "SWING1_MIDDLE",
    "SWING2",
    "SWING2_LIMIT",
    "SWING2_MIDDLE",
    "SWING_DAMPING",
    "SWING_SOFT",
    "SWING_STIFFNESS",
    "TRANSLATION",
    "TWIST",
    "TWIST_DAMPING",
    "TWIST_LIMIT",
    "TWIST_MIDDLE",
    "TWIST_SOFT",
    "TWIST_STIFFNESS",
    "X_MIDDLE",
    "X_MOTION",
    "Y_MIDDLE",
    "Y_MOTION",
    "Z_MIDDLE",
    "Z_MOTION",
    "Word",
    "number_in",
    "text_in",
]

T = TypeVar("T")
Kind = TypeVar("Kind", bound=Enum)

_NUMBER_PATTERN = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"
_NUMBER = re.compile(rf"\s*{_NUMBER_PATTERN}\s*", re.ASCII)
"""Python itself would also take "nan", "1_000" and digits from all over the world."""
_INTEGER = xsd("integer")
_TRUTH = {"true": True, "1": True, "false": False, "0": False}


@dataclass(frozen=True, slots=True)
class Word(Generic[T]):
    """One property, and what its values mean."""

    property: Iri
    what: str
    """What a value must be, for those who write something else."""
    understand: Callable[[FactValue], T | None]
    say: Callable[[T], FactValue]
    by_value: bool = False
    """Whether texts of its datatype that mean the same are the same statement."""
    datatype: Iri | None = None
    often: bool = False
    """Whether it is usual to tell it more than once, such as a label in each language."""

    def first(self, facts: Iterable[Fact]) -> T | None:
        """The first value that some facts give it."""
        values = (self.understand(fact.value) for fact in facts if fact.property == self.property)
        return next((value for value in values if value is not None), None)

    def repeats(self, value: T, told: FactValue) -> bool:
        """Whether saying the value gives back what was told."""
        if self.by_value:
            return isinstance(told, Literal) and told.datatype == self.datatype
        return self.say(value) == told


def number_in(text: str) -> float | None:
    """A finite number, exactly; None for anything else."""
    if not _NUMBER.fullmatch(text):
        return None
    number = float(text)
    return number if math.isfinite(number) else None


def text_in(value: FactValue) -> str | None:
    """The text of a literal of any type, but in no particular language."""
    return value.text if isinstance(value, Literal) and value.language is None else None


def _text(property: Iri) -> Word[str]:
    return Word(property, "a text", text_in, Literal)


def _label(property: Iri) -> Word[str]:
    def understand(value: FactValue) -> str | None:
        return value.text if isinstance(value, Literal) else None

    return Word(property, "a text", understand, Literal, often=True)


def _path(property: Iri) -> Word[str]:
    def understand(value: FactValue) -> str | None:
        return value.iri if isinstance(value, Reference) and not value.iri.startswith("_:") else text_in(value)

    return Word(property, "a path", understand, Literal)


def _one_of(property: Iri, kinds: type[Kind]) -> Word[Kind]:
    names = {str(kind.value): kind for kind in kinds}

    def understand(value: FactValue) -> Kind | None:
        text = text_in(value)
        return None if text is None else names.get(text.strip().lower())

    return Word(property, "one of " + ", ".join(names), understand, lambda kind: Literal(str(kind.value)))


def _truth(property: Iri) -> Word[bool]:
    def understand(value: FactValue) -> bool | None:
        text = text_in(value)
        return None if text is None else _TRUTH.get(text.strip().lower())

    datatype = xsd("boolean")
    return Word(property, "true or false", understand, lambda told: Literal(str(told).lower(), datatype))


def _number(property: Iri, *, datatype: str = "float", least: float = -math.inf) -> Word[float]:
    def understand(value: FactValue) -> float | None:
        text = text_in(value)
        number = None if text is None else number_in(text)
        return number if number is not None and number >= least else None

    kind = xsd(datatype)
    what = "a finite number" if least else "a finite number of 0 or more"
    return Word(property, what, understand, lambda number: Literal(repr(float(number)), kind), True, kind)


def _whole_number(property: Iri) -> Word[int]:
    def understand(value: FactValue) -> int | None:
        text = text_in(value)
        return int(text) if text is not None and re.fullmatch(r"\s*\d{1,9}\s*", text, re.ASCII) else None

    return Word(property, "a whole number", understand, lambda number: Literal(str(number), _INTEGER), True, _INTEGER)


def _motion(property: Iri) -> Word[Motion]:
    def understand(value: FactValue) -> Motion | None:
        number = number_in(text_in(value) or "")
        return Motion(int(number)) if number in set(Motion) else None

    what = "0 (free), 1 (limited) or 2 (locked)"
    return Word(property, what, understand, lambda motion: Literal(str(motion.value), _INTEGER), True, _INTEGER)


def _numbers(property: Iri, count: int, *, nonzero: bool = False) -> Word[tuple[float, ...]]:
    pattern = re.compile(r"\s*" + r"\s+".join([_NUMBER_PATTERN] * count) + r"\s*", re.ASCII)

    def understand(value: FactValue) -> tuple[float, ...] | None:
        text = text_in(value)
        if text is None or not pattern.fullmatch(text):
            return None
        numbers = tuple(map(float, text.split()))
        length = math.hypot(*numbers)
        return numbers if math.isfinite(length) and (length > 0.0 or not nonzero) else None

    def say(numbers: tuple[float, ...]) -> Literal:
        return Literal(" ".join(repr(float(number)) for number in numbers))

    what = f"{count} finite numbers" + (" that are not all 0" if nonzero else "")
    return Word(property, what, understand, say, by_value=True)


# -- the words ---------------------------------------------------------------------------------------------------------

ID = _text(ms("id"))
LABEL_WORD = _label(LABEL)
MESH = _path(knowrob("pathToCadModel"))
SHAPE = _one_of(ms("shape"), ShapeKind)

MOBILITY = _one_of(knowrob("mobility"), Mobility)
GRAVITY = _truth(knowrob("gravity"))
OVERLAP_EVENTS = _truth(knowrob("overlapEvents"))
MASS = _number(knowrob("mass"), least=0.0)

SIZE = (
    _number(knowrob("depthOfObject"), least=0.0),
    _number(knowrob("widthOfObject"), least=0.0),
    _number(knowrob("heightOfObject"), least=0.0),
)
"""Along x, y and z."""

TRANSLATION = _numbers(knowrob("translation"), 3)
QUATERNION = _numbers(knowrob("quaternion"), 4, nonzero=True)

X_MOTION = _motion(knowrob("xMotion"))
Y_MOTION = _motion(knowrob("yMotion"))
Z_MOTION = _motion(knowrob("zMotion"))
LIMIT = _number(knowrob("limit"), least=0.0)
SOFT = _truth(knowrob("softConstraint"))
STIFFNESS = _number(knowrob("stiffness"))
DAMPING = _number(knowrob("damping"))

SWING1 = _motion(knowrob("swing1Motion"))
SWING2 = _motion(knowrob("swing2Motion"))
TWIST = _motion(knowrob("twistMotion"))
SWING1_LIMIT = _number(knowrob("swing1Limit"), least=0.0)
SWING2_LIMIT = _number(knowrob("swing2Limit"), least=0.0)
TWIST_LIMIT = _number(knowrob("twistLimit"), least=0.0)
SWING_SOFT = _truth(knowrob("softSwingConstraint"))
SWING_STIFFNESS = _number(knowrob("swingStiffness"))
SWING_DAMPING = _number(knowrob("swingDamping"))
TWIST_SOFT = _truth(knowrob("softTwistConstraint"))
TWIST_STIFFNESS = _number(knowrob("twistStiffness"))
TWIST_DAMPING = _number(knowrob("twistDamping"))

X_MIDDLE = _number(ms("xMiddle"))
Y_MIDDLE = _number(ms("yMiddle"))
Z_MIDDLE = _number(ms("zMiddle"))
SWING1_MIDDLE = _number(ms("swing1Middle"))
SWING2_MIDDLE = _number(ms("swing2Middle"))
TWIST_MIDDLE = _number(ms("twistMiddle"))

DISABLE_COLLISION = _truth(ms("disableCollision"))
COLOUR = _numbers(ms("colour"), 3)
INTENSITY = _number(ms("intensity"), datatype="double")
INDEX = _whole_number(ms("index"))
MATERIAL_NAME = _text(ms("name"))
MATERIAL_PATH = _text(ms("path"))
