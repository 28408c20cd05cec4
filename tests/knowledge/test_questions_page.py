"""The page about the questions has all of them, and every example on it runs; `make check` makes it again."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

from mindstage.cli.app import app
from mindstage.knowledge.queries import list_questions

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "reference" / "questions.md"
EXAMPLES = re.findall(r"^(?: {4})?mindstage (ask .*)$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)


def test_every_question_is_on_it_with_an_example() -> None:
    assert {example.split()[1] for example in EXAMPLES} == {declared.name for declared in list_questions()}


@pytest.mark.parametrize("example", [each for each in EXAMPLES if "--episode" not in each])
def test_every_example_has_an_answer(example: str) -> None:
    result = CliRunner().invoke(app, shlex.split(example))
    nothing = example.startswith(
        ("ask differences", "ask states")
    )  # nothing was told; a map does not differ from itself, and only one is loaded
    assert result.exit_code == (1 if nothing else 0), result.output
