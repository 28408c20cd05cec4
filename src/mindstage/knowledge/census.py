"""The census: which maps a graph tells of, and which individuals live in each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import msgspec

from mindstage.knowledge.graph import Graph
from mindstage.knowledge.hierarchy import ClassHierarchy
from mindstage.knowledge.parts import PARTS
from mindstage.knowledge.vocabulary import (
    CHILD,
    CONSTRAINT,
    DESCRIBED_IN_MAP,
    NAMED_INDIVIDUAL,
    OWL,
    PARENT,
    RDFS,
    SEMANTIC_MAP,
    TYPE,
)
from mindstage.world import Fact, Iri, Reference

__all__ = ["Analysis", "Census", "analyse", "census_of", "is_constraint", "types_of"]

_PART_CLASSES = frozenset(part.cls for part in PARTS)


class Census(NamedTuple):
    """Who lives where."""

    residents: dict[Iri, list[Iri]]
    """By map, in the order of the graph. A map counts if it is called one, or if something is described in it."""
    declared: frozenset[Iri]
    """Maps that are called one."""


class Analysis(msgspec.Struct, frozen=True, kw_only=True):
    """A map in numbers."""

    map: Iri
    classes: int
    """Different classes that its individuals are said to be of, constraints' included; OWL's own words are none."""
    individuals: int
    """All that is described in the map."""
    objects: int
    """Individuals that are not constraints."""
    constraints: int
    relations: int
    """Different pairs of parent and child, whichever side tells them, constraints' included."""


def types_of(facts: Sequence[Fact]) -> tuple[Iri, ...]:
    """Classes that a thing is said to be of, but for OWL's remark that it is an individual."""
    types = [fact.value.iri for fact in facts if fact.property == TYPE and isinstance(fact.value, Reference)]
    return tuple(cls for cls in types if cls != NAMED_INDIVIDUAL)


def is_constraint(types: Sequence[Iri], hierarchy: ClassHierarchy) -> bool:
    """Whether something of these classes joins two others."""
    return any(hierarchy.is_a(cls, CONSTRAINT) for cls in types)


def census_of(graph: Graph) -> Census:
    """Goes through a graph once."""
    residents: dict[Iri, list[Iri]] = {}
    declared: set[Iri] = set()
    map_class = Reference(SEMANTIC_MAP)
    for subject, facts in graph.items():
        for fact in facts:
            if fact.property == DESCRIBED_IN_MAP and isinstance(fact.value, Reference):
                residents.setdefault(fact.value.iri, []).append(subject)
            elif fact.property == TYPE and fact.value == map_class:
                residents.setdefault(subject, [])
                declared.add(subject)
    for map, members in residents.items():
        members[:] = [member for member in members if member != map and not _is_part(graph[member])]
    return Census(residents, frozenset(declared))


def _is_part(facts: Sequence[Fact]) -> bool:
    types = types_of(facts)
    return bool(types) and _PART_CLASSES.issuperset(types)


def analyse(map: Iri, graph: Graph, census: Census, hierarchy: ClassHierarchy) -> Analysis:
    """Counts what the thesis counts, from what is told and before anything is understood or left out."""
    members = census.residents.get(map, [])
    types = {member: types_of(graph[member]) for member in members}
    constraints = {member for member in members if is_constraint(types[member], hierarchy)}
    objects = types.keys() - constraints
    relations = {
        relation
        for member in members
        for relation in _relations(member, graph[member], objects if member in objects else None)
    }
    told = {cls for classes in types.values() for cls in classes if not cls.startswith((OWL, RDFS))}
    return Analysis(
        map=map,
        classes=len(told),
        individuals=len(members),
        objects=len(objects),
        constraints=len(constraints),
        relations=len(relations),
    )


def _relations(member: Iri, facts: Sequence[Fact], objects: set[Iri] | None) -> set[tuple[Iri, Iri]]:
    told = {role: [] for role in (PARENT, CHILD)}  # type: dict[Iri, list[Iri]]
    for fact in facts:
        if fact.property in told and isinstance(fact.value, Reference):
            told[fact.property].append(fact.value.iri)
    if objects is None:
        return set(zip(told[PARENT][:1], told[CHILD][:1], strict=False))
    pairs = [(parent, member) for parent in told[PARENT]] + [(member, child) for child in told[CHILD]]
    return {pair for pair in pairs if objects.issuperset(pair)}
