"""Scene: what all visitors see, kept like the world with as few messages as possible.

Only one thread may call it.
"""

from __future__ import annotations

from collections.abc import Container, Mapping

import numpy as np
import viser
from numpy.typing import NDArray

from mindstage.viewport.bodies import BodyNodes, NodeCallback
from mindstage.viewport.framing import CameraPose
from mindstage.viewport.lamps import LightNodes
from mindstage.viewport.looks import BodyAppearance, VisiblePart
from mindstage.viewport.palette import Paint, dimmed, highlighted
from mindstage.viewport.veils import find_occluders
from mindstage.world import BodyId, Color, Vector
from mindstage.world.geometry import Array, normalize

__all__ = ["ViewerScene", "moved_rows"]

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
