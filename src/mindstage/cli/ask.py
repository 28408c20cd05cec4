"""`mindstage ask`: one of the declared questions.

Highlight: a question asked of a world that is spawned for it, and its answers lit up there.

`mindstage list_questions`: what can be asked.

`mindstage sparql`: a query straight on the store.

`mindstage tell`: one more thing that the robot knows, or one less.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mindstage.cli.options import (
    AsJson,
    Bundled,
    Closure,
    EndpointUrl,
    EngineName,
    ExitCode,
    MapName,
    MapOptions,
    Ontologies,
    Port,
    Robots,
    Seconds,
    StoreFolder,
    WithViewport,
    finite,
    options_given,
)
from mindstage.cli.output import (
    Cell,
    assumptions_json,
    findings_json,
    fits_table,
    print_failures,
    print_findings,
    print_json,
    print_line,
    print_records,
    print_table,
    progress_spinner,
    report_json,
    step_with_progress,
    warn,
)
from mindstage.cli.setup import knowledge_base, make_engine, simulation_from_options
from mindstage.cli.viewer import show_page

if TYPE_CHECKING:
    from mindstage.engines import Engine
    from mindstage.knowledge import KnowledgeBase, RdfTerm, SparqlEndpoint
    from mindstage.knowledge.queries import Answers, Question
    from mindstage.scene import Color
    from mindstage.simulation import HighlightResult

__all__ = ["HighlightRun", "ask", "named_args", "questions", "sparql", "tell"]


PrintAnswers = Callable[["Answers[Any]", dict[str, object]], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class HighlightRun:
    """How answers are shown."""

    color: Color | None
    """None lights nothing."""
    engine: Engine
    """Who runs the world; closed in the end."""
    port: int | None
    """Where the page is served; None for no page."""
    duration_s: float | None
    """How long the world lives [s]."""
    quiet: bool
    """Whether nothing but the answers is printed."""

    def ask(
        self,
        knowledge: KnowledgeBase,
        question: Question[Any],
        args: Mapping[str, str],
        *,
        map_name: str | None,
        print_answers: PrintAnswers,
    ) -> Answers[Any]:
        """Spawns a map, asks, lights the answers up, and shows them; without any there is nothing to show.

        Args:
            knowledge: what is known.
            question: what is asked.
            args: what it is asked about, as typed.
            map_name: which map is spawned; by default the one that the question is asked about, or the only one.
            tell: prints the answers, and for programs what there is to add.
        """
        with simulation_from_options(knowledge, self.engine) as stage:
            with progress_spinner("spawning"):
                report = stage.spawn(map_name or _map_of_question(knowledge, question, args))
                answers = stage.ask(question, **args)
                shown = stage.highlight(answers, self.color)
            print_failures(report)
            for dark in () if self.quiet else shown.unhighlighted:
                warn(f"not lit: {dark.id}: {dark.reason}")
            more = {"engine": stage.engine_name, "spawn": report_json(report)} | _highlight_json(shown, self.color)
            if answers and self.port is not None:
                announce = partial(self._announce, print_answers, answers, shown, more)
                show_page(stage, port=self.port, duration_s=self.duration_s, announce=announce, quiet=self.quiet)
            else:
                step_with_progress(stage, self.duration_s or 0.0)
                print_answers(answers, more)
        return answers

    def _announce(
        self,
        print_answers: PrintAnswers,
        answers: Answers[Any],
        result: HighlightResult,
        more: dict[str, object],
        url: str,
    ) -> None:
        print_answers(answers, more | {"url": url})  # now: whoever reads it wants to look while the world lives
        if not self.quiet:
            print_line(f"{0 if self.color is None else len(result.highlighted)} lit at {url}")


def _map_of_question(knowledge: KnowledgeBase, question: Question[Any], args: Mapping[str, str]) -> str | None:
    """The map that a question is asked about, if it is."""
    from mindstage.knowledge.names import EntityType

    about_maps = [argument.name for argument in question.arguments if argument.value_type is EntityType.MAP]
    return next((knowledge.names.find(args[name], EntityType.MAP) for name in about_maps if name in args), None)


def _highlight_json(result: HighlightResult, color: Color | None) -> dict[str, object]:
    import msgspec

    from mindstage.scene.colors import NO_COLOR, color_name

    return {
        "colour": NO_COLOR if color is None else color_name(color),
        "lit": [] if color is None else list(result.highlighted),
        "not_lit": msgspec.to_builtins(result.unhighlighted),
    }


def questions(*, as_json: AsJson = False) -> ExitCode:
    """List the questions that `mindstage ask` knows."""
    from mindstage.knowledge import queries as declared

    every = declared.list_questions()
    if as_json:
        print_json(
            [
                {
                    "question": each.name,
                    "arguments": [{"name": argument.name, "kind": argument.type_text} for argument in each.arguments],
                    "text": each.text,
                    "examples": list(each.examples),
                }
                for each in every
            ]
        )
    else:
        rows = [
            (each.name, " ".join(argument.name for argument in each.arguments), each.text.splitlines()[0])
            for each in every
        ]
        print_table("", ("question", "arguments", "asks"), rows)
    return ExitCode.OK


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
    from mindstage.knowledge.tell import parse_value

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


_UNBOUND_ARGUMENT = "_"
"""Leaves an argument out that others follow."""

QuestionName = Annotated[
    str, typer.Argument(metavar="QUESTION", help="Which one; `mindstage questions` lists them.", show_default=False)
]

Arguments = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[ARGS]…",
        help="Names in the question's order (_ leaves one out), or NAME=VALUE. What is left out is asked for.",
        show_default=False,
    ),
]

Why = Annotated[bool, typer.Option("--why", help="Show what led to each answer.")]

ColorOption = Annotated[
    str | None,
    typer.Option(
        "--highlight",
        metavar="COLOUR",
        help="Spawn the map and light the answers up there: black, red, blue, green, yellow, none, #rrggbb or "
        "r,g,b from 0 to 1. The options below are for that.",
        show_default=False,
    ),
]


def ask(
    context: typer.Context,
    question: QuestionName,
    args: Arguments = None,
    *,
    maps: MapOptions = None,
    why: Why = False,
    store: StoreFolder = None,
    endpoint: EndpointUrl = None,
    ontologies: Ontologies = None,
    bundled: Bundled = True,
    closure: Closure = False,
    robots: Robots = None,
    highlight: ColorOption = None,
    map_name: MapName = None,
    engine: EngineName = "mujoco",
    with_viewport: WithViewport = True,
    port: Port = 8080,
    seconds: Seconds = None,
    as_json: AsJson = False,
) -> ExitCode:
    """Ask what the robot knows. Without an answer, say what is missing, and end with 1.

    With --highlight it is asked of the running world: where things are then, and what is open.
    """
    from mindstage.knowledge.queries import get_question
    from mindstage.scene.colors import parse_color

    # First, so that a mistyped word is told before a long map is read.
    asked = get_question(question)
    named = named_args(asked, args or [])
    if highlight is None:
        _require_highlight(context)
        show = None
    else:
        show = HighlightRun(
            color=parse_color(highlight),
            engine=make_engine(engine),
            port=port if with_viewport else None,
            duration_s=seconds,
            quiet=as_json,
        )
    with progress_spinner("thinking"):
        knowledge = knowledge_base(
            maps or [],
            ontologies=ontologies,
            bundled=bundled,
            robots=robots,
            store=store,
            endpoint=endpoint,
            closure=closure,
        )
    tell = partial(_print_result, knowledge, why=why, as_json=as_json)
    if show is None:
        answers = knowledge.ask(asked, **named)
        tell(answers, {})
    else:
        answers = show.ask(knowledge, asked, named, map_name=map_name, print_answers=tell)
    return ExitCode.OK if answers else ExitCode.NEGATIVE


def _print_result(
    knowledge: KnowledgeBase, answers: Answers[Any], more: dict[str, object], *, why: bool, as_json: bool
) -> None:
    from mindstage.knowledge.queries import answers_to_builtins

    findings = knowledge.findings()
    if as_json:
        told = answers_to_builtins(knowledge, answers, explain=why) | more
        print_json(told | {"assumptions": assumptions_json(knowledge), "findings": findings_json(findings)})
    else:
        print_findings(findings)
        _print_answers(knowledge, answers, why=why)


def _require_highlight(context: typer.Context) -> None:
    """Refuses what says how answers are shown where none are.

    Raises:
        InvalidArgumentError: there is such an option.
    """
    from mindstage.errors import InvalidArgumentError

    options = {"map_name": "--map-name", "engine": "--engine", "with_viewport": "--no-viewport"}
    options |= {"port": "--port", "seconds": "--for"}
    for option in options_given(context, options):
        raise InvalidArgumentError(option, cause="it says how answers are shown", remedy="give --highlight COLOUR too")


def named_args(question: Question[Any], args: list[str]) -> dict[str, str]:
    """What was typed, by the question's names for it.

    Raises:
        InvalidArgumentError: there is more than the question takes, or one of it twice.
    """
    from mindstage.errors import InvalidArgumentError

    names = [argument.name for argument in question.arguments]
    takes = f"it takes {', '.join(names)}"
    places = iter(names)
    named: dict[str, str] = {}
    for arg in args:
        name, equals, value = arg.partition("=")
        if not equals or not name.isidentifier():
            place = next(places, None)
            if place is None:
                raise InvalidArgumentError(question.name, cause=f"{arg!r} is one argument too many", remedy=takes)
            name, value = place, arg
        if name in named:
            raise InvalidArgumentError(question.name, cause=f"{name} is given twice", remedy=takes)
        named[name] = value
    return {name: value for name, value in named.items() if value != _UNBOUND_ARGUMENT}


def _print_answers(knowledge: KnowledgeBase, answers: Answers[Any], *, why: bool) -> None:
    for lack in answers.missing:
        print_line(f"missing: {lack.reason}")
    if not answers and not answers.missing:
        print_line("no answer")
    if not answers:
        return
    columns, rows = _table_cells(knowledge, answers)
    if why:
        reasons = (knowledge.explain(answers.question, row) for row in answers)
        print_records([*columns, "why"], [[*cells, each] for cells, each in zip(rows, reasons, strict=True)])
    elif fits_table(columns, rows):
        print_table("", columns, rows)
    else:
        print_records(columns, rows)


def _table_cells(knowledge: KnowledgeBase, answers: Answers[Any]) -> tuple[list[str], list[list[Cell]]]:
    """The answers as they are printed, and the class of what was asked for: many individuals are called by a number."""
    from mindstage.knowledge.names import EntityType
    from mindstage.knowledge.queries import cell_text, subject_column

    columns, about = list(answers.question.columns), subject_column(answers)
    rows = [[cell_text(getattr(row, name)) for name in columns] for row in answers]
    if about and answers.question.columns[about] is EntityType.INDIVIDUAL and not {"cls", "classes"} & {*columns}:
        classes = (knowledge.reasoner.class_of(getattr(row, about)) for row in answers)
        rows = [[*cells, cell_text(cls)] for cells, cls in zip(rows, classes, strict=True)]
        columns.append(f"class of {about}")
    return columns, rows
