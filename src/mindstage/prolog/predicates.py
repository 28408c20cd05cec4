"""Statements: the triples under the questions, as users of SWI-Prolog's semweb library and of KnowRob know them."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import msgspec

from mindstage.errors import InvalidArgumentError
from mindstage.knowledge import KnowledgeBase, RdfTerm
from mindstage.knowledge.reasoning import (
    EntityType,
    Expression,
    IntersectionOf,
    NamedClass,
    Restriction,
    RestrictionType,
    UnionOf,
)
from mindstage.knowledge.reasoning import LiteralValue as Constant
from mindstage.knowledge.triples import Triple, TripleStoreView
from mindstage.knowledge.vocabulary import OWL, RDF, RDFS, TYPE, XSD
from mindstage.prolog.asking import literal_term
from mindstage.prolog.requests import Handler
from mindstage.prolog.terms import FREE, Atom, Compound, Unbound, Value
from mindstage.world import Iri

__all__ = ["RdfPredicates"]

_VOCABULARY_NAMESPACES = (OWL, RDFS, RDF)
"""The namespaces of what ontologies are made of, which no individual of the index is of."""


class RdfPredicates:
    """What a knowledge base is asked and told, triple by triple."""

    def __init__(self, knowledge: KnowledgeBase) -> None:
        self._knowledge = knowledge
        handlers: dict[str, Handler] = {
            "rdf": self.asserted,
            "rdf_has": self.inferred,
            "rdf_assert": self.assert_triple,
            "rdf_retractall": self.retract_triples,
            "rdfs_individual_of": self.individuals,
            "rdfs_subclass_of": self.subclasses,
            "owl_class_properties": self.class_properties,
            "owl_parse": self.load_source,
        }
        self.handlers = {name: self._locked(handler) for name, handler in handlers.items()}

    def _locked(self, handler: Handler) -> Handler:
        """Nothing changes while somebody looks."""

        def handle(*arguments: Value) -> Value:
            with self._knowledge.lock:
                return handler(*arguments)

        return handle

    # -- triples -------------------------------------------------------------------------------------------------------

    def asserted(self, subject: Value, property: Value, value: Value) -> Value:
        """Triples as they were told."""
        return self._rows(TripleStoreView(self._knowledge).find, subject, property, value)

    def inferred(self, subject: Value, property: Value, value: Value) -> Value:
        """Triples of a property, and of those that imply it or its inverse."""
        return self._rows(TripleStoreView(self._knowledge).find_entailed, subject, property, value)

    def assert_triple(self, subject: Value, property: Value, value: Value) -> Value:
        """Tells one."""
        about, link = _text(subject, "subject"), _text(property, "property")
        TripleStoreView(self._knowledge).add(about, link, _to_rdf_term(value))
        return True

    def retract_triples(self, subject: Value, property: Value, value: Value) -> Value:
        """Takes back all that fit, and says how many."""
        triples, wanted = TripleStoreView(self._knowledge), _value_pattern(value)
        about, link = _resource_name(subject, "subject"), _resource_name(property, "property")
        if value is FREE or wanted.exact_term:
            return triples.remove(about, link, wanted.exact_term)
        found = [each for each in triples.find(about, link) if wanted.matches(each.value)]
        return sum(triples.remove(each.subject, each.property, each.value) for each in found)

    def load_source(self, source: Value) -> Value:
        """Loads a file, a folder of packages or `package://…`, and all that it imports."""
        self._knowledge.load((), ontologies=_text(source, "source"))
        return True

    def _rows(
        self,
        search: Callable[[str | None, str | None, RdfTerm | None], Iterator[Triple]],
        subject: Value,
        property: Value,
        value: Value,
    ) -> list[Value]:
        about, link, wanted = (
            _resource_name(subject, "subject"),
            _resource_name(property, "property"),
            _value_pattern(value),
        )
        return [
            [
                Atom(each.subject) if about is None else FREE,
                Atom(each.property) if link is None else FREE,
                FREE if wanted.is_exact else _value_term(each.value),
            ]
            for each in search(about, link, wanted.exact_term)
            if wanted.matches(each.value)
        ]

    # -- what follows --------------------------------------------------------------------------------------------------

    def individuals(self, individual: Value, cls: Value) -> Value:
        """Individuals and their classes, told or above those; of maps and of none."""
        index = self._knowledge.reasoner
        one, kind = self._name(individual, EntityType.INDIVIDUAL), self._name(cls, EntityType.CLASS)
        if kind and kind.startswith(_VOCABULARY_NAMESPACES):
            return [
                [FREE if one else Atom(each.subject), FREE]
                for each in TripleStoreView(self._knowledge).find(one, TYPE, RdfTerm("iri", kind))
            ]
        if one and kind:
            return [[FREE, FREE]] if index.is_member(one, kind) else []
        if kind:
            return [[Atom(each), FREE] for each in index.members(kind)]
        return [
            [FREE if one else Atom(each), Atom(above)]
            for each in ([one] if one else sorted(index.types))
            for above in dict.fromkeys(up for told in index.types.get(each, ()) for up in index.classes.above(told))
        ]

    def subclasses(self, cls: Value, superclass: Value) -> Value:
        """Classes and what is above them, themselves first."""
        classes = self._knowledge.reasoner.classes
        lower, upper = self._name(cls, EntityType.CLASS), self._name(superclass, EntityType.CLASS)
        if lower and upper:
            return [[FREE, FREE]] if upper in classes.above(lower) else []
        if upper:
            return [[Atom(each), FREE] for each in classes.below(upper)]
        every = [lower] if lower else sorted(set(self._knowledge.reasoner.declared_classes()))
        return [[FREE if lower else Atom(each), Atom(above)] for each in every for above in classes.above(each)]

    def class_properties(self, cls: Value, property: Value) -> Value:
        """What every member of a class has by a property, inherited or not; the nearest first."""
        index = self._knowledge.reasoner
        one, link = self._name(cls, EntityType.CLASS), self._name(property, EntityType.PROPERTY)
        below = {lower for owner in index.restricted_classes() for lower in index.classes.below(owner)}
        rows: dict[tuple[Iri, Iri, Expression], None] = {}
        for each in [one] if one else sorted(below):
            for owned in index.restrictions(each):
                told = owned.restriction
                promised = told.restriction_type is RestrictionType.HAS_VALUE or told.implies_existence()
                if promised and told.filler and (not link or link in index.properties.super_properties(told.property)):
                    rows[each, told.property, told.filler] = None
        return [
            [FREE if one else Atom(owner), FREE if link else Atom(has), _expression_term(filler)]
            for owner, has, filler in rows
        ]

    def _name(self, value: Value, kind: EntityType) -> Iri | None:
        """A name written out; a whole one is taken as it is, since nobody has to know it to ask about it."""
        if value is FREE:
            return None
        name = _text(value, kind.value)
        return Iri(name) if ":" in name else self._knowledge.names.find(name, kind)


_VALUE_HINT = "give an atom, or literal(Text), literal(type(Type, Text)), literal(lang(Language, Text))"


def _resource_name(value: Value, role: str) -> str | None:
    return None if value is FREE else _text(value, role)


def _text(value: Value, role: str) -> str:
    if isinstance(value, str):
        return str(value)
    raise InvalidArgumentError(f"the {role}", cause=f"{value!r} is no name")


class _ValuePattern(msgspec.Struct, frozen=True):
    """What the value of a statement shall be; what stays open in it, Prolog compares."""

    exact_term: RdfTerm | None = None
    """The one resource or literal that is meant."""
    is_literal: bool = False
    text: str | None = None
    """The text of a literal, whatever its type."""

    @property
    def is_exact(self) -> bool:
        return bool(self.exact_term or self.text is not None)

    def matches(self, term: RdfTerm) -> bool:
        if self.exact_term or not self.is_literal:
            return True
        return term.kind == "literal" and self.text in {None, term.value}


def _value_pattern(value: Value) -> _ValuePattern:
    """What is asked for.

    Raises:
        InvalidArgumentError: it is neither a resource nor a literal.
    """
    match value:
        case Unbound():
            return _ValuePattern()
        case Atom():
            return _ValuePattern(RdfTerm("blank", value[2:]) if value.startswith("_:") else RdfTerm("iri", str(value)))
        case Compound("literal", (Compound("type", (Atom() as type, (str() | int() | float()) as text)),)):
            return _ValuePattern(RdfTerm("literal", str(text), str(type)))
        case Compound("literal", (Compound("lang", (Atom() as language, str() as text)),)):
            return _ValuePattern(RdfTerm("literal", str(text), RDF + "langString", str(language)))
        case Compound("literal", ((str() | int() | float()) as text,)):
            return _ValuePattern(is_literal=True, text=str(text))
        case Compound("literal", (_,)):
            return _ValuePattern(is_literal=True)
        case _:
            raise InvalidArgumentError(
                "the value", cause=f"{value!r} is no resource and no literal", remedy=_VALUE_HINT
            )


def _to_rdf_term(value: Value) -> RdfTerm:
    """What is to be told; a literal without a type has that of what stands in it.

    Raises:
        InvalidArgumentError: it is neither a resource nor a literal, or not a whole one.
    """
    match value:
        case Compound("literal", (int() as number,)):
            return RdfTerm("literal", str(number), XSD + "integer")
        case Compound("literal", (float() as number,)):
            return RdfTerm("literal", repr(number), XSD + "double")
    wanted = _value_pattern(value)
    if wanted.exact_term:
        return wanted.exact_term
    if wanted.text is None:
        raise InvalidArgumentError("the value", cause="it is not told as a whole", remedy=_VALUE_HINT)
    return RdfTerm("literal", wanted.text, XSD + "string")


def _value_term(term: RdfTerm) -> Value:
    match term.kind:
        case "literal":
            return literal_term(term.value, term.datatype, term.language)
        case "blank":
            return Atom(f"_:{term.value}")
        case _:
            return Atom(term.value)


def _expression_term(expression: Expression) -> Value:
    match expression:
        case NamedClass(iri):
            return Atom(iri)
        case Constant(literal):
            return literal_term(literal.text, literal.datatype, literal.language)
        case UnionOf(members):
            return Compound("union_of", ([_expression_term(each) for each in members],))
        case IntersectionOf(members):
            return Compound("intersection_of", ([_expression_term(each) for each in members],))
        case Restriction(property, kind, filler):
            inner = (Atom(property), Atom(kind.value), None if filler is None else _expression_term(filler))
            return Compound("restriction", inner)
        case _:
            return None
