"""Scene: bodies as nodes in the visitors' browsers, kept like the world with as few messages as possible.

Only one thread may call it.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from functools import lru_cache
from typing import Protocol
from urllib.parse import quote

import numpy as np
import viser
from numpy.typing import NDArray

from mindstage.viewport.forms import Mesh, ball, box, cylinder, edges, inside, open_box, pierced_box, vessel
from mindstage.viewport.framing import View
from mindstage.viewport.looks import Form, Look
from mindstage.viewport.palette import Paint, dimmed, lit
from mindstage.world import BodyId, Colour, Vector
from mindstage.world.geometry import Array, unit

__all__ = ["Scene", "moved"]

_STILL = 5e-5
"""What moves by less than this [m, or in a quaternion's numbers] since it was last sent is not sent again."""
_ACCENT = (232, 93, 4)
_OUTLINE = (205, 208, 211)
_SKY = ((247, 248, 249), (222, 226, 230))
"""The background, from the upper to the lower edge."""


class Prepare(Protocol):
    """Called with each body that can be clicked, whenever it is drawn anew."""

    def __call__(self, id: BodyId, node: viser.MeshHandle, *, holdable: bool) -> None: ...


def moved(sent: Array, now: Array) -> NDArray[np.intp]:
    """The rows whose pose is no longer the one that was sent."""
    return np.flatnonzero(np.any(np.abs(now - sent) > _STILL, axis=1))


class Scene:
    """What the visitors see."""

    def __init__(self, server: viser.ViserServer, *, prepare: Prepare) -> None:
        """Lights an empty place.

        Args:
            server: where the visitors come.
            prepare: makes a body that was just drawn answer to the mouse.
        """
        self._server = server
        self._prepare = prepare
        self._solids: dict[BodyId, viser.MeshHandle] = {}
        self._outlines: dict[BodyId, viser.LineSegmentsHandle] = {}
        self._looks: dict[BodyId, Look] = {}
        self._holdable: dict[BodyId, bool] = {}
        self._lit: dict[BodyId, Colour] = {}
        self._ids: tuple[BodyId, ...] = ()
        self._sent: Array = np.zeros((0, 7))
        self._selected: tuple[BodyId, viser.LineSegmentsHandle] | None = None
        self._shells_shown = True
        self._sun = _light(server.scene)

    # -- bodies ----------------------------------------------------------------------------------------------

    def show(
        self, looks: Mapping[BodyId, Look], ids: tuple[BodyId, ...], poses: Array, *, holdable: Container[BodyId]
    ) -> None:
        """Draws bodies that came or changed, removes those that went, and puts all in their places.

        Args:
            looks: of all bodies.
            ids: whose poses follow.
            poses: n x 7.
            holdable: which of them can be pulled.
        """
        with self._server.atomic():
            for id, look in list(self._looks.items()):
                if looks.get(id) != look or self._holdable[id] != (id in holdable):
                    self._remove(id)
            for id, look in looks.items():
                if id not in self._looks:
                    self._draw(id, look, holdable=id in holdable)
            self._ids, self._sent = ids, poses.copy()
            self._place(np.arange(len(ids)))

    def move(self, poses: Array) -> int:
        """Sends the poses that changed, in the order of the ids last shown; returns how many."""
        rows = moved(self._sent, poses)
        if len(rows):
            self._sent[rows] = poses[rows]
            with self._server.atomic():
                self._place(rows)
        return len(rows)

    def light_up(self, highlights: Mapping[BodyId, Colour]) -> None:
        """Paints lit bodies in their highlight, and all others as they are; dimmed while anything is lit."""
        dims = bool(highlights) != bool(self._lit)
        changed = [id for id in self._looks if dims or highlights.get(id) != self._lit.get(id)]
        self._lit = dict(highlights)
        with self._server.atomic():
            for id in changed:
                self._paint(id)

    def show_shells(self, shown: bool) -> None:
        """Draws the outlines of what encloses the place, or not."""
        if shown != self._shells_shown:
            self._shells_shown = shown
            for node in self._outlines.values():
                node.visible = shown

    # -- marks -----------------------------------------------------------------------------------------------

    def select(self, id: BodyId | None) -> None:
        """Draws a frame round a body, and round no other."""
        if (self._selected[0] if self._selected is not None else None) == id:
            return
        if self._selected is not None:
            self._selected[1].remove()
            self._selected = None
        if id is not None and id in self._looks:
            around = edges(self._looks[id].size, margin=0.004)
            frame = self._server.scene.add_line_segments(
                f"{_name(id)}/selected", around, _ACCENT, thickness=2.5, thickness_units="screen"
            )
            self._selected = id, frame

    # -- the place -------------------------------------------------------------------------------------------

    def look_from(self, view: View) -> None:
        """Where visitors start; those who are there already are taken there too."""
        camera = self._server.initial_camera
        camera.position, camera.look_at, camera.fov = view.position, view.look_at, view.field_of_view_rad
        away = np.subtract(view.position, view.look_at)
        self._sun.position = _sun_beside(away)
        for client in self._server.get_clients().values():
            client.camera.position, client.camera.look_at = view.position, view.look_at
            client.camera.fov = view.field_of_view_rad

    def lay_ground(self, height: float | None) -> None:
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

    # -- nodes -----------------------------------------------------------------------------------------------

    def _draw(self, id: BodyId, look: Look, *, holdable: bool) -> None:
        if look.form is Form.OUTLINE:
            self._outlines[id] = self._outline(id, look)
        else:
            self._solids[id] = self._solid(id, look)
            # A floor that answers to the mouse would be outlined whenever somebody looks round, and what is drawn
            # from one side only would catch the mouse from the other.
            if look.form is not Form.INSIDE and (holdable or not look.building):
                self._prepare(id, self._solids[id], holdable=holdable)
        self._looks[id], self._holdable[id] = look, holdable

    def _outline(self, id: BodyId, look: Look) -> viser.LineSegmentsHandle:
        colour = _bytes(self._lit[id]) if id in self._lit else _OUTLINE
        return self._server.scene.add_line_segments(
            _name(id), edges(look.size), colour, thickness=1.0, thickness_units="screen", visible=self._shells_shown
        )

    def _solid(self, id: BodyId, look: Look) -> viser.MeshHandle:
        mesh, paint = _mesh(look), self._painted(id, look)
        return self._server.scene.add_mesh_simple(
            _name(id),
            mesh.vertices,
            mesh.faces,
            color=_bytes(paint.colour),
            opacity=_opacity(paint),
            cast_shadow=look.form is not Form.INSIDE and look.paint.opacity > 0.6,
        )

    def _remove(self, id: BodyId) -> None:
        if self._selected is not None and self._selected[0] == id:
            self.select(None)
        del self._looks[id], self._holdable[id]
        node = self._solids.pop(id, None) or self._outlines.pop(id)
        node.remove()

    def _paint(self, id: BodyId) -> None:
        if id in self._solids:
            paint = self._painted(id, self._looks[id])
            self._solids[id].color, self._solids[id].opacity = _bytes(paint.colour), _opacity(paint)
        else:
            colour = _bytes(self._lit[id]) if id in self._lit else _OUTLINE
            self._outlines[id].colors = np.array(colour, dtype=np.uint8)

    def _painted(self, id: BodyId, look: Look) -> Paint:
        return lit(look.paint, self._lit[id]) if id in self._lit else dimmed(look.paint) if self._lit else look.paint

    def _place(self, rows: NDArray[np.intp]) -> None:
        quaternions = unit(self._sent[rows, 3:])
        for row, quaternion in zip(rows.tolist(), quaternions, strict=True):
            id = self._ids[row]
            node = self._solids.get(id) or self._outlines.get(id)
            if node is not None:
                node.position, node.wxyz = self._sent[row, :3], quaternion


def _name(id: BodyId) -> str:
    # A slash in an id would make it a part of another body.
    return f"/bodies/{quote(id, safe='')}"


def _bytes(colour: Colour) -> tuple[int, int, int]:
    red, green, blue = (round(255 * min(max(part, 0.0), 1.0)) for part in colour)
    return red, green, blue


def _opacity(paint: Paint) -> float | None:
    return paint.opacity if paint.opacity < 1.0 else None


@lru_cache(maxsize=4096)
def _mesh(look: Look) -> Mesh:
    match look.form:
        case Form.OPEN_BOX:
            return open_box(look.size, look.openings, levels=look.levels, holes=look.holes)
        case Form.CYLINDER:
            return cylinder(look.size)
        case Form.VESSEL:
            return vessel(look.size, foot=look.foot)
        case Form.BALL:
            return ball(look.size)
        case Form.INSIDE:
            return inside(look.size, look.openings[0])
        case _:
            return pierced_box(look.size, look.holes) if look.holes else box(look.size)


def _light(scene: viser.SceneApi) -> viser.DirectionalLightHandle:
    """Daylight from a window behind the visitor's shoulder, a little from everywhere else, and a quiet background."""
    scene.configure_default_lights(enabled=False)
    scene.configure_environment_map(None)
    scene.add_light_hemisphere("/sky", sky_color=(255, 255, 255), ground_color=(214, 204, 190), intensity=2.2)
    scene.world_axes.visible = False
    rows = np.linspace(*_SKY, 512).astype(np.uint8)
    scene.set_background_image(np.repeat(rows[:, None, :], 2, axis=1), format="png")
    return scene.add_light_directional(
        "/sun", color=(255, 246, 232), intensity=2.3, cast_shadow=True, position=_sun_beside(np.array([1.0, -1.0, 1.0]))
    )


def _sun_beside(away: Array) -> Vector:
    """Where the sun stands for an eye in that direction from the middle."""
    azimuth = float(np.arctan2(away[1], away[0])) + np.radians(18.0)
    return 6.0 * float(np.cos(azimuth)), 6.0 * float(np.sin(azimuth)), 11.0
