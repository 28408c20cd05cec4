"""Map files: a world as a semantic map, from which the same world is read again.

KnowRob and any RDF library can read them. Everything that a world holds is written, in whichever dialect: a value for
which it has no word stands under dialect 1's or a name of our own (see `all_names`), and facts and resources stand as
they came.
"""

from __future__ import annotations

import os
from enum import StrEnum
from pathlib import Path

from mindstage.errors import MapWriteError
from mindstage.files import atomic_write
from mindstage.knowledge.dialects.soma_export import write_as_soma
from mindstage.knowledge.graph_diff import SourceMapView
from mindstage.knowledge.io.serializers import to_rdf_xml, to_turtle
from mindstage.knowledge.io.write_original import write_in_source_dialect
from mindstage.knowledge.rdf import gc_paused
from mindstage.knowledge.rdf_mapping.serialize import PrefixTable, to_sections
from mindstage.scene import World

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
    source_view: SourceMapView | None = None,
) -> str:
    """The text of a map file; the same for equal worlds.

    Args:
        world: what is written.
        format: how.
        dialect: in whose words.
        origin: the map that the world came from, in whose own words it is written then, whatever the dialect.

    Raises:
        MapWriteError: the world holds something that the format cannot, and the error says what.
    """
    return _serialize(world, format, dialect, source_view)[0]


def save_map(
    world: World,
    path: str | os.PathLike[str],
    *,
    format: MapFormat | None = None,
    dialect: MapDialect = MapDialect.SEMLOG,
    source_view: SourceMapView | None = None,
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
        MapWriteError: the suffix stands for none, the world holds something that the format cannot, or the disk
            refuses.
    """
    path = Path(path)
    format = format or _SUFFIXES.get(path.suffix.lower())
    if format is None:
        remedy = f"use one of {', '.join(_SUFFIXES)}"
        raise MapWriteError(str(path), cause=f"the suffix {path.suffix!r} stands for no format", remedy=remedy)
    text, notes = _serialize(world, format, dialect, source_view)
    try:
        content = text.encode()
    except UnicodeEncodeError as error:
        letter = f"U+{ord(error.object[error.start]):04X}"
        raise MapWriteError(str(path), cause=f"a text holds {letter}, which is half a letter") from error
    save_file(path, content)
    return notes


def save_file(path: Path, content: bytes) -> None:
    """Writes a file, which replaces an existing one only once it is complete.

    Raises:
        MapWriteError: the file system does not allow it.
    """
    try:
        atomic_write(path, content)
    except OSError as error:
        raise MapWriteError(str(path), cause=error.strerror or str(error)) from error


def _serialize(
    world: World, format: MapFormat, dialect: MapDialect, source_view: SourceMapView | None
) -> tuple[str, tuple[str, ...]]:
    with gc_paused():
        sections = to_sections(world)
        notes: tuple[str, ...] = ()
        if source_view is not None:
            sections, notes = write_in_source_dialect(world, sections, source_view)
        elif dialect is MapDialect.SOMA:
            sections, notes = write_as_soma(world, sections)
        names = PrefixTable(world.iri, sections)
        return (to_rdf_xml if format is MapFormat.RDF_XML else to_turtle)(sections, names), notes
