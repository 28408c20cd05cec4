"""Verbs with a remote engine: `mindstage serve` in another process."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from mindstage.engines.remote import connect
from mindstage.maps.io.files import BUNDLED_KITCHEN
from tests.cli.runner import Run, WriteMap, json_output


@pytest.fixture(scope="module")
def served() -> Iterator[str]:
    """The URL of a playing simulation without a map."""
    command = [sys.executable, "-m", "mindstage", "serve", "--port", "0", "--namespace", "lab", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            text = ""
            for line in iter(process.stdout.readline, "}\n"):
                assert line, "the process exited"
                text += line
            yield f"{json.loads(text + '}')['url'].replace('ws://', 'ros://')}/lab"
        finally:
            process.terminate()


@pytest.fixture
def remote(served: str) -> Iterator[str]:
    yield served
    with closing(connect(served)) as engine:
        engine.clear()


def test_the_round_trip_of_the_kitchen_is_lossless_and_clears_the_remote_world(remote: str, run: Run) -> None:
    for _ in range(2):
        result = run("check", BUNDLED_KITCHEN, "--engine", remote, "--json")
        assert result.exit_code == 0, result.output
        output = json_output(result)
        assert output["identical"] is output["identical_before_file"] is True
        assert (output["delta"], output["max_error"], output["lost_facts"]) == (0.0, 0.0, 0)
        assert output["engine"] == remote
        assert output["spawn"]["bodies"] > 100


def test_a_remote_world_is_logged_as_a_map(remote: str, run: Run, write_map: WriteMap, tmp_path: Path) -> None:
    source, out = write_map(), tmp_path / "remote.owl"
    assert run("spawn", source, "--engine", remote, "--no-viewer").exit_code == 0
    result = run("log", "--engine", remote, "-o", out, "--json")
    assert result.exit_code == 0, result.output
    assert (json_output(result)["bodies"], json_output(result)["engine"]) == (2, remote)
    assert run("compare", source, out).exit_code == 0


def test_check_requires_an_empty_remote_world(remote: str, run: Run, write_map: WriteMap) -> None:
    source = write_map()
    assert run("spawn", source, "--engine", remote, "--no-viewer").exit_code == 0
    result = run("check", source, "--engine", remote)
    assert result.exit_code == 2
    assert "its world is not empty" in result.stderr
    with closing(connect(remote)) as engine:
        assert len(engine.poses()[0]) == 2


def test_an_unreadable_map_does_not_change_the_remote_world(remote: str, run: Run, tmp_path: Path) -> None:
    assert run("check", tmp_path / "missing.owl", "--engine", remote).exit_code == 2
    assert run("check", BUNDLED_KITCHEN, "--engine", remote).exit_code == 0


@pytest.mark.parametrize(
    ("engine", "message"),
    [
        ("ros://127.0.0.1:1/lab?token=secret", "no connection"),
        ("ros://127.0.0.1:x/lab?token=secret", "it is not a valid address"),
        (
            "ros:/127.0.0.1",
            "there is no engine of that name; choose godot, godot:window, mujoco, null, ros://HOST:PORT/",
        ),
    ],
)
def test_an_unreachable_engine_is_reported_in_one_line(
    engine: str, message: str, run: Run, write_map: WriteMap
) -> None:
    result = run("spawn", write_map(), "--engine", engine, "--no-viewer")
    assert result.exit_code == 2
    assert message in result.stderr
    assert "secret" not in result.output
    assert len(result.stderr.strip().splitlines()) == 1


def test_log_without_a_map_requires_a_remote_engine(run: Run, tmp_path: Path) -> None:
    result = run("log", "-o", tmp_path / "out.owl")
    assert result.exit_code == 2
    assert "the world of the engine 'mujoco' is empty; name a map" in result.stderr
    assert not (tmp_path / "out.owl").exists()
