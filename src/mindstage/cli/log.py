"""`mindstage log`: a running world as a semantic map."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mindstage.cli.engine import make_engine
from mindstage.cli.options import AsJson, Bundled, EngineName, MapName, Maps, Ontologies, finite
from mindstage.cli.outcome import Outcome
from mindstage.cli.output import findings_json, print_findings, print_json, say, working
from mindstage.cli.passing import let_pass
from mindstage.cli.report import everything_stands, print_report, report_json
from mindstage.cli.sources import findings_about, knowledge_base

__all__ = ["log"]


def log(
    maps: Maps,
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
    engine: EngineName = "mujoco",
    seconds: Annotated[
        float,
        typer.Option("--for", metavar="SECONDS", min=0.0, callback=finite, help="Simulated time before it is logged."),
    ] = 0.0,
    as_json: AsJson = False,
) -> Outcome:
    """Spawn a map, let time pass, and log the world as it is then; exit 1 if anything could not be spawned."""
    from mindstage.knowledge import save_map
    from mindstage.stage import Stage

    running = make_engine(engine)  # first: a wrong name is told before a long map is read
    with working("reading"):
        knowledge = knowledge_base(maps, ontologies=ontologies, bundled=bundled)
        world = knowledge.world(map_name)
    findings = findings_about(world, knowledge)
    with Stage(knowledge, running) as stage:
        with working("spawning"):
            report = stage.spawn(world)
        let_pass(stage, seconds)
        with working("logging"):
            logged = stage.log()
            save_map(logged, out)
        if as_json:
            told = {"map": logged.iri, "engine": stage.engine_name, "simulated_s": seconds, "out": str(out)}
            told |= {"bodies": len(logged.bodies), "constraints": len(logged.constraints)}
            print_json(told | {"spawn": report_json(report), "findings": findings_json(findings)})
        else:
            print_findings(findings)
            print_report(report, title=logged.name, verbose=False)
            say(f"{len(logged.bodies)} bodies, {len(logged.constraints)} constraints → {out}")
    return Outcome.DONE if everything_stands(report, findings) else Outcome.NO
