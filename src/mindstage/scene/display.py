"""How values show in consoles and notebooks: short words for `repr`, escaped HTML tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

__all__ = ["counted", "html_table", "short_name"]

_MOST_ROWS = 100
"""A table in a notebook is cut after as many rows."""
_IRREGULAR = {"body": "bodies"}


def counted(number: int, noun: str) -> str:
    """A number with its noun: "1 body", "1,200 bodies"."""
    return f"{number:,} {noun if number == 1 else _IRREGULAR.get(noun, f'{noun}s')}"


def short_name(iri: str) -> str:
    """The last part of an IRI; anything else as it is."""
    return iri.rstrip("#/").replace("#", "/").rpartition("/")[2] if "://" in iri else iri


def html_table(
    title: str, columns: Sequence[str], rows: Sequence[Sequence[object]], *, notes: Iterable[str] = ()
) -> str:
    """A table with its title as the caption; every text is escaped, and long tables are cut.

    Args:
        title: the caption.
        columns: their names.
        rows: one cell for each column; None is an empty cell.
        notes: further lines below the table.
    """
    head = "".join(f"<th>{escape(column)}</th>" for column in columns)
    body = "".join(f"<tr>{''.join(f'<td>{_cell(cell)}</td>' for cell in row)}</tr>" for row in rows[:_MOST_ROWS])
    left = len(rows) - _MOST_ROWS
    below = [*([f"… and {left:,} more rows"] if left > 0 else []), *notes]
    lines = "".join(f"<p>{escape(line)}</p>" for line in below)
    caption = f"<caption>{escape(title)}</caption>"
    return f"<table>{caption}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{lines}"


def _cell(value: object) -> str:
    return "" if value is None else escape(f"{value:.6g}" if isinstance(value, float) else str(value))
