"""Packages: where the files are that imports name."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from glob import escape
from pathlib import Path, PurePosixPath
from urllib.parse import unquote, urlsplit

__all__ = ["RosPackagePath", "file_from_iri"]

_SCHEME = "package://"


class RosPackagePath:
    """Folders that hold ROS packages, searched in the order that they were given."""

    def __init__(self, folders: Iterable[Path] = ()) -> None:
        self.folders = tuple(dict.fromkeys(folder.resolve() for folder in folders))
        self._cache: dict[str, Path | None] = {}

    def find(self, iri: str) -> Path | None:
        """The file that `package://NAME/rest` names, or None where no folder has it.

        A package lies directly in one of the folders, or up to two levels deeper, or the folder is the package.

        Raises:
            ValueError: the name leads out of its package.
        """
        if iri not in self._cache:
            self._cache[iri] = self._search_file(iri)
        return self._cache[iri]

    def package_folder(self, name: str) -> Path | None:
        """The folder of a package, or None where no folder has one of that name."""
        if not name or name == ".." or "/" in name:
            return None
        homes = (home for folder in self.folders for home in _package_folders(folder, name))
        return next((home for home in homes if home.is_dir()), None)

    def _search_file(self, iri: str) -> Path | None:
        name, *rest = PurePosixPath(unquote(iri.removeprefix(_SCHEME))).parts or ("",)
        if name in {"", "/", ".."} or ".." in rest or not rest:
            raise ValueError("it leads out of every package")
        for folder in self.folders:
            for package in _package_folders(folder, name):
                path = package.joinpath(*rest)
                if path.is_file():
                    return path.resolve()
        return None


def _package_folders(folder: Path, name: str) -> Iterator[Path]:
    yield folder / name
    if folder.name == name:
        yield folder
    for level in ("*", "*/*"):
        yield from sorted(path.parent for path in folder.glob(f"{level}/{escape(name)}/package.xml"))


def file_from_iri(iri: str, importer: Path) -> Path | None:
    """The file that a `file:` IRI names, relative to whoever imports it; None for files of other machines, or none."""
    try:
        parts = urlsplit(iri)
        if parts.netloc not in {"", "localhost"}:
            return None
        return (importer.parent / unquote(parts.path)).resolve()
    except (OSError, RuntimeError, ValueError):
        return None  # no path has such letters, or its links lead round in a circle
