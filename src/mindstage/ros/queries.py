"""Asking: the declared questions as services: all of them by `/mindstage/ask`, and each by its own name.

Nothing here knows a question's name: they come from the registry.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import msgspec

from mindstage.errors import MessageValidationError
from mindstage.knowledge.queries import answers_to_builtins, list_questions
from mindstage.msgs import mindstage_msgs as wire
from mindstage.ros.service import ServiceSpec
from mindstage.simulation import Simulation

__all__ = ["QuestionServices"]

_NAMESPACE = "/mindstage"
_TIMEOUT_S = 60.0


class QuestionServices:
    """Asks a stage, for the place as it is now."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation

    def services(self) -> Iterator[ServiceSpec]:
        """All services."""
        # Also below the namespace: where several stages join one hub, only one can have the plain names.
        for name in (f"{_NAMESPACE}/ask", "mindstage/ask"):
            yield ServiceSpec(wire.Ask, self.handle_ask, name=name, timeout_s=_TIMEOUT_S)
        for question in list_questions():
            name = f"{_NAMESPACE}/{question.name}"
            yield ServiceSpec(wire.Ask, self._question_handler(question.name), name=name, timeout_s=_TIMEOUT_S)

    def handle_ask(self, request: wire.Ask.Request) -> wire.Ask.Response:
        """Any question; no answer is no failure, and what is missing for one is told."""
        answers = self._simulation.ask(request.question, **_parse_arguments(request.args))
        told = answers_to_builtins(self._simulation.knowledge, answers)
        return wire.Ask.Response(success=True, answers=msgspec.json.encode(told).decode())

    def _question_handler(self, name: str) -> Callable[[wire.Ask.Request], wire.Ask.Response]:
        """The service of one question; which one it is need not be said again."""

        def ask(request: wire.Ask.Request) -> wire.Ask.Response:
            if request.question.replace("-", "_") not in {"", name}:
                cause = f"this service asks {name}, not {request.question}"
                raise MessageValidationError(
                    "mindstage_msgs/AskRequest", path="question", cause=cause, remedy="leave it empty"
                )
            return self.handle_ask(msgspec.structs.replace(request, question=name))

        return ask


def _parse_arguments(text: str) -> dict[str, object]:
    """What is asked about, by name.

    Raises:
        MessageValidationError: it is no JSON object.
    """
    try:
        args = msgspec.json.decode(text or "{}", type=dict[str, object])
    except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
        remedy = 'send an object in a string, such as {"item": "CowsMilk"}'
        raise MessageValidationError(
            "mindstage_msgs/AskRequest", path="args", cause=str(error), remedy=remedy
        ) from error
    if "question" in args or "self" in args:
        raise MessageValidationError("mindstage_msgs/AskRequest", path="args", cause="no question is asked about that")
    return args
