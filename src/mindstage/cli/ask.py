"""`mindstage ask`: one of the declared questions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from mindstage.cli.options import AsJson, Bundled, MapOptions, Ontologies
from mindstage.cli.outcome import Outcome
from mindstage.cli.output import findings_json, print_findings, print_json, print_table, say, working
from mindstage.cli.sources import knowledge_base

if TYPE_CHECKING:
    from mindstage.knowledge import KnowledgeBase
    from mindstage.knowledge.questions import Answers, Question

__all__ = ["ask"]

_FREE = "_"
"""Leaves an argument out that others follow."""


def ask(
    question: Annotated[
        str, typer.Argument(metavar="QUESTION", help="Which one; `mindstage questions` lists them.", show_default=False)
    ],
    args: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[ARGS]…",
            help="Names in the question's order (_ leaves one out), or NAME=VALUE. What is left out is asked for.",
            show_default=False,
        ),
    ] = None,
    *,
    maps: MapOptions = None,
    why: Annotated[bool, typer.Option("--why", help="Show what led to each answer.")] = False,
    ontologies: Ontologies = None,
    bundled: Bundled = True,
    as_json: AsJson = False,
) -> Outcome:
    """Ask what the robot knows. Without an answer, say what is missing, and end with 1."""
    from mindstage.knowledge.questions import answers_to_builtins, question_named

    with working("thinking"):
        asked = question_named(question)
        named = _named(asked, args or [])
        knowledge = knowledge_base(maps or [], ontologies=ontologies, bundled=bundled)
        answers = knowledge.ask(asked, **named)
    findings = knowledge.findings()
    if as_json:
        told = answers_to_builtins(knowledge, answers, why=why)
        print_json(told | {"findings": findings_json(findings)})
    else:
        print_findings(findings)
        _print_answers(knowledge, answers, why=why)
    return Outcome.DONE if answers else Outcome.NO


def _named(question: Question[Any], args: list[str]) -> dict[str, str]:
    """What was typed, by the question's names for it.

    Raises:
        ArgumentRefused: there is more than the question takes, or one of it twice.
    """
    from mindstage.errors import ArgumentRefused

    names = [argument.name for argument in question.arguments]
    takes = f"it takes {', '.join(names)}"
    places = iter(names)
    named: dict[str, str] = {}
    for arg in args:
        name, equals, value = arg.partition("=")
        if not equals or not name.isidentifier():
            place = next(places, None)
            if place is None:
                raise ArgumentRefused(question.name, cause=f"{arg!r} is one argument too many", remedy=takes)
            name, value = place, arg
        if name in named:
            raise ArgumentRefused(question.name, cause=f"{name} is given twice", remedy=takes)
        named[name] = value
    return {name: value for name, value in named.items() if value != _FREE}


def _print_answers(knowledge: KnowledgeBase, answers: Answers[Any], *, why: bool) -> None:
    from mindstage.knowledge.questions import cell_text

    for lack in answers.missing:
        say(f"missing: {lack.why}")
    if not answers:
        if not answers.missing:
            say("no answer")
        return
    columns = [*answers.question.columns, *(["why"] if why else [])]
    rows = []
    for row in answers:
        cells = [cell_text(getattr(row, name)) for name in answers.question.columns]
        rows.append([*cells, "; ".join(knowledge.why(answers.question, row))] if why else cells)
    print_table("", columns, rows)
