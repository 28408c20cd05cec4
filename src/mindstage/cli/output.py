"""Output of the verbs: results on stdout, as tables or JSON; warnings and progress on stderr."""

from __future__ import annotations

import json
import os
import re
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from itertools import chain, repeat
from typing import TYPE_CHECKING, TextIO

from mindstage.errors import without_surrogates

if TYPE_CHECKING:
    from rich.console import Console
    from rich.status import Status

    from mindstage.engines import SpawnNote, SpawnReport
    from mindstage.knowledge import KnowledgeBase
    from mindstage.maps import Assumption
    from mindstage.rdf import Finding
    from mindstage.rdf.graphs import FindingGroup
    from mindstage.scene import Statement, World, WorldDiff
    from mindstage.simulation import Simulation

__all__ = [
    "Cell",
    "Shortcoming",
    "Timings",
    "assumptions_json",
    "class_lookup",
    "console",
    "diff_json",
    "difference_summary",
    "findings_json",
    "fits_table",
    "import_summary",
    "losses_json",
    "notes_json",
    "one_line",
    "print_diff",
    "print_failures",
    "print_findings",
    "print_import_summary",
    "print_json",
    "print_line",
    "print_losses",
    "print_notes",
    "print_reasons",
    "print_records",
    "print_report",
    "print_table",
    "progress_bar",
    "progress_spinner",
    "reasons_json",
    "report_json",
    "shortcomings",
    "show_mesh_progress",
    "step_with_progress",
    "warn",
]


class Timings:
    """Seconds by the name of the part, in the order they were measured."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def measure(self, name: str) -> Iterator[None]:
        """Adds the time spent inside to that part."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start


_DEFAULT_WIDTH = 160
"""Width of the output if it is not a terminal [characters]."""
_MAX_FINDINGS = 20
"""Limit of the printed findings; JSON contains all."""

_BEYOND_ASCII = re.compile(r"[^\x00-\x7f]+")

Cell = str | int | float | None


def one_line(text: str) -> str:
    """The text with unprintable characters replaced by spaces, since a file may contain terminal escape sequences."""
    return "".join(letter if letter.isprintable() else " " for letter in without_surrogates(text))


def console(*, stderr: bool = False) -> Console:
    """A rich console for stdout or stderr."""
    from rich.console import Console

    class PipeConsole(Console):
        def on_broken_pipe(self) -> None:
            raise BrokenPipeError  # rich would exit with 1, which means "no" here

    terminal = PipeConsole(stderr=stderr, highlight=False, markup=False, emoji=False)
    if not terminal.is_terminal:
        terminal.width = _DEFAULT_WIDTH
    return terminal


def print_line(text: str) -> None:
    """Prints a line on stdout, and flushes it."""
    sys.stdout.write(one_line(text) + "\n")
    sys.stdout.flush()


def warn(text: str) -> None:
    """Prints a yellow line on stderr."""
    console(stderr=True).print(f"mindstage: {one_line(text)}", style="yellow", soft_wrap=True)


@contextmanager
def progress_spinner(text: str) -> Iterator[None]:
    """Shows a spinner during the `with` block, if stderr is a terminal."""
    if not sys.stderr.isatty():
        yield
        return
    with console(stderr=True).status(f"{text} …") as status:
        _spinners.append((status, text))
        try:
            yield
        finally:
            _spinners.pop()


_spinners: list[tuple[Status, str]] = []
"""The spinners that are shown, with their texts."""


def show_mesh_progress(done: int, total: int) -> None:
    """Shows beside the spinner how many mesh files are imported, of those that have to be."""
    if _spinners:
        status, text = _spinners[-1]
        status.update(f"{text} … {done:,} of {total:,} mesh files")


def print_json(value: object) -> None:
    """Prints a JSON document on stdout; infinity and NaN become null.

    Where the output is not in UTF-8, others than ASCII are escaped. What is not UTF-8 in names of files is U+FFFD.
    """
    import msgspec

    from mindstage.unicode_json import encode_json

    text = msgspec.json.format(encode_json(value), indent=2).decode()
    if not _is_unicode(sys.stdout):
        text = _BEYOND_ASCII.sub(lambda found: json.dumps(found[0])[1:-1], text)
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def _is_unicode(stream: TextIO) -> bool:
    return (getattr(stream, "encoding", None) or "").lower().startswith("utf")


def print_table(title: str, columns: Sequence[str], rows: Iterable[Sequence[Cell]]) -> None:
    """Prints a table on stdout; columns without text are right-aligned."""
    cells = list(rows)
    lines = [[one_line(_cell_text(cell)) for cell in row] for row in cells]
    has_text = [any(isinstance(row[at], str) for row in cells) for at in range(len(columns))]
    if not title and lines and _is_plain(chain(columns, *lines)) and _table_width(columns, lines) <= _DEFAULT_WIDTH:
        sys.stdout.write(_plain_table(columns, lines, has_text))
        sys.stdout.flush()
        return
    from rich.table import Table
    from rich.text import Text

    table = Table()
    for column, is_text in zip(columns, has_text, strict=True):
        table.add_column(column, justify="left" if is_text else "right", overflow="fold")
    for line in lines:
        table.add_row(*map(Text, line))
    terminal = console()
    if title:
        terminal.print(Text(one_line(title), style="bold"), soft_wrap=True)  # the title may be wider than the table
    terminal.print(table)


def _is_plain(texts: Iterable[str]) -> bool:
    """Whether rich would write a table of these texts without styles and with one column per character.

    Most commands of scripts print such a table, and importing rich would take a tenth of their time.
    """
    stdout, environment = sys.stdout, os.environ.keys()
    is_file = not stdout.isatty() and not environment & {"FORCE_COLOR", "TTY_COMPATIBLE"}
    return is_file and _is_unicode(stdout) and all(text.isascii() and text for text in texts)


def _plain_table(columns: Sequence[str], lines: Sequence[Sequence[str]], has_text: Sequence[bool]) -> str:
    """The same text as that of a rich table."""
    widths = [max(len(row[at]) for row in (columns, *lines)) for at in range(len(columns))]

    def padded(row: Sequence[str], edge: str) -> str:
        cells = (
            text.ljust(width) if is_text else text.rjust(width)
            for text, width, is_text in zip(row, widths, has_text, strict=True)
        )
        return f"{edge} {f' {edge} '.join(cells)} {edge}\n"

    def rule(left: str, line: str, middle: str, right: str) -> str:
        return f"{left}{middle.join(line * (width + 2) for width in widths)}{right}\n"

    head = (rule("┏", "━", "┳", "┓"), padded(columns, "┃"), rule("┡", "━", "╇", "┩"))
    return "".join([*head, *(padded(line, "│") for line in lines), rule("└", "─", "┴", "┘")])


def fits_table(columns: Sequence[str], rows: Iterable[Sequence[Cell]]) -> bool:
    """Whether the table fits in the console without wrapping cells."""
    width = _table_width(columns, [[_cell_text(cell) for cell in row] for row in rows])
    return width <= (_DEFAULT_WIDTH if _is_plain(()) else console().width)


def _table_width(columns: Sequence[str], lines: Iterable[Sequence[str]]) -> int:
    widths = [len(column) for column in columns]
    for line in lines:
        widths = [max(width, len(text)) for width, text in zip(widths, line, strict=True)]
    return sum(widths) + 3 * len(widths) + 1


def print_records(columns: Sequence[str], rows: Iterable[Sequence[Cell | Sequence[str]]]) -> None:
    """Prints rows as records, with a line for each field; empty fields are omitted."""
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


_MIN_GROUP = 3
"""Like findings are printed as one line from this number on."""
_MAX_CLASSES = 4
"""Limit of the classes that the line of a group names."""


def print_findings(
    findings: Sequence[Finding], *, all: bool = False, classes: Callable[[str], str | None] | None = None
) -> None:
    """Prints findings on stderr, errors first; like findings are one line, up to a limit of lines.

    Args:
        all: whether to print each finding, without a limit.
        classes: returns the name of an individual's class, or None.
    """
    from mindstage.rdf.graphs import group_findings

    lines: list[tuple[str, int]] = []
    for group in group_findings(findings):
        if all or len(group.findings) < _MIN_GROUP:
            lines += ((str(finding), 1) for finding in group.findings)
        else:
            lines.append((_group_text(group, classes), len(group.findings)))
    shown = lines if all else lines[:_MAX_FINDINGS]
    for text, _ in shown:
        warn(text)
    if left := sum(count for _, count in lines[len(shown) :]):
        warn(f"… and {left} more; --json shows all")
    if not all and any(count > 1 for _, count in shown):
        warn("mindstage validate --verbose lists each finding")


def _group_text(group: FindingGroup, classes: Callable[[str], str | None] | None) -> str:
    """One line for like findings: their number, the classes of the individuals, and the first of them."""
    first = group.findings[0]
    about = f"{_local_name(first.property)}: " if first.property else ""
    individuals = dict.fromkeys(finding.individual for finding in group.findings)
    named = Counter(name for each in individuals if (name := classes and classes(each)))
    listed = [f"{count} {name}" for name, count in named.most_common(_MAX_CLASSES)]
    if (others := len(individuals) - sum(count for _, count in named.most_common(_MAX_CLASSES))) and named:
        listed.append(f"{others} other{'s' if others > 1 else ''}")
    of = f" ({', '.join(listed)})" if listed else ""
    what = f"{len(group.findings)} like this{of}, the first about {_local_name(first.individual)}"
    return f"{first.severity.value}: {about}{what}: {first.problem}; {first.action}"


def class_lookup(knowledge: KnowledgeBase) -> Callable[[str], str | None]:
    """Returns a function from the IRI of an individual to the local name of its class, or None."""

    def find(individual: str) -> str | None:
        return next((_local_name(cls) for cls in knowledge.stated_classes(individual)), None)

    return find


def findings_json(findings: Iterable[Finding]) -> list[dict[str, object]]:
    """The findings as JSON objects; like findings have the same `group`."""
    from mindstage.rdf.graphs import findings_to_builtins

    return findings_to_builtins(findings)


def _cell_text(cell: Cell) -> str:
    if cell is None:
        return "-"
    return f"{cell:.6g}" if isinstance(cell, float) else str(cell)


_MIN_PROGRESS_S = 1.0
"""A progress bar is shown after this time [s]."""


def step_with_progress(simulation: Simulation, duration_s: float) -> float:
    """Steps a simulation with a progress bar, and returns the wall time [s]."""
    if duration_s == 0:  # importing rich would take a tenth of the time of a picture
        return 0.0
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("simulating"), BarColumn(), TextColumn("{task.completed:.1f} of {task.total:.1f} s"))
    start = time.perf_counter()
    with Progress(*columns, TimeRemainingColumn(), console=console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=duration_s, visible=False)

        # Also before the first time step, for which the world may have to be compiled.
        show = threading.Timer(_MIN_PROGRESS_S, bar.update, (task,), {"visible": bar.console.is_terminal})
        show.start()
        try:
            simulation.step(duration_s, progress=lambda done_s: bar.update(task, completed=done_s))
        finally:
            show.cancel()
    return time.perf_counter() - start


@contextmanager
def progress_bar(text: str) -> Iterator[Callable[[float], None]]:
    """Shows a progress bar during the `with` block, if stderr is a terminal.

    Yields:
        A function that takes the part that is done, from 0 to 1.
    """
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    columns = (TextColumn(text), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=1.0, visible=bar.console.is_terminal)
        yield lambda part: bar.update(task, completed=part)


def assumptions_json(knowledge: KnowledgeBase, about: World | None = None) -> list[dict[str, object]]:
    """The assumptions about one map, or about all maps, as JSON objects."""
    import msgspec

    return [msgspec.to_builtins(each) for each in knowledge.assumptions() if about is None or each.map == about.iri]


def import_summary(world: World, knowledge: KnowledgeBase) -> dict[str, object]:
    """The assumptions about a map, and the extent of its world, as JSON objects."""
    import msgspec

    from mindstage.scene.bounding_boxes import world_bounds

    extent = world_bounds(world)
    bounds = None if extent is None else {"size": extent.size} | msgspec.to_builtins(extent)
    return {"assumptions": assumptions_json(knowledge, world), "extent": bounds}


def print_import_summary(world: World, knowledge: KnowledgeBase, *, verbose: bool = False) -> None:
    """Prints the extent of a world, and the assumptions that differ from the defaults, or all with `verbose`."""
    from mindstage.scene.bounding_boxes import world_bounds

    extent = world_bounds(world)
    if extent is not None:
        size = " x ".join(f"{length:.3g}" for length in extent.size)
        name = extent.tallest_class.replace("/", "#").rpartition("#")[2]
        print_line(f"Extent: {size} m; the tallest is {name} {extent.tallest!r}, {extent.height_m:.3g} m high.")
    assumptions = [each for each in knowledge.assumptions() if each.map == world.iri]
    _print_assumptions(each for each in assumptions if verbose or not _is_default(each))


def _is_default(assumption: Assumption) -> bool:
    """Whether an assumption is the convention of Mindstage itself, and was not given by an option."""
    from mindstage.maps.dialects.conventions import SI

    default = getattr(SI, assumption.topic, None)
    return default is not None and default.value == assumption.value and not assumption.overridden


def _print_assumptions(assumptions: Iterable[Assumption]) -> None:
    rows = [
        (assumption.topic, assumption.value, "given" if assumption.overridden else "assumed", assumption.evidence)
        for assumption in assumptions
    ]
    if rows:
        print_table("Conventions of the map", ("topic", "value", "source", "evidence"), rows)


@dataclass(frozen=True, slots=True)
class Shortcoming:
    """A reason for which a verb exits with 1, as in the field `reasons` of JSON."""

    kind: str
    """findings, not_spawned, moved, different, lost or unplaced."""
    count: int
    text: str


def shortcomings(report: SpawnReport, findings: Iterable[Finding]) -> list[Shortcoming]:
    """Why a world is incomplete: what was not read, was not spawned, or did not stay; empty if it is complete."""
    from mindstage.rdf import Severity

    found: list[Shortcoming] = []
    errors = [finding for finding in findings if finding.severity is Severity.ERROR]
    if errors:
        first = f"{_local_name(errors[0].individual)}: {errors[0].problem}; {errors[0].action}"
        found.append(Shortcoming("findings", len(errors), f"{_counted(errors, 'finding')} of severity error ({first})"))
    failed = [*report.failed_bodies, *report.failed_joints, *report.failed_attachments]
    if failed:
        text = f"{_counted(failed, 'entity', 'entities')} not spawned ({failed[0].id}: {failed[0].reason})"
        found.append(Shortcoming("not_spawned", len(failed), text))
    if report.moved:
        farthest = f"{report.moved[0].id} by {report.moved[0].distance_m:.3g} m"
        text = f"{_counted(report.moved, 'body', 'bodies')} moved within {report.rest_checked_s:g} s ({farthest})"
        found.append(Shortcoming("moved", len(report.moved), text))
    return found


def reasons_json(reasons: Iterable[Shortcoming]) -> list[dict[str, object]]:
    """The reasons of a verb's exit code as JSON objects."""
    return [asdict(reason) for reason in reasons]


def print_reasons(reasons: Sequence[Shortcoming], *, start: str = "Incomplete") -> None:
    """Prints the reasons of a verb's exit code as its last line, if there are any."""
    if reasons:
        print_line(f"{start}: {'; '.join(reason.text for reason in reasons)}.")


def _counted(items: Sequence[object], noun: str, plural: str = "") -> str:
    return f"{len(items):,} {noun if len(items) == 1 else plural or f'{noun}s'}"


def report_json(report: SpawnReport) -> dict[str, object]:
    """The report as a JSON object; `warnings` are the assumptions of the engine."""
    import msgspec

    return {
        "ok": report.ok,
        "bodies": report.bodies,
        "joints": report.joints,
        "attachments": report.attachments,
        "failed_bodies": msgspec.to_builtins(report.failed_bodies),
        "failed_joints": msgspec.to_builtins(report.failed_joints),
        "failed_attachments": msgspec.to_builtins(report.failed_attachments),
        "warnings": msgspec.to_builtins(report.notes),
        "moved": msgspec.to_builtins(report.moved),
        "rest_checked_s": report.rest_checked_s,
    }


def print_report(report: SpawnReport, *, title: str, verbose: bool) -> None:
    """Prints a report as tables, and its failures on stderr."""
    kinds = (
        ("bodies", report.bodies, report.failed_bodies),
        ("joints", report.joints, report.failed_joints),
        ("attachments", report.attachments, report.failed_attachments),
    )
    print_table(title, ("", "spawned", "failed"), [(kind, done, len(failed)) for kind, done, failed in kinds])
    print_failures(report)
    print_moved(report)
    if report.notes and verbose:
        rows = [(note.kind.value, ", ".join(note.ids), note.text) for note in report.notes]
        print_table("Assumptions of the engine", ("topic", "about", "assumption"), rows)
    elif report.notes:
        counts = Counter(note.kind.value for note in report.notes)
        print_table("Assumptions of the engine (--verbose lists each)", ("topic", "count"), counts.most_common())


def print_failures(report: SpawnReport) -> None:
    """Prints what could not be spawned, a line for each."""
    kinds = ("body", report.failed_bodies), ("joint", report.failed_joints)
    for kind, failures in (*kinds, ("attachment", report.failed_attachments)):
        for failure in failures:
            warn(f"{kind} not spawned: {failure.id}: {failure.reason}")


_MAX_MOVED = 20
"""Limit of the printed bodies that moved; JSON contains all."""


def print_moved(report: SpawnReport) -> None:
    """Prints the bodies that did not stay where they were spawned, a line for each."""
    for moved in report.moved[:_MAX_MOVED]:
        left = " and left the place" if moved.left_place else ""
        warn(f"not at rest: {moved.id} moved by {moved.distance_m:.3g} m in {report.rest_checked_s:g} s{left}")
    if len(report.moved) > _MAX_MOVED:
        warn(f"not at rest: {len(report.moved) - _MAX_MOVED:,} more, see --json")


def notes_json(notes: Sequence[SpawnNote]) -> list[dict[str, object]]:
    """Notes of an engine as JSON objects."""
    import msgspec

    return [msgspec.to_builtins(note) for note in notes]


def print_notes(notes: Sequence[SpawnNote]) -> None:
    """Prints what an engine decided or noticed while it simulated, a line for each, on stderr."""
    for note in notes:
        warn(f"{note.kind.value}: {note.text}")


_MAX_CHANGES = 20
"""Limit of the printed changes; JSON contains all."""
_MAX_VALUE_LENGTH = 120
"""Longer values are truncated."""


def diff_json(diff: WorldDiff, delta: float) -> dict[str, object]:
    """The difference of two worlds as a JSON object."""
    from mindstage.scene import MECHANICAL_KINDS

    return diff.to_builtins(delta) | {"identical_mechanics": diff.identical(delta, kinds=MECHANICAL_KINDS)}


def losses_json(diff: WorldDiff, lost: Sequence[Statement]) -> dict[str, object]:
    """The lost facts of a world and the lost statements of its map, each once, as a JSON object."""
    lines = [{"id": _local_name(each.id), "note": str(each)} for each in lost]
    known = {(line["id"], line["note"]) for line in lines}
    lines += [
        {"id": each.id, "note": str(each)} for each in diff.lost if (_local_name(each.id), str(each)) not in known
    ]
    return {"lost_facts": len(lines), "lost": lines}


def print_losses(lost: Sequence[Statement]) -> None:
    """Prints the lost statements of a map as a table."""
    rows = [(_local_name(each.id), _value_text(_short_statement(str(each)))) for each in lost]
    _print_truncated_table("Lost statements of the map", ("subject", "statement"), rows)


def print_diff(diff: WorldDiff, delta: float, *, about: World, summary: bool = True) -> None:
    """Prints the difference of two worlds as tables, and a summary.

    Args:
        diff: the difference.
        delta: permitted difference of numbers.
        about: one of the two worlds, for the classes of the bodies.
        summary: whether the summary is printed.
    """
    classes: dict[str, str] = {body.id: re.split("[#/]", body.cls)[-1] for body in about.bodies}
    for title, ids in (("Only in A", diff.only_in_a), ("Only in B", diff.only_in_b)):
        _print_truncated_table(title, ("id", "class"), [(only, classes.get(only)) for only in ids])
    numbers, largest = Counter(change.kind.value for change in diff.changed), diff.max_error
    rows = [(kind, number, largest.get(kind)) for kind, number in numbers.most_common()]
    _print_truncated_table("Differences", ("kind", "changes", "largest error"), rows)
    shown = [change for change in diff.exceeding(delta) if change.kind.value not in {"facts", "tags"}]
    shown.sort(key=lambda change: (change.error is None, -(change.error or 0.0), change.id))
    _print_truncated_table(
        f"Beyond delta {delta:g}",
        ("id", "class", "field", "A", "B", "error"),
        [
            (
                change.id,
                classes.get(change.id),
                change.field,
                _value_text(change.a),
                _value_text(change.b),
                change.error,
            )
            for change in shown
        ],
    )
    for title, lines in (("Facts and tags only in A", diff.lost), ("Facts and tags only in B", diff.gained)):
        _print_truncated_table(
            title,
            ("id", "statement"),
            [(_local_name(line.id), _value_text(_short_statement(str(line)))) for line in lines],
        )
    if summary:
        print_line(difference_summary(diff, delta))


def _print_truncated_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[Cell]]) -> None:
    """Prints the first rows of a table, unless it is empty."""
    if rows:
        more = f" (the first {_MAX_CHANGES} of {len(rows)}; --json shows all)" if len(rows) > _MAX_CHANGES else ""
        print_table(f"{title}{more}", columns, rows[:_MAX_CHANGES])


def _local_name(iri: str) -> str:
    return re.split("[#/]", iri.rstrip("#/"))[-1] if "://" in iri else iri


def _short_statement(statement: str) -> str:
    """A statement with IRIs shortened to their local names."""
    shortened = re.sub(
        r"<([^<>]*)>", lambda iri: iri[1] if iri[1].startswith("package:") else _local_name(iri[1]), statement
    )
    return re.sub(r"\^\^\w+|\btype Restriction[;,. ]*", "", shortened)


def _value_text(value: object) -> str:
    text = ", ".join(map(str, value)) if isinstance(value, tuple) else str(value)
    return text if len(text) <= _MAX_VALUE_LENGTH else f"{text[:_MAX_VALUE_LENGTH]}…"


def difference_summary(diff: WorldDiff, delta: float) -> str:
    """One sentence about the difference of two worlds."""
    from mindstage.scene import MECHANICAL_KINDS

    if diff.identical(delta):
        return f"Identical at delta {delta:g}."
    verb = "are" if diff.identical(delta, kinds=MECHANICAL_KINDS) else "are not"
    return f"Different at delta {delta:g}; poses, masses and limits {verb} identical."
