"""Definitions: a type told as rosapi tells it, made from the struct that does the reading."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from mindstage.msgs.builtin_interfaces import Duration, Time
from mindstage.msgs.fields import Field, constants_of, fields_of, struct_of
from mindstage.msgs.message import Ros
from mindstage.msgs.naming import short_name
from mindstage.msgs.rosapi import TypeDef

__all__ = ["definition_text", "type_definitions"]

RULE = "=" * 80
NUMBERS = ("int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64")
EXAMPLES = dict.fromkeys(NUMBERS, "0") | {"bool": "False", "string": "", "float32": "0.0", "float64": "0.0"}


def type_definitions(cls: Any, *, ros: Ros = Ros.TWO) -> tuple[TypeDef, ...]:
    """A message and all messages inside of it, each once, itself first."""
    return tuple(_definition(each, ros) for each in _with_parts(cls, ros))


def definition_text(cls: Any, *, ros: Ros = Ros.TWO) -> str:
    """The same as the text of `.msg` files, the way recorders and viewers keep it."""
    first, *parts = _with_parts(cls, ros)
    texts = [_text(first, ros)]
    texts += [f"{RULE}\nMSG: {short_name(part, ros)}\n{_text(part, ros)}" for part in parts if not _builtin(part, ros)]
    return "".join(texts)


def _definition(cls: Any, ros: Ros) -> TypeDef:
    fields = list(_fields(cls, ros))
    constants = list(constants_of(cls))
    return TypeDef(
        type=_name(cls, ros),
        fieldnames=tuple(name for name, _ in fields),
        fieldtypes=tuple(_type(field, ros) for _, field in fields),
        fieldarraylen=tuple(-1 if field.length is None else field.length for _, field in fields),
        examples=tuple(_example(field) for _, field in fields),
        constnames=tuple(name for name, _ in constants),
        constvalues=tuple(str(value) for _, value in constants),
    )


def _text(cls: Any, ros: Ros) -> str:
    width = next((field.primitive for field in fields_of(cls) if field.codes), "uint8")
    lines = [f"{width} {name}={value}" for name, value in constants_of(cls)]
    for name, field in _fields(cls, ros):
        length = "" if field.length is None else f"[{field.length or ''}]"
        lines.append(f"{_type(field, ros)}{length} {name}")
    return "".join(f"{line}\n" for line in lines)


def _with_parts(cls: Any, ros: Ros) -> list[Any]:
    found: dict[Any, None] = {}

    def visit(each: Any) -> None:
        if each not in found:
            found[each] = None
            for _, field in _fields(each, ros):
                if field.message:
                    visit(field.message)

    visit(cls)
    return list(found)


def _fields(cls: Any, ros: Ros) -> Iterator[tuple[str, Field]]:
    struct = struct_of(cls)
    for field in fields_of(cls):
        if struct.only_in.get(field.name, ros) is ros:
            yield (struct.ros1_names.get(field.name, field.name) if ros is Ros.ONE else field.name), field


def _builtin(cls: Any, ros: Ros) -> bool:
    """ROS 1 has moments and spans of time among its primitives."""
    return ros is Ros.ONE and cls in {Time, Duration}


def _name(cls: Any, ros: Ros) -> str:
    return str(cls.__name__).lower() if _builtin(cls, ros) else short_name(cls, ros)


def _type(field: Field, ros: Ros) -> str:
    return _name(field.message, ros) if field.message else field.primitive


def _example(field: Field) -> str:
    if field.length is not None:
        return "[]"
    return "{}" if field.message else EXAMPLES[field.primitive]
