"""`mindstage check`: proves that a map comes back from a running world with nothing lost."""

from __future__ import annotations

import gc
from collections.abc import Iterable
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from mindstage.cli.engine import alone_in, make_engine
from mindstage.cli.numbers import Numbers
from mindstage.cli.options import (
    AsJson,
    AssetFolders,
    Bundled,
    Delta,
    EngineName,
    FrameNames,
    MapName,
    Maps,
    Ontologies,
    PlainBoxes,
    QuaternionOrders,
    Robots,
    Strict,
    UnitNames,
    Verbose,
)
from mindstage.cli.outcome import Outcome, at_end
from mindstage.cli.output import findings_json, print_findings, print_json, print_table, working
from mindstage.cli.reading import print_reading, reading_json
from mindstage.cli.report import everything_stands, print_report, report_json
from mindstage.cli.sources import findings_about, knowledge_base
from mindstage.cli.staging import stage_for
from mindstage.cli.stopwatch import Stopwatch
from mindstage.cli.verdict import difference_json, losses_json, print_difference, print_losses

if TYPE_CHECKING:
    from mindstage.knowledge import KnowledgeBase, Origin
    from mindstage.world import Body, Constraint, Difference, Light, Statement, World

__all__ = ["check"]

_NO_XML = frozenset({".ttl", ".nt", ".n3", ".trig", ".nq"})
"""Maps of these formats may hold names and letters that RDF/XML has no way to write."""


def check(
    maps: Maps,
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
) -> Outcome:
    """Spawn a map, log it back, write it, read it again, and compare; exit 0 only if nothing was lost.

    The world goes the whole way round: map, engine, logger, OWL file in the map's own dialect, map. Compared are the
    two worlds, and every statement of the map.
    """
    if gc.isenabled():  # nothing here makes circular garbage, and all that is made is needed until the end
        gc.disable()
        at_end(gc.enable)
    running = make_engine(engine)  # first: a wrong name is told before a long map is read
    watch = Stopwatch()
    with working("reading"), watch.measure("load"):
        knowledge = knowledge_base(
            maps, ontologies=ontologies, bundled=bundled, robots=robots, numbers=Numbers(units, frame, quaternion)
        )
        world = knowledge.world(map_name)
    findings = findings_about(world, knowledge, strict=strict)
    with stage_for(knowledge, running, assets=assets, plain_boxes=plain_boxes) as stage, alone_in(stage):
        name = stage.engine_name
        with working("spawning"), watch.measure("spawn"):
            report = stage.spawn(world)
        with working("logging"), watch.measure("log"):
            logged = stage.log()
    with working("writing and reading back"), watch.measure("file"):
        origin = knowledge.origin(world.iri)
        name_of_file = "logged.ttl" if any(Path(map).suffix.lower() in _NO_XML for map in maps) else "logged.owl"
        written = _through_a_file(name_of_file, logged, origin, ontologies=ontologies, bundled=bundled)
        written.world(world.iri)
    with working("comparing"), watch.measure("compare"):
        by_engine, found, lost = _compared(world, logged, written, origin, delta)
    identical = by_engine.identical(delta) and found.identical(delta) and not lost
    if as_json:
        told = difference_json(found, delta) | losses_json(found, lost) | {"identical": identical, "engine": name}
        told |= {"identical_before_file": by_engine.identical(delta), "dialect": origin.dialect}
        told |= {"spawn": report_json(report), "seconds": watch.seconds}
        print_json(told | {"map": world.iri, "findings": findings_json(findings)} | reading_json(world, knowledge))
    else:
        print_findings(findings)
        print_reading(world, knowledge, verbose=verbose)
        print_report(report, title=world.name, verbose=verbose)
        print_table("Seconds", tuple(watch.seconds), [[round(spent, 3) for spent in watch.seconds.values()]])
        # What the engine lost is lost in the file too; shown once, where it happened.
        print_difference(found if by_engine.identical(delta) else by_engine, delta, about=world)
        print_losses(lost)
    return Outcome.DONE if identical and everything_stands(report, findings) else Outcome.NO


def _through_a_file(
    name: str, world: World, origin: Origin, *, ontologies: list[str] | None, bundled: bool
) -> KnowledgeBase:
    from mindstage.knowledge import save_map

    with TemporaryDirectory(prefix="mindstage-") as folder:
        path = Path(folder, name)
        save_map(world, path, origin=origin)
        return knowledge_base([str(path)], ontologies=ontologies, bundled=bundled)


def _compared(
    world: World, logged: World, written: KnowledgeBase, origin: Origin, delta: float
) -> tuple[Difference, Difference, tuple[Statement, ...]]:
    """What the engine changed, what is otherwise after the file, and the statements that it does not make."""
    from mindstage.knowledge import lost_statements
    from mindstage.world import difference

    by_engine, found = difference(world, logged), difference(world, written.world(world.iri))
    things: Iterable[Body | Constraint | Light] = chain(world.bodies, world.constraints, world.lights)
    rounded = {change.id for change in by_engine.changed} - {change.id for change in by_engine.beyond(delta)}
    moved = {thing.iri for thing in things if thing.id in rounded}
    return by_engine, found, lost_statements(origin, written.origin(world.iri), moved=moved)
