"""Bags of ROS as recordings of a known map: ROS 1 bags, and rosbag2 with SQLite or MCAP.

Read are the transforms of `/tf` and `/tf_static` and the joint positions of `/joint_states`; `transform_recording`
says how they move the bodies of the map.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Collection, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

from mindstage.episodes.recording import EpisodeEvent, Recording
from mindstage.episodes.transform_recording import TransformLog, TransformRecording, listed
from mindstage.errors import EpisodeFileError, without_surrogates
from mindstage.ranges import Frequency, checked
from mindstage.scene import NO_GEOMETRY, BodyId, GeometryMap, World
from mindstage.scene.display import counted

__all__ = ["RosBag"]


class RosBag(TransformRecording):
    """A bag as a `Recording` of a map."""

    @checked
    def __init__(
        self,
        path: str | PathLike[str],
        world: World,
        *,
        bodies: Mapping[str, BodyId] | None = None,
        map_frame: str | None = None,
        relative: bool | Collection[str] = False,
        rate_hz: Frequency | None = 30.0,
        geometry: GeometryMap = NO_GEOMETRY,
        events: Callable[[Recording], tuple[EpisodeEvent, ...]] | None = None,
    ) -> None:
        """Reads a bag.

        Args:
            path: a file `.bag`, `.mcap` or `.db3`, or the folder of a rosbag2.
            world: the map, whose bodies and joints were recorded.
            bodies: see `TransformRecording`, as the next ones.
            map_frame: see there.
            relative: see there.
            rate_hz: see there.
            geometry: see there.
            events: see there.

        Raises:
            EpisodeFileError: the file is no bag, is damaged, or has no transforms and no joint states.
            EpisodeError: the frame of the map is not clear.
            BodyNotFoundError: `bodies` names a body that is not in the map.
        """
        self.path = Path(path)
        super().__init__(
            _read_log(self.path),
            world,
            name=without_surrogates(self.path.stem),
            bodies=bodies,
            map_frame=map_frame,
            relative=relative,
            rate_hz=rate_hz,
            geometry=geometry,
            events=events,
        )


def _read_log(path: Path) -> TransformLog:
    """Reads the transforms and joint states of a bag.

    Raises:
        EpisodeFileError: see `RosBag`.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise EpisodeFileError(
            str(path), cause="rosbags is not installed", remedy="pip install 'mindstage[episodes]'"
        ) from error
    if not path.exists():
        raise EpisodeFileError(str(path), cause="there is no such file")
    if path.is_dir() and not (path / "metadata.yaml").is_file():
        raise EpisodeFileError(
            str(path), cause="the folder has no metadata.yaml", remedy="give a .bag, .mcap or .db3, or a rosbag2 folder"
        )
    found = TransformLog()
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            topics = {connection.topic: connection.msgtype for connection in reader.connections}
            wanted = [connection for connection in reader.connections if connection.msgtype in _READERS]
            if not wanted:
                raise EpisodeFileError(
                    str(path),
                    cause="it has no transforms and no joint states",
                    remedy=f"it has the topics {listed(sorted(topics)) or 'none at all'}",
                )
            broken: dict[str, int] = defaultdict(int)
            for connection, logged_ns, data in reader.messages(wanted):
                try:
                    message = reader.deserialize(data, connection.msgtype)
                except Exception:  # rosbags raises whatever its generated code raises
                    broken[connection.topic] += 1
                    continue
                _READERS[connection.msgtype](found, message, logged_ns, connection.topic)
    except EpisodeFileError:
        raise
    except Exception as error:  # AnyReaderError, struct.error, sqlite3 and lz4 errors of damaged files
        raise EpisodeFileError(str(path), cause=f"it cannot be read as a bag: {error}") from error
    for topic, count in broken.items():
        found.findings.append(f"{counted(count, 'message')} of {topic} cannot be decoded and are left out")
    if not found:
        raise EpisodeFileError(str(path), cause="its topics of transforms and joint states have no valid message")
    return found


def _read_transforms(found: TransformLog, message: Any, logged_ns: int, topic: str) -> None:
    is_static = topic.rstrip("/").endswith("tf_static")
    for each in message.transforms:
        at, turn = each.transform.translation, each.transform.rotation
        found.add_transform(
            each.child_frame_id,
            each.header.frame_id,
            (at.x, at.y, at.z, turn.w, turn.x, turn.y, turn.z),
            stamp_ns=_stamp_ns(each.header.stamp),
            logged_ns=logged_ns,
            is_static=is_static,
        )


def _read_joints(found: TransformLog, message: Any, logged_ns: int, topic: str) -> None:
    stamp_ns = _stamp_ns(message.header.stamp)
    for name, position in zip(message.name, message.position, strict=False):
        found.add_joint(name, float(position), stamp_ns=stamp_ns, logged_ns=logged_ns)


_READERS: Mapping[str, Callable[[TransformLog, Any, int, str], None]] = {
    "tf2_msgs/msg/TFMessage": _read_transforms,
    "tf/msg/tfMessage": _read_transforms,
    "sensor_msgs/msg/JointState": _read_joints,
}


def _stamp_ns(stamp: Any) -> int:
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
