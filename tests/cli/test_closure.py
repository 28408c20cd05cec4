"""The option `--closure`: the OWL 2 RL closure is derived for one command, and not stored."""

from __future__ import annotations

import os
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.cli.runner import Run, json_output

_ONTOLOGY = """@prefix : <http://example.org/lair#> . @prefix k: <http://knowrob.org/kb/knowrob.owl#> .
@prefix owl: <http://www.w3.org/2002/07/owl#> .
:lair a k:SemanticEnvironmentMap . :Cat a owl:Class . :ownedBy a owl:ObjectProperty , owl:FunctionalProperty .
:mouse :ownedBy :tom , :puss . :tom k:describedInMap :lair . :puss a :Cat ; k:describedInMap :lair .
"""
SAME = "ASK { <http://example.org/lair#tom> owl:sameAs <http://example.org/lair#puss> }"


@pytest.fixture
def ontology(tmp_path: Path) -> tuple[object, ...]:
    """Options for an ontology in which a functional property has two values."""
    path = tmp_path / "lair.ttl"
    path.write_text(_ONTOLOGY, encoding="utf-8")
    return "--map", path, "--no-bundled-ontology"


@pytest.fixture
def reasoner() -> None:
    """Skips the test without the reasoner."""
    if find_spec("reasonable") is None:
        reason = "reasonable is not installed (the extra closure)"
        pytest.fail(reason) if os.environ.get("CI") else pytest.skip(reason)


def test_a_derived_answer_is_explained(reasoner: None, ontology: tuple[object, ...], run: Run) -> None:
    cats = ("ask", "individual_of_class", "Cat", *ontology, "--why", "--json")
    assert [answer["id"] for answer in json_output(run(*cats))["answers"]] == ["puss"]
    puss, tom = json_output(run(*cats, "--closure"))["answers"]
    assert (puss["id"], puss["why"]) == ("puss", ["puss type Cat"])
    assert (tom["id"], tom["why"]) == ("tom", ["tom type Cat, by the rules of OWL 2 RL"])


def test_a_query_finds_derived_statements(reasoner: None, ontology: tuple[object, ...], run: Run) -> None:
    result = run("sparql", SAME, *ontology)
    assert (result.stdout, result.exit_code) == ("no\n", 1)
    result = run("sparql", SAME, *ontology, "--closure")
    assert (result.stdout, result.exit_code) == ("yes\n", 0)


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (
            ("ask", "maps", "--store", "{tmp}/store"),
            "it would write derived statements into a store",
        ),
        (
            ("sparql", SAME, "--store", "{tmp}/store"),
            "it would write derived statements into a store",
        ),
        (
            ("sparql", SAME, "--endpoint", "http://127.0.0.1:9/"),
            "an endpoint does not contain the statements that",
        ),
    ],
)
def test_the_closure_is_not_written_to_stores_and_endpoints(
    args: tuple[str, ...], message: str, ontology: tuple[object, ...], run: Run, tmp_path: Path
) -> None:
    result = run(*(arg.replace("{tmp}", str(tmp_path)) for arg in args), *ontology, "--closure")
    assert result.exit_code == 2
    assert f"--closure: {message}" in result.stderr
    assert not (tmp_path / "store").exists()


def test_without_the_reasoner_the_error_names_the_extra(
    ontology: tuple[object, ...], run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "reasonable", None)
    result = run("ask", "maps", *ontology, "--closure")
    assert result.exit_code == 2
    assert "install it with: pip install 'mindstage[closure]'" in result.stderr
    assert run("ask", "maps", *ontology).exit_code == 0
