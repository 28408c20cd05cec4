"""Supervision of a worker process that reads untrusted files, with time limits.

Each job has a limit of CPU time, which hardly depends on the machine, and a limit of wall time, in case it blocks.
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
"""About a hundred times the CPU time of a large sample."""
WALL_LIMIT_S = 180.0
VERBS = ("validate", "validate --json", "analyze", "convert")

_TICKS_PER_SECOND = os.sysconf("SC_CLK_TCK")


class WorkerResult(NamedTuple):
    """The result of one job."""

    defect: str
    """Description of a failure; empty if there is none."""
    error: str = ""
    """The error with which Mindstage refused the file."""
    maps: int = 0
    bodies: int = 0
    findings: Sequence[str] = ()
    exit_code: int = 0
    """Exit code of the CLI command."""
    network_attempts: Sequence[str] = ()
    """Attempts to use the network or to start a process."""
    opened_files: Sequence[str] = ()
    """Protected files that were opened."""
    memory_mb: float = 0.0
    """Peak memory of the worker so far."""


class WorkerSupervisor:
    """Runs one worker process, which is replaced after a failure."""

    def __init__(self, folder: Path) -> None:
        """Creates the supervisor; the worker starts with the first job and writes into the folder."""
        self._folder = folder
        self._command = [sys.executable, "-m", "tests.maps.fuzz_worker", str(folder)]
        self._worker: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._kill()

    def read(
        self, path: Path, *, robots: Sequence[Path] = (), ontologies: Sequence[Path] = (), verb: str = VERBS[0]
    ) -> WorkerResult:
        """Runs one job: reads and writes a file, and runs a CLI command on it."""
        worker = self._worker = self._worker or self._start()
        assert worker.stdin is not None
        job = {"path": str(path), "robots": list(map(str, robots)), "ontologies": list(map(str, ontologies))}
        worker.stdin.write(json.dumps(job | {"verb": verb}).encode() + b"\n")
        worker.stdin.flush()
        line = self._wait_for(worker)
        if isinstance(line, str):
            self._kill()
            return WorkerResult(line)
        result = json.loads(line)
        defect = result.get("defect", "")
        if result["network_attempts"]:
            defect = f"it accessed the network or started a process: {result['network_attempts']}\n{defect}"
        if result["opened_files"]:
            defect = f"it opened protected files: {result['opened_files']}\n{defect}"
        return WorkerResult(**(result | {"defect": defect}))

    def _start(self) -> subprocess.Popen[bytes]:
        environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        errors = (self._folder / "errors.txt").open("wb")
        with errors:
            return subprocess.Popen(
                self._command, cwd=ROOT, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors
            )

    def _wait_for(self, worker: subprocess.Popen[bytes]) -> bytes | str:
        """Returns the answer, or the reason why there is none."""
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
    """Returns the CPU time of a process [s]."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    except OSError:
        return 0.0  # it has just ended
    return (int(fields[11]) + int(fields[12])) / _TICKS_PER_SECOND
