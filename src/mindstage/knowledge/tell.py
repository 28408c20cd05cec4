"""Teaching: what is told at run time, and taken back.

Told statements stand in a graph of their own. They are for questions: what the worlds of maps hold is read from the
maps' own files.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import pyoxigraph as ox

from mindstage.errors import InvalidArgumentError, NameNotFoundError
from mindstage.knowledge.names import EntityType, NameIndex, expand_prefix
from mindstage.knowledge.owl import ClassExpressionParser, LiteralValue, Restriction, RestrictionType
from mindstage.knowledge.owl_rl import INFERRED_GRAPH
from mindstage.knowledge.rdf import TripleStore, local_name
from mindstage.knowledge.reasoner import Reasoner
from mindstage.knowledge.vocabulary import (
    HAS_VALUE,
    NAMED_INDIVIDUAL,
    ON_PROPERTY,
    OWL,
    OWL_CLASS,
    RDFS,
    SUBCLASS_OF,
    TYPE,
)
from mindstage.scene import Iri

__all__ = ["RUNTIME_GRAPH", "AssertableValue", "AssertionStore", "parse_value"]

AssertableValue = str | bool | int | float
"""A name where the property leads to things, else a value."""

RUNTIME_GRAPH = ox.NamedNode("http://mindstage.org/told")
"""The graph of what was told at run time."""
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_SOME_VALUES_FROM = Iri(OWL + "someValuesFrom")
_CLASS_VALUED = (SUBCLASS_OF, TYPE, Iri(OWL + "equivalentClass"), Iri(OWL + "disjointWith"))
_ANNOTATIONS = (Iri(RDFS + "label"), Iri(RDFS + "comment"))


@dataclass(frozen=True, slots=True)
class AssertionStore:
    """One store, and what its names mean now."""

    store: TripleStore
    reasoner: Reasoner
    names: NameIndex

    def tell(self, subject: str, property: str, value: AssertableValue) -> list[ox.Quad]:
        """Adds a statement; gives all that was added for it, which is nothing where it was said already.

        Of a class it means all its members: `tell("Breadbasket", "typePrimaryFunction-containerFor", "Bread")`. A
        subject that nobody knows yet must be given with prefix or whole, and becomes a class by "subClassOf" and an
        individual by "type".

        Raises:
            NameNotFoundError: nothing has one of the names.
            AmbiguousNameError: several things have it.
            InvalidArgumentError: the three make no statement.
        """
        about, is_class, link, object = self._resolve(subject, property, value)
        told = []
        if is_class is None:
            told.append(_quad(about, TYPE, ox.NamedNode(OWL_CLASS if link == SUBCLASS_OF else NAMED_INDIVIDUAL)))
        if not is_class or self._applies_to_class_itself(link):
            told.append(_quad(about, link, object))
        elif not self._matching_restrictions(about, link, object):
            node = ox.BlankNode()
            filler = _SOME_VALUES_FROM if isinstance(object, ox.NamedNode) and self._is_class(object) else HAS_VALUE
            told += [
                _quad(node, TYPE, ox.NamedNode(OWL + "Restriction")),
                _quad(node, ON_PROPERTY, ox.NamedNode(link)),
                _quad(node, filler, object),
                _quad(about, SUBCLASS_OF, node),
            ]
        told = [quad for quad in told if not self._is_asserted(quad)]
        self.store.extend(told)
        return told

    def retract(self, subject: str, property: str, value: AssertableValue) -> list[ox.Quad]:
        """Takes a statement back, whoever said it; gives all that was removed for it, which may be nothing.

        What follows from other statements is not touched.

        Raises:
            NameNotFoundError: nothing has one of the names.
            AmbiguousNameError: several things have it.
            InvalidArgumentError: the three make no statement.
        """
        about, is_class, link, object = self._resolve(subject, property, value)
        if is_class and not self._applies_to_class_itself(link):
            quads = self._matching_restrictions(about, link, object)
        else:
            told = self.store.quads_for_pattern(ox.NamedNode(about), ox.NamedNode(link), None)
            quads = [quad for quad in told if _same_node(quad.object, object)]
        for quad in quads:
            self.store.remove(quad)
        return quads

    def _resolve(
        self, subject: str, property: str, value: AssertableValue
    ) -> tuple[Iri, bool | None, Iri, ox.NamedNode | ox.Literal]:
        """What it is about, whether that is a class (None: nobody knows it yet), the property, the value."""
        link = self.names.find(property, EntityType.PROPERTY)
        object = self._object(link, value)
        if known := self.names.find_any(subject):
            return known[0], known[1] is EntityType.CLASS, link, object
        whole = expand_prefix(subject)
        if ":" not in whole or link not in {SUBCLASS_OF, TYPE}:
            raise NameNotFoundError(
                subject, entity_type="class, individual or property", known=self.names.short_names()
            )
        return _valid_iri(whole), None, link, object

    def _object(self, property_iri: Iri, value: AssertableValue) -> ox.NamedNode | ox.Literal:
        if not isinstance(value, str) and (
            property_iri in _CLASS_VALUED or self._is_property_type(property_iri, "ObjectProperty")
        ):
            raise InvalidArgumentError(local_name(property_iri), cause=f"it leads to things, and {value!r} is none")
        if not isinstance(value, str):
            return ox.Literal(value)
        if property_iri in _CLASS_VALUED:
            return ox.NamedNode(self.names.find(value, EntityType.CLASS))
        if property_iri in _ANNOTATIONS or self._is_property_type(property_iri, "DatatypeProperty"):
            return ox.Literal(value)
        found = self.names.find_any(value)
        if found is None and self._is_property_type(property_iri, "AnnotationProperty"):
            return ox.Literal(value)
        if found is None:
            raise NameNotFoundError(value, entity_type="class or individual", known=self.names.short_names())
        return ox.NamedNode(found[0])

    def _matching_restrictions(self, cls: Iri, property_iri: Iri, object: ox.NamedNode | ox.Literal) -> list[ox.Quad]:
        """The statements that say just that of a class."""
        reader = self.reasoner.axioms.parser
        meant = reader.parse(object)
        told = []
        for quad in self.store.quads_for_pattern(ox.NamedNode(cls), ox.NamedNode(SUBCLASS_OF), None):
            match reader.parse(quad.object):
                case Restriction(
                    property=property,
                    restriction_type=RestrictionType.SOME | RestrictionType.HAS_VALUE,
                    filler=filler,
                    inverse=False,
                ):
                    same_value = (
                        isinstance(filler, LiteralValue)
                        and isinstance(meant, LiteralValue)
                        and _equal_literals(filler, meant)
                    )
                    if property == property_iri and (filler == meant or same_value):
                        told.append(quad)
        return told

    def _is_asserted(self, quad: ox.Quad) -> bool:
        told = self.store.quads_for_pattern(quad.subject, quad.predicate, quad.object)
        return any(each.graph_name != INFERRED_GRAPH for each in told)

    def _is_class(self, node: ox.NamedNode) -> bool:
        try:
            return bool(self.names.find(node.value, EntityType.CLASS))
        except NameNotFoundError:
            return False

    def _applies_to_class_itself(self, property_iri: Iri) -> bool:
        """Whether what is said of a class by a property is said of the class itself, not of its members."""
        return property_iri in {*_CLASS_VALUED, *_ANNOTATIONS} or self._is_property_type(
            property_iri, "AnnotationProperty"
        )

    def _is_property_type(self, property_iri: Iri, property_type: str) -> bool:
        types = self.store.quads_for_pattern(ox.NamedNode(property_iri), ox.NamedNode(TYPE), None)
        return any(quad.object == ox.NamedNode(OWL + property_type) for quad in types)


def parse_value(text: str) -> AssertableValue:
    """What people mean who type a value: a number, true or false, a name, or a text ('"5"' is one)."""
    if len(text) > 1 and text[0] == text[-1] == '"':
        return text[1:-1]
    if text in {"true", "false"}:
        return text == "true"
    if number := _NUMBER.fullmatch(text):
        return int(text) if number[1].isdecimal() and not number[2] else float(text)
    return text


def _quad(subject: Iri | ox.BlankNode, property_iri: Iri, object: ox.NamedNode | ox.BlankNode | ox.Literal) -> ox.Quad:
    return ox.Quad(
        ox.NamedNode(subject) if isinstance(subject, str) else subject,
        ox.NamedNode(property_iri),
        object,
        RUNTIME_GRAPH,
    )


def _same_node(asserted: object, expected: ox.NamedNode | ox.Literal) -> bool:
    """Whether two values are the same, in whatever type a number or a language a text was told."""
    reader = ClassExpressionParser()
    one, other = reader.parse(asserted), reader.parse(expected)
    return one == other or (
        isinstance(one, LiteralValue) and isinstance(other, LiteralValue) and _equal_literals(one, other)
    )


def _equal_literals(one: LiteralValue, other: LiteralValue) -> bool:
    a, b = one.literal.text, other.literal.text
    try:
        return a == b or float(a) == float(b)
    except ValueError:
        return False


def _valid_iri(name: Iri) -> Iri:
    try:
        return Iri(ox.NamedNode(name).value)
    except ValueError as error:
        raise InvalidArgumentError(f"<{name}>", cause=str(error)) from error
