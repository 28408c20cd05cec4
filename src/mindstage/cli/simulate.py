"""`mindstage check`: proves that a map comes back from a running world with nothing lost.

`mindstage log`: a running world as a semantic map.

`mindstage spawn`: a map as a world that lives.
"""

from __future__ import annotations

import gc
from collections.abc import Iterable
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import typer

from mindstage.cli.options import (
    AsJson,
    AssetFolders,
    Bundled,
    ConventionOptions,
    Delta,
    EngineName,
    ExitCode,
    FrameNames,
    MapArguments,
    MapName,
    Ontologies,
    PageHost,
    PageToken,
    PlainBoxes,
    Port,
    QuaternionOrders,
    Robots,
    Seconds,
    Strict,
    UnitNames,
    Verbose,
    close_at_end,
    finite,
)
from mindstage.cli.output import (
    Timings,
    diff_json,
    findings_json,
    import_summary,
    is_complete,
    losses_json,
    print_diff,
    print_findings,
    print_import_summary,
    print_json,
    print_line,
    print_losses,
    print_report,
    print_table,
    progress_spinner,
    report_json,
    step_with_progress,
)
from mindstage.cli.setup import (
    exclusive,
    findings_about,
    is_remote_engine,
    knowledge_base,
    make_engine,
    simulation_from_options,
)
from mindstage.cli.viewer import LOOPBACK, check_token_given, print_and_serve
from mindstage.errors import InvalidArgumentError

if TYPE_CHECKING:
    from mindstage.engines import Engine
    from mindstage.knowledge import KnowledgeBase, SourceMapView
    from mindstage.scene import Body, Joint, Light, Statement, World, WorldDiff
    from mindstage.simulation import Simulation

__all__ = ["check", "log", "spawn"]


Maps = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[MAP]…",
        help="A semantic map, or bundled:kitchen; without one, what runs in a far engine is logged as it is.",
        show_default=False,
    ),
]


def log(
    maps: Maps = None,
    *,
    out: Annotated[
        Path,
        typer.Option(
            "--out", "-o", metavar="OUT", help="The map to write: .owl, .rdf, .xml or .ttl.", show_default=False
        ),
    ],
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
    seconds: Annotated[
        float,
        typer.Option("--for", metavar="SECONDS", min=0.0, callback=finite, help="Simulated time before it is logged."),
    ] = 0.0,
    as_json: AsJson = False,
) -> ExitCode:
    """Spawn a map, let time pass, and log the world as it is then; exit 1 if anything could not be spawned.

    Without a map, the world that runs in a far engine is logged.
    """
    running = make_engine(engine)  # first: a wrong name is told before a long map is read
    if not maps:
        return _snapshot_remote(running, out, seconds=seconds, as_json=as_json)
    with progress_spinner("reading"):
        knowledge = knowledge_base(
            maps,
            ontologies=ontologies,
            bundled=bundled,
            robots=robots,
            conventions=ConventionOptions(units, frame, quaternion),
        )
        world = knowledge.world(map_name)
    findings = findings_about(world, knowledge, strict=strict)
    with simulation_from_options(knowledge, running, assets=assets, plain_boxes=plain_boxes) as stage:
        with progress_spinner("spawning"):
            report = stage.spawn(world)
        told = _write(stage, out, seconds=seconds)
    if as_json:
        print_json(
            told
            | {"spawn": report_json(report), "findings": findings_json(findings)}
            | import_summary(world, knowledge)
        )
    else:
        print_findings(findings)
        print_import_summary(world, knowledge)
        print_report(report, title=world.name, verbose=False)
        _print_summary(told)
    return ExitCode.OK if is_complete(report, findings) else ExitCode.NEGATIVE


def _snapshot_remote(running: Engine, out: Path, *, seconds: float, as_json: bool) -> ExitCode:
    """Logs what runs somewhere else.

    Raises:
        InvalidArgumentError: the engine is here, and nothing is in it yet.
    """
    from mindstage.knowledge import KnowledgeBase
    from mindstage.simulation import Simulation

    if not is_remote_engine(running.name):
        remedy = "name a map, or --engine ros://HOST:PORT/NAMESPACE"
        raise InvalidArgumentError("MAP", cause=f"nothing runs in the engine {running.name!r} yet", remedy=remedy)
    with Simulation(KnowledgeBase(), running) as stage:
        told = _write(stage, out, seconds=seconds)
    if as_json:
        print_json(told)
    else:
        _print_summary(told)
    return ExitCode.OK


def _write(simulation: Simulation, out: Path, *, seconds: float) -> dict[str, object]:
    """Lets time pass, writes the world, and says what was written."""
    from mindstage.knowledge import save_map

    step_with_progress(simulation, seconds)
    with progress_spinner("logging"):
        logged = simulation.snapshot()
        save_map(logged, out)
    return {
        "map": logged.iri,
        "engine": simulation.engine_name,
        "simulated_s": seconds,
        "out": str(out),
        "bodies": len(logged.bodies),
        "constraints": len(logged.joints),
    }


def _print_summary(summary: dict[str, object]) -> None:
    print_line(f"{summary['bodies']} bodies, {summary['constraints']} constraints → {summary['out']}")


def spawn(
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
    with_viewport: Annotated[
        bool, typer.Option(" /--no-viewport", help="Do not show the world in the browser.", show_default=False)
    ] = True,
    port: Port = 8080,
    host: PageHost = LOOPBACK,
    token: PageToken = None,
    seconds: Seconds = None,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> ExitCode:
    """Spawn a map into an engine, report what became of it, and let it live; exit 1 if anything is missing."""
    check_token_given(host, token)
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
    with simulation_from_options(knowledge, running, assets=assets, plain_boxes=plain_boxes) as stage:
        with progress_spinner("spawning"), watch.measure("spawn"):
            report = stage.spawn(world)
        told: dict[str, object] = {"map": world.iri, "engine": stage.engine_name, "spawn": report_json(report)}
        told |= {"seconds": watch.seconds, "findings": findings_json(findings)} | import_summary(world, knowledge)
        if not as_json:
            print_findings(findings)
            print_import_summary(world, knowledge, verbose=verbose)
            print_report(report, title=world.name, verbose=verbose)
        if with_viewport:
            print_and_serve(stage, told, port=port, host=host, token=token, duration_s=seconds, as_json=as_json)
        else:
            _run(stage, told, seconds=seconds or 0.0, as_json=as_json)
    return ExitCode.OK if is_complete(report, findings) else ExitCode.NEGATIVE


def _run(simulation: Simulation, summary: dict[str, object], *, seconds: float, as_json: bool) -> None:
    wall_s = step_with_progress(simulation, seconds)
    factor = seconds / wall_s if seconds else None
    if as_json:
        print_json(summary | {"simulated_s": seconds, "real_time_factor": factor})
    elif factor:
        print_line(f"{seconds:g} s simulated in {wall_s:.2f} s: {factor:.1f} times real time")


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
    from mindstage.scene import diff

    by_engine, found = diff(world, logged), diff(world, written.world(world.iri))
    things: Iterable[Body | Joint | Light] = chain(world.bodies, world.joints, world.lights)
    rounded = {change.id for change in by_engine.changed} - {change.id for change in by_engine.exceeding(delta)}
    moved = {thing.iri for thing in things if thing.id in rounded}
    return by_engine, found, lost_statements(origin, written.source_view(world.iri), moved=moved)
