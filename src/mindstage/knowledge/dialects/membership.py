"""Residence: who lives in which map, where a dialect leaves that to be understood.

In KnowRob 1 a part belongs to the map of its whole, and in the oldest maps nobody says where he belongs. KnowRob 2 has
no word for a map at all: a file is one. What follows is said here in the words of dialect 1, so that maps, questions
and analyzes need not know of any of this.

The census: which maps a graph tells of, who lives in each, and what belongs to none but the others.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence

from mindstage.knowledge.rdf import Graph, local_name, namespace_of
from mindstage.knowledge.rdf_mapping.nested import NESTED_RESOURCES
from mindstage.knowledge.vocabulary import (
    CHILD,
    CONNECTIONS,
    CONSTRAINT,
    DESCRIBED_IN_MAP,
    DIALECT,
    NAMED_INDIVIDUAL,
    OBJECT_ACTED_ON,
    ONTOLOGY,
    PARENT,
    POSE_PROPERTIES,
    SEMANTIC_MAP,
    TO_PARTS,
    TO_WHOLES,
    TYPE,
)
from mindstage.scene import Iri, IriRef, PropertyAssertion

__all__ = [
    "MapMembers",
    "individuals_by_map",
    "inferred_membership",
    "types_of",
    "with_inferred_membership",
    "without_other_maps",
]


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


def with_inferred_membership(graph: Graph) -> Graph:
    """The graph, and with it what follows about who lives where."""
    more = inferred_membership(graph)
    if not more:
        return graph
    return {subject: [*graph.get(subject, ()), *more.get(subject, ())] for subject in {**graph, **more}}


def inferred_membership(graph: Graph) -> dict[Iri, list[PropertyAssertion]]:
    """What follows about who lives where; nothing, where all is said."""
    placed = _individuals_with_pose(graph)
    if not placed or any(fact.property == DIALECT for map in _semantic_maps(graph) for fact in graph[map]):
        return {}  # maps that we write say all of it
    homes = _map_of_individual(graph)
    maps = _semantic_maps(graph) | dict.fromkeys(map for map in homes.values())
    following: dict[Iri, list[PropertyAssertion]] = {}
    if not maps:
        map = _derive_map_iri(graph, placed)
        following[map] = [PropertyAssertion(TYPE, IriRef(SEMANTIC_MAP))]
        maps[map] = None
    if len(maps) == 1:
        only = next(iter(maps))
        placed_nowhere = (individual for individual in placed if individual not in homes and individual not in maps)
        homes |= dict.fromkeys(placed_nowhere, only)
    told = set(_map_of_individual(graph))
    for individual, map in _propagate_maps(graph, homes).items():
        if individual not in told and individual not in maps:
            following.setdefault(individual, []).append(PropertyAssertion(DESCRIBED_IN_MAP, IriRef(map)))
    return following


def _individuals_with_pose(graph: Graph) -> dict[Iri, None]:
    """What other dialects give a place."""
    placed: dict[Iri, None] = {}
    for subject, facts in graph.items():
        for fact in facts:
            if fact.property not in POSE_PROPERTIES:
                continue
            if fact.property != OBJECT_ACTED_ON:
                placed[subject] = None
            elif isinstance(fact.value, IriRef):
                placed[fact.value.iri] = None
    return {subject: None for subject in placed if subject in graph}


def _map_of_individual(graph: Graph) -> dict[Iri, Iri]:
    """By individual, the first map that it says to be described in."""
    homes: dict[Iri, Iri] = {}
    for subject, facts in graph.items():
        for fact in facts:
            if fact.property == DESCRIBED_IN_MAP and isinstance(fact.value, IriRef):
                homes.setdefault(subject, fact.value.iri)
    return homes


def _semantic_maps(graph: Graph) -> dict[Iri, None]:
    called = PropertyAssertion(TYPE, IriRef(SEMANTIC_MAP))
    return {subject: None for subject, facts in graph.items() if called in facts}


def _propagate_maps(graph: Graph, map_of: Mapping[Iri, Iri]) -> dict[Iri, Iri]:
    """Homes, and those of all that hangs together with who has one, wholes before parts."""
    neighbors = _connected(graph)
    found = dict(map_of)
    waiting = list(map_of)
    while waiting:
        here = waiting.pop()
        for other in neighbors.get(here, ()):
            if other not in found and types_of(graph.get(other, ())):
                found[other] = found[here]
                waiting.append(other)
    return found


def _connected(graph: Graph) -> Mapping[Iri, Sequence[Iri]]:
    neighbors: dict[Iri, list[Iri]] = {}
    for subject, facts in graph.items():
        for fact in facts:
            if isinstance(fact.value, IriRef):
                if fact.property in TO_PARTS or fact.property in CONNECTIONS:
                    neighbors.setdefault(subject, []).append(fact.value.iri)
                if fact.property in TO_WHOLES or fact.property in CONNECTIONS:
                    neighbors.setdefault(fact.value.iri, []).append(subject)
    return neighbors


def _derive_map_iri(graph: Graph, individuals: Iterable[Iri]) -> Iri:
    """A name for a map that has none: that of the ontology which it is, or of the namespace that most things are in."""
    ontologies = [subject for subject, facts in graph.items() if ONTOLOGY in types_of(facts) and subject[:2] != "_:"]
    namespaces = Counter(namespace_of(individual) for individual in individuals if not individual.startswith("_:"))
    common = max(namespaces, key=namespaces.__getitem__, default="")
    source = (ontologies[0] if ontologies else common).rstrip("#/")
    stem = re.sub(r"\.(owl|rdf|ttl|xml)$", "", local_name(source)) or "map"
    name = f"{source}#{stem}"
    return Iri(name if name not in graph else f"{name}-map")
