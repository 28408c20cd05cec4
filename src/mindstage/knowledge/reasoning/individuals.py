"""Individuals: who is of which class and in which map, as told."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any

import pyoxigraph as ox

from mindstage.knowledge.reasoning.expressions import node_name
from mindstage.knowledge.vocabulary import DESCRIBED_IN_MAP, OWL, OWL_CLASS, RDF, RDFS, SEMANTIC_MAP, TYPE
from mindstage.knowledge.wording.parts import PARTS
from mindstage.world import Iri

__all__ = ["PROPERTY_KINDS", "Individuals"]

_KINDS = "Object Datatype Annotation Functional InverseFunctional Transitive Symmetric"
PROPERTY_KINDS = (Iri(RDF + "Property"), *(Iri(f"{OWL}{kind}Property") for kind in _KINDS.split()))
_DECLARING = frozenset({OWL_CLASS, *PROPERTY_KINDS})
_PART_CLASSES = frozenset(part.cls for part in PARTS)

Told = Callable[[str], Iterable[ox.Quad]]


class Individuals:
    """Types and maps of individuals."""

    def __init__(self, told: Told) -> None:
        """Reads all that is told."""
        self.types: dict[Iri, tuple[Iri, ...]] = {}
        """By individual, sorted; what only ontologies are made of is left out."""
        self.expressions: dict[Iri, dict[ox.BlankNode, None]] = {}
        """Types without a name, by individual."""
        self.members: dict[Iri, dict[Iri, None]] = {}
        """By class, as told."""
        self.declared: dict[Iri, dict[Iri, None]] = {kind: {} for kind in _DECLARING}
        """Classes and properties, by what they are said to be."""
        self.residents: dict[Iri, dict[Iri, None]] = {}
        """By map; the poses and limits of individuals are not counted as individuals."""
        self.maps_of: dict[Iri, tuple[Iri, ...]] = {}
        self.untyped: dict[Iri, None] = {}
        """Residents of which nobody says what they are."""
        self.here: dict[tuple[Iri, Iri], dict[Iri, None]] = {}
        """By map and class, as told."""
        self._parts: dict[Iri, tuple[Iri, ...]] = {}
        """The maps of what is a part of another individual and nothing else."""
        self.read(told)

    def read(self, told: Told) -> None:
        """Adds more."""
        touched: dict[Iri, None] = {}
        for quad in told(TYPE):
            self._is(quad.subject, quad.object, touched)
        described: dict[Iri, list[object]] = {}
        for quad in told(DESCRIBED_IN_MAP):
            if individual := node_name(quad.subject):
                described.setdefault(individual, []).append(quad.object)
        for individual in touched:  # who was in a map before may be of another class there now
            if individual in self.maps_of or individual in self._parts:
                described.setdefault(individual, [])
        for individual, maps in described.items():
            before = (*self.maps_of.get(individual, ()), *self._parts.get(individual, ()))
            self._settle(individual, {*before, *_names(individual, maps)})

    def reread(self, individual: Iri, types: Iterable[object], maps: Iterable[object]) -> None:
        """Forgets an individual and takes in what is told of it now."""
        self._settle(individual, ())
        for cls in self.types.pop(individual, ()):
            self._leave(cls, individual)
        self.expressions.pop(individual, None)
        for declared in self.declared.values():
            declared.pop(individual, None)
        node = ox.BlankNode(individual[2:]) if individual.startswith("_:") else ox.NamedNode(individual)
        for told in types:
            self._is(node, told, {})
        self._settle(individual, set(_names(individual, maps)))

    def _is(self, subject: object, cls: object, touched: dict[Iri, None]) -> None:
        individual = node_name(subject)
        if individual is None:
            return
        if isinstance(cls, ox.BlankNode):
            self.expressions.setdefault(individual, {})[cls] = None
        elif isinstance(cls, ox.NamedNode):
            name = Iri(cls.value)
            if name in _DECLARING:
                self.declared[name][individual] = None
            elif not name.startswith((OWL, RDFS, RDF)):
                self._join(name, individual)
                touched[individual] = None

    def _join(self, cls: Iri, individual: Iri) -> None:
        known = self.types.get(individual, ())
        if cls not in known:
            self.types[individual] = tuple(sorted((*known, cls))) if known else (cls,)
            self.members.setdefault(cls, {})[individual] = None
            if cls == SEMANTIC_MAP:
                self.residents.setdefault(individual, {})

    def _leave(self, cls: Iri, individual: Iri) -> None:
        _drop(self.members, cls, individual)
        if cls == SEMANTIC_MAP and not self.residents[individual]:
            del self.residents[individual]

    def _settle(self, individual: Iri, maps: Iterable[Iri]) -> None:
        """Makes these the maps of an individual, with the classes that it now has."""
        types = self.types.get(individual, ())
        for map in self.maps_of.pop(individual, ()):
            self.residents[map].pop(individual)
            if not self.residents[map] and map not in self.members.get(SEMANTIC_MAP, ()):
                del self.residents[map]
            for cls in types:
                _drop(self.here, (map, cls), individual)
        self.untyped.pop(individual, None)
        self._parts.pop(individual, None)
        if maps and types and _PART_CLASSES.issuperset(types):
            self._parts[individual] = tuple(sorted(maps))
        elif maps:
            self._enter(individual, types, tuple(sorted(maps)))

    def _enter(self, individual: Iri, types: tuple[Iri, ...], maps: tuple[Iri, ...]) -> None:
        self.maps_of[individual] = maps
        if not types:
            self.untyped[individual] = None
        for map in maps:
            self.residents.setdefault(map, {})[individual] = None
            for cls in types:
                self.here.setdefault((map, cls), {})[individual] = None


def _names(individual: Iri, maps: Iterable[object]) -> Iterator[Iri]:
    return (name for map in maps if (name := node_name(map)) and name != individual)


def _drop(told: dict[Any, dict[Any, None]], key: object, item: object) -> None:
    """Takes an item from a group, and the group with its last one."""
    group = told.get(key, {})
    group.pop(item, None)
    if not group:
        told.pop(key, None)
