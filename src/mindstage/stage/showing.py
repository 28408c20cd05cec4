"""Showing: what a stage answers, and what it shows of the answers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, TypeVar, overload

from mindstage.engines.contract import Engine
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.moment import Moment, Present
from mindstage.knowledge.questions import Answers, Question, Row, question_named
from mindstage.stage.lights import Lights, Shown, wish_of
from mindstage.stage.markers import Marker, Markers
from mindstage.world import Colour
from mindstage.world.colours import color_from

__all__ = ["Showing"]

T = TypeVar("T")
R = TypeVar("R", bound=Row)


class Showing(ABC):
    """The part of a stage that asks, lights up and marks."""

    knowledge: KnowledgeBase
    _lights: Lights
    _markers: Markers

    @abstractmethod
    def call(
        self, function: Callable[[Engine], T], *, what: str = "", timeout_s: float | None = None, edits: bool = False
    ) -> T:
        """Runs any function on the engine in the stage's thread."""

    @abstractmethod
    def moment(self) -> Moment:
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
        asked = question_named(question) if isinstance(question, str) else question
        return asked.ask(self.knowledge, args, present=Present(self.knowledge, self.moment))

    def highlight(
        self,
        shown: str | Row | Answers[Any] | Iterable[str | Row],
        color: Colour | str | None,
        *,
        label: str = "",
        replace: bool = False,
        missing_ok: bool = False,
    ) -> Shown:
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
            BodyUnknown: for the first id that is not there, unless `missing_ok`; nothing changes then.
            ColourUnknown: the color is none.
        """
        wish = wish_of(shown, label)
        rgb = color_from(color)
        light = partial(self._lights.show, wish=wish, colour=rgb, replace=replace, strict=not missing_ok)
        return self.call(light, what="highlight", edits=True)

    def put_out(self) -> None:
        """Puts out everything that is lit."""
        self.call(lambda engine: engine.highlight(tuple(engine.highlights()), None), what="put out", edits=True)

    def mark(self, markers: Iterable[Marker], *, lifetime_s: float | None = None) -> None:
        """Shows markers, in the place of those of the same ids, for so long [s] or until they are taken away."""
        shown = tuple(markers)
        self.call(lambda _: self._markers.show(shown, lifetime_s=lifetime_s), what="mark")

    def unmark(self, ids: Iterable[str]) -> tuple[str, ...]:
        """Takes markers away; gives the ids of those that were there."""
        wanted = tuple(ids)
        return self.call(lambda _: self._markers.remove(wanted), what="unmark")
