"""Class names: what a link is, from the words that its name is made of."""

from __future__ import annotations

import re
from functools import cached_property

import pyoxigraph as ox

from mindstage.knowledge.names import local_name
from mindstage.knowledge.stores.triplestore import QuadSource
from mindstage.knowledge.vocabulary import KNOWROB, OWL, OWL_CLASS, RDFS, TYPE
from mindstage.world import Iri

__all__ = ["ClassNameIndex"]

_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
_IGNORED_WORDS = frozenset(
    (
        *("link", "main", "base", "frame", "body", "joint", "footprint", "root", "area", "block"),
        *("left", "right", "upper", "lower", "top", "bottom", "middle", "front", "back", "inner", "outer"),
        *("center", "centre", "vertical", "horizontal", "small", "big", "large"),
    )
)
"""Words at the end of a link's name that say where it is, or nothing, but not what it is."""


class ClassNameIndex:
    """The classes that a store knows, by the words of their names."""

    def __init__(self, store: QuadSource) -> None:
        """Reads nothing yet."""
        self._store = store

    def class_of_link(self, link: str) -> Iri | None:
        """The class that the end of a link's name spells: a Handle for `oven_door_handle_link`, and so on.

        The longest end counts, so `fridge_door` is a FridgeDoor where there is such a class, and else a Door.
        """
        words = [word.lower() for word in _WORD.findall(link)]
        while words and words[-1] in _IGNORED_WORDS:
            words.pop()
        ends = ("".join(words[start:]) for start in range(len(words)))
        return next((self._classes_by_name[end] for end in ends if end in self._classes_by_name), None)

    @cached_property
    def _classes_by_name(self) -> dict[str, Iri]:
        """By name in small letters; of several classes of one name, the community's own."""
        quads = self._store.quads_for_pattern(None, ox.NamedNode(TYPE), ox.NamedNode(OWL_CLASS))
        classes = {Iri(quad.subject.value) for quad in quads if isinstance(quad.subject, ox.NamedNode)}
        told = sorted(cls for cls in classes if not cls.startswith((OWL, RDFS)))
        told.sort(key=lambda cls: cls.startswith(KNOWROB))  # whoever comes last stays
        return {local_name(cls).lower(): cls for cls in told}
