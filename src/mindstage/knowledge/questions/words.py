"""Words: how answers are explained and expressions read, in short names."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from mindstage.knowledge.names import local_name
from mindstage.knowledge.questions.question import Missing
from mindstage.knowledge.reasoning import (
    AllOf,
    AnyOf,
    Expression,
    Ground,
    Index,
    Kind,
    Named,
    Not,
    OneOf,
    Restriction,
    Rule,
    Statement,
    Value,
)
from mindstage.knowledge.vocabulary import DESCRIBED_IN_MAP, SEMANTIC_MAP, THING, TYPE
from mindstage.world import Iri

__all__ = [
    "expression_text",
    "implies_line",
    "is_line",
    "member_lines",
    "not_described",
    "not_here",
    "only_told",
    "restriction_line",
    "restriction_text",
    "statement_line",
    "thing_text",
]

_BINDING = {
    Kind.SOME: " some",
    Kind.ALL: " only",
    Kind.VALUE: "",
    Kind.SELF: " itself",
    Kind.AT_LEAST: " at least",
    Kind.AT_MOST: " at most",
    Kind.EXACTLY: " exactly",
}


def statement_line(statement: Statement) -> str:
    """A triple."""
    return f"{local_name(statement.subject)} {local_name(statement.property)} {local_name(statement.object)}"


def expression_text(expression: Expression | None) -> str:  # noqa: PLR0911 (one a kind)
    """An expression as people read it."""
    match expression:
        case Named(iri):
            return local_name(iri)
        case Value(literal):
            return literal.text
        case AnyOf(members):
            return f"({' or '.join(map(expression_text, members))})"
        case AllOf(members):
            return f"({' and '.join(map(expression_text, members))})"
        case OneOf(members):
            return f"(one of {', '.join(map(expression_text, members))})"
        case Not(member):
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
    number = "" if restriction.count is None else f" {restriction.count}"
    filler = "" if restriction.kind is Kind.SELF else f" {expression_text(restriction.filler)}"
    return f"{property}{_BINDING[restriction.kind]}{number}{filler}"


def restriction_line(cls: Iri, restriction: Restriction) -> str:
    """What a class says of all its members."""
    return f"every {local_name(cls)}: {restriction_text(restriction)}"


def is_line(path: Iterable[Iri]) -> Iterator[str]:
    """The way from a class up to another one; nothing where they are the same."""
    names = [local_name(cls) for cls in path]
    if len(names) > 1:
        yield " is a ".join(names)


def implies_line(path: Iterable[Iri]) -> Iterator[str]:
    """The way from a property to one that it implies; nothing where they are the same."""
    names = [local_name(property) for property in path]
    if len(names) > 1:
        yield " implies ".join(names)


def member_lines(index: Index, individual: Iri, cls: Iri) -> Iterator[str]:
    """Why an individual is of a class."""
    types = [own for own in index.types_of(individual) if index.is_a(own, cls)]
    nearest = min(types, key=lambda own: (len(index.classes.path(own, cls)), own))
    if ground := index.ground(individual, nearest):
        yield from _ground_lines(index, individual, ground)
    else:
        yield statement_line(Statement(individual, TYPE, nearest))
    yield from is_line(index.classes.path(nearest, cls))


def _ground_lines(index: Index, individual: Iri, ground: Ground) -> Iterator[str]:
    """Why an individual is of a class that nobody says it is of."""
    yield from dict.fromkeys(map(statement_line, ground.statements))
    cls, property = local_name(ground.cls), local_name(ground.property or "")
    if ground.property:
        (statement,) = ground.statements
        yield from implies_line(index.properties.path(statement.property, ground.property))
    match ground.rule:
        case Rule.DOMAIN:
            yield f"whatever has a {property} is a {cls}"
        case Rule.RANGE:
            yield f"whatever is a {property} of something is a {cls}"
        case Rule.DEFINITION:
            yield f"whatever is {expression_text(ground.expression)} is a {cls}"
        case Rule.OWL_RL:
            yield f"{local_name(individual)} type {cls}, by the rules of OWL 2 RL"
        case Rule.TYPE:
            yield f"{local_name(individual)} type {expression_text(ground.expression)}"


def not_described(index: Index, individual: Iri | None, map: Iri | None) -> Iterator[Missing]:
    """What nobody told of an individual that is not in a map."""
    if individual:
        where = "any map" if map is None else local_name(map)
        cls = index.class_of(individual) or THING
        yield Missing(cls, DESCRIBED_IN_MAP, f"{local_name(individual)} is not in {where}: no describedInMap says so")
    elif map:
        yield Missing(SEMANTIC_MAP, DESCRIBED_IN_MAP, f"nothing is in {local_name(map)}: no describedInMap leads there")
    elif not index.residents:
        why = "no semantic map is known: nothing is a SemanticEnvironmentMap, and no describedInMap leads to one"
        yield Missing(SEMANTIC_MAP, TYPE, why)


def only_told(map: Iri) -> Iterator[Missing]:
    """What is missing of a map that was only told of."""
    yield Missing(SEMANTIC_MAP, DESCRIBED_IN_MAP, f"{local_name(map)} was only told of: no file describes it")


def not_here(cls: Iri, individual: Iri | None, map: Iri | None) -> Missing:
    """What nobody told where a class has no individual in a map, or this one is not of it."""
    if individual is not None:
        return Missing(cls, TYPE, f"{local_name(individual)} is no {local_name(cls)}")
    where = "any map" if map is None else local_name(map)
    return Missing(cls, TYPE, f"no individual in {where} is a {local_name(cls)}")


def thing_text(index: Index, individual: Iri) -> str:
    """An individual with its class, since many have names that tell nothing."""
    cls = index.class_of(individual)
    return local_name(individual) if cls is None else f"{local_name(individual)} ({local_name(cls)})"
