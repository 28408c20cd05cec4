"""A directory of glTF files with visual meshes, for engines on this machine that load them from disk.

Files are named by the key of their geometry, so a file is never outdated. The least recently used ones are deleted.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from mindstage.assets.gltf import geometry_to_glb
from mindstage.errors import CacheError
from mindstage.files import atomic_write, cache_dir
from mindstage.scene import BodyGeometry

__all__ = ["cache_geometry_glb", "geometry_cache_dir"]

_MAX_BYTES = 512 << 20
"""Total size from which the least recently used files are deleted."""
_MAX_KEY_LENGTH = 64
_HEX_DIGITS = frozenset("0123456789abcdef")


def geometry_cache_dir() -> Path:
    """The directory of the files."""
    return cache_dir("forms")


def cache_geometry_glb(geometry: BodyGeometry) -> str:
    """Writes the visual meshes of a geometry and returns the file name; empty if it has none, or no valid key.

    Raises:
        CacheError: the file cannot be written, for example since the disk is full.
    """
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
    try:
        atomic_write(path, geometry_to_glb(geometry))
    except OSError as error:
        raise CacheError(str(path.parent), cause=error.strerror or str(error)) from error
    _evict(path)
    return path.name


def _evict(newest: Path) -> None:
    """Deletes the least recently used files while their total size is too large."""
    found = [(entry.stat(), entry.path) for entry in os.scandir(newest.parent) if entry.name.endswith(".glb")]
    total = sum(status.st_size for status, _ in found)
    for status, path in sorted(found, key=lambda each: each[0].st_mtime_ns):
        if total <= _MAX_BYTES:
            return
        if path != str(newest):
            with suppress(OSError):  # another process may have deleted it
                os.unlink(path)
            total -= status.st_size
