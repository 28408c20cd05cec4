"""`mindstage map_statistics`: what a map holds, in numbers."""

from __future__ import annotations

from mindstage.cli.options import AsJson, Bundled, MapArguments, MapName, Ontologies, Robots
from mindstage.cli.outcome import ExitCode
from mindstage.cli.output import findings_json, print_findings, print_json, print_table, progress_spinner
from mindstage.cli.reading import assumptions_json
from mindstage.cli.sources import knowledge_base

__all__ = ["analyse"]

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
