"""Expressions: what ontologies say of a class without a name, from unions to restrictions, as plain values."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from enum import StrEnum

import msgspec
import pyoxigraph as ox

from mindstage.knowledge.vocabulary import HAS_VALUE, ON_PROPERTY, OWL, RDF
from mindstage.world import Iri, Literal

__all__ = [
    "STRUCTURE",
    "AllOf",
    "AnyOf",
    "Expression",
    "ExpressionReader",
    "Kind",
    "Named",
    "Not",
    "OneOf",
    "Restriction",
    "Unread",
    "Value",
    "classes_in",
    "node_name",
]

_FIRST, _REST, _NIL = RDF + "first", RDF + "rest", RDF + "nil"
_UNION, _INTERSECTION, _INVERSE = OWL + "unionOf", OWL + "intersectionOf", OWL + "inverseOf"
_COMPLEMENT, _ONE_OF = OWL + "complementOf", OWL + "oneOf"


class Kind(StrEnum):
    """How a restriction binds a property."""

    SOME = "someValuesFrom"
    ALL = "allValuesFrom"
    VALUE = "hasValue"
    SELF = "hasSelf"
    AT_LEAST = "minCardinality"
    AT_MOST = "maxCardinality"
    EXACTLY = "cardinality"


_COUNTS = {
    OWL + "minCardinality": Kind.AT_LEAST,
    OWL + "maxCardinality": Kind.AT_MOST,
    OWL + "cardinality": Kind.EXACTLY,
    OWL + "minQualifiedCardinality": Kind.AT_LEAST,
    OWL + "maxQualifiedCardinality": Kind.AT_MOST,
    OWL + "qualifiedCardinality": Kind.EXACTLY,
}
_FILLERS = {OWL + "someValuesFrom": Kind.SOME, OWL + "allValuesFrom": Kind.ALL, HAS_VALUE: Kind.VALUE}
_QUALIFIERS = (OWL + "onClass", OWL + "onDataRange")
_DEFINING = (_UNION, _INTERSECTION, _COMPLEMENT, _ONE_OF)
_TO_CLASSES = (OWL + "someValuesFrom", OWL + "allValuesFrom", *_QUALIFIERS)
STRUCTURE = (
    *(_FIRST, _REST, *_DEFINING, _INVERSE, ON_PROPERTY, OWL + "hasSelf"),
    *(*_FILLERS, *_COUNTS, *_QUALIFIERS),
)
"""The properties that expressions are built with."""


class Named(msgspec.Struct, frozen=True):
    """A class, datatype or individual that has a name."""

    iri: Iri


class Value(msgspec.Struct, frozen=True):
    """A literal."""

    literal: Literal


class AnyOf(msgspec.Struct, frozen=True):
    """A union."""

    members: tuple[Expression, ...]


class AllOf(msgspec.Struct, frozen=True):
    """An intersection."""

    members: tuple[Expression, ...]


class OneOf(msgspec.Struct, frozen=True):
    """An enumeration of individuals or values."""

    members: tuple[Expression, ...]


class Not(msgspec.Struct, frozen=True):
    """A complement."""

    expression: Expression


class Restriction(msgspec.Struct, frozen=True):
    """All things whose property has such values."""

    property: Iri
    kind: Kind
    filler: Expression | None = None
    """What the values are; None where only their number matters."""
    count: int | None = None
    inverse: bool = False
    """Whether the property is meant backwards."""

    def promises(self) -> bool:
        """Whether there surely is a value of such a class, and not only none of another."""
        if self.kind is Kind.SOME:
            return True
        return self.kind in {Kind.AT_LEAST, Kind.EXACTLY} and bool(self.count) and self.filler is not None


class Unread(msgspec.Struct, frozen=True):
    """An expression that has no meaning: broken, or in a circle."""


Expression = Named | Value | AnyOf | AllOf | OneOf | Not | Restriction | Unread


def node_name(node: object) -> Iri | None:
    """The name or label of a node; None for a literal."""
    if isinstance(node, ox.NamedNode):
        return Iri(node.value)
    return Iri("_:" + node.value) if isinstance(node, ox.BlankNode) else None


def classes_in(expression: Expression | None) -> Iterator[Iri]:
    """The classes that an expression is put together from by unions and intersections."""
    match expression:
        case Named(iri):
            yield iri
        case AnyOf(members) | AllOf(members):
            for member in members:
                yield from classes_in(member)


class ExpressionReader:
    """Reads expressions, each once, out of the statements that it was given."""

    def __init__(self, quads: Iterable[ox.Quad] = ()) -> None:
        """Learns the first statements."""
        self._told: dict[Iri, dict[str, list[object]]] = {}
        self._read: dict[Iri, Expression] = {}
        self._used: set[Iri] = set()
        self._defined: dict[Iri, None] = {}
        self.restricted: dict[Iri, None] = {}
        """The properties that restrictions are about."""
        self.fillers: dict[Iri, None] = {}
        """The classes and datatypes that their values are of."""
        self.learn(quads)

    def learn(self, quads: Iterable[ox.Quad]) -> bool:
        """Takes in statements by properties of `STRUCTURE`; False where one changes what was read before."""
        fresh = True
        for quad in quads:
            name = node_name(quad.subject)
            if name is None:
                continue
            property, value = quad.predicate.value, quad.object
            told = self._told.setdefault(name, {}).setdefault(property, [])
            if value not in told:
                fresh = fresh and name not in self._used
                told.append(value)
                if len(told) > 1:
                    told.sort(key=str)  # the store has no order to rely on
                if property == ON_PROPERTY and isinstance(value, ox.NamedNode):
                    self.restricted[Iri(value.value)] = None
                elif property in _TO_CLASSES and isinstance(value, ox.NamedNode):
                    self.fillers[Iri(value.value)] = None
                elif property in _DEFINING and not name.startswith("_:"):
                    self._defined[name] = None
        return fresh

    def definitions(self) -> Iterator[tuple[Iri, Expression]]:
        """Named classes that are themselves said to be a union, an intersection, a complement or an enumeration."""
        for name in self._defined:
            told = self._statements(name)
            for property in _DEFINING:
                for value in told.get(property, ()):
                    yield name, self._built({property: [value]}, frozenset({name}))

    def read(self, node: object, within: frozenset[Iri] = frozenset()) -> Expression:
        """The expression that a node stands for."""
        if isinstance(node, ox.Literal):
            datatype = None if node.language else Iri(node.datatype.value)
            return Value(Literal(node.value, datatype, node.language))
        name = node_name(node)
        if name is None or name in within:
            return Unread()
        if isinstance(node, ox.NamedNode):
            return Named(name)
        if within:  # in a circle, what is read depends on where one enters it
            return self._built(self._statements(name), within | {name})
        if name not in self._read:
            self._read[name] = self._built(self._statements(name), frozenset({name}))
        return self._read[name]

    def names(self) -> Iterator[Iri]:
        """Every name in what it was given, whether or not an expression with it was read yet."""
        for name, told in self._told.items():
            yield name
            yield from (Iri(node.value) for nodes in told.values() for node in nodes if isinstance(node, ox.NamedNode))

    def items(self, head: object) -> Sequence[object]:
        """What a list holds, as far as it goes."""
        items: list[object] = []
        seen: set[Iri] = set()
        while (name := node_name(head)) and name != _NIL and name not in seen:
            seen.add(name)
            told = self._statements(name)
            items.extend(told.get(_FIRST, ())[:1])
            head = next(iter(told.get(_REST, ())), None)
        return items

    def line(self, node: object) -> tuple[Iri, bool] | None:
        """The property that a node stands for, and whether it is meant forwards."""
        property, forward = node_name(node), True
        if property and property.startswith("_:"):
            property, forward = node_name(self._statements(property).get(_INVERSE, [None])[0]), False
        return None if property is None or property.startswith("_:") else (property, forward)

    def _statements(self, name: Iri) -> dict[str, list[object]]:
        self._used.add(name)
        return self._told.get(name, {})

    def _built(self, told: dict[str, list[object]], within: frozenset[Iri]) -> Expression:
        if ON_PROPERTY in told:
            return self._restriction(told, within)
        shapes: tuple[tuple[str, Callable[[tuple[Expression, ...]], Expression]], ...]
        shapes = ((_UNION, AnyOf), (_INTERSECTION, AllOf), (_ONE_OF, OneOf))
        for property, shape in shapes:
            if property in told:
                return shape(tuple(self.read(member, within) for member in self.items(told[property][0])))
        return Not(self.read(told[_COMPLEMENT][0], within)) if _COMPLEMENT in told else Unread()

    def _restriction(self, told: dict[str, list[object]], within: frozenset[Iri]) -> Expression:
        line = self.line(told[ON_PROPERTY][0])
        if line is None:
            return Unread()
        property, inverse = line[0], not line[1]
        for word, kind in _FILLERS.items():
            if word in told:
                return Restriction(property, kind, self.read(told[word][0], within), inverse=inverse)
        for word, kind in _COUNTS.items():
            number = told.get(word, [None])[0]
            if isinstance(number, ox.Literal) and number.value.isdecimal():
                fillers = [self.read(told[word][0], within) for word in _QUALIFIERS if word in told]
                return Restriction(property, kind, fillers[0] if fillers else None, int(number.value), inverse)
        return Restriction(property, Kind.SELF, inverse=inverse) if OWL + "hasSelf" in told else Unread()
