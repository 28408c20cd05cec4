"""Drafts: a shape while it is drawn, part by part.

A draft knows the size and nothing of what it becomes. Its frame has x to the front, y to the left, z up and the
middle of the size at the origin. Parts are seen and touched alike unless told otherwise. What is finished fits the
size exactly: the little that round parts miss of it is made up for by stretching everything.

Holes: what is left of a plate where there are openings in it.

Sides: which way a shape looks, and how it is turned into a body's own axes.

Every shape is drawn once, with x to its front, y to its left and z up. A body may have its front at any of its six
sides and up at any that is not opposite; between the two lies a turn by right angles, which loses no digit.

Touchables: the convex parts of a shape while it is drawn, and how hollow things are cut into them.

Designs: the kinds of shape, each a class whose fields are its parameters and whose `draw` makes it.

Lengths are meters and wishes: a wall of 15 mm is thinner where a fifth of the size is less. Names of fields are those
that an ontology uses (`ms:wall 0.012`).
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
from mindstage.scene import IDENTITY, Pose, Quaternion, Vector
from mindstage.scene.geometry import CollisionShape, CollisionShapeType, PbrMaterial
from mindstage.scene.mesh import TriangleMesh, boxes, joined, lathe, loft, panel_with_cutouts, scaled, sweep
from mindstage.scene.model import FrozenStruct
from mindstage.scene.transforms import Array, quat_multiply, quaternion_from_matrix

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
    "ShapeTemplate",
    "TemplateDoesNotFit",
    "Thickness",
    "covering_rectangles",
    "grid_cells",
    "merge_narrow_strips",
    "ring_parts",
    "turn_between",
]


Hole = tuple[Array, Array]
"""Its lower and its upper corner, across the plate."""

_MIN_FILL = 0.6
"""So much of the rectangle round two holes that meet they must fill to become one."""


def grid_cells(low: Array, high: Array, holes: Sequence[Hole]) -> tuple[tuple[Array, Array], NDArray[np.bool_]]:
    """A plate divided where its holes begin and end, and which cells are left of it."""
    cuts = []
    for axis in range(2):
        marks = _each_once([low[axis], high[axis], *(corner[axis] for hole in holes for corner in hole)])
        inner = marks[(marks > low[axis] + 1e-4) & (marks < high[axis] - 1e-4)]
        inner = inner[np.diff(inner, prepend=-np.inf) > 1e-6]
        cuts.append(np.array([low[axis], *inner, high[axis]]))
    x, y = ((cut[:-1] + cut[1:]) / 2 for cut in cuts)
    kept = np.ones((len(x), len(y)), dtype=bool)
    for start, end in holes:
        kept &= ~(((x > start[0]) & (x < end[0]))[:, None] & ((y > start[1]) & (y < end[1]))[None])
    return (cuts[0], cuts[1]), kept


def merge_narrow_strips(low: Array, high: Array, holes: Sequence[Hole], min_width: float) -> list[Hole]:
    """Holes that are widened so that hardly any strip between their edges is narrower than asked.

    Nothing can stand on such strips, none is worth a look, and every one costs an engine a part to look at.

    Args:
        low: the plate's lower corner, across it [m].
        high: its upper corner.
        holes: what is free.
        least: how wide strips should be [m].
    """
    starts, ends = (np.array([hole[end] for hole in holes]).reshape(-1, 2) for end in (0, 1))
    for axis in range(2):
        marks = _each_once([low[axis], high[axis], *starts[:, axis], *ends[:, axis]])
        first, last = _merge_marks(marks, min_width)
        starts[:, axis] = first[np.searchsorted(marks, starts[:, axis])]
        ends[:, axis] = last[np.searchsorted(marks, ends[:, axis])]
    return _merge_holes(list(zip(starts, ends, strict=True)))


def _each_once(marks: Sequence[float]) -> Array:
    """The same numbers in order, each once: `numpy.unique` for few of them, which needs no `numpy.ma`."""
    return np.array(sorted(set(marks)))


def _merge_marks(marks: Array, min_width: float) -> tuple[Array, Array]:
    """For each mark the first and the last of those so near each other that they are taken as one."""
    first, last = marks.copy(), marks.copy()
    begin = 0
    for index in range(1, len(marks) + 1):
        if index == len(marks) or marks[index] - marks[begin] >= min_width:
            first[begin:index], last[begin:index] = marks[begin], marks[index - 1]
            begin = index
    return first, last


def _merge_holes(holes: list[Hole]) -> list[Hole]:
    """The same holes, those that meet as one where they fill most of the rectangle round them."""
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
    """One of the six sides of a body, by its own axes."""

    FRONT = "+x"
    BACK = "-x"
    LEFT = "+y"
    RIGHT = "-y"
    TOP = "+z"
    BOTTOM = "-z"

    @classmethod
    def from_axis(cls, axis: int, sign: int) -> BodySide:
        """The side at one end of an axis (0, 1, 2 for x, y, z)."""
        return cls(f"{'+' if sign > 0 else '-'}{'xyz'[axis]}")

    @property
    def axis(self) -> int:
        """0, 1, 2 for x, y, z."""
        return "xyz".index(self.value[1])

    @property
    def sign(self) -> int:
        """1 where the axis points, else -1."""
        return 1 if self.value[0] == "+" else -1

    @property
    def opposite(self) -> BodySide:
        """The side across."""
        return BodySide.from_axis(self.axis, -self.sign)

    @property
    def vector(self) -> Vector:
        """Where it looks, of length 1."""
        x, y, z = (float(self.sign) if axis == self.axis else 0.0 for axis in range(3))
        return (x, y, z)


class Cutout(FrozenStruct, frozen=True, kw_only=True):
    """A box that must stay free: a door's opening in a wall, a sink's in a worktop."""

    low: Vector
    """The corner with the smallest coordinates, in the body's frame."""
    high: Vector


class AxisPermutation:
    """From the frame in which shapes are drawn into a body's own."""

    def __init__(self, front: BodySide, up: BodySide) -> None:
        if front.axis == up.axis:
            raise InvalidShapeError("any", reason=f"its front {front.value} and its top {up.value} lie on one axis")
        left = np.cross(up.vector, front.vector)
        self.matrix: Array = np.stack([front.vector, left, up.vector], axis=1)
        w, x, y, z = quaternion_from_matrix(self.matrix).tolist()
        self.quaternion: Quaternion = (w, x, y, z)
        self._axes = [int(np.flatnonzero(row)[0]) for row in self.matrix]
        self.is_identity = bool(np.array_equal(self.matrix, np.eye(3)))
        """Whether both frames are the same."""

    def template_size(self, size: Vector) -> Vector:
        """A body's extents along the drawn axes."""
        x, y, z = (float(value) for value in np.abs(self.matrix.T) @ np.array(size))
        return (x, y, z)

    def body_size(self, template_size: Vector) -> Vector:
        """Drawn extents along the body's axes."""
        x, y, z = (template_size[axis] for axis in self._axes)
        return (x, y, z)

    def to_body(self, template_points: Array) -> Array:
        """Points or directions, n x 3, in the body's frame."""
        return template_points if self.is_identity else template_points @ self.matrix.T

    def vector_to_body(self, template_vector: Vector) -> Vector:
        """One point or direction in the body's frame."""
        x, y, z = (self.matrix @ np.array(template_vector)).tolist()
        return (x, y, z)

    def template_side(self, side: BodySide) -> BodySide:
        """A side of the body as the drawing calls it."""
        drawn = self.matrix.T @ np.array(side.vector)
        axis = int(np.flatnonzero(drawn)[0])
        return BodySide.from_axis(axis, int(drawn[axis]))

    def template_cutout(self, cutout: Cutout) -> tuple[Array, Array]:
        """The two corners of a gap in the drawing."""
        corners = np.array([cutout.low, cutout.high]) @ self.matrix
        return corners.min(axis=0), corners.max(axis=0)


@cache
def turn_between(front: BodySide, up: BodySide) -> AxisPermutation:
    """The turn of these two sides; there are only 24, so each is computed once. Its arrays must not be written to."""
    return AxisPermutation(front, up)


_SEGMENTS = 16
"""Corners of a cylinder whose ends are no circles."""
_MIN_UPRIGHT_RATIO = 0.75
"""A wall whose foot is at least so wide as its rim, as a share, is taken as upright."""
_CYLINDER_TURNS: tuple[tuple[float, float, float, float], ...] = (
    (0.5**0.5, 0.0, 0.5**0.5, 0.0),
    (0.5**0.5, -(0.5**0.5), 0.0, 0.0),
    (1.0, 0.0, 0.0, 0.0),
)
"""Which turn lays a cylinder's axis along x, y, z."""


class CollisionPart(NamedTuple):
    """A convex part, in the drawing's frame."""

    type: CollisionShapeType
    points: Array
    """Of a hull, its points; else the two corners of the box that it fills."""
    axis: int = 2
    """Of a cylinder."""
    turn_rad: float = 0.0
    """By how much it is turned about z, at `hub`, from where its points are."""
    rotation_center: tuple[float, float] = (0.0, 0.0)

    def scaled(self, scale: Array, shift: Array) -> CollisionPart:
        """The same part larger or smaller along each axis, then moved."""
        if self.turn_rad and not np.isclose(scale[0], scale[1], rtol=1e-9):
            return self._as_fixed_hull().scaled(scale, shift)
        x, y = (np.array(self.rotation_center) * scale[:2] + shift[:2]).tolist()
        return self._replace(points=self.points * scale + shift, rotation_center=(x, y))

    def clipped(self, low: Array, high: Array) -> CollisionPart:
        """The same part, kept from standing out of a box by the last digit."""
        return self if self.turn_rad else self._replace(points=np.clip(self.points, low, high))

    def to_collision_shape(self, turn: AxisPermutation) -> CollisionShape | None:
        """The part in the body's frame; None if it has no volume."""
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
        """One of several alike that stand round an axis: its own frame turns, its points stay."""
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
        """The same part as a hull whose points are where it is."""
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
    """The wall of an upright round vessel as convex pieces.

    Pieces of a circle are one and the same part, turned; they are boxes where the wall is nearly upright, which engines
    like best, else hulls.

    Args:
        low: of the box that it stands in [m].
        high: its other corner.
        outer: radii outside at the bottom and at the top, as shares of the box.
        inner: those inside.
        pieces: how many.
    """
    half, middle = (high - low)[:2] / 2, (low + high)[:2] / 2
    radius, step = float(half.min()), 2 * np.pi / pieces
    hub = (float(middle[0]), float(middle[1]))
    if min(outer) >= _MIN_UPRIGHT_RATIO * max(outer):
        reach = radius * (outer[0] + outer[1]) / 2
        chord, face = 2 * reach * np.sin(step / 2), reach * np.cos(step / 2)
        wall = max(face - radius * (inner[0] + inner[1]) / 2 * np.cos(step / 2), 0.05 * reach)
        corners = np.array(
            [[hub[0] + face - wall, hub[1] - chord / 2, low[2]], [hub[0] + face, hub[1] + chord / 2, high[2]]]
        )
        one = CollisionPart(CollisionShapeType.BOX, corners, rotation_center=hub)
    else:
        angle = np.array([-step / 2, 0.0, step / 2])
        circle = np.stack([np.cos(angle), np.sin(angle)], axis=1) * radius
        rows = []
        for level, outer_share, inner_share in zip((low[2], high[2]), outer, inner, strict=True):
            row = np.concatenate([circle * outer_share, circle[[0, 2]] * inner_share]) + middle
            rows.append(np.column_stack([row, np.full(len(row), level)]))
        one = CollisionPart(CollisionShapeType.HULL, np.concatenate(rows), rotation_center=hub)
    parts = [one._replace(turn_rad=number * step) for number in range(pieces)]
    if np.isclose(half[0], half[1], rtol=1e-9):
        return parts
    scale = np.array([*(half / radius), 1.0])
    return [part._as_fixed_hull().scaled(scale, np.array([*(middle * (1 - scale[:2])), 0.0])) for part in parts]


def covering_rectangles(cuts: tuple[Array, Array], kept: NDArray[np.bool_]) -> Iterator[tuple[Array, Array]]:
    """The kept cells of a plate as few rectangles, each by its two corners."""
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
"""How many corners a circle has from which radius on [m]."""
_EPSILON_M = 1e-9
_EXACT = 1e-12

_BLOCK_FACES = np.array(
    [
        *((0, 2, 1), (0, 3, 2), (4, 5, 6), (4, 6, 7)),
        *(face for a, b in ((0, 1), (1, 2), (2, 3), (3, 0)) for face in ((a, b, b + 4), (a, b + 4, a + 4))),
    ],
    dtype=np.uint32,
)

Corner = Sequence[float] | Array
Profile = Sequence[tuple[float, float]]


class TemplateDoesNotFit(Exception):
    """The size leaves no room for what the shape consists of."""


class LocalSupportSurface:
    """A level place in the drawing's frame."""

    def __init__(self, low: Array, high: Array, level: float, clearance: float | None, *, is_inside: bool) -> None:
        self.low, self.high = low, high
        self.level, self.clearance, self.is_inside = level, clearance, is_inside


class _Part(NamedTuple):
    """One surface of a draft, whose triangles are made only where somebody looks at them."""

    low: Array
    """The lower corner of the box round its points [m]."""
    high: Array
    make: Callable[[], TriangleMesh]


class GeometryBuilder:
    """What has been drawn so far."""

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
        self._stretch: tuple[Array, Array] | None = None
        """By what all surfaces are scaled and then moved in the end."""

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing to be seen, or nothing to be touched."""
        return not (self.collision_parts and (self._boxes or self._parts))

    @property
    def min_extent(self) -> float:
        """The smallest extent [m]."""
        return float(self.size.min())

    def add_note(self, text: str) -> None:
        """Something that whoever asked for the shape should know."""
        self.notes.append(text)

    # -- parts -------------------------------------------------------------------------------------------------------

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
        """A box between two corners, its edges bevelled, or rounded where it is soft; nothing if it has no volume."""
        lower, upper = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
        extents = upper - lower
        if extents.min() <= _EPSILON_M:
            return
        radius = min(rounding, (0.5 if rounded else 0.3) * float(extents.min()))
        self._boxes.setdefault((role, 4 if rounded else 1), []).append((lower, upper, radius))
        if collides:
            self.add_collision_box(lower, upper)

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
        """Something turned round an axis, in a box; it is seen only.

        Args:
            role: its surface's.
            profile: radius and height from 0 to 1, as shares of the box across and along the axis.
            low: the box.
            high: its other corner.
            along: where the profile's heights grow to.
            bevel: how much of sharp edges is taken off [m].
            closed: whether the profile is a loop that does not touch the axis.
            around: corners of a circle; the smaller, the fewer, unless told.
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

        def turned() -> TriangleMesh:
            profile = shares * (radius, length)
            mesh = lathe(profile, bevel=bevel, segments=corners, closed=closed)  # type: ignore[arg-type]
            mesh = scaled(mesh, np.array([*across, 1.0]), np.array([0.0, 0.0, -length / 2]))
            normals = None if mesh.normals is None else turn.to_body(mesh.normals)
            return TriangleMesh(turn.to_body(mesh.points) + middle, mesh.faces, normals)

        # A circle has corners on both axes, so the surface fills the box of its outermost radius and its heights.
        widest, heights = float(shares[:, 0].max()), shares[:, 1]
        reach = [*(extents[:2] / 2 * widest), (float(heights.max()) - 0.5) * length]
        depth = [*(extents[:2] / -2 * widest), (float(heights.min()) - 0.5) * length]
        ends = turn.to_body(np.array([depth, reach])) + middle
        self._add(role, _Part(ends.min(axis=0), ends.max(axis=0), turned), smooth=True)

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
        """A cylinder that fills a box; it is seen only."""
        profile = ((0, 0), (1, 0), (1, 1), (0, 1))
        self.add_lathe(role, profile, low, high, along=along, bevel=bevel, segments=segments)

    def add_tube(self, role: str, path: Sequence[Corner], radius: float, *, segments: int = 12) -> None:
        """A round bar along a path; it is seen only."""
        if radius > _EPSILON_M:
            self.add_mesh(
                role, sweep(np.array([np.asarray(spot, dtype=np.float64) for spot in path]), radius, segments=segments)
            )

    def add_loft(self, role: str, rings: Array) -> None:
        """A skin over rings of points; it is seen only."""
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
        """A box with holes along its thin axis (0, 1, 2), where gaps take up half of its thickness or more.

        What is left of it is given back as boxes, each by its two corners; strips between holes that are narrower than
        `least` are left out.
        """
        lower, upper = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
        if (upper - lower).min() <= _EPSILON_M:
            return []
        holes = [hole for gap in cutouts if (hole := self._hole_of(gap, lower, upper, thin_axis)) is not None]
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
        """A plate of cells, some of which may be missing; it gives back the boxes that it consists of.

        Args:
            role: its surface's.
            cuts: where it is divided along the two axes after the thin one [m].
            kept: which of its cells are there.
            thickness: where it begins and ends along the thin axis [m].
            thin: that axis.
            solid: whether it can be touched.
            down_to: how far down what can be touched goes, if farther than what is seen [m].
        """
        axes = [(thin_axis + 1) % 3, (thin_axis + 2) % 3, thin_axis]

        def standing() -> TriangleMesh:
            lying = panel_with_cutouts(cuts, kept, thickness)
            return TriangleMesh(lying.points[:, np.argsort(axes)], lying.faces, None)

        if kept.any():
            lower, upper = np.empty(3), np.empty(3)
            for axis, cut, there in zip(axes, cuts, (kept.any(axis=1), kept.any(axis=0)), strict=False):
                cells_there = np.flatnonzero(there)
                lower[axis], upper[axis] = cut[cells_there[0]], cut[cells_there[-1] + 1]
            lower[thin_axis], upper[thin_axis] = min(thickness), max(thickness)
            self._add(role, _Part(lower, upper, standing), smooth=False)
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
        """A block between two level rectangles, each by two corners of one height."""
        rings = []
        for first, last in (below, above):
            (x0, y0, z), (x1, y1, _) = first, last
            rings += [(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)]
        self.add_hexahedron(role, np.array(rings, dtype=np.float64))

    def add_hexahedron(self, role: str, corners: Array, *, collides: bool = True) -> None:
        """A convex block of six flat sides: four corners, and the four above them, each counterclockwise from above."""
        self.add_mesh(role, TriangleMesh(corners, _BLOCK_FACES, None))
        if collides:
            self.add_collision_hull(corners)

    def add_mesh(self, role: str, mesh: TriangleMesh) -> None:
        """Any other closed surface; it is seen only."""
        part = _Part(mesh.points.min(axis=0), mesh.points.max(axis=0), lambda: mesh)
        self._add(role, part, smooth=mesh.normals is not None)

    def _add(self, role: str, part: _Part, *, smooth: bool) -> None:
        self._parts.setdefault((role, smooth), []).append(part)

    # -- what can be touched -----------------------------------------------------------------------------------------

    def add_collision_box(self, low: Corner, high: Corner) -> None:
        """A box that is not seen."""
        self.collision_parts.append(CollisionPart(CollisionShapeType.BOX, np.array([low, high], dtype=np.float64)))

    def add_collision_cylinder(self, low: Corner, high: Corner, *, along: BodySide = BodySide.TOP) -> None:
        """A cylinder that fills a box and is not seen."""
        self.collision_parts.append(
            CollisionPart(CollisionShapeType.CYLINDER, np.array([low, high], dtype=np.float64), axis=along.axis)
        )

    def add_collision_sphere(self, low: Corner, high: Corner) -> None:
        """An ellipsoid that fills a box and is not seen."""
        self.collision_parts.append(CollisionPart(CollisionShapeType.SPHERE, np.array([low, high], dtype=np.float64)))

    def add_collision_hull(self, points: Sequence[Corner] | Array) -> None:
        """A convex body round points that is not seen."""
        self.collision_parts.append(CollisionPart(CollisionShapeType.HULL, np.asarray(points, dtype=np.float64)))

    def add_collision_ring(
        self, low: Corner, high: Corner, *, outer: tuple[float, float], inner: tuple[float, float], pieces: int = 8
    ) -> None:
        """The wall of an upright round vessel, in pieces.

        Args:
            low: of the box that it stands in.
            high: its other corner.
            outer: radii outside at the bottom and at the top, as shares of the box.
            inner: those inside.
            pieces: how many.
        """
        lower, upper = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
        self.collision_parts += ring_parts(lower, upper, outer, inner, pieces)

    def add_support_surface(
        self, low: Corner, high: Corner, level: float, *, clearance: float | None = None, is_inside: bool = False
    ) -> None:
        """Something can be put on a level rectangle between two corners (x, y)."""
        lower = np.maximum(np.asarray(low, dtype=np.float64)[:2], self.low[:2])
        upper = np.minimum(np.asarray(high, dtype=np.float64)[:2], self.high[:2])
        if (upper - lower).min() > _EPSILON_M and (clearance is None or clearance > _EPSILON_M):
            self.support_surfaces.append(LocalSupportSurface(lower, upper, level, clearance, is_inside=is_inside))

    # -- the end -----------------------------------------------------------------------------------------------------

    def fit_to_size(self) -> float:
        """Stretches all that was drawn to the size; by how much at most, as a share."""
        parts = [part for parts in self._parts.values() for part in parts]
        blocks = [block for blocks in self._boxes.values() for block in blocks]
        low = np.min([*(part.low for part in parts), *(block[0] for block in blocks)], axis=0)
        high = np.max([*(part.high for part in parts), *(block[1] for block in blocks)], axis=0)
        if np.abs(low - self.low).max() <= _EXACT and np.abs(high - self.high).max() <= _EXACT:
            return 0.0
        scale = self.size / (high - low)
        shift = self.low - low * scale
        self._stretch = (scale, shift)
        self.collision_parts = [part.scaled(scale, shift).clipped(self.low, self.high) for part in self.collision_parts]
        for spot in self.support_surfaces:
            spot.low, spot.high = spot.low * scale[:2] + shift[:2], spot.high * scale[:2] + shift[:2]
            spot.level = float(spot.level * scale[2] + shift[2])
            spot.clearance = None if spot.clearance is None else float(spot.clearance * scale[2])
            spot.low, spot.high = np.maximum(spot.low, self.low[:2]), np.minimum(spot.high, self.high[:2])
        if self.light is not None:
            self.light = self.light * scale + shift
        return float(np.abs(scale - 1.0).max())

    def merged_meshes(self) -> dict[tuple[str, bool], TriangleMesh]:
        """One a role, and one more for its parts whose faces have their own normals."""
        found = {key: [part.make() for part in parts] for key, parts in self._parts.items()}
        for (role, steps), parts in self._boxes.items():
            low, high, rounding = (np.array(column) for column in zip(*parts, strict=True))
            found.setdefault((role, True), []).append(boxes(low, high, rounding, steps=steps))
        whole = {key: joined(meshes) for key, meshes in sorted(found.items())}
        if self._stretch is None:
            return whole
        return {key: scaled(mesh, *self._stretch) for key, mesh in whole.items()}

    def _hole_of(self, cutout: Cutout, low: Array, high: Array, thin_axis: int) -> Hole | None:
        """Where a gap is in a plate, across it; None where it takes up less than half of its thickness."""
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
"""[m]; of what cannot be left out."""
Fraction = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
PositiveFraction = Annotated[float, msgspec.Meta(ge=0.05, le=1.0)]
"""A share of what cannot be left out."""
Count = Annotated[int, msgspec.Meta(ge=0, le=64)]

MaterialRoles = Mapping[str, PbrMaterial | str]
"""The surfaces that a shape has: each with what it is unless somebody says, or the role whose surface it shares."""


class ShapeTemplate(FrozenStruct, frozen=True, kw_only=True):
    """What all kinds of shape are."""

    roles: ClassVar[MaterialRoles] = MappingProxyType({"body": finishes.PLAIN})

    name: ClassVar[str] = ""
    """The name of the shape in ontologies (`ms:shapedAs`); by default the class's name in lower case."""

    @classmethod
    def shape_name(cls) -> str:
        """The name of the shape in ontologies."""
        return cls.name or cls.__name__.lower()

    def build(self, builder: GeometryBuilder) -> None:
        """Draws the shape in the draft's size; raises `TemplateDoesNotFit` where that leaves no room for it."""
        self._build(builder)

    def _build(self, builder: GeometryBuilder) -> None:
        raise NotImplementedError(f"{type(self).__name__} has to say how it is drawn")

    def material_of(self, role: str, materials: Mapping[str, PbrMaterial]) -> PbrMaterial:
        """What a role's surface is, by what was given."""
        while role not in materials:
            told = self.roles[role]
            if isinstance(told, PbrMaterial):
                return told
            role = told
        return materials[role]
