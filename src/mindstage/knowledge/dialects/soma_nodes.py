"""SOMA's nodes: values that stand some things without a name away from what they are said of.

An object has a localization, which has a region, which has numbers; how many of those stand between differs from map to
map, so a value is looked for among all that hangs below, the nearest first.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterable, Iterator, Sequence
from typing import NamedTuple

from mindstage.knowledge.graph import Graph
from mindstage.knowledge.names import local_name
from mindstage.knowledge.reading.census import types_of
from mindstage.knowledge.wording import words
from mindstage.world import BlankNode, FactValue, Iri, IriRef, PropertyAssertion

__all__ = ["RdfNode", "RdfNodes"]

_MAX_DEPTH = 5
_BRACKETS = re.compile(r"[\[\]()]")
_SEPARATORS = re.compile(r"[\s,;]+")


class RdfNode(NamedTuple):
    """A thing, and what is said about it."""

    name: Iri | None
    facts: Sequence[PropertyAssertion]

    def types(self) -> tuple[str, ...]:
        """The local names of its classes."""
        return tuple(local_name(cls) for cls in types_of(self.facts))

    def values(self, *properties: Iri) -> list[FactValue]:
        """All that is said by some properties."""
        return [fact.value for fact in self.facts if fact.property in properties]

    def has(self, *properties: Iri) -> bool:
        """Whether anything is said by some properties."""
        return any(fact.property in properties for fact in self.facts)

    def number(self, *properties: Iri) -> float | None:
        """The first finite number that is said by some properties."""
        numbers = (words.parse_number(words.literal_text(value) or "") for value in self.values(*properties))
        return next((number for number in numbers if number is not None), None)

    def numbers(self, *properties: Iri) -> tuple[float, ...]:
        """The first row of finite numbers that is said by some properties; none where one of them is no number."""
        for value in self.values(*properties):
            text = _BRACKETS.sub(" ", words.literal_text(value) or "").strip()
            row = [words.parse_number(part) for part in _SEPARATORS.split(text)]
            numbers = tuple(number for number in row if number is not None)
            if len(numbers) == len(row):
                return numbers
        return ()


class RdfNodes:
    """The things of a graph, nested or not."""

    def __init__(self, graph: Graph, individuals: Container[Iri] = ()) -> None:
        """Looks nothing up yet.

        Args:
            graph: what is said.
            individuals: things of their own, below which nothing of another one hangs.
        """
        self._graph, self._individuals = graph, individuals

    def node_from_value(self, value: FactValue) -> RdfNode | None:
        """What a value stands for, if it is a thing that something is said about."""
        if isinstance(value, BlankNode):
            return RdfNode(None, value.facts)
        if isinstance(value, IriRef) and value.iri in self._graph:
            return RdfNode(value.iri, self._graph[value.iri])
        return None

    def node_named(self, subject: Iri) -> RdfNode:
        """A thing by its name."""
        return RdfNode(subject, self._graph.get(subject, ()))

    def descendants(self, start: RdfNode, *properties: Iri, depth: int = _MAX_DEPTH) -> Iterator[RdfNode]:
        """What hangs on some properties of a thing, and what hangs on that, the nearest first."""
        seen = set() if start.name is None else {start.name}
        level = self._child_nodes(start.values(*properties), seen)
        for _ in range(depth):
            yield from level
            level = self._child_nodes((fact.value for above in level for fact in above.facts), seen)

    def _child_nodes(self, values: Iterable[FactValue], seen: set[Iri]) -> list[RdfNode]:
        """The things among some values, each named one once: a web of names has more ways than anyone could go."""
        found = []
        for value in values:
            if isinstance(value, BlankNode):
                found.append(RdfNode(None, value.facts))
            elif isinstance(value, IriRef) and value.iri not in seen and self._is_nested(value.iri):
                seen.add(value.iri)
                found.append(RdfNode(value.iri, self._graph[value.iri]))
        return found

    def _is_nested(self, name: Iri) -> bool:
        return name in self._graph and name not in self._individuals
