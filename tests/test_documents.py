"""What the documents promise is tried: the examples run, the pictures and links are there."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
DOCUMENTS = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.md"))]


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)


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


def test_the_readme_can_be_read_in_one_go() -> None:
    assert len(README.splitlines()) <= 120
    assert len(blocks("python")) >= 1


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_and_pictures_lead_somewhere(path: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", path.read_text(encoding="utf-8")):
        if "://" not in target:
            assert (path.parent / target).exists(), f"{path.name} names {target}"


def test_every_verb_of_the_command_line_is_in_the_readme() -> None:
    from mindstage.cli.app import app

    for command in app.registered_commands:
        assert command.callback is not None
        assert f"mindstage {command.callback.__name__}" in README
