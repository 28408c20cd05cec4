"""Fixtures that write small maps and run commands."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from mindstage.cli.app import app
from tests.cli.runner import Run, WriteMap, map_text


@pytest.fixture
def write_map(tmp_path: Path) -> WriteMap:
    """Writes a map of two mugs, or of the given ones; a mug at None has no pose."""

    def write(
        name: str = "room.owl", *, mugs: dict[str, str | None] | None = None, maps: Iterable[str] = ("Room",)
    ) -> Path:
        path = tmp_path / name
        positions = {"Mug1": "1.0 2.0 0.0", "Mug2": "3.0 2.0 0.0"} if mugs is None else mugs
        path.write_text(map_text(list(maps), positions), encoding="utf-8")
        return path

    return write


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Run:
    """Runs a command in this process."""
    monkeypatch.delenv("ROS_PACKAGE_PATH", raising=False)
    monkeypatch.delenv("MINDSTAGE_DEMO_SECONDS", raising=False)

    def invoke(*args: object) -> Result:
        result = CliRunner().invoke(app, [str(arg) for arg in args], prog_name="mindstage")
        if result.exception is not None and not isinstance(result.exception, SystemExit):
            raise result.exception
        return result

    return invoke
