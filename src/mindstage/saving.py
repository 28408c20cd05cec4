"""Saving: a world as a file, in any format and dialect that Mindstage writes.

save_world(world, "kitchen.ttl")                 # a semantic map; nothing is lost
save_world(world, "kitchen.glb", knowledge=kb)   # a scene for viewers; returns notes on what glTF cannot hold
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from mindstage.errors import InvalidArgumentError, MapWriteError, SourceParseError

if TYPE_CHECKING:
    from mindstage.assets import MeshLibrary
    from mindstage.geometry import FittedGeometry
    from mindstage.knowledge import KnowledgeBase, SourceMapView
    from mindstage.scene import World

__all__ = ["FileDialect", "FileFormat", "dialect_name", "file_format", "mesh_assets", "save_world"]

StrPath = str | os.PathLike[str]
E = TypeVar("E", bound=StrEnum)


class FileFormat(StrEnum):
    """A file format that a world can be written in."""

    OWL = "owl"
    """A semantic map in RDF/XML."""
    TURTLE = "ttl"
    """A semantic map in Turtle."""
    MJCF = "mjcf"
    """A MuJoCo model."""
    GLTF = "glb"
    """A binary glTF 2.0 scene: visual geometry and lights."""
    GODOT = "tscn"
    """A Godot scene; Godot has to be installed."""

    @property
    def is_map(self) -> bool:
        """Whether the format is a semantic map, which holds everything and has a dialect."""
        return self in (FileFormat.OWL, FileFormat.TURTLE)


class FileDialect(StrEnum):
    """The vocabulary that a semantic map is written in."""

    SAME = "same"
    """The dialect of the map that the world was read from."""
    GIVEN = "given"
    """The dialect of the map from which that map was once converted."""
    SEMLOG = "semlog"
    """SemLog's of 2019, with physics."""
    SOMA = "soma"
    """That of KnowRob 2."""


_SUFFIXES = {
    ".owl": FileFormat.OWL,
    ".rdf": FileFormat.OWL,
    ".ttl": FileFormat.TURTLE,
    ".mjcf": FileFormat.MJCF,
    ".xml": FileFormat.MJCF,
    ".glb": FileFormat.GLTF,
    ".tscn": FileFormat.GODOT,
}


def file_format(
    path: StrPath, format: FileFormat | str | None = None, *, dialect: FileDialect | str | None = None
) -> FileFormat:
    """The format given, or else the one of the path's suffix.

    Raises:
        MapWriteError: no format has this suffix.
        InvalidArgumentError: there is no such format or dialect, or the format has no dialects and one is given.
    """
    suffix = Path(path).suffix
    chosen = _SUFFIXES.get(suffix.lower()) if format is None else _choice(FileFormat, format)
    if chosen is None:
        remedy = f"use one of {', '.join(_SUFFIXES)}, or give the format"
        raise MapWriteError(str(path), cause=f"the suffix {suffix!r} stands for no format", remedy=remedy)
    if dialect is not None and not chosen.is_map:
        remedy = "leave it out, or write .owl or .ttl"
        name = _choice(FileDialect, dialect).value
        raise InvalidArgumentError(f"the dialect {name}", cause=f"{chosen.value} has no dialects", remedy=remedy)
    return chosen


def dialect_name(world: World, knowledge: KnowledgeBase, format: FileFormat, dialect: FileDialect) -> str | None:
    """The name of the dialect that a world is written in; None for formats that have none."""
    if not format.is_map:
        return None
    own = dialect in (FileDialect.SAME, FileDialect.GIVEN)
    return _origin_of(world, knowledge, dialect).dialect if own else dialect.value


def save_world(
    world: World,
    path: StrPath,
    *,
    knowledge: KnowledgeBase | None = None,
    format: FileFormat | str | None = None,
    dialect: FileDialect | str | None = None,
    assets: StrPath | Iterable[StrPath] = (),
    plain_shapes: bool = False,
    godot: StrPath | None = None,
) -> tuple[str, ...]:
    """Writes a world to a file, which is there as a whole or not at all.

    Args:
        world: the world.
        path: the file; its suffix determines the format (.owl, .rdf, .ttl, .mjcf, .xml, .glb, .tscn).
        knowledge: the knowledge base that the world was read from. The dialects `same` and `given` need it; MJCF, glTF
            and Godot scenes take the shapes of classes and the files of meshes from it, by default from the bundled
            ontology alone.
        format: instead of the one of the suffix.
        dialect: the vocabulary of a semantic map; SemLog's by default.
        assets: folders of mesh files, for MJCF, glTF and Godot scenes.
        plain_shapes: whether these formats get each body's primitive shape only (box, sphere, cylinder).
        godot: the Godot program that makes a Godot scene; by default the one on PATH, or in a usual place.

    Returns:
        Notes, one sentence each, on what the file cannot hold or holds in other words.

    Raises:
        MapWriteError: no format has this suffix, the world holds something that the format cannot, or the file cannot
            be written.
        InvalidArgumentError: there is no such format or dialect; the dialect needs a knowledge base that has read the map,
            or the map was not converted.
        SourceParseError: one of the asset folders does not exist.
        EngineUnavailableError: Godot is not installed.
    """
    from mindstage.knowledge import KnowledgeBase

    out, kind = Path(path), file_format(path, format, dialect=dialect)
    if kind.is_map:
        words = FileDialect.SEMLOG if dialect is None else _choice(FileDialect, dialect)
        return _save_map(world, out, kind, words, knowledge)
    if knowledge is None:
        with KnowledgeBase() as bundled:
            return _save_scene(world, out, kind, bundled, assets=assets, plain_shapes=plain_shapes, godot=godot)
    return _save_scene(world, out, kind, knowledge, assets=assets, plain_shapes=plain_shapes, godot=godot)


def mesh_assets(folders: StrPath | Iterable[StrPath], knowledge: KnowledgeBase) -> MeshLibrary:
    """The meshes in some folders and those that maps refer to.

    Raises:
        SourceParseError: one of the folders does not exist.
    """
    from mindstage.assets import MeshLibrary

    listed = [folders] if isinstance(folders, str | os.PathLike) else folders
    paths = [Path(folder) for folder in listed]
    for path in paths:
        if not path.is_dir():
            raise SourceParseError(str(path), cause="there is no such folder; assets takes folders of mesh files")
    return MeshLibrary(paths, find_file=knowledge.find_file)


def _choice(kind: type[E], name: str) -> E:
    try:
        return kind(name)
    except ValueError:
        what = "format" if kind is FileFormat else "dialect"
        remedy = f"use one of {', '.join(kind)}"
        raise InvalidArgumentError(f"the {what} {name!r}", cause=f"there is no such {what}", remedy=remedy) from None


def _save_map(
    world: World, path: Path, format: FileFormat, dialect: FileDialect, knowledge: KnowledgeBase | None
) -> tuple[str, ...]:
    from mindstage.knowledge import MapDialect, MapFormat, save_map

    syntax = MapFormat.RDF_XML if format is FileFormat.OWL else MapFormat.TURTLE
    if dialect not in (FileDialect.SAME, FileDialect.GIVEN):
        return save_map(world, path, format=syntax, dialect=MapDialect(dialect.value))
    if knowledge is None:
        cause = "it takes the knowledge base that the map was read with"
        raise InvalidArgumentError(
            f"the dialect {dialect.value}", cause=cause, remedy="give knowledge, or use semlog, soma"
        )
    return save_map(world, path, format=syntax, source_view=_origin_of(world, knowledge, dialect))


def _origin_of(world: World, knowledge: KnowledgeBase, dialect: FileDialect) -> SourceMapView:
    """The map that a world was read from, or the one from which that was converted.

    Raises:
        InvalidArgumentError: it was not converted.
    """
    origin = knowledge.source_view(world.iri)
    if dialect is FileDialect.SAME:
        return origin
    given = origin.before_conversion()
    if given is None:
        cause, remedy = "the map does not say that it was converted", "use same, semlog or soma"
        raise InvalidArgumentError(f"the dialect {dialect.value}", cause=cause, remedy=remedy)
    return given


def _save_scene(
    world: World,
    path: Path,
    format: FileFormat,
    knowledge: KnowledgeBase,
    *,
    assets: StrPath | Iterable[StrPath],
    plain_shapes: bool,
    godot: StrPath | None,
) -> tuple[str, ...]:
    """Writes what a world looks like, or how it moves."""
    from mindstage.knowledge.io.write import save_file

    fitted = _fitted(world, knowledge, assets=assets, plain_shapes=plain_shapes)
    if format is FileFormat.MJCF:
        from mindstage.engines.mujoco import world_to_mjcf

        text, notes = world_to_mjcf(world, geometry=fitted.geometry, find_mesh=knowledge.find_file)
        save_file(path, text.encode())
    elif format is FileFormat.GLTF:
        from mindstage.assets.gltf import world_to_glb

        data, notes = world_to_glb(world, geometry=fitted.geometry)
        save_file(path, data)
    else:
        return _save_godot_scene(world, path, fitted, godot=godot)
    return (*(note.text for note in fitted.notes), *notes)


def _fitted(
    world: World, knowledge: KnowledgeBase, *, assets: StrPath | Iterable[StrPath], plain_shapes: bool
) -> FittedGeometry:
    from mindstage.geometry import FittedGeometry, fit_geometry
    from mindstage.scene import NO_GEOMETRY

    return (
        FittedGeometry(NO_GEOMETRY)
        if plain_shapes
        else fit_geometry(world, knowledge, meshes=mesh_assets(assets, knowledge))
    )


def _save_godot_scene(world: World, path: Path, fitted: FittedGeometry, *, godot: StrPath | None) -> tuple[str, ...]:
    """Spawns the world in a Godot process, which writes the scene."""
    from tempfile import TemporaryDirectory

    from mindstage.engines import GodotEngine
    from mindstage.knowledge.io.write import save_file

    engine = GodotEngine(None if godot is None else Path(godot))
    try:
        report = engine.spawn(world, geometry=fitted.geometry)
        with TemporaryDirectory(prefix="mindstage-") as folder:
            scene = Path(folder, "scene.tscn")
            engine.save_scene(scene)
            save_file(path, scene.read_bytes())
    finally:
        engine.close()
    failed = (*report.failed_bodies, *report.failed_joints, *report.failed_attachments)
    return tuple(f"{each.id} is not in it: {each.reason}" for each in failed)
