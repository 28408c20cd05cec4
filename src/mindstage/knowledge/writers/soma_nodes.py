"""SOMA's nodes for values of a world: localizations, shapes, colors and joints, each saying what it restates."""

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
    AxisMotion,
    BlankNode,
    Body,
    Color,
    FactValue,
    Iri,
    IriRef,
    Joint,
    Literal,
    Pose,
    PrimitiveType,
    PropertyAssertion,
)
from mindstage.world.geometry import Array, normalized_pose_array, pose_inverse, pose_multiply, quat_rotate
from mindstage.world.travel import axis_ranges

__all__ = [
    "DofAxis",
    "blank_node",
    "color_node",
    "free_axes",
    "joint_node",
    "limits_node",
    "localization_node",
    "shape_node",
]

_REGION = dul("hasRegion")
_DOUBLE = xsd("double")


class DofAxis(NamedTuple):
    """One way in which a constraint lets something move."""

    is_rotational: bool
    direction: Array
    """In the constraint's frame."""
    range: tuple[float, float] | None
    """From where it was spawned [m or rad]; None for no end."""


def blank_node(cls: Iri, facts: Iterable[PropertyAssertion] = (), *, restates: Iri | None = None) -> BlankNode:
    """A thing without a name."""
    mark = () if restates is None else (PropertyAssertion(RESTATES, IriRef(restates)),)
    return BlankNode(sorted_facts((PropertyAssertion(TYPE, IriRef(cls)), *mark, *facts)))


def localization_node(pose_node: FactValue) -> BlankNode:
    """Where something is: at a pose that is told in SOMA's way."""
    return blank_node(soma("Localization"), [PropertyAssertion(SPACE_REGION, pose_node)], restates=HAS_POSE)


def shape_node(body: Body) -> BlankNode | None:
    """How large something is and which mesh it has, if anything is known of it."""
    regions = [*_shape_nodes(body), *_mesh_nodes(body)]
    if not regions:
        return None
    return blank_node(
        soma("Shape"), (PropertyAssertion(_REGION, region) for region in regions), restates=words.SIZE[0].property
    )


def _shape_nodes(body: Body) -> Iterator[BlankNode]:
    if body.size is None:
        return
    x, y, z = body.size
    kind = body.shape.type if body.shape else PrimitiveType.BOX
    if kind is PrimitiveType.SPHERE and x == y == z:
        yield blank_node(soma("SphereShape"), [_number_fact(soma("hasRadius"), x / 2)])
    elif kind is PrimitiveType.CYLINDER and x == y:
        yield blank_node(
            soma("CylinderShape"), [_number_fact(soma("hasRadius"), x / 2), _number_fact(soma("hasLength"), z)]
        )
    else:
        extents = zip(("hasDepth", "hasWidth", "hasHeight"), (x, y, z), strict=True)
        yield blank_node(soma("BoxShape"), [_number_fact(soma(name), extent) for name, extent in extents])


def _mesh_nodes(body: Body) -> Iterator[BlankNode]:
    if body.mesh is not None:
        yield blank_node(soma("MeshShape"), [PropertyAssertion(soma("hasFilePath"), Literal(body.mesh))])


def color_node(color: Color) -> BlankNode:
    """What color something has."""
    region = blank_node(soma("ColorRegion"), [_number_row_fact(soma("hasRGBValue"), (*color, 1.0))])
    return blank_node(soma("Color"), [PropertyAssertion(_REGION, region)], restates=MATERIAL)


# -- joints ------------------------------------------------------------------------------------------------------------


def free_axes(constraint: Joint) -> Sequence[DofAxis]:
    """The axes along or about which a constraint lets something move."""
    return [
        DofAxis(at >= 3, np.eye(3)[at % 3], None if motion is AxisMotion.FREE else (middle - limit, middle + limit))
        for at, (motion, limit, middle) in enumerate(axis_ranges(constraint))
        if motion is AxisMotion.FREE or (motion is AxisMotion.LIMITED and limit)
    ]


def joint_node(constraint: Joint, cls: Iri, ends: tuple[Iri, Iri], parent: Pose) -> BlankNode:
    """A joint as robots' descriptions tell it, seen from the link that holds.

    Args:
        constraint: what it restates.
        cls: what kind of joint it is, and with that how far it goes.
        ends: what holds and what is held.
        parent: where the former is.
    """
    facts = [
        PropertyAssertion(urdf("hasParentLink"), IriRef(ends[0])),
        PropertyAssertion(urdf("hasChildLink"), IriRef(ends[1])),
    ]
    axes = free_axes(constraint)
    with np.errstate(over="ignore", invalid="ignore"):  # some poses are too large to reckon with
        parent_from_frame: Array = pose_multiply(
            pose_inverse(normalized_pose_array(parent)), normalized_pose_array(constraint.pose)
        )
        axis = quat_rotate(parent_from_frame[3:], axes[0].direction) if len(axes) == 1 else parent_from_frame[:0]
    if np.isfinite(parent_from_frame).all():
        facts.append(
            PropertyAssertion(
                urdf("hasOrigin"),
                blank_node(urdf("Pose"), [_number_row_fact(urdf("hasXYZ"), parent_from_frame[:3].tolist())]),
            )
        )
        facts += [_number_row_fact(urdf("hasAxisVector"), axis.tolist())] if len(axis) else []
    return blank_node(cls, facts, restates=CONSTRAINT)


def limits_node(range: tuple[float, float]) -> BlankNode:
    """From where to where a joint goes."""
    ends = zip((urdf("hasLowerLimit"), urdf("hasUpperLimit")), range, strict=True)
    return blank_node(urdf("JointLimits"), [_number_fact(property, end) for property, end in ends])


def _number_fact(property: Iri, number: float) -> PropertyAssertion:
    return PropertyAssertion(property, Literal(repr(float(number)), _DOUBLE))


def _number_row_fact(property: Iri, numbers: Iterable[float]) -> PropertyAssertion:
    return PropertyAssertion(property, Literal(" ".join(repr(float(number) + 0.0) for number in numbers), ARRAY))
