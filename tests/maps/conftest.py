"""Reading maps from texts."""

from __future__ import annotations

from pathlib import Path

import pytest

from mindstage.knowledge import KnowledgeBase
from mindstage.rdf import Finding
from mindstage.scene import World
from tests.maps.small_maps import MakeKnowledgeBase, ReadMap, knowledge_base_from, room_map


@pytest.fixture
def make_knowledge_base(tmp_path: Path) -> MakeKnowledgeBase:
    """Makes a knowledge base with a map of these statements only."""

    def make(*statements: str) -> KnowledgeBase:
        path = tmp_path / "map.ttl"
        path.write_text(room_map(*statements), encoding="utf-8")
        return knowledge_base_from(path)

    return make


@pytest.fixture
def read(tmp_path: Path) -> ReadMap:
    """Reads a map from its text in a knowledge base without other sources."""

    def read_text(text: str, *, suffix: str = ".ttl", map: str | None = None) -> tuple[World, tuple[Finding, ...]]:
        path = tmp_path / f"map{suffix}"
        path.write_text(text, encoding="utf-8")
        knowledge = knowledge_base_from(path)
        return knowledge.world(map), knowledge.findings()

    return read_text
