"""The files of `changes`, and the script that moves them into the changelog."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__).resolve().parent.parent / "scripts" / "join_changes.py"


def join(root: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, root / "scripts" / SCRIPT.name, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)


def test_the_changes_since_the_last_version_are_valid() -> None:
    done = join(SCRIPT.parent.parent)
    assert done.returncode == 0, done.stderr


def test_changes_since_the_last_version_are_not_in_the_changelog() -> None:
    text = (SCRIPT.parent.parent / "CHANGELOG.md").read_text(encoding="utf-8")
    unreleased = text.partition("(not released yet)")[2].partition("\n## ")[0]
    assert "\n### " not in unreleased, "a merge has brought back what was replaced by the page"
    assert "\n- " not in unreleased, "each change is a file in the folder changes"
    assert "## Unreleased" not in text


def test_a_version_gets_all_changes_by_their_kind(tmp_path: Path) -> None:
    (tmp_path / "scripts").mkdir()
    (tmp_path / "changes").mkdir()
    shutil.copy(SCRIPT, tmp_path / "scripts")
    log = tmp_path / "CHANGELOG.md"
    log.write_text("# Changelog\n\nIntroduction.\n\n## 1.0\n\nThe first one.\n")
    texts = {"doors.fixed.md": "Doors close.\nDrawers, too.\n", "README.md": "How.\n", "cups.added.md": "Cups.\n"}
    for name, text in texts.items():
        (tmp_path / "changes" / name).write_text(text)
    assert join(tmp_path, "1.1").returncode == 0
    before, version, after = log.read_text().partition("## 1.1 (")
    assert before == "# Changelog\n\nIntroduction.\n\n"
    expected = "\n\n### Added\n\n- Cups.\n\n### Fixed\n\n- Doors close.\n  Drawers, too.\n\n## 1.0\n\nThe first one.\n"
    assert version
    assert after.partition(")")[2] == expected
    assert [path.name for path in (tmp_path / "changes").iterdir()] == ["README.md"]
    assert join(tmp_path, "1.2").returncode == 1
    (tmp_path / "changes" / "cups.new.md").write_text("Cups.\n")
    assert "cups.new.md" in join(tmp_path).stderr
