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

from mindstage.knowledge.reasoning.axioms import SufficientCondition
from mindstage.knowledge.reasoning.derivation import InferredTriples
from mindstage.knowledge.reasoning.expressions import (
    Expression,
    IntersectionOf,
    LiteralValue,
    NamedClass,
    OneOf,
    Restriction,
    RestrictionType,
    UnionOf,
    node_label,
)
from mindstage.knowledge.reasoning.properties import ObjectTriple, node_from_label
from mindstage.knowledge.vocabulary import OWL, RDF, RDFS, TYPE, xsd
from mindstage.world import Iri

if TYPE_CHECKING:
    from mindstage.knowledge.reasoning.index import Reasoner
    from mindstage.knowledge.stores.triplestore import QuadSource

__all__ = ["InferenceRule", "InstanceChecker", "Justification"]

ProofStatements = tuple[ObjectTriple, ...]
_NO_JUSTIFICATIONS: Mapping[Iri, Justification] = {}


class InferenceRule(StrEnum):
    """How somebody became a member."""

    DOMAIN = "domain"
    RANGE = "range"
    DEFINITION = "definition"
    TYPE = "type"
    OWL_RL = "OWL 2 RL"


class Justification(msgspec.Struct, frozen=True):
    """Why an individual is of a class that nobody says it is of."""

    cls: Iri
    rule: InferenceRule
    statements: ProofStatements
    property: Iri | None = None
    """Whose domain or range the class is."""
    expression: Expression | None = None
    """What the individual falls under, or is said to be."""


class InstanceChecker:
    """What follows for individuals from one state of an index."""

    def __init__(self, reasoner: Reasoner, store: QuadSource, inferred: InferredTriples) -> None:
        """Works out what definitions make of the individuals that they may be about, until nothing more follows."""
        self._reasoner = reasoner
        self._store = store
        self._inferred = inferred
        self._by_definition: dict[Iri, dict[Iri, Justification]] = {}
        self._by_domain_range: dict[Iri, dict[Iri, Justification]] = {}
        self._inferred_members: dict[Iri, dict[Iri, None]] = {}
        for individual in reasoner.individuals.anonymous_types:
            for expression in self._anonymous_types(individual):
                for cls in _conjunct_classes(expression):
                    self._add_member(individual, Justification(cls, InferenceRule.TYPE, (), expression=expression))
        while any(
            self._apply_condition(condition) for condition in sorted(reasoner.axioms.sufficient_conditions, key=repr)
        ):
            pass
        for individual in reasoner.individuals.untyped:
            for cls in self.justifications(individual):
                self._inferred_members.setdefault(cls, {})[individual] = None

    def members(self, cls: Iri) -> Iterable[Iri]:
        """Individuals that became members of this very class."""
        members = self._inferred_members.get(cls, ())
        if not self._inferred:
            return members
        quads = self._inferred.quads_for_pattern(None, ox.NamedNode(TYPE), ox.NamedNode(cls))
        return dict.fromkeys((*members, *(name for quad in quads if (name := node_label(quad.subject)))))

    def justifications(self, individual: Iri) -> Mapping[Iri, Justification]:
        """The classes that an individual became a member of, and why."""
        grounds = self._by_definition.get(individual, _NO_JUSTIFICATIONS)
        if individual not in self._reasoner.types and individual not in self._reasoner.individuals.anonymous_types:
            if individual not in self._by_domain_range:
                self._by_domain_range[individual] = {
                    ground.cls: ground for ground in self._domain_range_justifications(individual)
                }
            grounds = {**self._by_domain_range[individual], **grounds}
        return {**self._owl_rl_justifications(individual, grounds), **grounds} if self._inferred else grounds

    def _owl_rl_justifications(self, individual: Iri, known: Iterable[Iri]) -> dict[Iri, Justification]:
        """Classes that were derived, as far as they do not follow anyway."""
        above = self._reasoner.classes.above
        implied = {cls for each in (*self._reasoner.types.get(individual, ()), *known) for cls in above(each)}
        quads = self._inferred.quads_for_pattern(node_from_label(individual), ox.NamedNode(TYPE), None)
        names = {Iri(quad.object.value) for quad in quads if isinstance(quad.object, ox.NamedNode)}
        new = {name for name in names - implied if not name.startswith((OWL, RDFS, RDF))}
        special = {cls for cls in new if not any(cls != other and cls in above(other) for other in new)}
        return {cls: Justification(cls, InferenceRule.OWL_RL, ()) for cls in sorted(special or new)}

    def is_affected_by(self, quads: Sequence[ox.Quad]) -> bool:
        """Whether other classes may follow for somebody after such statements have come or gone.

        Those about classes, properties and types always matter, and are not looked at here.
        """
        if self._definition_properties is None:
            return True
        names = (name for quad in quads for name in (node_label(quad.subject), node_label(quad.object)))
        return any(Iri(quad.predicate.value) in self._definition_properties for quad in quads) or any(
            name in self._by_domain_range for name in names
        )

    @cached_property
    def _definition_properties(self) -> frozenset[Iri] | None:
        """The properties that some definition is about; None where chains lead from any of them to any other."""
        properties = self._reasoner.properties
        wanted = {
            each
            for condition in self._reasoner.axioms.sufficient_conditions
            for each in _decisive_properties(condition.expression)
        }
        if wanted and properties.has_chains:
            return None
        return frozenset(line for property in wanted for line in properties.implying_properties(property))

    # -- domains and ranges --------------------------------------------------------------------------------------------

    def _domain_range_justifications(self, individual: Iri) -> Iterator[Justification]:
        node = node_from_label(individual)
        properties = self._reasoner.properties
        told = [(quad, True) for quad in self._store.quads_for_pattern(node, None, None)]
        told += [(quad, False) for quad in self._store.quads_for_pattern(None, None, node)]
        found: dict[Iri, Justification] = {}
        for quad, is_subject in sorted(told, key=lambda each: (str(each[0].predicate), str(each[0]))):
            one, other = node_label(quad.subject), node_label(quad.object)
            property = Iri(quad.predicate.value)
            text = getattr(quad.object, "value", str(quad.object))
            for bound in properties.domains_ranges(property, as_subject=is_subject):
                rule = InferenceRule.DOMAIN if bound.is_domain else InferenceRule.RANGE
                proof = (ObjectTriple(one or individual, property, other or Iri(text)),)
                found.setdefault(bound.cls, Justification(bound.cls, rule, proof, property=bound.property))
        yield from found.values()

    # -- definitions ---------------------------------------------------------------------------------------------------

    def _anonymous_types(self, individual: Iri) -> Iterator[Expression]:
        """The types of an individual that have no name."""
        reader = self._reasoner.axioms.parser
        return (reader.parse(node) for node in self._reasoner.individuals.anonymous_types.get(individual, ()))

    def _add_member(self, individual: Iri, justification: Justification) -> None:
        self._by_definition.setdefault(individual, {})[justification.cls] = justification
        self._inferred_members.setdefault(justification.cls, {})[individual] = None

    def _apply_condition(self, condition: SufficientCondition) -> bool:
        """Finds new members of one class; whether there were any."""
        expression, found = condition.expression, False
        for individual in sorted(set(self._candidates(expression))):
            if not self._is_instance(individual, condition.cls):
                proof = self._proof(individual, expression)
                if proof is not None:
                    self._add_member(
                        individual, Justification(condition.cls, InferenceRule.DEFINITION, proof, expression=expression)
                    )
                    found = True
        return found

    def _candidates(self, expression: Expression | None) -> Iterator[Iri]:
        """All individuals that may fall under an expression, and some that do not."""
        match expression:
            case NamedClass(iri):
                for below in self._reasoner.classes.below(iri):
                    yield from self._reasoner.individuals.members.get(below, ())
                    yield from self._inferred_members.get(below, ())
            case IntersectionOf(members):
                yield from self._candidates(min(members, key=_search_cost, default=None))
            case UnionOf(members):
                for member in members:
                    yield from self._candidates(member)
            case OneOf(members):
                yield from (member.iri for member in members if isinstance(member, NamedClass))
            case Restriction(property=property, inverse=inverse):
                if _is_provable(expression):
                    yield from self._reasoner.properties.candidate_subjects(property, backwards=inverse)
                for individual in self._reasoner.individuals.anonymous_types:
                    if expression in self._anonymous_types(individual):
                        yield individual

    def _is_instance(self, individual: Iri, cls: Iri) -> bool:
        classes = self._reasoner.classes
        told = (*self._reasoner.types.get(individual, ()), *self.justifications(individual))
        return any(cls in classes.above(each) for each in told)

    def _proof(self, individual: Iri, expression: Expression | None) -> ProofStatements | None:
        """The statements that bring an individual under an expression; None where they do not."""
        match expression:
            case NamedClass(iri):
                return () if self._is_instance(individual, iri) else None
            case IntersectionOf(members):
                proofs = [self._proof(individual, member) for member in members]
                return None if None in proofs else tuple(line for proof in proofs for line in proof or ())
            case UnionOf(members):
                proofs = [self._proof(individual, member) for member in members]
                return next((proof for proof in proofs if proof is not None), None)
            case OneOf(members):
                return () if NamedClass(individual) in members else None
            case Restriction():
                return (
                    ()
                    if expression in self._anonymous_types(individual)
                    else self._restriction_proof(individual, expression)
                )
        return None

    def _restriction_proof(self, individual: Iri, restriction: Restriction) -> ProofStatements | None:
        """The statements by which an individual surely has such a value."""
        if not _is_provable(restriction):
            return None
        reached = self._reasoner.properties.values_with_paths(
            restriction.property, individual, backwards=restriction.inverse
        )
        return next((way for value, way in reached if self._satisfies(individual, restriction, value)), None)

    def _satisfies(self, individual: Iri, restriction: Restriction, value: NamedClass | LiteralValue) -> bool:
        filler = restriction.filler
        if restriction.restriction_type is RestrictionType.HAS_SELF:
            return value == NamedClass(individual)
        if restriction.restriction_type is RestrictionType.HAS_VALUE or filler is None:
            return filler in {None, value}
        if isinstance(value, LiteralValue):
            return filler == NamedClass(value.literal.datatype or xsd("string"))
        return self._proof(value.iri, filler) is not None


def _is_provable(restriction: Restriction) -> bool:
    """Whether statements can show it: nobody says that there are no more of them, or that two names mean two things."""
    if restriction.restriction_type is RestrictionType.MIN_CARDINALITY:
        return restriction.cardinality == 1
    return restriction.restriction_type in {RestrictionType.SOME, RestrictionType.HAS_VALUE, RestrictionType.HAS_SELF}


def _decisive_properties(expression: Expression | None) -> Iterator[Iri]:
    """The properties that decide whether something falls under an expression."""
    match expression:
        case IntersectionOf(members) | UnionOf(members):
            for member in members:
                yield from _decisive_properties(member)
        case Restriction(property=property, filler=filler) if _is_provable(expression):
            yield property
            yield from _decisive_properties(filler)


def _conjunct_classes(expression: Expression) -> Iterator[Iri]:
    """The named classes that something surely is of when it falls under an expression."""
    match expression:
        case NamedClass(iri):
            yield iri
        case IntersectionOf(members):
            for member in members:
                yield from _conjunct_classes(member)


def _search_cost(expression: Expression) -> int:
    """Where to look first: a name leads to its members alone."""
    return 0 if isinstance(expression, NamedClass | OneOf) else 1
