"""What is installed is what is here: the wheel holds every file of the package, data included."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (path,) = folder.glob("mindstage-*-py3-none-any.whl")
    return zipfile.ZipFile(path)


def test_the_wheel_holds_every_file_of_the_package(wheel: zipfile.ZipFile) -> None:
    package = ROOT / "src" / "mindstage"
    files = {
        str(path.relative_to(package.parent))
        for path in package.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    held = {name for name in wheel.namelist() if name.startswith("mindstage/")}
    of_godot = {name for name in held if name.startswith("mindstage/godot_project/")}
    assert held - of_godot == files
    assert {"mindstage/py.typed", "mindstage/knowledge/bundled/kitchen.owl"} <= held


def test_the_wheel_holds_what_godot_runs(wheel: zipfile.ZipFile) -> None:
    project = ROOT / "godot"
    scripts = {f"addons/{path.relative_to(project / 'addons')}" for path in (project / "addons").rglob("*.gd")}
    wanted = {f"mindstage/godot_project/{name}" for name in scripts | {"main.gd", "main.tscn", "project.godot"}}
    assert wanted <= set(wheel.namelist())


def test_the_wheel_says_its_license(wheel: zipfile.ZipFile) -> None:
    names = wheel.namelist()
    metadata = wheel.read(next(name for name in names if name.endswith("METADATA"))).decode()
    assert "License-Expression: Apache-2.0" in metadata
    assert any(name.endswith("licenses/LICENSE") for name in names)


def test_the_pins_hold_what_the_project_asks_for() -> None:
    import tomllib

    from packaging.requirements import Requirement

    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = [line for extra in project["optional-dependencies"].values() for line in extra]
    for name, lines in (("run", project["dependencies"]), ("dev", [*project["dependencies"], *extras])):
        pins = dict(
            line.split(";")[0].rstrip(" \\").split("==")
            for line in (ROOT / "requirements" / f"{name}.txt").read_text(encoding="utf-8").splitlines()
            if "==" in line and not line.startswith(" ")
        )
        for line in lines:
            wanted = Requirement(line)
            assert wanted.specifier.contains(pins[wanted.name]), f"{line} but {name}.txt has {pins[wanted.name]}"
