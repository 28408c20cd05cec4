"""Formats of files in which worlds are read and written, those of installed packages included.

    BOXES = WorldFormat(suffixes=(".boxes",), title="Boxes", read=read_boxes, write=write_boxes)

A file that a format reads becomes a semantic map, so that it can be given wherever a map can.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mindstage.errors import SourceParseError
from mindstage.registry import Group, load_all

if TYPE_CHECKING:
    from mindstage.scene import GeometryMap, World

__all__ = ["MapFormat", "WorldFormat", "WrittenWorld", "read_with", "readable_suffixes"]


class MapFormat(StrEnum):
    """File formats of maps."""

    RDF_XML = "rdf/xml"
    """The format that KnowRob reads; it cannot represent some names and characters."""
    TURTLE = "turtle"


@dataclass(frozen=True, kw_only=True)
class WrittenWorld:
    """A world that is written to a file."""

    world: World
    path: Path
    fit: Callable[[], GeometryMap]
    find_mesh: Callable[[str], Path | None]
    """Finds the mesh files that the world names."""
    actuated: Sequence[Any] = ()
    """Its bodies with actuators: `mindstage.engines.actuators.ActuatedBodies`."""
    godot: Path | None = None
    """The Godot executable; None for the one on PATH, or in a common location."""

    @cached_property
    def geometry(self) -> GeometryMap:
        """The geometry of its bodies, which takes a while to compute."""
        return self.fit()


@dataclass(frozen=True, kw_only=True)
class WorldFormat:
    """A format of files; the entry points `mindstage.formats` name these."""

    suffixes: tuple[str, ...]
    """In lower case, with the point."""
    title: str
    """For menus."""
    media_type: str = "application/octet-stream"
    syntax: MapFormat | None = None
    """That of a semantic map, which is lossless and has a dialect; None for other formats."""
    write: Callable[[WrittenWorld], Iterable[str]] | None = None
    """Writes a world completely or not at all, and returns notes, one sentence each, on what it cannot express.

    Raises:
        MapWriteError: the format cannot express the world, or the file cannot be written.
    """
    read: Callable[[Path], World] | None = None
    """Reads a file as a world.

    Raises:
        SourceParseError: it is not of this format.
    """


def readable_suffixes() -> dict[str, WorldFormat]:
    """The formats that read files themselves, by suffix; semantic maps and robot descriptions are not among them."""
    found: dict[str, WorldFormat] = {}
    for each in load_all(Group.FORMATS, WorldFormat).values():
        if each.read is not None:
            found = dict.fromkeys(each.suffixes, each) | found
    return found


def read_with(format: WorldFormat, path: Path) -> World:
    """Reads a file of a format.

    Raises:
        SourceParseError: it does not exist, or is not of this format.
    """
    assert format.read is not None
    try:
        return format.read(path)
    except SourceParseError:
        raise
    except Exception as error:  # of another package
        raise SourceParseError(str(path), cause=f"{format.title}: {error}") from error
