"""Properties: what follows from subproperties, inverse, symmetric and transitive ones, and from chains of them.

Chains: the values of a property that follow when properties are put one behind another, in circles too.

`hasPart` after `hasPart` is a transitive property, `locatedIn` after `partOf` may be `locatedIn` again. Whatever is
asked for on the way is asked for once, and hears of each value as soon as it is found, so that no circle goes on for
ever.
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
from mindstage.knowledge.rdf import QuadSource
from mindstage.knowledge.taxonomy import TransitiveClosure
from mindstage.knowledge.vocabulary import OWL, RDFS, TYPE
from mindstage.scene import Iri

__all__ = [
    "PROPERTY_AXIOM_PROPERTIES",
    "PROPERTY_TYPES",
    "ChainSearch",
    "ObjectTriple",
    "PropertyChain",
    "PropertyExpression",
    "PropertyHierarchy",
    "node_from_label",
]


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


_CHAIN = Iri(OWL + "propertyChainAxiom")
_DOMAIN, _RANGE = Iri(RDFS + "domain"), Iri(RDFS + "range")
_IMPLICATIONS = (
    (Iri(RDFS + "subPropertyOf"), False, False),
    (Iri(OWL + "equivalentProperty"), True, False),
    (Iri(OWL + "inverseOf"), True, True),
)
"""Words; whether each works both ways; whether it turns the direction."""
PROPERTY_AXIOM_PROPERTIES = frozenset({_CHAIN, _DOMAIN, _RANGE, *(word for word, _, _ in _IMPLICATIONS)})
"""The properties that tell something of properties."""
PROPERTY_TYPES = frozenset(Iri(OWL + name) for name in ("TransitiveProperty", "SymmetricProperty"))
"""What properties can be said to be that has consequences."""


class ObjectTriple(msgspec.Struct, frozen=True):
    """One triple between two things, as told."""

    subject: Iri
    property: Iri
    object: Iri


InferenceStep = tuple[Iri, tuple[ObjectTriple, ...]]
"""A thing, and the statements that lead there."""


class DomainRange(msgspec.Struct, frozen=True):
    """What everything at one end of a property is."""

    property: Iri
    is_domain: bool
    """Whether the start of the property is meant (rdfs:domain), and not its end (rdfs:range)."""
    cls: Iri


class PropertyHierarchy:
    """How properties follow from one another, and the values that follow from that."""

    def __init__(
        self, store: QuadSource, parser: ClassExpressionParser | None = None, inferred: InferredTriples | None = None
    ) -> None:
        """Reads what is told of properties; statements about individuals stay in the store.

        Args:
            store: where everything is that was told.
            reader: knows the lists and expressions that chains, domains and ranges are written with.
            derived: what was derived from it.
        """
        self._store = store
        self._inferred = inferred
        self._property_closure = TransitiveClosure(self._implication_pairs())
        self._parser = parser = parser or ClassExpressionParser()
        self._chains = self._read_chains(parser)
        self._domains_ranges = {
            word: {
                iri: tuple(_named_conjuncts(map(parser.parse, nodes)))
                for iri, nodes in self._objects_by_subject(word).items()
            }
            for word in (_DOMAIN, _RANGE)
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
        """The property itself and those that imply it in the same direction, the nearest first."""
        return tuple(iri for iri, forward in self._property_closure.below((property, True)) if forward)

    def super_properties(self, property: Iri) -> tuple[Iri, ...]:
        """The property itself and those that it implies in the same direction, the nearest first."""
        return tuple(iri for iri, forward in self._property_closure.above((property, True)) if forward)

    def implying_properties(self, property: Iri) -> Iterator[Iri]:
        """The property itself and all that imply it or its inverse."""
        return (iri for iri, _ in self._property_closure.below((property, True)))

    @property
    def has_chains(self) -> bool:
        """Whether some property follows from others put one behind another."""
        return any(self._chains.values())

    def implication_path(self, property: Iri, upper: Iri) -> tuple[Iri, ...]:
        """How one property implies the other, step by step."""
        return tuple(iri for iri, _ in self._property_closure.path((property, True), (upper, True)))

    def all_names(self) -> Iterator[Iri]:
        """Every property that something is told of, and the classes that they lead to; some more than once."""
        yield from (iri for iri, _ in self._property_closure)
        yield from (
            *self._domains_ranges[_DOMAIN],
            *self._domains_ranges[_RANGE],
            *self._chains,
            *self._bounding_classes,
        )

    def __contains__(self, iri: object) -> bool:
        """Whether something is told of the property."""
        told = (iri, True) in self._property_closure or (iri, False) in self._property_closure
        return (
            told or iri in self._domains_ranges[_DOMAIN] or iri in self._domains_ranges[_RANGE] or iri in self._chains
        )

    def domains_ranges(self, property: Iri, *, as_subject: bool) -> Iterator[DomainRange]:
        """What everything is that has the property, or that is its value; implied properties count."""
        for iri, forward in self._property_closure.above((property, True)):
            is_start = forward == as_subject
            for cls in self._domains_ranges[_DOMAIN if is_start else _RANGE].get(iri, ()):
                yield DomainRange(iri, is_start, cls)

    def used_expressions(self, property: Iri) -> tuple[tuple[ox.NamedNode, bool], ...]:
        """The properties that imply this one, forwards or backwards, as far as anybody uses them."""
        return self._used_cache(((property, True),))

    def is_domain_or_range(self, cls: Iri) -> bool:
        """Whether the class is the domain or range of some property."""
        return cls in self._bounding_classes

    def clear_usage_cache(self) -> None:
        """Some property may be used now that nobody used before, or the other way round."""
        self._used_cache.cache_clear()

    # -- values --------------------------------------------------------------------------------------------------------

    def steps(
        self, expressions: tuple[PropertyExpression, ...], individual: Iri, *, backwards: bool = False
    ) -> Iterator[InferenceStep]:
        """One step away: by a told statement of a property that implies one of these, or by a chain that does."""
        for node, forward in self._used_cache(expressions):
            yield from _asserted_steps(self._store, node, individual, forwards=forward != backwards)
        for iri, forward in self._chain_cache(expressions):
            line = (iri, forward != backwards)
            yield from self._new_search().values(line, individual, transitive=False).items()

    def inferred_steps(
        self, expressions: tuple[PropertyExpression, ...], individual: Iri, *, backwards: bool = False
    ) -> Iterator[InferenceStep]:
        """One step away by a statement that was derived."""
        if self._inferred:
            for iri, forward in self._implying_expressions(expressions):
                yield from _asserted_steps(self._inferred, ox.NamedNode(iri), individual, forwards=forward != backwards)

    def values(self, property: Iri, individual: Iri, *, backwards: bool = False) -> tuple[Iri, ...]:
        """All values that follow; a transitive property is followed to the end, and so are transitive ones below it."""
        return tuple(self._new_search().values((property, not backwards), individual))

    def values_with_paths(
        self, property: Iri, individual: Iri, *, backwards: bool = False
    ) -> Iterator[tuple[NamedClass | LiteralValue, tuple[ObjectTriple, ...]]]:
        """All values that follow, texts and numbers too, with the statements that lead there."""
        for name, way in self._new_search().values((property, not backwards), individual).items():
            yield NamedClass(name), way
        for iri, forward in self.used_expressions(property):
            for quad in (
                self._store.quads_for_pattern(node_from_label(individual), iri, None) if forward != backwards else ()
            ):
                if isinstance(value := self._parser.parse(quad.object), LiteralValue):
                    yield value, (ObjectTriple(individual, Iri(iri.value), Iri(value.literal.text)),)

    def candidate_subjects(self, property: Iri, *, backwards: bool = False) -> Iterator[Iri]:
        """All things that may have a value of the property, and some that do not."""
        waiting: dict[PropertyExpression, None] = {(property, not backwards): None}
        done: set[PropertyExpression] = set()
        while waiting:
            line, _ = waiting.popitem()
            for iri, forward in self._property_closure.below(line).keys() - done:
                done.add((iri, forward))
                for quad in self._quads_with_predicate(iri):
                    if name := node_label(quad.subject if forward else quad.object):
                        yield name
                for chain in self._chains.get(iri, ()):
                    first, ahead = chain[0] if forward else chain[-1]
                    waiting[first, ahead == forward] = None

    def _new_search(self) -> ChainSearch[ObjectTriple]:
        def told(line: PropertyExpression, thing: Iri) -> Iterator[InferenceStep]:
            return _asserted_steps(self._store, ox.NamedNode(line[0]), thing, forwards=line[1])

        return ChainSearch(self._property_closure, self._chains, self._transitive, told)

    def _implying_expressions(self, expressions: tuple[PropertyExpression, ...]) -> dict[PropertyExpression, None]:
        return {below: None for line in expressions for below in self._property_closure.below(line)}

    def _compute_used(self, expressions: tuple[PropertyExpression, ...]) -> tuple[tuple[ox.NamedNode, bool], ...]:
        """What implies one of these, as far as anybody uses it."""
        below = [(ox.NamedNode(iri), forward) for iri, forward in self._implying_expressions(expressions)]
        return tuple(line for line in below if next(iter(self._quads_with_predicate(line[0].value)), None))

    def _compute_chained(self, expressions: tuple[PropertyExpression, ...]) -> tuple[PropertyExpression, ...]:
        """Those of the lines that some chain implies."""
        return tuple(
            line for line in expressions if any(self._chains.get(iri) for iri, _ in self._property_closure.below(line))
        )

    # -- reading -------------------------------------------------------------------------------------------------------

    def _implication_pairs(self) -> Iterator[tuple[PropertyExpression, PropertyExpression]]:
        """A property read forwards or backwards implies another one, read forwards or backwards."""
        for word, mirrored, inverse in _IMPLICATIONS:
            for quad in self._quads_with_predicate(word):
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
                lines = [parser.property_expression(item) for item in parser.list_items(head)]
                if lines and None not in lines:
                    chains[iri].append(tuple(line for line in lines if line))
        return {iri: tuple(sorted(told)) for iri, told in chains.items()}

    def _objects_by_subject(self, predicate: Iri) -> dict[Iri, list[object]]:
        found: dict[Iri, list[object]] = {}
        for quad in self._quads_with_predicate(predicate):
            if isinstance(quad.subject, ox.NamedNode):
                found.setdefault(Iri(quad.subject.value), []).append(quad.object)
        return found

    def _properties_of_type(self, name: str) -> frozenset[Iri]:
        quads = self._store.quads_for_pattern(None, ox.NamedNode(TYPE), ox.NamedNode(OWL + name))
        return frozenset(Iri(quad.subject.value) for quad in quads if isinstance(quad.subject, ox.NamedNode))

    def _quads_with_predicate(self, predicate: str) -> Iterator[ox.Quad]:
        return self._store.quads_for_pattern(None, ox.NamedNode(predicate), None)


def _asserted_steps(
    store: QuadSource | InferredTriples, property: ox.NamedNode, individual: Iri, *, forwards: bool
) -> Iterator[InferenceStep]:
    """The told values of one property, or what has the thing as its value."""
    node = node_from_label(individual)
    if forwards:
        for quad in store.quads_for_pattern(node, property, None):
            if name := node_label(quad.object):
                yield name, (ObjectTriple(individual, Iri(property.value), name),)
    else:
        for quad in store.quads_for_pattern(None, property, node):
            if name := node_label(quad.subject):
                yield name, (ObjectTriple(name, Iri(property.value), individual),)


def _named_conjuncts(expressions: Iterable[Expression]) -> list[Iri]:
    """The named classes that all of these promise together."""
    found: set[Iri] = set()
    for expression in expressions:
        match expression:
            case NamedClass(iri) if not iri.startswith((OWL, RDFS)):
                found.add(iri)
            case IntersectionOf(members):
                found.update(_named_conjuncts(members))
    return sorted(found)


def node_from_label(name: Iri) -> ox.NamedNode | ox.BlankNode:
    """The node that has the name or label."""
    return ox.BlankNode(name[2:]) if name.startswith("_:") else ox.NamedNode(name)
