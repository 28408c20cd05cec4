"""Saving: a world as a file of whichever format and dialect was asked for."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

from mindstage.cli.staging import assets_in, stage_for
from mindstage.errors import ArgumentRefused, MapUnwritable

if TYPE_CHECKING:
    from mindstage.knowledge import KnowledgeBase, Origin
    from mindstage.shapes import Fitted
    from mindstage.world import World

__all__ = ["FileDialect", "FileFormat", "format_of", "save_world", "words_of"]


class FileFormat(StrEnum):
    """How a world can be written."""

    OWL = "owl"
    TURTLE = "ttl"
    MJCF = "mjcf"
    GLTF = "glb"
    GODOT = "tscn"

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
    ".tscn": FileFormat.GODOT,
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
    world: World,
    knowledge: KnowledgeBase,
    path: Path,
    format: FileFormat,
    dialect: FileDialect,
    *,
    assets: list[Path] | None = None,
    plain_boxes: bool = False,
) -> tuple[str, ...]:
    """Writes a world, and says in sentences what such a file has no place for.

    Args:
        world: what is written.
        knowledge: where it came from, and where the files of its meshes may be.
        path: where to.
        format: how.
        dialect: in whose words, where the format is one for maps.
        assets: folders of meshes; they and the next count where the format is one for what a place looks like.
        plain_boxes: whether bodies shall be no more than the boxes that the map says.

    Raises:
        MapUnwritable: the world holds something that the format cannot, or the disk refuses.
        ArgumentRefused: the map shall become what it was converted from, and was not.
        EngineUnavailable: it is a scene for Godot, and there is no Godot to make it.
    """
    from mindstage.knowledge import MapDialect, MapFormat, save_map
    from mindstage.knowledge.writers.mapwriter import save_file

    if format is FileFormat.GODOT:
        return _save_scene(world, knowledge, path, assets=assets, plain_boxes=plain_boxes)
    if format in (FileFormat.MJCF, FileFormat.GLTF):
        fitted = _fitted(world, knowledge, assets=assets, plain_boxes=plain_boxes)
        if format is FileFormat.MJCF:
            from mindstage.engines.mujoco import mjcf

            text, notes = mjcf(world, forms=fitted.forms, find_mesh=knowledge.find_file)
            save_file(path, text.encode())
        else:
            from mindstage.exports import glb

            data, notes = glb(world, forms=fitted.forms)
            save_file(path, data)
        return (*(note.text for note in fitted.notes), *notes)
    syntax = MapFormat.RDF_XML if format is FileFormat.OWL else MapFormat.TURTLE
    if dialect in (FileDialect.SAME, FileDialect.GIVEN):
        return save_map(world, path, format=syntax, origin=_origin_of(world, knowledge, dialect))
    return save_map(world, path, format=syntax, dialect=MapDialect(dialect.value))


def _fitted(world: World, knowledge: KnowledgeBase, *, assets: list[Path] | None, plain_boxes: bool) -> Fitted:
    """What its bodies are made of."""
    from mindstage.shapes import Fitted, forms_for
    from mindstage.world import NO_FORMS

    return Fitted(NO_FORMS) if plain_boxes else forms_for(world, knowledge, meshes=assets_in(assets, knowledge))


def _save_scene(
    world: World, knowledge: KnowledgeBase, path: Path, *, assets: list[Path] | None, plain_boxes: bool
) -> tuple[str, ...]:
    """Has a Godot make its own scene of what it was told to spawn."""
    from tempfile import TemporaryDirectory

    from mindstage.cli.engine import godot_engine
    from mindstage.knowledge.writers.mapwriter import save_file

    godot = godot_engine()
    staged = stage_for(knowledge, godot, assets=assets, plain_boxes=plain_boxes)
    with TemporaryDirectory(prefix="mindstage-") as folder, staged as stage:
        report = stage.spawn(world)
        scene = Path(folder, "scene.tscn")
        stage.call(lambda engine: godot.save_scene(scene), what="save scene", timeout_s=60.0 + 0.05 * report.bodies)
        save_file(path, scene.read_bytes())
    failed = (*report.failed_bodies, *report.failed_constraints, *report.failed_attachments)
    return tuple(f"{each.id} is not in it: {each.reason}" for each in failed)
