"""`mindstage list_questions`: what can be asked."""

from __future__ import annotations

from mindstage.cli.options import AsJson
from mindstage.cli.outcome import ExitCode
from mindstage.cli.output import print_json, print_table

__all__ = ["questions"]


def questions(*, as_json: AsJson = False) -> ExitCode:
    """List the questions that `mindstage ask` knows."""
    from mindstage.knowledge import questions as declared

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
