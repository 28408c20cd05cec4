"""Writes worlds to files, in the formats that are installed and in the dialects of semantic maps.

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
from typing import TYPE_CHECKING

from mindstage.errors import InvalidArgumentError, MapWriteError, SourceParseError
from mindstage.maps.io.formats import MapFormat, WorldFormat, WrittenWorld
from mindstage.registry import Group, load_all
from mindstage.scene.edits import Spawn

if TYPE_CHECKING:
    from mindstage.assets import MeshLibrary
    from mindstage.assets.mesh_import import MeshProgress
    from mindstage.engines.actuators import ActuatedBodies
    from mindstage.geometry import FittedGeometry
    from mindstage.knowledge import KnowledgeBase
    from mindstage.maps import SourceMapView
    from mindstage.scene import GeometryMap, World

__all__ = [
    "GLTF",
    "GODOT",
    "MJCF",
    "OWL",
    "TURTLE",
    "FileDialect",
    "dialect_name",
    "file_format",
    "mesh_assets",
    "save_world",
]

StrPath = str | os.PathLike[str]


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


def file_format(
    path: StrPath, format: str | None = None, *, dialect: FileDialect | str | None = None
) -> tuple[str, WorldFormat]:
    """The name and the format that is given, or else those of the path's suffix.

    Raises:
        MapWriteError: the suffix is unknown.
        InvalidArgumentError: the format or the dialect is unknown, or a dialect is given for a format without dialects.
    """
    known = {name: each for name, each in load_all(Group.FORMATS, WorldFormat).items() if each.syntax or each.write}
    if format is None:
        suffix = Path(path).suffix
        format = next((name for name, each in known.items() if suffix.lower() in each.suffixes), None)
        if format is None:
            suffixes = ", ".join(each for kind in known.values() for each in kind.suffixes)
            remedy = f"use one of {suffixes}, or give the format"
            raise MapWriteError(str(path), cause=f"the suffix {suffix!r} belongs to no format", remedy=remedy)
    chosen = known.get(format)
    if chosen is None:
        remedy = f"use one of {', '.join(known)}"
        raise InvalidArgumentError(f"the format {format!r}", cause="there is no such format", remedy=remedy)
    if dialect is not None and chosen.syntax is None:
        remedy = "leave it out, or write .owl or .ttl"
        raise InvalidArgumentError(
            f"the dialect {_dialect(dialect).value}", cause=f"{format} has no dialects", remedy=remedy
        )
    return format, chosen


def dialect_name(world: World, knowledge: KnowledgeBase, format: WorldFormat, dialect: FileDialect) -> str | None:
    """The name of the dialect in which a world is written; None for formats without dialects."""
    if format.syntax is None:
        return None
    own = dialect in (FileDialect.SAME, FileDialect.GIVEN)
    return _origin_of(world, knowledge, dialect).dialect if own else dialect.value


def save_world(
    world: World,
    path: StrPath,
    *,
    knowledge: KnowledgeBase | None = None,
    format: str | None = None,
    dialect: FileDialect | str | None = None,
    assets: StrPath | Iterable[StrPath] = (),
    primitive_shapes: bool = False,
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
        primitive_shapes: whether MJCF, glTF and Godot scenes get only the primitive shape of each body.
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

    out, (_, kind) = Path(path), file_format(path, format, dialect=dialect)
    if kind.syntax is not None:
        chosen = FileDialect.SEMLOG if dialect is None else _dialect(dialect)
        return _save_map(world, out, kind.syntax, chosen, knowledge)
    assert kind.write is not None
    notes: list[str] = []
    with nullcontext(knowledge) if knowledge is not None else KnowledgeBase() as used:
        bodies = tuple(actuated)

        def fit() -> GeometryMap:
            fitted = _fitted(world, used, assets, primitive_shapes=primitive_shapes, actuated=bodies)
            notes.extend(note.text for note in fitted.notes)
            return fitted.geometry

        program = None if godot is None else Path(godot)
        find_mesh = used.find_file
        written = WrittenWorld(world=world, path=out, fit=fit, find_mesh=find_mesh, actuated=bodies, godot=program)
        told = tuple(kind.write(written))
    return (*notes, *told)


def mesh_assets(
    folders: StrPath | Iterable[StrPath],
    knowledge: KnowledgeBase,
    *,
    progress: MeshProgress | None = None,
    decompose: bool = True,
) -> MeshLibrary:
    """The meshes in the folders, and those that maps refer to.

    Args:
        folders: searched recursively.
        knowledge: resolves the names of meshes in maps.
        progress: called with the number of files that are imported, and of all that have to be.
        decompose: whether collision shapes are convex parts of meshes; otherwise they are convex hulls.

    Raises:
        SourceParseError: one of the folders does not exist.
    """
    from mindstage.assets import MeshLibrary

    listed = [folders] if isinstance(folders, str | os.PathLike) else folders
    paths = [Path(folder) for folder in listed]
    for path in paths:
        if not path.is_dir():
            raise SourceParseError(str(path), cause="there is no such folder; assets takes folders of mesh files")
    return MeshLibrary(paths, find_file=knowledge.find_file, progress=progress, decompose=decompose)


def _dialect(name: str) -> FileDialect:
    try:
        return FileDialect(name)
    except ValueError:
        remedy = f"use one of {', '.join(FileDialect)}"
        raise InvalidArgumentError(f"the dialect {name!r}", cause="there is no such dialect", remedy=remedy) from None


def _save_map(
    world: World, path: Path, syntax: MapFormat, dialect: FileDialect, knowledge: KnowledgeBase | None
) -> tuple[str, ...]:
    from mindstage.maps import MapDialect, save_map

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
    primitive_shapes: bool,
    actuated: Sequence[ActuatedBodies],
) -> FittedGeometry:
    """The geometry that is written: none for plain shapes; that of robots is their own."""
    from mindstage.geometry import FittedGeometry, fit_geometry
    from mindstage.scene import NO_GEOMETRY

    if primitive_shapes:
        return FittedGeometry(NO_GEOMETRY)
    fitted = fit_geometry(world, knowledge, meshes=mesh_assets(assets, knowledge))
    own = {id: each for bodies in actuated for id, each in bodies.geometry.items()}
    return replace(fitted, geometry={**fitted.geometry, **own}) if own else fitted


def _save_mjcf(written: WrittenWorld) -> tuple[str, ...]:
    from mindstage.engines.mujoco import world_to_mjcf

    path, folder = written.path, f"{written.path.stem}_assets"
    model = world_to_mjcf(
        written.world,
        geometry=written.geometry,
        find_mesh=written.find_mesh,
        actuated=written.actuated,
        visuals_folder=folder if written.geometry else None,
    )
    _save_model(path, model.text.encode(), path.parent / folder, model.files)
    return tuple(model.notes)


def _save_gltf(written: WrittenWorld) -> tuple[str, ...]:
    from mindstage.assets.gltf import world_to_glb
    from mindstage.maps.io.write import save_file

    data, notes = world_to_glb(written.world, geometry=written.geometry)
    save_file(written.path, data)
    return tuple(notes)


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


def _save_godot_scene(written: WrittenWorld) -> tuple[str, ...]:
    """Spawns the world in a Godot process, which saves it as a scene."""
    from tempfile import TemporaryDirectory

    from mindstage.engines.remote.godot import GodotEngine
    from mindstage.maps.io.write import save_file

    engine = GodotEngine(written.godot)
    try:
        report = engine.apply(Spawn(written.world, geometry=written.geometry)).report
        with TemporaryDirectory(prefix="mindstage-") as folder:
            scene = Path(folder, "scene.tscn")
            engine.save_scene(scene)
            save_file(written.path, scene.read_bytes())
    finally:
        engine.close()
    failed = (*report.failed_bodies, *report.failed_joints, *report.failed_attachments)
    return tuple(f"{each.id} is not in the scene: {each.reason}" for each in failed)


OWL = WorldFormat(
    suffixes=(".owl", ".rdf"), title="Semantic map, OWL", media_type="application/rdf+xml", syntax=MapFormat.RDF_XML
)
TURTLE = WorldFormat(
    suffixes=(".ttl",), title="Semantic map, Turtle", media_type="text/turtle", syntax=MapFormat.TURTLE
)
MJCF = WorldFormat(suffixes=(".mjcf", ".xml"), title="MuJoCo model", write=_save_mjcf)
GLTF = WorldFormat(suffixes=(".glb",), title="glTF scene", media_type="model/gltf-binary", write=_save_gltf)
"""Visual geometry and lights."""
GODOT = WorldFormat(suffixes=(".tscn",), title="Godot scene", write=_save_godot_scene)
"""Godot has to be installed."""
