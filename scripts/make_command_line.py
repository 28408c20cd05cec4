"""Writes docs/reference/command-line.md from the command line's own help; with --check only compares.

Usage: make_command_line.py [--check]
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import typer
from generated import write_or_compare

from mindstage.cli.app import app

__all__ = ["main"]

PAGE = Path(__file__).resolve().parent.parent / "docs" / "reference" / "command-line.md"

HEAD = """# Command line

<!-- Written by scripts/make_command_line.py: change the help texts in src/mindstage/cli instead. -->

`mindstage VERB --help` prints the same information. A map is a file (OWL, Turtle, URDF, xacro), a `package://` name, or
`bundled:kitchen`. [JSON output and exit codes](json-output.md) describes the results for programs;
[Ask questions](../how-to/asking.md) and the other how-to pages show the verbs in use.
"""


def main() -> int:
    """Writes or checks the page; returns 0 if it is up to date, otherwise 1."""
    return write_or_compare({PAGE: page()})


def page() -> str:
    """The complete document."""
    group: Any = typer.main.get_command(app)  # a click command or typer's own copy of it, depending on the version
    return "\n".join([HEAD, *(line for name, verb in verbs(group) for line in section(name, verb))])


def verbs(group: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """The verbs with their names; those of a group have two words."""
    for name, verb in group.commands.items():
        if hasattr(verb, "commands"):
            yield from verbs(verb, f"{prefix}{name} ")
        elif not verb.hidden:
            yield f"{prefix}{name}", verb


def section(name: str, verb: Any) -> Iterator[str]:
    """One verb: usage, help text, and tables of its arguments and options."""
    arguments = [
        each for each in verb.params if each.param_type_name == "argument" and not getattr(each, "hidden", False)
    ]
    options = [each for each in verb.params if each.param_type_name == "option" and not each.hidden]
    usage = " ".join(["mindstage", name, *(metavar(each) for each in arguments), "[OPTIONS]"])
    yield from (f"## mindstage {name}", "", plain(verb.help), "", f"    {usage}", "")
    if arguments:
        rows = [(f"`{metavar(each)}`", plain(getattr(each, "help", ""))) for each in arguments]
        yield from table("argument", rows)
    rows = [(names(each), described(each)) for each in options]
    yield from table("option", rows)


def table(title: str, rows: list[tuple[str, str]]) -> Iterator[str]:
    """A Markdown table with two columns."""
    yield from (f"| {title} | meaning |", "|---|---|")
    yield from (f"| {left} | {right} |" for left, right in rows)
    yield ""


def names(option: Any) -> str:
    """The spellings of an option, each in backticks, with the placeholder of its value."""
    value = "" if option.is_flag else f" {metavar(option)}"
    spellings = (*option.opts, *option.secondary_opts)
    return ", ".join(f"`{name.strip()}{value}`" for name in spellings if name.strip())


def described(option: Any) -> str:
    """The help text, with the default value and the environment variable."""
    notes = []
    if option.show_default and not option.is_flag and option.default not in {None, ""}:
        notes.append(f"default: {option.default}")
    if option.envvar:
        variables = [option.envvar] if isinstance(option.envvar, str) else option.envvar
        notes.append("environment: " + ", ".join(f"`{variable}`" for variable in variables))
    return plain(option.help) + (f" ({'; '.join(notes)})" if notes else "")


def metavar(parameter: Any) -> str:
    """The placeholder of a value."""
    text = parameter.metavar or str(parameter.name).upper()
    return text.replace("|", " or ")  # a pipe would end the table cell


def plain(text: str | None) -> str:
    """A help text in one line, safe in a table."""
    return " ".join((text or "").replace("|", "\\|").split())


if __name__ == "__main__":
    sys.exit(main())
