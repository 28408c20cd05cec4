"""Verbs on an engine far away: a `mindstage serve` in a process of its own."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from mindstage.engines import connect
from mindstage.knowledge.io.files import BUNDLED_KITCHEN
from tests.cli.typed import Run, WriteMap, json_output


@pytest.fixture(scope="module")
def served() -> Iterator[str]:
    """The address of a stage without a map, whose time passes."""
    command = [sys.executable, "-m", "mindstage", "serve", "--port", "0", "--namespace", "lab", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            text = ""
            for line in iter(process.stdout.readline, "}\n"):
                assert line, "it ended"
                text += line
            yield f"{json.loads(text + '}')['url'].replace('ws://', 'ros://')}/lab"
        finally:
            process.terminate()


@pytest.fixture
def far(served: str) -> Iterator[str]:
    yield served
    with closing(connect(served)) as engine:
        engine.clear()


def test_the_kitchen_comes_back_whole_from_far_away_and_leaves_nothing_there(far: str, run: Run) -> None:
    for _ in range(2):
        result = run("check", BUNDLED_KITCHEN, "--engine", far, "--json")
        assert result.exit_code == 0, result.output
        verdict = json_output(result)
        assert verdict["identical"] is verdict["identical_before_file"] is True
        assert (verdict["delta"], verdict["max_error"], verdict["lost_facts"]) == (0.0, 0.0, 0)
        assert verdict["engine"] == far
        assert verdict["spawn"]["bodies"] > 100


def test_a_world_that_runs_far_away_is_logged_as_a_map(far: str, run: Run, write_map: WriteMap, tmp_path: Path) -> None:
    source, out = write_map(), tmp_path / "far.owl"
    assert run("spawn", source, "--engine", far, "--no-viewport").exit_code == 0
    result = run("log", "--engine", far, "-o", out, "--json")
    assert result.exit_code == 0, result.output
    assert (json_output(result)["bodies"], json_output(result)["engine"]) == (2, far)
    assert run("compare", source, out).exit_code == 0


def test_what_stands_far_away_already_is_not_swept_aside_for_a_check(far: str, run: Run, write_map: WriteMap) -> None:
    source = write_map()
    assert run("spawn", source, "--engine", far, "--no-viewport").exit_code == 0
    result = run("check", source, "--engine", far)
    assert result.exit_code == 2
    assert "its world is not empty" in result.stderr
    with closing(connect(far)) as engine:
        assert len(engine.poses()[0]) == 2


def test_a_map_that_cannot_be_read_leaves_the_far_world_alone(far: str, run: Run, tmp_path: Path) -> None:
    assert run("check", tmp_path / "missing.owl", "--engine", far).exit_code == 2
    assert run("check", BUNDLED_KITCHEN, "--engine", far).exit_code == 0


@pytest.mark.parametrize(
    ("engine", "why"),
    [
        ("ros://127.0.0.1:1/lab?token=secret", "no connection"),
        ("ros://127.0.0.1:x/lab?token=secret", "it is no address"),
        (
            "ros:/127.0.0.1",
            "there is no engine of that name; choose mujoco, godot, godot:window, null, or ros://HOST:PORT/",
        ),
    ],
)
def test_a_far_engine_that_cannot_be_reached_is_trouble_in_one_line(
    engine: str, why: str, run: Run, write_map: WriteMap, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mindstage.engines.remote.client._CONNECT_TIMEOUT_S", 0.5)
    result = run("spawn", write_map(), "--engine", engine, "--no-viewport")
    assert result.exit_code == 2
    assert why in result.stderr
    assert "secret" not in result.output
    assert len(result.stderr.strip().splitlines()) == 1


def test_without_a_map_only_what_runs_far_away_can_be_logged(run: Run, tmp_path: Path) -> None:
    result = run("log", "-o", tmp_path / "out.owl")
    assert result.exit_code == 2
    assert "nothing runs in the engine 'mujoco' yet; name a map" in result.stderr
    assert not (tmp_path / "out.owl").exists()
