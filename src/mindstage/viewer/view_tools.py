"""Tools of the 3D view: picking, box selection, measuring, camera bookmarks and standard views.

Pointers are positions in the view, from (-1, -1) at the lower left corner to (1, 1) at the upper right one. Rays are
cast on the server against collision shapes, through what is hidden, clipped, or drawn from inside only.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Mapping, Sequence
from enum import StrEnum
from typing import Annotated, Any

import msgspec
import numpy as np
import viser

from mindstage.access.policies import READ
from mindstage.errors import BodyNotFoundError, InvalidArgumentError
from mindstage.rendering.appearance import BodyAppearance, VisiblePart
from mindstage.rendering.camera import CameraPose, corners, focus_camera
from mindstage.scene import Body, BodyId, Vector
from mindstage.scene.proximity import BodyBoxes, box_gaps
from mindstage.scene.ray_casting import ShapeScene
from mindstage.scene.transforms import Array, normalize, pose_array, quat_rotate, rotation_matrix
from mindstage.simulation import Simulation, StateSnapshot
from mindstage.viewer.client_views import ClientViews, Snapping, aspect_ratio
from mindstage.viewer.server import ClientSession, EmptyRequest, RpcChannel

__all__ = ["PickResult", "PointerPicker", "SessionViews", "ViewToolHandler"]

_MAX_RAY_M = 200.0
_MAX_SKIPPED = 30
"""How many bodies a ray may pass that are not drawn from its side."""
_CORNER_RADIUS = 0.03
"""Distance from a corner at which it is picked, relative to the distance from the camera."""
_Coordinate = Annotated[float, msgspec.Meta(ge=-1.5, le=1.5)]
_Meters = Annotated[float, msgspec.Meta(ge=-10_000.0, le=10_000.0)]
Pointer = tuple[_Coordinate, _Coordinate]
_Point = tuple[_Meters, _Meters, _Meters]


class SessionViews:
    """The views and cameras of pages."""

    def __init__(
        self, views: ClientViews, server: viser.ViserServer, *, views_of: Callable[[ClientSession], list[int]]
    ) -> None:
        """Keeps its arguments.

        Args:
            views: the views of all clients.
            server: the server of the views.
            views_of: returns the views of a page.
        """
        self.views, self._server, self._views_of = views, server, views_of

    def of(self, session: ClientSession) -> list[int]:
        """The views of a page; usually one."""
        return self._views_of(session)

    def camera(self, session: ClientSession) -> viser.CameraHandle:
        """The camera of a page.

        Raises:
            InvalidArgumentError: its 3D view is not connected.
        """
        clients = self._server.get_clients()
        for view in self._views_of(session):
            if view in clients:
                return clients[view].camera
        raise InvalidArgumentError("the 3D view", cause="it is not connected", remedy="wait until it is drawn")

    def clip_height(self, session: ClientSession) -> float | None:
        """The height above which a page shows nothing [m]; None without one."""
        heights = (self.views.clip_height(view) for view in self._views_of(session))
        return next((height for height in heights if height is not None), None)

    def culled(self, session: ClientSession) -> frozenset[BodyId]:
        """The bodies that a page does not draw because the wall that they are mounted on is not drawn."""
        return frozenset().union(*(self.views.culled(view) for view in self._views_of(session)))

    def ray(self, session: ClientSession, pointer: Pointer) -> tuple[Array, Array]:
        """Origin [m] and direction of the ray through a point of the view.

        Raises:
            InvalidArgumentError: the view is not connected.
        """
        camera = self.camera(session)
        half = float(np.tan(camera.fov / 2))
        # The axes of the camera are those of OpenCV: x to the right, y down, z forward.
        direction = np.array([pointer[0] * half * aspect_ratio(camera), -pointer[1] * half, 1.0])
        return np.asarray(camera.position, dtype=float), quat_rotate(normalize(camera.wxyz), normalize(direction))


class PickResult(msgspec.Struct, frozen=True, kw_only=True):
    """What a ray meets first."""

    id: BodyId
    point: Vector
    """In the world frame [m]."""
    is_corner: bool = False
    """Whether the point was moved to a corner of the body's box."""


class PointerPicker:
    """Finds what rays meet; the shapes of the latest state are kept. May be used from any thread."""

    def __init__(self, simulation: Simulation, views: ClientViews) -> None:
        """Reads nothing yet.

        Args:
            views: how bodies are drawn, and which are hidden.
        """
        self._simulation, self._views = simulation, views
        self._lock = threading.Lock()
        self._state: StateSnapshot | None = None
        self._scene: ShapeScene | None = None

    def pick(
        self,
        origin: Array,
        direction: Array,
        *,
        clip_height: float | None = None,
        culled: Collection[BodyId] = (),
        corners_too: bool = False,
    ) -> PickResult | None:
        """Returns what a ray meets first that is drawn; None without anything.

        Args:
            origin: where it starts [m].
            direction: a unit vector.
            clip_height: nothing above it is met [m].
            culled: bodies that are not drawn from where the ray starts.
            corners_too: whether a corner of the body's box near the point is taken instead.
        """
        with self._lock:
            scene = self._shapes()
        shown = self._views.appearances
        start = np.array(origin, dtype=float)
        if clip_height is not None and start[2] > clip_height:
            if direction[2] > -1e-6:
                return None
            start = start + direction * float((clip_height - start[2]) / direction[2])
        hidden = self._views.hidden.union(culled)
        skipped = np.array([body.id in hidden or body.id not in shown for body in scene.bodies], dtype=bool)
        limits = np.array([_MAX_RAY_M])
        for _ in range(_MAX_SKIPPED):
            distances, rows = scene.first_hits(start, np.asarray(direction)[None], limits, skipped)
            row = int(rows[0])
            if row < 0:
                return None
            body = scene.bodies[row]
            if _is_drawn_from(direction, body, shown[body.id]):
                point = start + float(distances[0]) * np.asarray(direction)
                return self._result(body, point, float(np.linalg.norm(point - origin)), corners_too=corners_too)
            skipped[row] = True
        return None

    def below(self, point: Vector) -> PickResult | None:
        """What is below a point [m]."""
        return self.pick(np.add(point, (0.0, 0.0, 1e-3)), np.array([0.0, 0.0, -1.0]))

    def body(self, id: BodyId) -> Body:
        """A body in its current state.

        Raises:
            BodyNotFoundError: there is no such body.
        """
        return self._simulation.snapshot().body(id)

    @staticmethod
    def _result(body: Body, point: Array, distance: float, *, corners_too: bool) -> PickResult:
        if corners_too and body.size is not None:
            ends = corners(pose_array([body.pose]), np.array([body.size]))
            gaps = np.linalg.norm(ends - point, axis=1)
            if gaps.min() < _CORNER_RADIUS * distance:
                return PickResult(id=body.id, point=_vector(ends[int(gaps.argmin())]), is_corner=True)
        return PickResult(id=body.id, point=_vector(point))

    def _shapes(self) -> ShapeScene:
        state = self._simulation.state
        if self._scene is None or state.poses is not (self._state and self._state.poses):
            self._state = state
            self._scene = ShapeScene(self._simulation.snapshot().bodies, self._simulation.geometry)
        return self._scene


def _is_drawn_from(direction: Array, body: Body, appearance: BodyAppearance) -> bool:
    """Whether a body is drawn as seen in a direction; of walls only the side towards the room is."""
    if appearance.part is VisiblePart.OUTLINE:
        return False
    if appearance.side is None or appearance.part is VisiblePart.WHOLE:
        return True
    axis, sign = appearance.side
    normal = rotation_matrix(normalize(np.array(body.pose.quaternion)))[:, axis] * sign
    return bool(normal @ direction < 0.0)


class PickRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `pick`: the body at a point of the view, or one of its corners."""

    pointer: Pointer
    corners: bool = True


class SelectBoxRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `bodies_in_box`: two opposite corners of a rectangle in the view."""

    first: Pointer
    second: Pointer


class MeasureRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `measure`: draws a line between points; without points, removes it."""

    points: Annotated[tuple[_Point, ...], msgspec.Meta(max_length=2)] = ()


class GapRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `measure_gap`: the distance between the boxes of two bodies."""

    first: BodyId
    second: BodyId


class Measurement(msgspec.Struct, frozen=True, kw_only=True):
    """A measured distance."""

    distance: float
    """[m]."""
    offset: Vector
    """From the first point or center to the second one [m]."""


class CameraRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `set_camera`: moves the camera with an animation."""

    position: _Point
    look_at: _Point
    field_of_view_rad: Annotated[float, msgspec.Meta(gt=0.01, lt=3.1)]


class StandardView(StrEnum):
    """A direction from which the camera looks, along the axes of the world."""

    FRONT = "front"
    BACK = "back"
    LEFT = "left"
    RIGHT = "right"
    TOP = "top"


_EYES: Mapping[StandardView, Vector] = {
    StandardView.FRONT: (1.0, 0.0, 0.0),
    StandardView.BACK: (-1.0, 0.0, 0.0),
    StandardView.LEFT: (0.0, 1.0, 0.0),
    StandardView.RIGHT: (0.0, -1.0, 0.0),
    StandardView.TOP: (0.0, 0.0, 1.0),
}
"""From the center to the camera: the front faces along x, as in ROS REP 103."""


class StandardViewRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `standard_view`: of the given bodies, or of everything."""

    view: StandardView
    ids: tuple[BodyId, ...] = ()


class SnappingRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `set_snapping` of the gizmo."""

    step_m: Annotated[float, msgspec.Meta(ge=0.0, le=10.0)] = 0.0
    step_deg: Annotated[float, msgspec.Meta(ge=0.0, le=180.0)] = 0.0
    to_surface: bool = False
    precise: bool = False


class ViewToolHandler:
    """Handles the requests of the tools."""

    def __init__(
        self, simulation: Simulation, channel: RpcChannel, session_views: SessionViews, picker: PointerPicker
    ) -> None:
        """Registers the requests.

        Args:
            channel: the channel of the pages.
            session_views: the views of pages.
            picker: finds what rays meet.
        """
        self._simulation, self._session_views, self._picker = simulation, session_views, picker
        self._views = session_views.views
        channel.register("pick", PickRequest, self._pick, READ, queue="pick")
        channel.register("bodies_in_box", SelectBoxRequest, self._bodies_in_box, READ, queue="pick")
        channel.register("measure", MeasureRequest, self._measure, READ, queue="view")
        channel.register("measure_gap", GapRequest, self._measure_gap, READ, queue="view")
        channel.register("camera", EmptyRequest, self._camera, READ, queue="view")
        channel.register("set_camera", CameraRequest, self._set_camera, READ, queue="view")
        channel.register("standard_view", StandardViewRequest, self._standard_view, READ, queue="view")
        channel.register("set_snapping", SnappingRequest, self._set_snapping, READ, queue="view")

    def _pick(self, session: ClientSession, request: PickRequest) -> PickResult | None:
        origin, direction = self._session_views.ray(session, request.pointer)
        height, culled = self._session_views.clip_height(session), self._session_views.culled(session)
        return self._picker.pick(origin, direction, clip_height=height, culled=culled, corners_too=request.corners)

    def _bodies_in_box(self, session: ClientSession, request: SelectBoxRequest) -> list[BodyId]:
        """The bodies that are drawn and whose centers are in a rectangle of the view."""
        camera = self._session_views.camera(session)
        state, shown = self._simulation.state, self._views.appearances
        hidden = self._views.hidden | self._session_views.culled(session)
        height = self._session_views.clip_height(session)
        if not state.ids:
            return []
        turn = rotation_matrix(normalize(np.asarray(camera.wxyz, dtype=float)))
        local = (state.poses[:, :3] - np.asarray(camera.position)) @ turn
        half = float(np.tan(camera.fov / 2))
        depth = np.maximum(local[:, 2], 1e-6)
        at = np.stack([local[:, 0] / (depth * half * aspect_ratio(camera)), -local[:, 1] / (depth * half)], axis=1)
        low, high = np.minimum(request.first, request.second), np.maximum(request.first, request.second)
        inside = (local[:, 2] > 0.0) & np.all((at >= low) & (at <= high), axis=1)
        if height is not None:
            inside &= state.poses[:, 2] <= height
        return [
            id
            for row in np.flatnonzero(inside).tolist()
            if (id := state.ids[row]) in shown
            and id not in hidden
            and not shown[id].is_building
            and shown[id].part is not VisiblePart.OUTLINE
        ]

    # -- measuring -----------------------------------------------------------------------------------------------------

    def _measure(self, session: ClientSession, request: MeasureRequest) -> Measurement | None:
        found = None
        if len(request.points) == 2:
            offset = np.subtract(request.points[1], request.points[0])
            found = Measurement(distance=float(np.linalg.norm(offset)), offset=_vector(offset))
        text = "" if found is None else _length(found.distance)
        for view in self._session_views.of(session):
            self._views.show_measurement(request.points, text, client=view)
        return found

    def _measure_gap(self, _: ClientSession, request: GapRequest) -> Measurement:
        """The gap between the bounding boxes of two bodies; 0 if they meet."""
        first, second = self._picker.body(request.first), self._picker.body(request.second)
        boxes = BodyBoxes.from_bodies((first, second))
        if len(boxes.bodies) < 2:
            lost = first.id if first.size is None else second.id
            raise InvalidArgumentError(lost, cause="its size is unknown")
        gap = float(box_gaps(boxes.boxes, np.array([0]), np.array([1]))[0])
        offset = np.subtract(second.pose.position, first.pose.position)
        return Measurement(distance=max(gap, 0.0), offset=_vector(offset))

    # -- the camera ----------------------------------------------------------------------------------------------------

    def _camera(self, session: ClientSession, _: EmptyRequest) -> CameraPose:
        camera = self._session_views.camera(session)
        return CameraPose(_vector(camera.position), _vector(camera.look_at), float(camera.fov))

    def _set_camera(self, session: ClientSession, request: CameraRequest) -> None:
        pose = CameraPose(request.position, request.look_at, request.field_of_view_rad)
        for view in self._session_views.of(session):
            self._views.move_camera(pose, client=view)

    def _standard_view(self, session: ClientSession, request: StandardViewRequest) -> None:
        points = self._points(request.ids)
        if not len(points):
            return
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        camera = self._session_views.camera(session)
        aspect = aspect_ratio(camera)
        eye = middle + np.array(_EYES[request.view])
        pose = focus_camera(points, _vector(eye), _vector(middle), aspect)
        for view in self._session_views.of(session):
            self._views.move_camera(pose, client=view)

    def _points(self, ids: Sequence[BodyId]) -> Array:
        """The corners of bodies, by default of those that the home view shows, n x 3 [m]."""
        if not ids:
            target = self._views.target
            return np.zeros((0, 3)) if target is None else target.points
        state, shown = self._simulation.state, self._views.appearances
        rows = {id: row for row, id in enumerate(state.ids)}
        if unknown := [id for id in ids if id not in rows or id not in shown]:
            raise BodyNotFoundError(unknown[0], known=state.ids)
        poses = state.poses[[rows[id] for id in ids]]
        return corners(poses, np.array([shown[id].size for id in ids]))

    def _set_snapping(self, session: ClientSession, request: SnappingRequest) -> None:
        snapping = Snapping(**msgspec.structs.asdict(request))
        for view in self._session_views.of(session):
            self._views.set_snapping(snapping, client=view)


def _length(distance: float) -> str:
    return f"{100 * distance:.1f} cm" if distance < 1.0 else f"{distance:.3f} m"


def _vector(array: Any) -> Vector:
    x, y, z = np.asarray(array, dtype=float).tolist()
    return x, y, z
