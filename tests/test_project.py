"""The structure of the source tree: packages, imports, public names, errors, sizes.

The order of the packages is read from the table in `docs/explanation/architecture.md`, so that document and code agree.
"""

from __future__ import annotations

import ast
import builtins
import importlib
import inspect
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

from mindstage import errors
from mindstage.knowledge.questions import Question
from mindstage.registry import Group, extensions
from mindstage.robots.skill_declaration import Skill

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
    rank: int
    """The place in the order of packages: they import only those of a lower rank."""
    libraries: frozenset[str]


@cache
def package_rows() -> dict[str, PackageRow]:
    text = (ROOT / "docs" / "explanation" / "architecture.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `([a-z0-9_/]+)` \|.*\|(.*)\|$", text, re.MULTILINE)
    return {
        name: PackageRow(rank, frozenset(re.findall(r"`([a-z_0-9]+)`", libraries)))
        for rank, (name, libraries) in enumerate(rows)
    }


def module_name(path: Path, root: Path = ROOT) -> str:
    parts = path.relative_to(root / "src").with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = frozenset(map(module_name, SOURCES))


@cache
def package_of(module: str) -> str | None:
    """The deepest package of the table that contains the module."""
    parts = module.split(".")[1:]
    for end in range(len(parts), 0, -1):
        if (name := "/".join(parts[:end])) in package_rows():
            return name
    return {"": "mindstage", "__main__": "cli"}.get(".".join(parts))


@cache
def syntax_tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def imported_names(path: Path, root: Path = ROOT) -> tuple[str, ...]:
    """The dotted names that a module imports: at its top, inside functions and for type checking alike."""
    here = module_name(path, root).split(".")
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
                level = len(name) - len(name.lstrip("."))
                found.append(".".join([*base[: len(base) - level + 1], name.lstrip(".")]) if level else name)
    return tuple(found)


def named_modules(path: Path, root: Path = ROOT) -> Iterator[str]:
    """The dotted names in the strings of a module, without its documentation; `{__name__}.x` in an f-string is one."""
    tree = syntax_tree(path)
    blocks = (node for node in ast.walk(tree) if isinstance(getattr(node, "body", None), list))
    documentation = {
        id(statement.value) for node in blocks for statement in node.body if isinstance(statement, ast.Expr)
    }
    for node in ast.walk(tree):
        match node:
            case ast.Constant(value=str(text)) if id(node) not in documentation:
                pass
            case ast.JoinedStr(
                values=[ast.FormattedValue(value=ast.Name(id="__name__")), ast.Constant(value=str(end))]
            ):
                text = module_name(path, root) + end
            case _:
                continue
        if re.fullmatch(r"mindstage(\.\w+)+(:\w+)?", text):
            yield text.replace(":", ".")


def module_of(name: str) -> str | None:
    """The module that a dotted name is in; None if it is in none of ours."""
    while name and name not in MODULES:
        name = name.rpartition(".")[0]
    return name or None


def upward_references(path: Path, root: Path = ROOT) -> Iterator[str]:
    """The modules of higher packages that a module imports, or names in a string."""
    own = package_of(module_name(path, root))
    assert own is not None, path
    strings = {name for name in named_modules(path, root) if module_of(name) != "mindstage"}  # such as a file's name
    if own == "registry":
        strings -= {"mindstage.engines", "mindstage.sensors"}  # groups of entry points
    for name in dict.fromkeys((*imported_names(path, root), *sorted(strings))):
        target = module_of(name)
        package = package_of(target) if target is not None else None
        if package is not None and package_rows()[package].rank > package_rows()[own].rank:
            yield f"{name} is in {package}, above {own}"


def test_imports_and_names_of_modules_lead_down_only() -> None:
    assert not problems(SOURCES, upward_references)


def test_a_package_shows_no_names_of_higher_packages() -> None:
    def check(path: Path) -> Iterator[str]:
        module = importlib.import_module(module_name(path))
        for name in getattr(module, "__all__", ()):
            value = getattr(module, name)
            defined = value.__name__ if inspect.ismodule(value) else getattr(value, "__module__", None) or ""
            package, own = package_of(defined) if module_of(defined) else None, package_of(module.__name__)
            if package and own and package_rows()[package].rank > package_rows()[own].rank:
                yield f"shows {name}, which {defined} defines"

    assert not problems((path for path in SOURCES if path.name == "__init__.py"), check)


@pytest.mark.parametrize(
    "line",
    [
        "import mindstage.simulation",
        "from mindstage import simulation",
        "from mindstage.simulation.simulation import Simulation",
        "from .. import simulation",
        "from ..simulation import Simulation",
        "def late():\n    from mindstage.simulation import Simulation",
        "if TYPE_CHECKING:\n    from mindstage.simulation import Simulation",
        "import_module('mindstage.simulation')",
        "importlib.import_module('..simulation', __package__)",
        "MODULES = ['mindstage.simulation.simulation']",
        "ENTRY_POINT = 'mindstage.simulation:Simulation'",
        "lazy_names(__name__, {'Simulation': 'mindstage.simulation'})",
        "lazy_names(__name__, [f'{__name__}.queries.storage'])",
    ],
)
def test_every_kind_of_reference_to_a_higher_package_is_found(line: str, tmp_path: Path) -> None:
    package = tmp_path / "src" / "mindstage" / "knowledge"
    package.mkdir(parents=True)
    for name in ("__init__.py",) if "__name__" in line else ("__init__.py", "store.py"):
        path = package / name
        path.write_text(f'"""Documentation may name `mindstage.simulation`."""\n\n{line}\n', encoding="utf-8")
        assert len([*upward_references(path, tmp_path)]) == 1, name


@pytest.mark.parametrize(
    "line",
    [
        "from mindstage.rdf.graphs import Graph",
        "from mindstage import rdf",
        "from . import store",
        "import_module('mindstage.maps.io.files')",
        "FILE = 'mindstage.json'",
        "IRI = 'http://mindstage.simulation.org/'",
        "class Documented:\n    field = 1\n    'mindstage.simulation'",
    ],
)
def test_other_references_are_allowed(line: str, tmp_path: Path) -> None:
    path = tmp_path / "src" / "mindstage" / "knowledge" / "store.py"
    path.parent.mkdir(parents=True)
    path.write_text(line, encoding="utf-8")
    assert not [*upward_references(path, tmp_path)]


def test_a_library_is_imported_in_its_packages_only() -> None:
    owners: dict[str, tuple[str, ...]] = {}
    for package, row in package_rows().items():
        for library in row.libraries:
            owners[library] = (*owners.get(library, ()), f"{package}/")

    def check(path: Path) -> Iterator[str]:
        own = package_of(module_name(path)) or ""
        for target in imported_names(path):
            if not f"{own}/".startswith(owners.get(target.split(".")[0], own)):
                yield f"imports {target}, a library of {owners[target.split('.')[0]]}"

    assert not problems(SOURCES, check)


def test_every_folder_and_every_module_beside_them_is_a_row_of_the_table() -> None:
    folders = {path.parent.relative_to(PACKAGE).as_posix() for path in SOURCES} - {"."}
    modules = {path.stem for path in PACKAGE.glob("*.py")} - {"__init__", "__main__"}
    assert {*folders, *modules, "mindstage"} == package_rows().keys()


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


def test_every_entry_point_names_something_under_its_own_name() -> None:
    found = [(each, each.load(object)) for group in Group for each in extensions(group).values()]
    declared = [
        (each.name, value.spec.name if isinstance(value, Skill) else value.name)
        for each, value in found
        if isinstance(value, Skill | Question)
    ]
    assert declared
    assert [pair for pair in declared if pair[0] != pair[1]] == []


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
