"""The 3D scene that all clients share: nodes for bodies, lights and markers, updated with few messages.

A body has a node of its own; many bodies of equal appearance share a batch, one instanced node whose poses are sent
together. Each node has two variants: a textured GLB with all materials, and a plain mesh in one color for highlighted
and dimmed bodies. Only one thread may call into this module.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Container, Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Literal, Protocol, TypeVar
from urllib.parse import quote

import numpy as np
import viser
from msgspec.structs import replace
from numpy.typing import NDArray

from mindstage.rendering.appearance import (
    BodyAppearance,
    Paint,
    VisiblePart,
    cached_visuals_to_glb,
    dimmed,
    highlighted,
    merge_visuals,
)
from mindstage.rendering.camera import CameraPose, corners, find_occluders
from mindstage.scene import AttachedLight, BodyId, Color, Vector
from mindstage.scene.colors import srgb_to_linear
from mindstage.scene.mesh import TriangleMesh, arrow, box, box_edges, cone, cylinder, sphere
from mindstage.scene.transforms import Array, normalize, normalized_pose_array, pose_multiply
from mindstage.simulation import Marker, MarkerType
from mindstage.textures.images import TextureUri
from mindstage.viewer.view_data import FirstData, PoseBlocks, send_view_data

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
"""Number of bodies of equal appearance from which on they share a batch."""
_MAX_BATCH_SIZE = 128
"""Maximum number of bodies in a batch: when one of them moves, the poses of all are sent."""
_OUTLINE_COLOR = (208, 212, 216)

Clickable = viser.MeshHandle | viser.GlbHandle | viser.BatchedMeshHandle | viser.BatchedGlbHandle

Node = TypeVar("Node", viser.BatchedGlbHandle, viser.BatchedMeshHandle)

_LevelOfDetail = Literal["auto", "off"]

Pick = Callable[[int | None], BodyId | None]
"""Returns the body of a node by the instance index of a mouse event."""


class NodeCallback(Protocol):
    """Called with each clickable node when it is created."""

    def __call__(self, node: Clickable, pick: Pick, *, draggable: bool) -> None:
        """Registers mouse callbacks.

        Args:
            pick: returns the body of a mouse event.
            draggable: whether its bodies can be dragged.
        """


class _BodyNode(Protocol):
    """The node of one body, or of a batch of bodies."""

    name: str

    def set_poses(self, ids: Sequence[BodyId], rows: Array) -> None: ...
    def set_paints(self, paints: Mapping[BodyId, Paint | None]) -> None: ...
    def set_visible(self, ids: Iterable[BodyId], shown: bool) -> None: ...
    def instances(self, ids: Collection[BodyId]) -> Mapping[str, list[int]]: ...
    def remove(self, ids: Iterable[BodyId]) -> None: ...


class BodyNodes:
    """The nodes of all bodies."""

    def __init__(
        self,
        scene: viser.SceneApi,
        *,
        on_node: NodeCallback,
        parent: str = "",
        texture_uri: TextureUri | None = None,
        has_scripts: bool = True,
    ) -> None:
        """Creates no nodes yet.

        Args:
            scene: the scene of the server.
            on_node: called with each clickable node when it is created.
            parent: the name of the node whose frame poses are relative to, such as "/beside"; by default the world.
            texture_uri: where pages find the images of textures; None to draw plain colors.
            has_scripts: whether the page has the scripts of Mindstage, which set the poses of many nodes at once.
        """
        self._scene, self._on_node, self._parent = scene, on_node, parent
        self._texture_uri = texture_uri
        self._blocks = PoseBlocks(scene, topic=f"poses{parent}") if has_scripts else None
        self._rows: dict[BodyId, int] = {}
        """The rows in the blocks, of bodies with a node of their own."""
        self._nodes: dict[BodyId, _BodyNode] = {}
        self._appearances: dict[BodyId, BodyAppearance] = {}
        self._is_draggable: dict[BodyId, bool] = {}
        self._paints: dict[BodyId, Paint] = {}
        self._hidden: frozenset[BodyId] = frozenset()
        self._batch_count = 0

    @property
    def appearances(self) -> Mapping[BodyId, BodyAppearance]:
        """The appearances of the bodies that have nodes."""
        return self._appearances

    def show(self, appearances: Mapping[BodyId, BodyAppearance], *, draggable: Container[BodyId]) -> None:
        """Creates nodes of new and changed bodies, and removes those of others; new nodes have no poses yet."""
        removed = [
            id
            for id, appearance in self._appearances.items()
            if appearances.get(id) != appearance or self._is_draggable[id] != (id in draggable)
        ]
        for node, ids in self._by_node(removed).items():
            node.remove(ids)
        for id in removed:
            del self._nodes[id], self._appearances[id], self._is_draggable[id]
        if self._blocks is not None:
            self._blocks.remove([self._rows.pop(id) for id in removed if id in self._rows])
        new = [id for id in appearances if id not in self._appearances]
        counts = Counter(appearances[id].key for id in new if appearances[id].part is VisiblePart.WHOLE)
        groups: dict[tuple[str, bool], list[BodyId]] = {}
        for id in new:
            appearance, is_draggable = appearances[id], id in draggable
            self._appearances[id], self._is_draggable[id] = appearance, is_draggable
            is_batched = counts[appearance.key] >= BATCH_SIZE
            groups.setdefault((appearance.key if is_batched else f"of {id}", is_draggable), []).append(id)
        # A slow page shows first what is large.
        for ids in sorted(groups.values(), key=lambda ids: -len(ids) * _visible_area(appearances[ids[0]])):
            is_draggable = self._is_draggable[ids[0]]
            if counts[appearances[ids[0]].key] < BATCH_SIZE:
                self._add_single(ids[0], is_draggable)
                continue
            for start in range(0, len(ids), _MAX_BATCH_SIZE):
                self._add_batch(ids[start : start + _MAX_BATCH_SIZE], is_draggable)
        self._restore_state(new)

    def set_poses(self, ids: Sequence[BodyId], rows: Array) -> None:
        """Sets the poses of bodies.

        Args:
            ids: the bodies; those without nodes are skipped.
            rows: poses with unit quaternions, n x 7.
        """
        own = np.array([self._rows.get(id, -1) for id in ids], dtype=np.intp)
        has_own = own >= 0
        if self._blocks is not None and has_own.any():
            self._blocks.set_poses(own[has_own], rows[has_own])
        groups: dict[_BodyNode, list[int]] = {}
        for row in np.flatnonzero(~has_own).tolist():
            if (node := self._nodes.get(ids[row])) is not None:
                groups.setdefault(node, []).append(row)
        for node, numbers in groups.items():
            node.set_poses([ids[number] for number in numbers], rows[numbers])

    def set_paints(self, paints: Mapping[BodyId, Paint | None]) -> None:
        """Draws bodies in one color, or textured if it is None."""
        for id, paint in paints.items():
            if paint is None:
                self._paints.pop(id, None)
            else:
                self._paints[id] = paint
        for node, ids in self._by_node(paints).items():
            node.set_paints({id: paints[id] for id in ids})

    def hide(self, hidden: frozenset[BodyId]) -> None:
        """Hides these bodies, and shows all others."""
        changed, self._hidden = self._hidden ^ hidden, hidden
        for node, ids in self._by_node(changed).items():
            node.set_visible([id for id in ids if id in hidden], False)
            node.set_visible([id for id in ids if id not in hidden], True)

    def instances(self, ids: Iterable[BodyId]) -> dict[str, list[int]]:
        """The names of the nodes that draw bodies; of a node with instances, which of them, otherwise none."""
        found: dict[str, list[int]] = {}
        for node, group in self._by_node(ids).items():
            found.update(node.instances(group))
        return found

    def _restore_state(self, ids: Iterable[BodyId]) -> None:
        """Applies paints and visibility to new nodes."""
        for node, group in self._by_node(ids).items():
            if painted := {id: self._paints[id] for id in group if id in self._paints}:
                node.set_paints(painted)
            if hidden := [id for id in group if id in self._hidden]:
                node.set_visible(hidden, False)

    def node_name(self, id: BodyId) -> str:
        """The name of the node of a body, or of its batch."""
        return self._nodes[id].name

    def _add_single(self, id: BodyId, draggable: bool) -> None:
        name = f"{self._parent}/bodies/{quote(id, safe='')}"  # a slash would make it a child of another one
        appearance = self._appearances[id]
        glb = _glb(appearance, self._texture_uri)
        self._nodes[id] = _SingleNode(self._scene, name, id, appearance, glb, self._on_node, draggable=draggable)
        if self._blocks is not None:
            self._rows[id] = self._blocks.add(name)

    def _add_batch(self, ids: list[BodyId], draggable: bool) -> None:
        self._batch_count += 1
        name, appearance = f"{self._parent}/batches/{self._batch_count}", self._appearances[ids[0]]
        glb = _glb(appearance, self._texture_uri)
        # With the scripts, levelsOfDetail.js has coarser meshes than viser.
        lod: _LevelOfDetail = "auto" if self._blocks is None else "off"
        batch = _BatchNode(self._scene, name, ids, appearance, glb, self._on_node, draggable=draggable, lod=lod)
        self._nodes.update(dict.fromkeys(ids, batch))

    def _by_node(self, ids: Iterable[BodyId]) -> dict[_BodyNode, list[BodyId]]:
        groups: dict[_BodyNode, list[BodyId]] = {}
        for id in ids:
            if (node := self._nodes.get(id)) is not None:
                groups.setdefault(node, []).append(id)
        return groups


class _SingleNode:
    """The node of a single body; its variants are child nodes."""

    def __init__(
        self,
        scene: viser.SceneApi,
        name: str,
        id: BodyId,
        appearance: BodyAppearance,
        glb: bytes,
        on_node: NodeCallback,
        *,
        draggable: bool,
    ) -> None:
        self._scene, self.name, self._appearance = scene, name, appearance
        self._root = scene.add_frame(self.name, show_axes=False)
        self._sent_wxyz = b""
        self._clickable = _is_clickable(appearance, draggable)
        self._on_node: Callable[[Clickable], None] = lambda node: on_node(node, lambda _: id, draggable=draggable)
        self._plain_node: viser.MeshHandle | None = None
        self._textured_node: viser.GlbHandle | None = None
        self._outline_node: viser.LineSegmentsHandle | None = None
        if appearance.part is VisiblePart.OUTLINE:
            self._outline_node = scene.add_line_segments(
                f"{self.name}/outline",
                box_edges(appearance.size),
                _OUTLINE_COLOR,
                thickness=1.0,
                thickness_units="screen",
            )
        else:
            self._textured_node = scene.add_glb(f"{self.name}/textured", glb, cast_shadow=_casts_shadow(appearance))
            if self._clickable:
                self._on_node(self._textured_node)

    def set_poses(self, ids: Sequence[BodyId], rows: Array) -> None:
        self._root.position = rows[0, :3]
        wxyz = rows[0, 3:].tobytes()
        if wxyz != self._sent_wxyz:  # most bodies slide, and this comparison is cheaper than that of viser
            self._root.wxyz, self._sent_wxyz = rows[0, 3:], wxyz

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

    def instances(self, ids: Collection[BodyId]) -> Mapping[str, list[int]]:
        return {self.name: []}

    def remove(self, ids: Iterable[BodyId]) -> None:
        self._root.remove()

    def _draw_plain(self, paint: Paint) -> viser.MeshHandle:
        mesh = _mesh(self._appearance)
        node = self._scene.add_mesh_simple(
            f"{self.name}/plain",
            mesh.points.astype(np.float32),
            mesh.faces,
            color=byte_color(paint.color),
            opacity=_opacity(paint),
            cast_shadow=_casts_shadow(self._appearance),
        )
        if self._clickable:
            self._on_node(node)
        return node


class _BatchNode:
    """A batch of bodies of equal appearance: an instanced node for textured ones, and one for plain ones."""

    def __init__(
        self,
        scene: viser.SceneApi,
        name: str,
        ids: Sequence[BodyId],
        appearance: BodyAppearance,
        glb: bytes,
        on_node: NodeCallback,
        *,
        draggable: bool,
        lod: _LevelOfDetail,
    ) -> None:
        self._scene, self.name, self._appearance, self._glb, self._on_node = scene, name, appearance, glb, on_node
        self._lod: _LevelOfDetail = lod
        self._draggable, self._clickable = draggable, _is_clickable(appearance, draggable)
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

    def instances(self, ids: Collection[BodyId]) -> Mapping[str, list[int]]:
        wanted, found = set(ids), {}
        for variant, members in (("textured", self._members), ("plain", self._painted_members)):
            if rows := [row for row, id in enumerate(members) if id in wanted]:
                found[f"{self.name}/{variant}"] = rows
        return found

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
        """Distributes the bodies to the two nodes."""
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
        """Updates or creates the node of some members; an instanced node cannot be empty, so it is hidden instead."""
        if members and node is None:
            return draw()
        if node is not None:
            node.visible = bool(members)
            if members:
                self._send_poses(node, members)
        return node

    def _draw(self) -> viser.BatchedGlbHandle:
        positions, quaternions = self._member_poses(self._members)
        node = self._scene.add_batched_glb(
            f"{self.name}/textured",
            self._glb,
            quaternions,
            positions,
            lod=self._lod,
            cast_shadow=_casts_shadow(self._appearance),
        )
        if self._clickable:
            self._on_node(node, lambda instance: _body_at(self._members, instance), draggable=self._draggable)
        return node

    def _draw_plain(self) -> viser.BatchedMeshHandle:
        mesh = _mesh(self._appearance)
        positions, quaternions = self._member_poses(self._painted_members)
        colors, opacities = self._colors()
        node = self._scene.add_batched_meshes_simple(
            f"{self.name}/plain",
            mesh.points.astype(np.float32),
            mesh.faces,
            quaternions,
            positions,
            batched_colors=colors,
            batched_opacities=opacities,
            opacity=1.0,  # enables transparency of instances
            lod=self._lod,
            cast_shadow=False,
        )
        if self._clickable:
            self._on_node(node, lambda instance: _body_at(self._painted_members, instance), draggable=self._draggable)
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


def _body_at(ids: tuple[BodyId, ...], index: int | None) -> BodyId | None:
    # A page may send a click before it has received the removal of members.
    return ids[index] if index is not None and index < len(ids) else None


def byte_color(color: Color) -> tuple[int, int, int]:
    """Converts a color to 8 bits per channel."""
    red, green, blue = (round(255 * min(max(part, 0.0), 1.0)) for part in color)
    return red, green, blue


def _is_clickable(appearance: BodyAppearance, draggable: bool) -> bool:
    """Whether a body has mouse callbacks.

    viser outlines clickable nodes under the pointer, which is distracting for floors; and one-sided bodies would block
    clicks from behind, where they are invisible.
    """
    return appearance.part is VisiblePart.WHOLE and (draggable or not appearance.is_building)


def _casts_shadow(appearance: BodyAppearance) -> bool:
    return appearance.part is VisiblePart.WHOLE and appearance.is_opaque


def _opacity(paint: Paint) -> float | None:
    return paint.opacity if paint.opacity < 1.0 else None


@lru_cache(maxsize=4096)
def _glb(appearance: BodyAppearance, texture_uri: TextureUri | None) -> bytes:
    return cached_visuals_to_glb(appearance.visuals, texture_uri=texture_uri)


@lru_cache(maxsize=4096)
def _mesh(appearance: BodyAppearance) -> TriangleMesh:
    return merge_visuals(appearance.visuals)


_MAX_LIGHTS = 3
"""Maximum number of lights: each makes rendering slower."""
_TOTAL_INTENSITY = 4.0
"""Sum of the intensities of all lights [cd], low enough not to overexpose the scene."""
_LIGHT_RANGE_M = 6.0


class LightNodes:
    """The lights attached to bodies; if there are too many, the brightest."""

    def __init__(self, scene: viser.SceneApi) -> None:
        """Creates no lights yet.

        Args:
            scene: the scene of the server.
        """
        self._scene = scene
        self._attached_lights: dict[BodyId, AttachedLight] = {}
        self._lights: dict[BodyId, viser.PointLightHandle] = {}

    def show(self, appearances: Mapping[BodyId, BodyAppearance]) -> None:
        """Creates the lights of these bodies, and removes all others."""
        all_lights = [(id, light) for id, appearance in appearances.items() for light in appearance.lights[:1]]
        brightest = dict(sorted(all_lights, key=lambda each: -each[1].intensity)[:_MAX_LIGHTS])
        if brightest == self._attached_lights:
            return
        for handle in self._lights.values():
            handle.remove()
        self._attached_lights = brightest
        total = sum(light.intensity for light in brightest.values())
        self._lights = {
            id: self._add_light(id, light, _TOTAL_INTENSITY * light.intensity / max(total, 1e-9))
            for id, light in brightest.items()
        }

    def set_poses(self, ids: Sequence[BodyId], rows: Array) -> None:
        """Moves the lights of bodies.

        Args:
            ids: the bodies.
            rows: their poses, n x 7.
        """
        for id, row in zip(ids, rows, strict=True):
            if (light := self._lights.get(id)) is not None:
                light.position = pose_multiply(row, normalized_pose_array(self._attached_lights[id].pose))[:3]

    def _add_light(self, id: BodyId, attached_light: AttachedLight, intensity: float) -> viser.PointLightHandle:
        red, green, blue = np.round(255 * np.clip(attached_light.color, 0.0, 1.0)).astype(int).tolist()
        return self._scene.add_light_point(
            f"/lights/{quote(id, safe='')}",
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
    """The nodes of markers."""

    def __init__(self, server: viser.ViserServer) -> None:
        """Creates no nodes yet.

        Args:
            server: the server of the scene.
        """
        self._server = server
        self._markers: dict[str, Marker] = {}
        self._nodes: dict[str, MarkerNode] = {}
        self._appearances: Mapping[BodyId, BodyAppearance] = {}
        self._body_copies: dict[str, BodyAppearance | None] = {}
        """The appearance with which each body copy was drawn."""

    def show(self, markers: Iterable[Marker], appearances: Mapping[BodyId, BodyAppearance]) -> None:
        """Shows these markers, and removes all others. A marker of which only the pose changed is moved.

        Args:
            appearances: the appearances of bodies, for markers that are copies of them.
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
        """Creates the node of a marker, unless it is invisible (a line of one point, or opacity 0)."""
        position, wxyz = _pose_array(marker)
        name, scene = f"/markers/{quote(marker.id, safe='')}", self._server.scene
        size = _clamped_size(marker.size)
        if marker.opacity <= 0.0:
            return
        if marker.type is MarkerType.TEXT:
            self._nodes[marker.id] = scene.add_label(name, marker.text, position=position, wxyz=wxyz)
        elif marker.type is MarkerType.POINTS and marker.points:
            points, colors = np.array(marker.points), _bytes(_colors(marker))
            self._nodes[marker.id] = scene.add_point_cloud(
                name,
                points,
                colors,
                point_size=size[0],
                point_shape="circle",
                precision="float32",  # 16 bits would round to centimeters at ten meters
                position=position,
                wxyz=wxyz,
            )
        elif marker.type in {MarkerType.LINE_STRIP, MarkerType.LINE_LIST} and len(marker.points) >= 2:
            ends = _segments(marker)
            points, colors = np.array(marker.points)[ends], _bytes(srgb_to_linear(_colors(marker)))[ends]
            self._nodes[marker.id] = scene.add_line_segments(
                name, points, colors, thickness=size[0], thickness_units="world", position=position, wxyz=wxyz
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
                wxyz=wxyz,
            )

    def _mesh(self, marker: Marker, size: Vector) -> TriangleMesh | None:
        if marker.type is MarkerType.BODY_COPY:
            appearance = self._body_copies[marker.id] = self._body_copy_appearance(marker)
            return merge_visuals(appearance.visuals) if appearance is not None and appearance.visuals else None
        return _MESHES[marker.type](size) if marker.type in _MESHES else None

    def _body_copy_appearance(self, marker: Marker) -> BodyAppearance | None:
        return self._appearances.get(BodyId(marker.body))


def _pose_array(marker: Marker) -> tuple[Array, Array]:
    quaternion = np.array(marker.pose.quaternion)
    wxyz = normalize(quaternion) if quaternion.any() else np.array([1.0, 0.0, 0.0, 0.0])
    return np.array(marker.pose.position), wxyz


def _clamped_size(size: Vector) -> Vector:
    x, y, z = (max(abs(extent), _MIN_THICKNESS_M) for extent in size)
    return x, y, z


def _segments(marker: Marker) -> NDArray[np.intp]:
    """The indices of the two end points of each segment."""
    count = len(marker.points)
    starts = np.arange(count - 1) if marker.type is MarkerType.LINE_STRIP else np.arange(0, count - 1, 2)
    return np.stack([starts, starts + 1], axis=1)


def _colors(marker: Marker) -> Array:
    """The color of each point."""
    count = len(marker.points)
    return np.array(marker.colors if len(marker.colors) == count else (marker.color,) * count)


def _bytes(colors: Array) -> NDArray[np.uint8]:
    return np.asarray(np.round(255 * np.clip(colors, 0.0, 1.0)), dtype=np.uint8)


_TRANSPARENT_OPACITY = 0.32
"""Opacity of transparent bodies that are drawn in one color."""
_POSE_TOLERANCE = 5e-5
"""Smallest change of a position [m] or quaternion component that is sent."""
_SKY_COLORS = ((247, 248, 249), (222, 226, 230))
"""Colors of the background at the upper and the lower edge; `surroundings.js` has those of the dark theme."""
_GROUND_COLOR = (229, 231, 233)
_GROUND_FADE_M = 28.0
"""Distance from the camera at which the ground has faded into the background [m]."""
_GROUND_GAP_M = 0.002
"""Distance below the lowest bodies, whose lower sides would otherwise flicker [m]."""


def moved_rows(sent: Array, now: Array) -> NDArray[np.intp]:
    """The rows in which the pose differs from the one that was sent."""
    return np.flatnonzero(np.any(np.abs(now - sent) > _POSE_TOLERANCE, axis=1))


class ViewerScene:
    """The scene of all clients."""

    def __init__(
        self,
        server: viser.ViserServer,
        *,
        on_node: NodeCallback,
        texture_uri: TextureUri | None = None,
        has_scripts: bool = True,
    ) -> None:
        """Creates an empty scene with daylight.

        Args:
            server: the server of the scene.
            on_node: called with each clickable node when it is created.
            texture_uri: where pages find the images of textures; None to draw plain colors.
            has_scripts: whether the page has the scripts of Mindstage, see `BodyNodes`.
        """
        self._server = server
        self._bodies = BodyNodes(server.scene, on_node=on_node, texture_uri=texture_uri, has_scripts=has_scripts)
        self._lights = LightNodes(server.scene)
        self._highlights: dict[BodyId, Color] = {}
        self._occluders: frozenset[BodyId] = frozenset()
        self._eye: Array | None = None
        self._hidden: frozenset[BodyId] = frozenset()
        self._enclosures_shown = True
        self._ids: tuple[BodyId, ...] = ()
        self._sent_poses: Array = np.zeros((0, 7))
        self._sun = _add_daylight(server.scene)
        self._has_scripts = has_scripts
        self._boxes, self._bounds = FirstData(server.scene, "boxes"), FirstData(server.scene, "bounds/first")

    @property
    def appearances(self) -> Mapping[BodyId, BodyAppearance]:
        """The appearances of all bodies."""
        return self._bodies.appearances

    @property
    def ids(self) -> tuple[BodyId, ...]:
        """The bodies of the rows of poses; the same object until `show` is called with others."""
        return self._ids

    # -- bodies --------------------------------------------------------------------------------------------------------

    def show(
        self,
        appearances: Mapping[BodyId, BodyAppearance],
        ids: tuple[BodyId, ...],
        poses: Array,
        *,
        draggable: Container[BodyId],
    ) -> None:
        """Creates nodes of new and changed bodies, removes those of others, and sets all poses.

        Args:
            appearances: the appearances of all bodies.
            ids: the bodies of the rows of `poses`.
            poses: n x 7.
            draggable: the bodies that can be dragged.
        """
        with self._server.atomic():
            if not self.appearances and self._has_scripts:
                self._boxes.send({})  # before the nodes
                self._bounds.send({})
            self._bodies.show(appearances, draggable=draggable)
            self._lights.show(appearances)
            self._ids, self._sent_poses = ids, poses.copy()
            if self._has_scripts:
                self._send_boxes()
            self._send_poses(np.arange(len(ids)))
            self._hide()
            self._repaint()

    def move(self, poses: Array) -> NDArray[np.intp]:
        """Sends the poses that changed; returns their rows.

        Args:
            poses: poses in the order of `ids`, n x 7.
        """
        rows = moved_rows(self._sent_poses, poses)
        if len(rows):
            self._sent_poses[rows] = poses[rows]
            with self._server.atomic():
                self._send_poses(rows)
        return rows

    def set_highlights(self, highlights: Mapping[BodyId, Color]) -> None:
        """Paints highlighted bodies in their colors; while there are any, all other bodies are dimmed."""
        repaint_all = bool(highlights) != bool(self._highlights)
        before, occluders_before, self._highlights = self._highlights, self._occluders, dict(highlights)
        self._update_occluders()
        toggled = self._occluders ^ occluders_before
        changed = [
            id for id in self.appearances if repaint_all or id in toggled or highlights.get(id) != before.get(id)
        ]
        with self._server.atomic():
            self._bodies.set_paints({id: self._paint_for(id, self.appearances[id]) for id in changed})

    def hide(self, hidden: frozenset[BodyId]) -> None:
        """Hides these bodies, and shows all others."""
        if hidden != self._hidden:
            self._hidden = hidden
            with self._server.atomic():
                self._hide()

    def instances(self, ids: Iterable[BodyId]) -> dict[str, list[int]]:
        """The names of the nodes that draw bodies; of a node with instances, which of them, otherwise none."""
        return self._bodies.instances(ids)

    def show_enclosures(self, shown: bool) -> None:
        """Shows or hides the outlines of enclosing bodies."""
        if shown != self._enclosures_shown:
            self._enclosures_shown = shown
            with self._server.atomic():
                self._hide()

    # -- surroundings --------------------------------------------------------------------------------------------------

    def set_initial_camera(self, camera_pose: CameraPose) -> None:
        """Sets the camera of new clients until their aspect ratio is known, and the sun relative to it."""
        camera = self._server.initial_camera
        camera.position, camera.look_at, camera.fov = (
            camera_pose.position,
            camera_pose.look_at,
            camera_pose.field_of_view_rad,
        )
        self._eye = np.array(camera_pose.position)
        self._sun.position = _sun_direction(np.subtract(camera_pose.position, camera_pose.look_at))

    def set_ground(self, height: float | None) -> None:
        """Shows a plane at a height [m] that fades into the background and receives shadows; None removes it."""
        ground = self._server.scene.get_handle_by_name("/ground")
        if ground is not None:
            ground.remove()
        if height is not None:
            self._server.scene.add_grid(
                "/ground",
                infinite_grid=True,
                position=(0.0, 0.0, height - _GROUND_GAP_M),
                cell_thickness=0.0,
                section_thickness=0.0,
                plane_color=_GROUND_COLOR,
                plane_opacity=1.0,
                fade_distance=_GROUND_FADE_M,
                fade_strength=1.6,
                shadow_opacity=0.3,
            )

    # -- internals -----------------------------------------------------------------------------------------------------

    def _send_boxes(self) -> None:
        """Sends the boxes of all bodies, and a sphere around them, over which the sun casts shadows."""
        solid = [(row, id) for row, id in enumerate(self._ids) if _is_solid(self.appearances.get(id))]
        if not solid:
            return
        drawn = [self.appearances[id] for _, id in solid]
        poses, sizes = self._sent_poses[[row for row, _ in solid]], np.array([each.size for each in drawn])
        points = corners(poses, sizes)
        low, high = points.min(axis=0), points.max(axis=0)
        bounds = {"center": ((low + high) / 2).tolist(), "radius": float(np.linalg.norm(high - low)) / 2}
        self._bounds.replace(bounds)
        send_view_data(self._server.scene, "bounds/now", bounds)
        is_opaque = np.array([each.is_opaque for each in drawn])
        self._boxes.replace(
            {
                "names": [self._bodies.node_name(id) for _, id in solid],
                "poses": np.hstack([poses[:, :3], normalize(poses[:, 3:])]).astype(np.float32).reshape(-1),
                "sizes": (sizes * is_opaque[:, None]).astype(np.float32).reshape(-1),
                "colors": _bytes(np.array([each.color for each in drawn])).reshape(-1),
                "sides": [_ALL_SIDES if each.side is None else 2 * each.side[0] + (each.side[1] > 0) for each in drawn],
            }
        )

    def _hide(self) -> None:
        outlines = {id for id, each in self.appearances.items() if each.part is VisiblePart.OUTLINE}
        self._bodies.hide(self._hidden | (frozenset() if self._enclosures_shown else outlines))

    def _repaint(self) -> None:
        if self._highlights:
            self._update_occluders()
            self._bodies.set_paints({id: self._paint_for(id, each) for id, each in self.appearances.items()})

    def _update_occluders(self) -> None:
        """Finds the bodies that hide highlighted ones from the initial camera; they are drawn transparent."""
        ids = [(row, id) for row, id in enumerate(self._ids) if id in self.appearances]
        rows = np.array([at for at, (_, id) in enumerate(ids) if id in self._highlights], dtype=np.intp)
        if self._eye is None or not len(rows):
            self._occluders = frozenset()
            return
        poses = self._sent_poses[[row for row, _ in ids]]
        sizes = np.array([self.appearances[id].size for _, id in ids])
        self._occluders = frozenset(ids[at][1] for at in find_occluders(self._eye, poses, sizes, rows).tolist())

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
        poses = self._sent_poses[rows]
        poses[:, 3:] = normalize(poses[:, 3:])
        ids = [self._ids[row] for row in rows.tolist()]
        self._bodies.set_poses(ids, poses)
        self._lights.set_poses(ids, poses)


_ALL_SIDES = -1
"""The code of a wall that is drawn from all sides."""


def _visible_area(appearance: BodyAppearance) -> float:
    """The area of the largest side of a body's box [m²]."""
    _, middle, largest = sorted(appearance.size)
    return middle * largest


def _is_solid(appearance: BodyAppearance | None) -> bool:
    return appearance is not None and appearance.part is not VisiblePart.OUTLINE


def _add_daylight(scene: viser.SceneApi) -> viser.DirectionalLightHandle:
    """Adds a directional light beside the initial camera, a hemisphere light, and a gray background."""
    scene.configure_default_lights(enabled=False)
    # An environment map makes rendering 30 times slower without a GPU.
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
    """The position of the sun: 18 degrees beside the camera, whose direction from the center is given."""
    azimuth = float(np.arctan2(view_direction[1], view_direction[0])) + np.radians(18.0)
    return 6.0 * float(np.cos(azimuth)), 6.0 * float(np.sin(azimuth)), 11.0
