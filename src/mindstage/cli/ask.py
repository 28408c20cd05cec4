"""The verbs `ask`, `questions`, `sparql` and `tell`, which query and change a knowledge base.

With `--highlight`, `ask` spawns the map and highlights the answers in the simulation.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mindstage.access.limits import Deadline
from mindstage.cli.attach import open_running, running_target
from mindstage.cli.options import (
    DEFAULT_READING,
    NO_EPISODES,
    AsJson,
    AtTime,
    Closure,
    DuringInterval,
    EndpointUrl,
    EngineName,
    EpisodeOptions,
    ExitCode,
    MapName,
    MapOptions,
    MapReading,
    Port,
    Running,
    Seconds,
    SinceTime,
    StoreFolder,
    UntilTime,
    WithViewer,
    options_given,
)
from mindstage.cli.output import (
    Cell,
    assumptions_json,
    class_lookup,
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
from mindstage.cli.setup import knowledge_base, knowledge_with_episodes, make_engine, simulation_from_options
from mindstage.cli.viewer import show_page

if TYPE_CHECKING:
    from mindstage.engines import Engine
    from mindstage.knowledge import KnowledgeBase
    from mindstage.knowledge.queries import Answers, Question
    from mindstage.rdf import RdfTerm, SparqlResult
    from mindstage.scene import Color
    from mindstage.simulation import HighlightResult

__all__ = ["HighlightRun", "ask", "named_args", "questions", "sparql", "tell"]


PrintAnswers = Callable[["Answers[Any]", dict[str, object]], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class HighlightRun:
    """Options for asking a question about a spawned map and highlighting its answers."""

    color: Color | None
    """None for no highlight."""
    engine: Engine
    """The engine; closed at the end."""
    has_page: bool
    """Whether the page is served."""
    port: int | None
    """The port of the page; None for the default one."""
    duration_s: float | None
    """Duration of the simulation [s]; None for no limit, or for none without a page."""
    quiet: bool
    """Whether to print the answers only."""

    def ask(
        self,
        knowledge: KnowledgeBase,
        question: Question[Any],
        args: Mapping[str, str],
        *,
        map_name: str | None,
        print_answers: PrintAnswers,
    ) -> Answers[Any]:
        """Spawns a map, asks the question, highlights the answers and, if there are any, serves the page.

        Args:
            args: its arguments, as text.
            map_name: the map to spawn; by default the one among the arguments, or the only one.
            print_answers: prints the answers, and with `--json` the given further fields.
        """
        with simulation_from_options(knowledge, self.engine) as simulation:
            with progress_spinner("spawning"):
                report = simulation.spawn(map_name or _map_of_question(knowledge, question, args))
                answers = simulation.ask(question, **args)
                result = simulation.highlight(answers, self.color)
            print_failures(report)
            for item in () if self.quiet else result.unhighlighted:
                warn(f"not highlighted: {item.id}: {item.reason}")
            fields: dict[str, object] = {"engine": simulation.engine.name, "spawn": report_json(report)}
            fields |= _highlight_json(result, self.color)
            if answers and self.has_page:
                announce = partial(self._announce, print_answers, answers, result, fields)
                show_page(simulation, port=self.port, duration_s=self.duration_s, announce=announce, quiet=self.quiet)
            else:
                step_with_progress(simulation, self.duration_s or 0.0)
                print_answers(answers, fields)
        return answers

    def _announce(
        self,
        print_answers: PrintAnswers,
        answers: Answers[Any],
        result: HighlightResult,
        fields: dict[str, object],
        url: str,
    ) -> None:
        print_answers(answers, fields | {"url": url})  # before the simulation ends, since the URL is valid until then
        if not self.quiet:
            print_line(f"{0 if self.color is None else len(result.highlighted)} highlighted at {url}")


def _map_of_question(knowledge: KnowledgeBase, question: Question[Any], args: Mapping[str, str]) -> str | None:
    """The map among the arguments of a question, if there is one."""
    from mindstage.knowledge.names import EntityType

    map_arguments = [argument.name for argument in question.arguments if argument.value_type is EntityType.MAP]
    return next((knowledge.names.find(args[name], EntityType.MAP) for name in map_arguments if name in args), None)


def _highlight_json(result: HighlightResult, color: Color | None) -> dict[str, object]:
    import msgspec

    from mindstage.scene.colors import NO_COLOR, color_name

    return {
        "color": NO_COLOR if color is None else color_name(color),
        "highlighted": [] if color is None else list(result.highlighted),
        "not_highlighted": msgspec.to_builtins(result.unhighlighted),
    }


def questions(*, as_json: AsJson = False) -> ExitCode:
    """List the questions of `mindstage ask`."""
    from mindstage.knowledge.queries import list_questions

    listed = list_questions()
    if as_json:
        print_json(
            [
                {
                    "question": each.name,
                    "arguments": [{"name": argument.name, "kind": argument.type_text} for argument in each.arguments],
                    "text": each.text,
                    "sentences": list(each.sentences),
                    "examples": list(each.examples),
                }
                for each in listed
            ]
        )
    else:
        rows = [
            (each.name, " ".join(argument.name for argument in each.arguments), each.text.splitlines()[0])
            for each in listed
        ]
        print_table("", ("question", "arguments", "description"), rows)
    return ExitCode.OK


def sparql(
    context: typer.Context,
    query: Annotated[
        str,
        typer.Argument(
            metavar="QUERY", help="SPARQL 1.1; common prefixes such as knowrob: are declared.", show_default=False
        ),
    ],
    *,
    maps: MapOptions = None,
    running: Running = None,
    timeout_s: Annotated[
        Deadline,
        typer.Option("--timeout", metavar="SECONDS", help="The timeout."),
    ] = 30.0,
    allow_service: Annotated[
        bool, typer.Option("--allow-service", help="Permit SERVICE, which queries other servers.")
    ] = False,
    store: StoreFolder = None,
    endpoint: EndpointUrl = None,
    reading: MapReading = DEFAULT_READING,
    closure: Closure = False,
    recorded: EpisodeOptions = NO_EPISODES,
    at: AtTime = None,
    as_json: AsJson = False,
) -> ExitCode:
    """Run a SPARQL query on the loaded sources, or on an endpoint; exit 1 for no result, or for the answer no.

    With --episode, the graph urn:mindstage:episode:NAME has the events of that episode, and urn:mindstage:present the
    state at --at.
    """
    from mindstage.errors import InvalidArgumentError

    allowed = {"query", "running", "timeout_s", "at", "as_json"}
    if (target := running_target(context, running, maps, allowed=allowed)) is not None:
        return _query_running(target, query, at=at, timeout_s=timeout_s, as_json=as_json)
    if closure and endpoint:
        cause = "an endpoint does not contain the statements that are derived here"
        raise InvalidArgumentError("--closure", cause=cause, remedy="omit it, or ask one of the questions")
    with progress_spinner("querying"):
        knowledge = knowledge_with_episodes(
            maps or [], reading, recorded, store=store, endpoint=endpoint, closure=closure
        )
        named = recorded.named().get("episode")
        table = knowledge.sparql(query, timeout_s=timeout_s, allow_service=allow_service, at=at, episode=named)
    findings = knowledge.findings()
    if not as_json:
        print_findings(findings, classes=class_lookup(knowledge))
    return _print_sparql(table, as_json={"findings": findings_json(findings)} if as_json else None)


def _query_running(target: str, query: str, *, at: float | None, timeout_s: float, as_json: bool) -> ExitCode:
    """Runs a SPARQL query in a running simulation."""
    import msgspec

    from mindstage.rdf import SparqlResult

    with progress_spinner("querying"), open_running(target) as simulation:
        args = "{}" if at is None else msgspec.json.encode({"at": at}).decode()
        result = simulation.query("sparql", query, args=args, timeout_s=timeout_s)
    table = msgspec.convert(result | {"boolean": result["truth"]}, SparqlResult)
    fields = {"findings": result.get("findings", []), "running": simulation.address}
    return _print_sparql(table, as_json=fields if as_json else None)


def _print_sparql(table: SparqlResult, *, as_json: Mapping[str, object] | None) -> ExitCode:
    """Prints a result as a table, or as JSON with further fields."""
    import msgspec

    if as_json is not None:
        solutions = [
            {name: msgspec.to_builtins(term) for name, term in zip(table.columns, row, strict=True) if term is not None}
            for row in table.rows
        ]
        print_json({"columns": table.columns, "rows": solutions, "truth": table.boolean, **as_json})
    elif table.boolean is not None:
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
    property: Annotated[
        str, typer.Argument(metavar="PROPERTY", help="A property, such as subClassOf.", show_default=False)
    ],
    value: Annotated[
        str,
        typer.Argument(
            metavar="VALUE", help="A name, a number, true, false, or a string (such as '\"5\"').", show_default=False
        ),
    ],
    *,
    retract: Annotated[bool, typer.Option("--retract", help="Retract the statement instead.")] = False,
    store: StoreFolder = None,
    endpoint: EndpointUrl = None,
    update_endpoint: Annotated[
        str | None,
        typer.Option(
            "--update-endpoint",
            metavar="URL",
            help="The URL for updates, if it is not /update beside /query or /sparql.",
            show_default=False,
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE.ttl",
            help="A Turtle file, which is loaded with --ontology.",
            show_default=False,
        ),
    ] = None,
    maps: MapOptions = None,
    reading: MapReading = DEFAULT_READING,
    as_json: AsJson = False,
) -> ExitCode:
    """Assert or retract a statement, in a store, at an endpoint, or in a file.

    About a class it applies to all its instances. A new name needs a prefix; it becomes a class by subClassOf, and an
    individual by type: mindstage tell ms:MilkRack subClassOf Refrigerator -o told.ttl
    """
    from mindstage.knowledge import AssertionFile, SparqlEndpoint
    from mindstage.knowledge.tell import parse_value

    target_name = _target_name(store, endpoint, output)
    with progress_spinner("asserting"):
        sparql_endpoint = None if endpoint is None else SparqlEndpoint(endpoint, update_url=update_endpoint)
        knowledge = knowledge_base(maps or [], reading, store=store, endpoint=sparql_endpoint)
        target = AssertionFile(output, knowledge) if output else knowledge
        done = (target.retract if retract else target.tell)(subject, property, parse_value(value))
    findings = knowledge.findings()
    if as_json:
        statement = {"subject": subject, "property": property, "value": value}
        print_json({"done": done, "statement": statement, "where": target_name, "findings": findings_json(findings)})
    else:
        print_findings(findings, classes=class_lookup(knowledge))
        print_line(_result_text(f"{subject} {property} {value}", target_name, retract=retract, done=done))
    return ExitCode.OK if done or not retract else ExitCode.NEGATIVE


def _target_name(store: Path | None, endpoint: str | None, output: Path | None) -> str:
    """The store, endpoint or file of an assertion.

    Raises:
        InvalidArgumentError: none of them is given, or several.
    """
    from mindstage.errors import InvalidArgumentError

    targets = [str(target) for target in (store, endpoint, output) if target is not None]
    if len(targets) == 1:
        return targets[0]
    cause = "the statement would not be stored" if not targets else "a statement is stored in one target"
    raise InvalidArgumentError("tell", cause=cause, remedy="give one of --store DIR, --endpoint URL and -o FILE.ttl")


def _result_text(statement: str, target: str, *, retract: bool, done: bool) -> str:
    if retract:
        return f"retracted: {statement}" if done else f"not asserted in {target}: {statement}"
    return f"asserted: {statement}" if done else f"already asserted: {statement}"


_UNBOUND_ARGUMENT = "_"
"""The text of an omitted positional argument."""

QuestionName = Annotated[
    str,
    typer.Argument(
        metavar="QUESTION",
        help="The name of a question, which `mindstage questions` lists, or a sentence: where is the milk?",
        show_default=False,
    ),
]

Arguments = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[ARGS]…",
        help="Arguments in the order of the question (_ omits one), or NAME=VALUE. Omitted ones are answered.",
        show_default=False,
    ),
]

Rows = Annotated[
    bool, typer.Option("--rows", help="Print the answers to a sentence as a table, too.", show_default=False)
]

Why = Annotated[bool, typer.Option("--why", help="Explain each answer.")]

ColorOption = Annotated[
    str | None,
    typer.Option(
        "--highlight",
        metavar="COLOR",
        help="Spawn the map and highlight the answers: black, red, blue, green, yellow, none, #rrggbb or "
        "r,g,b from 0 to 1. The options below require it.",
        show_default=False,
    ),
]


def ask(
    context: typer.Context,
    question: QuestionName,
    args: Arguments = None,
    *,
    maps: MapOptions = None,
    running: Running = None,
    rows: Rows = False,
    why: Why = False,
    store: StoreFolder = None,
    endpoint: EndpointUrl = None,
    reading: MapReading = DEFAULT_READING,
    closure: Closure = False,
    recorded: EpisodeOptions = NO_EPISODES,
    at: AtTime = None,
    during: DuringInterval = None,
    since: SinceTime = None,
    until: UntilTime = None,
    highlight: ColorOption = None,
    map_name: MapName = None,
    engine: EngineName = "mujoco",
    with_viewer: WithViewer = True,
    port: Port = None,
    seconds: Seconds = None,
    as_json: AsJson = False,
) -> ExitCode:
    """Ask a question; without an answer, print what is missing, and exit 1.

    A sentence (mindstage ask are all drawers closed) is answered by one: exit 0 for yes, 1 for no, 3 for unknown.
    With --highlight the question is asked about the state of the simulation, and with --running about that of a
    running one. With --episode or --episodes it is asked about any time of recorded ones: --at 3.2.
    """
    # Before the map is read, so that a wrong name fails at once.
    sentence = _sentence(question, args or [])
    if sentence.lower().rstrip(" ?") in {"what can i ask", "what can you answer"}:
        return questions(as_json=as_json)
    asked = None if sentence else _question_with_args(question, args or [])
    allowed = {"question", "args", "running", "rows", "why", "highlight", "as_json", "at", "during", "since", "until"}
    when = {"at": at, "during": during, "since": since, "until": until}
    when = {name: value for name, value in when.items() if value is not None}
    if (target := running_target(context, running, maps, allowed=allowed)) is not None:
        return _ask_running(target, asked, sentence, when, rows=rows, why=why, highlight=highlight, as_json=as_json)

    if when or recorded.episode or recorded.episodes:
        _refuse_highlight(highlight)
    shown = {"has_page": with_viewer, "port": port, "duration_s": seconds, "quiet": as_json}
    run = _highlight_run(context, highlight, engine, shown)
    with progress_spinner("loading"):
        knowledge = knowledge_with_episodes(
            maps or [], reading, recorded, store=store, endpoint=endpoint, closure=closure
        )
    resolved, named, notes = asked or _understood(
        knowledge, sentence, is_past=bool(when or recorded.episode or recorded.episodes)
    )
    has_rows = rows or why or not sentence
    print_answers = partial(_print_result, knowledge, notes, rows=has_rows, why=why, as_json=as_json)
    if run is None:
        with progress_spinner("asking"):
            answers = knowledge.ask(resolved, **named, **when, **recorded.named())
        print_answers(answers, {})
    else:
        answers = run.ask(knowledge, resolved, named, map_name=map_name, print_answers=print_answers)
    return _exit_code(answers.conclusion.truth)


def _exit_code(truth: bool | None) -> ExitCode:
    return ExitCode.UNKNOWN if truth is None else ExitCode.OK if truth else ExitCode.NEGATIVE


def _highlight_run(
    context: typer.Context, color: str | None, engine: str, shown: Mapping[str, Any]
) -> HighlightRun | None:
    """The simulation in which answers are highlighted; None without `--highlight`.

    Raises:
        InvalidArgumentError: an option that requires `--highlight` is given without it.
        InvalidColorError: the color is invalid.
        EngineUnavailableError: the engine is not installed.
    """
    if color is None:
        _require_highlight(context)
        return None
    from mindstage.scene.colors import parse_color

    return HighlightRun(color=parse_color(color), engine=make_engine(engine), **shown)


def _refuse_highlight(highlight: str | None) -> None:
    """Rejects `--highlight` for another time than the present.

    Raises:
        InvalidArgumentError: it is given.
    """
    from mindstage.errors import InvalidArgumentError

    if highlight is not None:
        cause = "it spawns the map as it is, not the world of an episode"
        raise InvalidArgumentError("--highlight", cause=cause, remedy="omit it, or the options about episodes")


AskedQuestion = tuple["Question[Any]", Mapping[str, str], tuple[str, ...]]
"""A question, its arguments as text, and how they were understood."""


def _sentence(question: str, args: list[str]) -> str:
    """The plain sentence that the arguments of the command are; empty if they name a question."""
    from mindstage.knowledge.questions import question_names

    words = [question, *(arg for arg in args if "=" not in arg)]
    if not question.replace("-", "_").isidentifier():
        from mindstage.knowledge.sentences import is_sentence  # not needed for most questions, and slow to load

        return " ".join(words) if is_sentence(question) else ""
    is_name = question.replace("-", "_") in question_names()
    return "" if is_name or not question.isalpha() or len(words) == 1 else " ".join(words)


def _question_with_args(question: str, args: list[str]) -> AskedQuestion:
    from mindstage.knowledge.questions import get_question

    resolved = get_question(question)
    return resolved, named_args(resolved, args), ()


def _understood(knowledge: KnowledgeBase, sentence: str, *, is_past: bool) -> AskedQuestion:
    from mindstage.errors import SentenceNotUnderstoodError
    from mindstage.knowledge.sentences import understand

    try:
        understood = understand(knowledge, sentence, is_past=is_past)
    except SentenceNotUnderstoodError:
        _point_to_do(knowledge, sentence)
        raise
    return understood.question, {name: str(value) for name, value in understood.args.items()}, understood.notes


def _point_to_do(knowledge: KnowledgeBase, sentence: str) -> None:
    """Refuses a command with the verb that performs it.

    Raises:
        SentenceNotUnderstoodError: it is a command.
    """
    from mindstage.errors import AmbiguousSentenceError, SentenceNotUnderstoodError
    from mindstage.robots.commands import understand_command

    try:
        found = understand_command(knowledge, sentence)
    except (SentenceNotUnderstoodError, AmbiguousSentenceError):
        return
    does = f"mindstage do {sentence!r} MAP does it"
    tries = f"mindstage do '{found}' MAP --try-first 0.9 tries it in copies of the world"
    cause = f"it is no question: {tries if found.is_hypothetical else does}"
    raise SentenceNotUnderstoodError(sentence, cause=cause)


def _ask_running(
    target: str,
    asked: AskedQuestion | None,
    sentence: str,
    when: Mapping[str, object],
    *,
    rows: bool,
    why: bool,
    highlight: str | None,
    as_json: bool,
) -> ExitCode:
    """Asks a running simulation."""
    import msgspec

    from mindstage.knowledge.questions import get_question

    name, own = (asked[0].name, asked[1]) if asked else (sentence, {})
    named = msgspec.json.encode({**own, **when}).decode()
    with progress_spinner("asking"), open_running(target) as simulation:
        result = simulation.query("question", name, args=named, explain=why, highlight=highlight or "")
    if as_json:
        print_json({**result, "running": simulation.address})
    else:
        for note in result.get("notes", ()):
            print_line(note)
        if sentence:
            print_line(result["sentence"])
        if rows or why or not sentence:
            _print_received(get_question(result["question"]), result, why=why)
        for item in result.get("not_highlighted", ()):
            warn(f"not highlighted: {item['id']}: {item['reason']}")
        if highlight is not None:
            print_line(f"{len(result['highlighted'])} highlighted in {simulation.address}")
    return _exit_code(result["truth"])


def _print_received(question: Question[Any], result: Mapping[str, Any], *, why: bool) -> None:
    """Prints the answers of a running simulation.

    Raises:
        InvalidArgumentError: the simulation is of a version with other columns.
    """
    import msgspec

    from mindstage.errors import InvalidArgumentError
    from mindstage.knowledge.queries import Answers, MissingKnowledge

    records = result["answers"]
    try:
        rows = [msgspec.convert(record, question.row) for record in records]
    except msgspec.ValidationError as error:
        remedy = "use --json, or the same version on both sides"
        raise InvalidArgumentError(question.name, cause=f"the answers differ: {error}", remedy=remedy) from error
    missing = [MissingKnowledge(each["class"], each["property"], each["why"]) for each in result["missing"]]
    answers = Answers(question, result["args"], rows, missing)
    classes = {record["iri"]: record["class"] for record in records if "iri" in record}
    reasons = [record["why"] for record in records] if why else None
    _print_answers(answers, class_of=classes.get, reasons=reasons)


def _print_result(
    knowledge: KnowledgeBase,
    notes: tuple[str, ...],
    answers: Answers[Any],
    fields: dict[str, object],
    *,
    rows: bool,
    why: bool,
    as_json: bool,
) -> None:
    from mindstage.knowledge.queries import answers_to_builtins

    findings = knowledge.findings()
    if as_json:
        output = answers_to_builtins(knowledge, answers, explain=why) | fields
        output["notes"] = [*notes, *answers.notes]
        print_json(output | {"assumptions": assumptions_json(knowledge), "findings": findings_json(findings)})
    else:
        print_findings(findings, classes=class_lookup(knowledge))
        for note in (*notes, *answers.notes):
            print_line(note)
        if notes:  # a sentence
            print_line(answers.conclusion.sentence)
        if not rows:
            return
        reasons = [knowledge.explain(answers.question, row) for row in answers] if why else None
        _print_answers(answers, class_of=knowledge.reasoner.class_of, reasons=reasons)


def _require_highlight(context: typer.Context) -> None:
    """Rejects options that require `--highlight`.

    Raises:
        InvalidArgumentError: there is such an option.
    """
    from mindstage.errors import InvalidArgumentError

    options = {"map_name": "--map-name", "engine": "--engine", "with_viewer": "--no-viewer"}
    options |= {"port": "--port", "seconds": "--for"}
    for option in options_given(context, options):
        raise InvalidArgumentError(option, cause="it requires --highlight", remedy="give --highlight COLOR too")


def named_args(question: Question[Any], args: list[str]) -> dict[str, str]:
    """The arguments from the command line, by name.

    Raises:
        InvalidArgumentError: there are too many arguments, or one is given twice.
    """
    from mindstage.errors import InvalidArgumentError

    names = [argument.name for argument in question.arguments]
    takes = f"it takes {', '.join(names)}"
    positions = iter(names)
    named: dict[str, str] = {}
    for arg in args:
        name, equals, value = arg.partition("=")
        if not equals or not name.isidentifier():
            position = next(positions, None)
            if position is None:
                raise InvalidArgumentError(question.name, cause=f"{arg!r} is one argument too many", remedy=takes)
            name, value = position, arg
        if name in named:
            raise InvalidArgumentError(question.name, cause=f"{name} is given twice", remedy=takes)
        named[name] = value
    return {name: value for name, value in named.items() if value != _UNBOUND_ARGUMENT}


def _print_answers(
    answers: Answers[Any], *, class_of: Callable[[Any], str | None], reasons: Sequence[Sequence[str]] | None
) -> None:
    """Prints answers as a table, or as records if they have reasons or do not fit.

    Args:
        class_of: returns the class of an individual, or None.
        reasons: the explanation of each answer; None for none.
    """
    for missing in answers.missing:
        print_line(f"missing: {missing.reason}")
    if not answers and not answers.missing:
        print_line("no answer")
    if not answers:
        return
    columns, rows = _table_cells(answers, class_of)
    if reasons is not None:
        print_records([*columns, "why"], [[*cells, each] for cells, each in zip(rows, reasons, strict=True)])
    elif fits_table(columns, rows):
        print_table("", columns, rows)
    else:
        print_records(columns, rows)


def _table_cells(answers: Answers[Any], class_of: Callable[[Any], str | None]) -> tuple[list[str], list[list[Cell]]]:
    """The columns and rows of a table of answers, with the class of the subjects, since many names are numbers."""
    from mindstage.knowledge.names import EntityType
    from mindstage.knowledge.queries import cell_text, subject_column

    columns, about = list(answers.question.columns), subject_column(answers)
    rows = [[cell_text(getattr(row, name)) for name in columns] for row in answers]
    if about and answers.question.columns[about] is EntityType.INDIVIDUAL and not {"cls", "classes"} & {*columns}:
        classes = (class_of(getattr(row, about)) for row in answers)
        rows = [[*cells, cell_text(cls)] for cells, cls in zip(rows, classes, strict=True)]
        columns.append(f"class of {about}")
    return columns, rows
