"""The user's cache directory, and atomic file writing."""

from __future__ import annotations

import os
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from uuid import uuid4

__all__ = ["atomic_write", "cache_dir"]


def cache_dir(name: str = "") -> Path:
    """The directory of that name in Mindstage's cache, created if needed.

    The cache is at `MINDSTAGE_CACHE`, or else where the platform has caches (`XDG_CACHE_HOME` of the XDG Base Directory
    Specification; `~/Library/Caches` on macOS), or in the directory for temporary files if that is not writable. Other
    processes, such as game engines, find it by the same rule.
    """
    preferred = _home() / name
    with suppress(OSError):
        preferred.mkdir(mode=0o700, parents=True, exist_ok=True)
        if os.access(preferred, os.W_OK | os.X_OK):
            return preferred
    user = os.getuid() if hasattr(os, "getuid") else 0
    fallback = Path(tempfile.gettempdir()) / f"mindstage-{user}" / name
    fallback.mkdir(mode=0o700, parents=True, exist_ok=True)
    return fallback


def _home() -> Path:
    if configured := os.environ.get("MINDSTAGE_CACHE"):
        return Path(configured).absolute()
    configured = os.environ.get("XDG_CACHE_HOME", "")
    caches = (
        Path(configured)
        if os.path.isabs(configured)
        else Path.home() / ("Library/Caches" if sys.platform == "darwin" else ".cache")
    )
    return caches / "mindstage"


def atomic_write(path: Path, content: bytes, *, durable: bool = False) -> None:
    """Writes a file; an existing file is replaced only when the new one is complete.

    Args:
        path: the file, in an existing directory.
        content: the whole content.
        durable: whether the file is also synchronized to disk, so that it survives a power failure.

    Raises:
        OSError: the file cannot be written; `filename` is the path. An existing file is unchanged.
    """
    # In the same directory, since a rename is atomic only within one file system.
    part = path.with_name(f".{uuid4().hex}.part")
    try:
        with part.open("xb") as file:
            file.write(content)
            if durable:
                file.flush()
                os.fsync(file.fileno())
        part.replace(path)
        if durable and hasattr(os, "O_DIRECTORY"):  # the rename is part of the directory's data
            folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)
    except BaseException as error:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise OSError(error.errno, error.strerror or str(error), str(path)) from error
        raise
