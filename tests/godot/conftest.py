"""A copy of the Godot project for all tests of a session."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.godot.project import copy_project


@pytest.fixture(scope="session")
def project(godot: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The path of a prepared copy, which tests may change."""
    return copy_project(godot, tmp_path_factory.mktemp("godot"))
