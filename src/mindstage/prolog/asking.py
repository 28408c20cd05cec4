"""Asking: every declared question as a predicate, without a list of them anywhere."""

from __future__ import annotations

import re
from collections.abc import Container, Sequence
from enum import Enum
from typing import Any

import msgspec

from mindstage.errors import InvalidArgumentError
from mindstage.knowledge.names import namespace_of
from mindstage.knowledge.questions import AnswerRow, Answers, Question, get_question, list_questions
from mindstage.knowledge.reasoning.namebook import PREFIXES
from mindstage.prolog.requests import Handler
from mindstage.prolog.terms import FREE, Atom, Compound, Unbound, Value
from mindstage.stage import Simulation
from mindstage.world import IriRef, Literal

__all__ = ["QuestionPredicates", "literal_term", "term_of"]


class QuestionPredicates:
    """What a stage is asked."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self.handlers: dict[str, Handler] = {
            "predicates": self.predicates,
            "rows": self.rows,
            "reasons": self.reasons,
            "missing": self.missing,
            "prefixes": self.prefixes,
        }

    def predicates(self) -> Value:
        """Each question's name, the names of its columns in their order here, how many of them are arguments, text.

        There is a predicate with the arguments and, where the answers tell more than that, one with all columns.
        """
        return [
            Compound(
                "predicate",
                (Atom(each.name), [Atom(name) for name in _columns(each)], len(each.arguments), _first_line(each.text)),
            )
            for each in list_questions()
        ]

    def rows(self, name: Value, args: Sequence[Value]) -> Value:
        """The answers, each a list as long as what is given; what was asked about is left free in them."""
        answers, bound = self._ask(name, args)
        return [list(row) for row in dict.fromkeys(_row_values(row, answers, bound, len(args)) for row in answers)]

    def reasons(self, name: Value, args: Sequence[Value]) -> Value:
        """The same rows, each with the lines that explain it."""
        answers, bound = self._ask(name, args)
        why = self._simulation.knowledge.explain
        return [
            [list(_row_values(row, answers, bound, len(args))), [Atom(line) for line in why(answers.question, row)]]
            for row in answers
        ]

    def missing(self, name: Value, args: Sequence[Value]) -> Value:
        """What nobody has told, one sentence each; nothing where there is an answer."""
        answers, _ = self._ask(name, args)
        return [Atom(lack.reason) for lack in answers.missing]

    def prefixes(self) -> Value:
        """The prefixes of names; each map brings one for its own, where that is free."""
        found = dict(PREFIXES)
        for map in self._simulation.knowledge.maps():
            namespace = namespace_of(map)
            prefix = re.sub(r"\.\w+$", "", re.split(r"[/:]", namespace.rstrip("#/:"))[-1]).lower()
            if prefix and namespace not in found.values():
                found.setdefault(prefix, namespace)
        return [Compound("-", (Atom(prefix), Atom(namespace))) for prefix, namespace in found.items()]

    def _ask(self, name: Value, args: Sequence[Value]) -> tuple[Answers[Any], Container[str]]:
        """The answers, and the columns that were given as arguments."""
        question = get_question(str(name))
        arguments = {argument.name for argument in question.arguments}
        columns = _columns(question)
        if len(args) > len(columns):
            cause = f"it has no more than {len(columns)} arguments here: {', '.join(columns)}"
            raise InvalidArgumentError(question.name, cause=cause)
        pairs = zip(columns, args, strict=False)
        bound = {column: value for column, value in pairs if column in arguments and value is not FREE}
        return self._simulation.ask(question, **bound), bound


def _row_values(row: AnswerRow, answers: Answers[Any], bound: Container[str], width: int) -> tuple[Value, ...]:
    """A row as Prolog has it; what no row tells, such as a tolerance, is what it was by default."""
    defaults = {argument.name: argument.default for argument in answers.question.arguments}
    return tuple(
        FREE if column in bound else term_of(getattr(row, column, defaults.get(column)))
        for column in _columns(answers.question)[:width]
    )


_FUNCTORS = {
    "JointSummary": "joint",
    "PropertyAssertion": "fact",
    "BlankNode": "anonymous",
    "LinearLimits": "linearmotion",
    "AngularLimits": "angularmotion",
    "SoftLimit": "soft",
    "BodyPhysics": "physics",
    "PrimitiveShape": "shape",
}
"""The functors of records whose class has another name; all others have the class's name in lower case."""


def term_of(value: object) -> Value:  # noqa: PLR0911 (one a kind)
    """A field of an answer: texts as atoms, a struct as a term that is called like it, `none` for what is not told."""
    match value:
        case bool() | int() | float() | None | Compound() | Unbound():
            return value
        case Enum():  # before str, which enumerations of words are too
            return term_of(value.value)
        case str():
            return Atom(value)
        case IriRef(iri):
            return Atom(iri)
        case Literal():
            return literal_term(value.text, value.datatype, value.language)
        case tuple() | list():
            return tuple(term_of(each) for each in value)
        case msgspec.Struct():
            fields = (term_of(getattr(value, name)) for name in value.__struct_fields__)
            name = type(value).__name__
            return Compound(_FUNCTORS.get(name, name.lower()), tuple(fields))
        case _:
            return Atom(str(value))


def literal_term(text: str, datatype: str | None, language: str | None) -> Compound:
    """A literal as SWI-Prolog's semweb library writes it; texts without a type are strings, as RDF 1.1 says."""
    if language:
        return Compound("literal", (Compound("lang", (Atom(language), Atom(text))),))
    type = datatype or PREFIXES["xsd"] + "string"
    return Compound("literal", (Compound("type", (Atom(type), Atom(text))),))


def _columns(question: Question[Any]) -> list[str]:
    """All that a predicate can have, in its order: the map first, as the community has it, then the other arguments."""
    arguments = [argument.name for argument in question.arguments]
    arguments.sort(key=lambda name: name != "map")
    return [*arguments, *(column for column in question.columns if column not in arguments)]


def _first_line(text: str) -> str:
    return text.partition("\n")[0]
