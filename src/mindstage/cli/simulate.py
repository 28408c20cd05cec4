"""`mindstage check`: proves that a map comes back from a running world with nothing lost."""

from __future__ import annotations

import gc
from collections.abc import Iterable
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from mindstage.cli.engine import exclusive, make_engine
from mindstage.cli.numbers import ConventionOptions
from mindstage.cli.options import (
    AsJson,
    AssetFolders,
    Bundled,
    Delta,
    EngineName,
    FrameNames,
    MapArguments,
    MapName,
    Ontologies,
    PlainBoxes,
    QuaternionOrders,
    Robots,
    Strict,
    UnitNames,
    Verbose,
)
from mindstage.cli.outcome import ExitCode, close_at_end
from mindstage.cli.output import findings_json, print_findings, print_json, print_table, progress_spinner
from mindstage.cli.reading import import_summary, print_import_summary
from mindstage.cli.report import is_complete, print_report, report_json
from mindstage.cli.sources import findings_about, knowledge_base
from mindstage.cli.staging import simulation_from_options
from mindstage.cli.stopwatch import Timings
from mindstage.cli.verdict import diff_json, losses_json, print_diff, print_losses

if TYPE_CHECKING:
    from mindstage.knowledge import KnowledgeBase, SourceMapView
    from mindstage.world import Body, Joint, Light, Statement, World, WorldDiff

__all__ = ["check"]

_NON_XML_SUFFIXES = frozenset({".ttl", ".nt", ".n3", ".trig", ".nq"})
"""Maps of these formats may hold names and letters that RDF/XML has no way to write."""


def check(
    maps: MapArguments,
    *,
    map_name: MapName = None,
    ontologies: Ontologies = None,
    bundled: Bundled = True,
    robots: Robots = None,
    units: UnitNames = None,
    frame: FrameNames = None,
    quaternion: QuaternionOrders = None,
    strict: Strict = False,
    assets: AssetFolders = None,
    plain_boxes: PlainBoxes = False,
    engine: EngineName = "mujoco",
    delta: Delta = 0.0,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> ExitCode:
    """Spawn a map, log it back, write it, read it again, and compare; exit 0 only if nothing was lost.

    The world goes the whole way round: map, engine, logger, OWL file in the map's own dialect, map. Compared are the
    two worlds, and every statement of the map.
    """
    if gc.isenabled():  # nothing here makes circular garbage, and all that is made is needed until the end
        gc.disable()
        close_at_end(gc.enable)
    running = make_engine(engine)  # first: a wrong name is told before a long map is read
    watch = Timings()
    with progress_spinner("reading"), watch.measure("load"):
        knowledge = knowledge_base(
            maps,
            ontologies=ontologies,
            bundled=bundled,
            robots=robots,
            conventions=ConventionOptions(units, frame, quaternion),
        )
        world = knowledge.world(map_name)
    findings = findings_about(world, knowledge, strict=strict)
    with simulation_from_options(knowledge, running, assets=assets, plain_boxes=plain_boxes) as stage, exclusive(stage):
        name = stage.engine_name
        with progress_spinner("spawning"), watch.measure("spawn"):
            report = stage.spawn(world)
        with progress_spinner("logging"), watch.measure("log"):
            logged = stage.snapshot()
    with progress_spinner("writing and reading back"), watch.measure("file"):
        origin = knowledge.source_view(world.iri)
        name_of_file = (
            "logged.ttl" if any(Path(map).suffix.lower() in _NON_XML_SUFFIXES for map in maps) else "logged.owl"
        )
        written = _file_round_trip(name_of_file, logged, origin, ontologies=ontologies, bundled=bundled)
        written.world(world.iri)
    with progress_spinner("comparing"), watch.measure("compare"):
        by_engine, found, lost = _compare_round_trip(world, logged, written, origin, delta)
    identical = by_engine.identical(delta) and found.identical(delta) and not lost
    if as_json:
        told = diff_json(found, delta) | losses_json(found, lost) | {"identical": identical, "engine": name}
        told |= {"identical_before_file": by_engine.identical(delta), "dialect": origin.dialect}
        told |= {"spawn": report_json(report), "seconds": watch.seconds}
        print_json(told | {"map": world.iri, "findings": findings_json(findings)} | import_summary(world, knowledge))
    else:
        print_findings(findings)
        print_import_summary(world, knowledge, verbose=verbose)
        print_report(report, title=world.name, verbose=verbose)
        print_table("Seconds", tuple(watch.seconds), [[round(spent, 3) for spent in watch.seconds.values()]])
        # What the engine lost is lost in the file too; shown once, where it happened.
        print_diff(found if by_engine.identical(delta) else by_engine, delta, about=world)
        print_losses(lost)
    return ExitCode.OK if identical and is_complete(report, findings) else ExitCode.NEGATIVE


def _file_round_trip(
    name: str, world: World, origin: SourceMapView, *, ontologies: list[str] | None, bundled: bool
) -> KnowledgeBase:
    from mindstage.knowledge import save_map

    with TemporaryDirectory(prefix="mindstage-") as folder:
        path = Path(folder, name)
        save_map(world, path, source_view=origin)
        return knowledge_base([str(path)], ontologies=ontologies, bundled=bundled)


def _compare_round_trip(
    world: World, logged: World, written: KnowledgeBase, origin: SourceMapView, delta: float
) -> tuple[WorldDiff, WorldDiff, tuple[Statement, ...]]:
    """What the engine changed, what is otherwise after the file, and the statements that it does not make."""
    from mindstage.knowledge import lost_statements
    from mindstage.world import diff

    by_engine, found = diff(world, logged), diff(world, written.world(world.iri))
    things: Iterable[Body | Joint | Light] = chain(world.bodies, world.joints, world.lights)
    rounded = {change.id for change in by_engine.changed} - {change.id for change in by_engine.exceeding(delta)}
    moved = {thing.iri for thing in things if thing.id in rounded}
    return by_engine, found, lost_statements(origin, written.source_view(world.iri), moved=moved)
