"""What a text from outside may name: files of granted folders and of packages, and nothing else.

Requests of clients are handled in the context `from_outside`; the command line and Python calls are outside of it, and
may name everything. Names are refused by their text alone, and a granted name of a file that a symbolic link puts
elsewhere is that of a missing file. Therefore no answer shows whether a file exists that is not granted.
"""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from urllib.parse import quote, unquote, unquote_to_bytes

from mindstage.access.limits import LISTED_FILES
from mindstage.errors import ResourceRefusedError, without_surrogates

__all__ = [
    "GrantedFolder",
    "from_outside",
    "is_granted",
    "is_inside",
    "is_outside_request",
    "require_granted",
    "values_without_paths",
    "without_paths",
]

_outside: ContextVar[bool] = ContextVar("outside", default=False)
_PACKAGE = "package://"
_UNREAL_CONTENT = "/Game/"
"""Begins the names of assets of the Unreal engine, which are looked up by their last part only."""
_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*:")
_UNSAFE = re.compile(r"[\x00-\x1f\x7f]")
_DECODING_STEPS = 4
_PATH = re.compile(r"""(?<![\w:/.~-])/(?:[^\s/'"`:,;()<>]+/)+[^\s/'"`:,;()<>]*""")


@contextmanager
def from_outside(outside: bool = True) -> Iterator[None]:
    """In the context, this thread handles the request of a client of a port."""
    token = _outside.set(outside)
    try:
        yield
    finally:
        _outside.reset(token)


def is_outside_request() -> bool:
    """Whether this thread handles the request of a client of a port."""
    return _outside.get()


def require_granted(names: Iterable[str | None], *, known: Collection[str | None] = ()) -> None:
    """Refuses names of files that a request from outside must not have; other callers may name everything.

    Args:
        names: names in a text; None and empty names are skipped.
        known: names that are used already, and so are granted.

    Raises:
        ResourceRefusedError: a name is absolute, leaves its folder, or is a URL other than `package://`.
    """
    if not is_outside_request():
        return
    for name in dict.fromkeys(names):
        if name and name not in known and not is_granted(name):
            raise ResourceRefusedError(name[:200])


def is_granted(name: str) -> bool:
    """Whether a text from outside may have a name of a file; decided by the text alone."""
    for _ in range(_DECODING_STEPS):
        decoded = unquote(name)
        if decoded == name:
            break
        name = decoded
    else:
        return False
    path = name.replace("\\", "/")
    for prefix in (_PACKAGE, _UNREAL_CONTENT):
        if path.startswith(prefix):
            path = path.removeprefix(prefix)
            break
    parts = path.split("/")
    return not (
        path.startswith("/") or _SCHEME.match(path) or _UNSAFE.search(path) or ".." in parts or path.startswith("~")
    )


def is_inside(path: Path, folder: Path) -> bool:
    """Whether a file, after symbolic links are resolved, is in a folder or below."""
    try:
        return path.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError, ValueError):  # a loop of symbolic links, or invalid characters
        return False


class GrantedFolder:
    """A folder whose files clients may name, by paths relative to it."""

    def __init__(self, folder: Path | None) -> None:
        """Grants a folder.

        Args:
            folder: the folder; None grants nothing.
        """
        self._folder = folder.resolve() if folder else None

    def find(self, name: str) -> Path | None:
        """The file of a name; None if there is none, or it is not in the folder."""
        if self._folder is None:
            return None
        name = name.removeprefix("file://")
        for each in dict.fromkeys((name, os.fsdecode(unquote_to_bytes(name)))):
            with suppress(OSError, RuntimeError, ValueError):
                path = (self._folder / each).resolve()
                if is_inside(path, self._folder) and path.is_file():
                    return path
        return None

    def files(self, suffixes: Collection[str]) -> Iterator[str]:
        """Yields the names of the files with one of some suffixes; bytes that are not UTF-8 are percent-encoded."""
        if self._folder is None:
            return
        found = (
            path
            for path in sorted(self._folder.rglob("*"))
            if path.suffix.lower() in suffixes and path.is_file() and is_inside(path, self._folder)
        )
        for _, path in zip(range(LISTED_FILES.count), found, strict=False):
            name = path.relative_to(self._folder).as_posix()
            yield name if name == without_surrogates(name) else quote(os.fsencode(name))


def values_without_paths(value: object, *, given: str = "") -> object:
    """The values of an error message for a client, in whose texts each path of this machine is its last part.

    Args:
        value: texts, numbers, and lists and mappings of them.
        given: the request; paths in it are kept.
    """
    match value:
        case str():
            return without_paths(value, given=given)
        case dict():
            return {key: values_without_paths(each, given=given) for key, each in value.items()}
        case list() | tuple():
            return [values_without_paths(each, given=given) for each in value]
    return value


def without_paths(text: str, *, given: str = "") -> str:
    """A text for a client, in which each path of this machine is its last part.

    Args:
        given: the request; paths in it are kept.
    """
    roots = {f"/{path.name}" for path in Path("/").iterdir()} if _PATH.search(text) else set()

    def shown(match: re.Match[str]) -> str:
        path, root = match[0], "/" + match[0].split("/")[1]
        return path.rstrip("/").rpartition("/")[2] if root in roots and path not in given else path

    return _PATH.sub(shown, text)
