"""Statistics of maps: the numbers of individuals, joints and relations that the thesis tabulates."""

from __future__ import annotations

from collections.abc import Iterator, Sequence, Set

import msgspec

from mindstage.maps.dialects.membership import types_of
from mindstage.rdf.graphs import Graph
from mindstage.rdf.taxonomy import ClassHierarchy
from mindstage.rdf.vocabulary import CHILD, CONSTRAINT, OWL, PARENT, RDFS
from mindstage.scene import Iri, IriRef, PropertyAssertion

__all__ = ["MapStatistics", "is_constraint", "map_statistics"]


class MapStatistics(msgspec.Struct, frozen=True, kw_only=True):
    """The statistics of one map."""

    map: Iri
    classes: int
    """The number of different classes of its individuals, including joints; OWL's own classes are not counted."""
    individuals: int
    """Everything that is described in the map."""
    objects: int
    """Individuals that are not joints."""
    constraints: int
    relations: int
    """Different pairs of parent and child: those of objects, stated on either side, and the two ends of joints."""


def is_constraint(types: Sequence[Iri], hierarchy: ClassHierarchy) -> bool:
    """Whether an individual of these classes is a joint."""
    return any(hierarchy.is_a(cls, CONSTRAINT) for cls in types)


def map_statistics(map: Iri, graph: Graph, members: Sequence[Iri], hierarchy: ClassHierarchy) -> MapStatistics:
    """Computes the statistics from the statements of a map, before a world is read from it."""
    types = {member: types_of(graph[member]) for member in members}
    constraints = {member for member in members if is_constraint(types[member], hierarchy)}
    objects = types.keys() - constraints
    asserted = {cls for classes in types.values() for cls in classes if not cls.startswith((OWL, RDFS))}
    relations = {
        pair for member in objects for pair in _relation_pairs(member, graph[member]) if objects.issuperset(pair)
    }
    relations |= {pair for member in constraints for pair in _endpoint_pairs(graph[member])}
    return MapStatistics(
        map=map,
        classes=len(asserted),
        individuals=len(members),
        objects=len(objects),
        constraints=len(constraints),
        relations=len(relations),
    )


def _relation_pairs(member: Iri, facts: Sequence[PropertyAssertion]) -> Iterator[tuple[Iri, Iri]]:
    yield from ((parent, member) for parent in _referenced_iris(facts, PARENT))
    yield from ((member, child) for child in _referenced_iris(facts, CHILD))


def _endpoint_pairs(facts: Sequence[PropertyAssertion]) -> Set[tuple[Iri, Iri]]:
    return set(zip(_referenced_iris(facts, PARENT)[:1], _referenced_iris(facts, CHILD)[:1], strict=False))


def _referenced_iris(facts: Sequence[PropertyAssertion], property: Iri) -> list[Iri]:
    return [fact.value.iri for fact in facts if fact.property == property and isinstance(fact.value, IriRef)]
