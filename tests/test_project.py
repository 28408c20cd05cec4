"""The house is as it is drawn: rooms, modules, errors, sizes.

The packages are read from the table in `docs/explanation/architecture.md`, so that document and code agree.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

from mindstage import errors

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "src" / "mindstage"
SOURCES = sorted(PACKAGE.rglob("*.py"))
EVERYTHING = sorted(
    path for folder in ("src", "tests", "scripts", "benchmarks") for path in (ROOT / folder).rglob("*.py")
)

LONG_FILES: dict[str, str] = {}
"""Files over 1,000 lines, each with the reason why it is one."""


def shown(path: Path) -> str:
    return str(path.relative_to(ROOT))


each_module = pytest.mark.parametrize("path", SOURCES, ids=shown)
each_file = pytest.mark.parametrize("path", EVERYTHING, ids=shown)


# -- rooms -------------------------------------------------------------------------------------------------------------


class Room(NamedTuple):
    name: str
    may_import: frozenset[str]
    libraries: frozenset[str]


@cache
def rooms() -> dict[str, Room]:
    text = (ROOT / "docs" / "explanation" / "architecture.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `([a-z_/]+)` \|(.*)\|(.*)\|(.*)\|$", text, re.MULTILINE)
    names = {name for name, *_ in rows}
    found = {}
    for name, _, imports, libraries in rows:
        may = names if "all" in imports else set(re.findall(r"`([a-z_/]+)`", imports)) | {name, "errors"}
        assert may <= names, f"the row of {name} names a room that has no row: {may - names}"
        found[name] = Room(name, frozenset(may), frozenset(re.findall(r"`([a-z_/]+)`", libraries)))
    return found


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT / "src").with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def room_of(module: str) -> str | None:
    """The deepest room that a module lies in; the package itself is in none."""
    parts = module.split(".")[1:]
    for end in range(len(parts), 0, -1):
        if (name := "/".join(parts[:end])) in rooms():
            return name
    return None


def imported_modules(path: Path) -> Iterator[str]:
    here = module_name(path).split(".")
    base = here if path.name == "__init__.py" else here[:-1]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        match node:
            case ast.Import(names=names):
                yield from (alias.name for alias in names)
            case ast.ImportFrom(module=module, names=names, level=level):
                start = ".".join([*base[: len(base) - level + 1], *([module] if module else [])]) if level else module
                # `from mindstage import knowledge` names a module, `from mindstage.world import Pose` does not.
                yield from (f"{start}.{alias.name}" for alias in names)
            case ast.Call(func=ast.Name(id="import_module"), args=[ast.Constant(value=str(name)), *_]):
                yield name


@each_module
def test_a_room_imports_only_what_its_row_allows(path: Path) -> None:
    module = module_name(path)
    own = room_of(module)
    for target in imported_modules(path):
        if target.split(".")[0] != "mindstage":
            continue
        room = room_of(target)
        if own is None or room is None or (path.name == "__init__.py" and room.startswith(f"{own}/")):
            continue  # the package shows what its rooms hold, a room shows what its inner rooms hold
        assert room in rooms()[own].may_import, f"{module} imports {target}, but {own} may not use {room}"


@each_module
def test_a_library_is_imported_in_its_own_room_only(path: Path) -> None:
    owners = {library: room.name for room in rooms().values() for library in room.libraries}
    own = room_of(module_name(path))
    for target in imported_modules(path):
        library = target.split(".")[0]
        assert owners.get(library, own) == own, f"{library} belongs to {owners[library]}, not to {module_name(path)}"


def test_every_module_stands_in_a_room_of_the_table() -> None:
    outside = {module_name(path) for path in SOURCES if room_of(module_name(path)) is None}
    assert outside <= {"mindstage", "mindstage.__main__"}


def test_every_room_of_the_table_exists() -> None:
    for name in rooms():
        assert (PACKAGE / name).is_dir() or (PACKAGE / f"{name}.py").is_file(), f"there is no room {name}"


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("import mindstage.stage", ["mindstage.simulation"]),
        ("from mindstage.world import Pose", ["mindstage.scene.Pose"]),
        ("from . import loop", ["mindstage.scene.loop"]),
        ("from .loop import Loop", ["mindstage.scene.loop.Loop"]),
        ("from ..knowledge import KnowledgeBase", ["mindstage.knowledge.KnowledgeBase"]),
        ("def late():\n    import mujoco", ["mujoco"]),
        ("import_module('mindstage.stage')", ["mindstage.simulation"]),
    ],
)
def test_the_walk_sees_every_way_to_import(
    line: str, expected: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.modules[__name__], "ROOT", tmp_path)
    path = tmp_path / "src" / "mindstage" / "world" / "values.py"
    path.parent.mkdir(parents=True)
    path.write_text(line, encoding="utf-8")
    assert list(imported_modules(path)) == expected


# -- modules -----------------------------------------------------------------------------------------------------------


@each_module
def test_a_module_says_what_it_is_for(path: Path) -> None:
    docstring = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
    assert docstring, "no docstring"
    assert docstring.splitlines()[0].endswith("."), "the first line is no sentence"


@each_module
def test_a_module_shows_what_it_says(path: Path) -> None:
    if path.name == "__main__.py":
        return
    module = importlib.import_module(module_name(path))
    assert hasattr(module, "__all__"), "no __all__"
    assert len(set(module.__all__)) == len(module.__all__), "a name stands twice in __all__"
    for name in module.__all__:
        assert hasattr(module, name), f"__all__ promises {name}, which is not there"


def test_a_wrong_name_in_the_package_is_an_attribute_error() -> None:
    package = importlib.import_module("mindstage")
    with pytest.raises(AttributeError, match="no attribute 'Stagge'"):
        package.Stagge  # noqa: B018


# -- errors ------------------------------------------------------------------------------------------------------------


def drawn_errors() -> dict[str, tuple[str | None, int | None]]:
    """Name, parent and exit code of every error as the docstring draws them; a branch passes its code on."""
    drawn: dict[str, tuple[str | None, int | None]] = {}
    branch: list[str] = []
    for stem, name, rest in re.findall(
        r"^    ((?:│   |    |├── |└── )*)(\w+)(.*)$", errors.__doc__ or "", re.MULTILINE
    ):
        del branch[len(stem) // 4 :]
        parent = branch[-1] if branch else None
        told = re.search(r"\(exit code (\d)\)", rest)
        drawn[name] = (parent, int(told[1]) if told else drawn[parent][1] if parent else None)
        branch.append(name)
    return drawn


def test_the_drawn_tree_of_errors_is_the_tree_of_classes() -> None:
    classes = {
        name: cls
        for name, cls in inspect.getmembers(errors, inspect.isclass)
        if cls.__module__.startswith(errors.__name__)
    }
    parents = {
        name: base.__name__ if (base := cls.__base__) in classes.values() else None for name, cls in classes.items()
    }
    assert parents == {name: parent for name, (parent, _) in drawn_errors().items()}
    assert set(errors.__all__) == {*classes, "near", "suggestion"}


def test_the_command_line_ends_with_the_drawn_exit_codes() -> None:
    from mindstage.cli.options import exit_code

    for name, (_, code) in drawn_errors().items():
        if code is not None:
            error = getattr(errors, name).__new__(getattr(errors, name))
            assert exit_code(error) == code, name


# -- sizes -------------------------------------------------------------------------------------------------------------


@each_file
def test_a_file_can_be_read_in_one_sitting(path: Path) -> None:
    if path.parent.name == "_generated":
        return  # the definition files are what is read and edited
    lines = len(path.read_text(encoding="utf-8").splitlines())
    if lines > 1000:
        assert shown(path) in LONG_FILES, f"{lines} lines; split it, or give the reason in LONG_FILES"


def test_no_reason_is_kept_for_a_file_that_became_short() -> None:
    for name in LONG_FILES:
        assert len((ROOT / name).read_text(encoding="utf-8").splitlines()) > 1000, f"{name} needs no reason any more"


@each_file
def test_a_function_fits_on_a_screen(path: Path) -> None:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            documentation = ast.get_docstring(node, clean=False) or ""  # as long as it has to be
            lines = (node.end_lineno or node.lineno) - node.lineno + 1 - documentation.count("\n")
            assert lines <= 60, f"{node.name} has {lines} lines"


def test_no_file_is_a_drawer_for_everything() -> None:
    assert not [shown(path) for path in EVERYTHING if path.stem in {"utils", "util", "helpers", "misc", "common"}]


def test_no_package_index_is_named() -> None:
    # Where packages come from is the business of whoever installs; the parts are joined here to keep this file clean.
    hosts = re.compile(
        "|".join(re.escape(f"{name}.org") for name in ("py" + "pi", "files.python" + "hosted", "npm" + "js"))
    )
    documents = [*ROOT.glob("*.*"), *ROOT.glob("docs/**/*.md"), *ROOT.glob(".github/**/*")]
    texts = [*documents, *ROOT.glob("requirements/*"), *EVERYTHING, ROOT / "Makefile"]
    assert not [shown(path) for path in texts if path.is_file() and hosts.search(path.read_text(encoding="utf-8"))]
