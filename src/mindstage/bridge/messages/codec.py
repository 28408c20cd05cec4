"""Codec: between a message and the JSON object that it is on the wire, checked field by field.

Two ways to read, one to write:

- *lenient*, as rosbridge reads: what is left out has ROS's default.
- *strict*, as Unreal's plugin reads: every field must be there.
- Writing writes every field, and is held to the same types and ranges as reading.

Either way a wrong type, a number out of range, an unknown key or one key in two spellings is refused, with the path to
it: `constraints[3].constraint_details.linear_limits.limit: expected float, got str`. Both spellings of ROS 1 and ROS 2
are read; which one is written is the writer's choice.
"""

from __future__ import annotations

import re
from functools import cache
from typing import Any, TypeVar, cast

import msgspec

from mindstage.bridge.messages.causes import cause_and_path
from mindstage.bridge.messages.fields import Field, fields_of, struct_of, type_of
from mindstage.bridge.messages.message import Message, Ros
from mindstage.bridge.messages.naming import type_name
from mindstage.bridge.messages.primitives import plain
from mindstage.errors import MessageRefused, suggestion

__all__ = ["decode", "decode_arguments", "encode"]

M = TypeVar("M", bound=Message)
JsonObject = dict[str, Any]

MISSING = "it is missing"


def decode(cls: type[M], value: object, *, strict: bool = False) -> M:
    """Reads a JSON object as a message of that type.

    Args:
        cls: the type.
        value: what came, already parsed; byte strings, as CBOR has them, are understood too.
        strict: refuse what leaves a field out.

    Raises:
        MessageRefused: it is no such message.
    """
    if _renames(cls):
        value = _read_names(cls, value, "")
    try:
        message = msgspec.convert(value, cls)
    except msgspec.ValidationError as error:
        raise _refusal(cls, error) from error
    except (UnicodeError, RecursionError) as error:
        raise MessageRefused(type_name(cls), cause=str(error)) from error
    if strict and (path := _missing(cls, cast(JsonObject, value))):
        raise MessageRefused(type_name(cls), path=path, cause=MISSING, remedy="every field has to be there")
    return message


def decode_arguments(cls: type[M], args: object, *, strict: bool = False) -> M:
    """Reads what a service is called with: an object, the list of its fields in their order, or nothing at all.

    Args:
        cls: the request's type.
        args: what came.
        strict: refuse what leaves a field out.

    Raises:
        MessageRefused: it is no such request.
    """
    if isinstance(args, list | tuple):
        names = [field.name for field in fields_of(cls)]
        if len(args) > len(names):
            cause = f"{len(args)} arguments, and it has {len(names)} fields"
            raise MessageRefused(type_name(cls), cause=cause, remedy="send an object, with the names of the fields")
        args = dict(zip(names, args, strict=False))
    return decode(cls, {} if args is None else args, strict=strict)


def encode(message: Message, *, ros: Ros = Ros.TWO) -> JsonObject:
    """Writes a message as a JSON object, every field of it.

    Args:
        message: what to write.
        ros: whose names to write where they differ: `sec` or `secs`, a header with or without `seq`.

    Raises:
        MessageRefused: it holds what its type does not allow, such as NaN.
    """
    cls = type_of(message)
    try:
        written: JsonObject = msgspec.to_builtins(message, enc_hook=plain)
        msgspec.convert(written, cls)
    except msgspec.ValidationError as error:
        raise _refusal(cls, error) from error
    except TypeError as error:
        raise MessageRefused(type_name(cls), cause=str(error)) from error
    if _renames(cls):
        _write_names(cls, written, ros)
    return written


# -- names -------------------------------------------------------------------------------------------------------------


def _other_names(cls: type[Message]) -> dict[str, str]:
    """Other spelling to field."""
    return {**cls.spellings, **{other: name for name, other in cls.ros1_names.items()}}


@cache
def _renames(cls: Any) -> bool:
    """Whether the message, or one inside of it, has a field of several names, or one that not every ROS has."""
    struct = struct_of(cls)
    return bool(_other_names(struct) or struct.only_in or _renaming_parts(cls))


@cache
def _renaming_parts(cls: Any) -> tuple[Field, ...]:
    """The fields in whose messages there is something to rename."""
    return tuple(field for field in fields_of(cls) if field.message and _renames(field.message))


def _read_names(cls: Any, value: Any, path: str) -> Any:
    """A copy with every key as its field is called; what is no object is left for others to refuse."""
    if not isinstance(value, dict):
        return value
    names = _other_names(struct_of(cls))
    renamed = {names.get(key, key): part for key, part in value.items()}
    if len(renamed) != len(value):
        twice = next(key for key in value if key in names and names[key] in value)
        raise MessageRefused(type_name(cls), path=_joined(path, twice), cause=f"{names[twice]} stands there too")
    for field in _renaming_parts(cls):
        part, here = renamed.get(field.name), _joined(path, field.name)
        if field.length is None and part is not None:
            renamed[field.name] = _read_names(field.message, part, here)
        elif isinstance(part, list | tuple):
            renamed[field.name] = [_read_names(field.message, item, f"{here}[{at}]") for at, item in enumerate(part)]
    return renamed


def _write_names(cls: Any, value: JsonObject, ros: Ros) -> None:
    """Gives every key, in place, the name that this ROS has for it, and drops those that it has not."""
    struct = struct_of(cls)
    for field in _renaming_parts(cls):
        part = value[field.name]
        for item in (part,) if field.length is None else part:
            _write_names(field.message, item, ros)
    for name, only in struct.only_in.items():
        if only is not ros:
            del value[name]
    if ros is Ros.ONE:
        for name, other in struct.ros1_names.items():
            value[other] = value.pop(name)


# -- presence ----------------------------------------------------------------------------------------------------------


def _missing(cls: Any, value: JsonObject) -> str:
    """The path to the first field that is left out of an object, whose types are right; empty if none is."""
    may_lack = struct_of(cls).only_in
    for field in fields_of(cls):
        if field.name not in value:
            if field.name in may_lack:
                continue
            return field.name
        if field.message is None:
            continue
        part = value[field.name]
        for at, item in enumerate((part,) if field.length is None else part):
            if deeper := _missing(field.message, item):
                return f"{field.name}.{deeper}" if field.length is None else f"{field.name}[{at}].{deeper}"
    return ""


# -- what is wrong -----------------------------------------------------------------------------------------------------


def _refusal(cls: Any, error: Exception) -> MessageRefused:
    """What msgspec refused, with what there is in the place of it."""
    cause, path = cause_and_path(error)
    inner, field = _at(cls, path)
    remedy = ""
    if unknown := re.fullmatch(r"object contains unknown field (.*)", cause, re.DOTALL):
        known = [each.name for each in fields_of(inner)]
        remedy = suggestion(unknown[1], known, none="it has no fields")
        path, cause = _joined(path, unknown[1]), f"{type_name(inner)} has no such field"
    elif missing := re.fullmatch(r"object missing required field (.*)", cause):
        path, cause = _joined(path, missing[1]), MISSING
    elif field and field.codes and (code := re.fullmatch(r"invalid enum value (.*)", cause)):
        remedy = "there is " + ", ".join(f"{each.value} {name}" for name, each in field.codes.__members__.items())
        cause = f"{code[1]} is none of its codes"
    elif re.match(r"expected float [<>]=|number out of range", cause):
        cause = f"expected a finite {field.primitive if field else 'number'}, got NaN or one that is too large"
    return MessageRefused(type_name(cls), path=path, cause=cause, remedy=remedy)


def _at(cls: Any, path: str) -> tuple[Any, Field | None]:
    """The message and the field at a path; the field is None where a message as a whole stands."""
    field: Field | None = None
    for name in re.sub(r"\[[^\]]*\]", "", path).split(".") if path else ():
        field = next((each for each in fields_of(cls) if each.name == name), None)
        if field is None:
            break
        if field.message:
            cls, field = field.message, None
    return cls, field


def _joined(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name
