"""`mindstage log`: a running world as a semantic map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mindstage.cli.engine import is_far, make_engine
from mindstage.cli.numbers import Numbers
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
from mindstage.cli.outcome import Outcome
from mindstage.cli.output import findings_json, print_findings, print_json, say, working
from mindstage.cli.passing import let_pass
from mindstage.cli.reading import print_reading, reading_json
from mindstage.cli.report import everything_stands, print_report, report_json
from mindstage.cli.sources import findings_about, knowledge_base
from mindstage.cli.staging import stage_for
from mindstage.errors import ArgumentRefused

if TYPE_CHECKING:
    from mindstage.engines import Engine
    from mindstage.stage import Stage

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
) -> Outcome:
    """Spawn a map, let time pass, and log the world as it is then; exit 1 if anything could not be spawned.

    Without a map, the world that runs in a far engine is logged.
    """
    running = make_engine(engine)  # first: a wrong name is told before a long map is read
    if not maps:
        return _log_as_it_is(running, out, seconds=seconds, as_json=as_json)
    with working("reading"):
        knowledge = knowledge_base(
            maps, ontologies=ontologies, bundled=bundled, robots=robots, numbers=Numbers(units, frame, quaternion)
        )
        world = knowledge.world(map_name)
    findings = findings_about(world, knowledge, strict=strict)
    with stage_for(knowledge, running, assets=assets, plain_boxes=plain_boxes) as stage:
        with working("spawning"):
            report = stage.spawn(world)
        told = _write(stage, out, seconds=seconds)
    if as_json:
        print_json(
            told | {"spawn": report_json(report), "findings": findings_json(findings)} | reading_json(world, knowledge)
        )
    else:
        print_findings(findings)
        print_reading(world, knowledge)
        print_report(report, title=world.name, verbose=False)
        _say(told)
    return Outcome.DONE if everything_stands(report, findings) else Outcome.NO


def _log_as_it_is(running: Engine, out: Path, *, seconds: float, as_json: bool) -> Outcome:
    """Logs what runs somewhere else.

    Raises:
        ArgumentRefused: the engine is here, and nothing is in it yet.
    """
    from mindstage.knowledge import KnowledgeBase
    from mindstage.stage import Stage

    if not is_far(running.name):
        remedy = "name a map, or --engine ros://HOST:PORT/NAMESPACE"
        raise ArgumentRefused("MAP", cause=f"nothing runs in the engine {running.name!r} yet", remedy=remedy)
    with Stage(KnowledgeBase(), running) as stage:
        told = _write(stage, out, seconds=seconds)
    if as_json:
        print_json(told)
    else:
        _say(told)
    return Outcome.DONE


def _write(stage: Stage, out: Path, *, seconds: float) -> dict[str, object]:
    """Lets time pass, writes the world, and says what was written."""
    from mindstage.knowledge import save_map

    let_pass(stage, seconds)
    with working("logging"):
        logged = stage.log()
        save_map(logged, out)
    return {
        "map": logged.iri,
        "engine": stage.engine_name,
        "simulated_s": seconds,
        "out": str(out),
        "bodies": len(logged.bodies),
        "constraints": len(logged.constraints),
    }


def _say(told: dict[str, object]) -> None:
    say(f"{told['bodies']} bodies, {told['constraints']} constraints → {told['out']}")
