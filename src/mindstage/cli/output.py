"""Output: results on stdout, as tables for people or JSON for programs; everything else on stderr."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

    from mindstage.knowledge import Finding

__all__ = [
    "Cell",
    "console",
    "findings_json",
    "one_line",
    "print_findings",
    "print_json",
    "print_table",
    "say",
    "warn",
    "working",
]

_WIDE = 160
"""Columns [characters] where nobody looks through a window."""
_MANY = 20
"""More findings than this are cut short on a terminal; JSON has them all."""

Cell = str | int | float | None


def one_line(text: str) -> str:
    """The text without line breaks or control characters, which a hostile file could use to rewrite the terminal."""
    return "".join(letter if letter.isprintable() else " " for letter in text)


def console(*, stderr: bool = False) -> Console:
    """The terminal, or whatever stands for it, behind stdout or stderr."""
    from rich.console import Console

    class PipeConsole(Console):
        def on_broken_pipe(self) -> None:
            raise BrokenPipeError  # rich itself would end the process with 1, which means "no" here

    terminal = PipeConsole(stderr=stderr, highlight=False, markup=False, emoji=False)
    if not terminal.is_terminal:
        terminal.width = _WIDE
    return terminal


def say(text: str) -> None:
    """One plain line on stdout, there at once."""
    sys.stdout.write(one_line(text) + "\n")
    sys.stdout.flush()


def warn(text: str) -> None:
    """One yellow line on stderr."""
    console(stderr=True).print(f"mindstage: {one_line(text)}", style="yellow", soft_wrap=True)


@contextmanager
def working(what: str) -> Iterator[None]:
    """Shows a person that something goes on inside; nothing where nobody looks."""
    if not sys.stderr.isatty():
        yield
        return
    with console(stderr=True).status(f"{what} …"):
        yield


def print_json(value: object) -> None:
    """One JSON document on stdout. What JSON has no number for (infinite, not a number) becomes null."""
    import msgspec

    sys.stdout.write(msgspec.json.format(msgspec.json.encode(value), indent=2).decode() + "\n")
    sys.stdout.flush()


def print_table(title: str, columns: Sequence[str], rows: Iterable[Sequence[Cell]]) -> None:
    """A table on stdout; a column that holds numbers is set to the right."""
    from rich.table import Table
    from rich.text import Text

    lines = list(rows)
    table = Table()
    for at, column in enumerate(columns):
        words = any(isinstance(line[at], str) for line in lines)
        table.add_column(column, justify="left" if words else "right", overflow="fold")
    for line in lines:
        table.add_row(*(Text(one_line(_shown(cell))) for cell in line))
    terminal = console()
    if title:
        terminal.print(Text(one_line(title), style="bold"), soft_wrap=True)  # a narrow table would break its own title
    terminal.print(table)


def print_findings(findings: Sequence[Finding]) -> None:
    """What the knowledge base found odd, on stderr, one line each."""
    for finding in findings[:_MANY]:
        warn(str(finding))
    if len(findings) > _MANY:
        warn(f"… and {len(findings) - _MANY} more; --json shows all")


def findings_json(findings: Iterable[Finding]) -> list[dict[str, object]]:
    """The findings as they stand in JSON."""
    import msgspec

    return [msgspec.to_builtins(finding) for finding in findings]


def _shown(cell: Cell) -> str:
    if cell is None:
        return "-"
    return f"{cell:.6g}" if isinstance(cell, float) else str(cell)
