"""Assertions and retractions of statements at run time.

Assertions are kept in a named graph of their own. Questions use them; the worlds of maps are read from the maps' files
only.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import pyoxigraph as ox

from mindstage.errors import InvalidArgumentError, NameNotFoundError
from mindstage.knowledge.names import EntityType, NameIndex, expand_prefix
from mindstage.knowledge.owl import ClassExpressionParser, LiteralValue, Restriction, RestrictionType
from mindstage.knowledge.owl_rl import INFERRED_GRAPH
from mindstage.knowledge.reasoner import Reasoner
from mindstage.rdf.graphs import TripleStore, local_name
from mindstage.rdf.vocabulary import (
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
"""A name if the property relates resources, else a plain value."""

RUNTIME_GRAPH = ox.NamedNode("http://mindstage.org/told")
"""The graph of the statements that were asserted at run time."""
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_SOME_VALUES_FROM = Iri(OWL + "someValuesFrom")
_CLASS_VALUED = (SUBCLASS_OF, TYPE, Iri(OWL + "equivalentClass"), Iri(OWL + "disjointWith"))
_ANNOTATIONS = (Iri(RDFS + "label"), Iri(RDFS + "comment"))


@dataclass(frozen=True, slots=True)
class AssertionStore:
    """Writes assertions to a triple store, after resolving their names."""

    store: TripleStore
    reasoner: Reasoner
    names: NameIndex

    def tell(self, subject: str, property: str, value: AssertableValue) -> list[ox.Quad]:
        """Asserts a statement, and returns all triples that were added for it; none if it was asserted before.

        A statement about a class holds for all its members: `tell("Breadbasket", "typePrimaryFunction-containerFor",
        "Bread")`. An unknown subject must be given with a prefix or as a whole IRI, and becomes a class by "subClassOf"
        or an individual by "type".

        Raises:
            NameNotFoundError: a name is unknown.
            AmbiguousNameError: several entities have a name.
            InvalidArgumentError: the three do not form a statement.
        """
        entity, is_class, link, object = self._resolve(subject, property, value)
        added = []
        if is_class is None:
            added.append(_quad(entity, TYPE, ox.NamedNode(OWL_CLASS if link == SUBCLASS_OF else NAMED_INDIVIDUAL)))
        if not is_class or self._applies_to_class_itself(link):
            added.append(_quad(entity, link, object))
        elif not self._matching_restrictions(entity, link, object):
            node = ox.BlankNode()
            filler = _SOME_VALUES_FROM if isinstance(object, ox.NamedNode) and self._is_class(object) else HAS_VALUE
            added += [
                _quad(node, TYPE, ox.NamedNode(OWL + "Restriction")),
                _quad(node, ON_PROPERTY, ox.NamedNode(link)),
                _quad(node, filler, object),
                _quad(entity, SUBCLASS_OF, node),
            ]
        added = [quad for quad in added if not self._is_asserted(quad)]
        self.store.extend(added)
        return added

    def retract(self, subject: str, property: str, value: AssertableValue) -> list[ox.Quad]:
        """Removes a statement from all graphs, and returns the triples that were removed for it, which may be none.

        Statements that it was inferred from are not removed.

        Raises:
            NameNotFoundError: a name is unknown.
            AmbiguousNameError: several entities have a name.
            InvalidArgumentError: the three do not form a statement.
        """
        entity, is_class, link, object = self._resolve(subject, property, value)
        if is_class and not self._applies_to_class_itself(link):
            quads = self._matching_restrictions(entity, link, object)
        else:
            asserted = self.store.quads_for_pattern(ox.NamedNode(entity), ox.NamedNode(link), None)
            quads = [quad for quad in asserted if _same_node(quad.object, object)]
        for quad in quads:
            self.store.remove(quad)
        return quads

    def _resolve(
        self, subject: str, property: str, value: AssertableValue
    ) -> tuple[Iri, bool | None, Iri, ox.NamedNode | ox.Literal]:
        """The subject, whether it is a class (None for an unknown subject), the property and the value."""
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
            raise InvalidArgumentError(local_name(property_iri), cause=f"it leads to resources, and {value!r} is none")
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
        """The subclass statements that give a class exactly this restriction."""
        parser = self.reasoner.axioms.parser
        expected = parser.parse(object)
        matching = []
        for quad in self.store.quads_for_pattern(ox.NamedNode(cls), ox.NamedNode(SUBCLASS_OF), None):
            match parser.parse(quad.object):
                case Restriction(
                    property=property,
                    restriction_type=RestrictionType.SOME | RestrictionType.HAS_VALUE,
                    filler=filler,
                    inverse=False,
                ):
                    same_value = (
                        isinstance(filler, LiteralValue)
                        and isinstance(expected, LiteralValue)
                        and _equal_literals(filler, expected)
                    )
                    if property == property_iri and (filler == expected or same_value):
                        matching.append(quad)
        return matching

    def _is_asserted(self, quad: ox.Quad) -> bool:
        quads = self.store.quads_for_pattern(quad.subject, quad.predicate, quad.object)
        return any(each.graph_name != INFERRED_GRAPH for each in quads)

    def _is_class(self, node: ox.NamedNode) -> bool:
        try:
            return bool(self.names.find(node.value, EntityType.CLASS))
        except NameNotFoundError:
            return False

    def _applies_to_class_itself(self, property_iri: Iri) -> bool:
        """Whether a property of a class describes the class itself, not its members."""
        return property_iri in {*_CLASS_VALUED, *_ANNOTATIONS} or self._is_property_type(
            property_iri, "AnnotationProperty"
        )

    def _is_property_type(self, property_iri: Iri, property_type: str) -> bool:
        types = self.store.quads_for_pattern(ox.NamedNode(property_iri), ox.NamedNode(TYPE), None)
        return any(quad.object == ox.NamedNode(OWL + property_type) for quad in types)


def parse_value(text: str) -> AssertableValue:
    """Parses a typed value: a number, true or false, a name, or a quoted string ('"5"' is a string)."""
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
    """Whether two values are equal, regardless of the datatype of a number and the language of a string."""
    parser = ClassExpressionParser()
    one, other = parser.parse(asserted), parser.parse(expected)
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
