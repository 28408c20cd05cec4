"""Unreal vis: markers and trajectories, by services and by messages.

Messages are acted on whether or not anyone listens: a control system shows what it thinks and goes on.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from msgspec.structs import replace

from mindstage.bridge.description import colour_from, point_from, pose_from, vector_from
from mindstage.errors import BodyUnknown, WorldError
from mindstage.msgs import std_msgs, visualization_msgs
from mindstage.msgs import unreal_vis_msgs as wire
from mindstage.ros.diagnostics import Diagnostics
from mindstage.ros.names import free_id
from mindstage.ros.offer import ServiceOffer
from mindstage.ros.sight import Sight
from mindstage.stage import Marker, MarkerForm
from mindstage.world import Colour, Pose, Vector
from mindstage.world.geometry import Array, compose, unit_pose

__all__ = ["UnrealVis", "marker_from"]

_USUAL_M = 0.1
"""How large a marker without a scale is [m]."""
_LINE_M = 0.01
_MOST = 10_000
"""So many markers may be shown; nobody sees more, and the memory is not without end."""
_BASIC = {
    wire.BasicMarkerType.POINT: MarkerForm.SPHERE,
    wire.BasicMarkerType.CUBE: MarkerForm.CUBE,
    wire.BasicMarkerType.SPHERE: MarkerForm.SPHERE,
    wire.BasicMarkerType.CYLINDER: MarkerForm.CYLINDER,
    wire.BasicMarkerType.CONE: MarkerForm.CONE,
    wire.BasicMarkerType.ARROW: MarkerForm.ARROW,
}
_BODY = "body://"
_HINTS = {visualization_msgs.MarkerType.MESH_RESOURCE: f"; the ghost of a body can, as the resource {_BODY}ID"}
_FORMS = {
    visualization_msgs.MarkerType.ARROW: MarkerForm.ARROW,
    visualization_msgs.MarkerType.CUBE: MarkerForm.CUBE,
    visualization_msgs.MarkerType.SPHERE: MarkerForm.SPHERE,
    visualization_msgs.MarkerType.CYLINDER: MarkerForm.CYLINDER,
    visualization_msgs.MarkerType.LINE_STRIP: MarkerForm.LINE,
    visualization_msgs.MarkerType.LINE_LIST: MarkerForm.LINES,
    visualization_msgs.MarkerType.CUBE_LIST: MarkerForm.POINTS,
    visualization_msgs.MarkerType.SPHERE_LIST: MarkerForm.POINTS,
    visualization_msgs.MarkerType.POINTS: MarkerForm.POINTS,
    visualization_msgs.MarkerType.TEXT_VIEW_FACING: MarkerForm.TEXT,
    visualization_msgs.MarkerType.ARROW_STRIP: MarkerForm.LINE,
    visualization_msgs.MarkerType.MESH_RESOURCE: MarkerForm.GHOST,
}


class UnrealVis:
    """Shows markers on a stage."""

    def __init__(self, sight: Sight, diagnostics: Diagnostics) -> None:
        self._sight = sight
        self._stage = sight.stage
        self._diagnostics = diagnostics
        self._from_messages: set[str] = set()

    def offers(self) -> Iterator[ServiceOffer]:
        """All services."""
        yield ServiceOffer(wire.DisplayBasicMarker, self.display_basic_marker)
        yield ServiceOffer(wire.DisplayTrajectory, self.display_trajectory)
        yield ServiceOffer(wire.RemoveMarker, self.remove_marker)

    def display_basic_marker(self, request: wire.DisplayBasicMarker.Request) -> wire.DisplayBasicMarker.Response:
        """One form; a colour that is wholly transparent is taken as opaque, since nobody asks for what is unseen."""
        id = request.marker_id or self._free("marker")
        size = abs(request.scale) or _USUAL_M
        form = _BASIC[request.marker_type]
        marker = Marker(
            id=id,
            form=form,
            pose=pose_from(request.pose),
            size=(size, size / 5, size / 5) if form is MarkerForm.ARROW else (size, size, size),
            colour=colour_from(request.color),
            opacity=request.color.a or 1.0,
        )
        self._show(marker)
        return wire.DisplayBasicMarker.Response(marker_id=id)

    def display_trajectory(self, request: wire.DisplayTrajectory.Request) -> wire.DisplayTrajectory.Response:
        """A line whose colour runs from its first to its last point, evenly by its length."""
        id = request.marker_id or self._free("trajectory")
        points = tuple(map(point_from, request.points))
        marker = Marker(
            id=id,
            form=MarkerForm.LINE,
            size=(_LINE_M, _LINE_M, _LINE_M),
            colour=colour_from(request.color_begin),
            opacity=max(request.color_begin.a, request.color_end.a) or 1.0,
            points=points,
            colours=_run(points, request.color_begin, request.color_end),
        )
        self._show(marker)
        return wire.DisplayTrajectory.Response(marker_id=id)

    def remove_marker(self, request: wire.RemoveMarker.Request) -> wire.RemoveMarker.Response:
        """Takes one away."""
        gone = bool(self._stage.unmark([request.marker_id]))
        if not gone:
            shown = ", ".join(marker.id for marker in self._stage.frame.markers[:10]) or "none"
            self._diagnostics.failed(
                "remove_marker", [(request.marker_id, f"there is no such marker; there is {shown}")]
            )
        return wire.RemoveMarker.Response(success=gone)

    def on_markers(self, message: visualization_msgs.MarkerArray) -> None:
        """Does what an array of markers says, as RViz would."""
        for marker in message.markers:
            self.on_marker(marker)

    def on_marker(self, message: visualization_msgs.Marker) -> None:
        """One of them."""
        id = f"{message.ns}/{message.id}"
        match message.action:
            case visualization_msgs.MarkerAction.DELETE:
                self._take_away([id])
            case visualization_msgs.MarkerAction.DELETEALL:
                self._take_away(
                    [each for each in self._from_messages if not message.ns or each.startswith(f"{message.ns}/")]
                )
            case _:
                try:
                    marker = marker_from(message, id, self._sight)
                    if marker is None:
                        raise WorldError(f"a {message.type.name} cannot be shown here{_HINTS.get(message.type, '')}")
                    if marker.body and marker.body not in self._stage.frame.ids:
                        raise BodyUnknown(marker.body, known=self._stage.frame.ids)
                    self._show(marker, lifetime_s=message.lifetime.seconds or None)
                except WorldError as error:
                    self._diagnostics.failed("markers", [(id, str(error))])
                else:
                    self._from_messages.add(id)

    def _show(self, marker: Marker, *, lifetime_s: float | None = None) -> None:
        """Shows one more, if there is room for it.

        Raises:
            WorldError: there are too many.
        """
        shown = self._stage.frame.markers
        if len(shown) >= _MOST and all(each.id != marker.id for each in shown):
            raise WorldError(f"{_MOST} markers are shown already; take some away first")
        if len(self._from_messages) > 2 * _MOST:  # most have gone by themselves
            self._from_messages.intersection_update(each.id for each in shown)
        self._stage.mark([marker], lifetime_s=lifetime_s)

    def _take_away(self, ids: list[str]) -> None:
        self._stage.unmark(ids)
        self._from_messages.difference_update(ids)

    def _free(self, stem: str) -> str:
        return free_id(stem, {marker.id for marker in self._stage.frame.markers})


def marker_from(message: visualization_msgs.Marker, id: str, sight: Sight) -> Marker | None:
    """The marker that a message means; None for what has no form here (triangles, and meshes but for those of bodies).

    Raises:
        BodyUnknown: its frame is no body and not the world.
    """
    form = _FORMS.get(message.type)
    if form is None or (form is MarkerForm.GHOST and not message.mesh_resource.startswith(_BODY)):
        return None
    marker = Marker(
        id=id,
        form=form,
        pose=sight.in_world(pose_from(message.pose), message.header.frame_id),
        size=_size(message, form),
        colour=colour_from(message.color),
        opacity=message.color.a,
        points=tuple(map(point_from, message.points)),
        colours=tuple(map(colour_from, message.colors)),
        text=message.text,
        body=message.mesh_resource.removeprefix(_BODY) if form is MarkerForm.GHOST else "",
    )
    if form is MarkerForm.ARROW and len(marker.points) >= 2:
        return _arrow_between(marker, message)
    return marker


def _size(message: visualization_msgs.Marker, form: MarkerForm) -> Vector:
    x, y, z = vector_from(message.scale)
    if form in {MarkerForm.LINE, MarkerForm.LINES}:
        return x or _LINE_M, x or _LINE_M, x or _LINE_M
    return (z, z, z) if form is MarkerForm.TEXT else (x, y, z)


def _arrow_between(marker: Marker, message: visualization_msgs.Marker) -> Marker:
    """An arrow told by its ends instead of its pose; the scale is then how thick the shaft and the head are."""
    start, end = np.array(marker.points[0]), np.array(marker.points[1])
    length = float(np.linalg.norm(end - start))
    turn = _turn_of_x_to((end - start) / length) if length > 0.0 else np.array([1.0, 0.0, 0.0, 0.0])
    placed = compose(unit_pose(marker.pose), np.concatenate([start, turn])).tolist()
    width = message.scale.y or message.scale.x or length / 5
    pose = Pose((placed[0], placed[1], placed[2]), (placed[3], placed[4], placed[5], placed[6]))
    return replace(marker, pose=pose, size=(length, width, width), points=(), colours=())


def _turn_of_x_to(direction: Array) -> Array:
    """The shortest turn of the x axis to a direction, as w x y z."""
    if direction[0] < -1.0 + 1e-12:
        return np.array([0.0, 0.0, 0.0, 1.0])
    half = np.array([1.0 + direction[0], 0.0, -direction[2], direction[1]])
    return np.asarray(half / np.linalg.norm(half))


def _run(points: tuple[Vector, ...], begin: std_msgs.ColorRGBA, end: std_msgs.ColorRGBA) -> tuple[Colour, ...]:
    if not points:
        return ()
    ways = np.linalg.norm(np.diff(np.array(points), axis=0), axis=1)
    passed = np.concatenate([[0.0], np.cumsum(ways)])
    shares = passed / passed[-1] if passed[-1] > 0.0 else np.linspace(0.0, 1.0, len(points))
    first, last = np.array(colour_from(begin)), np.array(colour_from(end))
    rows = (first + shares[:, None] * (last - first)).tolist()
    return tuple((red, green, blue) for red, green, blue in rows)
