"""Texture coordinates with a metric scale: flat and cylindrical projections of the parts of a shape.

Each face is projected along the axis that is nearest to its normal, or unrolled around the axis of a round part, so
that an area of the surface has nearly the same area on the texture and no face is mirrored. Vertices are duplicated
where neighboring faces are projected differently; then edges are closed by position, no longer by index.
"""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mindstage.scene.mesh import TriangleMesh, face_cross_products
from mindstage.scene.transforms import Array
from mindstage.textures.catalog import TextureInfo, TextureLayout

__all__ = ["PrintLayout", "RoundAxis", "project_boxes", "project_flat", "project_print", "project_round"]

_PREFERENCE = np.array([1.0, 1.0 + 1e-6, 1.0 + 2e-6])
"""Decides the axis of faces that are oblique by exactly 45 degrees: the same for both triangles of a bevel."""
_CAP_COSINE = 0.7
"""Faces whose normal is nearer to the axis of a round part than this are projected along it."""
_MAX_STRETCH = 0.3
"""Largest relative deviation from the metric scale that makes the texture fit around a circle without a seam."""

_UPRIGHT = np.array([[[0, 1, 0], [0, 0, 1]], [[-1, 0, 0], [0, 0, 1]], [[1, 0, 0], [0, 1, 0]]], dtype=np.float64)
"""Directions of u and v on faces across x, y and z."""


class PrintLayout(StrEnum):
    """Where the picture of a printed part is; what it leaves free has the color of the picture's lower left corner."""

    WRAP = "wrap"
    """On the four upright sides of a box: from the left edge of the front around it, seen from above."""
    ROUND = "round"
    """Around an upright cylinder; the middle of the picture is at the front."""
    FRONT = "front"
    """On the side at +x."""
    TOP = "top"
    """On the upper side, with its upper edge at -x."""
    LEFT = "left"
    """On the side at +y."""
    RIGHT = "right"
    """On the side at -y."""


_SIDES = {PrintLayout.FRONT: 1, PrintLayout.LEFT: 3, PrintLayout.RIGHT: 2, PrintLayout.TOP: 5}
"""The charts of printed sides: twice the axis, plus one for the positive end."""


class RoundAxis(NamedTuple):
    """The axis of a round part: its number (0, 1, 2), and a point on it."""

    axis: int
    center: Array


def project_boxes(mesh: TriangleMesh, count: int, extents: Array, texture: TextureInfo) -> TriangleMesh:
    """Returns boxes with texture coordinates: those of one box follow its own longest side.

    Args:
        mesh: the mesh of all boxes, with equally many points and faces each.
        count: the number of boxes.
        extents: their extents, n x 3 [m].
    """
    points_each, faces_each = len(mesh.points) // count, len(mesh.faces) // count
    number = np.arange(count)
    grain = np.argmax(extents, axis=1)
    return _project_axes(
        mesh, texture, np.repeat(number, faces_each), grain, np.repeat(number, points_each), groups=count
    )


def project_flat(mesh: TriangleMesh, texture: TextureInfo) -> TriangleMesh:
    """Returns a part with texture coordinates that are projected along the axes."""
    grain = np.array([int(np.argmax(np.ptp(mesh.points, axis=0)))])
    return _project_axes(
        mesh, texture, np.zeros(len(mesh.faces), np.int64), grain, np.zeros(len(mesh.points), np.int64), groups=1
    )


def project_round(mesh: TriangleMesh, around: RoundAxis, texture: TextureInfo) -> TriangleMesh:
    """Returns a round part with texture coordinates: its ends flat, its sides unrolled around the axis.

    The grain of wood runs along the axis. The texture is stretched a little if it then fits around without a seam.
    """
    axis = around.axis
    along_grain = texture.layout is TextureLayout.GRAIN
    offset = _offsets(mesh.points.mean(axis=0)[None], texture)[0]
    normals = _face_normals(mesh)
    first, second = [each for each in range(3) if each != axis]
    local = (mesh.points - around.center)[:, [first, second]]
    half = np.maximum(np.abs(local).max(axis=0), 1e-12)
    angle = np.arctan2(local[:, 1] / half[1], local[:, 0] / half[0]) + np.pi
    on_axis = np.hypot(*local.T) < 1e-9
    chart = _round_charts(mesh, normals, axis, angle, on_axis, normals[:, [first, second]], local)
    split, source, charts = _split(mesh, chart)
    turn = angle[source].copy()
    is_cap, is_inner = charts < 2, charts % 2 == 1
    turn[(charts // 2 == 2) & (turn < np.pi)] += 2.0 * np.pi
    tips = on_axis[mesh.faces].any(axis=1) & (chart >= 2)
    if tips.any():
        turn = _tip_angles(split.faces[tips], turn, on_axis[source])
    width = texture.size[1] if along_grain else texture.size[0]
    share, circumference = _arc_shares(turn, half * _mean_share(mesh, local / half, normals, axis))
    around_it = share * _repeats(circumference, width)
    up = split.points[:, axis] / (texture.size[0] if along_grain else texture.size[1])
    # Seen from outside, angles increase to the right if the axis is up and the frame is right-handed; y is mirrored.
    mirror = -1.0 if axis == 1 else 1.0
    around_it = around_it * np.where(is_inner, -mirror, mirror)
    side = np.stack([up, -around_it] if along_grain else [around_it, up], axis=1)
    flat = split.points[:, [first, second]] * np.stack([np.where(is_inner, -mirror, mirror), np.ones(len(charts))], 1)
    return split._replace(uv=np.where(is_cap[:, None], flat / np.array(texture.size), side) + offset)


def _round_charts(
    mesh: TriangleMesh,
    normals: Array,
    axis: int,
    angle: Array,
    on_axis: NDArray[np.bool_],
    outwards: Array,
    local: Array,
) -> NDArray[np.int64]:
    """The chart of each face: 0 and 1 for ends, from 2 on for sides; inner and lower sides have odd numbers."""
    corners = mesh.faces
    caps = np.abs(normals[:, axis]) > _CAP_COSINE
    inner = np.einsum("ij,ij->i", outwards, local[corners].mean(axis=1)) < 0.0
    wraps = np.ptp(angle[corners], axis=1) > np.pi
    chart = np.where(caps, (normals[:, axis] < 0.0).astype(np.int64), np.where(wraps, 4, 2) + inner)
    # A fan at a tip has one vertex for all angles: each of its faces needs its own.
    tips = on_axis[corners].any(axis=1) & ~caps
    return np.where(tips, 6 + 2 * np.arange(len(chart)) + inner, chart)


def _arc_shares(angles: Array, half: Array) -> tuple[Array, float]:
    """The arc lengths of angles of an ellipse with these semi-axes, as shares of its circumference, and that [m]."""
    if abs(half[0] / half[1] - 1.0) < 1e-6:
        return angles / (2.0 * np.pi), 2.0 * np.pi * float(half[0])
    fine = np.linspace(0.0, 4.0 * np.pi, 1441)
    speed = np.hypot(half[0] * np.sin(fine), half[1] * np.cos(fine))
    length = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(fine))])
    circumference = float(length[720])
    return np.interp(angles, fine, length) / circumference, circumference


def project_print(mesh: TriangleMesh, layout: PrintLayout) -> TriangleMesh:
    """Returns a part with texture coordinates from 0 to 1 on its printed sides; pictures are not mirrored."""
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    if layout is PrintLayout.ROUND:
        return _project_round_print(mesh, low, high)
    normals = _face_normals(mesh)
    axis = np.argmax(np.abs(normals) * _PREFERENCE[::-1], axis=1)  # bevels belong to the upright sides
    positive = np.take_along_axis(normals, axis[:, None], axis=1)[:, 0] > 0.0
    split, _, charts = _split(mesh, axis * 2 + positive)
    across, sign = charts // 2, np.where(charts % 2, 1.0, -1.0)
    share = (split.points - low) / np.where(high > low, high - low, 1.0) - 0.5
    u, v = (np.einsum("ij,ij->i", share, _UPRIGHT[across, each]) for each in (0, 1))
    uv = np.stack([0.5 + sign * u, 0.5 + v], axis=1)
    if layout is PrintLayout.TOP:  # read from the front
        uv = np.stack([0.5 + share[:, 1], 0.5 - share[:, 0]], axis=1)
    printed = charts == _SIDES.get(layout, -1)
    if layout is PrintLayout.WRAP:
        depth, width = (high - low)[:2]
        start = {1: 0.0, 3: width, 0: width + depth, 2: 2 * width + depth}
        total = 2 * (width + depth)
        begin = np.array([start.get(chart, 0.0) for chart in range(6)])[charts]
        extent = np.where(across == 0, width, depth)
        uv[:, 0] = (begin + uv[:, 0] * extent) / total
        printed = across != 2
    return split._replace(uv=np.where(printed[:, None], uv, _BARE))


_BARE = np.array([0.004, 0.004])
"""A place in the lower left corner of a picture."""


def _project_round_print(mesh: TriangleMesh, low: Array, high: Array) -> TriangleMesh:
    middle = (low + high) / 2
    normals = _face_normals(mesh)
    angle = np.arctan2(mesh.points[:, 1] - middle[1], mesh.points[:, 0] - middle[0]) + np.pi
    outer = np.einsum("ij,ij->i", normals[:, :2], (mesh.points[mesh.faces].mean(axis=1) - middle)[:, :2]) > 0.0
    side = outer & (np.abs(normals[:, 2]) <= _CAP_COSINE)
    wraps = np.ptp(angle[mesh.faces], axis=1) > np.pi
    split, source, charts = _split(mesh, np.where(side, wraps.astype(np.int64), 2))
    turn = angle[source].copy()
    turn[(charts == 1) & (turn < np.pi)] += 2.0 * np.pi
    height = (split.points[:, 2] - low[2]) / (high[2] - low[2])
    uv = np.stack([turn / (2.0 * np.pi), height], axis=1)
    return split._replace(uv=np.where((charts == 2)[:, None], _BARE, uv))


def _repeats(circumference: float, width: float) -> float:
    """How often a texture is repeated around a circle: a whole number if that stretches it little."""
    exact = circumference / width
    whole = max(round(exact), 1)
    return float(whole) if abs(whole / exact - 1.0) <= _MAX_STRETCH else exact


def _mean_share(mesh: TriangleMesh, shares: Array, normals: Array, axis: int) -> float:
    """The mean distance of the sides from the axis, weighted by area, as a share of the largest one."""
    a, b, c = (mesh.points[mesh.faces[:, corner]] for corner in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) * (np.abs(normals[:, axis]) <= _CAP_COSINE)
    total = float(area.sum())
    radii = np.hypot(*shares.T)
    return float((radii[mesh.faces].mean(axis=1) * area).sum() / total) if total > 0.0 else float(radii.max())


def _tip_angles(faces: NDArray[np.uint32], turn: Array, on_axis: NDArray[np.bool_]) -> Array:
    """The angles, with those of tips in the middle of the other corners of their face."""
    turn = turn.copy()
    for face in faces:
        tip = on_axis[face]
        others = turn[face[~tip]]
        if np.ptp(others) > np.pi:
            others = np.where(others < np.pi, others + 2.0 * np.pi, others)
            turn[face[~tip]] = others
        turn[face[tip]] = others.mean()
    return turn


def _project_axes(
    mesh: TriangleMesh,
    texture: TextureInfo,
    group_of_face: NDArray[np.int64],
    grain: NDArray[np.int64],
    group_of_point: NDArray[np.int64],
    *,
    groups: int,
) -> TriangleMesh:
    """Projects each face along the axis nearest to its normal; each group of faces has its own grain and offset."""
    normals = _face_normals(mesh)
    axis = np.argmax(np.abs(normals) * _PREFERENCE, axis=1)
    sign = np.where(np.take_along_axis(normals, axis[:, None], axis=1)[:, 0] < 0.0, -1.0, 1.0)
    split, source, charts = _split(mesh, axis * 2 + (sign > 0))
    across, sign = charts // 2, np.where(charts % 2, 1.0, -1.0)
    u, v = (_UPRIGHT[across, each] for each in (0, 1))
    if texture.layout is TextureLayout.GRAIN:
        u, v = _along_grain(u, v, across, grain[group_of_point[source]])
    u = u * sign[:, None]  # seen from outside, v stays upwards
    middles = np.zeros((groups, 3))
    np.add.at(middles, group_of_point, mesh.points)
    middles /= np.bincount(group_of_point, minlength=groups)[:, None]
    offset = _offsets(middles, texture)[group_of_point[source]]
    flat = np.stack([np.einsum("ij,ij->i", split.points, each) for each in (u, v)], axis=1)
    return split._replace(uv=flat / np.array(texture.size) + offset)


def _along_grain(u: Array, v: Array, across: NDArray[np.int64], grain: NDArray[np.int64]) -> tuple[Array, Array]:
    """Turns u into the direction of the grain; at the ends of a board both stay."""
    turned = (np.take_along_axis(v, grain[:, None], axis=1)[:, 0] != 0.0) & (across != grain)
    return np.where(turned[:, None], v, u), np.where(turned[:, None], -u, v)


def _offsets(middles: Array, texture: TextureInfo) -> Array:
    """Where in the texture each part begins, n x 2: anywhere, but always the same for the same place."""
    if texture.layout is TextureLayout.GRID:
        return np.zeros((len(middles), 2))
    mixed = np.sin(np.round(middles, 4) @ np.array([[127.1, 269.5], [311.7, 183.3], [74.7, 246.1]])) * 43758.5453
    return np.asarray(mixed - np.floor(mixed))


def _face_normals(mesh: TriangleMesh) -> Array:
    """Normals of the faces; for faces without an area, such as bevels of width 0, those of their vertices."""
    normals = face_cross_products(mesh.points, mesh.faces)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    flat = length[:, 0] < 1e-14
    if flat.any() and mesh.normals is not None:
        normals = np.where(flat[:, None], mesh.normals[mesh.faces].mean(axis=1), normals)
        length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(normals / np.where(length > 0.0, length, 1.0))


def _split(mesh: TriangleMesh, chart: NDArray[np.int64]) -> tuple[TriangleMesh, NDArray[np.int64], NDArray[np.int64]]:
    """Duplicates the vertices that have faces in several charts.

    Returns the mesh, and for each of its vertices the original one and its chart.
    """
    count = int(chart.max()) + 1
    pairs = mesh.faces.astype(np.int64) * count + chart[:, None]
    used, faces = np.unique(pairs, return_inverse=True)
    source, charts = used // count, used % count
    normals = None if mesh.normals is None else mesh.normals[source]
    return TriangleMesh(mesh.points[source], faces.reshape(-1, 3).astype(np.uint32), normals), source, charts
