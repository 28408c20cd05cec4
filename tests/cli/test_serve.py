"""`mindstage serve`: a stage that programs reach, told where, and ended cleanly."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from mindstage.bridge import RosbridgeClient
from mindstage.knowledge.io.files import BUNDLED_KITCHEN
from tests.bridge.raw_client import TIMEOUT_S, eventually
from tests.cli.typed import Run, WriteMap

MINDSTAGE = [sys.executable, "-m", "mindstage"]


@contextmanager
def serving(*args: object) -> Iterator[tuple[subprocess.Popen[str], dict[str, Any]]]:
    """A process that serves, and what it told when it was ready."""
    command = [*MINDSTAGE, "serve", "--json", *map(str, args)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        lines = []
        assert process.stdout is not None
        while not lines or lines[-1] != "}\n":
            lines.append(process.stdout.readline())
            assert lines[-1], process.communicate(timeout=TIMEOUT_S)[1]
        yield process, json.loads("".join(lines))
    finally:
        process.kill()
        process.communicate(timeout=TIMEOUT_S)


def test_a_map_is_served_and_ctrl_c_ends_it(tmp_path: Path) -> None:
    with serving(BUNDLED_KITCHEN, "--port", 0, "--namespace", "lab") as (process, told):
        assert told["namespace"] == "lab"
        assert told["spawn"]["ok"] is True
        with RosbridgeClient(told["url"]) as client:
            client.wait_connected(TIMEOUT_S)
            assert client.call_service("/lab/get_model_pose", {"id": "fridge"})["success"]
            heard: list[Any] = []
            client.subscribe("/clock", heard.append)
            eventually(lambda: len(heard) >= 3)
            process.send_signal(signal.SIGINT)
            out, error = process.communicate(timeout=TIMEOUT_S)
        assert process.returncode == 130
        assert (out, error) == ("", "")


def test_it_joins_a_hub_and_is_ended_by_a_caller() -> None:
    with (
        serving("--port", 0, "--engine", "null", "--namespace", "first", "--token", "secret") as (_, first),
        serving("--connect", first["url"], "--engine", "null", "--paused", "--token", "secret") as (second, told),
    ):
        assert told["url"] == first["url"]
        with RosbridgeClient(first["url"], token="secret") as client:
            client.wait_connected(TIMEOUT_S)
            model = {"id": "cup", "name": "Cup"}
            assert client.call_service("/unreal/spawn_model", model)["success"]
            assert client.call_service("/first/get_entities")["entities"] == []
            assert client.call_service("/unreal/get_entities")["entities"] == ["cup"]
            client.call_service("/unreal/set_simulation_state", {"state": {"state": 3}})
            second.communicate(timeout=TIMEOUT_S)
        assert second.returncode == 0


def test_it_ends_by_itself_and_says_where_it_is(run: Run, write_map: WriteMap) -> None:
    result = run("serve", write_map(), "--port", "0", "--engine", "null", "--for", "0.1")
    assert result.exit_code == 0
    assert "Listening at ws://127.0.0.1:" in result.stdout
    assert "services are below /unreal" in result.stdout


@pytest.mark.parametrize(
    ("args", "text"),
    [
        (["--engine", "no-engine"], "there is no engine of that name"),
        (["--connect", "ws://127.0.0.1:1"], "no connection to ws://127.0.0.1:1"),
        (["--connect", "http://127.0.0.1:1"], "must begin with ws://"),
        (["--connect", "ws://127.0.0.1:1", "--port", "9091"], "with --connect nothing is served here"),
        (["--connect", "ws://127.0.0.1:1", "--origin", "http://robot"], "with --connect nothing is served here"),
        (["--host", "0.0.0.0", "--port", "0"], "give a token"),
        (["--port", "99999"], "99999"),
        (["--namespace", "no name"], "is no name in ROS"),
        (["--worlds", "/nowhere/at/all"], "is no folder"),
        (["nothing.owl"], "nothing.owl"),
    ],
)
def test_what_cannot_be_served_ends_with_words(
    run: Run, args: list[str], text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mindstage.cli.serve._CONNECT_TIMEOUT_S", 0.5)
    result = run("serve", *args)
    assert result.exit_code == 2
    assert text in result.output.replace("\n", " ")


def test_a_port_that_is_taken_is_told(run: Run) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        result = run("serve", "--port", taken.getsockname()[1], "--engine", "null")
    assert result.exit_code == 2
    assert "try 127.0.0.1 or another port" in result.output
