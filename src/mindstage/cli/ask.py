"""`mindstage ask`: one of the declared questions."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mindstage.cli.engine import make_engine
from mindstage.cli.highlight import HighlightRun
from mindstage.cli.options import (
    AsJson,
    Bundled,
    Closure,
    EndpointUrl,
    EngineName,
    MapName,
    MapOptions,
    Ontologies,
    Port,
    Robots,
    Seconds,
    StoreFolder,
    WithViewport,
    options_given,
)
from mindstage.cli.outcome import ExitCode
from mindstage.cli.output import (
    Cell,
    findings_json,
    fits_table,
    print_findings,
    print_json,
    print_line,
    print_records,
    print_table,
    progress_spinner,
)
from mindstage.cli.reading import assumptions_json
from mindstage.cli.sources import knowledge_base

if TYPE_CHECKING:
    from mindstage.knowledge import KnowledgeBase
    from mindstage.knowledge.questions import Answers, Question

__all__ = ["ask", "named_args"]

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
    from mindstage.knowledge.questions import get_question
    from mindstage.world.colors import parse_color

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
    from mindstage.knowledge.questions import answers_to_builtins

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
    from mindstage.knowledge.questions import cell_text, subject_column
    from mindstage.knowledge.reasoning import EntityType

    columns, about = list(answers.question.columns), subject_column(answers)
    rows = [[cell_text(getattr(row, name)) for name in columns] for row in answers]
    if about and answers.question.columns[about] is EntityType.INDIVIDUAL and not {"cls", "classes"} & {*columns}:
        classes = (knowledge.reasoner.class_of(getattr(row, about)) for row in answers)
        rows = [[*cells, cell_text(cls)] for cells, cls in zip(rows, classes, strict=True)]
        columns.append(f"class of {about}")
    return columns, rows
