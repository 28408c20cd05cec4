"""The cache directory of the user, and atomic writing of files."""

from __future__ import annotations

import os
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from uuid import uuid4

__all__ = ["atomic_write", "cache_dir"]


def cache_dir(name: str = "") -> Path:
    """The folder of that name in Mindstage's cache, made if it is not there.

    It lies where `MINDSTAGE_CACHE` says, else where the platform keeps such things (the XDG Base Directory
    Specification's `XDG_CACHE_HOME`; `~/Library/Caches` on macOS), or, where nobody may write there, in the folder for
    temporary files. Another process, such as a game engine, finds it by the same rule.
    """
    wanted = _home() / name
    with suppress(OSError):
        wanted.mkdir(mode=0o700, parents=True, exist_ok=True)
        if os.access(wanted, os.W_OK | os.X_OK):
            return wanted
    user = os.getuid() if hasattr(os, "getuid") else 0
    spare = Path(tempfile.gettempdir()) / f"mindstage-{user}" / name
    spare.mkdir(mode=0o700, parents=True, exist_ok=True)
    return spare


def _home() -> Path:
    if told := os.environ.get("MINDSTAGE_CACHE"):
        return Path(told).absolute()
    told = os.environ.get("XDG_CACHE_HOME", "")
    caches = (
        Path(told)
        if os.path.isabs(told)
        else Path.home() / ("Library/Caches" if sys.platform == "darwin" else ".cache")
    )
    return caches / "mindstage"


def atomic_write(path: Path, content: bytes, *, durable: bool = False) -> None:
    """Writes a file; an existing one of that name is replaced only once the new one is complete.

    Args:
        path: the file, in an existing folder.
        content: all of it.
        durable: whether the file must also survive a power failure once this returns.

    Raises:
        OSError: it cannot be written; `filename` is the path. An existing file is unchanged.
    """
    # In the same folder, since a rename is atomic only within one file system.
    part = path.with_name(f".{uuid4().hex}.part")
    try:
        with part.open("xb") as file:
            file.write(content)
            if durable:
                file.flush()
                os.fsync(file.fileno())
        part.replace(path)
        if durable and hasattr(os, "O_DIRECTORY"):  # the rename is in the folder's own data
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
