"""The examples run: each script as a program, the code cells of each notebook in one namespace."""

from __future__ import annotations

import ast
import contextlib
import io
import json
import os
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"
SCRIPTS = sorted(EXAMPLES.glob("*.py"))
NOTEBOOKS = sorted(EXAMPLES.glob("notebooks/*.ipynb"))

EXPECTED_OUTPUT = {
    "01_open_and_step.py": "254 bodies",
    "02_ask.py": "milk is stored in http://mindstage.org/maps/kitchen.owl#fridge",
    "03_highlight_and_view.py": "viewer at http://127.0.0.1:",
    "04_open_a_door.py": "open by 90 degrees, 100% of its range",
    "05_place_objects.py": "is in fridge",
    "06_save_and_diff.py": "nothing moved: identical",
    "07_ontology_rule.py": "crockery_cupboard is a Cupboard",
    "08_urdf.py": "2 bodies, 1 joint",
    "09_rosbridge.py": "{'fridge': (",
    "10_sparql_and_tell.py": "coffee_mug_1",
    "11_export.py": "kitchen.glb",
    "12_imagine.py": "10 of 10 samples succeeded",
    "13_episode.py": "at 2.9 s the milk is in nothing",
    "14_robot.py": "drawer_left_2 is open",
}
"""A part of what each script prints."""


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_a_script_prints_the_expected_output(script: Path, tmp_path: Path) -> None:
    source = str(EXAMPLES.parent / "src")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, (source, os.environ.get("PYTHONPATH"))))}
    result = subprocess.run(
        [sys.executable, str(script)],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=180,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    assert EXPECTED_OUTPUT[script.name] in result.stdout
    assert not list(tmp_path.iterdir()), "the example created files"


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_a_script_is_short_and_has_a_docstring(script: Path) -> None:
    text = script.read_text(encoding="utf-8")
    assert len(text.splitlines()) < 40
    assert ast.get_docstring(ast.parse(text))


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_and_its_outputs_are_cleared(notebook: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    monkeypatch.setenv("MPLBACKEND", "agg")
    namespace: dict[str, Any] = {"__name__": "__main__"}
    shown = 0
    try:
        for cell in cells:
            if cell["cell_type"] == "code":
                assert (cell["execution_count"], cell["outputs"]) == (None, [])
                shown += _run("".join(cell["source"]), namespace, name=f"{notebook.name}, {cell['id']}")
    finally:
        if "sim" in namespace:
            namespace["sim"].close()
    assert shown >= 3, "too few cells have an output"


def test_there_are_at_least_ten_scripts_and_four_notebooks() -> None:
    assert len(SCRIPTS) >= 10
    assert {script.name for script in SCRIPTS} == EXPECTED_OUTPUT.keys()
    assert len(NOTEBOOKS) == 4


def _run(source: str, namespace: dict[str, Any], *, name: str) -> bool:
    """Runs a cell as Jupyter does; returns whether it prints something or ends in an expression with a value."""
    tree = ast.parse(source)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(compile(tree, name, "exec"), namespace)
        value = eval(compile(ast.Expression(last.value), name, "eval"), namespace) if last else None
    if value is None:
        return bool(printed.getvalue())
    if html := getattr(value, "_repr_html_", None):
        parser = _Balanced()
        parser.feed(html())
        assert not parser.open
    assert repr(value)
    return True


class _Balanced(HTMLParser):
    """Checks that every opened tag is closed."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag
