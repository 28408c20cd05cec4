"""Conversion: a map whose numbers are meant otherwise, said in meters, in ROS's frame and with w x y z, and back.

Every number that changes is kept beside the new one, under the name of its property with `original_property` before it. A map
that says such a thing about itself has been converted already. Numbers change digit by digit, as on paper, so that
each comes back as it was: of those that a computer divides by 100, some do not.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from enum import Enum
from functools import lru_cache
from typing import Any

from mindstage.knowledge.dialects.conventions import SI, Handedness, LengthUnit, QuaternionOrder, UnitConventions
from mindstage.knowledge.dialects.source_map import SourceMap
from mindstage.knowledge.rdf import local_name
from mindstage.knowledge.rdf_mapping.nested import sorted_facts
from mindstage.knowledge.rdf_mapping.properties import (
    LIMIT,
    QUATERNION,
    SIZE,
    SWING1_MIDDLE,
    TRANSLATION,
    TWIST_MIDDLE,
    X_MIDDLE,
    Y_MIDDLE,
    Z_MIDDLE,
    PropertyCodec,
    literal_text,
)
from mindstage.knowledge.vocabulary import FRAME, HAS_VALUE, ON_PROPERTY, QUATERNION_ORDER, UNITS, ms
from mindstage.scene import BlankNode, Iri, IriRef, Literal, PropertyAssertion

__all__ = [
    "CONVERTED_PROPERTIES",
    "convert_facts",
    "convert_source_map",
    "is_converted",
    "original_conventions",
    "original_property",
    "restore_declarations",
    "restore_facts",
]

Decimals = tuple[Decimal, ...]

_DECLARATIONS = (UNITS, FRAME, QUATERNION_ORDER)
_LENGTH_CODECS: dict[Iri, PropertyCodec[float]] = {
    word.property: word for word in (*SIZE, LIMIT, X_MIDDLE, Y_MIDDLE, Z_MIDDLE)
}
_ANGLE_CODECS: dict[Iri, PropertyCodec[float]] = {word.property: word for word in (TWIST_MIDDLE, SWING1_MIDDLE)}
"""Of turns that run the other way in a mirrored frame."""

_CODECS: dict[Iri, PropertyCodec[Any]] = (
    _LENGTH_CODECS | _ANGLE_CODECS | {word.property: word for word in (TRANSLATION, QUATERNION)}
)
CONVERTED_PROPERTIES = frozenset({HAS_VALUE, *_CODECS})
"""Properties whose values may change."""
_MIRRORED_PROPERTIES = frozenset({Y_MIDDLE.property, *_ANGLE_CODECS})


@lru_cache(maxsize=1024)
def original_property(property: Iri) -> Iri:
    """The name under which a map's own statement is kept, where one in SI stands in its place."""
    name = local_name(property)
    return ms(f"given{name[:1].upper()}{name[1:]}")


def is_converted(source_map: SourceMap) -> bool:
    """Whether the map says that its numbers are in SI now, and how they were meant before."""
    return any(fact.property == original_property(UNITS) for fact in source_map.graph.get(source_map.map, ()))


def convert_source_map(source_map: SourceMap, conventions: UnitConventions, *, dialect: str) -> SourceMap:
    """The same excerpt in SI; it tells how it was, so that it can be written back in its own way.

    Args:
        excerpt: as the map has it.
        conventions: how its numbers are meant; all three are told.
        dialect: what kind of map it is, which is kept too.
    """
    if conventions == SI:
        return source_map
    graph = {subject: convert_facts(facts, conventions) for subject, facts in source_map.graph.items()}
    graph[source_map.map] = [
        *(fact for fact in graph.get(source_map.map, ()) if fact.property not in _DECLARATIONS),
        PropertyAssertion(ms("givenDialect"), Literal(dialect)),
        *(
            PropertyAssertion(original_property(property), Literal(told.value))
            for property, told in _declaration_values(conventions)
        ),
    ]
    return replace(source_map, graph=graph)


def original_conventions(facts: Iterable[PropertyAssertion]) -> UnitConventions | None:
    """How a map's numbers were meant before, as its facts tell it; None where it never was converted."""
    told = {fact.property: literal_text(fact.value) for fact in facts}
    chosen: list[Any] = []
    kinds: tuple[type[Enum], ...] = (LengthUnit, Handedness, QuaternionOrder)
    for property, kind in zip(_DECLARATIONS, kinds, strict=True):
        chosen += [each for each in kind if each.value == told.get(original_property(property))]
    if len(chosen) != len(kinds):
        return None
    units, frame, quaternion = chosen
    return UnitConventions(units=units, frame=frame, quaternion=quaternion)


def restore_declarations(facts: Iterable[PropertyAssertion], conventions: UnitConventions) -> list[PropertyAssertion]:
    """What a map that was converted says of itself once it is as it was."""
    away = {ms("givenDialect"), *map(original_property, _DECLARATIONS)}
    kept = [fact for fact in facts if fact.property not in away]
    return [
        *kept,
        *(PropertyAssertion(property, Literal(told.value)) for property, told in _declaration_values(conventions)),
    ]


def _declaration_values(
    conventions: UnitConventions,
) -> Iterator[tuple[Iri, LengthUnit | Handedness | QuaternionOrder]]:
    for property, told in zip(
        _DECLARATIONS, (conventions.units, conventions.frame, conventions.quaternion), strict=True
    ):
        assert told is not None
        yield property, told


def convert_facts(facts: Sequence[PropertyAssertion], conventions: UnitConventions) -> list[PropertyAssertion]:
    """Statements about one thing in SI, and what was given in their place."""
    if not any(fact.property in CONVERTED_PROPERTIES or isinstance(fact.value, BlankNode) for fact in facts):
        return list(facts)
    measures = _measured_length(facts)
    found: list[PropertyAssertion] = []
    for fact in facts:
        if isinstance(fact.value, BlankNode):
            found.append(
                PropertyAssertion(fact.property, BlankNode(sorted_facts(convert_facts(fact.value.facts, conventions))))
            )
            continue
        value = _changed_literal(fact, measures, _UnitChange(conventions))
        if value is None:
            found.append(fact)
        else:
            found += (
                PropertyAssertion(fact.property, value),
                PropertyAssertion(original_property(fact.property), fact.value),
            )
    return list(dict.fromkeys(found))  # two numbers may come to the same


def restore_facts(facts: Sequence[PropertyAssertion], conventions: UnitConventions) -> list[PropertyAssertion]:
    """The same statements as they were given; those that say something else by now are converted back."""
    measures = _measured_length(facts)
    kept: dict[Iri, list[Literal]] = {}
    for fact in facts:
        if isinstance(fact.value, Literal):
            kept.setdefault(fact.property, []).append(fact.value)
    found: list[PropertyAssertion] = []
    gone: set[PropertyAssertion] = set()
    for fact in facts:
        if isinstance(fact.value, BlankNode):
            found.append(
                PropertyAssertion(fact.property, BlankNode(sorted_facts(restore_facts(fact.value.facts, conventions))))
            )
            continue
        word = _codec_for(fact, measures)
        if word is None:
            found.append(fact)
            continue
        before = [PropertyAssertion(fact.property, value) for value in kept.get(original_property(fact.property), ())]
        same = [
            each for each in before if _converted_value(each, word, measures, conventions) == word.decode(fact.value)
        ]
        back = _changed_literal(fact, measures, _UnitChange(conventions, inverse=True))
        found += same or [fact if back is None else PropertyAssertion(fact.property, back)]
        gone.update(PropertyAssertion(original_property(fact.property), each.value) for each in before)
    return [fact for fact in dict.fromkeys(found) if fact not in gone]


def _measured_length(facts: Sequence[PropertyAssertion]) -> Iri | None:
    """The length that a restriction is about, if it is one about a length."""
    on = (fact.value.iri for fact in facts if fact.property == ON_PROPERTY and isinstance(fact.value, IriRef))
    return next((property for property in on if property in _LENGTH_CODECS), None)


def _codec_for(fact: PropertyAssertion, measured_length: Iri | None) -> PropertyCodec[Any] | None:
    """What a statement says, if it is one of those that change."""
    property = measured_length if fact.property == HAS_VALUE and measured_length else fact.property
    return _CODECS.get(property)


def _converted_value(
    fact: PropertyAssertion, codec: PropertyCodec[Any], measured_length: Iri | None, conventions: UnitConventions
) -> object:
    """What a statement comes to in SI."""
    return codec.decode(_changed_literal(fact, measured_length, _UnitChange(conventions)) or fact.value)


def _changed_literal(fact: PropertyAssertion, measured_length: Iri | None, change: _UnitChange) -> Literal | None:
    """Another value for a fact; None where it is no number that changes."""
    word = _codec_for(fact, measured_length)
    told = None if word is None else word.decode(fact.value)
    if word is None or told is None:
        return None
    row = change.row(word, tuple(map(_parse_decimal, (literal_text(fact.value) or "").split())))
    numbers = tuple(map(float, row))
    if numbers == (told if isinstance(told, tuple) else (told,)):
        return None
    if change.inverse:
        # Digit by digit: of the numbers that a computer has, not each is the hundredfold of another one.
        return Literal(" ".join(map(_format_decimal, row)), word.datatype)
    said = word.encode(numbers if isinstance(told, tuple) else numbers[0])
    assert isinstance(said, Literal)
    return said


@dataclass(frozen=True, slots=True)
class _UnitChange:
    """The way of numbers into SI, or back."""

    conventions: UnitConventions
    inverse: bool = False

    def row(self, codec: PropertyCodec[Any], row: Decimals) -> Decimals:
        mirrors = self.conventions.frame is Handedness.UNREAL
        if codec is QUATERNION:
            return self._rotation(row, mirrors)
        if codec is TRANSLATION:
            x, y, z = map(self._length, row)
            return (x, _negated(y), z) if mirrors else (x, y, z)
        if codec.property in _LENGTH_CODECS:
            row = tuple(map(self._length, row))
        return tuple(map(_negated, row)) if mirrors and codec.property in _MIRRORED_PROPERTIES else row

    def _rotation(self, row: Decimals, mirrors: bool) -> Decimals:
        scalar_last = self.conventions.quaternion is QuaternionOrder.XYZW
        a, b, c, d = row
        w, x, y, z = (d, a, b, c) if scalar_last and not self.inverse else (a, b, c, d)
        if mirrors:  # the same turn runs the other way; y, which is mirrored itself, keeps its sign
            x, z = _negated(x), _negated(z)
        return (x, y, z, w) if scalar_last and self.inverse else (w, x, y, z)

    def _length(self, number: Decimal) -> Decimal:
        assert self.conventions.units is not None
        digits = {LengthUnit.METERS: 0, LengthUnit.CENTIMETERS: 2, LengthUnit.MILLIMETERS: 3}[self.conventions.units]
        told = number.as_tuple()
        assert isinstance(told.exponent, int)
        return Decimal((told.sign, told.digits, told.exponent + (digits if self.inverse else -digits)))


def _parse_decimal(text: str) -> Decimal:
    """A number to all its digits; one so small that it is none is 0."""
    number = float(text)
    return Decimal(text if number else repr(number))


def _negated(number: Decimal) -> Decimal:
    return number.copy_negate() if number else Decimal(0)


def _format_decimal(number: Decimal) -> str:
    """A number without an exponent, unless it is far from 1, and with a point."""
    text = f"{number:f}" if not number or -9 <= number.adjusted() <= 15 else str(number)
    return text if "." in text or "E" in text else f"{text}.0"
