"""Pictures: a frame as the messages by which robots know a place: transforms, joint states, markers.

There are many of them every second, so those with many parts are written as JSON objects at once.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from mindstage.errors import EngineError
from mindstage.msgs import RosVersion, builtin_interfaces, encode, sensor_msgs, std_msgs, visualization_msgs
from mindstage.stage import StateSnapshot
from mindstage.world import AxisMotion, Body, BodyId, Color, Joint, PrimitiveType

__all__ = ["joint_state_message", "tf_message", "world_marker_array"]

_WORLD_FRAME = "world"
_NAMESPACE = "mindstage"
_DEFAULT_SIZE_M = 0.05
_GRAY: Color = (0.7, 0.7, 0.7)
_AXES = ("x", "y", "z", "twist", "swing2", "swing1")
_MARKER_TYPES = {
    PrimitiveType.SPHERE: visualization_msgs.MarkerType.SPHERE,
    PrimitiveType.CYLINDER: visualization_msgs.MarkerType.CYLINDER,
}

EncodedMessage = dict[str, Any]


def tf_message(frame: StateSnapshot, *, ros: RosVersion) -> EncodedMessage:
    """Where every body is in the world, as a `tf2_msgs/TFMessage`.

    Raises:
        EngineError: the engine tells of places that are no numbers.
    """
    header = encode(_header(frame), ros=ros)
    return {
        "transforms": [
            {
                "header": header,
                "child_frame_id": id,
                "transform": {
                    "translation": {"x": x, "y": y, "z": z},
                    "rotation": {"x": i, "y": j, "z": k, "w": w},
                },
            }
            for id, (x, y, z, w, i, j, k) in zip(frame.ids, _header_stamp(frame), strict=True)
        ]
    }


def joint_state_message(
    frame: StateSnapshot, joints: Iterable[Joint], positions: Mapping[BodyId, tuple[float, ...]]
) -> sensor_msgs.JointState:
    """How far every constraint has moved since it was spawned; one that moves in several ways has several names."""
    names: list[str] = []
    numbers: list[float] = []
    for constraint in joints:
        if constraint.id not in positions:
            continue
        axes = [at for at, axis in enumerate(_AXES) if _axis_motion(constraint, axis) is not AxisMotion.LOCKED]
        for at in axes:
            names.append(constraint.id if len(axes) == 1 else f"{constraint.id}/{_AXES[at]}")
            numbers.append(positions[constraint.id][at])
    return sensor_msgs.JointState(header=_header(frame), name=tuple(names), position=tuple(numbers))


def world_marker_array(frame: StateSnapshot, bodies: Iterable[Body], *, ros: RosVersion) -> EncodedMessage:
    """Every body as a form, as a `visualization_msgs/MarkerArray` that replaces the one before."""
    described = {body.id: body for body in bodies}
    header = _header(frame)
    blank = encode(visualization_msgs.Marker(header=header, ns=_NAMESPACE), ros=ros)
    markers: list[EncodedMessage] = [{**blank, "action": int(visualization_msgs.MarkerAction.DELETEALL)}]
    for number, (id, (x, y, z, w, i, j, k)) in enumerate(zip(frame.ids, _header_stamp(frame), strict=True)):
        body = described.get(id)
        width, depth, height = body.size if body and body.size else (_DEFAULT_SIZE_M,) * 3
        red, green, blue = frame.highlights.get(id) or _color(body)
        form = (
            _MARKER_TYPES.get(body.shape.type, visualization_msgs.MarkerType.CUBE)
            if body and body.shape
            else visualization_msgs.MarkerType.CUBE
        )
        pose = {"position": {"x": x, "y": y, "z": z}, "orientation": {"x": i, "y": j, "z": k, "w": w}}
        markers.append(
            {
                **blank,
                "id": number,
                "type": int(form),
                "pose": pose,
                "scale": {"x": width, "y": depth, "z": height},
                "color": {"r": red, "g": green, "b": blue, "a": 1.0},
                "text": id,
            }
        )
    return {"markers": markers}


def _header(frame: StateSnapshot) -> std_msgs.Header:
    return std_msgs.Header(stamp=builtin_interfaces.Time.at(frame.time_s), frame_id=_WORLD_FRAME)


def _header_stamp(frame: StateSnapshot) -> list[list[float]]:
    if not np.isfinite(frame.poses).all():
        raise EngineError("the engine tells of places that are no numbers")
    rows: list[list[float]] = frame.poses.tolist()
    return rows


def _axis_motion(joint: Joint, axis: str) -> AxisMotion:
    motion: AxisMotion = getattr(joint.linear if axis in {"x", "y", "z"} else joint.angular, axis)
    return motion


def _color(body: Body | None) -> Color:
    colors = (material.color for material in body.materials if material.color) if body else ()
    return next(iter(colors), _GRAY)
