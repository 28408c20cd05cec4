"""Saving: a world as a file of whichever format and dialect was asked for."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

from mindstage.errors import ArgumentRefused, MapUnwritable

if TYPE_CHECKING:
    from mindstage.knowledge import KnowledgeBase, Origin
    from mindstage.world import World

__all__ = ["FileDialect", "FileFormat", "format_of", "save_world", "words_of"]


class FileFormat(StrEnum):
    """How a world can be written."""

    OWL = "owl"
    TURTLE = "ttl"
    MJCF = "mjcf"
    GLTF = "glb"

    @property
    def is_map(self) -> bool:
        """Whether it holds all that is known, in the words of some dialect."""
        return self in (FileFormat.OWL, FileFormat.TURTLE)


class FileDialect(StrEnum):
    """In whose words a map is written."""

    SAME = "same"
    GIVEN = "given"
    SEMLOG = "semlog"
    SOMA = "soma"


_SUFFIXES = {
    ".owl": FileFormat.OWL,
    ".rdf": FileFormat.OWL,
    ".ttl": FileFormat.TURTLE,
    ".mjcf": FileFormat.MJCF,
    ".xml": FileFormat.MJCF,
    ".glb": FileFormat.GLTF,
}


def format_of(path: Path, told: FileFormat | None, dialect: FileDialect | None) -> FileFormat:
    """The format that was asked for, or else the one that the suffix stands for.

    Raises:
        MapUnwritable: the suffix stands for none.
        ArgumentRefused: the format has no dialects, and one was asked for.
    """
    format = told or _SUFFIXES.get(path.suffix.lower())
    if format is None:
        remedy = f"use one of {', '.join(_SUFFIXES)}, or say --format"
        raise MapUnwritable(str(path), cause=f"the suffix {path.suffix!r} stands for no format", remedy=remedy)
    if dialect is not None and not format.is_map:
        remedy = "leave it out, or write .owl or .ttl"
        raise ArgumentRefused(f"--dialect {dialect.value}", cause=f"{format.value} has no dialects", remedy=remedy)
    return format


def words_of(world: World, knowledge: KnowledgeBase, format: FileFormat, dialect: FileDialect) -> str | None:
    """The name of the dialect that a world is written in; None for formats that have none."""
    if not format.is_map:
        return None
    own = dialect in (FileDialect.SAME, FileDialect.GIVEN)
    return _origin_of(world, knowledge, dialect).dialect if own else dialect.value


def _origin_of(world: World, knowledge: KnowledgeBase, dialect: FileDialect) -> Origin:
    """The map that a world came from, or what that was converted from.

    Raises:
        ArgumentRefused: it was not converted from anything.
    """
    origin = knowledge.origin(world.iri)
    if dialect is FileDialect.SAME:
        return origin
    given = origin.given()
    if given is None:
        cause, remedy = "the map does not say that it was converted", "use same, semlog or soma"
        raise ArgumentRefused(f"--dialect {dialect.value}", cause=cause, remedy=remedy)
    return given


def save_world(
    world: World, knowledge: KnowledgeBase, path: Path, format: FileFormat, dialect: FileDialect
) -> tuple[str, ...]:
    """Writes a world, and says in sentences what such a file has no place for.

    Args:
        world: what is written.
        knowledge: where it came from, and where the files of its meshes may be.
        path: where to.
        format: how.
        dialect: in whose words, where the format is one for maps.

    Raises:
        MapUnwritable: the world holds something that the format cannot, or the disk refuses.
        ArgumentRefused: the map shall become what it was converted from, and was not.
    """
    from mindstage.knowledge import MapDialect, MapFormat, save_map
    from mindstage.knowledge.writers.whole_files import save_whole

    if format is FileFormat.MJCF:
        from mindstage.engines.mujoco import mjcf

        text, notes = mjcf(world, find_mesh=knowledge.find_file)
        save_whole(path, text.encode())
        return notes
    if format is FileFormat.GLTF:
        from mindstage.assets import Assets
        from mindstage.exports import glb

        forms, fitted = Assets(find_file=knowledge.find_file).forms(world.bodies)
        data, notes = glb(world, forms=forms)
        save_whole(path, data)
        return (*fitted, *notes)
    syntax = MapFormat.RDF_XML if format is FileFormat.OWL else MapFormat.TURTLE
    if dialect in (FileDialect.SAME, FileDialect.GIVEN):
        return save_map(world, path, format=syntax, origin=_origin_of(world, knowledge, dialect))
    return save_map(world, path, format=syntax, dialect=MapDialect(dialect.value))
