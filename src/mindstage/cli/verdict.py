"""Verdict: the difference of two worlds, for people and for programs."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING

from mindstage.cli.output import Cell, print_line, print_table

if TYPE_CHECKING:
    from mindstage.world import Statement, World, WorldDiff

__all__ = ["diff_json", "losses_json", "print_diff", "print_losses"]

_MAX_CHANGES = 20
"""More changes than this are cut short in a table; JSON has them all."""
_MAX_VALUE_LENGTH = 120
"""A value of more characters than this is cut short, too."""


def diff_json(diff: WorldDiff, delta: float) -> dict[str, object]:
    """The difference as it stands in JSON."""
    from mindstage.world import MECHANICAL_KINDS

    return diff.to_builtins(delta) | {"identical_mechanics": diff.identical(delta, kinds=MECHANICAL_KINDS)}


def losses_json(diff: WorldDiff, lost: Sequence[Statement]) -> dict[str, object]:
    """What is lost, of the world and of the statements of its map, each once."""
    lines = [{"id": _local_name(each.id), "said": str(each)} for each in lost]
    known = {(line["id"], line["said"]) for line in lines}
    lines += [
        {"id": each.id, "said": str(each)} for each in diff.lost if (_local_name(each.id), str(each)) not in known
    ]
    return {"lost_facts": len(lines), "lost": lines}


def print_losses(lost: Sequence[Statement]) -> None:
    """The statements of a map that did not come back, as a table."""
    rows = [(_local_name(each.id), _value_text(_short_statement(str(each)))) for each in lost]
    _print_truncated_table("Statements of the map that its file does not make", ("about", "what is said"), rows)
    if lost:
        print_line(f"{len(lost)} statements of the map are lost.")


def print_diff(diff: WorldDiff, delta: float, *, about: World) -> None:
    """The difference as tables, and a verdict in a sentence.

    Args:
        found: what differs.
        delta: how much of it is forgiven.
        about: one of the two, whose classes tell people what an id is.
    """
    classes: dict[str, str] = {body.id: re.split("[#/]", body.cls)[-1] for body in about.bodies}
    for title, ids in (("Only in A", diff.only_in_a), ("Only in B", diff.only_in_b)):
        _print_truncated_table(title, ("id", "class"), [(only, classes.get(only)) for only in ids])
    numbers, largest = Counter(change.kind.value for change in diff.changed), diff.max_error
    rows = [(kind, number, largest.get(kind)) for kind, number in numbers.most_common()]
    _print_truncated_table("What differs", ("kind", "changes", "largest error"), rows)
    told = [change for change in diff.exceeding(delta) if change.kind.value not in {"facts", "tags"}]
    told.sort(key=lambda change: (change.error is None, -(change.error or 0.0), change.id))
    _print_truncated_table(
        f"Beyond delta {delta:g}",
        ("id", "class", "what", "A", "B", "error"),
        [
            (
                change.id,
                classes.get(change.id),
                change.field,
                _value_text(change.a),
                _value_text(change.b),
                change.error,
            )
            for change in told
        ],
    )
    for title, lines in (("Facts and tags only in A", diff.lost), ("Facts and tags only in B", diff.gained)):
        _print_truncated_table(
            title,
            ("id", "what is said"),
            [(_local_name(line.id), _value_text(_short_statement(str(line)))) for line in lines],
        )
    print_line(_summary(diff, delta))


def _print_truncated_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[Cell]]) -> None:
    """A table, unless it would be empty, that does not go on for ever."""
    if rows:
        more = f" (the first {_MAX_CHANGES} of {len(rows)}; --json has all)" if len(rows) > _MAX_CHANGES else ""
        print_table(f"{title}{more}", columns, rows[:_MAX_CHANGES])


def _local_name(iri: str) -> str:
    return re.split("[#/]", iri.rstrip("#/"))[-1] if "://" in iri else iri


def _short_statement(statement: str) -> str:
    """A statement with the names of things cut down to their last part, as people say them."""
    named = re.sub(
        r"<([^<>]*)>", lambda iri: iri[1] if iri[1].startswith("package:") else _local_name(iri[1]), statement
    )
    return re.sub(r"\^\^\w+|\btype Restriction[;,. ]*", "", named)


def _value_text(value: object) -> str:
    text = ", ".join(map(str, value)) if isinstance(value, tuple) else str(value)
    return text if len(text) <= _MAX_VALUE_LENGTH else f"{text[:_MAX_VALUE_LENGTH]}…"


def _summary(diff: WorldDiff, delta: float) -> str:
    from mindstage.world import MECHANICAL_KINDS

    if diff.identical(delta):
        return f"Identical at delta {delta:g}."
    alike = "are" if diff.identical(delta, kinds=MECHANICAL_KINDS) else "are not"
    return f"Different at delta {delta:g}; poses, masses and limits {alike} identical."
