"""Small places to fit forms to, and what can be seen of a form."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import cos, pi, sin

import numpy as np

from mindstage.geometry import BodySide
from mindstage.geometry.fit import FittedGeometry, fit_geometry
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import (
    Attachment,
    AxisMotion,
    Body,
    BodyGeometry,
    BodyId,
    BodyPhysics,
    CollisionShape,
    Iri,
    Joint,
    LinearLimits,
    Mobility,
    Pose,
    Quaternion,
    Vector,
    World,
)
from mindstage.scene.transforms import Array, normalized_pose_array, quat_rotate, rotation_matrix
from tests.kitchenette import KNOWROB

MY = "http://example.org/my#"
UPRIGHT: Quaternion = (1.0, 0.0, 0.0, 0.0)
QUARTERS = tuple((cos(quarter * pi / 4), 0.0, 0.0, sin(quarter * pi / 4)) for quarter in range(4))
"""Turned about the upright by 0, 90, 180 and 270 degrees."""


def make_body(
    id: str, cls: str, at: Vector, size: Vector | None, *, is_free: bool = False, turn: Quaternion = UPRIGHT
) -> Body:
    mobility = Mobility.DYNAMIC if is_free else Mobility.STATIC
    iri = cls if "//" in cls else KNOWROB + cls
    return Body(
        id=BodyId(id),
        iri=Iri(MY + id),
        cls=Iri(iri),
        pose=Pose(at, turn),
        size=size,
        physics=BodyPhysics(mobility=mobility),
    )


def slide_joint(parent: str, child: str, *, middle: float = 0.0, turn: Quaternion = UPRIGHT) -> Joint:
    linear = LinearLimits(x=AxisMotion.LIMITED, limit=0.2, x_middle=middle)
    id = BodyId(f"{child}_slide")
    return Joint(
        id=id, iri=Iri(MY + id), parent=BodyId(parent), child=BodyId(child), pose=Pose((0, 0, 0), turn), linear=linear
    )


def world(bodies: Iterable[Body], constraints: Sequence[Joint] = (), attached: Sequence[tuple[str, str]] = ()) -> World:
    attachments = tuple(Attachment(parent=BodyId(parent), child=BodyId(child)) for parent, child in attached)
    return World(iri=Iri(MY + "map"), bodies=tuple(bodies), joints=tuple(constraints), attachments=attachments)


def fit(knowledge: KnowledgeBase, *bodies: Body) -> FittedGeometry:
    return fit_geometry(world(bodies), knowledge)


# -- what can be seen of a form ----------------------------------------------------------------------------------------


def box_of(solid: CollisionShape) -> tuple[Array, Array]:
    """The lower and upper corner of a solid, in the body's frame."""
    pose = normalized_pose_array(solid.pose)
    if solid.points:
        points = quat_rotate(pose[3:], np.array(solid.points)) + pose[:3]
        return points.min(axis=0), points.max(axis=0)
    reach = np.abs(rotation_matrix(pose[3:])) @ np.array(solid.size) / 2
    return pose[:3] - reach, pose[:3] + reach


def has_clearance(form: BodyGeometry, point: Vector, clearance: float = 0.0) -> bool:
    """Whether no solid's box comes nearer to a point than that, along each axis."""
    boxes = [box_of(solid) for solid in form.collision_shapes]
    return not any(
        np.all(low - clearance < point) and np.all(np.array(point) < high + clearance) for low, high in boxes
    )


def open_sides(form: BodyGeometry, size: Vector) -> set[BodySide]:
    """The sides of a body through whose middle one can reach into it."""
    reached = set()
    for side in BodySide:
        point = [0.0, 0.0, 0.0]
        point[side.axis] = side.sign * (size[side.axis] / 2 - 0.0002)
        if has_clearance(form, (point[0], point[1], point[2])):
            reached.add(side)
    return reached


def panel_side(form: BodyGeometry, size: Vector) -> BodySide:
    """The side of a drawer that its front closes: the only one with a solid that covers all of it."""
    covering = []
    for side in (BodySide.FRONT, BodySide.BACK, BodySide.LEFT, BodySide.RIGHT):
        for low, high in map(box_of, form.collision_shapes):
            across = [axis for axis in range(3) if axis != side.axis]
            covers = np.allclose((high - low)[across], np.array(size)[across])
            outer = (high if side.sign > 0 else -low)[side.axis]
            if covers and np.isclose(outer, size[side.axis] / 2):
                covering.append(side)
    (side,) = covering
    return side
