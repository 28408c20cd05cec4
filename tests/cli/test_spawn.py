"""The verbs `spawn` and `demo`."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from urllib.request import urlopen

import pytest

from mindstage.maps.io.files import BUNDLED_KITCHEN
from tests.cli.runner import Run, WriteMap, json_output

MINDSTAGE = [sys.executable, "-m", "mindstage"]


def test_spawning_the_kitchen_prints_a_report(run: Run) -> None:
    result = run("spawn", BUNDLED_KITCHEN, "--no-viewer", "--for", "0.1", "--json")
    assert result.exit_code == 0
    report = json_output(result)
    assert report["engine"] == "mujoco"
    assert report["spawn"]["ok"] is True
    assert report["spawn"]["bodies"] >= 120
    assert report["spawn"]["joints"] >= 20
    assert report["simulated_s"] == 0.1
    assert report["real_time_factor"] > 0.0


def test_verbose_lists_each_assumption(run: Run) -> None:
    short = run("spawn", BUNDLED_KITCHEN, "--no-viewer")
    long = run("spawn", BUNDLED_KITCHEN, "--no-viewer", "--verbose")
    assert "--verbose" in short.stdout
    assert len(long.stdout.splitlines()) > len(short.stdout.splitlines())


def test_the_simulated_time_is_printed(run: Run, write_map: WriteMap) -> None:
    result = run("spawn", write_map(), "--no-viewer", "--engine", "null", "--for", "2")
    assert "2 s simulated" in result.stdout
    assert "times real time" in result.stdout


def test_an_individual_without_a_pose_is_skipped_with_a_finding(run: Run, write_map: WriteMap) -> None:
    result = run("spawn", write_map(mugs={"Here": "1 2 3", "Lost": None}), "--no-viewer", "--engine", "null")
    assert result.exit_code == 1
    assert "Lost" in result.stderr
    assert "Traceback" not in result.stderr
    report = json_output(run("spawn", write_map(mugs={"Here": "1 2 3", "Lost": None}), "--no-viewer", "--json"))
    assert report["spawn"]["bodies"] == 1
    assert "Lost" in str(report["findings"])


def test_an_empty_world_is_a_finding(run: Run, write_map: WriteMap) -> None:
    result = run("spawn", write_map(mugs={}), "--no-viewer", "--engine", "null")
    assert "the world is empty" in result.stderr
    assert "the world is empty" in str(json_output(run("check", write_map(mugs={}), "--json"))["findings"])


def test_a_failed_body_exits_1(run: Run, write_map: WriteMap, monkeypatch: pytest.MonkeyPatch) -> None:
    import msgspec

    from mindstage.engines import Applied, NullEngine, SpawnFailure
    from mindstage.scene.edits import Edit

    succeed = NullEngine.apply

    def fail(engine: NullEngine, edit: Edit) -> Applied:
        applied = succeed(engine, edit)
        failed = (SpawnFailure("Mug1", "no room left"),)
        return msgspec.structs.replace(applied, report=msgspec.structs.replace(applied.report, failed_bodies=failed))

    monkeypatch.setattr(NullEngine, "apply", fail)
    result = run("spawn", write_map(), "--no-viewer", "--engine", "null")
    assert result.exit_code == 1
    assert "Mug1: no room left" in result.stderr


@pytest.mark.parametrize("ended_by", ["flag", "environment"])
def test_the_demo_serves_its_page_for_the_duration(ended_by: str) -> None:
    command = [*MINDSTAGE, "demo", "--port", "0", "--no-open", *(["--for", "2"] if ended_by == "flag" else [])]
    environment = os.environ | ({"MINDSTAGE_DEMO_SECONDS": "2"} if ended_by == "environment" else {})
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    ) as process:
        assert process.stdout is not None
        lines = iter(process.stdout.readline, "")
        url = next(found[1] for line in lines if (found := re.search(r"served at (http://\S+)", line)))
        with urlopen(url, timeout=30) as page:
            assert b"<html" in page.read().lower()
        process.communicate(timeout=60)
    assert process.returncode == 0


def test_the_json_contains_the_url_of_the_page(write_map: WriteMap) -> None:
    command = [*MINDSTAGE, "spawn", str(write_map()), "--engine", "null", "--port", "0", "--for", "0.5", "--json"]
    result = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert result.returncode == 0, result.stderr
    assert json.loads(result.stdout)["url"].startswith("http://127.0.0.1:")


@pytest.mark.parametrize("verb", ["spawn", "check", "log"])
def test_a_body_that_does_not_stay_exits_1_and_is_named(
    verb: str, run: Run, write_map: WriteMap, tmp_path: Path
) -> None:
    source = write_map(mugs={"Mug": "0.0 0.0 50.0"})
    source.write_text(source.read_text(encoding="utf-8").replace(">static<", ">dynamic<"), encoding="utf-8")
    options = {"spawn": ["--no-viewer"], "check": [], "log": ["-o", tmp_path / "out.owl"]}[verb]
    fallen = run(verb, source, *options, "--no-ground", "--json")
    assert fallen.exit_code == 1
    report = json_output(fallen)["spawn"]
    assert [(each["id"], each["left_place"]) for each in report["moved"]] == [("Mug", True)]
    assert report["rest_checked_s"] == 2.0
    resting = run(verb, source, *options, "--json")
    assert resting.exit_code == 0
    assert json_output(resting)["spawn"]["moved"] == []
    assert "ground" in [each["kind"] for each in json_output(resting)["spawn"]["warnings"]]
