"""A copy of Godot's project, with its tests, in which tests may write."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

from mindstage.engines.godot_process import isolated_environment

PROJECT = Path(__file__).resolve().parents[2] / "godot"
IMPORT_TIMEOUT_S = 180.0


def copy_project(godot: Path, folder: Path) -> Path:
    """Copies it with all that it is tested by, and has Godot learn the names of its classes."""
    copy = folder / "godot"
    shutil.copytree(PROJECT, copy, ignore=shutil.ignore_patterns(".godot"))
    shutil.copytree(PROJECT.parent / "wire", folder / "wire")
    done = run(godot, copy, "--headless", "--import", timeout_s=IMPORT_TIMEOUT_S)
    assert "SCRIPT ERROR" not in done.stdout, done.stdout
    return copy


def run(godot: Path, copy: Path, *arguments: str, timeout_s: float) -> subprocess.CompletedProcess[str]:
    """Runs Godot on a copy until it ends."""
    return subprocess.run(
        [godot, "--path", copy, *arguments],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        timeout=timeout_s,
        check=False,
        env=os.environ | isolated_environment(),
    )
