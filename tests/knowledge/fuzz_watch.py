"""Watching from outside: a worker process reads what may be anything, and ends if it takes too long.

A job may have some seconds of the processor, which a slow machine has as well as a fast one, and some minutes on the
clock, in case it waits for something that never comes.
"""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, Self

from tests.conftest import ROOT

__all__ = ["VERBS", "WorkerResult", "WorkerSupervisor"]

CPU_LIMIT_S = 15.0
"""A hundred times what a large sample takes."""
WALL_LIMIT_S = 180.0
VERBS = ("validate", "validate --json", "analyse", "convert")

_TICKS_PER_SECOND = os.sysconf("SC_CLK_TCK")


class WorkerResult(NamedTuple):
    """What became of one file."""

    defect: str
    """Why it must not have ended so; empty where all is well."""
    error: str = ""
    """What Mindstage said where it did not take the file."""
    maps: int = 0
    bodies: int = 0
    findings: Sequence[str] = ()
    exit_code: int = 0
    """Of a verb about the file."""
    network_attempts: Sequence[str] = ()
    """To get outside of the process."""
    opened_files: Sequence[str] = ()
    """Files that nothing in a map is a reason to open."""
    memory_mb: float = 0.0
    """The worker's peak so far."""


class WorkerSupervisor:
    """One worker at a time; a new one where the last one had to be ended."""

    def __init__(self, folder: Path) -> None:
        """Starts nothing yet; the worker writes into the folder."""
        self._folder = folder
        self._command = [sys.executable, "-m", "tests.knowledge.fuzz_worker", str(folder)]
        self._worker: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._kill()

    def read(
        self, path: Path, *, robots: Sequence[Path] = (), ontologies: Sequence[Path] = (), verb: str = VERBS[0]
    ) -> WorkerResult:
        """Has a file read and written, and something typed about it."""
        worker = self._worker = self._worker or self._start()
        assert worker.stdin is not None
        job = {"path": str(path), "robots": list(map(str, robots)), "ontologies": list(map(str, ontologies))}
        worker.stdin.write(json.dumps(job | {"verb": verb}).encode() + b"\n")
        worker.stdin.flush()
        line = self._wait_for(worker)
        if isinstance(line, str):
            self._kill()
            return WorkerResult(line)
        told = json.loads(line)
        defect = told.get("defect", "")
        if told["tries"]:
            defect = f"it tried to get outside: {told['tries']}\n{defect}"
        if told["opened"]:
            defect = f"it opened what it must not: {told['opened']}\n{defect}"
        typed = told.pop("typed", 0)
        return WorkerResult(**(told | {"defect": defect}), exit_code=typed)

    def _start(self) -> subprocess.Popen[bytes]:
        environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        errors = (self._folder / "errors.txt").open("wb")
        with errors:
            return subprocess.Popen(
                self._command, cwd=ROOT, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors
            )

    def _wait_for(self, worker: subprocess.Popen[bytes]) -> bytes | str:
        """The answer, or why there is none."""
        assert worker.stdout is not None
        begin, used = time.monotonic(), _cpu_s(worker.pid)
        while not select.select([worker.stdout], [], [], 0.25)[0]:
            if _cpu_s(worker.pid) - used > CPU_LIMIT_S:
                return f"it hangs: no answer after {CPU_LIMIT_S:g} s of the processor"
            if time.monotonic() - begin > WALL_LIMIT_S:
                return f"it hangs: no answer after {WALL_LIMIT_S:g} s"
        line = worker.stdout.readline()
        if line.endswith(b"\n"):
            return line
        code = worker.wait(timeout=30)
        errors = (self._folder / "errors.txt").read_text(errors="replace")
        return f"the process ended with {code}: {errors[-2000:]}"

    def _kill(self) -> None:
        worker, self._worker = self._worker, None
        if worker is None:
            return
        worker.kill()
        worker.wait(timeout=30)
        for pipe in (worker.stdin, worker.stdout):
            assert pipe is not None
            pipe.close()


def _cpu_s(pid: int) -> float:
    """How long a process has been at work [s]."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    except OSError:
        return 0.0  # it has just ended, as its pipe will tell
    return (int(fields[11]) + int(fields[12])) / _TICKS_PER_SECOND
