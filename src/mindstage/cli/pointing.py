"""Pointing: what somebody means by a question, by ids or by a class, lit up on a stage."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mindstage.cli.ask import named_args
from mindstage.errors import NameNotFoundError

if TYPE_CHECKING:
    from mindstage.stage import HighlightResult, Simulation
    from mindstage.world import BodyId, Color, World

__all__ = ["HighlightTarget"]


@dataclass(frozen=True, slots=True)
class HighlightTarget:
    """Something to be lit in a color."""

    terms: tuple[str, ...]
    """A question and what it is asked about, or else ids and names of classes."""
    color: Color | None

    def apply(self, simulation: Simulation) -> HighlightResult:
        """Lights it up.

        Raises:
            NameNotFoundError: a word is neither a question, a body's id nor a class.
            InvalidArgumentError: the question is not asked about that.
        """
        from mindstage.knowledge.questions import get_question, list_questions

        first = self.terms[0].replace("-", "_")
        if first in {question.name for question in list_questions()}:
            question = get_question(first)
            answers = simulation.ask(question, **named_args(question, list(self.terms[1:])))
            return simulation.highlight(answers, self.color)
        world = simulation.snapshot()
        ids = dict.fromkeys(id for word in self.terms for id in _matching_bodies(simulation, world, word))
        return simulation.highlight(ids, self.color, label=" ".join(self.terms))


def _matching_bodies(simulation: Simulation, world: World, word: str) -> Iterator[BodyId]:
    """The body of that id, or all of that class."""
    from mindstage.knowledge.reasoning import EntityType

    ids = {body.id for body in world.bodies}
    if word in ids:
        yield from (id for id in ids if id == word)
        return
    knowledge = simulation.knowledge
    try:
        cls = knowledge.names.find(word, EntityType.CLASS)
    except NameNotFoundError as error:
        kind = "question, body or class"
        raise NameNotFoundError(word, entity_type=kind, known=(*ids, *knowledge.names.short_names())) from error
    yield from (body.id for body in world.bodies if knowledge.is_a(body.cls, cls))
