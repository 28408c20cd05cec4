"""Bags written by rosbags alone: no code of Mindstage takes part in writing them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation

__all__ = ["BAG_FORMATS", "JointReading", "Transform", "matrix", "matrix_of_pose", "write_bag"]

BAG_FORMATS = ("ros1", "sqlite3", "mcap")
SECOND = 1_000_000_000


class Transform(NamedTuple):
    """A transform of `/tf` or `/tf_static`."""

    time_s: float
    parent: str
    child: str
    matrix: NDArray[np.float64]
    static: bool = False
    logged_s: float | None = None
    """When it was recorded; by default at its time."""
    is_negated: bool = False
    """Whether the quaternion is written with the other sign, which is the same rotation."""


class JointReading(NamedTuple):
    """A message of `/joint_states`."""

    time_s: float
    positions: dict[str, float]


def matrix(position: Sequence[float], *, yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0) -> Any:
    """A homogeneous matrix, from a position and extrinsic roll, pitch, yaw."""
    result = np.eye(4)
    result[:3, :3] = Rotation.from_euler("xyz", [roll, pitch, yaw]).as_matrix()
    result[:3, 3] = position
    return result


def matrix_of_pose(pose: Sequence[float]) -> Any:
    """A homogeneous matrix, from x y z and w x y z."""
    result = np.eye(4)
    result[:3, :3] = Rotation.from_quat(np.roll(pose[3:], -1)).as_matrix()
    result[:3, 3] = pose[:3]
    return result


def write_bag(
    folder: Path, format: str, messages: Iterable[Transform | JointReading], *, start_s: float = 0.0, name: str = "run"
) -> Path:
    """Writes messages in their order; each is recorded at its time, unless it says otherwise.

    Args:
        folder: where it is written.
        format: one of `BAG_FORMATS`.
        messages: what is written.
        start_s: added to all times.
        name: the name of the file or folder.
    """
    store = get_typestore(Stores.ROS1_NOETIC if format == "ros1" else Stores.ROS2_HUMBLE)
    if "tf2_msgs/msg/TFMessage" not in store.types:  # rosbags' types of ROS 1 lack it
        definition = "geometry_msgs/TransformStamped[] transforms"
        store.register(get_types_from_msg(definition, "tf2_msgs/msg/TFMessage"))
    types = store.types
    sequence = {"seq": 0} if format == "ros1" else {}

    def header(time_s: float, frame: str) -> Any:
        at = round((time_s + start_s) * SECOND)
        stamp = types["builtin_interfaces/msg/Time"](sec=at // SECOND, nanosec=at % SECOND)
        return types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame, **sequence)

    def content(message: Transform | JointReading) -> tuple[str, str, Any]:
        if isinstance(message, JointReading):
            empty = np.zeros(0)
            positions = np.array(list(message.positions.values()), dtype=np.float64)
            joints = types["sensor_msgs/msg/JointState"](
                header=header(message.time_s, ""),
                name=list(message.positions),
                position=positions,
                velocity=empty,
                effort=empty,
            )
            return "/joint_states", "sensor_msgs/msg/JointState", joints
        sign = -1.0 if message.is_negated else 1.0
        x, y, z, w = (sign * Rotation.from_matrix(message.matrix[:3, :3]).as_quat()).tolist()
        at = message.matrix[:3, 3].tolist()
        transform = types["geometry_msgs/msg/Transform"](
            translation=types["geometry_msgs/msg/Vector3"](*at),
            rotation=types["geometry_msgs/msg/Quaternion"](x=x, y=y, z=z, w=w),
        )
        stamped = types["geometry_msgs/msg/TransformStamped"](
            header=header(message.time_s, message.parent), child_frame_id=message.child, transform=transform
        )
        topic = "/tf_static" if message.static else "/tf"
        return topic, "tf2_msgs/msg/TFMessage", types["tf2_msgs/msg/TFMessage"](transforms=[stamped])

    if format == "ros1":
        path = folder / f"{name}.bag"
        writer: Any = Writer1(path)
    else:
        path = folder / name
        plugin = StoragePlugin.MCAP if format == "mcap" else StoragePlugin.SQLITE3
        writer = Writer2(path, version=9, storage_plugin=plugin)
    with writer:
        connections: dict[str, Any] = {}
        for message in messages:
            topic, type, value = content(message)
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, type, typestore=store)
            data = store.serialize_ros1(value, type) if format == "ros1" else store.serialize_cdr(value, type)
            logged = getattr(message, "logged_s", None)
            at = round(((message.time_s if logged is None else logged) + start_s) * SECOND)
            writer.write(connections[topic], at, data)
    return path
