"""Reading parts: finds an individual's pose and the like, and remembers what is left of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

from mindstage.knowledge.findings import Report
from mindstage.knowledge.graph import Graph
from mindstage.knowledge.names import is_part_name
from mindstage.knowledge.vocabulary import NAMED_INDIVIDUAL, TYPE
from mindstage.knowledge.wording.parts import Part
from mindstage.knowledge.wording.statements import Heard
from mindstage.world import Anonymous, Fact, FactValue, Iri, Literal, Reference

__all__ = ["PartReader"]

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class _Found:
    index: int
    node: Iri | None
    """None for a part without a name."""
    value: Any
    left: tuple[Fact, ...]


class PartReader:
    """Takes parts out of a graph. The first one that can be understood counts; the others stay as they are."""

    def __init__(self, graph: Graph, individuals: Container[Iri], report: Report) -> None:
        """Begins with nothing taken.

        Args:
            graph: where parts are looked up.
            individuals: things of their own, which are nobody's part.
            report: where findings go.
        """
        self._graph = graph
        self._individuals = individuals
        self._report = report
        self._roles: dict[Iri, Part[Any]] = {}
        self.left: dict[Iri, tuple[Fact, ...]] = {}
        """By part that was taken, what nothing was made of; often nothing."""

    def take(self, heard: Heard, part: Part[T]) -> T | None:
        """The part of an individual, or None; only if there is one, anything is taken."""
        found: _Found | None = None
        for index in heard.at(part.property):
            other = self._look(heard, index, part)
            if other is None:
                continue
            if found is None:
                found = other
            elif other.value != found.value:
                heard.warn(part.property, "it is told twice, differently", "the first counts, the other stays a fact")
        if found is None:
            self._leave_to_the_writer(heard, part)
            return None
        if found.node is not None:
            self._roles[found.node] = part
            self.left[found.node] = found.left
        if self._says_nothing_more(heard, part, found):
            heard.take(found.index)
        else:
            heard.lead(found.index)
        value: T = found.value
        return value

    def _look(self, heard: Heard, index: int, part: Part[T]) -> _Found | None:
        told = heard.facts[index].value
        node, facts = None, ()  # type: Iri | None, Iterable[Fact]
        if isinstance(told, Reference):
            node, facts = told.iri, self._graph.get(told.iri, ())
            if not facts or node in self._individuals or self._roles.get(node, part) is not part:
                why = "stands for something else as well" if facts else "is not described anywhere"
                heard.warn(part.property, f"{node} {why}", "it stays a fact")
                return None
        elif isinstance(told, Anonymous):
            facts = told.facts
        else:
            heard.warn(part.property, f"{told.text!r} is a text and not a thing", "it stays a fact")
            return None
        inner = Heard(node or heard.subject, tuple(facts), self._report, is_part=True)
        inner.drop(TYPE, NAMED_INDIVIDUAL, part.cls)
        value = part.read(inner)
        return None if value is None else _Found(index, node, value, inner.left())

    def _leave_to_the_writer(self, heard: Heard, part: Part[Any]) -> None:
        """A mere name that nothing is said of, and that the part gets anyway where it is written."""
        if len(heard.at(part.property)) == 1:
            for index, name in heard.references(part.property):
                if name not in self._graph and self._is_own_name(name, heard, part):
                    heard.take(index)

    def _is_own_name(self, node: Iri, heard: Heard, part: Part[Any]) -> bool:
        return is_part_name(node, heard.subject, part.suffix) and self._mentions[node] == 1

    def _says_nothing_more(self, heard: Heard, part: Part[T], found: _Found) -> bool:
        """Whether the part's name and all about it come back by themselves when it is written."""
        others = [heard.facts[index].value for index in heard.at(part.property) if index != found.index]
        if found.left or (others and not self._stands_for_something_else(others[0], part)):
            return False
        if found.node is None:
            return True
        return self._is_own_name(found.node, heard, part)

    def _stands_for_something_else(self, told: FactValue, part: Part[Any]) -> bool:
        """Whether a writer would take it for no name of this part either, and make one up."""
        if isinstance(told, Reference):
            return told.iri in self._individuals or self._roles.get(told.iri, part) is not part
        return isinstance(told, Literal)

    @cached_property
    def _mentions(self) -> Counter[Iri]:
        counter: Counter[Iri] = Counter()
        waiting: list[Iterable[Fact]] = list(self._graph.values())
        while waiting:
            for fact in waiting.pop():
                if isinstance(fact.value, Reference):
                    counter[fact.value.iri] += 1
                elif isinstance(fact.value, Anonymous):
                    waiting.append(fact.value.facts)
        return counter
