"""Reading parts: finds an individual's pose and the like, and remembers what is left of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

from mindstage.knowledge.findings import FindingSink
from mindstage.knowledge.graph import Graph
from mindstage.knowledge.names import is_part_name
from mindstage.knowledge.vocabulary import NAMED_INDIVIDUAL, TYPE
from mindstage.knowledge.wording.parts import NestedResource
from mindstage.knowledge.wording.statements import SubjectReader
from mindstage.world import BlankNode, FactValue, Iri, IriRef, Literal, PropertyAssertion

__all__ = ["NestedResourceReader"]

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class _NestedValue:
    index: int
    node: Iri | None
    """None for a part without a name."""
    value: Any
    remaining: tuple[PropertyAssertion, ...]


class NestedResourceReader:
    """Takes parts out of a graph. The first one that can be understood counts; the others stay as they are."""

    def __init__(self, graph: Graph, individuals: Container[Iri], report: FindingSink) -> None:
        """Begins with nothing taken.

        Args:
            graph: where parts are looked up.
            individuals: things of their own, which are nobody's part.
            report: where findings go.
        """
        self._graph = graph
        self._individuals = individuals
        self._report = report
        self._resource_types: dict[Iri, NestedResource[Any]] = {}
        self.remaining_facts: dict[Iri, tuple[PropertyAssertion, ...]] = {}
        """By part that was taken, what nothing was made of; often nothing."""

    def read(self, reader: SubjectReader, nested_resource: NestedResource[T]) -> T | None:
        """The part of an individual, or None; only if there is one, anything is taken."""
        found: _NestedValue | None = None
        for index in reader.indexes_of(nested_resource.property):
            other = self._parse(reader, index, nested_resource)
            if other is None:
                continue
            if found is None:
                found = other
            elif other.value != found.value:
                reader.warn(
                    nested_resource.property,
                    "it is told twice, differently",
                    "the first counts, the other stays a fact",
                )
        if found is None:
            self._consume_generated_name(reader, nested_resource)
            return None
        if found.node is not None:
            self._resource_types[found.node] = nested_resource
            self.remaining_facts[found.node] = found.remaining
        if self._is_redundant(reader, nested_resource, found):
            reader.consume(found.index)
        else:
            reader.mark_leading(found.index)
        value: T = found.value
        return value

    def _parse(self, reader: SubjectReader, index: int, nested_resource: NestedResource[T]) -> _NestedValue | None:
        told = reader.facts[index].value
        node, facts = None, ()  # type: Iri | None, Iterable[PropertyAssertion]
        if isinstance(told, IriRef):
            node, facts = told.iri, self._graph.get(told.iri, ())
            if (
                not facts
                or node in self._individuals
                or self._resource_types.get(node, nested_resource) is not nested_resource
            ):
                why = "stands for something else as well" if facts else "is not described anywhere"
                reader.warn(nested_resource.property, f"{node} {why}", "it stays a fact")
                return None
        elif isinstance(told, BlankNode):
            facts = told.facts
        else:
            reader.warn(nested_resource.property, f"{told.text!r} is a text and not a thing", "it stays a fact")
            return None
        inner = SubjectReader(node or reader.subject, tuple(facts), self._report, is_nested=True)
        inner.consume_references(TYPE, NAMED_INDIVIDUAL, nested_resource.cls)
        value = nested_resource.read(inner)
        return None if value is None else _NestedValue(index, node, value, inner.remaining())

    def _consume_generated_name(self, reader: SubjectReader, nested_resource: NestedResource[Any]) -> None:
        """A mere name that nothing is said of, and that the part gets anyway where it is written."""
        if len(reader.indexes_of(nested_resource.property)) == 1:
            for index, name in reader.references(nested_resource.property):
                if name not in self._graph and self._is_generated_name(name, reader, nested_resource):
                    reader.consume(index)

    def _is_generated_name(self, node: Iri, reader: SubjectReader, nested_resource: NestedResource[Any]) -> bool:
        return is_part_name(node, reader.subject, nested_resource.suffix) and self._mention_counts[node] == 1

    def _is_redundant(self, reader: SubjectReader, nested_resource: NestedResource[T], found: _NestedValue) -> bool:
        """Whether the part's name and all about it come back by themselves when it is written."""
        others = [
            reader.facts[index].value for index in reader.indexes_of(nested_resource.property) if index != found.index
        ]
        if found.remaining or (others and not self._is_other_resource(others[0], nested_resource)):
            return False
        if found.node is None:
            return True
        return self._is_generated_name(found.node, reader, nested_resource)

    def _is_other_resource(self, value: FactValue, nested_resource: NestedResource[Any]) -> bool:
        """Whether a writer would take it for no name of this part either, and make one up."""
        if isinstance(value, IriRef):
            return (
                value.iri in self._individuals
                or self._resource_types.get(value.iri, nested_resource) is not nested_resource
            )
        return isinstance(value, Literal)

    @cached_property
    def _mention_counts(self) -> Counter[Iri]:
        counter: Counter[Iri] = Counter()
        waiting: list[Iterable[PropertyAssertion]] = list(self._graph.values())
        while waiting:
            for fact in waiting.pop():
                if isinstance(fact.value, IriRef):
                    counter[fact.value.iri] += 1
                elif isinstance(fact.value, BlankNode):
                    waiting.append(fact.value.facts)
        return counter
