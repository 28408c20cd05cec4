"""Pointing: what somebody means by a question, by ids or by a class, lit up on a stage."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mindstage.cli.ask import named_args
from mindstage.errors import NameUnknown

if TYPE_CHECKING:
    from mindstage.stage import Shown, Stage
    from mindstage.world import BodyId, Colour, World

__all__ = ["Pointer"]


@dataclass(frozen=True, slots=True)
class Pointer:
    """Something to be lit in a colour."""

    words: tuple[str, ...]
    """A question and what it is asked about, or else ids and names of classes."""
    colour: Colour | None

    def show(self, stage: Stage) -> Shown:
        """Lights it up.

        Raises:
            NameUnknown: a word is neither a question, a body's id nor a class.
            ArgumentRefused: the question is not asked about that.
        """
        from mindstage.knowledge.questions import question_named, questions

        first = self.words[0].replace("-", "_")
        if first in {question.name for question in questions()}:
            question = question_named(first)
            answers = stage.ask(question, **named_args(question, list(self.words[1:])))
            return stage.highlight(answers, self.colour)
        world = stage.log()
        ids = dict.fromkeys(id for word in self.words for id in _meant(stage, world, word))
        return stage.highlight(ids, self.colour, label=" ".join(self.words))


def _meant(stage: Stage, world: World, word: str) -> Iterator[BodyId]:
    """The body of that id, or all of that class."""
    from mindstage.knowledge.reasoning import NameKind

    ids = {body.id for body in world.bodies}
    if word in ids:
        yield from (id for id in ids if id == word)
        return
    knowledge = stage.knowledge
    try:
        cls = knowledge.names.find(word, NameKind.CLASS)
    except NameUnknown as error:
        kind = "question, body or class"
        raise NameUnknown(word, kind=kind, known=(*ids, *knowledge.names.all())) from error
    yield from (body.id for body in world.bodies if knowledge.is_a(body.cls, cls))
