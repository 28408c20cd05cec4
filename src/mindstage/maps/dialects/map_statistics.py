"""Statistics of maps: the numbers of individuals, joints and relations that the thesis tabulates."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import msgspec

from mindstage.maps.dialects.membership import references, types_of
from mindstage.rdf.graphs import Graph
from mindstage.rdf.taxonomy import ClassHierarchy
from mindstage.rdf.vocabulary import CHILD, CONSTRAINT, OWL, PARENT, RDFS
from mindstage.scene import Iri, PropertyAssertion

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
    for facts in (graph[member] for member in constraints):
        relations |= set(zip(references(facts, PARENT)[:1], references(facts, CHILD)[:1], strict=False))
    return MapStatistics(
        map=map,
        classes=len(asserted),
        individuals=len(members),
        objects=len(objects),
        constraints=len(constraints),
        relations=len(relations),
    )


def _relation_pairs(member: Iri, facts: Sequence[PropertyAssertion]) -> Iterator[tuple[Iri, Iri]]:
    yield from ((parent, member) for parent in references(facts, PARENT))
    yield from ((member, child) for child in references(facts, CHILD))
