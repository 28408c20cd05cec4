"""The views of clients: camera, selection box, labels, previews and gizmo.

Methods of `ClientViews` may be called from any thread; they enqueue actions, which the drawing thread executes at its
next update. A client is identified by the id of viser's connection.
"""

from __future__ import annotations

import logging
import threading
import time
import warnings
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from enum import StrEnum
from queue import Empty, SimpleQueue
from typing import Protocol
from urllib.parse import quote

import msgspec
import numpy as np
import viser
from numpy.typing import NDArray

from mindstage.access.limits import LABELS
from mindstage.errors import BodyNotFoundError
from mindstage.rendering.appearance import BodyAppearance, merge_visuals
from mindstage.rendering.camera import (
    CameraPose,
    FramingTarget,
    corners,
    focus_camera,
)
from mindstage.rendering.render_scene import find_culled
from mindstage.rendering.screenshot import LabelMode
from mindstage.scene import BodyId, Pose, Vector, VisualMesh, World
from mindstage.scene.colors import srgb_to_linear
from mindstage.scene.mesh import box_edges
from mindstage.scene.transforms import (
    Array,
    normalize,
    normalized_pose_array,
    pose_from_array,
    pose_inverse,
    pose_multiply,
    quat_conjugate,
    quat_multiply,
    quat_rotate,
    rotation_matrix,
)
from mindstage.viewer.view_data import send_view_data

__all__ = [
    "ClientView",
    "ClientViews",
    "Ghost",
    "GizmoMode",
    "MountCulling",
    "PlaceCallback",
    "Snapping",
    "moved_with",
]


_ACCENT_COLOR = (232, 93, 4)
_PREVIEW_OPACITY = 0.35
_GHOST_OPACITY = 0.6
_FREE_COLOR, _BLOCKED_COLOR = (46, 150, 90), (205, 50, 40)
_PRECISION_FACTOR = 0.1
_SAME_CAMERA_M = 1e-3
_CAMERA_MOVE_S = 0.6
_SELECTED_COLORS = ((250, 160, 90), _ACCENT_COLOR)
"""Colors of the boxes of selected bodies: of the further ones, and of the one whose details are shown."""
_PART_COLOR = (222, 190, 168)
_BOX_EDGES = 12
_MIN_FOCUS_SIZE_M = 0.25
"""Smallest extent that the camera zooms to [m]."""
_IN_PICTURE = 0.92
"""Share of the picture around its center in which the center of a body counts as visible."""
_NOTICED_SIZE = 0.015
"""Size at which a body is noticed, as a share of the picture's height: about 10 pixels."""


def aspect_ratio(camera: viser.CameraHandle) -> float:
    """Width by height of a client's view, from 0.2 to 5; 1 if it has no height, as in a window that is not shown."""
    try:
        return float(np.clip(camera.aspect, 0.2, 5.0))
    except ZeroDivisionError:
        return 1.0


class GizmoMode(StrEnum):
    """What the gizmo at the selected body does."""

    MOVE = "move"
    TURN = "turn"


class Snapping(msgspec.Struct, frozen=True, kw_only=True):
    """How the gizmo rounds what it does."""

    step_m: float = 0.0
    """Positions are multiples of it along the axes of the world [m]; 0 does not round."""
    step_deg: float = 0.0
    """Turns are multiples of it [degrees]; 0 does not round."""
    to_surface: bool = False
    """Whether a moved body is put down on what is below it."""
    precise: bool = False
    """Whether the body moves by a tenth of the gizmo's motion, without rounding."""

    def apply(self, start: Pose, pose: Pose) -> Pose:
        """The rounded pose of a body that was at a start and is to be moved to a pose."""
        before, after = normalized_pose_array(start), normalized_pose_array(pose)
        offset, turn = after[:3] - before[:3], quat_multiply(after[3:], quat_conjugate(before[3:]))
        turn = turn if turn[0] >= 0.0 else -turn
        sine = float(np.linalg.norm(turn[1:]))
        angle = 2.0 * float(np.arctan2(sine, turn[0]))
        if self.precise:
            offset, angle = _PRECISION_FACTOR * offset, _PRECISION_FACTOR * angle
        else:
            if self.step_m > 0.0:
                moved = np.abs(offset) > 1e-6  # an axis along which the gizmo is not moved stays exactly as it is
                rounded = np.round((before[:3] + offset) / self.step_m) * self.step_m
                offset = np.where(moved, rounded - before[:3], 0.0)
            if self.step_deg > 0.0:
                angle = float(np.round(np.degrees(angle) / self.step_deg) * np.radians(self.step_deg))
        turn = np.concatenate([[np.cos(angle / 2)], turn[1:] / max(sine, 1e-12) * np.sin(angle / 2)])
        return pose_from_array(np.concatenate([before[:3] + offset, normalize(quat_multiply(turn, before[3:]))]))


class PlaceCallback(Protocol):
    """Called when a client has moved a body with the gizmo."""

    def __call__(self, client: int, id: BodyId, pose: Pose, *, to_surface: bool) -> None:
        """Moves the body, and the other selected ones with it.

        Args:
            pose: its new pose.
            to_surface: whether to put it down on what is below it.
        """


class Ghost(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A body that does not exist, for example one that is being dragged into the view."""

    key: str
    """Equal for ghosts with the same meshes."""
    visuals: tuple[VisualMesh, ...]
    pose: Pose
    is_free: bool
    """Whether it can be placed there."""


def moved_with(start: Pose, end: Pose, poses: Mapping[BodyId, Pose]) -> dict[BodyId, Pose]:
    """The poses of bodies that move rigidly with one that is moved from a start to an end."""
    change = pose_multiply(normalized_pose_array(end), pose_inverse(normalized_pose_array(start)))
    return {id: pose_from_array(pose_multiply(change, normalized_pose_array(pose))) for id, pose in poses.items()}


_MOVED_M = 0.02
"""How far a culled body moves before it is computed again what holds it [m]."""


class MountCulling:
    """Finds what would float in the air because the wall that it is mounted on is not drawn from where a camera is.

    Pages draw one side of walls, ceilings and doors in walls. What is culled therefore changes only when a camera or
    such a body passes through the plane of the other; results are kept by the sides on which the camera is.
    """

    def __init__(self, world: World, appearances: Mapping[BodyId, BodyAppearance], ids: Sequence[BodyId]) -> None:
        """Computes nothing yet.

        Args:
            world: the world, with what is attached and joined to what.
            appearances: how its bodies are drawn.
            ids: the bodies of the rows of poses.
        """
        self._world, self._appearances, self._ids = world, appearances, tuple(ids)
        sides = [(row, each.side) for row, id in enumerate(ids) if (each := appearances.get(id)) and each.side]
        self._rows = np.array([row for row, _ in sides], dtype=np.intp)
        self._axes = np.array([axis for _, (axis, _) in sides], dtype=np.intp)
        self._signs = np.array([sign for _, (_, sign) in sides], dtype=float)
        self._found: dict[bytes, tuple[frozenset[BodyId], NDArray[np.intp], Array]] = {}

    def find(self, eye: Array, poses: Array) -> frozenset[BodyId]:
        """The bodies that are not drawn, without the walls themselves.

        Args:
            eye: position of the camera [m].
            poses: the current poses, n x 7.
        """
        walls = poses[self._rows]
        normals = rotation_matrix(normalize(walls[:, 3:]))[np.arange(len(walls)), :, self._axes]
        is_behind = np.einsum("ij,ij->i", eye - walls[:, :3], normals) * self._signs < 0.0
        key = is_behind.tobytes()
        known = self._found.get(key)
        if known is None or np.abs(poses[known[1], :3] - known[2]).max(initial=0.0) > _MOVED_M:
            current = {id: pose_from_array(row) for id, row in zip(self._ids, poses, strict=True)}
            culled = find_culled(self._world, self._appearances, _vector(eye), poses=current)
            culled -= {self._ids[row] for row in self._rows[is_behind].tolist()}
            rows = np.array([row for row, id in enumerate(self._ids) if id in culled], dtype=np.intp)
            known = self._found[key] = culled, rows, poses[rows, :3].copy()
        return known[0]


class ClientView:
    """The view of one client, and the nodes drawn for it alone. Not thread-safe."""

    def __init__(
        self, client: viser.ClientHandle, *, on_place: PlaceCallback, enqueue: Callable[[Callable[[], None]], None]
    ) -> None:
        """Creates the view of a new client.

        Args:
            client: the connection of viser.
            on_place: called when the client has moved a body with the gizmo, in a thread of the server.
            enqueue: calls a function in the drawing thread.
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
        self._last_camera: CameraPose | None = None
        """The camera that was set last; the user may have moved it since."""
        self._further: tuple[BodyId, ...] = ()
        """Selected bodies besides `selected`."""
        self._parts: Mapping[BodyId, tuple[BodyId, ...]] = {}
        self._selection_lines: tuple[viser.LineSegmentsHandle, ...] = ()
        self._drawn_lines: Array = np.zeros((0, 2, 3))
        self._label_mode = LabelMode.NONE
        self._labeled: tuple[BodyId, ...] = ()
        self._label_texts: list[str] = []
        self._label_positions: NDArray[np.float32] = np.zeros((0, 3), np.float32)
        self._previews: dict[BodyId, viser.MeshHandle] = {}
        self._clip_height: viser.FrameHandle | None = None
        self._mode: GizmoMode | None = None
        self._gizmo: viser.TransformControlsHandle | None = None
        self._dragging = False
        self._drag_start: Pose | None = None
        self._snapping = Snapping()
        self._ghost: tuple[str, viser.MeshHandle] | None = None
        self._measurement: list[viser.SceneNodeHandle] = []
        self.clip_height: float | None = None
        self.culled: frozenset[BodyId] = frozenset()
        """The bodies that are not drawn because their wall is not."""
        self._sent_culled: Mapping[str, list[int]] = {}

    # -- bodies --------------------------------------------------------------------------------------------------------

    def set_bodies(
        self,
        appearances: Mapping[BodyId, BodyAppearance],
        names: Mapping[BodyId, str],
        ids: tuple[BodyId, ...],
        poses: Array,
        parts: Mapping[BodyId, tuple[BodyId, ...]],
    ) -> bool:
        """Sets the bodies and their poses; returns whether a selected body was removed.

        Args:
            appearances: how bodies are drawn.
            names: their labels.
            ids: the bodies of the rows of `poses`.
            poses: n x 7.
            parts: the parts of bodies, which are outlined with them.
        """
        changed = [id for id in self._appearances if appearances.get(id) != self._appearances[id]]
        self._appearances, self._names, self._poses, self._parts = dict(appearances), names, poses, parts
        self._rows = {id: row for row, id in enumerate(ids)}
        for id in changed:
            self.show_preview(id, None)
        selected = self.selection
        remaining = tuple(id for id in selected if id in appearances)
        if remaining != selected or not set(changed).isdisjoint(selected):
            self.select(())
            self.select(remaining)
        else:
            self._update_labels()
        self.update_poses(poses)
        return remaining != selected

    def update_poses(self, poses: Array) -> None:
        """Moves selection box, gizmo and labels to the poses of their bodies."""
        self._poses = poses
        self._outline_selection()
        if self._gizmo is not None and not self._dragging and self.selected in self._rows:
            self._gizmo.position, self._gizmo.wxyz = self._pose(self.selected)
        self._move_labels()

    def cull(
        self,
        culling: MountCulling,
        kept: Collection[BodyId],
        instances: Callable[[Iterable[BodyId]], Mapping[str, list[int]]],
    ) -> None:
        """Hides what would float from where the camera is.

        Args:
            culling: finds these bodies.
            kept: bodies that are drawn in any case.
            instances: returns the nodes that draw bodies.
        """
        selected = {part for id in self.selection for part in (id, *self._parts.get(id, ()))}
        culled = culling.find(np.asarray(self._client.camera.position, dtype=float), self._poses)
        culled = culled - selected - frozenset(kept)
        if culled != self.culled:
            self.culled = culled
            self._update_labels()
        nodes = instances(sorted(culled))
        if nodes != self._sent_culled:
            self._sent_culled = nodes
            send_view_data(self._scene, "culled", {"names": list(nodes), "instances": list(nodes.values())})

    # -- selection and labels ------------------------------------------------------------------------------------------

    @property
    def selection(self) -> tuple[BodyId, ...]:
        """All selected bodies; the last one is `selected`."""
        return self._further if self.selected is None else (*self._further, self.selected)

    def select(self, ids: Sequence[BodyId]) -> bool:
        """Selects bodies, the last of which has the gizmo and the details; returns whether the selection changed."""
        known = tuple(dict.fromkeys(id for id in ids if id in self._rows))
        if known == self.selection or (ids and not known):
            return False
        self._further, self.selected = known[:-1], known[-1] if known else None
        self._outline_selection()
        self._update_labels()
        self.set_gizmo(self._mode)
        return True

    def _outline_selection(self) -> None:
        """Draws the boxes of selected bodies and, faintly, of their parts; a second node is drawn through fronts."""
        boxes = [
            *((id, _SELECTED_COLORS[id == self.selected]) for id in self.selection),
            *((part, _PART_COLOR) for id in self.selection for part in self._parts.get(id, ()) if part in self._rows),
        ]
        if not boxes:
            for lines in self._selection_lines:
                lines.remove()
            self._selection_lines, self._drawn_lines = (), np.zeros((0, 2, 3))
            return
        segments = np.concatenate([self._box(id) for id, _ in boxes])
        if np.array_equal(segments, self._drawn_lines):
            return
        self._drawn_lines = segments
        linear = 255 * srgb_to_linear(np.array([color for _, color in boxes]) / 255)  # viser takes colors of points so
        colors = np.repeat(np.round(linear).astype(np.uint8), _BOX_EDGES * 2, axis=0).reshape(-1, 2, 3)
        if not self._selection_lines:
            self._selection_lines = tuple(
                self._scene.add_line_segments(name, segments, colors, thickness=thickness, thickness_units="screen")
                for name, thickness in (("/selected", 1.8), ("/selected_behind", 1.2))
            )
            return
        with self._client.atomic():
            for lines in self._selection_lines:
                lines.points, lines.colors = segments, colors

    def _box(self, id: BodyId) -> Array:
        """The edges of the box of a body in the world frame, 12 x 2 x 3 [m]."""
        position, wxyz = self._pose(id)
        edges = box_edges(self._appearances[id].size, margin=0.004)
        moved: Array = quat_rotate(wxyz, edges.reshape(-1, 3)) + position
        return moved.reshape(-1, 2, 3)

    def set_labels(self, labels: LabelMode) -> None:
        """Sets which bodies are labeled."""
        self._label_mode = labels
        self._update_labels()

    def show_preview(self, id: BodyId, pose: Pose | None) -> None:
        """Draws a transparent copy of a body at another pose; None removes it."""
        preview = self._previews.pop(id, None)
        if pose is None or id not in self._appearances:
            if preview is not None:
                preview.remove()
            return
        row = normalized_pose_array(pose)
        if preview is None:
            mesh = merge_visuals(self._appearances[id].visuals)
            preview = self._scene.add_mesh_simple(
                f"/previews/{quote(id, safe='')}",
                mesh.points.astype(np.float32),
                mesh.faces,
                color=_ACCENT_COLOR,
                opacity=_PREVIEW_OPACITY,
                cast_shadow=False,
                receive_shadow=False,
            )
        preview.position, preview.wxyz = row[:3], row[3:]
        self._previews[id] = preview

    def set_gizmo(self, mode: GizmoMode | None) -> None:
        """Shows the gizmo at the selected body, or removes it; while it is dragged, a preview shows the new pose."""
        self._mode, self._dragging = mode, False
        if self._gizmo is not None:
            self._gizmo.remove()
            self._gizmo = None
        id = self.selected
        if mode is None or id is None:
            return
        position, wxyz = self._pose(id)
        self._gizmo = self._scene.add_transform_controls(
            "/gizmo",
            scale=max(0.25, 0.9 * max(self._appearances[id].size)),
            disable_axes=mode is not GizmoMode.MOVE,
            disable_sliders=mode is not GizmoMode.MOVE,
            disable_rotations=mode is not GizmoMode.TURN,
            depth_test=False,
            position=position,
            wxyz=wxyz,
        )
        self._gizmo.on_update(lambda event: self._drag(id, event))

    def _drag(self, id: BodyId, event: viser.TransformControlsEvent) -> None:
        """Called in a thread of the server."""
        if self._drag_start is None:
            position, wxyz = self._pose(id)
            self._drag_start = pose_from_array(np.concatenate([position, wxyz]))
        start, snapping = self._drag_start, self._snapping
        pose = pose_from_array(np.concatenate([event.target.position, normalize(event.target.wxyz)]))
        pose = snapping.apply(start, pose)
        self._dragging = event.phase != "end"
        others = [each for each in self.selection if each != id]

        def preview() -> None:
            for each, moved in moved_with(start, pose, {each: self._pose_of(each) for each in (id, *others)}).items():
                self.show_preview(each, None if event.phase == "end" else moved)

        self._enqueue(preview)
        if event.phase == "end":
            self._drag_start = None
            self._on_place(self.client_id, id, pose, to_surface=snapping.to_surface)
            self._enqueue(lambda: self.set_gizmo(self._mode))  # it was left where the pointer was

    def _pose_of(self, id: BodyId) -> Pose:
        return pose_from_array(np.concatenate(self._pose(id)))

    def set_snapping(self, snapping: Snapping) -> None:
        """Sets how the gizmo rounds."""
        self._snapping = snapping

    # -- tools ---------------------------------------------------------------------------------------------------------

    def show_ghost(self, ghost: Ghost | None) -> None:
        """Draws a transparent body that does not exist, or removes it."""
        key = None if ghost is None else f"{ghost.key} {ghost.is_free}"
        if self._ghost is not None and self._ghost[0] != key:
            self._ghost[1].remove()
            self._ghost = None
        if ghost is None:
            return
        if self._ghost is None:
            mesh = merge_visuals(ghost.visuals)
            node = self._scene.add_mesh_simple(
                "/ghost",
                mesh.points.astype(np.float32),
                mesh.faces,
                color=_FREE_COLOR if ghost.is_free else _BLOCKED_COLOR,
                opacity=_GHOST_OPACITY,
                cast_shadow=False,
                receive_shadow=False,
            )
            self._ghost = (f"{ghost.key} {ghost.is_free}", node)
        row = normalized_pose_array(ghost.pose)
        self._ghost[1].position, self._ghost[1].wxyz = row[:3], row[3:]

    def show_measurement(self, points: tuple[Vector, ...], text: str) -> None:
        """Draws points with the line between them and a label; without points, removes them."""
        for node in self._measurement:
            node.remove()
        self._measurement = [
            self._scene.add_icosphere(f"/measurement/{row}", radius=0.012, color=_ACCENT_COLOR, position=point)
            for row, point in enumerate(points)
        ]
        if len(points) == 2:
            segment = np.array([points], dtype=np.float32)
            name = "/measurement/line"
            self._measurement.append(
                self._scene.add_line_segments(name, segment, _ACCENT_COLOR, thickness=2.5, thickness_units="screen")
            )
            middle = _vector(np.mean(points, axis=0))
            self._measurement.append(self._scene.add_label("/measurement/label", text, position=middle))

    def _update_labels(self) -> None:
        """Sends the labels by the current mode and selection; the page draws those that do not overlap."""
        wanted = tuple(self._wanted_labels())
        texts = [self._names.get(id, id) for id in wanted]
        if (wanted, texts) != (self._labeled, self._label_texts):
            self._labeled, self._label_texts = wanted, texts
            sizes = np.array([max(self._appearances[id].size) for id in wanted], np.float32)
            send_view_data(self._scene, "labels", {"ids": list(wanted), "texts": texts, "sizes": sizes})
            self._label_positions = np.zeros((0, 3), np.float32)
        self._move_labels()

    def _move_labels(self) -> None:
        """Sends the positions of the labels, above the centers of the bodies, if they have changed."""
        if not self._labeled:
            return
        poses = self._poses[[self._rows[id] for id in self._labeled]]
        sizes = np.array([self._appearances[id].size for id in self._labeled])
        tops = corners(poses, sizes).reshape(-1, 8, 3)[:, :, 2].max(axis=1) + 0.02
        positions = np.column_stack([poses[:, :2], tops]).astype(np.float32)
        if not np.array_equal(positions, self._label_positions):
            self._label_positions = positions
            send_view_data(self._scene, "labels", {"positions": positions})

    def _wanted_labels(self) -> list[BodyId]:
        drawn = [id for id in self._rows if id in self._appearances and id not in self.culled]
        match self._label_mode:
            case LabelMode.ALL:
                return sorted(drawn, key=lambda each: -max(self._appearances[each].size))[: LABELS.count]
            case LabelMode.CLASS if self.selected is not None:
                name = self._names.get(self.selected)
                return [id for id in drawn if self._names.get(id) == name][: LABELS.count]
            case LabelMode.SELECTED:
                return list(self.selection)
            case _:
                return []

    # -- the camera ----------------------------------------------------------------------------------------------------

    def set_target(self, target: FramingTarget) -> None:
        """Sets what the home view shows, and moves the camera there."""
        self._target = target
        self.set_camera(target.camera(self._aspect))

    def go_home(self) -> None:
        """Animates the camera to the home view."""
        if self._target is not None:
            self.move_camera(self._target.camera(self._aspect))

    def go_top(self) -> None:
        """Animates the camera to the view from above."""
        if self._target is not None:
            self.move_camera(self._target.top_camera(self._aspect))

    def focus(self, ids: tuple[BodyId, ...]) -> None:
        """Animates the camera to bodies; without any, to the home view."""
        rows = [self._rows[id] for id in ids if id in self._rows]
        if not rows:
            self.go_home()
            return
        sizes = np.array([self._appearances[id].size for id in ids if id in self._rows])
        points = corners(self._poses[rows], np.maximum(sizes, _MIN_FOCUS_SIZE_M))
        camera = self._client.camera
        eye, look_at = _vector(camera.position), _vector(camera.look_at)
        self.move_camera(focus_camera(points, eye, look_at, self._aspect))

    def sees_any(self, ids: Iterable[BodyId]) -> bool:
        """Whether one of the bodies is in the picture, and large enough to be noticed."""
        rows = [self._rows[id] for id in ids if id in self._rows]
        if not rows:
            return True
        camera = self._client.camera
        eye, look_at = np.array(camera.position), np.array(camera.look_at)
        ahead = normalize(look_at - eye)
        right = np.cross(ahead, [0.0, 0.0, 1.0])
        right = normalize(right) if right.any() else np.array([1.0, 0.0, 0.0])
        offsets = self._poses[rows, :3] - eye
        depth = offsets @ ahead  # without a picture behind the camera: nothing is smaller than a negative height
        half_height = depth * np.tan(camera.fov / 2)
        sizes = np.array([max(self._appearances[id].size) for id in ids if id in self._rows])
        aside = np.abs(offsets @ right) < _IN_PICTURE * half_height * self._aspect
        above = np.abs(offsets @ np.cross(right, ahead)) < _IN_PICTURE * half_height
        return bool(np.any(aside & above & (sizes > _NOTICED_SIZE * 2 * half_height)))

    def focus_points(self, points: tuple[Vector, ...]) -> None:
        """Animates the camera to points."""
        poses = np.concatenate([np.array(points), np.tile([1.0, 0.0, 0.0, 0.0], (len(points), 1))], axis=1)
        margins = np.full((len(points), 3), _MIN_FOCUS_SIZE_M)
        camera = self._client.camera
        eye, look_at = _vector(camera.position), _vector(camera.look_at)
        self.move_camera(focus_camera(corners(poses, margins), eye, look_at, self._aspect))

    def set_camera(self, camera_pose: CameraPose) -> None:
        """Sets the camera without animation."""
        self._camera_move = None
        self._set_camera(camera_pose)

    def set_clip_height(self, height: float | None) -> None:
        """Clips everything above a height [m]; None clips nothing."""
        self.clip_height = height
        if self._clip_height is not None:
            self._clip_height.remove()
            self._clip_height = None
        if height is not None:
            self._clip_height = self._scene.add_frame(
                "/clipping_plane", show_axes=False, position=(0.0, 0.0, height), visible=False
            )

    def undo_initial_camera(self, initial: Vector) -> None:
        """Sets the camera again if the client has moved it to the initial position of the server.

        A client of viser does so some time after it connected, and so may lose a camera that was set before.

        Args:
            initial: the initial position [m].
        """
        if (last := self._last_camera) is None:
            return
        positions = self._client.camera.position, last.position
        is_there, is_wanted = (np.allclose(each, initial, atol=_SAME_CAMERA_M) for each in positions)
        if is_there and not is_wanted:
            self._set_camera(last)

    def step_camera(self) -> None:
        """Advances the animation of the camera."""
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
        return aspect_ratio(self._client.camera)

    def move_camera(self, camera_pose: CameraPose) -> None:
        """Animates the camera to a pose."""
        camera = self._client.camera
        origin = CameraPose(_vector(camera.position), _vector(camera.look_at), camera.fov)
        self._camera_move = time.monotonic(), origin, camera_pose

    def _set_camera(self, camera_pose: CameraPose) -> None:
        camera, self._last_camera = self._client.camera, camera_pose
        with self._client.atomic():
            camera.position, camera.look_at, camera.fov = (
                camera_pose.position,
                camera_pose.look_at,
                camera_pose.field_of_view_rad,
            )

    # -- poses ---------------------------------------------------------------------------------------------------------

    def _pose(self, id: BodyId) -> tuple[Array, Array]:
        row = self._poses[self._rows[id]]
        return row[:3], normalize(row[3:])


def _vector(array: Array) -> Vector:
    x, y, z = np.asarray(array, dtype=float).tolist()
    return x, y, z


_log = logging.getLogger(__name__)


class ClientViews:
    """The views of all clients. Without `client`, methods apply to all clients, later ones included."""

    def __init__(
        self,
        server: viser.ViserServer,
        *,
        on_place: PlaceCallback,
        instances: Callable[[Iterable[BodyId]], Mapping[str, list[int]]] = lambda ids: {},
    ) -> None:
        """Registers for connections of clients.

        Args:
            server: the server that clients connect to.
            on_place: called when a client has moved a body with the gizmo.
            instances: returns the names of the nodes that draw bodies and, of nodes with instances, which of them.
        """
        self._on_place, self._instances = on_place, instances
        self._culling: MountCulling | None = None
        self._highlighted: frozenset[BodyId] = frozenset()
        self._queue: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._views: dict[int, ClientView] = {}
        self._defaults: dict[str, Callable[[ClientView], None]] = {}
        """Actions applied to new clients, by setting."""
        self._listeners: list[Callable[[int], None]] = []
        self._names: Mapping[BodyId, str] = {}
        self._appearances: Mapping[BodyId, BodyAppearance] = {}
        self._ids: tuple[BodyId, ...] = ()
        self._poses: Array | None = None
        self._parts: Mapping[BodyId, tuple[BodyId, ...]] = {}
        self._target: FramingTarget | None = None
        self._hidden: frozenset[BodyId] = frozenset()
        self._hidden_lock = threading.Lock()
        self._enclosures_shown = True
        # A tab may be closed between two updates.
        warnings.filterwarnings("ignore", message=".* on a closed connection", category=UserWarning)
        server.on_client_connect(lambda client: self._enqueue(lambda: self._on_connect(client, server)))
        server.on_client_disconnect(lambda client: self._enqueue(lambda: self._on_disconnect(client)))

    # -- requests from any thread --------------------------------------------------------------------------------------

    @property
    def clients(self) -> tuple[int, ...]:
        """The connected clients."""
        return tuple(self._views)

    def on_change(self, listener: Callable[[int], None]) -> None:
        """Registers a callback for clients whose selection has changed."""
        self._listeners.append(listener)

    def selected(self, client: int) -> BodyId | None:
        """The selected body of a client; of several, the one selected last."""
        view = self._views.get(client)
        return view.selected if view is not None else None

    def selection(self, client: int) -> tuple[BodyId, ...]:
        """All selected bodies of a client; the last one is `selected`."""
        view = self._views.get(client)
        return view.selection if view is not None else ()

    def select(self, id: BodyId | None, *, client: int | None = None) -> None:
        """Selects a body; None selects nothing.

        Raises:
            BodyNotFoundError: there is no such body.
        """
        self.select_several([] if id is None else [id], client=client)

    def select_several(self, ids: Iterable[BodyId], *, client: int | None = None) -> None:
        """Selects bodies; the last one has the gizmo, and its details are shown.

        Raises:
            BodyNotFoundError: one of them does not exist.
        """
        bodies = tuple(ids)
        self._require_bodies(bodies)

        def select_in(view: ClientView) -> None:
            if view.select(bodies):
                self._notify(view.client_id)

        self._request("select", select_in, client)

    def focus(self, ids: Iterable[BodyId] = (), *, client: int | None = None) -> None:
        """Animates the camera to bodies; without any, to the home view.

        Raises:
            BodyNotFoundError: one of them does not exist.
        """
        bodies = tuple(ids)
        self._require_bodies(bodies)
        self._request(None, lambda view: view.focus(bodies), client)

    def focus_points(self, points: Iterable[Vector], *, client: int | None = None) -> None:
        """Animates the camera to points [m]; without any, it stays."""
        if shown := tuple(points):
            self._request(None, lambda view: view.focus_points(shown), client)

    def go_home(self, *, client: int | None = None) -> None:
        """Animates the camera to the home view."""
        self._request(None, lambda view: view.go_home(), client)

    def go_top(self, *, client: int | None = None) -> None:
        """Animates the camera to the view from above."""
        self._request(None, lambda view: view.go_top(), client)

    def set_camera(self, camera_pose: CameraPose, *, client: int | None = None) -> None:
        """Sets the camera without animation."""
        self._request("view", lambda view: view.set_camera(camera_pose), client)

    def set_clip_height(self, height: float | None, *, client: int | None = None) -> None:
        """Clips everything above a height [m], to show rooms from above; None clips nothing."""
        self._request("section", lambda view: view.set_clip_height(height), client)

    def set_labels(self, labels: LabelMode, *, client: int | None = None) -> None:
        """Sets which bodies are labeled."""
        self._request("labels", lambda view: view.set_labels(labels), client)

    def show_preview(self, id: BodyId, pose: Pose | None, *, client: int | None = None) -> None:
        """Draws a transparent copy of a body at another pose; None removes it.

        Raises:
            BodyNotFoundError: there is no such body.
        """
        self._require_bodies([id])
        self._request(f"preview {id}", lambda view: view.show_preview(id, pose), client)

    def set_gizmo(self, mode: GizmoMode | None, *, client: int | None = None) -> None:
        """Shows the gizmo at the selected body; None removes it."""
        self._request("gizmo", lambda view: view.set_gizmo(mode), client)

    def set_snapping(self, snapping: Snapping, *, client: int | None = None) -> None:
        """Sets how the gizmo rounds."""
        self._request("snapping", lambda view: view.set_snapping(snapping), client)

    def move_camera(self, camera_pose: CameraPose, *, client: int | None = None) -> None:
        """Animates the camera to a pose."""
        self._request(None, lambda view: view.move_camera(camera_pose), client)

    def show_ghost(self, ghost: Ghost | None, *, client: int | None = None) -> None:
        """Draws a transparent body that does not exist, or removes it."""
        self._request(None, lambda view: view.show_ghost(ghost), client)

    def show_measurement(self, points: tuple[Vector, ...], text: str, *, client: int | None = None) -> None:
        """Draws points with the line between them and a label; without points, removes them."""
        self._request(None, lambda view: view.show_measurement(points, text), client)

    @property
    def appearances(self) -> Mapping[BodyId, BodyAppearance]:
        """How the bodies are drawn."""
        return self._appearances

    def clip_height(self, client: int) -> float | None:
        """The height above which a client sees nothing [m]; None without one."""
        view = self._views.get(client)
        return None if view is None else view.clip_height

    def culled(self, client: int) -> frozenset[BodyId]:
        """The bodies that a client does not see because the wall that they are mounted on is not drawn."""
        view = self._views.get(client)
        return frozenset() if view is None else view.culled

    @property
    def is_drawn(self) -> bool:
        """Whether the scene was drawn at least once, even if it is empty."""
        return self._poses is not None

    @property
    def target(self) -> FramingTarget | None:
        """The home view; None while the scene is empty."""
        return self._target

    @property
    def hidden(self) -> frozenset[BodyId]:
        """The hidden bodies."""
        return self._hidden

    def show_bodies(self, ids: Iterable[BodyId], shown: bool) -> None:
        """Hides bodies for all clients, or shows them again.

        Raises:
            BodyNotFoundError: one of them does not exist.
        """
        bodies = frozenset(ids)
        self._require_bodies(bodies)
        with self._hidden_lock:
            self._hidden = self._hidden - bodies if shown else self._hidden | bodies

    @property
    def enclosures_shown(self) -> bool:
        """Whether the outlines of enclosing bodies are drawn."""
        return self._enclosures_shown

    def show_enclosures(self, shown: bool) -> None:
        """Shows or hides the outlines of enclosing bodies, for all clients."""
        self._enclosures_shown = shown

    # -- for the drawing thread ----------------------------------------------------------------------------------------

    def set_bodies(
        self,
        appearances: Mapping[BodyId, BodyAppearance],
        names: Mapping[BodyId, str],
        ids: tuple[BodyId, ...],
        poses: Array,
        *,
        parts: Mapping[BodyId, tuple[BodyId, ...]] | None = None,
        culling: MountCulling | None = None,
    ) -> None:
        """Sets the bodies and their poses.

        Args:
            appearances: how bodies are drawn.
            names: their labels.
            ids: the bodies of the rows of `poses`.
            poses: n x 7.
            parts: the parts of bodies, which are outlined with them.
            culling: finds what would float beside walls that are not drawn; by default nothing.
        """
        self._appearances, self._names, self._ids, self._poses = appearances, names, ids, poses
        self._culling = culling
        self._parts = parts or {}
        with self._hidden_lock:
            self._hidden &= appearances.keys()
        for view in self._views.values():
            if view.set_bodies(appearances, names, ids, poses, self._parts):
                self._notify(view.client_id)

    def set_target(self, target: FramingTarget) -> None:
        """Sets what the home view shows, and moves all cameras there."""
        self._target = target
        for view in self._views.values():
            view.set_target(target)

    def set_highlighted(self, ids: Iterable[BodyId]) -> None:
        """Sets the highlighted bodies, which are drawn although their wall is not."""
        self._highlighted = frozenset(ids)

    def clients_not_seeing(self, ids: Collection[BodyId]) -> tuple[int, ...]:
        """The clients in whose picture none of these bodies is noticed."""
        return tuple(client for client, view in self._views.items() if not view.sees_any(ids))

    def update_poses(self, poses: Array) -> None:
        """Moves selection box, gizmo and labels to the poses of their bodies."""
        self._poses = poses
        for view in self._views.values():
            view.update_poses(poses)

    def process_queue(self) -> None:
        """Executes the enqueued actions, and advances camera animations."""
        while True:
            try:
                action = self._queue.get_nowait()
            except Empty:
                break
            action()
        for view in self._views.values():
            view.step_camera()
            if self._culling is not None:
                view.cull(self._culling, self._highlighted, self._instances)

    # -- internals -----------------------------------------------------------------------------------------------------

    def _enqueue(self, action: Callable[[], None]) -> None:
        self._queue.put(action)

    def _request(self, setting: str | None, action: Callable[[ClientView], None], client: int | None) -> None:
        def apply() -> None:
            if client is not None:
                if (view := self._views.get(client)) is not None:  # a tab may be closed at any time
                    action(view)
                return
            if setting is not None:
                self._defaults[setting] = action
            for view in self._views.values():
                action(view)

        self._enqueue(apply)

    def _require_bodies(self, ids: Iterable[BodyId]) -> None:
        for id in ids:
            if id not in self._appearances:
                raise BodyNotFoundError(id, world="the view", known=self._appearances)

    def _on_connect(self, client: viser.ClientHandle, server: viser.ViserServer) -> None:
        view = self._views[client.client_id] = ClientView(client, on_place=self._on_place, enqueue=self._enqueue)
        if self._poses is not None:
            view.set_bodies(self._appearances, self._names, self._ids, self._poses, self._parts)
        if self._target is not None:
            view.set_target(self._target)
        for action in self._defaults.values():
            action(view)
        client.camera.on_update(
            lambda _: self._enqueue(lambda: view.undo_initial_camera(_vector(server.initial_camera.position)))
        )

    def _on_disconnect(self, client: viser.ClientHandle) -> None:
        self._views.pop(client.client_id, None)

    def _notify(self, client: int) -> None:
        for listener in self._listeners:
            try:
                listener(client)
            except Exception:
                _log.exception("a selection callback failed")
