"""`mindstage convert_source_map`: the same place in another dialect, or as a file for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mindstage.cli.engine import godot_program
from mindstage.cli.numbers import ConventionOptions
from mindstage.cli.options import (
    AsJson,
    AssetFolders,
    Bundled,
    FrameNames,
    MapArgument,
    MapName,
    Ontologies,
    PlainBoxes,
    QuaternionOrders,
    Robots,
    Strict,
    UnitNames,
)
from mindstage.cli.outcome import ExitCode
from mindstage.cli.output import findings_json, print_findings, print_json, print_line, progress_spinner, warn
from mindstage.cli.reading import import_summary, print_import_summary
from mindstage.cli.sources import findings_about, knowledge_base
from mindstage.cli.staging import asset_folders
from mindstage.saving import FileDialect, FileFormat, dialect_name, file_format, save_world

if TYPE_CHECKING:
    from mindstage.knowledge import KnowledgeBase
    from mindstage.world import World

__all__ = ["convert"]


def convert(
    source: MapArgument,
    out: Annotated[
        Path,
        typer.Argument(
            metavar="OUT",
            help="Where to. The suffix says how: .owl or .rdf (RDF/XML), .ttl (Turtle), .mjcf or .xml (MuJoCo), "
            ".glb (glTF), .tscn (a scene of Godot's, which has to be installed).",
            show_default=False,
        ),
    ],
    *,
    dialect: Annotated[
        FileDialect | None,
        typer.Option(
            "--dialect",
            help="In whose words a map is written: those of the map itself, those that it was converted from, "
            "SemLog's (2019), or SOMA's (KnowRob 2).",
            show_default="same",
        ),
    ] = None,
    format: Annotated[
        FileFormat | None,
        typer.Option("--format", help="How it is written, whatever the suffix of OUT.", show_default=False),
    ] = None,
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
    as_json: AsJson = False,
) -> ExitCode:
    """Read a map and write it again: nothing is lost between dialects, and what another format cannot hold is said."""
    kind, chosen = file_format(out, format, dialect=dialect), dialect or FileDialect.SAME
    with progress_spinner("converting"):
        knowledge = knowledge_base(
            [source],
            ontologies=ontologies,
            bundled=bundled,
            robots=robots,
            conventions=ConventionOptions(units, frame, quaternion),
        )
        world = knowledge.world(map_name)
        findings = findings_about(world, knowledge, strict=strict)
        notes = _save(world, knowledge, out, kind, chosen, assets=assets, plain_boxes=plain_boxes)
    words = dialect_name(world, knowledge, kind, chosen)
    if as_json:
        told = {"map": world.iri, "out": str(out), "bodies": len(world.bodies), "constraints": len(world.joints)}
        told |= {"format": kind.value, "dialect": words, "notes": list(notes)}
        print_json(told | {"findings": findings_json(findings)} | import_summary(world, knowledge))
    else:
        print_findings(findings)
        for note in notes:
            warn(note)
        print_import_summary(world, knowledge)
        how = kind.value if words is None else f"{kind.value}, {words}"
        counted = f"{len(world.bodies)} bodies, {len(world.joints)} constraints"
        print_line(f"{world.name or world.iri}: {counted} → {out} ({how})")
    return ExitCode.OK


def _save(
    world: World,
    knowledge: KnowledgeBase,
    out: Path,
    format: FileFormat,
    dialect: FileDialect,
    *,
    assets: list[Path] | None,
    plain_boxes: bool,
) -> tuple[str, ...]:
    return save_world(
        world,
        out,
        knowledge=knowledge,
        format=format,
        dialect=dialect if format.is_map else None,
        assets=() if format.is_map else asset_folders(assets),
        plain_shapes=plain_boxes,
        godot=godot_program(),
    )
