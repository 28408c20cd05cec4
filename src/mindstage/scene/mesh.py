"""Triangle meshes: primitives, rounded boxes, surfaces of revolution, sweeps, lofts, panels with cutouts, convex hulls.

Each mesh is closed by its indices: every edge is used once in each direction, and faces are counterclockwise seen from
outside. Each point has one normal: edges have a narrow bevel over which the shading changes, so that adjacent faces
look flat and no point is duplicated.

`scipy.spatial` (Qhull) is imported by the first call of `convex_hull`, since the import takes 0.1 s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mindstage.scene.transforms import Array, cross
from mindstage.scene.world_model import Vector

__all__ = [
    "Hull",
    "TriangleMesh",
    "arrow",
    "box",
    "box_edges",
    "boxes",
    "cone",
    "convex_hull",
    "cut_above",
    "cylinder",
    "face_cross_products",
    "face_normals",
    "joined",
    "lathe",
    "loft",
    "panel_with_cutouts",
    "scaled",
    "sphere",
    "sweep",
]


_FLAT = 1e-6
"""Points are coplanar if their smallest extent is at most this fraction of the largest: float32 files round by 1e-7."""


@dataclass(frozen=True, slots=True, eq=False)
class Hull:
    """A convex polyhedron with triangular faces."""

    points: Array
    """n x 3, the vertices, in the order of the input points."""
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
"""Largest bevel of the edges of primitives."""
_SEGMENTS = 40
"""Points of the circles of primitives, a multiple of four."""
_MIN_EXTENT_M = 2e-4
"""Smallest extent of primitives along each axis."""
_MIN_CROSS_PRODUCT_M2 = 1e-30
_SHARP_EDGE_RAD = 0.6
"""Corners of profiles with a larger angle are sharp edges, which are beveled."""


class TriangleMesh(NamedTuple):
    """A closed triangle mesh."""

    points: Array
    """n x 3 [m]."""
    faces: Faces
    """m x 3 indices of points, counterclockwise seen from outside."""
    normals: Array | None = None
    """n x 3 unit vertex normals; None for flat shading, with one normal per face."""
    uv: Array | None = None
    """n x 2 texture coordinates."""


def face_cross_products(points: Array, faces: NDArray[np.integer[Any]]) -> Array:
    """For each face, the cross product of two of its edges, m x 3 [m²].

    It is along the normal, and twice as long as the area.

    Args:
        points: n x 3 [m].
        faces: m x 3 indices of points.
    """
    first, second, third = np.take(points, faces.T, axis=0)
    return cross(second - first, third - first)


def face_normals(points: Array, faces: NDArray[np.integer[Any]]) -> Array:
    """The unit normal of each face, m x 3; 0 for faces without an area.

    Args:
        points: n x 3 [m].
        faces: m x 3 indices of points.
    """
    across = face_cross_products(points, faces)
    normals: Array = across / np.maximum(np.linalg.norm(across, axis=1), _MIN_CROSS_PRODUCT_M2)[:, None]
    return normals


def joined(meshes: Sequence[TriangleMesh]) -> TriangleMesh:
    """Returns several meshes as one; either all of them have normals or none, and the same holds for `uv`."""
    if len(meshes) == 1:
        return meshes[0]
    starts = np.cumsum([0, *(len(mesh.points) for mesh in meshes)])
    normals = [mesh.normals for mesh in meshes if mesh.normals is not None]
    uv = [mesh.uv for mesh in meshes if mesh.uv is not None]
    return TriangleMesh(
        np.concatenate([mesh.points for mesh in meshes]),
        np.concatenate([mesh.faces + np.uint32(start) for mesh, start in zip(meshes, starts, strict=False)]),
        np.concatenate(normals) if normals else None,
        np.concatenate(uv) if uv else None,
    )


def scaled(mesh: TriangleMesh, scale: Array, shift: Array) -> TriangleMesh:
    """Returns the mesh scaled along each axis, then translated."""
    normals = mesh.normals
    if normals is not None and not np.allclose(scale, scale[0], rtol=1e-9):
        normals = _normalized(normals / scale)
    return TriangleMesh(mesh.points * scale + shift, mesh.faces, normals, mesh.uv)


# -- primitives --------------------------------------------------------------------------------------------------------


def box(size: Vector) -> TriangleMesh:
    """Returns a box around the origin, with beveled edges."""
    half = np.maximum(np.array(size), _MIN_EXTENT_M)[None] / 2
    return boxes(-half, half, np.minimum(_EDGE_RADIUS_M, 0.3 * half.min(axis=1)))


def cylinder(size: Vector) -> TriangleMesh:
    """Returns a cylinder along z around the origin, with beveled edges; elliptic if width and depth differ."""
    radius, half = max(min(size[:2]), _MIN_EXTENT_M) / 2, max(size[2], _MIN_EXTENT_M) / 2
    return _surface_of_revolution(size, [(0.0, -half), (radius, -half), (radius, half), (0.0, half)])


def sphere(size: Vector) -> TriangleMesh:
    """Returns a sphere around the origin, or an ellipsoid if the extents differ."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, _SEGMENTS // 2 + 1)
    profile = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    profile[[0, -1], 0] = 0.0
    return _surface_of_revolution(size, [(r, z) for r, z in profile.tolist()])


def cone(size: Vector) -> TriangleMesh:
    """Returns a cone along z around the origin, with its apex at the top."""
    radius, half = max(min(size[:2]), _MIN_EXTENT_M) / 2, max(size[2], _MIN_EXTENT_M) / 2
    return _surface_of_revolution(size, [(0.0, -half), (radius, -half), (0.0, half)])


def arrow(size: Vector) -> TriangleMesh:
    """Returns an arrow from the origin along x: the first extent is its length, the others are its thickness."""
    length, width, height = size
    radius, half = max(min(width, height), _MIN_EXTENT_M) / 2, max(length, _MIN_EXTENT_M) / 2
    shaft = [(0.0, -half), (0.5 * radius, -half), (0.5 * radius, 0.5 * half)]
    upright = _surface_of_revolution((width, height, length), [*shaft, (radius, 0.5 * half), (0.0, half)])
    assert upright.normals is not None
    points = upright.points[:, [2, 0, 1]] + (max(length, _MIN_EXTENT_M) / 2, 0.0, 0.0)
    return TriangleMesh(points, upright.faces, upright.normals[:, [2, 0, 1]])


def _surface_of_revolution(size: Vector, profile: Sequence[tuple[float, float]]) -> TriangleMesh:
    """Returns a surface of revolution that is scaled to a size."""
    mesh = lathe(profile, bevel=_EDGE_RADIUS_M, segments=_SEGMENTS)
    scale = np.maximum(np.array(size), _MIN_EXTENT_M) / np.ptp(mesh.points, axis=0)
    return scaled(mesh, scale, np.zeros(3))


def box_edges(size: Vector, *, margin: float = 0.0) -> NDArray[np.float32]:
    """Returns the end points of the twelve edges of a box, 12 x 2 x 3, offset outwards by the margin [m]."""
    corners = _CORNERS * (np.asarray(size) / 2 + margin)
    return np.asarray(corners[np.array(_EDGES)], dtype=np.float32)


_CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))
_EDGES = [(a, b) for a in range(8) for b in range(a + 1, 8) if np.sum(_CORNERS[a] != _CORNERS[b]) == 1]
"""Pairs of indices of corners."""


# -- boxes -------------------------------------------------------------------------------------------------------------


def boxes(low: Array, high: Array, radii: Array, *, steps: int = 1) -> TriangleMesh:
    """Returns boxes with rounded edges as one mesh.

    Args:
        low: lower corners, n x 3 [m].
        high: upper corners, n x 3 [m].
        radii: radius of the edges of each box [m], at most half of its smallest extent.
        steps: number of flat strips per rounded edge; one is a bevel.
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
    """Returns the corner signs and normals of the points of a rounded box, and its faces."""
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
    """Returns the faces between consecutive closed rings of points; `closed` connects the last ring to the first."""
    ring, step = np.meshgrid(np.arange(rings if closed else rings - 1), np.arange(segments), indexing="ij")
    here, beside = ring * segments + step, ring * segments + (step + 1) % segments
    above = (ring + 1) % rings * segments
    over, across = above + step, above + (step + 1) % segments
    lower, upper = np.stack([here, beside, across], axis=-1), np.stack([here, across, over], axis=-1)
    return np.concatenate([lower.reshape(-1, 3), upper.reshape(-1, 3)])


def _caps(rings: int, segments: int) -> NDArray[np.int64]:
    """Returns triangle fans over the first and the last ring."""
    fan = np.array([(0, step, step + 1) for step in range(1, segments - 1)], dtype=np.int64)
    return np.concatenate([fan[:, ::-1], fan + (rings - 1) * segments])


# -- surfaces of revolution, sweeps and lofts --------------------------------------------------------------------------


def lathe(profile: Sequence[tuple[float, float]], *, bevel: float, segments: int, closed: bool = False) -> TriangleMesh:
    """Returns the surface of revolution of a profile about z.

    Args:
        profile: radius and height [m] of its points: from the axis at the bottom, along the outside, to the axis at
            the top, which may be the bottom of a cavity; or a loop that does not touch the axis.
        bevel: largest bevel of sharp edges [m].
        segments: points per circle, a multiple of four.
        closed: whether the profile is a loop.
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
    """Returns a round bar along a path, with rounded ends.

    Args:
        path: n x 3 [m].
        radius: radius of the bar [m], a number or n.
        segments: points per circle.
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
    caps = [np.broadcast_to(normal, (1, segments, 3)) for normal in (-along[0], along[-1])]
    return _tube(np.concatenate([ends[0], rings, ends[1]]), np.concatenate([caps[0], turns, caps[1]]))


def loft(rings: Array) -> TriangleMesh:
    """Returns the surface through rings of points, with smooth normals; fans close the first and the last ring.

    Args:
        rings: k x n x 3 [m], each counterclockwise seen against the direction of the loft.
    """
    ends = [np.broadcast_to(ring.mean(axis=0), (1, rings.shape[1], 3)) for ring in (rings[0], rings[-1])]
    mesh = _tube(np.concatenate([ends[0], rings, ends[1]]), None)
    across = face_cross_products(mesh.points, mesh.faces)
    normals = np.zeros_like(mesh.points)
    for corner in range(3):
        np.add.at(normals, mesh.faces[:, corner], across)
    return mesh._replace(normals=_normalized(normals))


def _tube(rings: Array, normals: Array | None, *, closed: bool = False) -> TriangleMesh:
    """Returns the surface through rings; a ring of coincident points becomes a single point."""
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
    """Returns the points and normals of a profile in which each sharp corner is replaced by two points."""
    steps = np.diff(corners, axis=0, append=corners[:1])
    lengths = np.linalg.norm(steps, axis=1)
    directions = steps / np.where(lengths > 0.0, lengths, 1.0)[:, None]
    out = np.stack([directions[:, 1], -directions[:, 0]], axis=1)
    points: list[Array] = []
    normals: list[Array] = []
    last = len(corners) - 1
    for at, corner in enumerate(corners):
        if not closed and at in (0, last):
            points.append(corner)
            normals.append(
                np.array([0.0, np.sign(out[at - 1 if at else 0][1]) or 1.0]) if corner[0] == 0.0 else out[at]
            )
            continue
        before, after = out[at - 1], out[at]
        if before @ after > np.cos(_SHARP_EDGE_RAD):
            points.append(corner)
            normals.append(before + after)
            continue
        cut = min(bevel, 0.3 * float(lengths[at - 1]), 0.3 * float(lengths[at]))
        points += [corner - cut * directions[at - 1], corner + cut * directions[at]]
        normals += [before, after]
    return _restore_extents(np.array(points), corners), _normalized(np.array(normals))


def _restore_extents(line: Array, corners: Array) -> Array:
    """Scales a beveled profile to the extents of the original corners."""
    radius = line[:, 0] * (corners[:, 0].max() / line[:, 0].max())
    low, high = corners[:, 1].min(), corners[:, 1].max()
    height = line[:, 1]
    if height.max() > height.min():
        height = low + (height - height.min()) * ((high - low) / (height.max() - height.min()))
    return np.stack([radius, np.clip(height, low, high)], axis=1)


def _parallel_frames(along: Array) -> Array:
    """Returns two unit vectors across each direction, n x 2 x 3, by parallel transport (minimal rotation)."""
    first = np.eye(3)[int(np.argmin(np.abs(along[0])))]
    sides = []
    for direction in along:
        first = _normalized(first - (first @ direction) * direction)
        sides.append((first, np.cross(direction, first)))
    return np.array(sides)


def _normalized(vectors: Array) -> Array:
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.where(lengths > 0.0, lengths, 1.0))


# -- panels with cutouts -----------------------------------------------------------------------------------------------


def panel_with_cutouts(
    cuts: tuple[Array, Array], kept: NDArray[np.bool_], thickness: tuple[float, float]
) -> TriangleMesh:
    """Returns a panel with holes through it along z, flat shaded.

    Args:
        cuts: coordinates that divide the panel into cells along x and y, including its edges [m].
        kept: which of the cells are present.
        thickness: lower and upper z coordinate [m].
    """
    rows, columns = kept.shape
    number = np.arange(2 * (rows + 1) * (columns + 1)).reshape(2, rows + 1, columns + 1)
    padded = np.pad(kept, 1)
    a, b, c, d = padded[:-1, :-1], padded[1:, :-1], padded[:-1, 1:], padded[1:, 1:]
    twice = (a & d & ~b & ~c) | (b & c & ~a & ~d)  # two cells that meet only at a corner do not share the vertex
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


def cut_above(
    columns: Array, faces: NDArray[np.integer[Any]], heights: Array, limit: float
) -> tuple[Array, NDArray[np.int64]]:
    """The part of a mesh below a height; triangles that cross it are cut, and the cut is left open.

    Args:
        columns: n x k, what each point has, such as its position, normal and texture coordinates.
        faces: m x 3 indices of points.
        heights: n, the height of each point, a linear function of its position.
        limit: what is higher is cut off.

    Returns:
        The columns, followed by those of new points at the height, interpolated along the edges; and the faces, whose
        order of corners is kept.
    """
    inside = heights[faces] <= limit
    count = inside.sum(axis=1)
    kept = [faces[count == 3].astype(np.int64)]
    added: list[Array] = []
    total = len(columns)
    for below in (1, 2):
        cut = faces[count == below].astype(np.int64)
        if not len(cut):
            continue
        # The corner that is alone on its side comes first; the order of the others is kept.
        alone = np.argmax(inside[count == below] == (below == 1), axis=1)
        a, b, c = (np.take_along_axis(cut, ((alone + step) % 3)[:, None], axis=1)[:, 0] for step in range(3))
        for end in (b, c):
            part = (limit - heights[a]) / (heights[end] - heights[a])
            added.append(columns[a] + (columns[end] - columns[a]) * part[:, None])
        first, second = total + np.arange(len(cut)), total + len(cut) + np.arange(len(cut))
        total += 2 * len(cut)
        if below == 1:
            kept.append(np.stack([a, first, second], axis=1))
        else:
            kept += [np.stack([first, b, c], axis=1), np.stack([first, c, second], axis=1)]
    return np.concatenate([columns, *added]), np.concatenate(kept)
