"""The name book: what people call things, short (`CowsMilk`), with a prefix (`knowrob:CowsMilk`) or whole."""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum
from functools import cached_property

import pyoxigraph as ox

from mindstage.errors import NameAmbiguous, NameUnknown
from mindstage.knowledge.names import local_name
from mindstage.knowledge.reasoning.index import Index
from mindstage.knowledge.vocabulary import KNOWROB, MS, ON_PROPERTY, OWL, RDF, RDFS, TYPE, XSD
from mindstage.world import Iri

__all__ = ["PREFIXES", "NameKind", "Namebook", "spelt_out"]

PREFIXES = {
    "knowrob": KNOWROB,
    "ms": MS,
    "owl": OWL,
    "rdf": RDF,
    "rdfs": RDFS,
    "xsd": XSD,
    "dul": "http://www.ontologydesignpatterns.org/ont/dul/DUL.owl#",
    "soma": "http://www.ease-crc.org/ont/SOMA.owl#",
}
"""The prefixes that names may have."""

_PROPERTY_CLASSES = ("ObjectProperty", "DatatypeProperty", "AnnotationProperty")
_BUILT_IN = (TYPE, *(Iri(RDFS + name) for name in ("subClassOf", "subPropertyOf", "label", "comment")))


class NameKind(Enum):
    """What a name can be the name of."""

    CLASS = "class"
    INDIVIDUAL = "individual"
    MAP = "map"
    PROPERTY = "property"


class Namebook:
    """All names of one state of a store, found when the first of a kind is asked for."""

    def __init__(self, store: ox.Store, index: Index) -> None:
        """Reads nothing yet."""
        self._store = store
        self._index = index
        self._books: dict[NameKind, dict[str, list[Iri]]] = {}

    def find(self, name: str, kind: NameKind) -> Iri:
        """What a name means.

        An individual may also be called by the name of its class, where it is the only one of that class.

        Raises:
            NameUnknown: nothing of that kind has the name.
            NameAmbiguous: several have it.
        """
        book = self._book(kind)
        whole = spelt_out(name)
        found = [whole] if whole in book.get(local_name(whole), ()) else book.get(name, [])
        if not found and kind is NameKind.INDIVIDUAL:
            found = self._only_members(name, whole)
        if len(found) == 1:
            return found[0]
        if found:
            raise NameAmbiguous(name, kind=kind.value, known=found)
        raise NameUnknown(name, kind=kind.value, known=book)

    def kind_of(self, name: str) -> tuple[Iri, NameKind] | None:
        """What a name means, whatever it is; None where nothing has it."""
        for kind in NameKind:
            try:
                return self.find(name, kind), kind
            except NameUnknown:
                continue
        return None

    def all(self) -> Iterable[str]:
        """Every short name."""
        return (name for kind in NameKind for name in self._book(kind))

    def _only_members(self, name: str, whole: Iri) -> list[Iri]:
        classes = self._book(NameKind.CLASS)
        named = [whole] if whole in classes.get(local_name(whole), ()) else classes.get(name, [])
        return sorted({member for cls in named for member in self._index.members(cls)})

    def _book(self, kind: NameKind) -> dict[str, list[Iri]]:
        if kind not in self._books:
            book: dict[str, list[Iri]] = {}
            for iri in dict.fromkeys(self._names(kind)):
                if not iri.startswith("_:"):
                    book.setdefault(local_name(iri), []).append(iri)
            self._books[kind] = book
        return self._books[kind]

    def _names(self, kind: NameKind) -> Iterable[Iri]:
        if kind is NameKind.CLASS:
            return self._index.declared_classes()
        if kind is NameKind.MAP:
            return self._index.residents
        return self._properties if kind is NameKind.PROPERTY else (*self._index.types, *self._index.maps_of)

    @cached_property
    def _properties(self) -> tuple[Iri, ...]:
        quads = [
            *(quad.subject for name in _PROPERTY_CLASSES for quad in self._told(TYPE, Iri(OWL + name))),
            *(quad.object for quad in self._told(ON_PROPERTY)),
        ]
        named = [Iri(node.value) for node in quads if isinstance(node, ox.NamedNode)]
        return (*_BUILT_IN, *named, *self._index.properties.known())

    def _told(self, property: Iri, value: Iri | None = None) -> Iterable[ox.Quad]:
        node = None if value is None else ox.NamedNode(value)
        return self._store.quads_for_pattern(None, ox.NamedNode(property), node)


def spelt_out(name: str) -> Iri:
    """A name with its prefix written out; other names as they are, without angle brackets."""
    prefix, colon, rest = name.partition(":")
    if colon and prefix in PREFIXES:
        return Iri(PREFIXES[prefix] + rest)
    return Iri(name.removeprefix("<").removesuffix(">"))
