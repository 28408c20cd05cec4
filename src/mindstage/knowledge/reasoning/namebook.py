"""The name book: what people call things, short (`CowsMilk`), with a prefix (`knowrob:CowsMilk`) or whole."""

from __future__ import annotations

from collections.abc import Iterable
from enum import StrEnum
from functools import cached_property

import pyoxigraph as ox

from mindstage.errors import NameAmbiguous, NameUnknown
from mindstage.knowledge.names import local_name
from mindstage.knowledge.reading.other_words import DUL, SOMA
from mindstage.knowledge.reasoning.index import Index
from mindstage.knowledge.stores.triplestore import Readable
from mindstage.knowledge.vocabulary import KNOWROB, MS, OWL, RDF, RDFS, TYPE, XSD
from mindstage.world import Iri

__all__ = ["PREFIXES", "NameKind", "Namebook", "shortened", "spelt_out"]

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

_BUILT_IN = (TYPE, *(Iri(RDFS + name) for name in ("subClassOf", "subPropertyOf", "label", "comment")))


class NameKind(StrEnum):
    """What a name can be the name of."""

    CLASS = "class"
    INDIVIDUAL = "individual"
    MAP = "map"
    PROPERTY = "property"
    VALUE = "class, individual or text"
    """What has no such name is taken as it is."""


_NAMING = (NameKind.CLASS, NameKind.INDIVIDUAL, NameKind.MAP, NameKind.PROPERTY)


class Namebook:
    """All names, found when the first is asked for and kept from then on.

    It remembers what things are called, and asks the index what they are now.
    """

    def __init__(self, store: Readable, index: Index) -> None:
        """Reads nothing yet."""
        self._store = store
        self._index = index

    def learn(self, names: Iterable[Iri]) -> None:
        """Adds names that have come up since."""
        if "_book" in self.__dict__:
            for name in names:
                self._write(self._book, name)

    def find(self, name: str, kind: NameKind) -> Iri:
        """What a name means.

        An individual may also be called by the name of its class, where it is the only one of that class.

        Raises:
            NameUnknown: nothing of that kind has the name.
            NameAmbiguous: several have it.
        """
        if kind is NameKind.VALUE:
            known = self.kind_of(name)
            return known[0] if known else Iri(name)
        found = self._meant(name, kind)
        if not found:
            of_classes = map(local_name, self._index.individuals.members) if kind is NameKind.INDIVIDUAL else ()
            raise NameUnknown(name, kind=kind.value, known=(*self._all(kind), *of_classes))
        return found

    def kind_of(self, name: str) -> tuple[Iri, NameKind] | None:
        """What a name means, whatever it is; None where nothing has it.

        Raises:
            NameAmbiguous: several things of one kind have it.
        """
        found = ((self._meant(name, kind), kind) for kind in _NAMING)
        return next(((iri, kind) for iri, kind in found if iri), None)

    def like(self, start: str, kind: NameKind, *, most: int) -> list[tuple[str, Iri]]:
        """What somebody may be about to type: names that begin so, then those with it inside, the shortest first.

        Args:
            start: the beginning of a name, in any case; or of one with its prefix.
            kind: of what it is the name.
            most: so many are given.

        Returns:
            Pairs of what to type and what it means.
        """
        found: list[tuple[str, Iri]] = []
        for name in sorted(self._with(start), key=lambda each: (not _begins(each, start), len(each), each)):
            iris = [iri for iri in self._book[name] if self._is(iri, kind)]
            found += [(name if len(iris) == 1 else shortened(iri), iri) for iri in sorted(iris)]
            if len(found) >= most:
                break
        return found[:most]

    def all(self) -> Iterable[str]:
        """Every short name."""
        return (name for kind in _NAMING for name in self._all(kind))

    def _with(self, start: str) -> Iterable[str]:
        whole = spelt_out(start)
        if whole != start:
            return (name for name, iris in self._book.items() if any(iri.startswith(whole) for iri in iris))
        small = start.casefold()
        return (name for name in self._book if small in name.casefold())

    def _meant(self, name: str, kind: NameKind) -> Iri | None:
        """What of a kind has a name; None where nothing does."""
        found = self._named(name, kind)
        if not found and kind is NameKind.INDIVIDUAL:
            found = self._only_members(name) or self._strangers(name)
        if len(found) > 1:
            raise NameAmbiguous(name, kind=kind.value, known=found)
        return found[0] if found else None

    def _named(self, name: str, kind: NameKind) -> list[Iri]:
        whole = spelt_out(name)
        if ":" in whole and self._is(whole, kind):
            return [whole]
        return sorted(iri for iri in self._book.get(name, ()) if self._is(iri, kind))

    def _only_members(self, name: str) -> list[Iri]:
        return sorted({member for cls in self._named(name, NameKind.CLASS) for member in self._index.members(cls)})

    def _strangers(self, name: str) -> list[Iri]:
        """What only statements by other properties speak of: a part, say, that nobody says anything else about."""
        whole = spelt_out(name)
        kinds = (NameKind.CLASS, NameKind.MAP, NameKind.PROPERTY)
        if ":" not in whole or any(self._is(whole, kind) for kind in kinds):
            return []
        try:
            node = ox.NamedNode(whole)
        except ValueError:
            return []
        told = (self._store.quads_for_pattern(node, None, None), self._store.quads_for_pattern(None, None, node))
        return [whole] if any(next(iter(quads), None) for quads in told) else []

    def _is(self, iri: Iri, kind: NameKind) -> bool:
        index = self._index
        match kind:
            case NameKind.CLASS:
                return index.knows_class(iri)
            case NameKind.MAP:
                return iri in index.residents
            case NameKind.INDIVIDUAL:
                return index.knows_individual(iri)
            case NameKind.PROPERTY:
                return iri in _BUILT_IN or index.knows_property(iri)
            case NameKind.VALUE:
                return any(self._is(iri, each) for each in _NAMING)

    def _all(self, kind: NameKind) -> Iterable[str]:
        return (name for name, iris in self._book.items() if any(self._is(iri, kind) for iri in iris))

    @cached_property
    def _book(self) -> dict[str, dict[Iri, None]]:
        """By short name; it may hold names of what is gone, and of what is nothing that can be asked about."""
        book: dict[str, dict[Iri, None]] = {}
        for iri in (*_BUILT_IN, *dict.fromkeys(self._index.vocabulary())):
            self._write(book, iri)
        return book

    def _write(self, book: dict[str, dict[Iri, None]], iri: Iri) -> None:
        if not iri.startswith("_:"):
            book.setdefault(local_name(iri), {})[iri] = None


def spelt_out(name: str) -> Iri:
    """A name with its prefix written out; other names as they are, without angle brackets."""
    prefix, colon, rest = name.partition(":")
    if colon and prefix in PREFIXES:
        return Iri(PREFIXES[prefix] + rest)
    return Iri(name.removeprefix("<").removesuffix(">"))


def shortened(iri: Iri) -> str:
    """A name with its prefix, where there is one."""
    return next((f"{prefix}:{iri[len(base) :]}" for prefix, base in PREFIXES.items() if iri.startswith(base)), iri)


def _begins(name: str, start: str) -> bool:
    return name.casefold().startswith(start.rpartition(":")[2].casefold())
