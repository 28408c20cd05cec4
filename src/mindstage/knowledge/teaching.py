"""Teaching: what is told at run time, and taken back.

Told statements stand in a graph of their own. They are for questions: what the worlds of maps hold is read from the
maps' own files.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import pyoxigraph as ox

from mindstage.errors import ArgumentRefused, NameUnknown
from mindstage.knowledge.names import local_name
from mindstage.knowledge.reasoning import Index, Kind, Namebook, NameKind, Restriction, Value
from mindstage.knowledge.reasoning.derivation import DERIVED
from mindstage.knowledge.reasoning.expressions import ExpressionReader
from mindstage.knowledge.reasoning.namebook import spelt_out
from mindstage.knowledge.stores.triplestore import TripleStore
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
from mindstage.world import Iri

__all__ = ["TOLD", "Teachable", "Teaching", "typed_value"]

Teachable = str | bool | int | float
"""A name where the property leads to things, else a value."""

TOLD = ox.NamedNode("http://mindstage.org/told")
"""The graph of what was told at run time."""
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_SOME = Iri(OWL + "someValuesFrom")
_TO_CLASSES = (SUBCLASS_OF, TYPE, Iri(OWL + "equivalentClass"), Iri(OWL + "disjointWith"))
_TEXTS = (Iri(RDFS + "label"), Iri(RDFS + "comment"))


@dataclass(frozen=True, slots=True)
class Teaching:
    """One store, and what its names mean now."""

    store: TripleStore
    index: Index
    names: Namebook

    def tell(self, subject: str, property: str, value: Teachable) -> list[ox.Quad]:
        """Adds a statement; gives all that was added for it, which is nothing where it was said already.

        Of a class it means all its members: `tell("Breadbasket", "typePrimaryFunction-containerFor", "Bread")`. A
        subject that nobody knows yet must be given with prefix or whole, and becomes a class by "subClassOf" and an
        individual by "type".

        Raises:
            NameUnknown: nothing has one of the names.
            NameAmbiguous: several things have it.
            ArgumentRefused: the three make no statement.
        """
        about, is_class, link, object = self._understood(subject, property, value)
        told = []
        if is_class is None:
            told.append(_quad(about, TYPE, ox.NamedNode(OWL_CLASS if link == SUBCLASS_OF else NAMED_INDIVIDUAL)))
        if not is_class or self._is_plain(link):
            told.append(_quad(about, link, object))
        elif not self._restrictions(about, link, object):
            node = ox.BlankNode()
            filler = _SOME if isinstance(object, ox.NamedNode) and self._is_class(object) else HAS_VALUE
            told += [
                _quad(node, TYPE, ox.NamedNode(OWL + "Restriction")),
                _quad(node, ON_PROPERTY, ox.NamedNode(link)),
                _quad(node, filler, object),
                _quad(about, SUBCLASS_OF, node),
            ]
        told = [quad for quad in told if not self._is_told(quad)]
        self.store.extend(told)
        return told

    def retract(self, subject: str, property: str, value: Teachable) -> list[ox.Quad]:
        """Takes a statement back, whoever said it; gives all that was removed for it, which may be nothing.

        What follows from other statements is not touched.

        Raises:
            NameUnknown: nothing has one of the names.
            NameAmbiguous: several things have it.
            ArgumentRefused: the three make no statement.
        """
        about, is_class, link, object = self._understood(subject, property, value)
        if is_class and not self._is_plain(link):
            quads = self._restrictions(about, link, object)
        else:
            told = self.store.quads_for_pattern(ox.NamedNode(about), ox.NamedNode(link), None)
            quads = [quad for quad in told if _same(quad.object, object)]
        for quad in quads:
            self.store.remove(quad)
        return quads

    def _understood(
        self, subject: str, property: str, value: Teachable
    ) -> tuple[Iri, bool | None, Iri, ox.NamedNode | ox.Literal]:
        """What it is about, whether that is a class (None: nobody knows it yet), the property, the value."""
        link = self.names.find(property, NameKind.PROPERTY)
        object = self._object(link, value)
        if known := self.names.kind_of(subject):
            return known[0], known[1] is NameKind.CLASS, link, object
        whole = spelt_out(subject)
        if ":" not in whole or link not in {SUBCLASS_OF, TYPE}:
            raise NameUnknown(subject, kind="class, individual or property", known=self.names.all())
        return _checked(whole), None, link, object

    def _object(self, link: Iri, value: Teachable) -> ox.NamedNode | ox.Literal:
        if not isinstance(value, str) and (link in _TO_CLASSES or self._is_a(link, "ObjectProperty")):
            raise ArgumentRefused(local_name(link), cause=f"it leads to things, and {value!r} is none")
        if not isinstance(value, str):
            return ox.Literal(value)
        if link in _TO_CLASSES:
            return ox.NamedNode(self.names.find(value, NameKind.CLASS))
        if link in _TEXTS or self._is_a(link, "DatatypeProperty"):
            return ox.Literal(value)
        found = self.names.kind_of(value)
        if found is None and self._is_a(link, "AnnotationProperty"):
            return ox.Literal(value)
        if found is None:
            raise NameUnknown(value, kind="class or individual", known=self.names.all())
        return ox.NamedNode(found[0])

    def _restrictions(self, cls: Iri, link: Iri, object: ox.NamedNode | ox.Literal) -> list[ox.Quad]:
        """The statements that say just that of a class."""
        reader = self.index.axioms.reader
        meant = reader.read(object)
        told = []
        for quad in self.store.quads_for_pattern(ox.NamedNode(cls), ox.NamedNode(SUBCLASS_OF), None):
            match reader.read(quad.object):
                case Restriction(property=property, kind=Kind.SOME | Kind.VALUE, filler=filler, inverse=False):
                    same_value = isinstance(filler, Value) and isinstance(meant, Value) and _equal(filler, meant)
                    if property == link and (filler == meant or same_value):
                        told.append(quad)
        return told

    def _is_told(self, quad: ox.Quad) -> bool:
        told = self.store.quads_for_pattern(quad.subject, quad.predicate, quad.object)
        return any(each.graph_name != DERIVED for each in told)

    def _is_class(self, node: ox.NamedNode) -> bool:
        try:
            return bool(self.names.find(node.value, NameKind.CLASS))
        except NameUnknown:
            return False

    def _is_plain(self, link: Iri) -> bool:
        """Whether what is said of a class by a property is said of the class itself, not of its members."""
        return link in {*_TO_CLASSES, *_TEXTS} or self._is_a(link, "AnnotationProperty")

    def _is_a(self, link: Iri, kind: str) -> bool:
        types = self.store.quads_for_pattern(ox.NamedNode(link), ox.NamedNode(TYPE), None)
        return any(quad.object == ox.NamedNode(OWL + kind) for quad in types)


def typed_value(text: str) -> Teachable:
    """What people mean who type a value: a number, true or false, a name, or a text ('"5"' is one)."""
    if len(text) > 1 and text[0] == text[-1] == '"':
        return text[1:-1]
    if text in {"true", "false"}:
        return text == "true"
    if number := _NUMBER.fullmatch(text):
        return int(text) if number[1].isdecimal() and not number[2] else float(text)
    return text


def _quad(subject: Iri | ox.BlankNode, link: Iri, object: ox.NamedNode | ox.BlankNode | ox.Literal) -> ox.Quad:
    return ox.Quad(ox.NamedNode(subject) if isinstance(subject, str) else subject, ox.NamedNode(link), object, TOLD)


def _same(told: object, meant: ox.NamedNode | ox.Literal) -> bool:
    """Whether two values are the same, in whatever type a number or a language a text was told."""
    reader = ExpressionReader()
    one, other = reader.read(told), reader.read(meant)
    return one == other or (isinstance(one, Value) and isinstance(other, Value) and _equal(one, other))


def _equal(one: Value, other: Value) -> bool:
    a, b = one.literal.text, other.literal.text
    try:
        return a == b or float(a) == float(b)
    except ValueError:
        return False


def _checked(name: Iri) -> Iri:
    try:
        return Iri(ox.NamedNode(name).value)
    except ValueError as error:
        raise ArgumentRefused(f"<{name}>", cause=str(error)) from error
