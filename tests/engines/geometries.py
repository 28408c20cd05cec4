"""Simple geometry for tests, made of a few collision shapes."""

from __future__ import annotations

import hashlib
from typing import Any

from mindstage.scene import BodyGeometry, CollisionShape, CollisionShapeType, Pose, Vector
from mindstage.scene.transforms import Array

__all__ = [
    "as_vector",
    "bin_geometry",
    "box_shape",
    "cabinet_geometry",
    "geometry",
    "single_shape_geometry",
    "table_geometry",
    "wedge_geometry",
]

WALL_M = 0.02


def geometry(*shapes: CollisionShape, **more: Any) -> BodyGeometry:
    """Geometry with collision shapes and without visual meshes."""
    key_text = repr((shapes, sorted(more.items())))
    return BodyGeometry(
        key=hashlib.sha256(key_text.encode()).hexdigest()[:16], visuals=(), collision_shapes=shapes, **more
    )


def box_shape(low: Vector, high: Vector) -> CollisionShape:
    """A box between two corners."""
    (a, b, c), (d, e, f) = low, high
    return CollisionShape(size=(d - a, e - b, f - c), pose=Pose(((a + d) / 2, (b + e) / 2, (c + f) / 2)))


def bin_geometry(size: Vector, *, wall: float = WALL_M, **more: Any) -> BodyGeometry:
    """A box that is open at the top: a floor and four walls."""
    x, y, z = (extent / 2 for extent in size)
    walls = [
        box_shape((-x, -y, -z + wall), (-x + wall, y, z)),
        box_shape((x - wall, -y, -z + wall), (x, y, z)),
        box_shape((-x + wall, -y, -z + wall), (x - wall, -y + wall, z)),
        box_shape((-x + wall, y - wall, -z + wall), (x - wall, y, z)),
    ]
    return geometry(box_shape((-x, -y, -z), (x, y, -z + wall)), *walls, **more)


def cabinet_geometry(
    size: Vector, *, shelves: tuple[float, ...] = (), wall: float = WALL_M, **more: Any
) -> BodyGeometry:
    """A box that is open towards x, with upper sides of shelves at heights relative to its center."""
    x, y, z = (extent / 2 for extent in size)
    boards = [
        box_shape((-x, -y, -z), (x, y, -z + wall)),
        box_shape((-x, -y, z - wall), (x, y, z)),
        box_shape((-x, -y, -z + wall), (-x + wall, y, z - wall)),
        box_shape((-x + wall, -y, -z + wall), (x, -y + wall, z - wall)),
        box_shape((-x + wall, y - wall, -z + wall), (x, y, z - wall)),
    ]
    boards += [box_shape((-x + wall, -y + wall, top - wall), (x, y - wall, top)) for top in shelves]
    return geometry(*boards, **more)


def table_geometry(size: Vector, *, wall: float = 0.04, **more: Any) -> BodyGeometry:
    """A table top on four legs."""
    x, y, z = (extent / 2 for extent in size)
    legs = [
        box_shape(
            (min(a, a - i * wall), min(b, b - j * wall), -z), (max(a, a - i * wall), max(b, b - j * wall), z - wall)
        )
        for i, a in ((-1, -x), (1, x))
        for j, b in ((-1, -y), (1, y))
    ]
    return geometry(box_shape((-x, -y, z - wall), (x, y, z)), *legs, **more)


def wedge_geometry(size: Vector, **more: Any) -> BodyGeometry:
    """A ramp that ascends along x, as one hull."""
    x, y, z = (extent / 2 for extent in size)
    points = ((-x, -y, -z), (-x, y, -z), (x, -y, -z), (x, y, -z), (x, -y, z), (x, y, z))
    return geometry(CollisionShape(type=CollisionShapeType.HULL, size=size, points=points), **more)


def single_shape_geometry(type: CollisionShapeType, size: Vector, **more: Any) -> BodyGeometry:
    """One collision shape at the body's own pose."""
    return geometry(CollisionShape(type=type, size=size), **more)


def as_vector(row: Array) -> Vector:
    """Three numbers of an array as a tuple."""
    x, y, z = row.tolist()
    return x, y, z
