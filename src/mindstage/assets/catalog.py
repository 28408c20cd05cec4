"""Catalog: which mesh file is meant, among all those in some folders.

Maps name meshes as their makers did: by a path in somebody's package, by the name of an Unreal asset with or without
its `SM_`, or not at all. So a file is looked for by path, then by name, then by the name of the class; neither case
nor prefix counts.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path, PurePosixPath
from typing import NamedTuple
from urllib.parse import unquote

from mindstage.world import Body

__all__ = ["SUFFIXES", "MeshIndex", "MeshMatch"]

SUFFIXES = (".glb", ".gltf", ".obj", ".dae", ".stl")
"""What can be read; of several files of one name the earliest of these, since it says most about looks."""
_MAX_FILES = 200_000
"""A folder with more is no folder of meshes."""


class MeshMatch(NamedTuple):
    """A file, and by what it was found."""

    path: Path
    matched_by: str


class MeshIndex:
    """The mesh files in some folders."""

    def __init__(self, folders: Iterable[Path], *, find_file: Callable[[str], Path | None] = lambda name: None) -> None:
        """Looks through the folders, once.

        Args:
            folders: searched with all that is below them; what an earlier one has comes first.
            find_file: the file that a map's own name stands for, such as `package://…`.
        """
        self.notes: list[str] = []
        self._find_file = find_file
        self._by_path: dict[str, Path] = {}
        self._by_name: dict[str, list[Path]] = {}
        for folder in folders:
            self._index_folder(folder)

    def find(self, body: Body) -> MeshMatch | None:
        """The file for a body, if there is one."""
        if body.mesh:
            told = self._find_file(body.mesh)
            if told is not None and told.suffix.lower() in SUFFIXES:
                return MeshMatch(told, "path")
            if (path := self._find_by_path(body.mesh)) is not None:
                return MeshMatch(path, "path")
            if (path := self._find_by_name(PurePosixPath(body.mesh.replace("\\", "/")).name)) is not None:
                return MeshMatch(path, "name")
        local = body.cls.rpartition("#")[2].rpartition("/")[2]
        path = self._find_by_name(local)
        return None if path is None else MeshMatch(path, "class")

    def _index_folder(self, folder: Path) -> None:
        for count, path in enumerate(_files(folder)):
            if count == _MAX_FILES:
                self.notes.append(f"{folder} has more than {_MAX_FILES} files: only so many were looked at")
                return
            if path.suffix.lower() in SUFFIXES:
                self._by_path.setdefault(path.relative_to(folder).as_posix().lower(), path)
                self._by_name.setdefault(_normalized_name(path.name), []).append(path)

    def _find_by_path(self, name: str) -> Path | None:
        """The file whose path ends as the name does: of `package://a/merged_meshes/b.dae` first all, then `b.dae`'s folder."""
        parts = [
            part for part in unquote(name.partition("://")[2] or name).replace("\\", "/").lower().split("/") if part
        ]
        for start in range(len(parts) - 1):
            if (path := self._by_path.get("/".join(parts[start:]))) is not None:
                return path
        return None

    def _find_by_name(self, name: str) -> Path | None:
        paths = self._by_name.get(_normalized_name(name))
        if not paths:
            return None
        return min(paths, key=lambda path: SUFFIXES.index(path.suffix.lower()))


def _files(folder: Path) -> Iterator[Path]:
    """All files below a folder, in an order that is the same everywhere; links to folders are not followed."""
    for where, below, files in os.walk(folder):
        below.sort()
        for file in sorted(files):
            yield Path(where, file)


def _normalized_name(name: str) -> str:
    """A name without what makers of meshes put before and behind it."""
    plain = name.lower()
    for suffix in SUFFIXES:
        plain = plain.removesuffix(suffix)
    return plain.removeprefix("sm_")
