"""The dock in Godot's editor: a map is spawned into the open scene, edited, undone, saved, reopened and read back."""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path

import pytest

from mindstage.bridge import LocalNode, RosbridgeServer
from mindstage.engines.remote import RemoteEngine, connect
from mindstage.engines.remote.godot_process import isolated_environment
from mindstage.errors import UnsupportedByEngineError
from mindstage.scene import BodyId, diff
from mindstage.scene.edits import Delete, Spawn
from tests.engines.scenes import room
from tests.godot.project import run

SCENE = "res://place.tscn"
LONG_S = 120.0


class Editor:
    """Godot's editor without a window, controlled by commands."""

    def __init__(self, godot: Path, project: Path) -> None:
        self.project = project
        (project / "place.tscn").write_text('[gd_scene format=3]\n\n[node name="Place" type="Node3D"]\n')
        settings = project / "project.godot"
        settings_text = settings.read_text().replace('plugin.cfg")', 'plugin.cfg", "res://tests/editor/plugin.cfg")')
        # The editor opens the main scene when it starts.
        settings.write_text(settings_text.replace("res://main.tscn", SCENE))
        self._output_file = project / "output.txt"
        self._process = subprocess.Popen(
            [godot, "--headless", "--editor", "--path", project],
            stdin=subprocess.DEVNULL,
            stdout=self._output_file.open("w"),
            stderr=subprocess.STDOUT,
            env=os.environ | isolated_environment(),
        )

    def execute(self, command: str) -> str:
        """Executes a command and returns its result."""
        result_file = self.project / "done.txt"
        part = self.project / "command.part"
        part.write_text(command)
        part.rename(self.project / "command.txt")
        self._wait(result_file.exists, command)
        result = result_file.read_text()
        result_file.unlink()
        return result

    def wait(self, command: str, wanted: str) -> None:
        """Waits until a command returns a result."""
        self._wait(lambda: self.execute(command) == wanted, f"{command} to give {wanted}")

    def output(self) -> str:
        """The output so far."""
        return self._output_file.read_text(errors="replace")

    def close(self) -> None:
        self._process.kill()
        self._process.wait(10.0)

    def _wait(self, is_so: object, what: str) -> None:
        deadline_s = time.monotonic() + LONG_S
        while not is_so():  # type: ignore[operator]
            assert self._process.poll() is None, self.output()
            assert time.monotonic() < deadline_s, f"timed out waiting for {what}; {self.output()}"
            time.sleep(0.02)


@pytest.fixture(scope="module")
def editor_and_engine(godot: Path, project: Path) -> Iterator[tuple[Editor, RemoteEngine]]:
    """An editor with an empty scene, connected to a rosbridge server, and an engine that controls it."""
    with ExitStack() as open_things:
        hub = open_things.enter_context(LocalNode())
        server = open_things.enter_context(RosbridgeServer(hub, port=0))
        editor = open_things.enter_context(closing(Editor(godot, project)))
        assert editor.execute(f"open {SCENE}") == "Place"
        editor.execute(f"connect_dock ws://127.0.0.1:{server.port} godot")
        editor.wait("status", "CONNECTED")
        address = f"ros://127.0.0.1:{server.port}/godot?profile=mindstage"
        engine = open_things.enter_context(closing(connect(address, timeout_s=LONG_S)))
        yield editor, engine


@pytest.fixture
def with_room(editor_and_engine: tuple[Editor, RemoteEngine]) -> tuple[Editor, RemoteEngine]:
    """The same with `scenes.room` in the scene."""
    editor, engine = editor_and_engine
    engine.clear()
    assert engine.apply(Spawn(room())).report.ok
    return editor, engine


def names() -> str:
    """Bodies with a physics node of their own; a handle shares its door's."""
    return " ".join(sorted(body.id for body in room().bodies if not body.id.endswith("_handle")))


def test_a_map_is_spawned_into_the_open_scene_and_returned(with_room: tuple[Editor, RemoteEngine]) -> None:
    editor, engine = with_room
    assert editor.execute("nodes") == names()
    assert diff(room(), engine.snapshot()).identical(0.0)


def test_a_body_moved_by_hand_has_its_new_pose_in_the_snapshot(with_room: tuple[Editor, RemoteEngine]) -> None:
    editor, engine = with_room
    editor.execute("move crate")
    assert engine.snapshot().body("crate").pose.position == pytest.approx((2, 0, 2), abs=1e-6)
    editor.execute("move door")
    snapshot = engine.snapshot()
    assert snapshot.body("door").pose.position == pytest.approx((0.322, 2, 1.9), abs=1e-6)
    assert snapshot.body("door_handle").pose.position == pytest.approx((0.362, 1.75, 1.9), abs=1e-6)
    editor.execute("undo")
    editor.execute("undo")
    assert diff(room(), engine.snapshot()).identical(2e-6)


def test_edits_from_the_wire_can_be_undone_and_redone(with_room: tuple[Editor, RemoteEngine]) -> None:
    editor, engine = with_room
    engine.apply(Delete((BodyId("fridge"),)))
    assert "fridge" not in editor.execute("nodes")
    editor.execute("undo")
    assert editor.execute("nodes") == names()
    assert diff(room(), engine.snapshot()).identical(0.0)
    editor.execute("redo")
    assert "fridge" not in {body.id for body in engine.snapshot().bodies}
    editor.execute("undo")
    editor.execute("undo")
    assert engine.snapshot().bodies == ()
    editor.execute("redo")
    assert diff(room(), engine.snapshot()).identical(0.0)


def test_a_saved_scene_is_still_the_map_when_opened_again(with_room: tuple[Editor, RemoteEngine]) -> None:
    editor, engine = with_room
    editor.execute("move crate")
    assert editor.execute("save") == "OK"
    text = (editor.project / "place.tscn").read_text()
    assert "Generic6DOFJoint3D" in text
    assert "RigidBody3D" in text
    editor.execute(f"reload {SCENE}")
    assert editor.execute("nodes") == names()
    snapshot = engine.snapshot()
    assert snapshot.body("crate").pose.position == pytest.approx((2, 0, 2), abs=1e-6)
    different = {change.id for change in diff(room(), snapshot).changed}
    assert different == {"crate"}


def test_a_saved_scene_runs_as_the_map_describes(with_room: tuple[Editor, RemoteEngine], godot: Path) -> None:
    editor, _ = with_room
    assert editor.execute("save") == "OK"
    process = run(
        godot, editor.project, "--headless", "--script", "tests/editor/run_saved_scene.gd", "--", SCENE, timeout_s=120.0
    )
    assert process.returncode == 0, process.stdout
    assert "SCRIPT ERROR" not in process.stdout, process.stdout


def test_stepping_in_the_editor_is_an_error(with_room: tuple[Editor, RemoteEngine]) -> None:
    _, engine = with_room
    with pytest.raises(UnsupportedByEngineError, match="run the scene"):
        engine.step(0.1)


def test_no_script_failed_meanwhile(with_room: tuple[Editor, RemoteEngine]) -> None:
    editor, _ = with_room
    assert "SCRIPT ERROR" not in editor.output(), editor.output()
