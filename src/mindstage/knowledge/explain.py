"""Words: how answers are explained and expressions read, in short names."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from mindstage.knowledge.owl import (
    ComplementOf,
    Expression,
    IntersectionOf,
    LiteralValue,
    NamedClass,
    OneOf,
    Restriction,
    RestrictionType,
    UnionOf,
)
from mindstage.knowledge.questions import MissingKnowledge
from mindstage.knowledge.rdf import local_name
from mindstage.knowledge.reasoner import InferenceRule, Justification, Reasoner
from mindstage.knowledge.reasoner_properties import ObjectTriple
from mindstage.knowledge.vocabulary import DESCRIBED_IN_MAP, SEMANTIC_MAP, THING, TYPE
from mindstage.scene import Iri

__all__ = [
    "expression_text",
    "individual_text",
    "membership_lines",
    "missing_description",
    "missing_file",
    "missing_instance",
    "restriction_line",
    "restriction_text",
    "statement_line",
    "subclass_line",
    "subproperty_line",
]

_RESTRICTION_TEXT = {
    RestrictionType.SOME: " some",
    RestrictionType.ALL: " only",
    RestrictionType.HAS_VALUE: "",
    RestrictionType.HAS_SELF: " itself",
    RestrictionType.MIN_CARDINALITY: " at least",
    RestrictionType.MAX_CARDINALITY: " at most",
    RestrictionType.EXACT_CARDINALITY: " exactly",
}


def statement_line(statement: ObjectTriple) -> str:
    """A triple."""
    return f"{local_name(statement.subject)} {local_name(statement.property)} {local_name(statement.object)}"


def expression_text(expression: Expression | None) -> str:  # noqa: PLR0911 (one a kind)
    """An expression as people read it."""
    match expression:
        case NamedClass(iri):
            return local_name(iri)
        case LiteralValue(literal):
            return literal.text
        case UnionOf(members):
            return f"({' or '.join(map(expression_text, members))})"
        case IntersectionOf(members):
            return f"({' and '.join(map(expression_text, members))})"
        case OneOf(members):
            return f"(one of {', '.join(map(expression_text, members))})"
        case ComplementOf(member):
            return f"(not {expression_text(member)})"
        case Restriction():
            return f"({restriction_text(expression)})"
        case None:
            return "anything"
        case _:
            return "…"


def restriction_text(restriction: Restriction) -> str:
    """A restriction: what every member has."""
    property = f"{'inverse of ' if restriction.inverse else ''}{local_name(restriction.property)}"
    number = "" if restriction.cardinality is None else f" {restriction.cardinality}"
    filler = (
        "" if restriction.restriction_type is RestrictionType.HAS_SELF else f" {expression_text(restriction.filler)}"
    )
    return f"{property}{_RESTRICTION_TEXT[restriction.restriction_type]}{number}{filler}"


def restriction_line(cls: Iri, restriction: Restriction) -> str:
    """What a class says of all its members."""
    return f"every {local_name(cls)}: {restriction_text(restriction)}"


def subclass_line(path: Iterable[Iri]) -> Iterator[str]:
    """The way from a class up to another one; nothing where they are the same."""
    names = [local_name(cls) for cls in path]
    if len(names) > 1:
        yield " is a ".join(names)


def subproperty_line(path: Iterable[Iri]) -> Iterator[str]:
    """The way from a property to one that it implies; nothing where they are the same."""
    names = [local_name(property) for property in path]
    if len(names) > 1:
        yield " implies ".join(names)


def membership_lines(reasoner: Reasoner, individual: Iri, cls: Iri) -> Iterator[str]:
    """Why an individual is of a class."""
    types = [own for own in reasoner.types_of(individual) if reasoner.is_a(own, cls)]
    nearest = min(types, key=lambda own: (len(reasoner.classes.path(own, cls)), own))
    if ground := reasoner.justification(individual, nearest):
        yield from _justification_lines(reasoner, individual, ground)
    else:
        yield statement_line(ObjectTriple(individual, TYPE, nearest))
    yield from subclass_line(reasoner.classes.path(nearest, cls))


def _justification_lines(reasoner: Reasoner, individual: Iri, justification: Justification) -> Iterator[str]:
    """Why an individual is of a class that nobody says it is of."""
    yield from dict.fromkeys(map(statement_line, justification.statements))
    cls, property = local_name(justification.cls), local_name(justification.property or "")
    if justification.property:
        (statement,) = justification.statements
        yield from subproperty_line(reasoner.properties.implication_path(statement.property, justification.property))
    match justification.rule:
        case InferenceRule.DOMAIN:
            yield f"whatever has a {property} is a {cls}"
        case InferenceRule.RANGE:
            yield f"whatever is a {property} of something is a {cls}"
        case InferenceRule.DEFINITION:
            yield f"whatever is {expression_text(justification.expression)} is a {cls}"
        case InferenceRule.OWL_RL:
            yield f"{local_name(individual)} type {cls}, by the rules of OWL 2 RL"
        case InferenceRule.TYPE:
            yield f"{local_name(individual)} type {expression_text(justification.expression)}"


def missing_description(reasoner: Reasoner, individual: Iri | None, map: Iri | None) -> Iterator[MissingKnowledge]:
    """What nobody told of an individual that is not in a map."""
    if individual:
        where = "any map" if map is None else local_name(map)
        cls = reasoner.class_of(individual) or THING
        yield MissingKnowledge(
            cls, DESCRIBED_IN_MAP, f"{local_name(individual)} is not in {where}: no describedInMap says so"
        )
    elif map:
        yield MissingKnowledge(
            SEMANTIC_MAP, DESCRIBED_IN_MAP, f"nothing is in {local_name(map)}: no describedInMap leads there"
        )
    elif not reasoner.members_by_map:
        why = "no semantic map is known: nothing is a SemanticEnvironmentMap, and no describedInMap leads to one"
        yield MissingKnowledge(SEMANTIC_MAP, TYPE, why)


def missing_file(map: Iri) -> Iterator[MissingKnowledge]:
    """What is missing of a map that was only told of."""
    yield MissingKnowledge(SEMANTIC_MAP, DESCRIBED_IN_MAP, f"{local_name(map)} was only told of: no file describes it")


def missing_instance(cls: Iri, individual: Iri | None, map: Iri | None) -> MissingKnowledge:
    """What nobody told where a class has no individual in a map, or this one is not of it."""
    if individual is not None:
        return MissingKnowledge(cls, TYPE, f"{local_name(individual)} is no {local_name(cls)}")
    where = "any map" if map is None else local_name(map)
    return MissingKnowledge(cls, TYPE, f"no individual in {where} is a {local_name(cls)}")


def individual_text(reasoner: Reasoner, individual: Iri) -> str:
    """An individual with its class, since many have names that tell nothing."""
    cls = reasoner.class_of(individual)
    return local_name(individual) if cls is None else f"{local_name(individual)} ({local_name(cls)})"
