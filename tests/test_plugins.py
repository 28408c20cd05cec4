"""Plug-ins: the example is built, installed and used; one that cannot be imported, and one without access classes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parent.parent
SHY = '''
from collections.abc import Iterator

from mindstage.knowledge.questions import AnswerRow, IndividualName, QuestionContext, question
from mindstage.robots.skill_declaration import SkillMotion, skill
from mindstage.robots.skill_task import SkillTask
from mindstage.scene import Iri


class Secret(AnswerRow, frozen=True, kw_only=True):
    """A secret."""

    thing: IndividualName


@question(sentences=("what is secret of {thing}",))
def secret(kb: QuestionContext, thing: IndividualName | None = None) -> Iterator[Secret]:
    """The secret of a thing."""
    yield Secret(thing=thing or Iri("urn:secret"))


@skill(needs=())
def salute(task: SkillTask) -> SkillMotion:
    """Does nothing."""
    yield 0.1
'''


def add_distribution(site: Path, name: str, source: str, entry_points: dict[str, str]) -> None:
    """Writes a package as it is when it is installed."""
    site.joinpath(f"{name}.py").write_text(source, encoding="utf-8")
    info = site / f"{name}-1.0.dist-info"
    info.mkdir(parents=True)
    info.joinpath("METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n", encoding="utf-8")
    lines = (f"[mindstage.{group}]\n{line}\n" for group, line in entry_points.items())
    info.joinpath("entry_points.txt").write_text("".join(lines), encoding="utf-8")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the plug-in, installed by pip without the network, and two others."""
    site = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation", "--no-index"]
    plugin = ROOT / "examples" / "plugin"
    subprocess.run([*command, "--target", str(site), str(plugin)], check=True, capture_output=True)
    add_distribution(
        site,
        "broken",
        "raise ImportError('a library is missing')\n",
        {"questions": "broken_question = broken:question [read]", "verbs": "fix = broken:fix [read]"},
    )
    add_distribution(site, "shy", SHY, {"questions": "secret = shy:secret", "skills": "salute = shy:salute"})
    return site


@pytest.fixture(scope="module")
def environment(site: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    cache = tmp_path_factory.mktemp("cache")
    path = os.pathsep.join([str(ROOT / "src"), str(site), str(ROOT)])
    return {**os.environ, "PYTHONPATH": path, "MINDSTAGE_CACHE": str(cache)}


@pytest.fixture(scope="module")
def used(environment: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What using everything gives."""
    command = [sys.executable, "-m", "tests.plugin_program", str(tmp_path_factory.mktemp("files"))]
    run = subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    found: dict[str, Any] = json.loads(run.stdout)
    return found | {"log": run.stderr}


def test_each_of_the_seven_is_used_from_python(used: dict[str, Any]) -> None:
    local = used["local"]
    assert local["asked"] == local["sentence"] == [7]
    assert local["waved"] == ["succeeded", ["wave"] * 4]
    assert local["measured"] == {}, "nothing is held"
    assert local["notes"] == ["the list has no sizes"]
    assert local["distance"] == 0.1, "the engine has moved the carton, which was read from a file of the format"
    assert local["carton"] == [[1.0, 2.0, 0.5], "http://knowrob.org/kb/knowrob.owl#CowsMilk"]
    assert local["names"] == ["secret", "shelf_life"]


def test_what_is_offered_is_used_over_the_page(used: dict[str, Any]) -> None:
    page = used["page"]
    assert "shelf_life" in page["offered"]
    assert page["rows"]
    assert page["understood"]
    assert "wave" in page["skills"]
    assert page["measured"] == {}
    assert {"name": "stock", "title": "Stock list"} in page["formats"]
    assert page["saved"][0].endswith(".stock")
    assert page["dialect"] == [1, [1.0, 2.0, 0.5]]
    assert page["format"] == ["one", 1]


def test_what_is_offered_has_a_service_or_an_action_of_ros(used: dict[str, Any]) -> None:
    assert used["ros"]["services"] == ["/mindstage/shelf_life"]
    assert [name.rpartition("/")[2] for name in used["ros"]["actions"]] == ["wave"]


def test_what_declares_no_access_class_is_not_offered_to_clients(used: dict[str, Any]) -> None:
    page = used["page"]
    assert used["local"]["secret"] == ["urn:secret"], "it is there for Python"
    assert "secret" not in page["offered"]
    assert "no question 'secret'" in page["secret"]
    assert "not understood" in page["secret sentence"] or "no question" in page["secret sentence"]
    assert "salute" not in page["skills"]


def test_what_cannot_be_imported_is_a_problem_that_stops_nothing(used: dict[str, Any]) -> None:
    text = "broken_question, an entry point mindstage.questions of broken, cannot be loaded: ImportError"
    assert text in used["local"]["broken"]
    assert [each for each in used["problems"] if each.startswith(text)]
    assert used["log"].count(text) == 1, "it is logged once"


def mindstage(environment: dict[str, str], *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "mindstage", *arguments]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


def test_a_verb_is_a_verb_of_the_command_line(environment: dict[str, str]) -> None:
    run = mindstage(environment, "stock", "bundled:kitchen")
    assert run.returncode == 0, run.stderr
    assert "6 Tumbler\n" in run.stdout
    help = mindstage(environment, "--help")
    assert help.returncode == 0, "although a package has a verb that cannot be imported"
    assert "Count the things of a map by class." in help.stdout
    broken = mindstage(environment, "fix")
    assert broken.returncode == 2
    assert broken.stderr.startswith("mindstage: error: fix, an entry point mindstage.verbs of broken, cannot be loaded")


def test_plugins_lists_what_packages_add_and_their_problems(environment: dict[str, str]) -> None:
    run = mindstage(environment, "plugins", "--json")
    assert run.returncode == 1
    found = json.loads(run.stdout)
    listed = {(each["name"], each["group"].rpartition(".")[2]): each for each in found["plugins"]}
    assert listed["shelf_life", "questions"]["package"] == "mindstage-pantry"
    assert [name for (name, _), each in listed.items() if each["offered"]] == [
        "broken_question",
        "shelf_life",
        "wave",
        "pantry",
        "stock",
        "scale",
    ]
    assert listed["secret", "questions"]["access"] == ""
    assert any("a library is missing" in each for each in found["problems"])


@pytest.mark.parametrize("is_changed", [False, True])
def test_the_words_of_questions_are_kept_until_a_source_changes(
    environment: dict[str, str], site: Path, is_changed: bool
) -> None:
    """A question is not imported again to find that its words are not in a sentence."""
    code = (
        "import sys\n"
        "from mindstage.knowledge.sentences import questions_with_words\n"
        "print(*(each.name for each in questions_with_words({'how', 'long', 'do', 'last'})))\n"
        "print('shy' in sys.modules)"
    )

    def asked() -> list[str]:
        run = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
        return run.stdout.splitlines()

    asked()
    if is_changed:
        source = site / "shy.py"
        source.write_text(SHY.replace("what is secret of {thing}", "how long does {thing} last"), encoding="utf-8")
        assert asked() == ["secret", "True"]
    else:
        assert asked() == ["", "False"]


def test_a_checkout_that_is_not_installed_has_its_entry_points(tmp_path: Path) -> None:
    code = (
        "import sys\n"
        "sys.path = [each for each in sys.path if not each.endswith('site-packages')] + [sys.argv[1]]\n"
        "from importlib.metadata import PackageNotFoundError, version\n"
        "try: version('mindstage'); assert False\n"
        "except PackageNotFoundError: pass\n"
        "from mindstage.registry import Group, extensions\n"
        "print(len(extensions(Group.QUESTIONS)), *sorted(extensions(Group.ENGINES)))"
    )
    libraries = tmp_path / "libraries"
    libraries.mkdir()
    import msgspec

    libraries.joinpath("msgspec").symlink_to(Path(msgspec.__file__).parent)
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "src"), "MINDSTAGE_CACHE": str(tmp_path)}
    command = [sys.executable, "-S", "-c", code, str(libraries)]
    run = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["52", "godot", "mujoco", "null", "ros", "ros+tls"]
