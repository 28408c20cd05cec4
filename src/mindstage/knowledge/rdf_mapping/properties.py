"""Statements about one thing: words take their values out of them while reading, and put them in while writing.

The two sides keep one rule, which makes reading undo writing: the first statement that a word understands gives the
value, and a statement is only taken away if saying the value would give it back.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, TypeVar

from mindstage.errors import MapWriteError
from mindstage.knowledge.findings import FindingSink, Severity
from mindstage.knowledge.vocabulary import UNTOLD
from mindstage.knowledge.wording.words import PropertyCodec
from mindstage.world import FactValue, Iri, IriRef, Literal, PropertyAssertion

__all__ = ["SubjectReader", "SubjectWriter"]

T = TypeVar("T")

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
