"""Closures: everything above and below a thing, told only step by step.

Circles are allowed, their members are above and below one another. What was once asked is remembered until a step is
added or taken away.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Mapping
from typing import Generic, TypeVar

__all__ = ["Closure"]

T = TypeVar("T", bound=Hashable)


class Closure(Generic[T]):
    """The transitive closure of pairs (lower, upper), worked out where somebody asks."""

    def __init__(self, pairs: Iterable[tuple[T, T]] = ()) -> None:
        """Keeps the pairs; a thing above itself tells nothing."""
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
        """Takes a step away; no harm where it never was there."""
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
        """What is told to be directly above."""
        return tuple(self._upper.get(thing, ()))

    def children(self, thing: T) -> tuple[T, ...]:
        """What is told to be directly below."""
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
