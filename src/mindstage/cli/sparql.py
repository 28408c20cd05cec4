"""`mindstage sparql`: a query straight on the store."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from mindstage.cli.options import AsJson, Bundled, Closure, EndpointUrl, MapOptions, Ontologies, StoreFolder, finite
from mindstage.cli.outcome import ExitCode
from mindstage.cli.output import findings_json, print_findings, print_json, print_line, print_table, progress_spinner
from mindstage.cli.sources import knowledge_base

if TYPE_CHECKING:
    from mindstage.knowledge import RdfTerm

__all__ = ["sparql"]


def sparql(
    query: Annotated[str, typer.Argument(metavar="QUERY", help="SPARQL 1.1; knowrob: is known.", show_default=False)],
    *,
    maps: MapOptions = None,
    timeout_s: Annotated[
        float,
        typer.Option("--timeout", metavar="SECONDS", min=0.0, callback=finite, help="When it is stopped."),
    ] = 30.0,
    allow_service: Annotated[bool, typer.Option("--allow-service", help="Let it ask other servers (SERVICE).")] = False,
    store: StoreFolder = None,
    endpoint: EndpointUrl = None,
    ontologies: Ontologies = None,
    bundled: Bundled = True,
    closure: Closure = False,
    as_json: AsJson = False,
) -> ExitCode:
    """Put a SPARQL query to everything that was loaded, or to an endpoint. No result, or ASK's no, ends with 1."""
    import msgspec

    from mindstage.errors import InvalidArgumentError

    if closure and endpoint:
        cause = "an endpoint answers by itself, and hears nothing of what is derived here"
        raise InvalidArgumentError("--closure", cause=cause, remedy="leave it out, or ask one of the questions")
    with progress_spinner("querying"):
        knowledge = knowledge_base(
            maps or [], ontologies=ontologies, bundled=bundled, store=store, endpoint=endpoint, closure=closure
        )
        table = knowledge.sparql(query, timeout_s=timeout_s, allow_service=allow_service)
    findings = knowledge.findings()
    if as_json:
        solutions = [
            {name: msgspec.to_builtins(term) for name, term in zip(table.columns, row, strict=True) if term is not None}
            for row in table.rows
        ]
        told = {"columns": table.columns, "rows": solutions, "truth": table.boolean}
        print_json(told | {"findings": findings_json(findings)})
    else:
        print_findings(findings)
        if table.boolean is not None:
            print_line("yes" if table.boolean else "no")
        else:
            print_table("", table.columns, [[_term_text(term) for term in row] for row in table.rows])
    return ExitCode.OK if table.boolean or table.rows else ExitCode.NEGATIVE


def _term_text(term: RdfTerm | None) -> str | None:
    if term is None:
        return None
    return f"_:{term.value}" if term.kind == "blank" else term.value
