"""Bodies: the nodes in the visitors' browsers that bodies are drawn with, kept like the world with few messages.

A body has a node of its own, which moves with little effort on both sides. Bodies that look alike and are many are a
crowd: one node for all, which is drawn at once and whose poses are sent together. Each of both has two guises: as it
is, a GLB with all its materials, and plain in one color, for what is lit and for what steps back behind it.

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
from numpy.typing import NDArray

from mindstage.viewport.glb import merge_visuals, visuals_to_glb
from mindstage.viewport.looks import BodyAppearance, VisiblePart
from mindstage.viewport.palette import Paint
from mindstage.world import BodyId, Color
from mindstage.world.colors import srgb_to_linear
from mindstage.world.geometry import Array
from mindstage.world.meshes import TriangleMesh, box_edges

__all__ = ["BATCH_SIZE", "BodyNodes", "Clickable", "NodeCallback", "byte_color"]

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
