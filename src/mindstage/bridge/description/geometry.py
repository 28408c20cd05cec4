"""Geometry: poses, points and colors on the wire. Nothing is converted but where the numbers stand.

The wire is in ROS's frame and in meters, as a world is; a quaternion is w x y z in memory and has four names there.
Digits stay as they are, so a quaternion that a map has normalized to six digits only arrives as it was.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from mindstage.msgs import geometry_msgs, std_msgs, world_control_msgs
from mindstage.world import Color, Pose, Vector
from mindstage.world.colors import COLORS

__all__ = [
    "color_code",
    "color_from_code",
    "color_from_message",
    "color_message",
    "point_from_message",
    "point_message",
    "pose_array_from_messages",
    "pose_array_messages",
    "pose_from_message",
    "pose_message",
    "vector_from_message",
    "vector_message",
]

_COLORS: dict[world_control_msgs.ColorCode, Color] = {
    world_control_msgs.ColorCode(code): color for code, color in enumerate(COLORS.values(), start=1)
}


def pose_message(pose: Pose) -> geometry_msgs.Pose:
    """A pose for the wire."""
    w, x, y, z = pose.quaternion
    return geometry_msgs.Pose(
        position=point_message(pose.position), orientation=geometry_msgs.Quaternion(x=x, y=y, z=z, w=w)
    )


def pose_from_message(message: geometry_msgs.Pose) -> Pose:
    """A pose from the wire."""
    turn = message.orientation
    return Pose(point_from_message(message.position), (turn.w, turn.x, turn.y, turn.z))


def pose_array_messages(rows: NDArray[np.float64]) -> tuple[geometry_msgs.Pose, ...]:
    """Many poses for the wire, from an array n x 7: x y z, then w x y z."""
    return tuple(
        geometry_msgs.Pose(
            position=geometry_msgs.Point(x=x, y=y, z=z), orientation=geometry_msgs.Quaternion(x=i, y=j, z=k, w=w)
        )
        for x, y, z, w, i, j, k in rows.tolist()
    )


def pose_array_from_messages(messages: Sequence[geometry_msgs.Pose]) -> NDArray[np.float64]:
    """Many poses from the wire, as an array n x 7: x y z, then w x y z."""
    return np.array([_pose_row(message) for message in messages], dtype=np.float64).reshape(-1, 7)


def _pose_row(message: geometry_msgs.Pose) -> Iterable[float]:
    at, turn = message.position, message.orientation
    return at.x, at.y, at.z, turn.w, turn.x, turn.y, turn.z


def point_message(vector: Vector) -> geometry_msgs.Point:
    """A place for the wire."""
    x, y, z = vector
    return geometry_msgs.Point(x=x, y=y, z=z)


def point_from_message(message: geometry_msgs.Point) -> Vector:
    """A place from the wire."""
    return message.x, message.y, message.z


def vector_message(vector: Vector) -> geometry_msgs.Vector3:
    """A direction or a force for the wire."""
    x, y, z = vector
    return geometry_msgs.Vector3(x=x, y=y, z=z)


def vector_from_message(message: geometry_msgs.Vector3) -> Vector:
    """A direction or a force from the wire."""
    return message.x, message.y, message.z


def color_message(color: Color, *, opacity: float = 1.0) -> std_msgs.ColorRGBA:
    """A color for the wire."""
    red, green, blue = color
    return std_msgs.ColorRGBA(r=red, g=green, b=blue, a=opacity)


def color_from_message(message: std_msgs.ColorRGBA) -> Color:
    """A color from the wire, without its opacity."""
    return message.r, message.g, message.b


def color_from_code(code: world_control_msgs.ColorCode) -> Color | None:
    """The color of a code; None puts out."""
    return _COLORS.get(code)


def color_code(color: Color | None) -> world_control_msgs.ColorCode:
    """The code whose color is nearest; only five colors have one, so what comes back may be another color."""
    if color is None:
        return world_control_msgs.ColorCode.NONE
    return min(_COLORS, key=lambda code: sum((a - b) ** 2 for a, b in zip(_COLORS[code], color, strict=True)))
