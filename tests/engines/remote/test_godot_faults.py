"""Faults of a Godot process end in an error with the reason; no call hangs, and no process remains."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from pathlib import Path

import pytest

from mindstage.bridge import RosbridgeClient
from mindstage.engines.remote import godot_process as program
from mindstage.engines.remote import godot_process as project
from mindstage.engines.remote.godot import GodotEngine
from mindstage.engines.remote.godot_process import GodotExecutable, find_godot
from mindstage.errors import (
    AuthenticationError,
    BodyNotFoundError,
    EngineClosedError,
    EngineTimeoutError,
    EngineUnavailableError,
)
from mindstage.scene import BodyId
from mindstage.scene.edits import Spawn
from tests.engines.scenes import FLOOR, body, room, world

Make = Callable[..., Path]


@pytest.fixture
def make_program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Make:
    """Creates an executable that reports a Godot version when asked for it, and otherwise runs a script."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))

    def make(*, version: str = "4.6.3.stable.official", asked: str = "", runs: str = "exit 0") -> Path:
        path = tmp_path / "pretender"
        answer = asked or f"echo {version}"
        path.write_text(f'#!/bin/sh\ncase "$*" in *--version*) {answer};; *--import*) exit 0;; *) {runs};; esac\n')
        path.chmod(0o755)
        return path

    return make


def is_gone(pid: int, *, within_s: float = 30.0) -> bool:
    """Whether a process ends in time; a zombie counts as ended."""
    deadline_s = time.monotonic() + within_s
    while time.monotonic() < deadline_s:
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        except FileNotFoundError:
            return True
        if state == "Z":
            return True
        time.sleep(0.05)
    return False


# -- before it starts --------------------------------------------------------------------------------------------------


def test_a_missing_executable_is_named_with_installation_help() -> None:
    with pytest.raises(EngineUnavailableError, match=r"no executable '/nowhere/godot'.*install Godot 4\.4 or later"):
        GodotEngine("/nowhere/godot")


def test_a_machine_without_godot_gets_installation_help(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(program, "_candidates", lambda: iter(()))
    with pytest.raises(EngineUnavailableError, match=r"Godot was not found on this machine.*GODOT"):
        find_godot()


@pytest.mark.parametrize("version", ["3.5.2.stable", "4.3.stable.official"])
def test_a_godot_that_is_too_old_is_refused(version: str, make_program: Make) -> None:
    with pytest.raises(EngineUnavailableError, match=rf"Godot {version}, and 4\.4 or later"):
        find_godot(make_program(version=version))


@pytest.mark.parametrize("version", ["4.4.stable", "4.10.1.stable", "5.0.dev"])
def test_a_recent_godot_is_accepted(version: str, make_program: Make) -> None:
    assert find_godot(make_program(version=version)).version == version


def test_another_program_is_refused_with_its_output(make_program: Make) -> None:
    with pytest.raises(EngineUnavailableError, match="does not report its version: no display today"):
        find_godot(make_program(asked="echo no display today >&2; exit 1"))


def test_a_program_that_does_not_answer_times_out(make_program: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(program, "_VERSION_TIMEOUT_S", 0.3)
    with pytest.raises(EngineUnavailableError, match=r"did not report its version within 0\.3 s"):
        find_godot(make_program(asked="exec sleep 60"))


def test_a_file_that_is_not_executable_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "godot"
    path.write_bytes(b"\x7fELF and nothing more")
    path.chmod(0o755)
    with pytest.raises(EngineUnavailableError, match="does not run"):
        find_godot(path)


def test_the_project_is_copied_once_and_again_after_a_change(
    make_program: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bundled = tmp_path / "shipped"
    (bundled / "addons").mkdir(parents=True)
    (bundled / "project.godot").write_text("one")
    monkeypatch.setattr(project, "bundled_project", lambda: bundled)
    path = make_program()
    first = project.prepare_project(GodotExecutable(path, "4.6.3"))
    assert (first / "project.godot").read_text() == "one"
    assert project.prepare_project(GodotExecutable(path, "4.6.3")) == first
    assert project.prepare_project(GodotExecutable(path, "4.7")) != first
    (bundled / "project.godot").write_text("two")
    second = project.prepare_project(GodotExecutable(path, "4.6.3"))
    assert (second / "project.godot").read_text() == "two"
    assert first.is_dir()


def test_unused_copies_of_the_project_are_deleted(make_program: Make, tmp_path: Path) -> None:
    path = make_program()
    copies = [project.prepare_project(GodotExecutable(path, f"4.4.{number}")) for number in range(5)]
    long_ago_s = time.time() - 30 * 24 * 3600
    for age, copy in enumerate(copies):
        os.utime(copy, (long_ago_s - age, long_ago_s - age))
    unused = copies[0].parent / ".making-by-a-killed-process"
    unused.mkdir()
    os.utime(unused, (0, 0))
    project.isolated_environment()
    assert project.prepare_project(GodotExecutable(path, "4.4.3")) == copies[3]  # it is used, so it is recent
    newest = project.prepare_project(GodotExecutable(path, "4.5"))
    remaining = {each.name for each in newest.parent.iterdir()}
    assert remaining == {newest.name, copies[3].name, copies[0].name, "home"}


def test_a_failed_preparation_leaves_no_partial_copy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    path = tmp_path / "broken"
    path.write_text('#!/bin/sh\ncase "$*" in *--version*) echo 4.6;; *) echo no room; exit 3;; esac\n')
    path.chmod(0o755)
    with pytest.raises(EngineUnavailableError, match=r"exit code 3\): no room"):
        GodotEngine(path)
    assert [each.name for each in (tmp_path / "mindstage" / "godot").iterdir() if each.name != "home"] == []


# -- during the start --------------------------------------------------------------------------------------------------


def test_a_godot_that_exits_at_once_is_reported_with_its_output(make_program: Make) -> None:
    with pytest.raises(EngineUnavailableError, match=r"did not start: it exited with code 7.*my last words"):
        GodotEngine(make_program(runs="echo my last words; exit 7"))


def test_a_godot_that_offers_no_services_times_out_and_is_terminated(make_program: Make, tmp_path: Path) -> None:
    pid = tmp_path / "pid"
    runs = f"echo $$ >{pid}; echo thinking; exec sleep 600"
    with pytest.raises(EngineUnavailableError, match=r"after 2 s it offers no service; its last output: thinking"):
        GodotEngine(make_program(runs=runs), start_timeout_s=2.0)
    assert is_gone(int(pid.read_text()))


def test_a_godot_that_ignores_sigterm_is_killed(make_program: Make, tmp_path: Path) -> None:
    pid = tmp_path / "pid"
    runs = f"trap '' TERM; echo $$ >{pid}; while :; do sleep 0.1; done"
    with pytest.raises(EngineUnavailableError):
        GodotEngine(make_program(runs=runs), start_timeout_s=2.0)
    assert is_gone(int(pid.read_text()))


# -- while it runs -----------------------------------------------------------------------------------------------------


@pytest.fixture
def engine(godot: Path) -> Iterator[GodotEngine]:
    with closing(GodotEngine(godot)) as engine:
        yield engine


def test_a_godot_killed_during_a_spawn_is_reported_at_once_and_can_be_restarted(
    engine: GodotEngine, godot: Path
) -> None:
    errors: list[Exception] = []

    def spawn() -> None:
        try:
            engine.apply(Spawn(room()))
        except EngineUnavailableError as error:
            errors.append(error)

    os.kill(engine.pid, signal.SIGSTOP)  # so that the spawn has started but not finished
    thread = threading.Thread(target=spawn)
    thread.start()
    time.sleep(0.3)
    os.kill(engine.pid, signal.SIGKILL)
    thread.join(20.0)
    assert not thread.is_alive()
    assert "SIGKILL" in str(errors[0])
    with pytest.raises(EngineUnavailableError, match="SIGKILL"):
        engine.poses()
    engine.close()
    with pytest.raises(EngineClosedError):
        engine.poses()
    with closing(GodotEngine(godot)) as other:
        assert other.apply(Spawn(room())).report.ok


def test_a_godot_that_hangs_times_out_and_is_terminated(godot: Path) -> None:
    with closing(GodotEngine(godot, timeout_s=1.0)) as engine:
        os.kill(engine.pid, signal.SIGSTOP)
        with pytest.raises(EngineTimeoutError, match="did not answer"):
            engine.snapshot()
    assert is_gone(engine.pid)


def test_two_engines_run_independently(engine: GodotEngine, godot: Path) -> None:
    engine.apply(Spawn(world(FLOOR)))
    with closing(GodotEngine(godot)) as other, socket.socket() as listener:
        with suppress(OSError):  # another process has it, which is just as good
            listener.bind(("127.0.0.1", 9090))  # rosbridge's default port, which the engines do not need
        assert other.poses()[0] == ()
        other.apply(Spawn(world(body("box", (0, 0, 1), (0.1, 0.1, 0.1)))))
        assert engine.poses()[0] == ("floor",)
        assert other.poses()[0] == ("box",)
    assert is_gone(other.pid)
    assert engine.poses()[0] == ("floor",)


def test_other_clients_cannot_connect_to_its_bridge(engine: GodotEngine) -> None:
    client = RosbridgeClient(engine._client.address.url, max_reconnect_delay_s=0.2)
    with closing(client), pytest.raises(AuthenticationError):
        client.wait_connected(10.0)


def test_no_godot_remains_when_python_is_killed(godot: Path) -> None:
    script = (
        "import os, signal\n"
        "from mindstage.engines.remote.godot import GodotEngine\n"
        f"engine = GodotEngine({str(godot)!r})\n"
        "print(engine.pid, flush=True)\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=120, check=False)
    assert result.returncode == -signal.SIGKILL, result.stderr
    assert is_gone(int(result.stdout))


def test_no_godot_remains_when_python_exits_without_closing(godot: Path) -> None:
    script = (
        "from mindstage.engines.remote.godot import GodotEngine\n"
        f"engine = GodotEngine({str(godot)!r})\n"
        "print(engine.pid, flush=True)\n"
    )
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=120, check=False)
    assert result.returncode == 0, result.stderr
    assert is_gone(int(result.stdout))


def test_an_unknown_body_is_refused_without_a_call_to_godot(engine: GodotEngine) -> None:
    engine.apply(Spawn(world(FLOOR)))
    os.kill(engine.pid, signal.SIGSTOP)
    try:
        with pytest.raises(BodyNotFoundError):
            engine.apply_force(BodyId("flor"), (1.0, 0.0, 0.0))
    finally:
        os.kill(engine.pid, signal.SIGCONT)
