"""The name book: what people call things, short (`CowsMilk`), with a prefix (`knowrob_iri:CowsMilk`) or whole."""

from __future__ import annotations

from collections.abc import Iterable
from enum import StrEnum
from functools import cached_property

import pyoxigraph as ox

from mindstage.errors import AmbiguousNameError, NameNotFoundError
from mindstage.knowledge.rdf import QuadSource, local_name
from mindstage.knowledge.reasoner import Reasoner
from mindstage.knowledge.vocabulary import DUL, KNOWROB, MS, OWL, RDF, RDFS, SOMA, TYPE, XSD
from mindstage.scene import Iri

__all__ = ["PREFIXES", "EntityType", "NameIndex", "compact_iri", "expand_prefix"]

PREFIXES = {
    "knowrob": KNOWROB,
    "ms": MS,
    "owl": OWL,
    "rdf": RDF,
    "rdfs": RDFS,
    "xsd": XSD,
    "dul": DUL,
    "soma": SOMA,
}
"""The prefixes that names may have."""

_BUILT_IN_PROPERTIES = (TYPE, *(Iri(RDFS + name) for name in ("subClassOf", "subPropertyOf", "label", "comment")))


class EntityType(StrEnum):
    """What a name can be the name of."""

    CLASS = "class"
    INDIVIDUAL = "individual"
    MAP = "map"
    PROPERTY = "property"
    VALUE = "class, individual or text"
    """What has no such name is taken as it is."""


_NAMED_TYPES = (EntityType.CLASS, EntityType.INDIVIDUAL, EntityType.MAP, EntityType.PROPERTY)


class NameIndex:
    """All names, found when the first is asked for and kept from then on.

    It remembers what things are called, and asks the index what they are now.
    """

    def __init__(self, store: QuadSource, reasoner: Reasoner) -> None:
        """Reads nothing yet."""
        self._store = store
        self._reasoner = reasoner

    def add(self, names: Iterable[Iri]) -> None:
        """Adds names that have come up since."""
        if "_names" in self.__dict__:
            for name in names:
                self._add_name(self._names, name)

    def find(self, name: str, entity_type: EntityType) -> Iri:
        """What a name means.

        An individual may also be called by the name of its class, where it is the only one of that class.

        Raises:
            NameNotFoundError: nothing of that kind has the name.
            AmbiguousNameError: several have it.
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
        """What a name means, whatever it is; None where nothing has it.

        Raises:
            AmbiguousNameError: several things of one kind have it.
        """
        found = ((self._resolve(name, kind), kind) for kind in _NAMED_TYPES)
        return next(((iri, kind) for iri, kind in found if iri), None)

    def complete(self, prefix: str, entity_type: EntityType, *, limit: int) -> list[tuple[str, Iri]]:
        """What somebody may be about to type: names that begin so, then those with it inside, the shortest first.

        Args:
            start: the beginning of a name, in any case; or of one with its prefix.
            kind: of what it is the name.
            most: so many are given.

        Returns:
            Pairs of what to type and what it means.
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
        """Every short name."""
        return (name for kind in _NAMED_TYPES for name in self._names_of_type(kind))

    def _containing(self, text: str) -> Iterable[str]:
        whole = expand_prefix(text)
        if whole != text:
            return (name for name, iris in self._names.items() if any(iri.startswith(whole) for iri in iris))
        small = text.casefold()
        return (name for name in self._names if small in name.casefold())

    def _resolve(self, name: str, entity_type: EntityType) -> Iri | None:
        """What of a kind has a name; None where nothing does."""
        found = self._candidates(name, entity_type)
        if not found and entity_type is EntityType.INDIVIDUAL:
            found = self._sole_members(name) or self._mentioned_only(name)
        if len(found) > 1:
            raise AmbiguousNameError(name, entity_type=entity_type.value, candidates=found)
        return found[0] if found else None

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
        """What only statements by other properties speak of: a part, say, that nobody says anything else about."""
        whole = expand_prefix(name)
        kinds = (EntityType.CLASS, EntityType.MAP, EntityType.PROPERTY)
        if ":" not in whole or any(self._has_type(whole, kind) for kind in kinds):
            return []
        try:
            node = ox.NamedNode(whole)
        except ValueError:
            return []
        told = (self._store.quads_for_pattern(node, None, None), self._store.quads_for_pattern(None, None, node))
        return [whole] if any(next(iter(quads), None) for quads in told) else []

    def _has_type(self, iri: Iri, entity_type: EntityType) -> bool:
        index = self._reasoner
        match entity_type:
            case EntityType.CLASS:
                return index.is_class(iri)
            case EntityType.MAP:
                return iri in index.members_by_map
            case EntityType.INDIVIDUAL:
                return index.is_individual(iri)
            case EntityType.PROPERTY:
                return iri in _BUILT_IN_PROPERTIES or index.is_property(iri)
            case EntityType.VALUE:
                return any(self._has_type(iri, each) for each in _NAMED_TYPES)

    def _names_of_type(self, entity_type: EntityType) -> Iterable[str]:
        return (name for name, iris in self._names.items() if any(self._has_type(iri, entity_type) for iri in iris))

    @cached_property
    def _names(self) -> dict[str, dict[Iri, None]]:
        """By short name; it may hold names of what is gone, and of what is nothing that can be asked about."""
        book: dict[str, dict[Iri, None]] = {}
        for iri in (*_BUILT_IN_PROPERTIES, *dict.fromkeys(self._reasoner.all_names())):
            self._add_name(book, iri)
        return book

    def _add_name(self, names: dict[str, dict[Iri, None]], iri: Iri) -> None:
        if not iri.startswith("_:"):
            names.setdefault(local_name(iri), {})[iri] = None


def expand_prefix(name: str) -> Iri:
    """A name with its prefix written out; other names as they are, without angle brackets."""
    prefix, colon, rest = name.partition(":")
    if colon and prefix in PREFIXES:
        return Iri(PREFIXES[prefix] + rest)
    return Iri(name.removeprefix("<").removesuffix(">"))


def compact_iri(iri: Iri) -> str:
    """A name with its prefix, where there is one."""
    return next((f"{prefix}:{iri[len(base) :]}" for prefix, base in PREFIXES.items() if iri.startswith(base)), iri)


def _starts_with(name: str, prefix: str) -> bool:
    return name.casefold().startswith(prefix.rpartition(":")[2].casefold())
