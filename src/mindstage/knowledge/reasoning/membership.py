"""Membership: the classes that individuals are of although nobody says so.

A definition makes members of all that falls under it, a type without a name says what it consists of, and what nobody
gave a type gets one by the domain or range of a property that it has.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from enum import StrEnum
from functools import cached_property
from typing import TYPE_CHECKING

import msgspec
import pyoxigraph as ox

from mindstage.knowledge.reasoning.axioms import Condition
from mindstage.knowledge.reasoning.derivation import Derived
from mindstage.knowledge.reasoning.expressions import (
    AllOf,
    AnyOf,
    Expression,
    Kind,
    Named,
    OneOf,
    Restriction,
    Value,
    node_name,
)
from mindstage.knowledge.reasoning.properties import Statement, node_of
from mindstage.knowledge.vocabulary import OWL, RDF, RDFS, TYPE, xsd
from mindstage.world import Iri

if TYPE_CHECKING:
    from mindstage.knowledge.reasoning.index import Index
    from mindstage.knowledge.stores.triplestore import Readable

__all__ = ["Ground", "Membership", "Rule"]

Proof = tuple[Statement, ...]
_NONE: Mapping[Iri, Ground] = {}


class Rule(StrEnum):
    """How somebody became a member."""

    DOMAIN = "domain"
    RANGE = "range"
    DEFINITION = "definition"
    TYPE = "type"
    OWL_RL = "OWL 2 RL"


class Ground(msgspec.Struct, frozen=True):
    """Why an individual is of a class that nobody says it is of."""

    cls: Iri
    rule: Rule
    statements: Proof
    property: Iri | None = None
    """Whose domain or range the class is."""
    expression: Expression | None = None
    """What the individual falls under, or is said to be."""


class Membership:
    """What follows for individuals from one state of an index."""

    def __init__(self, index: Index, store: Readable, derived: Derived) -> None:
        """Works out what definitions make of the individuals that they may be about, until nothing more follows."""
        self._index = index
        self._store = store
        self._derived = derived
        self._defined: dict[Iri, dict[Iri, Ground]] = {}
        self._bounded: dict[Iri, dict[Iri, Ground]] = {}
        self._members: dict[Iri, dict[Iri, None]] = {}
        for individual in index.individuals.expressions:
            for expression in self._said(individual):
                for cls in _parts(expression):
                    self._join(individual, Ground(cls, Rule.TYPE, (), expression=expression))
        while any(self._apply(condition) for condition in sorted(index.axioms.conditions, key=repr)):
            pass
        for individual in index.individuals.untyped:
            for cls in self.grounds(individual):
                self._members.setdefault(cls, {})[individual] = None

    def members(self, cls: Iri) -> Iterable[Iri]:
        """Individuals that became members of this very class."""
        members = self._members.get(cls, ())
        if not self._derived:
            return members
        quads = self._derived.quads_for_pattern(None, ox.NamedNode(TYPE), ox.NamedNode(cls))
        return dict.fromkeys((*members, *(name for quad in quads if (name := node_name(quad.subject)))))

    def grounds(self, individual: Iri) -> Mapping[Iri, Ground]:
        """The classes that an individual became a member of, and why."""
        grounds = self._defined.get(individual, _NONE)
        if individual not in self._index.types and individual not in self._index.individuals.expressions:
            if individual not in self._bounded:
                self._bounded[individual] = {ground.cls: ground for ground in self._by_bounds(individual)}
            grounds = {**self._bounded[individual], **grounds}
        return {**self._by_rules(individual, grounds), **grounds} if self._derived else grounds

    def _by_rules(self, individual: Iri, known: Iterable[Iri]) -> dict[Iri, Ground]:
        """Classes that were derived, as far as they do not follow anyway."""
        above = self._index.classes.above
        implied = {cls for each in (*self._index.types.get(individual, ()), *known) for cls in above(each)}
        quads = self._derived.quads_for_pattern(node_of(individual), ox.NamedNode(TYPE), None)
        names = {Iri(quad.object.value) for quad in quads if isinstance(quad.object, ox.NamedNode)}
        new = {name for name in names - implied if not name.startswith((OWL, RDFS, RDF))}
        special = {cls for cls in new if not any(cls != other and cls in above(other) for other in new)}
        return {cls: Ground(cls, Rule.OWL_RL, ()) for cls in sorted(special or new)}

    def heeds(self, quads: Sequence[ox.Quad]) -> bool:
        """Whether other classes may follow for somebody after such statements have come or gone.

        Those about classes, properties and types always matter, and are not looked at here.
        """
        if self._watched is None:
            return True
        names = (name for quad in quads for name in (node_name(quad.subject), node_name(quad.object)))
        return any(Iri(quad.predicate.value) in self._watched for quad in quads) or any(
            name in self._bounded for name in names
        )

    @cached_property
    def _watched(self) -> frozenset[Iri] | None:
        """The properties that some definition is about; None where chains lead from any of them to any other."""
        properties = self._index.properties
        wanted = {each for condition in self._index.axioms.conditions for each in _properties(condition.expression)}
        if wanted and properties.has_chains:
            return None
        return frozenset(line for property in wanted for line in properties.used_for(property))

    # -- domains and ranges --------------------------------------------------------------------------------------------

    def _by_bounds(self, individual: Iri) -> Iterator[Ground]:
        node = node_of(individual)
        properties = self._index.properties
        told = [(quad, True) for quad in self._store.quads_for_pattern(node, None, None)]
        told += [(quad, False) for quad in self._store.quads_for_pattern(None, None, node)]
        found: dict[Iri, Ground] = {}
        for quad, is_subject in sorted(told, key=lambda each: (str(each[0].predicate), str(each[0]))):
            one, other = node_name(quad.subject), node_name(quad.object)
            property = Iri(quad.predicate.value)
            text = getattr(quad.object, "value", str(quad.object))
            for bound in properties.bounds(property, at_start=is_subject):
                rule = Rule.DOMAIN if bound.at_start else Rule.RANGE
                proof = (Statement(one or individual, property, other or Iri(text)),)
                found.setdefault(bound.cls, Ground(bound.cls, rule, proof, property=bound.property))
        yield from found.values()

    # -- definitions ---------------------------------------------------------------------------------------------------

    def _said(self, individual: Iri) -> Iterator[Expression]:
        """The types of an individual that have no name."""
        reader = self._index.axioms.reader
        return (reader.read(node) for node in self._index.individuals.expressions.get(individual, ()))

    def _join(self, individual: Iri, ground: Ground) -> None:
        self._defined.setdefault(individual, {})[ground.cls] = ground
        self._members.setdefault(ground.cls, {})[individual] = None

    def _apply(self, condition: Condition) -> bool:
        """Finds new members of one class; whether there were any."""
        expression, found = condition.expression, False
        for individual in sorted(set(self._candidates(expression))):
            if not self._is(individual, condition.cls):
                proof = self._proof(individual, expression)
                if proof is not None:
                    self._join(individual, Ground(condition.cls, Rule.DEFINITION, proof, expression=expression))
                    found = True
        return found

    def _candidates(self, expression: Expression | None) -> Iterator[Iri]:
        """All individuals that may fall under an expression, and some that do not."""
        match expression:
            case Named(iri):
                for below in self._index.classes.below(iri):
                    yield from self._index.individuals.members.get(below, ())
                    yield from self._members.get(below, ())
            case AllOf(members):
                yield from self._candidates(min(members, key=_cost, default=None))
            case AnyOf(members):
                for member in members:
                    yield from self._candidates(member)
            case OneOf(members):
                yield from (member.iri for member in members if isinstance(member, Named))
            case Restriction(property=property, inverse=inverse):
                if _can_be_shown(expression):
                    yield from self._index.properties.starts(property, backwards=inverse)
                for individual in self._index.individuals.expressions:
                    if expression in self._said(individual):
                        yield individual

    def _is(self, individual: Iri, cls: Iri) -> bool:
        classes = self._index.classes
        told = (*self._index.types.get(individual, ()), *self.grounds(individual))
        return any(cls in classes.above(each) for each in told)

    def _proof(self, individual: Iri, expression: Expression | None) -> Proof | None:
        """The statements that bring an individual under an expression; None where they do not."""
        match expression:
            case Named(iri):
                return () if self._is(individual, iri) else None
            case AllOf(members):
                proofs = [self._proof(individual, member) for member in members]
                return None if None in proofs else tuple(line for proof in proofs for line in proof or ())
            case AnyOf(members):
                proofs = [self._proof(individual, member) for member in members]
                return next((proof for proof in proofs if proof is not None), None)
            case OneOf(members):
                return () if Named(individual) in members else None
            case Restriction():
                return () if expression in self._said(individual) else self._has(individual, expression)
        return None

    def _has(self, individual: Iri, restriction: Restriction) -> Proof | None:
        """The statements by which an individual surely has such a value."""
        if not _can_be_shown(restriction):
            return None
        reached = self._index.properties.reached(restriction.property, individual, backwards=restriction.inverse)
        return next((way for value, way in reached if self._fits(individual, restriction, value)), None)

    def _fits(self, individual: Iri, restriction: Restriction, value: Named | Value) -> bool:
        filler = restriction.filler
        if restriction.kind is Kind.SELF:
            return value == Named(individual)
        if restriction.kind is Kind.VALUE or filler is None:
            return filler in {None, value}
        if isinstance(value, Value):
            return filler == Named(value.literal.datatype or xsd("string"))
        return self._proof(value.iri, filler) is not None


def _can_be_shown(restriction: Restriction) -> bool:
    """Whether statements can show it: nobody says that there are no more of them, or that two names mean two things."""
    if restriction.kind is Kind.AT_LEAST:
        return restriction.count == 1
    return restriction.kind in {Kind.SOME, Kind.VALUE, Kind.SELF}


def _properties(expression: Expression | None) -> Iterator[Iri]:
    """The properties that decide whether something falls under an expression."""
    match expression:
        case AllOf(members) | AnyOf(members):
            for member in members:
                yield from _properties(member)
        case Restriction(property=property, filler=filler) if _can_be_shown(expression):
            yield property
            yield from _properties(filler)


def _parts(expression: Expression) -> Iterator[Iri]:
    """The named classes that something surely is of when it falls under an expression."""
    match expression:
        case Named(iri):
            yield iri
        case AllOf(members):
            for member in members:
                yield from _parts(member)


def _cost(expression: Expression) -> int:
    """Where to look first: a name leads to its members alone."""
    return 0 if isinstance(expression, Named | OneOf) else 1
