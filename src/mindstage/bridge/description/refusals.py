"""Refusals: how an error crosses the wire, so that it is the same error on the other side.

What the world refuses travels in a reply (`success: false`) as a `Refusal`. What breaks outside of it ends the call
itself (`result: false`), and all that rosbridge has for that is a text: its first line is for people, and a second one
holds the facts for us.
"""

from __future__ import annotations

from collections.abc import Callable

import msgspec

from mindstage.errors import (
    AttachmentRefused,
    BodyExists,
    BodyUnknown,
    EngineClosed,
    EngineError,
    EngineTimedOut,
    EngineUnable,
    EngineUnavailable,
    PoseUnreachable,
    SimulationUnstable,
    WorldError,
)
from mindstage.msgs import mindstage_msgs

__all__ = ["error_from_text", "error_text", "refusal", "world_error"]

WORLD_ERRORS: dict[str, Callable[[mindstage_msgs.Refusal], WorldError]] = {
    "BodyUnknown": lambda said: BodyUnknown(said.body, known=said.near, world=said.world),
    "BodyExists": lambda said: BodyExists(said.body),
    "PoseUnreachable": lambda said: PoseUnreachable(said.body, reason=said.reason),
    "AttachmentRefused": lambda said: AttachmentRefused(said.parent, said.child, reason=said.reason),
}
ENGINE_ERRORS: dict[str, type[EngineError]] = {
    cls.__name__: cls for cls in (EngineUnavailable, EngineTimedOut, EngineUnable, EngineClosed, SimulationUnstable)
}


def refusal(error: WorldError) -> mindstage_msgs.Refusal:
    """Why the world said no, for the wire."""
    facts = vars(error)
    said = {name: facts[name] for name in mindstage_msgs.Refusal.__struct_fields__ if name in facts}
    return mindstage_msgs.Refusal(kind=type(error).__name__, text=str(error), **said)


def world_error(said: mindstage_msgs.Refusal) -> WorldError:
    """The error that was refused with; of a kind that is not known here, its sentence."""
    made = WORLD_ERRORS.get(said.kind)
    return made(said) if made else WorldError(said.text)


def error_text(error: EngineError) -> str:
    """What broke, as the text that ends a call."""
    facts = {"kind": type(error).__name__, **vars(error)}
    return f"{error}\n{msgspec.json.encode(facts).decode()}"


def error_from_text(text: str) -> EngineError:
    """The error that ended a call over there; where the text is anybody's, an error that says the text."""
    sentence, _, facts = text.partition("\n")
    try:
        known = msgspec.json.decode(facts, type=dict[str, str | float])
        return ENGINE_ERRORS[str(known.pop("kind"))](**known)
    except (msgspec.MsgspecError, KeyError, TypeError):
        return EngineError(sentence)
