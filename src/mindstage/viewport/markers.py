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

from mindstage.stage import Marker, MarkerForm
from mindstage.viewport.glb import mesh_of
from mindstage.viewport.looks import Look
from mindstage.world import BodyId, Vector
from mindstage.world.colours import linear
from mindstage.world.geometry import Array, unit
from mindstage.world.meshes import TriangleMesh, arrow, box, cone, cylinder, sphere

__all__ = ["MarkerScene"]

_MESHES: dict[MarkerForm, Callable[[Vector], TriangleMesh]] = {
    MarkerForm.CUBE: box,
    MarkerForm.SPHERE: sphere,
    MarkerForm.CYLINDER: cylinder,
    MarkerForm.CONE: cone,
    MarkerForm.ARROW: arrow,
}
_THINNEST_M = 1e-3

Node = viser.MeshHandle | viser.LineSegmentsHandle | viser.PointCloudHandle | viser.LabelHandle


class MarkerScene:
    """The markers that the visitors see."""

    def __init__(self, server: viser.ViserServer) -> None:
        """Shows none.

        Args:
            server: where the visitors come.
        """
        self._server = server
        self._shown: dict[str, Marker] = {}
        self._nodes: dict[str, Node] = {}
        self._looks: Mapping[BodyId, Look] = {}
        self._ghosts: dict[str, Look | None] = {}
        """How the bodies looked of which ghosts are shown."""

    def show(self, markers: Iterable[Marker], looks: Mapping[BodyId, Look]) -> None:
        """Shows these and no others; what only moved is not drawn anew.

        Args:
            markers: which.
            looks: of the bodies, for their ghosts.
        """
        wanted = {marker.id: marker for marker in markers}
        self._looks = looks
        for id, marker in list(self._shown.items()):
            if marker.form is MarkerForm.GHOST and self._look_of(marker) is not self._ghosts.get(id):
                self._remove(id)
        with self._server.atomic():
            for id in self._shown.keys() - wanted.keys():
                self._remove(id)
            for id, marker in wanted.items():
                before = self._shown.get(id)
                if before == marker:
                    continue
                if before is None or replace(before, pose=marker.pose) != marker:
                    self._remove(id)
                    self._draw(marker)
                elif id in self._nodes:
                    self._nodes[id].position, self._nodes[id].wxyz = _place(marker)
                self._shown[id] = marker

    def _remove(self, id: str) -> None:
        self._shown.pop(id, None)
        self._ghosts.pop(id, None)
        if (node := self._nodes.pop(id, None)) is not None:
            node.remove()

    def _draw(self, marker: Marker) -> None:
        """Draws what can be seen: a line of one point cannot, nor what is wholly transparent."""
        position, turn = _place(marker)
        name, scene = f"/markers/{quote(marker.id, safe='')}", self._server.scene
        size = _at_least(marker.size)
        if marker.opacity <= 0.0:
            return
        if marker.form is MarkerForm.TEXT:
            self._nodes[marker.id] = scene.add_label(name, marker.text, position=position, wxyz=turn)
        elif marker.form is MarkerForm.POINTS and marker.points:
            points, colours = np.array(marker.points), _bytes(_colours(marker))
            self._nodes[marker.id] = scene.add_point_cloud(
                name,
                points,
                colours,
                point_size=size[0],
                point_shape="circle",
                precision="float32",  # half as many bits would round to centimetres ten metres away
                position=position,
                wxyz=turn,
            )
        elif marker.form in {MarkerForm.LINE, MarkerForm.LINES} and len(marker.points) >= 2:
            ends = _segments(marker)
            points, colours = np.array(marker.points)[ends], _bytes(linear(_colours(marker)))[ends]
            self._nodes[marker.id] = scene.add_line_segments(
                name, points, colours, thickness=size[0], thickness_units="world", position=position, wxyz=turn
            )
        elif (mesh := self._mesh(marker, size)) is not None:
            self._nodes[marker.id] = scene.add_mesh_simple(
                name,
                mesh.points.astype(np.float32),
                mesh.faces,
                color=_bytes(np.array(marker.colour)),
                opacity=marker.opacity if marker.opacity < 1.0 else None,
                cast_shadow=False,
                position=position,
                wxyz=turn,
            )

    def _mesh(self, marker: Marker, size: Vector) -> TriangleMesh | None:
        if marker.form is MarkerForm.GHOST:
            look = self._ghosts[marker.id] = self._look_of(marker)
            return mesh_of(look.skins) if look is not None and look.skins else None
        return _MESHES[marker.form](size) if marker.form in _MESHES else None

    def _look_of(self, marker: Marker) -> Look | None:
        return self._looks.get(BodyId(marker.body))


def _place(marker: Marker) -> tuple[Array, Array]:
    quaternion = np.array(marker.pose.quaternion)
    turn = unit(quaternion) if quaternion.any() else np.array([1.0, 0.0, 0.0, 0.0])
    return np.array(marker.pose.position), turn


def _at_least(size: Vector) -> Vector:
    x, y, z = (max(abs(extent), _THINNEST_M) for extent in size)
    return x, y, z


def _segments(marker: Marker) -> NDArray[np.intp]:
    """The two ends of each piece of a line, as rows of its points."""
    count = len(marker.points)
    starts = np.arange(count - 1) if marker.form is MarkerForm.LINE else np.arange(0, count - 1, 2)
    return np.stack([starts, starts + 1], axis=1)


def _colours(marker: Marker) -> Array:
    """One for each point."""
    count = len(marker.points)
    return np.array(marker.colours if len(marker.colours) == count else (marker.colour,) * count)


def _bytes(colours: Array) -> NDArray[np.uint8]:
    return np.asarray(np.round(255 * np.clip(colours, 0.0, 1.0)), dtype=np.uint8)
