"""Expressions: what ontologies say of a class without a name, from unions to restrictions, as plain values."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from enum import StrEnum

import msgspec
import pyoxigraph as ox

from mindstage.knowledge.vocabulary import HAS_VALUE, ON_PROPERTY, OWL, RDF
from mindstage.scene import Iri, Literal

__all__ = [
    "EXPRESSION_PROPERTIES",
    "ClassExpressionParser",
    "ComplementOf",
    "Expression",
    "IntersectionOf",
    "LiteralValue",
    "NamedClass",
    "OneOf",
    "Restriction",
    "RestrictionType",
    "UnionOf",
    "UnparsedExpression",
    "named_classes",
    "node_label",
]

_FIRST, _REST, _NIL = RDF + "first", RDF + "rest", RDF + "nil"
_UNION, _INTERSECTION, _INVERSE = OWL + "unionOf", OWL + "intersectionOf", OWL + "inverseOf"
_COMPLEMENT, _ONE_OF = OWL + "complementOf", OWL + "oneOf"


class RestrictionType(StrEnum):
    """How a restriction binds a property."""

    SOME = "someValuesFrom"
    ALL = "allValuesFrom"
    HAS_VALUE = "hasValue"
    HAS_SELF = "hasSelf"
    MIN_CARDINALITY = "minCardinality"
    MAX_CARDINALITY = "maxCardinality"
    EXACT_CARDINALITY = "cardinality"


_CARDINALITIES = {
    OWL + "minCardinality": RestrictionType.MIN_CARDINALITY,
    OWL + "maxCardinality": RestrictionType.MAX_CARDINALITY,
    OWL + "cardinality": RestrictionType.EXACT_CARDINALITY,
    OWL + "minQualifiedCardinality": RestrictionType.MIN_CARDINALITY,
    OWL + "maxQualifiedCardinality": RestrictionType.MAX_CARDINALITY,
    OWL + "qualifiedCardinality": RestrictionType.EXACT_CARDINALITY,
}
_VALUE_RESTRICTIONS = {
    OWL + "someValuesFrom": RestrictionType.SOME,
    OWL + "allValuesFrom": RestrictionType.ALL,
    HAS_VALUE: RestrictionType.HAS_VALUE,
}
_QUALIFIERS = (OWL + "onClass", OWL + "onDataRange")
_DEFINING_PROPERTIES = (_UNION, _INTERSECTION, _COMPLEMENT, _ONE_OF)
_CLASS_VALUED = (OWL + "someValuesFrom", OWL + "allValuesFrom", *_QUALIFIERS)
EXPRESSION_PROPERTIES = (
    *(_FIRST, _REST, *_DEFINING_PROPERTIES, _INVERSE, ON_PROPERTY, OWL + "hasSelf"),
    *(*_VALUE_RESTRICTIONS, *_CARDINALITIES, *_QUALIFIERS),
)
"""The properties that expressions are built with."""


class NamedClass(msgspec.Struct, frozen=True):
    """A class, datatype or individual that has a name."""

    iri: Iri


class LiteralValue(msgspec.Struct, frozen=True):
    """A literal."""

    literal: Literal


class UnionOf(msgspec.Struct, frozen=True):
    """A union."""

    members: tuple[Expression, ...]


class IntersectionOf(msgspec.Struct, frozen=True):
    """An intersection."""

    members: tuple[Expression, ...]


class OneOf(msgspec.Struct, frozen=True):
    """An enumeration of individuals or values."""

    members: tuple[Expression, ...]


class ComplementOf(msgspec.Struct, frozen=True):
    """A complement."""

    expression: Expression


class Restriction(msgspec.Struct, frozen=True):
    """All things whose property has such values."""

    property: Iri
    restriction_type: RestrictionType
    filler: Expression | None = None
    """What the values are; None where only their number matters."""
    cardinality: int | None = None
    inverse: bool = False
    """Whether the property is meant backwards."""

    def implies_existence(self) -> bool:
        """Whether there surely is a value of such a class, and not only none of another."""
        if self.restriction_type is RestrictionType.SOME:
            return True
        return (
            self.restriction_type in {RestrictionType.MIN_CARDINALITY, RestrictionType.EXACT_CARDINALITY}
            and bool(self.cardinality)
            and self.filler is not None
        )


class UnparsedExpression(msgspec.Struct, frozen=True):
    """An expression that has no meaning: broken, or in a circle."""


Expression = (
    NamedClass | LiteralValue | UnionOf | IntersectionOf | OneOf | ComplementOf | Restriction | UnparsedExpression
)


def node_label(node: object) -> Iri | None:
    """The name or label of a node; None for a literal."""
    if isinstance(node, ox.NamedNode):
        return Iri(node.value)
    return Iri("_:" + node.value) if isinstance(node, ox.BlankNode) else None


def named_classes(expression: Expression | None) -> Iterator[Iri]:
    """The classes that an expression is put together from by unions and intersections."""
    match expression:
        case NamedClass(iri):
            yield iri
        case UnionOf(members) | IntersectionOf(members):
            for member in members:
                yield from named_classes(member)


class ClassExpressionParser:
    """Reads expressions, each once, out of the statements that it was given."""

    def __init__(self, quads: Iterable[ox.Quad] = ()) -> None:
        """Learns the first statements."""
        self._statements_by_node: dict[Iri, dict[str, list[object]]] = {}
        self._parsed: dict[Iri, Expression] = {}
        self._visited: set[Iri] = set()
        self._defined_classes: dict[Iri, None] = {}
        self.restricted_properties: dict[Iri, None] = {}
        """The properties that restrictions are about."""
        self.fillers: dict[Iri, None] = {}
        """The classes and datatypes that their values are of."""
        self.add(quads)

    def add(self, quads: Iterable[ox.Quad]) -> bool:
        """Takes in statements by properties of `EXPRESSION_PROPERTIES`; False where one changes what was read before."""
        fresh = True
        for quad in quads:
            name = node_label(quad.subject)
            if name is None:
                continue
            property, value = quad.predicate.value, quad.object
            told = self._statements_by_node.setdefault(name, {}).setdefault(property, [])
            if value not in told:
                fresh = fresh and name not in self._visited
                told.append(value)
                if len(told) > 1:
                    told.sort(key=str)  # the store has no order to rely on
                if property == ON_PROPERTY and isinstance(value, ox.NamedNode):
                    self.restricted_properties[Iri(value.value)] = None
                elif property in _CLASS_VALUED and isinstance(value, ox.NamedNode):
                    self.fillers[Iri(value.value)] = None
                elif property in _DEFINING_PROPERTIES and not name.startswith("_:"):
                    self._defined_classes[name] = None
        return fresh

    def definitions(self) -> Iterator[tuple[Iri, Expression]]:
        """Named classes that are themselves said to be a union, an intersection, a complement or an enumeration."""
        for name in self._defined_classes:
            told = self._statements_of(name)
            for property in _DEFINING_PROPERTIES:
                for value in told.get(property, ()):
                    yield name, self._build({property: [value]}, frozenset({name}))

    def parse(self, node: object, enclosing: frozenset[Iri] = frozenset()) -> Expression:
        """The expression that a node stands for."""
        if isinstance(node, ox.Literal):
            datatype = None if node.language else Iri(node.datatype.value)
            return LiteralValue(Literal(node.value, datatype, node.language))
        name = node_label(node)
        if name is None or name in enclosing:
            return UnparsedExpression()
        if isinstance(node, ox.NamedNode):
            return NamedClass(name)
        if enclosing:  # in a circle, what is read depends on where one enters it
            return self._build(self._statements_of(name), enclosing | {name})
        if name not in self._parsed:
            self._parsed[name] = self._build(self._statements_of(name), frozenset({name}))
        return self._parsed[name]

    def names(self) -> Iterator[Iri]:
        """Every name in what it was given, whether or not an expression with it was read yet."""
        for name, told in self._statements_by_node.items():
            yield name
            yield from (Iri(node.value) for nodes in told.values() for node in nodes if isinstance(node, ox.NamedNode))

    def list_items(self, head: object) -> Sequence[object]:
        """What a list holds, as far as it goes."""
        items: list[object] = []
        seen: set[Iri] = set()
        while (name := node_label(head)) and name != _NIL and name not in seen:
            seen.add(name)
            told = self._statements_of(name)
            items.extend(told.get(_FIRST, ())[:1])
            head = next(iter(told.get(_REST, ())), None)
        return items

    def property_expression(self, node: object) -> tuple[Iri, bool] | None:
        """The property that a node stands for, and whether it is meant forwards."""
        property, forward = node_label(node), True
        if property and property.startswith("_:"):
            property, forward = node_label(self._statements_of(property).get(_INVERSE, [None])[0]), False
        return None if property is None or property.startswith("_:") else (property, forward)

    def _statements_of(self, name: Iri) -> dict[str, list[object]]:
        self._visited.add(name)
        return self._statements_by_node.get(name, {})

    def _build(self, statements: dict[str, list[object]], enclosing: frozenset[Iri]) -> Expression:
        if ON_PROPERTY in statements:
            return self._restriction(statements, enclosing)
        shapes: tuple[tuple[str, Callable[[tuple[Expression, ...]], Expression]], ...]
        shapes = ((_UNION, UnionOf), (_INTERSECTION, IntersectionOf), (_ONE_OF, OneOf))
        for property, shape in shapes:
            if property in statements:
                return shape(
                    tuple(self.parse(member, enclosing) for member in self.list_items(statements[property][0]))
                )
        return (
            ComplementOf(self.parse(statements[_COMPLEMENT][0], enclosing))
            if _COMPLEMENT in statements
            else UnparsedExpression()
        )

    def _restriction(self, statements: dict[str, list[object]], enclosing: frozenset[Iri]) -> Expression:
        line = self.property_expression(statements[ON_PROPERTY][0])
        if line is None:
            return UnparsedExpression()
        property, inverse = line[0], not line[1]
        for word, kind in _VALUE_RESTRICTIONS.items():
            if word in statements:
                return Restriction(property, kind, self.parse(statements[word][0], enclosing), inverse=inverse)
        for word, kind in _CARDINALITIES.items():
            number = statements.get(word, [None])[0]
            if isinstance(number, ox.Literal) and number.value.isdecimal():
                fillers = [self.parse(statements[word][0], enclosing) for word in _QUALIFIERS if word in statements]
                return Restriction(property, kind, fillers[0] if fillers else None, int(number.value), inverse)
        return (
            Restriction(property, RestrictionType.HAS_SELF, inverse=inverse)
            if OWL + "hasSelf" in statements
            else UnparsedExpression()
        )
