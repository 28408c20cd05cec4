"""The sample maps as a user would try them, with what is expected of each, and the script that tries maps."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from scripts.try_maps import STEPS, MapResult, StepResult, find_maps, main, to_markdown, try_map

from tests.cli.runner import map_text

BODIES = {
    "ameva-task-two": 78,
    "iai-kitchen-original": 114,
    "iai-kitchen-spawned": 114,
    "knowrob1-ccrl": 59,
    "soma-iai-room": 49,
}
"""Every individual with a pose is a body, as counted in the files."""


@pytest.fixture(autouse=True)
def this_tree(monkeypatch: pytest.MonkeyPatch) -> None:
    """Processes import the package from the tree of the tests."""
    import mindstage

    package = Path(mindstage.__file__).parents[1]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, (str(package), os.environ.get("PYTHONPATH")))))
    monkeypatch.delenv("ROS_PACKAGE_PATH", raising=False)


def test_the_expectations_are_about_all_sample_maps(shared_data: Path) -> None:
    assert {path.stem for path, _ in find_maps([shared_data / "maps"])} == BODIES.keys()


@pytest.mark.parametrize("name", BODIES)
def test_a_sample_map_is_read_spawned_and_written_without_loss_and_rests(name: str, shared_data: Path) -> None:
    result = try_map(shared_data / "maps" / f"{name}.owl", steps=("validate", "spawn", "check"), seconds=10.0)
    row = result.row()
    assert result.ok, result.to_json()
    assert row["failed"] == ""
    assert (row["bodies"], row["errors"]) == (BODIES[name], 0)
    assert (row["moved"], row["fell"]) == (0, 0), result.steps["spawn"].output.get("moved")
    assert (row["identical"], row["lost"], row["verdict"]) == (True, 0, "ok")


def test_a_sample_map_is_analyzed_and_photographed(shared_data: Path, chromium: Path, tmp_path: Path) -> None:
    path = shared_data / "maps" / "soma-iai-room.owl"
    analyzed = try_map(path, steps=("analyze",))
    assert analyzed.steps["analyze"].output["individuals"] >= BODIES[path.stem]
    shot = try_map(path, steps=("shot",), pictures=tmp_path, options=("--size", "320x200"))
    assert shot.steps["shot"].code == 0, shot.to_json()
    assert (tmp_path / "soma-iai-room.owl.png").read_bytes().startswith(b"\x89PNG")


# -- the script --------------------------------------------------------------------------------------------------------


def test_a_bad_map_does_not_stop_the_others(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, out = tmp_path / "maps", tmp_path / "out"
    (folder / "deeper").mkdir(parents=True)
    (folder / "a-broken.owl").write_text("<rdf:RDF", encoding="utf-8")
    (folder / "deeper" / "room.owl").write_text(map_text(["Room"], {"Mug1": "1.0 2.0 0.0"}), encoding="utf-8")
    (folder / "readme.txt").write_text("not a map", encoding="utf-8")
    assert main([str(folder), "--steps", "validate,check", "--out", str(out), "--", "--no-bundled-ontology"]) == 0
    broken, room = json.loads((out / "maps.json").read_text(encoding="utf-8"))
    assert (broken["map"], broken["identical"], broken["steps"]["check"]["code"]) == ("a-broken.owl", None, 2)
    assert "cannot read" in broken["failed"]
    assert (room["map"], room["identical"], room["lost"], room["ok"]) == ("deeper/room.owl", True, 0, True)
    table = (out / "maps.md").read_text(encoding="utf-8")
    assert table == capsys.readouterr().out
    assert [line.split("|")[1].strip() for line in table.splitlines()[2:]] == ["a-broken.owl", "deeper/room.owl"]


def test_a_step_that_hangs_is_ended_and_counts_as_a_failure(tmp_path: Path) -> None:
    path = tmp_path / "room.owl"
    path.write_text(map_text(["Room"], {"Mug1": "1.0 2.0 0.0"}), encoding="utf-8")
    result = try_map(path, steps=("validate",), timeout_s=0.001)
    assert result.steps["validate"].code is None
    assert result.row()["failed"] == "validate: timeout"
    assert not result.ok


def spawn(**fields: object) -> StepResult:
    return StepResult(code=0, seconds=4.0, output={"spawn": {"bodies": 2}, "seconds": {"spawn": 2.0}, **fields})


def test_a_row_counts_what_moved_and_what_fell() -> None:
    moved = [
        {"id": "cup", "distance_m": 9.0, "left_place": True},
        {"id": "jar", "distance_m": 0.2, "left_place": False},
    ]
    result = MapResult(map="room.owl", steps={"spawn": spawn(moved=moved, simulated_s=10.0, real_time_factor=5.0)})
    row = result.row()
    assert (row["bodies"], row["moved"], row["fell"], row["identical"]) == (2, 2, 1, None)
    assert (row["real_time_factor"], row["real_time_factor_with_spawn"]) == (5.0, 2.5)
    assert "| 2             | 1    | -         |" in to_markdown([result])


def test_lost_statements_and_crashes_are_failures() -> None:
    lost = MapResult(map="a", steps={"check": StepResult(code=1, seconds=1.0, output={"lost_facts": 3})})
    bug = "mindstage: this is a bug in Mindstage, please report it"
    crash = MapResult(map="b", steps={"check": StepResult(code=2, seconds=1.0, error=bug)})
    killed = MapResult(map="c", steps={"check": StepResult(code=-9, seconds=1.0)})
    assert [each.ok for each in (lost, crash, killed)] == [False, False, False]
    assert "crash" in crash.row()["failed"]


def test_unknown_steps_and_folders_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, text in (([str(tmp_path), "--steps", "fly"], "no step fly"), (["nowhere"], "there is no nowhere")):
        with pytest.raises(SystemExit) as exit:
            main([*arguments, "--out", str(tmp_path / "out")])
        assert exit.value.code == 2
        assert text in capsys.readouterr().err


def test_the_steps_are_verbs() -> None:
    from mindstage.cli.app import app

    assert {*STEPS} <= {str(command.name or command.callback.__name__) for command in app.registered_commands}  # type: ignore[union-attr]
