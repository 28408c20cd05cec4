"""Passing: lets simulated time pass, and shows how far it is where that takes a while."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from mindstage.cli.output import console

if TYPE_CHECKING:
    from mindstage.stage import Simulation

__all__ = ["step_with_progress"]

_MIN_PROGRESS_S = 1.0
"""Nobody needs a bar for less [s]."""


def step_with_progress(simulation: Simulation, duration_s: float) -> float:
    """Steps the stage and returns how long that took [s]."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("simulating"), BarColumn(), TextColumn("{task.completed:.1f} of {task.total:.1f} s"))
    start = time.perf_counter()
    with Progress(*columns, TimeRemainingColumn(), console=console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=duration_s, visible=False)

        def progress(done_s: float) -> None:
            waited_s = time.perf_counter() - start
            bar.update(task, completed=done_s, visible=bar.console.is_terminal and waited_s > _MIN_PROGRESS_S)

        simulation.step(duration_s, progress=progress)
    return time.perf_counter() - start
