"""`python -m benchmarks [MODULE…]` runs the benchmarks and prints each measure with its aim."""

from __future__ import annotations

import os
import pkgutil
import platform
import sys
import time
from importlib import import_module
from typing import Literal

from rich.console import Console
from rich.table import Table

import benchmarks
from benchmarks import Measure

_COLUMNS: tuple[tuple[str, Literal["left", "right"], int], ...] = (
    ("what", "left", 50),
    ("ours", "right", 11),
    ("peer", "left", 24),
    ("theirs", "right", 11),
    ("figure", "right", 12),
    ("aim", "left", 12),
    ("", "left", 6),
    ("MB", "right", 6),
    ("theirs", "right", 6),
)
"""Titles, alignments and widths; fixed, since each row is printed before the next one is measured."""


def main(names: list[str]) -> None:
    known = [module.name for module in pkgutil.iter_modules(benchmarks.__path__) if module.name != "__main__"]
    if unknown := set(names) - set(known):
        sys.exit(f"no benchmark {', '.join(sorted(unknown))}; there is {', '.join(known)}")
    os.environ.setdefault("MUJOCO_GL", "egl")  # MuJoCo reads it when it is imported, by whichever comes first
    console = Console()
    if not console.is_terminal:
        console.width = 160
    start = time.perf_counter()
    console.print(f"Python {platform.python_version()} on {platform.machine()}, {platform.system()}", highlight=False)
    rows = missed = 0
    for name in names or known:
        module = import_module(f"benchmarks.{name}")
        if not hasattr(module, "measure"):
            continue  # a module shared by benchmarks
        module_start = time.perf_counter()
        _print_row(console, [title for title, _, _ in _COLUMNS], title=name)
        for measure in module.measure():
            _print_row(console, _row(measure))
            rows += 1
            missed += measure.met is False
        console.print(f"{name}: {time.perf_counter() - module_start:.0f} s\n", highlight=False)
    minutes, seconds = divmod(round(time.perf_counter() - start), 60)
    console.print("All aims are met." if not missed else f"{missed} aims are missed.")
    console.print(f"{rows} rows in {minutes} min {seconds:02} s", highlight=False)


def _print_row(console: Console, cells: list[str], *, title: str = "") -> None:
    """Prints a row and flushes the output."""
    table = Table(show_header=False, box=None, padding=(0, 1), title=title or None, title_justify="left")
    for _, justify, width in _COLUMNS:
        table.add_column(justify=justify, width=width)
    table.add_row(*cells, style="bold" if title else None)
    console.print(table)
    sys.stdout.flush()


def _row(measure: Measure) -> list[str]:
    unit = measure.unit if measure.theirs is None else "times"
    aim = ""
    if measure.at_most is not None:
        aim = f"≤ {measure.at_most:g} {unit}"
    elif measure.at_least is not None:
        aim = f"≥ {measure.at_least:g} {unit}"
    return [
        measure.what,
        _format(measure.ours, measure.unit),
        measure.peer,
        _format(measure.theirs, measure.unit),
        "" if measure.theirs is None else f"{measure.figure:.2f} times",
        aim,
        {True: "[green]ok", False: "[red]missed", None: ""}[measure.met],
        _format(measure.memory_mb),
        _format(measure.their_memory_mb),
    ]


def _format(value: float | None, unit: str = "") -> str:
    return "" if value is None else f"{value:.4g} {unit}".rstrip()


if __name__ == "__main__":
    main(sys.argv[1:])
