"""`mindstage validate`: everything odd about maps, and what was done about it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING

from mindstage.cli.numbers import ConventionOptions
from mindstage.cli.options import (
    AsJson,
    Bundled,
    FrameNames,
    MapArguments,
    MapName,
    Ontologies,
    QuaternionOrders,
    Robots,
    Strict,
    UnitNames,
    Verbose,
)
from mindstage.cli.outcome import ExitCode
from mindstage.cli.output import findings_json, print_findings, print_json, print_line, print_table, progress_spinner
from mindstage.cli.reading import import_summary, print_import_summary
from mindstage.cli.sources import findings_about, knowledge_base

if TYPE_CHECKING:
    from mindstage.knowledge import Finding
    from mindstage.world import World

__all__ = ["validate"]


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
