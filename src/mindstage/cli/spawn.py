"""`mindstage spawn`: a map as a world that lives."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from mindstage.cli.engine import make_engine
from mindstage.cli.numbers import Numbers
from mindstage.cli.options import (
    AsJson,
    Bundled,
    EngineName,
    FrameNames,
    MapName,
    Maps,
    Ontologies,
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
from mindstage.cli.page import show_page
from mindstage.cli.passing import let_pass
from mindstage.cli.reading import print_reading, reading_json
from mindstage.cli.report import everything_stands, print_report, report_json
from mindstage.cli.sources import findings_about, knowledge_base
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
    engine: EngineName = "mujoco",
    with_viewport: Annotated[
        bool, typer.Option(" /--no-viewport", help="Do not show the world in the browser.", show_default=False)
    ] = True,
    port: Port = 8080,
    seconds: Seconds = None,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> Outcome:
    """Spawn a map into an engine, report what became of it, and let it live; exit 1 if anything is missing."""
    from mindstage.stage import Stage

    running = make_engine(engine)  # first: a wrong name is told before a long map is read
    watch = Stopwatch()
    with working("reading"), watch.measure("load"):
        knowledge = knowledge_base(
            maps, ontologies=ontologies, bundled=bundled, robots=robots, numbers=Numbers(units, frame, quaternion)
        )
        world = knowledge.world(map_name)
    findings = findings_about(world, knowledge, strict=strict)
    with Stage(knowledge, running) as stage:
        with working("spawning"), watch.measure("spawn"):
            report = stage.spawn(world)
        told: dict[str, object] = {"map": world.iri, "engine": stage.engine_name, "spawn": report_json(report)}
        told |= {"seconds": watch.seconds, "findings": findings_json(findings)} | reading_json(world, knowledge)
        if not as_json:
            print_findings(findings)
            print_reading(world, knowledge, verbose=verbose)
            print_report(report, title=world.name, verbose=verbose)
        if with_viewport:
            _show(stage, told, port=port, seconds=seconds, as_json=as_json)
        else:
            _run(stage, told, seconds=seconds or 0.0, as_json=as_json)
    return Outcome.DONE if everything_stands(report, findings) else Outcome.NO


def _show(stage: Stage, told: dict[str, object], *, port: int, seconds: float | None, as_json: bool) -> None:
    def announce(url: str) -> None:
        if as_json:
            print_json(told | {"url": url})  # now: whoever reads it wants to look while the world lives
        else:
            say(f"The world is open at {url}")

    show_page(stage, port=port, duration_s=seconds, announce=announce, quiet=as_json)


def _run(stage: Stage, told: dict[str, object], *, seconds: float, as_json: bool) -> None:
    wall_s = let_pass(stage, seconds)
    factor = seconds / wall_s if seconds else None
    if as_json:
        print_json(told | {"simulated_s": seconds, "real_time_factor": factor})
    elif factor:
        say(f"{seconds:g} s simulated in {wall_s:.2f} s: {factor:.1f} times real time")
