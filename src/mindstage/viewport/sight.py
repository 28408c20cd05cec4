"""Sight: one visitor's own view: the camera, and what is drawn for nobody else.

Only one thread may call it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from enum import StrEnum
from typing import Protocol
from urllib.parse import quote

import numpy as np
import viser

from mindstage.viewport.framing import Outlook, View, corners, focus_view
from mindstage.viewport.glb import mesh_of
from mindstage.viewport.looks import Look
from mindstage.world import BodyId, Pose, Vector
from mindstage.world.geometry import Array, pose_from, unit, unit_pose
from mindstage.world.meshes import box_edges

__all__ = ["GizmoMode", "Labels", "Place", "Sight"]

_ACCENT = (232, 93, 4)
_GHOST_OPACITY = 0.35
_FLIGHT_S = 0.6
_MOST_LABELS = 300
"""More than that nobody reads, and no browser draws with ease: the largest bodies have theirs."""
_CLOSEST_M = 0.25
"""What is smaller is looked at from no nearer than if it were so large."""


class Labels(StrEnum):
    """Which bodies have their names beside them."""

    NONE = "none"
    SELECTED = "selected"
    CLASS = "class"
    """All that are named like the selected one."""
    ALL = "all"


class GizmoMode(StrEnum):
    """What the handles at the selected body do with it."""

    MOVE = "move"
    TURN = "turn"


class Place(Protocol):
    """Called when a visitor has put a body somewhere."""

    def __call__(self, visitor: int, id: BodyId, pose: Pose) -> None:
        """Puts it there."""


class Sight:
    """What one visitor sees of what all see, and what else."""

    def __init__(self, client: viser.ClientHandle, *, place: Place, wish: Callable[[Callable[[], None]], None]) -> None:
        """Nothing of its own yet.

        Args:
            client: the visitor's browser.
            place: called when the visitor has put a body somewhere, in a thread of the server's.
            wish: has something done by the thread that may call this.
        """
        self.visitor = client.client_id
        self.selected: BodyId | None = None
        self._client, self._scene, self._place, self._wish = client, client.scene, place, wish
        self._looks: Mapping[BodyId, Look] = {}
        self._names: Mapping[BodyId, str] = {}
        self._rows: dict[BodyId, int] = {}
        self._poses: Array = np.zeros((0, 7))
        self._outlook: Outlook | None = None
        self._flight: tuple[float, View, View] | None = None
        self._frame: viser.LineSegmentsHandle | None = None
        self._labels, self._labelled = Labels.NONE, dict[BodyId, viser.LabelHandle]()
        self._ghosts: dict[BodyId, viser.MeshHandle] = {}
        self._cut: viser.FrameHandle | None = None
        self._mode: GizmoMode | None = None
        self._handles: viser.TransformControlsHandle | None = None
        self._dragging = False

    # -- what is there -------------------------------------------------------------------------------------------------

    def know(
        self, looks: Mapping[BodyId, Look], names: Mapping[BodyId, str], ids: tuple[BodyId, ...], poses: Array
    ) -> bool:
        """What is there now; tells whether the selected body has gone."""
        changed = [id for id in self._looks if looks.get(id) != self._looks[id]]
        self._looks, self._names, self._poses = dict(looks), names, poses
        self._rows = {id: row for row, id in enumerate(ids)}
        for id in changed:
            self.ghost(id, None)
        selected = self.selected
        gone = selected is not None and selected not in looks
        if gone or selected in changed:
            self.select(None)
            if selected is not None and not gone:
                self.select(selected)
        else:
            self._write()
        self.follow(poses)
        return gone

    def follow(self, poses: Array) -> None:
        """Moves what is drawn at a body with it."""
        self._poses = poses
        if self._frame is not None and self.selected in self._rows:
            self._frame.position, self._frame.wxyz = self._pose(self.selected)
        if self._handles is not None and not self._dragging and self.selected in self._rows:
            self._handles.position, self._handles.wxyz = self._pose(self.selected)
        for id, label in self._labelled.items():
            label.position = self._above(id)

    # -- marks ---------------------------------------------------------------------------------------------------------

    def select(self, id: BodyId | None) -> bool:
        """Draws a frame round a body, and round no other; tells whether that is news."""
        if id == self.selected or (id is not None and id not in self._rows):
            return False
        self.selected = id
        if self._frame is not None:
            self._frame.remove()
            self._frame = None
        if id is not None:
            position, turn = self._pose(id)
            self._frame = self._scene.add_line_segments(
                "/selected",
                box_edges(self._looks[id].size, margin=0.004),
                _ACCENT,
                thickness=2.5,
                thickness_units="screen",
                position=position,
                wxyz=turn,
            )
        self._write()
        self.gizmo(self._mode)
        return True

    def label(self, labels: Labels) -> None:
        """Writes names beside bodies."""
        self._labels = labels
        self._write()

    def ghost(self, id: BodyId, pose: Pose | None) -> None:
        """Draws a body a second time, at another pose; None takes that away."""
        ghost = self._ghosts.pop(id, None)
        if pose is None or id not in self._looks:
            if ghost is not None:
                ghost.remove()
            return
        row = unit_pose(pose)
        if ghost is None:
            mesh = mesh_of(self._looks[id].skins)
            ghost = self._scene.add_mesh_simple(
                f"/ghosts/{quote(id, safe='')}",
                mesh.points.astype(np.float32),
                mesh.faces,
                color=_ACCENT,
                opacity=_GHOST_OPACITY,
                cast_shadow=False,
                receive_shadow=False,
            )
        ghost.position, ghost.wxyz = row[:3], row[3:]
        self._ghosts[id] = ghost

    def gizmo(self, mode: GizmoMode | None) -> None:
        """Gives the selected body handles, or takes them away; a ghost shows where it will be put."""
        self._mode, self._dragging = mode, False
        if self._handles is not None:
            self._handles.remove()
            self._handles = None
        id = self.selected
        if mode is None or id is None:
            return
        position, turn = self._pose(id)
        self._handles = self._scene.add_transform_controls(
            "/gizmo",
            scale=max(0.25, 0.9 * max(self._looks[id].size)),
            disable_axes=mode is not GizmoMode.MOVE,
            disable_sliders=mode is not GizmoMode.MOVE,
            disable_rotations=mode is not GizmoMode.TURN,
            depth_test=False,
            position=position,
            wxyz=turn,
        )
        self._handles.on_update(lambda event: self._drag(id, event))

    def _drag(self, id: BodyId, event: viser.TransformControlsEvent) -> None:
        """In a thread of the server's."""
        pose = pose_from(np.concatenate([event.target.position, unit(event.target.wxyz)]))
        self._dragging = event.phase != "end"
        self._wish(lambda: self.ghost(id, None if event.phase == "end" else pose))
        if event.phase == "end":
            self._place(self.visitor, id, pose)

    def _write(self) -> None:
        """The labels that are wanted, and no others."""
        wanted = dict.fromkeys(self._wanted_labels())
        for id in self._labelled.keys() - wanted.keys():
            self._labelled.pop(id).remove()
        for id in wanted:
            if id not in self._labelled:
                name = f"/labels/{quote(id, safe='')}"
                self._labelled[id] = self._scene.add_label(
                    name, self._names.get(id, id), anchor="bottom-center", position=self._above(id)
                )

    def _wanted_labels(self) -> list[BodyId]:
        match self._labels:
            case Labels.ALL:
                sizes = {id: max(look.size) for id, look in self._looks.items() if id in self._rows}
                return sorted(sizes, key=lambda each: -sizes[each])[:_MOST_LABELS]
            case Labels.CLASS if self.selected is not None:
                name = self._names.get(self.selected)
                return [id for id in self._rows if self._names.get(id) == name][:_MOST_LABELS]
            case Labels.SELECTED if self.selected is not None:
                return [self.selected]
            case _:
                return []

    # -- the camera ----------------------------------------------------------------------------------------------------

    def open_on(self, outlook: Outlook) -> None:
        """Takes the visitor to where visitors stand at first."""
        self._outlook = outlook
        self.look_from(outlook.view(self._aspect))

    def home(self) -> None:
        """Flies back there."""
        if self._outlook is not None:
            self._fly_to(self._outlook.view(self._aspect))

    def top(self) -> None:
        """Flies to where one looks straight down."""
        if self._outlook is not None:
            self._fly_to(self._outlook.top(self._aspect))

    def focus(self, ids: tuple[BodyId, ...]) -> None:
        """Flies to bodies; to all, where none is named."""
        rows = [self._rows[id] for id in ids if id in self._rows]
        if not rows:
            self.home()
            return
        sizes = np.array([self._looks[id].size for id in ids if id in self._rows])
        points = corners(self._poses[rows], np.maximum(sizes, _CLOSEST_M))
        camera = self._client.camera
        eye, look_at = _vector(camera.position), _vector(camera.look_at)
        self._fly_to(focus_view(points, eye, look_at, self._aspect))

    def look_from(self, view: View) -> None:
        """Is there at once."""
        self._flight = None
        self._stand(view)

    def section(self, height: float | None) -> None:
        """Tells the page to hide what is above a height [m]; None to hide nothing."""
        if self._cut is not None:
            self._cut.remove()
            self._cut = None
        if height is not None:
            self._cut = self._scene.add_frame(
                "/clipping_plane", show_axes=False, position=(0.0, 0.0, height), visible=False
            )

    def fly(self) -> None:
        """A little farther, where the camera is on its way."""
        if self._flight is None:
            return
        start, origin, goal = self._flight
        done = min((time.monotonic() - start) / _FLIGHT_S, 1.0)
        eased = done * done * (3.0 - 2.0 * done)
        position, look_at = (
            _vector((1.0 - eased) * np.array(a) + eased * np.array(b))
            for a, b in ((origin.position, goal.position), (origin.look_at, goal.look_at))
        )
        self._stand(View(position, look_at, goal.field_of_view_rad))
        if done >= 1.0:
            self._flight = None

    @property
    def _aspect(self) -> float:
        return float(np.clip(self._client.camera.aspect, 0.2, 5.0))

    def _fly_to(self, view: View) -> None:
        camera = self._client.camera
        origin = View(_vector(camera.position), _vector(camera.look_at), camera.fov)
        self._flight = time.monotonic(), origin, view

    def _stand(self, view: View) -> None:
        camera = self._client.camera
        with self._client.atomic():
            camera.position, camera.look_at, camera.fov = view.position, view.look_at, view.field_of_view_rad

    # -- where things are ----------------------------------------------------------------------------------------------

    def _pose(self, id: BodyId) -> tuple[Array, Array]:
        row = self._poses[self._rows[id]]
        return row[:3], unit(row[3:])

    def _above(self, id: BodyId) -> Vector:
        """Where the name of a body is written: over the middle of it."""
        row = self._poses[self._rows[id]]
        top = corners(row[None], np.array([self._looks[id].size]))[:, 2].max()
        return float(row[0]), float(row[1]), float(top) + 0.02


def _vector(array: Array) -> Vector:
    x, y, z = np.asarray(array, dtype=float).tolist()
    return x, y, z
