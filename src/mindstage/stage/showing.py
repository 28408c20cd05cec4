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
from mindstage.world import BodyId, Colour

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

    def show(
        self,
        shown: Answers[Any] | Iterable[str],
        colour: Colour | None,
        *,
        label: str = "",
        replace: bool = False,
    ) -> Shown:
        """Lights up what a question was answered with, and remembers why.

        It adds to what is lit already; a body that is shown twice has the later colour, and showing something again
        for the same reason replaces what that lit before.

        Args:
            shown: answers, or ids or IRIs. Of answers it is what was asked for: the handle of a door that was given.
            colour: how to light it; None puts it out.
            label: the reason, in one line; by default the question.
            replace: whether all else goes out first.

        Returns:
            What is lit, and what has no body, with the reason.
        """
        wish = wish_of(shown, label)
        light = partial(self._lights.show, wish=wish, colour=colour, replace=replace)
        return self.call(light, what="show", edits=True)

    def highlight(self, ids: Iterable[BodyId], colour: Colour | None) -> None:
        """Lights bodies up, or puts them out (None); `show` also says why.

        Raises:
            BodyUnknown: for the first id that is not there; nothing changes then.
        """
        lit = tuple(ids)
        self.call(lambda engine: engine.highlight(lit, colour), what="highlight", edits=True)

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
