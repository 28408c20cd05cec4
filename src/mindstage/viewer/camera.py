"""Sight: one visitor's own view: the camera, and what is drawn for nobody else.

Only one thread may call it.

Framing: where one stands to see a place for the first time.

The furniture fills the picture, not the shells round it, however wide or narrow the picture is. Of all directions the
one is taken from which most of it can be seen, so that fronts and handles face the visitor and tall cabinets do not
stand in the way.

Veils: what stands between visitors and what is lit, so that it has to be seen through.

All else may stay as solid as it is: a whole kitchen of glass is hard to read.

Sights: what each visitor wants to see, and whatever is drawn for one visitor alone.

A visitor is known by the number of the view's connection. Any thread may ask for anything; what is asked for is done
by the one thread that draws, at its next turn.
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
"""In a picture that is higher than wide: from farther up a floor is higher too."""
_MAX_ELEVATION_RAD = np.radians(89.5)
"""Straight down no side would be up."""
_DIRECTIONS = 24
_ASPECT = 1.25
"""Of a picture, until the visitor's is known: its width by its height."""
_OCCLUSION_LENGTH_M = 0.15
"""So much of other bodies in between dims what is behind by a factor of e."""
_DIAGONAL_BONUS = 0.2
"""A view across the corner shows a room better than one straight at a wall, if not much less is seen."""
_MAX_SAMPLED_BODIES = 160
"""So many bodies, evenly picked, are looked at from each direction."""
_MARGIN = 1.2
_MAX_OCCLUDERS = 200
"""So many of the largest bodies are taken to hide others."""
_MIN_DISTANCE_M = 0.4


class CameraPose(msgspec.Struct, frozen=True):
    """A camera."""

    position: Vector
    look_at: Vector
    field_of_view_rad: float
    """From the lower to the upper edge of the picture."""


class FramingTarget(msgspec.Struct, frozen=True, eq=False):
    """What shall be seen, and from which direction: the view of a visitor follows from the shape of the window."""

    points: Array
    """Corners of all that shall be seen, n x 3 [m]."""
    azimuth_rad: float
    """Of the eye, seen from the middle."""
    alignment_rad: float = 0.0
    """How walls and furniture are turned, up to quarter turns."""

    def camera(self, aspect: float = _ASPECT) -> CameraPose:
        """The camera.

        Args:
            aspect: the picture's width by its height.
        """
        elevation = _ELEVATION_RAD if aspect >= 1.0 else _UPRIGHT_ELEVATION_RAD
        return _fit_camera(self.points, _view_direction(self.azimuth_rad, elevation), aspect)

    def top_camera(self, aspect: float = _ASPECT) -> CameraPose:
        """The same from straight above, as on a plan: walls are level or upright, whichever fills the picture."""
        quarter = np.pi / 2
        nearest = np.floor((self.azimuth_rad - self.alignment_rad) / quarter)
        ways = (self.alignment_rad + quarter * (nearest + step) for step in (0, 1))
        views = [_fit_camera(self.points, _view_direction(way, _MAX_ELEVATION_RAD), aspect) for way in ways]
        return min(views, key=lambda view: round(view.position[2], 6))


def corners(poses: Array, sizes: Array) -> Array:
    """The corners of bodies, 8 n x 3 [m].

    Args:
        poses: n x 7.
        sizes: n x 3 [m].
    """
    signs = np.indices((2, 2, 2)).reshape(3, -1).T - 0.5
    own = signs[None] * sizes[:, None]
    turned: Array = np.einsum("nij,nkj->nki", rotation_matrix(normalize(poses[:, 3:])), own) + poses[:, None, :3]
    return turned.reshape(-1, 3)


def focus_camera(points: Array, eye: Vector, look_at: Vector, aspect: float = _ASPECT) -> CameraPose:
    """All of some points, seen from the side from which one looks already.

    Args:
        points: n x 3 [m].
        eye: where the camera is [m].
        look_at: where it looks [m].
        aspect: the picture's width by its height.
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
    """Where visitors stand first, in a world as it is described."""
    return initial_target(world, appearances).camera(aspect)


def initial_target(world: World, appearances: Mapping[BodyId, BodyAppearance]) -> FramingTarget:
    """Finds what to look at first, and from where.

    What moves, and what that is joined to, is what people come for; a place where nothing moves is shown whole.
    """
    bodies = [body for body in world.bodies if body.id in appearances]
    seen = [appearances[body.id] for body in bodies]
    ends = {end for joint in world.joints for end in (joint.parent, joint.child)}
    ends |= {end for hold in world.attachments for end in (hold.parent, hold.child)}
    furniture = np.array([not look.is_building and look.part is VisiblePart.WHOLE for look in seen], dtype=bool)
    lively = np.array([body.id in ends or body.physics.is_dynamic for body in bodies], dtype=bool) & furniture
    solid = np.array([look.part is VisiblePart.WHOLE and look.is_opaque for look in seen], dtype=bool)
    sizes = np.array([look.size for look in seen], dtype=float).reshape(-1, 3)
    poses = pose_array(body.pose for body in bodies)
    return _find_target(poses, sizes, lively if lively.any() else furniture, solid)


def ground_height(world: World, appearances: Mapping[BodyId, BodyAppearance]) -> float | None:
    """Where a ground has to be drawn, under everything; None where the place has a floor [m]."""
    if any(look.is_floor for look in appearances.values()):
        return None
    bodies = [
        body for body in world.bodies if body.id in appearances and appearances[body.id].part is not VisiblePart.OUTLINE
    ]
    return min((body.pose.position[2] - appearances[body.id].size[2] / 2 for body in bodies), default=0.0)


def _find_target(
    poses: Array, sizes: Array, body_mask: NDArray[np.bool_], occluders: NDArray[np.bool_]
) -> FramingTarget:
    """Finds the direction.

    Args:
        poses: of all bodies, n x 7.
        sizes: of all bodies, n x 3 [m].
        things: which of them shall be seen; where it is none, all.
        blockers: which of them hide what is behind them.
    """
    if len(poses) == 0:
        return FramingTarget(np.array([[-1.0, -1.0, 0.0], [1.0, 1.0, 1.0]]), -np.pi / 4)
    if not body_mask.any():
        body_mask = np.ones(len(poses), dtype=bool)
    turn = rotation_matrix(normalize(poses[:, 3:]))
    rows = _without_outliers(poses[body_mask, :3], np.flatnonzero(body_mask))
    points = corners(poses[rows], sizes[rows])
    seen = rows[np.linspace(0, len(rows) - 1, min(len(rows), _MAX_SAMPLED_BODIES)).astype(int)]
    hiding = np.flatnonzero(occluders)
    hiding = hiding[np.argsort(-np.prod(sizes[hiding], axis=1))[:_MAX_OCCLUDERS]]
    azimuths = np.arange(_DIRECTIONS) * 2 * np.pi / _DIRECTIONS
    eyes = [np.array(FramingTarget(points, float(azimuth)).camera().position) for azimuth in azimuths]
    visible = np.array([_visibility(eye, poses, sizes, turn, seen, hiding) for eye in eyes])
    grain = _alignment(turn[rows])
    slant = np.abs(np.sin(2 * (azimuths - grain)))
    # Rounded, so that of two views that are equally good it is always the first.
    best = int(np.argmax(np.round(visible * (1.0 + _DIAGONAL_BONUS * slant), 6)))
    return FramingTarget(points, float(azimuths[best]), grain)


def _without_outliers(centers: Array, rows: NDArray[np.intp]) -> NDArray[np.intp]:
    """The rows without those that stand far from all the others: one lost poster shall not shrink the kitchen."""
    middle = np.median(centers, axis=0)
    distance = np.linalg.norm(centers - middle, axis=1)
    near: NDArray[np.bool_] = distance <= 3.0 * max(float(np.median(distance)), _MIN_DISTANCE_M)
    return rows[near]


def _alignment(rotations: Array) -> float:
    """How the furniture is turned about the vertical, up to a quarter turn [rad]."""
    yaw = np.arctan2(rotations[:, 1, 0], rotations[:, 0, 0])
    return float(np.angle(np.exp(4j * yaw).sum())) / 4


def _view_direction(azimuth: float, elevation: float) -> Array:
    """The direction from the middle to the eye."""
    flat = np.cos(elevation)
    return np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])


def _fit_camera(points: Array, direction: Array, aspect: float) -> CameraPose:
    """From a direction, as near as all points allow, and with as much beside them on each side."""
    right = np.cross([0.0, 0.0, 1.0], direction)
    right /= np.linalg.norm(right)
    up = np.cross(direction, right)
    # Across, upwards and towards the eye.
    seen = (points - points[0]) @ np.stack([right, up, direction], axis=1)
    tangents = np.tan(_FIELD_OF_VIEW_RAD / 2) * np.array([aspect, 1.0]) / _MARGIN
    # A line of sight along each edge of the picture touches the points; two such lines meet where the eye has to be.
    most = np.max(seen[:, :2] + seen[:, 2:] * tangents, axis=0)
    least = np.min(seen[:, :2] - seen[:, 2:] * tangents, axis=0)
    depth = float(np.max((most - least) / (2 * tangents)))
    nearest = float(seen[:, 2].max()) + _MIN_DISTANCE_M
    depth = max(depth, nearest)
    across, upwards = ((most + least) / 2).tolist()
    eye = points[0] + across * right + upwards * up + depth * direction
    middle = float(np.median(seen[:, 2]))
    return CameraPose(
        _to_vector(eye), _to_vector(eye - max(depth - middle, _MIN_DISTANCE_M) * direction), float(_FIELD_OF_VIEW_RAD)
    )


def _visibility(
    eye: Array, poses: Array, sizes: Array, rotations: Array, sampled: NDArray[np.intp], occluders: NDArray[np.intp]
) -> float:
    """How much of the bodies can be seen: each counts one, less what stands between it and the eye."""
    through = np.zeros(len(sampled))
    for blocker in occluders:
        start = (eye - poses[blocker, :3]) @ rotations[blocker]
        path = (poses[sampled, :3] - poses[blocker, :3]) @ rotations[blocker] - start
        with np.errstate(divide="ignore", invalid="ignore"):
            enter, leave = (-sizes[blocker] / 2 - start) / path, (sizes[blocker] / 2 - start) / path
        first = np.nanmax(np.minimum(enter, leave), axis=1)
        last = np.nanmin(np.maximum(enter, leave), axis=1)
        inside = np.clip(np.minimum(last, 1.0) - np.maximum(first, 0.0), 0.0, 1.0) * np.linalg.norm(path, axis=1)
        through += np.where(sampled == blocker, 0.0, inside)
    return float(np.exp(-through / _OCCLUSION_LENGTH_M).sum())


def _to_vector(array: Array) -> Vector:
    x, y, z = array.tolist()
    return x, y, z


_SAMPLE_INSET = 0.8
"""Of what is lit so much is looked for, from its middle to its corners: its very edge may be behind something."""


def find_occluders(eye: Array, poses: Array, sizes: Array, highlighted: NDArray[np.intp]) -> NDArray[np.intp]:
    """The bodies that hide some of what is lit from an eye, or that it is in.

    Args:
        eye: where one looks from [m].
        poses: of all bodies, n x 7.
        sizes: of all bodies, n x 3 [m].
        lit: the rows of those that are lit.

    Returns:
        Rows, none of them lit.
    """
    points = np.concatenate([poses[highlighted, :3], corners(poses[highlighted], sizes[highlighted] * _SAMPLE_INSET)])
    turn = rotation_matrix(normalize(poses[:, 3:]))
    # In each body's own frame the line of sight to a point runs from `start` along `path`, which is 1 long.
    start = np.einsum("nji,nj->ni", turn, eye - poses[:, :3])[:, None]
    path = np.einsum("nji,npj->npi", turn, points[None] - poses[:, None, :3]) - start
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


_log = logging.getLogger(__name__)


class ClientViews:
    """All visitors' views. Where no visitor is named, all are meant, and those who come later too."""

    def __init__(self, server: viser.ViserServer, *, on_place: PlaceCallback) -> None:
        """Nobody is there yet.

        Args:
            server: where they come.
            place: called when a visitor has put a body somewhere with the gizmo.
        """
        self._on_place = on_place
        self._queue: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._views: dict[int, ClientView] = {}
        self._defaults: dict[str, Callable[[ClientView], None]] = {}
        """What newcomers get, by what it is about."""
        self._listeners: list[Callable[[int], None]] = []
        self._names: Mapping[BodyId, str] = {}
        self._appearances: Mapping[BodyId, BodyAppearance] = {}
        self._ids: tuple[BodyId, ...] = ()
        self._poses: Array | None = None
        self._target: FramingTarget | None = None
        self._hidden: frozenset[BodyId] = frozenset()
        self._hidden_changed = threading.Lock()
        self._enclosures_shown = True
        # A tab may be closed between two pictures; nobody needs to be warned of that on stderr.
        warnings.filterwarnings("ignore", message=".* on a closed connection", category=UserWarning)
        server.on_client_connect(lambda client: self._enqueue(lambda: self._on_connect(client)))
        server.on_client_disconnect(lambda client: self._enqueue(lambda: self._on_disconnect(client)))

    # -- what anybody may ask for --------------------------------------------------------------------------------------

    @property
    def clients(self) -> tuple[int, ...]:
        """Who is there."""
        return tuple(self._views)

    def on_change(self, listener: Callable[[int], None]) -> None:
        """Calls a function with each visitor whose selection has changed."""
        self._listeners.append(listener)

    def selected(self, client: int) -> BodyId | None:
        """What a visitor has selected."""
        sight = self._views.get(client)
        return sight.selected if sight is not None else None

    def select(self, id: BodyId | None, *, client: int | None = None) -> None:
        """Draws a frame round a body; None round none.

        Raises:
            BodyNotFoundError: there is no such body.
        """
        self._require_bodies([] if id is None else [id])

        def choose(sight: ClientView) -> None:
            if sight.select(id):
                self._notify(sight.client_id)

        self._request("select", choose, client)

    def focus(self, ids: Iterable[BodyId] = (), *, client: int | None = None) -> None:
        """Flies to bodies, so that they fill the picture; to the whole place, where none is named.

        Raises:
            BodyNotFoundError: one of them is not there.
        """
        wanted = tuple(ids)
        self._require_bodies(wanted)
        self._request(None, lambda sight: sight.focus(wanted), client)

    def go_home(self, *, client: int | None = None) -> None:
        """Flies to where visitors stand at first."""
        self._request(None, lambda sight: sight.go_home(), client)

    def go_top(self, *, client: int | None = None) -> None:
        """Looks down on the whole place, as on a plan."""
        self._request(None, lambda sight: sight.go_top(), client)

    def set_camera(self, camera_pose: CameraPose, *, client: int | None = None) -> None:
        """Takes a visitor somewhere at once."""
        self._request("view", lambda sight: sight.set_camera(camera_pose), client)

    def set_clip_height(self, height: float | None, *, client: int | None = None) -> None:
        """Hides all that is above a height [m], so that one sees into rooms; None shows it again."""
        self._request("section", lambda sight: sight.set_clip_height(height), client)

    def set_labels(self, labels: LabelMode, *, client: int | None = None) -> None:
        """Writes the names of bodies beside them."""
        self._request("labels", lambda sight: sight.set_labels(labels), client)

    def show_preview(self, id: BodyId, pose: Pose | None, *, client: int | None = None) -> None:
        """Draws a body a second time, see-through, at another pose; None takes that away.

        Raises:
            BodyNotFoundError: there is no such body.
        """
        self._require_bodies([id])
        self._request(f"ghost {id}", lambda sight: sight.show_preview(id, pose), client)

    def set_gizmo(self, mode: GizmoMode | None, *, client: int | None = None) -> None:
        """Gives the selected body handles to move or to turn it by."""
        self._request("gizmo", lambda sight: sight.set_gizmo(mode), client)

    @property
    def is_drawn(self) -> bool:
        """Whether what is there was drawn at least once, be it nothing."""
        return self._poses is not None

    @property
    def target(self) -> FramingTarget | None:
        """Where visitors stand at first; None as long as there is nothing to be seen."""
        return self._target

    @property
    def hidden(self) -> frozenset[BodyId]:
        """The bodies that nobody sees."""
        return self._hidden

    def show_bodies(self, ids: Iterable[BodyId], shown: bool) -> None:
        """Hides bodies from all visitors, or shows them again.

        Raises:
            BodyNotFoundError: one of them is not there.
        """
        wanted = frozenset(ids)
        self._require_bodies(wanted)
        with self._hidden_changed:
            self._hidden = self._hidden - wanted if shown else self._hidden | wanted

    @property
    def enclosures_shown(self) -> bool:
        """Whether the outlines of what encloses the place are drawn."""
        return self._enclosures_shown

    def show_enclosures(self, shown: bool) -> None:
        """Draws the outlines of what encloses the place, or not, for all visitors."""
        self._enclosures_shown = shown

    # -- for the thread that draws -------------------------------------------------------------------------------------

    def set_bodies(
        self,
        appearances: Mapping[BodyId, BodyAppearance],
        names: Mapping[BodyId, str],
        ids: tuple[BodyId, ...],
        poses: Array,
    ) -> None:
        """What is there now: how it is drawn, its name for people, and where it is."""
        self._appearances, self._names, self._ids, self._poses = appearances, names, ids, poses
        with self._hidden_changed:
            self._hidden &= appearances.keys()
        for sight in self._views.values():
            if sight.set_bodies(appearances, names, ids, poses):
                self._notify(sight.client_id)

    def set_target(self, outlook: FramingTarget) -> None:
        """Where visitors stand at first."""
        self._target = outlook
        for sight in self._views.values():
            sight.set_target(outlook)

    def update_poses(self, poses: Array) -> None:
        """Moves what is drawn at a body with it."""
        self._poses = poses
        for sight in self._views.values():
            sight.update_poses(poses)

    def process_queue(self) -> None:
        """Does all that was asked for since the last time, and lets cameras fly on."""
        while True:
            try:
                wish = self._queue.get_nowait()
            except Empty:
                break
            wish()
        for sight in self._views.values():
            sight.step_camera()

    def wait_idle(self, *, timeout_s: float) -> bool:
        """Waits until all that was asked for so far is on its way; False if it did not come to that in time."""
        done = threading.Event()
        self._enqueue(done.set)
        return done.wait(timeout_s)

    # -- how -----------------------------------------------------------------------------------------------------------

    def _enqueue(self, action: Callable[[], None]) -> None:
        self._queue.put(action)

    def _request(self, setting: str | None, action: Callable[[ClientView], None], client: int | None) -> None:
        def do() -> None:
            if client is not None:
                if (sight := self._views.get(client)) is not None:  # a tab may be closed at any time
                    action(sight)
                return
            if setting is not None:
                self._defaults[setting] = action
            for sight in self._views.values():
                action(sight)

        self._enqueue(do)

    def _require_bodies(self, ids: Iterable[BodyId]) -> None:
        for id in ids:
            if id not in self._appearances:
                raise BodyNotFoundError(id, world="the view", known=self._appearances)

    def _on_connect(self, client: viser.ClientHandle) -> None:
        sight = self._views[client.client_id] = ClientView(client, on_place=self._on_place, enqueue=self._enqueue)
        if self._poses is not None:
            sight.set_bodies(self._appearances, self._names, self._ids, self._poses)
        if self._target is not None:
            sight.set_target(self._target)
        for what in self._defaults.values():
            what(sight)

    def _on_disconnect(self, client: viser.ClientHandle) -> None:
        self._views.pop(client.client_id, None)

    def _notify(self, visitor: int) -> None:
        for listener in self._listeners:
            try:
                listener(visitor)
            except Exception:
                _log.exception("nobody could be told of a selection")
