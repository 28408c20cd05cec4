"""Imports are lazy: which libraries an import or a command loads. Times are measured by `benchmarks/startup.py`."""

from __future__ import annotations

import subprocess
import sys

import pytest

HEAVY = {"mujoco", "pyoxigraph", "viser", "websockets", "trimesh", "numpy", "scipy"}


def loaded_by(code: str) -> set[str]:
    """The top-level modules after running code in a new Python process."""
    show = "import sys; print(*{name.split('.')[0] for name in sys.modules}, file=sys.__stderr__)"
    result = subprocess.run([sys.executable, "-c", f"{code}\n{show}"], capture_output=True, text=True, check=True)
    return set(result.stderr.split())


def test_importing_the_package_loads_no_other_package() -> None:
    third_party = loaded_by("import mindstage") - loaded_by("import importlib, typing") - set(sys.stdlib_module_names)
    assert third_party == {"mindstage"}


@pytest.mark.parametrize("args", [["--help"], ["check", "--help"], ["--version"]], ids=" ".join)
def test_help_loads_no_heavy_library(args: list[str]) -> None:
    code = (
        f"import sys; sys.argv = ['mindstage', *{args}]\n"
        "from mindstage.cli import main\n"
        "try: main()\n"
        "except SystemExit as end: assert end.code == 0, end.code"
    )
    assert not loaded_by(code) & (HEAVY | {"msgspec"})


@pytest.mark.parametrize(
    ("name", "absent"),
    [
        ("World", HEAVY),
        ("NullEngine", HEAVY - {"numpy"}),
        ("KnowledgeBase", HEAVY - {"numpy", "pyoxigraph"}),
        ("MujocoEngine", {"pyoxigraph", "viser", "trimesh", "scipy"}),  # mujoco itself imports websockets
        ("Simulation", HEAVY - {"numpy", "pyoxigraph"}),
    ],
)
def test_a_name_loads_only_the_libraries_of_its_package(name: str, absent: set[str]) -> None:
    assert not loaded_by(f"import mindstage; mindstage.{name}") & absent


@pytest.mark.parametrize(
    "args",
    [["ask", "storage_place", "CowsMilk"], ["ask", "subclass_of", "Cup"], ["sparql", "ASK {}"]],
    ids=" ".join,
)
def test_a_question_about_classes_loads_neither_arrays_nor_the_simulation(args: list[str]) -> None:
    code = (
        f"import sys; sys.argv = ['mindstage', *{args}]\n"
        "from mindstage.cli import main\n"
        "try: main()\n"
        "except SystemExit as end: assert end.code == 0, end.code\n"
        "assert not {'mindstage.simulation', 'mindstage.imagination'} & sys.modules.keys()"
    )
    assert not loaded_by(code) & (HEAVY - {"pyoxigraph"})
