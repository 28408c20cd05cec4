"""Words: how answers are explained and expressions read, in short names."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from mindstage.knowledge.names import local_name
from mindstage.knowledge.reasoning import (
    AllOf,
    AnyOf,
    Expression,
    Index,
    Kind,
    Named,
    Restriction,
    Statement,
    Value,
)
from mindstage.knowledge.vocabulary import TYPE
from mindstage.world import Iri

__all__ = [
    "expression_text",
    "implies_line",
    "is_line",
    "member_lines",
    "restriction_line",
    "restriction_text",
    "statement_line",
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
    told = [own for own in index.types.get(individual, ()) if index.is_a(own, cls)]
    nearest = min(told, key=lambda own: (len(index.classes.path(own, cls)), own))
    yield statement_line(Statement(individual, TYPE, nearest))
    yield from is_line(index.classes.path(nearest, cls))
