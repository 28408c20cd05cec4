"""Membership: which maps a graph contains, and which individuals belong to each of them.

In KnowRob 1 a part belongs to the map of its whole, and the oldest maps do not state membership at all. KnowRob 2 has
no map class: a file is a map. What follows from this is added as `describedInMap` statements of dialect 1, so that
readers and queries need only these.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

from mindstage.maps.rdf_mapping.nested import NESTED_RESOURCES
from mindstage.maps.rdf_mapping.properties import QUATERNION, TRANSLATION
from mindstage.rdf.graphs import FindingSink, Graph, Severity, local_name, namespace_of
from mindstage.rdf.vocabulary import (
    ASSUMED_PARENT,
    CHILD,
    CONNECTIONS,
    CONSTRAINT,
    DESCRIBED_IN_MAP,
    DIALECT,
    HAS_POSE,
    NAMED_INDIVIDUAL,
    OBJECT_ACTED_ON,
    ONTOLOGY,
    PARENT,
    POSE_PROPERTIES,
    SEMANTIC_MAP,
    SUCCEEDING_JOINT,
    SUCCEEDING_LINK,
    TO_PARTS,
    TO_WHOLES,
    TYPE,
)
from mindstage.scene import BlankNode, FactValue, Iri, IriRef, PropertyAssertion

__all__ = [
    "MapMembers",
    "check_dependency_circles",
    "individuals_by_map",
    "inferred_membership",
    "is_membership",
    "node_facts",
    "pose_facts",
    "references",
    "types_of",
    "with_inferred_membership",
    "without_other_maps",
]


_KINEMATIC = (SUCCEEDING_LINK, SUCCEEDING_JOINT)
MapMembers = Mapping[Iri, Sequence[Iri]]
"""Individuals by map, in the order of the graph. A map has the map class or is the object of `describedInMap`."""

_DEPENDENCY = re.compile(r"depends[-_ ]?on", re.IGNORECASE)
_PART_CLASSES = frozenset(part.cls for part in NESTED_RESOURCES)
_PART_PROPERTIES = frozenset(part.property for part in NESTED_RESOURCES)


def types_of(facts: Iterable[PropertyAssertion]) -> tuple[Iri, ...]:
    """Returns the classes that a resource is declared to have, without `owl:NamedIndividual`."""
    types = [fact.value.iri for fact in facts if fact.property == TYPE and isinstance(fact.value, IriRef)]
    return tuple(cls for cls in types if cls != NAMED_INDIVIDUAL)


def references(facts: Iterable[PropertyAssertion], property: Iri) -> list[Iri]:
    """Returns the resources that some statements with a property refer to."""
    return [fact.value.iri for fact in facts if fact.property == property and isinstance(fact.value, IriRef)]


def node_facts(graph: Graph, value: FactValue) -> Sequence[PropertyAssertion]:
    """Returns the statements about the resource that a statement refers to; none about a literal."""
    if isinstance(value, BlankNode):
        return value.facts
    return graph.get(value.iri, ()) if isinstance(value, IriRef) else ()


def pose_facts(graph: Graph, facts: Iterable[PropertyAssertion]) -> Sequence[PropertyAssertion] | None:
    """Returns the statements about the first valid pose of an individual; None if it has none.

    Args:
        graph: the statements of the map.
        facts: those about the individual.
    """
    nodes = (node_facts(graph, fact.value) for fact in facts if fact.property == HAS_POSE)
    return next((node for node in nodes if TRANSLATION.first_value(node) and QUATERNION.first_value(node)), None)


def individuals_by_map(graph: Graph) -> MapMembers:
    """Returns the maps of a graph and their members."""
    members_by_map: dict[Iri, dict[Iri, None]] = {}
    constraints: dict[Iri, None] = {}
    map_class, constraint_class = IriRef(SEMANTIC_MAP), IriRef(CONSTRAINT)
    for subject, facts in graph.items():
        for fact in facts:
            if fact.property == DESCRIBED_IN_MAP and isinstance(fact.value, IriRef):
                members_by_map.setdefault(fact.value.iri, {})[subject] = None
            elif fact.property == TYPE and fact.value == map_class:
                members_by_map.setdefault(subject, {})
            elif fact.property == TYPE and fact.value == constraint_class:
                constraints[subject] = None
    _assign_constraints(graph, constraints, members_by_map)
    return {
        map: [member for member in members if member != map and not _is_nested_resource(graph[member])]
        for map, members in members_by_map.items()
    }


def _assign_constraints(
    graph: Graph, constraints: Iterable[Iri], members_by_map: Mapping[Iri, dict[Iri, None]]
) -> None:
    """Assigns constraints without `describedInMap`, as in early maps, to the map of a body that they join."""
    maps: dict[Iri, Iri] = {}
    for map, members in members_by_map.items():
        for member in members:
            maps.setdefault(member, map)
    ends: dict[Iri, list[Iri]] = {}
    for constraint in constraints:
        if constraint not in maps:
            references = (fact for fact in graph[constraint] if fact.property in (ASSUMED_PARENT, PARENT, CHILD))
            ends[constraint] = [fact.value.iri for fact in references if isinstance(fact.value, IriRef)]
    if not ends:
        return
    for member in maps:
        for fact in graph.get(member, ()):
            if isinstance(fact.value, IriRef) and fact.value.iri in ends and fact.property in (PARENT, CHILD):
                ends[fact.value.iri].append(member)
    for constraint, others in ends.items():
        if map_iri := next((maps[other] for other in others if other in maps), None):
            members_by_map[map_iri][constraint] = None


def check_dependency_circles(graph: Graph, report: FindingSink) -> None:
    """Reports individuals that depend on themselves, directly or by others; each circle once.

    A property states a dependency if its name begins with "dependsOn" or "depends-on", in any vocabulary.
    """
    needed: dict[Iri, list[tuple[Iri | None, Iri]]] = {}
    for subject, facts in graph.items():
        for fact in facts:
            if isinstance(fact.value, IriRef) and _DEPENDENCY.match(local_name(fact.property)):
                needed.setdefault(subject, []).append((fact.property, fact.value.iri))
    finished: set[Iri] = set()
    for start, first in needed.items():
        path = {} if start in finished else {start: iter(first)}
        while path:
            here, others = next(reversed(path.items()))
            property, other = next(others, (None, here))
            if property is None:
                finished.add(here)
                del path[here]
            elif other in path:
                names = [local_name(each) for each in path]
                circle = [*names[list(path).index(other) :], local_name(other)]
                problem = f"it depends on itself: {' → '.join(circle)}"
                report(Severity.WARNING, other, property, problem, "the statements are kept; nothing follows from them")
            elif other not in finished and other in needed:
                path[other] = iter(needed[other])


def without_other_maps(graph: Graph, map: Iri, members_by_map: MapMembers) -> Graph:
    """Returns the graph without other maps, their members and the nested resources of these."""
    if members_by_map.keys() <= {map}:
        return graph
    own = {map, *members_by_map.get(map, ())}
    others = (members_by_map.keys() | {member for members in members_by_map.values() for member in members}) - own
    parts = set(_nested_resources(graph, others)) - set(_nested_resources(graph, own)) - own
    excluded = others | parts
    return {subject: facts for subject, facts in graph.items() if subject not in excluded}


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


def is_membership(fact: PropertyAssertion, map: Iri) -> bool:
    """Whether a statement makes its subject a map, or a member of one map."""
    if fact.property == DESCRIBED_IN_MAP:
        return fact.value == IriRef(map)
    return fact.property == TYPE and fact.value == IriRef(SEMANTIC_MAP)


def with_inferred_membership(graph: Graph) -> Graph:
    """Returns the graph extended by inferred membership."""
    inferred = inferred_membership(graph)
    if not inferred:
        return graph
    return {subject: [*graph.get(subject, ()), *inferred.get(subject, ())] for subject in {**graph, **inferred}}


def inferred_membership(graph: Graph) -> dict[Iri, list[PropertyAssertion]]:
    """Returns the membership statements that follow from a graph; empty if all membership is stated."""
    map_of = _map_of_individual(graph)
    maps = _semantic_maps(graph) | dict.fromkeys(map_of.values())
    placed = _individuals_with_pose(graph, POSE_PROPERTIES if maps else (HAS_POSE, *POSE_PROPERTIES))
    if not placed or any(fact.property == DIALECT for map in _semantic_maps(graph) for fact in graph[map]):
        return {}  # Mindstage writes all membership explicitly
    inferred: dict[Iri, list[PropertyAssertion]] = {}
    if not maps:
        map = _derive_map_iri(graph, placed)
        inferred[map] = [PropertyAssertion(TYPE, IriRef(SEMANTIC_MAP))]
        maps[map] = None
    if len(maps) == 1:
        only = next(iter(maps))
        unassigned = (individual for individual in placed if individual not in map_of and individual not in maps)
        map_of |= dict.fromkeys(unassigned, only)
    stated = set(_map_of_individual(graph))
    for individual, map in _propagate_maps(graph, map_of).items():
        if individual not in stated and individual not in maps:
            inferred.setdefault(individual, []).append(PropertyAssertion(DESCRIBED_IN_MAP, IriRef(map)))
    return inferred


def _individuals_with_pose(graph: Graph, properties: Collection[Iri]) -> dict[Iri, None]:
    """Returns the individuals that have a pose by one of these properties; by `knowrob:pose` if they have a class."""
    placed: dict[Iri, None] = {}
    for subject, facts in graph.items():
        for fact in facts:
            if fact.property not in properties or (fact.property == HAS_POSE and not types_of(facts)):
                continue
            if fact.property != OBJECT_ACTED_ON:
                placed[subject] = None
            elif isinstance(fact.value, IriRef):
                placed[fact.value.iri] = None
    return {subject: None for subject in placed if subject in graph}


def _map_of_individual(graph: Graph) -> dict[Iri, Iri]:
    """Returns the first `describedInMap` value of each individual."""
    map_of: dict[Iri, Iri] = {}
    for subject, facts in graph.items():
        for fact in facts:
            if fact.property == DESCRIBED_IN_MAP and isinstance(fact.value, IriRef):
                map_of.setdefault(subject, fact.value.iri)
    return map_of


def _semantic_maps(graph: Graph) -> dict[Iri, None]:
    is_map = PropertyAssertion(TYPE, IriRef(SEMANTIC_MAP))
    return {subject: None for subject, facts in graph.items() if is_map in facts}


def _propagate_maps(graph: Graph, map_of: Mapping[Iri, Iri]) -> dict[Iri, Iri]:
    """Returns `map_of` extended to all individuals that are connected to its members, from wholes to parts."""
    neighbors = _connected(graph)
    found = dict(map_of)
    pending = list(map_of)
    while pending:
        here = pending.pop()
        for other in neighbors.get(here, ()):
            if other not in found and types_of(graph.get(other, ())):
                found[other] = found[here]
                pending.append(other)
    return found


def _connected(graph: Graph) -> Mapping[Iri, Sequence[Iri]]:
    neighbors: dict[Iri, list[Iri]] = {}
    for subject, facts in graph.items():
        for fact in facts:
            if isinstance(fact.value, IriRef):
                if fact.property in TO_PARTS or fact.property in CONNECTIONS or fact.property in _KINEMATIC:
                    neighbors.setdefault(subject, []).append(fact.value.iri)
                if fact.property in TO_WHOLES or fact.property in CONNECTIONS or fact.property == SUCCEEDING_JOINT:
                    neighbors.setdefault(fact.value.iri, []).append(subject)
    return neighbors


def _derive_map_iri(graph: Graph, individuals: Iterable[Iri]) -> Iri:
    """Returns an IRI for a map without one: from its ontology, or from the most common namespace of its individuals."""
    ontologies = [subject for subject, facts in graph.items() if ONTOLOGY in types_of(facts) and subject[:2] != "_:"]
    namespaces = Counter(namespace_of(individual) for individual in individuals if not individual.startswith("_:"))
    common = max(namespaces, key=namespaces.__getitem__, default="")
    source = (ontologies[0] if ontologies else common).rstrip("#/")
    stem = re.sub(r"\.(owl|rdf|ttl|xml)$", "", local_name(source)) or "map"
    name = f"{source}#{stem}"
    return Iri(name if name not in graph else f"{name}-map")
