"""Godot, one process for all tests of a module."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from mindstage.engines.remote.godot import GodotEngine


@pytest.fixture(scope="module")
def running(godot: Path) -> Iterator[GodotEngine]:
    """The process; for tests that leave it as it was, or clear it."""
    with closing(GodotEngine(godot, timeout_s=60.0)) as engine:
        yield engine


@pytest.fixture
def engine(running: GodotEngine) -> Iterator[GodotEngine]:
    """An engine without a world."""
    yield running
    running.clear()
