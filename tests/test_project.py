"""The structure of the source tree: packages, imports, public names, errors, sizes.

The allowed imports are read from the table in `docs/explanation/architecture.md`, so that document and code agree.
"""

from __future__ import annotations

import ast
import builtins
import importlib
import inspect
import re
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

from mindstage import errors
from mindstage.registry import Group, extensions

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "src" / "mindstage"
SOURCES = sorted(PACKAGE.rglob("*.py"))
EVERYTHING = sorted(
    path for folder in ("src", "tests", "scripts", "benchmarks") for path in (ROOT / folder).rglob("*.py")
)


def shown(path: Path) -> str:
    return str(path.relative_to(ROOT))


def problems(paths: Iterable[Path], check: Callable[[Path], Iterable[str]]) -> list[str]:
    """What a check yields for each file, with the file's name: one test for all files, since there are thousands."""
    return [f"{shown(path)}: {problem}" for path in paths for problem in check(path)]


# -- packages ----------------------------------------------------------------------------------------------------------


class PackageRow(NamedTuple):
    name: str
    imports: frozenset[str] | None
    """The other packages that this one may import; None for all."""
    libraries: frozenset[str]


@cache
def package_rows() -> dict[str, PackageRow]:
    text = (ROOT / "docs" / "explanation" / "architecture.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `([a-z_/]+)` \|(.*)\|(.*)\|(.*)\|$", text, re.MULTILINE)
    names = {name for name, *_ in rows}
    found = {}
    for name, _, imports, libraries in rows:
        allowed = None if imports.strip() == "all" else frozenset(re.findall(r"`([a-z_/]+)`", imports))
        assert (allowed or set()) <= names, f"the row of {name} names packages without a row: {allowed}"
        found[name] = PackageRow(name, allowed, frozenset(re.findall(r"`([a-z_0-9]+)`", libraries)))
    return found


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT / "src").with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def package_of(module: str) -> str | None:
    """The deepest package of the table that contains the module; None for the top-level package."""
    parts = module.split(".")[1:]
    for end in range(len(parts), 0, -1):
        if (name := "/".join(parts[:end])) in package_rows():
            return name
    return None


@cache
def syntax_tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def imported_names(path: Path) -> tuple[str, ...]:
    """The dotted names that a module imports: at its top, inside functions and for type checking alike."""
    here = module_name(path).split(".")
    base = here if path.name == "__init__.py" else here[:-1]
    found: list[str] = []
    for node in ast.walk(syntax_tree(path)):
        match node:
            case ast.Import(names=names):
                found += (alias.name for alias in names)
            case ast.ImportFrom(module=module, names=names, level=level):
                start = ".".join([*base[: len(base) - level + 1], *([module] if module else [])]) if level else module
                # `from mindstage import knowledge` imports a module, `from mindstage.scene import Pose` does not.
                found += (f"{start}.{alias.name}" for alias in names)
            case ast.Call(
                func=ast.Name(id="import_module") | ast.Attribute(attr="import_module"),
                args=[ast.Constant(value=str(name)), *_],
            ):
                found.append(name)
    return tuple(found)


def imported_packages(path: Path) -> Iterator[tuple[str, str, str]]:
    """The importing package, the imported package and the imported name of each import between two packages."""
    own = package_of(module_name(path))
    for target in imported_names(path):
        if target.split(".")[0] == "mindstage" and own is not None:
            package = package_of(target)
            if package is None or (path.name == "__init__.py" and package.startswith(f"{own}/")):
                continue  # a package re-exports names of its sub-packages
            if package not in {own, "errors", "ranges"}:
                yield own, package, target


def test_a_package_imports_only_what_its_row_allows() -> None:
    def check(path: Path) -> Iterator[str]:
        for own, package, target in imported_packages(path):
            allowed = package_rows()[own].imports
            if allowed is not None and package not in allowed:
                yield f"imports {target}, {own} may not use {package}"

    assert not problems(SOURCES, check)


def test_every_allowed_import_exists() -> None:
    used = {(own, package) for path in SOURCES for own, package, _ in imported_packages(path)}
    allowed = {(row.name, package) for row in package_rows().values() for package in row.imports or ()}
    assert not allowed - used, "the table in architecture.md allows imports that no module needs"


def test_a_library_is_imported_in_its_packages_only() -> None:
    owners: dict[str, tuple[str, ...]] = {}
    for row in package_rows().values():
        for library in row.libraries:
            owners[library] = (*owners.get(library, ()), f"{row.name}/")

    def check(path: Path) -> Iterator[str]:
        own = package_of(module_name(path)) or ""
        for target in imported_names(path):
            if not f"{own}/".startswith(owners.get(target.split(".")[0], own)):
                yield f"imports {target}, a library of {owners[target.split('.')[0]]}"

    assert not problems(SOURCES, check)


def test_every_module_is_in_a_package_of_the_table() -> None:
    outside = {module_name(path) for path in SOURCES if package_of(module_name(path)) is None}
    assert outside <= {"mindstage", "mindstage.__main__"}


def test_every_package_of_the_table_exists() -> None:
    for name in package_rows():
        assert (PACKAGE / name).is_dir() or (PACKAGE / f"{name}.py").is_file(), f"there is no package {name}"


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("import mindstage.simulation", ["mindstage.simulation"]),
        ("from mindstage.scene import Pose", ["mindstage.scene.Pose"]),
        ("from . import broker", ["mindstage.bridge.broker"]),
        ("from .broker import Broker", ["mindstage.bridge.broker.Broker"]),
        ("from ..knowledge import KnowledgeBase", ["mindstage.knowledge.KnowledgeBase"]),
        ("def late():\n    import mujoco", ["mujoco"]),
        ("if TYPE_CHECKING:\n    import mujoco", ["mujoco"]),
        ("import_module('mindstage.simulation')", ["mindstage.simulation"]),
        ("importlib.import_module('mindstage.simulation')", ["mindstage.simulation"]),
    ],
)
def test_every_form_of_import_is_found(
    line: str, expected: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.modules[__name__], "ROOT", tmp_path)
    path = tmp_path / "src" / "mindstage" / "bridge" / "server.py"
    path.parent.mkdir(parents=True)
    path.write_text(line, encoding="utf-8")
    assert list(imported_names(path)) == expected


# -- modules -----------------------------------------------------------------------------------------------------------


def test_a_module_has_a_docstring() -> None:
    def check(path: Path) -> Iterator[str]:
        docstring = ast.get_docstring(syntax_tree(path))
        if not docstring:
            yield "no docstring"
        elif not docstring.splitlines()[0].endswith("."):
            yield "the first line is not a sentence"

    assert not problems(SOURCES, check)


def test_every_name_in_all_exists() -> None:
    def check(path: Path) -> Iterator[str]:
        module = importlib.import_module(module_name(path))
        names = getattr(module, "__all__", None)
        if names is None:
            yield "no __all__"
            return
        if len(set(names)) != len(names):
            yield "a name is twice in __all__"
        yield from (f"{name} is in __all__ but not defined" for name in names if not hasattr(module, name))

    assert not problems([path for path in SOURCES if path.name != "__main__.py"], check)


def documented_arguments(docstring: str) -> list[str]:
    """The names in the section "Args:" of a docstring in Google style."""
    section = re.search(r"^Args:\n((?: +.*\n|\n)*)", docstring + "\n", re.MULTILINE)
    return re.findall(r"^ {4}\*{0,2}(\w+)(?: \([^)]*\))?:", section[1], re.MULTILINE) if section else []


def parameters(node: ast.AST) -> set[str] | None:
    """The parameters of a function or of a class's constructor; None for other nodes."""
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
        args = node.args
        every = [*args.posonlyargs, *args.args, *args.kwonlyargs, args.vararg, args.kwarg]
        return {each.arg for each in every if each is not None}
    if isinstance(node, ast.ClassDef):
        for member in node.body:
            if isinstance(member, ast.FunctionDef) and member.name == "__init__":
                return parameters(member)
        return {
            each.target.id
            for each in node.body
            if isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name)
        }
    return None


def test_every_documented_argument_is_a_parameter() -> None:
    def check(path: Path) -> Iterator[str]:
        for node in ast.walk(syntax_tree(path)):
            if (names := parameters(node)) is not None:
                assert isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef)
                if wrong := set(documented_arguments(ast.get_docstring(node) or "")) - names:
                    yield f"the docstring of {node.name} describes {wrong}"

    assert not problems(SOURCES, check)


def test_a_wrong_name_in_the_package_is_an_attribute_error() -> None:
    package = importlib.import_module("mindstage")
    with pytest.raises(AttributeError, match="no attribute 'Simulatoin'"):
        package.Simulatoin  # noqa: B018


# -- errors ------------------------------------------------------------------------------------------------------------


def test_every_exception_class_ends_in_error() -> None:
    bases: dict[str, set[str]] = {}
    for path in SOURCES:
        for node in ast.walk(syntax_tree(path)):
            if isinstance(node, ast.ClassDef):
                bases.setdefault(node.name, set()).update(ast.unparse(base).split(".")[-1] for base in node.bases)
    exceptions = {
        name for name, value in vars(builtins).items() if inspect.isclass(value) and issubclass(value, Exception)
    }
    while found := {name for name, parents in bases.items() if parents & exceptions} - exceptions:
        exceptions |= found
    assert not {name for name in exceptions & bases.keys() if not name.endswith("Error")}


# -- imports and names -------------------------------------------------------------------------------------------------


@cache
def import_graph() -> dict[str, set[str]]:
    """The modules that each module imports."""
    modules = {module_name(path) for path in SOURCES}
    graph: dict[str, set[str]] = {}
    for path in SOURCES:
        targets = graph[module_name(path)] = set()
        for target in imported_names(path):
            # `from package import name` is an import of the package, unless the name is one of its modules.
            found = target if target in modules else target.rpartition(".")[0]
            if found in modules and found != module_name(path):
                targets.add(found)
    return graph


def circles(graph: dict[str, set[str]]) -> list[set[str]]:
    """The strongly connected components of more than one module."""
    reachable: dict[str, set[str]] = {}
    for start, targets in graph.items():
        seen: set[str] = set()
        waiting = list(targets)
        while waiting:
            if (node := waiting.pop()) not in seen:
                seen.add(node)
                waiting.extend(graph[node])
        reachable[start] = seen
    found: list[set[str]] = []
    for start, seen in reachable.items():
        if start in seen and not any(start in circle for circle in found):
            found.append({other for other in seen if start in reachable[other]})
    return found


def test_no_import_is_circular() -> None:
    assert not circles(import_graph())


def test_every_circle_of_a_graph_is_found() -> None:
    graph = {"a": {"b"}, "b": {"c"}, "c": {"a", "d"}, "d": set(), "e": {"a", "f"}, "f": {"e"}}
    assert circles(graph) == [{"a", "b", "c"}, {"e", "f"}]


def test_a_module_under_100_lines_has_several_importers() -> None:
    importers = Counter(target for targets in import_graph().values() for target in targets)
    named = {each.module for group in Group for each in extensions(group).values()}  # by entry points
    small = [
        shown(path)
        for path in SOURCES
        if path.name not in {"__init__.py", "__main__.py"}
        and path.parent.name != "_generated"
        and len(path.read_text(encoding="utf-8").splitlines()) < 100
        and importers[module_name(path)] == 1
        and module_name(path) not in named
    ]
    assert not small, "a module under 100 lines with one importer belongs into that importer"


def test_no_two_public_classes_share_a_name() -> None:
    modules: dict[str, list[str]] = {}
    for path in SOURCES:
        if path.is_relative_to(PACKAGE / "msgs"):
            continue  # ROS types have the names of their definitions; a package may use one of another's
        for node in syntax_tree(path).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                modules.setdefault(node.name, []).append(module_name(path))
    assert not {name: found for name, found in modules.items() if len(found) > 1}


# -- sizes and names ---------------------------------------------------------------------------------------------------


UNITS = "BYTES CM DEG EV FPS HZ KG L LM LX M M2 M3 MB MIB MM MS N NM NS PX RAD S STOPS"
DIMENSIONLESS = (
    "ATTEMPTS BASES BISECTIONS CANDIDATES CELLS CHARACTERS CHUNKS CODES COLOR COLORS CORNERS COSINE COST COUNT DEPTH "
    "DIGITS DIRECTIONS EDGES EPISODES EXPANSIONS FACES FACTOR FILES FINDINGS FRACTION FRACTIONS FRAMES GOALS GRASPS "
    "GROUP HEADINGS IDS ITERATIONS JOINTS LAMPS LINES NAMES OPACITY PAIRS PARTS PIXELS POINTS POSES PROBES "
    "RATIO REFINEMENTS REFUSALS REWARD SAMPLES SCALE SEGMENTS SHARE STEPS TAGS THREADS TRIALS VERSION WEIGHT WORDS "
    "WORLDS"
)
"""Words in the names of constants, which say that it is a count, a fraction or another number without a unit."""


def is_number(node: ast.expr) -> bool:
    match node:
        case ast.Constant(value=value):
            return isinstance(value, int | float) and not isinstance(value, bool)
        case ast.UnaryOp(operand=operand):
            return is_number(operand)
        case ast.BinOp(left=left, right=right):
            return is_number(left) and is_number(right)
        case ast.Tuple(elts=parts) | ast.List(elts=parts):
            return bool(parts) and all(map(is_number, parts))
    return False


def numeric_constants(node: ast.stmt) -> list[str]:
    """The constants with a numeric value that a statement assigns."""
    match node:
        case ast.Assign(targets=[ast.Tuple(elts=targets)], value=ast.Tuple(elts=values)):
            pairs = list(zip(targets, values, strict=False))
        case ast.Assign(targets=[target], value=value) | ast.AnnAssign(target=target, value=ast.expr() as value):
            pairs = [(target, value)]
        case _:
            return []
    names = [each.id for each, value in pairs if isinstance(each, ast.Name) and is_number(value)]
    return [name for name in names if name.strip("_").isupper()]


def constants_without_unit(body: list[ast.stmt]) -> Iterator[str]:
    """Constants that have neither a unit nor a dimensionless quantity in the name, nor a docstring.

    A docstring that begins with "These are" is that of all constants in the lines directly above it.
    """
    block: list[str] = []
    own = end = 0
    for node in body:
        names = numeric_constants(node)
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            yield from () if node.value.value.startswith("These are") else block[: len(block) - own]
            block = []
        elif not (names and node.lineno == end + 1):
            yield from block
            block = []
        block += names
        own, end = len(names), node.end_lineno or 0
        if isinstance(node, ast.ClassDef) and not any("Enum" in ast.unparse(base) for base in node.bases):
            yield from constants_without_unit(node.body)
    yield from block


def test_a_numeric_constant_has_a_unit_or_says_what_it_counts() -> None:
    def check(path: Path) -> Iterator[str]:
        for name in constants_without_unit(syntax_tree(path).body):
            if not {*UNITS.split(), *DIMENSIONLESS.split()} & {*name.strip("_").split("_")}:
                yield name

    assert not problems([path for path in SOURCES if path.parent.name != "_generated"], check)


def test_constants_without_a_unit_are_found() -> None:
    source = """
_SPEED = 2.0
_LENGTH_M = 2.0
_WEIGHTED = 3
\"\"\"A factor.\"\"\"


_ONE, _TWO = 1, 2
_THREE = 3
\"\"\"These are codes.\"\"\"
class Cup:
    HEIGHT = 0.1
class Code(IntEnum):
    FULL = 1
"""
    assert [*constants_without_unit(ast.parse(source).body)] == ["_SPEED", "_LENGTH_M", "HEIGHT"]


def test_a_function_fits_on_a_screen() -> None:
    def check(path: Path) -> Iterator[str]:
        for node in ast.walk(syntax_tree(path)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                documentation = ast.get_docstring(node, clean=False) or ""  # not counted
                lines = (node.end_lineno or node.lineno) - node.lineno + 1 - documentation.count("\n")
                if lines > 60:
                    yield f"{node.name} has {lines} lines"

    assert not problems(EVERYTHING, check)


def test_no_module_is_named_utils() -> None:
    assert not [shown(path) for path in EVERYTHING if path.stem in {"utils", "util", "helpers", "misc", "common"}]


def test_no_package_index_is_named() -> None:
    # The package source is configured by the person or machine that installs. The host names are joined here, so that
    # this file passes.
    hosts = re.compile(
        "|".join(re.escape(f"{name}.org") for name in ("py" + "pi", "files.python" + "hosted", "npm" + "js"))
    )
    documents = [*ROOT.glob("*.*"), *ROOT.glob("docs/**/*.md"), *ROOT.glob(".github/**/*")]
    texts = [*documents, *ROOT.glob("requirements/*"), *EVERYTHING, ROOT / "Makefile"]
    assert not [shown(path) for path in texts if path.is_file() and hosts.search(path.read_text(encoding="utf-8"))]


# -- one vocabulary ----------------------------------------------------------------------------------------------------

OLD_WORDS = frozenset(
    [
        "apart",
        "centre",
        "colour",
        "did",
        "forms",
        "glow",
        "glows",
        "holder",
        "lit",
        "not_lit",
        "plain_boxes",
        "plain_shapes",
        "said",
        "solids",
        "stance",
        "sunk",
        "told_by",
        "untold",
        "urdf_files",
        "viewport",
    ]
)
"""Words that have better ones: see `docs/migration.md`."""


def old_words(name: str) -> set[str]:
    """The old words in a name: the whole name, or a part of it between underscores or hyphens."""
    return {name, *re.split(r"[_-]", name)} & OLD_WORDS


def names_of_fields(tree: ast.Module) -> Iterator[tuple[str, int]]:
    """The fields of classes that are sent or stored, and renaming tables, which would give them other names in JSON."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef):
            yield from ((each.arg or "", node.lineno) for each in node.keywords if each.arg == "rename")
            for field in node.body:
                if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
                    yield field.target.id, field.lineno


def names_of_options(tree: ast.Module) -> Iterator[tuple[str, int]]:
    """The options of the command line."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and re.match(r"(?: /)?--[a-z]", node.value):
            yield from ((option, node.lineno) for option in re.findall(r"--([a-z-]+)", node.value.partition(" is ")[0]))


def vocabulary_problems(path: Path) -> Iterator[str]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    names = [*names_of_fields(tree), *(names_of_options(tree) if path.parent.name == "cli" else ())]
    for name, line in names:
        if name == "rename":
            yield f"line {line}: a field has the same name in Python and JSON; give it that name"
        for word in sorted(old_words(name)):
            yield f"line {line}: {name} has the old word {word}"


def test_fields_and_options_have_the_words_of_the_vocabulary() -> None:
    assert problems(SOURCES, vocabulary_problems) == []


def test_the_code_of_an_error_is_the_name_of_its_class() -> None:
    classes = [
        each for each in vars(errors).values() if inspect.isclass(each) and issubclass(each, errors.MindstageError)
    ]
    assert len(classes) > 60
    for cls in classes:
        assert "code" not in vars(cls) or cls is errors.MindstageError, cls
        assert cls.__new__(cls).code == cls.__name__


def test_fields_of_our_own_messages_have_the_words_of_the_vocabulary() -> None:
    definitions = (PACKAGE / "msgs" / "definitions" / "mindstage_msgs").rglob("*.*")
    fields = [
        f"{path.name}: {found[1]}"
        for path in definitions
        for found in re.finditer(r"^[\w/]+(?:\[\])?\s+(\w+)", path.read_text(encoding="utf-8"), re.M)
        if path.suffix in {".msg", ".srv", ".action"} and old_words(found[1])
    ]
    assert fields == []


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("class A:\n    colour: int", "colour has the old word colour"),
        ("class A:\n    with_viewport: bool", "with_viewport has the old word viewport"),
        ("class A(B, rename={'a': 'b'}):\n    a: int", "the same name in Python and JSON"),
        ("class A:\n    color: int", ""),
    ],
)
def test_old_words_in_names_are_noticed(text: str, expected: str, tmp_path: Path) -> None:
    (tmp_path / "one.py").write_text(text, encoding="utf-8")
    assert expected in "".join(vocabulary_problems(tmp_path / "one.py"))
    assert bool(expected) == bool(list(vocabulary_problems(tmp_path / "one.py")))
