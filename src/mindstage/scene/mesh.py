"""Triangle meshes of primitives, boxes in bulk, surfaces of revolution, sweeps, lofts and plates with holes.

Each mesh is closed by its indices (every edge runs once each way), counterclockwise seen from outside, and has one
normal a point: edges are bevelled a little, so that shading runs over the narrow bevel while the faces beside it stay
flat, and no point is needed twice.

Convex hulls of point sets: triangles, face normals, volume and second moments.

`scipy.spatial` (Qhull) is imported by the first call, since it takes a tenth of a second to load.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mindstage.scene.model import Vector
from mindstage.scene.transforms import Array, cross

__all__ = [
    "Hull",
    "TriangleMesh",
    "arrow",
    "box",
    "box_edges",
    "boxes",
    "cone",
    "convex_hull",
    "cylinder",
    "joined",
    "lathe",
    "loft",
    "panel_with_cutouts",
    "scaled",
    "sphere",
    "sweep",
]


_FLAT = 1e-6
"""Points whose least extent is at most this part of the largest one are coplanar: float32 files round by 1e-7."""


@dataclass(frozen=True, slots=True, eq=False)
class Hull:
    """A convex polyhedron with triangular faces."""

    points: Array
    """n x 3, the vertices, in the order in which they were given."""
    faces: NDArray[np.intp]
    """m x 3 indices of points, counterclockwise seen from outside."""
    normals: Array
    """m x 3, outward unit normals of the faces."""

    def moments(self) -> tuple[float, Array, Array]:
        """Returns the volume, the centroid, and the second moments (the integral of x xT) about it, 3 x 3.

        Summed over the tetrahedra between the faces and an interior point.
        """
        inside = self.points.mean(axis=0)
        corners = self.points[self.faces] - inside
        sixfold = np.linalg.det(corners)
        volume = float(sixfold.sum() / 6)
        total = corners.sum(axis=1)
        middle = (sixfold[:, None] * total).sum(axis=0) / (24 * volume)
        squares = np.einsum("fki,fkj->fij", corners, corners) + np.einsum("fi,fj->fij", total, total)
        second = np.einsum("f,fij->ij", sixfold, squares) / 120
        return volume, inside + middle, second - volume * np.outer(middle, middle)


def convex_hull(points: Array) -> Hull | None:
    """Returns the convex hull of n x 3 points; None where they are coplanar, fewer than four, or not finite."""
    if len(points) < 4 or not np.isfinite(points).all():
        return None
    centered = points - points.mean(axis=0)
    extent = float(np.ptp(centered, axis=0).max())
    if extent <= 0.0:
        return None
    scaled = centered / extent  # Qhull's tolerances are meant for coordinates near 1
    least = np.linalg.svd(scaled, full_matrices=False)[2][2]
    if np.ptp(scaled @ least) <= _FLAT:
        return None

    from scipy.spatial import ConvexHull, QhullError

    try:
        found = ConvexHull(scaled)
    except QhullError:  # coplanar to Qhull, whose bound is the rounding of float64
        return None
    normals = found.equations[:, :3]
    a, b, c = scaled[found.simplices].transpose(1, 0, 2)
    inward = np.einsum("fi,fi->f", cross(b - a, c - a), normals) < 0.0
    faces = np.where(inward[:, None], found.simplices[:, ::-1], found.simplices)
    used, faces = np.unique(faces, return_inverse=True)
    return Hull(np.asarray(points[used], dtype=np.float64), faces.reshape(-1, 3), normals.copy())


Faces = NDArray[np.uint32]

_EDGE_RADIUS_M = 0.008
"""How much of a primitive's edges is taken off, at most."""
_SEGMENTS = 40
"""Corners of a primitive's circle, a multiple of four."""
_LEAST_M = 2e-4
"""Primitives are at least so large along each axis."""
_SHARP_EDGE_RAD = 0.6
"""Profiles that turn by more have an edge there, which is bevelled."""


class TriangleMesh(NamedTuple):
    """A closed surface."""

    points: Array
    """n x 3 [m]."""
    faces: Faces
    """m x 3 numbers of points, counterclockwise seen from outside."""
    normals: Array | None = None
    """n x 3, of norm 1; None where each face has its own."""
    uv: Array | None = None
    """n x 2, texture coordinates."""


def joined(meshes: Sequence[TriangleMesh]) -> TriangleMesh:
    """Several as one; all of them have normals, or none."""
    if len(meshes) == 1:
        return meshes[0]
    starts = np.cumsum([0, *(len(mesh.points) for mesh in meshes)])
    normals = [mesh.normals for mesh in meshes if mesh.normals is not None]
    return TriangleMesh(
        np.concatenate([mesh.points for mesh in meshes]),
        np.concatenate([mesh.faces + np.uint32(start) for mesh, start in zip(meshes, starts, strict=False)]),
        np.concatenate(normals) if normals else None,
    )


def scaled(mesh: TriangleMesh, scale: Array, shift: Array) -> TriangleMesh:
    """The mesh larger or smaller along each axis, then moved."""
    normals = mesh.normals
    if normals is not None and not np.allclose(scale, scale[0], rtol=1e-9):
        normals = _normalized(normals / scale)
    return TriangleMesh(mesh.points * scale + shift, mesh.faces, normals)


# -- primitives --------------------------------------------------------------------------------------------------------


def box(size: Vector) -> TriangleMesh:
    """A box around the origin, with slightly bevelled edges."""
    half = np.maximum(np.array(size), _LEAST_M)[None] / 2
    return boxes(-half, half, np.minimum(_EDGE_RADIUS_M, 0.3 * half.min(axis=1)))


def cylinder(size: Vector) -> TriangleMesh:
    """A cylinder along z around the origin, with bevelled edges; elliptic where width and depth differ."""
    radius, half = max(min(size[:2]), _LEAST_M) / 2, max(size[2], _LEAST_M) / 2
    return _turned(size, [(0.0, -half), (radius, -half), (radius, half), (0.0, half)])


def sphere(size: Vector) -> TriangleMesh:
    """A sphere around the origin, or an ellipsoid where the extents differ."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, _SEGMENTS // 2 + 1)
    profile = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    profile[[0, -1], 0] = 0.0
    return _turned(size, [(r, z) for r, z in profile.tolist()])


def cone(size: Vector) -> TriangleMesh:
    """A cone along z around the origin, its tip at the top."""
    radius, half = max(min(size[:2]), _LEAST_M) / 2, max(size[2], _LEAST_M) / 2
    return _turned(size, [(0.0, -half), (radius, -half), (0.0, half)])


def arrow(size: Vector) -> TriangleMesh:
    """An arrow from the origin along x: as long as the first extent, as thick as the others."""
    length, width, height = size
    radius, half = max(min(width, height), _LEAST_M) / 2, max(length, _LEAST_M) / 2
    shaft = [(0.0, -half), (0.5 * radius, -half), (0.5 * radius, 0.5 * half)]
    upright = _turned((width, height, length), [*shaft, (radius, 0.5 * half), (0.0, half)])
    assert upright.normals is not None
    points = upright.points[:, [2, 0, 1]] + (max(length, _LEAST_M) / 2, 0.0, 0.0)
    return TriangleMesh(points, upright.faces, upright.normals[:, [2, 0, 1]])


def _turned(size: Vector, profile: Sequence[tuple[float, float]]) -> TriangleMesh:
    """A surface of revolution, stretched to a size."""
    mesh = lathe(profile, bevel=_EDGE_RADIUS_M, segments=_SEGMENTS)
    scale = np.maximum(np.array(size), _LEAST_M) / np.ptp(mesh.points, axis=0)
    return scaled(mesh, scale, np.zeros(3))


def box_edges(size: Vector, *, margin: float = 0.0) -> NDArray[np.float32]:
    """The twelve edges of a box, as 12 x 2 x 3 ends; outside of it by the margin [m]."""
    corners = _CORNERS * (np.asarray(size) / 2 + margin)
    return np.asarray(corners[np.array(_EDGES)], dtype=np.float32)


_CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))
_EDGES = [(a, b) for a in range(8) for b in range(a + 1, 8) if np.sum(_CORNERS[a] != _CORNERS[b]) == 1]
"""Pairs of corners."""


# -- boxes -------------------------------------------------------------------------------------------------------------


def boxes(low: Array, high: Array, radii: Array, *, steps: int = 1) -> TriangleMesh:
    """Boxes with rounded edges, as one mesh.

    Args:
        low: lower corners, n x 3 [m].
        high: upper corners.
        rounding: the radius of each one's edges [m], at most half its least extent.
        steps: flat pieces a rounded edge has; one is a bevel.
    """
    signs, turns, faces = _rounded_unit_box(steps)
    half, center, radius = (high - low) / 2, (high + low) / 2, radii[:, None, None]
    points = center[:, None] + signs * (half[:, None] - radius) + turns * radius
    starts = np.arange(len(low), dtype=np.uint32) * np.uint32(len(signs))
    return TriangleMesh(
        points.reshape(-1, 3),
        (faces + starts[:, None, None]).reshape(-1, 3),
        np.tile(turns, (len(low), 1)),
    )


@cache
def _rounded_unit_box(steps: int) -> tuple[Array, Array, Faces]:
    """A rounded box as a sphere cut in eight: the corner that each point belongs to, its direction, and the faces."""
    quarter = np.linspace(0.0, np.pi / 2, steps + 1)
    around = np.concatenate([quarter + turn * np.pi / 2 for turn in range(4)])
    upwards = np.concatenate([quarter - np.pi / 2, quarter])
    corner = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]).repeat(steps + 1, axis=0)
    level, turn = np.meshgrid(upwards, around, indexing="ij")
    turns = np.stack([np.cos(level) * np.cos(turn), np.cos(level) * np.sin(turn), np.sin(level)], axis=-1).round(15)
    signs = np.empty_like(turns)
    signs[..., :2] = corner
    signs[..., 2] = np.repeat([-1.0, 1.0], steps + 1)[:, None]
    every = np.concatenate([signs.reshape(-1, 3), turns.reshape(-1, 3)], axis=1) + 0.0
    kept, number = np.unique(every, axis=0, return_inverse=True)
    faces = number.reshape(-1)[np.concatenate([_grid(len(upwards), len(around)), _caps(len(upwards), len(around))])]
    a, b, c = faces.T
    return kept[:, :3], kept[:, 3:], faces[(a != b) & (b != c) & (c != a)].astype(np.uint32)


def _grid(rings: int, segments: int, *, closed: bool = False) -> NDArray[np.int64]:
    """The faces between rings of points, each of which is closed; the last ring meets the first one if asked to."""
    ring, step = np.meshgrid(np.arange(rings if closed else rings - 1), np.arange(segments), indexing="ij")
    here, beside = ring * segments + step, ring * segments + (step + 1) % segments
    above = (ring + 1) % rings * segments
    over, across = above + step, above + (step + 1) % segments
    lower, upper = np.stack([here, beside, across], axis=-1), np.stack([here, across, over], axis=-1)
    return np.concatenate([lower.reshape(-1, 3), upper.reshape(-1, 3)])


def _caps(rings: int, segments: int) -> NDArray[np.int64]:
    """A fan over the first ring and one over the last."""
    fan = np.array([(0, step, step + 1) for step in range(1, segments - 1)], dtype=np.int64)
    return np.concatenate([fan[:, ::-1], fan + (rings - 1) * segments])


# -- round things ------------------------------------------------------------------------------------------------------


def lathe(profile: Sequence[tuple[float, float]], *, bevel: float, segments: int, closed: bool = False) -> TriangleMesh:
    """Turns a profile round z.

    Args:
        profile: radius and height [m] of its corners: from the axis below, by the outside, to the axis above, which
            may be at the bottom of a hollow; or a loop that does not touch the axis.
        bevel: how much of a sharp edge is taken off, at most [m].
        around: corners of a circle, a multiple of four.
        closed: whether the profile is such a loop.
    """
    corners = np.array(profile, dtype=np.float64)
    line, headings = _bevel_profile(corners, bevel, closed=closed)
    angle = np.arange(segments) * (2 * np.pi / segments)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1).round(15)
    rings = np.concatenate(
        [line[:, None, :1] * circle, np.broadcast_to(line[:, None, 1:], (len(line), segments, 1))], 2
    )
    normals = np.concatenate(
        [headings[:, None, :1] * circle, np.broadcast_to(headings[:, None, 1:], (len(line), segments, 1))], 2
    )
    return _tube(rings, normals, closed=closed)


def sweep(path: Array, radius: float | Array, *, segments: int = 12) -> TriangleMesh:
    """A round bar along a path, with rounded ends.

    Args:
        path: n x 3 [m].
        radius: of the bar [m], one or n.
        around: corners of a circle.
    """
    path = np.asarray(path, dtype=np.float64)
    radii = np.broadcast_to(np.asarray(radius, dtype=np.float64), (len(path),))
    steps = np.diff(path, axis=0)
    along = _normalized(np.concatenate([steps[:1], _normalized(steps[:-1]) + _normalized(steps[1:]), steps[-1:]]))
    sides = _parallel_frames(along)
    spots, sizes = [path[0] - along[0] * radii[0] * 0.3, *path], [radii[0] * 0.7, *radii]
    spots, sizes = [*spots, path[-1] + along[-1] * radii[-1] * 0.3], [*sizes, radii[-1] * 0.7]
    frames = np.concatenate([sides[:1], sides, sides[-1:]])
    angle = np.arange(segments) * (2 * np.pi / segments)
    turns = np.cos(angle)[None, :, None] * frames[:, None, 0] + np.sin(angle)[None, :, None] * frames[:, None, 1]
    rings = np.array(spots)[:, None] + turns * np.array(sizes)[:, None, None]
    turns[0] = _normalized(turns[0] - 1.5 * along[0])
    turns[-1] = _normalized(turns[-1] + 1.5 * along[-1])
    ends = [np.broadcast_to(spot, (1, segments, 3)) for spot in (spots[0], spots[-1])]
    caps = [np.broadcast_to(way, (1, segments, 3)) for way in (-along[0], along[-1])]
    return _tube(np.concatenate([ends[0], rings, ends[1]]), np.concatenate([caps[0], turns, caps[1]]))


def loft(rings: Array) -> TriangleMesh:
    """A skin over rings of points, with smooth normals; the first and the last one are closed by their middles.

    Args:
        rings: k x n x 3 [m], each counterclockwise seen from where the rings go to.
    """
    ends = [np.broadcast_to(ring.mean(axis=0), (1, rings.shape[1], 3)) for ring in (rings[0], rings[-1])]
    mesh = _tube(np.concatenate([ends[0], rings, ends[1]]), None)
    corners = mesh.points[mesh.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(mesh.points)
    for corner in range(3):
        np.add.at(normals, mesh.faces[:, corner], across)
    return mesh._replace(normals=_normalized(normals))


def _tube(rings: Array, normals: Array | None, *, closed: bool = False) -> TriangleMesh:
    """The surface over rings; a ring all of whose points are one becomes that one point."""
    count, around, _ = rings.shape
    single = np.all(np.abs(rings - rings[:, :1]) < 1e-12, axis=(1, 2))
    lengths = np.where(single, 1, around)
    starts = np.cumsum(np.concatenate([[0], lengths[:-1]]))
    number = (starts[:, None] + np.where(single[:, None], 0, np.arange(around))).reshape(-1)
    kept = (~single[:, None] | (np.arange(around) == 0)).reshape(-1)
    faces = number[_grid(count, around, closed=closed)]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)].astype(np.uint32)
    flat = None if normals is None else _normalized(normals.reshape(-1, 3)[kept])
    return TriangleMesh(rings.reshape(-1, 3)[kept], faces, flat)


def _bevel_profile(corners: Array, bevel: float, *, closed: bool) -> tuple[Array, Array]:
    """A profile whose sharp corners became two, and where each of its points looks."""
    steps = np.diff(corners, axis=0, append=corners[:1])
    lengths = np.linalg.norm(steps, axis=1)
    ways = steps / np.where(lengths > 0.0, lengths, 1.0)[:, None]
    out = np.stack([ways[:, 1], -ways[:, 0]], axis=1)
    points: list[Array] = []
    looks: list[Array] = []
    last = len(corners) - 1
    for at, corner in enumerate(corners):
        if not closed and at in (0, last):
            points.append(corner)
            looks.append(np.array([0.0, np.sign(out[at - 1 if at else 0][1]) or 1.0]) if corner[0] == 0.0 else out[at])
            continue
        before, after = out[at - 1], out[at]
        if before @ after > np.cos(_SHARP_EDGE_RAD):
            points.append(corner)
            looks.append(before + after)
            continue
        cut = min(bevel, 0.3 * float(lengths[at - 1]), 0.3 * float(lengths[at]))
        points += [corner - cut * ways[at - 1], corner + cut * ways[at]]
        looks += [before, after]
    return _restore_extents(np.array(points), corners), _normalized(np.array(looks))


def _restore_extents(line: Array, corners: Array) -> Array:
    """What the bevels took off the outermost corners is given back, so that the extents are what they were."""
    radius = line[:, 0] * (corners[:, 0].max() / line[:, 0].max())
    low, high = corners[:, 1].min(), corners[:, 1].max()
    height = line[:, 1]
    if height.max() > height.min():
        height = low + (height - height.min()) * ((high - low) / (height.max() - height.min()))
    return np.stack([radius, np.clip(height, low, high)], axis=1)


def _parallel_frames(along: Array) -> Array:
    """Two directions across each step of a path, n x 2 x 3, turned as little as can be from step to step."""
    first = np.eye(3)[int(np.argmin(np.abs(along[0])))]
    sides = []
    for way in along:
        first = _normalized(first - (first @ way) * way)
        sides.append((first, np.cross(way, first)))
    return np.array(sides)


def _normalized(vectors: Array) -> Array:
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.where(lengths > 0.0, lengths, 1.0))


# -- plates with holes -------------------------------------------------------------------------------------------------


def panel_with_cutouts(
    cuts: tuple[Array, Array], kept: NDArray[np.bool_], thickness: tuple[float, float]
) -> TriangleMesh:
    """A plate with holes through it along z; each face has its own normal.

    Args:
        cuts: where the plate is divided along x and along y, edges included [m].
        kept: which of the cells between the cuts are there.
        thickness: its lower and upper side along z [m].
    """
    rows, columns = kept.shape
    number = np.arange(2 * (rows + 1) * (columns + 1)).reshape(2, rows + 1, columns + 1)
    padded = np.pad(kept, 1)
    a, b, c, d = padded[:-1, :-1], padded[1:, :-1], padded[:-1, 1:], padded[1:, 1:]
    twice = (a & d & ~b & ~c) | (b & c & ~a & ~d)  # two cells meet in a corner alone: each has its own
    x, y = np.nonzero(kept)
    below, above = (
        [
            level[x + dx, y + dy] + number.size * (twice[x + dx, y + dy] if dx == 0 else 0)
            for dx, dy in ((0, 0), (1, 0), (1, 1), (0, 1))
        ]
        for level in number
    )
    quads = [np.stack(above, axis=1), np.stack(below[::-1], axis=1)]
    for start, end, (dx, dy) in ((0, 1, (0, -1)), (1, 2, (1, 0)), (2, 3, (0, 1)), (3, 0, (-1, 0))):
        bare = ~padded[x + 1 + dx, y + 1 + dy]
        quads.append(np.stack([below[start], below[end], above[end], above[start]], axis=1)[bare])
    corners = np.concatenate(quads)
    faces = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
    used, faces = np.unique(faces, return_inverse=True)
    level, at_x, at_y = np.unravel_index(used % number.size, number.shape)
    points = np.stack([cuts[0][at_x], cuts[1][at_y], np.array(thickness)[level]], axis=1)
    return TriangleMesh(points, faces.reshape(-1, 3).astype(np.uint32), None)
