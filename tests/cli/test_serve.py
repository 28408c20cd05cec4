"""The verb `serve`."""

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
from mindstage.maps.io.files import BUNDLED_KITCHEN
from tests.bridge.raw_client import TIMEOUT_S, eventually
from tests.cases import each_case
from tests.cli.runner import Run, WriteMap

MINDSTAGE = [sys.executable, "-m", "mindstage"]


@contextmanager
def serving(*args: object) -> Iterator[tuple[subprocess.Popen[str], dict[str, Any]]]:
    """Runs `mindstage serve`; yields the process and its JSON output."""
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


def test_a_map_is_served_until_ctrl_c(tmp_path: Path) -> None:
    with serving(BUNDLED_KITCHEN, "--port", 0, "--namespace", "lab") as (process, output):
        assert output["namespace"] == "lab"
        assert output["spawn"]["ok"] is True
        with RosbridgeClient(output["url"]) as client:
            client.wait_connected(TIMEOUT_S)
            assert client.call_service("/lab/get_model_pose", {"id": "fridge"})["success"]
            messages: list[Any] = []
            client.subscribe("/clock", messages.append)
            eventually(lambda: len(messages) >= 3)
            process.send_signal(signal.SIGINT)
            out, error = process.communicate(timeout=TIMEOUT_S)
        assert process.returncode == 130
        assert (out, error) == ("", "")


def test_it_connects_to_a_rosbridge_and_a_client_ends_it() -> None:
    with (
        serving("--port", 0, "--engine", "null", "--namespace", "first", "--token", "secret") as (_, first),
        serving("--connect", first["url"], "--engine", "null", "--paused", "--token", "secret") as (second, output),
    ):
        assert output["url"] == first["url"]
        with RosbridgeClient(first["url"], token="secret") as client:
            client.wait_connected(TIMEOUT_S)
            model = {"id": "cup", "name": "Cup"}
            assert client.call_service("/unreal/spawn_model", model)["success"]
            assert client.call_service("/first/get_entities")["entities"] == []
            assert client.call_service("/unreal/get_entities")["entities"] == ["cup"]
            client.call_service("/unreal/set_simulation_state", {"state": {"state": 3}})
            second.communicate(timeout=TIMEOUT_S)
        assert second.returncode == 0


def test_it_prints_its_url_and_exits_after_the_duration(run: Run, write_map: WriteMap) -> None:
    result = run("serve", write_map(), "--port", "0", "--engine", "null", "--for", "0.1")
    assert result.exit_code == 0
    assert "Listening at ws://127.0.0.1:" in result.stdout
    assert "services are below /unreal" in result.stdout


def test_a_robot_is_served_with_the_map(write_map: WriteMap) -> None:
    with serving(write_map(), "--port", "0", "--robot", "mobile_manipulator") as (_, output):
        assert output["robots"] == ["mobile_manipulator"]
        with RosbridgeClient(output["url"]) as client:
            client.wait_connected(TIMEOUT_S)
            robots = client.call_service("/unreal/mindstage/list_skills")["robots"]
            assert robots == ["mobile_manipulator"]
            controllers = client.call_service("/controller_manager/list_controllers")["controller"]
            assert "arm_controller" in {each["name"] for each in controllers}


@pytest.mark.parametrize(
    ("args", "text"),
    [
        (["--robot", "no_such_robot", "--port", "0"], "no_such_robot"),
        (["--engine", "no-engine"], "there is no engine of that name"),
        (["--connect", "ws://127.0.0.1:1"], "no connection to ws://127.0.0.1:1"),
        (["--connect", "http://127.0.0.1:1"], "must begin with ws://"),
        (["--connect", "ws://127.0.0.1:1", "--port", "9091"], "with --connect no server is started"),
        (["--connect", "ws://127.0.0.1:1", "--origin", "http://robot"], "with --connect no server is started"),
        (["--host", "0.0.0.0", "--port", "0"], "give a token"),
        (["--port", "99999"], "99999"),
        (["--namespace", "no name"], "is not a valid ROS name"),
        (["--worlds", "/dev/null/at/all"], "is not a folder"),
        (["nothing.owl"], "nothing.owl"),
    ],
)
def test_errors_exit_2_with_a_message(run: Run, args: list[str], text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mindstage.cli.serve._CONNECT_TIMEOUT_S", 0.5)
    result = run("serve", *args)
    assert result.exit_code == 2
    assert text in result.output.replace("\n", " ")


def test_a_port_in_use_is_an_error(run: Run) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        result = run("serve", "--port", taken.getsockname()[1], "--engine", "null")
    assert result.exit_code == 2
    assert "try 127.0.0.1 or another port" in result.output


@each_case(
    "options, cause",
    [
        (("--ros2-domain", "3"), "it requires --ros2"),
        (("--ros2", "--ros2-discovery", "subnet"), "every machine of the network can control the simulation"),
        (("--ros2", "--connect", "ws://127.0.0.1:1"), "another rosbridge is served"),
    ],
)
def test_options_of_ros2_are_checked_before_anything_starts(run: Run, options: tuple[str, ...], cause: str) -> None:
    result = run("serve", *options)
    assert result.exit_code == 2
    assert cause in " ".join(result.output.split())
