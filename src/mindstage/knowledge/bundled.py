"""The files that come with Mindstage: a household ontology and a furnished kitchen."""

from __future__ import annotations

from pathlib import Path

__all__ = ["bundled_kitchen", "bundled_ontology"]


def bundled_kitchen() -> Path:
    """A kitchen to play with: a map of dialect 1."""
    return _bundled("kitchen.owl")


def bundled_ontology() -> Path:
    """What a household holds, as classes that maps and questions share; every `KnowledgeBase` knows it unless told."""
    return _bundled("household.ttl")


def _bundled(name: str) -> Path:
    # Wheels are always unpacked, so that a resource of ours is a file.
    return Path(__file__).parent / "bundled" / name
