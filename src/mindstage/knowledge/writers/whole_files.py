"""Whole files: what is written is there as a whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path
from uuid import uuid4

from mindstage.errors import MapUnwritable

__all__ = ["save_whole"]


def save_whole(path: Path, content: bytes) -> None:
    """Writes a file, which replaces another one of its name only once it is complete.

    Raises:
        MapUnwritable: the disk refuses.
    """
    # Beside the file, since only within one file system a file can take another's place at once.
    beside = path.with_name(f".{path.name}-{uuid4().hex}")
    try:
        beside.write_bytes(content)
        os.replace(beside, path)
    except BaseException as error:
        beside.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise MapUnwritable(str(path), cause=error.strerror or str(error)) from error
        raise
