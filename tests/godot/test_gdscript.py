"""The addon's own tests, written in GDScript and run in Godot."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.godot.project import run

_RUN = ("--headless", "--script", "tests/run.gd")


def test_all_gdscript_tests_pass_without_script_errors(godot: Path, project: Path) -> None:
    process = run(godot, project, *_RUN, timeout_s=300.0)
    assert process.returncode == 0, process.stdout
    assert "SCRIPT ERROR" not in process.stdout, process.stdout
    assert " 0 failed" in process.stdout


def test_a_failing_gdscript_test_is_detected(godot: Path, project: Path) -> None:
    wrong = "func test_wrong_sum() -> void:\n\tsame(1, 2)\n\n\nfunc test_wrong_silence() -> void:\n\tpass\n"
    path = project / "tests" / "test_wrong.gd"
    path.write_text(f"extends MindstageTestCase\n\n\n{wrong}")
    try:
        process = run(godot, project, *_RUN, "--", "test_wrong_", timeout_s=120.0)
    finally:
        path.unlink()
    assert process.returncode == 1, process.stdout
    assert "0 passed, 2 failed" in process.stdout


@pytest.mark.parametrize(
    ("argument", "message"),
    [("--mindstage-url=http://x", "is not the URL of a rosbridge"), ("--wrong", "there is no option --wrong")],
)
def test_invalid_arguments_are_refused_with_a_reason(godot: Path, project: Path, argument: str, message: str) -> None:
    process = run(godot, project, "--headless", "res://main.tscn", "--", argument, timeout_s=120.0)
    assert process.returncode == 2, process.stdout
    assert message in process.stdout
    assert "leaked" not in process.stdout
