"""The files that come with Mindstage: a household ontology and a furnished kitchen."""

from __future__ import annotations

import os
from pathlib import Path

__all__ = ["BUNDLED_KITCHEN", "bundled_kitchen", "bundled_ontology", "map_path"]

BUNDLED_KITCHEN = "bundled:kitchen"
"""The name under which `KnowledgeBase.load` and every command of the shell take the bundled kitchen."""


def map_path(name: str | os.PathLike[str]) -> str:
    """The path of a map: that of the bundled kitchen for its name, any other as it is."""
    path = os.fspath(name)
    return os.fspath(bundled_kitchen()) if path == BUNDLED_KITCHEN else path


def bundled_kitchen() -> Path:
    """A kitchen to play with: a map of dialect 1."""
    return _bundled_path("kitchen.owl")


def bundled_ontology() -> Path:
    """What a household holds, as classes that maps and questions share; every `KnowledgeBase` knows it unless told."""
    return _bundled_path("household.ttl")


def _bundled_path(name: str) -> Path:
    # Wheels are always unpacked, so that a resource of ours is a file.
    return Path(__file__).parent / "bundled" / name
