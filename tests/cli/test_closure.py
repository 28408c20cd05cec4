"""What follows by the rules of OWL 2 RL, typed: derived for one command, and written nowhere."""

from __future__ import annotations

import os
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.cli.typed import Run, json_output

_LAIR = """@prefix : <http://example.org/lair#> . @prefix k: <http://knowrob.org/kb/knowrob.owl#> .
@prefix owl: <http://www.w3.org/2002/07/owl#> .
:lair a k:SemanticEnvironmentMap . :Cat a owl:Class . :ownedBy a owl:ObjectProperty , owl:FunctionalProperty .
:mouse :ownedBy :tom , :puss . :tom k:describedInMap :lair . :puss a :Cat ; k:describedInMap :lair .
"""
SAME = "ASK { <http://example.org/lair#tom> owl:sameAs <http://example.org/lair#puss> }"


@pytest.fixture
def lair(tmp_path: Path) -> tuple[object, ...]:
    """A mouse that two cats own, although one alone can."""
    path = tmp_path / "lair.ttl"
    path.write_text(_LAIR, encoding="utf-8")
    return "--map", path, "--no-bundled-ontology"


@pytest.fixture
def reasoner() -> None:
    """The library that applies the rules."""
    if find_spec("reasonable") is None:
        reason = "reasonable is not installed (the extra closure)"
        pytest.fail(reason) if os.environ.get("CI") else pytest.skip(reason)


def test_what_follows_is_an_answer_that_tells_why(reasoner: None, lair: tuple[object, ...], run: Run) -> None:
    cats = ("ask", "individual_of_class", "Cat", *lair, "--why", "--json")
    assert [answer["id"] for answer in json_output(run(*cats))["answers"]] == ["puss"]
    puss, tom = json_output(run(*cats, "--closure"))["answers"]
    assert (puss["id"], puss["why"]) == ("puss", ["puss type Cat"])
    assert (tom["id"], tom["why"]) == ("tom", ["tom type Cat, by the rules of OWL 2 RL"])


def test_a_query_sees_it_too(reasoner: None, lair: tuple[object, ...], run: Run) -> None:
    result = run("sparql", SAME, *lair)
    assert (result.stdout, result.exit_code) == ("no\n", 1)
    result = run("sparql", SAME, *lair, "--closure")
    assert (result.stdout, result.exit_code) == ("yes\n", 0)


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("ask", "maps", "--store", "{tmp}/store"), "what it derives would be written into what others use; load"),
        (("sparql", SAME, "--store", "{tmp}/store"), "what it derives would be written into what others use; load"),
        (("sparql", SAME, "--endpoint", "http://127.0.0.1:9/"), "an endpoint answers by itself, and hears nothing of"),
    ],
)
def test_what_others_use_is_not_added_to(
    args: tuple[str, ...], message: str, lair: tuple[object, ...], run: Run, tmp_path: Path
) -> None:
    result = run(*(arg.replace("{tmp}", str(tmp_path)) for arg in args), *lair, "--closure")
    assert result.exit_code == 2
    assert f"--closure: {message}" in result.stderr
    assert not (tmp_path / "store").exists()


def test_without_the_reasoner_it_says_how_to_get_it(
    lair: tuple[object, ...], run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "reasonable", None)
    result = run("ask", "maps", *lair, "--closure")
    assert result.exit_code == 2
    assert "install it with: pip install 'mindstage[closure]'" in result.stderr
    assert run("ask", "maps", *lair).exit_code == 0
