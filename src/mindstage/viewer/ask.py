"""The Ask panel: questions, SPARQL and Prolog queries, their answers as tables, highlights, and assertions.

Forms are generated from the declarations of the questions. Every query runs outside the thread of the simulation and
has a timeout, so that neither the simulation nor other requests of the page wait for it. Questions wait in the queue of
the `QuestionPool` of the simulation; the topic `ask.place` has the place.
"""

from __future__ import annotations

import shutil
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from importlib.util import find_spec
from itertools import count
from typing import Any, Protocol

import msgspec

from mindstage.access.limits import (
    COMPLETIONS,
    KEPT_ANSWERS,
    LABEL_CHARACTERS,
    PROLOG_TIME,
    QUERY_CHARACTERS,
    QUERY_DEFAULT_TIME,
    ROWS,
)
from mindstage.access.policies import QUERY, READ
from mindstage.errors import InvalidArgumentError, PrologUnavailableError
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.names import EntityType, compact_iri
from mindstage.knowledge.queries import Answers, Question, cell_text, get_question, list_questions, subject_column
from mindstage.knowledge.sentences import is_sentence
from mindstage.knowledge.tell import parse_value
from mindstage.ranges import Count, Index
from mindstage.rdf import RdfTerm, SparqlResult
from mindstage.rdf.graphs import local_name
from mindstage.scene import BodyId
from mindstage.scene.colors import hex_color, parse_color
from mindstage.simulation import Simulation, StateSnapshot
from mindstage.simulation.question_pool import QuestionPool, WaitingQuestion
from mindstage.viewer.server import BoundedExecutor, ClientSession, EmptyRequest, Later, RpcChannel

__all__ = [
    "AnswerTable",
    "AskHandler",
    "AskRequest",
    "ClearHighlightRequest",
    "CompleteNameRequest",
    "ExplainRequest",
    "HighlightAnswersRequest",
    "MissingFact",
    "PrologRequest",
    "PrologSolutions",
    "PrologSolver",
    "QuestionForm",
    "SparqlRequest",
    "TableCell",
    "TellRequest",
    "answer_table",
    "prolog_table",
    "question_form",
    "sparql_table",
]


_CLASS_COLUMN_TITLE = "class of {}"


class TableCell(msgspec.Struct, frozen=True, omit_defaults=True):
    """One value of an answer, as it is displayed."""

    text: str | int | float | None
    iri: str = ""
    """The full IRI, if the value is one."""
    id: str = ""
    """The body of that IRI, if there is one."""


class MissingFact(msgspec.Struct, frozen=True, kw_only=True):
    """A missing fact, as an incomplete statement; the end that is unknown is empty."""

    subject: str
    property: str
    value: str
    reason: str


class AnswerTable(msgspec.Struct, frozen=True, kw_only=True):
    """The answers to a question or a query."""

    key: int = 0
    """Identifies these answers in later requests."""
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[TableCell, ...], ...]
    ids: tuple[str, ...]
    """The body of each row; empty if it has none."""
    total: int
    missing: tuple[MissingFact, ...] = ()
    explainable: bool = False
    """Whether rows can be explained."""
    boolean: bool | None = None
    """The answer to a yes-or-no query."""
    complete: bool = True
    """False if the search stopped at a limit, so that there may be more than `total`."""
    notes: tuple[str, ...] = ()
    """How a sentence or a name was understood."""


class _Parameter(msgspec.Struct, frozen=True):
    name: str
    kind: str
    choices: tuple[str, ...]
    completion: str
    """The kind of entity whose names are completed, such as CLASS; empty if values are not completed."""


class QuestionForm(msgspec.Struct, frozen=True, kw_only=True):
    """The description of a question from which the page generates a form."""

    name: str
    text: str
    arguments: tuple[_Parameter, ...]
    live: bool
    """Whether the answers depend on the current state of the simulation."""


def question_form(question: Question[Any]) -> QuestionForm:
    """Describes a question for its form."""
    arguments = (
        _Parameter(
            each.name,
            each.type_text,
            ("true", "false") if each.value_type is bool else each.choices,
            each.value_type.name if isinstance(each.value_type, EntityType) else "",
        )
        for each in question.arguments
    )
    return QuestionForm(
        name=question.name, text=question.text, arguments=tuple(arguments), live=question.uses_current_state
    )


def answer_table(kb: KnowledgeBase, answers: Answers[Any], bodies: Mapping[str, BodyId], *, title: str) -> AnswerTable:
    """Converts the answers of a declared question to a table.

    A column with the class of the individual is added, because many individuals have a number for a name.

    Args:
        kb: the knowledge base that was queried.
        bodies: ids of bodies by the IRI of the individual.
        title: the title of the table.
    """
    about = subject_column(answers)
    columns = _columns(kb, answers, about)
    shown = answers[: ROWS.count]
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
                subject="" if fact.is_filler else compact_iri(fact.cls),
                property=compact_iri(fact.property),
                value=compact_iri(fact.cls) if fact.is_filler else "",
                reason=fact.reason,
            )
            for fact in answers.missing
        ),
        explainable=answers.question.has_explanation,
        notes=(*answers.notes, answers.conclusion.sentence) if answers.notes else (),
    )


def prolog_table(rows: PrologSolutions, bodies: Mapping[str, BodyId], *, title: str) -> AnswerTable:
    """Converts the solutions of a Prolog query to a table of its variables, or to yes or no if it has none."""
    columns = tuple(next(iter(rows), {}))
    cells = [tuple(_cell(row[name], bodies) for name in columns) for row in rows]
    return AnswerTable(
        title=title,
        columns=columns,
        rows=tuple(cells) if columns else (),
        ids=tuple(map(_row_id, cells)) if columns else (),
        total=len(rows),
        boolean=None if columns else bool(rows),
        complete=rows.complete or not columns,
    )


def _columns(kb: KnowledgeBase, answers: Answers[Any], individual: str | None) -> list[str]:
    """The columns that are shown, the individual first; without arguments and a single map, which are constant."""
    all_columns = answers.question.columns
    constant = {*answers.args} - {*answers.classes}
    if len(kb.maps()) == 1:
        constant |= {name for name, kind in all_columns.items() if kind is EntityType.MAP}
    columns = [name for name in all_columns if name != individual and name not in constant]
    return [individual, *columns] if individual else columns or list(all_columns)


def sparql_table(result: SparqlResult, bodies: Mapping[str, BodyId], *, title: str) -> AnswerTable:
    """Converts the result of a SPARQL query to a table."""
    rows = [tuple(_term_cell(term, bodies) for term in row) for row in result.rows[: ROWS.count]]
    ids = tuple(map(_row_id, rows))
    total = len(result.rows)
    return AnswerTable(
        title=title, columns=result.columns, rows=tuple(rows), ids=ids, total=total, boolean=result.boolean
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


class PrologSolutions(Protocol):
    """The solutions of a Prolog query, as the values of its variables by name."""

    complete: bool
    """False if the search stopped at the limit."""

    def __len__(self) -> int: ...

    def __iter__(self) -> Iterator[Mapping[str, Any]]: ...


class PrologSolver(Protocol):
    """Solves Prolog queries of untrusted clients; `mindstage.prolog.solve_query` is one."""

    def __call__(self, simulation: Simulation, query: str, *, limit: int, timeout_s: float) -> PrologSolutions:
        """Returns the solutions of a query.

        Args:
            simulation: the simulation that is queried.
            query: the query, with or without the full stop.
            limit: the maximum number of solutions.
            timeout_s: the time limit [s].

        Raises:
            PrologUnavailableError: Prolog is not installed or in use.
            PrologGoalError: a syntax error, a goal that is not allowed, or an error in a goal.
            PrologTimeoutError: the time limit was exceeded.
        """


class AskRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Parameters of `ask`: a question, or a plain sentence. Arguments that `args` does not contain are unbound."""

    question: str
    args: dict[str, str] = {}


class SparqlRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Parameters of `ask.sparql`."""

    query: str


class PrologRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Parameters of `ask.prolog`: a query of declared questions."""

    line: str


class CompleteNameRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Parameters of `ask.complete`: the beginning of a name."""

    prefix: str
    kind: str = ""
    """A kind of entity, such as CLASS; classes and individuals if empty."""
    limit: Count = 20


class HighlightAnswersRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Parameters of `ask.highlight`: the answers to highlight, all or some rows."""

    key: Index
    color: str
    rows: tuple[Index, ...] | None = None
    replace: bool = True


class ExplainRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Parameters of `ask.explain`: the row to explain."""

    key: Index
    row: Index


class TellRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Parameters of `ask.tell`: a statement to add or to retract."""

    subject: str
    property: str
    value: str
    retract: bool = False


class ClearHighlightRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Parameters of `ask.clear_highlights`: the group to clear; all groups without a label."""

    label: str | None = None


_KEPT_KEY = "answers"
"""Key of the kept answers in a session's `state`."""


class _KeptAnswers(msgspec.Struct, frozen=True):
    """The table that was sent to a page, and the answers that it was made from."""

    table: AnswerTable
    answers: Answers[Any] | None


def _missing_prolog() -> str:
    """What keeps Prolog from being offered, and what to do."""
    missing = [
        text
        for text, is_there in (
            ("SWI-Prolog 9 (Debian: apt-get install swi-prolog-nox)", shutil.which("swipl") is not None),
            ("the extra prolog (pip install 'mindstage[prolog]')", find_spec("pyswip") is not None),
        )
        if not is_there
    ]
    if missing:
        return f"Prolog needs {' and '.join(missing)}. Install it and start the page again."
    return "This page was opened by a program that offers no Prolog; open it with mindstage.view or the command line."


class AskHandler:
    """Handles the requests `ask` and `ask.…`, and publishes the highlight groups as the topic `highlights`."""

    def __init__(
        self,
        simulation: Simulation,
        channel: RpcChannel,
        *,
        prolog: PrologSolver | None = None,
        timeout_s: float = 30.0,
        pool: QuestionPool | None = None,
    ) -> None:
        """Registers the requests.

        Args:
            simulation: the simulation that is queried.
            channel: the channel of the pages.
            prolog: solves Prolog queries; without it they are refused.
            timeout_s: the time limit of a question that imagines or is about the past, and of other queries [s].
            pool: answers all other questions; None for that of the simulation.
        """
        self._simulation, self._channel, self._prolog = simulation, channel, prolog
        self._executor = BoundedExecutor(timeout_s=timeout_s)
        self._pool = QuestionPool.of(simulation) if pool is None else pool
        self._waiting: dict[str, tuple[ClientSession, WaitingQuestion]] = {}
        """The question that each page waits for, by the key of its session; a page waits for one at a time."""
        self._keys = count(1)
        self._last_highlights: object = None
        self._bodies: tuple[int, Mapping[str, BodyId]] = (-1, {})
        channel.register("ask.questions", EmptyRequest, self._list, READ, queue="ask.words")
        channel.register("ask.complete", CompleteNameRequest, self._complete, READ, queue="ask.words")
        channel.register("ask", AskRequest, self._ask, QUERY, queue="ask")
        channel.register("ask.sparql", SparqlRequest, self._query, QUERY, queue="ask")
        channel.register("ask.prolog", PrologRequest, self._prolog_query, QUERY, queue="ask")
        channel.register("ask.languages", EmptyRequest, self._languages, READ, queue="ask.words")
        channel.register("ask.explain", ExplainRequest, self._explain, QUERY, queue="ask")
        channel.register("ask.highlight", HighlightAnswersRequest, self._highlight, QUERY, queue="ask")
        channel.register("ask.clear_highlights", ClearHighlightRequest, self._clear_highlight, READ, queue="ask.words")
        channel.register("ask.tell", TellRequest, self._change_assertion, QUERY, queue="ask")

    def publish(self, snapshot: StateSnapshot) -> None:
        """Publishes the highlight groups if they have changed, and to each page the place of its waiting question."""
        for session, asked in tuple(self._waiting.values()):
            place, waiting = self._pool.place(asked)
            if place:
                session.send_event("ask.place", {"place": place, "waiting": waiting})
        if snapshot.highlight_groups is not self._last_highlights:
            self._last_highlights = snapshot.highlight_groups
            groups = [
                {"label": group.label, "color": hex_color(group.color), "ids": group.ids, "question": group.question}
                for group in snapshot.highlight_groups
            ]
            self._channel.publish("highlights", groups)

    # -- forms ---------------------------------------------------------------------------------------------------------

    def _list(self, _: ClientSession, __: EmptyRequest) -> list[QuestionForm]:
        return [question_form(each) for each in list_questions()]

    def _complete(self, _: ClientSession, request: CompleteNameRequest) -> list[dict[str, str]]:
        """Names with a prefix; the description of an individual is its class."""
        return self._executor.run(partial(self._names, request), label="the completion")

    def _names(self, request: CompleteNameRequest) -> list[dict[str, str]]:
        kb = self._simulation.knowledge
        found: list[dict[str, str]] = []
        with kb.lock:
            for kind in _kinds(request.kind):
                for name, iri in kb.names.complete(request.prefix, kind, limit=min(request.limit, COMPLETIONS.count)):
                    cls = kb.reasoner.class_of(iri) if kind is EntityType.INDIVIDUAL else None
                    description = local_name(cls) if cls else kind.value
                    found.append({"name": name, "iri": iri, "description": description})
        return found

    # -- questions -----------------------------------------------------------------------------------------------------

    def _ask(self, session: ClientSession, request: AskRequest) -> AnswerTable | Later:
        question = request.question if is_sentence(request.question) else get_question(request.question).name
        args = {name: value for name, value in request.args.items() if value.strip()}
        title = _title(" ".join([question, *(f"{name}={value}" for name, value in args.items())]))

        def kept(answers: Answers[Any]) -> _KeptAnswers:
            with self._simulation.knowledge.lock:
                table = answer_table(self._simulation.knowledge, answers, self._body_by_iri(), title=title)
            return _KeptAnswers(table, answers)

        if not self._pool.accepts(question, args):
            work = partial(self._simulation.ask, question, **args)
            return self._remember(session, kept(self._executor.run(work, label=f"the question {title!r}")))
        asked = self._pool.submit(question, args, client=session.key, as_rows=True)
        self._waiting[session.key] = session, asked

        def finish() -> AnswerTable:
            self._waiting.pop(session.key, None)
            return self._remember(session, kept(asked.result.result().answers))

        return Later(asked.result, finish)

    def _query(self, session: ClientSession, request: SparqlRequest) -> AnswerTable:
        if len(request.query) > QUERY_CHARACTERS.count:
            raise InvalidArgumentError(
                "a query", cause=f"it has more than {QUERY_CHARACTERS.count} characters", remedy="shorten it"
            )

        def answer() -> _KeptAnswers:
            result = self._simulation.sparql(request.query, timeout_s=QUERY_DEFAULT_TIME.maximum)
            return _KeptAnswers(sparql_table(result, self._body_by_iri(), title=_title(request.query)), None)

        return self._remember(session, self._executor.run(answer, label="the query"))

    def _prolog_query(self, session: ClientSession, request: PrologRequest) -> AnswerTable:
        if (solve := self._prolog) is None:
            raise PrologUnavailableError("this page was opened without it")

        def answer() -> _KeptAnswers:
            rows = solve(self._simulation, request.line, limit=ROWS.count, timeout_s=PROLOG_TIME.maximum)
            return _KeptAnswers(prolog_table(rows, self._body_by_iri(), title=_title(request.line)), None)

        return self._remember(session, self._executor.run(answer, label="the query"))

    def _languages(self, _: ClientSession, __: EmptyRequest) -> dict[str, object]:
        """The query languages that are available besides forms and SPARQL."""
        missing = "" if self._prolog is not None else _missing_prolog()
        return {"prolog": self._prolog is not None, "prolog_missing": missing}

    def _explain(self, session: ClientSession, request: ExplainRequest) -> tuple[str, ...]:
        kept = _kept_answers(session, request.key)
        if kept.answers is None:
            return ()
        row = kept.answers[_checked_row(request.row, kept.table)]
        question = kept.answers.question
        return self._executor.run(partial(self._simulation.knowledge.explain, question, row), label="the explanation")

    # -- highlights ----------------------------------------------------------------------------------------------------

    def _highlight(self, session: ClientSession, request: HighlightAnswersRequest) -> dict[str, object]:
        """Highlights the bodies of answers; the result names those without a body, with the reason."""
        kept, color = _kept_answers(session, request.key), parse_color(request.color)
        table = kept.table
        if request.rows is None and kept.answers is not None:
            result = self._simulation.highlight(kept.answers, color, label=table.title, replace=request.replace)
        else:
            rows = (
                range(len(table.rows)) if request.rows is None else [_checked_row(row, table) for row in request.rows]
            )
            ids = dict.fromkeys(table.ids[row] for row in rows if table.ids[row])
            result = self._simulation.highlight(ids, color, label=table.title, replace=request.replace, missing_ok=True)
        return {"highlighted": result.highlighted, "not_highlighted": result.unhighlighted}

    def _clear_highlight(self, _: ClientSession, request: ClearHighlightRequest) -> None:
        if request.label is None:
            self._simulation.clear_highlights()
            return
        ids = [
            id for group in self._simulation.state.highlight_groups if group.label == request.label for id in group.ids
        ]
        self._simulation.highlight(ids, None)

    # -- assertions ----------------------------------------------------------------------------------------------------

    def _change_assertion(self, _: ClientSession, request: TellRequest) -> bool:
        """Adds or retracts a statement; returns whether that changed the knowledge base."""
        kb, value = self._simulation.knowledge, parse_value(request.value.strip())
        method = kb.retract if request.retract else kb.tell
        work = partial(method, request.subject.strip(), request.property.strip(), value)
        changed = self._executor.run(work, label="the assertion")
        if changed:
            verb = "retracted" if request.retract else "asserted"
            text = f"{verb}: {request.subject} {request.property} {request.value}"
            self._channel.broadcast("toast", {"text": text, "kind": "info"})
        return changed

    # -- internals -----------------------------------------------------------------------------------------------------

    def _body_by_iri(self) -> Mapping[str, BodyId]:
        """Ids of the current bodies by IRI."""
        revision = self._simulation.state.revision
        if self._bodies[0] != revision:
            self._bodies = (revision, {str(body.iri): body.id for body in self._simulation.snapshot().bodies})
        return self._bodies[1]

    def _remember(self, session: ClientSession, answered: _KeptAnswers) -> AnswerTable:
        table = msgspec.structs.replace(answered.table, key=next(self._keys))
        kept: OrderedDict[int, _KeptAnswers] = session.state.setdefault(_KEPT_KEY, OrderedDict())
        kept[table.key] = _KeptAnswers(table, answered.answers)
        while len(kept) > KEPT_ANSWERS.count:
            kept.popitem(last=False)
        return table


def _title(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= LABEL_CHARACTERS.count else f"{line[: LABEL_CHARACTERS.count - 1]}…"


def _kinds(name: str) -> tuple[EntityType, ...]:
    if not name or name == EntityType.VALUE.name:
        return (EntityType.CLASS, EntityType.INDIVIDUAL)
    try:
        return (EntityType[name],)
    except KeyError:
        known = ", ".join(kind.name for kind in EntityType)
        raise InvalidArgumentError(
            "kind", cause=f"{name!r} is not a kind of entity", remedy=f"the kinds are {known}"
        ) from None


def _kept_answers(session: ClientSession, key: int) -> _KeptAnswers:
    kept: _KeptAnswers | None = session.state.get(_KEPT_KEY, {}).get(key)
    if kept is None:
        remedy = "ask again"
        raise InvalidArgumentError("these answers", cause="they are not kept any more", remedy=remedy)
    return kept


def _checked_row(row: int, table: AnswerTable) -> int:
    if not 0 <= row < len(table.rows):
        cause, remedy = f"row {row} does not exist", f"there are {len(table.rows)}, counted from 0"
        raise InvalidArgumentError("a row", cause=cause, remedy=remedy)
    return row
