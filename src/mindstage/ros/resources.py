"""Resources: the worlds and things that can be asked for by name, and those that come as text.

A name is that of a known map, or of a file in the folder that whoever serves has opened; no name leads out of it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from enum import Enum, auto
from pathlib import Path
from tempfile import TemporaryDirectory

from mindstage.errors import KnowledgeError
from mindstage.knowledge import KnowledgeBase
from mindstage.knowledge.names import local_name
from mindstage.world import Body, World

__all__ = ["FORMATS", "ResourceError", "ResourceErrorType", "ResourceLoader"]

FORMATS = {".owl": "owl", ".rdf": "rdf", ".ttl": "ttl", ".urdf": "urdf"}
"""What can be read, by the end of a file's name."""
_MAX_FILES = 1000


class ResourceErrorType(Enum):
    """Why a resource cannot be had."""

    NOT_FOUND = auto()
    UNSUPPORTED_FORMAT = auto()
    PARSE_ERROR = auto()


class ResourceError(Exception):
    """A resource cannot be had."""

    def __init__(self, type: ResourceErrorType, text: str) -> None:
        self.type = type
        super().__init__(text)


class ResourceLoader:
    """Finds and reads."""

    def __init__(self, knowledge: KnowledgeBase, folder: Path | None) -> None:
        """Nothing is read yet.

        Args:
            knowledge: whose maps are known.
            folder: what may be read beside them; None is nothing.
        """
        self.knowledge = knowledge
        self._folder = folder.resolve() if folder else None

    def files(self) -> Iterator[str]:
        """The names of all files that can be read, below the folder."""
        if self._folder is None:
            return
        found = (
            path
            for path in sorted(self._folder.rglob("*"))
            if path.suffix.lower() in FORMATS and self._is_inside_folder(path)
        )
        for _, path in zip(range(_MAX_FILES), found, strict=False):
            yield path.relative_to(self._folder).as_posix()

    def known_bodies(self) -> Iterator[Body]:
        """What stands in the known maps, each of which can be spawned once more."""
        for map in self.knowledge.maps():
            yield from self.knowledge.world(map).bodies

    def find_body(self, name: str) -> tuple[World, Body] | None:
        """The body of that IRI or id, and the world of its map; None where no map has it."""
        for map in self.knowledge.maps():
            world = self.knowledge.world(map)
            for body in world.bodies:
                if name in {body.iri, body.id}:
                    return world, body
        return None

    def load_world(self, uri: str, text: str = "") -> World:
        """The world that a name or a text means; a name goes before.

        Raises:
            ResourceError: it cannot be had.
        """
        if uri:
            maps = self.knowledge.maps()
            if uri in maps or uri in map(local_name, maps):
                return self._read(self.knowledge, uri)
            return self._read_file(self._path(uri))
        if not text.strip():
            raise ResourceError(ResourceErrorType.NOT_FOUND, "neither an address nor a text is given")
        if "xacro" in text:
            raise ResourceError(
                ResourceErrorType.UNSUPPORTED_FORMAT,
                "a text that came from elsewhere may not have xacro read other files",
            )
        with TemporaryDirectory(prefix="mindstage-") as folder:
            path = Path(folder, f"resource{_guess_suffix(text)}")
            path.write_text(text, encoding="utf-8")
            return self._read_file(path, follow_imports=False)

    def _path(self, uri: str) -> Path:
        name = uri.removeprefix("file://")
        known = ", ".join([*map(local_name, self.knowledge.maps()), *self.files()][:10]) or "nothing"
        if self._folder is None:
            raise ResourceError(
                ResourceErrorType.NOT_FOUND, f"no map {uri!r} is known, and no folder is open; there is {known}"
            )
        path = (self._folder / name).resolve()
        if not self._is_inside_folder(path):
            raise ResourceError(ResourceErrorType.NOT_FOUND, f"nothing is called {uri!r} here; there is {known}")
        if path.suffix.lower() not in FORMATS:
            raise ResourceError(
                ResourceErrorType.UNSUPPORTED_FORMAT, f"{path.name} ends like none of {', '.join(FORMATS)}"
            )
        return path

    def _is_inside_folder(self, path: Path) -> bool:
        """Whether it is a file that lies in the folder, and is no link out of it."""
        return self._folder is not None and path.is_file() and path.resolve().is_relative_to(self._folder)

    def _read_file(self, path: Path, *, follow_imports: bool = True) -> World:
        with KnowledgeBase() as knowledge:
            try:
                knowledge.load(path, follow_imports=follow_imports)
            except KnowledgeError as error:
                raise ResourceError(ResourceErrorType.PARSE_ERROR, str(error)) from error
            return self._read(knowledge, None)

    @staticmethod
    def _read(knowledge: KnowledgeBase, map: str | None) -> World:
        try:
            return knowledge.world(map)
        except KnowledgeError as error:
            raise ResourceError(ResourceErrorType.PARSE_ERROR, str(error)) from error


def _guess_suffix(text: str) -> str:
    """How the name of a file with that text would end."""
    if re.search(r"<robot[\s>]", text[:10_000]):
        return ".urdf"
    return ".owl" if text.lstrip().startswith("<") and "<rdf:RDF" in text else ".ttl"
