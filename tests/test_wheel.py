"""The wheel contains every file of the package, including data, and the pins satisfy the requirements."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tarfile
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


def test_the_wheel_contains_every_file_of_the_package(wheel: zipfile.ZipFile) -> None:
    package = ROOT / "src" / "mindstage"
    files = {
        str(path.relative_to(package.parent))
        for path in package.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    contents = {name for name in wheel.namelist() if name.startswith("mindstage/")}
    godot = {name for name in contents if name.startswith("mindstage/godot_project/")}
    assert contents - godot == files
    assert {
        "mindstage/py.typed",
        "mindstage/maps/bundled/kitchen.owl",
        "mindstage/msgs/definitions/world_control_msgs/srv/SpawnModel.srv",
        "mindstage/prolog/questions.pl",
        "mindstage/viewer/web/style.css",
    } <= contents


def test_the_source_distribution_contains_the_ros_packages(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", str(tmp_path)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (path,) = tmp_path.glob("mindstage-*.tar.gz")
    with tarfile.open(path) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    files = {str(path.relative_to(ROOT)) for path in (ROOT / "ros").rglob("*") if path.is_file()}
    assert "ros/mindstage_msgs/package.xml" in files
    assert files <= names


def test_the_wheel_contains_the_godot_project(wheel: zipfile.ZipFile) -> None:
    project = ROOT / "godot"
    scripts = {f"addons/{path.relative_to(project / 'addons')}" for path in (project / "addons").rglob("*.gd")}
    wanted = {f"mindstage/godot_project/{name}" for name in scripts | {"main.gd", "main.tscn", "project.godot"}}
    assert wanted <= set(wheel.namelist())


def test_the_wheel_names_its_license(wheel: zipfile.ZipFile) -> None:
    names = wheel.namelist()
    metadata = wheel.read(next(name for name in names if name.endswith("METADATA"))).decode()
    assert "License-Expression: Apache-2.0" in metadata
    assert any(name.endswith("licenses/LICENSE") for name in names)


def test_the_pins_satisfy_the_requirements_of_the_project() -> None:
    import tomllib

    from packaging.requirements import Requirement

    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    sets = {
        "run": [],
        "dev": [line for extra, lines in extras.items() if extra not in {"all", "docs"} for line in lines],
        "docs": extras["docs"],
    }
    for name, lines in sets.items():
        pins = dict(
            line.split(";")[0].rstrip(" \\").split("==")
            for line in (ROOT / "requirements" / f"{name}.txt").read_text(encoding="utf-8").splitlines()
            if "==" in line and not line.startswith(" ")
        )
        for line in [*project["dependencies"], *lines]:
            wanted = Requirement(line)
            assert wanted.specifier.contains(pins[wanted.name]), f"{line} but {name}.txt has {pins[wanted.name]}"


def test_the_extra_all_has_every_extra_but_those_for_developers_and_special_machines() -> None:
    import tomllib

    from packaging.requirements import Requirement

    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    (line,) = extras["all"]
    requirement = Requirement(line)
    assert requirement.name == "mindstage"
    assert requirement.extras == extras.keys() - {"all", "bench", "dev", "docs", "gpu", "ray"}


def test_the_installed_wheel_runs_the_demo_and_answers_outside_the_checkout(
    wheel: zipfile.ZipFile, tmp_path: Path
) -> None:
    wheel.extractall(tmp_path / "site")
    environment = {name: value for name, value in os.environ.items() if not name.startswith("MINDSTAGE")}
    environment |= {"PYTHONPATH": str(tmp_path / "site"), "HOME": str(tmp_path), "MINDSTAGE_CACHE": str(tmp_path)}

    def run(*arguments: str) -> str:
        command = [sys.executable, "-m", "mindstage", *arguments]
        done = subprocess.run(
            command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120, check=False
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    where = subprocess.run(
        [sys.executable, "-c", "import mindstage; print(mindstage.__file__)"],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert where.startswith(str(tmp_path)), "the wheel is tested, not the checkout"
    assert "is served at http://127.0.0.1:" in run("demo", "--port", "0", "--for", "0.5", "--no-open")
    assert "fridge" in run("ask", "where is milk kept?", "--map", "bundled:kitchen")


# -- the container -----------------------------------------------------------------------------------------------------


def instructions() -> list[tuple[str, str]]:
    """The instructions of the Containerfile and their arguments."""
    text = (ROOT / "Containerfile").read_text(encoding="utf-8").replace("\\\n", " ")
    lines = [line.strip() for line in text.splitlines() if line.strip() and not line.startswith("#")]
    return [(line.partition(" ")[0], line.partition(" ")[2]) for line in lines]


def test_the_container_runs_the_demo_without_root_on_the_loopback_interface() -> None:
    found = instructions()
    last_stage = found[max(index for index, (name, _) in enumerate(found) if name == "FROM") :]
    values = dict(last_stage)
    assert values["USER"] == "mindstage"
    assert json.loads(values["ENTRYPOINT"]) == ["mindstage"]
    assert json.loads(values["CMD"]) == ["demo", "--no-open"], "other addresses only by an explicit --host"
    assert "MINDSTAGE_TOKEN" not in " ".join(argument for _, argument in found), "no token is baked into the image"
    assert all("slim" in argument for name, argument in found if name == "FROM")


def test_the_container_installs_pinned_packages_and_copies_files_that_exist() -> None:
    known = {"FROM", "WORKDIR", "COPY", "RUN", "USER", "ENV", "EXPOSE", "ENTRYPOINT", "CMD"}
    for name, argument in instructions():
        assert name in known
        if name == "COPY" and not argument.startswith("--from"):
            for source in argument.split()[:-1]:
                assert (ROOT / source).exists(), source
        for command in argument.split("&&") if name == "RUN" else ():
            if "pip install" in command:
                assert "--require-hashes" in command or "--no-deps" in command, command


def test_the_container_can_build_the_wheel_from_the_pins_alone() -> None:
    import tomllib

    from packaging.requirements import Requirement

    backend = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["build-system"]["requires"]
    pins = (ROOT / "requirements" / "run.txt").read_text(encoding="utf-8")
    assert any("--no-build-isolation" in argument for _, argument in instructions())
    for requirement in map(Requirement, backend):
        assert f"\n{requirement.name}==" in pins, requirement


def test_the_user_of_the_container_owns_its_working_folder() -> None:
    found = instructions()
    user = max(index for index, (name, _) in enumerate(found) if name == "USER")
    folder = dict(found[user:])["WORKDIR"]
    made = [argument for name, argument in found[:user] if name == "RUN" and argument.endswith(f" {folder}")]
    assert any("--owner mindstage" in argument for argument in made), "WORKDIR makes folders that belong to root"
