"""Shelf: a folder in which forms lie as files, for engines on this machine that read what bodies look like from there.

A file is called after its form's key, so what lies there is never wrong, only perhaps no longer needed.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from mindstage.exports.gltf import form_glb
from mindstage.files import atomic_write, cache_folder
from mindstage.world import Form

__all__ = ["shelf_folder", "shelve"]

_MOST_BYTES = 512 << 20
"""What lies there longest without being used goes first."""
_LONGEST_NAME = 64
_DIGITS = frozenset("0123456789abcdef")


def shelf_folder() -> Path:
    """The folder."""
    return cache_folder("forms")


def shelve(form: Form) -> str:
    """Has a file that shows a form lie on the shelf, and gives its name; empty for what has no looks, or no digest."""
    if not form.skins or not 8 <= len(form.key) <= _LONGEST_NAME or not _DIGITS.issuperset(form.key):
        return ""
    path = shelf_folder() / f"{form.key}.glb"
    if path.is_file():
        with suppress(OSError):
            os.utime(path)
        return path.name
    atomic_write(path, form_glb(form))
    _tidy(path)
    return path.name


def _tidy(newest: Path) -> None:
    """Takes away what has not been used for longest, once there is too much."""
    found = [(entry.stat(), entry.path) for entry in os.scandir(newest.parent) if entry.name.endswith(".glb")]
    left = sum(status.st_size for status, _ in found)
    for status, path in sorted(found, key=lambda each: each[0].st_mtime_ns):
        if left <= _MOST_BYTES:
            return
        if path != str(newest):
            with suppress(OSError):  # somebody else tidies as well
                os.unlink(path)
            left -= status.st_size
