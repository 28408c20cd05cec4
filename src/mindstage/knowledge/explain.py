"""Explanations: statements, class expressions and missing knowledge as text with local names."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from mindstage.knowledge.claims import Claim, ClaimKind
from mindstage.knowledge.names import compact_iri
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
from mindstage.knowledge.questions import MAP_SOURCE, MissingKnowledge
from mindstage.knowledge.reasoner import InferenceRule, Justification, Reasoner
from mindstage.knowledge.reasoner_properties import ObjectTriple
from mindstage.rdf.graphs import local_name
from mindstage.rdf.vocabulary import DESCRIBED_IN_MAP, SEMANTIC_MAP, THING, TYPE
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
    "source_text",
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
    """A triple as text."""
    return f"{local_name(statement.subject)} {local_name(statement.property)} {local_name(statement.object)}"


def expression_text(expression: Expression | None) -> str:  # noqa: PLR0911 (one per type)
    """A class expression as text."""
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
    """A restriction as text, without the class that has it."""
    property = f"{'inverse of ' if restriction.inverse else ''}{local_name(restriction.property)}"
    number = "" if restriction.cardinality is None else f" {restriction.cardinality}"
    filler = (
        "" if restriction.restriction_type is RestrictionType.HAS_SELF else f" {expression_text(restriction.filler)}"
    )
    return f"{property}{_RESTRICTION_TEXT[restriction.restriction_type]}{number}{filler}"


def restriction_line(cls: Iri, restriction: Restriction) -> str:
    """A restriction of a class as text."""
    return f"every {local_name(cls)}: {restriction_text(restriction)}"


def subclass_line(path: Iterable[Iri]) -> Iterator[str]:
    """The path from a class up to a superclass as text; nothing if they are the same.

    Classes of one local name, such as knowrob:Drawer and soma:Drawer, are given with their prefixes.
    """
    classes = list(path)
    names = [local_name(cls) for cls in classes]
    names = [compact_iri(cls) if names.count(name) > 1 else name for cls, name in zip(classes, names, strict=True)]
    if len(names) > 1:
        yield " is a ".join(names)


def subproperty_line(path: Iterable[Iri]) -> Iterator[str]:
    """The path from a property to one that it implies as text; nothing if they are the same."""
    names = [local_name(property) for property in path]
    if len(names) > 1:
        yield " implies ".join(names)


def membership_lines(reasoner: Reasoner, individual: Iri, cls: Iri) -> Iterator[str]:
    """Why an individual is a member of a class."""
    types = [own for own in reasoner.types_of(individual) if reasoner.is_a(own, cls)]
    nearest = min(types, key=lambda own: (len(reasoner.classes.path(own, cls)), own))
    if justification := reasoner.justification(individual, nearest):
        yield from _justification_lines(reasoner, individual, justification)
    else:
        yield statement_line(ObjectTriple(individual, TYPE, nearest))
    yield from subclass_line(reasoner.classes.path(nearest, cls))


def _justification_lines(reasoner: Reasoner, individual: Iri, justification: Justification) -> Iterator[str]:
    """Why an individual is a member of an inferred class."""
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
    """The missing statement if an individual is not in a map, or a map is empty."""
    nested = reasoner.individuals.nested_maps(individual)
    only_nested = "only poses and limits have a describedInMap statement, which are not counted as individuals"
    if individual:
        where = "any map" if map is None else local_name(map)
        cls = reasoner.class_of(individual) or THING
        reason = f"{local_name(individual)} is not in {where}: there is no describedInMap statement"
        if nested:
            reason = f"{individual_text(reasoner, individual)} is a part of an individual, and is not counted as one"
        claim = Claim(kind=ClaimKind.NO_STATEMENT, subject=individual, property=DESCRIBED_IN_MAP, object=map)
        yield MissingKnowledge(cls, DESCRIBED_IN_MAP, reason, claims=(claim,))
    elif map:
        reason = f"nothing is in {local_name(map)}: there is no describedInMap statement"
        reason = f"nothing is in {local_name(map)}: {only_nested}" if map in nested else reason
        claim = Claim(kind=ClaimKind.NO_STATEMENT, property=DESCRIBED_IN_MAP, object=map)
        yield MissingKnowledge(SEMANTIC_MAP, DESCRIBED_IN_MAP, reason, claims=(claim,))
    elif not reasoner.members_by_map:
        reason = "no semantic map is loaded: there is no SemanticEnvironmentMap and no describedInMap statement"
        reason = f"no SemanticEnvironmentMap is loaded, and {only_nested}" if nested else reason
        claims = (
            Claim(kind=ClaimKind.NO_STATEMENT, property=TYPE, object=SEMANTIC_MAP),
            Claim(kind=ClaimKind.NO_STATEMENT, property=DESCRIBED_IN_MAP),
        )
        yield MissingKnowledge(SEMANTIC_MAP, TYPE, reason, claims=claims)


def missing_file(map: Iri) -> Iterator[MissingKnowledge]:
    """The missing statement if a map exists in assertions only."""
    reason = f"{local_name(map)} is only asserted: no loaded file describes it"
    claim = Claim(kind=ClaimKind.NO_SOURCE, subject=map)
    yield MissingKnowledge(SEMANTIC_MAP, DESCRIBED_IN_MAP, reason, claims=(claim,))


def missing_instance(
    reasoner: Reasoner, cls: Iri, individual: Iri | None, map: Iri | None
) -> Iterator[MissingKnowledge]:
    """The missing statement if a class has no individual in a map, or the given one is not a member of it."""
    if individual is not None:
        if reasoner.is_member(individual, cls):
            yield from missing_description(reasoner, individual, map)
            return
        reason = f"{local_name(individual)} is no {local_name(cls)}"
        claim = Claim(kind=ClaimKind.NOT_INSTANCE, subject=individual, object=cls)
        yield MissingKnowledge(cls, TYPE, reason, claims=(claim,))
        return
    where = "any map" if map is None else local_name(map)
    reason = f"no individual in {where} is a {local_name(cls)}"
    nested = next((each for each in reasoner.members(cls) if reasoner.individuals.nested_maps(each)), None)
    if nested:
        reason += f"; {local_name(nested)} is a part of an individual, as poses are, and is not counted"
    claim = Claim(kind=ClaimKind.NO_INSTANCE, object=cls, map=map)
    yield MissingKnowledge(cls, TYPE, reason, claims=(claim,))


def individual_text(reasoner: Reasoner, individual: Iri) -> str:
    """An individual with its class, since the names of individuals are often generated."""
    cls = reasoner.class_of(individual)
    return local_name(individual) if cls is None else f"{local_name(individual)} ({local_name(cls)})"


def source_text(source: str) -> str:
    """Where the poses and shapes of an answer come from, in words."""
    state, _, shapes = source.partition(", ")
    note = f"; bodies are taken as their {shapes}" if shapes else ""
    return ("as the map has it; no simulation is running" if state == MAP_SOURCE else f"as {state} has it now") + note
