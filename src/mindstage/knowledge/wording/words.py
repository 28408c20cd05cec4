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
from mindstage.world import AxisMotion, FactValue, Iri, IriRef, Literal, Mobility, PrimitiveType, PropertyAssertion

__all__ = [
    "COLOR",
    "DAMPING",
    "DISABLE_COLLISION",
    "GRAVITY",
    "ID",
    "INDEX",
    "INTENSITY",
    "LABEL_CODEC",
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
    "PropertyCodec",
    "literal_text",
    "parse_number",
]

T = TypeVar("T")
EnumT = TypeVar("EnumT", bound=Enum)

_NUMBER_PATTERN = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"
_NUMBER = re.compile(rf"\s*{_NUMBER_PATTERN}\s*", re.ASCII)
"""Python itself would also take "nan", "1_000" and digits from all over the world."""
_INTEGER_TYPE = xsd("integer")
_BOOLEANS = {"true": True, "1": True, "false": False, "0": False}


@dataclass(frozen=True, slots=True)
class PropertyCodec(Generic[T]):
    """One property, and what its values mean."""

    property: Iri
    expected: str
    """What a value must be, for those who write something else."""
    decode: Callable[[FactValue], T | None]
    encode: Callable[[T], FactValue]
    by_value: bool = False
    """Whether texts of its datatype that mean the same are the same statement."""
    datatype: Iri | None = None
    repeatable: bool = False
    """Whether it is usual to tell it more than once, such as a label in each language."""

    def first_value(self, facts: Iterable[PropertyAssertion]) -> T | None:
        """The first value that some facts give it."""
        values = (self.decode(fact.value) for fact in facts if fact.property == self.property)
        return next((value for value in values if value is not None), None)

    def round_trips(self, value: T, original: FactValue) -> bool:
        """Whether saying the value gives back what was told."""
        if self.by_value:
            return isinstance(original, Literal) and original.datatype == self.datatype
        return self.encode(value) == original


def parse_number(text: str) -> float | None:
    """A finite number, exactly; None for anything else."""
    if not _NUMBER.fullmatch(text):
        return None
    number = float(text)
    return number if math.isfinite(number) else None


def literal_text(value: FactValue) -> str | None:
    """The text of a literal of any type, but in no particular language."""
    return value.text if isinstance(value, Literal) and value.language is None else None


def _text(property: Iri) -> PropertyCodec[str]:
    return PropertyCodec(property, "a text", literal_text, Literal)


def _label(property: Iri) -> PropertyCodec[str]:
    def understand(value: FactValue) -> str | None:
        return value.text if isinstance(value, Literal) else None

    return PropertyCodec(property, "a text", understand, Literal, repeatable=True)


def _path(property: Iri) -> PropertyCodec[str]:
    def understand(value: FactValue) -> str | None:
        return value.iri if isinstance(value, IriRef) and not value.iri.startswith("_:") else literal_text(value)

    return PropertyCodec(property, "a path", understand, Literal)


def _enum(property: Iri, enum_type: type[EnumT]) -> PropertyCodec[EnumT]:
    names = {str(kind.value): kind for kind in enum_type}

    def understand(value: FactValue) -> EnumT | None:
        text = literal_text(value)
        return None if text is None else names.get(text.strip().lower())

    return PropertyCodec(property, "one of " + ", ".join(names), understand, lambda kind: Literal(str(kind.value)))


def _boolean(property: Iri) -> PropertyCodec[bool]:
    def understand(value: FactValue) -> bool | None:
        text = literal_text(value)
        return None if text is None else _BOOLEANS.get(text.strip().lower())

    datatype = xsd("boolean")
    return PropertyCodec(property, "true or false", understand, lambda told: Literal(str(told).lower(), datatype))


def _number(property: Iri, *, datatype: str = "float", minimum: float = -math.inf) -> PropertyCodec[float]:
    def understand(value: FactValue) -> float | None:
        text = literal_text(value)
        number = None if text is None else parse_number(text)
        return number if number is not None and number >= minimum else None

    kind = xsd(datatype)
    what = "a finite number" if minimum else "a finite number of 0 or more"
    return PropertyCodec(property, what, understand, lambda number: Literal(repr(float(number)), kind), True, kind)


def _integer(property: Iri) -> PropertyCodec[int]:
    def understand(value: FactValue) -> int | None:
        text = literal_text(value)
        return int(text) if text is not None and re.fullmatch(r"\s*\d{1,9}\s*", text, re.ASCII) else None

    return PropertyCodec(
        property, "a whole number", understand, lambda number: Literal(str(number), _INTEGER_TYPE), True, _INTEGER_TYPE
    )


def _axis_motion(property: Iri) -> PropertyCodec[AxisMotion]:
    def understand(value: FactValue) -> AxisMotion | None:
        number = parse_number(literal_text(value) or "")
        return AxisMotion(int(number)) if number in set(AxisMotion) else None

    what = "0 (free), 1 (limited) or 2 (locked)"
    return PropertyCodec(
        property, what, understand, lambda motion: Literal(str(motion.value), _INTEGER_TYPE), True, _INTEGER_TYPE
    )


def _number_row(property: Iri, count: int, *, nonzero: bool = False) -> PropertyCodec[tuple[float, ...]]:
    pattern = re.compile(r"\s*" + r"\s+".join([_NUMBER_PATTERN] * count) + r"\s*", re.ASCII)

    def understand(value: FactValue) -> tuple[float, ...] | None:
        text = literal_text(value)
        if text is None or not pattern.fullmatch(text):
            return None
        numbers = tuple(map(float, text.split()))
        length = math.hypot(*numbers)
        return numbers if math.isfinite(length) and (length > 0.0 or not nonzero) else None

    def say(numbers: tuple[float, ...]) -> Literal:
        return Literal(" ".join(repr(float(number)) for number in numbers))

    what = f"{count} finite numbers" + (" that are not all 0" if nonzero else "")
    return PropertyCodec(property, what, understand, say, by_value=True)


# -- the words ---------------------------------------------------------------------------------------------------------

ID = _text(ms("id"))
LABEL_CODEC = _label(LABEL)
MESH = _path(knowrob("pathToCadModel"))
SHAPE = _enum(ms("shape"), PrimitiveType)

MOBILITY = _enum(knowrob("mobility"), Mobility)
GRAVITY = _boolean(knowrob("gravity"))
OVERLAP_EVENTS = _boolean(knowrob("overlapEvents"))
MASS = _number(knowrob("mass"), minimum=0.0)

SIZE = (
    _number(knowrob("depthOfObject"), minimum=0.0),
    _number(knowrob("widthOfObject"), minimum=0.0),
    _number(knowrob("heightOfObject"), minimum=0.0),
)
"""Along x, y and z."""

TRANSLATION = _number_row(knowrob("translation"), 3)
QUATERNION = _number_row(knowrob("quaternion"), 4, nonzero=True)

X_MOTION = _axis_motion(knowrob("xMotion"))
Y_MOTION = _axis_motion(knowrob("yMotion"))
Z_MOTION = _axis_motion(knowrob("zMotion"))
LIMIT = _number(knowrob("limit"), minimum=0.0)
SOFT = _boolean(knowrob("softConstraint"))
STIFFNESS = _number(knowrob("stiffness"))
DAMPING = _number(knowrob("damping"))

SWING1 = _axis_motion(knowrob("swing1Motion"))
SWING2 = _axis_motion(knowrob("swing2Motion"))
TWIST = _axis_motion(knowrob("twistMotion"))
SWING1_LIMIT = _number(knowrob("swing1Limit"), minimum=0.0)
SWING2_LIMIT = _number(knowrob("swing2Limit"), minimum=0.0)
TWIST_LIMIT = _number(knowrob("twistLimit"), minimum=0.0)
SWING_SOFT = _boolean(knowrob("softSwingConstraint"))
SWING_STIFFNESS = _number(knowrob("swingStiffness"))
SWING_DAMPING = _number(knowrob("swingDamping"))
TWIST_SOFT = _boolean(knowrob("softTwistConstraint"))
TWIST_STIFFNESS = _number(knowrob("twistStiffness"))
TWIST_DAMPING = _number(knowrob("twistDamping"))

X_MIDDLE = _number(ms("xMiddle"))
Y_MIDDLE = _number(ms("yMiddle"))
Z_MIDDLE = _number(ms("zMiddle"))
SWING1_MIDDLE = _number(ms("swing1Middle"))
SWING2_MIDDLE = _number(ms("swing2Middle"))
TWIST_MIDDLE = _number(ms("twistMiddle"))

DISABLE_COLLISION = _boolean(ms("disableCollision"))
COLOR = _number_row(ms("colour"), 3)
INTENSITY = _number(ms("intensity"), datatype="double")
INDEX = _integer(ms("index"))
MATERIAL_NAME = _text(ms("name"))
MATERIAL_PATH = _text(ms("path"))
