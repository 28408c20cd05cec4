"""Exit codes and error messages of verbs."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from mindstage.cli.options import ExitCode, command
from mindstage.errors import BodyNotFoundError, EngineClosedError
from tests.cli.runner import Run, WriteMap, json_output

MINDSTAGE = [sys.executable, "-m", "mindstage"]


def error_line(stderr: str) -> str:
    lines = stderr.strip().splitlines()
    assert len(lines) == 1, stderr
    assert lines[0].startswith("mindstage: error: ")
    return lines[0]


def test_a_missing_file(run: Run, tmp_path: Path) -> None:
    result = run("analyze", tmp_path / "nowhere.owl")
    assert result.exit_code == 2
    assert result.stdout == ""
    assert "nowhere.owl" in error_line(result.stderr)


def test_a_folder_is_not_a_map(run: Run, tmp_path: Path) -> None:
    result = run("analyze", tmp_path)
    assert result.exit_code == 2
    error_line(result.stderr)


def test_a_file_that_is_not_xml(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "shopping.owl"
    path.write_text("milk, bread, a sponge", encoding="utf-8")
    result = run("spawn", path, "--no-viewer")
    assert result.exit_code == 2
    assert "shopping.owl" in error_line(result.stderr)


def test_a_truncated_file(run: Run, write_map: WriteMap) -> None:
    path = write_map()
    text = path.read_text(encoding="utf-8")
    path.write_text(text[: len(text) * 2 // 3], encoding="utf-8")
    result = run("check", path, "--json")
    assert result.exit_code == 2
    assert json_output(result)["error"]["code"] == "SourceParseError"
    assert "line" in error_line(result.stderr)


def test_a_file_without_a_map(run: Run, write_map: WriteMap) -> None:
    result = run("analyze", write_map(maps=[], mugs={}), "--json")
    assert result.exit_code == 2
    assert json_output(result)["error"]["code"] == "MapNotFoundError"
    assert "no semantic map" in error_line(result.stderr)


def test_two_maps_without_a_map_name(run: Run, write_map: WriteMap) -> None:
    result = run("check", write_map(maps=["Kitchen", "Cellar"]), "--engine", "null", "--json")
    assert result.exit_code == 2
    assert json_output(result)["error"]["code"] == "AmbiguousMapError"
    line = error_line(result.stderr)
    assert "Kitchen" in line
    assert "Cellar" in line
    assert "--map-name" in line


def test_an_unknown_map_name(run: Run, write_map: WriteMap) -> None:
    result = run("analyze", write_map(), "--map-name", "Attic", "--json")
    assert result.exit_code == 2
    assert json_output(result)["error"]["code"] == "MapNotFoundError"
    assert "Room" in error_line(result.stderr)


@pytest.mark.parametrize("engine", ["unity", "warp"])
def test_an_unknown_engine(engine: str, run: Run, write_map: WriteMap) -> None:
    result = run("check", write_map(), "--engine", engine, "--json")
    assert result.exit_code == 2
    assert json_output(result)["error"]["code"] == "EngineUnavailableError"
    line = error_line(result.stderr)
    assert engine in line
    assert "mujoco" in line


def test_a_file_that_cannot_be_written(run: Run, write_map: WriteMap, tmp_path: Path) -> None:
    result = run("convert", write_map(), tmp_path / "no" / "such" / "folder" / "out.owl", "--json")
    assert result.exit_code == 2
    assert "folder" in json_output(result)["error"]["message"]
    error_line(result.stderr)


@pytest.mark.parametrize(
    "args",
    [
        ["analize", "MAP"],
        ["analyze"],
        ["compare", "MAP"],
        ["analyze", "MAP", "--jsno"],
        ["compare", "MAP", "MAP", "--delta", "-1"],
        ["compare", "MAP", "MAP", "--delta", "nan"],
        ["compare", "MAP", "MAP", "--delta", "little"],
        ["spawn", "MAP", "--for", "inf"],
        ["log", "MAP"],
        ["demo", "--port", "70000"],
    ],
    ids=" ".join,
)
def test_an_invalid_command_line(args: list[str], run: Run, write_map: WriteMap) -> None:
    path = str(write_map())
    result = run(*(path if arg == "MAP" else arg for arg in args))
    assert result.exit_code == 2
    assert "Traceback" not in result.output


def test_a_world_error_exits_1() -> None:
    assert _result_of(BodyNotFoundError("cupp", known=["cup"])) == (
        1,
        "mindstage: error: no body 'cupp'; near: 'cup'\n",
    )


def test_an_engine_error_exits_2() -> None:
    assert _result_of(EngineClosedError("null"))[0] == 2


def test_a_full_disk_is_reported_in_one_line() -> None:
    assert _result_of(OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "out.owl")) == (
        2,
        "mindstage: error: out.owl: No space left on device\n",
    )


def test_control_characters_in_a_name_are_not_printed() -> None:
    code, line = _result_of(BodyNotFoundError("a\nb\x1b[2J", known=[]))
    assert code == 1
    assert line.count("\n") == 1
    assert "\x1b" not in line


def test_ctrl_c_prints_nothing() -> None:
    assert _result_of(KeyboardInterrupt()) == (130, "")


def _result_of(raised: BaseException) -> tuple[int, str]:
    def act() -> ExitCode:
        raise raised

    single = typer.Typer()
    single.command()(command(act))
    result = CliRunner().invoke(single, [])
    return result.exit_code, result.stderr


def test_ctrl_c_during_a_simulation(write_map: WriteMap) -> None:
    command = [*MINDSTAGE, "spawn", str(write_map()), "--engine", "null", "--no-viewer", "--for", "1e9"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline()  # the report is printed before the simulation starts
        process.send_signal(signal.SIGINT)
        _, stderr = process.communicate(timeout=60)
    assert process.returncode == 130
    assert stderr == ""


def test_a_closed_pipe(write_map: WriteMap) -> None:
    read, write = os.pipe()
    os.close(read)
    command = [*MINDSTAGE, "analyze", str(write_map())]
    result = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, text=True, check=False)
    os.close(write)
    assert result.returncode == 141
    assert result.stderr == ""


def test_a_bug_exits_2_with_a_traceback() -> None:
    code = (
        "import mindstage.cli.app as app, mindstage.cli.maps as maps, sys\n"
        "maps.knowledge_base = lambda *args, **kwargs: 1 / 0\n"
        "sys.argv = ['mindstage', 'analyze', 'map.owl']\n"
        "app.main()\n"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert result.returncode == 2
    assert "ZeroDivisionError" in result.stderr
    assert result.stderr.rstrip().endswith("please report it")


def test_the_module_is_the_command() -> None:
    result = subprocess.run([*MINDSTAGE, "--version"], capture_output=True, text=True, check=True)
    assert result.stdout.startswith("mindstage ")


@pytest.mark.parametrize(("alias", "verb"), [("analyse", "analyze"), ("furnish", "place")])
def test_former_names_of_verbs_are_hidden_aliases(alias: str, verb: str, run: Run) -> None:
    assert run(alias, "--help").exit_code == 0
    listed = run("--help").stdout
    assert verb in listed
    assert alias not in listed


@pytest.mark.parametrize("arguments", [["check", "kitchen"], ["ask", "where_is", "--map", "Kitchen.owl"]])
def test_a_missing_map_named_like_the_bundled_kitchen_names_it(run: Run, arguments: list[str]) -> None:
    result = run(*arguments)
    assert result.exit_code == 2
    assert "there is no such file; did you mean bundled:kitchen?" in result.stderr


def test_another_missing_map_does_not_name_the_bundled_kitchen(run: Run) -> None:
    assert "bundled" not in run("check", "laboratory.owl").stderr


def test_the_demo_takes_the_name_of_the_kitchen_and_says_what_shows_other_maps(run: Run) -> None:
    result = run("demo", "laboratory.owl")
    assert result.exit_code == 2
    assert "another map is shown by: mindstage spawn laboratory.owl" in result.stderr
    assert run("demo", "kitchen", "--port", "0", "--for", "0", "--no-open").exit_code == 0
