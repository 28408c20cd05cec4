"""Codecs between values of a world and statements, and the reader and writer of the statements about one subject.

Reading and writing are inverse: the first statement that a codec can decode gives the value, and a statement is only
consumed if writing the value reproduces it. A codec decodes more than it encodes ("Dynamic" and "dynamic", 1 and true);
a statement that it would not reproduce remains a fact besides the value, so that nothing is lost. Numbers are compared
by value.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, Generic, TypeVar

from mindstage.errors import MapWriteError
from mindstage.rdf import vocabulary
from mindstage.rdf.graphs import FindingSink, Severity
from mindstage.rdf.vocabulary import LABEL, UNTOLD, knowrob, ms, xsd
from mindstage.scene import AxisMotion, FactValue, Iri, IriRef, Literal, Mobility, PrimitiveType, PropertyAssertion

__all__ = [
    "ANGULAR_LIMITS",
    "ASSUMED",
    "ASSUMED_MOBILITY",
    "BOUNDING_BOX",
    "COLOR",
    "DISABLE_COLLISION",
    "GRAVITY",
    "ID",
    "INDEX",
    "INTENSITY",
    "LABEL_CODEC",
    "LINEAR_LIMITS",
    "MASS",
    "MATERIAL_NAME",
    "MATERIAL_PATH",
    "MESH",
    "MIMICS",
    "MIMIC_MULTIPLIER",
    "MIMIC_OFFSET",
    "MOBILITY",
    "OVERLAP_EVENTS",
    "QUATERNION",
    "SHAPE",
    "SIZE",
    "SOFT_LIMITS",
    "TRANSLATION",
    "PropertyCodec",
    "SubjectReader",
    "SubjectWriter",
    "literal_text",
    "parse_number",
]


T = TypeVar("T")
EnumT = TypeVar("EnumT", bound=Enum)

_NUMBER_PATTERN = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"
_NUMBER = re.compile(rf"\s*{_NUMBER_PATTERN}\s*", re.ASCII)
"""`float` would also accept "nan", "1_000" and non-ASCII digits."""
_INTEGER_TYPE = xsd("integer")
_BOOLEANS = {"true": True, "1": True, "false": False, "0": False}

_MAX_TEXT_LENGTH = 200
"""The number of characters of a literal that a finding repeats."""


@dataclass(frozen=True, slots=True)
class PropertyCodec(Generic[T]):
    """A property, with the conversion between its statements and values."""

    property: Iri
    expected: str
    """The expected value, for messages."""
    decode: Callable[[FactValue], T | None]
    encode: Callable[[T], FactValue]
    by_value: bool = False
    """Whether literals of its datatype with equal values are the same statement."""
    datatype: Iri | None = None
    repeatable: bool = False
    """Whether several statements are normal, such as a label in each language."""

    def first_value(self, facts: Iterable[PropertyAssertion]) -> T | None:
        """The first value in some statements; None if there is none."""
        values = (self.decode(fact.value) for fact in facts if fact.property == self.property)
        return next((value for value in values if value is not None), None)

    def round_trips(self, value: T, original: FactValue) -> bool:
        """Whether writing the value reproduces the original statement."""
        if self.by_value:
            return isinstance(original, Literal) and original.datatype == self.datatype
        return self.encode(value) == original


def parse_number(text: str) -> float | None:
    """Parses a finite number exactly; None for anything else."""
    if not _NUMBER.fullmatch(text):
        return None
    number = float(text)
    return number if math.isfinite(number) else None


def literal_text(value: FactValue) -> str | None:
    """The text of a literal of any datatype without a language; None for anything else."""
    return value.text if isinstance(value, Literal) and value.language is None else None


def _text(property: Iri) -> PropertyCodec[str]:
    return PropertyCodec(property, "a text", literal_text, Literal)


def _label(property: Iri) -> PropertyCodec[str]:
    def decode(value: FactValue) -> str | None:
        return value.text if isinstance(value, Literal) else None

    return PropertyCodec(property, "a text", decode, Literal, repeatable=True)


def _path(property: Iri) -> PropertyCodec[str]:
    def decode(value: FactValue) -> str | None:
        return value.iri if isinstance(value, IriRef) and not value.iri.startswith("_:") else literal_text(value)

    return PropertyCodec(property, "a path", decode, Literal)


def _enum(property: Iri, enum_type: type[EnumT]) -> PropertyCodec[EnumT]:
    names = {str(member.value): member for member in enum_type}

    def decode(value: FactValue) -> EnumT | None:
        text = literal_text(value)
        return None if text is None else names.get(text.strip().lower())

    return PropertyCodec(property, "one of " + ", ".join(names), decode, lambda member: Literal(str(member.value)))


def _boolean(property: Iri) -> PropertyCodec[bool]:
    def decode(value: FactValue) -> bool | None:
        text = literal_text(value)
        return None if text is None else _BOOLEANS.get(text.strip().lower())

    datatype = xsd("boolean")
    return PropertyCodec(property, "true or false", decode, lambda value: Literal(str(value).lower(), datatype))


def _reference(property: Iri) -> PropertyCodec[Iri]:
    def decode(value: FactValue) -> Iri | None:
        return value.iri if isinstance(value, IriRef) else None

    return PropertyCodec(property, "a resource", decode, IriRef)


def _number(property: Iri, *, datatype: str = "float", minimum: float = -math.inf) -> PropertyCodec[float]:
    def decode(value: FactValue) -> float | None:
        text = literal_text(value)
        number = None if text is None else parse_number(text)
        return number if number is not None and number >= minimum else None

    datatype_iri = xsd(datatype)
    what = "a finite number" if minimum else "a finite number of 0 or more"
    return PropertyCodec(
        property, what, decode, lambda number: Literal(repr(float(number)), datatype_iri), True, datatype_iri
    )


def _integer(property: Iri) -> PropertyCodec[int]:
    def decode(value: FactValue) -> int | None:
        text = literal_text(value)
        return int(text) if text is not None and re.fullmatch(r"\s*\d{1,9}\s*", text, re.ASCII) else None

    return PropertyCodec(
        property, "a whole number", decode, lambda number: Literal(str(number), _INTEGER_TYPE), True, _INTEGER_TYPE
    )


def _axis_motion(property: Iri) -> PropertyCodec[AxisMotion]:
    def decode(value: FactValue) -> AxisMotion | None:
        number = parse_number(literal_text(value) or "")
        return AxisMotion(int(number)) if number in set(AxisMotion) else None

    what = "0 (free), 1 (limited) or 2 (locked)"
    return PropertyCodec(
        property, what, decode, lambda motion: Literal(str(motion.value), _INTEGER_TYPE), True, _INTEGER_TYPE
    )


def _number_row(
    property: Iri, count: int, *, nonzero: bool = False, minimum: float = -math.inf
) -> PropertyCodec[tuple[float, ...]]:
    pattern = re.compile(r"\s*" + r"\s+".join([_NUMBER_PATTERN] * count) + r"\s*", re.ASCII)

    def decode(value: FactValue) -> tuple[float, ...] | None:
        text = literal_text(value)
        if text is None or not pattern.fullmatch(text):
            return None
        numbers = tuple(map(float, text.split()))
        length = math.hypot(*numbers)
        is_valid = math.isfinite(length) and (length > 0.0 or not nonzero) and min(numbers) >= minimum
        return numbers if is_valid else None

    def encode(numbers: tuple[float, ...]) -> Literal:
        return Literal(" ".join(repr(float(number)) for number in numbers))

    what = f"{count} finite numbers{' that are not all 0' if nonzero else ''}{'' if minimum else ' of 0 or more'}"
    return PropertyCodec(property, what, decode, encode, by_value=True)


# -- codecs ------------------------------------------------------------------------------------------------------------

ID = _text(ms("id"))
LABEL_CODEC = _label(LABEL)
MESH = _path(knowrob("pathToCadModel"))
SHAPE = _enum(ms("shape"), PrimitiveType)

MOBILITY = _enum(knowrob("mobility"), Mobility)
ASSUMED_MOBILITY = _enum(vocabulary.ASSUMED_MOBILITY, Mobility)
"""A mobility that no map states; see `BodyPhysics.assumed`."""
ASSUMED = _text(vocabulary.ASSUMED)
"""What of a joint no map states: the names of `Joint.assumed`, separated by spaces."""
GRAVITY = _boolean(knowrob("gravity"))
OVERLAP_EVENTS = _boolean(knowrob("overlapEvents"))
MASS = _number(knowrob("mass"), minimum=0.0)

SIZE = (
    _number(knowrob("depthOfObject"), minimum=0.0),
    _number(knowrob("widthOfObject"), minimum=0.0),
    _number(knowrob("heightOfObject"), minimum=0.0),
)
"""Along x, y and z [m]."""
BOUNDING_BOX = _number_row(knowrob("boundingBoxSize"), 3, minimum=0.0)
"""The same three extents as one text; read only, since `SIZE` takes precedence."""

TRANSLATION = _number_row(knowrob("translation"), 3)
QUATERNION = _number_row(knowrob("quaternion"), 4, nonzero=True)

LINEAR_LIMITS: dict[str, PropertyCodec[Any]] = {
    **{axis: _axis_motion(knowrob(f"{axis}Motion")) for axis in ("x", "y", "z")},
    "limit": _number(knowrob("limit"), minimum=0.0),
    **{f"{axis}_middle": _number(ms(f"{axis}Middle")) for axis in ("x", "y", "z")},
}
"""By the fields of `scene.LinearLimits`, in the order in which they are written."""
ANGULAR_LIMITS: dict[str, PropertyCodec[Any]] = {
    **{axis: _axis_motion(knowrob(f"{axis}Motion")) for axis in ("swing1", "swing2", "twist")},
    **{f"{axis}_limit": _number(knowrob(f"{axis}Limit"), minimum=0.0) for axis in ("swing1", "swing2", "twist")},
    **{f"{axis}_middle": _number(ms(f"{axis}Middle")) for axis in ("swing1", "swing2", "twist")},
}
"""By the fields of `scene.AngularLimits`, in the order in which they are written."""
SOFT_LIMITS: dict[str, dict[str, PropertyCodec[Any]]] = {
    field: {
        "enabled": _boolean(knowrob(names[0])),
        "stiffness": _number(knowrob(names[1])),
        "damping": _number(knowrob(names[2])),
    }
    for field, *names in (
        ("soft_limit", "softConstraint", "stiffness", "damping"),
        ("swing_soft_limit", "softSwingConstraint", "swingStiffness", "swingDamping"),
        ("twist_soft_limit", "softTwistConstraint", "twistStiffness", "twistDamping"),
    )
}
"""By the fields of these two, then by those of `scene.SoftLimit`."""

MIMICS = _reference(ms("mimics"))
"""From a joint to the joint that it follows."""
MIMIC_MULTIPLIER = _number(ms("mimicMultiplier"), datatype="double")
MIMIC_OFFSET = _number(ms("mimicOffset"), datatype="double")
DISABLE_COLLISION = _boolean(ms("disableCollision"))
COLOR = _number_row(ms("colour"), 3)
INTENSITY = _number(ms("intensity"), datatype="double")
INDEX = _integer(ms("index"))
MATERIAL_NAME = _text(ms("name"))
MATERIAL_PATH = _text(ms("path"))


class SubjectReader:
    """Reads the statements about one subject, and records which of them were consumed."""

    def __init__(
        self, subject: Iri, facts: Sequence[PropertyAssertion], report: FindingSink, *, is_nested: bool = False
    ) -> None:
        """Indexes the statements.

        Args:
            facts: the statements about it.
            report: receives findings.
            is_nested: whether it is a nested resource, which cannot have `ms:untold`.
        """
        self.subject = subject
        self.facts = facts
        self.report = report
        self._indexes: dict[Iri, list[int]] = {}
        self._consumed: set[int] = set()
        self._leading: list[int] = []
        self._is_nested = is_nested
        at = self._indexes
        for index, fact in enumerate(facts):
            if (places := at.get(fact.property)) is None:
                at[fact.property] = [index]
            else:
                places.append(index)
        marked = UNTOLD in at and not is_nested
        self._untold_marks = {iri: index for index, iri in self.references(UNTOLD)} if marked else {}

    def indexes_of(self, property: Iri) -> Sequence[int]:
        """The indexes of the statements with a property."""
        return self._indexes.get(property, ())

    def is_marked_untold(self, property: Iri) -> bool:
        """Whether `ms:untold` says that the property sets no field."""
        return property in self._untold_marks

    def consume_untold_mark(self, property: Iri) -> None:
        """Consumes the `ms:untold` of a property, which the writer will add again."""
        if property in self._untold_marks:
            self._consumed.add(self._untold_marks[property])

    def first_value(self, codec: PropertyCodec[T]) -> T | None:
        """The value that the statements have for a codec, regardless of `ms:untold`."""
        return codec.first_value(self.facts[index] for index in self.indexes_of(codec.property))

    def references(self, property: Iri) -> Iterator[tuple[int, Iri]]:
        """The statements of a property whose values are resources: index and IRI."""
        for index in self.indexes_of(property):
            value = self.facts[index].value
            if isinstance(value, IriRef):
                yield index, value.iri

    def consume(self, *indexes: int) -> None:
        """Marks statements as represented in the world."""
        self._consumed.update(indexes)

    def consume_references(self, property: Iri, *iris: Iri) -> None:
        """Consumes the statements of a property with these values, which are implied."""
        for index in self._indexes.get(property, ()):
            value = self.facts[index].value
            if isinstance(value, IriRef) and value.iri in iris:
                self._consumed.add(index)

    def read(self, codec: PropertyCodec[T], *, keep_if: Callable[[T], bool] | None = None) -> T | None:
        """Reads the value of a codec; None if there is no valid statement.

        Args:
            codec: the property to read.
            keep_if: whether the statement of a value remains a fact nevertheless.
        """
        places = self._indexes.get(codec.property)
        if places is None:
            return None
        if len(places) == 1 and keep_if is None and not self._untold_marks:
            return self._only_value(codec, places[0])
        if codec.property in self._untold_marks:
            if self.first_value(codec) is not None:
                self.consume_untold_mark(codec.property)
            return None
        found: T | None = None
        repeated: list[int] = []
        stays: T | None = None
        for index in places:
            term = self.facts[index].value
            value = codec.decode(term)
            if value is None:
                self.warn(codec.property, _type_error(codec, term), "it stays a fact and is not used")
                continue
            if found is None:
                found = value
            elif value != found and not codec.repeatable:
                self.warn(codec.property, "it has different values", "the first is used, the others stay facts")
            if value == found and codec.round_trips(value, term) and not (keep_if and keep_if(value)):
                repeated.append(index)
            elif stays is None:
                stays = value
        if self._is_nested or stays != found:
            self._consumed.update(repeated)  # a remaining fact with the same value is all that would be written
        return found

    def _only_value(self, codec: PropertyCodec[T], index: int) -> T | None:
        """Reads the value of the only statement, which is the usual case."""
        term = self.facts[index].value
        value = codec.decode(term)
        if value is None:
            self.warn(codec.property, _type_error(codec, term), "it stays a fact and is not used")
        elif codec.round_trips(value, term):
            self._consumed.add(index)
        return value

    def mark_leading(self, index: int) -> None:
        """Marks the statement that is used among several of its property: it remains, and comes first."""
        if self._indexes[self.facts[index].property][0] != index:
            self._leading.append(index)

    def remaining(self) -> tuple[PropertyAssertion, ...]:
        """The statements that were not consumed."""
        leading = self._leading
        if len(self._consumed) == len(self.facts):
            return ()
        rest = (index for index in range(len(self.facts)) if index not in self._consumed and index not in leading)
        return tuple(self.facts[index] for index in (*leading, *rest))

    def warn(self, property: str, problem: str, action: str) -> None:
        """Reports a warning about the subject."""
        self.report(Severity.WARNING, self.subject, property, problem, action)


def _type_error(codec: PropertyCodec[Any], value: FactValue) -> str:
    if not isinstance(value, Literal):
        return f"its value is not {codec.expected}"
    text = value.text if len(value.text) <= _MAX_TEXT_LENGTH else f"{value.text[:_MAX_TEXT_LENGTH]}…"
    has_comma = "number" in codec.expected and re.search(r"\d,\d", text)
    return f"{text!r} is not {codec.expected}{'; decimals have a point, not a comma' if has_comma else ''}"


class SubjectWriter:
    """Collects the statements about one subject."""

    def __init__(self, subject: Iri, facts: Sequence[PropertyAssertion] = ()) -> None:
        """Creates a writer.

        Args:
            facts: its facts, which are written after everything else.
        """
        self.subject = subject
        self._facts = facts
        self._written: list[PropertyAssertion] = []

    def add_reference(self, property: Iri, iri: Iri) -> None:
        """Adds a statement between two resources."""
        self._written.append(PropertyAssertion(property, IriRef(iri)))

    def add_fact(self, fact: PropertyAssertion) -> None:
        """Adds a statement."""
        self._written.append(fact)

    def first_value(self, codec: PropertyCodec[T]) -> T | None:
        """The value that the facts have for a codec."""
        return codec.first_value(self._facts)

    def write(self, codec: PropertyCodec[T], value: T | None) -> None:
        """Writes a value; None writes nothing.

        If the facts have the same value already, nothing is written; if they have a value that the world does not have,
        the property is marked with `ms:untold`.

        Raises:
            MapWriteError: the value cannot be read back, such as an infinite mass.
        """
        if value is None and not self._facts:
            return
        existing = self.first_value(codec)
        if existing is not None and value is None:
            self.add_reference(UNTOLD, codec.property)
        elif value is not None and existing != value:
            term = codec.encode(value)
            if codec.decode(term) != value:
                what = f"the value {value!r} of {codec.property}"
                raise MapWriteError(self.subject, cause=f"{what} is not {codec.expected}")
            self._written.append(PropertyAssertion(codec.property, term))

    def all_facts(self) -> list[PropertyAssertion]:
        """All statements, the facts last."""
        return [*self._written, *self._facts]
