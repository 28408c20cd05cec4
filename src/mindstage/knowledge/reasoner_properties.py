"""Property axioms: subproperties, inverse, symmetric and transitive properties, and property chains.

`hasPart` after `hasPart` is a transitive property; `locatedIn` after `partOf` may again be `locatedIn`. Chains may
refer to each other in cycles: each goal of a search is opened once, and every value found is passed to all goals that
depend on it, so the search terminates.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Container, Iterable, Iterator, Mapping
from functools import cache
from typing import Generic, NamedTuple, TypeVar

import msgspec
import pyoxigraph as ox

from mindstage.knowledge.owl import (
    ClassExpressionParser,
    Expression,
    IntersectionOf,
    LiteralValue,
    NamedClass,
    node_label,
)
from mindstage.knowledge.owl_rl import InferredTriples
from mindstage.rdf.graphs import QuadSource, node_to_look_up, quads_with_property
from mindstage.rdf.taxonomy import TransitiveClosure
from mindstage.rdf.vocabulary import OWL, RDFS, TYPE
from mindstage.scene import Iri

__all__ = [
    "PROPERTY_AXIOM_PROPERTIES",
    "PROPERTY_TYPES",
    "ChainSearch",
    "ObjectTriple",
    "PropertyChain",
    "PropertyExpression",
    "PropertyHierarchy",
]


S = TypeVar("S")

PropertyExpression = tuple[Iri, bool]
"""A property and whether it is followed forwards; False for its inverse."""
PropertyChain = tuple[PropertyExpression, ...]

_CHAIN = Iri(OWL + "propertyChainAxiom")
_DOMAIN, _RANGE = Iri(RDFS + "domain"), Iri(RDFS + "range")
_IMPLICATIONS = (
    (Iri(RDFS + "subPropertyOf"), False, False),
    (Iri(OWL + "equivalentProperty"), True, False),
    (Iri(OWL + "inverseOf"), True, True),
)
"""The axiom; whether it holds in both directions; whether it inverts the property."""
PROPERTY_AXIOM_PROPERTIES = frozenset({_CHAIN, _DOMAIN, _RANGE, *(axiom for axiom, _, _ in _IMPLICATIONS)})
"""The properties of statements about properties."""
PROPERTY_TYPES = frozenset(Iri(OWL + name) for name in ("TransitiveProperty", "SymmetricProperty"))
"""The types of properties that have consequences."""


class ChainGoal(NamedTuple):
    """One goal of a search: all values of a property expression, one step or any number of steps from an individual."""

    property_expression: PropertyExpression
    start: Iri
    transitive: bool


class ChainContinuation(NamedTuple, Generic[S]):
    """What follows from a goal's values: a value of another goal, after the rest of a chain."""

    goal: ChainGoal
    remaining: PropertyChain
    path: tuple[S, ...]


class ChainSearch(Generic[S]):
    """A search for the values of property expressions, including chains and transitive properties."""

    def __init__(
        self,
        property_closure: TransitiveClosure[PropertyExpression],
        chains: Mapping[Iri, Iterable[PropertyChain]],
        transitive: Container[Iri],
        asserted_values: Callable[[PropertyExpression, Iri], Iterable[tuple[Iri, tuple[S, ...]]]],
    ) -> None:
        """Creates a search without goals.

        Args:
            property_closure: which property expression implies which.
            chains: the chains that imply a property, by property.
            transitive: the transitive properties.
            asserted_values: the asserted values of a property expression, each with its statement.
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
        """All values of a property expression, with the statements that lead to them.

        Args:
            property_expression: the property and its direction.
            start: the individual to start from.
            transitive: whether to repeat the expression itself if it is transitive; those that imply it are repeated.
        """
        goal = ChainGoal(property_expression, start, transitive)
        self._open_goal(goal)
        while self._queue:
            continuation, value, path = self._queue.popleft()
            self._on_value(continuation, value, path)
        return self._found[goal]

    def _open_goal(self, goal: ChainGoal) -> None:
        if goal in self._found:
            return
        self._found[goal], self._continuations[goal] = {}, []
        for expression in self._property_closure.below(goal.property_expression):
            property, forward = expression
            if property in self._transitive and expression != goal.property_expression:
                self._subscribe(ChainGoal(expression, goal.start, transitive=True), ChainContinuation(goal, (), ()))
                continue
            for value, path in self._asserted_values(expression, goal.start):
                self._queue.append((ChainContinuation(goal, (), ()), value, path))
            for chain in self._chains.get(property, ()):
                links = chain if forward else tuple((link, not ahead) for link, ahead in reversed(chain))
                self._subscribe(
                    ChainGoal(links[0], goal.start, transitive=True), ChainContinuation(goal, links[1:], ())
                )

    def _subscribe(self, goal: ChainGoal, continuation: ChainContinuation[S]) -> None:
        self._open_goal(goal)
        self._continuations[goal].append(continuation)
        self._queue.extend((continuation, value, path) for value, path in self._found[goal].items())

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


class ObjectTriple(msgspec.Struct, frozen=True):
    """A triple between two resources."""

    subject: Iri
    property: Iri
    object: Iri


InferenceStep = tuple[Iri, tuple[ObjectTriple, ...]]
"""An individual, and the statements that lead to it."""


class DomainRange(msgspec.Struct, frozen=True):
    """The class of everything at one end of a property."""

    property: Iri
    is_domain: bool
    """Whether the class is that of the subjects (rdfs:domain), not of the values (rdfs:range)."""
    cls: Iri


class PropertyHierarchy:
    """The property axioms of a triple store, and the values that follow from them."""

    def __init__(
        self, store: QuadSource, parser: ClassExpressionParser | None = None, inferred: InferredTriples | None = None
    ) -> None:
        """Reads the axioms; statements about individuals stay in the store.

        Args:
            store: the asserted statements.
            parser: parses lists and class expressions; None creates one.
            inferred: the materialized statements, if any.
        """
        self._store = store
        self._inferred = inferred
        self._property_closure = TransitiveClosure(self._implication_pairs())
        self._parser = parser = parser or ClassExpressionParser()
        self._chains = self._read_chains(parser)
        self._domains_ranges = {
            axiom: {
                iri: tuple(_named_conjuncts(map(parser.parse, nodes)))
                for iri, nodes in self._objects_by_subject(axiom).items()
            }
            for axiom in (_DOMAIN, _RANGE)
        }
        self._bounding_classes = {
            cls for bounds in self._domains_ranges.values() for classes in bounds.values() for cls in classes
        }
        self._transitive = {
            iri
            for property in self._properties_of_type("TransitiveProperty")
            for iri, forward in self._property_closure.below((property, True))
            if (iri, forward) in self._property_closure.above((property, True))  # itself, equal ones, and inverses
        }
        self._used_cache = cache(self._compute_used)
        self._chain_cache = cache(self._compute_chained)
        self.sub_properties = cache(self._compute_sub_properties)

    def _compute_sub_properties(self, property: Iri) -> tuple[Iri, ...]:
        """The property and its subproperties, the nearest first, without inverses."""
        return tuple(iri for iri, forward in self._property_closure.below((property, True)) if forward)

    def super_properties(self, property: Iri) -> tuple[Iri, ...]:
        """The property and its superproperties, the nearest first, without inverses."""
        return tuple(iri for iri, forward in self._property_closure.above((property, True)) if forward)

    def implying_properties(self, property: Iri) -> Iterator[Iri]:
        """The property and all that imply it or its inverse."""
        return (iri for iri, _ in self._property_closure.below((property, True)))

    @property
    def has_chains(self) -> bool:
        """Whether any property follows from a chain."""
        return any(self._chains.values())

    def implication_path(self, property: Iri, upper: Iri) -> tuple[Iri, ...]:
        """The properties through which one implies another, from the first to the last."""
        return tuple(iri for iri, _ in self._property_closure.path((property, True), (upper, True)))

    def all_names(self) -> Iterator[Iri]:
        """All properties with axioms and the classes of their domains and ranges, possibly repeated."""
        yield from (iri for iri, _ in self._property_closure)
        yield from (
            *self._domains_ranges[_DOMAIN],
            *self._domains_ranges[_RANGE],
            *self._chains,
            *self._bounding_classes,
        )

    def __contains__(self, iri: object) -> bool:
        """Whether the property has an axiom."""
        in_closure = (iri, True) in self._property_closure or (iri, False) in self._property_closure
        return (
            in_closure
            or iri in self._domains_ranges[_DOMAIN]
            or iri in self._domains_ranges[_RANGE]
            or iri in self._chains
        )

    def domains_ranges(self, property: Iri, *, as_subject: bool) -> Iterator[DomainRange]:
        """The classes of all subjects or all values of a property, including those of implied properties."""
        for iri, forward in self._property_closure.above((property, True)):
            is_start = forward == as_subject
            for cls in self._domains_ranges[_DOMAIN if is_start else _RANGE].get(iri, ()):
                yield DomainRange(iri, is_start, cls)

    def used_expressions(self, property: Iri) -> tuple[tuple[ox.NamedNode, bool], ...]:
        """The property expressions that imply a property and that occur in the store."""
        return self._used_cache(((property, True),))

    def is_domain_or_range(self, cls: Iri) -> bool:
        """Whether a class is the domain or range of a property."""
        return cls in self._bounding_classes

    def clear_usage_cache(self) -> None:
        """Must be called when statements were added or removed: other properties may be in use."""
        self._used_cache.cache_clear()

    # -- values --------------------------------------------------------------------------------------------------------

    def steps(
        self, expressions: tuple[PropertyExpression, ...], individual: Iri, *, backwards: bool = False
    ) -> Iterator[InferenceStep]:
        """Individuals one step away: by an asserted statement whose property implies an expression, or by a chain."""
        for node, forward in self._used_cache(expressions):
            yield from _asserted_steps(self._store, node, individual, forwards=forward != backwards)
        for iri, forward in self._chain_cache(expressions):
            expression = (iri, forward != backwards)
            yield from self._new_search().values(expression, individual, transitive=False).items()

    def inferred_steps(
        self, expressions: tuple[PropertyExpression, ...], individual: Iri, *, backwards: bool = False
    ) -> Iterator[InferenceStep]:
        """Individuals one step away by a materialized statement."""
        if self._inferred:
            for iri, forward in self._implying_expressions(expressions):
                yield from _asserted_steps(self._inferred, ox.NamedNode(iri), individual, forwards=forward != backwards)

    def values(self, property: Iri, individual: Iri, *, backwards: bool = False) -> tuple[Iri, ...]:
        """All values of a property, following transitive properties and chains."""
        return tuple(self._new_search().values((property, not backwards), individual))

    def values_with_paths(
        self, property: Iri, individual: Iri, *, backwards: bool = False
    ) -> Iterator[tuple[NamedClass | LiteralValue, tuple[ObjectTriple, ...]]]:
        """All values of a property, including literals, with the statements that lead to them."""
        for name, path in self._new_search().values((property, not backwards), individual).items():
            yield NamedClass(name), path
        for iri, forward in self.used_expressions(property):
            for quad in (
                self._store.quads_for_pattern(node_to_look_up(individual), iri, None) if forward != backwards else ()
            ):
                if isinstance(value := self._parser.parse(quad.object), LiteralValue):
                    yield value, (ObjectTriple(individual, Iri(iri.value), Iri(value.literal.text)),)

    def candidate_subjects(self, property: Iri, *, backwards: bool = False) -> Iterator[Iri]:
        """A superset of the individuals that have a value of the property."""
        waiting: dict[PropertyExpression, None] = {(property, not backwards): None}
        done: set[PropertyExpression] = set()
        while waiting:
            expression, _ = waiting.popitem()
            for iri, forward in self._property_closure.below(expression).keys() - done:
                done.add((iri, forward))
                for quad in quads_with_property(self._store, iri):
                    if name := node_label(quad.subject if forward else quad.object):
                        yield name
                for chain in self._chains.get(iri, ()):
                    first, ahead = chain[0] if forward else chain[-1]
                    waiting[first, ahead == forward] = None

    def _new_search(self) -> ChainSearch[ObjectTriple]:
        def asserted_values(expression: PropertyExpression, individual: Iri) -> Iterator[InferenceStep]:
            return _asserted_steps(self._store, ox.NamedNode(expression[0]), individual, forwards=expression[1])

        return ChainSearch(self._property_closure, self._chains, self._transitive, asserted_values)

    def _implying_expressions(self, expressions: tuple[PropertyExpression, ...]) -> dict[PropertyExpression, None]:
        return {below: None for expression in expressions for below in self._property_closure.below(expression)}

    def _compute_used(self, expressions: tuple[PropertyExpression, ...]) -> tuple[tuple[ox.NamedNode, bool], ...]:
        """The expressions that imply one of these and that occur in the store."""
        below = [(ox.NamedNode(iri), forward) for iri, forward in self._implying_expressions(expressions)]
        return tuple(each for each in below if next(iter(quads_with_property(self._store, each[0].value)), None))

    def _compute_chained(self, expressions: tuple[PropertyExpression, ...]) -> tuple[PropertyExpression, ...]:
        """Those of the expressions that a chain implies."""
        return tuple(
            each for each in expressions if any(self._chains.get(iri) for iri, _ in self._property_closure.below(each))
        )

    # -- reading -------------------------------------------------------------------------------------------------------

    def _implication_pairs(self) -> Iterator[tuple[PropertyExpression, PropertyExpression]]:
        """Pairs of property expressions of which the first implies the second."""
        for axiom, mirrored, inverse in _IMPLICATIONS:
            for quad in quads_with_property(self._store, axiom):
                if isinstance(quad.subject, ox.NamedNode) and isinstance(quad.object, ox.NamedNode):
                    one, other = Iri(quad.subject.value), Iri(quad.object.value)
                    for forward in (True, False):
                        yield (one, forward), (other, forward != inverse)
                        if mirrored:
                            yield (other, forward), (one, forward != inverse)
        for iri in self._properties_of_type("SymmetricProperty"):
            yield (iri, True), (iri, False)
            yield (iri, False), (iri, True)

    def _read_chains(self, parser: ClassExpressionParser) -> dict[Iri, tuple[PropertyChain, ...]]:
        chains: dict[Iri, list[PropertyChain]] = {}
        for iri, heads in self._objects_by_subject(_CHAIN).items():
            chains[iri] = []
            for head in heads:
                links = [parser.property_expression(item) for item in parser.list_items(head)]
                if links and None not in links:
                    chains[iri].append(tuple(link for link in links if link))
        return {iri: tuple(sorted(each)) for iri, each in chains.items()}

    def _objects_by_subject(self, predicate: Iri) -> dict[Iri, list[object]]:
        found: dict[Iri, list[object]] = {}
        for quad in quads_with_property(self._store, predicate):
            if isinstance(quad.subject, ox.NamedNode):
                found.setdefault(Iri(quad.subject.value), []).append(quad.object)
        return found

    def _properties_of_type(self, name: str) -> frozenset[Iri]:
        quads = self._store.quads_for_pattern(None, ox.NamedNode(TYPE), ox.NamedNode(OWL + name))
        return frozenset(Iri(quad.subject.value) for quad in quads if isinstance(quad.subject, ox.NamedNode))


def _asserted_steps(
    store: QuadSource | InferredTriples, property: ox.NamedNode, individual: Iri, *, forwards: bool
) -> Iterator[InferenceStep]:
    """The asserted values of a property, or the subjects that have the individual as value."""
    node = node_to_look_up(individual)
    if forwards:
        for quad in store.quads_for_pattern(node, property, None):
            if name := node_label(quad.object):
                yield name, (ObjectTriple(individual, Iri(property.value), name),)
    else:
        for quad in store.quads_for_pattern(None, property, node):
            if name := node_label(quad.subject):
                yield name, (ObjectTriple(name, Iri(property.value), individual),)


def _named_conjuncts(expressions: Iterable[Expression]) -> list[Iri]:
    """The named classes of everything that is an instance of all expressions."""
    found: set[Iri] = set()
    for expression in expressions:
        match expression:
            case NamedClass(iri) if not iri.startswith((OWL, RDFS)):
                found.add(iri)
            case IntersectionOf(members):
                found.update(_named_conjuncts(members))
    return sorted(found)
