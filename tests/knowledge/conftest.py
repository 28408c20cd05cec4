"""Reading maps from texts."""

from __future__ import annotations

from pathlib import Path

import pytest

from mindstage.knowledge import Finding, KnowledgeBase
from mindstage.world import World
from tests.knowledge.maps import Read, Tell, knowing, room


@pytest.fixture
def told(tmp_path: Path) -> Tell:
    """A knowledge base that was told just that."""

    def tell(*statements: str) -> KnowledgeBase:
        path = tmp_path / "map.ttl"
        path.write_text(room(*statements), encoding="utf-8")
        return knowing(path)

    return tell


@pytest.fixture
def read(tmp_path: Path) -> Read:
    """Reads a map from its text, alone in a knowledge base."""

    def read_text(text: str, *, suffix: str = ".ttl", map: str | None = None) -> tuple[World, tuple[Finding, ...]]:
        path = tmp_path / f"map{suffix}"
        path.write_text(text, encoding="utf-8")
        knowledge = knowing(path)
        return knowledge.world(map), knowledge.findings()

    return read_text
