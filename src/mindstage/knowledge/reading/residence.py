"""Residence: who lives in which map, where a dialect leaves that to be understood.

In KnowRob 1 a part belongs to the map of its whole, and in the oldest maps nobody says where he belongs. KnowRob 2 has
no word for a map at all: a file is one. What follows is said here in the words of dialect 1, so that maps, questions
and analyses need not know of any of this.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

from mindstage.knowledge.graph import Graph
from mindstage.knowledge.names import local_name, namespace_of
from mindstage.knowledge.reading.census import types_of
from mindstage.knowledge.reading.other_words import CONNECTIONS, OBJECT_ACTED_ON, PLACES, TO_PARTS, TO_WHOLES
from mindstage.knowledge.vocabulary import DESCRIBED_IN_MAP, DIALECT, ONTOLOGY, SEMANTIC_MAP, TYPE
from mindstage.world import Fact, Iri, Reference

__all__ = ["settled", "settling"]


def settled(graph: Graph) -> Graph:
    """The graph, and with it what follows about who lives where."""
    more = settling(graph)
    if not more:
        return graph
    return {subject: [*graph.get(subject, ()), *more.get(subject, ())] for subject in {**graph, **more}}


def settling(graph: Graph) -> dict[Iri, list[Fact]]:
    """What follows about who lives where; nothing, where all is said."""
    placed = _placed(graph)
    if not placed or any(fact.property == DIALECT for map in _maps(graph) for fact in graph[map]):
        return {}  # maps that we write say all of it
    homes = _homes(graph)
    maps = _maps(graph) | dict.fromkeys(map for map in homes.values())
    following: dict[Iri, list[Fact]] = {}
    if not maps:
        map = _named_after_its_source(graph, placed)
        following[map] = [Fact(TYPE, Reference(SEMANTIC_MAP))]
        maps[map] = None
    if len(maps) == 1:
        only = next(iter(maps))
        placed_nowhere = (individual for individual in placed if individual not in homes and individual not in maps)
        homes |= dict.fromkeys(placed_nowhere, only)
    told = set(_homes(graph))
    for individual, map in _with_parts(graph, homes).items():
        if individual not in told and individual not in maps:
            following.setdefault(individual, []).append(Fact(DESCRIBED_IN_MAP, Reference(map)))
    return following


def _placed(graph: Graph) -> dict[Iri, None]:
    """What other dialects give a place."""
    placed: dict[Iri, None] = {}
    for subject, facts in graph.items():
        for fact in facts:
            if fact.property not in PLACES:
                continue
            if fact.property != OBJECT_ACTED_ON:
                placed[subject] = None
            elif isinstance(fact.value, Reference):
                placed[fact.value.iri] = None
    return {subject: None for subject in placed if subject in graph}


def _homes(graph: Graph) -> dict[Iri, Iri]:
    """By individual, the first map that it says to be described in."""
    homes: dict[Iri, Iri] = {}
    for subject, facts in graph.items():
        for fact in facts:
            if fact.property == DESCRIBED_IN_MAP and isinstance(fact.value, Reference):
                homes.setdefault(subject, fact.value.iri)
    return homes


def _maps(graph: Graph) -> dict[Iri, None]:
    called = Fact(TYPE, Reference(SEMANTIC_MAP))
    return {subject: None for subject, facts in graph.items() if called in facts}


def _with_parts(graph: Graph, homes: Mapping[Iri, Iri]) -> dict[Iri, Iri]:
    """Homes, and those of all that hangs together with who has one, wholes before parts."""
    neighbours = _neighbours(graph)
    found = dict(homes)
    waiting = list(homes)
    while waiting:
        here = waiting.pop()
        for other in neighbours.get(here, ()):
            if other not in found and types_of(graph.get(other, ())):
                found[other] = found[here]
                waiting.append(other)
    return found


def _neighbours(graph: Graph) -> Mapping[Iri, Sequence[Iri]]:
    neighbours: dict[Iri, list[Iri]] = {}
    for subject, facts in graph.items():
        for fact in facts:
            if isinstance(fact.value, Reference):
                if fact.property in TO_PARTS or fact.property in CONNECTIONS:
                    neighbours.setdefault(subject, []).append(fact.value.iri)
                if fact.property in TO_WHOLES or fact.property in CONNECTIONS:
                    neighbours.setdefault(fact.value.iri, []).append(subject)
    return neighbours


def _named_after_its_source(graph: Graph, placed: Iterable[Iri]) -> Iri:
    """A name for a map that has none: that of the ontology which it is, or of the namespace that most things are in."""
    ontologies = [subject for subject, facts in graph.items() if ONTOLOGY in types_of(facts) and subject[:2] != "_:"]
    namespaces = Counter(namespace_of(individual) for individual in placed if not individual.startswith("_:"))
    common = max(namespaces, key=namespaces.__getitem__, default="")
    source = (ontologies[0] if ontologies else common).rstrip("#/")
    stem = re.sub(r"\.(owl|rdf|ttl|xml)$", "", local_name(source)) or "map"
    name = f"{source}#{stem}"
    return Iri(name if name not in graph else f"{name}-map")
