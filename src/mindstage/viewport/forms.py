"""Forms: the meshes that bodies are drawn with, made from their size alone.

Edges are rounded a little, which is what makes a box look like a thing: the vertices of each face are shared with the
narrow faces round it, so that the light runs over the edge while the face itself stays flat. A mesh is in the body's
own frame, centred, in metres.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise, product

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from mindstage.world import Vector

__all__ = [
    "Hole",
    "Mesh",
    "Side",
    "arrow",
    "ball",
    "box",
    "boxes",
    "cone",
    "cylinder",
    "edges",
    "inside",
    "open_box",
    "pierced_box",
    "vessel",
]

_ROUNDING_M = 0.008
_WALL_M = 0.028
_SEGMENTS = 40

Side = tuple[int, int]
"""A side of a box: the axis, and 1 or -1 for its direction."""

Hole = tuple[float, float, float, float]
"""In a side that looks up: from and to along x, from and to along y [m, from the centre]."""

Array = NDArray[np.float64]


class Mesh(msgspec.Struct, frozen=True, eq=False):
    """Triangles, counter-clockwise seen from outside."""

    vertices: NDArray[np.float32]
    """n x 3 [m]."""
    faces: NDArray[np.uint32]
    """m x 3."""


def box(size: ArrayLike, centre: ArrayLike = (0.0, 0.0, 0.0)) -> Mesh:
    """A box with slightly rounded edges."""
    half = np.maximum(np.asarray(size, dtype=np.float64) / 2, 1e-4)
    inset = half - min(_ROUNDING_M, 0.3 * float(half.min()))
    # Vertex 3 * corner + axis lies on the face across that axis, at that corner.
    signs = _CORNERS[:, None, :]
    at_face = np.eye(3, dtype=bool)[None]
    vertices = np.where(at_face, signs * half, signs * inset).reshape(-1, 3) + np.asarray(centre)
    return Mesh(vertices.astype(np.float32), _BOX_FACES)


def pierced_box(size: Vector, holes: Iterable[Hole]) -> Mesh:
    """A box with holes from top to bottom, such as a worktop with a sink in it."""
    return boxes(_pierced(np.asarray(size, dtype=np.float64), np.zeros(3), holes))


def boxes(parts: Iterable[tuple[ArrayLike, ArrayLike]]) -> Mesh:
    """Several boxes as one mesh; each part is a size and a centre."""
    return _joined([box(size, centre) for size, centre in parts])


def open_box(
    size: Vector, openings: Iterable[Side], *, levels: Iterable[float] = (), holes: Iterable[Hole] = ()
) -> Mesh:
    """A box with walls, to look into.

    Args:
        size: its extents [m].
        openings: the sides that have no wall.
        levels: heights of shelves inside, where things stand [m, from the centre].
        holes: in its top.
    """
    extents = np.asarray(size, dtype=np.float64)
    wall = min(_WALL_M, 0.15 * float(extents.min()))
    open_sides = set(openings)
    low, high = -extents / 2, extents / 2
    parts = []
    # Top and bottom go all the way, the rest stands between them, so that no two faces lie in one another.
    for axis in (2, 1, 0):
        for direction in (1, -1):
            if (axis, direction) not in open_sides:
                slab = _slab(low, high, axis, direction, wall)
                parts += _pierced(*slab, holes) if (axis, direction) == (2, 1) else [slab]
        low, high = low.copy(), high.copy()
        low[axis] += wall * ((axis, -1) not in open_sides)
        high[axis] -= wall * ((axis, 1) not in open_sides)
    for level in levels:
        if low[2] + wall < level < high[2]:
            shelf_low, shelf_high = low.copy(), high.copy()
            shelf_low[2], shelf_high[2] = level - min(wall, 0.012), level
            parts.append((shelf_high - shelf_low, (shelf_high + shelf_low) / 2))
    return boxes(parts)


def cylinder(size: Vector) -> Mesh:
    """An upright cylinder; its footprint is an ellipse where depth and width differ."""
    radius = max(min(size[0], size[1]) / 2, 1e-4)
    r = 1.0 - min(_ROUNDING_M, 0.3 * radius) / radius
    h = 1.0 - min(_ROUNDING_M, 0.15 * size[2]) / max(size[2] / 2, 1e-4)
    return _lathe(size, [(0.0, -1.0), (r, -1.0), (1.0, -h), (1.0, h), (r, 1.0), (0.0, 1.0)])


def vessel(size: Vector, *, foot: float = 1.0, thickness: float = 0.004) -> Mesh:
    """An upright round vessel, open at the top: a mug, a bowl, a pot, a plate.

    Args:
        size: extents [m].
        foot: the radius at the bottom against the one at the rim.
        thickness: of its wall [m], where it is large enough for it.
    """
    radius, height = max(min(size[0], size[1]) / 2, 1e-4), max(size[2], 1e-4)
    wall = min(thickness, 0.2 * radius, 0.3 * height)
    w, b = wall / radius, -1.0 + 2 * wall / height
    inside_foot = max(foot - w, 0.1)
    outside = [(0.0, -1.0), (foot * 0.96, -1.0), (foot, -1.0 + 0.2 * wall / height), (1.0, 0.98), (1.0 - w / 2, 1.0)]
    hollow = [(1.0 - w, 0.98), (inside_foot, b + 0.02), (inside_foot * 0.95, b), (0.0, b)]
    return _lathe(size, outside + hollow)


def ball(size: Vector) -> Mesh:
    """A ball, or an ellipsoid where the extents differ."""
    angles = np.linspace(-np.pi / 2, np.pi / 2, _SEGMENTS // 2 + 1)
    return _lathe(size, list(zip(np.cos(angles).tolist(), np.sin(angles).tolist(), strict=True)))


def cone(size: Vector) -> Mesh:
    """An upright cone, its tip at the top."""
    return _lathe(size, [(0.0, -1.0), (1.0, -1.0), (0.0, 1.0)])


def arrow(size: Vector) -> Mesh:
    """An arrow from the origin along x: as long as the first extent, as thick as the others."""
    length, width, height = size
    upright = _lathe((width, height, length), [(0.0, -1.0), (0.5, -1.0), (0.5, 0.5), (1.0, 0.5), (0.0, 1.0)])
    vertices = upright.vertices[:, [2, 0, 1]] + np.array([length / 2, 0.0, 0.0])
    return Mesh(vertices.astype(np.float32), upright.faces)


def inside(size: Vector, side: Side) -> Mesh:
    """One side of a box and nothing else; from behind it is not there."""
    axis, direction = side
    corners = (_CORNERS * np.asarray(size) / 2)[_CORNERS[:, axis] == direction]
    faces = np.array([[0, 1, 2], [1, 3, 2]])
    outward = np.cross(corners[1] - corners[0], corners[2] - corners[0])[axis] * direction > 0
    return Mesh(corners.astype(np.float32), (faces if outward else faces[:, ::-1]).astype(np.uint32))


def edges(size: Vector, *, margin: float = 0.0) -> NDArray[np.float32]:
    """The twelve edges of a box, as 12 x 2 x 3 ends; a little outside of it by the margin [m]."""
    corners = _CORNERS * (np.asarray(size) / 2 + margin)
    return np.asarray(corners[np.array(_EDGES)], dtype=np.float32)


_CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))
_EDGES = [(a, b) for a in range(8) for b in range(a + 1, 8) if np.sum(_CORNERS[a] != _CORNERS[b]) == 1]
"""Between which corners."""


def _box_faces() -> NDArray[np.uint32]:
    """Six faces, twelve edges and eight corners between the 24 vertices of a rounded box."""
    loops = [
        [3 * corner + axis for corner in range(8) if _CORNERS[corner, axis] == direction]
        for axis in range(3)
        for direction in (-1.0, 1.0)
    ]
    for start, end in _EDGES:
        along = int(np.flatnonzero(_CORNERS[start] != _CORNERS[end])[0])
        loops.append([3 * corner + axis for corner in (start, end) for axis in range(3) if axis != along])
    loops += [[3 * corner + axis for axis in range(3)] for corner in range(8)]
    # Around a unit shape each loop is put in order, and triangles made that look outwards.
    at = np.where(np.eye(3, dtype=bool)[None], _CORNERS[:, None, :], _CORNERS[:, None, :] * 0.8).reshape(-1, 3)
    return np.array([face for loop in loops for face in _triangles(loop, at)], dtype=np.uint32)


def _triangles(loop: Sequence[int], at: Array) -> list[tuple[int, int, int]]:
    middle = at[list(loop)].mean(axis=0)
    first = at[loop[0]] - middle
    second = np.cross(middle, first)
    round_it = sorted(loop, key=lambda v: float(np.arctan2((at[v] - middle) @ second, (at[v] - middle) @ first)))
    return [(round_it[0], b, c) for b, c in pairwise(round_it[1:])]


_BOX_FACES = _box_faces()


def _pierced(size: Array, centre: Array, holes: Iterable[Hole]) -> list[tuple[Array, Array]]:
    """The strips that are left of a plate; each hole splits the strips that it lies in."""
    (x0, y0), (x1, y1) = (centre - size / 2)[:2], (centre + size / 2)[:2]
    strips = [(x0, x1, y0, y1)]
    for a, b, c, d in holes:
        strips = [
            rest
            for x0, x1, y0, y1 in strips
            for rest in (
                (x0, min(a, x1), y0, y1),
                (max(b, x0), x1, y0, y1),
                (max(a, x0), min(b, x1), y0, min(c, y1)),
                (max(a, x0), min(b, x1), max(d, y0), y1),
            )
            if rest[1] - rest[0] > 1e-3 and rest[3] - rest[2] > 1e-3
        ]
    return [
        (np.array([x1 - x0, y1 - y0, size[2]]), np.array([(x0 + x1) / 2, (y0 + y1) / 2, centre[2]]))
        for x0, x1, y0, y1 in strips
    ]


def _slab(low: Array, high: Array, axis: int, direction: int, wall: float) -> tuple[Array, Array]:
    """The wall along one side of the room between two corners: size and centre."""
    low, high = low.copy(), high.copy()
    if direction > 0:
        low[axis] = high[axis] - wall
    else:
        high[axis] = low[axis] + wall
    return high - low, (high + low) / 2


def _joined(meshes: Sequence[Mesh]) -> Mesh:
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + np.uint32(start) for mesh, start in zip(meshes, starts, strict=False)]),
    )


def _lathe(size: Vector, profile: Sequence[tuple[float, float]]) -> Mesh:
    """Turns a profile (radius, height; 1 is the extent) round z, from the bottom over the outside to the top.

    Each corner of the profile is kept sharp: the rings on both sides of it have vertices of their own.
    """
    angles = np.linspace(0, 2 * np.pi, _SEGMENTS, endpoint=False)
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    vertices: list[Array] = []
    faces = []
    smooth = _is_smooth(profile)
    for (r0, z0), (r1, z1) in pairwise(profile):
        start = len(vertices) * _SEGMENTS
        if not (smooth and vertices):
            vertices.append(_ring(circle, r0, z0))
        else:
            start -= _SEGMENTS
        vertices.append(_ring(circle, r1, z1))
        lower = start + np.arange(_SEGMENTS)
        upper, along = lower + _SEGMENTS, np.roll(np.arange(_SEGMENTS), -1) + start
        if r0 > 0:
            faces.append(np.stack([lower, along, upper], axis=1))
        if r1 > 0:
            faces.append(np.stack([along, along + _SEGMENTS, upper], axis=1))
    scaled = np.concatenate(vertices) * np.asarray(size) / 2
    return Mesh(scaled.astype(np.float32), np.concatenate(faces).astype(np.uint32))


def _ring(circle: Array, radius: float, height: float) -> Array:
    return np.column_stack([circle * radius, np.full(len(circle), height)])


def _is_smooth(profile: Sequence[tuple[float, float]]) -> bool:
    """Whether the profile turns by little everywhere, as a ball's does."""
    steps = np.diff(np.asarray(profile), axis=0)
    heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    return bool(np.all(np.abs(np.diff(heading)) < 0.3))
