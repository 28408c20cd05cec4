"""Answering: answers as tables for the page, in which each row knows its body."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import msgspec

from mindstage.knowledge import KnowledgeBase, RdfTerm, SparqlResult
from mindstage.knowledge.names import local_name
from mindstage.knowledge.questions import Answers, Question, cell_text, subject_column
from mindstage.knowledge.reasoning import EntityType
from mindstage.knowledge.reasoning.namebook import compact_iri
from mindstage.world import BodyId

__all__ = [
    "MAX_ROWS",
    "AnswerTable",
    "MissingFact",
    "QuestionForm",
    "TableCell",
    "answer_table",
    "prolog_table",
    "question_form",
    "sparql_table",
]

MAX_ROWS = 500
"""So many rows a page gets at once; how many there are it is told besides."""
_CLASS_COLUMN_TITLE = "class of {}"


class TableCell(msgspec.Struct, frozen=True, omit_defaults=True):
    """One value as people read it."""

    text: str | int | float | None
    iri: str = ""
    """The whole name, where it is one."""
    id: str = ""
    """The body that it is in the world."""


class MissingFact(msgspec.Struct, frozen=True, kw_only=True):
    """What nobody has told yet, as a statement that waits for its other end."""

    subject: str
    property: str
    value: str
    reason: str


class AnswerTable(msgspec.Struct, frozen=True, kw_only=True):
    """What a question or a query was answered with."""

    key: int = 0
    """Names these answers in what is asked about them."""
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[TableCell, ...], ...]
    ids: tuple[str, ...]
    """Of each row, the body that it is about; empty where it has none."""
    total: int
    missing: tuple[MissingFact, ...] = ()
    explainable: bool = False
    """Whether it can be asked why."""
    boolean: bool | None = None
    """The answer of a query that asks for yes or no."""


class _Parameter(msgspec.Struct, frozen=True):
    name: str
    kind: str
    choices: tuple[str, ...]
    completion: str
    """The kind of name that can be completed; empty where it is none."""


class QuestionForm(msgspec.Struct, frozen=True, kw_only=True):
    """A question as a form is made from it."""

    name: str
    text: str
    arguments: tuple[_Parameter, ...]
    live: bool
    """Whether it is about how things are just now."""


def question_form(question: Question[Any]) -> QuestionForm:
    """A question, for a form."""
    arguments = (
        _Parameter(
            each.name,
            each.type_text,
            each.choices,
            each.value_type.name if isinstance(each.value_type, EntityType) else "",
        )
        for each in question.arguments
    )
    return QuestionForm(
        name=question.name, text=question.text, arguments=tuple(arguments), live=question.uses_current_state
    )


def answer_table(kb: KnowledgeBase, answers: Answers[Any], bodies: Mapping[str, BodyId], *, title: str) -> AnswerTable:
    """Answers as a table.

    Args:
        kb: tells the class of what was asked for: many individuals are called by a number.
        answers: to a declared question.
        bodies: of individuals, by IRI.
        title: what was asked.
    """
    about = subject_column(answers)
    columns = _columns(kb, answers, about)
    shown = answers[:MAX_ROWS]
    rows = [[_cell(getattr(row, name), bodies) for name in columns] for row in shown]
    if about and answers.question.columns[about] is EntityType.INDIVIDUAL and not {"cls", "classes"} & {*columns}:
        for cells, row in zip(rows, shown, strict=True):
            cells.insert(1, _cell(kb.reasoner.class_of(getattr(row, about)), {}))
        columns.insert(1, _CLASS_COLUMN_TITLE.format(about))
    return AnswerTable(
        title=title,
        columns=tuple(columns),
        rows=tuple(map(tuple, rows)),
        ids=tuple(map(_row_id, rows)),
        total=len(answers),
        missing=tuple(
            MissingFact(
                subject="" if lack.is_filler else compact_iri(lack.cls),
                property=compact_iri(lack.property),
                value=compact_iri(lack.cls) if lack.is_filler else "",
                reason=lack.reason,
            )
            for lack in answers.missing
        ),
        explainable=answers.question.has_explanation,
    )


def prolog_table(rows: Sequence[Mapping[str, Any]], bodies: Mapping[str, BodyId], *, title: str) -> AnswerTable:
    """What makes a line in Prolog true, as a table of its variables; yes or no where it has none."""
    columns = tuple(rows[0]) if rows else ()
    cells = [tuple(_cell(row[name], bodies) for name in columns) for row in rows]
    return AnswerTable(
        title=title,
        columns=columns,
        rows=tuple(cells) if columns else (),
        ids=tuple(map(_row_id, cells)) if columns else (),
        total=len(rows),
        boolean=None if columns else bool(rows),
    )


def _columns(kb: KnowledgeBase, answers: Answers[Any], individual: str | None) -> list[str]:
    """What was asked for first; without what was given, and the map where there is only one: they are all the same."""
    named = answers.question.columns
    same = {*answers.args, *(name for name, kind in named.items() if kind is EntityType.MAP and len(kb.maps()) == 1)}
    columns = [name for name in named if name != individual and name not in same]
    return [individual, *columns] if individual else columns or list(named)


def sparql_table(found: SparqlResult, bodies: Mapping[str, BodyId], *, title: str) -> AnswerTable:
    """What a SPARQL query found, as a table."""
    rows = [tuple(_term_cell(term, bodies) for term in row) for row in found.rows[:MAX_ROWS]]
    ids = tuple(map(_row_id, rows))
    total = len(found.rows)
    return AnswerTable(
        title=title, columns=found.columns, rows=tuple(rows), ids=ids, total=total, boolean=found.boolean
    )


def _cell(value: object, bodies: Mapping[str, BodyId]) -> TableCell:
    if isinstance(value, str) and "://" in value:
        return TableCell(local_name(value), value, bodies.get(value, ""))
    return TableCell(cell_text(tuple(value) if isinstance(value, list) else value))


def _term_cell(term: RdfTerm | None, bodies: Mapping[str, BodyId]) -> TableCell:
    if term is None:
        return TableCell(None)
    if term.kind == "iri":
        return TableCell(local_name(term.value) or term.value, term.value, bodies.get(term.value, ""))
    return TableCell(f"_:{term.value}" if term.kind == "blank" else term.value)


def _row_id(cells: Sequence[TableCell] | Iterable[TableCell]) -> str:
    return next((cell.id for cell in cells if cell.id), "")
