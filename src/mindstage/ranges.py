"""Ranges of numbers, declared in the type of a parameter or a field and checked at the call.

    @checked
    def open(self, fraction: Fraction = 1.0, *, timeout_s: MotionTimeout = 10.0) -> JointMotion: ...

A range is a `msgspec.Meta`, so that decoded records are checked by the same declaration. NaN, infinities and booleans
are in no range. Aliases are named by physical kind and are in SI units; those whose bounds limit what clients may
request are in `access.limits`.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable, Mapping
from functools import cache, wraps
from inspect import Parameter, signature
from numbers import Integral, Real
from types import UnionType
from typing import Annotated, Any, NamedTuple, ParamSpec, TypeVar, Union, get_args, get_origin

from msgspec import Meta

from mindstage.errors import NumberRefusedError

__all__ = [
    "MAX_COORDINATE_M",
    "MAX_SIZE_M",
    "Angle",
    "Component",
    "Coordinate",
    "Count",
    "Degrees",
    "Factor",
    "FieldOfView",
    "Finite",
    "Force",
    "ForceVector",
    "Fraction",
    "Frequency",
    "Index",
    "Length",
    "Mass",
    "NotNegative",
    "PictureSize",
    "Pixels",
    "PlanePoint",
    "Point",
    "Port",
    "Positive",
    "PositiveLength",
    "PositiveMass",
    "Range",
    "RotationQuaternion",
    "Seed",
    "Size",
    "Time",
    "TimeStep",
    "WallTime",
    "Workers",
    "check_fields",
    "check_number",
    "checked",
    "declared_range",
    "range_of",
    "ranges_of",
]

P = ParamSpec("P")
R = TypeVar("R")

MAX_COORDINATE_M = 1e8
"""Positions farther from the origin are refused; the circumference of the earth is 4e7 m."""
MAX_SIZE_M = 1e5
"""Larger bodies are refused."""
_FINITE = sys.float_info.max
_METER = {"unit": "m"}

Finite = Annotated[float, Meta(ge=-_FINITE, le=_FINITE)]
"""Any finite number."""
NotNegative = Annotated[float, Meta(ge=0.0, le=_FINITE)]
Positive = Annotated[float, Meta(gt=0.0, le=1e15)]
Factor = Annotated[float, Meta(gt=0.0, le=1e6)]
Fraction = Annotated[float, Meta(ge=0.0, le=1.0)]
Component = Annotated[float, Meta(ge=-1e12, le=1e12)]
"""Of a vector such as a velocity or a force, or of a quaternion, which need not be normalized."""
Coordinate = Annotated[float, Meta(ge=-MAX_COORDINATE_M, le=MAX_COORDINATE_M, extra=_METER)]
Point = tuple[Coordinate, Coordinate, Coordinate]
PlanePoint = tuple[Coordinate, Coordinate]
Length = Annotated[float, Meta(ge=0.0, le=MAX_SIZE_M, extra=_METER)]
PositiveLength = Annotated[float, Meta(gt=0.0, le=MAX_SIZE_M, extra=_METER)]
Size = tuple[Length, Length, Length]
RotationQuaternion = tuple[Component, Component, Component, Component]
Angle = Annotated[float, Meta(ge=-1e6, le=1e6, extra={"unit": "rad"})]
Mass = Annotated[float, Meta(ge=0.0, le=1e12, extra={"unit": "kg"})]
PositiveMass = Annotated[float, Meta(gt=0.0, le=1e12, extra={"unit": "kg"})]
TimeStep = Annotated[float, Meta(gt=0.0, le=1.0, extra={"unit": "s"})]
Degrees = Annotated[float, Meta(gt=0.0, lt=180.0, extra={"unit": "degrees"})]
Force = Annotated[float, Meta(ge=-1e30, le=1e30, extra={"unit": "N"})]
ForceVector = tuple[Force, Force, Force]
Time = Annotated[float, Meta(ge=-1e12, le=1e12, extra={"unit": "s"})]
"""A point in time, since the begin of an episode or of 1970 [s]."""
WallTime = Annotated[float, Meta(ge=0.0, le=1e9, extra={"unit": "s"})]
Frequency = Annotated[float, Meta(gt=0.0, le=1000.0, extra={"unit": "Hz"})]
FieldOfView = Annotated[float, Meta(gt=0.0, lt=3.141592653589793, extra={"unit": "rad"})]
Workers = Annotated[int, Meta(ge=1, le=1024)]
Index = Annotated[int, Meta(ge=0, le=2**53)]
Count = Annotated[int, Meta(ge=1, le=2**53)]
Seed = Annotated[int, Meta(ge=0, le=2**63 - 1)]
Port = Annotated[int, Meta(ge=0, le=65535)]
DomainId = Annotated[int, Meta(ge=0, le=232)]
"""A domain of DDS whose ports are valid (RTPS 2.5, 9.6.2)."""
Pixels = Annotated[int, Meta(ge=1, le=16384)]
PictureSize = tuple[Pixels, Pixels]


class Range(NamedTuple):
    """The bounds of a declared number."""

    low: float
    high: float
    excludes_low: bool
    excludes_high: bool
    integer: bool
    text: str
    """Such as "a number from 0 to 1000 m"."""
    contained: bool = False
    """Whether the numbers are elements of a tuple, a sequence or a mapping."""

    @classmethod
    def of(cls, meta: Meta, *, integer: bool = False) -> Range:
        """The range that the constraints of a type state."""
        low = next((each for each in (meta.ge, meta.gt) if each is not None), -_FINITE)
        high = next((each for each in (meta.le, meta.lt) if each is not None), _FINITE)
        unit = f" {meta.extra['unit']}" if meta.extra and "unit" in meta.extra else ""
        kind, shown = ("an integer", str) if integer else ("a number", "{:g}".format)
        least = [f"{'above' if meta.gt is not None else 'at least'} {shown(low)}"] if low > -_FINITE else []
        most = [f"{'below' if meta.lt is not None else 'at most'} {shown(high)}"] if high < _FINITE else []
        if least and most and meta.gt is None and meta.lt is None:
            text = f"{kind} from {shown(low)} to {shown(high)}{unit}"
        elif least or most:
            text = f"{'an integer' if integer else 'a finite number'} {' and '.join(least + most)}{unit}"
        else:
            text = "a finite number"
        return cls(low, high, meta.gt is not None, meta.lt is not None, integer, text)

    def __contains__(self, value: object) -> bool:
        kind = type(value)
        if kind is not float and kind is not int:
            if kind is bool or not isinstance(value, Real):
                return False
            value = int(value) if isinstance(value, Integral) else float(value)
        if self.integer and not isinstance(value, int):
            return False
        is_within = self.low <= value <= self.high  # type: ignore[operator]
        return is_within and not (
            (self.excludes_low and value == self.low) or (self.excludes_high and value == self.high)
        )


def check_number(value: object, range: Range, name: str) -> None:
    """Refuses a value that is not in a range; of arrays, sequences and mappings, each element is checked.

    Raises:
        NumberRefusedError: with the name and the range.
    """
    if value in range:
        return
    elements: Iterable[tuple[str, object]] | None = None
    if not range.contained:
        pass
    elif isinstance(value, Mapping):
        elements = ((f"{name}[{key!r}]", each) for key, each in value.items() if each not in range)
    elif isinstance(value, list | tuple | set | frozenset):
        elements = ((name, each) for each in value if each not in range)
    elif (to_list := getattr(value, "tolist", None)) is not None:  # an array
        elements = ((name, each) for each in to_list())
    if elements is None:
        raise NumberRefusedError(f"{name} {_shown(value)}", cause=f"it must be {range.text}")
    for inner, each in elements:
        check_number(each, range, inner)


def _shown(value: object) -> str:
    if isinstance(value, int) and value.bit_length() > 128:  # Python refuses to print thousands of digits
        return f"of {value.bit_length()} bits"
    return repr(value)[:80]


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """Checks the numbers of each call against the ranges that are declared in the types of the parameters.

    None is accepted. Elements of tuples, sequences and mappings are checked; the value of a parameter that also takes
    other types, such as a name or an object, is checked if it is a number.

    Raises:
        TypeError: no parameter has a range.
    """
    parameters = signature(function).parameters
    ranges = ranges_of(function)
    rest = next(
        (ranges.pop(name) for name, each in parameters.items() if each.kind is each.VAR_KEYWORD and name in ranges),
        None,
    )
    checks = tuple(
        (sys.maxsize if parameters[name].kind is Parameter.KEYWORD_ONLY else list(parameters).index(name), name, *rule)
        for name, rule in ranges.items()
    )
    if not checks and rest is None:
        raise TypeError(f"{function.__qualname__} has no number with a range")

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        for at, name, range, allows in checks:
            value = args[at] if at < len(args) else kwargs.get(name)
            if value is not None and value not in range and not allows(value):
                check_number(value, range, name)
        if rest is not None:
            for name in kwargs.keys() - parameters.keys():
                check_number(kwargs[name], rest[0], name)
        return function(*args, **kwargs)

    return call


def check_fields(record: object) -> None:
    """Checks the numbers of a record against the ranges of its fields: `__post_init__ = check_fields`.

    Raises:
        NumberRefusedError: also a ValueError, which msgspec reports with the path of the record when it decodes one.
    """
    for name, range, allows in _field_ranges(type(record)):  # type: ignore[arg-type]
        value = getattr(record, name)
        if value is not None and value not in range and not allows(value):
            check_number(value, range, name)


@cache
def _field_ranges(cls: type) -> tuple[tuple[str, Range, Callable[[object], bool]], ...]:
    return tuple((name, range, allows) for name, (range, allows) in ranges_of(cls).items())


def ranges_of(declared: Any) -> dict[str, tuple[Range, Callable[[object], bool]]]:
    """The ranges of the parameters of a function, or of the fields of a class, by name.

    Each comes with a function that returns whether a value beside the range is of another allowed type.
    """
    if isinstance(declared, type):
        annotations = [
            (name, annotation, vars(sys.modules[cls.__module__]))
            for cls in reversed(declared.__mro__)
            for name, annotation in vars(cls).get("__annotations__", {}).items()
        ]
    else:
        annotations = [
            (each.name, each.annotation, declared.__globals__) for each in signature(declared).parameters.values()
        ]
    found: dict[str, tuple[Range, Callable[[object], bool]]] = {}
    for name, annotation, names in annotations:
        if (range := range_of(annotation, names)) is not None:
            found[name] = range, _is_other if _OTHER_TYPES.search(str(annotation)) else lambda _: False
    return found


def range_of(annotation: Any, names: Mapping[str, object] | None = None) -> Range | None:
    """The range in a type, or in the text of one with the names of its module; None without one."""
    if not isinstance(annotation, str):
        return _range_in(annotation)
    try:
        return _range_in(eval(annotation, dict(names or {})))
    except (NameError, TypeError):  # it has names that are imported for type checking only
        found = (_range_in((names or {}).get(word)) for word in re.findall(r"[A-Za-z_]\w*", annotation))
        range = next((each for each in found if each is not None), None)
        return range._replace(contained=range.contained or "[" in annotation) if range is not None else None


def declared_range(type: Any) -> Range:
    """The range of a type that has one, such as `Fraction`.

    Raises:
        TypeError: it has none.
    """
    if (range := _range_in(type)) is None:
        raise TypeError(f"{type} has no range")
    return range


def _range_in(type: Any) -> Range | None:
    args = get_args(type)
    for each in getattr(type, "__metadata__", ()):
        if isinstance(each, Meta) and any(bound is not None for bound in (each.ge, each.gt, each.le, each.lt)):
            return Range.of(each, integer=args[0] is int)
    range = next((range for each in args if (range := _range_in(each)) is not None), None)
    if range is None or get_origin(type) in {Union, UnionType, Annotated}:
        return range
    return range._replace(contained=True)


_OTHER_TYPES = re.compile(r"\b(str|dict|Executor|UnsetType)\b")
"""The types beside numbers that annotations name, of which a value need not be checked."""


def _is_other(value: object) -> bool:
    return not isinstance(value, Real | Mapping | list | tuple)
