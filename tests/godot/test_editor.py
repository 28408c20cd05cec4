"""The editor's dock: a map is spawned into the open scene, edited by hand, undone, saved, opened again, logged back."""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path

import pytest

from mindstage.bridge import LocalNode, RosbridgeServer
from mindstage.engines import RemoteEngine, connect
from mindstage.engines.godot_process import isolated_environment
from mindstage.errors import UnsupportedByEngineError
from mindstage.scene import BodyId, diff
from tests.engines.scenes import room
from tests.godot.project import run

SCENE = "res://place.tscn"
LONG_S = 120.0


class Editor:
    """Godot's editor without a window, and somebody who works with it."""

    def __init__(self, godot: Path, project: Path) -> None:
        self.project = project
        (project / "place.tscn").write_text('[gd_scene format=3]\n\n[node name="Place" type="Node3D"]\n')
        settings = project / "project.godot"
        told = settings.read_text().replace('plugin.cfg")', 'plugin.cfg", "res://tests/editor/plugin.cfg")')
        settings.write_text(told.replace("res://main.tscn", SCENE))  # the editor opens the main scene by itself
        self._said = project / "said.txt"
        self._process = subprocess.Popen(
            [godot, "--headless", "--editor", "--path", project],
            stdin=subprocess.DEVNULL,
            stdout=self._said.open("w"),
            stderr=subprocess.STDOUT,
            env=os.environ | isolated_environment(),
        )

    def do(self, command: str) -> str:
        """Has something done, and gives what came of it."""
        done = self.project / "done.txt"
        part = self.project / "command.part"
        part.write_text(command)
        part.rename(self.project / "command.txt")
        self._wait(done.exists, command)
        said = done.read_text()
        done.unlink()
        return said

    def wait(self, command: str, wanted: str) -> None:
        """Waits until a command gives what is wanted."""
        self._wait(lambda: self.do(command) == wanted, f"{command} to give {wanted}")

    def said(self) -> str:
        """All that it printed."""
        return self._said.read_text(errors="replace")

    def close(self) -> None:
        self._process.kill()
        self._process.wait(10.0)

    def _wait(self, is_so: object, what: str) -> None:
        until_s = time.monotonic() + LONG_S
        while not is_so():  # type: ignore[operator]
            assert self._process.poll() is None, self.said()
            assert time.monotonic() < until_s, f"waited in vain for {what}; {self.said()}"
            time.sleep(0.02)


@pytest.fixture(scope="module")
def place(godot: Path, project: Path) -> Iterator[tuple[Editor, RemoteEngine]]:
    """An editor with an empty scene, joined to a hub, and an engine that drives it."""
    with ExitStack() as open_things:
        hub = open_things.enter_context(LocalNode())
        server = open_things.enter_context(RosbridgeServer(hub, port=0))
        editor = open_things.enter_context(closing(Editor(godot, project)))
        assert editor.do(f"open {SCENE}") == "Place"
        editor.do(f"connect_dock ws://127.0.0.1:{server.port} godot")
        editor.wait("status", "CONNECTED")
        address = f"ros://127.0.0.1:{server.port}/godot?profile=mindstage"
        engine = open_things.enter_context(closing(connect(address, timeout_s=LONG_S)))
        yield editor, engine


@pytest.fixture
def furnished(place: tuple[Editor, RemoteEngine]) -> tuple[Editor, RemoteEngine]:
    """The same with the room in its scene."""
    editor, engine = place
    engine.clear()
    assert engine.spawn(room()).ok
    return editor, engine


def names() -> str:
    """Those that have a physics node of their own: a handle shares its door's."""
    return " ".join(sorted(body.id for body in room().bodies if not body.id.endswith("_handle")))


def test_a_map_is_spawned_into_the_open_scene_and_returned(furnished: tuple[Editor, RemoteEngine]) -> None:
    editor, engine = furnished
    assert editor.do("nodes") == names()
    assert diff(room(), engine.snapshot()).identical(0.0)


def test_a_body_moved_by_hand_has_its_new_pose_in_the_snapshot(furnished: tuple[Editor, RemoteEngine]) -> None:
    editor, engine = furnished
    editor.do("move crate")
    assert engine.snapshot().body("crate").pose.position == pytest.approx((2, 0, 2), abs=1e-6)
    editor.do("move door")
    log = engine.snapshot()
    assert log.body("door").pose.position == pytest.approx((0.322, 2, 1.9), abs=1e-6)
    assert log.body("door_handle").pose.position == pytest.approx((0.362, 1.75, 1.9), abs=1e-6)
    editor.do("undo")
    editor.do("undo")
    assert diff(room(), engine.snapshot()).identical(2e-6)


def test_edits_from_the_wire_can_be_undone_and_redone(furnished: tuple[Editor, RemoteEngine]) -> None:
    editor, engine = furnished
    engine.delete([BodyId("fridge")])
    assert "fridge" not in editor.do("nodes")
    editor.do("undo")
    assert editor.do("nodes") == names()
    assert diff(room(), engine.snapshot()).identical(0.0)
    editor.do("redo")
    assert "fridge" not in {body.id for body in engine.snapshot().bodies}
    editor.do("undo")
    editor.do("undo")
    assert engine.snapshot().bodies == ()
    editor.do("redo")
    assert diff(room(), engine.snapshot()).identical(0.0)


def test_a_saved_scene_is_still_the_map_when_opened_again(furnished: tuple[Editor, RemoteEngine]) -> None:
    editor, engine = furnished
    editor.do("move crate")
    assert editor.do("save") == "OK"
    text = (editor.project / "place.tscn").read_text()
    assert "Generic6DOFJoint3D" in text
    assert "RigidBody3D" in text
    editor.do(f"reload {SCENE}")
    assert editor.do("nodes") == names()
    log = engine.snapshot()
    assert log.body("crate").pose.position == pytest.approx((2, 0, 2), abs=1e-6)
    different = {change.id for change in diff(room(), log).changed}
    assert different == {"crate"}


def test_a_saved_scene_runs_as_the_map_describes(furnished: tuple[Editor, RemoteEngine], godot: Path) -> None:
    editor, _ = furnished
    assert editor.do("save") == "OK"
    done = run(
        godot, editor.project, "--headless", "--script", "tests/editor/run_saved_scene.gd", "--", SCENE, timeout_s=120.0
    )
    assert done.returncode == 0, done.stdout
    assert "SCRIPT ERROR" not in done.stdout, done.stdout


def test_stepping_in_the_editor_is_an_error(furnished: tuple[Editor, RemoteEngine]) -> None:
    _, engine = furnished
    with pytest.raises(UnsupportedByEngineError, match="run the scene"):
        engine.step(0.1)


def test_no_script_failed_meanwhile(furnished: tuple[Editor, RemoteEngine]) -> None:
    editor, _ = furnished
    assert "SCRIPT ERROR" not in editor.said(), editor.said()
