"""Showing: what a stage answers, and what it shows of the answers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, TypeVar, overload

from mindstage.engines.contract import Engine
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.moment import StateAccess, WorldState
from mindstage.knowledge.questions import AnswerRow, Answers, Question, get_question
from mindstage.stage.lights import HighlightResult, Highlights, highlight_request
from mindstage.stage.markers import Marker, MarkerStore
from mindstage.world import Color
from mindstage.world.colors import color_from

__all__ = ["Showing"]

T = TypeVar("T")
R = TypeVar("R", bound=AnswerRow)


class Showing(ABC):
    """The part of a stage that asks, lights up and marks."""

    knowledge: KnowledgeBase
    _highlights: Highlights
    _markers: MarkerStore

    @abstractmethod
    def run_on_engine(
        self, function: Callable[[Engine], T], *, label: str = "", timeout_s: float | None = None, edits: bool = False
    ) -> T:
        """Runs any function on the engine in the stage's thread."""

    @abstractmethod
    def current_state(self) -> WorldState:
        """The place as it is now."""

    # -- questions -----------------------------------------------------------------------------------------

    @overload
    def ask(self, question: Question[R], **args: object) -> Answers[R]: ...
    @overload
    def ask(self, question: str, **args: object) -> Answers[Any]: ...
    def ask(self, question: Question[Any] | str, **args: object) -> Answers[Any]:
        """All answers, for the place as it is now; see `KnowledgeBase.ask`.

        The engine is only asked by questions that look at the present, and once by each.
        """
        asked = get_question(question) if isinstance(question, str) else question
        return asked.ask(self.knowledge, args, present=StateAccess(self.knowledge, self.current_state))

    def highlight(
        self,
        shown: str | AnswerRow | Answers[Any] | Iterable[str | AnswerRow],
        color: Color | str | None,
        *,
        label: str = "",
        replace: bool = False,
        missing_ok: bool = False,
    ) -> HighlightResult:
        """Highlights bodies in a color, or removes their highlight.

        Highlights add up; a body that is highlighted twice has the later color, and highlighting something again with
        the same label replaces what was highlighted with it before. An IRI, or an answer, that has no body here is
        listed in the result with the reason.

        Args:
            shown: a body's id or IRI, an answer, several of these, or all answers to a question. Of answers it is what
                was asked for: the handle of a door that was given.
            color: a name ("green"), "#rrggbb", or red, green and blue from 0 to 1; None or "none" removes the
                highlight.
            label: the reason, in one line; of `Answers` by default the question.
            replace: whether all other highlights are removed first.
            missing_ok: whether an id that is not there is listed in the result, as an IRI is, instead of raising.

        Returns:
            What is highlighted, and what has no body, with the reason.

        Raises:
            BodyNotFoundError: for the first id that is not there, unless `missing_ok`; nothing changes then.
            InvalidColorError: the color is none.
        """
        wish = highlight_request(shown, label)
        rgb = color_from(color)
        light = partial(self._highlights.apply, request=wish, color=rgb, replace=replace, strict=not missing_ok)
        return self.run_on_engine(light, label="highlight", edits=True)

    def clear_highlights(self) -> None:
        """Puts out everything that is lit."""
        self.run_on_engine(
            lambda engine: engine.highlight(tuple(engine.highlights()), None), label="put out", edits=True
        )

    def add_markers(self, markers: Iterable[Marker], *, lifetime_s: float | None = None) -> None:
        """Shows markers, in the place of those of the same ids, for so long [s] or until they are taken away."""
        shown = tuple(markers)
        self.run_on_engine(lambda _: self._markers.add(shown, lifetime_s=lifetime_s), label="mark")

    def remove_markers(self, ids: Iterable[str]) -> tuple[str, ...]:
        """Takes markers away; gives the ids of those that were there."""
        wanted = tuple(ids)
        return self.run_on_engine(lambda _: self._markers.remove(wanted), label="unmark")
