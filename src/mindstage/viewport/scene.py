"""Scene: what all visitors see, kept like the world with as few messages as possible.

Only one thread may call it.
"""

from __future__ import annotations

from collections.abc import Container, Mapping

import numpy as np
import viser
from numpy.typing import NDArray

from mindstage.viewport.bodies import Bodies, Prepare
from mindstage.viewport.framing import View
from mindstage.viewport.lamps import Lamps
from mindstage.viewport.looks import Look, Part
from mindstage.viewport.palette import Paint, dimmed, lit
from mindstage.viewport.veils import find_veils
from mindstage.world import BodyId, Colour, Vector
from mindstage.world.geometry import Array, unit

__all__ = ["Scene", "moved"]

_GLASSY = 0.32
"""The opacity of what one sees through, where it is drawn in one colour."""
_STILL = 5e-5
"""What moves by less than this [m, or in a quaternion's numbers] since it was last sent is not sent again."""
_SKY = ((247, 248, 249), (222, 226, 230))
"""The background, from the upper to the lower edge."""


def moved(sent: Array, now: Array) -> NDArray[np.intp]:
    """The rows whose pose is no longer the one that was sent."""
    return np.flatnonzero(np.any(np.abs(now - sent) > _STILL, axis=1))


class Scene:
    """What the visitors see."""

    def __init__(self, server: viser.ViserServer, *, prepare: Prepare) -> None:
        """Lights an empty place.

        Args:
            server: where the visitors come.
            prepare: makes what was just drawn answer to the mouse.
        """
        self._server = server
        self._bodies = Bodies(server.scene, prepare=prepare)
        self._lamps = Lamps(server.scene)
        self._lit: dict[BodyId, Colour] = {}
        self._veils: frozenset[BodyId] = frozenset()
        self._eye: Array | None = None
        self._hidden: frozenset[BodyId] = frozenset()
        self._shells_shown = True
        self._ids: tuple[BodyId, ...] = ()
        self._sent: Array = np.zeros((0, 7))
        self._sun = _light(server.scene)

    @property
    def looks(self) -> Mapping[BodyId, Look]:
        """Of all bodies that are there."""
        return self._bodies.looks

    @property
    def ids(self) -> tuple[BodyId, ...]:
        """Whose poses were shown last; the same object until others are shown."""
        return self._ids

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
            self._bodies.show(looks, holdable=holdable)
            self._lamps.show(looks)
            self._ids, self._sent = ids, poses.copy()
            self._place(np.arange(len(ids)))
            self._hide()
            self._paint_all()

    def move(self, poses: Array) -> NDArray[np.intp]:
        """Sends the poses that changed, in the order of the ids last shown; gives their rows."""
        rows = moved(self._sent, poses)
        if len(rows):
            self._sent[rows] = poses[rows]
            with self._server.atomic():
                self._place(rows)
        return rows

    def light_up(self, highlights: Mapping[BodyId, Colour]) -> None:
        """Paints lit bodies in their highlight, and all others as they are; dimmed while anything is lit."""
        dims = bool(highlights) != bool(self._lit)
        before, veils_before, self._lit = self._lit, self._veils, dict(highlights)
        self._find_veils()
        other = self._veils ^ veils_before
        changed = [id for id in self.looks if dims or id in other or highlights.get(id) != before.get(id)]
        with self._server.atomic():
            self._bodies.paint({id: self._painted(id, self.looks[id]) for id in changed})

    def hide(self, hidden: frozenset[BodyId]) -> None:
        """Shows all bodies but these."""
        if hidden != self._hidden:
            self._hidden = hidden
            with self._server.atomic():
                self._hide()

    def show_shells(self, shown: bool) -> None:
        """Draws the outlines of what encloses the place, or not."""
        if shown != self._shells_shown:
            self._shells_shown = shown
            with self._server.atomic():
                self._hide()

    # -- the place -------------------------------------------------------------------------------------------

    def start_from(self, view: View) -> None:
        """Where the camera of a visitor is who comes, until the shape of the window is known; the sun stands beside."""
        camera = self._server.initial_camera
        camera.position, camera.look_at, camera.fov = view.position, view.look_at, view.field_of_view_rad
        self._eye = np.array(view.position)
        self._sun.position = _sun_beside(np.subtract(view.position, view.look_at))

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

    # -- how -------------------------------------------------------------------------------------------------

    def _hide(self) -> None:
        outlines = {id for id, look in self.looks.items() if look.part is Part.OUTLINE}
        self._bodies.hide(self._hidden | (frozenset() if self._shells_shown else outlines))

    def _paint_all(self) -> None:
        if self._lit:
            self._find_veils()
            self._bodies.paint({id: self._painted(id, look) for id, look in self.looks.items()})

    def _find_veils(self) -> None:
        """Where visitors stand first, they see what is lit, whatever it is in or behind."""
        ids = [(row, id) for row, id in enumerate(self._ids) if id in self.looks]
        lit = np.array([at for at, (_, id) in enumerate(ids) if id in self._lit], dtype=np.intp)
        if self._eye is None or not len(lit):
            self._veils = frozenset()
            return
        poses = self._sent[[row for row, _ in ids]]
        sizes = np.array([self.looks[id].size for _, id in ids])
        self._veils = frozenset(ids[at][1] for at in find_veils(self._eye, poses, sizes, lit).tolist())

    def _painted(self, id: BodyId, look: Look) -> Paint | None:
        if not self._lit:
            return None
        paint = Paint(look.colour, 1.0 if look.opaque else _GLASSY)
        if look.part is Part.OUTLINE and id not in self._lit:
            return None
        return lit(paint, self._lit[id]) if id in self._lit else dimmed(paint, veil=id in self._veils)

    def _place(self, rows: NDArray[np.intp]) -> None:
        placed = self._sent[rows]
        placed[:, 3:] = unit(placed[:, 3:])
        ids = [self._ids[row] for row in rows.tolist()]
        self._bodies.place(ids, placed)
        self._lamps.place(ids, placed)


def _light(scene: viser.SceneApi) -> viser.DirectionalLightHandle:
    """Daylight from a window behind the visitor's shoulder, a little from everywhere else, and a quiet background."""
    scene.configure_default_lights(enabled=False)
    # Surroundings to be mirrored make each picture thirty times slower where there is no GPU.
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
