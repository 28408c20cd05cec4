"""SOMA's nodes for values of a world: localizations, shapes, colours and joints, each saying what it restates."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from mindstage.knowledge.reading.other_words import dul, soma, urdf
from mindstage.knowledge.reading.restating import ARRAY, SPACE_REGION
from mindstage.knowledge.vocabulary import CONSTRAINT, HAS_POSE, MATERIAL, RESTATES, TYPE, xsd
from mindstage.knowledge.wording import words
from mindstage.knowledge.wording.nesting import sorted_facts
from mindstage.world import (
    Anonymous,
    Body,
    Colour,
    Constraint,
    Fact,
    FactValue,
    Iri,
    Literal,
    Motion,
    Pose,
    Reference,
    ShapeKind,
)
from mindstage.world.geometry import Array, compose, invert, rotate, unit_pose
from mindstage.world.travel import axis_ranges

__all__ = ["Axis", "axes_of", "colour_node", "joint_node", "limits_node", "localization_node", "node", "shape_node"]

_REGION = dul("hasRegion")
_DOUBLE = xsd("double")


class Axis(NamedTuple):
    """One way in which a constraint lets something move."""

    turns: bool
    direction: Array
    """In the constraint's frame."""
    range: tuple[float, float] | None
    """From where it was spawned [m or rad]; None for no end."""


def node(cls: Iri, facts: Iterable[Fact] = (), *, restates: Iri | None = None) -> Anonymous:
    """A thing without a name."""
    mark = () if restates is None else (Fact(RESTATES, Reference(restates)),)
    return Anonymous(sorted_facts((Fact(TYPE, Reference(cls)), *mark, *facts)))


def localization_node(place: FactValue) -> Anonymous:
    """Where something is: at a pose that is told in SOMA's way."""
    return node(soma("Localization"), [Fact(SPACE_REGION, place)], restates=HAS_POSE)


def shape_node(body: Body) -> Anonymous | None:
    """How large something is and which mesh it has, if anything is known of it."""
    regions = [*_solid(body), *_mesh(body)]
    if not regions:
        return None
    return node(soma("Shape"), (Fact(_REGION, region) for region in regions), restates=words.SIZE[0].property)


def _solid(body: Body) -> Iterator[Anonymous]:
    if body.size is None:
        return
    x, y, z = body.size
    kind = body.shape.kind if body.shape else ShapeKind.BOX
    if kind is ShapeKind.SPHERE and x == y == z:
        yield node(soma("SphereShape"), [_number(soma("hasRadius"), x / 2)])
    elif kind is ShapeKind.CYLINDER and x == y:
        yield node(soma("CylinderShape"), [_number(soma("hasRadius"), x / 2), _number(soma("hasLength"), z)])
    else:
        extents = zip(("hasDepth", "hasWidth", "hasHeight"), (x, y, z), strict=True)
        yield node(soma("BoxShape"), [_number(soma(name), extent) for name, extent in extents])


def _mesh(body: Body) -> Iterator[Anonymous]:
    if body.mesh is not None:
        yield node(soma("MeshShape"), [Fact(soma("hasFilePath"), Literal(body.mesh))])


def colour_node(colour: Colour) -> Anonymous:
    """What colour something has."""
    region = node(soma("ColorRegion"), [_row(soma("hasRGBValue"), (*colour, 1.0))])
    return node(soma("Color"), [Fact(_REGION, region)], restates=MATERIAL)


# -- joints ------------------------------------------------------------------------------------------------------------


def axes_of(constraint: Constraint) -> Sequence[Axis]:
    """The axes along or about which a constraint lets something move."""
    return [
        Axis(at >= 3, np.eye(3)[at % 3], None if motion is Motion.FREE else (middle - limit, middle + limit))
        for at, (motion, limit, middle) in enumerate(axis_ranges(constraint))
        if motion is Motion.FREE or (motion is Motion.LIMITED and limit)
    ]


def joint_node(constraint: Constraint, cls: Iri, ends: tuple[Iri, Iri], parent: Pose) -> Anonymous:
    """A joint as robots' descriptions tell it, seen from the link that holds.

    Args:
        constraint: what it restates.
        cls: what kind of joint it is, and with that how far it goes.
        ends: what holds and what is held.
        parent: where the former is.
    """
    facts = [Fact(urdf("hasParentLink"), Reference(ends[0])), Fact(urdf("hasChildLink"), Reference(ends[1]))]
    axes = axes_of(constraint)
    with np.errstate(over="ignore", invalid="ignore"):  # some poses are too large to reckon with
        parent_from_frame: Array = compose(invert(unit_pose(parent)), unit_pose(constraint.pose))
        axis = rotate(parent_from_frame[3:], axes[0].direction) if len(axes) == 1 else parent_from_frame[:0]
    if np.isfinite(parent_from_frame).all():
        facts.append(
            Fact(urdf("hasOrigin"), node(urdf("Pose"), [_row(urdf("hasXYZ"), parent_from_frame[:3].tolist())]))
        )
        facts += [_row(urdf("hasAxisVector"), axis.tolist())] if len(axis) else []
    return node(cls, facts, restates=CONSTRAINT)


def limits_node(range: tuple[float, float]) -> Anonymous:
    """From where to where a joint goes."""
    ends = zip((urdf("hasLowerLimit"), urdf("hasUpperLimit")), range, strict=True)
    return node(urdf("JointLimits"), [_number(property, end) for property, end in ends])


def _number(property: Iri, number: float) -> Fact:
    return Fact(property, Literal(repr(float(number)), _DOUBLE))


def _row(property: Iri, numbers: Iterable[float]) -> Fact:
    return Fact(property, Literal(" ".join(repr(float(number) + 0.0) for number in numbers), ARRAY))
