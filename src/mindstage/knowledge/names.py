"""Names of entities: local names (`CowsMilk`), prefixed names (`knowrob:CowsMilk`), whole IRIs, and words.

Words are compared with the words of local names, labels (`rdfs:label`) and synonyms (`skos:altLabel`), without case,
articles, plurals and separators: "the fridge doors" are those of the class `FridgeDoor`.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from enum import IntEnum, StrEnum
from functools import cached_property, lru_cache
from pathlib import Path

import pyoxigraph as ox

from mindstage.errors import AmbiguousNameError, NameNotFoundError
from mindstage.knowledge.reasoner import Reasoner
from mindstage.rdf.graphs import PREFIXES, QuadSource, local_name, namespace_of
from mindstage.rdf.vocabulary import LABEL, RDFS, SYNONYM, TYPE
from mindstage.scene import Iri
from mindstage.scene.display import counted

__all__ = [
    "PREFIXES",
    "EntityType",
    "NameIndex",
    "NameQuality",
    "NamedThing",
    "Noun",
    "compact_iri",
    "expand_prefix",
    "is_plural",
    "name_words",
]

_MAX_NAME = 80
"""The number of characters of a name that are compared with others."""
_MAX_COMPARED = 20_000
"""The maximum number of names that are compared letter by letter; of more, those that begin alike."""
_SHOWN_NAMES = 3
_MIN_PLURAL_CHARACTERS = 4
_MIN_GERUND_CHARACTERS = 5
_ARTICLES = frozenset(
    ("the", "a", "an", "any", "some", "all", "every", "each", "my", "our", "your", "this", "that", "these", "those")
)
_IRREGULAR_PLURALS = {
    "knives": "knife",
    "shelves": "shelf",
    "loaves": "loaf",
    "leaves": "leaf",
    "halves": "half",
    "scarves": "scarf",
    "potatoes": "potato",
    "tomatoes": "tomato",
    "mangoes": "mango",
    "people": "person",
    "men": "man",
    "women": "woman",
    "children": "child",
    "feet": "foot",
    "mice": "mouse",
}
_BEFORE_ATTRIBUTES = tuple((word,) for word in ("of", "for", "to", "with", "without", "in", "on", "at"))
"""Words in names after which no head noun follows."""
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


class NameQuality(IntEnum):
    """How a name was found, the best first."""

    EXACT = 0
    """By its local name, prefixed name or IRI."""
    WORDS = 1
    """By the words of its local name or label."""
    SYNONYM = 2
    """By the words of a synonym."""
    PARTIAL = 3
    """By some of its words."""


@dataclass(frozen=True, slots=True)
class NamedThing:
    """What a name refers to."""

    iri: Iri
    members: Sequence[Iri] | None = None
    """The individuals of the class `iri` where an individual is asked for; None for anything else."""
    note: str = ""
    """How the name was understood, if it is not the name of exactly this entity."""
    quality: NameQuality = NameQuality.EXACT


@dataclass(frozen=True, slots=True)
class Noun:
    """What the words of a noun stand for."""

    individuals: tuple[Iri, ...]
    """Those with exactly this name."""
    members: tuple[Iri, ...]
    """The individuals of all classes of this name, or with a name that ends with it: a dinner plate is a plate."""

    def of(self, *, plural: bool) -> tuple[Iri, ...]:
        """The individuals that the singular or the plural stands for: "the oven" is that of this name."""
        return self.individuals if self.individuals and not (plural and self.members) else self.members


@dataclass(slots=True)
class _WordIndex:
    """Names by their words."""

    by_key: dict[str, dict[Iri, NameQuality]] = field(default_factory=dict)
    by_word: dict[str, dict[tuple[str, ...], None]] = field(default_factory=dict)
    """The names that contain a word."""
    by_stem: dict[str, dict[Iri, None]] = field(default_factory=dict)
    """Names without the endings of verbs."""

    def add(self, text: str, iri: Iri, quality: NameQuality) -> None:
        words = name_words(text)
        if words:
            iris = self.by_key.setdefault("".join(words), {})
            iris[iri] = min(quality, iris.get(iri, quality))
            self.by_stem.setdefault(_stem(words), {})[iri] = None
            for word in words:
                self.by_word.setdefault(word, {})[words] = None


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
        self.__dict__.pop("_words", None)
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

    def find_thing(self, name: str, entity_type: EntityType) -> NamedThing:
        """Resolves a name of a given type as `find` does, or else by its words.

        Where an individual is asked for, a class stands for all its individuals (`NamedThing.members`), unless it has
        only one.

        Raises:
            NameNotFoundError: nothing of that type has the name.
            AmbiguousNameError: several entities of that type have it.
        """
        found = self.things(name, entity_type)
        if len(found) > 1:
            iris = [each.iri for each in found]
            raise AmbiguousNameError(name, entity_type=entity_type.value, candidates=iris)
        if found:
            return found[0]
        return NamedThing(self.find(name, entity_type))  # raises, or takes a text as a value

    def things(self, name: str, entity_type: EntityType, *, partial: bool = False) -> list[NamedThing]:
        """Everything that a name may refer to equally well.

        Args:
            name: a local name, a prefixed name, an IRI, or words.
            entity_type: what is asked for.
            partial: whether names that contain the words are found as well, if there is no other.
        """
        exact = self._candidates(name, entity_type)
        if not exact and entity_type is EntityType.INDIVIDUAL:
            if classes := self._candidates(name, EntityType.CLASS):
                return self._as_members(name, classes, NameQuality.EXACT)
            exact = self._mentioned_only(name)
        elif entity_type is EntityType.VALUE:
            exact = [found[0]] if (found := self.find_any(name)) else []
        if len(exact) > 1 and entity_type in {EntityType.CLASS, EntityType.PROPERTY}:
            exact = self._used_in_maps(exact, entity_type)
        if exact:
            return [NamedThing(iri) for iri in exact]
        empty: list[NamedThing] = []
        for quality, iris in self._by_words(name, partial=partial):
            named = self._of_type(name, iris, entity_type, quality)
            if any(each.members != () for each in named):
                return named
            empty = empty or named  # a class without individuals: "kettle" is rather a water kettle that exists
        return empty

    def noun(self, text: str) -> Noun | None:
        """What a noun stands for, by names, labels and synonyms; None if nothing has such a name.

        Both are empty for the name of a class without an individual in the loaded maps.
        """
        index, words = self._words, name_words(text)
        if not words:
            return None
        known = self._reasoner.maps_of
        whole = expand_prefix(text)
        exact = [each for each in self._names.get(text, ()) if each in known]
        is_iri = whole in known or (":" in whole and self._has_type(whole, EntityType.CLASS))
        named = [whole] if is_iri else exact or list(index.by_key.get("".join(words), ()))
        individuals = sorted({iri for iri in named if iri in known and not self._has_type(iri, EntityType.MAP)})
        classes = [iri for iri in named if self._has_type(iri, EntityType.CLASS)]
        members = {iri for cls in classes for iri in self._reasoner.members(cls) if iri in known}
        if not members:
            classes += self._classes_ending(words)
            members = {iri for cls in classes for iri in self._reasoner.members(cls) if iri in known}
        if any(self._has_type(each, EntityType.MAP) for each in members) or not (individuals or classes):
            return None
        return Noun(tuple(individuals), tuple(sorted(members)))

    def _classes_ending(self, words: tuple[str, ...]) -> list[Iri]:
        """The classes with names that end with these words: a water bottle is a bottle, the leg of a table no table."""
        index, count = self._words, len(words)
        names = (
            each
            for each in index.by_word.get(words[-1], ())
            if each[-count:] == words and each[-count - 1 : -count] not in _BEFORE_ATTRIBUTES
        )
        found = (iri for name in names for iri, quality in index.by_key["".join(name)].items()
                 if quality <= NameQuality.WORDS)  # fmt: skip
        return [iri for iri in dict.fromkeys(found) if self._has_type(iri, EntityType.CLASS)]

    def nearest(self, name: str, entity_type: EntityType, *, limit: int = 5) -> tuple[str, ...]:
        """Names that resemble one: those with a word in common, and similar spellings."""
        index, words = self._words, name_words(name[:_MAX_NAME])
        key = "".join(words)
        keys: Iterable[str] = index.by_key
        if len(index.by_key) > _MAX_COMPARED:
            keys = [each for each in keys if each[:2] == key[:2]]
        similar = get_close_matches(key, list(keys), n=4 * limit, cutoff=0.65)
        sharing = ("".join(each) for word in words for each in sorted(index.by_word.get(word, ()), key=len))
        types = (entity_type, EntityType.CLASS) if entity_type is EntityType.INDIVIDUAL else (entity_type,)
        found: dict[str, None] = {}
        for each in (*similar, *sharing):
            names = (local_name(iri) for iri in index.by_key[each] if any(self._has_type(iri, kind) for kind in types))
            found |= dict.fromkeys(names)
            if len(found) >= limit:
                break
        return tuple(found)[:limit]

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

    def _by_words(self, name: str, *, partial: bool) -> Iterator[tuple[NameQuality, list[Iri]]]:
        """The entities with the words of a name, the best first."""
        index, words = self._words, name_words(name)
        own = index.by_key.get("".join(words), {})
        for quality in (NameQuality.WORDS, NameQuality.SYNONYM):
            yield quality, sorted(iri for iri in own if own[iri] is quality)
        if not partial or not words:
            return
        fewest = min((index.by_word.get(word, {}) for word in words), key=len)
        ending = [each for each in fewest if each[-len(words) :] == words]  # an office chair is a chair
        inside = [each for each in fewest if any(each[at : at + len(words)] == words for at in range(len(each)))]
        any_order = [each for each in fewest if {*words} <= {*each}]
        for names in (ending, inside, any_order):
            yield NameQuality.PARTIAL, sorted({iri for each in names for iri in index.by_key["".join(each)]})
        stem = _stem(words)
        yield NameQuality.PARTIAL, sorted(index.by_stem.get(stem, ()))

    def _of_type(self, name: str, iris: list[Iri], entity_type: EntityType, quality: NameQuality) -> list[NamedThing]:
        found = [iri for iri in iris if self._has_type(iri, entity_type)]
        if entity_type is EntityType.VALUE:  # the state "on" is not the property `on-Physical`
            found = [iri for iri in found if not self._has_type(iri, EntityType.PROPERTY)]
        if quality is NameQuality.PARTIAL and entity_type is EntityType.INDIVIDUAL:
            found = self._of_head_noun(name, [iri for iri in found if iri in self._reasoner.maps_of])  # no pose of one
        if entity_type is EntityType.INDIVIDUAL and (not found or quality is NameQuality.PARTIAL):
            classes = [iri for iri in iris if self._has_type(iri, EntityType.CLASS)]
            of_classes = self._as_members(name, classes, quality) if classes else []
            if any(each.members != () for each in of_classes) or not found:
                return of_classes
        if entity_type is EntityType.CLASS:
            if not found:
                individuals = [iri for iri in iris if self._has_type(iri, EntityType.INDIVIDUAL)]
                return self._as_class(name, individuals)
            found = self._most_general(found)
            found = found if len(found) < 2 else self._used_in_maps(found, entity_type)
        return [NamedThing(iri, note=f"{name!r} is {_shown(iri)}", quality=quality) for iri in found]

    def _of_head_noun(self, name: str, individuals: list[Iri]) -> list[Iri]:
        """Those that belong to the class that the last word names: a "left drawer" is a drawer, not its handle."""
        last = name_words(name)[-1:]
        classes = [iri for iri in self._words.by_key.get("".join(last), ()) if self._has_type(iri, EntityType.CLASS)]
        members = [iri for iri in individuals if any(self._reasoner.is_member(iri, cls) for cls in classes)]
        return members or individuals

    def _as_members(self, name: str, classes: Sequence[Iri], quality: NameQuality) -> list[NamedThing]:
        """Classes that stand for all their individuals; those without an individual only if no other has one."""
        members = {cls: tuple(self._reasoner.members(cls)) for cls in classes}
        inhabited = {cls: each for cls, each in members.items() if each} or members
        kept = self._most_general(list(inhabited))
        by_members = {inhabited[cls]: cls for cls in reversed(kept)}
        return [self._all_of(name, cls, each, quality) for each, cls in by_members.items()]

    @staticmethod
    def _all_of(name: str, cls: Iri, members: Sequence[Iri], quality: NameQuality) -> NamedThing:
        shown = ", ".join(map(local_name, members[:_SHOWN_NAMES])) + (", …" if members[_SHOWN_NAMES:] else "")
        if len(members) == 1:
            note = "" if quality is NameQuality.EXACT else f"{name!r} is {shown}, the only {local_name(cls)}"
            return NamedThing(members[0], note=note, quality=quality)
        note = f"{name!r} is the class {_shown(cls)} with {counted(len(members), 'individual')}"
        if name == cls:
            return NamedThing(cls, members, quality=quality)
        return NamedThing(cls, members, f"{note}: {shown}" if shown else note, quality)

    def _as_class(self, name: str, individuals: Sequence[Iri]) -> list[NamedThing]:
        """The classes of individuals, where a class is asked for."""
        classes = {cls: each for each in individuals if (cls := self._reasoner.class_of(each))}
        return [
            NamedThing(cls, note=f"{local_name(each)} is a {_shown(cls)}", quality=NameQuality.SYNONYM)
            for cls, each in classes.items()
        ]

    def _most_general(self, classes: list[Iri]) -> list[Iri]:
        """The class that is above all others, if there is one; else all of them."""
        above = self._reasoner.classes.above
        return next(([cls] for cls in classes if all(cls in above(other) for other in classes)), classes)

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

    @cached_property
    def _words(self) -> _WordIndex:
        """Names by their words; may contain those of removed entities."""
        index = _WordIndex()
        for name, iris in self._names.items():
            for iri in iris:
                index.add(name, iri, NameQuality.WORDS)
        for property, quality in ((LABEL, NameQuality.WORDS), (SYNONYM, NameQuality.SYNONYM)):
            for quad in self._store.quads_for_pattern(None, ox.NamedNode(property), None):
                if isinstance(quad.subject, ox.NamedNode) and isinstance(quad.object, ox.Literal):
                    index.add(quad.object.value, Iri(quad.subject.value), quality)
        for iri, synonym in _bundled_synonyms():
            if iri in self._names.get(local_name(iri), ()):
                index.add(synonym, iri, NameQuality.SYNONYM)
        return index

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


@lru_cache(maxsize=8192)
def name_words(text: str) -> tuple[str, ...]:
    """The words of a name in lower case and singular, without articles: ("milk", "carton", "1") for MilkCartons_1."""
    plain = text.replace("\u2019", "'")
    words = [_singular(word) for word in _split_words(plain)]
    kept = tuple(word for word in words if word not in _ARTICLES)
    return kept or tuple(words)


_ASCII_WORD = re.compile("[0-9]+|[A-Z]+(?![a-z])|[A-Z]?[a-z]+")


def _split_words(text: str) -> Iterable[str]:
    """Splits at separators, between lower and upper case (`CowsMilk`), and between letters and digits (`W60H140`)."""
    if text.isascii() and "'" not in text:  # nearly all names, of which there may be a million
        return map(str.lower, _ASCII_WORD.findall(text))
    return _split_any_words(text)


def _split_any_words(text: str) -> Iterator[str]:
    word = ""
    for at, char in enumerate(text):
        if not char.isalnum():
            if char == "'" and text[at + 1 : at + 2] in {"s", "S"} and not text[at + 2 : at + 3].isalnum():
                continue  # cow's: a word in the plural, which is made singular
            if word:
                yield word.casefold()
            word = ""
            continue
        previous = word[-1:]
        follows_lower = char.isupper() and (previous.islower() or text[at + 1 : at + 2].islower())
        if previous and (follows_lower or previous.isdigit() != char.isdigit()):
            yield word.casefold()
            word = ""
        word += char
    if word:
        yield word.casefold()


def is_plural(word: str) -> bool:
    """Whether an English noun is in the plural, by its ending."""
    return _singular(word) != word


@lru_cache(maxsize=1)
def _bundled_synonyms() -> tuple[tuple[Iri, str], ...]:
    """The synonyms of classes that come with the package; an ontology adds others by `skos:altLabel`."""
    text = (Path(__file__).parents[1] / "maps" / "bundled" / "synonyms.ttl").read_bytes()
    quads = ox.parse(text, format=ox.RdfFormat.TURTLE)
    return tuple((Iri(str(quad.subject.value)), str(quad.object.value)) for quad in quads)


@lru_cache(maxsize=8192)
def _singular(word: str) -> str:
    """The singular of an English noun by its ending; the same for both sides of a comparison, so it need not exist."""
    if word in _IRREGULAR_PLURALS:
        return _IRREGULAR_PLURALS[word]
    if len(word) < _MIN_PLURAL_CHARACTERS or not word.endswith("s") or word.endswith(("ss", "us", "is")):
        return word
    if word.endswith("ies") and len(word) > _MIN_PLURAL_CHARACTERS:
        return word[:-3] + "y"
    return word[:-2] if word.endswith(("sses", "shes", "ches", "xes", "zes")) else word[:-1]


def _stem(words: Sequence[str]) -> str:
    """The words without the endings of verbs: the same for "bake food" and "baking food"."""
    return "".join(_verb_stem(word) for word in words)


@lru_cache(maxsize=8192)
def _verb_stem(word: str) -> str:
    stem = word.removesuffix("ing") if len(word) > _MIN_GERUND_CHARACTERS else word
    stem = stem[:-1] if stem != word and stem[-1:] == stem[-2:-1] else stem  # cutting
    return stem.removesuffix("e")


def _shown(iri: Iri) -> str:
    short = compact_iri(iri)
    return local_name(iri) if short == iri else short


def _starts_with(name: str, prefix: str) -> bool:
    return name.casefold().startswith(prefix.rpartition(":")[2].casefold())
