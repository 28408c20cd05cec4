"""Sources: from what was typed to a knowledge base.

Engine: from the name that was typed to an engine that runs.

Staging: a simulation as a verb's options want it.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from mindstage.api import load_knowledge, make_simulation
from mindstage.cli.options import DEFAULT_CONVENTIONS, ConventionOptions, close_at_end
from mindstage.errors import (
    EngineUnavailableError,
    InvalidArgumentError,
    MapRejectedError,
    MindstageError,
    SourceParseError,
)

if TYPE_CHECKING:
    from mindstage.engines import Engine
    from mindstage.knowledge import Finding, KnowledgeBase, SparqlEndpoint
    from mindstage.scene import World
    from mindstage.simulation import Simulation

__all__ = [
    "asset_folders",
    "exclusive",
    "findings_about",
    "godot_program",
    "is_remote_engine",
    "knowledge_base",
    "make_engine",
    "simulation_from_options",
]


def make_engine(name: str) -> Engine:
    """`mindstage.engines.make_engine` with the Godot that the environment's `GODOT` names; closed when the verb ends.

    Raises:
        EngineUnavailableError: there is no such engine, it cannot be loaded or started here, or reached.
    """
    from mindstage import engines

    # Nothing is drawn with OpenGL here, and looking for it takes longer than all the rest of MuJoCo's loading.
    os.environ.setdefault("MUJOCO_GL", "disable")
    engine = engines.make_engine(name, godot=godot_program())
    close_at_end(engine.close)
    return engine


def godot_program() -> str | None:
    """The Godot program that the environment names."""
    return os.environ.get("GODOT") or None


def is_remote_engine(name: str) -> bool:
    """Whether the name is the address of an engine that runs elsewhere, with a world that outlives the verb."""
    from mindstage.engines import is_remote

    return is_remote(name)


@contextmanager
def exclusive(simulation: Simulation) -> Iterator[None]:
    """Makes sure that a far world is empty to begin with, and leaves it so; any other is so by itself.

    Raises:
        EngineUnavailableError: something stands there already.
    """
    if not is_remote_engine(simulation.engine_name):
        yield
        return
    there = simulation.snapshot()
    if there.bodies or there.lights or there.facts or there.resources:
        cause = f"its world is not empty ({there.name or there.iri}, with {len(there.bodies)} bodies)"
        remedy = "use a stage that has no map yet, as mindstage serve alone starts one"
        raise EngineUnavailableError(simulation.engine_name, cause=cause, remedy=remedy)
    try:
        yield
    except BaseException:
        with suppress(MindstageError):  # what went wrong first is what is told
            simulation.clear()
        raise
    simulation.clear()


def simulation_from_options(
    knowledge: KnowledgeBase, engine: Engine, *, assets: list[Path] | None = None, plain_boxes: bool = False
) -> Simulation:
    """`mindstage.api.simulation_from_options` for a verb's options.

    Args:
        knowledge: what is known.
        engine: who runs it.
        assets: folders of meshes, besides what the map itself names.
        plain_boxes: whether every body is the primitive shape that the map says, and nothing better.

    Raises:
        SourceParseError: one of the folders is none.
    """
    folders = () if plain_boxes else asset_folders(assets)
    return make_simulation(knowledge, engine, assets=folders, plain_shapes=plain_boxes)


def asset_folders(folders: list[Path] | None) -> list[Path]:
    """The folders of `--assets`.

    Raises:
        SourceParseError: one of them does not exist.
    """
    for folder in folders or ():
        if not folder.is_dir():
            raise SourceParseError(str(folder), cause="there is no such folder; --assets takes folders of mesh files")
    return folders or []


def knowledge_base(
    maps: Sequence[str],
    *,
    ontologies: Sequence[str] | None,
    bundled: bool,
    store: Path | None = None,
    endpoint: str | SparqlEndpoint | None = None,
    conventions: ConventionOptions = DEFAULT_CONVENTIONS,
    robots: Sequence[str] | None = None,
    closure: bool = False,
) -> KnowledgeBase:
    """`mindstage.api.load_knowledge` for a verb's options, with the environment's ROS packages; closed when it ends.

    Raises:
        SourceParseError: one of them cannot be read.
        StoreError: the folder cannot be used.
        InvalidArgumentError: the endpoint's address is none, or both were given; or there are no such units, or no such map.
        ReasonerUnavailableError: the extra that derives is not installed.
    """
    if closure and store:
        cause = "what it derives would be written into what others use"
        raise InvalidArgumentError("--closure", cause=cause, remedy="load the files themselves, without --store")
    knowledge = load_knowledge(
        maps,
        ontologies=[*(ontologies or ()), *_ros_packages()],
        bundled_ontology=bundled,
        robots=robots or (),
        conventions=conventions.by_map(maps),
        store=store,
        endpoint=endpoint,
        closure=closure,
    )
    close_at_end(knowledge.close)
    return knowledge


def findings_about(world: World, knowledge: KnowledgeBase, *, strict: bool = False) -> tuple[Finding, ...]:
    """Everything odd, an empty world among it: more likely a map that was not understood than an empty place.

    Raises:
        MapRejectedError: there is something, and nothing was to be.
    """
    from mindstage.knowledge import Finding, Severity

    findings = knowledge.findings()
    if not world.bodies:
        what = "nothing in it could be read as a body; is it a map?"
        findings = (*findings, Finding(Severity.WARNING, world.iri, "", what, "the world is empty"))
    if strict and findings:
        raise MapRejectedError(world.iri, findings=[str(finding) for finding in findings])
    return findings


def _ros_packages() -> list[str]:
    # ROS itself says nothing about folders of that list which do not exist.
    folders = os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)
    return [folder for folder in folders if folder and Path(folder).is_dir()]
