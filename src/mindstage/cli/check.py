"""`mindstage check`: proves that a map comes back from a running world with nothing lost."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from mindstage.cli.engine import make_engine
from mindstage.cli.options import AsJson, Bundled, Delta, EngineName, MapName, Maps, Ontologies, Verbose
from mindstage.cli.outcome import Outcome
from mindstage.cli.output import findings_json, print_findings, print_json, print_table, working
from mindstage.cli.report import everything_stands, print_report, report_json
from mindstage.cli.sources import findings_about, knowledge_base
from mindstage.cli.stopwatch import Stopwatch
from mindstage.cli.verdict import difference_json, print_difference

if TYPE_CHECKING:
    from mindstage.world import World

__all__ = ["check"]


def check(
    maps: Maps,
    *,
    map_name: MapName = None,
    ontologies: Ontologies = None,
    bundled: Bundled = True,
    engine: EngineName = "mujoco",
    delta: Delta = 0.0,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> Outcome:
    """Spawn a map, log it back, write it, read it again, and compare; exit 0 only if nothing was lost.

    The world goes the whole way round: map, engine, logger, OWL file, map.
    """
    from mindstage.stage import Stage
    from mindstage.world import difference

    running = make_engine(engine)  # first: a wrong name is told before a long map is read
    watch = Stopwatch()
    with working("reading"), watch.measure("load"):
        knowledge = knowledge_base(maps, ontologies=ontologies, bundled=bundled)
        world = knowledge.world(map_name)
    findings = findings_about(world, knowledge)
    with Stage(knowledge, running) as stage:
        name = stage.engine_name
        with working("spawning"), watch.measure("spawn"):
            report = stage.spawn(world)
        with working("logging"), watch.measure("log"):
            logged = stage.log()
    with working("writing and reading back"), watch.measure("file"):
        returned = _through_a_file(logged, ontologies=ontologies, bundled=bundled)
    with working("comparing"), watch.measure("compare"):
        by_engine, found = difference(world, logged), difference(world, returned)
    identical = by_engine.identical(delta) and found.identical(delta)
    if as_json:
        told = difference_json(found, delta) | {"identical": identical, "engine": name, "spawn": report_json(report)}
        told |= {"identical_before_file": by_engine.identical(delta), "seconds": watch.seconds}
        print_json(told | {"map": world.iri, "findings": findings_json(findings)})
    else:
        print_findings(findings)
        print_report(report, title=world.name, verbose=verbose)
        print_table("Seconds", tuple(watch.seconds), [[round(spent, 3) for spent in watch.seconds.values()]])
        # What the engine lost is lost in the file too; shown once, where it happened.
        print_difference(found if by_engine.identical(delta) else by_engine, delta, about=world)
    return Outcome.DONE if identical and everything_stands(report, findings) else Outcome.NO


def _through_a_file(world: World, *, ontologies: list[str] | None, bundled: bool) -> World:
    from mindstage.knowledge import save_map

    with TemporaryDirectory(prefix="mindstage-") as folder:
        path = Path(folder, "logged.owl")
        save_map(world, path)
        return knowledge_base([str(path)], ontologies=ontologies, bundled=bundled).world(world.iri)
