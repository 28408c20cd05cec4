"""`mindstage convert_source_map`: the same place in another dialect, or as a file for other programs.

`mindstage map_statistics`: what a map holds, in numbers.

`mindstage compare`: everything in which two maps differ.

`mindstage validate`: everything odd about maps, and what was done about it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mindstage.cli.options import (
    AsJson,
    AssetFolders,
    Bundled,
    ConventionOptions,
    Delta,
    ExitCode,
    FrameNames,
    MapArgument,
    MapArguments,
    MapName,
    Ontologies,
    PlainBoxes,
    QuaternionOrders,
    Robots,
    Strict,
    UnitNames,
    Verbose,
)
from mindstage.cli.output import (
    assumptions_json,
    diff_json,
    findings_json,
    import_summary,
    print_diff,
    print_findings,
    print_import_summary,
    print_json,
    print_line,
    print_table,
    progress_spinner,
    warn,
)
from mindstage.cli.setup import asset_folders, findings_about, godot_program, knowledge_base
from mindstage.saving import FileDialect, FileFormat, dialect_name, file_format, save_world

if TYPE_CHECKING:
    from mindstage.knowledge import Finding, KnowledgeBase
    from mindstage.scene import World

__all__ = ["analyse", "compare", "convert", "validate"]


_COUNT_NAMES = ("classes", "individuals", "objects", "constraints", "relations")


def analyse(
    maps: MapArguments,
    *,
    map_name: MapName = None,
    ontologies: Ontologies = None,
    bundled: Bundled = True,
    robots: Robots = None,
    as_json: AsJson = False,
) -> ExitCode:
    """Count what a map holds: classes, individuals, objects, constraints and relations."""
    with progress_spinner("reading"):
        knowledge = knowledge_base(maps, ontologies=ontologies, bundled=bundled, robots=robots)
        # Without any map, asking for the only one gives the error that says so.
        wanted: list[str | None] = [map_name] if map_name else [*knowledge.maps()] or [None]
        analyses = [knowledge.map_statistics(name) for name in wanted]
    findings = knowledge.findings()
    if as_json:
        told = [
            {"map": analysis.map}
            | {count: getattr(analysis, count) for count in _COUNT_NAMES}
            | {"assumptions": assumptions_json(knowledge), "findings": findings_json(findings)}
            for analysis in analyses
        ]
        print_json(told[0] if len(told) == 1 else told)
    else:
        print_findings(findings)
        rows = [(analysis.map, *(getattr(analysis, count) for count in _COUNT_NAMES)) for analysis in analyses]
        print_table("", ("map", *_COUNT_NAMES), rows)
    return ExitCode.OK


def compare(
    a: Annotated[str, typer.Argument(metavar="A", help="A semantic map.", show_default=False)],
    b: Annotated[str, typer.Argument(metavar="B", help="The map to hold against it.", show_default=False)],
    *,
    map_name: MapName = None,
    ontologies: Ontologies = None,
    bundled: Bundled = True,
    delta: Delta = 0.0,
    as_json: AsJson = False,
) -> ExitCode:
    """Compare two maps in everything they say; exit 0 if identical, 1 if different, 2 on trouble."""
    from mindstage.scene import diff

    def read(path: str) -> tuple[World, KnowledgeBase]:
        knowledge = knowledge_base([path], ontologies=ontologies, bundled=bundled)
        return knowledge.world(map_name), knowledge

    with progress_spinner("reading"):
        (world_a, knowledge_a), (world_b, knowledge_b) = read(a), read(b)
    with progress_spinner("comparing"):
        found = diff(world_a, world_b)
    if as_json:
        findings = {"a": findings_json(knowledge_a.findings()), "b": findings_json(knowledge_b.findings())}
        assumptions = {"a": assumptions_json(knowledge_a, world_a), "b": assumptions_json(knowledge_b, world_b)}
        print_json(diff_json(found, delta) | {"assumptions": assumptions, "findings": findings})
    else:
        print_findings((*knowledge_a.findings(), *knowledge_b.findings()))
        print_diff(found, delta, about=world_a)
    return ExitCode.OK if found.identical(delta) else ExitCode.NEGATIVE


def validate(
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
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> ExitCode:
    """Read maps and list what is odd about them; exit 0 if nothing is, 1 if something, 2 if they cannot be read."""
    with progress_spinner("reading"):
        numbers = ConventionOptions(units, frame, quaternion)
        knowledge = knowledge_base(maps, ontologies=ontologies, bundled=bundled, robots=robots, conventions=numbers)
        # Without any map, asking for the only one gives the error that says so.
        wanted: list[str | None] = [map_name] if map_name else [*knowledge.maps()] or [None]
        worlds = [knowledge.world(name) for name in wanted]
        told = dict.fromkeys(finding for world in worlds for finding in findings_about(world, knowledge, strict=strict))
    findings = tuple(told)
    if as_json:
        read = [{"map": world.iri} | _counts(world) | import_summary(world, knowledge) for world in worlds]
        severities = Counter(finding.severity.value for finding in findings)
        counts = {"error": severities["error"], "warning": severities["warning"]}
        print_json({"clean": not findings, "counts": counts, "maps": read, "findings": findings_json(findings)})
    else:
        print_findings(findings, all=verbose)
        for world in worlds:
            print_table(world.name, ("", "in the world"), list(_counts(world).items()))
            print_import_summary(world, knowledge, verbose=True)
        _print_finding_counts(findings)
        print_line(
            f"{len(findings)} finding{'' if len(findings) == 1 else 's'}." if findings else "Nothing odd was found."
        )
    return ExitCode.NEGATIVE if findings else ExitCode.OK


def _counts(world: World) -> dict[str, int]:
    return {
        "bodies": len(world.bodies),
        "constraints": len(world.joints),
        "attachments": len(world.attachments),
        "lights": len(world.lights),
    }


def _print_finding_counts(findings: Sequence[Finding]) -> None:
    kinds = Counter((finding.severity.value, finding.property.rpartition("#")[2]) for finding in findings)
    if kinds:
        rows = [(severity, about or "-", number) for (severity, about), number in sorted(kinds.items())]
        print_table("What is odd", ("severity", "about", "findings"), rows)


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
