"""Statements about one thing: words take their values out of them while reading, and put them in while writing.

The two sides keep one rule, which makes reading undo writing: the first statement that a word understands gives the
value, and a statement is only taken away if saying the value would give it back.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, TypeVar

from mindstage.errors import MapUnwritable
from mindstage.knowledge.findings import Report, Severity
from mindstage.knowledge.vocabulary import UNTOLD
from mindstage.knowledge.wording.words import Word
from mindstage.world import Fact, FactValue, Iri, Literal, Reference

__all__ = ["Heard", "Said"]

T = TypeVar("T")

_LONG = 200
"""A text of more characters is cut short in a finding."""


class Heard:
    """What is said about one thing, while it is read."""

    def __init__(self, subject: Iri, facts: Sequence[Fact], report: Report, *, is_part: bool = False) -> None:
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
        self._at: dict[Iri, list[int]] = {}
        self._taken: set[int] = set()
        self._leading: list[int] = []
        self._is_part = is_part
        at = self._at
        for index, fact in enumerate(facts):
            if (places := at.get(fact.property)) is None:
                at[fact.property] = [index]
            else:
                places.append(index)
        marked = UNTOLD in at and not is_part
        self._untold = {iri: index for index, iri in self.references(UNTOLD)} if marked else {}

    def at(self, property: Iri) -> Sequence[int]:
        """Where the property stands among the facts."""
        return self._at.get(property, ())

    def is_untold(self, property: Iri) -> bool:
        """Whether the property is marked as giving no field its value."""
        return property in self._untold

    def take_mark(self, property: Iri) -> None:
        """Takes the mark away: it is where the writer would set one."""
        if property in self._untold:
            self._taken.add(self._untold[property])

    def told(self, word: Word[T]) -> T | None:
        """What the facts alone would give as the value of a word."""
        return _first(word, (self.facts[index] for index in self.at(word.property)))

    def references(self, property: Iri) -> Iterator[tuple[int, Iri]]:
        """Where a property names things, and which."""
        for index in self.at(property):
            value = self.facts[index].value
            if isinstance(value, Reference):
                yield index, value.iri

    def take(self, *indexes: int) -> None:
        """Marks facts as understood: the world says the same in another place."""
        self._taken.update(indexes)

    def drop(self, property: Iri, *iris: Iri) -> None:
        """Takes away what is implied."""
        for index in self._at.get(property, ()):
            value = self.facts[index].value
            if isinstance(value, Reference) and value.iri in iris:
                self._taken.add(index)

    def value(self, word: Word[T], *, keep: Callable[[T], bool] | None = None) -> T | None:
        """The value of a word, or None where nobody tells it.

        Args:
            word: what is looked for.
            keep: whether a value stays a fact all the same.
        """
        places = self._at.get(word.property)
        if places is None:
            return None
        if len(places) == 1 and keep is None and not self._untold:
            return self._only_value(word, places[0])
        if word.property in self._untold:
            if self.told(word) is not None:
                self.take_mark(word.property)
            return None
        found: T | None = None
        repeated: list[int] = []
        stays: T | None = None
        for index in places:
            told = self.facts[index].value
            value = word.understand(told)
            if value is None:
                self.warn(word.property, _misfit(word, told), "it stays a fact without meaning")
                continue
            if found is None:
                found = value
            elif value != found and not word.often:
                self.warn(word.property, "it is told twice, differently", "the first counts, the others stay facts")
            if value == found and word.repeats(value, told) and not (keep and keep(value)):
                repeated.append(index)
            elif stays is None:
                stays = value
        if self._is_part or stays != found:
            self._taken.update(repeated)  # a fact that stays and gives the same value is all that would be written
        return found

    def _only_value(self, word: Word[T], index: int) -> T | None:
        """`value` where one statement alone tells it, as is usual."""
        told = self.facts[index].value
        value = word.understand(told)
        if value is None:
            self.warn(word.property, _misfit(word, told), "it stays a fact without meaning")
        elif word.repeats(value, told):
            self._taken.add(index)
        return value

    def lead(self, index: int) -> None:
        """Marks the one fact that counts among several of its property: it stays, and comes first."""
        if self._at[self.facts[index].property][0] != index:
            self._leading.append(index)

    def left(self) -> tuple[Fact, ...]:
        """The facts that nothing has taken."""
        leading = self._leading
        if len(self._taken) == len(self.facts):
            return ()
        rest = (index for index in range(len(self.facts)) if index not in self._taken and index not in leading)
        return tuple(self.facts[index] for index in (*leading, *rest))

    def warn(self, property: str, what: str, did: str) -> None:
        """Reports something odd about this thing."""
        self.report(Severity.WARNING, self.subject, property, what, did)


def _misfit(word: Word[Any], told: FactValue) -> str:
    if not isinstance(told, Literal):
        return f"its value is not {word.what}"
    text = told.text if len(told.text) <= _LONG else f"{told.text[:_LONG]}…"
    has_comma = "number" in word.what and re.search(r"\d,\d", text)
    return f"{text!r} is not {word.what}{'; decimals have a point, not a comma' if has_comma else ''}"


def _first(word: Word[T], facts: Iterable[Fact]) -> T | None:
    return next((value for fact in facts if (value := word.understand(fact.value)) is not None), None)


class Said:
    """What is said about one thing, while it is written."""

    def __init__(self, subject: Iri, facts: Sequence[Fact] = ()) -> None:
        """Begins to speak.

        Args:
            subject: the thing.
            facts: its facts, which are said in any case, after everything else.
        """
        self.subject = subject
        self._facts = facts
        self._said: list[Fact] = []

    def add(self, property: Iri, iri: Iri) -> None:
        """Says that one thing has to do with another."""
        self._said.append(Fact(property, Reference(iri)))

    def fact(self, fact: Fact) -> None:
        """Says something as it is."""
        self._said.append(fact)

    def told(self, word: Word[T]) -> T | None:
        """What the facts alone would give as the value of a word."""
        return _first(word, (fact for fact in self._facts if fact.property == word.property))

    def value(self, word: Word[T], value: T | None) -> None:
        """Says a value, or nothing where it is None.

        Nothing is said either where the facts already give the value; where they give one that the world does not
        have, they are marked as facts only.

        Raises:
            MapUnwritable: no reader would understand the value, such as an infinite mass.
        """
        if value is None and not self._facts:
            return
        told = self.told(word)
        if told is not None and value is None:
            self.add(UNTOLD, word.property)
        elif value is not None and told != value:
            term = word.say(value)
            if word.understand(term) != value:
                what = f"the value {value!r} of {word.property}"
                raise MapUnwritable(self.subject, cause=f"{what} is not {word.what}")
            self._said.append(Fact(word.property, term))

    def everything(self) -> list[Fact]:
        """All that is said, the facts last."""
        return [*self._said, *self._facts]
