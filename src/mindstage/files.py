"""The user's cache directory, atomic file writing, and file locks."""

from __future__ import annotations

import atexit
import errno
import os
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from itertools import count
from pathlib import Path
from uuid import uuid4

from mindstage.ranges import Index, WallTime, checked

__all__ = [
    "atomic_file",
    "atomic_folder",
    "atomic_write",
    "cache_dir",
    "cached_content",
    "delete_least_recently_used",
    "file_lock",
    "home_folder",
    "is_own_folder",
    "modules_of",
]

_LOCK_TIMEOUT_S = 30.0
_FILES_PER_SWEEP = 50
_stored = count()
_LOCK_INTERVAL_S = 0.02
"""The time between two attempts to lock a file [s]."""


def cache_dir(name: str = "") -> Path:
    """The directory of that name in Mindstage's cache, created if needed.

    The cache is at `MINDSTAGE_CACHE`, or else where the platform has caches (`XDG_CACHE_HOME` of the XDG Base Directory
    Specification; `~/Library/Caches` on macOS), or in the directory for temporary files if that is not writable. Other
    processes, such as game engines, find it by the same rule.
    """
    with suppress(OSError):
        preferred = _home() / name
        _home().mkdir(mode=0o700, parents=True, exist_ok=True)  # the mode is that of the last part only
        preferred.mkdir(mode=0o700, parents=True, exist_ok=True)
        if os.access(preferred, os.W_OK | os.X_OK):
            return preferred
    fallback = _private_folder(Path(tempfile.gettempdir())) / name
    fallback.mkdir(mode=0o700, parents=True, exist_ok=True)
    return fallback


def _private_folder(parent: Path) -> Path:
    """A folder that belongs to the user, and that no one else can read or change, in one that all users write to.

    Anyone can make a folder of the expected name there; then another name is taken, which differs in each process.
    """
    if not hasattr(os, "getuid"):  # the folder of temporary files is the user's own
        folder = parent / "mindstage"
        folder.mkdir(exist_ok=True)
        return folder
    folder = parent / f"mindstage-{os.getuid()}"
    with suppress(FileExistsError):
        folder.mkdir(mode=0o700)
    if is_own_folder(folder):
        return folder
    return _folder_of_process(parent)


@cache
def _folder_of_process(parent: Path) -> Path:
    folder = Path(tempfile.mkdtemp(prefix=f"mindstage-{os.getuid()}-", dir=parent))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def is_own_folder(folder: Path) -> bool:
    """Whether a path is a folder of this user, no link, which is then made private: mode 0700."""
    try:
        status = folder.lstat()
        if hasattr(os, "getuid") and (not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid()):
            return False
        if status.st_mode & 0o077:
            folder.chmod(0o700)
    except OSError:
        return False
    return True


def _home() -> Path:
    """Where the cache is.

    Raises:
        OSError: the user has no home directory.
    """
    if configured := os.environ.get("MINDSTAGE_CACHE"):
        return Path(configured).absolute()
    configured = os.environ.get("XDG_CACHE_HOME", "")
    if os.path.isabs(configured):
        return Path(configured) / "mindstage"
    home = home_folder()
    if home is None:
        raise FileNotFoundError(errno.ENOENT, "the user has no home directory", "~")
    return home / ("Library/Caches" if sys.platform == "darwin" else ".cache") / "mindstage"


def modules_of(package: Path, folders: Iterable[str]) -> list[tuple[str, int, int]]:
    """The paths, sizes and times of the modules in some folders of a package: keys for what they compute.

    One of them has the version, and developers change the others.
    """
    files = [entry for folder in folders for entry in os.scandir(package / folder) if entry.name.endswith(".py")]
    return sorted((entry.path, entry.stat().st_size, entry.stat().st_mtime_ns) for entry in files)


def home_folder() -> Path | None:
    """The user's home directory; None without `HOME` and without an entry in the list of users, as in containers."""
    try:
        home = Path.home()
    except RuntimeError:
        return None
    return home if home.is_absolute() else None


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
    with atomic_file(path, durable=durable) as part, part.open("wb") as file:
        file.write(content)


@contextmanager
def atomic_file(path: Path, *, durable: bool = False) -> Iterator[Path]:
    """Yields the path of an empty file to be written, which replaces another one at the end of the `with` block.

    After an error nothing is left of it. See `atomic_write`.

    Raises:
        OSError: the file cannot be written, here or in the `with` block; `filename` is the path.
    """
    part: Path | None = None
    try:
        target = path.resolve() if path.is_symlink() else path
        mode = _permissions(target)
        if mode is None and target.exists():
            yield path  # not `target`: the name of a pipe cannot be opened
            return
        # In the same directory, since a rename is atomic only within one file system.
        part = target.with_name(f".{uuid4().hex}.part")
        part.touch(exist_ok=False, mode=0o666 if mode is None else 0o600)  # nobody opens it before it has its mode
        if mode is not None:
            os.chmod(part, mode)
        yield part
        if durable:
            _synchronize(part, os.O_RDWR)
        part.replace(target)
        if durable and hasattr(os, "O_DIRECTORY"):  # the rename is part of the directory's data
            _synchronize(target.parent, os.O_RDONLY | os.O_DIRECTORY)
    except BaseException as error:
        if part is not None:
            with suppress(OSError):
                part.unlink(missing_ok=True)
        if isinstance(error, OSError) and error.filename in (None, str(part), str(path)):
            raise OSError(error.errno, error.strerror or str(error), str(path)) from error
        raise


@contextmanager
def atomic_folder(path: Path) -> Iterator[Path]:
    """Yields an empty folder to be filled, whose files are those of another folder at the end of the `with` block.

    After an error nothing is left of it. Other files of an existing folder stay.

    Args:
        path: the folder, in a directory that exists or is created.

    Raises:
        OSError: the folder cannot be written, here or in the `with` block.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{uuid4().hex}.part")
    part.mkdir()
    try:
        yield part
        if not path.exists():
            part.replace(path)
            return
        for file in sorted(each for each in part.rglob("*") if not each.is_dir()):
            target = path / file.relative_to(part)
            target.parent.mkdir(parents=True, exist_ok=True)
            file.replace(target)
    except OSError as error:
        if error.filename is None or str(part) in str(error.filename):
            name = path if error.filename is None else str(error.filename).replace(str(part), str(path))
            raise OSError(error.errno, error.strerror or str(error), str(name)) from error
        raise
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _synchronize(path: Path, flags: int) -> None:
    """Waits until a file or a folder is on the disk."""
    descriptor = os.open(path, flags)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


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
        if next(_stored) % _FILES_PER_SWEEP == 0:  # listing a large directory takes as long as making some files
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
    """Excludes others that lock the same path, until the `with` block ends or the file is replaced.

    The file itself is locked, and is created empty for that; it is removed if it still is empty at the end. On Windows,
    which does not replace open files, another file is locked, and removed afterwards. The operating system releases the
    lock if the process ends.

    Args:
        path: the file to be changed, which need not exist.
        timeout_s: how long to wait for others [s].

    Raises:
        OSError: the lock was not available in time, or the file cannot be created; `filename` is the path.
    """
    lock = path.with_name(f".{path.name}.lock") if sys.platform == "win32" else path
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
            status = os.fstat(descriptor)
            if lock != path or (status.st_size == 0 and os.path.samestat(status, os.stat(lock))):
                lock.unlink()
        os.close(descriptor)


def _try_lock(path: Path, lock: Path) -> int | None:
    """Locks a file, and returns its descriptor; None if another process has locked, removed or replaced it."""
    try:
        descriptor = os.open(lock, (os.O_RDWR if os.access(lock, os.W_OK) else os.O_RDONLY) | os.O_CREAT, 0o666)
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
