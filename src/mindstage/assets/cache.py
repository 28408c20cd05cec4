"""A directory of glTF files with visual meshes, for engines on this machine that load them from disk.

Files are named by the key of their geometry, so a file is never outdated. The least recently used ones are deleted.
The images of textures are written once for all geometries: `oak_board-color.jpg`, `-roughness.jpg` and `-normal.jpg`.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from mindstage.assets.gltf import geometry_to_glb
from mindstage.errors import CacheError
from mindstage.files import atomic_write, cache_dir, cached_content, delete_least_recently_used
from mindstage.scene import BodyGeometry
from mindstage.textures.baking import content_version
from mindstage.textures.images import TextureMap, texture_jpeg

__all__ = ["cache_geometry_glb", "cached_glb", "geometry_cache_dir"]

_VIEW_FOLDER = "view"

_MAX_BYTES = 512 << 20
"""Total size from which the least recently used files are deleted."""
_MAX_KEY_CHARACTERS = 64
_HEX_DIGITS = frozenset("0123456789abcdef")
_TEXTURE_PIXELS = 512


def geometry_cache_dir() -> Path:
    """The directory of the files."""
    return cache_dir("meshes")


def cache_geometry_glb(geometry: BodyGeometry) -> str:
    """Writes the visual meshes of a geometry and its textures, and returns the name of the glTF file.

    The name is empty if the geometry has no visual meshes, or no valid key.

    Raises:
        CacheError: the file cannot be written, for example since the disk is full.
    """
    if (
        not geometry.visuals
        or not 8 <= len(geometry.key) <= _MAX_KEY_CHARACTERS
        or not _HEX_DIGITS.issuperset(geometry.key)
    ):
        return ""
    path = geometry_cache_dir() / f"{geometry.key}.glb"
    try:
        _write_textures({visual.material.texture for visual in geometry.visuals if visual.uv is not None}, path.parent)
        if path.is_file():
            with suppress(OSError):
                os.utime(path)
            return path.name
        atomic_write(path, geometry_to_glb(geometry))
    except OSError as error:
        raise CacheError(str(path.parent), cause=error.strerror or str(error)) from error
    delete_least_recently_used(path, max_bytes=_MAX_BYTES)
    return path.name


def cached_glb(key: str, make: Callable[[], bytes]) -> bytes:
    """A file for the page: from the cache directory if an earlier run has made it, else made and stored.

    Args:
        key: a hash of all that the content depends on.
        make: returns the content.
    """
    return cached_content(cache_dir(_VIEW_FOLDER) / f"{key}.glb", make, max_bytes=_MAX_BYTES)


def _write_textures(names: set[str], folder: Path) -> None:
    """Writes the images of textures, unless those of this version are there."""
    for name in names - {""}:
        mark = folder / f"{name}-{content_version()}.version"
        if mark.exists():
            continue
        for map in TextureMap:
            atomic_write(folder / f"{name}-{map}.jpg", texture_jpeg(name, map, _TEXTURE_PIXELS))
        for outdated in folder.glob(f"{name}-*.version"):
            outdated.unlink(missing_ok=True)
        atomic_write(mark, b"")
