"""Benchmarks of Mindstage, as ratios to a named peer that does the same in the same run.

A module has a function `measure()`, which yields `Measure`s; `python -m benchmarks [MODULE…]` (or `make bench`) runs
them and compares them with their aims. Times are medians, printed with the peak memory of the process.
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
"""Odd, so that the median is one of the measured values."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Measure:
    """A measured value, that of a peer if there is one, and the aim."""

    what: str
    """What is measured, such as "load the IAI kitchen with its ontologies"."""
    ours: float
    unit: str = "s"
    peer: str = ""
    """The name and version of the peer, such as "rdflib 7.6.0"."""
    theirs: float | None = None
    at_most: float | None = None
    """Upper bound of `figure`, where less is better."""
    at_least: float | None = None
    """Lower bound of `figure`, where more is better."""
    memory_mb: float | None = None
    """Our peak memory [MB]."""
    their_memory_mb: float | None = None
    """The peak memory of the peer [MB]."""

    @property
    def figure(self) -> float:
        """The value that is compared with the aim.

        Without a peer it is `ours`. With a peer it is the ratio `ours / theirs` or, with `at_least`, the speed-up
        `theirs / ours`.
        """
        if self.theirs is None:
            return self.ours
        return self.theirs / self.ours if self.at_least is not None else self.ours / self.theirs

    @property
    def met(self) -> bool | None:
        """Whether the aim was reached; None without an aim."""
        if self.at_most is not None:
            return self.figure <= self.at_most
        return self.figure >= self.at_least if self.at_least is not None else None


class Run(NamedTuple):
    """The cost of a process."""

    seconds: float
    """Wall time [s]."""
    memory_mb: float
    """Peak memory [MB]."""


def run(command: Sequence[str | os.PathLike[str]]) -> Run:
    """Runs a command and discards its output.

    Raises:
        CalledProcessError: the command failed.
    """
    # Bytecode is cached, as it is for users.
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    launched = [sys.executable, "-S", "-E", str(_LAUNCHER), *map(os.fspath, command)]
    output = subprocess.run(launched, env=environment, stdout=subprocess.PIPE, text=True, check=True).stdout
    code, seconds, memory_kib = output.split()
    if int(code):
        raise subprocess.CalledProcessError(int(code), list(map(os.fspath, command)))
    return Run(float(seconds), int(memory_kib) * 1024 / 1e6)


def median_runs(*commands: Sequence[str | os.PathLike[str]], repeats: int = REPEATS) -> tuple[Run, ...]:
    """The median time and memory of each command, after a warm-up run of each.

    The commands alternate, so that other load on the machine affects all of them equally.
    """
    for command in commands:
        run(command)
    rounds = [[run(command) for command in commands] for _ in range(repeats)]
    return tuple(
        Run(median(each.seconds for each in runs), median(each.memory_mb for each in runs))
        for runs in zip(*rounds, strict=True)
    )


def median_s(function: Callable[[], object], *, repeats: int = REPEATS) -> float:
    """The median time of several calls, after a warm-up call [s]."""
    function()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return median(times)
