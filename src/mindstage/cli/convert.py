"""`mindstage convert`: the same map in another format."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mindstage.cli.options import AsJson, Bundled, MapName, OneMap, Ontologies
from mindstage.cli.outcome import Outcome
from mindstage.cli.output import findings_json, print_findings, print_json, say, working
from mindstage.cli.sources import findings_about, knowledge_base

__all__ = ["convert"]


def convert(
    source: OneMap,
    out: Annotated[
        Path,
        typer.Argument(metavar="OUT", help="Where to: .owl, .rdf or .xml (RDF/XML), or .ttl.", show_default=False),
    ],
    *,
    map_name: MapName = None,
    ontologies: Ontologies = None,
    bundled: Bundled = True,
    as_json: AsJson = False,
) -> Outcome:
    """Read a map and write it in the format that the suffix of OUT names; nothing in it is lost."""
    from mindstage.knowledge import save_map

    with working("converting"):
        knowledge = knowledge_base([source], ontologies=ontologies, bundled=bundled)
        world = knowledge.world(map_name)
        findings = findings_about(world, knowledge)
        save_map(world, out)
    if as_json:
        told = {"map": world.iri, "out": str(out), "bodies": len(world.bodies), "constraints": len(world.constraints)}
        print_json(told | {"findings": findings_json(findings)})
    else:
        print_findings(findings)
        say(f"{world.name or world.iri}: {len(world.bodies)} bodies, {len(world.constraints)} constraints → {out}")
    return Outcome.DONE
