"""Conversion: a map whose numbers are meant otherwise, said in metres, in ROS's frame and with w x y z, and back.

Every number that changes is kept beside the new one, under the name of its property with `given` before it. A map
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

from mindstage.knowledge.names import local_name
from mindstage.knowledge.reading.conventions import SI, Conventions, Frame, QuaternionOrder, Units
from mindstage.knowledge.reading.excerpt import Excerpt
from mindstage.knowledge.vocabulary import FRAME, HAS_VALUE, ON_PROPERTY, QUATERNION_ORDER, UNITS, ms
from mindstage.knowledge.wording.nesting import sorted_facts
from mindstage.knowledge.wording.words import (
    LIMIT,
    QUATERNION,
    SIZE,
    SWING1_MIDDLE,
    TRANSLATION,
    TWIST_MIDDLE,
    X_MIDDLE,
    Y_MIDDLE,
    Z_MIDDLE,
    Word,
    text_in,
)
from mindstage.world import Anonymous, Fact, Iri, Literal, Reference

__all__ = ["CONVERTED", "convert", "converted", "declared", "given", "given_conventions", "is_converted", "unconverted"]

Row = tuple[Decimal, ...]

_DECLARATIONS = (UNITS, FRAME, QUATERNION_ORDER)
_LENGTHS: dict[Iri, Word[float]] = {word.property: word for word in (*SIZE, LIMIT, X_MIDDLE, Y_MIDDLE, Z_MIDDLE)}
_ANGLES: dict[Iri, Word[float]] = {word.property: word for word in (TWIST_MIDDLE, SWING1_MIDDLE)}
"""Of turns that run the other way in a mirrored frame."""

_WORDS: dict[Iri, Word[Any]] = _LENGTHS | _ANGLES | {word.property: word for word in (TRANSLATION, QUATERNION)}
CONVERTED = frozenset({HAS_VALUE, *_WORDS})
"""Properties whose values may change."""
_MIRRORED = frozenset({Y_MIDDLE.property, *_ANGLES})


@lru_cache(maxsize=1024)
def given(property: Iri) -> Iri:
    """The name under which a map's own statement is kept, where one in SI stands in its place."""
    name = local_name(property)
    return ms(f"given{name[:1].upper()}{name[1:]}")


def is_converted(excerpt: Excerpt) -> bool:
    """Whether the map says that its numbers are in SI now, and how they were meant before."""
    return any(fact.property == given(UNITS) for fact in excerpt.graph.get(excerpt.map, ()))


def convert(excerpt: Excerpt, conventions: Conventions, *, dialect: str) -> Excerpt:
    """The same excerpt in SI; it tells how it was, so that it can be written back in its own way.

    Args:
        excerpt: as the map has it.
        conventions: how its numbers are meant; all three are told.
        dialect: what kind of map it is, which is kept too.
    """
    if conventions == SI:
        return excerpt
    graph = {subject: converted(facts, conventions) for subject, facts in excerpt.graph.items()}
    graph[excerpt.map] = [
        *(fact for fact in graph.get(excerpt.map, ()) if fact.property not in _DECLARATIONS),
        Fact(ms("givenDialect"), Literal(dialect)),
        *(Fact(given(property), Literal(told.value)) for property, told in _declared(conventions)),
    ]
    return replace(excerpt, graph=graph)


def given_conventions(facts: Iterable[Fact]) -> Conventions | None:
    """How a map's numbers were meant before, as its facts tell it; None where it never was converted."""
    told = {fact.property: text_in(fact.value) for fact in facts}
    chosen: list[Any] = []
    kinds: tuple[type[Enum], ...] = (Units, Frame, QuaternionOrder)
    for property, kind in zip(_DECLARATIONS, kinds, strict=True):
        chosen += [each for each in kind if each.value == told.get(given(property))]
    if len(chosen) != len(kinds):
        return None
    units, frame, quaternion = chosen
    return Conventions(units=units, frame=frame, quaternion=quaternion)


def declared(facts: Iterable[Fact], conventions: Conventions) -> list[Fact]:
    """What a map that was converted says of itself once it is as it was."""
    away = {ms("givenDialect"), *map(given, _DECLARATIONS)}
    kept = [fact for fact in facts if fact.property not in away]
    return [*kept, *(Fact(property, Literal(told.value)) for property, told in _declared(conventions))]


def _declared(conventions: Conventions) -> Iterator[tuple[Iri, Units | Frame | QuaternionOrder]]:
    for property, told in zip(
        _DECLARATIONS, (conventions.units, conventions.frame, conventions.quaternion), strict=True
    ):
        assert told is not None
        yield property, told


def converted(facts: Sequence[Fact], conventions: Conventions) -> list[Fact]:
    """Statements about one thing in SI, and what was given in their place."""
    if not any(fact.property in CONVERTED or isinstance(fact.value, Anonymous) for fact in facts):
        return list(facts)
    measures = _measures(facts)
    found: list[Fact] = []
    for fact in facts:
        if isinstance(fact.value, Anonymous):
            found.append(Fact(fact.property, Anonymous(sorted_facts(converted(fact.value.facts, conventions)))))
            continue
        value = _changed(fact, measures, _Change(conventions))
        if value is None:
            found.append(fact)
        else:
            found += (Fact(fact.property, value), Fact(given(fact.property), fact.value))
    return list(dict.fromkeys(found))  # two numbers may come to the same


def unconverted(facts: Sequence[Fact], conventions: Conventions) -> list[Fact]:
    """The same statements as they were given; those that say something else by now are converted back."""
    measures = _measures(facts)
    kept: dict[Iri, list[Literal]] = {}
    for fact in facts:
        if isinstance(fact.value, Literal):
            kept.setdefault(fact.property, []).append(fact.value)
    found: list[Fact] = []
    gone: set[Fact] = set()
    for fact in facts:
        if isinstance(fact.value, Anonymous):
            found.append(Fact(fact.property, Anonymous(sorted_facts(unconverted(fact.value.facts, conventions)))))
            continue
        word = _word(fact, measures)
        if word is None:
            found.append(fact)
            continue
        before = [Fact(fact.property, value) for value in kept.get(given(fact.property), ())]
        same = [each for each in before if _means(each, word, measures, conventions) == word.understand(fact.value)]
        back = _changed(fact, measures, _Change(conventions, back=True))
        found += same or [fact if back is None else Fact(fact.property, back)]
        gone.update(Fact(given(fact.property), each.value) for each in before)
    return [fact for fact in dict.fromkeys(found) if fact not in gone]


def _measures(facts: Sequence[Fact]) -> Iri | None:
    """The length that a restriction is about, if it is one about a length."""
    on = (fact.value.iri for fact in facts if fact.property == ON_PROPERTY and isinstance(fact.value, Reference))
    return next((property for property in on if property in _LENGTHS), None)


def _word(fact: Fact, measures: Iri | None) -> Word[Any] | None:
    """What a statement says, if it is one of those that change."""
    property = measures if fact.property == HAS_VALUE and measures else fact.property
    return _WORDS.get(property)


def _means(fact: Fact, word: Word[Any], measures: Iri | None, conventions: Conventions) -> object:
    """What a statement comes to in SI."""
    return word.understand(_changed(fact, measures, _Change(conventions)) or fact.value)


def _changed(fact: Fact, measures: Iri | None, change: _Change) -> Literal | None:
    """Another value for a fact; None where it is no number that changes."""
    word = _word(fact, measures)
    told = None if word is None else word.understand(fact.value)
    if word is None or told is None:
        return None
    row = change.row(word, tuple(map(_decimal, (text_in(fact.value) or "").split())))
    numbers = tuple(map(float, row))
    if numbers == (told if isinstance(told, tuple) else (told,)):
        return None
    if change.back:
        # Digit by digit: of the numbers that a computer has, not each is the hundredfold of another one.
        return Literal(" ".join(map(_plain, row)), word.datatype)
    said = word.say(numbers if isinstance(told, tuple) else numbers[0])
    assert isinstance(said, Literal)
    return said


@dataclass(frozen=True, slots=True)
class _Change:
    """The way of numbers into SI, or back."""

    conventions: Conventions
    back: bool = False

    def row(self, word: Word[Any], row: Row) -> Row:
        mirrors = self.conventions.frame is Frame.UNREAL
        if word is QUATERNION:
            return self._rotation(row, mirrors)
        if word is TRANSLATION:
            x, y, z = map(self._length, row)
            return (x, _negated(y), z) if mirrors else (x, y, z)
        if word.property in _LENGTHS:
            row = tuple(map(self._length, row))
        return tuple(map(_negated, row)) if mirrors and word.property in _MIRRORED else row

    def _rotation(self, row: Row, mirrors: bool) -> Row:
        scalar_last = self.conventions.quaternion is QuaternionOrder.XYZW
        a, b, c, d = row
        w, x, y, z = (d, a, b, c) if scalar_last and not self.back else (a, b, c, d)
        if mirrors:  # the same turn runs the other way; y, which is mirrored itself, keeps its sign
            x, z = _negated(x), _negated(z)
        return (x, y, z, w) if scalar_last and self.back else (w, x, y, z)

    def _length(self, number: Decimal) -> Decimal:
        assert self.conventions.units is not None
        digits = {Units.METRES: 0, Units.CENTIMETRES: 2, Units.MILLIMETRES: 3}[self.conventions.units]
        told = number.as_tuple()
        assert isinstance(told.exponent, int)
        return Decimal((told.sign, told.digits, told.exponent + (digits if self.back else -digits)))


def _decimal(text: str) -> Decimal:
    """A number to all its digits; one so small that it is none is 0."""
    number = float(text)
    return Decimal(text if number else repr(number))


def _negated(number: Decimal) -> Decimal:
    return number.copy_negate() if number else Decimal(0)


def _plain(number: Decimal) -> str:
    """A number without an exponent, unless it is far from 1, and with a point."""
    text = f"{number:f}" if not number or -9 <= number.adjusted() <= 15 else str(number)
    return text if "." in text or "E" in text else f"{text}.0"
