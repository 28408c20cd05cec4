"""`mindstage log`: a running world as a semantic map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mindstage.cli.engine import is_remote_engine, make_engine
from mindstage.cli.numbers import ConventionOptions
from mindstage.cli.options import (
    AsJson,
    AssetFolders,
    Bundled,
    EngineName,
    FrameNames,
    MapName,
    Ontologies,
    PlainBoxes,
    QuaternionOrders,
    Robots,
    Strict,
    UnitNames,
    finite,
)
from mindstage.cli.outcome import ExitCode
from mindstage.cli.output import findings_json, print_findings, print_json, print_line, progress_spinner
from mindstage.cli.passing import step_with_progress
from mindstage.cli.reading import import_summary, print_import_summary
from mindstage.cli.report import is_complete, print_report, report_json
from mindstage.cli.sources import findings_about, knowledge_base
from mindstage.cli.staging import simulation_from_options
from mindstage.errors import InvalidArgumentError

if TYPE_CHECKING:
    from mindstage.engines import Engine
    from mindstage.stage import Simulation

__all__ = ["log"]


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
    from mindstage.stage import Simulation

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
