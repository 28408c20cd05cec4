"""Writing of worlds to semantic map files that KnowRob and RDF libraries can read.

Reading a written map gives the same world, in every dialect. A value that a dialect cannot express is written in the
vocabulary of dialect 1 or of Mindstage, and facts and resources are written unchanged.
"""

from __future__ import annotations

import os
from collections.abc import Container, Sequence
from dataclasses import replace
from enum import StrEnum
from pathlib import Path

from mindstage.errors import MapWriteError
from mindstage.files import atomic_write
from mindstage.maps.dialects.serialize import DocumentSection, PrefixTable, to_sections
from mindstage.maps.dialects.soma_export import write_as_soma
from mindstage.maps.io.files import old_name
from mindstage.maps.io.formats import MapFormat
from mindstage.maps.io.graph_diff import SourceMapView
from mindstage.maps.io.serializers import to_rdf_xml, to_turtle
from mindstage.maps.io.write_original import write_in_source_dialect
from mindstage.rdf.graphs import gc_paused
from mindstage.scene import BlankNode, Iri, IriRef, PropertyAssertion, World

__all__ = ["MapDialect", "save_file", "save_map", "save_statements", "write_map"]


class MapDialect(StrEnum):
    """The vocabularies that any world can be written in."""

    SEMLOG = "semlog"
    """SemLog with physical properties (2019), which KnowRob's game engine plugins read."""
    SOMA = "soma"
    """KnowRob 2; values that it cannot express are written in the SemLog vocabulary."""


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
    """Serializes a world as the text of a map file; equal worlds give equal texts.

    Args:
        format: the file format.
        dialect: the vocabulary.
        source_view: the map that the world was read from; it is written in that map's dialect, whatever `dialect` is.

    Raises:
        MapWriteError: the world contains something that the format cannot represent.
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
    """Writes a map file atomically.

    Args:
        path: the file.
        format: the file format; None for that of the suffix.
        dialect: the vocabulary.
        source_view: the map that the world was read from; it is written in that map's dialect, whatever `dialect` is.

    Returns:
        Sentences about what the dialect could not express and is written in another vocabulary.

    Raises:
        MapWriteError: the suffix is unknown, the world contains something that the format cannot represent, or the
            file cannot be written.
    """
    path = Path(path)
    format = format or _format_of(path)
    text, notes = _serialize(world, format, dialect, source_view)
    try:
        content = text.encode()
    except UnicodeEncodeError as error:
        surrogate = f"U+{ord(error.object[error.start]):04X}"
        raise MapWriteError(str(path), cause=f"a text contains {surrogate}, an unpaired surrogate") from error
    save_file(path, content)
    return notes


def save_statements(path: str | os.PathLike[str], ontology: Iri, sections: Sequence[DocumentSection]) -> None:
    """Writes statements that are no map as RDF/XML or Turtle, by the suffix, atomically.

    Args:
        path: the file.
        ontology: the IRI whose namespace the individuals have.
        sections: the statements.

    Raises:
        MapWriteError: the suffix is unknown, a statement cannot be represented, or the file cannot be written.
    """
    path = Path(path)
    serialize = to_turtle if _format_of(path) is MapFormat.TURTLE else to_rdf_xml
    save_file(path, serialize(sections, PrefixTable(ontology, sections)).encode("utf-8", "replace"))


def _format_of(path: Path) -> MapFormat:
    format = _SUFFIXES.get(path.suffix.lower())
    if format is None:
        remedy = f"use one of {', '.join(_SUFFIXES)}"
        raise MapWriteError(str(path), cause=f"the suffix {path.suffix!r} is not that of a known format", remedy=remedy)
    return format


def save_file(path: Path, content: bytes) -> None:
    """Writes a file atomically.

    Raises:
        MapWriteError: the file cannot be written.
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
            if (current := source_view.source_map.current_names) is not None:
                sections = _in_old_namespaces(sections, current)
        elif dialect is MapDialect.SOMA:
            sections, notes = write_as_soma(world, sections)
        names = PrefixTable(world.iri, sections)
        return (to_rdf_xml if format is MapFormat.RDF_XML else to_turtle)(sections, names), notes


def _in_old_namespaces(sections: Sequence[DocumentSection], current: Container[str]) -> Sequence[DocumentSection]:
    """Writes names as the source does, which uses the namespaces that KnowRob had until 2013.

    Args:
        current: the names that stay as they are.
    """

    def rename(iri: Iri) -> Iri:
        return iri if iri in current else Iri(old_name(iri))

    def renamed(fact: PropertyAssertion) -> PropertyAssertion:
        value = fact.value
        if isinstance(value, IriRef):
            value = IriRef(rename(value.iri))
        elif isinstance(value, BlankNode):
            value = BlankNode(tuple(map(renamed, value.facts)))
        return PropertyAssertion(rename(fact.property), value)

    return [
        replace(
            section,
            blocks=[
                replace(block, subject=rename(block.subject), facts=list(map(renamed, block.facts)))
                for block in section.blocks
            ],
        )
        for section in sections
    ]
