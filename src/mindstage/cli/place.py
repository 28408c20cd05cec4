"""mindstage furnish: things from a list, put into a place where they belong."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mindstage.cli.options import (
    AsJson,
    AssetFolders,
    Bundled,
    ConventionOptions,
    EngineName,
    ExitCode,
    FrameNames,
    MapArguments,
    MapName,
    Ontologies,
    Port,
    QuaternionOrders,
    Robots,
    Seconds,
    Strict,
    UnitNames,
    Verbose,
)
from mindstage.cli.output import (
    Cell,
    is_complete,
    print_failures,
    print_findings,
    print_json,
    print_line,
    print_table,
    progress_spinner,
    report_json,
    warn,
)
from mindstage.cli.setup import findings_about, knowledge_base, make_engine, simulation_from_options
from mindstage.cli.viewer import print_and_serve

if TYPE_CHECKING:
    from mindstage.knowledge import KnowledgeBase
    from mindstage.simulation import Simulation
    from mindstage.simulation.placement_list import PlacementItem, PlacementReport

__all__ = ["furnish"]


Items = Annotated[
    list[str],
    typer.Option(
        "--with",
        metavar="ITEMS",
        help="A Turtle file of things: what each is, and, if it does not go where such things are kept, where to "
        "(ms:putOn, ms:putInto). Or CLASS or CLASS:BODY for one thing. May be repeated.",
        show_default=False,
    ),
]

Out = Annotated[
    Path | None,
    typer.Option(
        "--out",
        "-o",
        metavar="OUT",
        help="Write the furnished place as a map (.owl, .rdf, .xml or .ttl) instead of showing it.",
        show_default=False,
    ),
]


def furnish(
    maps: MapArguments,
    *,
    items: Items,
    out: Out = None,
    map_name: MapName = None,
    ontologies: Ontologies = None,
    bundled: Bundled = True,
    robots: Robots = None,
    units: UnitNames = None,
    frame: FrameNames = None,
    quaternion: QuaternionOrders = None,
    strict: Strict = False,
    assets: AssetFolders = None,
    engine: EngineName = "mujoco",
    with_viewport: Annotated[
        bool, typer.Option(" /--no-viewport", help="Do not show the world in the browser.", show_default=False)
    ] = True,
    port: Port = 8080,
    seconds: Seconds = None,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> ExitCode:
    """Put things where they belong, on a free spot on which they stay; exit 1 if one of them finds no place."""
    from mindstage.simulation.placement_list import place_items as furnish_stage

    running = make_engine(engine)  # first: a wrong name is told before a long map is read
    with progress_spinner("reading"):
        knowledge = knowledge_base(
            maps,
            ontologies=ontologies,
            bundled=bundled,
            robots=robots,
            conventions=ConventionOptions(units, frame, quaternion),
        )
        listed = [item for each in items for item in _read_items(each, knowledge)]
        world = knowledge.world(map_name)
    findings = findings_about(world, knowledge, strict=strict)
    with simulation_from_options(knowledge, running, assets=assets) as stage:
        with progress_spinner("spawning"):
            report = stage.spawn(world)
        with progress_spinner("furnishing"):
            done = furnish_stage(stage, listed)
        told: dict[str, object] = {
            "map": world.iri,
            "engine": stage.engine_name,
            "spawn": report_json(report),
        } | _report_json(done)
        if not as_json:
            print_findings(findings)
            print_failures(report)
            _print_report(done, verbose=verbose)
        if out is None and with_viewport:
            print_and_serve(stage, told, port=port, duration_s=seconds, as_json=as_json)
        else:
            _finish(stage, told, out, as_json=as_json)
    return ExitCode.OK if is_complete(report, findings) and not done.unplaced else ExitCode.NEGATIVE


def _read_items(texts: str, knowledge: KnowledgeBase) -> tuple[PlacementItem, ...]:
    """What is meant: a file, or a class."""
    from mindstage.simulation.placement_list import load_items, parse_item

    path = Path(texts)
    return load_items(path, knowledge) if path.suffix or path.exists() else (parse_item(texts, knowledge),)


def _finish(simulation: Simulation, output: dict[str, object], out: Path | None, *, as_json: bool) -> None:
    """Writes the place, if wanted, and says so."""
    from mindstage.knowledge import save_map

    if out is not None:
        with progress_spinner("writing"):
            save_map(simulation.snapshot(), out)
    if as_json:
        print_json(output if out is None else output | {"out": str(out)})
    elif out is not None:
        print_line(f"the furnished place → {out}")


def _report_json(done: PlacementReport) -> dict[str, object]:
    import msgspec

    return {"put": msgspec.to_builtins(done.placed), "unplaced": msgspec.to_builtins(done.unplaced)}


def _print_report(done: PlacementReport, *, verbose: bool) -> None:
    rows: list[list[Cell]] = [
        [put.id, put.support_id, " ".join(f"{number:.2f}" for number in put.pose.position), put.attempts]
        for put in done.placed
    ]
    if rows:
        columns = ("thing", "where", "at [m]", "spots tried")
        shown = len(columns) if verbose else len(columns) - 1
        print_table("Put", columns[:shown], [row[:shown] for row in rows])
    for each in done.unplaced:
        warn(f"{each.id} found no place: {each.reason}")
