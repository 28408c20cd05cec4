"""Formatting of values for consoles and notebooks: counts, short names and escaped HTML tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

__all__ = ["counted", "html_table", "short_name"]

_MOST_ROWS = 100
"""Number of rows after which a table in a notebook is truncated."""
_IRREGULAR = {"body": "bodies", "loose body": "loose bodies"}


def counted(number: int, noun: str) -> str:
    """Returns a number with its noun: "1 body", "1,200 bodies"."""
    return f"{number:,} {noun if number == 1 else _IRREGULAR.get(noun, f'{noun}s')}"


def short_name(iri: str) -> str:
    """Returns the last segment of an IRI; other text is returned unchanged."""
    return iri.rstrip("#/").replace("#", "/").rpartition("/")[2] if "://" in iri else iri


def html_table(
    title: str, columns: Sequence[str], rows: Sequence[Sequence[object]], *, notes: Iterable[str] = ()
) -> str:
    """Returns an HTML table with its title as the caption; all text is escaped, and long tables are truncated.

    Args:
        title: the caption.
        columns: the column names.
        rows: one cell per column; None is an empty cell.
        notes: further lines below the table.
    """
    from html import escape  # a table of two thousand entities, which only notebooks need

    head = "".join(f"<th>{escape(column)}</th>" for column in columns)
    body = "".join(f"<tr>{''.join(f'<td>{_cell(cell)}</td>' for cell in row)}</tr>" for row in rows[:_MOST_ROWS])
    left = len(rows) - _MOST_ROWS
    below = [*([f"… and {left:,} more rows"] if left > 0 else []), *notes]
    lines = "".join(f"<p>{escape(line)}</p>" for line in below)
    caption = f"<caption>{escape(title)}</caption>"
    return f"<table>{caption}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{lines}"


def _cell(value: object) -> str:
    from html import escape  # see above

    return "" if value is None else escape(f"{value:.6g}" if isinstance(value, float) else str(value))
