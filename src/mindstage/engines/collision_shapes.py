"""Solids: what of a form can be touched, made ready once for all bodies that have that form.

How large each part is and where it sits come as arrays, for deciding about many bodies at once; how the mass lies is
worked out from the volumes of the parts, as though they were of one stuff and did not overlap.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import isfinite, pi

import numpy as np
from numpy.typing import NDArray

from mindstage.engines.hollow import WallPanel
from mindstage.world import Body, CollisionShape, CollisionShapeType, Pose, PrimitiveType, Vector
from mindstage.world.boxes import OrientedBoxes
from mindstage.world.geometry import Array, normalize, pose_array, rotation_matrix
from mindstage.world.hulls import Hull, convex_hull

__all__ = [
    "MAX_HULL_FACES",
    "MEAN_SQUARES",
    "MIN_THICKNESS_M",
    "SHAPE_TYPES",
    "CompiledGeometry",
    "compile_geometry",
    "fallback_collision_shape",
    "primitive_collision_type",
    "wall_collision_shapes",
]

MAX_HULL_FACES = 24
"""Of a hull with more faces than this, the directions of so many have to do."""
_CACHE_SIZE = 4096
"""Forms that are remembered."""
MIN_THICKNESS_M = 0.001
"""No engine lets thinner things collide well."""
SHAPE_TYPES = (CollisionShapeType.BOX, CollisionShapeType.SPHERE, CollisionShapeType.CYLINDER, CollisionShapeType.HULL)
_POSE_TOLERANCE_M = 1e-6
_TYPE_OF_PRIMITIVE = {
    PrimitiveType.BOX: CollisionShapeType.BOX,
    PrimitiveType.SPHERE: CollisionShapeType.SPHERE,
    PrimitiveType.CYLINDER: CollisionShapeType.CYLINDER,
}
_VOLUME_FRACTION = {CollisionShapeType.BOX: 1.0, CollisionShapeType.SPHERE: pi / 6, CollisionShapeType.CYLINDER: pi / 4}
"""The part of its box that a solid fills."""
MEAN_SQUARES = {
    CollisionShapeType.BOX: (1 / 12, 1 / 12, 1 / 12),
    CollisionShapeType.SPHERE: (1 / 20, 1 / 20, 1 / 20),
    CollisionShapeType.CYLINDER: (1 / 16, 1 / 16, 1 / 12),
}
"""The mean square along each axis of an evenly filled solid, in squares of its extents."""


@dataclass(frozen=True, slots=True, eq=False)
class CompiledGeometry:
    """The solids of one form."""

    shapes: tuple[CollisionShape, ...]
    """Those that can be used; hulls as points round their own middle."""
    poses: Array
    """k x 7, of the boxes round them in the body's frame, unit quaternions."""
    sizes: Array
    """k x 3, of those boxes."""
    types: NDArray[np.intp]
    """k numbers into `SHAPE_TYPES`."""
    hulls: tuple[tuple[int, Array, Array], ...]
    """Of those that are hulls: which one, its corners, and the directions its faces look in, in its box's frame."""
    bounds: tuple[Array, Array]
    """The lower and upper corner of all of them in the body's frame."""
    volume: float
    """Of all of them [m³]."""
    center_of_mass: Array
    """Their center of mass in the body's frame."""
    inertia: Array
    """3 x 3 about that center, for 1 kg [m²]."""
    invalid_count: int
    """How many solids have numbers that mean nothing."""

    def is_box_of_size(self, size: Vector) -> bool:
        """Whether it is just one box of that size."""
        if len(self.shapes) != 1 or self.shapes[0].type is not CollisionShapeType.BOX:
            return False
        here = np.abs(self.poses[0] - (0, 0, 0, 1, 0, 0, 0)).max() <= _POSE_TOLERANCE_M
        return bool(here and np.abs(self.sizes[0] - size).max() <= _POSE_TOLERANCE_M)


def compile_geometry(shapes: Sequence[CollisionShape]) -> CompiledGeometry:
    """Makes solids ready, the same ones only once.

    What is too thin gets thick enough to touch, a flat hull becomes a box.
    """
    return _compile_geometry(tuple(shapes))


@lru_cache(maxsize=_CACHE_SIZE)
def _compile_geometry(shapes: tuple[CollisionShape, ...]) -> CompiledGeometry:
    usable = [_normalized(solid) for solid in shapes if _is_valid(solid)]
    solids = tuple(solid for solid, _ in usable)
    hulls = tuple(hull for _, hull in usable)
    poses = pose_array(solid.pose for solid in solids)
    poses[:, 3:] = normalize(poses[:, 3:])
    sizes = np.array([solid.size for solid in solids], dtype=float).reshape(-1, 3)
    kinds = np.array([SHAPE_TYPES.index(solid.type) for solid in solids], dtype=np.intp)
    low, high = OrientedBoxes.from_poses(poses, sizes).bounds()
    bounds = (low.min(axis=0), high.max(axis=0)) if solids else (np.zeros(3), np.zeros(3))
    mass = _mass_properties(solids, poses, sizes, hulls)
    faced = tuple(
        (row, hull.points, _face_directions(hull.normals)) for row, hull in enumerate(hulls) if hull is not None
    )
    return CompiledGeometry(solids, poses, sizes, kinds, faced, bounds, *mass, invalid_count=len(shapes) - len(solids))


def _face_directions(normals: Array) -> Array:
    """The directions that a hull's faces look in, each once, at most `MAX_HULL_FACES` of them."""
    once = {tuple(row): None for row in normals.round(6).tolist()}
    kept = np.array(list(once))
    return kept if len(kept) <= MAX_HULL_FACES else kept[np.linspace(0, len(kept) - 1, MAX_HULL_FACES).astype(np.intp)]


def primitive_collision_type(body: Body) -> CollisionShapeType:
    """Which solid a body without a form is."""
    return _TYPE_OF_PRIMITIVE[body.shape.type] if body.shape else CollisionShapeType.BOX


def fallback_collision_shape(body: Body, size: Vector) -> CollisionShape:
    """What a body without a form can be touched as."""
    return CollisionShape(type=primitive_collision_type(body), size=_with_min_thickness(size))


def wall_collision_shapes(panels: tuple[WallPanel, ...]) -> tuple[CollisionShape, ...]:
    """What a body that was made hollow can be touched as."""
    return tuple(CollisionShape(size=_with_min_thickness(plate.size), pose=Pose(plate.center)) for plate in panels)


def _with_min_thickness(size: Vector) -> Vector:
    x, y, z = size
    return max(x, MIN_THICKNESS_M), max(y, MIN_THICKNESS_M), max(z, MIN_THICKNESS_M)


def _is_valid(shape: CollisionShape) -> bool:
    points = [number for point in shape.points for number in point]
    finite = all(map(isfinite, (*shape.size, *shape.pose.position, *shape.pose.quaternion, *points)))
    return finite and any(shape.pose.quaternion) and min(shape.size) >= 0.0


def _normalized(shape: CollisionShape) -> tuple[CollisionShape, Hull | None]:
    """A solid round its own middle, thick enough, and the hull that it may be."""
    if shape.type is not CollisionShapeType.HULL:
        return CollisionShape(type=shape.type, size=_with_min_thickness(shape.size), pose=shape.pose), None
    points = np.array(shape.points, dtype=float).reshape(-1, 3)
    low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(3), np.zeros(3))
    turn = rotation_matrix(normalize(shape.pose.quaternion))
    center = np.array(shape.pose.position) + turn @ ((low + high) / 2)
    x, y, z = np.maximum(high - low, MIN_THICKNESS_M).tolist()
    pose = Pose((float(center[0]), float(center[1]), float(center[2])), shape.pose.quaternion)
    hull = convex_hull(points - (low + high) / 2) if (high - low).min() >= MIN_THICKNESS_M else None
    if hull is None:
        return CollisionShape(size=(x, y, z), pose=pose), None
    corners = tuple((px, py, pz) for px, py, pz in hull.points[np.unique(hull.faces)].tolist())
    return CollisionShape(type=CollisionShapeType.HULL, size=(x, y, z), pose=pose, points=corners), hull


def _mass_properties(
    shapes: tuple[CollisionShape, ...], poses: Array, sizes: Array, hulls: tuple[Hull | None, ...]
) -> tuple[float, Array, Array]:
    """Volume, center of mass, and inertia for 1 kg, of all solids together."""
    if not shapes:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    turns = rotation_matrix(poses[:, 3:])
    volumes, centers, seconds = np.zeros(len(shapes)), poses[:, :3].copy(), np.zeros((len(shapes), 3, 3))
    for row, (solid, hull) in enumerate(zip(shapes, hulls, strict=True)):
        if hull is None:
            volumes[row] = _VOLUME_FRACTION[solid.type] * float(sizes[row].prod())
            seconds[row] = volumes[row] * np.diag(sizes[row] ** 2 * MEAN_SQUARES[solid.type])
        else:
            volumes[row], middle, seconds[row] = hull.moments()
            centers[row] += turns[row] @ middle
    volume = float(volumes.sum())
    middle = volumes @ centers / volume
    away = centers - middle
    second = (turns @ seconds @ np.swapaxes(turns, 1, 2)).sum(axis=0) + (volumes * away.T) @ away
    return volume, middle, (np.trace(second) * np.eye(3) - second) / volume
