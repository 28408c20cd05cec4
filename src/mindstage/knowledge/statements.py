"""Statements about one thing: words take their values out of them while reading, and put them in while writing.

The two sides keep one rule, which makes reading undo writing: the first statement that a word understands gives the
value, and a statement is only taken away if saying the value would give it back.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TypeVar

from mindstage.errors import MapUnwritable
from mindstage.knowledge.findings import Report, Severity
from mindstage.knowledge.vocabulary import UNTOLD
from mindstage.knowledge.words import Word
from mindstage.world import Fact, Iri, Literal, Reference

__all__ = ["Heard", "tell", "tell_each"]

T = TypeVar("T")


class Heard:
    """What is said about one thing, while it is read."""

    def __init__(self, subject: Iri, facts: Sequence[Fact], report: Report) -> None:
        self.subject = subject
        self.facts = facts
        self._report = report
        self._at: dict[Iri, list[int]] = {}
        self._taken: set[int] = set()
        for index, fact in enumerate(facts):
            self._at.setdefault(fact.property, []).append(index)
        self._untold = {self.facts[index].value for index in self._at.get(UNTOLD, ())}
        self._taken.update(self._at.get(UNTOLD, ()))

    def at(self, property: Iri) -> Sequence[int]:
        """Where the property stands among the facts; nowhere if it is marked as untold."""
        if self._untold and Reference(property) in self._untold:
            return ()
        return self._at.get(property, ())

    def is_untold(self, property: Iri) -> bool:
        """Whether the property is marked as giving no field its value."""
        return Reference(property) in self._untold

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
        for index, iri in self.references(property):
            if iri in iris:
                self._taken.add(index)

    def value(self, word: Word[T], *, keep: Callable[[T], bool] | None = None) -> T | None:
        """The value of a word, or None where nobody tells it.

        Args:
            word: what is looked for.
            keep: whether a value stays a fact all the same.
        """
        found: T | None = None
        for index in self.at(word.property):
            told = self.facts[index].value
            value = word.understand(told)
            if value is None:
                text = repr(told.text) if isinstance(told, Literal) else "its value"
                self.warn(word.property, f"{text} is not {word.what}", "it stays a fact without meaning")
                continue
            if found is None:
                found = value
            elif value != found:
                self.warn(word.property, "it is told twice, differently", "the first counts, the others stay facts")
                continue
            if word.repeats(value, told) and not (keep and keep(value)):
                self._taken.add(index)
        return found

    def left(self, *, first: int | None = None) -> tuple[Fact, ...]:
        """The facts that nothing has taken, in their order but for one that comes first."""
        rest = [index for index in range(len(self.facts)) if index not in self._taken and index != first]
        if first is not None and first not in self._taken:
            rest.insert(0, first)
        return tuple(self.facts[index] for index in rest)

    def warn(self, property: str, what: str, did: str) -> None:
        """Reports something odd about this thing."""
        self._report(Severity.WARNING, self.subject, property, what, did)


def tell(said: list[Fact], word: Word[T], value: T | None, facts: Iterable[Fact] = ()) -> None:
    """Says a value, unless the facts that are said as well already give it, or say more than they should.

    Args:
        said: the statements about the thing so far.
        word: what is said.
        value: None if the world does not know.
        facts: the thing's own facts, which are said anyway.

    Raises:
        MapUnwritable: no reader would understand the value, such as an infinite mass.
    """
    told = next((v for f in facts if f.property == word.property and (v := word.understand(f.value)) is not None), None)
    if value is None:
        if told is not None:
            said.append(Fact(UNTOLD, Reference(word.property)))
        return
    if told == value:
        return
    term = word.say(value)
    if word.understand(term) != value:
        raise MapUnwritable(f"{word.property} {value!r}", cause=f"a map needs {word.what} there")
    said.append(Fact(word.property, term))


def tell_each(said: list[Fact], told: Iterable[tuple[Word[T], T | None]], facts: Sequence[Fact] = ()) -> None:
    """Says several values."""
    for word, value in told:
        tell(said, word, value, facts)
