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

from mindstage.errors import ArgumentRefused
from mindstage.knowledge.names import local_name
from mindstage.knowledge.questions import Answers, question_named, questions
from mindstage.knowledge.reasoning import NameKind
from mindstage.knowledge.teaching import typed_value
from mindstage.stage import Frame, Stage
from mindstage.viewport.answering import MOST_ROWS, AnswerTable, Declared, declared, line_table, query_table, table_of
from mindstage.viewport.channel import Channel
from mindstage.viewport.lines import answers_to_line, has_prolog
from mindstage.viewport.patience import Patience
from mindstage.viewport.visitor import Visitor
from mindstage.viewport.wishes import Ask, Everything, Line, Names, PutOut, Query, Show, Tell, Why
from mindstage.world import BodyId
from mindstage.world.colours import colour_from, hex_text

__all__ = ["AskDesk"]

_KEPT = 8
"""So many of each visitor's last answers can be asked about."""
_QUERY_S = 20.0
_LINE_S = 10.0
_MOST_NAMES = 50
_MOST_LETTERS = 20_000
_LABEL = 60


class _Told(msgspec.Struct, frozen=True):
    """Answers as a page got them, and as they are."""

    table: AnswerTable
    answers: Answers[Any] | None


class AskDesk:
    """Answers what pages ask, by the requests `ask.…`, and tells all what is lit by the topic `lit`."""

    def __init__(self, stage: Stage, channel: Channel, *, timeout_s: float = 30.0) -> None:
        """Offers it all.

        Args:
            stage: who is asked.
            channel: to the pages.
            timeout_s: how long a question may take.
        """
        self._stage, self._channel = stage, channel
        self._patience = Patience(timeout_s=timeout_s)
        self._keys = count(1)
        self._lit: object = None
        self._bodies: tuple[int, Mapping[str, BodyId]] = (-1, {})
        channel.offer("ask.questions", Everything, self._list, lane="ask.words")
        channel.offer("ask.complete", Names, self._complete, lane="ask.words")
        channel.offer("ask", Ask, self._ask, lane="ask")
        channel.offer("ask.sparql", Query, self._query, lane="ask")
        channel.offer("ask.prolog", Line, self._line, lane="ask")
        channel.offer("ask.languages", Everything, self._ways, lane="ask.words")
        channel.offer("ask.explain", Why, self._why, lane="ask")
        channel.offer("ask.highlight", Show, self._show, lane="ask")
        channel.offer("ask.clear_highlights", PutOut, self._put_out, lane="ask.words")
        channel.offer("ask.tell", Tell, self._tell, lane="ask")

    def tell(self, frame: Frame) -> None:
        """Publishes what is lit, if that has changed."""
        if frame.lit is not self._lit:
            self._lit = frame.lit
            groups = [
                {"label": group.label, "color": hex_text(group.colour), "ids": group.ids, "question": group.question}
                for group in frame.lit
            ]
            self._channel.publish("highlights", groups)

    # -- words ---------------------------------------------------------------------------------------------------------

    def _list(self, _: Visitor, __: Everything) -> list[Declared]:
        return [declared(each) for each in questions()]

    def _complete(self, _: Visitor, wish: Names) -> list[dict[str, str]]:
        """Names that begin so, each with its class where it is an individual."""
        return self._patience.run(partial(self._names, wish), what="the list of names")

    def _names(self, wish: Names) -> list[dict[str, str]]:
        kb = self._stage.knowledge
        found: list[dict[str, str]] = []
        with kb.turn:
            for kind in _kinds(wish.kind):
                for name, iri in kb.names.like(wish.prefix, kind, most=min(wish.limit, _MOST_NAMES)):
                    cls = kb.index.class_of(iri) if kind is NameKind.INDIVIDUAL else None
                    description = local_name(cls) if cls else kind.value
                    found.append({"name": name, "iri": iri, "description": description})
        return found

    # -- questions -----------------------------------------------------------------------------------------------------

    def _ask(self, visitor: Visitor, wish: Ask) -> AnswerTable:
        asked = question_named(wish.question)
        args = {name: value for name, value in wish.args.items() if value.strip()}
        title = " ".join([asked.name, *(f"{name}={value}" for name, value in args.items())])

        def answer() -> _Told:
            answers = self._stage.ask(asked, **_checked(args))
            with self._stage.knowledge.turn:
                table = table_of(self._stage.knowledge, answers, self._by_iri(), title=title)
            return _Told(table, answers)

        return self._kept(visitor, self._patience.run(answer, what=f"the question {title!r}"))

    def _query(self, visitor: Visitor, wish: Query) -> AnswerTable:
        if len(wish.query) > _MOST_LETTERS:
            raise ArgumentRefused("a query", cause=f"it has more than {_MOST_LETTERS} letters", remedy="ask for less")

        def answer() -> _Told:
            found = self._stage.knowledge.sparql(wish.query, timeout_s=_QUERY_S)
            return _Told(query_table(found, self._by_iri(), title=_title(wish.query)), None)

        return self._kept(visitor, self._patience.run(answer, what="the query"))

    def _line(self, visitor: Visitor, wish: Line) -> AnswerTable:
        def answer() -> _Told:
            rows = answers_to_line(self._stage, wish.line, limit=MOST_ROWS, timeout_s=_LINE_S)
            return _Told(line_table(rows, self._by_iri(), title=_title(wish.line)), None)

        return self._kept(visitor, self._patience.run(answer, what="the line"))

    def _ways(self, _: Visitor, __: Everything) -> dict[str, bool]:
        """What a page may ask in."""
        return {"prolog": has_prolog()}

    def _why(self, visitor: Visitor, wish: Why) -> tuple[str, ...]:
        told = _told(visitor, wish.key)
        if told.answers is None:
            return ()
        row = told.answers[_row(wish.row, told.table)]
        question = told.answers.question
        return self._patience.run(partial(self._stage.knowledge.why, question, row), what="the reason")

    # -- lights --------------------------------------------------------------------------------------------------------

    def _show(self, visitor: Visitor, wish: Show) -> dict[str, object]:
        """Lights answers up; says what has no body, and why."""
        told, colour = _told(visitor, wish.key), colour_from(wish.color)
        table = told.table
        if wish.rows is None and told.answers is not None:
            shown = self._stage.highlight(told.answers, colour, label=table.title, replace=wish.replace)
        else:
            rows = range(len(table.rows)) if wish.rows is None else [_row(row, table) for row in wish.rows]
            ids = dict.fromkeys(table.ids[row] for row in rows if table.ids[row])
            shown = self._stage.highlight(ids, colour, label=table.title, replace=wish.replace, missing_ok=True)
        return {"highlighted": shown.lit, "not_highlighted": shown.not_lit}

    def _put_out(self, _: Visitor, wish: PutOut) -> None:
        if wish.label is None:
            self._stage.put_out()
            return
        ids = [id for group in self._stage.frame.lit if group.label == wish.label for id in group.ids]
        self._stage.highlight(ids, None)

    # -- telling -------------------------------------------------------------------------------------------------------

    def _tell(self, _: Visitor, wish: Tell) -> bool:
        """Adds a statement, or takes it back; whether that changed anything."""
        kb, value = self._stage.knowledge, typed_value(wish.value.strip())
        act = kb.retract if wish.retract else kb.tell
        work = partial(act, wish.subject.strip(), wish.property.strip(), value)
        done = self._patience.run(work, what="what was told")
        if done:
            words = "retracted" if wish.retract else "asserted"
            text = f"{words}: {wish.subject} {wish.property} {wish.value}"
            self._channel.announce("toast", {"text": text, "kind": "info"})
        return done

    # -- inside --------------------------------------------------------------------------------------------------------

    def _by_iri(self) -> Mapping[str, BodyId]:
        """The bodies that stand in the world now, by IRI."""
        edition = self._stage.frame.edition
        if self._bodies[0] != edition:
            self._bodies = (edition, {str(body.iri): body.id for body in self._stage.log().bodies})
        return self._bodies[1]

    def _kept(self, visitor: Visitor, told: _Told) -> AnswerTable:
        table = msgspec.structs.replace(told.table, key=next(self._keys))
        kept: OrderedDict[int, _Told] = visitor.state.setdefault("asked", OrderedDict())
        kept[table.key] = _Told(table, told.answers)
        while len(kept) > _KEPT:
            kept.popitem(last=False)
        return table


def _title(text: str) -> str:
    words = " ".join(text.split())
    return words if len(words) <= _LABEL else f"{words[: _LABEL - 1]}…"


def _kinds(name: str) -> tuple[NameKind, ...]:
    if not name or name == NameKind.VALUE.name:
        return (NameKind.CLASS, NameKind.INDIVIDUAL)
    try:
        return (NameKind[name],)
    except KeyError:
        known = ", ".join(kind.name for kind in NameKind)
        raise ArgumentRefused("kind", cause=f"{name!r} is no kind of name", remedy=f"there is {known}") from None


def _told(visitor: Visitor, key: int) -> _Told:
    told: _Told | None = visitor.state.get("asked", {}).get(key)
    if told is None:
        remedy = "ask again"
        raise ArgumentRefused("these answers", cause="they are not kept any more", remedy=remedy)
    return told


def _row(row: int, table: AnswerTable) -> int:
    if not 0 <= row < len(table.rows):
        cause, remedy = f"there is none with the number {row}", f"there are {len(table.rows)}, from 0"
        raise ArgumentRefused("a row", cause=cause, remedy=remedy)
    return row


def _checked(args: Mapping[str, str]) -> Mapping[str, str]:
    """What may be handed on by name.

    Raises:
        ArgumentRefused: no question is asked about it.
    """
    for name in args.keys() & {"question", "self"}:
        raise ArgumentRefused(name, cause="no question is asked about that", remedy="leave it out")
    return args
