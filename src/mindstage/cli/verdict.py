"""Verdict: the difference of two worlds, for people and for programs."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING

from mindstage.cli.output import Cell, print_table, say

if TYPE_CHECKING:
    from mindstage.world import Difference, Statement, World

__all__ = ["difference_json", "losses_json", "print_difference", "print_losses"]

_MANY = 20
"""More changes than this are cut short in a table; JSON has them all."""
_LONG = 120
"""A value of more characters than this is cut short, too."""


def difference_json(found: Difference, delta: float) -> dict[str, object]:
    """The difference as it stands in JSON."""
    from mindstage.world import MECHANICS

    return found.to_builtins(delta) | {"identical_mechanics": found.identical(delta, kinds=MECHANICS)}


def losses_json(found: Difference, lost: Sequence[Statement]) -> dict[str, object]:
    """What is lost, of the world and of the statements of its map, each once."""
    lines = [{"id": _local(each.id), "said": str(each)} for each in lost]
    known = {(line["id"], line["said"]) for line in lines}
    lines += [{"id": each.id, "said": str(each)} for each in found.lost if (_local(each.id), str(each)) not in known]
    return {"lost_facts": len(lines), "lost": lines}


def print_losses(lost: Sequence[Statement]) -> None:
    """The statements of a map that did not come back, as a table."""
    rows = [(_local(each.id), _shown(_brief(str(each)))) for each in lost]
    _cut("Statements of the map that its file does not make", ("about", "what is said"), rows)
    if lost:
        say(f"{len(lost)} statements of the map are lost.")


def print_difference(found: Difference, delta: float, *, about: World) -> None:
    """The difference as tables, and a verdict in a sentence.

    Args:
        found: what differs.
        delta: how much of it is forgiven.
        about: one of the two, whose classes tell people what an id is.
    """
    classes: dict[str, str] = {body.id: re.split("[#/]", body.cls)[-1] for body in about.bodies}
    for title, ids in (("Only in A", found.only_in_a), ("Only in B", found.only_in_b)):
        _cut(title, ("id", "class"), [(only, classes.get(only)) for only in ids])
    numbers, largest = Counter(change.kind.value for change in found.changed), found.max_error
    rows = [(kind, number, largest.get(kind)) for kind, number in numbers.most_common()]
    _cut("What differs", ("kind", "changes", "largest error"), rows)
    told = [change for change in found.beyond(delta) if change.kind.value not in {"facts", "tags"}]
    told.sort(key=lambda change: (change.error is None, -(change.error or 0.0), change.id))
    _cut(
        f"Beyond delta {delta:g}",
        ("id", "class", "what", "A", "B", "error"),
        [
            (change.id, classes.get(change.id), change.field, _shown(change.a), _shown(change.b), change.error)
            for change in told
        ],
    )
    for title, lines in (("Facts and tags only in A", found.lost), ("Facts and tags only in B", found.gained)):
        _cut(title, ("id", "what is said"), [(_local(line.id), _shown(_brief(str(line)))) for line in lines])
    say(_verdict(found, delta))


def _cut(title: str, columns: Sequence[str], rows: Sequence[Sequence[Cell]]) -> None:
    """A table, unless it would be empty, that does not go on for ever."""
    if rows:
        more = f" (the first {_MANY} of {len(rows)}; --json has all)" if len(rows) > _MANY else ""
        print_table(f"{title}{more}", columns, rows[:_MANY])


def _local(iri: str) -> str:
    return re.split("[#/]", iri.rstrip("#/"))[-1] if "://" in iri else iri


def _brief(statement: str) -> str:
    """A statement with the names of things cut down to their last part, as people say them."""
    named = re.sub(r"<([^<>]*)>", lambda iri: iri[1] if iri[1].startswith("package:") else _local(iri[1]), statement)
    return re.sub(r"\^\^\w+|\btype Restriction[;,. ]*", "", named)


def _shown(value: object) -> str:
    text = ", ".join(map(str, value)) if isinstance(value, tuple) else str(value)
    return text if len(text) <= _LONG else f"{text[:_LONG]}…"


def _verdict(found: Difference, delta: float) -> str:
    from mindstage.world import MECHANICS

    if found.identical(delta):
        return f"Identical at delta {delta:g}."
    alike = "are" if found.identical(delta, kinds=MECHANICS) else "are not"
    return f"Different at delta {delta:g}; poses, masses and limits {alike} identical."
