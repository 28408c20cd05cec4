"""Verdict: the difference of two worlds, for people and for programs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mindstage.cli.output import print_table, say

if TYPE_CHECKING:
    from mindstage.world import Difference

__all__ = ["difference_json", "print_difference"]

_MANY = 40
"""More changes than this are cut short in a table; JSON has them all."""


def difference_json(found: Difference, delta: float) -> dict[str, object]:
    """The difference as it stands in JSON."""
    from mindstage.world import MECHANICS

    return found.to_builtins(delta) | {"identical_mechanics": found.identical(delta, kinds=MECHANICS)}


def print_difference(found: Difference, delta: float) -> None:
    """The difference as tables, and a verdict in a sentence."""
    if errors := [(kind, error) for kind, error in found.max_error.items() if error]:
        print_table("Largest differences", ("kind", "error"), errors)
    for title, ids in (("Only in A", found.only_in_a), ("Only in B", found.only_in_b)):
        if ids:
            print_table(title, ("id",), [(only,) for only in ids])
    if changes := found.beyond(delta):
        more = f" (the first {_MANY} of {len(changes)}; --json has all)" if len(changes) > _MANY else ""
        rows = [(change.id, change.field, str(change.a), str(change.b), change.error) for change in changes[:_MANY]]
        print_table(f"Changed{more}", ("id", "what", "A", "B", "error"), rows)
    if found.lost_facts or found.gained_facts:
        say(f"Facts and tags: {found.lost_facts} only in A, {found.gained_facts} only in B.")
    say(_verdict(found, delta))


def _verdict(found: Difference, delta: float) -> str:
    from mindstage.world import MECHANICS

    if found.identical(delta):
        return f"Identical at delta {delta:g}."
    alike = "are" if found.identical(delta, kinds=MECHANICS) else "are not"
    return f"Different at delta {delta:g}; poses, masses and limits {alike} identical."
