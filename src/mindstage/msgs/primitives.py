"""Primitives: ROS's numbers and strings, each with its range and its name in ROS.

Numbers are finite on the wire: JSON has no word for NaN or an infinity, and no message of ours has a use for one. What
is read and what is written is held to that. A float32 keeps the digits that were sent.
"""

from __future__ import annotations

from enum import IntEnum
from numbers import Integral, Real
from typing import Annotated, Final

from msgspec import Meta

__all__ = [
    "FLOAT64_MAX",
    "Bool",
    "Bytes",
    "Float32",
    "Float64",
    "Int8",
    "Int16",
    "Int32",
    "Int32Code",
    "Int64",
    "String",
    "Uint8",
    "Uint8Code",
    "Uint16",
    "Uint32",
    "Uint64",
    "plain",
]

FLOAT32_MAX: Final = 3.4028234663852886e38
FLOAT64_MAX: Final = 1.7976931348623157e308

Bool = Annotated[bool, Meta(extra={"ros": "bool"})]
String = Annotated[str, Meta(extra={"ros": "string"})]
Bytes = Annotated[bytes, Meta(extra={"ros": "uint8"})]
"""uint8[]: base64 in JSON, as rosbridge has it, and a byte string in CBOR."""
Float32 = Annotated[float, Meta(ge=-FLOAT32_MAX, le=FLOAT32_MAX, extra={"ros": "float32"})]
Float64 = Annotated[float, Meta(ge=-FLOAT64_MAX, le=FLOAT64_MAX, extra={"ros": "float64"})]
Int8 = Annotated[int, Meta(ge=-(2**7), le=2**7 - 1, extra={"ros": "int8"})]
Int16 = Annotated[int, Meta(ge=-(2**15), le=2**15 - 1, extra={"ros": "int16"})]
Int32 = Annotated[int, Meta(ge=-(2**31), le=2**31 - 1, extra={"ros": "int32"})]
Int64 = Annotated[int, Meta(ge=-(2**63), le=2**63 - 1, extra={"ros": "int64"})]
Uint8 = Annotated[int, Meta(ge=0, le=2**8 - 1, extra={"ros": "uint8"})]
Uint16 = Annotated[int, Meta(ge=0, le=2**16 - 1, extra={"ros": "uint16"})]
Uint32 = Annotated[int, Meta(ge=0, le=2**32 - 1, extra={"ros": "uint32"})]
Uint64 = Annotated[int, Meta(ge=0, le=2**63 - 1, extra={"ros": "uint64"})]
"""Its upper half is refused: it counts steps, and most JSON readers lose digits far below."""


class Uint8Code(IntEnum):
    """A closed set of meanings that travels as a uint8."""


class Int32Code(IntEnum):
    """A closed set of meanings that travels as an int32."""


def plain(number: object) -> int | float:
    """What NumPy and its like have in the place of a number, as a number that can be written.

    Raises:
        TypeError: it is none.
    """
    match number:
        case Integral():
            return int(number)
        case Real():
            return float(number)
    raise TypeError(f"{type(number).__name__} cannot be written")
