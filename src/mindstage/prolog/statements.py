"""Statements: the triples under the questions, as users of SWI-Prolog's semweb library and of KnowRob know them."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import msgspec

from mindstage.errors import ArgumentRefused
from mindstage.knowledge import KnowledgeBase, Term
from mindstage.knowledge.reasoning import AllOf, AnyOf, Expression, Kind, Named, NameKind, Restriction
from mindstage.knowledge.reasoning import Value as Constant
from mindstage.knowledge.triples import Triple, Triples
from mindstage.knowledge.vocabulary import OWL, RDF, RDFS, TYPE, XSD
from mindstage.prolog.asking import literal_term
from mindstage.prolog.requests import Handler
from mindstage.prolog.terms import FREE, Atom, Compound, Free, Value
from mindstage.world import Iri

__all__ = ["Statements"]

_WORDS = (OWL, RDFS, RDF)
"""The namespaces of what ontologies are made of, which no individual of the index is of."""


class Statements:
    """What a knowledge base is asked and told, triple by triple."""

    def __init__(self, knowledge: KnowledgeBase) -> None:
        self._knowledge = knowledge
        handlers: dict[str, Handler] = {
            "rdf": self.told,
            "rdf_has": self.implied,
            "rdf_assert": self.add,
            "rdf_retractall": self.remove,
            "rdfs_individual_of": self.individuals,
            "rdfs_subclass_of": self.subclasses,
            "owl_class_properties": self.class_properties,
            "owl_parse": self.parse,
        }
        self.handlers = {name: self._in_turn(handler) for name, handler in handlers.items()}

    def _in_turn(self, handler: Handler) -> Handler:
        """Nothing changes while somebody looks."""

        def handle(*arguments: Value) -> Value:
            with self._knowledge.turn:
                return handler(*arguments)

        return handle

    # -- triples -------------------------------------------------------------------------------------------------------

    def told(self, subject: Value, property: Value, value: Value) -> Value:
        """Triples as they were told."""
        return self._rows(Triples(self._knowledge).find, subject, property, value)

    def implied(self, subject: Value, property: Value, value: Value) -> Value:
        """Triples of a property, and of those that imply it or its inverse."""
        return self._rows(Triples(self._knowledge).follow, subject, property, value)

    def add(self, subject: Value, property: Value, value: Value) -> Value:
        """Tells one."""
        about, link = _text(subject, "subject"), _text(property, "property")
        Triples(self._knowledge).add(about, link, _constant(value))
        return True

    def remove(self, subject: Value, property: Value, value: Value) -> Value:
        """Takes back all that fit, and says how many."""
        triples, wanted = Triples(self._knowledge), _wanted(value)
        about, link = _end(subject, "subject"), _end(property, "property")
        if value is FREE or wanted.exactly:
            return triples.remove(about, link, wanted.exactly)
        found = [each for each in triples.find(about, link) if wanted.fits(each.value)]
        return sum(triples.remove(each.subject, each.property, each.value) for each in found)

    def parse(self, source: Value) -> Value:
        """Loads a file, a folder of packages or `package://…`, and all that it imports."""
        self._knowledge.load((), ontologies=_text(source, "source"))
        return True

    def _rows(
        self,
        search: Callable[[str | None, str | None, Term | None], Iterator[Triple]],
        subject: Value,
        property: Value,
        value: Value,
    ) -> list[Value]:
        about, link, wanted = _end(subject, "subject"), _end(property, "property"), _wanted(value)
        return [
            [
                Atom(each.subject) if about is None else FREE,
                Atom(each.property) if link is None else FREE,
                FREE if wanted.is_closed else _value_term(each.value),
            ]
            for each in search(about, link, wanted.exactly)
            if wanted.fits(each.value)
        ]

    # -- what follows --------------------------------------------------------------------------------------------------

    def individuals(self, individual: Value, cls: Value) -> Value:
        """Individuals and their classes, told or above those; of maps and of none."""
        index = self._knowledge.index
        one, kind = self._name(individual, NameKind.INDIVIDUAL), self._name(cls, NameKind.CLASS)
        if kind and kind.startswith(_WORDS):
            return [
                [FREE if one else Atom(each.subject), FREE]
                for each in Triples(self._knowledge).find(one, TYPE, Term("iri", kind))
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
        classes = self._knowledge.index.classes
        lower, upper = self._name(cls, NameKind.CLASS), self._name(superclass, NameKind.CLASS)
        if lower and upper:
            return [[FREE, FREE]] if upper in classes.above(lower) else []
        if upper:
            return [[Atom(each), FREE] for each in classes.below(upper)]
        every = [lower] if lower else sorted(set(self._knowledge.index.declared_classes()))
        return [[FREE if lower else Atom(each), Atom(above)] for each in every for above in classes.above(each)]

    def class_properties(self, cls: Value, property: Value) -> Value:
        """What every member of a class has by a property, inherited or not; the nearest first."""
        index = self._knowledge.index
        one, link = self._name(cls, NameKind.CLASS), self._name(property, NameKind.PROPERTY)
        below = {lower for owner in index.restricting() for lower in index.classes.below(owner)}
        rows: dict[tuple[Iri, Iri, Expression], None] = {}
        for each in [one] if one else sorted(below):
            for owned in index.restrictions(each):
                told = owned.restriction
                promised = told.kind is Kind.VALUE or told.promises()
                if promised and told.filler and (not link or link in index.properties.implied(told.property)):
                    rows[each, told.property, told.filler] = None
        return [
            [FREE if one else Atom(owner), FREE if link else Atom(has), _expression_term(filler)]
            for owner, has, filler in rows
        ]

    def _name(self, value: Value, kind: NameKind) -> Iri | None:
        """A name written out; a whole one is taken as it is, since nobody has to know it to ask about it."""
        if value is FREE:
            return None
        name = _text(value, kind.value)
        return Iri(name) if ":" in name else self._knowledge.names.find(name, kind)


_FORMS = "give an atom, or literal(Text), literal(type(Type, Text)), literal(lang(Language, Text))"


def _end(value: Value, what: str) -> str | None:
    return None if value is FREE else _text(value, what)


def _text(value: Value, what: str) -> str:
    if isinstance(value, str):
        return str(value)
    raise ArgumentRefused(f"the {what}", cause=f"{value!r} is no name")


class _Wanted(msgspec.Struct, frozen=True):
    """What the value of a statement shall be; what stays open in it, Prolog compares."""

    exactly: Term | None = None
    """The one resource or literal that is meant."""
    is_literal: bool = False
    text: str | None = None
    """The text of a literal, whatever its type."""

    @property
    def is_closed(self) -> bool:
        return bool(self.exactly or self.text is not None)

    def fits(self, term: Term) -> bool:
        if self.exactly or not self.is_literal:
            return True
        return term.kind == "literal" and self.text in {None, term.value}


def _wanted(value: Value) -> _Wanted:
    """What is asked for.

    Raises:
        ArgumentRefused: it is neither a resource nor a literal.
    """
    match value:
        case Free():
            return _Wanted()
        case Atom():
            return _Wanted(Term("blank", value[2:]) if value.startswith("_:") else Term("iri", str(value)))
        case Compound("literal", (Compound("type", (Atom() as type, (str() | int() | float()) as text)),)):
            return _Wanted(Term("literal", str(text), str(type)))
        case Compound("literal", (Compound("lang", (Atom() as language, str() as text)),)):
            return _Wanted(Term("literal", str(text), RDF + "langString", str(language)))
        case Compound("literal", ((str() | int() | float()) as text,)):
            return _Wanted(is_literal=True, text=str(text))
        case Compound("literal", (_,)):
            return _Wanted(is_literal=True)
        case _:
            raise ArgumentRefused("the value", cause=f"{value!r} is no resource and no literal", remedy=_FORMS)


def _constant(value: Value) -> Term:
    """What is to be told; a literal without a type has that of what stands in it.

    Raises:
        ArgumentRefused: it is neither a resource nor a literal, or not a whole one.
    """
    match value:
        case Compound("literal", (int() as number,)):
            return Term("literal", str(number), XSD + "integer")
        case Compound("literal", (float() as number,)):
            return Term("literal", repr(number), XSD + "double")
    wanted = _wanted(value)
    if wanted.exactly:
        return wanted.exactly
    if wanted.text is None:
        raise ArgumentRefused("the value", cause="it is not told as a whole", remedy=_FORMS)
    return Term("literal", wanted.text, XSD + "string")


def _value_term(term: Term) -> Value:
    match term.kind:
        case "literal":
            return literal_term(term.value, term.datatype, term.language)
        case "blank":
            return Atom(f"_:{term.value}")
        case _:
            return Atom(term.value)


def _expression_term(expression: Expression) -> Value:
    match expression:
        case Named(iri):
            return Atom(iri)
        case Constant(literal):
            return literal_term(literal.text, literal.datatype, literal.language)
        case AnyOf(members):
            return Compound("union_of", ([_expression_term(each) for each in members],))
        case AllOf(members):
            return Compound("intersection_of", ([_expression_term(each) for each in members],))
        case Restriction(property, kind, filler):
            inner = (Atom(property), Atom(kind.value), None if filler is None else _expression_term(filler))
            return Compound("restriction", inner)
        case _:
            return None
