"""`mindstage tell`: one more thing that the robot knows, or one less."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mindstage.cli.options import AsJson, Bundled, EndpointUrl, MapOptions, Ontologies, StoreFolder
from mindstage.cli.outcome import ExitCode
from mindstage.cli.output import findings_json, print_findings, print_json, print_line, progress_spinner
from mindstage.cli.sources import knowledge_base

if TYPE_CHECKING:
    from mindstage.knowledge import SparqlEndpoint

__all__ = ["tell"]


def tell(
    subject: Annotated[str, typer.Argument(metavar="SUBJECT", help="A class or an individual.", show_default=False)],
    property: Annotated[str, typer.Argument(metavar="PROPERTY", help="Such as subClassOf.", show_default=False)],
    value: Annotated[
        str,
        typer.Argument(
            metavar="VALUE", help="A name, a number, true or false, or a text ('\"5\"' is one).", show_default=False
        ),
    ],
    *,
    retract: Annotated[bool, typer.Option("--retract", help="Take it back instead.")] = False,
    store: StoreFolder = None,
    endpoint: EndpointUrl = None,
    update_endpoint: Annotated[
        str | None,
        typer.Option(
            "--update-endpoint",
            metavar="URL",
            help="Where the server takes changes, if not beside /query or /sparql as /update.",
            show_default=False,
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="FILE.ttl", help="A file to be loaded with --ontology.", show_default=False
        ),
    ] = None,
    maps: MapOptions = None,
    ontologies: Ontologies = None,
    bundled: Bundled = True,
    as_json: AsJson = False,
) -> ExitCode:
    """Tell the robot something that stays known: in a store, at an endpoint, or in a file.

    Of a class it means all its members. A name that nobody knows yet takes a prefix, and becomes a class by subClassOf
    and an individual by type: mindstage tell ms:MilkRack subClassOf Refrigerator -o told.ttl
    """
    from mindstage.knowledge import AssertionFile
    from mindstage.knowledge.teaching import parse_value

    where = _store_target(store, endpoint, output)
    with progress_spinner("telling"):
        at = _endpoint(endpoint, update_endpoint)
        knowledge = knowledge_base(maps or [], ontologies=ontologies, bundled=bundled, store=store, endpoint=at)
        told = AssertionFile(output, knowledge) if output else knowledge
        done = (told.retract if retract else told.tell)(subject, property, parse_value(value))
    findings = knowledge.findings()
    if as_json:
        statement = {"subject": subject, "property": property, "value": value}
        print_json({"done": done, "statement": statement, "where": where, "findings": findings_json(findings)})
    else:
        print_findings(findings)
        print_line(_result_text(f"{subject} {property} {value}", where, retract=retract, done=done))
    return ExitCode.OK if done or not retract else ExitCode.NEGATIVE


def _store_target(store: Path | None, endpoint: str | None, output: Path | None) -> str:
    """Where it is to stay.

    Raises:
        InvalidArgumentError: nowhere, or in several places.
    """
    from mindstage.errors import InvalidArgumentError

    places = [str(place) for place in (store, endpoint, output) if place is not None]
    if len(places) == 1:
        return places[0]
    cause = "it would be forgotten at once" if not places else "it can stay in one place at a time"
    raise InvalidArgumentError("tell", cause=cause, remedy="give one of --store DIR, --endpoint URL and -o FILE.ttl")


def _endpoint(url: str | None, update_url: str | None) -> SparqlEndpoint | None:
    from mindstage.knowledge import SparqlEndpoint

    return None if url is None else SparqlEndpoint(url, update_url=update_url)


def _result_text(statement: str, target: str, *, retract: bool, done: bool) -> str:
    if retract:
        return f"taken back: {statement}" if done else f"nobody says in {target}: {statement}"
    return f"told: {statement}" if done else f"known already: {statement}"
