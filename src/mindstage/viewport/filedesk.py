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

from mindstage.errors import ArgumentRefused, MapMissing
from mindstage.knowledge import KnowledgeBase, MapDialect, MapFormat, Origin, write_map
from mindstage.stage import Stage
from mindstage.viewport.channel import Channel
from mindstage.viewport.visitor import Visitor
from mindstage.world import World

__all__ = ["FileDesk"]

_SUFFIXES = (".owl", ".rdf", ".xml", ".ttl", ".urdf")
_MOST_LETTERS = 20_000_000
_TYPES = {MapFormat.RDF_XML: (".owl", "application/rdf+xml"), MapFormat.TURTLE: (".ttl", "text/turtle")}


class Save(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Asks for the world as a map."""

    format: MapFormat = MapFormat.RDF_XML
    dialect: MapDialect | None = None
    """None is that of the map that was spawned, where there is one."""


class Load(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A map from a visitor's disk."""

    name: Annotated[str, msgspec.Meta(max_length=300)]
    text: Annotated[str, msgspec.Meta(max_length=_MOST_LETTERS)]


class FileDesk:
    """Writes maps for visitors, and reads theirs."""

    def __init__(self, stage: Stage, channel: Channel) -> None:
        """Offers what it does."""
        self._stage, self._channel = stage, channel
        self._loaded: KnowledgeBase | None = None
        channel.offer("save", Save, self._save, lane="files")
        channel.offer("load", Load, self._load, lane="files")

    def _save(self, _: Visitor, wish: Save) -> dict[str, str]:
        world = self._stage.log()
        origin = self._origin(world) if wish.dialect is None else None
        dialect = wish.dialect or MapDialect.SEMLOG
        text = write_map(world, format=wish.format, dialect=dialect, origin=origin)
        suffix, kind = _TYPES[wish.format]
        return {"name": f"{_plain(world.name) or 'map'}{suffix}", "type": kind, "text": text}

    def _origin(self, world: World) -> Origin | None:
        try:
            return self._stage.knowledge.origin(world.iri)
        except MapMissing:
            return None  # it was never a map: it is written in our own words

    def _load(self, _: Visitor, wish: Load) -> dict[str, object]:
        knowledge, world = self._read(wish)
        playing, speed = self._stage.frame.playing, self._stage.frame.speed
        self._stage.learn(knowledge)
        before, self._loaded = self._loaded, knowledge
        report = self._stage.spawn(world)
        if before is not None:
            before.close()
        if playing:
            self._stage.play(speed=speed)
        failed = (*report.failed_bodies, *report.failed_constraints, *report.failed_attachments)
        return {
            "name": world.name,
            "bodies": report.bodies,
            "joints": report.constraints,
            "failed": [{"id": each.id, "reason": each.reason} for each in failed[:50]],
            "findings": len(knowledge.findings()),
        }

    def _read(self, wish: Load) -> tuple[KnowledgeBase, World]:
        """What a text says, beside what is known of classes.

        Raises:
            ArgumentRefused: it is no map by its name, or wants other files to be read.
            KnowledgeError: it cannot be read, or no map is in it.
        """
        suffix = Path(wish.name).suffix.lower()
        if suffix not in _SUFFIXES:
            raise ArgumentRefused(wish.name, cause=f"a map ends in {', '.join(_SUFFIXES)}")
        if "xacro" in wish.text:
            raise ArgumentRefused(wish.name, cause="xacro reads other files; expand it first")
        knowledge = self._stage.knowledge.without_maps()
        folder = TemporaryDirectory(prefix="mindstage-")
        # The text is read again when the map is written in its own words, so it stays as long as what is known of it.
        weakref.finalize(knowledge, folder.cleanup)
        try:
            path = Path(folder.name, f"{_plain(Path(wish.name).stem) or 'map'}{suffix}")
            path.write_text(wish.text, encoding="utf-8")
            knowledge.load(path, follow_imports=False)
            world = knowledge.world()
            for body in world.bodies:
                if body.mesh and _leads_away(body.mesh):
                    cause = f"the mesh of {body.id!r} is named by its place on a disk, and a page may read no disk"
                    raise ArgumentRefused(wish.name, cause=cause, remedy="spawn such a map from the command line")
            return knowledge, world
        except BaseException:
            knowledge.close()
            raise


def _leads_away(name: str) -> bool:
    """Whether a mesh's name is a path of its own, not one in a package or in a folder that somebody opened."""
    parts = urlsplit(unquote(name).replace("\\", "/"))
    return (
        parts.scheme == "file"
        or (parts.path.startswith("/") and parts.scheme != "package")
        or ".." in parts.path.split("/")
    )


def _plain(name: str) -> str:
    """A file's name with nothing in it but letters and digits."""
    return re.sub(r"[^A-Za-z0-9._-]+", "-", name).strip("-.")[:80]
