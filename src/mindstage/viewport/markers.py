"""Markers: what programs want to be seen beside the bodies, as simple forms.

Only one thread may call it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from urllib.parse import quote

import numpy as np
import viser
from msgspec.structs import replace
from numpy.typing import NDArray

from mindstage.stage import Marker, MarkerType
from mindstage.viewport.glb import merge_visuals
from mindstage.viewport.looks import BodyAppearance
from mindstage.world import BodyId, Vector
from mindstage.world.colors import srgb_to_linear
from mindstage.world.geometry import Array, normalize
from mindstage.world.meshes import TriangleMesh, arrow, box, cone, cylinder, sphere

__all__ = ["MarkerNodes"]

_MESHES: dict[MarkerType, Callable[[Vector], TriangleMesh]] = {
    MarkerType.CUBE: box,
    MarkerType.SPHERE: sphere,
    MarkerType.CYLINDER: cylinder,
    MarkerType.CONE: cone,
    MarkerType.ARROW: arrow,
}
_MIN_THICKNESS_M = 1e-3

MarkerNode = viser.MeshHandle | viser.LineSegmentsHandle | viser.PointCloudHandle | viser.LabelHandle


class MarkerNodes:
    """The markers that the visitors see."""

    def __init__(self, server: viser.ViserServer) -> None:
        """Shows none.

        Args:
            server: where the visitors come.
        """
        self._server = server
        self._markers: dict[str, Marker] = {}
        self._nodes: dict[str, MarkerNode] = {}
        self._appearances: Mapping[BodyId, BodyAppearance] = {}
        self._body_copies: dict[str, BodyAppearance | None] = {}
        """How the bodies looked of which ghosts are shown."""

    def show(self, markers: Iterable[Marker], appearances: Mapping[BodyId, BodyAppearance]) -> None:
        """Shows these and no others; what only moved is not drawn anew.

        Args:
            markers: which.
            looks: of the bodies, for their ghosts.
        """
        wanted = {marker.id: marker for marker in markers}
        self._appearances = appearances
        for id, marker in list(self._markers.items()):
            if marker.type is MarkerType.BODY_COPY and self._body_copy_appearance(marker) is not self._body_copies.get(
                id
            ):
                self._remove(id)
        with self._server.atomic():
            for id in self._markers.keys() - wanted.keys():
                self._remove(id)
            for id, marker in wanted.items():
                before = self._markers.get(id)
                if before == marker:
                    continue
                if before is None or replace(before, pose=marker.pose) != marker:
                    self._remove(id)
                    self._draw(marker)
                elif id in self._nodes:
                    self._nodes[id].position, self._nodes[id].wxyz = _pose_array(marker)
                self._markers[id] = marker

    def _remove(self, id: str) -> None:
        self._markers.pop(id, None)
        self._body_copies.pop(id, None)
        if (node := self._nodes.pop(id, None)) is not None:
            node.remove()

    def _draw(self, marker: Marker) -> None:
        """Draws what can be seen: a line of one point cannot, nor what is wholly transparent."""
        position, turn = _pose_array(marker)
        name, scene = f"/markers/{quote(marker.id, safe='')}", self._server.scene
        size = _clamped_size(marker.size)
        if marker.opacity <= 0.0:
            return
        if marker.type is MarkerType.TEXT:
            self._nodes[marker.id] = scene.add_label(name, marker.text, position=position, wxyz=turn)
        elif marker.type is MarkerType.POINTS and marker.points:
            points, colors = np.array(marker.points), _bytes(_colors(marker))
            self._nodes[marker.id] = scene.add_point_cloud(
                name,
                points,
                colors,
                point_size=size[0],
                point_shape="circle",
                precision="float32",  # half as many bits would round to centimetres ten meters away
                position=position,
                wxyz=turn,
            )
        elif marker.type in {MarkerType.LINE_STRIP, MarkerType.LINE_LIST} and len(marker.points) >= 2:
            ends = _segments(marker)
            points, colors = np.array(marker.points)[ends], _bytes(srgb_to_linear(_colors(marker)))[ends]
            self._nodes[marker.id] = scene.add_line_segments(
                name, points, colors, thickness=size[0], thickness_units="world", position=position, wxyz=turn
            )
        elif (mesh := self._mesh(marker, size)) is not None:
            self._nodes[marker.id] = scene.add_mesh_simple(
                name,
                mesh.points.astype(np.float32),
                mesh.faces,
                color=_bytes(np.array(marker.color)),
                opacity=marker.opacity if marker.opacity < 1.0 else None,
                cast_shadow=False,
                position=position,
                wxyz=turn,
            )

    def _mesh(self, marker: Marker, size: Vector) -> TriangleMesh | None:
        if marker.type is MarkerType.BODY_COPY:
            look = self._body_copies[marker.id] = self._body_copy_appearance(marker)
            return merge_visuals(look.visuals) if look is not None and look.visuals else None
        return _MESHES[marker.type](size) if marker.type in _MESHES else None

    def _body_copy_appearance(self, marker: Marker) -> BodyAppearance | None:
        return self._appearances.get(BodyId(marker.body))


def _pose_array(marker: Marker) -> tuple[Array, Array]:
    quaternion = np.array(marker.pose.quaternion)
    turn = normalize(quaternion) if quaternion.any() else np.array([1.0, 0.0, 0.0, 0.0])
    return np.array(marker.pose.position), turn


def _clamped_size(size: Vector) -> Vector:
    x, y, z = (max(abs(extent), _MIN_THICKNESS_M) for extent in size)
    return x, y, z


def _segments(marker: Marker) -> NDArray[np.intp]:
    """The two ends of each piece of a line, as rows of its points."""
    count = len(marker.points)
    starts = np.arange(count - 1) if marker.type is MarkerType.LINE_STRIP else np.arange(0, count - 1, 2)
    return np.stack([starts, starts + 1], axis=1)


def _colors(marker: Marker) -> Array:
    """One for each point."""
    count = len(marker.points)
    return np.array(marker.colors if len(marker.colors) == count else (marker.color,) * count)


def _bytes(colors: Array) -> NDArray[np.uint8]:
    return np.asarray(np.round(255 * np.clip(colors, 0.0, 1.0)), dtype=np.uint8)
