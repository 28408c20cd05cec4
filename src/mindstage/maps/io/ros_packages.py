"""Resolution of `package://` and `file:` IRIs to files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from glob import escape
from pathlib import Path, PurePosixPath
from urllib.parse import unquote, urlsplit

__all__ = ["RosPackagePath", "file_from_iri"]

_SCHEME = "package://"


class RosPackagePath:
    """Folders that contain ROS packages, searched in the given order."""

    def __init__(self, folders: Iterable[Path] = ()) -> None:
        self.folders = tuple(dict.fromkeys(folder.resolve() for folder in folders))
        self._cache: dict[str, Path | None] = {}

    def find(self, iri: str) -> Path | None:
        """Returns the file of a `package://NAME/path` IRI, or None if no folder contains it.

        A package is one of the folders, or lies in one of them, at most two levels deeper.

        Raises:
            ValueError: the path is outside of the package.
        """
        if iri not in self._cache:
            self._cache[iri] = self._search_file(iri)
        return self._cache[iri]

    def package_folder(self, name: str) -> Path | None:
        """Returns the folder of a package, or None if no folder contains a package of that name."""
        if not name or name == ".." or "/" in name:
            return None
        candidates = (each for folder in self.folders for each in _package_folders(folder, name))
        return next((each for each in candidates if each.is_dir()), None)

    def _search_file(self, iri: str) -> Path | None:
        name, *rest = PurePosixPath(unquote(iri.removeprefix(_SCHEME))).parts or ("",)
        if name in {"", "/", ".."} or ".." in rest or not rest:
            raise ValueError("its path is outside of every package")
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
    """Returns the path of a `file:` IRI relative to the importing file; None for other hosts and invalid paths."""
    try:
        parts = urlsplit(iri)
        if parts.netloc not in {"", "localhost"}:
            return None
        return (importer.parent / unquote(parts.path)).resolve()
    except (OSError, RuntimeError, ValueError):
        return None  # invalid characters, or a loop of symbolic links
