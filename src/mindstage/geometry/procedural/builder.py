"""Drafts: a shape while it is drawn, part by part.

A draft knows the size and nothing of what it becomes. Its frame has x to the front, y to the left, z up and the
middle of the size at the origin. Parts are seen and touched alike unless told otherwise. What is finished fits the
size exactly: the little that round parts miss of it is made up for by stretching everything.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mindstage.shapes.holes import Hole, grid_cells, merge_narrow_strips
from mindstage.shapes.sides import AxisPermutation, BodySide, Cutout, turn_between
from mindstage.shapes.touchables import CollisionPart, covering_rectangles, ring_parts
from mindstage.world import Vector
from mindstage.world.forms import CollisionShapeType
from mindstage.world.geometry import Array
from mindstage.world.meshes import TriangleMesh, boxes, joined, lathe, loft, panel_with_cutouts, scaled, sweep

__all__ = ["GeometryBuilder", "LocalSupportSurface", "TemplateDoesNotFit"]

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
