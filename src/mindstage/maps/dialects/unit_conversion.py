"""Conversion of a map's numbers to SI units, ROS axes and quaternions w x y z, and back.

Each number that changes is kept as given, under its `original_property`. A map with such a statement about itself is
already converted. Conversion uses decimal arithmetic, so that every number converts back exactly, which binary
division by 100 does not guarantee.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from decimal import Context, Decimal
from enum import Enum
from functools import lru_cache
from typing import Any

from mindstage.maps.dialects.conventions import SI, Handedness, LengthUnit, QuaternionOrder, UnitConventions
from mindstage.maps.dialects.membership import references
from mindstage.maps.dialects.source_map import SourceMap
from mindstage.maps.rdf_mapping.nested import sorted_facts
from mindstage.maps.rdf_mapping.properties import (
    ANGULAR_LIMITS,
    BOUNDING_BOX,
    LINEAR_LIMITS,
    QUATERNION,
    SIZE,
    TRANSLATION,
    PropertyCodec,
    literal_text,
)
from mindstage.rdf.graphs import local_name
from mindstage.rdf.vocabulary import (
    FRAME,
    GIVEN_SIZES,
    HAS_POSE,
    HAS_VALUE,
    ON_PROPERTY,
    PIVOT,
    QUATERNION_ORDER,
    SIZES,
    UNITS,
    ms,
)
from mindstage.scene import IDENTITY, BlankNode, Iri, IriRef, Literal, PropertyAssertion
from mindstage.scene.transforms import normalize, quat_rotate

__all__ = [
    "CONVERTED_PROPERTIES",
    "center_poses",
    "convert_facts",
    "convert_source_map",
    "is_converted",
    "original_conventions",
    "original_property",
    "pivot_of",
    "restore_declarations",
    "restore_facts",
    "restore_size_declaration",
    "with_pivot",
]

Decimals = tuple[Decimal, ...]

_DECLARATIONS = (UNITS, FRAME, QUATERNION_ORDER)
_LENGTHS: tuple[PropertyCodec[Any], ...] = (
    *SIZE,
    BOUNDING_BOX,
    *(LINEAR_LIMITS[name] for name in ("limit", "x_middle", "y_middle", "z_middle")),
)
_LENGTH_CODECS: dict[Iri, PropertyCodec[Any]] = {codec.property: codec for codec in _LENGTHS}
_ANGLE_CODECS: dict[Iri, PropertyCodec[float]] = {
    codec.property: codec for codec in (ANGULAR_LIMITS["twist_middle"], ANGULAR_LIMITS["swing1_middle"])
}
"""Angles whose sign changes in a mirrored frame."""

_CODECS: dict[Iri, PropertyCodec[Any]] = (
    _LENGTH_CODECS | _ANGLE_CODECS | {codec.property: codec for codec in (TRANSLATION, QUATERNION)}
)
CONVERTED_PROPERTIES = frozenset({HAS_VALUE, *_CODECS})
"""Properties whose values may be converted."""
_EXACT = Context(prec=2000)
"""Precision of sums of binary numbers, which have up to 1075 decimal places."""
_PIVOT_CODEC = PropertyCodec(PIVOT, TRANSLATION.expected, TRANSLATION.decode, TRANSLATION.encode)
_GIVEN_TRANSLATION = ms("givenTranslation")
_MIRRORED_PROPERTIES = frozenset({LINEAR_LIMITS["y_middle"].property, *_ANGLE_CODECS})


@lru_cache(maxsize=1024)
def original_property(property: Iri) -> Iri:
    """Returns the property under which a value is kept as given, where a converted value has replaced it."""
    name = local_name(property)
    return ms(f"given{name[:1].upper()}{name[1:]}")


def is_converted(source_map: SourceMap) -> bool:
    """Whether a map's numbers have been converted to SI; it then also states its original conventions."""
    return any(fact.property == original_property(UNITS) for fact in source_map.graph.get(source_map.map, ()))


def convert_source_map(source_map: SourceMap, conventions: UnitConventions, *, dialect: str) -> SourceMap:
    """Converts the numbers of a map to SI and adds statements of its original conventions.

    Args:
        conventions: its conventions; no field is None.
        dialect: name of its dialect, which is kept too.
    """
    if conventions == SI:
        return source_map
    graph = {subject: convert_facts(facts, conventions) for subject, facts in source_map.graph.items()}
    graph[source_map.map] = [
        *(fact for fact in graph.get(source_map.map, ()) if fact.property not in _DECLARATIONS),
        PropertyAssertion(ms("givenDialect"), Literal(dialect)),
        *(
            PropertyAssertion(original_property(property), Literal(value.value))
            for property, value in _declaration_values(conventions)
        ),
    ]
    return replace(source_map, graph=graph)


def original_conventions(facts: Iterable[PropertyAssertion]) -> UnitConventions | None:
    """Returns a map's conventions before its conversion, from its statements; None if it was not converted."""
    given = {fact.property: literal_text(fact.value) for fact in facts}
    chosen: list[Any] = []
    enum_types: tuple[type[Enum], ...] = (LengthUnit, Handedness, QuaternionOrder)
    for property, enum_type in zip(_DECLARATIONS, enum_types, strict=True):
        chosen += [each for each in enum_type if each.value == given.get(original_property(property))]
    if len(chosen) != len(enum_types):
        return None
    units, frame, quaternion = chosen
    return UnitConventions(units=units, frame=frame, quaternion=quaternion)


def restore_declarations(facts: Iterable[PropertyAssertion], conventions: UnitConventions) -> list[PropertyAssertion]:
    """Returns the statements of a converted map about itself as they were before the conversion."""
    added = {ms("givenDialect"), *map(original_property, _DECLARATIONS)}
    kept = restore_size_declaration(fact for fact in facts if fact.property not in added)
    return [
        *kept,
        *(PropertyAssertion(property, Literal(value.value)) for property, value in _declaration_values(conventions)),
    ]


def restore_size_declaration(facts: Iterable[PropertyAssertion]) -> list[PropertyAssertion]:
    """Returns the statements of a map about itself with the frame of its sizes as a declaration."""
    return [PropertyAssertion(SIZES, fact.value) if fact.property == GIVEN_SIZES else fact for fact in facts]


def _declaration_values(
    conventions: UnitConventions,
) -> Iterator[tuple[Iri, LengthUnit | Handedness | QuaternionOrder]]:
    for property, value in zip(
        _DECLARATIONS, (conventions.units, conventions.frame, conventions.quaternion), strict=True
    ):
        assert value is not None
        yield property, value


def convert_facts(facts: Sequence[PropertyAssertion], conventions: UnitConventions) -> list[PropertyAssertion]:
    """Converts the statements of one resource to SI; the values given are kept under `original_property`."""
    if not any(fact.property in CONVERTED_PROPERTIES or isinstance(fact.value, BlankNode) for fact in facts):
        return list(facts)
    measures = _measured_length(facts)
    result: list[PropertyAssertion] = []
    for fact in facts:
        if isinstance(fact.value, BlankNode):
            result.append(
                PropertyAssertion(fact.property, BlankNode(sorted_facts(convert_facts(fact.value.facts, conventions))))
            )
            continue
        value = _changed_literal(fact, measures, _UnitChange(conventions))
        if value is None:
            result.append(fact)
        else:
            result += (
                PropertyAssertion(fact.property, value),
                PropertyAssertion(original_property(fact.property), fact.value),
            )
    return list(dict.fromkeys(result))  # two values may become equal


def restore_facts(facts: Sequence[PropertyAssertion], conventions: UnitConventions) -> list[PropertyAssertion]:
    """Restores the values given; values that have changed since the conversion are converted back."""
    measures = _measured_length(facts)
    kept: dict[Iri, list[Literal]] = {}
    for fact in facts:
        if isinstance(fact.value, Literal):
            kept.setdefault(fact.property, []).append(fact.value)
    result: list[PropertyAssertion] = []
    gone: set[PropertyAssertion] = set()
    for fact in facts:
        if isinstance(fact.value, BlankNode):
            result.append(
                PropertyAssertion(
                    fact.property,
                    BlankNode(sorted_facts(restore_facts(fact.value.facts, conventions))),
                )
            )
            continue
        codec = _codec_for(fact, measures)
        if codec is None:
            result.append(fact)
            continue
        before = [PropertyAssertion(fact.property, value) for value in kept.get(original_property(fact.property), ())]
        value, to_si = codec.decode(fact.value), _UnitChange(conventions)
        same = [each for each in before if codec.decode(_changed_literal(each, measures, to_si) or each.value) == value]
        back = _changed_literal(fact, measures, _UnitChange(conventions, inverse=True))
        result += same or [fact if back is None else PropertyAssertion(fact.property, back)]
        gone.update(PropertyAssertion(original_property(fact.property), each.value) for each in before)
    return [fact for fact in dict.fromkeys(result) if fact not in gone]


def _measured_length(facts: Sequence[PropertyAssertion]) -> Iri | None:
    """Returns the length property that a restriction is about, if it is about one."""
    return next((property for property in references(facts, ON_PROPERTY) if property in _LENGTH_CODECS), None)


def _codec_for(fact: PropertyAssertion, measured_length: Iri | None) -> PropertyCodec[Any] | None:
    """Returns the codec of a statement whose value is converted, or None."""
    property = measured_length if fact.property == HAS_VALUE and measured_length else fact.property
    return _CODECS.get(property)


def _changed_literal(fact: PropertyAssertion, measured_length: Iri | None, change: _UnitChange) -> Literal | None:
    """Returns the converted value of a statement, or None if it does not change."""
    codec = _codec_for(fact, measured_length)
    value = None if codec is None else codec.decode(fact.value)
    if codec is None or value is None:
        return None
    row = change.row(codec, tuple(map(_parse_decimal, (literal_text(fact.value) or "").split())))
    numbers = tuple(map(float, row))
    if numbers == (value if isinstance(value, tuple) else (value,)):
        return None
    if change.inverse:
        # Decimal digits are kept: not every binary number is a hundred times another one.
        return Literal(" ".join(map(_format_decimal, row)), codec.datatype)
    encoded = codec.encode(numbers if isinstance(value, tuple) else numbers[0])
    assert isinstance(encoded, Literal)
    return encoded


# -- pivots ------------------------------------------------------------------------------------------------------------


def center_poses(
    graph: dict[Iri, Sequence[PropertyAssertion]],
    conventions: UnitConventions,
    offsets: Iterable[tuple[Iri, Sequence[float]]],
) -> None:
    """Replaces poses that are those of mesh pivots by those of the centers of boxes; `with_pivot` inverts it.

    The sums are computed in decimal arithmetic from the digits given.

    Args:
        graph: the statements of a converted map, which are changed.
        conventions: the conventions that the map was converted from.
        offsets: individuals, and the center of the box in the frame of the pivot [m].
    """
    shifted: set[Iri] = set()
    for member, offset in offsets:
        facts = list(graph[member])
        at, value = next((at, fact.value) for at, fact in enumerate(facts) if fact.property == HAS_POSE)
        if isinstance(value, BlankNode):
            node = BlankNode(sorted_facts(_with_center(value.facts, offset, conventions)))
            facts[at] = PropertyAssertion(HAS_POSE, node)
            graph[member] = facts
        elif isinstance(value, IriRef) and value.iri not in shifted:
            graph[value.iri] = _with_center(graph[value.iri], offset, conventions)
            shifted.add(value.iri)


def pivot_of(facts: Iterable[PropertyAssertion]) -> tuple[float, ...] | None:
    """Returns the pivot that the statements about a pose give, relative to the center of the box [m]."""
    return _PIVOT_CODEC.first_value(facts)


def with_pivot(facts: Sequence[PropertyAssertion]) -> Sequence[PropertyAssertion]:
    """Returns the statements about the pose of a box with a pivot as those about the pose of the pivot.

    The position has as few digits as give the center when they are read: those of the source, unless it has moved.
    """
    pivot, center = pivot_of(facts), TRANSLATION.first_value(facts)
    if pivot is None or center is None:
        return facts
    steps = _turned(facts, [-part for part in pivot])
    row = [_shortest_summand(part, step) for part, step in zip(center, steps, strict=True)]
    position = Literal(" ".join(map(_format_decimal, row)), TRANSLATION.datatype)
    return [
        PropertyAssertion(fact.property, position) if fact.property == TRANSLATION.property else fact for fact in facts
    ]


def _with_center(
    facts: Sequence[PropertyAssertion], offset: Sequence[float], conventions: UnitConventions
) -> list[PropertyAssertion]:
    """Returns the statements about the pose of a pivot as those about the pose of the center."""
    at = next(at for at, fact in enumerate(facts) if TRANSLATION.first_value([fact]) is not None)
    values = [fact.value for fact in facts if fact.property == _GIVEN_TRANSLATION and TRANSLATION.decode(fact.value)]
    # Converted numbers are rounded to binary, those given are not.
    given = values[0] if values and conventions != SI else facts[at].value
    digits = tuple(map(_parse_decimal, (literal_text(given) or "").split()))
    pivot = _UnitChange(conventions).row(TRANSLATION, digits) if values else digits
    center = tuple(float(_EXACT.add(part, step)) for part, step in zip(pivot, _turned(facts, offset), strict=True))
    return [
        *facts[:at],
        PropertyAssertion(TRANSLATION.property, TRANSLATION.encode(center)),
        *(fact for fact in facts[at + 1 :] if fact.property != PIVOT),
        PropertyAssertion(PIVOT, TRANSLATION.encode(tuple(0.0 - float(part) for part in offset))),
    ]


def _shortest_summand(total: float, step: Decimal) -> Decimal:
    """Returns the number with the fewest decimal places whose sum with a step is rounded to a total."""
    exact = _EXACT.subtract(Decimal(total), step)
    for places in range(1, 26):
        rounded = exact.quantize(Decimal(1).scaleb(-places), context=_EXACT)
        if float(_EXACT.add(rounded, step)) == total:
            return rounded.normalize(_EXACT) if rounded else Decimal(0)
    return exact


def _turned(facts: Iterable[PropertyAssertion], offset: Sequence[float]) -> Decimals:
    """Returns an offset in the frame of a pose along the axes of the world [m]."""
    quaternion = normalize(QUATERNION.first_value(facts) or IDENTITY.quaternion)
    return tuple(map(Decimal, quat_rotate(quaternion, offset).tolist()))


@dataclass(frozen=True, slots=True)
class _UnitChange:
    """A conversion of numbers to SI, or back if `inverse`."""

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
        if mirrors:  # the sense of rotation changes; the y axis is itself mirrored, so y keeps its sign
            x, z = _negated(x), _negated(z)
        return (x, y, z, w) if scalar_last and self.inverse else (w, x, y, z)

    def _length(self, number: Decimal) -> Decimal:
        assert self.conventions.units is not None
        digits = {LengthUnit.METERS: 0, LengthUnit.CENTIMETERS: 2, LengthUnit.MILLIMETERS: 3}[self.conventions.units]
        parts = number.as_tuple()
        assert isinstance(parts.exponent, int)
        return Decimal((parts.sign, parts.digits, parts.exponent + (digits if self.inverse else -digits)))


def _parse_decimal(text: str) -> Decimal:
    """Parses a number with all its digits; one that underflows is 0."""
    number = float(text)
    return Decimal(text if number else repr(number))


def _negated(number: Decimal) -> Decimal:
    return number.copy_negate() if number else Decimal(0)


def _format_decimal(number: Decimal) -> str:
    """Formats a number with a decimal point, and without an exponent unless it is far from 1."""
    text = f"{number:f}" if not number or -9 <= number.adjusted() <= 15 else str(number)
    return text if "." in text or "E" in text else f"{text}.0"
