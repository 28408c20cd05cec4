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

from mindstage.viewport.framing import CameraPose, FramingTarget, corners, focus_camera
from mindstage.viewport.glb import merge_visuals
from mindstage.viewport.looks import BodyAppearance
from mindstage.world import BodyId, Pose, Vector
from mindstage.world.geometry import Array, normalize, normalized_pose_array, pose_from_array
from mindstage.world.meshes import box_edges

__all__ = ["ClientView", "GizmoMode", "LabelMode", "PlaceCallback"]

_ACCENT = (232, 93, 4)
_PREVIEW_OPACITY = 0.35
_CAMERA_MOVE_S = 0.6
_MAX_LABELS = 300
"""More than that nobody reads, and no browser draws with ease: the largest bodies have theirs."""
_MIN_FOCUS_SIZE_M = 0.25
"""What is smaller is looked at from no nearer than if it were so large."""


class LabelMode(StrEnum):
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


class PlaceCallback(Protocol):
    """Called when a visitor has put a body somewhere."""

    def __call__(self, visitor: int, id: BodyId, pose: Pose) -> None:
        """Puts it there."""


class ClientView:
    """What one visitor sees of what all see, and what else."""

    def __init__(
        self, client: viser.ClientHandle, *, on_place: PlaceCallback, enqueue: Callable[[Callable[[], None]], None]
    ) -> None:
        """Nothing of its own yet.

        Args:
            client: the visitor's browser.
            place: called when the visitor has put a body somewhere, in a thread of the server's.
            wish: has something done by the thread that may call this.
        """
        self.client_id = client.client_id
        self.selected: BodyId | None = None
        self._client, self._scene, self._on_place, self._enqueue = client, client.scene, on_place, enqueue
        self._appearances: Mapping[BodyId, BodyAppearance] = {}
        self._names: Mapping[BodyId, str] = {}
        self._rows: dict[BodyId, int] = {}
        self._poses: Array = np.zeros((0, 7))
        self._target: FramingTarget | None = None
        self._camera_move: tuple[float, CameraPose, CameraPose] | None = None
        self._selection_box: viser.LineSegmentsHandle | None = None
        self._labels, self._label_nodes = LabelMode.NONE, dict[BodyId, viser.LabelHandle]()
        self._previews: dict[BodyId, viser.MeshHandle] = {}
        self._clip_height: viser.FrameHandle | None = None
        self._mode: GizmoMode | None = None
        self._gizmo: viser.TransformControlsHandle | None = None
        self._dragging = False

    # -- what is there -------------------------------------------------------------------------------------------------

    def set_bodies(
        self,
        appearances: Mapping[BodyId, BodyAppearance],
        names: Mapping[BodyId, str],
        ids: tuple[BodyId, ...],
        poses: Array,
    ) -> bool:
        """What is there now; tells whether the selected body has gone."""
        changed = [id for id in self._appearances if appearances.get(id) != self._appearances[id]]
        self._appearances, self._names, self._poses = dict(appearances), names, poses
        self._rows = {id: row for row, id in enumerate(ids)}
        for id in changed:
            self.show_preview(id, None)
        selected = self.selected
        gone = selected is not None and selected not in appearances
        if gone or selected in changed:
            self.select(None)
            if selected is not None and not gone:
                self.select(selected)
        else:
            self._update_labels()
        self.update_poses(poses)
        return gone

    def update_poses(self, poses: Array) -> None:
        """Moves what is drawn at a body with it."""
        self._poses = poses
        if self._selection_box is not None and self.selected in self._rows:
            self._selection_box.position, self._selection_box.wxyz = self._pose(self.selected)
        if self._gizmo is not None and not self._dragging and self.selected in self._rows:
            self._gizmo.position, self._gizmo.wxyz = self._pose(self.selected)
        for id, label in self._label_nodes.items():
            label.position = self._label_position(id)

    # -- marks ---------------------------------------------------------------------------------------------------------

    def select(self, id: BodyId | None) -> bool:
        """Draws a frame round a body, and round no other; tells whether that is news."""
        if id == self.selected or (id is not None and id not in self._rows):
            return False
        self.selected = id
        if self._selection_box is not None:
            self._selection_box.remove()
            self._selection_box = None
        if id is not None:
            position, turn = self._pose(id)
            self._selection_box = self._scene.add_line_segments(
                "/selected",
                box_edges(self._appearances[id].size, margin=0.004),
                _ACCENT,
                thickness=2.5,
                thickness_units="screen",
                position=position,
                wxyz=turn,
            )
        self._update_labels()
        self.set_gizmo(self._mode)
        return True

    def set_labels(self, labels: LabelMode) -> None:
        """Writes names beside bodies."""
        self._labels = labels
        self._update_labels()

    def show_preview(self, id: BodyId, pose: Pose | None) -> None:
        """Draws a body a second time, at another pose; None takes that away."""
        ghost = self._previews.pop(id, None)
        if pose is None or id not in self._appearances:
            if ghost is not None:
                ghost.remove()
            return
        row = normalized_pose_array(pose)
        if ghost is None:
            mesh = merge_visuals(self._appearances[id].visuals)
            ghost = self._scene.add_mesh_simple(
                f"/ghosts/{quote(id, safe='')}",
                mesh.points.astype(np.float32),
                mesh.faces,
                color=_ACCENT,
                opacity=_PREVIEW_OPACITY,
                cast_shadow=False,
                receive_shadow=False,
            )
        ghost.position, ghost.wxyz = row[:3], row[3:]
        self._previews[id] = ghost

    def set_gizmo(self, mode: GizmoMode | None) -> None:
        """Gives the selected body handles, or takes them away; a ghost shows where it will be put."""
        self._mode, self._dragging = mode, False
        if self._gizmo is not None:
            self._gizmo.remove()
            self._gizmo = None
        id = self.selected
        if mode is None or id is None:
            return
        position, turn = self._pose(id)
        self._gizmo = self._scene.add_transform_controls(
            "/gizmo",
            scale=max(0.25, 0.9 * max(self._appearances[id].size)),
            disable_axes=mode is not GizmoMode.MOVE,
            disable_sliders=mode is not GizmoMode.MOVE,
            disable_rotations=mode is not GizmoMode.TURN,
            depth_test=False,
            position=position,
            wxyz=turn,
        )
        self._gizmo.on_update(lambda event: self._drag(id, event))

    def _drag(self, id: BodyId, event: viser.TransformControlsEvent) -> None:
        """In a thread of the server's."""
        pose = pose_from_array(np.concatenate([event.target.position, normalize(event.target.wxyz)]))
        self._dragging = event.phase != "end"
        self._enqueue(lambda: self.show_preview(id, None if event.phase == "end" else pose))
        if event.phase == "end":
            self._on_place(self.client_id, id, pose)

    def _update_labels(self) -> None:
        """The labels that are wanted, and no others."""
        wanted = dict.fromkeys(self._wanted_labels())
        for id in self._label_nodes.keys() - wanted.keys():
            self._label_nodes.pop(id).remove()
        for id in wanted:
            if id not in self._label_nodes:
                name = f"/labels/{quote(id, safe='')}"
                self._label_nodes[id] = self._scene.add_label(
                    name, self._names.get(id, id), anchor="bottom-center", position=self._label_position(id)
                )

    def _wanted_labels(self) -> list[BodyId]:
        match self._labels:
            case LabelMode.ALL:
                sizes = {id: max(look.size) for id, look in self._appearances.items() if id in self._rows}
                return sorted(sizes, key=lambda each: -sizes[each])[:_MAX_LABELS]
            case LabelMode.CLASS if self.selected is not None:
                name = self._names.get(self.selected)
                return [id for id in self._rows if self._names.get(id) == name][:_MAX_LABELS]
            case LabelMode.SELECTED if self.selected is not None:
                return [self.selected]
            case _:
                return []

    # -- the camera ----------------------------------------------------------------------------------------------------

    def set_target(self, outlook: FramingTarget) -> None:
        """Takes the visitor to where visitors stand at first."""
        self._target = outlook
        self.set_camera(outlook.camera(self._aspect))

    def go_home(self) -> None:
        """Flies back there."""
        if self._target is not None:
            self._move_camera(self._target.camera(self._aspect))

    def go_top(self) -> None:
        """Flies to where one looks straight down."""
        if self._target is not None:
            self._move_camera(self._target.top_camera(self._aspect))

    def focus(self, ids: tuple[BodyId, ...]) -> None:
        """Flies to bodies; to all, where none is named."""
        rows = [self._rows[id] for id in ids if id in self._rows]
        if not rows:
            self.go_home()
            return
        sizes = np.array([self._appearances[id].size for id in ids if id in self._rows])
        points = corners(self._poses[rows], np.maximum(sizes, _MIN_FOCUS_SIZE_M))
        camera = self._client.camera
        eye, look_at = _vector(camera.position), _vector(camera.look_at)
        self._move_camera(focus_camera(points, eye, look_at, self._aspect))

    def set_camera(self, camera_pose: CameraPose) -> None:
        """Is there at once."""
        self._camera_move = None
        self._set_camera(camera_pose)

    def set_clip_height(self, height: float | None) -> None:
        """Tells the page to hide what is above a height [m]; None to hide nothing."""
        if self._clip_height is not None:
            self._clip_height.remove()
            self._clip_height = None
        if height is not None:
            self._clip_height = self._scene.add_frame(
                "/clipping_plane", show_axes=False, position=(0.0, 0.0, height), visible=False
            )

    def step_camera(self) -> None:
        """A little farther, where the camera is on its way."""
        if self._camera_move is None:
            return
        start, origin, goal = self._camera_move
        done = min((time.monotonic() - start) / _CAMERA_MOVE_S, 1.0)
        eased = done * done * (3.0 - 2.0 * done)
        position, look_at = (
            _vector((1.0 - eased) * np.array(a) + eased * np.array(b))
            for a, b in ((origin.position, goal.position), (origin.look_at, goal.look_at))
        )
        self._set_camera(CameraPose(position, look_at, goal.field_of_view_rad))
        if done >= 1.0:
            self._camera_move = None

    @property
    def _aspect(self) -> float:
        return float(np.clip(self._client.camera.aspect, 0.2, 5.0))

    def _move_camera(self, camera_pose: CameraPose) -> None:
        camera = self._client.camera
        origin = CameraPose(_vector(camera.position), _vector(camera.look_at), camera.fov)
        self._camera_move = time.monotonic(), origin, camera_pose

    def _set_camera(self, camera_pose: CameraPose) -> None:
        camera = self._client.camera
        with self._client.atomic():
            camera.position, camera.look_at, camera.fov = (
                camera_pose.position,
                camera_pose.look_at,
                camera_pose.field_of_view_rad,
            )

    # -- where things are ----------------------------------------------------------------------------------------------

    def _pose(self, id: BodyId) -> tuple[Array, Array]:
        row = self._poses[self._rows[id]]
        return row[:3], normalize(row[3:])

    def _label_position(self, id: BodyId) -> Vector:
        """Where the name of a body is written: over the middle of it."""
        row = self._poses[self._rows[id]]
        top = corners(row[None], np.array([self._appearances[id].size]))[:, 2].max()
        return float(row[0]), float(row[1]), float(top) + 0.02


def _vector(array: Array) -> Vector:
    x, y, z = np.asarray(array, dtype=float).tolist()
    return x, y, z
