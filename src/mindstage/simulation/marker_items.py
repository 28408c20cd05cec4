"""Visualization markers as items of pictures: meshes in the color of the marker, and labels.

Lines are drawn as bars with a square section, points as small octahedra, both with the width of the marker.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from mindstage.rendering.render_scene import RenderItem, RenderLabel
from mindstage.scene import BodyId, Color, PbrMaterial, Vector, VisualMesh
from mindstage.scene.mesh import TriangleMesh, arrow, box, cone, cylinder, sphere
from mindstage.scene.transforms import Array, normalized_pose_array, pose_from_array, quat_rotate
from mindstage.simulation.highlights import Marker, MarkerType

__all__ = ["marker_items", "marker_labels"]

_MESHES: dict[MarkerType, Callable[[Vector], TriangleMesh]] = {
    MarkerType.CUBE: box,
    MarkerType.SPHERE: sphere,
    MarkerType.CYLINDER: cylinder,
    MarkerType.CONE: cone,
    MarkerType.ARROW: arrow,
}
_MIN_THICKNESS_M = 2e-3
"""A thinner line would hardly be seen in a picture of a room."""
_COLOR_STEPS = 32
"""Colors of points are rounded to so many steps, so that a cloud of points is few meshes."""
_OCTAHEDRON = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=float) / 2
_OCTAHEDRON_FACES = np.array(
    [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]], dtype=np.uint32
)
_BAR_CORNERS = np.array([[s, y, z] for s in (0, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
"""Position along the line, and to both sides in halves of the width."""
_BAR_FACES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ],
    dtype=np.uint32,
)


def marker_items(markers: Iterable[Marker], visuals: Mapping[BodyId, tuple[VisualMesh, ...]]) -> Iterator[RenderItem]:
    """Yields the markers that are drawn as meshes: all visible ones but texts.

    Args:
        markers: the markers.
        visuals: the visual meshes of the bodies that markers copy.
    """
    for marker in markers:
        if marker.opacity <= 0.0 or marker.type is MarkerType.TEXT:
            continue
        meshes = tuple(_visuals(marker, visuals))
        if not meshes:
            continue
        points = np.concatenate([mesh.points for mesh in meshes])
        low, high = points.min(axis=0), points.max(axis=0)
        # The item is where its mesh is: points of lines may be far from the origin of their marker.
        center = (low + high) / 2
        pose = normalized_pose_array(marker.pose)
        pose[:3] += quat_rotate(pose[3:], center)
        x, y, z = (high - low).tolist()
        yield RenderItem(
            id=BodyId(f"marker {marker.id}"),
            visuals=tuple(VisualMesh(mesh.points - center, mesh.faces, mesh.material, mesh.normals) for mesh in meshes),
            pose=pose_from_array(pose),
            size=(x, y, z),
            casts_shadow=False,
            is_marker=True,
        )


def marker_labels(markers: Iterable[Marker]) -> Iterator[RenderLabel]:
    """Yields the labels of text markers."""
    for marker in markers:
        if marker.type is MarkerType.TEXT and marker.text and marker.opacity > 0.0:
            yield RenderLabel(text=marker.text, point=marker.pose.position, id=BodyId(f"marker {marker.id}"))


def _visuals(marker: Marker, visuals: Mapping[BodyId, tuple[VisualMesh, ...]]) -> Iterator[VisualMesh]:
    x, y, z = (max(abs(extent), _MIN_THICKNESS_M) for extent in marker.size)
    points = np.array(marker.points, dtype=float).reshape(-1, 3)
    match marker.type:
        case MarkerType.BODY_COPY:
            material = _material(marker, marker.color)
            for mesh in visuals.get(BodyId(marker.body), ()):
                yield VisualMesh(mesh.points, mesh.faces, material, mesh.normals)
        case MarkerType.POINTS:
            for color, rows in _by_color(marker, np.arange(len(points))):
                dots = (points[rows, None] + x * _OCTAHEDRON).reshape(-1, 3)
                yield VisualMesh(dots, _repeated(_OCTAHEDRON_FACES, 6, len(rows)), _material(marker, color))
        case MarkerType.LINE_STRIP | MarkerType.LINE_LIST:
            step = 1 if marker.type is MarkerType.LINE_STRIP else 2
            starts = np.arange(0, max(len(points) - 1, 0), step)
            for color, rows in _by_color(marker, starts):
                yield VisualMesh(
                    _bars(points[rows], points[rows + 1], x),
                    _repeated(_BAR_FACES, 8, len(rows)),
                    _material(marker, color),
                )
        case _:
            shape = _MESHES[marker.type]((x, y, z))
            yield VisualMesh(shape.points, shape.faces, _material(marker, marker.color), shape.normals)


def _material(marker: Marker, color: Color) -> PbrMaterial:
    return PbrMaterial(color=color, opacity=marker.opacity, roughness=0.7)


def _by_color(marker: Marker, rows: NDArray[np.intp]) -> Iterator[tuple[Color, NDArray[np.intp]]]:
    """The rows of each color."""
    if not len(rows):
        return
    if len(marker.colors) != len(marker.points):
        yield marker.color, rows
        return
    steps = np.rint(np.array(marker.colors)[rows] * _COLOR_STEPS)
    colors, group = np.unique(steps, axis=0, return_inverse=True)
    for number, (red, green, blue) in enumerate((colors / _COLOR_STEPS).tolist()):
        yield (red, green, blue), rows[group.reshape(-1) == number]


def _repeated(faces: NDArray[np.uint32], corners: int, count: int) -> NDArray[np.uint32]:
    starts = corners * np.arange(count, dtype=np.uint32)
    repeated: NDArray[np.uint32] = (faces[None] + starts[:, None, None]).reshape(-1, 3)
    return repeated


def _bars(starts: Array, ends: Array, width: float) -> Array:
    """The corners of bars between points, 8 n x 3."""
    along = ends - starts
    # Any direction across; along the axis that the line is least parallel to.
    axes = np.eye(3)[np.argmin(np.abs(along), axis=1)]
    across = np.cross(along, axes)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    other = np.cross(along, across)
    other /= np.maximum(np.linalg.norm(other, axis=1, keepdims=True), 1e-12)
    part, side, up = (_BAR_CORNERS[:, at][None, :, None] for at in range(3))
    corners: Array = (
        starts[:, None] + part * along[:, None] + width / 2 * (side * across[:, None] + up * other[:, None])
    )
    return corners.reshape(-1, 3)
