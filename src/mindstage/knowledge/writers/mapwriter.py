"""Map files: a world as a semantic map, from which the same world is read again.

KnowRob and any RDF library can read them. Everything that a world holds is written, in whichever dialect: a value for
which it has no word stands under dialect 1's or a name of our own (see `vocabulary`), and facts and resources stand as
they came.
"""

from __future__ import annotations

import os
from enum import StrEnum
from pathlib import Path

from mindstage.errors import MapUnwritable
from mindstage.files import atomic_write
from mindstage.knowledge.bulk import bulk_work
from mindstage.knowledge.reading.origin import Origin
from mindstage.knowledge.wording.blocks import sections_of
from mindstage.knowledge.wording.prefixes import Names
from mindstage.knowledge.writers.own_words import in_own_words
from mindstage.knowledge.writers.rdfxml import rdf_xml
from mindstage.knowledge.writers.soma import in_soma
from mindstage.knowledge.writers.turtle import turtle
from mindstage.world import World

__all__ = ["MapDialect", "MapFormat", "save_file", "save_map", "write_map"]


class MapDialect(StrEnum):
    """In whose words any world can be written."""

    SEMLOG = "semlog"
    """Those of 2019, with physics: what KnowRob's plugins for game engines read."""
    SOMA = "soma"
    """Those of KnowRob 2; what it has no words for is told in SemLog's."""


class MapFormat(StrEnum):
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


def write_map(
    world: World,
    *,
    format: MapFormat = MapFormat.RDF_XML,
    dialect: MapDialect = MapDialect.SEMLOG,
    origin: Origin | None = None,
) -> str:
    """The text of a map file; the same for equal worlds.

    Args:
        world: what is written.
        format: how.
        dialect: in whose words.
        origin: the map that the world came from, in whose own words it is written then, whatever the dialect.

    Raises:
        MapUnwritable: the world holds something that the format cannot, and the error says what.
    """
    return _written(world, format, dialect, origin)[0]


def save_map(
    world: World,
    path: str | os.PathLike[str],
    *,
    format: MapFormat | None = None,
    dialect: MapDialect = MapDialect.SEMLOG,
    origin: Origin | None = None,
) -> tuple[str, ...]:
    """Writes a map file; it is there as a whole or not at all.

    Args:
        world: what is written.
        path: where to.
        format: how; None for that which the suffix stands for.
        dialect: in whose words.
        origin: the map that the world came from, in whose own words it is written then, whatever the dialect.

    Returns:
        What could not be said in those words, and is said in others, in sentences.

    Raises:
        MapUnwritable: the suffix stands for none, the world holds something that the format cannot, or the disk
            refuses.
    """
    path = Path(path)
    format = format or _SUFFIXES.get(path.suffix.lower())
    if format is None:
        remedy = f"use one of {', '.join(_SUFFIXES)}"
        raise MapUnwritable(str(path), cause=f"the suffix {path.suffix!r} stands for no format", remedy=remedy)
    text, notes = _written(world, format, dialect, origin)
    try:
        content = text.encode()
    except UnicodeEncodeError as error:
        letter = f"U+{ord(error.object[error.start]):04X}"
        raise MapUnwritable(str(path), cause=f"a text holds {letter}, which is half a letter") from error
    save_file(path, content)
    return notes


def save_file(path: Path, content: bytes) -> None:
    """Writes a file, which replaces an existing one only once it is complete.

    Raises:
        MapUnwritable: the file system does not allow it.
    """
    try:
        atomic_write(path, content)
    except OSError as error:
        raise MapUnwritable(str(path), cause=error.strerror or str(error)) from error


def _written(
    world: World, format: MapFormat, dialect: MapDialect, origin: Origin | None
) -> tuple[str, tuple[str, ...]]:
    with bulk_work():
        sections = sections_of(world)
        notes: tuple[str, ...] = ()
        if origin is not None:
            sections, notes = in_own_words(world, sections, origin)
        elif dialect is MapDialect.SOMA:
            sections, notes = in_soma(world, sections)
        names = Names(world.iri, sections)
        return (rdf_xml if format is MapFormat.RDF_XML else turtle)(sections, names), notes
