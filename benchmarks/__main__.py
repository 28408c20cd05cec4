"""`python -m benchmarks [MODULE…]` runs the benchmarks of this folder and prints ratios against their aims."""

from __future__ import annotations

import pkgutil
import platform
import sys
from collections.abc import Iterable
from importlib import import_module

from rich.console import Console
from rich.table import Table

import benchmarks
from benchmarks import Measure


def main(names: list[str]) -> None:
    known = [module.name for module in pkgutil.iter_modules(benchmarks.__path__) if module.name != "__main__"]
    if unknown := set(names) - set(known):
        sys.exit(f"no benchmark {', '.join(sorted(unknown))}; there is {', '.join(known)}")
    console = Console()
    if not console.is_terminal:
        console.width = 160
    console.print(f"Python {platform.python_version()} on {platform.machine()}, {platform.system()}", highlight=False)
    missed = 0
    for name in names or known:
        module = import_module(f"benchmarks.{name}")
        if not hasattr(module, "measure"):
            continue  # what several benchmarks share
        with console.status(f"measuring {name} …"):
            measures = list(module.measure())
        console.print(_table(name, measures))
        missed += sum(measure.met is False for measure in measures)
    console.print("All aims are met." if not missed else f"{missed} aims are missed.")


def _table(name: str, measures: Iterable[Measure]) -> Table:
    table = Table(title=name, title_justify="left")
    for column, justify in (
        ("what", "left"),
        ("ours", "right"),
        ("peer", "left"),
        ("theirs", "right"),
        ("figure", "right"),
        ("aim", "left"),
        ("", "left"),
        ("MB", "right"),
        ("theirs", "right"),
    ):
        table.add_column(column, justify=justify)  # type: ignore[arg-type]  # rich wants the literals
    for measure in measures:
        table.add_row(*_row(measure))
    return table


def _row(measure: Measure) -> list[str]:
    unit = measure.unit if measure.theirs is None else "times"
    aim = ""
    if measure.at_most is not None:
        aim = f"≤ {measure.at_most:g} {unit}"
    elif measure.at_least is not None:
        aim = f"≥ {measure.at_least:g} {unit}"
    return [
        measure.what,
        _shown(measure.ours, measure.unit),
        measure.peer,
        _shown(measure.theirs, measure.unit),
        "" if measure.theirs is None else f"{measure.figure:.2f} times",
        aim,
        {True: "[green]ok", False: "[red]missed", None: ""}[measure.met],
        _shown(measure.memory_mb),
        _shown(measure.their_memory_mb),
    ]


def _shown(value: float | None, unit: str = "") -> str:
    return "" if value is None else f"{value:.4g} {unit}".rstrip()


if __name__ == "__main__":
    main(sys.argv[1:])
