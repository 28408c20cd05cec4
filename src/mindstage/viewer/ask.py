"""Asking: what visitors ask, what lights up because of it, and what they tell.

The forms are made from the questions' declarations; nothing here knows a question's name. A question takes its time in
a thread of its own, a query in a process of its own, and both have an end: neither the world nor the page waits.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from functools import partial
from itertools import count
from typing import Any

import msgspec

from mindstage.errors import InvalidArgumentError
from mindstage.knowledge.names import local_name
from mindstage.knowledge.questions import Answers, get_question, list_questions
from mindstage.knowledge.reasoning import EntityType
from mindstage.knowledge.teaching import parse_value
from mindstage.stage import Simulation, StateSnapshot
from mindstage.viewport.answering import (
    MAX_ROWS,
    AnswerTable,
    QuestionForm,
    answer_table,
    prolog_table,
    question_form,
    sparql_table,
)
from mindstage.viewport.channel import RpcChannel
from mindstage.viewport.lines import has_prolog, solve_line
from mindstage.viewport.patience import BoundedExecutor
from mindstage.viewport.visitor import ClientSession
from mindstage.viewport.wishes import (
    AskRequest,
    ClearHighlightRequest,
    CompleteNameRequest,
    EmptyRequest,
    ExplainRequest,
    HighlightAnswersRequest,
    PrologRequest,
    SparqlRequest,
    TellRequest,
)
from mindstage.world import BodyId
from mindstage.world.colors import hex_color, parse_color

__all__ = ["AskHandler"]

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
