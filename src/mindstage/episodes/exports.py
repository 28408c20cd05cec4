"""Exports of an episode to general formats: CSV and LeRobot datasets.

An export is a copy for another program; it is not read back here.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mindstage.engines.kinematic_tree import AXIS_NAMES
from mindstage.episodes.recording import EpisodeEvent, EpisodeEventKind, EpisodeFrame, Recording
from mindstage.errors import EpisodeError, EpisodeFileError
from mindstage.files import atomic_folder, atomic_write
from mindstage.scene import BodyId, World
from mindstage.scene.joint_kinematics import joint_reach
from mindstage.scene.transforms import Array

__all__ = ["write_csv", "write_lerobot"]


# -- CSV ---------------------------------------------------------------------------------------------------------------

_POSE_COLUMNS = ("time_s", "id", "x_m", "y_m", "z_m", "qw", "qx", "qy", "qz")
_EVENT_COLUMNS = (
    "id",
    "kind",
    "begin_s",
    "end_s",
    "thing",
    "other",
    "agent",
    "joint",
    "amount",
    "evidence",
)


def write_csv(recording: Recording, path: str | PathLike[str]) -> tuple[Path, Path]:
    """Writes the poses of all bodies and the events as two tables, in UTF-8 with a header line.

    Poses are in long format: a row for each body and frame, with a position [m] and a quaternion w x y z in the frame
    of the world. An event that had not ended has no end; lines of evidence are separated by " | ".

    Args:
        recording: the episode.
        path: the file of the poses, such as `run.csv`; the events go to `run_events.csv` beside it.

    Returns:
        The files of the poses and of the events.

    Raises:
        EpisodeFileError: a file cannot be written.
    """
    poses = Path(path)
    events = poses.with_name(f"{poses.stem}_events{poses.suffix}")
    text = io.StringIO()
    table = csv.writer(text)
    table.writerow(_POSE_COLUMNS)
    for frame in recording.frames():
        table.writerows([frame.time_s, id, *row] for id, row in zip(frame.ids, frame.poses.tolist(), strict=True))
    _write(poses, text.getvalue().encode())
    text = io.StringIO()
    table = csv.writer(text)
    table.writerow(_EVENT_COLUMNS)
    for event in recording.events():
        values = [getattr(event, name) for name in _EVENT_COLUMNS[:-1]]
        table.writerow([*("" if value is None else value for value in values), " | ".join(event.evidence)])
    _write(events, text.getvalue().encode())
    return poses, events


def _write(path: Path, content: bytes) -> None:
    try:
        atomic_write(path, content)
    except OSError as error:
        raise EpisodeFileError(str(path), cause=error.strerror or str(error)) from error


# -- LeRobot -----------------------------------------------------------------------------------------------------------

_CODEBASE_VERSION = "v3.0"
_FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_ACTIONS = frozenset(
    {
        EpisodeEventKind.GRASP,
        EpisodeEventKind.PICK_UP,
        EpisodeEventKind.PUT_DOWN,
        EpisodeEventKind.TRANSPORT,
        EpisodeEventKind.OPEN,
        EpisodeEventKind.CLOSE,
    }
)
"""Kinds of events that are tasks."""
_IDLE = "idle"
_STATE, _ENVIRONMENT, _ACTION = "observation.state", "observation.environment_state", "action"
_POSE_PARTS = ("x", "y", "z", "qw", "qx", "qy", "qz")


def write_lerobot(
    recordings: Sequence[Recording], path: str | PathLike[str], *, fps: int = 30, robot_type: str | None = None
) -> None:
    """Writes episodes as a LeRobot dataset, version 3.0, without pictures.

    Features: `observation.state` has the positions of all joints [m, rad], `observation.environment_state` the poses of
    the bodies that move in any of the episodes (x y z [m], w x y z), `action` the state of the next frame. Where no
    joint was recorded, the state is that of the environment. The task of a frame is the action that was begun last and
    has not ended, such as "PickingUp Mug", else "idle".

    Args:
        recordings: episodes of the same map, at least one.
        path: the folder of the dataset, which must not exist or be empty.
        fps: frames per second; the episodes are sampled at this rate.
        robot_type: what `info.json` names as the robot.

    Raises:
        EpisodeFileError: pyarrow is not installed, the folder is not empty, or a file cannot be written.
        EpisodeError: there is no recording, or nothing in them moves.
    """
    folder = Path(path)
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError as error:
        raise EpisodeFileError(
            str(folder), cause="pyarrow is not installed", remedy="pip install 'mindstage[lerobot]'"
        ) from error
    if not recordings:
        raise EpisodeError("a LeRobot dataset needs at least one episode")
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise EpisodeFileError(str(folder), cause="it exists and is not an empty folder", remedy="give a new folder")
    signals = _Signals(recordings)
    tasks: dict[str, int] = {}
    columns = [signals.sampled(recording, fps, tasks) for recording in recordings]
    episodes = list(_number(columns, tasks))
    data = {key: np.concatenate([each[key] for each in columns]) for key in columns[0]}
    features = signals.features()
    info = {
        "codebase_version": _CODEBASE_VERSION,
        "robot_type": robot_type,
        "total_episodes": len(recordings),
        "total_frames": len(data["index"]),
        "total_tasks": len(tasks),
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 500,
        "fps": fps,
        "splits": {"train": f"0:{len(recordings)}"},
        "data_path": f"data/{_FILE}",
        "video_path": None,
        "features": features,
    }
    first = _FILE.format(chunk_index=0, file_index=0)
    tables = {
        f"data/{first}": _data_table(pa, data, features),
        f"meta/episodes/{first}": pa.Table.from_pylist(episodes),
        "meta/tasks.parquet": _task_table(pa, tasks),
    }
    documents = {"info": info, "stats": {key: _statistics(values) for key, values in data.items()}}
    try:
        with atomic_folder(folder) as part:
            for name, table in tables.items():
                (part / name).parent.mkdir(parents=True, exist_ok=True)
                with (part / name).open("wb") as file:
                    parquet.write_table(table, file)
            for name, content in documents.items():
                text = json.dumps(content, indent=4, ensure_ascii=False)
                atomic_write(part / "meta" / f"{name}.json", text.encode())
    except OSError as error:
        raise EpisodeFileError(str(folder), cause=error.strerror or str(error)) from error


def _number(columns: Sequence[dict[str, NDArray[Any]]], tasks: Mapping[str, int]) -> Iterator[dict[str, Any]]:
    """Numbers the episodes and the frames of a dataset; yields the description of each episode."""
    total = 0
    for number, data in enumerate(columns):
        count = len(data["timestamp"])
        data["episode_index"] = np.full(count, number, dtype=np.int64)
        data["index"] = np.arange(total, total + count, dtype=np.int64)
        used = set(data["task_index"].tolist())
        yield {
            "episode_index": number,
            "tasks": [task for task, index in tasks.items() if index in used],
            "length": count,
            "data/chunk_index": 0,
            "data/file_index": 0,
            "dataset_from_index": total,
            "dataset_to_index": total + count,
            "meta/episodes/chunk_index": 0,
            "meta/episodes/file_index": 0,
            **{
                f"stats/{key}/{name}": value
                for key, values in data.items()
                for name, value in _statistics(values).items()
            },
        }
        total += count


def _task_table(pa: Any, tasks: Mapping[str, int]) -> Any:
    """The tasks with their numbers; LeRobot reads them with pandas and looks them up by their index."""
    columns = [
        {"name": "task_index", "field_name": "task_index", "pandas_type": "int64", "numpy_type": "int64"},
        {"name": "task", "field_name": "task", "pandas_type": "unicode", "numpy_type": "object"},
    ]
    index = {"index_columns": ["task"], "column_indexes": [], "columns": columns, "pandas_version": "2.2.0"}
    table = pa.table({"task_index": pa.array(tasks.values(), pa.int64()), "task": list(tasks)})
    return table.replace_schema_metadata({"pandas": json.dumps(index)})


class _Signals:
    """The numbers of a dataset that several recordings have in common."""

    def __init__(self, recordings: Sequence[Recording]) -> None:
        joints: dict[BodyId, tuple[int, ...]] = {}
        moved: dict[BodyId, None] = {}
        self._first: dict[BodyId, Array] = {}
        for recording in recordings:
            for frame in recording.frames():
                for joint in _movable_joints(frame.structure) if frame.joint_positions else ():
                    joints.setdefault(*joint)
                for id, row in zip(frame.ids, frame.poses, strict=True):
                    if not np.array_equal(self._first.setdefault(id, row), row):
                        moved[id] = None
        if not moved and not joints:
            raise EpisodeError("nothing moves in these episodes, so a dataset of them would have no number")
        self._joints = [(id, axis) for id, axes in joints.items() for axis in axes]
        self._moved = tuple(moved)

    def features(self) -> dict[str, dict[str, Any]]:
        """The features as in `info.json`."""
        poses = [f"{id}.{part}" for id in self._moved for part in _POSE_PARTS]
        joints = [
            id if sum(other == id for other, _ in self._joints) == 1 else f"{id}.{AXIS_NAMES[axis]}"
            for id, axis in self._joints
        ]
        vectors = {_STATE: joints or poses, _ACTION: joints or poses} | ({_ENVIRONMENT: poses} if poses else {})
        features: dict[str, dict[str, Any]] = {
            key: {"dtype": "float32", "shape": [len(names)], "names": names} for key, names in vectors.items()
        }
        scalars = {"timestamp": "float32"} | dict.fromkeys(
            ("frame_index", "episode_index", "index", "task_index"), "int64"
        )
        return features | {key: {"dtype": type, "shape": [1], "names": None} for key, type in scalars.items()}

    def sampled(self, recording: Recording, fps: int, tasks: dict[str, int]) -> dict[str, NDArray[Any]]:
        """The columns of one episode; new tasks are added to `tasks`."""
        count = int((recording.end_s - recording.begin_s) * fps + 1e-6) + 1
        times = [min(recording.begin_s + number / fps, recording.end_s) for number in range(count)]
        frames = [recording.frame_at(time) for time in times]
        poses = np.array([self._poses(frame) for frame in frames], dtype=np.float32)
        joints = np.array([self._positions(frame) for frame in frames], dtype=np.float32)
        state = joints if self._joints else poses
        events = recording.events()
        task_numbers = [tasks.setdefault(_task_at(events, time), len(tasks)) for time in times]
        columns = {_STATE: state, _ACTION: np.concatenate([state[1:], state[-1:]])}
        if self._moved:
            columns[_ENVIRONMENT] = poses
        return columns | {
            "timestamp": (np.arange(count) / fps).astype(np.float32),
            "frame_index": np.arange(count, dtype=np.int64),
            "task_index": np.array(task_numbers, dtype=np.int64),
        }

    def _poses(self, frame: EpisodeFrame) -> Array:
        """The poses of the bodies that move, one after the other; of one that does not exist, its first one."""
        rows = {id: row for row, id in enumerate(frame.ids)}
        poses = [frame.poses[rows[id]] if id in rows else self._first[id] for id in self._moved]
        return np.concatenate([np.zeros(0), *poses])

    def _positions(self, frame: EpisodeFrame) -> list[float]:
        positions = frame.joint_positions or {}
        return [positions[id][axis] if id in positions else 0.0 for id, axis in self._joints]


def _movable_joints(world: World) -> Iterator[tuple[BodyId, tuple[int, ...]]]:
    for joint in world.joints:
        axes = tuple(axis for axis, reach in enumerate(joint_reach(joint)) if reach != 0.0)
        if axes:
            yield joint.id, axes


def _task_at(events: Sequence[EpisodeEvent], time_s: float) -> str:
    running = [
        event
        for event in events
        if event.kind in _ACTIONS and event.begin_s <= time_s and (event.end_s is None or time_s <= event.end_s)
    ]
    latest = max(running, key=lambda each: each.begin_s, default=None)
    return _IDLE if latest is None else f"{latest.kind.value} {latest.thing}"


def _statistics(values: NDArray[Any]) -> dict[str, list[Any]]:
    """The statistics of a feature by which policies normalize; each is a list, also of one number."""
    rows = values.reshape(len(values), -1).astype(np.float64)
    found = {
        "min": rows.min(axis=0),
        "max": rows.max(axis=0),
        "mean": rows.mean(axis=0),
        "std": rows.std(axis=0),
    }
    found |= {f"q{round(100 * share):02d}": np.quantile(rows, share, axis=0) for share in (0.01, 0.1, 0.5, 0.9, 0.99)}
    return {name: each.tolist() for name, each in found.items()} | {"count": [len(values)]}


def _data_table(pa: Any, data: Mapping[str, NDArray[Any]], features: Mapping[str, Mapping[str, Any]]) -> Any:
    columns = {}
    for key, feature in features.items():
        values = data[key]
        type = pa.float32() if feature["dtype"] == "float32" else pa.int64()
        if values.ndim == 2:
            columns[key] = pa.FixedSizeListArray.from_arrays(pa.array(values.reshape(-1), type), values.shape[1])
        else:
            columns[key] = pa.array(values, type)
    return pa.table(columns)
