"""Copies of the Godot project with its tests, which tests may change."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

from mindstage.engines.remote.godot_process import isolated_environment

PROJECT = Path(__file__).resolve().parents[2] / "godot"
IMPORT_TIMEOUT_S = 180.0


def copy_project(godot: Path, folder: Path) -> Path:
    """Copies the project with its tests, and imports it in Godot."""
    copy = folder / "godot"
    shutil.copytree(PROJECT, copy, ignore=shutil.ignore_patterns(".godot"))
    shutil.copytree(PROJECT.parent / "wire", folder / "wire")
    result = run(godot, copy, "--headless", "--import", timeout_s=IMPORT_TIMEOUT_S)
    assert "SCRIPT ERROR" not in result.stdout, result.stdout
    return copy


def run(godot: Path, copy: Path, *arguments: str, timeout_s: float) -> subprocess.CompletedProcess[str]:
    """Runs Godot in a copy until it exits."""
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
