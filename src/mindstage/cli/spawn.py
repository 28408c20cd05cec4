"""`mindstage spawn`: a map as a world that lives."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from mindstage.cli.engine import make_engine
from mindstage.cli.numbers import Numbers
from mindstage.cli.options import (
    AsJson,
    AssetFolders,
    Bundled,
    EngineName,
    FrameNames,
    MapName,
    Maps,
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
from mindstage.cli.outcome import Outcome
from mindstage.cli.output import findings_json, print_findings, print_json, say, working
from mindstage.cli.page import LOOPBACK, refuse_open_doors, show_told
from mindstage.cli.passing import let_pass
from mindstage.cli.reading import print_reading, reading_json
from mindstage.cli.report import everything_stands, print_report, report_json
from mindstage.cli.sources import findings_about, knowledge_base
from mindstage.cli.staging import stage_for
from mindstage.cli.stopwatch import Stopwatch

if TYPE_CHECKING:
    from mindstage.stage import Stage

__all__ = ["spawn"]


def spawn(
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
    with_viewport: Annotated[
        bool, typer.Option(" /--no-viewport", help="Do not show the world in the browser.", show_default=False)
    ] = True,
    port: Port = 8080,
    host: PageHost = LOOPBACK,
    token: PageToken = None,
    seconds: Seconds = None,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> Outcome:
    """Spawn a map into an engine, report what became of it, and let it live; exit 1 if anything is missing."""
    refuse_open_doors(host, token)
    running = make_engine(engine)  # first: a wrong name is told before a long map is read
    watch = Stopwatch()
    with working("reading"), watch.measure("load"):
        knowledge = knowledge_base(
            maps, ontologies=ontologies, bundled=bundled, robots=robots, numbers=Numbers(units, frame, quaternion)
        )
        world = knowledge.world(map_name)
    findings = findings_about(world, knowledge, strict=strict)
    with stage_for(knowledge, running, assets=assets, plain_boxes=plain_boxes) as stage:
        with working("spawning"), watch.measure("spawn"):
            report = stage.spawn(world)
        told: dict[str, object] = {"map": world.iri, "engine": stage.engine_name, "spawn": report_json(report)}
        told |= {"seconds": watch.seconds, "findings": findings_json(findings)} | reading_json(world, knowledge)
        if not as_json:
            print_findings(findings)
            print_reading(world, knowledge, verbose=verbose)
            print_report(report, title=world.name, verbose=verbose)
        if with_viewport:
            show_told(stage, told, port=port, host=host, token=token, duration_s=seconds, as_json=as_json)
        else:
            _run(stage, told, seconds=seconds or 0.0, as_json=as_json)
    return Outcome.DONE if everything_stands(report, findings) else Outcome.NO


def _run(stage: Stage, told: dict[str, object], *, seconds: float, as_json: bool) -> None:
    wall_s = let_pass(stage, seconds)
    factor = seconds / wall_s if seconds else None
    if as_json:
        print_json(told | {"simulated_s": seconds, "real_time_factor": factor})
    elif factor:
        say(f"{seconds:g} s simulated in {wall_s:.2f} s: {factor:.1f} times real time")
