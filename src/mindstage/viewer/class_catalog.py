"""The classes of which bodies can be added, with categories, search and thumbnails.

The categories are superclasses of the loaded ontologies; a class is in the first one that contains it.
"""

from __future__ import annotations

import hashlib
import re
import threading
from collections.abc import Iterable, Mapping

import msgspec

from mindstage.access.limits import FOUND_CLASSES
from mindstage.files import atomic_write, cache_dir
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.names import name_words
from mindstage.rdf.graphs import local_name
from mindstage.rdf.vocabulary import LABEL, SYNONYM
from mindstage.rendering.thumbnails import render_thumbnail
from mindstage.scene import Iri, Literal, Vector
from mindstage.simulation import Simulation

__all__ = ["AddableClass", "ClassCatalog"]

_CATEGORIES: tuple[tuple[str, frozenset[str]], ...] = (
    ("Food & drink", frozenset({"FoodOrDrinkOrIngredient", "FoodOrDrink", "Food", "Drink"})),
    ("Tableware", frozenset({"FoodVessel", "SilverwarePiece", "Cutlery", "TableCovering", "Tableware"})),
    (
        "Appliances",
        frozenset({"HouseholdAppliance", "PoweredDevice", "HeatingDevice", "CoolingDevice", "LightEmitter"}),
    ),
    ("Cooking", frozenset({"CookingVessel", "FoodUtensil", "Bakeware", "FoodOrDrinkPreparationDevice", "PotLid"})),
    ("Furniture", frozenset({"FurniturePiece", "Cupboard"})),
    ("Structure", frozenset({"PartOfAHumanDwelling", "ConstructionArtifact", "Portal", "PhysicalPartOfObject"})),
    ("Containers", frozenset({"Container", "StorageConstruct"})),
    ("Household", frozenset({"CleaningDevice", "CleaningSubstance", "TextileArtifact", "HandTool"})),
)
"""Titles, and the local names of superclasses."""
_OTHER = "Other"
_NO_THINGS = frozenset({"Event", "Situation", "TemporalThing"})
_THUMBNAIL_VERSION = 1
_THUMBNAIL_PX = 96


class AddableClass(msgspec.Struct, frozen=True, kw_only=True):
    """A class of which bodies can be added."""

    cls: Iri
    name: str
    """Its local name."""
    title: str
    """Its label, or the words of its name."""
    category: str
    size: Vector | None
    """The size of its instances [m]; None if the ontology states none."""
    used: bool
    """Whether the world has an instance."""


class _Names(msgspec.Struct, frozen=True):
    title: str
    words: tuple[str, ...]
    """Label and name in lower case."""
    synonyms: tuple[str, ...]


class ClassCatalog:
    """The catalog of a simulation's knowledge; may be used from any thread."""

    def __init__(self, simulation: Simulation) -> None:
        """Reads nothing yet."""
        self._simulation = simulation
        self._lock = threading.Lock()
        self._knowledge: KnowledgeBase | None = None
        self._names: Mapping[Iri, _Names] = {}
        self._entries: tuple[AddableClass, ...] = ()

    def find(self, text: str = "", category: str = "") -> list[AddableClass]:
        """Finds classes, the best match first; without text those that have a size, by category and title.

        Args:
            text: words of names, labels or synonyms.
            category: restricts the classes to one category.
        """
        entries, names = self._read()
        used = {body.cls for world in self._simulation.worlds for body in world.bodies}
        query = " ".join(text.casefold().split())
        ranked = []
        for entry in entries:
            if (category and entry.category != category) or (not query and entry.size is None):
                continue
            rank = _rank(query, names[entry.cls]) if query else 0
            if rank is not None:
                is_used = entry.cls in used
                # A class without a size is a superclass of many things, and rarely what was meant.
                order = (
                    rank,
                    entry.size is None,
                    not is_used,
                    len(entry.title) if query else 0,
                    entry.title.casefold(),
                )
                ranked.append((order, msgspec.structs.replace(entry, used=is_used)))
        ranked.sort(key=lambda pair: pair[0])
        return [entry for _, entry in ranked[: FOUND_CLASSES.count]] if query else [entry for _, entry in ranked]

    @property
    def categories(self) -> list[str]:
        """The categories that have classes with a size, in their order."""
        present = {entry.category for entry in self._read()[0] if entry.size is not None}
        return [title for title in (*(title for title, _ in _CATEGORIES), _OTHER) if title in present]

    def thumbnail(self, cls: Iri) -> bytes:
        """A picture of a class as a PNG file with a transparent background; kept in the cache directory.

        Returns:
            The file; empty if the class has no size.
        """
        rule = self._simulation.knowledge.shape_rule(cls)
        if rule.size is None:
            return b""
        key = f"{_THUMBNAIL_VERSION} {_THUMBNAIL_PX} {cls} {rule!r}"
        path = cache_dir("thumbnails") / f"{hashlib.sha256(key.encode()).hexdigest()[:32]}.png"
        try:
            return path.read_bytes()
        except OSError:
            pass
        body = self._simulation.make_body(cls, id="thumbnail", size=rule.size)
        picture = render_thumbnail(body, self._simulation.fit_geometry(body), rule, size=_THUMBNAIL_PX)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            atomic_write(path, picture)
        except OSError:
            return picture  # a cache directory that cannot be written only costs time
        return picture

    def _read(self) -> tuple[tuple[AddableClass, ...], Mapping[Iri, _Names]]:
        knowledge = self._simulation.knowledge
        with self._lock:
            if knowledge is not self._knowledge:
                with knowledge.lock:
                    used = {body.cls for world in self._simulation.worlds for body in world.bodies}
                    declared = (each for each in knowledge.reasoner.declared_classes() if not each.startswith("_:"))
                    classes = tuple(dict.fromkeys((*declared, *used)))
                    self._names = {cls: _names(knowledge, cls) for cls in classes}
                    self._entries = tuple(self._entry(knowledge, cls) for cls in classes if _is_thing(knowledge, cls))
                self._knowledge = knowledge
            return self._entries, self._names

    def _entry(self, knowledge: KnowledgeBase, cls: Iri) -> AddableClass:
        lineage = [local_name(each) for each in (cls, *knowledge.ancestors(cls))]
        return AddableClass(
            cls=cls,
            name=local_name(cls),
            title=self._names[cls].title,
            category=_category(lineage),
            size=knowledge.shape_rule(cls).size,
            used=False,
        )


def _names(knowledge: KnowledgeBase, cls: Iri) -> _Names:
    texts: dict[Iri, list[str]] = {LABEL: [], SYNONYM: []}
    for fact in knowledge.facts_of(cls):
        if fact.property in texts and isinstance(fact.value, Literal):
            texts[fact.property].append(fact.value.text)
    name = local_name(cls)
    spelled = " ".join(name_words(name)) or name
    title = texts[LABEL][0] if texts[LABEL] else re.sub(r"(?<=[a-z])(?=[A-Z0-9])|[-_]", " ", name)
    title = title[:1].upper() + title[1:]
    known = dict.fromkeys(each.casefold() for each in (*texts[LABEL], spelled, name))
    return _Names(title, tuple(known), tuple(each.casefold() for each in texts[SYNONYM]))


def _is_thing(knowledge: KnowledgeBase, cls: Iri) -> bool:
    return _NO_THINGS.isdisjoint(local_name(each) for each in (cls, *knowledge.ancestors(cls)))


def _category(lineage: Iterable[str]) -> str:
    names = set(lineage)
    return next((title for title, roots in _CATEGORIES if not roots.isdisjoint(names)), _OTHER)


def _rank(query: str, names: _Names) -> int | None:
    """How well a class matches, 0 is best; None if it does not."""
    for rank, texts in ((0, names.words), (2, names.synonyms)):
        if query in texts:
            return rank
        if any(text.startswith(query) for text in texts):
            return rank + 1
    everything = " ".join((*names.words, *names.synonyms))
    words = everything.split()
    if all(any(word.startswith(part) for word in words) for part in query.split()):
        return 4
    return 5 if query in everything else None
