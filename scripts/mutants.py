"""Mutation testing: changes one expression at a time and checks that a test fails (`make mutants`).

1. The tests of each folder run once with coverage, which records for each line the tests that execute it, and their
   durations. With `--nearest` these are only the folders in `tests` of the chosen packages.
2. A random sample of mutants is drawn, with the operators of mutmut, a negated `if`, and no prose: a string is mutated
   only if it is one word (a key, a name, an enumeration's value), since tests do not repeat sentences.
3. Each mutant runs the fastest tests of its line in a forked process, in a copy of `src`, until one fails.

A mutant is killed by a failed test, an error, or a time limit. The score is killed / all; a line without tests counts
as survived. tests/mutants.toml lists survivors with the reason why no test is missing (mostly: the changed program
behaves the same); they are reported apart from new ones.

The sample follows from its seed (by default the hash of the commit), its size, and the packages; to repeat it later,
give `--seed` the name or hash of that commit. Results are in build/mutants: results.json, which is complete after each
mutant, so that `--resume` continues a run that was interrupted with the same sample; sample.json, which describes the
sample; and survivors.txt with the changed line of each survivor.
"""

from __future__ import annotations

import argparse
import contextlib
import difflib
import json
import multiprocessing
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from queue import Queue
from typing import NamedTuple

import coverage
import libcst as cst
import pytest
from libcst.metadata import MetadataWrapper, PositionProvider
from mutmut.mutation.mutators import mutation_operators

__all__ = ["ListedSurvivor", "Mutant", "SurvivorList", "main"]

ROOT = Path(__file__).resolve().parent.parent
SOURCE = ROOT / "src" / "mindstage"
OUTPUT = ROOT / "build" / "mutants"
LISTED = ROOT / "tests" / "mutants.toml"
PACKAGES = {
    "scene": ["scene"],
    "engines": ["engines/*.py", "engines/mujoco"],
    "maps": ["rdf", "maps"],
    "reasoner and questions": ["knowledge/*.py", "knowledge/queries"],
    "protocol": ["bridge", "msgs/*.py"],
    "access": ["access"],
    "geometry and assets": ["geometry/*.py", "assets"],
    "imagination": ["imagination"],
    "episodes": ["episodes"],
    "robots": ["robots"],
    "rendering": ["rendering"],
    "viewer": ["viewer"],
    "ros": ["ros"],
    "prolog": ["prolog"],
    "simulation": ["simulation"],
}
"""What is mutated by name, as folders or patterns below `SOURCE`."""
TEST_FOLDERS = [
    *("scene", "engines", "rdf", "maps", "knowledge", "bridge", "msgs", "access", "geometry", "assets"),
    *("imagination", "episodes", "robots", "rendering", "viewer", "ros", "prolog", "simulation", "cli"),
]
EXCLUDED_FILES = ["__init__.py", "godot.py", "godot_process.py"]
"""Godot's files: their tests take seconds each."""
SLOW_TESTS = ["godot", "chromium", "browser", "page_tab", "fuzz_files", "fuzz_structure", "test_shot", "roslibjs"]
"""Words of test ids that are not run: they need other programs and take seconds each."""
BUDGET_S = 30.0
"""Maximum total duration of the tests of one mutant [s], as measured without coverage's cost."""
WORD = re.compile(r"[A-Za-z][\w:/.#-]*")
PLAIN_TEST_ID = re.compile(r"[\w./:-]+(\[[\w.-]+\])?")
"""Ids that pytest accepts as arguments; others name all parameters of their test."""
PRELOADED = ["pytest", "hypothesis", "numpy", "scipy.spatial", "mujoco", "pyoxigraph", "trimesh", "msgspec", "typer"]
"""Libraries that every run uses, imported once."""


Change = tuple[str, str, str]
"""A file, its text before, and the text after a mutation."""
Result = tuple["Mutant", str]
"""A mutant and its outcome: killed, survived, timeout (killed) or untested."""


@dataclass(frozen=True)
class Mutant:
    """One changed expression."""

    package: str
    file: str
    """Path below src/mindstage."""
    number: int
    """Index among the mutants of the file."""
    line: int
    function: tuple[int, int]
    """First and last line of the function."""
    before: str
    after: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line} #{self.number}\n    - {self.before}\n    + {self.after}"

    @property
    def change(self) -> Change:
        """What identifies it after lines above it were added or removed."""
        return self.file, self.before, self.after


class Mutation(NamedTuple):
    """An expression and what replaces it."""

    original: cst.CSTNode
    changed: cst.CSTNode
    line: int
    function: tuple[int, int]


class MutationVisitor(cst.CSTVisitor):
    """Collects the possible mutations inside of functions; prose, annotations and decorators stay."""

    METADATA_DEPENDENCIES = (PositionProvider,)

    def __init__(self) -> None:
        self.mutations: list[Mutation] = []
        self._functions: list[tuple[int, int]] = []

    def on_visit(self, node: cst.CSTNode) -> bool:
        if isinstance(node, cst.Annotation | cst.Decorator | cst.FormattedString | cst.Assert | cst.Raise):
            return False
        if isinstance(node, cst.FunctionDef):
            position = self.get_metadata(PositionProvider, node)
            self._functions.append((position.start.line, position.end.line))
        elif self._functions:
            line = self.get_metadata(PositionProvider, node).start.line
            self.mutations += [Mutation(node, new, line, self._functions[-1]) for new in _replacements(node)]
        return True

    def on_leave(self, original_node: cst.CSTNode) -> None:
        if isinstance(original_node, cst.FunctionDef):
            self._functions.pop()


def _replacements(node: cst.CSTNode) -> Iterator[cst.CSTNode]:
    if isinstance(node, cst.If) and not isinstance(node.test, cst.Comparison | cst.BooleanOperation):
        yield node.with_changes(test=_negated(node.test))
    for kind, operator in mutation_operators:
        if not isinstance(node, kind):
            continue
        if kind is not cst.BaseString:
            yield from operator(node)
        elif isinstance(node, cst.SimpleString) and WORD.fullmatch(str(node.evaluated_value)):
            yield node.with_changes(value=f'"XX{node.evaluated_value}"')


def _negated(test: cst.BaseExpression) -> cst.BaseExpression:
    if isinstance(test, cst.UnaryOperation) and isinstance(test.operator, cst.Not):
        return test.expression
    parenthesized = test.with_changes(lpar=[cst.LeftParen()], rpar=[cst.RightParen()])
    return cst.UnaryOperation(operator=cst.Not(), expression=parenthesized)


@dataclass(frozen=True)
class SampleDescription:
    """What a sample follows from, apart from the source."""

    seed: str
    count: int
    packages: list[str]


def commit_hash(name: str) -> str:
    """Returns the hash of a commit, or the text itself if it is a number or there is no commit of this name."""
    if name.isdigit():
        return name
    command = ["git", "rev-parse", "--verify", "--quiet", f"{name}^{{commit}}"]
    found = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    return found.stdout.strip() or name


def draw_sample(count: int, seed: str, packages: Sequence[str]) -> list[tuple[Mutant, str]]:
    """Draws mutants and their source texts: files by their size, then mutations of each, none twice.

    Their order is random, so that the first results are a sample as well.
    """
    chooser = random.Random(seed)
    files = [(name, path) for name in packages for path in _files_of(PACKAGES[name])]
    wanted = Counter(chooser.choices(files, weights=[path.stat().st_size for _, path in files], k=count))
    sample = [
        pair
        for (name, path), number in sorted(wanted.items(), key=lambda item: str(item[0][1]))
        for pair in _draw_from_file(name, path, number, chooser)
    ]
    chooser.shuffle(sample)
    return sample


def _files_of(patterns: Iterable[str]) -> Iterator[Path]:
    for pattern in patterns:
        folder = SOURCE / pattern
        found = sorted(folder.rglob("*.py")) if folder.is_dir() else sorted(SOURCE.glob(pattern))
        yield from (path for path in found if path.name not in EXCLUDED_FILES)


def _draw_from_file(package: str, path: Path, count: int, chooser: random.Random) -> Iterator[tuple[Mutant, str]]:
    text = path.read_text(encoding="utf-8")
    wrapper = MetadataWrapper(cst.parse_module(text))
    visitor = MutationVisitor()
    wrapper.visit(visitor)
    numbers = list(range(len(visitor.mutations)))
    chooser.shuffle(numbers)
    for number in numbers:
        if count == 0:
            return
        mutation = visitor.mutations[number]
        mutated = wrapper.module.deep_replace(mutation.original, mutation.changed).code
        try:
            compile(mutated, str(path), "exec")
        except SyntaxError:
            continue
        count -= 1
        rows = list(difflib.unified_diff(text.splitlines(), mutated.splitlines(), n=0, lineterm=""))[3:]
        before = " ".join(row[1:].strip() for row in rows if row.startswith("-"))
        after = " ".join(row[1:].strip() for row in rows if row.startswith("+")) or "(removed)"
        place = str(path.relative_to(SOURCE))
        yield Mutant(package, place, number, mutation.line, mutation.function, before[:200], after[:200]), mutated


class CoverageRecorder:
    """A pytest plugin that attributes the executed lines to tests, and records how long each test takes."""

    def __init__(self, measurement: coverage.Coverage) -> None:
        self.durations: dict[str, float] = defaultdict(float)
        """Duration of each passed test with its fixtures [s], by node id."""
        self._measurement = measurement

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_setup(self, item: pytest.Item) -> Iterator[None]:
        self._measurement.switch_context(f"{item.nodeid}|setup")
        return (yield)  # type: ignore[return-value]

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Iterator[None]:
        self._measurement.switch_context(f"{item.nodeid}|call")
        return (yield)  # type: ignore[return-value]

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        items[:] = [item for item in items if not any(word in _described(item) for word in SLOW_TESTS)]

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.durations[report.nodeid] += report.duration
        if not report.passed:
            self.durations[report.nodeid] = float("inf")  # skipped or failed: cannot kill a mutant


def _described(item: pytest.Item) -> str:
    return " ".join((item.nodeid, *getattr(item, "fixturenames", ())))


def record_coverage(folder: str) -> None:
    """Runs the tests of a folder with coverage, in this process."""
    output = OUTPUT / "coverage" / folder
    output.mkdir(parents=True, exist_ok=True)
    measurement = coverage.Coverage(data_file=str(output / "coverage"), source=[str(SOURCE)], config_file=False)
    measurement.erase()
    recorder = CoverageRecorder(measurement)
    measurement.start()
    pytest.main(["-q", "-p", "no:cacheprovider", "--tb=short", str(ROOT / "tests" / folder)], plugins=[recorder])
    measurement.stop()
    measurement.save()
    durations = {test: seconds for test, seconds in recorder.durations.items() if seconds != float("inf")}
    (output / "durations.json").write_text(json.dumps(durations), encoding="utf-8")


def test_folders(packages: Sequence[str], *, nearest: bool) -> list[str]:
    """Returns the folders whose tests run: all, or those of the packages."""
    own = {pattern.partition("/")[0] for name in packages for pattern in PACKAGES[name]}
    return [folder for folder in TEST_FOLDERS if folder in own or not nearest]


class TestSelector:
    """Selects the tests of a mutant from the recorded coverage."""

    def __init__(self, folders: Iterable[str]) -> None:
        """Reads what was recorded of the tests in some folders."""
        self._durations: dict[str, float] = {}
        self._data = []
        for folder in folders:
            recorded = OUTPUT / "coverage" / folder
            self._durations |= json.loads((recorded / "durations.json").read_text(encoding="utf-8"))
            self._data.append(coverage.CoverageData(str(recorded / "coverage")))
            self._data[-1].read()
        self._by_file: dict[str, list[str]] = defaultdict(list)
        for test in self._durations:
            self._by_file[test.partition("::")[0]].append(test)
        self._contexts: dict[str, dict[int, list[str]]] = {}

    def select(self, mutant: Mutant) -> tuple[list[str], float]:
        """Returns the ids of tests that execute the mutated line, nearest and fastest first, and their duration [s]."""
        contexts = self._contexts_of(mutant.file)
        first, last = mutant.function
        found = self._tests_of(contexts.get(mutant.line, ()))
        near = f"tests/{mutant.file.partition('/')[0]}/"
        if not found:  # a continued line
            in_function = {context for line in range(first, last + 1) for context in contexts.get(line, ())}
            found = self._tests_of(in_function)
            if not found and in_function:  # executed at import, so any test that imports the module may fail
                found = {test for test in self._durations if test.startswith(near)}
        ordered = sorted(found, key=lambda test: (not test.startswith(near), self._durations[test]))
        selected: dict[str, None] = {}
        total = 0.0
        for test in ordered:
            total += self._durations[test]
            if total > BUDGET_S and selected:
                break
            selected[test if PLAIN_TEST_ID.fullmatch(test) else test.partition("[")[0]] = None
        return list(selected), min(total, BUDGET_S)

    def _contexts_of(self, file: str) -> dict[int, list[str]]:
        if file not in self._contexts:
            contexts: dict[int, list[str]] = defaultdict(list)
            for data in self._data:
                for line, found in data.contexts_by_lineno(str(SOURCE / file)).items():
                    contexts[line] += found
            self._contexts[file] = contexts
        return self._contexts[file]

    def _tests_of(self, contexts: Iterable[str]) -> set[str]:
        tests = set()
        for context in contexts:
            test, _, phase = context.partition("|")
            # A shared fixture runs in the setup of its first test only, but all tests of the file may depend on it.
            tests |= set(self._by_file[test.partition("::")[0]]) if phase == "setup" else {test}
        return tests & self._durations.keys()


def run_mutant(tree: Path, tests: Sequence[str], log: Path) -> None:
    """Runs tests on a copy of the source, in a process of its own; exits with pytest's code."""
    os.setsid()
    for descriptor in (1, 2):
        os.dup2(os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), descriptor)
    os.chdir(ROOT)
    os.environ["PYTHONPATH"] = f"{tree}{os.pathsep}{ROOT}"
    sys.path[:0] = [str(tree), str(ROOT)]
    sys.exit(pytest.main(["-x", "-q", "-p", "no:cacheprovider", "--tb=line", *tests]))


class MutantRunner:
    """Runs mutants on several copies of the source at once."""

    def __init__(self, selector: TestSelector, workers: int) -> None:
        self._selector = selector
        self._workers = workers
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload(PRELOADED)
        self._trees: Queue[Path] = Queue()
        for number in range(workers):
            tree = OUTPUT / f"tree-{number}"
            shutil.rmtree(tree, ignore_errors=True)
            shutil.copytree(SOURCE, tree / "mindstage", ignore=shutil.ignore_patterns("__pycache__"))
            self._trees.put(tree)

    def run(self, sample: Sequence[tuple[Mutant, str]]) -> Iterator[Result]:
        """Yields each mutant with its outcome."""
        with ThreadPoolExecutor(self._workers) as pool:
            for number, (mutant, outcome) in enumerate(pool.map(self._run_one, sample), 1):
                print(f"{number:4}/{len(sample)} {outcome:9} {mutant.file}:{mutant.line}", flush=True)
                yield mutant, outcome

    def _run_one(self, pair: tuple[Mutant, str]) -> tuple[Mutant, str]:
        mutant, text = pair
        tests, duration = self._selector.select(mutant)
        if not tests:
            return mutant, "untested"
        tree = self._trees.get()
        file = tree / "mindstage" / mutant.file
        compiled = file.parent / "__pycache__" / f"{file.stem}.{sys.implementation.cache_tag}.pyc"
        original = file.read_text(encoding="utf-8")
        try:
            compiled.unlink(missing_ok=True)  # its time stamp may equal that of the mutated file
            file.write_text(text, encoding="utf-8")
            return mutant, self._outcome(tree, tests, 40.0 + 4.0 * duration)
        finally:
            file.write_text(original, encoding="utf-8")
            compiled.unlink(missing_ok=True)
            self._trees.put(tree)

    def _outcome(self, tree: Path, tests: Sequence[str], limit_s: float) -> str:
        process = self._context.Process(target=run_mutant, args=(tree, tests, tree / "log.txt"))
        process.start()
        process.join(limit_s)
        code = process.exitcode
        if process.pid is not None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)  # also what its tests started
        process.join()
        return "timeout" if code is None else "survived" if code == 0 else "killed"


@dataclass(frozen=True)
class ListedSurvivor:
    """A mutant that no test needs to kill."""

    file: str
    """Path below src/mindstage."""
    before: str
    after: str
    reason: str

    @property
    def change(self) -> Change:
        """As of a mutant."""
        return self.file, self.before, self.after

    @property
    def still_exists(self) -> bool:
        """Whether its file has the line or lines that it changes."""
        try:
            lines = (SOURCE / self.file).read_text(encoding="utf-8").splitlines()
        except FileNotFoundError:
            return False
        return self.before in " ".join(line.strip() for line in lines)


class SurvivorList:
    """The mutants that may survive, with reasons."""

    def __init__(self, path: Path) -> None:
        """Reads the list: tables `[[survivor]]` with the strings `file`, `before`, `after` and `reason`.

        Raises:
            ValueError: an entry has other fields, an empty one, or is there twice.
        """
        self._by_change: dict[Change, ListedSurvivor] = {}
        for row in tomllib.loads(path.read_text(encoding="utf-8")).get("survivor", []):
            if set(row) != {"file", "before", "after", "reason"} or not all(row.values()):
                raise ValueError(f"{path.name}: an entry needs file, before, after and reason: {row}")
            entry = ListedSurvivor(**row)
            if entry.change in self._by_change:
                raise ValueError(f"{path.name}: {entry.file} is listed twice with {entry.before!r}")
            self._by_change[entry.change] = entry

    def __len__(self) -> int:
        return len(self._by_change)

    def reason(self, mutant: Mutant) -> str | None:
        """Returns why a mutant may survive; None if it is not listed."""
        entry = self._by_change.get(mutant.change)
        return None if entry is None else entry.reason

    def outdated(self, results: Iterable[Result]) -> Iterator[str]:
        """Yields what is to be removed: entries whose line no longer exists, or that a test kills."""
        killed = {mutant.change for mutant, outcome in results if _is_killed(outcome)}
        for entry in self._by_change.values():
            if not entry.still_exists:
                yield f"{entry.file} has no longer: {entry.before}"
            elif entry.change in killed:
                yield f"{entry.file}: a test fails now with: {entry.after}"


def _is_killed(outcome: str) -> bool:
    return outcome in ("killed", "timeout")


def save_results(results: Iterable[Result]) -> None:
    """Writes results.json at once, so that it is complete whenever the run is interrupted."""
    rows = [asdict(mutant) | {"outcome": outcome} for mutant, outcome in results]
    partial = OUTPUT / "results.json.part"
    partial.write_text(json.dumps(rows, indent=1), encoding="utf-8")
    partial.replace(OUTPUT / "results.json")


def load_results() -> list[Result]:
    """Reads results.json; empty if there is none."""
    try:
        rows = json.loads((OUTPUT / "results.json").read_text(encoding="utf-8"))
    except FileNotFoundError:
        return []
    results = []
    for row in rows:
        outcome, function = row.pop("outcome"), tuple(row.pop("function"))
        results.append((Mutant(**row, function=function), outcome))
    return results


def load_description(default: SampleDescription) -> SampleDescription:
    """Reads sample.json; the default if there is none."""
    try:
        return SampleDescription(**json.loads((OUTPUT / "sample.json").read_text(encoding="utf-8")))
    except FileNotFoundError:
        return default


def report(results: Sequence[Result], listed: SurvivorList) -> None:
    """Writes the survivors and prints the score by package."""
    alive = [(mutant, outcome) for mutant, outcome in results if not _is_killed(outcome)]
    new = [f"{outcome} {mutant}" for mutant, outcome in alive if listed.reason(mutant) is None]
    known = [f"{outcome} {mutant}\n    {reason}" for mutant, outcome in alive if (reason := listed.reason(mutant))]
    text = "\n".join([f"{len(new)} new:", *new, "", f"{len(known)} listed with a reason:", *known])
    (OUTPUT / "survivors.txt").write_text(text + "\n", encoding="utf-8")
    print(f"\n{'package':24}{'mutants':>8}{'killed':>8}{'listed':>8}{'new':>6}{'score':>7}")
    for name in (*PACKAGES, None):
        rows = [(mutant, outcome) for mutant, outcome in results if name in (None, mutant.package)]
        if rows:
            killed = sum(_is_killed(outcome) for _, outcome in rows)
            reasons = sum(listed.reason(mutant) is not None for mutant, outcome in rows if not _is_killed(outcome))
            unlisted = len(rows) - killed - reasons
            print(f"{name or 'all':24}{len(rows):8}{killed:8}{reasons:8}{unlisted:6}{killed / len(rows):7.0%}")
    for entry in listed.outdated(results):
        print(f"remove from {LISTED.name}: {entry}")


def main(arguments: Sequence[str] | None = None) -> None:
    """Draws a sample, runs it, and prints the score."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=400, help="number of mutants")
    parser.add_argument("--seed", default="HEAD", help="a number, or a commit, whose hash it is (default: HEAD)")
    parser.add_argument("--package", action="extend", nargs="+", choices=list(PACKAGES), help="only these parts")
    parser.add_argument("--nearest", action="store_true", help="run only the tests in the folders of these parts")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--keep-coverage", action="store_true", help="reuse the recorded coverage")
    again = parser.add_mutually_exclusive_group()
    again.add_argument("--survivors", action="store_true", help="run the survivors of the last results again")
    again.add_argument("--resume", action="store_true", help="continue an interrupted run with its sample")
    parser.add_argument("--record", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.record:
        record_coverage(options.record)
        return
    begin = time.monotonic()
    listed = SurvivorList(LISTED)
    description = SampleDescription(commit_hash(options.seed), options.count, options.package or list(PACKAGES))
    if options.resume or options.survivors:
        description = load_description(description)
    sample = draw_sample(description.count, description.seed, description.packages)
    results: list[Result] = []
    if options.resume:
        before = dict(load_results())
        results = [(mutant, before[mutant]) for mutant, _ in sample if mutant in before]
    elif options.survivors:
        dead = {mutant.change: outcome for mutant, outcome in load_results() if _is_killed(outcome)}
        results = [(mutant, dead[mutant.change]) for mutant, _ in sample if mutant.change in dead]
    done = {mutant for mutant, _ in results}
    sample = [pair for pair in sample if pair[0] not in done]
    OUTPUT.mkdir(parents=True, exist_ok=True)
    save_results(results)  # those of an earlier run are not continued
    (OUTPUT / "sample.json").write_text(json.dumps(asdict(description)), encoding="utf-8")
    folders = test_folders(description.packages, nearest=options.nearest)
    for folder in folders:
        recorded = OUTPUT / "coverage" / folder / "durations.json"
        if recorded.exists() and (options.keep_coverage or options.resume):
            continue
        recorded.unlink(missing_ok=True)
        subprocess.run([sys.executable, __file__, "--record", folder], check=True, cwd=ROOT)
    if sample:
        for result in MutantRunner(TestSelector(folders), options.workers).run(sample):
            results.append(result)
            save_results(results)
    report(results, listed)
    print(f"{description.count} mutants by the seed {description.seed}; tests of {', '.join(folders)}")
    print(f"{time.monotonic() - begin:.0f} s; survivors are listed in {OUTPUT / 'survivors.txt'}")


if __name__ == "__main__":
    main()
