"""The verbs `analyze`, `compare`, `validate` and `convert`, which read maps without an engine."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mindstage.cli.options import (
    DEFAULT_MAP,
    DEFAULT_SHAPES,
    AsJson,
    Delta,
    ExitCode,
    MapArgument,
    MapArguments,
    MapChoice,
    ShapeOptions,
    Strict,
    Verbose,
)
from mindstage.cli.output import (
    assumptions_json,
    class_lookup,
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
from mindstage.cli.setup import findings_about, godot_program, knowledge_base
from mindstage.saving import FileDialect, dialect_name, file_format, save_world

if TYPE_CHECKING:
    from mindstage.knowledge import KnowledgeBase
    from mindstage.maps import UnitConventions
    from mindstage.rdf import Finding
    from mindstage.scene import World

__all__ = ["analyze", "compare", "convert", "validate"]


_COUNT_NAMES = ("classes", "individuals", "objects", "constraints", "relations")


def analyze(
    maps: MapArguments,
    *,
    reading: MapChoice = DEFAULT_MAP,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> ExitCode:
    """Count the classes, individuals, objects, constraints and relations of maps."""
    with progress_spinner("reading"):
        knowledge = knowledge_base(maps, reading)
        # Without maps, requesting the only one (None) raises the appropriate error.
        names: list[str | None] = [reading.map_name] if reading.map_name else [*knowledge.maps()] or [None]
        analyses = [knowledge.map_statistics(name) for name in names]
        for name in names:
            knowledge.world(name)  # whose findings and assumptions are printed
    findings = knowledge.findings()
    if as_json:
        output = [
            {"map": analysis.map}
            | {count: getattr(analysis, count) for count in _COUNT_NAMES}
            | {"assumptions": assumptions_json(knowledge), "findings": findings_json(findings)}
            for analysis in analyses
        ]
        print_json(output[0] if len(output) == 1 else output)
    else:
        print_findings(findings, all=verbose, classes=class_lookup(knowledge))
        rows = [(analysis.map, *(getattr(analysis, count) for count in _COUNT_NAMES)) for analysis in analyses]
        print_table("", ("map", *_COUNT_NAMES), rows)
    return ExitCode.OK


def compare(
    a: Annotated[str, typer.Argument(metavar="A", help="A semantic map.", show_default=False)],
    b: Annotated[str, typer.Argument(metavar="B", help="The map to compare it with.", show_default=False)],
    *,
    reading: MapChoice = DEFAULT_MAP,
    delta: Delta = 0.0,
    as_json: AsJson = False,
) -> ExitCode:
    """Compare two maps completely; exit 0 if they are identical, 1 if they differ, 2 on an error."""
    from mindstage.scene import diff

    def read(path: str, conventions: UnitConventions) -> tuple[World, KnowledgeBase]:
        knowledge = knowledge_base([path], reading, conventions=[conventions])
        return knowledge.world(reading.map_name), knowledge

    with progress_spinner("reading"):
        conventions_a, conventions_b = reading.conventions([a, b])
        (world_a, knowledge_a), (world_b, knowledge_b) = read(a, conventions_a), read(b, conventions_b)
    with progress_spinner("comparing"):
        found = diff(world_a, world_b)
    if as_json:
        findings = {"a": findings_json(knowledge_a.findings()), "b": findings_json(knowledge_b.findings())}
        assumptions = {"a": assumptions_json(knowledge_a, world_a), "b": assumptions_json(knowledge_b, world_b)}
        print_json(diff_json(found, delta) | {"assumptions": assumptions, "findings": findings})
    else:
        print_findings(knowledge_a.findings(), classes=class_lookup(knowledge_a))
        print_findings(knowledge_b.findings(), classes=class_lookup(knowledge_b))
        print_diff(found, delta, about=world_a)
    return ExitCode.OK if found.identical(delta) else ExitCode.NEGATIVE


def validate(
    maps: MapArguments,
    *,
    reading: MapChoice = DEFAULT_MAP,
    strict: Strict = False,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> ExitCode:
    """Read maps and list the findings; exit 0 if there are none, 1 if there are any, 2 if a map cannot be read."""
    with progress_spinner("reading"):
        knowledge = knowledge_base(maps, reading)
        # Without maps, requesting the only one (None) raises the appropriate error.
        names: list[str | None] = [reading.map_name] if reading.map_name else [*knowledge.maps()] or [None]
        worlds = [knowledge.world(name) for name in names]
        found = (finding for world in worlds for finding in findings_about(world, knowledge, strict=strict))
        findings = tuple(dict.fromkeys(found))
    if as_json:
        read = [{"map": world.iri} | _counts(world) | import_summary(world, knowledge) for world in worlds]
        severities = Counter(finding.severity.value for finding in findings)
        counts = {"error": severities["error"], "warning": severities["warning"]}
        print_json({"clean": not findings, "counts": counts, "maps": read, "findings": findings_json(findings)})
    else:
        print_findings(findings, all=verbose, classes=class_lookup(knowledge))
        for world in worlds:
            print_table(world.name, ("", "count"), list(_counts(world).items()))
            print_import_summary(world, knowledge, verbose=True)
        _print_finding_counts(findings)
        print_line(f"{len(findings)} finding{'' if len(findings) == 1 else 's'}." if findings else "No findings.")
    return ExitCode.NEGATIVE if findings else ExitCode.OK


def _counts(world: World) -> dict[str, int]:
    return {
        "bodies": len(world.bodies),
        "joints": len(world.joints),
        "attachments": len(world.attachments),
        "lights": len(world.lights),
    }


def _print_finding_counts(findings: Sequence[Finding]) -> None:
    kinds = Counter((finding.severity.value, finding.property.rpartition("#")[2]) for finding in findings)
    if kinds:
        rows = [(severity, about or "-", number) for (severity, about), number in sorted(kinds.items())]
        print_table("Findings", ("severity", "about", "count"), rows)


_ConvertedFile = Annotated[
    Path,
    typer.Argument(
        metavar="OUT",
        help="The file to write. The suffix determines the format: .owl or .rdf (RDF/XML), .ttl (Turtle), .mjcf or "
        ".xml (MuJoCo), .glb (glTF), .tscn (Godot scene; Godot must be installed).",
        show_default=False,
    ),
]
_FileDialectOption = Annotated[
    FileDialect | None,
    typer.Option(
        "--dialect",
        help="The vocabulary of a map: that of the source, that of the map it was converted from, SemLog (2019), "
        "or SOMA (KnowRob 2).",
        show_default="same",
    ),
]
_FileFormatOption = Annotated[
    str | None,
    typer.Option(
        "--format",
        help="The format, regardless of the suffix of OUT: owl, ttl, mjcf, glb, tscn, or one of an installed package.",
        show_default=False,
    ),
]


def convert(
    source: MapArgument,
    out: _ConvertedFile,
    *,
    dialect: _FileDialectOption = None,
    format: _FileFormatOption = None,
    options: ShapeOptions = DEFAULT_SHAPES,
    strict: Strict = False,
    verbose: Verbose = False,
    as_json: AsJson = False,
) -> ExitCode:
    """Convert a map to another dialect, without loss, or to another format, with notes on what it cannot express."""
    (name, kind), chosen = file_format(out, format, dialect=dialect), dialect or FileDialect.SAME
    with progress_spinner("converting"):
        knowledge = knowledge_base([source], options)
        world = knowledge.world(options.map_name)
        findings = findings_about(world, knowledge, strict=strict, options=options)
        notes = save_world(
            world,
            out,
            knowledge=knowledge,
            format=name,
            dialect=chosen if kind.syntax else None,
            assets=() if kind.syntax else options.asset_folders(),
            primitive_shapes=options.primitive_shapes,
            godot=godot_program(),
        )
    dialect_written = dialect_name(world, knowledge, kind, chosen)
    if as_json:
        output = {"map": world.iri, "out": str(out), "bodies": len(world.bodies), "joints": len(world.joints)}
        output |= {"format": name, "dialect": dialect_written, "notes": list(notes)}
        print_json(output | {"findings": findings_json(findings)} | import_summary(world, knowledge))
        return ExitCode.OK
    print_findings(findings, all=verbose, classes=class_lookup(knowledge))
    for note in notes:
        warn(note)
    print_import_summary(world, knowledge, verbose=verbose)
    _print_conversion(world, out, name if dialect_written is None else f"{name}, {dialect_written}")
    return ExitCode.OK


def _print_conversion(world: World, out: Path, format: str) -> None:
    counts = f"{len(world.bodies)} bodies, {len(world.joints)} joints"
    print_line(f"{world.name or world.iri}: {counts} → {out} ({format})")
