"""Imports are lazy: which libraries an import or a command loads. Times are measured by `benchmarks/startup.py`."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

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
    assert not loaded_by(code) & HEAVY


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


HOOK = """
import sys
from pathlib import Path
sys.path.insert(0, {folder!r})
import mindstage
from mindstage.lazy_names import when_imported
when_imported("late", lambda module: print("called with", module.VALUE))
"""


@pytest.mark.parametrize(
    ("statements", "expected"),
    [
        ("import late; import late", ["called with 7"]),
        ("import importlib.util; importlib.util.find_spec('late')", []),
        ("import late; import importlib; importlib.reload(late)", ["called with 7"]),
        ("try: import absent\nexcept ModuleNotFoundError: print('absent')\nimport late", ["absent", "called with 7"]),
        (
            "try: import late.absent\nexcept ModuleNotFoundError: pass\n"
            "import inspect, late; print(inspect.getsource(late).strip())",
            ["called with 7", "VALUE = 7"],
        ),
        ("when_imported('mindstage', lambda module: print(module.__name__))", ["mindstage"]),
    ],
)
def test_a_function_is_called_once_after_an_import(tmp_path: Path, statements: str, expected: list[str]) -> None:
    (tmp_path / "late.py").write_text("VALUE = 7\n", encoding="utf-8")
    code = HOOK.format(folder=str(tmp_path)) + statements
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.splitlines() == expected


def test_a_module_whose_first_import_fails_calls_the_function_at_the_next(tmp_path: Path) -> None:
    (tmp_path / "late.py").write_text("raise ImportError", encoding="utf-8")
    fix = "Path({path!r}).write_text('VALUE = 8  # of another size')"
    code = HOOK.format(folder=str(tmp_path)) + (
        f"try: import late\nexcept ImportError: {fix.format(path=str(tmp_path / 'late.py'))}\nimport late"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.splitlines() == ["called with 8"]
