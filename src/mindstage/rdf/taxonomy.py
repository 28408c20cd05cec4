"""Transitive closures, and the class hierarchy, which is one; cycles are allowed.

The members of a cycle are above and below one another. Closures are computed on demand and kept until a pair is added
or removed.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from typing import Generic, TypeVar

from mindstage.scene import Iri

__all__ = ["ClassHierarchy", "TransitiveClosure"]

T = TypeVar("T", bound=Hashable)


class TransitiveClosure(Generic[T]):
    """The transitive closure of pairs (lower, upper)."""

    def __init__(self, pairs: Iterable[tuple[T, T]] = ()) -> None:
        """Stores the pairs; pairs of equal nodes are ignored."""
        self._parents: dict[T, dict[T, None]] = {}
        self._children: dict[T, dict[T, None]] = {}
        self._above_cache: dict[T, dict[T, int]] = {}
        self._below_cache: dict[T, dict[T, int]] = {}
        for lower, upper in pairs:
            self.add(lower, upper)

    def add(self, lower: T, upper: T) -> None:
        """Adds a pair."""
        if lower != upper:
            self._parents.setdefault(lower, {})[upper] = None
            self._children.setdefault(upper, {})[lower] = None
            self._clear_cache()

    def discard(self, lower: T, upper: T) -> None:
        """Removes a pair, if it exists."""
        for steps, start, end in ((self._parents, lower, upper), (self._children, upper, lower)):
            ends = steps.get(start, {})
            ends.pop(end, None)
            if not ends:
                steps.pop(start, None)
        self._clear_cache()

    def __iter__(self) -> Iterator[T]:
        """All nodes."""
        return iter(dict.fromkeys((*self._parents, *self._children)))

    def __contains__(self, node: object) -> bool:
        """Whether a pair has this node."""
        return node in self._parents or node in self._children

    def parents(self, node: T) -> tuple[T, ...]:
        """The direct uppers of a node."""
        return tuple(self._parents.get(node, ()))

    def children(self, node: T) -> tuple[T, ...]:
        """The direct lowers of a node."""
        return tuple(self._children.get(node, ()))

    def above(self, node: T) -> Mapping[T, int]:
        """The node itself and all above it, the nearest first, with the number of steps to each."""
        if node not in self._above_cache:
            self._above_cache[node] = _breadth_first(node, self._parents)
        return self._above_cache[node]

    def below(self, node: T) -> Mapping[T, int]:
        """The node itself and all below it, the nearest first, with the number of steps to each."""
        if node not in self._below_cache:
            self._below_cache[node] = _breadth_first(node, self._children)
        return self._below_cache[node]

    def path(self, lower: T, upper: T) -> tuple[T, ...]:
        """A shortest path upwards, including both ends; empty if there is none."""
        steps = self.above(lower)
        if upper not in steps:
            return ()
        path = [upper]
        while path[-1] != lower:
            children = self._children[path[-1]]
            path.append(min(children, key=lambda child: (steps.get(child, len(steps)), str(child))))
        return tuple(reversed(path))

    def count_between(self, lower: T, upper: T) -> int:
        """The number of nodes between two ends, plus one; it is smaller for the more specific of two uppers."""
        return len(self.above(lower).keys() & self.below(upper).keys()) - 1

    def _clear_cache(self) -> None:
        if self._above_cache or self._below_cache:
            self._above_cache, self._below_cache = {}, {}


def _breadth_first(start: T, steps: Mapping[T, Mapping[T, None]]) -> dict[T, int]:
    found = {start: 0}
    for node in (waiting := [start]):
        for other in sorted(steps.get(node, ()), key=str):  # the store has no defined order
            if other not in found:
                found[other] = found[node] + 1
                waiting.append(other)
    return found


class ClassHierarchy:
    """Superclasses and subclasses; equivalent classes are below one another."""

    def __init__(self, pairs: Iterable[tuple[Iri, Iri]]) -> None:
        """Builds the index.

        Args:
            pairs: class and superclass, as stated in the sources.
        """
        self._closure = TransitiveClosure(pairs)
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
        """Whether a class is another class or one of its subclasses."""
        return ancestor in self._closure.above(cls)

    def most_specific(self, classes: Sequence[Iri]) -> Iri:
        """The first of the classes that has no subclass among the others; in a cycle, the first of all."""
        return next(
            cls for cls in classes if not any(self.is_a(other, cls) and not self.is_a(cls, other) for other in classes)
        )
