"""visualization_msgs: shapes that a program wants to be seen."""

from __future__ import annotations

from typing import ClassVar

from mindstage.msgs.builtin_interfaces import Duration
from mindstage.msgs.geometry_msgs import Point, Pose, Vector3
from mindstage.msgs.message import Message, Ros
from mindstage.msgs.primitives import Bool, Bytes, Float32, Int32, Int32Code, String
from mindstage.msgs.sensor_msgs import CompressedImage
from mindstage.msgs.std_msgs import ColorRGBA, Header

__all__ = ["Marker", "MarkerAction", "MarkerArray", "MarkerType", "MeshFile", "UVCoordinate"]


class MarkerType(Int32Code):
    """What a marker looks like."""

    ARROW = 0
    CUBE = 1
    SPHERE = 2
    CYLINDER = 3
    LINE_STRIP = 4
    LINE_LIST = 5
    CUBE_LIST = 6
    SPHERE_LIST = 7
    POINTS = 8
    TEXT_VIEW_FACING = 9
    MESH_RESOURCE = 10
    TRIANGLE_LIST = 11
    ARROW_STRIP = 12


class MarkerAction(Int32Code):
    """What is to be done with a marker."""

    ADD = 0
    MODIFY = 0
    DELETE = 2
    DELETEALL = 3


class UVCoordinate(Message, frozen=True):
    """A place in a texture, 0 to 1."""

    u: Float32 = 0.0
    v: Float32 = 0.0


class MeshFile(Message, frozen=True):
    """A mesh that travels inside of the message."""

    filename: String = ""
    data: Bytes = b""


class Marker(Message, frozen=True):
    """One shape; namespace and id together say which."""

    only_in: ClassVar = dict.fromkeys(("texture_resource", "texture", "uv_coordinates", "mesh_file"), Ros.TWO)

    header: Header = Header()
    ns: String = ""
    id: Int32 = 0
    type: MarkerType = MarkerType.ARROW
    action: MarkerAction = MarkerAction.ADD
    pose: Pose = Pose()
    scale: Vector3 = Vector3()
    color: ColorRGBA = ColorRGBA()
    lifetime: Duration = Duration()
    """Zero is for ever."""
    frame_locked: Bool = False
    points: tuple[Point, ...] = ()
    colors: tuple[ColorRGBA, ...] = ()
    """None, or one for each point."""
    texture_resource: String = ""
    texture: CompressedImage = CompressedImage()
    uv_coordinates: tuple[UVCoordinate, ...] = ()
    text: String = ""
    mesh_resource: String = ""
    mesh_file: MeshFile = MeshFile()
    mesh_use_embedded_materials: Bool = False


class MarkerArray(Message, frozen=True):
    """Some shapes."""

    markers: tuple[Marker, ...] = ()
