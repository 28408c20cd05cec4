"""The root of all errors."""

from __future__ import annotations

__all__ = [
    "MindstageError",
]


class MindstageError(Exception):
    """The root: catch it to catch everything that Mindstage itself raises."""
