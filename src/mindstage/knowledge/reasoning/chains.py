"""Chains: the values of a property that follow when properties are put one behind another, in circles too.

`hasPart` after `hasPart` is a transitive property, `locatedIn` after `partOf` may be `locatedIn` again. Whatever is
asked for on the way is asked for once, and hears of each value as soon as it is found, so that no circle goes on for
ever.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Container, Iterable, Mapping
from typing import Generic, NamedTuple, TypeVar

from mindstage.knowledge.taxonomy import TransitiveClosure
from mindstage.world import Iri

__all__ = ["ChainSearch", "PropertyChain", "PropertyExpression"]

S = TypeVar("S")

PropertyExpression = tuple[Iri, bool]
"""A property, read forwards or backwards."""
PropertyChain = tuple[PropertyExpression, ...]


class ChainGoal(NamedTuple):
    """What is asked for: all that lies one step, or any number of them, along a line from a thing."""

    property_expression: PropertyExpression
    start: Iri
    transitive: bool


class ChainContinuation(NamedTuple, Generic[S]):
    """Who wants to hear of a goal's values: another goal, once the rest of a chain was followed too."""

    goal: ChainGoal
    remaining: PropertyChain
    path: tuple[S, ...]


class ChainSearch(Generic[S]):
    """One question's way through the statements."""

    def __init__(
        self,
        property_closure: TransitiveClosure[PropertyExpression],
        chains: Mapping[Iri, Iterable[PropertyChain]],
        transitive: Container[Iri],
        asserted_values: Callable[[PropertyExpression, Iri], Iterable[tuple[Iri, tuple[S, ...]]]],
    ) -> None:
        """Finds nothing yet.

        Args:
            lattice: which line implies which.
            chains: by the property that they imply.
            transitive: properties that are followed to the end.
            told: the told values of a line, each with its statement.
        """
        self._property_closure = property_closure
        self._chains = chains
        self._transitive = transitive
        self._asserted_values = asserted_values
        self._found: dict[ChainGoal, dict[Iri, tuple[S, ...]]] = {}
        self._continuations: dict[ChainGoal, list[ChainContinuation[S]]] = {}
        self._queue: deque[tuple[ChainContinuation[S], Iri, tuple[S, ...]]] = deque()

    def values(
        self, property_expression: PropertyExpression, start: Iri, *, transitive: bool = True
    ) -> Mapping[Iri, tuple[S, ...]]:
        """Everything along a line, with the statements on the way there.

        Args:
            line: what is asked for.
            thing: where it starts.
            transitive: whether the line itself is followed to the end, where it is transitive; those below it are.
        """
        goal = ChainGoal(property_expression, start, transitive)
        self._open_goal(goal)
        while self._queue:
            wish, value, way = self._queue.popleft()
            self._on_value(wish, value, way)
        return self._found[goal]

    def _open_goal(self, goal: ChainGoal) -> None:
        if goal in self._found:
            return
        self._found[goal], self._continuations[goal] = {}, []
        for line in self._property_closure.below(goal.property_expression):
            property, forward = line
            follows = property in self._transitive and line != goal.property_expression
            if follows:
                self._subscribe(ChainGoal(line, goal.start, transitive=True), ChainContinuation(goal, (), ()))
                continue
            for value, way in self._asserted_values(line, goal.start):
                self._queue.append((ChainContinuation(goal, (), ()), value, way))
            for chain in self._chains.get(property, ()):
                links = chain if forward else tuple((link, not ahead) for link, ahead in reversed(chain))
                self._subscribe(
                    ChainGoal(links[0], goal.start, transitive=True), ChainContinuation(goal, links[1:], ())
                )

    def _subscribe(self, goal: ChainGoal, continuation: ChainContinuation[S]) -> None:
        self._open_goal(goal)
        self._continuations[goal].append(continuation)
        self._queue.extend((continuation, value, way) for value, way in self._found[goal].items())

    def _on_value(self, continuation: ChainContinuation[S], value: Iri, path: tuple[S, ...]) -> None:
        path = (*continuation.path, *path)
        if continuation.remaining:
            self._subscribe(
                ChainGoal(continuation.remaining[0], value, transitive=True),
                ChainContinuation(continuation.goal, continuation.remaining[1:], path),
            )
            return
        found = self._found[continuation.goal]
        if value in found:
            return
        found[value] = path
        self._queue.extend((waiting, value, path) for waiting in self._continuations[continuation.goal])
        if continuation.goal.transitive and continuation.goal.property_expression[0] in self._transitive:
            self._subscribe(
                ChainGoal(continuation.goal.property_expression, value, transitive=False),
                ChainContinuation(continuation.goal, (), path),
            )
