"""What the documents promise is tried: the examples run, the pictures and links are there."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from mindstage.cli.app import app
from mindstage.knowledge import bundled_kitchen, bundled_ontology
from tests.knowledge.sparql_server import SparqlServer

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
DOCUMENTS = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]


ASKING = (ROOT / "docs" / "how-to" / "asking.md").read_text(encoding="utf-8")
TUTORIAL = (ROOT / "docs" / "tutorial" / "first-hour.md").read_text(encoding="utf-8")
STORES = (ROOT / "docs" / "how-to" / "stores.md").read_text(encoding="utf-8")
ENDPOINT = "http://localhost:7878/query"


def blocks(language: str, page: str = README) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("code", blocks("python"))
def test_the_python_of_the_readme_runs_and_prints_what_it_says(code: str, tmp_path: Path) -> None:
    result = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    # A comment after a print says what it prints.
    promised = re.findall(r"^\s*print\(.*\)  # (.+?)(?::.*)?$", code, re.MULTILINE)
    assert promised
    assert result.stdout.split("\n")[:-1] == promised


@pytest.mark.parametrize("script", [block for block in blocks("sh") if "mindstage " in block])
def test_the_shell_of_the_readme_runs(script: str, tmp_path: Path) -> None:
    commands = [line for line in script.splitlines() if line.startswith("mindstage ")]
    assert commands
    # The command of the Python that runs this test, wherever it is installed; and the demo must end.
    environment = os.environ | {
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "MINDSTAGE_DEMO_SECONDS": "1",
    }
    result = subprocess.run(
        ["bash", "-euc", "\n".join(commands)],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr


@pytest.mark.parametrize(("page", "least"), [(ASKING, 8), (TUTORIAL, 3)], ids=["asking", "tutorial"])
def test_the_python_of_a_page_runs_and_prints_what_it_says(page: str, least: int, tmp_path: Path) -> None:
    """All of it is one program."""
    code = "".join(blocks("python", page))
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=120
    )
    assert result.returncode == 0, result.stderr
    promised = re.findall(r"^(?:\s*print\(.*\)  )?# (.+)$", code, re.MULTILINE)
    assert len(promised) >= least
    assert result.stdout.splitlines() == promised


def test_the_shell_about_asking_ends_as_it_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, oxigraph: Path
) -> None:
    """One line after the other, in one folder; the server is a real one elsewhere."""
    monkeypatch.chdir(tmp_path)
    server = SparqlServer(oxigraph)
    try:
        server.load_files(bundled_kitchen(), bundled_ontology())
        for line in "".join([*blocks("sh", ASKING), *blocks("sh", STORES)]).splitlines():
            command, _, promise = line.partition("  # ends with ")
            code, _, said = promise.partition(": ")
            typed = shlex.split(command.replace(ENDPOINT, server.url))
            assert typed[0] == "mindstage"
            result = CliRunner().invoke(app, typed[1:], prog_name="mindstage")
            assert result.exit_code == int(code or 0), f"{line}\n{result.output}"
            assert said in result.output
    finally:
        server.stop()


def test_the_pages_are_short_enough_to_be_read() -> None:
    assert len(ASKING.splitlines()) <= 150
    assert ENDPOINT in STORES


def test_the_readme_can_be_read_in_one_go() -> None:
    assert len(README.splitlines()) <= 120
    assert len(blocks("python")) >= 1


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_and_pictures_lead_somewhere(path: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", path.read_text(encoding="utf-8")):
        if "://" not in target:
            assert (path.parent / target).exists(), f"{path.name} names {target}"


def test_every_verb_of_the_command_line_is_in_the_readme() -> None:
    for command in app.registered_commands:
        assert command.callback is not None
        assert f"mindstage {command.callback.__name__}" in README
