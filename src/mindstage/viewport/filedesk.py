"""File desk: a world goes to the visitor as a map, and a visitor's map becomes the world.

What comes from a page is a stranger's: it has a limit, no other file is read whatever it imports, and nothing in it is
run. It is read before anything is cleared, so that a map that cannot be read changes nothing.
"""

from __future__ import annotations

import re
import weakref
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated
from urllib.parse import unquote, urlsplit

import msgspec

from mindstage.errors import InvalidArgumentError, MapNotFoundError
from mindstage.knowledge import KnowledgeBase, MapDialect, MapFormat, SourceMapView, write_map
from mindstage.stage import Simulation
from mindstage.viewport.channel import RpcChannel
from mindstage.viewport.visitor import ClientSession
from mindstage.world import World

__all__ = ["FileHandler"]

_SUFFIXES = (".owl", ".rdf", ".xml", ".ttl", ".urdf")
_MAX_TEXT_LENGTH = 20_000_000
_TYPES = {MapFormat.RDF_XML: (".owl", "application/rdf+xml"), MapFormat.TURTLE: (".ttl", "text/turtle")}


class SaveRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Asks for the world as a map."""

    format: MapFormat = MapFormat.RDF_XML
    dialect: MapDialect | None = None
    """None is that of the map that was spawned, where there is one."""


class LoadRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A map from a visitor's disk."""

    name: Annotated[str, msgspec.Meta(max_length=300)]
    text: Annotated[str, msgspec.Meta(max_length=_MAX_TEXT_LENGTH)]


class FileHandler:
    """Writes maps for visitors, and reads theirs."""

    def __init__(self, simulation: Simulation, channel: RpcChannel) -> None:
        """Offers what it does."""
        self._simulation, self._channel = simulation, channel
        self._loaded: KnowledgeBase | None = None
        channel.register("save", SaveRequest, self._save, queue="files")
        channel.register("load", LoadRequest, self._load, queue="files")

    def _save(self, _: ClientSession, request: SaveRequest) -> dict[str, str]:
        world = self._simulation.snapshot()
        origin = self._origin(world) if request.dialect is None else None
        dialect = request.dialect or MapDialect.SEMLOG
        text = write_map(world, format=request.format, dialect=dialect, source_view=origin)
        suffix, kind = _TYPES[request.format]
        return {"name": f"{_safe_filename(world.name) or 'map'}{suffix}", "type": kind, "text": text}

    def _origin(self, world: World) -> SourceMapView | None:
        try:
            return self._simulation.knowledge.source_view(world.iri)
        except MapNotFoundError:
            return None  # it was never a map: it is written in our own words

    def _load(self, _: ClientSession, request: LoadRequest) -> dict[str, object]:
        knowledge, world = self._read(request)
        playing, speed = self._simulation.state.playing, self._simulation.state.speed
        self._simulation.set_knowledge(knowledge)
        before, self._loaded = self._loaded, knowledge
        report = self._simulation.spawn(world)
        if before is not None:
            before.close()
        if playing:
            self._simulation.play(speed=speed)
        failed = (*report.failed_bodies, *report.failed_joints, *report.failed_attachments)
        return {
            "name": world.name,
            "bodies": report.bodies,
            "joints": report.joints,
            "failed": [{"id": each.id, "reason": each.reason} for each in failed[:50]],
            "findings": len(knowledge.findings()),
        }

    def _read(self, request: LoadRequest) -> tuple[KnowledgeBase, World]:
        """What a text says, beside what is known of classes.

        Raises:
            InvalidArgumentError: it is no map by its name, or wants other files to be read.
            KnowledgeError: it cannot be read, or no map is in it.
        """
        suffix = Path(request.name).suffix.lower()
        if suffix not in _SUFFIXES:
            raise InvalidArgumentError(request.name, cause=f"a map ends in {', '.join(_SUFFIXES)}")
        if "xacro" in request.text:
            raise InvalidArgumentError(request.name, cause="xacro reads other files; expand it first")
        knowledge = self._simulation.knowledge.ontologies_only()
        folder = TemporaryDirectory(prefix="mindstage-")
        # The text is read again when the map is written in its own words, so it stays as long as what is known of it.
        weakref.finalize(knowledge, folder.cleanup)
        try:
            path = Path(folder.name, f"{_safe_filename(Path(request.name).stem) or 'map'}{suffix}")
            path.write_text(request.text, encoding="utf-8")
            knowledge.load(path, follow_imports=False)
            world = knowledge.world()
            for body in world.bodies:
                if body.mesh and _is_outside_path(body.mesh):
                    cause = f"the mesh of {body.id!r} is named by its place on a disk, and a page may read no disk"
                    raise InvalidArgumentError(
                        request.name, cause=cause, remedy="spawn such a map from the command line"
                    )
            return knowledge, world
        except BaseException:
            knowledge.close()
            raise


def _is_outside_path(name: str) -> bool:
    """Whether a mesh's name is a path of its own, not one in a package or in a folder that somebody opened."""
    parts = urlsplit(unquote(name).replace("\\", "/"))
    return (
        parts.scheme == "file"
        or (parts.path.startswith("/") and parts.scheme != "package")
        or ".." in parts.path.split("/")
    )


def _safe_filename(name: str) -> str:
    """A file's name with nothing in it but letters and digits."""
    return re.sub(r"[^A-Za-z0-9._-]+", "-", name).strip("-.")[:80]
