"""Statements about one thing: words take their values out of them while reading, and put them in while writing.

The two sides keep one rule, which makes reading undo writing: the first statement that a word understands gives the
value, and a statement is only taken away if saying the value would give it back.

Words: how one value of a world is said by one statement, and understood again.

A word understands more than it says ("Dynamic" and "dynamic", 1 and true). What it would not say again in the same
way stays a fact beside the value, so that nothing is lost; numbers are the same when their values are.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, Generic, TypeVar

from mindstage.errors import MapWriteError
from mindstage.knowledge.rdf import FindingSink, Severity
from mindstage.knowledge.vocabulary import LABEL, UNTOLD, knowrob, ms, xsd
from mindstage.scene import AxisMotion, FactValue, Iri, IriRef, Literal, Mobility, PrimitiveType, PropertyAssertion

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
    "SubjectReader",
    "SubjectWriter",
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


_MAX_TEXT_LENGTH = 200
"""A text of more characters is cut short in a finding."""


class SubjectReader:
    """What is said about one thing, while it is read."""

    def __init__(
        self, subject: Iri, facts: Sequence[PropertyAssertion], report: FindingSink, *, is_nested: bool = False
    ) -> None:
        """Begins to listen.

        Args:
            subject: the thing.
            facts: all that is said about it.
            report: where findings go.
            is_part: whether it is only a part of another thing; such a one has no marks (`ms:untold`).
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
        """Where the property stands among the facts."""
        return self._indexes.get(property, ())

    def is_marked_untold(self, property: Iri) -> bool:
        """Whether the property is marked as giving no field its value."""
        return property in self._untold_marks

    def consume_untold_mark(self, property: Iri) -> None:
        """Takes the mark away: it is where the writer would set one."""
        if property in self._untold_marks:
            self._consumed.add(self._untold_marks[property])

    def first_value(self, codec: PropertyCodec[T]) -> T | None:
        """What the facts alone would give as the value of a word."""
        return _first_value(codec, (self.facts[index] for index in self.indexes_of(codec.property)))

    def references(self, property: Iri) -> Iterator[tuple[int, Iri]]:
        """Where a property names things, and which."""
        for index in self.indexes_of(property):
            value = self.facts[index].value
            if isinstance(value, IriRef):
                yield index, value.iri

    def consume(self, *indexes: int) -> None:
        """Marks facts as understood: the world says the same in another place."""
        self._consumed.update(indexes)

    def consume_references(self, property: Iri, *iris: Iri) -> None:
        """Takes away what is implied."""
        for index in self._indexes.get(property, ()):
            value = self.facts[index].value
            if isinstance(value, IriRef) and value.iri in iris:
                self._consumed.add(index)

    def read(self, codec: PropertyCodec[T], *, keep_if: Callable[[T], bool] | None = None) -> T | None:
        """The value of a word, or None where nobody tells it.

        Args:
            word: what is looked for.
            keep: whether a value stays a fact all the same.
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
            told = self.facts[index].value
            value = codec.decode(told)
            if value is None:
                self.warn(codec.property, _type_error(codec, told), "it stays a fact without meaning")
                continue
            if found is None:
                found = value
            elif value != found and not codec.repeatable:
                self.warn(codec.property, "it is told twice, differently", "the first counts, the others stay facts")
            if value == found and codec.round_trips(value, told) and not (keep_if and keep_if(value)):
                repeated.append(index)
            elif stays is None:
                stays = value
        if self._is_nested or stays != found:
            self._consumed.update(repeated)  # a fact that stays and gives the same value is all that would be written
        return found

    def _only_value(self, word: PropertyCodec[T], index: int) -> T | None:
        """`value` where one statement alone tells it, as is usual."""
        told = self.facts[index].value
        value = word.decode(told)
        if value is None:
            self.warn(word.property, _type_error(word, told), "it stays a fact without meaning")
        elif word.round_trips(value, told):
            self._consumed.add(index)
        return value

    def mark_leading(self, index: int) -> None:
        """Marks the one fact that counts among several of its property: it stays, and comes first."""
        if self._indexes[self.facts[index].property][0] != index:
            self._leading.append(index)

    def remaining(self) -> tuple[PropertyAssertion, ...]:
        """The facts that nothing has taken."""
        leading = self._leading
        if len(self._consumed) == len(self.facts):
            return ()
        rest = (index for index in range(len(self.facts)) if index not in self._consumed and index not in leading)
        return tuple(self.facts[index] for index in (*leading, *rest))

    def warn(self, property: str, problem: str, action: str) -> None:
        """Reports something odd about this thing."""
        self.report(Severity.WARNING, self.subject, property, problem, action)


def _type_error(codec: PropertyCodec[Any], value: FactValue) -> str:
    if not isinstance(value, Literal):
        return f"its value is not {codec.expected}"
    text = value.text if len(value.text) <= _MAX_TEXT_LENGTH else f"{value.text[:_MAX_TEXT_LENGTH]}…"
    has_comma = "number" in codec.expected and re.search(r"\d,\d", text)
    return f"{text!r} is not {codec.expected}{'; decimals have a point, not a comma' if has_comma else ''}"


def _first_value(codec: PropertyCodec[T], facts: Iterable[PropertyAssertion]) -> T | None:
    return next((value for fact in facts if (value := codec.decode(fact.value)) is not None), None)


class SubjectWriter:
    """What is said about one thing, while it is written."""

    def __init__(self, subject: Iri, facts: Sequence[PropertyAssertion] = ()) -> None:
        """Begins to speak.

        Args:
            subject: the thing.
            facts: its facts, which are said in any case, after everything else.
        """
        self.subject = subject
        self._facts = facts
        self._written: list[PropertyAssertion] = []

    def add_reference(self, property: Iri, iri: Iri) -> None:
        """Says that one thing has to do with another."""
        self._written.append(PropertyAssertion(property, IriRef(iri)))

    def add_fact(self, fact: PropertyAssertion) -> None:
        """Says something as it is."""
        self._written.append(fact)

    def first_value(self, codec: PropertyCodec[T]) -> T | None:
        """What the facts alone would give as the value of a word."""
        return _first_value(codec, (fact for fact in self._facts if fact.property == codec.property))

    def write(self, codec: PropertyCodec[T], value: T | None) -> None:
        """Says a value, or nothing where it is None.

        Nothing is said either where the facts already give the value; where they give one that the world does not
        have, they are marked as facts only.

        Raises:
            MapWriteError: no reader would understand the value, such as an infinite mass.
        """
        if value is None and not self._facts:
            return
        told = self.first_value(codec)
        if told is not None and value is None:
            self.add_reference(UNTOLD, codec.property)
        elif value is not None and told != value:
            term = codec.encode(value)
            if codec.decode(term) != value:
                what = f"the value {value!r} of {codec.property}"
                raise MapWriteError(self.subject, cause=f"{what} is not {codec.expected}")
            self._written.append(PropertyAssertion(codec.property, term))

    def all_facts(self) -> list[PropertyAssertion]:
        """All that is said, the facts last."""
        return [*self._written, *self._facts]
