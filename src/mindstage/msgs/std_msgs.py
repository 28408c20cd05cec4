"""std_msgs: single values, a header, a colour."""

from __future__ import annotations

from typing import ClassVar

from mindstage.msgs import primitives as ros
from mindstage.msgs.builtin_interfaces import Time
from mindstage.msgs.message import Message, Ros

__all__ = [
    "Bool",
    "ColorRGBA",
    "Empty",
    "Float32",
    "Float64",
    "Header",
    "Int8",
    "Int16",
    "Int32",
    "Int64",
    "String",
    "UInt8",
    "UInt16",
    "UInt32",
    "UInt64",
]


class Empty(Message, frozen=True):
    """Nothing."""


class Bool(Message, frozen=True):
    """A truth value."""

    data: ros.Bool = False


class String(Message, frozen=True):
    """A text."""

    data: ros.String = ""


class Float32(Message, frozen=True):
    """A number."""

    data: ros.Float32 = 0.0


class Float64(Message, frozen=True):
    """A number."""

    data: ros.Float64 = 0.0


class Int8(Message, frozen=True):
    """A whole number."""

    data: ros.Int8 = 0


class Int16(Message, frozen=True):
    """A whole number."""

    data: ros.Int16 = 0


class Int32(Message, frozen=True):
    """A whole number."""

    data: ros.Int32 = 0


class Int64(Message, frozen=True):
    """A whole number."""

    data: ros.Int64 = 0


class UInt8(Message, frozen=True):
    """A whole number, not negative."""

    data: ros.Uint8 = 0


class UInt16(Message, frozen=True):
    """A whole number, not negative."""

    data: ros.Uint16 = 0


class UInt32(Message, frozen=True):
    """A whole number, not negative."""

    data: ros.Uint32 = 0


class UInt64(Message, frozen=True):
    """A whole number, not negative."""

    data: ros.Uint64 = 0


class Header(Message, frozen=True):
    """When, and in which frame."""

    only_in: ClassVar = {"seq": Ros.ONE}

    seq: ros.Uint32 = 0
    stamp: Time = Time()
    frame_id: ros.String = ""


class ColorRGBA(Message, frozen=True):
    """Red, green, blue and opacity, each 0 to 1."""

    r: ros.Float32 = 0.0
    g: ros.Float32 = 0.0
    b: ros.Float32 = 0.0
    a: ros.Float32 = 0.0
