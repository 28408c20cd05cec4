"""Reading maps from texts."""

from __future__ import annotations

from pathlib import Path

import pytest

from mindstage.knowledge import Finding
from mindstage.world import World
from tests.knowledge.maps import Read, knowing


@pytest.fixture
def read(tmp_path: Path) -> Read:
    """Reads a map from its text, alone in a knowledge base."""

    def read_text(text: str, *, suffix: str = ".ttl", map: str | None = None) -> tuple[World, tuple[Finding, ...]]:
        path = tmp_path / f"map{suffix}"
        path.write_text(text, encoding="utf-8")
        knowledge = knowing(path)
        return knowledge.world(map), knowledge.findings()

    return read_text
