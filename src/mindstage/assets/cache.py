"""Cache: a folder of this user's for what can be made again."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

__all__ = ["cache_folder", "written_whole"]


def cache_folder(name: str = "") -> Path:
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


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """A path to write to; what was written there becomes the file of the name at once, or not at all."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}-", suffix=path.suffix)
    os.close(handle)
    part = Path(name)
    try:
        yield part
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
