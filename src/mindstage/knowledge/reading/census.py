"""The census: which maps a graph tells of, who lives in each, and what belongs to none but the others."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from mindstage.knowledge.graph import Graph
from mindstage.knowledge.vocabulary import (
    CHILD,
    CONSTRAINT,
    DESCRIBED_IN_MAP,
    NAMED_INDIVIDUAL,
    PARENT,
    SEMANTIC_MAP,
    TYPE,
)
from mindstage.knowledge.wording.parts import NESTED_RESOURCES
from mindstage.world import Iri, IriRef, PropertyAssertion

__all__ = ["MapMembers", "individuals_by_map", "types_of", "without_other_maps"]

MapMembers = Mapping[Iri, Sequence[Iri]]
"""By map, its individuals in the order of the graph. A map is what is called one, or what something is described in."""

_PART_CLASSES = frozenset(part.cls for part in NESTED_RESOURCES)
_PART_PROPERTIES = frozenset(part.property for part in NESTED_RESOURCES)


def types_of(facts: Iterable[PropertyAssertion]) -> tuple[Iri, ...]:
    """Classes that a thing is said to be of, but for OWL's remark that it is an individual."""
    types = [fact.value.iri for fact in facts if fact.property == TYPE and isinstance(fact.value, IriRef)]
    return tuple(cls for cls in types if cls != NAMED_INDIVIDUAL)


def individuals_by_map(graph: Graph) -> MapMembers:
    """Goes through a graph once."""
    residents: dict[Iri, dict[Iri, None]] = {}
    homeless: dict[Iri, None] = {}
    map_class, constraint_class = IriRef(SEMANTIC_MAP), IriRef(CONSTRAINT)
    for subject, facts in graph.items():
        for fact in facts:
            if fact.property == DESCRIBED_IN_MAP and isinstance(fact.value, IriRef):
                residents.setdefault(fact.value.iri, {})[subject] = None
            elif fact.property == TYPE and fact.value == map_class:
                residents.setdefault(subject, {})
            elif fact.property == TYPE and fact.value == constraint_class:
                homeless[subject] = None
    _assign_constraints(graph, homeless, residents)
    return {
        map: [member for member in members if member != map and not _is_nested_resource(graph[member])]
        for map, members in residents.items()
    }


def _assign_constraints(
    graph: Graph, constraints: Iterable[Iri], members_by_map: Mapping[Iri, dict[Iri, None]]
) -> None:
    """Early maps do not say where their constraints belong: it is where the things are that they join."""
    maps: dict[Iri, Iri] = {}
    for map, members in members_by_map.items():
        for member in members:
            maps.setdefault(member, map)
    ends: dict[Iri, list[Iri]] = {}
    for constraint in constraints:
        if constraint not in maps:
            told = (fact for fact in graph[constraint] if fact.property in (PARENT, CHILD))
            ends[constraint] = [fact.value.iri for fact in told if isinstance(fact.value, IriRef)]
    if not ends:
        return
    for member in maps:
        for fact in graph.get(member, ()):
            if isinstance(fact.value, IriRef) and fact.value.iri in ends and fact.property in (PARENT, CHILD):
                ends[fact.value.iri].append(member)
    for constraint, others in ends.items():
        if home := next((maps[other] for other in others if other in maps), None):
            members_by_map[home][constraint] = None


def without_other_maps(graph: Graph, map: Iri, members_by_map: MapMembers) -> Graph:
    """The graph without other maps, their individuals, and their individuals' parts."""
    if members_by_map.keys() <= {map}:
        return graph
    own = {map, *members_by_map.get(map, ())}
    strangers = (members_by_map.keys() | {member for members in members_by_map.values() for member in members}) - own
    parts = set(_nested_resources(graph, strangers)) - set(_nested_resources(graph, own)) - own
    away = strangers | parts
    return {subject: facts for subject, facts in graph.items() if subject not in away}


def _nested_resources(graph: Graph, individuals: Iterable[Iri]) -> Iterator[Iri]:
    for individual in individuals:
        for fact in graph.get(individual, ()):
            if fact.property in _PART_PROPERTIES and isinstance(fact.value, IriRef):
                part = graph.get(fact.value.iri, ())
                if not types_of(part) or _is_nested_resource(part):
                    yield fact.value.iri


def _is_nested_resource(facts: Sequence[PropertyAssertion]) -> bool:
    types = types_of(facts)
    return bool(types) and _PART_CLASSES.issuperset(types)
