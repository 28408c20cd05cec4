"""Asking: what visitors ask, what lights up because of it, and what they tell.

The forms are made from the questions' declarations; nothing here knows a question's name. A question takes its time in
a thread of its own, a query in a process of its own, and both have an end: neither the world nor the page waits.

Answering: answers as tables for the page, in which each row knows its body.

Lines: what a visitor asks in Prolog, where that is installed.

A visitor's line can ask the questions and join their answers, and no more: each goal in it is held against a list
before anything runs (`prolog/line_queries.pl`).

Wishes: what a page may ask the Ask desk for, as it stands on the wire; what is not in here is refused.
"""

from __future__ import annotations

import shutil
import threading
from collections import OrderedDict
from collections.abc import Iterable, Mapping, Sequence
from functools import cache, partial
from importlib.util import find_spec
from itertools import count
from typing import Any

import msgspec

from mindstage.errors import InvalidArgumentError
from mindstage.knowledge import KnowledgeBase, RdfTerm, SparqlResult
from mindstage.knowledge.names import EntityType, compact_iri
from mindstage.knowledge.queries import Answers, Question, cell_text, get_question, list_questions, subject_column
from mindstage.knowledge.rdf import local_name
from mindstage.knowledge.tell import parse_value
from mindstage.scene import BodyId
from mindstage.scene.colors import hex_color, parse_color
from mindstage.simulation import Simulation, StateSnapshot
from mindstage.viewer.server import BoundedExecutor, ClientSession, EmptyRequest, RpcChannel

__all__ = [
    "MAX_ROWS",
    "AnswerTable",
    "AskHandler",
    "AskRequest",
    "ClearHighlightRequest",
    "CompleteNameRequest",
    "ExplainRequest",
    "HighlightAnswersRequest",
    "MissingFact",
    "PrologRequest",
    "QuestionForm",
    "SparqlRequest",
    "TableCell",
    "TellRequest",
    "answer_table",
    "has_prolog",
    "prolog_table",
    "question_form",
    "solve_line",
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


_prolog_lock = threading.Lock()
"""There is one Prolog in a process; visitors take turns."""


@cache
def has_prolog() -> bool:
    """Whether SWI-Prolog and its bridge to Python are installed; nothing is started to find out."""
    return find_spec("pyswip") is not None and shutil.which("swipl") is not None


def solve_line(simulation: Simulation, line: str, *, limit: int, timeout_s: float) -> list[dict[str, Any]]:
    """What makes a line true: its variables and what they stand for.

    Raises:
        PrologUnavailableError: it is not installed, or somebody else in this process has it.
        PrologGoalError: it is no Prolog, or more than a question.
        PrologTimeoutError: it did not end in time.
    """
    from mindstage.prolog import PrologConsole

    with _prolog_lock, PrologConsole(simulation) as console:
        return console.answers(line, limit=limit, timeout_s=timeout_s)


class AskRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A declared question; what is left out of `args` is asked for."""

    question: str
    args: dict[str, str] = {}


class SparqlRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A query in SPARQL."""

    query: str


class PrologRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Questions joined in Prolog."""

    line: str


class CompleteNameRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The beginning of a name."""

    prefix: str
    kind: str = ""
    """Such as CLASS; any if empty."""
    limit: int = 20


class HighlightAnswersRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Answers that shall be lit up: all of them, or some rows."""

    key: int
    color: str
    rows: tuple[int, ...] | None = None
    replace: bool = True


class ExplainRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """An answer that shall be explained."""

    key: int
    row: int


class TellRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A statement to be added, or taken back."""

    subject: str
    property: str
    value: str
    retract: bool = False


class ClearHighlightRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What is lit for a reason; everything without one."""

    label: str | None = None


_MAX_KEPT_ANSWERS = 8
"""So many of each visitor's last answers can be asked about."""
_QUERY_TIMEOUT_S = 20.0
_PROLOG_TIMEOUT_S = 10.0
_MAX_NAMES = 50
_MAX_TEXT_LENGTH = 20_000
_MAX_LABEL_LENGTH = 60


class _KeptAnswers(msgspec.Struct, frozen=True):
    """Answers as a page got them, and as they are."""

    table: AnswerTable
    answers: Answers[Any] | None


class AskHandler:
    """Answers what pages ask, by the requests `ask.…`, and tells all what is lit by the topic `lit`."""

    def __init__(self, simulation: Simulation, channel: RpcChannel, *, timeout_s: float = 30.0) -> None:
        """Offers it all.

        Args:
            stage: who is asked.
            channel: to the pages.
            timeout_s: how long a question may take.
        """
        self._simulation, self._channel = simulation, channel
        self._executor = BoundedExecutor(timeout_s=timeout_s)
        self._keys = count(1)
        self._last_highlights: object = None
        self._bodies: tuple[int, Mapping[str, BodyId]] = (-1, {})
        channel.register("ask.questions", EmptyRequest, self._list, queue="ask.words")
        channel.register("ask.complete", CompleteNameRequest, self._complete, queue="ask.words")
        channel.register("ask", AskRequest, self._ask, queue="ask")
        channel.register("ask.sparql", SparqlRequest, self._query, queue="ask")
        channel.register("ask.prolog", PrologRequest, self._prolog_line, queue="ask")
        channel.register("ask.languages", EmptyRequest, self._capabilities, queue="ask.words")
        channel.register("ask.explain", ExplainRequest, self._explain, queue="ask")
        channel.register("ask.highlight", HighlightAnswersRequest, self._highlight, queue="ask")
        channel.register("ask.clear_highlights", ClearHighlightRequest, self._clear_highlight, queue="ask.words")
        channel.register("ask.tell", TellRequest, self._change_assertion, queue="ask")

    def publish(self, frame: StateSnapshot) -> None:
        """Publishes what is lit, if that has changed."""
        if frame.highlight_groups is not self._last_highlights:
            self._last_highlights = frame.highlight_groups
            groups = [
                {"label": group.label, "color": hex_color(group.color), "ids": group.ids, "question": group.question}
                for group in frame.highlight_groups
            ]
            self._channel.publish("highlights", groups)

    # -- words ---------------------------------------------------------------------------------------------------------

    def _list(self, _: ClientSession, __: EmptyRequest) -> list[QuestionForm]:
        return [question_form(each) for each in list_questions()]

    def _complete(self, _: ClientSession, request: CompleteNameRequest) -> list[dict[str, str]]:
        """Names that begin so, each with its class where it is an individual."""
        return self._executor.run(partial(self._names, request), label="the list of names")

    def _names(self, request: CompleteNameRequest) -> list[dict[str, str]]:
        kb = self._simulation.knowledge
        found: list[dict[str, str]] = []
        with kb.lock:
            for kind in _kinds(request.kind):
                for name, iri in kb.names.complete(request.prefix, kind, limit=min(request.limit, _MAX_NAMES)):
                    cls = kb.reasoner.class_of(iri) if kind is EntityType.INDIVIDUAL else None
                    description = local_name(cls) if cls else kind.value
                    found.append({"name": name, "iri": iri, "description": description})
        return found

    # -- questions -----------------------------------------------------------------------------------------------------

    def _ask(self, visitor: ClientSession, request: AskRequest) -> AnswerTable:
        asked = get_question(request.question)
        args = {name: value for name, value in request.args.items() if value.strip()}
        title = " ".join([asked.name, *(f"{name}={value}" for name, value in args.items())])

        def answer() -> _KeptAnswers:
            answers = self._simulation.ask(asked, **_checked_args(args))
            with self._simulation.knowledge.lock:
                table = answer_table(self._simulation.knowledge, answers, self._body_by_iri(), title=title)
            return _KeptAnswers(table, answers)

        return self._remember(visitor, self._executor.run(answer, label=f"the question {title!r}"))

    def _query(self, visitor: ClientSession, request: SparqlRequest) -> AnswerTable:
        if len(request.query) > _MAX_TEXT_LENGTH:
            raise InvalidArgumentError(
                "a query", cause=f"it has more than {_MAX_TEXT_LENGTH} letters", remedy="ask for less"
            )

        def answer() -> _KeptAnswers:
            found = self._simulation.knowledge.sparql(request.query, timeout_s=_QUERY_TIMEOUT_S)
            return _KeptAnswers(sparql_table(found, self._body_by_iri(), title=_title(request.query)), None)

        return self._remember(visitor, self._executor.run(answer, label="the query"))

    def _prolog_line(self, visitor: ClientSession, request: PrologRequest) -> AnswerTable:
        def answer() -> _KeptAnswers:
            rows = solve_line(self._simulation, request.line, limit=MAX_ROWS, timeout_s=_PROLOG_TIMEOUT_S)
            return _KeptAnswers(prolog_table(rows, self._body_by_iri(), title=_title(request.line)), None)

        return self._remember(visitor, self._executor.run(answer, label="the line"))

    def _capabilities(self, _: ClientSession, __: EmptyRequest) -> dict[str, bool]:
        """What a page may ask in."""
        return {"prolog": has_prolog()}

    def _explain(self, visitor: ClientSession, request: ExplainRequest) -> tuple[str, ...]:
        told = _kept_answers(visitor, request.key)
        if told.answers is None:
            return ()
        row = told.answers[_row(request.row, told.table)]
        question = told.answers.question
        return self._executor.run(partial(self._simulation.knowledge.explain, question, row), label="the reason")

    # -- lights --------------------------------------------------------------------------------------------------------

    def _highlight(self, visitor: ClientSession, request: HighlightAnswersRequest) -> dict[str, object]:
        """Lights answers up; says what has no body, and why."""
        told, color = _kept_answers(visitor, request.key), parse_color(request.color)
        table = told.table
        if request.rows is None and told.answers is not None:
            shown = self._simulation.highlight(told.answers, color, label=table.title, replace=request.replace)
        else:
            rows = range(len(table.rows)) if request.rows is None else [_row(row, table) for row in request.rows]
            ids = dict.fromkeys(table.ids[row] for row in rows if table.ids[row])
            shown = self._simulation.highlight(ids, color, label=table.title, replace=request.replace, missing_ok=True)
        return {"highlighted": shown.highlighted, "not_highlighted": shown.unhighlighted}

    def _clear_highlight(self, _: ClientSession, request: ClearHighlightRequest) -> None:
        if request.label is None:
            self._simulation.clear_highlights()
            return
        ids = [
            id for group in self._simulation.state.highlight_groups if group.label == request.label for id in group.ids
        ]
        self._simulation.highlight(ids, None)

    # -- telling -------------------------------------------------------------------------------------------------------

    def _change_assertion(self, _: ClientSession, request: TellRequest) -> bool:
        """Adds a statement, or takes it back; whether that changed anything."""
        kb, value = self._simulation.knowledge, parse_value(request.value.strip())
        act = kb.retract if request.retract else kb.tell
        work = partial(act, request.subject.strip(), request.property.strip(), value)
        done = self._executor.run(work, label="what was told")
        if done:
            words = "retracted" if request.retract else "asserted"
            text = f"{words}: {request.subject} {request.property} {request.value}"
            self._channel.broadcast("toast", {"text": text, "kind": "info"})
        return done

    # -- inside --------------------------------------------------------------------------------------------------------

    def _body_by_iri(self) -> Mapping[str, BodyId]:
        """The bodies that stand in the world now, by IRI."""
        edition = self._simulation.state.revision
        if self._bodies[0] != edition:
            self._bodies = (edition, {str(body.iri): body.id for body in self._simulation.snapshot().bodies})
        return self._bodies[1]

    def _remember(self, visitor: ClientSession, told: _KeptAnswers) -> AnswerTable:
        table = msgspec.structs.replace(told.table, key=next(self._keys))
        kept: OrderedDict[int, _KeptAnswers] = visitor.state.setdefault("asked", OrderedDict())
        kept[table.key] = _KeptAnswers(table, told.answers)
        while len(kept) > _MAX_KEPT_ANSWERS:
            kept.popitem(last=False)
        return table


def _title(text: str) -> str:
    words = " ".join(text.split())
    return words if len(words) <= _MAX_LABEL_LENGTH else f"{words[: _MAX_LABEL_LENGTH - 1]}…"


def _kinds(name: str) -> tuple[EntityType, ...]:
    if not name or name == EntityType.VALUE.name:
        return (EntityType.CLASS, EntityType.INDIVIDUAL)
    try:
        return (EntityType[name],)
    except KeyError:
        known = ", ".join(kind.name for kind in EntityType)
        raise InvalidArgumentError("kind", cause=f"{name!r} is no kind of name", remedy=f"there is {known}") from None


def _kept_answers(visitor: ClientSession, key: int) -> _KeptAnswers:
    told: _KeptAnswers | None = visitor.state.get("asked", {}).get(key)
    if told is None:
        remedy = "ask again"
        raise InvalidArgumentError("these answers", cause="they are not kept any more", remedy=remedy)
    return told


def _row(row: int, table: AnswerTable) -> int:
    if not 0 <= row < len(table.rows):
        cause, remedy = f"there is none with the number {row}", f"there are {len(table.rows)}, from 0"
        raise InvalidArgumentError("a row", cause=cause, remedy=remedy)
    return row


def _checked_args(args: Mapping[str, str]) -> Mapping[str, str]:
    """What may be handed on by name.

    Raises:
        InvalidArgumentError: no question is asked about it.
    """
    for name in args.keys() & {"question", "self"}:
        raise InvalidArgumentError(name, cause="no question is asked about that", remedy="leave it out")
    return args
