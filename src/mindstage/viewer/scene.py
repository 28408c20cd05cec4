"""Scene: what all visitors see, kept like the world with as few messages as possible.

Only one thread may call it.

Bodies: the nodes in the visitors' browsers that bodies are drawn with, kept like the world with few messages.

A body has a node of its own, which moves with little effort on both sides. Bodies that look alike and are many are a
crowd: one node for all, which is drawn at once and whose poses are sent together. Each of both has two guises: as it
is, a GLB with all its materials, and plain in one color, for what is lit and for what steps back behind it.

Only one thread may call it.

Lamps: the light that bodies give, as few lights as a browser draws with ease.

Only one thread may call it.

Markers: what programs want to be seen beside the bodies, as simple forms.

Only one thread may call it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Protocol, TypeVar
from urllib.parse import quote

import numpy as np
import viser
from msgspec.structs import replace
from numpy.typing import NDArray

from mindstage.scene import AttachedLight, BodyId, Color, Vector
from mindstage.scene.colors import srgb_to_linear
from mindstage.scene.mesh import TriangleMesh, arrow, box, box_edges, cone, cylinder, sphere
from mindstage.scene.transforms import Array, normalize, normalized_pose_array, pose_multiply
from mindstage.simulation import Marker, MarkerType
from mindstage.viewer.appearance import (
    BodyAppearance,
    Paint,
    VisiblePart,
    dimmed,
    highlighted,
    merge_visuals,
    visuals_to_glb,
)
from mindstage.viewer.camera import CameraPose, find_occluders

__all__ = [
    "BATCH_SIZE",
    "BodyNodes",
    "Clickable",
    "LightNodes",
    "MarkerNodes",
    "NodeCallback",
    "ViewerScene",
    "byte_color",
    "moved_rows",
]


BATCH_SIZE = 8
"""So many that look alike are drawn at once."""
_MAX_BATCH_SIZE = 128
"""One that moves in a crowd sends the poses of all that are in it."""
_OUTLINE_COLOR = (208, 212, 216)

Clickable = viser.MeshHandle | viser.GlbHandle | viser.BatchedMeshHandle | viser.BatchedGlbHandle

Node = TypeVar("Node", viser.BatchedGlbHandle, viser.BatchedMeshHandle)

Pick = Callable[[int | None], BodyId | None]
"""Which body of a node was meant, by the number that comes with a click."""


class NodeCallback(Protocol):
    """Called with each node that can be clicked, whenever it is drawn anew."""

    def __call__(self, node: Clickable, pick: Pick, *, holdable: bool) -> None:
        """Makes it answer."""


class _BodyNode(Protocol):
    """One body, or a crowd of them."""

    def set_poses(self, ids: Sequence[BodyId], rows: Array) -> None: ...
    def set_paints(self, paints: Mapping[BodyId, Paint | None]) -> None: ...
    def set_visible(self, ids: Iterable[BodyId], shown: bool) -> None: ...
    def remove(self, ids: Iterable[BodyId]) -> None: ...


class BodyNodes:
    """All that are there."""

    def __init__(self, scene: viser.SceneApi, *, on_node: NodeCallback) -> None:
        """None yet.

        Args:
            scene: where they are drawn.
            prepare: makes a node that was just drawn answer to the mouse.
        """
        self._scene, self._on_node = scene, on_node
        self._nodes: dict[BodyId, _BodyNode] = {}
        self._appearances: dict[BodyId, BodyAppearance] = {}
        self._holdable: dict[BodyId, bool] = {}
        self._paints: dict[BodyId, Paint] = {}
        self._hidden: frozenset[BodyId] = frozenset()
        self._batch_count = 0

    @property
    def appearances(self) -> Mapping[BodyId, BodyAppearance]:
        """Of those that are there."""
        return self._appearances

    def show(self, appearances: Mapping[BodyId, BodyAppearance], *, holdable: Container[BodyId]) -> None:
        """Draws what came or changed, and removes what went; the places of what is new are not known yet."""
        gone = [
            id
            for id, look in self._appearances.items()
            if appearances.get(id) != look or self._holdable[id] != (id in holdable)
        ]
        for drawn, ids in self._batches(gone).items():
            drawn.remove(ids)
        for id in gone:
            del self._nodes[id], self._appearances[id], self._holdable[id]
        new = [id for id in appearances if id not in self._appearances]
        counts = Counter(appearances[id].key for id in new if appearances[id].part is VisiblePart.WHOLE)
        crowds: dict[tuple[str, bool], list[BodyId]] = {}
        for id in new:
            look, held = appearances[id], id in holdable
            self._appearances[id], self._holdable[id] = look, held
            if counts[look.key] >= BATCH_SIZE:
                crowds.setdefault((look.key, held), []).append(id)
            else:
                self._nodes[id] = _SingleNode(self._scene, id, look, self._on_node, holdable=held)
        for (_, held), ids in crowds.items():
            for start in range(0, len(ids), _MAX_BATCH_SIZE):
                self._add_batch(ids[start : start + _MAX_BATCH_SIZE], held)
        self._restore_state(new)

    def set_poses(self, ids: Sequence[BodyId], rows: Array) -> None:
        """Puts bodies in their places.

        Args:
            ids: which; those that are not drawn are passed over.
            rows: n x 7, the quaternions of norm 1.
        """
        groups: dict[_BodyNode, list[int]] = {}
        for number, id in enumerate(ids):
            if (drawn := self._nodes.get(id)) is not None:
                groups.setdefault(drawn, []).append(number)
        for drawn, numbers in groups.items():
            drawn.set_poses([ids[number] for number in numbers], rows[numbers])

    def set_paints(self, paints: Mapping[BodyId, Paint | None]) -> None:
        """Draws bodies plain in one color, or as they are where it is None."""
        for id, paint in paints.items():
            if paint is None:
                self._paints.pop(id, None)
            else:
                self._paints[id] = paint
        for drawn, ids in self._batches(paints).items():
            drawn.set_paints({id: paints[id] for id in ids})

    def hide(self, hidden: frozenset[BodyId]) -> None:
        """Shows all bodies but these."""
        changed, self._hidden = self._hidden ^ hidden, hidden
        for drawn, ids in self._batches(changed).items():
            drawn.set_visible([id for id in ids if id in hidden], False)
            drawn.set_visible([id for id in ids if id not in hidden], True)

    def _restore_state(self, ids: Iterable[BodyId]) -> None:
        """What was drawn anew is lit or hidden as it was."""
        for drawn, group in self._batches(ids).items():
            if painted := {id: self._paints[id] for id in group if id in self._paints}:
                drawn.set_paints(painted)
            if hidden := [id for id in group if id in self._hidden]:
                drawn.set_visible(hidden, False)

    def _add_batch(self, ids: list[BodyId], held: bool) -> None:
        self._batch_count += 1
        look = self._appearances[ids[0]]
        crowd = _BatchNode(self._scene, f"/crowds/{self._batch_count}", ids, look, self._on_node, holdable=held)
        self._nodes.update(dict.fromkeys(ids, crowd))

    def _batches(self, ids: Iterable[BodyId]) -> dict[_BodyNode, list[BodyId]]:
        groups: dict[_BodyNode, list[BodyId]] = {}
        for id in ids:
            if (drawn := self._nodes.get(id)) is not None:
                groups.setdefault(drawn, []).append(id)
        return groups


class _SingleNode:
    """A body with a node of its own, below which its guises are."""

    def __init__(
        self, scene: viser.SceneApi, id: BodyId, appearance: BodyAppearance, prepare: NodeCallback, *, holdable: bool
    ) -> None:
        # A slash in an id would make it a part of another body.
        self._scene, self._name, self._appearance = scene, f"/bodies/{quote(id, safe='')}", appearance
        self._root = scene.add_frame(self._name, show_axes=False)
        self._turn = b""
        self._clickable = _is_clickable(appearance, holdable)
        self._prepare: Callable[[Clickable], None] = lambda node: prepare(node, lambda _: id, holdable=holdable)
        self._plain_node: viser.MeshHandle | None = None
        self._textured_node: viser.GlbHandle | None = None
        self._outline_node: viser.LineSegmentsHandle | None = None
        if appearance.part is VisiblePart.OUTLINE:
            self._outline_node = scene.add_line_segments(
                f"{self._name}/outline",
                box_edges(appearance.size),
                _OUTLINE_COLOR,
                thickness=1.0,
                thickness_units="screen",
            )
        else:
            self._textured_node = scene.add_glb(
                f"{self._name}/seen", _glb(appearance), cast_shadow=_casts_shadow(appearance)
            )
            if self._clickable:
                self._prepare(self._textured_node)

    def set_poses(self, ids: Sequence[BodyId], rows: Array) -> None:
        self._root.position = rows[0, :3]
        turn = rows[0, 3:].tobytes()
        if turn != self._turn:  # most things slide, and finding that out costs the page's library more than this
            self._root.wxyz, self._turn = rows[0, 3:], turn

    def set_paints(self, paints: Mapping[BodyId, Paint | None]) -> None:
        (paint,) = paints.values()
        if self._outline_node is not None:
            self._outline_node.colors = np.array(
                _OUTLINE_COLOR if paint is None else byte_color(paint.color), dtype=np.uint8
            )
            return
        if paint is not None:
            if self._plain_node is None:
                self._plain_node = self._draw_plain(paint)
            self._plain_node.color, self._plain_node.opacity = byte_color(paint.color), _opacity(paint)
            self._plain_node.visible = True
        elif self._plain_node is not None:
            self._plain_node.visible = False
        assert self._textured_node is not None
        self._textured_node.visible = paint is None

    def set_visible(self, ids: Iterable[BodyId], shown: bool) -> None:
        for _ in ids:
            self._root.visible = shown

    def remove(self, ids: Iterable[BodyId]) -> None:
        self._root.remove()

    def _draw_plain(self, paint: Paint) -> viser.MeshHandle:
        mesh = _mesh(self._appearance)
        node = self._scene.add_mesh_simple(
            f"{self._name}/plain",
            mesh.points.astype(np.float32),
            mesh.faces,
            color=byte_color(paint.color),
            opacity=_opacity(paint),
            cast_shadow=_casts_shadow(self._appearance),
        )
        if self._clickable:
            self._prepare(node)
        return node


class _BatchNode:
    """Bodies that look alike: a node for those as they are, and one for those in a color."""

    def __init__(
        self,
        scene: viser.SceneApi,
        name: str,
        ids: Sequence[BodyId],
        appearance: BodyAppearance,
        prepare: NodeCallback,
        *,
        holdable: bool,
    ) -> None:
        self._scene, self._name, self._appearance, self._prepare = scene, name, appearance, prepare
        self._holdable, self._clickable = holdable, _is_clickable(appearance, holdable)
        self._rows: dict[BodyId, Array] = {id: np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]) for id in ids}
        self._paints: dict[BodyId, Paint] = {}
        self._hidden: set[BodyId] = set()
        self._textured_node: viser.BatchedGlbHandle | None = None
        self._plain_node: viser.BatchedMeshHandle | None = None
        self._members: tuple[BodyId, ...] = ()
        self._painted_members: tuple[BodyId, ...] = ()
        self._root = scene.add_frame(name, show_axes=False)
        self._assign_members()

    def set_poses(self, ids: Sequence[BodyId], rows: Array) -> None:
        self._rows.update(zip(ids, rows, strict=True))
        moved = set(ids)
        for node, members in ((self._textured_node, self._members), (self._plain_node, self._painted_members)):
            if node is not None and not moved.isdisjoint(members):
                self._send_poses(node, members)

    def set_paints(self, paints: Mapping[BodyId, Paint | None]) -> None:
        for id, paint in paints.items():
            if paint is None:
                self._paints.pop(id, None)
            else:
                self._paints[id] = paint
        self._assign_members()

    def set_visible(self, ids: Iterable[BodyId], shown: bool) -> None:
        changed = set(ids)
        if changed:
            self._hidden = self._hidden - changed if shown else self._hidden | changed
            self._assign_members()

    def remove(self, ids: Iterable[BodyId]) -> None:
        for id in ids:
            del self._rows[id]
            self._paints.pop(id, None)
            self._hidden.discard(id)
        if self._rows:
            self._assign_members()
        else:
            self._root.remove()

    def _assign_members(self) -> None:
        """Shares the bodies out between the two nodes."""
        shown = [id for id in self._rows if id not in self._hidden]
        members = tuple(id for id in shown if id not in self._paints)
        painted = tuple(id for id in shown if id in self._paints)
        if members != self._members:
            self._members = members
            self._textured_node = self._node_for(self._textured_node, members, self._draw)
        if painted != self._painted_members:
            self._painted_members = painted
            self._plain_node = self._node_for(self._plain_node, painted, self._draw_plain)
        if self._plain_node is not None and painted:
            self._plain_node.batched_colors, self._plain_node.batched_opacities = self._colors()

    def _node_for(self, node: Node | None, members: tuple[BodyId, ...], draw: Callable[[], Node]) -> Node | None:
        """The node that holds these bodies now; one that holds none cannot be drawn, but is kept."""
        if members and node is None:
            return draw()
        if node is not None:
            node.visible = bool(members)
            if members:
                self._send_poses(node, members)
        return node

    def _draw(self) -> viser.BatchedGlbHandle:
        positions, turns = self._member_poses(self._members)
        node = self._scene.add_batched_glb(
            f"{self._name}/seen", _glb(self._appearance), turns, positions, cast_shadow=_casts_shadow(self._appearance)
        )
        if self._clickable:
            self._prepare(node, lambda instance: _body_at(self._members, instance), holdable=self._holdable)
        return node

    def _draw_plain(self) -> viser.BatchedMeshHandle:
        mesh = _mesh(self._appearance)
        positions, turns = self._member_poses(self._painted_members)
        colors, opacities = self._colors()
        node = self._scene.add_batched_meshes_simple(
            f"{self._name}/plain",
            mesh.points.astype(np.float32),
            mesh.faces,
            turns,
            positions,
            batched_colors=colors,
            batched_opacities=opacities,
            opacity=1.0,  # else none could be seen through
            cast_shadow=False,
        )
        if self._clickable:
            self._prepare(node, lambda instance: _body_at(self._painted_members, instance), holdable=self._holdable)
        return node

    def _send_poses(self, node: viser.BatchedGlbHandle | viser.BatchedMeshHandle, members: tuple[BodyId, ...]) -> None:
        node.batched_positions, node.batched_wxyzs = self._member_poses(members)

    def _member_poses(self, members: Iterable[BodyId]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        rows = np.array([self._rows[id] for id in members], dtype=np.float32).reshape(-1, 7)
        return np.ascontiguousarray(rows[:, :3]), np.ascontiguousarray(rows[:, 3:])

    def _colors(self) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        paints = [self._paints[id] for id in self._painted_members]
        colors = srgb_to_linear(np.array([paint.color for paint in paints]).reshape(-1, 3))
        return np.round(255 * colors).astype(np.uint8), np.array([paint.opacity for paint in paints], np.float32)


def _body_at(ids: tuple[BodyId, ...], number: int | None) -> BodyId | None:
    # A click may come from a page that has not heard yet of who went.
    return ids[number] if number is not None and number < len(ids) else None


def byte_color(color: Color) -> tuple[int, int, int]:
    """As the page takes most colors."""
    red, green, blue = (round(255 * min(max(part, 0.0), 1.0)) for part in color)
    return red, green, blue


def _is_clickable(appearance: BodyAppearance, holdable: bool) -> bool:
    """Whether a body answers to the mouse.

    A floor that does would be outlined whenever somebody looks round, and what is drawn from one side only would catch
    the mouse from the other.
    """
    return appearance.part is VisiblePart.WHOLE and (holdable or not appearance.is_building)


def _casts_shadow(appearance: BodyAppearance) -> bool:
    return appearance.part is VisiblePart.WHOLE and appearance.is_opaque


def _opacity(paint: Paint) -> float | None:
    return paint.opacity if paint.opacity < 1.0 else None


@lru_cache(maxsize=4096)
def _glb(appearance: BodyAppearance) -> bytes:
    return visuals_to_glb(appearance.visuals)


@lru_cache(maxsize=4096)
def _mesh(appearance: BodyAppearance) -> TriangleMesh:
    return merge_visuals(appearance.visuals)


_MAX_LIGHTS = 3
"""So many lights at most: each makes the drawing of everything slower."""
_TOTAL_INTENSITY = 4.0
"""How bright all of them are [cd]: the sky lights the place already, and no picture shall be too bright."""
_LIGHT_RANGE_M = 6.0


class LightNodes:
    """The lights of all bodies that give some; the brightest, where there are many."""

    def __init__(self, scene: viser.SceneApi) -> None:
        """None yet.

        Args:
            scene: where they are.
        """
        self._scene = scene
        self._attached_lights: dict[BodyId, AttachedLight] = {}
        self._lights: dict[BodyId, viser.PointLightHandle] = {}

    def show(self, appearances: Mapping[BodyId, BodyAppearance]) -> None:
        """Lights the lamps among these bodies, and no others."""
        glows = [(glow.intensity, id, glow) for id, look in appearances.items() for glow in look.lights[:1]]
        wanted = {id: glow for _, id, glow in sorted(glows, key=lambda each: -each[0])[:_MAX_LIGHTS]}
        if wanted == self._attached_lights:
            return
        for light in self._lights.values():
            light.remove()
        self._attached_lights = wanted
        together = sum(glow.intensity for glow in wanted.values())
        self._lights = {
            id: self._add_light(id, glow, _TOTAL_INTENSITY * glow.intensity / max(together, 1e-9))
            for id, glow in wanted.items()
        }

    def set_poses(self, ids: Sequence[BodyId], rows: Array) -> None:
        """Moves the lights of the bodies that moved.

        Args:
            ids: which.
            rows: n x 7.
        """
        for id, row in zip(ids, rows, strict=True):
            if (light := self._lights.get(id)) is not None:
                light.position = pose_multiply(row, normalized_pose_array(self._attached_lights[id].pose))[:3]

    def _add_light(self, id: BodyId, attached_light: AttachedLight, intensity: float) -> viser.PointLightHandle:
        red, green, blue = np.round(255 * np.clip(attached_light.color, 0.0, 1.0)).astype(int).tolist()
        return self._scene.add_light_point(
            f"/lamps/{quote(id, safe='')}",
            color=(red, green, blue),
            intensity=intensity,
            distance=_LIGHT_RANGE_M,
            decay=2.0,
        )


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


_TRANSPARENT_OPACITY = 0.32
"""The opacity of what one sees through, where it is drawn in one color."""
_POSE_TOLERANCE = 5e-5
"""What moves by less than this [m, or in a quaternion's numbers] since it was last sent is not sent again."""
_SKY_COLORS = ((247, 248, 249), (222, 226, 230))
"""The background, from the upper to the lower edge."""


def moved_rows(sent: Array, now: Array) -> NDArray[np.intp]:
    """The rows whose pose is no longer the one that was sent."""
    return np.flatnonzero(np.any(np.abs(now - sent) > _POSE_TOLERANCE, axis=1))


class ViewerScene:
    """What the visitors see."""

    def __init__(self, server: viser.ViserServer, *, on_node: NodeCallback) -> None:
        """Lights an empty place.

        Args:
            server: where the visitors come.
            prepare: makes what was just drawn answer to the mouse.
        """
        self._server = server
        self._bodies = BodyNodes(server.scene, on_node=on_node)
        self._lights = LightNodes(server.scene)
        self._highlights: dict[BodyId, Color] = {}
        self._occluders: frozenset[BodyId] = frozenset()
        self._eye: Array | None = None
        self._hidden: frozenset[BodyId] = frozenset()
        self._enclosures_shown = True
        self._ids: tuple[BodyId, ...] = ()
        self._sent_poses: Array = np.zeros((0, 7))
        self._sun = _add_daylight(server.scene)

    @property
    def appearances(self) -> Mapping[BodyId, BodyAppearance]:
        """Of all bodies that are there."""
        return self._bodies.appearances

    @property
    def ids(self) -> tuple[BodyId, ...]:
        """Whose poses were shown last; the same object until others are shown."""
        return self._ids

    # -- bodies ----------------------------------------------------------------------------------------------

    def show(
        self,
        appearances: Mapping[BodyId, BodyAppearance],
        ids: tuple[BodyId, ...],
        poses: Array,
        *,
        holdable: Container[BodyId],
    ) -> None:
        """Draws bodies that came or changed, removes those that went, and puts all in their places.

        Args:
            looks: of all bodies.
            ids: whose poses follow.
            poses: n x 7.
            holdable: which of them can be pulled.
        """
        with self._server.atomic():
            self._bodies.show(appearances, holdable=holdable)
            self._lights.show(appearances)
            self._ids, self._sent_poses = ids, poses.copy()
            self._send_poses(np.arange(len(ids)))
            self._hide()
            self._repaint()

    def move(self, poses: Array) -> NDArray[np.intp]:
        """Sends the poses that changed, in the order of the ids last shown; gives their rows."""
        rows = moved_rows(self._sent_poses, poses)
        if len(rows):
            self._sent_poses[rows] = poses[rows]
            with self._server.atomic():
                self._send_poses(rows)
        return rows

    def set_highlights(self, highlights: Mapping[BodyId, Color]) -> None:
        """Paints lit bodies in their highlight, and all others as they are; dimmed while anything is lit."""
        dims = bool(highlights) != bool(self._highlights)
        before, veils_before, self._highlights = self._highlights, self._occluders, dict(highlights)
        self._update_occluders()
        other = self._occluders ^ veils_before
        changed = [id for id in self.appearances if dims or id in other or highlights.get(id) != before.get(id)]
        with self._server.atomic():
            self._bodies.set_paints({id: self._paint_for(id, self.appearances[id]) for id in changed})

    def hide(self, hidden: frozenset[BodyId]) -> None:
        """Shows all bodies but these."""
        if hidden != self._hidden:
            self._hidden = hidden
            with self._server.atomic():
                self._hide()

    def show_enclosures(self, shown: bool) -> None:
        """Draws the outlines of what encloses the place, or not."""
        if shown != self._enclosures_shown:
            self._enclosures_shown = shown
            with self._server.atomic():
                self._hide()

    # -- the place -------------------------------------------------------------------------------------------

    def set_initial_camera(self, camera_pose: CameraPose) -> None:
        """Where the camera of a visitor is who comes, until the shape of the window is known; the sun stands beside."""
        camera = self._server.initial_camera
        camera.position, camera.look_at, camera.fov = (
            camera_pose.position,
            camera_pose.look_at,
            camera_pose.field_of_view_rad,
        )
        self._eye = np.array(camera_pose.position)
        self._sun.position = _sun_direction(np.subtract(camera_pose.position, camera_pose.look_at))

    def set_ground(self, height: float | None) -> None:
        """A grid to stand on, at a height [m]; None takes it away, for a place with a floor."""
        grid = self._server.scene.get_handle_by_name("/ground")
        if grid is not None:
            grid.remove()
        if height is not None:
            self._server.scene.add_grid(
                "/ground",
                infinite_grid=True,
                position=(0.0, 0.0, height),
                cell_size=0.5,
                cell_color=(214, 217, 220),
                section_color=(196, 200, 204),
                fade_distance=30.0,
                shadow_opacity=0.18,
            )

    # -- how -------------------------------------------------------------------------------------------------

    def _hide(self) -> None:
        outlines = {id for id, look in self.appearances.items() if look.part is VisiblePart.OUTLINE}
        self._bodies.hide(self._hidden | (frozenset() if self._enclosures_shown else outlines))

    def _repaint(self) -> None:
        if self._highlights:
            self._update_occluders()
            self._bodies.set_paints({id: self._paint_for(id, look) for id, look in self.appearances.items()})

    def _update_occluders(self) -> None:
        """Where visitors stand first, they see what is lit, whatever it is in or behind."""
        ids = [(row, id) for row, id in enumerate(self._ids) if id in self.appearances]
        lit = np.array([at for at, (_, id) in enumerate(ids) if id in self._highlights], dtype=np.intp)
        if self._eye is None or not len(lit):
            self._occluders = frozenset()
            return
        poses = self._sent_poses[[row for row, _ in ids]]
        sizes = np.array([self.appearances[id].size for _, id in ids])
        self._occluders = frozenset(ids[at][1] for at in find_occluders(self._eye, poses, sizes, lit).tolist())

    def _paint_for(self, id: BodyId, appearance: BodyAppearance) -> Paint | None:
        if not self._highlights:
            return None
        paint = Paint(appearance.color, 1.0 if appearance.is_opaque else _TRANSPARENT_OPACITY)
        if appearance.part is VisiblePart.OUTLINE and id not in self._highlights:
            return None
        return (
            highlighted(paint, self._highlights[id])
            if id in self._highlights
            else dimmed(paint, as_occluder=id in self._occluders)
        )

    def _send_poses(self, rows: NDArray[np.intp]) -> None:
        placed = self._sent_poses[rows]
        placed[:, 3:] = normalize(placed[:, 3:])
        ids = [self._ids[row] for row in rows.tolist()]
        self._bodies.set_poses(ids, placed)
        self._lights.set_poses(ids, placed)


def _add_daylight(scene: viser.SceneApi) -> viser.DirectionalLightHandle:
    """Daylight from a window behind the visitor's shoulder, a little from everywhere else, and a quiet background."""
    scene.configure_default_lights(enabled=False)
    # Surroundings to be mirrored make each picture thirty times slower where there is no GPU.
    scene.configure_environment_map(None)
    scene.add_light_hemisphere("/sky", sky_color=(255, 255, 255), ground_color=(214, 204, 190), intensity=2.2)
    scene.world_axes.visible = False
    rows = np.linspace(*_SKY_COLORS, 512).astype(np.uint8)
    scene.set_background_image(np.repeat(rows[:, None, :], 2, axis=1), format="png")
    return scene.add_light_directional(
        "/sun",
        color=(255, 246, 232),
        intensity=2.3,
        cast_shadow=True,
        position=_sun_direction(np.array([1.0, -1.0, 1.0])),
    )


def _sun_direction(view_direction: Array) -> Vector:
    """Where the sun stands for an eye in that direction from the middle."""
    azimuth = float(np.arctan2(view_direction[1], view_direction[0])) + np.radians(18.0)
    return 6.0 * float(np.cos(azimuth)), 6.0 * float(np.sin(azimuth)), 11.0
