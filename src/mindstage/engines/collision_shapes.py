"""Solids: what of a form can be touched, made ready once for all bodies that have that form.

How large each part is and where it sits come as arrays, for deciding about many bodies at once; how the mass lies is
worked out from the volumes of the parts, as though they were of one stuff and did not overlap.

Hollow: a box with room inside, made of plates.

A map says that milk is in the fridge and where; it does not say that a fridge has walls and shelves. What stands in a
box must stand on something, so the box gets a floor at each height on which its contents stand.

Parts: how deep the solids of different bodies stand in one another, in bulk.

Two convex solids are apart if along any axis their shadows are. For boxes fifteen axes settle it; round ones and hulls
are held against those and a few of their own, which may find them a little deeper than they are, never less deep.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import isfinite, pi

import numpy as np
from numpy.typing import NDArray

from mindstage.scene import Body, CollisionShape, CollisionShapeType, Pose, PrimitiveType, Vector
from mindstage.scene.bounding_boxes import Indices, OrientedBoxes, penetration_depths
from mindstage.scene.mesh import Hull, convex_hull
from mindstage.scene.transforms import Array, normalize, pose_array, pose_multiply, rotation_matrix

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
_MIN_THICKNESS_M = 0.001
_CLEARANCE_M = 0.0005
"""Between a wall and what stands next to it."""
_FEW = 8
"""So many contents are compared faster in plain numbers than in arrays."""
_SAME_LEVEL_M = 0.004
"""Contents whose undersides differ by less stand on one level."""
_SIDE_NAMES = ("to the back", "to the front", "to the right", "to the left", "to the bottom", "to the top")
"""Of the body's own axes: x backwards and forwards, y, z."""


@dataclass(frozen=True, slots=True)
class WallPanel:
    """A solid part, parallel to the hollow body's axes."""

    center: Vector
    """In the body's frame [m]."""
    size: Vector
    """[m]."""


@dataclass(frozen=True, slots=True)
class HollowBox:
    """What became of the box."""

    panels: tuple[WallPanel, ...]
    opening: str
    """Where one reaches in, in words."""


def hollow_box(boxes: OrientedBoxes, outer: int, inner: Sequence[int], fronts: Sequence[Array]) -> HollowBox:
    """Walls, an opening and floors for a box with contents.

    Args:
        boxes: all boxes there are.
        outer: the one to be made hollow.
        inner: those inside.
        fronts: centers, in the world, of what closes it (doors): each opens the side that it is nearest to.
            Without any, the top is open.
    """
    half, turn = boxes.half_extents[outer], boxes.rotation[outer]
    low, high = _extents(boxes, outer, inner)
    up = turn[2].tolist()
    vertical = max(range(3), key=lambda axis: abs(up[axis]))
    top = 2 * vertical + (1 if up[vertical] > 0 else 0)
    sides = {_side_towards((front - boxes.center[outer]) @ turn, half) for front in fronts} - {top ^ 1}
    opening = sides or {top}
    room = _interior(half, low, high)
    reach: list[float] = half.tolist()
    plates = [
        _panel(reach, side // 2, *_wall_range(side, reach, room))
        for side in range(6)
        if side not in opening and side // 2 != vertical
    ]
    if top not in opening:
        plates.append(_panel(reach, vertical, *_wall_range(top, reach, room)))
    plates += _floors(reach, vertical, up[vertical] > 0, low, high)
    words = " and ".join(_SIDE_NAMES[side] for side in sorted(opening))
    return HollowBox(tuple(plate for plate in plates if min(plate.size) > 0.0), words)


def _extents(boxes: OrientedBoxes, outer: int, inner: Sequence[int]) -> tuple[Array, Array]:
    """Lower and upper corners of the inner boxes, each n x 3, in the frame of the outer one."""
    turn, inside = boxes.rotation[outer], list(inner)
    center = (boxes.center[inside] - boxes.center[outer]) @ turn
    reach = (np.abs(turn.T @ boxes.rotation[inside]) @ boxes.half_extents[inside][:, :, None])[:, :, 0]
    return center - reach, center + reach


def _side_towards(point: Array, half: Array) -> int:
    """The side of the box that a point is farthest out of: 0 is x backwards, 1 x forwards, and so on for y and z."""
    place: list[float] = point.tolist()
    out = [abs(along) - extent for along, extent in zip(place, half.tolist(), strict=True)]
    axis = max(range(3), key=out.__getitem__)
    return 2 * axis + int(place[axis] > 0)


def _interior(half: Array, low: Array, high: Array) -> tuple[list[float], list[float]]:
    """The room between the walls: as wide as the contents need, no wall thicker than usual."""
    usual = [extent - min(_WALL_THICKNESS_M, extent / 5) for extent in half.tolist()]
    start = [min(-each, first - _CLEARANCE_M) for each, first in zip(usual, low.min(axis=0).tolist(), strict=True)]
    end = [max(each, last + _CLEARANCE_M) for each, last in zip(usual, high.max(axis=0).tolist(), strict=True)]
    return start, end


def _wall_range(side: int, half: list[float], room: tuple[list[float], list[float]]) -> tuple[float, float]:
    """From where to where a wall goes along its own axis; the two are equal where there is no room for one."""
    axis = side // 2
    if side % 2:
        start, end = room[1][axis], half[axis]
    else:
        start, end = -half[axis], room[0][axis]
    return (start, end) if end - start >= _MIN_THICKNESS_M else (start, start)


def _floors(half: list[float], vertical: int, upright: bool, low: Array, high: Array) -> list[WallPanel]:
    """A plate under each level of contents that does not stand on other contents."""
    flat = [axis for axis in range(3) if axis != vertical]
    bottoms = (low if upright else -high)[:, vertical]
    tops = (high if upright else -low)[:, vertical]
    bottom = -half[vertical]
    lowest = bottoms.tolist()
    if 1 < len(lowest) <= _FEW:
        firsts, lasts, highest = low.tolist(), high.tolist(), tops.tolist()
        lowest = [
            level
            for one, level in enumerate(lowest)
            if not any(
                other != one
                and abs(top - level) < _SAME_LEVEL_M
                and all(
                    firsts[one][axis] < lasts[other][axis] and firsts[other][axis] < lasts[one][axis] for axis in flat
                )
                for other, top in enumerate(highest)
            )
        ]
    elif len(lowest) > _FEW:
        beneath = np.abs(tops - bottoms[:, None]) < _SAME_LEVEL_M
        beside = np.all((low[:, flat] < high[:, None, flat]) & (low[:, None, flat] < high[:, flat]), axis=2)
        stacked = np.any(beneath & beside & ~np.eye(len(low), dtype=bool), axis=1)
        lowest = bottoms[~stacked].tolist()
    levels: list[float] = []
    for level in sorted(lowest):
        if not (levels and level - levels[-1] < _SAME_LEVEL_M):
            levels.append(level)
    floors = []
    for level in levels:
        ceiling_below = max([bottom, *(top for top in tops.tolist() if top <= level + _SAME_LEVEL_M)])
        start = bottom if level == levels[0] else max(level - _WALL_THICKNESS_M, ceiling_below + _CLEARANCE_M)
        if level - start >= _MIN_THICKNESS_M:
            floors.append(_panel(half, vertical, *((start, level) if upright else (-level, -start))))
    return floors


def _panel(half: list[float], axis: int, start: float, end: float) -> WallPanel:
    """A plate across the whole box, between two places along one axis."""
    center, size = [0.0, 0.0, 0.0], [2 * extent for extent in half]
    center[axis], size[axis] = (start + end) / 2, end - start
    return WallPanel((center[0], center[1], center[2]), (size[0], size[1], size[2]))


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


_BOX, _SPHERE, _CYLINDER, _HULL = (
    SHAPE_TYPES.index(kind)
    for kind in (
        CollisionShapeType.BOX,
        CollisionShapeType.SPHERE,
        CollisionShapeType.CYLINDER,
        CollisionShapeType.HULL,
    )
)
_CHUNK_SIZE = 1 << 14
"""So many pairs are looked at in one go; it bounds the memory."""
_MAX_SHAPE_PAIRS = 1 << 18
"""So many pairs of solids are looked at in all; bodies beyond that are as deep in one another as their boxes are."""


@dataclass(frozen=True, slots=True, eq=False)
class CollisionShapeBatch:
    """The solids of n bodies as they stand."""

    boxes: OrientedBoxes
    """Round each of the solids."""
    types: NDArray[np.intp]
    first_shape: Indices
    """n + 1: where each body's solids begin."""
    hulls: dict[int, tuple[Array, Array]]
    """Of those that are hulls: their corners and the normals of their faces, in the world."""

    @classmethod
    def from_compiled(cls, poses: Array, compiled: Sequence[CompiledGeometry]) -> CollisionShapeBatch:
        """From the bodies' poses (n x 7) and what each is made of."""
        counts = np.array([len(each.shapes) for each in compiled], dtype=np.intp)
        first = np.concatenate([[0], np.cumsum(counts)]).astype(np.intp)
        local = np.concatenate([each.poses for each in compiled] or [np.zeros((0, 7))])
        sizes = np.concatenate([each.sizes for each in compiled] or [np.zeros((0, 3))])
        kinds = np.concatenate([each.types for each in compiled] or [np.zeros(0, dtype=np.intp)])
        boxes = OrientedBoxes.from_poses(pose_multiply(np.repeat(poses, counts, axis=0), local), sizes)
        hulls = {}
        for begin, each in zip(first.tolist(), compiled, strict=False):
            for row, corners, directions in each.hulls:
                turn = boxes.rotation[begin + row].T
                hulls[begin + row] = (corners @ turn + boxes.center[begin + row], directions @ turn)
        return cls(boxes, kinds, first, hulls)

    def penetration_depths(self, a: Indices, b: Indices, fallback: Array) -> Array:
        """How deep the bodies of each pair stand in one another: as deep as their deepest solids do [m].

        Args:
            a: numbers of bodies.
            b: the same.
            otherwise: what to say of pairs of so many solids that looking at all of them would take too long.
        """
        count_a, count_b = (self.first_shape[each + 1] - self.first_shape[each] for each in (a, b))
        products = count_a * count_b
        order = np.argsort(products, kind="stable")
        looked_at = np.zeros(len(a), dtype=bool)
        looked_at[order] = np.cumsum(products[order]) <= _MAX_SHAPE_PAIRS
        deepest = np.where(looked_at, -np.inf, fallback)
        rows = np.flatnonzero(looked_at)
        pair = np.repeat(rows, products[rows])
        step = np.arange(len(pair)) - np.repeat(np.cumsum(products[rows]) - products[rows], products[rows])
        i, j = self.first_shape[a[pair]] + step // count_b[pair], self.first_shape[b[pair]] + step % count_b[pair]
        low, high = self.boxes.bounds()
        meet = np.all((low[i] <= high[j]) & (low[j] <= high[i]), axis=1)
        pair, i, j = pair[meet], i[meet], j[meet]
        for start in range(0, len(pair), _CHUNK_SIZE):
            piece = slice(start, start + _CHUNK_SIZE)
            np.maximum.at(deepest, pair[piece], self._shape_depths(i[piece], j[piece]))
        return deepest

    def _shape_depths(self, i: Indices, j: Indices) -> Array:
        found = penetration_depths(self.boxes, i, j)
        others = np.flatnonzero((found > 0.0) & ((self.types[i] != _BOX) | (self.types[j] != _BOX)))
        if len(others):
            found[others] = np.minimum(found[others], self._projection_depths(i[others], j[others]))
        return found

    def _projection_depths(self, i: Indices, j: Indices) -> Array:
        """The least overlap of the shadows along the axes of both, between both, and of the faces of hulls."""
        boxes = self.boxes
        between = boxes.center[j] - boxes.center[i]
        axes = [np.swapaxes(boxes.rotation[i], 1, 2), np.swapaxes(boxes.rotation[j], 1, 2), between[:, None]]
        axes += [self._perpendicular_axis(each, between)[:, None] for each in (i, j)]
        if self.hulls:
            axes += [self._normals(i), self._normals(j)]
        every = np.concatenate(axes, axis=1)
        length = np.linalg.norm(every, axis=2, keepdims=True)
        none = length[..., 0] < 1e-9
        every = np.divide(every, length, out=np.zeros_like(every), where=length >= 1e-9)
        (low_i, high_i), (low_j, high_j) = self._projections(i, every), self._projections(j, every)
        overlap = np.minimum(high_i - low_j, high_j - low_i)
        overlap[none] = np.inf
        return np.asarray(overlap.min(axis=1))

    def _perpendicular_axis(self, rows: Indices, between: Array) -> Array:
        """The way between two middles without what of it goes along the axis of a cylinder."""
        axis = self.boxes.rotation[rows][:, :, 2]
        return np.asarray(between - np.einsum("pi,pi->p", between, axis)[:, None] * axis)

    def _normals(self, rows: Indices) -> Array:
        out = np.zeros((len(rows), MAX_HULL_FACES, 3))
        for row in set(rows.tolist()) & self.hulls.keys():
            normals = self.hulls[row][1]
            out[rows == row, : len(normals)] = normals
        return out

    def _projections(self, rows: Indices, axes: Array) -> tuple[Array, Array]:
        """From where to where the solids reach along axes, p x k x 3."""
        boxes = self.boxes
        along = np.einsum("pki,pij->pkj", axes, boxes.rotation[rows]) * boxes.half_extents[rows][:, None]
        kinds = self.types[rows][:, None]
        flat = np.abs(along)
        level = np.linalg.norm(along[..., :2], axis=2)
        reach = np.where(kinds == _SPHERE, np.linalg.norm(along, axis=2), flat.sum(axis=2))
        reach = np.where(kinds == _CYLINDER, level + flat[..., 2], reach)
        middle = np.einsum("pki,pi->pk", axes, boxes.center[rows])
        low, high = middle - reach, middle + reach
        for row in set(rows.tolist()) & self.hulls.keys():
            mine = rows == row
            shadow = np.einsum("pki,ni->pkn", axes[mine], self.hulls[row][0])
            low[mine], high[mine] = shadow.min(axis=2), shadow.max(axis=2)
        return low, high
