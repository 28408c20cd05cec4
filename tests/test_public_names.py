"""The names that packages show: those for users and no others; the documents and examples use only these."""

from __future__ import annotations

import ast
import json
import re
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import mindstage
from tests.cases import each_case
from tests.test_documents import DOCUMENTS, ROOT, blocks

REFERENCE = ROOT / "docs/reference/python"
PACKAGES = sorted(page.stem for page in REFERENCE.glob("*.md") if page.stem != "index")
SUB_PACKAGES = ["knowledge.queries", "robots.models", "robots.skills"]
"""Those whose names are all for users; a package does not list the ones that import it."""
SOURCES = [
    *(path for path in DOCUMENTS if path.name not in {"CONTRIBUTING.md", "plug-ins.md"}),  # they are for developers
    *sorted((ROOT / "examples").glob("*.py")),
    *sorted((ROOT / "examples").rglob("*.ipynb")),
]


def code_of(path: Path) -> list[str]:
    """The Python programs of a document, script or notebook."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        return [text]
    if path.suffix == ".ipynb":
        return ["".join(cell["source"]) for cell in json.loads(text)["cells"] if cell["cell_type"] == "code"]
    return blocks("python", text)


def hidden_names(code: str) -> set[str]:
    """The names of Mindstage in a program that their packages do not show."""
    try:
        tree = ast.parse(code)
    except SyntaxError:  # signatures without bodies
        return set()
    found: set[str] = set()
    packages: dict[str, str] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            packages |= {each.asname or each.name: each.name for each in node.names if is_own(each.name)}
        elif isinstance(node, ast.ImportFrom) and is_own(node.module or ""):
            found |= {name for each in node.names if (name := f"{node.module}.{each.name}") and not is_shown(name)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and re.fullmatch(r"[\w.]+", text := ast.unparse(node)):
            package, _, names = text.partition(".")
            if package in packages and not is_shown(name := f"{packages[package]}.{names}"):
                found.add(name)
    return found


def is_own(module: str) -> bool:
    return module.partition(".")[0] == "mindstage"


def is_shown(name: str) -> bool:
    """Whether a dotted name leads through names that are shown, as far as these are modules."""
    shown: Any = mindstage
    for part in name.split(".")[1:]:
        if not isinstance(shown, ModuleType):
            return True
        if f"{shown.__name__}.{part}".removeprefix("mindstage.") in [*SUB_PACKAGES, "engines.mujoco", "engines.remote"]:
            shown = import_module(f"{shown.__name__}.{part}")
        elif part in dir(shown):
            shown = getattr(shown, part)
        else:
            return False
    return True


def test_the_package_shows_its_names_and_the_packages_of_the_reference() -> None:
    assert sorted([*mindstage.__all__, *PACKAGES]) == dir(mindstage)


@each_case("name", [*PACKAGES, *SUB_PACKAGES])
def test_a_package_shows_what_is_meant_for_users_and_nothing_else(name: str) -> None:
    package = import_module(f"mindstage.{name}")
    modules = {each for each in dir(package) if isinstance(getattr(package, each), ModuleType)} - set(package.__all__)
    assert set(dir(package)) == {*package.__all__, *modules}
    assert modules <= {"edits", "gym", "models", "mujoco", "queries", "remote", "skills"}
    assert all(hasattr(package, each) for each in dir(package))
    assert not [each for each in dir(package) if each.startswith("_")]


@each_case("path", SOURCES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_documents_and_examples_use_only_names_that_are_shown(path: Path) -> None:
    assert set().union(*map(hidden_names, code_of(path))) == set()


def test_a_hidden_name_is_found() -> None:
    assert hidden_names("from mindstage.scene.world_model import Pose") == {"mindstage.scene.world_model.Pose"}
    assert hidden_names("from mindstage.scene import Pose, cross") == {"mindstage.scene.cross"}
    assert hidden_names("import mindstage as ms\nms.saving.save_world(1)\nms.World.x") == {
        "mindstage.saving",
        "mindstage.saving.save_world",
    }
    assert len([path for path in SOURCES if any("mindstage" in code for code in code_of(path))]) > 20


def test_the_table_of_packages_has_all_of_them() -> None:
    listed = re.findall(r"^\| \[`mindstage\.(\w+)`\]", (REFERENCE / "index.md").read_text(encoding="utf-8"), re.M)
    assert sorted(listed) == PACKAGES
