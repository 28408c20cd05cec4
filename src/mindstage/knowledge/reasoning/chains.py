"""Chains: the values of a property that follow when properties are put one behind another, in circles too.

`hasPart` after `hasPart` is a transitive property, `locatedIn` after `partOf` may be `locatedIn` again. Whatever is
asked for on the way is asked for once, and hears of each value as soon as it is found, so that no circle goes on for
ever.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Container, Iterable, Mapping
from typing import Generic, NamedTuple, TypeVar

from mindstage.knowledge.taxonomy import Closure
from mindstage.world import Iri

__all__ = ["Chain", "Line", "Search"]

S = TypeVar("S")

Line = tuple[Iri, bool]
"""A property, read forwards or backwards."""
Chain = tuple[Line, ...]


class Goal(NamedTuple):
    """What is asked for: all that lies one step, or any number of them, along a line from a thing."""

    line: Line
    thing: Iri
    transitive: bool


class Wish(NamedTuple, Generic[S]):
    """Who wants to hear of a goal's values: another goal, once the rest of a chain was followed too."""

    goal: Goal
    rest: Chain
    way: tuple[S, ...]


class Search(Generic[S]):
    """One question's way through the statements."""

    def __init__(
        self,
        lattice: Closure[Line],
        chains: Mapping[Iri, Iterable[Chain]],
        transitive: Container[Iri],
        told: Callable[[Line, Iri], Iterable[tuple[Iri, tuple[S, ...]]]],
    ) -> None:
        """Finds nothing yet.

        Args:
            lattice: which line implies which.
            chains: by the property that they imply.
            transitive: properties that are followed to the end.
            told: the told values of a line, each with its statement.
        """
        self._lattice = lattice
        self._chains = chains
        self._transitive = transitive
        self._told = told
        self._found: dict[Goal, dict[Iri, tuple[S, ...]]] = {}
        self._wishes: dict[Goal, list[Wish[S]]] = {}
        self._news: deque[tuple[Wish[S], Iri, tuple[S, ...]]] = deque()

    def values(self, line: Line, thing: Iri, *, transitive: bool = True) -> Mapping[Iri, tuple[S, ...]]:
        """Everything along a line, with the statements on the way there.

        Args:
            line: what is asked for.
            thing: where it starts.
            transitive: whether the line itself is followed to the end, where it is transitive; those below it are.
        """
        goal = Goal(line, thing, transitive)
        self._open(goal)
        while self._news:
            wish, value, way = self._news.popleft()
            self._hear(wish, value, way)
        return self._found[goal]

    def _open(self, goal: Goal) -> None:
        if goal in self._found:
            return
        self._found[goal], self._wishes[goal] = {}, []
        for line in self._lattice.below(goal.line):
            property, forward = line
            follows = property in self._transitive and line != goal.line
            if follows:
                self._ask(Goal(line, goal.thing, transitive=True), Wish(goal, (), ()))
                continue
            for value, way in self._told(line, goal.thing):
                self._news.append((Wish(goal, (), ()), value, way))
            for chain in self._chains.get(property, ()):
                links = chain if forward else tuple((link, not ahead) for link, ahead in reversed(chain))
                self._ask(Goal(links[0], goal.thing, transitive=True), Wish(goal, links[1:], ()))

    def _ask(self, goal: Goal, wish: Wish[S]) -> None:
        self._open(goal)
        self._wishes[goal].append(wish)
        self._news.extend((wish, value, way) for value, way in self._found[goal].items())

    def _hear(self, wish: Wish[S], value: Iri, way: tuple[S, ...]) -> None:
        way = (*wish.way, *way)
        if wish.rest:
            self._ask(Goal(wish.rest[0], value, transitive=True), Wish(wish.goal, wish.rest[1:], way))
            return
        found = self._found[wish.goal]
        if value in found:
            return
        found[value] = way
        self._news.extend((waiting, value, way) for waiting in self._wishes[wish.goal])
        if wish.goal.transitive and wish.goal.line[0] in self._transitive:
            self._ask(Goal(wish.goal.line, value, transitive=False), Wish(wish.goal, (), way))
