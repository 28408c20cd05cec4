"""unreal_vis_msgs: markers and trajectories in Unreal."""
# ruff: noqa: D106 - Request and Response say what they are

from __future__ import annotations

from mindstage.msgs.geometry_msgs import Point, Pose
from mindstage.msgs.message import Message, Service
from mindstage.msgs.primitives import Bool, Float64, String, Uint8Code
from mindstage.msgs.std_msgs import ColorRGBA

__all__ = ["BasicMarkerType", "DisplayBasicMarker", "DisplayTrajectory", "RemoveMarker"]


class BasicMarkerType(Uint8Code):
    """What a marker looks like."""

    POINT = 0
    CUBE = 1
    SPHERE = 2
    CYLINDER = 3
    CONE = 4
    ARROW = 5


class DisplayBasicMarker(Service):
    """Shows a marker; without an id it gets one."""

    class Request(Message, frozen=True):
        marker_type: BasicMarkerType = BasicMarkerType.POINT
        pose: Pose = Pose()
        color: ColorRGBA = ColorRGBA()
        scale: Float64 = 0.0
        marker_id: String = ""

    class Response(Message, frozen=True):
        marker_id: String = ""


class DisplayTrajectory(Service):
    """Shows a line of points, whose colour runs from the first to the last."""

    class Request(Message, frozen=True):
        points: tuple[Point, ...] = ()
        color_begin: ColorRGBA = ColorRGBA()
        color_end: ColorRGBA = ColorRGBA()
        marker_id: String = ""

    class Response(Message, frozen=True):
        marker_id: String = ""


class RemoveMarker(Service):
    """Takes a marker or a trajectory away."""

    class Request(Message, frozen=True):
        marker_id: String = ""

    class Response(Message, frozen=True):
        success: Bool = False
