"""Residence: who lives in which map, where a dialect leaves that to be understood.

In KnowRob 1 a part belongs to the map of its whole, and in the oldest maps nobody says where he belongs. KnowRob 2 has
no word for a map at all: a file is one. What follows is said here in the words of dialect 1, so that maps, questions
and analyzes need not know of any of this.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

from mindstage.knowledge.graph import Graph
from mindstage.knowledge.names import local_name, namespace_of
from mindstage.knowledge.reading.census import types_of
from mindstage.knowledge.reading.other_words import CONNECTIONS, OBJECT_ACTED_ON, POSE_PROPERTIES, TO_PARTS, TO_WHOLES
from mindstage.knowledge.vocabulary import DESCRIBED_IN_MAP, DIALECT, ONTOLOGY, SEMANTIC_MAP, TYPE
from mindstage.world import Iri, IriRef, PropertyAssertion

__all__ = ["inferred_membership", "with_inferred_membership"]


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
