"""Losses: what a map's sources say and a written file does not, statement by statement.

Two graphs are held against each other as worlds are, one level below: by what they state. Numbers count by their
value, things without a name by what is said about them. What a writer names itself (poses, limits) is taken as part of
the thing that it belongs to.

Origins: what a map was before it became a world, for those who hold the two against each other.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from mindstage.knowledge.dialects import detect_dialect
from mindstage.knowledge.dialects.membership import types_of
from mindstage.knowledge.dialects.soma_nodes import POSE_6D, without_restatements
from mindstage.knowledge.dialects.source_map import SourceMap
from mindstage.knowledge.dialects.unit_conversion import (
    original_conventions,
    original_property,
    restore_declarations,
    restore_facts,
)
from mindstage.knowledge.rdf import Graph, gc_paused, is_part_name, merge_graphs
from mindstage.knowledge.rdf_mapping import properties as words
from mindstage.knowledge.rdf_mapping.nested import NESTED_RESOURCES
from mindstage.knowledge.rdf_mapping.properties import PropertyCodec
from mindstage.knowledge.vocabulary import CHILD, PARENT
from mindstage.scene import BlankNode, Iri, IriRef, NamedResource, PropertyAssertion, Statement, World, diff

__all__ = ["SourceMapView", "canonical_statement", "lost_statements"]


@dataclass(frozen=True, slots=True)
class SourceMapView:
    """One map as its sources tell it."""

    source_map: SourceMap
    """All that the reader of its dialect has at hand."""

    def before_conversion(self) -> SourceMapView | None:
        """The map as it was before its numbers were converted; None where it does not say that they were."""
        graph, map = self.source_map.graph, self.source_map.map
        conventions = original_conventions(graph.get(map, ()))
        if conventions is None:
            return None
        before = {subject: restore_facts(facts, conventions) for subject, facts in graph.items()}
        before[map] = restore_declarations(before[map], conventions)
        return SourceMapView(replace(self.source_map, graph=before))

    @property
    def map(self) -> Iri:
        """Which one it is."""
        return self.source_map.map

    @property
    def dialect(self) -> str:
        """What kind of map it is."""
        return detect_dialect(without_restatements(self.source_map)).name


_ORIGINAL_ROLES = {original_property(role): role for role in (PARENT, CHILD)}
_NESTED_BY_PROPERTY = {part.property: part for part in NESTED_RESOURCES}
_NUMBER_CODECS: Mapping[Iri, PropertyCodec[object]] = {
    word.property: word
    for each in vars(words).values()
    for word in (each if isinstance(each, tuple) else (each,))
    if isinstance(word, PropertyCodec) and word.by_value
}


def lost_statements(
    before: SourceMapView, after: SourceMapView, *, moved: Container[Iri] = ()
) -> tuple[Statement, ...]:
    """The statements of one map that another one, written from it, does not make.

    Takes a time that grows with the number of statements. What the second one says beyond the first is no loss, and
    what it says in other words is none if it says which: numbers that it keeps from before they were converted, and
    places that stand where another dialect has them.

    Args:
        before: the map.
        after: what was written and read again.
        moved: things that are somewhere else by now; numbers about them, and about their parts, may differ.
    """
    with gc_paused():
        told = _as_resources(before, before.source_map.graph)
        said = _as_resources(after, _graph_in_all_dialects(after), include_nested=True)
        lost = diff(told, said).lost
    parts = {
        fact.value.iri
        for subject, facts in before.source_map.graph.items()
        if subject in moved
        for fact in facts
        if fact.property in _NESTED_BY_PROPERTY and isinstance(fact.value, IriRef)
    }
    return tuple(each for each in lost if not ((each.id in moved or each.id in parts) and _is_number(each)))


def _is_number(statement: Statement) -> bool:
    return (
        isinstance(statement.assertion, PropertyAssertion)
        and statement.assertion.property.split()[-1] in _NUMBER_CODECS
    )


def canonical_statement(fact: PropertyAssertion) -> PropertyAssertion:
    """The statement as we would write it, if it says a number."""
    word = _NUMBER_CODECS.get(fact.property)
    if word is None:
        return fact
    value = word.decode(fact.value)
    return (
        fact
        if value is None or not word.round_trips(value, fact.value)
        else PropertyAssertion(fact.property, word.encode(value))
    )


def _graph_in_all_dialects(source_view: SourceMapView) -> Graph:
    """What a map says, in its own words and in those that it says they stand for."""
    plain = SourceMapView(without_restatements(source_view.source_map))
    graphs = [source_view.source_map.graph, plain.source_map.graph]
    if (before := plain.before_conversion()) is not None:
        graphs.append(
            {
                subject: [_with_original_property(fact) for fact in facts]
                for subject, facts in before.source_map.graph.items()
            }
        )
    return merge_graphs(graphs)


def _with_original_property(fact: PropertyAssertion) -> PropertyAssertion:
    """A relation that a reader has put another name on, under its own one."""
    return PropertyAssertion(_ORIGINAL_ROLES.get(fact.property, fact.property), fact.value)


def _as_resources(source_view: SourceMapView, graph: Graph, *, include_nested: bool = False) -> World:
    """The statements of a graph by what they are about: parts count as their wholes, or as both."""
    members = frozenset(source_view.source_map.members)
    parts = {
        fact.value.iri
        for subject, facts in graph.items()
        for fact in facts
        if isinstance(fact.value, IriRef)
        and _is_generated_nested(subject, fact, graph)
        and fact.value.iri not in members
    }
    told = (
        (subject, tuple(dict.fromkeys(_flattened(facts, parts, graph))))
        for subject, facts in graph.items()
        if include_nested or subject not in parts
    )
    return World(iri=source_view.map, resources=tuple(NamedResource(subject, facts) for subject, facts in told))


def _is_generated_nested(subject: Iri, fact: PropertyAssertion, graph: Graph) -> bool:
    """Whether a writer may have given this part its name."""
    part = _NESTED_BY_PROPERTY.get(fact.property)
    if part is None or not isinstance(fact.value, IriRef):
        return False
    facts = graph.get(fact.value.iri, ())
    return is_part_name(fact.value.iri, subject, part.suffix) and {part.cls, POSE_6D}.issuperset(types_of(facts))


def _flattened(facts: Sequence[PropertyAssertion], parts: Container[Iri], graph: Graph) -> Iterator[PropertyAssertion]:
    """What is said about a thing, and of its parts, each under the names of both."""
    for fact in facts:
        value = fact.value
        inner: Sequence[PropertyAssertion] | None = None
        if fact.property in _NESTED_BY_PROPERTY:
            if isinstance(value, BlankNode):
                inner = value.facts
            elif isinstance(value, IriRef) and value.iri in parts:
                inner = graph[value.iri]
        if inner is None:
            yield canonical_statement(fact)
        else:
            yield from (
                PropertyAssertion(Iri(f"{fact.property} {each.property}"), canonical_statement(each).value)
                for each in inner
            )
