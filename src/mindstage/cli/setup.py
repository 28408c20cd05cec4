"""Creates the knowledge base, the engine and the simulation of a verb from its options and the environment.

Only this package reads environment variables: `GODOT` and `ROS_PACKAGE_PATH`.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

from mindstage.api import load_knowledge, make_simulation
from mindstage.cli.options import (
    DEFAULT_READING,
    DEFAULT_SHAPES,
    EpisodeOptions,
    MapReading,
    ShapeOptions,
    close_at_end,
)
from mindstage.cli.output import show_mesh_progress, warn
from mindstage.errors import (
    EngineUnavailableError,
    InvalidArgumentError,
    MapRejectedError,
    MindstageError,
    SourceParseError,
)
from mindstage.files import atomic_write, cache_dir

if TYPE_CHECKING:
    from mindstage.engines import Engine
    from mindstage.episodes.history import EpisodeHistory
    from mindstage.knowledge import KnowledgeBase, SparqlEndpoint
    from mindstage.maps import UnitConventions
    from mindstage.rdf import Finding
    from mindstage.scene import World
    from mindstage.simulation import Simulation

__all__ = [
    "exclusive",
    "findings_about",
    "godot_program",
    "is_remote_engine",
    "knowledge_base",
    "knowledge_with_episodes",
    "make_engine",
    "simulation_from_options",
]


def make_engine(name: str) -> Engine:
    """Makes an engine, with the Godot executable of the environment variable `GODOT`; closed when the verb ends.

    Raises:
        EngineUnavailableError: the engine is unknown, or cannot be loaded, started or reached.
    """
    from mindstage import engines

    # OpenGL is not used here, and searching for it takes most of the import time of MuJoCo.
    os.environ.setdefault("MUJOCO_GL", "disable")
    engine = engines.make_engine(name, godot=godot_program())
    close_at_end(engine.close)
    return engine


def godot_program() -> str | None:
    """The Godot executable of the environment variable `GODOT`."""
    return os.environ.get("GODOT") or None


def is_remote_engine(name: str) -> bool:
    """Whether the name is the URL of a remote engine, whose world outlives the verb."""
    from mindstage.engines import is_remote

    return is_remote(name)


@contextmanager
def exclusive(simulation: Simulation) -> Iterator[None]:
    """Requires the world of a remote engine to be empty, and clears it at the end of the `with` block.

    Raises:
        EngineUnavailableError: the remote world is not empty.
    """
    if not is_remote_engine(simulation.engine.name):
        yield
        return
    world = simulation.snapshot()
    if world.bodies or world.lights or world.facts or world.resources:
        cause = f"its world is not empty ({world.name or world.iri}, with {len(world.bodies)} bodies)"
        remedy = "use one without a map, as started by mindstage serve without arguments"
        raise EngineUnavailableError(simulation.engine.name, cause=cause, remedy=remedy)
    try:
        yield
    except BaseException:
        with suppress(MindstageError):  # the first error is the relevant one
            simulation.clear()
        raise
    simulation.clear()


def simulation_from_options(
    knowledge: KnowledgeBase, engine: Engine, options: ShapeOptions = DEFAULT_SHAPES, *, decompose: bool = True
) -> Simulation:
    """Makes an empty simulation; see `mindstage.api.make_simulation`.

    Args:
        engine: the engine, which the simulation owns.
        options: where mesh files are looked up besides the folders of the map, and whether they are used.
        decompose: whether collision shapes are convex parts of meshes, which is needed where something moves.

    Raises:
        SourceParseError: one of the folders does not exist.
    """
    return make_simulation(
        knowledge,
        engine,
        assets=options.asset_folders(),
        primitive_shapes=options.primitive_shapes,
        mesh_progress=show_mesh_progress,
        decompose=decompose,
    )


def knowledge_base(
    maps: Sequence[str],
    reading: MapReading = DEFAULT_READING,
    *,
    conventions: Sequence[UnitConventions] | None = None,
    store: Path | None = None,
    endpoint: str | SparqlEndpoint | None = None,
    closure: bool = False,
) -> KnowledgeBase:
    """Loads a knowledge base, with the ROS packages of the environment; closed when the verb ends.

    Args:
        maps: the sources.
        reading: how they are read.
        conventions: those of each map; by default those of `reading`.
        store: the folder of a persistent knowledge base.
        endpoint: a SPARQL endpoint that is queried too.
        closure: whether the OWL 2 RL closure is derived.

    Raises:
        SourceParseError: one of them cannot be read.
        StoreError: the store folder cannot be used.
        InvalidArgumentError: the endpoint is not a URL, options are mutually exclusive, or a convention is invalid.
        ReasonerUnavailableError: the extra "closure" is not installed.
    """
    if closure and store:
        cause = "it would write derived statements into a store that is shared"
        raise InvalidArgumentError("--closure", cause=cause, remedy="load the files without --store")
    knowledge = load_knowledge(
        [_as_file(map) for map in maps],
        ontologies=[*(reading.ontologies or ()), *_ros_packages()],
        bundled_ontology=reading.bundled,
        urdf=reading.urdf or (),
        xacro=reading.xacro_request,
        conventions=reading.conventions(maps) if conventions is None else conventions,
        store=store,
        endpoint=endpoint,
        closure=closure,
    )
    close_at_end(knowledge.close)
    with suppress(OSError):  # where nothing can be written, maps are read again
        knowledge.use_world_cache(cache_dir("worlds"))
    return knowledge


def knowledge_with_episodes(
    maps: Sequence[str],
    reading: MapReading,
    episodes: EpisodeOptions,
    *,
    store: Path | None = None,
    endpoint: str | None = None,
    closure: bool = False,
) -> KnowledgeBase:
    """Loads a knowledge base with episodes; everything is closed when the verb ends.

    Args:
        maps: the maps; without any, and without a store or an endpoint, the knowledge base is the one that the first
            episode was recorded with.
        reading: how the maps are read.
        episodes: files of episodes, or a folder of them; with a folder the files are names, and are not opened.
        store: see `knowledge_base`, as the next two.
        endpoint: see there.
        closure: see there.

    Raises:
        EpisodeFileError: a file cannot be read.
        InvalidArgumentError: the folder does not exist; see also `knowledge_base`.
    """
    folder = episodes.episodes
    opened = _open_episodes(episodes.episode) if episodes.episode and folder is None else []
    if opened and not maps and store is None and endpoint is None:
        knowledge = opened[0].knowledge()
        knowledge.load((), ontologies=[*(reading.ontologies or ()), *_ros_packages()])
        close_at_end(knowledge.close)
        if closure:
            knowledge.materialize()
    else:
        knowledge = knowledge_base(maps, reading, store=store, endpoint=endpoint, closure=closure)
    for each in opened:
        knowledge.add_episode(each)
    if folder is not None:
        from mindstage.episodes.memory import EpisodeMemory

        memory = EpisodeMemory(folder)
        close_at_end(memory.close)
        for problem in memory.problems:
            warn(f"left out: {problem.path}: {problem.cause}")
        knowledge.add_episode(memory)
    return knowledge


def _open_episodes(files: Sequence[str]) -> list[EpisodeHistory]:
    if not files:
        return []
    from mindstage.episodes.history import open_episode

    opened = [open_episode(file) for file in files]
    for each in opened:
        close_at_end(each.close)
    return opened


_STANDARD_INPUT = "-"


@cache
def _as_file(name: str) -> str:
    """The path of a map; what can be read only once, such as standard input (`-`) or a pipe, is copied to a file.

    Raises:
        SourceParseError: it cannot be read.
    """
    path = Path(name)
    if name != _STANDARD_INPUT and (not path.exists() or path.is_file() or path.is_dir()):
        return name
    try:
        content = sys.stdin.buffer.read() if name == _STANDARD_INPUT else path.read_bytes()
    except (OSError, AttributeError) as error:  # a closed standard input is None
        cause = getattr(error, "strerror", None) or "standard input is closed"
        raise SourceParseError(name, cause=cause) from error
    if not content.strip():
        raise SourceParseError(name, cause="nothing was written to it; pipe a map into it")
    folder = Path(tempfile.mkdtemp(prefix="mindstage-input-"))
    close_at_end(partial(shutil.rmtree, folder, ignore_errors=True))
    close_at_end(_as_file.cache_clear)
    file = folder / "standard-input"
    atomic_write(file, content)
    return str(file)


def findings_about(
    world: World, knowledge: KnowledgeBase, *, strict: bool = False, options: ShapeOptions = DEFAULT_SHAPES
) -> tuple[Finding, ...]:
    """The findings of the knowledge base, one if mesh files are missing, and one if the world is empty.

    Args:
        knowledge: the knowledge base that it was read from.
        strict: whether findings are errors.
        options: where mesh files are looked up.

    Raises:
        MapRejectedError: with `strict`, if there are findings.
        SourceParseError: one of the folders does not exist.
    """
    from mindstage.rdf import Finding, Severity

    findings = knowledge.findings()
    if (missing := _missing_meshes(world, knowledge, options.asset_folders())) is not None:
        findings = (*findings, missing)
    if not world.bodies:
        cause = "no bodies were found in it; is it a semantic map?"
        findings = (*findings, Finding(Severity.WARNING, world.iri, "", cause, "the world is empty"))
    if strict and findings:
        raise MapRejectedError(world.iri, findings=[str(finding) for finding in findings])
    return findings


def _missing_meshes(world: World, knowledge: KnowledgeBase, folders: Sequence[Path]) -> Finding | None:
    """One finding about all mesh files that a map names and that were not found; None if there is none."""
    from mindstage.assets.library import MeshIndex
    from mindstage.maps.rdf_mapping.properties import MESH
    from mindstage.rdf import Finding, Severity

    named = [body for body in world.bodies if body.mesh]
    if not named:
        return None
    index = MeshIndex(folders, find_file=knowledge.find_file)
    missing = [body for body in named if index.find(body) is None]
    if not missing:
        return None
    files = dict.fromkeys(body.mesh for body in missing)
    count = "1 mesh file is" if len(files) == 1 else f"{len(files):,} mesh files are"
    problem = f"{count} missing, of {len(missing):,} of {len(world.bodies):,} bodies, such as {next(iter(files))}"
    action = "the shapes follow from classes and sizes; give the folder of the files with --assets DIR"
    return Finding(Severity.WARNING, world.iri, MESH.property, problem, action)


def _ros_packages() -> list[str]:
    # As in ROS, folders in the list that do not exist are ignored.
    folders = os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)
    return [folder for folder in folders if folder and Path(folder).is_dir()]
