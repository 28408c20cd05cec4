"""Collision shapes in the form in which engines and the collision filter use them.

- `compile_geometry` converts the collision shapes of a geometry to arrays, once for all bodies that share them. Mass
  properties are those of a uniform density, without regard to overlaps between shapes.
- `hollow_box` makes an interior for a box. A map has a fridge with milk inside, but neither its walls nor its shelves;
  since the contents must rest on something, the box gets a floor at each of their heights.
- `CollisionShapeBatch` computes the penetration depths of many pairs of bodies, by the separating axis theorem. Fifteen
  axes are exact for boxes. Round shapes and hulls are tested along a few more; their depths may be overestimated, but
  never underestimated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import hypot, isfinite, pi

import numpy as np
from numpy.typing import NDArray

from mindstage.scene.bounding_boxes import Indices, OrientedBoxes, penetration_depths
from mindstage.scene.geometry import CollisionShape, CollisionShapeType
from mindstage.scene.mesh import Hull, convex_hull
from mindstage.scene.transforms import Array, cross, normalize, pose_array, pose_multiply, rotation_matrix
from mindstage.scene.world_model import Body, Pose, PrimitiveType, Vector

__all__ = [
    "MAX_HULL_FACES",
    "MEAN_SQUARES",
    "MIN_THICKNESS_M",
    "SHAPE_TYPES",
    "CollisionShapeBatch",
    "CompiledGeometry",
    "HollowBox",
    "WallPanel",
    "compile_geometry",
    "fallback_collision_shape",
    "hollow_box",
    "primitive_collision_type",
    "wall_collision_shapes",
]


_WALL_THICKNESS_M = 0.015
_CLEARANCE_M = 0.0005
"""Gap between a wall and the contents next to it."""
_FEW = 8
"""Up to so many contents are compared faster in Python than with arrays."""
_SAME_LEVEL_M = 0.004
"""Contents whose lower sides differ by less are on one level."""
_SIDE_NAMES = ("to the back", "to the front", "to the right", "to the left", "to the bottom", "to the top")
"""Along the body's axes: -x, +x, -y, +y, -z, +z."""


@dataclass(frozen=True, slots=True)
class WallPanel:
    """A box-shaped part of a hollow body, parallel to its axes."""

    center: Vector
    """In the body frame [m]."""
    size: Vector
    """[m]."""


@dataclass(frozen=True, slots=True)
class HollowBox:
    """The panels of a hollow box."""

    panels: tuple[WallPanel, ...]
    opening: str
    """The open sides, in words."""


def hollow_box(boxes: OrientedBoxes, outer: int, inner: Sequence[int], parts: Sequence[Array]) -> HollowBox:
    """Computes walls, an opening and floors for a box with contents.

    Args:
        boxes: all boxes.
        outer: index of the box to make hollow.
        inner: indices of its contents.
        parts: centers of doors and drawers in the world frame [m]; each opens the side that it is nearest to. Without
            any, the top is open.
    """
    half, rotation = boxes.half_extents[outer], boxes.rotation[outer]
    low, high = _extents(boxes, outer, inner)
    up = rotation[2].tolist()
    up_axis = max(range(3), key=lambda axis: abs(up[axis]))
    top = 2 * up_axis + (1 if up[up_axis] > 0 else 0)
    sides = {_side_towards((part - boxes.center[outer]) @ rotation, half) for part in parts} - {top ^ 1}
    opening = sides or {top}
    interior = _interior(half, low, high)
    half_extents: list[float] = half.tolist()
    panels = [
        _panel(half_extents, side // 2, *_wall_range(side, half_extents, interior))
        for side in range(6)
        if side not in opening and side // 2 != up_axis
    ]
    if top not in opening:
        panels.append(_panel(half_extents, up_axis, *_wall_range(top, half_extents, interior)))
    panels += _floors(half_extents, up_axis, up[up_axis] > 0, low, high)
    opening_text = " and ".join(_SIDE_NAMES[side] for side in sorted(opening))
    return HollowBox(tuple(panel for panel in panels if min(panel.size) > 0.0), opening_text)


def _extents(boxes: OrientedBoxes, outer: int, inner: Sequence[int]) -> tuple[Array, Array]:
    """Lower and upper corners of the inner boxes, each n x 3, in the frame of the outer box."""
    rotation, inside = boxes.rotation[outer], list(inner)
    center = (boxes.center[inside] - boxes.center[outer]) @ rotation
    reach = (np.abs(rotation.T @ boxes.rotation[inside]) @ boxes.half_extents[inside][:, :, None])[:, :, 0]
    return center - reach, center + reach


def _side_towards(point: Array, half: Array) -> int:
    """Index of the side that a point is outermost of: 0 is -x, 1 is +x, and so on for y and z."""
    position: list[float] = point.tolist()
    outside = [abs(coordinate) - extent for coordinate, extent in zip(position, half.tolist(), strict=True)]
    axis = max(range(3), key=outside.__getitem__)
    return 2 * axis + int(position[axis] > 0)


def _interior(half: Array, low: Array, high: Array) -> tuple[list[float], list[float]]:
    """Lower and upper corner of the interior, which contains all contents; walls have at most the usual thickness."""
    usual_half = [extent - min(_WALL_THICKNESS_M, extent / 5) for extent in half.tolist()]
    start = [min(-each, first - _CLEARANCE_M) for each, first in zip(usual_half, low.min(axis=0).tolist(), strict=True)]
    end = [max(each, last + _CLEARANCE_M) for each, last in zip(usual_half, high.max(axis=0).tolist(), strict=True)]
    return start, end


def _wall_range(side: int, half: list[float], interior: tuple[list[float], list[float]]) -> tuple[float, float]:
    """Extent of a wall along its normal; empty if there is no room for it."""
    axis = side // 2
    if side % 2:
        start, end = interior[1][axis], half[axis]
    else:
        start, end = -half[axis], interior[0][axis]
    return (start, end) if end - start >= MIN_THICKNESS_M else (start, start)


def _floors(half: list[float], up_axis: int, is_upright: bool, low: Array, high: Array) -> list[WallPanel]:
    """A floor under each level of contents, except for contents stacked on others."""
    horizontal = [axis for axis in range(3) if axis != up_axis]
    bottoms = (low if is_upright else -high)[:, up_axis]
    tops = (high if is_upright else -low)[:, up_axis]
    bottom = -half[up_axis]
    lowest = bottoms.tolist()
    if 1 < len(lowest) <= _FEW:
        lower, upper, highest = low.tolist(), high.tolist(), tops.tolist()
        lowest = [
            height
            for index, height in enumerate(lowest)
            if not any(
                other_index != index
                and abs(top - height) < _SAME_LEVEL_M
                and all(
                    lower[index][axis] < upper[other_index][axis] and lower[other_index][axis] < upper[index][axis]
                    for axis in horizontal
                )
                for other_index, top in enumerate(highest)
            )
        ]
    elif len(lowest) > _FEW:
        is_below = np.abs(tops - bottoms[:, None]) < _SAME_LEVEL_M
        is_beside = np.all(
            (low[:, horizontal] < high[:, None, horizontal]) & (low[:, None, horizontal] < high[:, horizontal]), axis=2
        )
        is_stacked = np.any(is_below & is_beside & ~np.eye(len(low), dtype=bool), axis=1)
        lowest = bottoms[~is_stacked].tolist()
    levels: list[float] = []
    for height in sorted(lowest):
        if not (levels and height - levels[-1] < _SAME_LEVEL_M):
            levels.append(height)
    floors = []
    for height in levels:
        ceiling_below = max([bottom, *(top for top in tops.tolist() if top <= height + _SAME_LEVEL_M)])
        start = bottom if height == levels[0] else max(height - _WALL_THICKNESS_M, ceiling_below + _CLEARANCE_M)
        if height - start >= MIN_THICKNESS_M:
            floors.append(_panel(half, up_axis, *((start, height) if is_upright else (-height, -start))))
    return floors


def _panel(half: list[float], axis: int, start: float, end: float) -> WallPanel:
    """A panel across the whole box, between two positions along one axis."""
    center, size = [0.0, 0.0, 0.0], [2 * extent for extent in half]
    center[axis], size[axis] = (start + end) / 2, end - start
    return WallPanel((center[0], center[1], center[2]), (size[0], size[1], size[2]))


MAX_HULL_FACES = 24
"""Maximum number of face normals of a hull that are used."""
_CACHE_SIZE = 4096
"""Number of cached geometries."""
MIN_THICKNESS_M = 0.001
"""Minimum thickness that all engines collide reliably [m]."""
_MAX_LENGTH_M = 1e6
_MIN_QUATERNION_NORM = 1e-6
"""Dimensionless, as is its reciprocal, the largest norm."""
SHAPE_TYPES = (CollisionShapeType.BOX, CollisionShapeType.SPHERE, CollisionShapeType.CYLINDER, CollisionShapeType.HULL)
_POSE_TOLERANCE_M = 1e-6
_TYPE_OF_PRIMITIVE = {
    PrimitiveType.BOX: CollisionShapeType.BOX,
    PrimitiveType.SPHERE: CollisionShapeType.SPHERE,
    PrimitiveType.CYLINDER: CollisionShapeType.CYLINDER,
}
_VOLUME_FRACTION = {CollisionShapeType.BOX: 1.0, CollisionShapeType.SPHERE: pi / 6, CollisionShapeType.CYLINDER: pi / 4}
"""Part of its bounding box that a shape fills."""
MEAN_SQUARES = {
    CollisionShapeType.BOX: (1 / 12, 1 / 12, 1 / 12),
    CollisionShapeType.SPHERE: (1 / 20, 1 / 20, 1 / 20),
    CollisionShapeType.CYLINDER: (1 / 16, 1 / 16, 1 / 12),
}
"""Mean squares of the coordinates in a uniform shape about its center, in units of its squared extents."""


@dataclass(frozen=True, slots=True, eq=False)
class CompiledGeometry:
    """The collision shapes of a geometry, as arrays."""

    shapes: tuple[CollisionShape, ...]
    """The valid shapes; points of hulls are relative to their centers."""
    poses: Array
    """Poses of their bounding boxes in the body frame, k x 7, with unit quaternions."""
    sizes: Array
    """Sizes of those boxes, k x 3 [m]."""
    types: NDArray[np.intp]
    """Indices into `SHAPE_TYPES`, k."""
    hulls: tuple[tuple[int, Array, Array], ...]
    """For each hull: its index, its points, and its face normals, in the frame of its box."""
    bounds: tuple[Array, Array]
    """Lower and upper corner of all shapes in the body frame."""
    volume: float
    """Total volume [m³]."""
    center_of_mass: Array
    """Center of mass in the body frame [m]."""
    inertia: Array
    """Inertia tensor about the center of mass for 1 kg, 3 x 3 [m²]."""
    invalid_count: int
    """Number of shapes left out because of invalid numbers."""

    def is_box_of_size(self, size: Vector) -> bool:
        """Whether it is a single box of that size."""
        if len(self.shapes) != 1 or self.shapes[0].type is not CollisionShapeType.BOX:
            return False
        is_centered = np.abs(self.poses[0] - (0, 0, 0, 1, 0, 0, 0)).max() <= _POSE_TOLERANCE_M
        return bool(is_centered and np.abs(self.sizes[0] - size).max() <= _POSE_TOLERANCE_M)


def compile_geometry(shapes: Sequence[CollisionShape]) -> CompiledGeometry:
    """Converts collision shapes; the result is cached.

    Thin shapes are enlarged to `MIN_THICKNESS_M`; flat hulls become boxes.
    """
    return _compile_geometry(tuple(shapes))


@lru_cache(maxsize=_CACHE_SIZE)
def _compile_geometry(shapes: tuple[CollisionShape, ...]) -> CompiledGeometry:
    normalized = [_normalized(shape) for shape in shapes if _is_valid(shape)]
    valid_shapes = tuple(shape for shape, _ in normalized)
    hulls = tuple(hull for _, hull in normalized)
    poses = pose_array(shape.pose for shape in valid_shapes)
    poses[:, 3:] = normalize(poses[:, 3:])
    sizes = np.array([shape.size for shape in valid_shapes], dtype=float).reshape(-1, 3)
    types = np.array([SHAPE_TYPES.index(shape.type) for shape in valid_shapes], dtype=np.intp)
    low, high = OrientedBoxes.from_poses(poses, sizes).bounds()
    bounds = (low.min(axis=0), high.max(axis=0)) if valid_shapes else (np.zeros(3), np.zeros(3))
    mass = _mass_properties(valid_shapes, poses, sizes, hulls)
    hull_data = tuple(
        (row, hull.points, _face_directions(hull.normals)) for row, hull in enumerate(hulls) if hull is not None
    )
    return CompiledGeometry(
        valid_shapes, poses, sizes, types, hull_data, bounds, *mass, invalid_count=len(shapes) - len(valid_shapes)
    )


def _face_directions(normals: Array) -> Array:
    """The distinct face normals of a hull, at most `MAX_HULL_FACES`."""
    distinct = {tuple(row): None for row in normals.round(6).tolist()}
    directions = np.array(list(distinct))
    return (
        directions
        if len(directions) <= MAX_HULL_FACES
        else directions[np.linspace(0, len(directions) - 1, MAX_HULL_FACES).astype(np.intp)]
    )


def primitive_collision_type(body: Body) -> CollisionShapeType:
    """The collision shape type of a body without geometry."""
    return _TYPE_OF_PRIMITIVE[body.shape.type] if body.shape else CollisionShapeType.BOX


def fallback_collision_shape(body: Body, size: Vector) -> CollisionShape:
    """The collision shape of a body without geometry."""
    return CollisionShape(type=primitive_collision_type(body), size=_with_min_thickness(size))


def wall_collision_shapes(panels: tuple[WallPanel, ...]) -> tuple[CollisionShape, ...]:
    """The collision shapes of a hollow body."""
    return tuple(CollisionShape(size=_with_min_thickness(panel.size), pose=Pose(panel.center)) for panel in panels)


def _with_min_thickness(size: Vector) -> Vector:
    x, y, z = size
    return max(x, MIN_THICKNESS_M), max(y, MIN_THICKNESS_M), max(z, MIN_THICKNESS_M)


def _is_valid(shape: CollisionShape) -> bool:
    points = [number for point in shape.points for number in point]
    lengths = (*shape.size, *shape.pose.position, *points)
    in_range = all(isfinite(length) and abs(length) <= _MAX_LENGTH_M for length in lengths)
    norm = hypot(*shape.pose.quaternion)
    return in_range and _MIN_QUATERNION_NORM <= norm <= 1.0 / _MIN_QUATERNION_NORM and min(shape.size) >= 0.0


def _normalized(shape: CollisionShape) -> tuple[CollisionShape, Hull | None]:
    """A shape about its own center with the minimum thickness, and its hull if it is one."""
    if shape.type is not CollisionShapeType.HULL:
        return CollisionShape(type=shape.type, size=_with_min_thickness(shape.size), pose=shape.pose), None
    points = np.array(shape.points, dtype=float).reshape(-1, 3)
    low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(3), np.zeros(3))
    rotation = rotation_matrix(normalize(shape.pose.quaternion))
    center = np.array(shape.pose.position) + rotation @ ((low + high) / 2)
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
    """Volume, center of mass, and inertia for 1 kg of all shapes together."""
    if not shapes:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    rotations = rotation_matrix(poses[:, 3:])
    volumes, centers, second_moments = np.zeros(len(shapes)), poses[:, :3].copy(), np.zeros((len(shapes), 3, 3))
    for row, (shape, hull) in enumerate(zip(shapes, hulls, strict=True)):
        if hull is None:
            volumes[row] = _VOLUME_FRACTION[shape.type] * float(sizes[row].prod())
            second_moments[row] = volumes[row] * np.diag(sizes[row] ** 2 * MEAN_SQUARES[shape.type])
        else:
            volumes[row], center, second_moments[row] = hull.moments()
            centers[row] += rotations[row] @ center
    volume = float(volumes.sum())
    center = volumes @ centers / volume
    offsets = centers - center
    second_moment = (rotations @ second_moments @ np.swapaxes(rotations, 1, 2)).sum(axis=0) + (
        volumes * offsets.T
    ) @ offsets
    return volume, center, (np.trace(second_moment) * np.eye(3) - second_moment) / volume


_BOX, _SPHERE, _CYLINDER, _HULL = (
    SHAPE_TYPES.index(shape_type)
    for shape_type in (
        CollisionShapeType.BOX,
        CollisionShapeType.SPHERE,
        CollisionShapeType.CYLINDER,
        CollisionShapeType.HULL,
    )
)
_CHUNK_SIZE = 1 << 14
"""Number of pairs computed at once, which limits memory."""
_MAX_SHAPE_PAIRS = 1 << 18
"""Maximum number of shape pairs; beyond it, depths of the bodies' boxes are used."""


@dataclass(frozen=True, slots=True, eq=False)
class CollisionShapeBatch:
    """The collision shapes of n bodies at their current poses."""

    boxes: OrientedBoxes
    """A box around each shape."""
    types: NDArray[np.intp]
    first_shape: Indices
    """Index of each body's first shape; n + 1 entries."""
    hulls: dict[int, tuple[Array, Array]]
    """For each hull: its points and face normals in the world frame."""

    @classmethod
    def from_compiled(cls, poses: Array, compiled: Sequence[CompiledGeometry]) -> CollisionShapeBatch:
        """Creates a batch.

        Args:
            poses: poses of the bodies, n x 7.
            compiled: geometry of each body.
        """
        counts = np.array([len(each.shapes) for each in compiled], dtype=np.intp)
        first = np.concatenate([[0], np.cumsum(counts)]).astype(np.intp)
        local = np.concatenate([each.poses for each in compiled] or [np.zeros((0, 7))])
        sizes = np.concatenate([each.sizes for each in compiled] or [np.zeros((0, 3))])
        types = np.concatenate([each.types for each in compiled] or [np.zeros(0, dtype=np.intp)])
        boxes = OrientedBoxes.from_poses(pose_multiply(np.repeat(poses, counts, axis=0), local), sizes)
        hulls = {}
        for start, each in zip(first.tolist(), compiled, strict=False):
            for row, corners, directions in each.hulls:
                rotation = boxes.rotation[start + row].T
                hulls[start + row] = (corners @ rotation + boxes.center[start + row], directions @ rotation)
        return cls(boxes, types, first, hulls)

    def penetration_depths(self, a: Indices, b: Indices, fallback: Array, *, margin_m: float = 0.0) -> Array:
        """Penetration depth of each pair of bodies: that of their deepest pair of shapes, negative for a gap [m].

        Args:
            a: indices of the first bodies.
            b: indices of the second bodies.
            fallback: depths for pairs with too many shapes to compare.
            margin_m: gaps between bounds up to which shapes are compared [m]; farther ones are infinitely far apart.
        """
        count_a, count_b = (self.first_shape[each + 1] - self.first_shape[each] for each in (a, b))
        products = count_a * count_b
        order = np.argsort(products, kind="stable")
        is_compared = np.zeros(len(a), dtype=bool)
        is_compared[order] = np.cumsum(products[order]) <= _MAX_SHAPE_PAIRS
        deepest = np.where(is_compared, -np.inf, fallback)
        rows = np.flatnonzero(is_compared)
        pair = np.repeat(rows, products[rows])
        step = np.arange(len(pair)) - np.repeat(np.cumsum(products[rows]) - products[rows], products[rows])
        i, j = self.first_shape[a[pair]] + step // count_b[pair], self.first_shape[b[pair]] + step % count_b[pair]
        low, high = self.boxes.bounds()
        is_near = np.all((low[i] <= high[j] + margin_m) & (low[j] <= high[i] + margin_m), axis=1)
        pair, i, j = pair[is_near], i[is_near], j[is_near]
        for start in range(0, len(pair), _CHUNK_SIZE):
            chunk = slice(start, start + _CHUNK_SIZE)
            np.maximum.at(deepest, pair[chunk], self._shape_depths(i[chunk], j[chunk]))
        return deepest

    def separations(self, i: Indices, j: Indices, relative: Array) -> tuple[Array, Array]:
        """The translations of the first shape of each pair that separate it from the second one.

        Args:
            i: indices of the first shapes.
            j: indices of the second shapes.
            relative: how far the first shapes are shifted, relative to the second ones, p x 3 [m].

        Returns:
            For each pair, distances along k directions, p x k [m], and the directions, p x k x 3. The least distance is
            negative for a gap.
        """
        boxes = self.boxes
        turned_i, turned_j = (np.swapaxes(boxes.rotation[each], 1, 2) for each in (i, j))
        crossed = cross(turned_i[:, :, None, :], turned_j[:, None, :, :]).reshape(-1, 9, 3)
        between = boxes.center[j] - boxes.center[i] - relative
        axes = [turned_i, turned_j, crossed]
        if (self.types[i] != _BOX).any() or (self.types[j] != _BOX).any():
            axes += [between[:, None], *(self._perpendicular_axis(each, between)[:, None] for each in (i, j))]
        if self.hulls:
            axes += [self._normals(i), self._normals(j)]
        all_axes = np.concatenate(axes, axis=1)
        length = np.linalg.norm(all_axes, axis=2, keepdims=True)
        is_zero = length[..., 0] < 1e-6
        all_axes = np.divide(all_axes, length, out=np.zeros_like(all_axes), where=length >= 1e-6)
        forward, backward = self._overlaps(i, j, relative, all_axes)
        forward[is_zero] = backward[is_zero] = np.inf
        return np.concatenate([forward, backward], axis=1), np.concatenate([all_axes, -all_axes], axis=1)

    def overlaps_along(self, i: Indices, j: Indices, relative: Array, direction: Array) -> Array:
        """How far the first shape of each pair has to be moved in a direction to separate it from the second one [m].

        The arguments are those of `separations`, with one direction for all pairs.
        """
        axes = np.broadcast_to(direction, (len(i), 1, 3))
        return self._overlaps(i, j, relative, axes)[0][:, 0]

    def _overlaps(self, i: Indices, j: Indices, relative: Array, axes: Array) -> tuple[Array, Array]:
        """The distances that separate the first shapes along axes, p x k x 3, and against them."""
        (low_i, high_i), (low_j, high_j) = self._projections(i, axes), self._projections(j, axes)
        shift = np.einsum("pki,pi->pk", axes, relative)
        return high_j - low_i - shift, high_i + shift - low_j

    def _shape_depths(self, i: Indices, j: Indices) -> Array:
        depths = penetration_depths(self.boxes, i, j)
        not_boxes = np.flatnonzero((depths > 0.0) & ((self.types[i] != _BOX) | (self.types[j] != _BOX)))
        if len(not_boxes):
            depths[not_boxes] = np.minimum(depths[not_boxes], self._projection_depths(i[not_boxes], j[not_boxes]))
        return depths

    def _projection_depths(self, i: Indices, j: Indices) -> Array:
        """The least overlap along the axes of both boxes, between their centers, and along hull normals."""
        boxes = self.boxes
        between = boxes.center[j] - boxes.center[i]
        axes = [np.swapaxes(boxes.rotation[i], 1, 2), np.swapaxes(boxes.rotation[j], 1, 2), between[:, None]]
        axes += [self._perpendicular_axis(each, between)[:, None] for each in (i, j)]
        if self.hulls:
            axes += [self._normals(i), self._normals(j)]
        all_axes = np.concatenate(axes, axis=1)
        length = np.linalg.norm(all_axes, axis=2, keepdims=True)
        is_zero = length[..., 0] < 1e-9
        all_axes = np.divide(all_axes, length, out=np.zeros_like(all_axes), where=length >= 1e-9)
        (low_i, high_i), (low_j, high_j) = self._projections(i, all_axes), self._projections(j, all_axes)
        overlap = np.minimum(high_i - low_j, high_j - low_i)
        overlap[is_zero] = np.inf
        return np.asarray(overlap.min(axis=1))

    def _perpendicular_axis(self, rows: Indices, between: Array) -> Array:
        """The component of the vectors between centers that is perpendicular to the shapes' z axes."""
        axis = self.boxes.rotation[rows][:, :, 2]
        return np.asarray(between - np.einsum("pi,pi->p", between, axis)[:, None] * axis)

    def _normals(self, rows: Indices) -> Array:
        result = np.zeros((len(rows), MAX_HULL_FACES, 3))
        for row in set(rows.tolist()) & self.hulls.keys():
            normals = self.hulls[row][1]
            result[rows == row, : len(normals)] = normals
        return result

    def _projections(self, rows: Indices, axes: Array) -> tuple[Array, Array]:
        """Intervals that the shapes cover along axes; axes are p x k x 3."""
        boxes = self.boxes
        along = np.einsum("pki,pij->pkj", axes, boxes.rotation[rows]) * boxes.half_extents[rows][:, None]
        types = self.types[rows][:, None]
        absolute = np.abs(along)
        radial = np.linalg.norm(along[..., :2], axis=2)
        reach = np.where(types == _SPHERE, np.linalg.norm(along, axis=2), absolute.sum(axis=2))
        reach = np.where(types == _CYLINDER, radial + absolute[..., 2], reach)
        center = np.einsum("pki,pi->pk", axes, boxes.center[rows])
        low, high = center - reach, center + reach
        for row in set(rows.tolist()) & self.hulls.keys():
            is_hull = rows == row
            projected = np.einsum("pki,ni->pkn", axes[is_hull], self.hulls[row][0])
            low[is_hull], high[is_hull] = projected.min(axis=2), projected.max(axis=2)
        return low, high
