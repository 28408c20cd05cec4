"""Writes docs/reference/limits.md: the limits, and what clients can reach with which; with --check only compares.

The entry points are those of a simulation that is served at all ports, so that none can be forgotten.
"""

from __future__ import annotations

import ast
import inspect
import sys
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path

import msgspec
import numpy as np
from generated import write_or_compare

from mindstage import KnowledgeBase, MujocoEngine, Simulation
from mindstage.access.limits import LIMITS, BridgeLimits, Limit, RpcLimits, VisitorLimits
from mindstage.access.policies import EntryKind, EntryPoint
from mindstage.bridge import LocalNode
from mindstage.episodes.recording import EpisodeFrame, FrameRecording
from mindstage.episodes.replay import EpisodeReplay
from mindstage.prolog import PrologConsole
from mindstage.robots import add_robot
from mindstage.ros import RosInterface
from mindstage.scene import Iri, World
from mindstage.viewer import Viewer

__all__ = ["main"]

PAGE = Path(__file__).resolve().parent.parent / "docs" / "reference" / "limits.md"

HEAD = """# Limits and entry points

<!-- Written by scripts/make_limits.py: change src/mindstage/access/limits.py and the declarations of handlers. -->

What clients of ports can reach, and how much of it. [Security](../explanation/security.md) describes who is let in, and
what a text from outside may name. The command line and Python calls of the process itself have no limits but those of
numbers.

## Limits

Beyond a limit, a request is refused with the limit, processed later (slowed), or a part of the result is left out and
the result says so (cut).
"""
ENTRY_POINTS = """## Entry points

Everything that a client can reach in a simulation with a robot, with its policy. A robot of another model has other
controllers, with the same policies. A trusted request is refused to clients of ports. The operations of the rosbridge
are also those of the port of the shell, which has no service but `mindstage/query`.
"""
RECORDS = {
    VisitorLimits: "Limits of one address",
    BridgeLimits: "Limits of the rosbridge",
    RpcLimits: "Limits of the page",
}


def main() -> int:
    """Writes or checks the page; returns 0 if it is up to date, otherwise 1."""
    return write_or_compare({PAGE: page()})


def page() -> str:
    """The text of the page."""
    entries = served_entry_points()
    parts = [HEAD, table(("limit", "value", "beyond it", "reason"), map(limit_row, LIMITS.values()))]
    for record, title in RECORDS.items():
        parts += [f"### {title}\n", table(("field", "default", "meaning"), record_rows(record))]
    parts += [ENTRY_POINTS, table(("policy", "cost", "largest request", "deadline"), policy_rows(entries))]
    for kind in EntryKind:
        here = (each for each in entries if each.kind is kind)
        rows = {(f"`{each.name}`", each.policy.name if each.policy else "none") for each in here}
        parts += [f"### {kind[0].upper()}{kind[1:]}\n", table(("name", "policy"), sorted(rows))]
    return "\n".join(parts)


def served_entry_points() -> list[EntryPoint]:
    """What can be reached in an empty world with a robot, and on the page of an episode."""
    empty = World(iri=Iri("http://mindstage.org/maps/empty.owl#empty"))
    with ExitStack() as stack:
        simulation = stack.enter_context(Simulation(KnowledgeBase(), MujocoEngine()))
        simulation.spawn(empty)
        add_robot(simulation, "mobile_manipulator", name="robot")
        node = stack.enter_context(LocalNode())
        stack.enter_context(RosInterface(simulation, node))
        viewer = stack.enter_context(Viewer(simulation, port=0))
        prolog = stack.enter_context(PrologConsole(simulation))
        recording = FrameRecording([EpisodeFrame(time_s=0.0, structure=empty, ids=(), poses=np.zeros((0, 7)))])
        replay = stack.enter_context(EpisodeReplay(recording, stack.enter_context(KnowledgeBase())))
        page = stack.enter_context(Viewer(replay, port=0))
        return [*viewer.entry_points(), *page.entry_points(), *node.entry_points(), *prolog.entry_points()]


def limit_row(limit: Limit) -> tuple[str, ...]:
    """The cells of a limit."""
    least = f"{number(limit.minimum)} to " if limit.minimum else ""
    return limit.name, f"{least}{number(limit.maximum)} {limit.unit}".strip(), limit.excess, limit.reason


def record_rows(record: type[msgspec.Struct]) -> Iterator[tuple[str, ...]]:
    """The cells of the fields of a record, with the docstring under each."""
    (definition,) = ast.parse(inspect.getsource(record)).body
    assert isinstance(definition, ast.ClassDef)
    texts = {
        field.target.id: text.value.value
        for field, text in zip(definition.body, definition.body[1:], strict=False)
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
        if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)
    }
    for field in msgspec.structs.fields(record):
        yield f"`{field.name}`", number(field.default), " ".join(str(texts[field.name]).split())


def policy_rows(entries: Iterable[EntryPoint]) -> list[tuple[str, ...]]:
    """The cells of the policies that are used."""
    used = {each.policy for each in entries if each.policy is not None}
    return sorted(
        (
            each.name,
            each.cost,
            f"{each.size.name}: {number(each.size.maximum)} B",
            "" if each.deadline is None else f"{each.deadline.name}: {number(each.deadline.maximum)} s",
        )
        for each in used
    )


def number(value: float) -> str:
    """A number with separators of thousands."""
    return f"{value:,.0f}" if float(value).is_integer() else f"{value:g}"


def table(titles: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    """A table in Markdown."""
    lines = [titles, tuple("---" for _ in titles), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


if __name__ == "__main__":
    sys.exit(main())
