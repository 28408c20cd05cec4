"""Writes worlds to files, in all formats and dialects that Mindstage supports.

    save_world(world, "kitchen.ttl")                 # a semantic map, without loss
    save_world(world, "kitchen.glb", knowledge=kb)   # a glTF scene; returns notes on what glTF cannot express

A file is written completely or not at all.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from mindstage.errors import InvalidArgumentError, MapWriteError, SourceParseError

if TYPE_CHECKING:
    from mindstage.assets import MeshLibrary
    from mindstage.engines.actuators import ActuatedBodies
    from mindstage.geometry import FittedGeometry
    from mindstage.knowledge import KnowledgeBase
    from mindstage.maps import SourceMapView
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
        """Whether the format is a semantic map, which is lossless and has a dialect."""
        return self in (FileFormat.OWL, FileFormat.TURTLE)


class FileDialect(StrEnum):
    """The vocabulary that a semantic map is written in."""

    SAME = "same"
    """The dialect of the map that the world was read from."""
    GIVEN = "given"
    """The dialect of the map from which that map was converted."""
    SEMLOG = "semlog"
    """The SemLog vocabulary of 2019, which includes physics."""
    SOMA = "soma"
    """The SOMA vocabulary of KnowRob 2."""


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
    """The given format, or else the format of the path's suffix.

    Raises:
        MapWriteError: the suffix is unknown.
        InvalidArgumentError: the format or the dialect is unknown, or a dialect is given for a format without dialects.
    """
    suffix = Path(path).suffix
    chosen = _SUFFIXES.get(suffix.lower()) if format is None else _choice(FileFormat, format)
    if chosen is None:
        remedy = f"use one of {', '.join(_SUFFIXES)}, or give the format"
        raise MapWriteError(str(path), cause=f"the suffix {suffix!r} belongs to no format", remedy=remedy)
    if dialect is not None and not chosen.is_map:
        remedy = "leave it out, or write .owl or .ttl"
        name = _choice(FileDialect, dialect).value
        raise InvalidArgumentError(f"the dialect {name}", cause=f"{chosen.value} has no dialects", remedy=remedy)
    return chosen


def dialect_name(world: World, knowledge: KnowledgeBase, format: FileFormat, dialect: FileDialect) -> str | None:
    """The name of the dialect in which a world is written; None for formats without dialects."""
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
    actuated: Iterable[ActuatedBodies] = (),
) -> tuple[str, ...]:
    """Writes a world to a file, completely or not at all.

    Args:
        path: the file; its suffix determines the format (.owl, .rdf, .ttl, .mjcf, .xml, .glb, .tscn).
        knowledge: the knowledge base that the world was read from. The dialects `same` and `given` need it; MJCF, glTF
            and Godot scenes use its shape rules and mesh paths, by default those of the bundled ontology.
        format: by default the format of the suffix.
        dialect: the vocabulary of a semantic map, SemLog by default.
        assets: folders of mesh files, for MJCF, glTF and Godot scenes.
        plain_shapes: whether MJCF, glTF and Godot scenes get only the primitive shape of each body.
        godot: path of the Godot executable, for Godot scenes; by default searched on PATH and in the usual places.
        actuated: its bodies with actuators; MJCF has these, too.

    Returns:
        Notes, one sentence each, on what the format cannot express or approximates.

    Raises:
        MapWriteError: the suffix is unknown, the format cannot express the world, or the file cannot be written.
        InvalidArgumentError: the format or the dialect is unknown, `same` or `given` was requested without the
            knowledge base that read the map, or `given` for a map that was not converted.
        SourceParseError: one of the asset folders does not exist.
        EngineUnavailableError: Godot is not installed.
    """
    from mindstage.knowledge import KnowledgeBase

    out, kind = Path(path), file_format(path, format, dialect=dialect)
    if kind.is_map:
        chosen = FileDialect.SEMLOG if dialect is None else _choice(FileDialect, dialect)
        return _save_map(world, out, kind, chosen, knowledge)
    with nullcontext(knowledge) if knowledge is not None else KnowledgeBase() as used:
        fitted = _fitted(world, used, assets, plain_shapes=plain_shapes, actuated=(actuated := tuple(actuated)))
        return _save_scene(world, out, kind, used, fitted, godot=godot, actuated=actuated)


def mesh_assets(folders: StrPath | Iterable[StrPath], knowledge: KnowledgeBase) -> MeshLibrary:
    """The meshes in the folders, and those that maps refer to.

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
    from mindstage.maps import MapDialect, MapFormat, save_map

    syntax = MapFormat.RDF_XML if format is FileFormat.OWL else MapFormat.TURTLE
    if dialect not in (FileDialect.SAME, FileDialect.GIVEN):
        return save_map(world, path, format=syntax, dialect=MapDialect(dialect.value))
    if knowledge is None:
        cause = "it needs the knowledge base that the map was read with"
        raise InvalidArgumentError(
            f"the dialect {dialect.value}", cause=cause, remedy="pass `knowledge`, or use semlog or soma"
        )
    return save_map(world, path, format=syntax, source_view=_origin_of(world, knowledge, dialect))


def _origin_of(world: World, knowledge: KnowledgeBase, dialect: FileDialect) -> SourceMapView:
    """The map that a world was read from or, for `given`, the map from which that one was converted.

    Raises:
        InvalidArgumentError: the map was not converted.
    """
    origin = knowledge.source_view(world.iri)
    if dialect is FileDialect.SAME:
        return origin
    given = origin.before_conversion()
    if given is None:
        cause, remedy = "the map was not converted from another one", "use same, semlog or soma"
        raise InvalidArgumentError(f"the dialect {dialect.value}", cause=cause, remedy=remedy)
    return given


def _fitted(
    world: World,
    knowledge: KnowledgeBase,
    assets: StrPath | Iterable[StrPath],
    *,
    plain_shapes: bool,
    actuated: Sequence[ActuatedBodies],
) -> FittedGeometry:
    """The geometry that is written: none for plain shapes; that of robots is their own."""
    from mindstage.geometry import FittedGeometry, fit_geometry
    from mindstage.scene import NO_GEOMETRY

    if plain_shapes:
        return FittedGeometry(NO_GEOMETRY)
    fitted = fit_geometry(world, knowledge, meshes=mesh_assets(assets, knowledge))
    own = {id: each for bodies in actuated for id, each in bodies.geometry.items()}
    return replace(fitted, geometry={**fitted.geometry, **own}) if own else fitted


def _save_scene(
    world: World,
    path: Path,
    format: FileFormat,
    knowledge: KnowledgeBase,
    fitted: FittedGeometry,
    *,
    godot: StrPath | None,
    actuated: Sequence[ActuatedBodies],
) -> tuple[str, ...]:
    """Writes a MuJoCo model, a glTF scene or a Godot scene."""
    from mindstage.maps.io.write import save_file

    if format is FileFormat.MJCF:
        from mindstage.engines.mujoco import world_to_mjcf

        folder = f"{path.stem}_assets"
        written = world_to_mjcf(
            world,
            geometry=fitted.geometry,
            find_mesh=knowledge.find_file,
            actuated=actuated,
            visuals_folder=folder if fitted.geometry else None,
        )
        _save_model(path, written.text.encode(), path.parent / folder, written.files)
        notes = written.notes
    elif format is FileFormat.GLTF:
        from mindstage.assets.gltf import world_to_glb

        data, notes = world_to_glb(world, geometry=fitted.geometry)
        save_file(path, data)
    else:
        return _save_godot_scene(world, path, fitted, godot=godot)
    return (*(note.text for note in fitted.notes), *notes)


def _save_model(path: Path, text: bytes, folder: Path, files: Mapping[str, bytes]) -> None:
    """Writes a MuJoCo model with its meshes and textures, and removes those of an earlier one.

    Raises:
        MapWriteError: the folder has other files, or something cannot be written; then nothing is changed.
    """
    from mindstage.files import atomic_file, atomic_folder, atomic_write
    from mindstage.maps.io.write import save_file

    if not files:
        save_file(path, text)
        return
    try:
        existing = list(folder.iterdir()) if folder.exists() else []
        other = next((each for each in existing if each.suffix not in (".obj", ".png")), None)
        if other is not None:
            cause = f"it exists, and has files other than meshes and textures of a MuJoCo model: {other.name}"
            raise MapWriteError(str(folder), cause=cause, remedy="move it, or choose another name for the model")
        with atomic_folder(folder) as assets, atomic_file(path) as model:
            for name, data in files.items():
                atomic_write(assets / Path(name).name, data)
            model.write_bytes(text)
        names = {Path(name).name for name in files}
        for each in existing:
            if each.name not in names:
                each.unlink()
    except OSError as error:
        raise MapWriteError(error.filename or str(folder), cause=error.strerror or str(error)) from error


def _save_godot_scene(world: World, path: Path, fitted: FittedGeometry, *, godot: StrPath | None) -> tuple[str, ...]:
    """Spawns the world in a Godot process, which saves it as a scene."""
    from tempfile import TemporaryDirectory

    from mindstage.engines.remote.godot import GodotEngine
    from mindstage.maps.io.write import save_file

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
    return tuple(f"{each.id} is not in the scene: {each.reason}" for each in failed)
