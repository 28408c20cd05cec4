"""Individuals: who is of which class and in which map, as told."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any

import pyoxigraph as ox

from mindstage.knowledge.reasoning.expressions import node_label
from mindstage.knowledge.vocabulary import DESCRIBED_IN_MAP, OWL, OWL_CLASS, RDF, RDFS, SEMANTIC_MAP, TYPE
from mindstage.knowledge.wording.parts import NESTED_RESOURCES
from mindstage.world import Iri

__all__ = ["PROPERTY_TYPE_IRIS", "IndividualIndex"]

_PROPERTY_TYPE_NAMES = "Object Datatype Annotation Functional InverseFunctional Transitive Symmetric"
PROPERTY_TYPE_IRIS = (Iri(RDF + "Property"), *(Iri(f"{OWL}{kind}Property") for kind in _PROPERTY_TYPE_NAMES.split()))
_DECLARATION_TYPES = frozenset({OWL_CLASS, *PROPERTY_TYPE_IRIS})
_PART_CLASSES = frozenset(part.cls for part in NESTED_RESOURCES)

QuadsByPredicate = Callable[[str], Iterable[ox.Quad]]


class IndividualIndex:
    """Types and maps of individuals."""

    def __init__(self, asserted: QuadsByPredicate) -> None:
        """Reads all that is told."""
        self.types: dict[Iri, tuple[Iri, ...]] = {}
        """By individual, sorted; what only ontologies are made of is left out."""
        self.anonymous_types: dict[Iri, dict[ox.BlankNode, None]] = {}
        """Types without a name, by individual."""
        self.members: dict[Iri, dict[Iri, None]] = {}
        """By class, as told."""
        self.declared: dict[Iri, dict[Iri, None]] = {kind: {} for kind in _DECLARATION_TYPES}
        """Classes and properties, by what they are said to be."""
        self.members_by_map: dict[Iri, dict[Iri, None]] = {}
        """By map; the poses and limits of individuals are not counted as individuals."""
        self.maps_of: dict[Iri, tuple[Iri, ...]] = {}
        self.untyped: dict[Iri, None] = {}
        """Residents of which nobody says what they are."""
        self.members_by_map_and_class: dict[tuple[Iri, Iri], dict[Iri, None]] = {}
        """By map and class, as told."""
        self._nested_resources: dict[Iri, tuple[Iri, ...]] = {}
        """The maps of what is a part of another individual and nothing else."""
        self.add(asserted)

    def add(self, asserted: QuadsByPredicate) -> None:
        """Adds more."""
        touched: dict[Iri, None] = {}
        for quad in asserted(TYPE):
            self._add_type(quad.subject, quad.object, touched)
        described: dict[Iri, list[object]] = {}
        for quad in asserted(DESCRIBED_IN_MAP):
            if individual := node_label(quad.subject):
                described.setdefault(individual, []).append(quad.object)
        for individual in touched:  # who was in a map before may be of another class there now
            if individual in self.maps_of or individual in self._nested_resources:
                described.setdefault(individual, [])
        for individual, maps in described.items():
            before = (*self.maps_of.get(individual, ()), *self._nested_resources.get(individual, ()))
            self._set_maps(individual, {*before, *_map_names(individual, maps)})

    def update(self, individual: Iri, types: Iterable[object], maps: Iterable[object]) -> None:
        """Forgets an individual and takes in what is told of it now."""
        self._set_maps(individual, ())
        for cls in self.types.pop(individual, ()):
            self._remove_from_class(cls, individual)
        self.anonymous_types.pop(individual, None)
        for declared in self.declared.values():
            declared.pop(individual, None)
        node = ox.BlankNode(individual[2:]) if individual.startswith("_:") else ox.NamedNode(individual)
        for told in types:
            self._add_type(node, told, {})
        self._set_maps(individual, set(_map_names(individual, maps)))

    def _add_type(self, subject: object, cls: object, touched: dict[Iri, None]) -> None:
        individual = node_label(subject)
        if individual is None:
            return
        if isinstance(cls, ox.BlankNode):
            self.anonymous_types.setdefault(individual, {})[cls] = None
        elif isinstance(cls, ox.NamedNode):
            name = Iri(cls.value)
            if name in _DECLARATION_TYPES:
                self.declared[name][individual] = None
            elif not name.startswith((OWL, RDFS, RDF)):
                self._add_to_class(name, individual)
                touched[individual] = None

    def _add_to_class(self, cls: Iri, individual: Iri) -> None:
        known = self.types.get(individual, ())
        if cls not in known:
            self.types[individual] = tuple(sorted((*known, cls))) if known else (cls,)
            self.members.setdefault(cls, {})[individual] = None
            if cls == SEMANTIC_MAP:
                self.members_by_map.setdefault(individual, {})

    def _remove_from_class(self, cls: Iri, individual: Iri) -> None:
        _discard_from_group(self.members, cls, individual)
        if cls == SEMANTIC_MAP and not self.members_by_map[individual]:
            del self.members_by_map[individual]

    def _set_maps(self, individual: Iri, maps: Iterable[Iri]) -> None:
        """Makes these the maps of an individual, with the classes that it now has."""
        types = self.types.get(individual, ())
        for map in self.maps_of.pop(individual, ()):
            self.members_by_map[map].pop(individual)
            if not self.members_by_map[map] and map not in self.members.get(SEMANTIC_MAP, ()):
                del self.members_by_map[map]
            for cls in types:
                _discard_from_group(self.members_by_map_and_class, (map, cls), individual)
        self.untyped.pop(individual, None)
        self._nested_resources.pop(individual, None)
        if maps and types and _PART_CLASSES.issuperset(types):
            self._nested_resources[individual] = tuple(sorted(maps))
        elif maps:
            self._add_to_maps(individual, types, tuple(sorted(maps)))

    def _add_to_maps(self, individual: Iri, types: tuple[Iri, ...], maps: tuple[Iri, ...]) -> None:
        self.maps_of[individual] = maps
        if not types:
            self.untyped[individual] = None
        for map in maps:
            self.members_by_map.setdefault(map, {})[individual] = None
            for cls in types:
                self.members_by_map_and_class.setdefault((map, cls), {})[individual] = None


def _map_names(individual: Iri, maps: Iterable[object]) -> Iterator[Iri]:
    return (name for map in maps if (name := node_label(map)) and name != individual)


def _discard_from_group(groups: dict[Any, dict[Any, None]], key: object, item: object) -> None:
    """Takes an item from a group, and the group with its last one."""
    group = groups.get(key, {})
    group.pop(item, None)
    if not group:
        groups.pop(key, None)
