"""Expressions: what ontologies say of a class without a name, from unions to restrictions, as plain values."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from enum import Enum

import msgspec
import pyoxigraph as ox

from mindstage.knowledge.vocabulary import HAS_VALUE, ON_PROPERTY, OWL, RDF
from mindstage.world import Iri, Literal

__all__ = [
    "AllOf",
    "AnyOf",
    "Expression",
    "ExpressionReader",
    "Kind",
    "Named",
    "Restriction",
    "Unread",
    "Value",
    "node_name",
]

_FIRST, _REST, _NIL = RDF + "first", RDF + "rest", RDF + "nil"
_UNION, _INTERSECTION, _INVERSE = OWL + "unionOf", OWL + "intersectionOf", OWL + "inverseOf"


class Kind(Enum):
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
_STRUCTURE = (
    *(_FIRST, _REST, _UNION, _INTERSECTION, _INVERSE, ON_PROPERTY, OWL + "hasSelf"),
    *(*_FILLERS, *_COUNTS, *_QUALIFIERS),
)


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
    """An expression of a kind that no question needs: a complement, an enumeration, a list in a circle."""


Expression = Named | Value | AnyOf | AllOf | Restriction | Unread


def node_name(node: object) -> Iri | None:
    """The name or label of a node; None for a literal."""
    if isinstance(node, ox.NamedNode):
        return Iri(node.value)
    return Iri("_:" + node.value) if isinstance(node, ox.BlankNode) else None


class ExpressionReader:
    """Reads expressions from a store, each once."""

    def __init__(self, store: ox.Store) -> None:
        """Gathers what expressions are built of; the cost grows with these statements alone."""
        self._told: dict[Iri, dict[str, object]] = {}
        self._read: dict[Iri, Expression] = {}
        for property in _STRUCTURE:
            for quad in store.quads_for_pattern(None, ox.NamedNode(property), None):
                if name := node_name(quad.subject):
                    self._told.setdefault(name, {})[property] = quad.object

    def definitions(self) -> Iterator[tuple[Iri, Expression]]:
        """Named classes that are themselves said to be a union or an intersection."""
        for name, told in self._told.items():
            if not name.startswith("_:") and (_UNION in told or _INTERSECTION in told):
                yield name, self._built(told, frozenset({name}))

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
        if name not in self._read:
            self._read[name] = self._built(self._told.get(name, {}), within | {name})
        return self._read[name]

    def _built(self, told: dict[str, object], within: frozenset[Iri]) -> Expression:
        if ON_PROPERTY in told:
            return self._restriction(told, within)
        shapes: tuple[tuple[str, Callable[[tuple[Expression, ...]], Expression]], ...]
        shapes = ((_UNION, AnyOf), (_INTERSECTION, AllOf))
        for property, shape in shapes:
            if property in told:
                return shape(tuple(self.read(member, within) for member in self._items(told[property])))
        return Unread()

    def _restriction(self, told: dict[str, object], within: frozenset[Iri]) -> Expression:
        property, inverse = node_name(told[ON_PROPERTY]), False
        if property and property.startswith("_:"):
            property, inverse = node_name(self._told.get(property, {}).get(_INVERSE)), True
        if property is None:
            return Unread()
        for word, kind in _FILLERS.items():
            if word in told:
                return Restriction(property, kind, self.read(told[word], within), inverse=inverse)
        for word, kind in _COUNTS.items():
            number = told.get(word)
            if isinstance(number, ox.Literal) and number.value.isdecimal():
                fillers = [self.read(told[word], within) for word in _QUALIFIERS if word in told]
                return Restriction(property, kind, fillers[0] if fillers else None, int(number.value), inverse)
        return Restriction(property, Kind.SELF, inverse=inverse) if OWL + "hasSelf" in told else Unread()

    def _items(self, head: object) -> Sequence[object]:
        items, seen = [], set()
        while (name := node_name(head)) and name != _NIL and name not in seen:
            seen.add(name)
            told = self._told.get(name, {})
            if _FIRST in told:
                items.append(told[_FIRST])
            head = told.get(_REST)
        return items
