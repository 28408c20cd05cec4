"""Questions about other times than the present: any question about the state is asked about the state of that time.

At one time, a question is given the state of an episode instead of the present one. In an interval it is asked about
each state, and every answer gets the intervals in which it is one.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from functools import cache
from typing import Any, Protocol, cast

import msgspec

from mindstage.errors import (
    AmbiguousNameError,
    EpisodeError,
    InvalidArgumentError,
    NameNotFoundError,
    QuestionNotFoundError,
)
from mindstage.knowledge.history import EpisodeSource, History, QuestionTime, histories_of
from mindstage.knowledge.questions import (
    AnswerRow,
    Answers,
    MissingKnowledge,
    Question,
    QuestionContext,
    StateAccess,
    get_question,
)

__all__ = [
    "EpisodeAdapter",
    "argument_names",
    "ask_over_time",
    "episode_source",
    "recorded_so_far",
    "register_episode_adapter",
    "state_of_time",
]

_SHOWN_EPISODES = 5
Interval = tuple[float, float]


def argument_names(question: Question[Any] | str) -> frozenset[str]:
    """The arguments of a question; none of a sentence or an unknown name, which are refused elsewhere."""
    if isinstance(question, str):
        if not question.replace("-", "_").isidentifier():
            return frozenset()
        try:
            question = get_question(question)
        except QuestionNotFoundError:
            return frozenset()
    return frozenset(argument.name for argument in question.arguments)


class EpisodeAdapter(Protocol):
    """Makes recordings usable for questions; the package of recordings registers it, which is above this one."""

    def episode_source(self, episode: object, name: str | None) -> EpisodeSource:
        """See `episode_source`."""

    def recorded_so_far(self, recorder: Any) -> AbstractContextManager[tuple[EpisodeSource, ...]]:
        """See `recorded_so_far`."""


_adapters: list[Callable[[], EpisodeAdapter]] = []


def register_episode_adapter(adapter: Callable[[], EpisodeAdapter]) -> None:
    """Registers a function that returns the adapter, called when it is needed."""
    _adapters[:] = [adapter]


def episode_source(episode: object, name: str | None = None) -> EpisodeSource:
    """Makes a recording usable for questions; see `KnowledgeBase.add_episode`.

    Raises:
        InvalidArgumentError: it is no recording.
    """
    if not _adapters:
        remedy = "give a Recording, such as Episode('run.mcap')"
        raise InvalidArgumentError("the episode", cause=f"{type(episode).__name__} is no recording", remedy=remedy)
    return _adapters[0]().episode_source(episode, name)


def recorded_so_far(recorder: object | None) -> AbstractContextManager[tuple[EpisodeSource, ...]]:
    """What a `Recorder` has recorded, as an episode; empty if it is None or does not record any more."""
    return nullcontext(()) if recorder is None else _adapters[0]().recorded_so_far(recorder)


def ask_over_time(
    kb: QuestionContext,
    question: Question[Any],
    args: Mapping[str, object],
    *,
    time: QuestionTime,
    episodes: Sequence[EpisodeSource],
    notes: Iterable[str] = (),
) -> Answers[Any]:
    """All answers to a question that is about another time than the present.

    Args:
        kb: the knowledge base.
        args: its arguments.
        time: a time, an interval, or only an episode: then a question about the state is about its end.
        episodes: the episodes that may be asked about.
        notes: how the question was understood.

    Raises:
        EpisodeError: there is no episode, or several at one time.
        EpisodeTimeError: the episode has no state at that time.
        InvalidArgumentError: see `Question.ask`, or no episode has that name.
        NameNotFoundError: see `Question.ask`.
        AmbiguousNameError: see `Question.ask`.
    """
    if question.about_past:
        return question.ask(kb, args, present=StateAccess(kb, episodes=episodes, time=time), notes=notes)
    if not question.uses_current_state:
        note = f"{question.name} has the same answers at any time"
        return question.ask(kb, args, notes=(*notes, note))
    if time.is_span:
        return _ask_in_span(kb, question, args, time, histories_of(_some(episodes), time.episode), tuple(notes))
    return question.ask(kb, args, present=state_of_time(kb, time, episodes), notes=notes)


def state_of_time(kb: QuestionContext, time: QuestionTime, episodes: Sequence[EpisodeSource]) -> StateAccess:
    """Access to the state at one time of an episode; without a time, to that at its end.

    Raises:
        EpisodeError: there is no episode, or there are several and none is named.
        EpisodeTimeError: the episode has no state at that time.
        InvalidArgumentError: no episode has that name.
    """
    names = [name for source in _some(episodes) for name in source.names()]
    if time.episode is None and len(names) > 1:
        shown = ", ".join(names[:_SHOWN_EPISODES]) + (", …" if names[_SHOWN_EPISODES:] else "")
        raise EpisodeError(f"there are {len(names)} episodes ({shown}); name the one that the question is about")
    (history, *_) = histories_of(episodes, time.episode)
    at = history.end_s if time.at_s is None else time.at_s
    return StateAccess(kb, lambda: history.state_at(at), episodes=episodes, time=time, past=(history, at))


def _some(episodes: Sequence[EpisodeSource]) -> Sequence[EpisodeSource]:
    if not any(source.names() for source in episodes):
        raise EpisodeError("there is no episode to ask about; add one with add_episode, or with --episode FILE")
    return episodes


# -- intervals -------------------------------------------------------------------------------------------------------


def _ask_in_span(
    kb: QuestionContext,
    question: Question[Any],
    args: Mapping[str, object],
    time: QuestionTime,
    histories: Sequence[History],
    notes: tuple[str, ...],
) -> Answers[Any]:
    """The answers in each state of an interval, with the maximal intervals in which they are answers."""
    over_time = _interval_row(cast("Any", question.row))
    rows: list[tuple[float, int, AnswerRow]] = []
    last: Answers[Any] | None = None
    unknown: NameNotFoundError | AmbiguousNameError | None = None
    for history in histories:
        span = time.span_in(history)
        if span is None:
            continue
        found: dict[Hashable, list[tuple[AnswerRow, Interval]]] = {}
        for begin, end, present in _moments(kb, history, span, time):
            try:
                last = question.ask(kb, args, present=present, notes=notes)
            except (NameNotFoundError, AmbiguousNameError) as error:  # a body that exists at some times only
                unknown = error
                continue
            if last.is_concluded:
                cause = "what it amounts to is a yes, a no or a number at one time"
                raise InvalidArgumentError(
                    "a sentence", cause=cause, remedy="give a time (at), or ask a question by name"
                )
            for row in last:
                same = found.setdefault(_identity(row, ignores_numbers=question.is_relation), [])
                if same and same[-1][1][1] == begin:
                    same[-1] = (same[-1][0], (same[-1][1][0], end))
                else:
                    same.append((row, (begin, end)))
        for each in found.values():
            for row, (begin, end) in each:
                fields = {name: getattr(row, name) for name in row.__struct_fields__}
                rows.append((begin, len(rows), over_time(**fields, begin=begin, end=end, episode=history.name)))
    if last is None:
        if unknown is not None:
            raise unknown
        lasts = ", ".join(f"{each.name} lasts from {each.begin_s:g} to {each.end_s:g} s" for each in histories[:3])
        raise EpisodeError(f"no episode has a state in that interval: {lasts}")
    missing: Sequence[MissingKnowledge] = () if rows else last.missing
    return Answers(
        question.over_time(over_time),
        last.args,
        [row for _, _, row in sorted(rows, key=lambda each: each[:2])],
        missing,
        kb=kb,
        classes=last.classes,
        notes=last.notes,
    )


def _moments(
    kb: QuestionContext, history: History, span: Interval, time: QuestionTime
) -> Iterator[tuple[float, float, StateAccess]]:
    """The begin and end of each state, and access to it; the last one ends with the interval."""
    before: tuple[float, StateAccess] | None = None
    for begin, state in history.states(*span):
        if before is not None:
            yield before[0], begin, before[1]
        access = StateAccess(kb, lambda state=state: state, time=time, past=(history, begin))  # type: ignore[misc]
        before = (begin, access)
    if before is not None:
        yield before[0], span[1], before[1]


def _identity(row: AnswerRow, *, ignores_numbers: bool) -> Hashable:
    """What makes two rows the same answer: of a relation, everything but its measured numbers."""
    values = ((name, getattr(row, name)) for name in row.__struct_fields__)
    return tuple(value for _, value in values if not (ignores_numbers and isinstance(value, float)))


@cache
def _interval_row(row: type[AnswerRow]) -> type[AnswerRow]:
    """The type of the answers of another type in an interval: with begin [s], end [s] and the episode."""
    return msgspec.defstruct(  # type: ignore[return-value]
        row.__name__,
        [("begin", float), ("end", float), ("episode", str)],
        bases=(row,),
        module=row.__module__,
        namespace={"__doc__": row.__doc__},
        frozen=True,
        kw_only=True,
        dict=True,
    )
