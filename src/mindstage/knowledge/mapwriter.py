"""Map files: a world as a semantic map of dialect 1, from which the same world is read again.

KnowRob and any RDF library can read them. Everything that a world holds is written: a value for which dialect 1 has no
word stands under a name of our own (see `vocabulary`), and facts and resources stand as they came.
"""

from __future__ import annotations

import os
from enum import Enum
from pathlib import Path
from uuid import uuid4

from mindstage.errors import MapUnwritable
from mindstage.knowledge.blocks import sections_of
from mindstage.knowledge.bulk import bulk_work
from mindstage.knowledge.prefixes import Names
from mindstage.knowledge.rdfxml import rdf_xml
from mindstage.knowledge.turtle import turtle
from mindstage.world import World

__all__ = ["MapFormat", "save_map", "write_map"]


class MapFormat(Enum):
    """How a map file is written."""

    RDF_XML = "rdf/xml"
    """What KnowRob reads; a few names and letters have no place in it."""
    TURTLE = "turtle"


_SUFFIXES = {
    ".owl": MapFormat.RDF_XML,
    ".rdf": MapFormat.RDF_XML,
    ".xml": MapFormat.RDF_XML,
    ".ttl": MapFormat.TURTLE,
}


def write_map(world: World, *, format: MapFormat = MapFormat.RDF_XML) -> str:
    """The text of a map file; the same for equal worlds.

    Raises:
        MapUnwritable: the world holds something that the format cannot, and the error says what.
    """
    with bulk_work():
        sections = sections_of(world)
        names = Names(world.iri, sections)
        return rdf_xml(sections, names) if format is MapFormat.RDF_XML else turtle(sections, names)


def save_map(world: World, path: str | os.PathLike[str]) -> None:
    """Writes a map file, in the format that the suffix stands for; it is there as a whole or not at all.

    Raises:
        MapUnwritable: the suffix stands for none, the world holds something that the format cannot, or the disk
            refuses.
    """
    path = Path(path)
    format = _SUFFIXES.get(path.suffix.lower())
    if format is None:
        remedy = f"use one of {', '.join(_SUFFIXES)}"
        raise MapUnwritable(str(path), cause=f"the suffix {path.suffix!r} stands for no format", remedy=remedy)
    text = write_map(world, format=format)
    try:
        _replace(path, text.encode())
    except OSError as error:
        raise MapUnwritable(str(path), cause=error.strerror or str(error)) from error
    except UnicodeEncodeError as error:
        letter = f"U+{ord(error.object[error.start]):04X}"
        raise MapUnwritable(str(path), cause=f"a text holds {letter}, which is half a letter") from error


def _replace(path: Path, content: bytes) -> None:
    # Beside the file, since only within one file system a file can take another's place at once.
    beside = path.with_name(f".{path.name}-{uuid4().hex}")
    try:
        beside.write_bytes(content)
        os.replace(beside, path)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise
