"""Files: what the page is made of, read once from the package; no path from outside ever reaches the disk."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

import msgspec

__all__ = ["StaticFile", "page_files"]

_TYPES = {
    ".css": "text/css; charset=utf-8",
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}


class StaticFile(msgspec.Struct, frozen=True):
    """One file as a browser gets it."""

    type: str
    content: bytes
    etag: str
    """Changes whenever the content does."""


@cache
def page_files() -> dict[str, StaticFile]:
    """All files of the page by name: a fixed list, against which wishes are held."""
    found = {}
    # Wheels are always unpacked, so that what lies beside this file is a folder.
    for path in Path(__file__).with_name("page").iterdir():
        if (type := _TYPES.get(path.suffix)) is not None:
            content = path.read_bytes()
            found[path.name] = StaticFile(type, content, f'"{hashlib.sha256(content).hexdigest()[:24]}"')
    return found
