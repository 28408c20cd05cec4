"""`mindstage analyse`: what a map holds, in numbers."""

from __future__ import annotations

from mindstage.cli.options import AsJson, Bundled, MapName, Maps, Ontologies, Robots
from mindstage.cli.outcome import Outcome
from mindstage.cli.output import findings_json, print_findings, print_json, print_table, working
from mindstage.cli.reading import assumptions_json
from mindstage.cli.sources import knowledge_base

__all__ = ["analyse"]

_COUNTS = ("classes", "individuals", "objects", "constraints", "relations")


def analyse(
    maps: Maps,
    *,
    map_name: MapName = None,
    ontologies: Ontologies = None,
    bundled: Bundled = True,
    robots: Robots = None,
    as_json: AsJson = False,
) -> Outcome:
    """Count what a map holds: classes, individuals, objects, constraints and relations."""
    with working("reading"):
        knowledge = knowledge_base(maps, ontologies=ontologies, bundled=bundled, robots=robots)
        # Without any map, asking for the only one gives the error that says so.
        wanted: list[str | None] = [map_name] if map_name else [*knowledge.maps()] or [None]
        analyses = [knowledge.analyse(name) for name in wanted]
    findings = knowledge.findings()
    if as_json:
        told = [
            {"map": analysis.map}
            | {count: getattr(analysis, count) for count in _COUNTS}
            | {"assumptions": assumptions_json(knowledge), "findings": findings_json(findings)}
            for analysis in analyses
        ]
        print_json(told[0] if len(told) == 1 else told)
    else:
        print_findings(findings)
        rows = [(analysis.map, *(getattr(analysis, count) for count in _COUNTS)) for analysis in analyses]
        print_table("", ("map", *_COUNTS), rows)
    return Outcome.DONE
