"""Transitive closures, and the class hierarchy, which is one; cycles are allowed.

The members of a cycle are above and below one another. Closures are computed on demand and kept until a pair is added
or removed.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from typing import Generic, TypeVar

from mindstage.world import Iri

__all__ = ["ClassHierarchy", "Closure"]

T = TypeVar("T", bound=Hashable)


class Closure(Generic[T]):
    """The transitive closure of pairs (lower, upper)."""

    def __init__(self, pairs: Iterable[tuple[T, T]] = ()) -> None:
        """Stores the pairs; those of a thing with itself are ignored."""
        self._upper: dict[T, dict[T, None]] = {}
        self._lower: dict[T, dict[T, None]] = {}
        self._above: dict[T, dict[T, int]] = {}
        self._below: dict[T, dict[T, int]] = {}
        for lower, upper in pairs:
            self.add(lower, upper)

    def add(self, lower: T, upper: T) -> None:
        """Adds a step."""
        if lower != upper:
            self._upper.setdefault(lower, {})[upper] = None
            self._lower.setdefault(upper, {})[lower] = None
            self._forget()

    def discard(self, lower: T, upper: T) -> None:
        """Removes a step, if it exists."""
        for steps, start, end in ((self._upper, lower, upper), (self._lower, upper, lower)):
            ends = steps.get(start, {})
            ends.pop(end, None)
            if not ends:
                steps.pop(start, None)
        self._forget()

    def __iter__(self) -> Iterator[T]:
        """Everything that some pair names."""
        return iter(dict.fromkeys((*self._upper, *self._lower)))

    def __contains__(self, thing: object) -> bool:
        """Whether some pair names it."""
        return thing in self._upper or thing in self._lower

    def parents(self, thing: T) -> tuple[T, ...]:
        """The uppers of its own pairs."""
        return tuple(self._upper.get(thing, ()))

    def children(self, thing: T) -> tuple[T, ...]:
        """The lowers of its own pairs."""
        return tuple(self._lower.get(thing, ()))

    def above(self, thing: T) -> Mapping[T, int]:
        """The thing itself and all above it, the nearest first, with the number of steps to each."""
        if thing not in self._above:
            self._above[thing] = _levels(thing, self._upper)
        return self._above[thing]

    def below(self, thing: T) -> Mapping[T, int]:
        """The thing itself and all below it, the nearest first, with the number of steps to each."""
        if thing not in self._below:
            self._below[thing] = _levels(thing, self._lower)
        return self._below[thing]

    def path(self, lower: T, upper: T) -> tuple[T, ...]:
        """A shortest way up, both ends included; empty where there is none."""
        steps = self.above(lower)
        if upper not in steps:
            return ()
        way = [upper]
        while way[-1] != lower:
            children = self._lower[way[-1]]
            way.append(min(children, key=lambda child: (steps.get(child, len(steps)), str(child))))
        return tuple(reversed(way))

    def between(self, lower: T, upper: T) -> int:
        """How many things lie between two ends; the more special of two reasons always has fewer."""
        return len(self.above(lower).keys() & self.below(upper).keys()) - 1

    def _forget(self) -> None:
        if self._above or self._below:
            self._above, self._below = {}, {}


def _levels(start: T, steps: Mapping[T, Mapping[T, None]]) -> dict[T, int]:
    found = {start: 0}
    for thing in (waiting := [start]):
        for other in sorted(steps.get(thing, ()), key=str):  # the store has no order to rely on
            if other not in found:
                found[other] = found[thing] + 1
                waiting.append(other)
    return found


class ClassHierarchy:
    """Superclasses and subclasses; equivalent classes are below one another."""

    def __init__(self, pairs: Iterable[tuple[Iri, Iri]]) -> None:
        """Builds the index.

        Args:
            pairs: class and superclass, as stated in the sources.
        """
        self._closure = Closure(pairs)
        self._ancestors: dict[Iri, tuple[Iri, ...]] = {}

    def levels(self, classes: Sequence[Iri]) -> Iterator[Sequence[Iri]]:
        """The classes themselves, then their superclasses, then theirs; each class once, each level sorted."""
        steps: dict[Iri, int] = {}
        for cls in classes:
            for superclass, number in self._closure.above(cls).items():
                steps[superclass] = min(number, steps.get(superclass, number))
        own = list(dict.fromkeys(classes))
        if own:
            yield own
        above = sorted((number, superclass) for superclass, number in steps.items() if number)
        for _, level in groupby(above, key=lambda each: each[0]):
            yield [superclass for _, superclass in level]

    def ancestors(self, cls: Iri) -> tuple[Iri, ...]:
        """All superclasses, the nearest first; the class itself is not among them, even in a cycle."""
        if cls not in self._ancestors:
            _, *levels = self.levels([cls])
            self._ancestors[cls] = tuple(superclass for level in levels for superclass in level)
        return self._ancestors[cls]

    def descendants(self, cls: Iri) -> frozenset[Iri]:
        """All subclasses, without the class itself."""
        return frozenset(self._closure.below(cls)) - {cls}

    def is_a(self, cls: Iri, ancestor: Iri) -> bool:
        """Whether one class is the other or below it."""
        return ancestor in self._closure.above(cls)

    def most_specific(self, classes: Sequence[Iri]) -> Iri:
        """The first of the classes that has none of the others below it; in a cycle, the first of all."""
        return next(
            cls for cls in classes if not any(self.is_a(other, cls) and not self.is_a(cls, other) for other in classes)
        )
