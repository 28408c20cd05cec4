"""Bodies: the nodes in the visitors' browsers that bodies are drawn with, kept like the world with few messages.

A body has a node of its own, which moves with little effort on both sides. Bodies that look alike and are many are a
crowd: one node for all, which is drawn at once and whose poses are sent together. Each of both has two guises: as it
is, a GLB with all its materials, and plain in one colour, for what is lit and for what steps back behind it.

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

from mindstage.viewport.glb import glb, mesh_of
from mindstage.viewport.looks import Look, Part
from mindstage.viewport.palette import Paint
from mindstage.world import BodyId, Colour
from mindstage.world.colours import linear
from mindstage.world.geometry import Array
from mindstage.world.meshes import TriangleMesh, box_edges

__all__ = ["CROWD", "Bodies", "Clickable", "Prepare", "byte_colour"]

CROWD = 8
"""So many that look alike are drawn at once."""
_CROWD_AT_MOST = 128
"""One that moves in a crowd sends the poses of all that are in it."""
_OUTLINE = (208, 212, 216)

Clickable = viser.MeshHandle | viser.GlbHandle | viser.BatchedMeshHandle | viser.BatchedGlbHandle

Node = TypeVar("Node", viser.BatchedGlbHandle, viser.BatchedMeshHandle)

Pick = Callable[[int | None], BodyId | None]
"""Which body of a node was meant, by the number that comes with a click."""


class Prepare(Protocol):
    """Called with each node that can be clicked, whenever it is drawn anew."""

    def __call__(self, node: Clickable, pick: Pick, *, holdable: bool) -> None:
        """Makes it answer."""


class _Drawn(Protocol):
    """One body, or a crowd of them."""

    def place(self, ids: Sequence[BodyId], rows: Array) -> None: ...
    def paint(self, paints: Mapping[BodyId, Paint | None]) -> None: ...
    def show(self, ids: Iterable[BodyId], shown: bool) -> None: ...
    def remove(self, ids: Iterable[BodyId]) -> None: ...


class Bodies:
    """All that are there."""

    def __init__(self, scene: viser.SceneApi, *, prepare: Prepare) -> None:
        """None yet.

        Args:
            scene: where they are drawn.
            prepare: makes a node that was just drawn answer to the mouse.
        """
        self._scene, self._prepare = scene, prepare
        self._drawn: dict[BodyId, _Drawn] = {}
        self._looks: dict[BodyId, Look] = {}
        self._holdable: dict[BodyId, bool] = {}
        self._paints: dict[BodyId, Paint] = {}
        self._hidden: frozenset[BodyId] = frozenset()
        self._crowds = 0

    @property
    def looks(self) -> Mapping[BodyId, Look]:
        """Of those that are there."""
        return self._looks

    def show(self, looks: Mapping[BodyId, Look], *, holdable: Container[BodyId]) -> None:
        """Draws what came or changed, and removes what went; the places of what is new are not known yet."""
        gone = [
            id for id, look in self._looks.items() if looks.get(id) != look or self._holdable[id] != (id in holdable)
        ]
        for drawn, ids in self._grouped(gone).items():
            drawn.remove(ids)
        for id in gone:
            del self._drawn[id], self._looks[id], self._holdable[id]
        new = [id for id in looks if id not in self._looks]
        counts = Counter(looks[id].key for id in new if looks[id].part is Part.WHOLE)
        crowds: dict[tuple[str, bool], list[BodyId]] = {}
        for id in new:
            look, held = looks[id], id in holdable
            self._looks[id], self._holdable[id] = look, held
            if counts[look.key] >= CROWD:
                crowds.setdefault((look.key, held), []).append(id)
            else:
                self._drawn[id] = _Single(self._scene, id, look, self._prepare, holdable=held)
        for (_, held), ids in crowds.items():
            for start in range(0, len(ids), _CROWD_AT_MOST):
                self._crowd(ids[start : start + _CROWD_AT_MOST], held)
        self._dress(new)

    def place(self, ids: Sequence[BodyId], rows: Array) -> None:
        """Puts bodies in their places.

        Args:
            ids: which; those that are not drawn are passed over.
            rows: n x 7, the quaternions of norm 1.
        """
        groups: dict[_Drawn, list[int]] = {}
        for number, id in enumerate(ids):
            if (drawn := self._drawn.get(id)) is not None:
                groups.setdefault(drawn, []).append(number)
        for drawn, numbers in groups.items():
            drawn.place([ids[number] for number in numbers], rows[numbers])

    def paint(self, paints: Mapping[BodyId, Paint | None]) -> None:
        """Draws bodies plain in one colour, or as they are where it is None."""
        for id, paint in paints.items():
            if paint is None:
                self._paints.pop(id, None)
            else:
                self._paints[id] = paint
        for drawn, ids in self._grouped(paints).items():
            drawn.paint({id: paints[id] for id in ids})

    def hide(self, hidden: frozenset[BodyId]) -> None:
        """Shows all bodies but these."""
        changed, self._hidden = self._hidden ^ hidden, hidden
        for drawn, ids in self._grouped(changed).items():
            drawn.show([id for id in ids if id in hidden], False)
            drawn.show([id for id in ids if id not in hidden], True)

    def _dress(self, ids: Iterable[BodyId]) -> None:
        """What was drawn anew is lit or hidden as it was."""
        for drawn, group in self._grouped(ids).items():
            if painted := {id: self._paints[id] for id in group if id in self._paints}:
                drawn.paint(painted)
            if hidden := [id for id in group if id in self._hidden]:
                drawn.show(hidden, False)

    def _crowd(self, ids: list[BodyId], held: bool) -> None:
        self._crowds += 1
        look = self._looks[ids[0]]
        crowd = _Crowd(self._scene, f"/crowds/{self._crowds}", ids, look, self._prepare, holdable=held)
        self._drawn.update(dict.fromkeys(ids, crowd))

    def _grouped(self, ids: Iterable[BodyId]) -> dict[_Drawn, list[BodyId]]:
        groups: dict[_Drawn, list[BodyId]] = {}
        for id in ids:
            if (drawn := self._drawn.get(id)) is not None:
                groups.setdefault(drawn, []).append(id)
        return groups


class _Single:
    """A body with a node of its own, below which its guises are."""

    def __init__(self, scene: viser.SceneApi, id: BodyId, look: Look, prepare: Prepare, *, holdable: bool) -> None:
        # A slash in an id would make it a part of another body.
        self._scene, self._name, self._look = scene, f"/bodies/{quote(id, safe='')}", look
        self._top = scene.add_frame(self._name, show_axes=False)
        self._turn = b""
        self._clickable = _answers(look, holdable)
        self._prepare: Callable[[Clickable], None] = lambda node: prepare(node, lambda _: id, holdable=holdable)
        self._plain: viser.MeshHandle | None = None
        self._as_it_is: viser.GlbHandle | None = None
        self._outline: viser.LineSegmentsHandle | None = None
        if look.part is Part.OUTLINE:
            self._outline = scene.add_line_segments(
                f"{self._name}/outline", box_edges(look.size), _OUTLINE, thickness=1.0, thickness_units="screen"
            )
        else:
            self._as_it_is = scene.add_glb(f"{self._name}/seen", _glb(look), cast_shadow=_casts_shadow(look))
            if self._clickable:
                self._prepare(self._as_it_is)

    def place(self, ids: Sequence[BodyId], rows: Array) -> None:
        self._top.position = rows[0, :3]
        turn = rows[0, 3:].tobytes()
        if turn != self._turn:  # most things slide, and finding that out costs the page's library more than this
            self._top.wxyz, self._turn = rows[0, 3:], turn

    def paint(self, paints: Mapping[BodyId, Paint | None]) -> None:
        (paint,) = paints.values()
        if self._outline is not None:
            self._outline.colors = np.array(_OUTLINE if paint is None else byte_colour(paint.colour), dtype=np.uint8)
            return
        if paint is not None:
            if self._plain is None:
                self._plain = self._draw_plain(paint)
            self._plain.color, self._plain.opacity = byte_colour(paint.colour), _opacity(paint)
            self._plain.visible = True
        elif self._plain is not None:
            self._plain.visible = False
        assert self._as_it_is is not None
        self._as_it_is.visible = paint is None

    def show(self, ids: Iterable[BodyId], shown: bool) -> None:
        for _ in ids:
            self._top.visible = shown

    def remove(self, ids: Iterable[BodyId]) -> None:
        self._top.remove()

    def _draw_plain(self, paint: Paint) -> viser.MeshHandle:
        mesh = _mesh(self._look)
        node = self._scene.add_mesh_simple(
            f"{self._name}/plain",
            mesh.points.astype(np.float32),
            mesh.faces,
            color=byte_colour(paint.colour),
            opacity=_opacity(paint),
            cast_shadow=_casts_shadow(self._look),
        )
        if self._clickable:
            self._prepare(node)
        return node


class _Crowd:
    """Bodies that look alike: a node for those as they are, and one for those in a colour."""

    def __init__(
        self,
        scene: viser.SceneApi,
        name: str,
        ids: Sequence[BodyId],
        look: Look,
        prepare: Prepare,
        *,
        holdable: bool,
    ) -> None:
        self._scene, self._name, self._look, self._prepare = scene, name, look, prepare
        self._holdable, self._clickable = holdable, _answers(look, holdable)
        self._rows: dict[BodyId, Array] = {id: np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]) for id in ids}
        self._paints: dict[BodyId, Paint] = {}
        self._hidden: set[BodyId] = set()
        self._as_they_are: viser.BatchedGlbHandle | None = None
        self._plain: viser.BatchedMeshHandle | None = None
        self._members: tuple[BodyId, ...] = ()
        self._painted: tuple[BodyId, ...] = ()
        self._top = scene.add_frame(name, show_axes=False)
        self._arrange()

    def place(self, ids: Sequence[BodyId], rows: Array) -> None:
        self._rows.update(zip(ids, rows, strict=True))
        moved = set(ids)
        for node, members in ((self._as_they_are, self._members), (self._plain, self._painted)):
            if node is not None and not moved.isdisjoint(members):
                self._move(node, members)

    def paint(self, paints: Mapping[BodyId, Paint | None]) -> None:
        for id, paint in paints.items():
            if paint is None:
                self._paints.pop(id, None)
            else:
                self._paints[id] = paint
        self._arrange()

    def show(self, ids: Iterable[BodyId], shown: bool) -> None:
        changed = set(ids)
        if changed:
            self._hidden = self._hidden - changed if shown else self._hidden | changed
            self._arrange()

    def remove(self, ids: Iterable[BodyId]) -> None:
        for id in ids:
            del self._rows[id]
            self._paints.pop(id, None)
            self._hidden.discard(id)
        if self._rows:
            self._arrange()
        else:
            self._top.remove()

    def _arrange(self) -> None:
        """Shares the bodies out between the two nodes."""
        shown = [id for id in self._rows if id not in self._hidden]
        members = tuple(id for id in shown if id not in self._paints)
        painted = tuple(id for id in shown if id in self._paints)
        if members != self._members:
            self._members = members
            self._as_they_are = self._filled(self._as_they_are, members, self._draw)
        if painted != self._painted:
            self._painted = painted
            self._plain = self._filled(self._plain, painted, self._draw_plain)
        if self._plain is not None and painted:
            self._plain.batched_colors, self._plain.batched_opacities = self._colours()

    def _filled(self, node: Node | None, members: tuple[BodyId, ...], draw: Callable[[], Node]) -> Node | None:
        """The node that holds these bodies now; one that holds none cannot be drawn, but is kept."""
        if members and node is None:
            return draw()
        if node is not None:
            node.visible = bool(members)
            if members:
                self._move(node, members)
        return node

    def _draw(self) -> viser.BatchedGlbHandle:
        positions, turns = self._places(self._members)
        node = self._scene.add_batched_glb(
            f"{self._name}/seen", _glb(self._look), turns, positions, cast_shadow=_casts_shadow(self._look)
        )
        if self._clickable:
            self._prepare(node, lambda instance: _numbered(self._members, instance), holdable=self._holdable)
        return node

    def _draw_plain(self) -> viser.BatchedMeshHandle:
        mesh = _mesh(self._look)
        positions, turns = self._places(self._painted)
        colours, opacities = self._colours()
        node = self._scene.add_batched_meshes_simple(
            f"{self._name}/plain",
            mesh.points.astype(np.float32),
            mesh.faces,
            turns,
            positions,
            batched_colors=colours,
            batched_opacities=opacities,
            opacity=1.0,  # else none could be seen through
            cast_shadow=False,
        )
        if self._clickable:
            self._prepare(node, lambda instance: _numbered(self._painted, instance), holdable=self._holdable)
        return node

    def _move(self, node: viser.BatchedGlbHandle | viser.BatchedMeshHandle, members: tuple[BodyId, ...]) -> None:
        node.batched_positions, node.batched_wxyzs = self._places(members)

    def _places(self, members: Iterable[BodyId]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        rows = np.array([self._rows[id] for id in members], dtype=np.float32).reshape(-1, 7)
        return np.ascontiguousarray(rows[:, :3]), np.ascontiguousarray(rows[:, 3:])

    def _colours(self) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        paints = [self._paints[id] for id in self._painted]
        colours = linear(np.array([paint.colour for paint in paints]).reshape(-1, 3))
        return np.round(255 * colours).astype(np.uint8), np.array([paint.opacity for paint in paints], np.float32)


def _numbered(ids: tuple[BodyId, ...], number: int | None) -> BodyId | None:
    # A click may come from a page that has not heard yet of who went.
    return ids[number] if number is not None and number < len(ids) else None


def byte_colour(colour: Colour) -> tuple[int, int, int]:
    """As the page takes most colours."""
    red, green, blue = (round(255 * min(max(part, 0.0), 1.0)) for part in colour)
    return red, green, blue


def _answers(look: Look, holdable: bool) -> bool:
    """Whether a body answers to the mouse.

    A floor that does would be outlined whenever somebody looks round, and what is drawn from one side only would catch
    the mouse from the other.
    """
    return look.part is Part.WHOLE and (holdable or not look.building)


def _casts_shadow(look: Look) -> bool:
    return look.part is Part.WHOLE and look.opaque


def _opacity(paint: Paint) -> float | None:
    return paint.opacity if paint.opacity < 1.0 else None


@lru_cache(maxsize=4096)
def _glb(look: Look) -> bytes:
    return glb(look.skins)


@lru_cache(maxsize=4096)
def _mesh(look: Look) -> TriangleMesh:
    return mesh_of(look.skins)
