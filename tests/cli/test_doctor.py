"""What `doctor` says of this machine, and of components that are missing or do not work."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import mujoco
import pytest

from tests.cli.runner import Run


def components(run: Run) -> dict[str, dict[str, Any]]:
    result = run("doctor", "--json")
    found = {each["component"]: each for each in json.loads(result.stdout)["components"]}
    assert result.exit_code == any(each["state"] == "broken" for each in found.values()), result.output
    return found


def test_what_works_has_its_version_and_what_is_missing_a_remedy(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    found = components(run)
    assert found["MuJoCo"]["state"] == "works"
    assert found["MuJoCo"]["detail"] == mujoco.__version__
    assert found["SWI-Prolog"]["state"] == "missing"
    assert "swi-prolog-nox" in found["SWI-Prolog"]["remedy"]
    assert all(each["remedy"] for each in found.values() if each["state"] != "works")
    assert found["extra robots"]["state"] == "works"


@pytest.mark.skipif(os.name == "nt", reason="the program is a shell script")
def test_a_program_that_does_not_run_is_broken(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    godot = tmp_path / "godot"
    godot.write_text("#!/bin/sh\necho cannot open display >&2\nexit 3\n", encoding="utf-8")
    godot.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    found = components(run)["Godot"]
    assert found["state"] == "broken"
    assert "cannot open display" in found["detail"]
