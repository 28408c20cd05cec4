"""The views of clients: camera, selection box, labels, previews, gizmo; and how the initial camera is chosen.

Methods of `ClientViews` may be called from any thread; they enqueue actions, which the drawing thread executes at its
next update. A client is identified by the id of viser's connection. The initial camera frames the furniture rather than
the building, from the direction in which most of it is visible, for windows of any aspect ratio.
"""

from __future__ import annotations

import logging
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Mapping
from enum import StrEnum
from queue import Empty, SimpleQueue
from typing import Protocol
from urllib.parse import quote

import msgspec
import numpy as np
import viser
from numpy.typing import NDArray

from mindstage.errors import BodyNotFoundError
from mindstage.scene import BodyId, Pose, Vector, World
from mindstage.scene.mesh import box_edges
from mindstage.scene.transforms import (
    Array,
    normalize,
    normalized_pose_array,
    pose_array,
    pose_from_array,
    rotation_matrix,
)
from mindstage.viewer.appearance import BodyAppearance, VisiblePart, merge_visuals

__all__ = [
    "CameraPose",
    "ClientView",
    "ClientViews",
    "FramingTarget",
    "GizmoMode",
    "LabelMode",
    "PlaceCallback",
    "corners",
    "find_occluders",
    "focus_camera",
    "ground_height",
    "initial_camera",
    "initial_target",
]


_FIELD_OF_VIEW_RAD = np.radians(36.0)
_ELEVATION_RAD = np.radians(33.0)
_UPRIGHT_ELEVATION_RAD = np.radians(50.0)
"""Elevation in a portrait window, where a steeper view makes the floor fill the height."""
_MAX_ELEVATION_RAD = np.radians(89.5)
"""At 90 degrees the up direction would be undefined."""
_DIRECTIONS = 24
_ASPECT = 1.25
"""Aspect ratio (width / height) until that of the client is known."""
_OCCLUSION_LENGTH_M = 0.15
"""Length of occluding bodies on a line of sight that reduces the visibility by a factor of e."""
_DIAGONAL_BONUS = 0.2
"""Bonus of a direction diagonal to the walls over one perpendicular to a wall."""
_MAX_SAMPLED_BODIES = 160
"""Number of bodies, sampled evenly, whose visibility is computed."""
_MARGIN = 1.2
_MAX_OCCLUDERS = 200
"""Number of the largest bodies that count as occluders."""
_MIN_DISTANCE_M = 0.4


class CameraPose(msgspec.Struct, frozen=True):
    """The pose and field of view of a camera."""

    position: Vector
    look_at: Vector
    field_of_view_rad: float
    """Vertical field of view."""


class FramingTarget(msgspec.Struct, frozen=True, eq=False):
    """What the initial camera shows and from which direction; its pose depends on the aspect ratio of the window."""

    points: Array
    """Corners of the bodies to show, n x 3 [m]."""
    azimuth_rad: float
    """Direction of the camera from the center, about z."""
    alignment_rad: float = 0.0
    """Yaw of walls and furniture, modulo 90 degrees."""

    def camera(self, aspect: float = _ASPECT) -> CameraPose:
        """Returns the camera pose that shows all points.

        Args:
            aspect: the aspect ratio of the window (width / height).
        """
        elevation = _ELEVATION_RAD if aspect >= 1.0 else _UPRIGHT_ELEVATION_RAD
        return _fit_camera(self.points, _view_direction(self.azimuth_rad, elevation), aspect)

    def top_camera(self, aspect: float = _ASPECT) -> CameraPose:
        """Returns the camera pose from above, with walls parallel to the edges of the window.

        Args:
            aspect: the aspect ratio of the window (width / height).
        """
        quarter = np.pi / 2
        nearest = np.floor((self.azimuth_rad - self.alignment_rad) / quarter)
        azimuths = (self.alignment_rad + quarter * (nearest + step) for step in (0, 1))
        poses = [_fit_camera(self.points, _view_direction(each, _MAX_ELEVATION_RAD), aspect) for each in azimuths]
        return min(poses, key=lambda pose: round(pose.position[2], 6))


def corners(poses: Array, sizes: Array) -> Array:
    """The corners of the boxes of bodies in the world frame, 8 n x 3 [m].

    Args:
        poses: poses, n x 7.
        sizes: extents, n x 3 [m].
    """
    signs = np.indices((2, 2, 2)).reshape(3, -1).T - 0.5
    local = signs[None] * sizes[:, None]
    rotation = rotation_matrix(normalize(poses[:, 3:]))
    in_world: Array = np.einsum("nij,nkj->nki", rotation, local) + poses[:, None, :3]
    return in_world.reshape(-1, 3)


def focus_camera(points: Array, eye: Vector, look_at: Vector, aspect: float = _ASPECT) -> CameraPose:
    """Returns the camera pose that shows all points from the current direction.

    Args:
        points: points to show, n x 3 [m].
        eye: current position of the camera [m].
        look_at: current target of the camera [m].
        aspect: the aspect ratio of the window (width / height).
    """
    away = np.subtract(eye, look_at)
    length = float(np.linalg.norm(away))
    away = away / length if length > 1e-6 else _view_direction(0.0, _ELEVATION_RAD)
    if float(np.hypot(away[0], away[1])) < float(np.cos(_MAX_ELEVATION_RAD)):
        away = _view_direction(float(np.arctan2(away[1], away[0])), _MAX_ELEVATION_RAD)
    return _fit_camera(points, away, aspect)


def initial_camera(
    world: World, appearances: Mapping[BodyId, BodyAppearance], *, aspect: float = _ASPECT
) -> CameraPose:
    """Returns the initial camera pose for a world.

    Args:
        world: the world, with the poses of its description.
        appearances: how its bodies are drawn.
        aspect: the aspect ratio of the window (width / height).
    """
    return initial_target(world, appearances).camera(aspect)


def initial_target(world: World, appearances: Mapping[BodyId, BodyAppearance]) -> FramingTarget:
    """Chooses what the initial camera shows, and the direction.

    Shows the dynamic, jointed and attached bodies; if there are none, all furniture.

    Args:
        world: the world, with the poses of its description.
        appearances: how its bodies are drawn.
    """
    bodies = [body for body in world.bodies if body.id in appearances]
    drawn = [appearances[body.id] for body in bodies]
    ends = {end for joint in world.joints for end in (joint.parent, joint.child)}
    ends |= {end for link in world.attachments for end in (link.parent, link.child)}
    furniture = np.array([not each.is_building and each.part is VisiblePart.WHOLE for each in drawn], dtype=bool)
    movable = np.array([body.id in ends or body.physics.is_dynamic for body in bodies], dtype=bool) & furniture
    opaque = np.array([each.part is VisiblePart.WHOLE and each.is_opaque for each in drawn], dtype=bool)
    sizes = np.array([each.size for each in drawn], dtype=float).reshape(-1, 3)
    poses = pose_array(body.pose for body in bodies)
    return _find_target(poses, sizes, movable if movable.any() else furniture, opaque)


def ground_height(world: World, appearances: Mapping[BodyId, BodyAppearance]) -> float | None:
    """The height of the ground plane, below all bodies [m]; None if the world has a floor."""
    if any(each.is_floor for each in appearances.values()):
        return None
    bodies = [
        body for body in world.bodies if body.id in appearances and appearances[body.id].part is not VisiblePart.OUTLINE
    ]
    return min((body.pose.position[2] - appearances[body.id].size[2] / 2 for body in bodies), default=0.0)


def _find_target(
    poses: Array, sizes: Array, body_mask: NDArray[np.bool_], occluders: NDArray[np.bool_]
) -> FramingTarget:
    """Finds the direction in which most bodies are visible.

    Args:
        poses: poses of all bodies, n x 7.
        sizes: extents of all bodies, n x 3 [m].
        body_mask: the bodies to show; all if it is empty.
        occluders: a mask of the bodies that hide others.
    """
    if len(poses) == 0:
        return FramingTarget(np.array([[-1.0, -1.0, 0.0], [1.0, 1.0, 1.0]]), -np.pi / 4)
    if not body_mask.any():
        body_mask = np.ones(len(poses), dtype=bool)
    rotations = rotation_matrix(normalize(poses[:, 3:]))
    rows = _without_outliers(poses[body_mask, :3], np.flatnonzero(body_mask))
    points = corners(poses[rows], sizes[rows])
    sampled = rows[np.linspace(0, len(rows) - 1, min(len(rows), _MAX_SAMPLED_BODIES)).astype(int)]
    largest = np.flatnonzero(occluders)
    largest = largest[np.argsort(-np.prod(sizes[largest], axis=1))[:_MAX_OCCLUDERS]]
    azimuths = np.arange(_DIRECTIONS) * 2 * np.pi / _DIRECTIONS
    eyes = [np.array(FramingTarget(points, float(azimuth)).camera().position) for azimuth in azimuths]
    visible = np.array([_visibility(eye, poses, sizes, rotations, sampled, largest) for eye in eyes])
    alignment = _alignment(rotations[rows])
    diagonal = np.abs(np.sin(2 * (azimuths - alignment)))
    # Rounded, so that of equally good directions the first is chosen on every machine.
    best = int(np.argmax(np.round(visible * (1.0 + _DIAGONAL_BONUS * diagonal), 6)))
    return FramingTarget(points, float(azimuths[best]), alignment)


def _without_outliers(centers: Array, rows: NDArray[np.intp]) -> NDArray[np.intp]:
    """The rows without bodies that are far from all others, which would make everything else small."""
    median = np.median(centers, axis=0)
    distance = np.linalg.norm(centers - median, axis=1)
    near: NDArray[np.bool_] = distance <= 3.0 * max(float(np.median(distance)), _MIN_DISTANCE_M)
    return rows[near]


def _alignment(rotations: Array) -> float:
    """The mean yaw of the furniture, modulo 90 degrees [rad]."""
    yaw = np.arctan2(rotations[:, 1, 0], rotations[:, 0, 0])
    return float(np.angle(np.exp(4j * yaw).sum())) / 4


def _view_direction(azimuth: float, elevation: float) -> Array:
    """The unit vector from the center to the camera."""
    horizontal = np.cos(elevation)
    return np.array([horizontal * np.cos(azimuth), horizontal * np.sin(azimuth), np.sin(elevation)])


def _fit_camera(points: Array, direction: Array, aspect: float) -> CameraPose:
    """The nearest camera pose in a direction that shows all points, centered, with a margin."""
    right = np.cross([0.0, 0.0, 1.0], direction)
    right /= np.linalg.norm(right)
    up = np.cross(direction, right)
    # Coordinates of the points to the right, up and towards the camera.
    local = (points - points[0]) @ np.stack([right, up, direction], axis=1)
    tangents = np.tan(_FIELD_OF_VIEW_RAD / 2) * np.array([aspect, 1.0]) / _MARGIN
    # The planes of the frustum touch the outermost points; opposite planes intersect at the camera.
    most = np.max(local[:, :2] + local[:, 2:] * tangents, axis=0)
    least = np.min(local[:, :2] - local[:, 2:] * tangents, axis=0)
    depth = float(np.max((most - least) / (2 * tangents)))
    nearest = float(local[:, 2].max()) + _MIN_DISTANCE_M
    depth = max(depth, nearest)
    x, y = ((most + least) / 2).tolist()
    eye = points[0] + x * right + y * up + depth * direction
    middle = float(np.median(local[:, 2]))
    return CameraPose(
        _to_vector(eye), _to_vector(eye - max(depth - middle, _MIN_DISTANCE_M) * direction), float(_FIELD_OF_VIEW_RAD)
    )


def _visibility(
    eye: Array, poses: Array, sizes: Array, rotations: Array, sampled: NDArray[np.intp], occluders: NDArray[np.intp]
) -> float:
    """The number of visible bodies; a body counts less the more of the occluders is between it and the eye."""
    through = np.zeros(len(sampled))
    for row in occluders:
        start = (eye - poses[row, :3]) @ rotations[row]
        path = (poses[sampled, :3] - poses[row, :3]) @ rotations[row] - start
        with np.errstate(divide="ignore", invalid="ignore"):
            enter, leave = (-sizes[row] / 2 - start) / path, (sizes[row] / 2 - start) / path
        first = np.nanmax(np.minimum(enter, leave), axis=1)
        last = np.nanmin(np.maximum(enter, leave), axis=1)
        inside = np.clip(np.minimum(last, 1.0) - np.maximum(first, 0.0), 0.0, 1.0) * np.linalg.norm(path, axis=1)
        through += np.where(sampled == row, 0.0, inside)
    return float(np.exp(-through / _OCCLUSION_LENGTH_M).sum())


def _to_vector(array: Array) -> Vector:
    x, y, z = array.tolist()
    return x, y, z


_SAMPLE_INSET = 0.8
"""Part of the extents of a highlighted body that has to be visible; its edges may be occluded."""


def find_occluders(eye: Array, poses: Array, sizes: Array, highlighted: NDArray[np.intp]) -> NDArray[np.intp]:
    """Finds the bodies that occlude or contain a part of the highlighted bodies.

    Args:
        eye: position of the camera [m].
        poses: poses of all bodies, n x 7.
        sizes: extents of all bodies, n x 3 [m].
        highlighted: rows of the highlighted bodies.

    Returns:
        Rows of bodies that are not highlighted.
    """
    points = np.concatenate([poses[highlighted, :3], corners(poses[highlighted], sizes[highlighted] * _SAMPLE_INSET)])
    rotations = rotation_matrix(normalize(poses[:, 3:]))
    # In the frame of each body, the segment from the eye to a point is `start + s * path` for s from 0 to 1.
    start = np.einsum("nji,nj->ni", rotations, eye - poses[:, :3])[:, None]
    path = np.einsum("nji,npj->npi", rotations, points[None] - poses[:, None, :3]) - start
    with np.errstate(divide="ignore", invalid="ignore"):
        enter, leave = ((sign * sizes[:, None] / 2 - start) / path for sign in (-1.0, 1.0))
    first = np.nanmax(np.minimum(enter, leave), axis=2)
    last = np.nanmin(np.maximum(enter, leave), axis=2)
    crossed = np.any(np.maximum(first, 0.0) < np.minimum(last, 1.0), axis=1)
    crossed[highlighted] = False
    return np.flatnonzero(crossed)


_ACCENT = (232, 93, 4)
_PREVIEW_OPACITY = 0.35
_CAMERA_MOVE_S = 0.6
_MAX_LABELS = 300
"""Maximum number of labels; the largest bodies are labeled first."""
_MIN_FOCUS_SIZE_M = 0.25
"""Smallest extent that the camera zooms to [m]."""


class LabelMode(StrEnum):
    """Which bodies are labeled."""

    NONE = "none"
    SELECTED = "selected"
    CLASS = "class"
    """All bodies with the same label as the selected one."""
    ALL = "all"


class GizmoMode(StrEnum):
    """What the gizmo at the selected body does."""

    MOVE = "move"
    TURN = "turn"


class PlaceCallback(Protocol):
    """Called when a client has moved a body with the gizmo."""

    def __call__(self, client: int, id: BodyId, pose: Pose) -> None:
        """Moves the body.

        Args:
            client: the client.
            id: the body.
            pose: its new pose.
        """


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
        self._selection_box: viser.LineSegmentsHandle | None = None
        self._labels, self._label_nodes = LabelMode.NONE, dict[BodyId, viser.LabelHandle]()
        self._previews: dict[BodyId, viser.MeshHandle] = {}
        self._clip_height: viser.FrameHandle | None = None
        self._mode: GizmoMode | None = None
        self._gizmo: viser.TransformControlsHandle | None = None
        self._dragging = False

    # -- bodies --------------------------------------------------------------------------------------------------------

    def set_bodies(
        self,
        appearances: Mapping[BodyId, BodyAppearance],
        names: Mapping[BodyId, str],
        ids: tuple[BodyId, ...],
        poses: Array,
    ) -> bool:
        """Sets the bodies and their poses; returns whether the selected body was removed.

        Args:
            appearances: how bodies are drawn.
            names: their labels.
            ids: the bodies of the rows of `poses`.
            poses: n x 7.
        """
        changed = [id for id in self._appearances if appearances.get(id) != self._appearances[id]]
        self._appearances, self._names, self._poses = dict(appearances), names, poses
        self._rows = {id: row for row, id in enumerate(ids)}
        for id in changed:
            self.show_preview(id, None)
        selected = self.selected
        removed = selected is not None and selected not in appearances
        if removed or selected in changed:
            self.select(None)
            if selected is not None and not removed:
                self.select(selected)
        else:
            self._update_labels()
        self.update_poses(poses)
        return removed

    def update_poses(self, poses: Array) -> None:
        """Moves selection box, gizmo and labels to the poses of their bodies."""
        self._poses = poses
        if self._selection_box is not None and self.selected in self._rows:
            self._selection_box.position, self._selection_box.wxyz = self._pose(self.selected)
        if self._gizmo is not None and not self._dragging and self.selected in self._rows:
            self._gizmo.position, self._gizmo.wxyz = self._pose(self.selected)
        for id, label in self._label_nodes.items():
            label.position = self._label_position(id)

    # -- selection and labels ------------------------------------------------------------------------------------------

    def select(self, id: BodyId | None) -> bool:
        """Selects a body, or none; returns whether the selection changed."""
        if id == self.selected or (id is not None and id not in self._rows):
            return False
        self.selected = id
        if self._selection_box is not None:
            self._selection_box.remove()
            self._selection_box = None
        if id is not None:
            position, wxyz = self._pose(id)
            self._selection_box = self._scene.add_line_segments(
                "/selected",
                box_edges(self._appearances[id].size, margin=0.004),
                _ACCENT,
                thickness=2.5,
                thickness_units="screen",
                position=position,
                wxyz=wxyz,
            )
        self._update_labels()
        self.set_gizmo(self._mode)
        return True

    def set_labels(self, labels: LabelMode) -> None:
        """Sets which bodies are labeled."""
        self._labels = labels
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
                color=_ACCENT,
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
        pose = pose_from_array(np.concatenate([event.target.position, normalize(event.target.wxyz)]))
        self._dragging = event.phase != "end"
        self._enqueue(lambda: self.show_preview(id, None if event.phase == "end" else pose))
        if event.phase == "end":
            self._on_place(self.client_id, id, pose)

    def _update_labels(self) -> None:
        """Adds and removes labels by the current mode and selection."""
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
                sizes = {id: max(each.size) for id, each in self._appearances.items() if id in self._rows}
                return sorted(sizes, key=lambda each: -sizes[each])[:_MAX_LABELS]
            case LabelMode.CLASS if self.selected is not None:
                name = self._names.get(self.selected)
                return [id for id in self._rows if self._names.get(id) == name][:_MAX_LABELS]
            case LabelMode.SELECTED if self.selected is not None:
                return [self.selected]
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
            self._move_camera(self._target.camera(self._aspect))

    def go_top(self) -> None:
        """Animates the camera to the view from above."""
        if self._target is not None:
            self._move_camera(self._target.top_camera(self._aspect))

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
        self._move_camera(focus_camera(points, eye, look_at, self._aspect))

    def focus_points(self, points: tuple[Vector, ...]) -> None:
        """Animates the camera to points."""
        poses = np.concatenate([np.array(points), np.tile([1.0, 0.0, 0.0, 0.0], (len(points), 1))], axis=1)
        margins = np.full((len(points), 3), _MIN_FOCUS_SIZE_M)
        camera = self._client.camera
        eye, look_at = _vector(camera.position), _vector(camera.look_at)
        self._move_camera(focus_camera(corners(poses, margins), eye, look_at, self._aspect))

    def set_camera(self, camera_pose: CameraPose) -> None:
        """Sets the camera without animation."""
        self._camera_move = None
        self._set_camera(camera_pose)

    def set_clip_height(self, height: float | None) -> None:
        """Clips everything above a height [m]; None clips nothing."""
        if self._clip_height is not None:
            self._clip_height.remove()
            self._clip_height = None
        if height is not None:
            self._clip_height = self._scene.add_frame(
                "/clipping_plane", show_axes=False, position=(0.0, 0.0, height), visible=False
            )

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

    # -- poses ---------------------------------------------------------------------------------------------------------

    def _pose(self, id: BodyId) -> tuple[Array, Array]:
        row = self._poses[self._rows[id]]
        return row[:3], normalize(row[3:])

    def _label_position(self, id: BodyId) -> Vector:
        """The position of a label: above the center of the body."""
        row = self._poses[self._rows[id]]
        top = corners(row[None], np.array([self._appearances[id].size]))[:, 2].max()
        return float(row[0]), float(row[1]), float(top) + 0.02


def _vector(array: Array) -> Vector:
    x, y, z = np.asarray(array, dtype=float).tolist()
    return x, y, z


_log = logging.getLogger(__name__)


class ClientViews:
    """The views of all clients. Without `client`, methods apply to all clients, later ones included."""

    def __init__(self, server: viser.ViserServer, *, on_place: PlaceCallback) -> None:
        """Registers for connections of clients.

        Args:
            server: the server that clients connect to.
            on_place: called when a client has moved a body with the gizmo.
        """
        self._on_place = on_place
        self._queue: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._views: dict[int, ClientView] = {}
        self._defaults: dict[str, Callable[[ClientView], None]] = {}
        """Actions applied to new clients, by setting."""
        self._listeners: list[Callable[[int], None]] = []
        self._names: Mapping[BodyId, str] = {}
        self._appearances: Mapping[BodyId, BodyAppearance] = {}
        self._ids: tuple[BodyId, ...] = ()
        self._poses: Array | None = None
        self._target: FramingTarget | None = None
        self._hidden: frozenset[BodyId] = frozenset()
        self._hidden_lock = threading.Lock()
        self._enclosures_shown = True
        # A tab may be closed between two updates.
        warnings.filterwarnings("ignore", message=".* on a closed connection", category=UserWarning)
        server.on_client_connect(lambda client: self._enqueue(lambda: self._on_connect(client)))
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
        """The selected body of a client."""
        view = self._views.get(client)
        return view.selected if view is not None else None

    def select(self, id: BodyId | None, *, client: int | None = None) -> None:
        """Selects a body; None selects nothing.

        Raises:
            BodyNotFoundError: there is no such body.
        """
        self._require_bodies([] if id is None else [id])

        def select_in(view: ClientView) -> None:
            if view.select(id):
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
    ) -> None:
        """Sets the bodies and their poses.

        Args:
            appearances: how bodies are drawn.
            names: their labels.
            ids: the bodies of the rows of `poses`.
            poses: n x 7.
        """
        self._appearances, self._names, self._ids, self._poses = appearances, names, ids, poses
        with self._hidden_lock:
            self._hidden &= appearances.keys()
        for view in self._views.values():
            if view.set_bodies(appearances, names, ids, poses):
                self._notify(view.client_id)

    def set_target(self, target: FramingTarget) -> None:
        """Sets what the home view shows, and moves all cameras there."""
        self._target = target
        for view in self._views.values():
            view.set_target(target)

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

    def wait_idle(self, *, timeout_s: float) -> bool:
        """Waits until all actions enqueued so far are executed; False if that takes too long."""
        done = threading.Event()
        self._enqueue(done.set)
        return done.wait(timeout_s)

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

    def _on_connect(self, client: viser.ClientHandle) -> None:
        view = self._views[client.client_id] = ClientView(client, on_place=self._on_place, enqueue=self._enqueue)
        if self._poses is not None:
            view.set_bodies(self._appearances, self._names, self._ids, self._poses)
        if self._target is not None:
            view.set_target(self._target)
        for action in self._defaults.values():
            action(view)

    def _on_disconnect(self, client: viser.ClientHandle) -> None:
        self._views.pop(client.client_id, None)

    def _notify(self, client: int) -> None:
        for listener in self._listeners:
            try:
                listener(client)
            except Exception:
                _log.exception("a selection callback failed")
