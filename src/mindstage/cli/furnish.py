"""mindstage furnish: things from a list, put into a place where they belong."""

from __future__ import annotations

from pathlib import Path
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
    Port,
    QuaternionOrders,
    Robots,
    Seconds,
    Strict,
    UnitNames,
    Verbose,
)
from mindstage.cli.outcome import Outcome
from mindstage.cli.output import Cell, print_findings, print_json, print_table, say, warn, working
from mindstage.cli.page import show_told
from mindstage.cli.report import everything_stands, report_json, warn_of_failures
from mindstage.cli.sources import findings_about, knowledge_base
from mindstage.cli.staging import stage_for

if TYPE_CHECKING:
    from mindstage.knowledge import KnowledgeBase
    from mindstage.knowledge.items import Item
    from mindstage.stage import Stage
    from mindstage.stage.furnishing import Furnished

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
    maps: Maps,
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
) -> Outcome:
    """Put things where they belong, on a free spot on which they stay; exit 1 if one of them finds no place."""
    from mindstage.stage.furnishing import furnish as furnish_stage

    running = make_engine(engine)  # first: a wrong name is told before a long map is read
    with working("reading"):
        knowledge = knowledge_base(
            maps, ontologies=ontologies, bundled=bundled, robots=robots, numbers=Numbers(units, frame, quaternion)
        )
        listed = [item for each in items for item in _listed(each, knowledge)]
        world = knowledge.world(map_name)
    findings = findings_about(world, knowledge, strict=strict)
    with stage_for(knowledge, running, assets=assets) as stage:
        with working("spawning"):
            report = stage.spawn(world)
        with working("furnishing"):
            done = furnish_stage(stage, listed)
        told: dict[str, object] = {"map": world.iri, "engine": stage.engine_name, "spawn": report_json(report)} | _json(
            done
        )
        if not as_json:
            print_findings(findings)
            warn_of_failures(report)
            _print(done, verbose=verbose)
        if out is None and with_viewport:
            show_told(stage, told, port=port, duration_s=seconds, as_json=as_json)
        else:
            _finish(stage, told, out, as_json=as_json)
    return Outcome.DONE if everything_stands(report, findings) and not done.unplaced else Outcome.NO


def _listed(told: str, knowledge: KnowledgeBase) -> tuple[Item, ...]:
    """What is meant: a file, or a class."""
    from mindstage.knowledge.items import item_of_class, load_items

    path = Path(told)
    return load_items(path, knowledge) if path.suffix or path.exists() else (item_of_class(told, knowledge),)


def _finish(stage: Stage, told: dict[str, object], out: Path | None, *, as_json: bool) -> None:
    """Writes the place, if wanted, and says so."""
    from mindstage.knowledge import save_map

    if out is not None:
        with working("writing"):
            save_map(stage.log(), out)
    if as_json:
        print_json(told if out is None else told | {"out": str(out)})
    elif out is not None:
        say(f"the furnished place → {out}")


def _json(done: Furnished) -> dict[str, object]:
    import msgspec

    return {"put": msgspec.to_builtins(done.put), "unplaced": msgspec.to_builtins(done.unplaced)}


def _print(done: Furnished, *, verbose: bool) -> None:
    rows: list[list[Cell]] = [
        [put.id, put.holder, " ".join(f"{number:.2f}" for number in put.pose.position), put.tried] for put in done.put
    ]
    if rows:
        columns = ("thing", "where", "at [m]", "spots tried")
        shown = len(columns) if verbose else len(columns) - 1
        print_table("Put", columns[:shown], [row[:shown] for row in rows])
    for each in done.unplaced:
        warn(f"{each.id} found no place: {each.reason}")
