"""Worlds: a world, or a part of one, as JSON, exact: every fact, every tag, every digit.

This is how mindstage_msgs carries them, since ROS has no word for a value that is not told and no place for a fact.
"""

from __future__ import annotations

from typing import Any, TypeVar

import msgspec

from mindstage.errors import MessageValidationError
from mindstage.msgs.base import to_python_number, validation_error_details
from mindstage.world import Iri, World

__all__ = ["from_json", "to_json", "world_from_json", "world_to_json"]

T = TypeVar("T")

FORMAT_VERSION = World(iri=Iri("")).format_version
"""What this version writes and reads."""


class FormatVersion(msgspec.Struct):
    """As much of a world as tells whether the rest can be read."""

    format_version: int


def world_to_json(world: World) -> str:
    """A world as JSON; `format_version` is always in it.

    Raises:
        MessageValidationError: it holds what JSON cannot, such as NaN.
    """
    try:
        told = {**msgspec.to_builtins(world, enc_hook=to_python_number), "format_version": world.format_version}
    except (TypeError, RecursionError) as error:
        raise MessageValidationError("a world", cause=str(error)) from error
    return to_json(told, World)


def world_from_json(text: str | bytes) -> World:
    """The world that `world_to_json` wrote.

    Raises:
        MessageValidationError: it is no such JSON, or that of another version.
    """
    version = from_json(text, FormatVersion).format_version
    if version != FORMAT_VERSION:
        raise MessageValidationError(
            "a world",
            path="format_version",
            cause=f"it is {version}, and this Mindstage reads {FORMAT_VERSION}",
            remedy="use the same version of Mindstage on both sides",
        )
    return from_json(text, World)


def to_json(value: object, type: Any = None) -> str:
    """A part of a world (`BodyPhysics`, a tuple of `Material`s) as JSON.

    Args:
        value: the part.
        type: how it will be read, where that is not its own type; a tuple's is `tuple[Material, ...]`.

    Raises:
        MessageValidationError: it holds what JSON cannot, such as NaN.
    """
    try:
        text = msgspec.json.encode(value, enc_hook=to_python_number).decode()
    except (TypeError, UnicodeError, RecursionError) as error:
        raise MessageValidationError(_type_name(type or value.__class__), cause=str(error)) from error
    # msgspec writes NaN and the infinities as null, and a null in the place of a number cannot be read: so read it.
    from_json(text, type or value.__class__)
    return text


def from_json(text: str | bytes, type: type[T]) -> T:
    """A part of a world from JSON.

    Raises:
        MessageValidationError: it is no JSON, or not of that type.
    """
    try:
        return msgspec.json.decode(text, type=type)
    except msgspec.ValidationError as error:
        cause, path = validation_error_details(error)
        raise MessageValidationError(_type_name(type), path=path, cause=cause) from error
    except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
        raise MessageValidationError(_type_name(type), cause=f"it is no JSON: {error}") from error


def _type_name(type: Any) -> str:
    return "a world" if type in {World, FormatVersion} else getattr(type, "__name__", str(type))
