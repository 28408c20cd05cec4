"""Refusals: how an error crosses the wire, so that it is the same error on the other side.

What the world refuses travels in a reply (`success: false`) as a `Refusal`. What breaks outside of it ends the call
itself (`result: false`), and all that rosbridge has for that is a text: its first line is for people, and a second one
holds the facts for us.
"""

from __future__ import annotations

from collections.abc import Callable

import msgspec

from mindstage.errors import (
    AttachmentError,
    BodyExistsError,
    BodyNotFoundError,
    EngineClosedError,
    EngineError,
    EngineTimeoutError,
    EngineUnavailableError,
    PoseUnreachableError,
    SimulationDivergedError,
    UnsupportedByEngineError,
    WorldError,
)
from mindstage.msgs import mindstage_msgs

__all__ = ["error_from_text", "error_text", "error_to_message", "message_to_error"]

WORLD_ERROR_FACTORIES: dict[str, Callable[[mindstage_msgs.Refusal], WorldError]] = {
    "BodyUnknown": lambda said: BodyNotFoundError(said.body, known=said.near, world=said.world),
    "BodyExists": lambda said: BodyExistsError(said.body),
    "PoseUnreachable": lambda said: PoseUnreachableError(said.body, reason=said.reason),
    "AttachmentRefused": lambda said: AttachmentError(said.parent, said.child, reason=said.reason),
}
ENGINE_ERROR_TYPES: dict[str, type[EngineError]] = {
    cls.code: cls
    for cls in (
        EngineUnavailableError,
        EngineTimeoutError,
        UnsupportedByEngineError,
        EngineClosedError,
        SimulationDivergedError,
    )
}


def error_to_message(error: WorldError) -> mindstage_msgs.Refusal:
    """Why the world said no, for the wire."""
    facts = dict(vars(error))
    facts["near"] = facts.pop("suggestions", ())
    fields = {name: facts[name] for name in mindstage_msgs.Refusal.__struct_fields__ if name in facts}
    return mindstage_msgs.Refusal(kind=error.code, text=str(error), **fields)


def message_to_error(message: mindstage_msgs.Refusal) -> WorldError:
    """The error that was refused with; of a kind that is not known here, its sentence."""
    made = WORLD_ERROR_FACTORIES.get(message.kind)
    return made(message) if made else WorldError(message.text)


def error_text(error: EngineError) -> str:
    """What broke, as the text that ends a call."""
    facts = {"kind": error.code, **vars(error)}
    return f"{error}\n{msgspec.json.encode(facts).decode()}"


def error_from_text(text: str) -> EngineError:
    """The error that ended a call over there; where the text is anybody's, an error that says the text."""
    sentence, _, facts = text.partition("\n")
    try:
        known = msgspec.json.decode(facts, type=dict[str, str | float])
        return ENGINE_ERROR_TYPES[str(known.pop("kind"))](**known)
    except (msgspec.MsgspecError, KeyError, TypeError):
        return EngineError(sentence)
