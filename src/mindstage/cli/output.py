"""Output: results on stdout, as tables for people or JSON for programs; everything else on stderr."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import chain, repeat
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

    from mindstage.knowledge import Finding

__all__ = [
    "Cell",
    "console",
    "findings_json",
    "fits_table",
    "one_line",
    "print_findings",
    "print_json",
    "print_line",
    "print_records",
    "print_table",
    "progress_spinner",
    "warn",
]

_DEFAULT_WIDTH = 160
"""Columns [characters] where nobody looks through a window."""
_MAX_FINDINGS = 20
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
        terminal.width = _DEFAULT_WIDTH
    return terminal


def print_line(text: str) -> None:
    """One plain line on stdout, there at once."""
    sys.stdout.write(one_line(text) + "\n")
    sys.stdout.flush()


def warn(text: str) -> None:
    """One yellow line on stderr."""
    console(stderr=True).print(f"mindstage: {one_line(text)}", style="yellow", soft_wrap=True)


@contextmanager
def progress_spinner(text: str) -> Iterator[None]:
    """Shows a person that something goes on inside; nothing where nobody looks."""
    if not sys.stderr.isatty():
        yield
        return
    with console(stderr=True).status(f"{text} …"):
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
        table.add_row(*(Text(one_line(_cell_text(cell))) for cell in line))
    terminal = console()
    if title:
        terminal.print(Text(one_line(title), style="bold"), soft_wrap=True)  # a narrow table would break its own title
    terminal.print(table)


def fits_table(columns: Sequence[str], rows: Iterable[Sequence[Cell]]) -> bool:
    """Whether a table needs to break no cell."""
    widths = [len(column) for column in columns]
    for row in rows:
        widths = [max(width, len(_cell_text(cell))) for width, cell in zip(widths, row, strict=True)]
    return sum(widths) + 3 * len(widths) + 1 <= console().width


def print_records(columns: Sequence[str], rows: Iterable[Sequence[Cell | Sequence[str]]]) -> None:
    """The same with a line for each field, and for each of several texts in one; what is empty is left out."""
    from textwrap import wrap

    from rich.text import Text

    terminal = console()
    indent = max(map(len, columns), default=0) + 2
    for at, row in enumerate(rows):
        if at:
            terminal.print()
        for column, cell in zip(columns, row, strict=True):
            texts = [_cell_text(cell)] if isinstance(cell, str | int | float) else list(cell or ())
            width = max(20, terminal.width - indent)
            lines = [line for text in texts for line in wrap(one_line(text), width, break_on_hyphens=False)]
            for first, line in zip(chain([column], repeat("")), lines, strict=False):
                terminal.print(Text.assemble((first.ljust(indent), "bold"), line), soft_wrap=True)


def print_findings(findings: Sequence[Finding], *, all: bool = False) -> None:
    """What the knowledge base found odd, on stderr, one line each; errors first, and only so many unless all are."""
    many = len(findings) if all else _MAX_FINDINGS
    ordered = sorted(findings, key=lambda finding: finding.severity.value)  # "error" comes before "warning"
    for finding in ordered[:many]:
        warn(str(finding))
    if len(findings) > many:
        warn(f"… and {len(findings) - many} more; --json shows all")


def findings_json(findings: Iterable[Finding]) -> list[dict[str, object]]:
    """The findings as they stand in JSON."""
    import msgspec

    return [msgspec.to_builtins(finding) for finding in findings]


def _cell_text(cell: Cell) -> str:
    if cell is None:
        return "-"
    return f"{cell:.6g}" if isinstance(cell, float) else str(cell)
