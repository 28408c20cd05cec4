"""Hypothesis strategies for shape templates with any valid parameters."""

from __future__ import annotations

from typing import Any

import msgspec
from hypothesis import strategies as st

from mindstage.geometry import SHAPE_TEMPLATES, BodySide, Cutout, ShapeTemplate
from mindstage.scene import Vector

__all__ = ["materials_for", "orientations", "sizes", "templates"]

_EXTENTS_M = st.floats(-2.6, 0.8).map(lambda power: 10.0**power)

sizes: st.SearchStrategy[Vector] = st.tuples(_EXTENTS_M, _EXTENTS_M, _EXTENTS_M)
"""Extents from a quarter of a centimeter to a few meters."""

orientations = st.permutations(list(BodySide)).map(
    lambda sides: (sides[0], next(side for side in sides if side.axis != sides[0].axis))
)
"""Pairs of up and front sides."""


def templates(shape_name: str) -> st.SearchStrategy[ShapeTemplate]:
    """Returns templates of one shape with some parameters; the others keep their defaults."""
    template = SHAPE_TEMPLATES[shape_name]
    fields = {field.name: _values(field.type, field.name) for field in msgspec.structs.fields(template)}
    return st.fixed_dictionaries({}, optional=fields).map(lambda parameters: template(**parameters))


def _values(type_: Any, name: str) -> st.SearchStrategy[Any]:
    info = msgspec.inspect.type_info(type_)
    return _of_info(info, name)


def _of_info(info: Any, name: str) -> st.SearchStrategy[Any]:
    match info:
        case msgspec.inspect.FloatType(ge=low, le=high):
            return st.floats(-0.5 if low is None else low, min(0.5 if high is None else high, 1.0))
        case msgspec.inspect.IntType():
            return st.integers(0, 6)
        case msgspec.inspect.BoolType():
            return st.booleans()
        case msgspec.inspect.StrType():
            return st.sampled_from(["", "milk", "dishwasher tablets"])
        case msgspec.inspect.LiteralType(values=values):
            return st.sampled_from(values)
        case msgspec.inspect.EnumType():
            return st.sampled_from([BodySide.LEFT, BodySide.RIGHT, BodySide.TOP, BodySide.BOTTOM])
        case msgspec.inspect.UnionType(types=types):
            members = [_of_info(each, name) for each in types if not isinstance(each, msgspec.inspect.NoneType)]
            return st.none() | st.one_of(members)
        case msgspec.inspect.VarTupleType(item_type=item):
            return st.lists(_of_info(item, name), max_size=3).map(tuple)
        case msgspec.inspect.TupleType(item_types=items):
            return st.tuples(*(_of_info(item, name) for item in items))
        case msgspec.inspect.StructType(cls=cls) if cls is Cutout:
            return st.tuples(_corners, _corners).map(_cutout)
    raise AssertionError(f"no values for {name}: {info}")


_corners = st.tuples(*[st.floats(-1.0, 1.0)] * 3)


def _cutout(corners: tuple[Vector, Vector]) -> Cutout:
    (a, b, c), (d, e, f) = corners
    return Cutout(low=(min(a, d), min(b, e), min(c, f)), high=(max(a, d), max(b, e), max(c, f)))


def materials_for(template: ShapeTemplate) -> tuple[str, ...]:
    """Returns the material roles of a template."""
    return tuple(template.roles)
