"""Fields: what a message is made of, read from its struct once and for all.

Everything that needs to know more of a type than msgspec does asks here: which keys must be there, how a field is
called in the other ROS, and what rosapi tells of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from functools import cache
from typing import Any, cast

from msgspec import inspect

from mindstage.msgs.message import Message
from mindstage.msgs.primitives import Int32Code, Uint8Code

__all__ = ["Field", "constants_of", "fields_of", "struct_of", "type_of"]


@dataclass(frozen=True, slots=True)
class Field:
    """One field of a message."""

    name: str
    primitive: str
    """Its type's name in ROS, such as `float64`; empty where it holds messages."""
    message: Any
    """The message that it holds, else None; typed loosely, since it may be a generic one with its argument."""
    length: int | None
    """None for one value, 0 for any number of them, else their number."""
    codes: type[IntEnum] | None
    """Its values, where they are a closed set."""


@cache
def fields_of(cls: Any) -> tuple[Field, ...]:
    """The fields of a message in their order."""
    info = cast(inspect.StructType, inspect.type_info(cls))
    return tuple(_field(field.encode_name, field.type) for field in info.fields)


def struct_of(cls: Any) -> type[Message]:
    """The class itself, without the argument of a generic one."""
    return cast(type[Message], getattr(cls, "__origin__", cls))


def type_of(message: Message) -> Any:
    """The type of a message, with the argument of a generic one, which is the type of its last field."""
    cls = type(message)
    if not getattr(cls, "__parameters__", ()):
        return cls
    return cast(Any, cls)[type(getattr(message, cls.__struct_fields__[-1]))]


def constants_of(cls: Any) -> Iterator[tuple[str, int]]:
    """The names and values of all codes that belong to a message."""
    named = [field.codes for field in fields_of(cls) if field.codes]
    for codes in dict.fromkeys([*named, *struct_of(cls).constants]):
        yield from ((name, code.value) for name, code in codes.__members__.items())


def _field(name: str, info: inspect.Type) -> Field:
    length: int | None = None
    if isinstance(info, inspect.VarTupleType):
        length = info.max_length or 0
        info = info.item_type
    ros = ""
    if isinstance(info, inspect.Metadata):
        ros, info = (info.extra or {}).get("ros", ""), info.type
    match info:
        case inspect.BytesType():
            return Field(name, ros, None, 0, None)
        case inspect.EnumType(cls=codes):
            return Field(name, _width(cast(type[IntEnum], codes)), None, length, cast(type[IntEnum], codes))
        case inspect.StructType():
            return Field(name, "", info.cls, length, None)
        case _:
            return Field(name, ros, None, length, None)


def _width(codes: type[IntEnum]) -> str:
    for base, width in ((Uint8Code, "uint8"), (Int32Code, "int32")):
        if issubclass(codes, base):
            return width
    raise TypeError(f"{codes.__name__} has no width; make it a Uint8Code or an Int32Code")
