"""Exports to general formats, read by the libraries of those formats."""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from msgspec.structs import replace

from mindstage.episodes import FrameRecording
from mindstage.episodes.exports import write_csv, write_lerobot
from mindstage.errors import EpisodeError, EpisodeFileError
from mindstage.scene import BodyId
from tests.episodes.episodes import DRAWER, EVENTS, episodes, kitchenette_episode

# -- CSV ---------------------------------------------------------------------------------------------------------------


def test_a_table_has_a_row_for_each_body_and_frame(tmp_path: Path) -> None:
    episode = kitchenette_episode()
    poses, _ = write_csv(episode, tmp_path / "run.csv")
    with poses.open(newline="") as file:
        rows = list(csv.DictReader(file))
    expected = [
        (frame.time_s, id, *row) for frame in episode.frames() for id, row in zip(frame.ids, frame.poses, strict=True)
    ]
    assert len(rows) == len(expected) == 31 * 8
    for row, (time, id, *pose) in zip(rows, expected, strict=True):
        assert (float(row["time_s"]), row["id"]) == (time, id)
        assert [float(row[name]) for name in ("x_m", "y_m", "z_m", "qw", "qx", "qy", "qz")] == pose


def test_the_table_of_events_has_all_that_is_known_about_them(tmp_path: Path) -> None:
    _, events = write_csv(kitchenette_episode(), tmp_path / "run.csv")
    assert events == tmp_path / "run_events.csv"
    with events.open(newline="") as file:
        rows = {row["id"]: row for row in csv.DictReader(file)}
    assert rows.keys() == {event.id for event in EVENTS}
    opening = rows["Opening_1"]
    assert (opening["kind"], opening["thing"], opening["joint"]) == ("Opening", "Drawer", "DrawerSlide")
    assert (float(opening["begin_s"]), float(opening["end_s"]), float(opening["amount"])) == (0.25, 1.0, 0.2)
    assert rows["SupportedBy_1"]["end_s"] == ""
    assert rows["SupportedBy_1"]["evidence"] == "Mug rests on Cupboard, 0.0 mm above it | it does not move"


@given(episode=episodes())
@settings(max_examples=15)
def test_every_event_of_any_episode_is_in_the_table(
    episode: FrameRecording, tmp_path_factory: pytest.TempPathFactory
) -> None:
    poses, events = write_csv(episode, tmp_path_factory.mktemp("csv") / "run.csv")
    with events.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(episode.events())
    for row, event in zip(rows, episode.events(), strict=True):
        assert (row["id"], row["kind"], row["thing"]) == (event.id, event.kind.value, event.thing)
        assert (row["other"], row["agent"], row["joint"]) == (event.other or "", event.agent or "", event.joint or "")
        for name in ("begin_s", "end_s", "amount"):
            assert (float(row[name]) if row[name] else None) == getattr(event, name)
        assert row["evidence"] == " | ".join(event.evidence)
    with poses.open(newline="", encoding="utf-8") as file:
        assert sum(1 for _ in csv.DictReader(file)) == sum(len(frame.ids) for frame in episode.frames())


def test_a_table_that_cannot_be_written_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(EpisodeFileError, match=r"none/run\.csv"):
        write_csv(kitchenette_episode(), tmp_path / "none" / "run.csv")


# -- LeRobot -----------------------------------------------------------------------------------------------------------
# Its own loader needs PyTorch. The layout is checked against the description of version 3.0 in lerobot's sources:
# datasets/utils.py (paths and default features), dataset_metadata.py (columns of episodes), feature_utils.py (types).

DEFAULT_FEATURES = {
    "timestamp": "float32",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}


@pytest.fixture
def parquet() -> Any:
    """The reader of Parquet files; the extra `lerobot` is no part of the development environment (55 MB)."""
    return pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed (extra lerobot)")


def second_episode() -> FrameRecording:
    """Half as long, without events."""
    return FrameRecording(list(kitchenette_episode().frames(0.0, 0.5)), name="short")


def test_a_dataset_has_the_layout_of_version_3(parquet: Any, tmp_path: Path) -> None:
    write_lerobot([kitchenette_episode(), second_episode()], tmp_path, fps=30, robot_type="none")
    info = json.loads((tmp_path / "meta" / "info.json").read_text())
    assert (info["codebase_version"], info["fps"], info["robot_type"]) == ("v3.0", 30, "none")
    assert (info["total_episodes"], info["total_frames"], info["splits"]) == (2, 31 + 16, {"train": "0:2"})
    assert info["video_path"] is None
    data = parquet.read_table(tmp_path / info["data_path"].format(chunk_index=0, file_index=0))
    assert data.num_rows == info["total_frames"]
    assert set(data.column_names) == set(info["features"])
    for key, feature in info["features"].items():
        (size,) = feature["shape"]
        type = "float" if feature["dtype"] == "float32" else "int64"
        expected = type if feature["names"] is None else f"fixed_size_list<element: {type}>[{size}]"
        assert str(data.schema.field(key).type) == expected
        assert feature["names"] is None or len(feature["names"]) == size
        assert "/" not in key
    for key, dtype in DEFAULT_FEATURES.items():
        assert info["features"][key] == {"dtype": dtype, "shape": [1], "names": None}
    assert data["index"].to_pylist() == list(range(47))
    assert data["episode_index"].to_pylist() == [0] * 31 + [1] * 16
    assert data["frame_index"].to_pylist() == [*range(31), *range(16)]
    np.testing.assert_allclose(data["timestamp"].to_numpy(), np.array([*range(31), *range(16)]) / 30, atol=1e-6)


def test_the_numbers_of_a_dataset_are_those_of_the_episode(parquet: Any, tmp_path: Path) -> None:
    episode = kitchenette_episode()
    write_lerobot([episode], tmp_path)
    info = json.loads((tmp_path / "meta" / "info.json").read_text())
    data = parquet.read_table(tmp_path / "data" / "chunk-000" / "file-000.parquet")
    state = np.array(data["observation.state"].to_pylist())
    slide = info["features"]["observation.state"]["names"].index("DrawerSlide")
    bodies = info["features"]["observation.environment_state"]["names"]
    poses = np.array(data["observation.environment_state"].to_pylist())
    start = bodies.index("Drawer.x")
    assert bodies[start : start + 7] == [f"Drawer.{part}" for part in ("x", "y", "z", "qw", "qx", "qy", "qz")]
    for row, frame in enumerate(episode.frames()):
        assert frame.joint_positions is not None
        assert state[row, slide] == pytest.approx(frame.joint_positions[BodyId("DrawerSlide")][0], abs=1e-6)
        np.testing.assert_allclose(poses[row, start : start + 7], frame.poses[frame.ids.index(DRAWER)], atol=1e-6)
    np.testing.assert_array_equal(np.array(data["action"].to_pylist())[:-1], state[1:])
    assert "Floor.x" not in bodies


def test_episodes_tasks_and_statistics_are_described(parquet: Any, tmp_path: Path) -> None:
    write_lerobot([kitchenette_episode(), second_episode()], tmp_path)
    tasks = parquet.read_table(tmp_path / "meta" / "tasks.parquet")
    assert json.loads(tasks.schema.metadata[b"pandas"])["index_columns"] == ["task"]
    numbers = dict(zip(tasks["task"].to_pylist(), tasks["task_index"].to_pylist(), strict=True))
    assert numbers == {"idle": 0, "Opening Drawer": 1, "Grasping DrawerHandle": 2}
    first, second = parquet.read_table(tmp_path / "meta" / "episodes" / "chunk-000" / "file-000.parquet").to_pylist()
    assert (first["dataset_from_index"], first["dataset_to_index"], first["length"]) == (0, 31, 31)
    assert (second["dataset_from_index"], second["dataset_to_index"], second["tasks"]) == (31, 47, ["idle"])
    data = parquet.read_table(tmp_path / "data" / "chunk-000" / "file-000.parquet")
    at = dict(zip(data["timestamp"].to_pylist(), data["task_index"].to_pylist()[:31], strict=False))
    assert [at[time] for time in sorted(at)][0:31:5] == [0, 0, 1, 2, 2, 1, 1]
    state = np.array(data["observation.state"].to_pylist())
    statistics = json.loads((tmp_path / "meta" / "stats.json").read_text())
    for name, values in (
        ("min", state.min(axis=0)),
        ("max", state.max(axis=0)),
        ("mean", state.mean(axis=0)),
        ("std", state.std(axis=0)),
        ("q50", np.median(state, axis=0)),
        ("count", [47]),
    ):
        np.testing.assert_allclose(statistics["observation.state"][name], values, atol=1e-6)
    np.testing.assert_allclose(first["stats/observation.state/mean"], state[:31].mean(axis=0), atol=1e-6)


def test_tasks_are_found_by_their_index_with_pandas(parquet: Any, tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    write_lerobot([kitchenette_episode()], tmp_path)
    tasks = pandas.read_parquet(tmp_path / "meta" / "tasks.parquet")
    assert tasks.loc["Opening Drawer"].task_index == 1


def test_a_folder_with_files_is_not_written_to(parquet: Any, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(EpisodeFileError, match="not an empty folder"):
        write_lerobot([kitchenette_episode()], tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


def test_a_dataset_of_nothing_is_an_error(parquet: Any, tmp_path: Path) -> None:
    with pytest.raises(EpisodeError, match="at least one"):
        write_lerobot([], tmp_path)
    first = replace(kitchenette_episode().frame_at(0.0), joint_positions=None)
    with pytest.raises(EpisodeError, match="nothing moves"):
        write_lerobot([FrameRecording([first])], tmp_path / "still")


def test_without_pyarrow_the_error_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(EpisodeFileError, match=r"pyarrow is not installed.*mindstage\[lerobot\]"):
        write_lerobot([kitchenette_episode()], tmp_path)
