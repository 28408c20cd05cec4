"""The user's cache directory, atomic file writing, and file locks."""

from __future__ import annotations

import errno
import os
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path
from uuid import uuid4

from mindstage.ranges import Index, WallTime, checked

__all__ = ["atomic_write", "cache_dir", "cached_content", "delete_least_recently_used", "file_lock"]

_LOCK_TIMEOUT_S = 30.0
_STORED_PER_SWEEP = 50
_stored = count()
_LOCK_INTERVAL_S = 0.02
"""The time between two attempts to lock a file [s]."""


def cache_dir(name: str = "") -> Path:
    """The directory of that name in Mindstage's cache, created if needed.

    The cache is at `MINDSTAGE_CACHE`, or else where the platform has caches (`XDG_CACHE_HOME` of the XDG Base Directory
    Specification; `~/Library/Caches` on macOS), or in the directory for temporary files if that is not writable. Other
    processes, such as game engines, find it by the same rule.
    """
    preferred = _home() / name
    with suppress(OSError):
        _home().mkdir(mode=0o700, parents=True, exist_ok=True)  # the mode is that of the last part only
        preferred.mkdir(mode=0o700, parents=True, exist_ok=True)
        if os.access(preferred, os.W_OK | os.X_OK):
            return preferred
    user = os.getuid() if hasattr(os, "getuid") else 0
    fallback = Path(tempfile.gettempdir()) / f"mindstage-{user}"
    fallback.mkdir(mode=0o700, parents=True, exist_ok=True)
    fallback /= name
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

    A symbolic link stays, and the file it leads to is replaced. A file keeps its permissions. What is no regular file,
    such as a pipe, is written to directly.

    Args:
        path: the file, in an existing directory.
        content: the whole content.
        durable: whether the file is also synchronized to disk, so that it survives a power failure.

    Raises:
        OSError: the file cannot be written; `filename` is the path. An existing file is unchanged.
    """
    part: Path | None = None
    try:
        target = path.resolve() if path.is_symlink() else path
        mode = _permissions(target)
        if mode is None and target.exists():
            path.write_bytes(content)  # not `target`: the name of a pipe cannot be opened
            return
        # In the same directory, since a rename is atomic only within one file system.
        part = target.with_name(f".{uuid4().hex}.part")
        with part.open("xb") as file:
            if mode is not None:
                os.chmod(part, mode)
            file.write(content)
            if durable:
                file.flush()
                os.fsync(file.fileno())
        part.replace(target)
        if durable and hasattr(os, "O_DIRECTORY"):  # the rename is part of the directory's data
            folder = os.open(target.parent, os.O_RDONLY | os.O_DIRECTORY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)
    except BaseException as error:
        if part is not None:
            with suppress(OSError):
                part.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise OSError(error.errno, error.strerror or str(error), str(path)) from error
        raise


@checked
def cached_content(path: Path, make: Callable[[], bytes], *, max_bytes: Index) -> bytes:
    """A file of the cache: read if an earlier run has made it, else made and stored, if the disk allows it.

    Args:
        path: the file, in a directory of its own kind; its name is a hash of all that the content depends on.
        make: returns the content.
        max_bytes: total size of the files with its suffix in its directory, from which the least recently used ones are
            deleted.
    """
    with suppress(OSError):
        content = path.read_bytes()
        os.utime(path)  # used most recently
        return content
    content = make()
    with suppress(OSError):  # a full or read-only disk: the next run makes it again
        atomic_write(path, content)
        if next(_stored) % _STORED_PER_SWEEP == 0:  # listing a large directory takes as long as making some files
            delete_least_recently_used(path, max_bytes=max_bytes)
    return content


@checked
def delete_least_recently_used(newest: Path, *, max_bytes: Index) -> None:
    """Deletes the least recently used files in a directory while their total size is too large.

    Args:
        newest: a file that stays; only files with its suffix are deleted.
        max_bytes: the total size that is allowed.

    Raises:
        OSError: the directory cannot be read.
    """
    found = [(entry.stat(), entry.path) for entry in os.scandir(newest.parent) if entry.name.endswith(newest.suffix)]
    total = sum(status.st_size for status, _ in found)
    for status, path in sorted(found, key=lambda each: each[0].st_mtime_ns):
        if total <= max_bytes:
            return
        if path != str(newest):
            with suppress(OSError):  # another process may have deleted it
                os.unlink(path)
            total -= status.st_size


def _permissions(path: Path) -> int | None:
    """The permissions of a regular file; None if there is none."""
    try:
        status = path.stat()
    except FileNotFoundError:
        return None
    return stat.S_IMODE(status.st_mode) if stat.S_ISREG(status.st_mode) else None


@contextmanager
@checked
def file_lock(path: Path, *, timeout_s: WallTime = _LOCK_TIMEOUT_S) -> Iterator[None]:
    """Excludes other processes and threads that lock the same path, during the `with` block.

    The lock is a file beside it, which is removed afterwards. The operating system releases it if the process ends.

    Args:
        path: the file to be changed, which need not exist.
        timeout_s: how long to wait for others [s].

    Raises:
        OSError: the lock was not available in time, or its file cannot be created; `filename` is the path.
    """
    lock = path.with_name(f".{path.name}.lock")
    end_s = time.monotonic() + timeout_s
    while (descriptor := _try_lock(path, lock)) is None:
        if time.monotonic() > end_s:
            cause = f"it is being written by another process, which has not finished within {timeout_s:g} s"
            raise OSError(errno.EAGAIN, cause, str(path))
        time.sleep(_LOCK_INTERVAL_S)
    try:
        yield
    finally:
        with suppress(OSError):  # Windows does not remove open files
            lock.unlink()
        os.close(descriptor)


def _try_lock(path: Path, lock: Path) -> int | None:
    """Locks the lock file, and returns its descriptor; None if another process has locked or has just removed it."""
    try:
        descriptor = os.open(lock, os.O_RDWR | os.O_CREAT, 0o600)
    except PermissionError as error:
        if sys.platform == "win32":  # being removed
            return None
        raise OSError(error.errno, error.strerror, str(path)) from error
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.path.samestat(os.fstat(descriptor), os.stat(lock)):
            return descriptor
    except OSError:
        pass
    os.close(descriptor)
    return None
