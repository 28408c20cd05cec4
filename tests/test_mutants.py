"""Mutation testing: the list of survivors with reasons, and resuming a run that was interrupted."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest
from coverage import CoverageData
from scripts import mutants

SOURCE = '''"""Steps."""


def larger(a: int, b: int) -> int:
    """Returns the larger one."""
    return a if a > b else b


def names(count: int) -> list[str]:
    """Returns names."""
    found = []
    for number in range(count + 1):
        found.append("name" if number == 0 else "other")
    return found
'''
ENTRY = """
[[survivor]]
file = "core/steps.py"
before = "return a if a > b else b"
after = "return a if a >= b else b"
reason = "of two equal numbers it does not matter which one is returned"
"""


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package with two functions and a list with one survivor."""
    (tmp_path / "core").mkdir()
    (tmp_path / "core" / "steps.py").write_text(SOURCE, encoding="utf-8")
    (tmp_path / "listed.toml").write_text(ENTRY, encoding="utf-8")
    monkeypatch.setattr(mutants, "SOURCE", tmp_path)
    monkeypatch.setattr(mutants, "OUTPUT", tmp_path / "results")
    monkeypatch.setattr(mutants, "LISTED", tmp_path / "listed.toml")
    monkeypatch.setattr(mutants, "PACKAGES", {"core": ["core"], "other": ["other"]})
    monkeypatch.setattr(mutants, "TEST_FOLDERS", ["core", "cli"])
    recorded(tmp_path, "core", {})
    recorded(tmp_path, "cli", {})
    return tmp_path


def recorded(project: Path, folder: str, tests: dict[str, float]) -> CoverageData:
    """What a run of a folder's tests leaves: their durations, and the coverage, which is to be filled."""
    output = project / "results" / "coverage" / folder
    output.mkdir(parents=True, exist_ok=True)
    (output / "durations.json").write_text(json.dumps(tests), encoding="utf-8")
    return CoverageData(str(output / "coverage"))


class Runner:
    """Instead of tests: all mutants of the comparison survive; it is interrupted after some."""

    ran: list[mutants.Mutant]
    interrupted_after: int

    def __init__(self, selector: object, workers: int) -> None: ...

    def run(self, sample: Sequence[tuple[mutants.Mutant, str]]) -> Iterator[mutants.Result]:
        for number, (mutant, _) in enumerate(sample):
            if number == self.interrupted_after:
                raise KeyboardInterrupt
            self.ran.append(mutant)
            yield mutant, "survived" if "return a" in mutant.before else "killed"


@pytest.fixture
def runner(monkeypatch: pytest.MonkeyPatch) -> type[Runner]:
    Runner.ran, Runner.interrupted_after = [], 1000
    monkeypatch.setattr(mutants, "MutantRunner", Runner)
    monkeypatch.setattr(mutants, "TestSelector", lambda folders: None)
    return Runner


def comparison(after: str = "return a if a >= b else b") -> mutants.Mutant:
    return mutants.Mutant("core", "core/steps.py", 3, 6, (4, 6), "return a if a > b else b", after)


def test_a_listed_survivor_is_found_by_its_change_wherever_its_line_is(project: Path) -> None:
    listed = mutants.SurvivorList(project / "listed.toml")
    assert listed.reason(comparison()) == "of two equal numbers it does not matter which one is returned"
    assert listed.reason(comparison("return a if a < b else b")) is None
    assert list(listed.outdated([])) == []
    (project / "core" / "steps.py").write_text("import os\n\n" + SOURCE, encoding="utf-8")
    assert list(listed.outdated([])) == []


def test_an_entry_is_outdated_when_its_line_is_changed_or_a_test_fails(project: Path) -> None:
    listed = mutants.SurvivorList(project / "listed.toml")
    assert list(listed.outdated([(comparison(), "survived")])) == []
    for outcome in ("killed", "timeout"):
        (text,) = listed.outdated([(comparison(), outcome)])
        assert text == "core/steps.py: a test fails now with: return a if a >= b else b"
    (project / "core" / "steps.py").write_text(SOURCE.replace("a > b", "b < a"), encoding="utf-8")
    assert list(listed.outdated([])) == ["core/steps.py has no longer: return a if a > b else b"]
    (project / "core" / "steps.py").unlink()
    assert len(list(listed.outdated([]))) == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (ENTRY.replace("reason =", "because ="), "an entry needs file, before, after and reason"),
        (ENTRY.partition("reason")[0], "an entry needs file, before, after and reason"),
        (ENTRY.partition("reason")[0] + 'reason = ""', "an entry needs file, before, after and reason"),
        (ENTRY * 2, "core/steps.py is listed twice"),
    ],
)
def test_an_invalid_list_is_refused(project: Path, text: str, message: str) -> None:
    (project / "listed.toml").write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=message):
        mutants.SurvivorList(project / "listed.toml")


def test_the_list_of_this_project_is_valid() -> None:
    assert len(mutants.SurvivorList(mutants.LISTED)) > 10


def test_listed_survivors_are_reported_apart_from_new_ones(
    project: Path, runner: type[Runner], capsys: pytest.CaptureFixture[str]
) -> None:
    mutants.main(["--count", "100", "--keep-coverage"])
    survivors = (project / "results" / "survivors.txt").read_text(encoding="utf-8")
    new, listed = survivors.split("1 listed with a reason:")
    assert "of two equal numbers" in listed
    assert "+ return a if a >= b else b" in listed
    assert "+ return a if a >= b else b" not in new
    alive = [mutant for mutant in runner.ran if "return a" in mutant.before]
    assert new.startswith(f"{len(alive) - 1} new:")
    assert len(alive) > 1
    counts = [int(word) for word in capsys.readouterr().out.partition("\ncore")[2].split()[:4]]
    assert counts == [len(runner.ran), len(runner.ran) - len(alive), 1, len(alive) - 1]


def test_the_tests_of_a_mutant_execute_its_line_or_its_function_or_import_it(project: Path) -> None:
    one, two, other = "tests/core/test_a.py::test_one", "tests/core/test_a.py::test_two", "tests/cli/test_b.py::test_c"
    near, far = recorded(project, "core", {one: 0.2, two: 0.1}), recorded(project, "cli", {other: 0.0})
    executed = {"": [4, 6, 20], f"{one}|call": [6, 11], f"{other}|call": [6]}
    for context, lines in executed.items():
        data = far if context.startswith(other) else near
        data.set_context(context)
        data.add_lines({str(project / "core" / "steps.py"): lines})
    near.write()
    far.write()

    def selected(line: int, first: int, last: int, *folders: str) -> list[str]:
        mutant = mutants.Mutant("core", "core/steps.py", 0, line, (first, last), "a", "b")
        return mutants.TestSelector(folders or ["core", "cli"]).select(mutant)[0]

    assert selected(6, 4, 6) == [one, other], "nearest first"
    assert selected(12, 9, 14) == [one], "another line of the function"
    assert selected(20, 19, 21) == [two, one], "executed at import: the fastest first"
    assert selected(30, 29, 31) == []
    assert selected(6, 4, 6, "core") == [one], "only the folders that are asked for"


def test_the_nearest_tests_are_those_in_the_folders_of_the_packages(
    project: Path, runner: type[Runner], capsys: pytest.CaptureFixture[str]
) -> None:
    mutants.main(["--count", "5", "--keep-coverage", "--package", "core"])
    assert "tests of core, cli\n" in capsys.readouterr().out
    mutants.main(["--count", "5", "--keep-coverage", "--package", "core", "--nearest"])
    assert "tests of core\n" in capsys.readouterr().out


def test_a_sample_follows_from_the_hash_of_a_commit_or_from_a_number(
    project: Path, runner: type[Runner], capsys: pytest.CaptureFixture[str]
) -> None:
    def sampled(*options: str) -> list[mutants.Mutant]:
        runner.ran.clear()
        mutants.main(["--count", "5", "--keep-coverage", *options])
        return list(runner.ran)

    newest = sampled()
    (seed,) = re.findall(r"by the seed ([0-9a-f]{40});", capsys.readouterr().out)
    assert sampled("--seed", seed) == sampled("--seed", seed[:12]) == newest
    assert sampled("--seed", "7") == sampled("--seed", "7") != newest


def test_an_interrupted_run_is_resumed_after_the_last_result(project: Path, runner: type[Runner]) -> None:
    runner.interrupted_after = 4
    with pytest.raises(KeyboardInterrupt):
        mutants.main(["--count", "100", "--keep-coverage"])
    first = list(runner.ran)
    assert [mutant for mutant, _ in mutants.load_results()] == first
    runner.interrupted_after = 1000
    mutants.main(["--resume"])
    assert len(first) == 4
    assert len(set(runner.ran)) == len(runner.ran) > 8, "none is run twice"
    assert mutants.load_results() == [
        (mutant, "survived" if "return a" in mutant.before else "killed") for mutant in runner.ran
    ]


def test_a_new_run_does_not_continue_an_old_one_and_survivors_are_run_again(
    project: Path, runner: type[Runner]
) -> None:
    mutants.main(["--count", "100", "--keep-coverage"])
    count = len(runner.ran)
    runner.ran.clear()
    mutants.main(["--survivors", "--keep-coverage"])
    assert {mutant.before for mutant in runner.ran} == {"return a if a > b else b"}
    runner.interrupted_after = 0
    with pytest.raises(KeyboardInterrupt):
        mutants.main(["--count", "100", "--keep-coverage"])
    assert mutants.load_results() == []
    runner.ran.clear()
    runner.interrupted_after = 1000
    mutants.main(["--resume"])
    assert len(runner.ran) == count
