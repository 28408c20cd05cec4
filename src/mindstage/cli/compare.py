"""`mindstage compare`: everything in which two maps differ."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from mindstage.cli.options import AsJson, Bundled, Delta, MapName, Ontologies
from mindstage.cli.outcome import ExitCode
from mindstage.cli.output import findings_json, print_findings, print_json, progress_spinner
from mindstage.cli.reading import assumptions_json
from mindstage.cli.sources import knowledge_base
from mindstage.cli.verdict import diff_json, print_diff

if TYPE_CHECKING:
    from mindstage.knowledge import KnowledgeBase
    from mindstage.world import World

__all__ = ["compare"]


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
    from mindstage.world import diff

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
