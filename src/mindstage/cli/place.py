"""The verb `place`: spawns a map and places a list of items in it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mindstage.cli.options import (
    DEFAULT_SPAWN,
    AsJson,
    ExitCode,
    MapArguments,
    MapSpawning,
    Port,
    Seconds,
    Strict,
    Verbose,
    WithViewer,
)
from mindstage.cli.output import (
    Cell,
    class_lookup,
    print_failures,
    print_findings,
    print_json,
    print_line,
    print_table,
    progress_spinner,
    report_json,
    shortcomings,
    warn,
)
from mindstage.cli.setup import findings_about, knowledge_base, make_engine, simulation_from_options
from mindstage.cli.viewer import print_and_serve

if TYPE_CHECKING:
    from mindstage.knowledge import KnowledgeBase
    from mindstage.simulation import Simulation
    from mindstage.simulation.placement_list import PlacementItem, PlacementReport

__all__ = ["place"]


Items = Annotated[
    list[str],
    typer.Option(
        "--with",
        metavar="ITEMS",
        help="A Turtle file of items with their classes and, if they are not to be placed where their class is stored, "
        "their holders (ms:putOn, ms:putInto). Or CLASS or CLASS:BODY for one item. May be repeated.",
        show_default=False,
    ),
]

Out = Annotated[
    Path | None,
    typer.Option(
        "--out",
        "-o",
        metavar="OUT",
        help="Write the world as a map (.owl, .rdf, .xml or .ttl) instead of showing it.",
        show_default=False,
    ),
]


def place(
    maps: MapArguments,
    *,
    items: Items,
    out: Out = None,
    options: MapSpawning = DEFAULT_SPAWN,
    strict: Strict = False,
    with_viewer: WithViewer = True,
    port: Port = None,
    seconds: Seconds = None,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> ExitCode:
    """Place items on or in furniture, at free and stable poses; exit 1 if any of them could not be placed."""
    from mindstage.simulation.placement_list import place_items

    running = make_engine(options.engine)  # before the map is read, so that a wrong name fails at once
    with progress_spinner("reading"):
        knowledge = knowledge_base(maps, options)
        listed = [item for text in items for item in _read_items(text, knowledge)]
        world = knowledge.world(options.map_name)
    findings = findings_about(world, knowledge, strict=strict, options=options)
    with simulation_from_options(knowledge, running, options) as simulation:
        with progress_spinner("spawning"):
            report = simulation.spawn(world)
        with progress_spinner("placing"):
            placement = place_items(simulation, listed)
        output: dict[str, object] = {"map": world.iri, "engine": simulation.engine.name, "spawn": report_json(report)}
        output |= _report_json(placement)
        if not as_json:
            print_findings(findings, all=verbose, classes=class_lookup(knowledge))
            print_failures(report)
            _print_report(placement, verbose=verbose)
        if out is None and with_viewer:
            print_and_serve(simulation, output, port=port, duration_s=seconds, as_json=as_json)
        else:
            _finish(simulation, output, placement, out, as_json=as_json)
    return ExitCode.OK if not shortcomings(report, findings) and not placement.unplaced else ExitCode.NEGATIVE


def _read_items(text: str, knowledge: KnowledgeBase) -> tuple[PlacementItem, ...]:
    """The items of a file, or the item that the text describes."""
    from mindstage.simulation.placement_list import load_items, parse_item

    path = Path(text)
    return load_items(path, knowledge) if path.suffix or path.exists() else (parse_item(text, knowledge),)


def _finish(
    simulation: Simulation, output: dict[str, object], placement: PlacementReport, out: Path | None, *, as_json: bool
) -> None:
    """Writes the world, if requested, and prints the output."""
    from mindstage.maps import save_map

    if out is not None:
        with progress_spinner("writing"):
            save_map(simulation.snapshot(), out)
    if as_json:
        print_json(output if out is None else output | {"out": str(out)})
    elif out is not None:
        print_line(f"world → {out}{_omission(placement)}")


def _omission(placement: PlacementReport) -> str:
    from mindstage.scene.display import counted

    total = len(placement.placed) + len(placement.unplaced)
    return f", without {len(placement.unplaced)} of {counted(total, 'item')}" if placement.unplaced else ""


def _report_json(placement: PlacementReport) -> dict[str, object]:
    import msgspec

    return {"placed": msgspec.to_builtins(placement.placed), "unplaced": msgspec.to_builtins(placement.unplaced)}


def _print_report(placement: PlacementReport, *, verbose: bool) -> None:
    rows: list[list[Cell]] = [
        [each.id, each.support_id, " ".join(f"{number:.2f}" for number in each.pose.position), each.attempts]
        for each in placement.placed
    ]
    if rows:
        columns = ("item", "support", "position [m]", "attempts")
        shown = len(columns) if verbose else len(columns) - 1
        print_table("Placed", columns[:shown], [row[:shown] for row in rows])
    for item in placement.unplaced:
        warn(f"{item.id} could not be placed: {item.reason}")
