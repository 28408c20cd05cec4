"""OWL class expressions as plain values, and a parser for them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from enum import StrEnum

import msgspec
import pyoxigraph as ox

from mindstage.rdf.graphs import QuadSource, node_to_look_up
from mindstage.rdf.vocabulary import HAS_VALUE, ON_PROPERTY, OWL, RDF
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

_QUALIFIERS = (OWL + "onClass", OWL + "onDataRange")
_DEFINING_PROPERTIES = (_UNION, _INTERSECTION, _COMPLEMENT, _ONE_OF)
_CLASS_VALUED = (OWL + "someValuesFrom", OWL + "allValuesFrom", *_QUALIFIERS)


class RestrictionType(StrEnum):
    """The kind of a property restriction."""

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
EXPRESSION_PROPERTIES = (
    *(_FIRST, _REST, *_DEFINING_PROPERTIES, _INVERSE, ON_PROPERTY, OWL + "hasSelf"),
    *(*_VALUE_RESTRICTIONS, *_CARDINALITIES, *_QUALIFIERS),
)
"""The properties that class expressions are made of."""
LIST_PROPERTIES = frozenset({_FIRST, _REST})
_EXPRESSION_PROPERTY_SET = frozenset(EXPRESSION_PROPERTIES)


class NamedClass(msgspec.Struct, frozen=True, tag=True):
    """A named class, datatype or individual."""

    iri: Iri


class LiteralValue(msgspec.Struct, frozen=True, tag=True):
    """A literal as a value."""

    literal: Literal


class UnionOf(msgspec.Struct, frozen=True, tag=True):
    """A union of classes."""

    members: tuple[Expression, ...]


class IntersectionOf(msgspec.Struct, frozen=True, tag=True):
    """An intersection of classes."""

    members: tuple[Expression, ...]


class OneOf(msgspec.Struct, frozen=True, tag=True):
    """An enumeration of individuals or literals."""

    members: tuple[Expression, ...]


class ComplementOf(msgspec.Struct, frozen=True, tag=True):
    """The complement of a class."""

    expression: Expression


class Restriction(msgspec.Struct, frozen=True, tag=True):
    """The class of all individuals whose values of a property satisfy a condition."""

    property: Iri
    restriction_type: RestrictionType
    filler: Expression | None = None
    """The class of the values, or the value; None for an unqualified cardinality."""
    cardinality: int | None = None
    inverse: bool = False
    """Whether the condition is on the inverse of the property."""

    def implies_existence(self) -> bool:
        """Whether every member has a value of the filler's class: not for conditions that only exclude other values."""
        if self.restriction_type is RestrictionType.SOME:
            return True
        return (
            self.restriction_type in {RestrictionType.MIN_CARDINALITY, RestrictionType.EXACT_CARDINALITY}
            and bool(self.cardinality)
            and self.filler is not None
        )


class UnparsedExpression(msgspec.Struct, frozen=True, tag=True):
    """An expression without a meaning: incomplete or cyclic."""


Expression = (
    NamedClass | LiteralValue | UnionOf | IntersectionOf | OneOf | ComplementOf | Restriction | UnparsedExpression
)


def node_label(node: object) -> Iri | None:
    """The IRI or blank node label (`_:label`) of a node; None for a literal."""
    if isinstance(node, ox.NamedNode):
        return Iri(node.value)
    return Iri("_:" + node.value) if isinstance(node, ox.BlankNode) else None


def named_classes(expression: Expression | None) -> Iterator[Iri]:
    """The named classes in an expression, inside unions and intersections."""
    match expression:
        case NamedClass(iri):
            yield iri
        case UnionOf(members) | IntersectionOf(members):
            for member in members:
                yield from named_classes(member)


class ClassExpressionParser:
    """Parses class expressions from the statements that it was given, and caches them."""

    def __init__(self, quads: Iterable[ox.Quad] = (), *, look_up: QuadSource | None = None) -> None:
        """Adds the first statements.

        Args:
            quads: statements.
            look_up: where the statements of other nodes are looked up when they are needed.
        """
        self._look_up = look_up
        self._statements_by_node: dict[Iri, dict[str, list[object]]] = {}
        self._parsed: dict[Iri, Expression] = {}
        self._visited: set[Iri] = set()
        self._defined_classes: dict[Iri, None] = {}
        self.restricted_properties: dict[Iri, None] = {}
        """The properties in restrictions."""
        self.fillers: dict[Iri, None] = {}
        """The classes and datatypes in restrictions."""
        self.add(quads)

    def add(self, quads: Iterable[ox.Quad]) -> bool:
        """Adds statements with `EXPRESSION_PROPERTIES`; returns False if they change expressions parsed before."""
        is_new = True
        for quad in quads:
            name = node_label(quad.subject)
            if name is None:
                continue
            property, value = quad.predicate.value, quad.object
            values = self._statements_by_node.setdefault(name, {}).setdefault(property, [])
            if value not in values:
                is_new = is_new and name not in self._visited
                values.append(value)
                if len(values) > 1:
                    values.sort(key=str)  # the store has no defined order
                if property == ON_PROPERTY and isinstance(value, ox.NamedNode):
                    self.restricted_properties[Iri(value.value)] = None
                elif property in _CLASS_VALUED and isinstance(value, ox.NamedNode):
                    self.fillers[Iri(value.value)] = None
                elif property in _DEFINING_PROPERTIES and not name.startswith("_:"):
                    self._defined_classes[name] = None
        return is_new

    def definitions(self) -> Iterator[tuple[Iri, Expression]]:
        """Named classes that are declared as a union, an intersection, a complement or an enumeration."""
        for name in self._defined_classes:
            statements = self._statements_of(name)
            for property in _DEFINING_PROPERTIES:
                for value in statements.get(property, ()):
                    yield name, self._build({property: [value]}, frozenset({name}))

    def parse(self, node: object, enclosing: frozenset[Iri] = frozenset()) -> Expression:
        """The class expression of a node."""
        if isinstance(node, ox.Literal):
            datatype = None if node.language else Iri(node.datatype.value)
            return LiteralValue(Literal(node.value, datatype, node.language))
        name = node_label(node)
        if name is None or name in enclosing:
            return UnparsedExpression()
        if isinstance(node, ox.NamedNode):
            return NamedClass(name)
        if enclosing:  # in a cycle, the result depends on where it is entered
            return self._build(self._statements_of(name), enclosing | {name})
        if name not in self._parsed:
            self._parsed[name] = self._build(self._statements_of(name), frozenset({name}))
        return self._parsed[name]

    def names(self) -> Iterator[Iri]:
        """All names in the statements, possibly repeated."""
        for name, statements in self._statements_by_node.items():
            yield name
            yield from (
                Iri(node.value) for nodes in statements.values() for node in nodes if isinstance(node, ox.NamedNode)
            )

    def list_items(self, head: object) -> Sequence[object]:
        """The items of an RDF list, up to the first error."""
        items: list[object] = []
        seen: set[Iri] = set()
        while (name := node_label(head)) and name != _NIL and name not in seen:
            seen.add(name)
            statements = self._statements_of(name)
            items.extend(statements.get(_FIRST, ())[:1])
            head = next(iter(statements.get(_REST, ())), None)
        return items

    def property_expression(self, node: object) -> tuple[Iri, bool] | None:
        """The property of a node and whether it is used forwards; False for an inverse. None if it is neither."""
        property, forward = node_label(node), True
        if property and property.startswith("_:"):
            property, forward = node_label(self._statements_of(property).get(_INVERSE, [None])[0]), False
        return None if property is None or property.startswith("_:") else (property, forward)

    def _statements_of(self, name: Iri) -> dict[str, list[object]]:
        if self._look_up is not None and name not in self._statements_by_node:
            quads = self._look_up.quads_for_pattern(node_to_look_up(name), None, None)
            self.add(quad for quad in quads if quad.predicate.value in _EXPRESSION_PROPERTY_SET)
        self._visited.add(name)
        return self._statements_by_node.get(name, {})

    def _build(self, statements: dict[str, list[object]], enclosing: frozenset[Iri]) -> Expression:
        if ON_PROPERTY in statements:
            return self._restriction(statements, enclosing)
        constructors: tuple[tuple[str, Callable[[tuple[Expression, ...]], Expression]], ...]
        constructors = ((_UNION, UnionOf), (_INTERSECTION, IntersectionOf), (_ONE_OF, OneOf))
        for property, constructor in constructors:
            if property in statements:
                return constructor(
                    tuple(self.parse(member, enclosing) for member in self.list_items(statements[property][0]))
                )
        return (
            ComplementOf(self.parse(statements[_COMPLEMENT][0], enclosing))
            if _COMPLEMENT in statements
            else UnparsedExpression()
        )

    def _restriction(self, statements: dict[str, list[object]], enclosing: frozenset[Iri]) -> Expression:
        expression = self.property_expression(statements[ON_PROPERTY][0])
        if expression is None:
            return UnparsedExpression()
        property, inverse = expression[0], not expression[1]
        for key, kind in _VALUE_RESTRICTIONS.items():
            if key in statements:
                return Restriction(property, kind, self.parse(statements[key][0], enclosing), inverse=inverse)
        for key, kind in _CARDINALITIES.items():
            number = statements.get(key, [None])[0]
            if isinstance(number, ox.Literal) and number.value.isdecimal():
                fillers = [self.parse(statements[name][0], enclosing) for name in _QUALIFIERS if name in statements]
                return Restriction(property, kind, fillers[0] if fillers else None, int(number.value), inverse)
        return (
            Restriction(property, RestrictionType.HAS_SELF, inverse=inverse)
            if OWL + "hasSelf" in statements
            else UnparsedExpression()
        )
