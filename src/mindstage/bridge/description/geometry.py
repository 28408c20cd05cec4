"""Geometry: poses, points and colours on the wire. Nothing is converted but where the numbers stand.

The wire is in ROS's frame and in metres, as a world is; a quaternion is w x y z in memory and has four names there.
Digits stay as they are, so a quaternion that a map has normalised to six digits only arrives as it was.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from mindstage.msgs import geometry_msgs, std_msgs, world_control_msgs
from mindstage.world import Colour, Pose, Vector
from mindstage.world.colours import COLOURS

__all__ = [
    "colour_code",
    "colour_from",
    "colour_from_code",
    "colour_message",
    "point_from",
    "point_message",
    "pose_from",
    "pose_message",
    "pose_messages",
    "pose_rows",
    "vector_from",
    "vector_message",
]

_COLOURS: dict[world_control_msgs.ColourCode, Colour] = {
    world_control_msgs.ColourCode(code): colour for code, colour in enumerate(COLOURS.values(), start=1)
}


def pose_message(pose: Pose) -> geometry_msgs.Pose:
    """A pose for the wire."""
    w, x, y, z = pose.quaternion
    return geometry_msgs.Pose(
        position=point_message(pose.position), orientation=geometry_msgs.Quaternion(x=x, y=y, z=z, w=w)
    )


def pose_from(message: geometry_msgs.Pose) -> Pose:
    """A pose from the wire."""
    turn = message.orientation
    return Pose(point_from(message.position), (turn.w, turn.x, turn.y, turn.z))


def pose_messages(rows: NDArray[np.float64]) -> tuple[geometry_msgs.Pose, ...]:
    """Many poses for the wire, from an array n x 7: x y z, then w x y z."""
    return tuple(
        geometry_msgs.Pose(
            position=geometry_msgs.Point(x=x, y=y, z=z), orientation=geometry_msgs.Quaternion(x=i, y=j, z=k, w=w)
        )
        for x, y, z, w, i, j, k in rows.tolist()
    )


def pose_rows(messages: Sequence[geometry_msgs.Pose]) -> NDArray[np.float64]:
    """Many poses from the wire, as an array n x 7: x y z, then w x y z."""
    return np.array([_row(message) for message in messages], dtype=np.float64).reshape(-1, 7)


def _row(message: geometry_msgs.Pose) -> Iterable[float]:
    at, turn = message.position, message.orientation
    return at.x, at.y, at.z, turn.w, turn.x, turn.y, turn.z


def point_message(vector: Vector) -> geometry_msgs.Point:
    """A place for the wire."""
    x, y, z = vector
    return geometry_msgs.Point(x=x, y=y, z=z)


def point_from(message: geometry_msgs.Point) -> Vector:
    """A place from the wire."""
    return message.x, message.y, message.z


def vector_message(vector: Vector) -> geometry_msgs.Vector3:
    """A direction or a force for the wire."""
    x, y, z = vector
    return geometry_msgs.Vector3(x=x, y=y, z=z)


def vector_from(message: geometry_msgs.Vector3) -> Vector:
    """A direction or a force from the wire."""
    return message.x, message.y, message.z


def colour_message(colour: Colour, *, opacity: float = 1.0) -> std_msgs.ColorRGBA:
    """A colour for the wire."""
    red, green, blue = colour
    return std_msgs.ColorRGBA(r=red, g=green, b=blue, a=opacity)


def colour_from(message: std_msgs.ColorRGBA) -> Colour:
    """A colour from the wire, without its opacity."""
    return message.r, message.g, message.b


def colour_from_code(code: world_control_msgs.ColourCode) -> Colour | None:
    """The colour of a code; None puts out."""
    return _COLOURS.get(code)


def colour_code(colour: Colour | None) -> world_control_msgs.ColourCode:
    """The code whose colour is nearest; only five colours have one, so what comes back may be another colour."""
    if colour is None:
        return world_control_msgs.ColourCode.NONE
    return min(_COLOURS, key=lambda code: sum((a - b) ** 2 for a, b in zip(_COLOURS[code], colour, strict=True)))
