"""Asking: the declared questions as services: all of them by `/mindstage/ask`, and each by its own name.

Nothing here knows a question's name: they come from the registry.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import msgspec

from mindstage.errors import MessageRefused
from mindstage.knowledge.questions import answers_to_builtins, questions
from mindstage.msgs import mindstage_msgs as wire
from mindstage.ros.offer import ServiceOffer
from mindstage.stage import Stage

__all__ = ["Asking"]

_PLACE = "/mindstage"
_PATIENCE_S = 60.0


class Asking:
    """Asks a stage, for the place as it is now."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage

    def offers(self) -> Iterator[ServiceOffer]:
        """All services."""
        # Also below the namespace: where several stages join one hub, only one can have the plain names.
        for name in (f"{_PLACE}/ask", "mindstage/ask"):
            yield ServiceOffer(wire.Ask, self.ask, name=name, patience_s=_PATIENCE_S)
        for question in questions():
            name = f"{_PLACE}/{question.name}"
            yield ServiceOffer(wire.Ask, self._asking(question.name), name=name, patience_s=_PATIENCE_S)

    def ask(self, request: wire.Ask.Request) -> wire.Ask.Response:
        """Any question; no answer is no failure, and what is missing for one is told."""
        answers = self._stage.ask(request.question, **_arguments(request.args))
        told = answers_to_builtins(self._stage.knowledge, answers)
        return wire.Ask.Response(success=True, answers=msgspec.json.encode(told).decode())

    def _asking(self, name: str) -> Callable[[wire.Ask.Request], wire.Ask.Response]:
        """The service of one question; which one it is need not be said again."""

        def ask(request: wire.Ask.Request) -> wire.Ask.Response:
            if request.question.replace("-", "_") not in {"", name}:
                cause = f"this service asks {name}, not {request.question}"
                raise MessageRefused("mindstage_msgs/AskRequest", path="question", cause=cause, remedy="leave it empty")
            return self.ask(msgspec.structs.replace(request, question=name))

        return ask


def _arguments(text: str) -> dict[str, object]:
    """What is asked about, by name.

    Raises:
        MessageRefused: it is no JSON object.
    """
    try:
        args = msgspec.json.decode(text or "{}", type=dict[str, object])
    except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
        remedy = 'send an object in a string, such as {"item": "CowsMilk"}'
        raise MessageRefused("mindstage_msgs/AskRequest", path="args", cause=str(error), remedy=remedy) from error
    if "question" in args or "self" in args:
        raise MessageRefused("mindstage_msgs/AskRequest", path="args", cause="no question is asked about that")
    return args
