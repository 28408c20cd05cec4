"""Names of entities: local names (`CowsMilk`), prefixed names (`knowrob:CowsMilk`) and whole IRIs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from enum import StrEnum
from functools import cached_property

import pyoxigraph as ox

from mindstage.errors import AmbiguousNameError, NameNotFoundError
from mindstage.knowledge.rdf import PREFIXES, QuadSource, local_name, namespace_of
from mindstage.knowledge.reasoner import Reasoner
from mindstage.knowledge.vocabulary import RDFS, TYPE
from mindstage.scene import Iri

__all__ = ["PREFIXES", "EntityType", "NameIndex", "compact_iri", "expand_prefix"]

_BUILT_IN_PROPERTIES = (TYPE, *(Iri(RDFS + name) for name in ("subClassOf", "subPropertyOf", "label", "comment")))


class EntityType(StrEnum):
    """What a name refers to."""

    CLASS = "class"
    INDIVIDUAL = "individual"
    MAP = "map"
    PROPERTY = "property"
    VALUE = "class, individual or text"
    """An unknown name is taken as text."""


_NAMED_TYPES = (EntityType.CLASS, EntityType.INDIVIDUAL, EntityType.MAP, EntityType.PROPERTY)


class NameIndex:
    """Resolves names. The index is built at its first use and then updated.

    It stores names only; what a name refers to at present is looked up in the reasoner.
    """

    def __init__(
        self, store: QuadSource, reasoner: Reasoner, *, names: dict[str, dict[Iri, None]] | None = None
    ) -> None:
        """Reads nothing yet.

        Args:
            store: the statements.
            reasoner: what names refer to.
            names: the IRIs by local name, if they are known.
        """
        self._store = store
        self._reasoner = reasoner
        if names is not None:
            self._names = names

    @property
    def by_local_name(self) -> dict[str, dict[Iri, None]]:
        """The IRIs by local name; may contain those of removed entities."""
        return self._names

    def add(self, names: Iterable[Iri]) -> None:
        """Adds the names of new statements."""
        if "_names" in self.__dict__:
            for name in names:
                self._add_name(self._names, name)

    def find(self, name: str, entity_type: EntityType) -> Iri:
        """Resolves a name of a given type.

        An individual can also be given by the name of its class, if it is the only member. Of several classes or
        properties of a name, it is the one that the loaded maps use; if they use none or several, any of them as long
        as all are equivalent.

        Raises:
            NameNotFoundError: nothing of that type has the name.
            AmbiguousNameError: several entities of that type have it, and the maps leave the choice open.
        """
        if entity_type is EntityType.VALUE:
            known = self.find_any(name)
            return known[0] if known else Iri(name)
        found = self._resolve(name, entity_type)
        if not found:
            of_classes = (
                map(local_name, self._reasoner.individuals.members) if entity_type is EntityType.INDIVIDUAL else ()
            )
            raise NameNotFoundError(
                name, entity_type=entity_type.value, known=(*self._names_of_type(entity_type), *of_classes)
            )
        return found

    def find_any(self, name: str) -> tuple[Iri, EntityType] | None:
        """Resolves a name of any type; returns the IRI and its type, or None.

        Raises:
            AmbiguousNameError: several entities of one type have the name.
        """
        found = ((self._resolve(name, kind), kind) for kind in _NAMED_TYPES)
        return next(((iri, kind) for iri, kind in found if iri), None)

    def complete(self, prefix: str, entity_type: EntityType, *, limit: int) -> list[tuple[str, Iri]]:
        """Completes a name: names that start with the text, then those that contain it, the shortest first.

        Args:
            prefix: the beginning of a name, in any case, optionally after a prefix such as `knowrob:`.
            entity_type: what the names refer to.
            limit: the maximum number of results.

        Returns:
            Pairs of a name and the IRI that it refers to.
        """
        found: list[tuple[str, Iri]] = []
        for name in sorted(
            self._containing(prefix), key=lambda each: (not _starts_with(each, prefix), len(each), each)
        ):
            iris = [iri for iri in self._names[name] if self._has_type(iri, entity_type)]
            found += [(name if len(iris) == 1 else compact_iri(iri), iri) for iri in sorted(iris)]
            if len(found) >= limit:
                break
        return found[:limit]

    def short_names(self) -> Iterable[str]:
        """All local names."""
        return (name for kind in _NAMED_TYPES for name in self._names_of_type(kind))

    def _containing(self, text: str) -> Iterable[str]:
        iri_prefix = expand_prefix(text)
        if iri_prefix != text:
            return (name for name, iris in self._names.items() if any(iri.startswith(iri_prefix) for iri in iris))
        folded = text.casefold()
        return (name for name in self._names if folded in name.casefold())

    def _resolve(self, name: str, entity_type: EntityType) -> Iri | None:
        """Resolves a name of a given type; None if there is none."""
        found = self._candidates(name, entity_type)
        if not found and entity_type is EntityType.INDIVIDUAL:
            found = self._sole_members(name) or self._mentioned_only(name)
        if len(found) > 1 and entity_type in {EntityType.CLASS, EntityType.PROPERTY}:
            found = self._used_in_maps(found, entity_type)
        if len(found) > 1:
            raise AmbiguousNameError(name, entity_type=entity_type.value, candidates=found)
        return found[0] if found else None

    def _used_in_maps(self, candidates: list[Iri], entity_type: EntityType) -> list[Iri]:
        """Those of several candidates that the loaded maps use; of equivalent ones, which have one meaning, the first.

        A class is used by its individuals. If no candidate is used, it is one of the vocabulary that the maps use most.
        """
        is_class = entity_type is EntityType.CLASS
        found = [each for each in candidates if (self._has_members(each) if is_class else self._is_predicate(each))]
        if not found and is_class:
            counts = {each: self._vocabulary[namespace_of(each)] for each in candidates}
            found = [each for each in candidates if counts[each] and counts[each] == max(counts.values())]
        found = found or candidates
        same = self._reasoner.equivalents(found[0]) if is_class else ()
        return found[:1] if {*found} <= {*same} else found

    def _has_members(self, cls: Iri) -> bool:
        return any(
            individual in self._reasoner.maps_of for individual in self._reasoner.individuals.members.get(cls, ())
        )

    def _is_predicate(self, property: Iri) -> bool:
        return next(iter(self._store.quads_for_pattern(None, ox.NamedNode(property), None)), None) is not None

    @property
    def _vocabulary(self) -> Counter[str]:
        """The number of classes that the individuals of maps have, by namespace."""
        return Counter(namespace_of(cls) for cls in self._reasoner.individuals.members if self._has_members(cls))

    def _candidates(self, name: str, entity_type: EntityType) -> list[Iri]:
        whole = expand_prefix(name)
        if ":" in whole and self._has_type(whole, entity_type):
            return [whole]
        return sorted(iri for iri in self._names.get(name, ()) if self._has_type(iri, entity_type))

    def _sole_members(self, name: str) -> list[Iri]:
        return sorted(
            {member for cls in self._candidates(name, EntityType.CLASS) for member in self._reasoner.members(cls)}
        )

    def _mentioned_only(self, name: str) -> list[Iri]:
        """A resource without a type and a map that occurs in other statements, such as a part."""
        whole = expand_prefix(name)
        kinds = (EntityType.CLASS, EntityType.MAP, EntityType.PROPERTY)
        if ":" not in whole or any(self._has_type(whole, kind) for kind in kinds):
            return []
        try:
            node = ox.NamedNode(whole)
        except ValueError:
            return []
        uses = (self._store.quads_for_pattern(node, None, None), self._store.quads_for_pattern(None, None, node))
        return [whole] if any(next(iter(quads), None) for quads in uses) else []

    def _has_type(self, iri: Iri, entity_type: EntityType) -> bool:
        reasoner = self._reasoner
        match entity_type:
            case EntityType.CLASS:
                return reasoner.is_class(iri)
            case EntityType.MAP:
                return iri in reasoner.members_by_map
            case EntityType.INDIVIDUAL:
                return reasoner.is_individual(iri)
            case EntityType.PROPERTY:
                return iri in _BUILT_IN_PROPERTIES or reasoner.is_property(iri)
            case EntityType.VALUE:
                return any(self._has_type(iri, each) for each in _NAMED_TYPES)

    def _names_of_type(self, entity_type: EntityType) -> Iterable[str]:
        return (name for name, iris in self._names.items() if any(self._has_type(iri, entity_type) for iri in iris))

    @cached_property
    def _names(self) -> dict[str, dict[Iri, None]]:
        """IRIs by local name; may contain those of removed entities, and of resources of no type."""
        names: dict[str, dict[Iri, None]] = {}
        for iri in (*_BUILT_IN_PROPERTIES, *dict.fromkeys(self._reasoner.all_names())):
            self._add_name(names, iri)
        return names

    def _add_name(self, names: dict[str, dict[Iri, None]], iri: Iri) -> None:
        if not iri.startswith("_:"):
            names.setdefault(local_name(iri), {})[iri] = None


def expand_prefix(name: str) -> Iri:
    """Expands a prefixed name; any other name is returned without angle brackets."""
    prefix, colon, rest = name.partition(":")
    if colon and prefix in PREFIXES:
        return Iri(PREFIXES[prefix] + rest)
    return Iri(name.removeprefix("<").removesuffix(">"))


def compact_iri(iri: Iri) -> str:
    """The prefixed name of an IRI if there is a prefix for it, else the IRI."""
    return next((f"{prefix}:{iri[len(base) :]}" for prefix, base in PREFIXES.items() if iri.startswith(base)), iri)


def _starts_with(name: str, prefix: str) -> bool:
    return name.casefold().startswith(prefix.rpartition(":")[2].casefold())
