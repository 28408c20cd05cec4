"""Benchmarks: how fast Mindstage is, as ratios against a named peer that does the same in the same run.

A module here has one function `set_size()`, which yields `Measure`s; `python -m benchmarks [MODULE…]` (or `make bench`)
runs them and holds them against their aims. Times are medians, and each stands beside the peak memory of its process.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import NamedTuple

__all__ = ["REPEATS", "Measure", "Run", "median_runs", "median_s", "run"]

_LAUNCHER = Path(__file__).with_name("launcher.py")

REPEATS = 9
"""Odd, so that the median is one of them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Measure:
    """One number of ours, the peer's where there is one, and what was aimed at."""

    what: str
    """Such as "load the IAI kitchen with its ontologies"."""
    ours: float
    unit: str = "s"
    peer: str = ""
    """Who does the same, with the version: "rdflib 7.6.0"."""
    theirs: float | None = None
    at_most: float | None = None
    """The aim for `figure`, where less is better."""
    at_least: float | None = None
    """The aim for `figure`, where more is better."""
    memory_mb: float | None = None
    """Our peak [MB]."""
    their_memory_mb: float | None = None

    @property
    def figure(self) -> float:
        """What is held against the aim.

        Without a peer it is our own number. Against a peer it is how many times its number ours is (`at_most`), or,
        for times where more is better (`at_least`), how many times faster we are.
        """
        if self.theirs is None:
            return self.ours
        return self.theirs / self.ours if self.at_least is not None else self.ours / self.theirs

    @property
    def met(self) -> bool | None:
        """Whether the aim was reached; None where there is none."""
        if self.at_most is not None:
            return self.figure <= self.at_most
        return self.figure >= self.at_least if self.at_least is not None else None


class Run(NamedTuple):
    """What one process took."""

    seconds: float
    memory_mb: float
    """Its peak."""


def run(command: Sequence[str | os.PathLike[str]]) -> Run:
    """Runs a command to its end, output unseen.

    Raises:
        CalledProcessError: it failed, which would make its time worthless.
    """
    # Compiled once and kept, as it is for users.
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    launched = [sys.executable, "-S", "-E", str(_LAUNCHER), *map(os.fspath, command)]
    told = subprocess.run(launched, env=environment, stdout=subprocess.PIPE, text=True, check=True).stdout
    code, seconds, memory_kib = told.split()
    if int(code):
        raise subprocess.CalledProcessError(int(code), list(map(os.fspath, command)))
    return Run(float(seconds), int(memory_kib) * 1024 / 1e6)


def median_runs(*commands: Sequence[str | os.PathLike[str]], repeats: int = REPEATS) -> tuple[Run, ...]:
    """The median time and memory of each command, after a run of each that warms the disk's cache.

    They take turns, so that whatever else the machine does meets all of them alike.
    """
    for command in commands:
        run(command)
    rounds = [[run(command) for command in commands] for _ in range(repeats)]
    return tuple(
        Run(median(each.seconds for each in runs), median(each.memory_mb for each in runs))
        for runs in zip(*rounds, strict=True)
    )


def median_s(function: Callable[[], object], *, repeats: int = REPEATS) -> float:
    """The median time of several calls, after one that does not count [s]."""
    function()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return median(times)
