"""Markers and trajectories, by the services of `unreal_vis_msgs` and by messages as in RViz."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from msgspec.structs import replace

from mindstage.access.limits import MARKERS
from mindstage.access.policies import EDIT
from mindstage.bridge.conversions import color_from_message, point_from_message, pose_from_message, vector_from_message
from mindstage.errors import BodyNotFoundError, WorldError
from mindstage.msgs import std_msgs, visualization_msgs
from mindstage.msgs import unreal_vis_msgs as wire
from mindstage.ros.diagnostics import DiagnosticsPublisher
from mindstage.ros.service import ServiceSpec
from mindstage.ros.state import StateReader, free_id
from mindstage.scene import Color, Pose, Vector
from mindstage.scene.transforms import Array, normalized_pose_array, pose_multiply
from mindstage.simulation import Marker, MarkerType

__all__ = ["UnrealVisServices", "marker_from_message"]

_DEFAULT_SIZE_M = 0.1
"""Size of a marker without a scale [m]."""
_DEFAULT_LINE_WIDTH_M = 0.01
_BASIC_MARKER_TYPES = {
    wire.BasicMarkerType.POINT: MarkerType.SPHERE,
    wire.BasicMarkerType.CUBE: MarkerType.CUBE,
    wire.BasicMarkerType.SPHERE: MarkerType.SPHERE,
    wire.BasicMarkerType.CYLINDER: MarkerType.CYLINDER,
    wire.BasicMarkerType.CONE: MarkerType.CONE,
    wire.BasicMarkerType.ARROW: MarkerType.ARROW,
}
_BODY_SCHEME = "body://"
_UNSUPPORTED_HINTS = {
    visualization_msgs.MarkerType.MESH_RESOURCE: f", except for a copy of a body, with the resource {_BODY_SCHEME}ID"
}
_MARKER_TYPES = {
    visualization_msgs.MarkerType.ARROW: MarkerType.ARROW,
    visualization_msgs.MarkerType.CUBE: MarkerType.CUBE,
    visualization_msgs.MarkerType.SPHERE: MarkerType.SPHERE,
    visualization_msgs.MarkerType.CYLINDER: MarkerType.CYLINDER,
    visualization_msgs.MarkerType.LINE_STRIP: MarkerType.LINE_STRIP,
    visualization_msgs.MarkerType.LINE_LIST: MarkerType.LINE_LIST,
    visualization_msgs.MarkerType.CUBE_LIST: MarkerType.POINTS,
    visualization_msgs.MarkerType.SPHERE_LIST: MarkerType.POINTS,
    visualization_msgs.MarkerType.POINTS: MarkerType.POINTS,
    visualization_msgs.MarkerType.TEXT_VIEW_FACING: MarkerType.TEXT,
    visualization_msgs.MarkerType.ARROW_STRIP: MarkerType.LINE_STRIP,
    visualization_msgs.MarkerType.MESH_RESOURCE: MarkerType.BODY_COPY,
}


class UnrealVisServices:
    """Services and message handlers for markers."""

    def __init__(self, state_reader: StateReader, diagnostics: DiagnosticsPublisher) -> None:
        self._state_reader = state_reader
        self._simulation = state_reader.simulation
        self._diagnostics = diagnostics
        self._from_messages: set[str] = set()

    def services(self) -> Iterator[ServiceSpec]:
        """Yields all services."""
        yield ServiceSpec(wire.DisplayBasicMarker, self.display_basic_marker, EDIT)
        yield ServiceSpec(wire.DisplayTrajectory, self.display_trajectory, EDIT)
        yield ServiceSpec(wire.RemoveMarker, self.remove_marker, EDIT)

    def display_basic_marker(self, request: wire.DisplayBasicMarker.Request) -> wire.DisplayBasicMarker.Response:
        """Adds a marker; a fully transparent color is displayed opaque."""
        id = request.marker_id or self._free_id("marker")
        size = abs(request.scale) or _DEFAULT_SIZE_M
        marker_type = _BASIC_MARKER_TYPES[request.marker_type]
        marker = Marker(
            id=id,
            type=marker_type,
            pose=pose_from_message(request.pose),
            size=(size, size / 5, size / 5) if marker_type is MarkerType.ARROW else (size, size, size),
            color=color_from_message(request.color),
            opacity=request.color.a or 1.0,
        )
        self._add_marker(marker)
        return wire.DisplayBasicMarker.Response(marker_id=id)

    def display_trajectory(self, request: wire.DisplayTrajectory.Request) -> wire.DisplayTrajectory.Response:
        """Adds a line whose color is interpolated from its first to its last point by arc length."""
        id = request.marker_id or self._free_id("trajectory")
        points = tuple(map(point_from_message, request.points))
        marker = Marker(
            id=id,
            type=MarkerType.LINE_STRIP,
            size=(_DEFAULT_LINE_WIDTH_M, _DEFAULT_LINE_WIDTH_M, _DEFAULT_LINE_WIDTH_M),
            color=color_from_message(request.color_begin),
            opacity=max(request.color_begin.a, request.color_end.a) or 1.0,
            points=points,
            colors=_color_gradient(points, request.color_begin, request.color_end),
        )
        self._add_marker(marker)
        return wire.DisplayTrajectory.Response(marker_id=id)

    def remove_marker(self, request: wire.RemoveMarker.Request) -> wire.RemoveMarker.Response:
        """Removes a marker."""
        removed = bool(self._simulation.markers.remove([request.marker_id]))
        if not removed:
            existing = ", ".join(marker.id for marker in self._simulation.state.markers[:10]) or "none"
            self._diagnostics.report_failures(
                "remove_marker", [(request.marker_id, f"there is no such marker; there is {existing}")]
            )
        return wire.RemoveMarker.Response(success=removed)

    def on_markers(self, message: visualization_msgs.MarkerArray) -> None:
        """Handles an array of markers, as RViz does."""
        for marker in message.markers:
            self.on_marker(marker)

    def on_marker(self, message: visualization_msgs.Marker) -> None:
        """Handles a marker."""
        id = f"{message.ns}/{message.id}"
        match message.action:
            case visualization_msgs.MarkerAction.DELETE:
                self._remove_markers([id])
            case visualization_msgs.MarkerAction.DELETEALL:
                self._remove_markers(
                    [each for each in self._from_messages if not message.ns or each.startswith(f"{message.ns}/")]
                )
            case _:
                try:
                    marker = marker_from_message(message, id, self._state_reader)
                    if marker is None:
                        raise WorldError(
                            f"a {message.type.name} is not supported{_UNSUPPORTED_HINTS.get(message.type, '')}"
                        )
                    if marker.body and marker.body not in self._simulation.state.ids:
                        raise BodyNotFoundError(marker.body, known=self._simulation.state.ids)
                    self._add_marker(marker, lifetime_s=message.lifetime.seconds or None)
                except WorldError as error:
                    self._diagnostics.report_failures("markers", [(id, str(error))])
                else:
                    self._from_messages.add(id)

    def _add_marker(self, marker: Marker, *, lifetime_s: float | None = None) -> None:
        """Adds a marker.

        Raises:
            WorldError: there are too many markers.
        """
        markers = self._simulation.state.markers
        if len(markers) >= MARKERS.count and all(each.id != marker.id for each in markers):
            raise WorldError(f"{MARKERS.count} markers exist already; remove some first")
        if len(self._from_messages) > 2 * MARKERS.count:  # most have expired
            self._from_messages.intersection_update(each.id for each in markers)
        self._simulation.markers.add([marker], lifetime_s=lifetime_s)

    def _remove_markers(self, ids: list[str]) -> None:
        self._simulation.markers.remove(ids)
        self._from_messages.difference_update(ids)

    def _free_id(self, stem: str) -> str:
        return free_id(stem, {marker.id for marker in self._simulation.state.markers})


def marker_from_message(message: visualization_msgs.Marker, id: str, state_reader: StateReader) -> Marker | None:
    """Converts a message to a marker; None for unsupported types (triangles, and meshes other than those of bodies).

    Raises:
        BodyNotFoundError: the frame is neither a body nor the world.
    """
    marker_type = _MARKER_TYPES.get(message.type)
    if marker_type is None or (
        marker_type is MarkerType.BODY_COPY and not message.mesh_resource.startswith(_BODY_SCHEME)
    ):
        return None
    marker = Marker(
        id=id,
        type=marker_type,
        pose=state_reader.to_world_frame(pose_from_message(message.pose), message.header.frame_id),
        size=_size(message, marker_type),
        color=color_from_message(message.color),
        opacity=message.color.a,
        points=tuple(map(point_from_message, message.points)),
        colors=tuple(map(color_from_message, message.colors)),
        text=message.text,
        body=message.mesh_resource.removeprefix(_BODY_SCHEME) if marker_type is MarkerType.BODY_COPY else "",
    )
    if marker_type is MarkerType.ARROW and len(marker.points) >= 2:
        return _arrow_between(marker, message)
    return marker


def _size(message: visualization_msgs.Marker, type: MarkerType) -> Vector:
    x, y, z = vector_from_message(message.scale)
    if type in {MarkerType.LINE_STRIP, MarkerType.LINE_LIST}:
        return x or _DEFAULT_LINE_WIDTH_M, x or _DEFAULT_LINE_WIDTH_M, x or _DEFAULT_LINE_WIDTH_M
    return (z, z, z) if type is MarkerType.TEXT else (x, y, z)


def _arrow_between(marker: Marker, message: visualization_msgs.Marker) -> Marker:
    """Returns an arrow that is given by its end points; the scale is then the diameter of the shaft and the head."""
    start, end = np.array(marker.points[0]), np.array(marker.points[1])
    length = float(np.linalg.norm(end - start))
    rotation = _rotation_from_x((end - start) / length) if length > 0.0 else np.array([1.0, 0.0, 0.0, 0.0])
    row = pose_multiply(normalized_pose_array(marker.pose), np.concatenate([start, rotation])).tolist()
    width = message.scale.y or message.scale.x or length / 5
    pose = Pose((row[0], row[1], row[2]), (row[3], row[4], row[5], row[6]))
    return replace(marker, pose=pose, size=(length, width, width), points=(), colors=())


def _rotation_from_x(direction: Array) -> Array:
    """Returns the shortest rotation of the x axis to a direction, as w x y z."""
    if direction[0] < -1.0 + 1e-12:
        return np.array([0.0, 0.0, 0.0, 1.0])
    half = np.array([1.0 + direction[0], 0.0, -direction[2], direction[1]])
    return np.asarray(half / np.linalg.norm(half))


def _color_gradient(
    points: tuple[Vector, ...], begin: std_msgs.ColorRGBA, end: std_msgs.ColorRGBA
) -> tuple[Color, ...]:
    if not points:
        return ()
    lengths = np.linalg.norm(np.diff(np.array(points), axis=0), axis=1)
    positions = np.concatenate([[0.0], np.cumsum(lengths)])
    fractions = positions / positions[-1] if positions[-1] > 0.0 else np.linspace(0.0, 1.0, len(points))
    first, last = np.array(color_from_message(begin)), np.array(color_from_message(end))
    rows = (first + fractions[:, None] * (last - first)).tolist()
    return tuple((red, green, blue) for red, green, blue in rows)
