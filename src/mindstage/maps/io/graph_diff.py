"""The difference between two maps on the level of statements: what a written file does not contain of its source.

Numbers are compared by value, and blank nodes by their statements. Nested resources that a writer names itself (poses,
limits) are compared as part of the individual that they belong to.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from mindstage.maps.dialects.detection import detect_dialect
from mindstage.maps.dialects.membership import types_of
from mindstage.maps.dialects.soma_nodes import POSE_6D, without_restatements
from mindstage.maps.dialects.source_map import SourceMap
from mindstage.maps.dialects.unit_conversion import (
    original_conventions,
    original_property,
    restore_declarations,
    restore_facts,
    restore_size_declaration,
)
from mindstage.maps.rdf_mapping import properties as codecs
from mindstage.maps.rdf_mapping.nested import NESTED_RESOURCES
from mindstage.maps.rdf_mapping.properties import PropertyCodec
from mindstage.rdf.graphs import Graph, gc_paused, is_part_name, merge_graphs
from mindstage.rdf.vocabulary import CHILD, GIVEN_SIZES, PARENT
from mindstage.scene import BlankNode, Iri, IriRef, NamedResource, PropertyAssertion, Statement, World, diff

__all__ = ["SourceMapView", "canonical_statement", "lost_statements"]


@dataclass(frozen=True, slots=True)
class SourceMapView:
    """The statements of one map, as its sources contain them."""

    source_map: SourceMap
    """The map with all that is needed to read its dialect."""
    world: World | None = None
    """The world that these statements alone describe, if they have been read before."""

    def before_conversion(self) -> SourceMapView | None:
        """The map before its numbers were converted; None if it does not declare a conversion."""
        graph, map = self.source_map.graph, self.source_map.map
        conventions = original_conventions(graph.get(map, ()))
        if conventions is None:
            if not any(fact.property == GIVEN_SIZES for fact in graph.get(map, ())):
                return None
            restored = {**graph, map: restore_size_declaration(graph[map])}
            return SourceMapView(replace(self.source_map, graph=restored))
        before = {subject: restore_facts(facts, conventions) for subject, facts in graph.items()}
        before[map] = restore_declarations(before[map], conventions)
        return SourceMapView(replace(self.source_map, graph=before))

    @property
    def map(self) -> Iri:
        """The IRI of the map."""
        return self.source_map.map

    @property
    def dialect(self) -> str:
        """The name of the map's dialect."""
        return detect_dialect(without_restatements(self.source_map)).name


_ORIGINAL_ROLES = {original_property(role): role for role in (PARENT, CHILD)}
_NESTED_BY_PROPERTY = {part.property: part for part in NESTED_RESOURCES}
_NUMBER_CODECS: Mapping[Iri, PropertyCodec[object]] = {
    codec.property: codec
    for each in (*vars(codecs).values(), *codecs.SOFT_LIMITS.values())
    for codec in (each.values() if isinstance(each, dict) else each if isinstance(each, tuple) else (each,))
    if isinstance(codec, PropertyCodec) and codec.by_value
}


def lost_statements(
    before: SourceMapView, after: SourceMapView, *, moved: Container[Iri] = ()
) -> tuple[Statement, ...]:
    """The statements of a map that are missing in another map that was written from it.

    The time is linear in the number of statements. Additional statements of the second map are ignored, and so are
    differences in form that it declares: numbers from before a conversion, and properties of another dialect.

    Args:
        after: the written map, read again.
        moved: individuals that have moved; numbers of these and of their nested resources may differ.
    """
    with gc_paused():
        source = _as_resources(before, before.source_map.graph)
        written = _as_resources(after, _graph_in_all_dialects(after), include_nested=True)
        lost = diff(source, written).lost
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
    """A numeric statement in the form that `mindstage` writes; any other statement unchanged."""
    codec = _NUMBER_CODECS.get(fact.property)
    if codec is None:
        return fact
    value = codec.decode(fact.value)
    return (
        fact
        if value is None or not codec.round_trips(value, fact.value)
        else PropertyAssertion(fact.property, codec.encode(value))
    )


def _graph_in_all_dialects(source_view: SourceMapView) -> Graph:
    """The statements of a map, together with those of other dialects and units that it declares them to restate."""
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
    """A relation that the reader has renamed, with its original property."""
    return PropertyAssertion(_ORIGINAL_ROLES.get(fact.property, fact.property), fact.value)


def _as_resources(source_view: SourceMapView, graph: Graph, *, include_nested: bool = False) -> World:
    """The statements of a graph as resources; nested ones count as part of their owners, or as both."""
    members = frozenset(source_view.source_map.members)
    parts = {
        fact.value.iri
        for subject, facts in graph.items()
        for fact in facts
        if isinstance(fact.value, IriRef)
        and _is_generated_nested(subject, fact, graph)
        and fact.value.iri not in members
    }
    resources = (
        (subject, tuple(dict.fromkeys(_flattened(facts, parts, graph))))
        for subject, facts in graph.items()
        if include_nested or subject not in parts
    )
    return World(iri=source_view.map, resources=tuple(NamedResource(subject, facts) for subject, facts in resources))


def _is_generated_nested(subject: Iri, fact: PropertyAssertion, graph: Graph) -> bool:
    """Whether a writer may have named this nested resource."""
    part = _NESTED_BY_PROPERTY.get(fact.property)
    if part is None or not isinstance(fact.value, IriRef):
        return False
    facts = graph.get(fact.value.iri, ())
    return is_part_name(fact.value.iri, subject, part.suffix) and {part.cls, POSE_6D}.issuperset(types_of(facts))


def _flattened(facts: Sequence[PropertyAssertion], parts: Container[Iri], graph: Graph) -> Iterator[PropertyAssertion]:
    """The statements about an individual and its nested resources, the latter under both properties."""
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
