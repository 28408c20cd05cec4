"""Shelf: a folder in which forms lie as files, for engines on this machine that read what bodies look like from there.

A file is called after its form's key, so what lies there is never wrong, only perhaps no longer needed.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from mindstage.assets.gltf import geometry_to_glb
from mindstage.files import atomic_write, cache_dir
from mindstage.scene import BodyGeometry

__all__ = ["cache_geometry_glb", "geometry_cache_dir"]

_MAX_BYTES = 512 << 20
"""What lies there longest without being used goes first."""
_MAX_KEY_LENGTH = 64
_HEX_DIGITS = frozenset("0123456789abcdef")


def geometry_cache_dir() -> Path:
    """The folder."""
    return cache_dir("forms")


def cache_geometry_glb(geometry: BodyGeometry) -> str:
    """Has a file that shows a form lie on the shelf, and gives its name; empty for what has no looks, or no digest."""
    if (
        not geometry.visuals
        or not 8 <= len(geometry.key) <= _MAX_KEY_LENGTH
        or not _HEX_DIGITS.issuperset(geometry.key)
    ):
        return ""
    path = geometry_cache_dir() / f"{geometry.key}.glb"
    if path.is_file():
        with suppress(OSError):
            os.utime(path)
        return path.name
    atomic_write(path, geometry_to_glb(geometry))
    _evict(path)
    return path.name


def _evict(newest: Path) -> None:
    """Takes away what has not been used for longest, once there is too much."""
    found = [(entry.stat(), entry.path) for entry in os.scandir(newest.parent) if entry.name.endswith(".glb")]
    left = sum(status.st_size for status, _ in found)
    for status, path in sorted(found, key=lambda each: each[0].st_mtime_ns):
        if left <= _MAX_BYTES:
            return
        if path != str(newest):
            with suppress(OSError):  # somebody else tidies as well
                os.unlink(path)
            left -= status.st_size
