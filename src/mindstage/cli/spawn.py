"""`mindstage spawn`: a map as a world that lives."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from mindstage.cli.engine import make_engine
from mindstage.cli.numbers import ConventionOptions
from mindstage.cli.options import (
    AsJson,
    AssetFolders,
    Bundled,
    EngineName,
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
)
from mindstage.cli.outcome import ExitCode
from mindstage.cli.output import findings_json, print_findings, print_json, print_line, progress_spinner
from mindstage.cli.page import LOOPBACK, check_token_given, print_and_serve
from mindstage.cli.passing import step_with_progress
from mindstage.cli.reading import import_summary, print_import_summary
from mindstage.cli.report import is_complete, print_report, report_json
from mindstage.cli.sources import findings_about, knowledge_base
from mindstage.cli.staging import simulation_from_options
from mindstage.cli.stopwatch import Timings

if TYPE_CHECKING:
    from mindstage.stage import Simulation

__all__ = ["spawn"]


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
