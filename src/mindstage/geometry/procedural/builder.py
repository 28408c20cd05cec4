"""Building blocks of procedural shapes: templates, the builder that they draw with, sides, cutouts, collision parts.

A `ShapeTemplate` is a class whose fields are the parameters of a shape; the names of fields are those in ontologies
(`ms:wall 0.012`). Its `build` adds parts to a `GeometryBuilder`, in the template frame: x to the front, y to the left,
z up, origin at the center of the size. Parameters are upper bounds: a wall of 15 mm is thinner where a fifth of the
size is less. The finished shape is scaled to fit the size exactly.

An `AxisPermutation` converts from the template frame to the body frame: the front can be any of the six sides of a
body, and the top any side on another axis. These are rotations by right angles, which are exact.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from enum import StrEnum
from functools import cache, partial
from itertools import combinations, product
from types import MappingProxyType
from typing import Annotated, ClassVar, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from mindstage.errors import InvalidShapeError
from mindstage.geometry.procedural import materials as finishes
from mindstage.geometry.procedural.texture_coordinates import (
    PrintLayout,
    RoundAxis,
    project_boxes,
    project_flat,
    project_print,
    project_round,
)
from mindstage.scene import IDENTITY, Color, Pose, Quaternion, Vector
from mindstage.scene.geometry import CollisionShape, CollisionShapeType, PbrMaterial
from mindstage.scene.mesh import TriangleMesh, boxes, joined, lathe, loft, panel_with_cutouts, scaled, sweep
from mindstage.scene.transforms import Array, quat_multiply, quaternion_from_matrix
from mindstage.scene.world_model import FrozenStruct
from mindstage.textures.catalog import TextureInfo

__all__ = [
    "AxisPermutation",
    "BodySide",
    "CollisionPart",
    "Count",
    "Cutout",
    "Fraction",
    "GeometryBuilder",
    "Hole",
    "Length",
    "LocalSupportSurface",
    "MaterialRoles",
    "PositiveFraction",
    "PrintedMesh",
    "ShapeTemplate",
    "TemplateFitError",
    "Thickness",
    "covering_rectangles",
    "grid_cells",
    "merge_narrow_strips",
    "ring_parts",
    "turn_between",
]


Hole = tuple[Array, Array]
"""The lower and the upper corner of a hole, in the plane of the plate."""

_MIN_FILL = 0.6
"""Smallest fraction of their common bounds that two adjacent holes fill if they are merged."""


def grid_cells(low: Array, high: Array, holes: Sequence[Hole]) -> tuple[tuple[Array, Array], NDArray[np.bool_]]:
    """Returns the coordinates that divide a plate at the edges of its holes, and which cells remain."""
    cuts = []
    for axis in range(2):
        marks = _sorted_unique([low[axis], high[axis], *(corner[axis] for hole in holes for corner in hole)])
        inner = marks[(marks > low[axis] + 1e-4) & (marks < high[axis] - 1e-4)]
        inner = inner[np.diff(inner, prepend=-np.inf) > 1e-6]
        cuts.append(np.array([low[axis], *inner, high[axis]]))
    x, y = ((cut[:-1] + cut[1:]) / 2 for cut in cuts)
    kept = np.ones((len(x), len(y)), dtype=bool)
    for start, end in holes:
        kept &= ~(((x > start[0]) & (x < end[0]))[:, None] & ((y > start[1]) & (y < end[1]))[None])
    return (cuts[0], cuts[1]), kept


def merge_narrow_strips(low: Array, high: Array, holes: Sequence[Hole], min_width: float) -> list[Hole]:
    """Returns the holes, extended so that few strips between their edges are narrower than a width.

    Such strips support nothing and are barely visible, but each is a collision shape.

    Args:
        low: lower corner of the plate, in its plane [m].
        high: upper corner of the plate [m].
        min_width: the smallest width of strips [m].
    """
    starts, ends = (np.array([hole[end] for hole in holes]).reshape(-1, 2) for end in (0, 1))
    for axis in range(2):
        marks = _sorted_unique([low[axis], high[axis], *starts[:, axis], *ends[:, axis]])
        first, last = _merge_marks(marks, min_width)
        starts[:, axis] = first[np.searchsorted(marks, starts[:, axis])]
        ends[:, axis] = last[np.searchsorted(marks, ends[:, axis])]
    return _merge_holes(list(zip(starts, ends, strict=True)))


def _sorted_unique(marks: Sequence[float]) -> Array:
    """Returns the sorted unique numbers; unlike `numpy.unique` without the import of `numpy.ma`."""
    return np.array(sorted(set(marks)))


def _merge_marks(marks: Array, min_width: float) -> tuple[Array, Array]:
    """Returns, for each mark, the first and the last mark of its cluster."""
    first, last = marks.copy(), marks.copy()
    begin = 0
    for index in range(1, len(marks) + 1):
        if index == len(marks) or marks[index] - marks[begin] >= min_width:
            first[begin:index], last[begin:index] = marks[begin], marks[index - 1]
            begin = index
    return first, last


def _merge_holes(holes: list[Hole]) -> list[Hole]:
    """Returns the holes, with adjacent ones merged if they fill most of their common bounds."""
    for one, other in combinations(range(len(holes)), 2):
        (low_a, high_a), (low_b, high_b) = holes[one], holes[other]
        common = np.minimum(high_a, high_b) - np.maximum(low_a, low_b)
        low, high = np.minimum(low_a, low_b), np.maximum(high_a, high_b)
        fills = np.prod(high_a - low_a) + np.prod(high_b - low_b) - np.prod(np.maximum(common, 0.0))
        if common.min() >= 0.0 and fills >= _MIN_FILL * np.prod(high - low):
            rest = [hole for number, hole in enumerate(holes) if number not in (one, other)]
            return _merge_holes([*rest, (low, high)])
    return holes


class BodySide(StrEnum):
    """One of the six sides of a body, named by its axes."""

    FRONT = "+x"
    BACK = "-x"
    LEFT = "+y"
    RIGHT = "-y"
    TOP = "+z"
    BOTTOM = "-z"

    @classmethod
    def from_axis(cls, axis: int, sign: int) -> BodySide:
        """Returns the side at one end of an axis (0, 1, 2 for x, y, z)."""
        return cls(f"{'+' if sign > 0 else '-'}{'xyz'[axis]}")

    @property
    def axis(self) -> int:
        """0, 1, 2 for x, y, z."""
        return "xyz".index(self.value[1])

    @property
    def sign(self) -> int:
        """1 for the positive end of the axis, otherwise -1."""
        return 1 if self.value[0] == "+" else -1

    @property
    def opposite(self) -> BodySide:
        """The opposite side."""
        return BodySide.from_axis(self.axis, -self.sign)

    @property
    def vector(self) -> Vector:
        """The outward unit normal."""
        x, y, z = (float(self.sign) if axis == self.axis else 0.0 for axis in range(3))
        return (x, y, z)


class Cutout(FrozenStruct, frozen=True, kw_only=True):
    """A box that stays free: the opening of a door in a wall, of a sink in a countertop."""

    low: Vector
    """The lower corner, in the body frame [m]."""
    high: Vector
    """The upper corner [m]."""


class AxisPermutation:
    """A rotation by right angles from the template frame to the body frame."""

    def __init__(self, front: BodySide, up: BodySide) -> None:
        if front.axis == up.axis:
            raise InvalidShapeError("any", reason=f"its front {front.value} and its top {up.value} are on one axis")
        left = np.cross(up.vector, front.vector)
        self.matrix: Array = np.stack([front.vector, left, up.vector], axis=1)
        w, x, y, z = quaternion_from_matrix(self.matrix).tolist()
        self.quaternion: Quaternion = (w, x, y, z)
        self._axes = [int(np.flatnonzero(row)[0]) for row in self.matrix]
        self.is_identity = bool(np.array_equal(self.matrix, np.eye(3)))
        """Whether both frames are equal."""

    def template_size(self, size: Vector) -> Vector:
        """Returns the extents of a body along the axes of the template frame."""
        x, y, z = (float(value) for value in np.abs(self.matrix.T) @ np.array(size))
        return (x, y, z)

    def body_size(self, template_size: Vector) -> Vector:
        """Returns extents in the template frame along the axes of the body frame."""
        x, y, z = (template_size[axis] for axis in self._axes)
        return (x, y, z)

    def to_body(self, template_points: Array) -> Array:
        """Converts points or directions, n x 3, to the body frame."""
        return template_points if self.is_identity else template_points @ self.matrix.T

    def vector_to_body(self, template_vector: Vector) -> Vector:
        """Converts one point or direction to the body frame."""
        x, y, z = (self.matrix @ np.array(template_vector)).tolist()
        return (x, y, z)

    def template_side(self, side: BodySide) -> BodySide:
        """Returns the side in the template frame of a side of the body."""
        normal = self.matrix.T @ np.array(side.vector)
        axis = int(np.flatnonzero(normal)[0])
        return BodySide.from_axis(axis, int(normal[axis]))

    def template_cutout(self, cutout: Cutout) -> tuple[Array, Array]:
        """Returns the lower and upper corner of a cutout in the template frame."""
        corners = np.array([cutout.low, cutout.high]) @ self.matrix
        return corners.min(axis=0), corners.max(axis=0)


@cache
def turn_between(front: BodySide, up: BodySide) -> AxisPermutation:
    """Returns the permutation for a front and a top; each of the 24 is cached, so its arrays must not be modified."""
    return AxisPermutation(front, up)


_SEGMENTS = 16
"""Points per ring of elliptic cylinders, which become hulls."""
_MIN_UPRIGHT_RATIO = 0.75
"""Walls with at least this ratio of foot to rim radius are approximated as vertical."""
_CYLINDER_TURNS: tuple[tuple[float, float, float, float], ...] = (
    (0.5**0.5, 0.0, 0.5**0.5, 0.0),
    (0.5**0.5, -(0.5**0.5), 0.0, 0.0),
    (1.0, 0.0, 0.0, 0.0),
)
"""Rotations of the z axis of a cylinder to x, y and z."""


class CollisionPart(NamedTuple):
    """A convex collision shape in the template frame."""

    type: CollisionShapeType
    points: Array
    """The points of a hull; otherwise the two corners of the bounds."""
    axis: int = 2
    """The axis of a cylinder."""
    turn_rad: float = 0.0
    """Rotation of the points about a vertical axis through `rotation_center`."""
    rotation_center: tuple[float, float] = (0.0, 0.0)

    def scaled(self, scale: Array, shift: Array) -> CollisionPart:
        """Returns the part scaled along each axis, then translated."""
        if self.turn_rad and not np.isclose(scale[0], scale[1], rtol=1e-9):
            return self._as_fixed_hull().scaled(scale, shift)
        x, y = (np.array(self.rotation_center) * scale[:2] + shift[:2]).tolist()
        return self._replace(points=self.points * scale + shift, rotation_center=(x, y))

    def clipped(self, low: Array, high: Array) -> CollisionPart:
        """Returns the part clipped to a box, which removes rounding errors."""
        return self if self.turn_rad else self._replace(points=np.clip(self.points, low, high))

    def to_collision_shape(self, turn: AxisPermutation) -> CollisionShape | None:
        """Returns the collision shape in the body frame; None if it has no volume."""
        if self.type is CollisionShapeType.CYLINDER and not self._is_circular():
            return self._as_hull().to_collision_shape(turn)
        low, high = self.points.min(axis=0), self.points.max(axis=0)
        if (high - low).min() <= 1e-9:
            return None
        if self.turn_rad:
            return self._rotated_shape(turn, low, high)
        points = turn.to_body(self.points)
        low, high = points.min(axis=0), points.max(axis=0)
        center = (low + high) / 2
        if self.type is CollisionShapeType.HULL:
            local = tuple(_vector(point) for point in points - center)
            return CollisionShape(type=self.type, size=_vector(high - low), pose=Pose(_vector(center)), points=local)
        if self.type is not CollisionShapeType.CYLINDER:
            return CollisionShape(type=self.type, size=_vector(high - low), pose=Pose(_vector(center)))
        axis = int(np.flatnonzero(turn.matrix[:, self.axis])[0])
        extents = high - low
        across = float(np.delete(extents, axis).min())
        quaternion = _CYLINDER_TURNS[axis] if axis != 2 else IDENTITY.quaternion
        size = (across, across, float(extents[axis]))
        return CollisionShape(type=self.type, size=size, pose=Pose(_vector(center), quaternion))

    def _rotated_shape(self, turn: AxisPermutation, low: Array, high: Array) -> CollisionShape:
        """Returns the shape of a rotated part: only its pose is rotated, so copies have equal points."""
        center = (low + high) / 2
        cosine, sine = np.cos(self.turn_rad), np.sin(self.turn_rad)
        x, y = center[:2] - self.rotation_center
        spot = (
            self.rotation_center[0] + cosine * x - sine * y,
            self.rotation_center[1] + sine * x + cosine * y,
            center[2],
        )
        about_z = [np.cos(self.turn_rad / 2), 0.0, 0.0, np.sin(self.turn_rad / 2)]
        w, i, j, k = quat_multiply(turn.quaternion, about_z).tolist()
        pose = Pose(turn.vector_to_body(spot), (w, i, j, k))
        local = self.points - center if self.type is CollisionShapeType.HULL else ()
        return CollisionShape(type=self.type, size=_vector(high - low), pose=pose, points=tuple(map(_vector, local)))

    def _as_fixed_hull(self) -> CollisionPart:
        """Returns the part as a hull without a rotation."""
        points = self.points
        if self.type is CollisionShapeType.BOX:
            points = np.array(list(product(*points.T)))
        cosine, sine = np.cos(self.turn_rad), np.sin(self.turn_rad)
        x, y = points[:, 0] - self.rotation_center[0], points[:, 1] - self.rotation_center[1]
        turned = [
            self.rotation_center[0] + cosine * x - sine * y,
            self.rotation_center[1] + sine * x + cosine * y,
            points[:, 2],
        ]
        return CollisionPart(CollisionShapeType.HULL, np.stack(turned, axis=1))

    def _is_circular(self) -> bool:
        extents = np.delete(self.points[1] - self.points[0], self.axis)
        return bool(abs(extents[0] - extents[1]) <= 1e-6 * extents.max())

    def _as_hull(self) -> CollisionPart:
        low, high = self.points
        angle = np.arange(_SEGMENTS) * (2 * np.pi / _SEGMENTS)
        across = [axis for axis in range(3) if axis != self.axis]
        points = np.empty((2, _SEGMENTS, 3))
        circle = np.stack([np.cos(angle), np.sin(angle)], axis=1).round(15)
        points[:, :, across] = ((low + high) / 2)[across] + circle * ((high - low) / 2)[across]
        points[0, :, self.axis], points[1, :, self.axis] = low[self.axis], high[self.axis]
        return CollisionPart(CollisionShapeType.HULL, points.reshape(-1, 3))


def ring_parts(
    low: Array, high: Array, outer: tuple[float, float], inner: tuple[float, float], pieces: int
) -> list[CollisionPart]:
    """Returns the wall of an upright round vessel as convex parts.

    The pieces of a circular wall are rotated copies of one part: boxes if the wall is nearly vertical, which engines
    process fastest, otherwise hulls.

    Args:
        low: lower corner of the bounds [m].
        high: upper corner of the bounds [m].
        outer: outer radii at the bottom and at the top, as fractions of the bounds.
        inner: inner radii at the bottom and at the top.
        pieces: the number of parts.
    """
    half, middle = (high - low)[:2] / 2, (low + high)[:2] / 2
    radius, step = float(half.min()), 2 * np.pi / pieces
    center = (float(middle[0]), float(middle[1]))
    if min(outer) >= _MIN_UPRIGHT_RATIO * max(outer):
        reach = radius * (outer[0] + outer[1]) / 2
        chord, face = 2 * reach * np.sin(step / 2), reach * np.cos(step / 2)
        wall = max(face - radius * (inner[0] + inner[1]) / 2 * np.cos(step / 2), 0.05 * reach)
        corners = np.array(
            [
                [center[0] + face - wall, center[1] - chord / 2, low[2]],
                [center[0] + face, center[1] + chord / 2, high[2]],
            ]
        )
        one = CollisionPart(CollisionShapeType.BOX, corners, rotation_center=center)
    else:
        angle = np.array([-step / 2, 0.0, step / 2])
        circle = np.stack([np.cos(angle), np.sin(angle)], axis=1) * radius
        rows = []
        for level, outer_share, inner_share in zip((low[2], high[2]), outer, inner, strict=True):
            row = np.concatenate([circle * outer_share, circle[[0, 2]] * inner_share]) + middle
            rows.append(np.column_stack([row, np.full(len(row), level)]))
        one = CollisionPart(CollisionShapeType.HULL, np.concatenate(rows), rotation_center=center)
    parts = [one._replace(turn_rad=number * step) for number in range(pieces)]
    if np.isclose(half[0], half[1], rtol=1e-9):
        return parts
    scale = np.array([*(half / radius), 1.0])
    return [part._as_fixed_hull().scaled(scale, np.array([*(middle * (1 - scale[:2])), 0.0])) for part in parts]


def covering_rectangles(cuts: tuple[Array, Array], kept: NDArray[np.bool_]) -> Iterator[tuple[Array, Array]]:
    """Yields rectangles that cover the kept cells of a plate, each as its two corners."""
    left = kept.copy()
    while left.any():
        row, column = (int(index) for index in np.argwhere(left)[0])
        end = column + int(np.argmin(np.append(left[row, column:], False)))
        last = row + 1
        while last < len(left) and left[last, column:end].all():
            last += 1
        left[row:last, column:end] = False
        yield np.array([cuts[0][row], cuts[1][column]]), np.array([cuts[0][last], cuts[1][end]])


def _vector(row: Array) -> Vector:
    x, y, z = row.tolist()
    return (x, y, z)


_BEVEL_M = 0.004
_SEGMENTS_BY_RADIUS = ((0.03, 32), (0.012, 20), (0.0, 12))
"""Smallest radius [m] and number of points of circles."""
_EPSILON_M = 1e-9
_EXACT = 1e-12
"""Bounds that differ by less are equal [m]."""

_BLOCK_FACES = np.array(
    [
        *((0, 2, 1), (0, 3, 2), (4, 5, 6), (4, 6, 7)),
        *(face for a, b in ((0, 1), (1, 2), (2, 3), (3, 0)) for face in ((a, b, b + 4), (a, b + 4, a + 4))),
    ],
    dtype=np.uint32,
)

Picture = Callable[[Color], NDArray[np.uint8]]
"""Returns a picture, h x w x 4, on paper of a color."""
Corner = Sequence[float] | Array
Profile = Sequence[tuple[float, float]]


class TemplateFitError(Exception):
    """The size is too small for the parts of the shape."""


class LocalSupportSurface:
    """A support surface in the template frame."""

    def __init__(self, low: Array, high: Array, level: float, clearance: float | None, *, is_inside: bool) -> None:
        self.low, self.high = low, high
        self.level, self.clearance, self.is_inside = level, clearance, is_inside


class _Part(NamedTuple):
    """A visual part whose mesh is created on demand."""

    low: Array
    """Lower corner of its bounds [m]."""
    high: Array
    """Upper corner of its bounds [m]."""
    make: Callable[[], TriangleMesh]
    around: RoundAxis | None = None
    """Its axis, if it is round."""


class PrintedMesh(NamedTuple):
    """A part with a picture."""

    role: str
    mesh: TriangleMesh
    picture: Picture


class _PrintedPart(NamedTuple):
    role: str
    part: _Part
    layout: PrintLayout
    picture: Picture


class GeometryBuilder:
    """Collects the visual parts, collision parts and support surfaces of a shape, in the template frame.

    Parts with a volume below rounding are ignored.
    """

    def __init__(self, size: Vector, turn: AxisPermutation) -> None:
        self.size = np.array(size)
        self.low, self.high = -self.size / 2, self.size / 2
        self.turn = turn
        self.collision_parts: list[CollisionPart] = []
        self.support_surfaces: list[LocalSupportSurface] = []
        self.notes: list[str] = []
        self.light: Array | None = None
        self._boxes: dict[tuple[str, int], list[tuple[Array, Array, float]]] = {}
        self._parts: dict[tuple[str, bool], list[_Part]] = {}
        self._printed: list[_PrintedPart] = []
        self._stretch: tuple[Array, Array] | None = None
        """Scale and translation of all meshes, which fit them to the size."""

    @property
    def is_empty(self) -> bool:
        """Whether there are no visual parts or no collision parts."""
        return not (self.collision_parts and (self._boxes or self._parts or self._printed))

    @property
    def min_extent(self) -> float:
        """The smallest extent [m]."""
        return float(self.size.min())

    def add_note(self, text: str) -> None:
        """Adds a remark to the reason of the geometry."""
        self.notes.append(text)

    # -- parts ---------------------------------------------------------------------------------------------------------

    def add_box(
        self,
        role: str,
        low: Corner,
        high: Corner,
        *,
        rounding: float = _BEVEL_M,
        rounded: bool = False,
        collides: bool = True,
    ) -> None:
        """Adds a box between two corners, with beveled or rounded edges; `collides` adds a collision box as well."""
        lower, upper = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
        extents = upper - lower
        if extents.min() <= _EPSILON_M:
            return
        radius = min(rounding, (0.5 if rounded else 0.3) * float(extents.min()))
        self._boxes.setdefault((role, 4 if rounded else 1), []).append((lower, upper, radius))
        if collides:
            self.add_collision_box(lower, upper)

    def add_printed_box(
        self,
        role: str,
        low: Corner,
        high: Corner,
        layout: PrintLayout,
        picture: Picture,
        *,
        rounding: float = 0.0015,
        rounded: bool = False,
    ) -> None:
        """Adds a box with a picture on its sides; visual only.

        Args:
            role: the material role; the picture replaces its color and texture.
            low: lower corner [m].
            high: upper corner [m].
            layout: which sides have the picture.
            picture: returns the picture for the color of the role.
            rounding: radius of the edges [m].
            rounded: whether edges are round instead of beveled.
        """
        lower, upper = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
        if (extents := upper - lower).min() <= _EPSILON_M:
            return
        radius = np.array([min(rounding, (0.5 if rounded else 0.3) * float(extents.min()))])
        make = partial(boxes, lower[None], upper[None], radius, steps=4 if rounded else 1)
        self._printed.append(_PrintedPart(role, _Part(lower, upper, make), layout, picture))

    def add_printed_lathe(
        self,
        role: str,
        profile: Profile,
        low: Corner,
        high: Corner,
        picture: Picture,
        *,
        closed: bool = False,
    ) -> None:
        """Adds an upright surface of revolution with a picture around it; visual only. Arguments as of `add_lathe`."""
        lower, upper = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
        if (upper - lower).min() <= _EPSILON_M:
            return
        inner = GeometryBuilder((1.0, 1.0, 1.0), self.turn)
        inner.add_lathe(role, profile, lower, upper, bevel=0.0005, closed=closed)
        (part,) = inner._parts[role, True]
        self._printed.append(_PrintedPart(role, part, PrintLayout.ROUND, picture))

    def add_lathe(
        self,
        role: str,
        profile: Profile,
        low: Corner,
        high: Corner,
        *,
        along: BodySide = BodySide.TOP,
        bevel: float = _BEVEL_M,
        closed: bool = False,
        segments: int | None = None,
    ) -> None:
        """Adds a surface of revolution that fills a box; visual only.

        Args:
            role: the material role.
            profile: radius and height from 0 to 1, as fractions of the box across and along the axis.
            low: lower corner of the box [m].
            high: upper corner of the box [m].
            along: direction of increasing height.
            bevel: largest bevel of sharp edges [m].
            closed: whether the profile is a loop that does not touch the axis.
            segments: points per circle; by default it depends on the radius.
        """
        lower, upper = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
        if (upper - lower).min() <= _EPSILON_M:
            return
        turn = turn_between(BodySide.FRONT if along.axis == 2 else BodySide.TOP, along)
        extents = np.array(turn.template_size(tuple((upper - lower).tolist())))
        radius, length = float(extents[:2].min()) / 2, float(extents[2])
        shares = np.array(profile)
        corners = segments or next(corners for least, corners in _SEGMENTS_BY_RADIUS if radius >= least)
        middle, across = (lower + upper) / 2, extents[:2] / (2 * radius)

        def make() -> TriangleMesh:
            profile = shares * (radius, length)
            mesh = lathe(profile, bevel=bevel, segments=corners, closed=closed)  # type: ignore[arg-type]
            mesh = scaled(mesh, np.array([*across, 1.0]), np.array([0.0, 0.0, -length / 2]))
            normals = None if mesh.normals is None else turn.to_body(mesh.normals)
            return TriangleMesh(turn.to_body(mesh.points) + middle, mesh.faces, normals)

        # Circles have points on both axes, so the bounds follow from the largest radius and the heights.
        widest, heights = float(shares[:, 0].max()), shares[:, 1]
        reach = [*(extents[:2] / 2 * widest), (float(heights.max()) - 0.5) * length]
        depth = [*(extents[:2] / -2 * widest), (float(heights.min()) - 0.5) * length]
        ends = turn.to_body(np.array([depth, reach])) + middle
        around = RoundAxis(along.axis, middle)
        self._add(role, _Part(ends.min(axis=0), ends.max(axis=0), make, around), smooth=True)

    def add_cylinder(
        self,
        role: str,
        low: Corner,
        high: Corner,
        *,
        along: BodySide = BodySide.TOP,
        bevel: float = _BEVEL_M,
        segments: int | None = None,
    ) -> None:
        """Adds a cylinder that fills a box; visual only."""
        profile = ((0, 0), (1, 0), (1, 1), (0, 1))
        self.add_lathe(role, profile, low, high, along=along, bevel=bevel, segments=segments)

    def add_tube(self, role: str, path: Sequence[Corner], radius: float, *, segments: int = 12) -> None:
        """Adds a round bar along a path; visual only."""
        if radius > _EPSILON_M:
            self.add_mesh(
                role, sweep(np.array([np.asarray(spot, dtype=np.float64) for spot in path]), radius, segments=segments)
            )

    def add_loft(self, role: str, rings: Array) -> None:
        """Adds the surface through rings of points; visual only."""
        points = rings.reshape(-1, 3)
        self._add(role, _Part(points.min(axis=0), points.max(axis=0), partial(loft, rings)), smooth=True)

    def add_plate(
        self,
        role: str,
        low: Corner,
        high: Corner,
        cutouts: Iterable[Cutout] = (),
        *,
        thin_axis: int,
        rounding: float = _BEVEL_M,
        collides: bool = True,
        min_strip_width: float = 0.0,
    ) -> list[tuple[Array, Array]]:
        """Adds a box with holes along its thin axis (0, 1, 2), where cutouts take up at least half of its thickness.

        Returns the remaining boxes, each as its two corners; strips between holes that are narrower than
        `min_strip_width` are omitted.
        """
        lower, upper = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
        if (upper - lower).min() <= _EPSILON_M:
            return []
        holes = [hole for cutout in cutouts if (hole := self._hole_of(cutout, lower, upper, thin_axis)) is not None]
        if not holes:
            self.add_box(role, lower, upper, rounding=rounding, collides=collides)
            return [(lower, upper)]
        axes = [(thin_axis + 1) % 3, (thin_axis + 2) % 3]
        if min_strip_width:
            holes = merge_narrow_strips(lower[axes], upper[axes], holes, min_strip_width)
        cuts, kept = grid_cells(lower[axes], upper[axes], holes)
        if not kept.any():
            return []
        return self.add_sheet(
            role, cuts, kept, (float(lower[thin_axis]), float(upper[thin_axis])), thin_axis=thin_axis, collides=collides
        )

    def add_sheet(
        self,
        role: str,
        cuts: tuple[Array, Array],
        kept: NDArray[np.bool_],
        thickness: tuple[float, float],
        *,
        thin_axis: int = 2,
        collides: bool = True,
        collision_bottom: float | None = None,
    ) -> list[tuple[Array, Array]]:
        """Adds a plate of cells, some of which may be missing; returns the boxes of which it consists.

        Args:
            role: the material role.
            cuts: coordinates that divide it into cells along the two axes after the thin one [m].
            kept: which of the cells are present.
            thickness: its start and end along the thin axis [m].
            collides: whether to add collision boxes.
            collision_bottom: start of the collision boxes along the thin axis, if different [m].
        """
        axes = [(thin_axis + 1) % 3, (thin_axis + 2) % 3, thin_axis]

        def make() -> TriangleMesh:
            panel = panel_with_cutouts(cuts, kept, thickness)
            return TriangleMesh(panel.points[:, np.argsort(axes)], panel.faces, None)

        if kept.any():
            lower, upper = np.empty(3), np.empty(3)
            for axis, cut, is_present in zip(axes, cuts, (kept.any(axis=1), kept.any(axis=0)), strict=False):
                present = np.flatnonzero(is_present)
                lower[axis], upper[axis] = cut[present[0]], cut[present[-1] + 1]
            lower[thin_axis], upper[thin_axis] = min(thickness), max(thickness)
            self._add(role, _Part(lower, upper, make), smooth=False)
        start = thickness[0] if collision_bottom is None else collision_bottom
        parts = []
        for first, last in covering_rectangles(cuts, kept):
            low, high = np.empty(3), np.empty(3)
            low[axes], high[axes] = [*first, start], [*last, thickness[1]]
            parts.append((low, high))
            if collides:
                self.add_collision_box(low, high)
        return parts

    def add_frustum(self, role: str, below: tuple[Corner, Corner], above: tuple[Corner, Corner]) -> None:
        """Adds a frustum between two horizontal rectangles, each given by two corners."""
        rings = []
        for first, last in (below, above):
            (x0, y0, z), (x1, y1, _) = first, last
            rings += [(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)]
        self.add_hexahedron(role, np.array(rings, dtype=np.float64))

    def add_hexahedron(self, role: str, corners: Array, *, collides: bool = True) -> None:
        """Adds a convex hexahedron: four lower and four upper corners, each counterclockwise seen from above."""
        self.add_mesh(role, TriangleMesh(corners, _BLOCK_FACES, None))
        if collides:
            self.add_collision_hull(corners)

    def add_mesh(self, role: str, mesh: TriangleMesh) -> None:
        """Adds a closed mesh; visual only."""
        part = _Part(mesh.points.min(axis=0), mesh.points.max(axis=0), lambda: mesh)
        self._add(role, part, smooth=mesh.normals is not None)

    def _add(self, role: str, part: _Part, *, smooth: bool) -> None:
        self._parts.setdefault((role, smooth), []).append(part)

    # -- collision parts -----------------------------------------------------------------------------------------------

    def add_collision_box(self, low: Corner, high: Corner) -> None:
        """Adds a collision box."""
        self.collision_parts.append(CollisionPart(CollisionShapeType.BOX, np.array([low, high], dtype=np.float64)))

    def add_collision_cylinder(self, low: Corner, high: Corner, *, along: BodySide = BodySide.TOP) -> None:
        """Adds a collision cylinder that fills a box."""
        self.collision_parts.append(
            CollisionPart(CollisionShapeType.CYLINDER, np.array([low, high], dtype=np.float64), axis=along.axis)
        )

    def add_collision_sphere(self, low: Corner, high: Corner) -> None:
        """Adds a collision ellipsoid that fills a box."""
        self.collision_parts.append(CollisionPart(CollisionShapeType.SPHERE, np.array([low, high], dtype=np.float64)))

    def add_collision_hull(self, points: Sequence[Corner] | Array) -> None:
        """Adds the convex hull of points as a collision part."""
        self.collision_parts.append(CollisionPart(CollisionShapeType.HULL, np.asarray(points, dtype=np.float64)))

    def add_collision_ring(
        self, low: Corner, high: Corner, *, outer: tuple[float, float], inner: tuple[float, float], pieces: int = 8
    ) -> None:
        """Adds the wall of an upright round vessel as convex parts.

        Args:
            low: lower corner of the bounds [m].
            high: upper corner of the bounds [m].
            outer: outer radii at the bottom and at the top, as fractions of the bounds.
            inner: inner radii at the bottom and at the top.
            pieces: the number of parts.
        """
        lower, upper = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
        self.collision_parts += ring_parts(lower, upper, outer, inner, pieces)

    def add_support_surface(
        self, low: Corner, high: Corner, level: float, *, clearance: float | None = None, is_inside: bool = False
    ) -> None:
        """Adds a horizontal support surface between two corners (x, y), at a height [m]."""
        lower = np.maximum(np.asarray(low, dtype=np.float64)[:2], self.low[:2])
        upper = np.minimum(np.asarray(high, dtype=np.float64)[:2], self.high[:2])
        if (upper - lower).min() > _EPSILON_M and (clearance is None or clearance > _EPSILON_M):
            self.support_surfaces.append(LocalSupportSurface(lower, upper, level, clearance, is_inside=is_inside))

    # -- the result ----------------------------------------------------------------------------------------------------

    def fit_to_size(self) -> float:
        """Scales all parts to fit the size; returns the largest relative change."""
        parts = [part for parts in self._parts.values() for part in parts]
        parts += [printed.part for printed in self._printed]
        blocks = [block for blocks in self._boxes.values() for block in blocks]
        low = np.min([*(part.low for part in parts), *(block[0] for block in blocks)], axis=0)
        high = np.max([*(part.high for part in parts), *(block[1] for block in blocks)], axis=0)
        if np.abs(low - self.low).max() <= _EXACT and np.abs(high - self.high).max() <= _EXACT:
            return 0.0
        scale = self.size / (high - low)
        shift = self.low - low * scale
        self._stretch = (scale, shift)
        self.collision_parts = [part.scaled(scale, shift).clipped(self.low, self.high) for part in self.collision_parts]
        for surface in self.support_surfaces:
            surface.low, surface.high = surface.low * scale[:2] + shift[:2], surface.high * scale[:2] + shift[:2]
            surface.level = float(surface.level * scale[2] + shift[2])
            surface.clearance = None if surface.clearance is None else float(surface.clearance * scale[2])
            surface.low, surface.high = np.maximum(surface.low, self.low[:2]), np.minimum(surface.high, self.high[:2])
        if self.light is not None:
            self.light = self.light * scale + shift
        return float(np.abs(scale - 1.0).max())

    def merged_meshes(
        self, texture_of: Callable[[str], TextureInfo | None] = lambda role: None
    ) -> dict[tuple[str, bool], TriangleMesh]:
        """Returns one mesh per role and shading: smooth (with vertex normals) or flat.

        Args:
            texture_of: returns the texture of a role; the meshes of roles with a texture have texture coordinates.
        """
        textures = {role: texture_of(role) for role, _ in (*self._parts, *self._boxes)}
        found = {key: [self._finished(part, textures[key[0]]) for part in parts] for key, parts in self._parts.items()}
        for (role, steps), parts in self._boxes.items():
            low, high, rounding = (np.array(column) for column in zip(*parts, strict=True))
            mesh, texture = self._stretched(boxes(low, high, rounding, steps=steps)), textures[role]
            if texture is not None:
                mesh = project_boxes(mesh, len(parts), high - low, texture)
            found.setdefault((role, True), []).append(mesh)
        return {key: joined(meshes) for key, meshes in sorted(found.items())}

    def printed_meshes(self) -> Iterator[PrintedMesh]:
        """Yields the parts with pictures."""
        for role, part, layout, picture in self._printed:
            yield PrintedMesh(role, project_print(self._stretched(part.make()), layout), picture)

    def _finished(self, part: _Part, texture: TextureInfo | None) -> TriangleMesh:
        """Returns the mesh of a part in its final size, with texture coordinates if it has a texture."""
        mesh = self._stretched(part.make())
        if texture is None:
            return mesh
        if part.around is None:
            return project_flat(mesh, texture)
        scale, shift = self._stretch or (np.ones(3), np.zeros(3))
        return project_round(mesh, RoundAxis(part.around.axis, part.around.center * scale + shift), texture)

    def _stretched(self, mesh: TriangleMesh) -> TriangleMesh:
        return mesh if self._stretch is None else scaled(mesh, *self._stretch)

    def _hole_of(self, cutout: Cutout, low: Array, high: Array, thin_axis: int) -> Hole | None:
        """Returns the hole of a cutout in a plate; None if it takes up less than half of the thickness."""
        start, end = self.turn.template_cutout(cutout)
        if min(end[thin_axis], high[thin_axis]) - max(start[thin_axis], low[thin_axis]) < 0.5 * (
            high[thin_axis] - low[thin_axis]
        ):
            return None
        axes = [(thin_axis + 1) % 3, (thin_axis + 2) % 3]
        start, end = np.maximum(start, low)[axes], np.minimum(end, high)[axes]
        return (start, end) if (end - start).min() > 1e-4 else None


Length = Annotated[float, msgspec.Meta(ge=0.0, le=1000.0)]
"""[m]."""
Thickness = Annotated[float, msgspec.Meta(ge=1e-4, le=1000.0)]
"""[m], at least 0.1 mm."""
Fraction = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
PositiveFraction = Annotated[float, msgspec.Meta(ge=0.05, le=1.0)]
"""A fraction of at least 0.05."""
Count = Annotated[int, msgspec.Meta(ge=0, le=64)]

MaterialRoles = Mapping[str, PbrMaterial | str]
"""The material roles of a shape: each with its default material, or with the role whose material it shares."""


class ShapeTemplate(FrozenStruct, frozen=True, kw_only=True):
    """Base class of shape templates; its fields are the parameters of the shape."""

    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.PLAIN})

    name: ClassVar[str] = ""
    """The name of the shape in ontologies (`ms:shapedAs`); by default the class's name in lower case."""

    @classmethod
    def shape_name(cls) -> str:
        """The name of the shape in ontologies."""
        return cls.name or cls.__name__.lower()

    def build(self, builder: GeometryBuilder) -> None:
        """Adds the parts of the shape to a builder.

        Raises:
            TemplateFitError: the size is too small.
        """
        self._build(builder)

    def _build(self, builder: GeometryBuilder) -> None:
        raise NotImplementedError(f"{type(self).__name__} must implement _build")

    def material_of(self, role: str, materials: Mapping[str, PbrMaterial]) -> PbrMaterial:
        """Returns the material of a role: the given one, otherwise the default."""
        while role not in materials:
            default = self.roles[role]
            if isinstance(default, PbrMaterial):
                return default
            role = default
        return materials[role]
