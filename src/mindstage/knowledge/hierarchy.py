"""The class hierarchy: who is below whom, whatever circles the sources draw."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from mindstage.world import Iri

__all__ = ["ClassHierarchy"]


class ClassHierarchy:
    """An index of subclass statements; equal classes are below one another."""

    def __init__(self, pairs: Iterable[tuple[Iri, Iri]]) -> None:
        """Builds the index.

        Args:
            pairs: class and superclass, as told.
        """
        self._above: dict[Iri, set[Iri]] = {}
        self._below: dict[Iri, set[Iri]] = {}
        self._ancestors: dict[Iri, dict[Iri, None]] = {}
        """By class, in the order of `ancestors`; computed when first asked for."""
        for cls, superclass in pairs:
            if cls != superclass:
                self._above.setdefault(cls, set()).add(superclass)
                self._below.setdefault(superclass, set()).add(cls)

    def levels(self, classes: Sequence[Iri]) -> Iterator[Sequence[Iri]]:
        """The classes themselves, then their superclasses, then theirs; each class once, each level sorted."""
        seen = set(classes)
        level = list(dict.fromkeys(classes))
        while level:
            yield level
            above = {superclass for cls in level for superclass in self._above.get(cls, ())} - seen
            seen |= above
            level = sorted(above)

    def ancestors(self, cls: Iri) -> tuple[Iri, ...]:
        """All superclasses, the nearest first; the class itself is not among them, even in a circle."""
        return tuple(self._ancestors_of(cls))

    def _ancestors_of(self, cls: Iri) -> Mapping[Iri, None]:
        found = self._ancestors.get(cls)
        if found is None:
            _, *levels = self.levels([cls])
            found = self._ancestors[cls] = {superclass: None for level in levels for superclass in level}
        return found

    def descendants(self, cls: Iri) -> frozenset[Iri]:
        """All subclasses, without the class itself."""
        found: set[Iri] = set()
        waiting = [cls]
        while waiting:
            below = self._below.get(waiting.pop(), set()) - found
            found |= below
            waiting.extend(below)
        return frozenset(found - {cls})

    def is_a(self, cls: Iri, ancestor: Iri) -> bool:
        """Whether one class is the other or below it."""
        if cls == ancestor:
            return True
        if cls not in self._above or ancestor not in self._below:
            return False
        return ancestor in self._ancestors_of(cls)

    def most_specific(self, classes: Sequence[Iri]) -> Iri:
        """The first of the classes that has none of the others below it; in a circle, the first of all."""
        return next(
            cls for cls in classes if not any(self.is_a(other, cls) and not self.is_a(cls, other) for other in classes)
        )
