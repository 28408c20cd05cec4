"""Fuzzes the readers and ports for a given time (`make fuzz FUZZ_S=600`), and keeps the corpus in build/fuzz/corpus.

Each target (`tests/fuzz/targets.py`) gets an equal share of the time. A defect is an exception other than the promised
errors, a hang, the end of the process, or an attempt to use the network. Its input is saved in build/fuzz/findings; the
exit code is 1 if there are any. `--input FILE --target NAME` processes one saved input again.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import select
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rich.console import Console
from rich.live import Live
from rich.table import Table

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from tests.fuzz.targets import TARGETS  # noqa: E402

__all__ = ["TargetReport", "fuzz_target", "main"]

OUTPUT = ROOT / "build" / "fuzz"
HANG_S = 60.0
"""Time without progress after which a target counts as hanging [s]."""


@dataclass
class TargetReport:
    """What was found in one target."""

    name: str
    inputs: int = 0
    lines: int = 0
    corpus: int = 0
    findings: list[Path] = field(default_factory=list)


def fuzz_target(report: TargetReport, seconds: float, seed: int, on_progress: Any = lambda: None) -> None:
    """Runs worker processes for a target until the time is used up; a worker that dies or hangs is replaced."""
    end = time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0.0:
        with TemporaryDirectory(prefix="mindstage-fuzz-") as folder:
            finished = _run_worker(report, Path(folder), left, seed, on_progress)
        if finished:
            return
        seed += 1


def _run_worker(report: TargetReport, folder: Path, seconds: float, seed: int, on_progress: Any) -> bool:
    corpus = OUTPUT / "corpus" / report.name
    command = [
        sys.executable,
        "-m",
        "tests.fuzz.worker",
        report.name,
        str(folder),
        str(corpus),
        str(seconds),
        str(seed),
    ]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "PYTHONFAULTHANDLER": "1", "XDG_CACHE_HOME": str(folder)}
    inputs = report.inputs
    with (folder / "errors.txt").open("wb") as errors:
        worker = subprocess.Popen(
            command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, stderr=errors, start_new_session=True
        )
    assert worker.stdout is not None
    try:
        while select.select([worker.stdout], [], [], HANG_S)[0]:
            line = worker.stdout.readline()
            if not line:
                worker.wait(timeout=30)
                _save(report, folder / "input", f"the process ended with {worker.returncode}", folder / "errors.txt")
                return False
            message = json.loads(line)
            if "defect" in message:
                _save_finding(report, bytes.fromhex(message["input"]), message["traceback"])
                continue
            report.inputs = inputs + message["inputs"]
            report.lines, report.corpus = message["lines"], message["corpus"]
            on_progress()
            if message.get("end"):
                return True
        _save(report, folder / "input", f"it hangs: no progress for {HANG_S:g} s", folder / "errors.txt")
        return False
    finally:
        worker.kill()
        worker.wait(timeout=30)
        worker.stdout.close()


def _save(report: TargetReport, input: Path, cause: str, errors: Path) -> None:
    data = input.read_bytes() if input.exists() else b""
    _save_finding(report, data, f"{cause}\n{errors.read_text(errors='replace')[-4000:]}")


def _save_finding(report: TargetReport, data: bytes, text: str) -> None:
    folder = OUTPUT / "findings"
    folder.mkdir(parents=True, exist_ok=True)
    place = folder / f"{report.name}-{hashlib.sha1(data).hexdigest()[:10]}"
    place.write_bytes(data)
    place.with_suffix(".txt").write_text(text, encoding="utf-8")
    report.findings.append(place)


def _table(reports: Sequence[TargetReport]) -> Table:
    table = Table("target", "inputs", "lines", "corpus", "findings", box=None)
    for report in reports:
        table.add_row(
            report.name, f"{report.inputs:,}", f"{report.lines:,}", str(report.corpus), str(len(report.findings))
        )
    return table


def main(arguments: Sequence[str] | None = None) -> int:
    """Fuzzes, prints the table, and returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=600.0, help="time for all targets together [s]")
    parser.add_argument("--target", action="append", choices=list(TARGETS), help="only this one; repeatable")
    parser.add_argument("--seed", type=int, default=None, help="seed; random if not given")
    parser.add_argument("--input", type=Path, help="process this file once, in this process")
    options = parser.parse_args(arguments)
    names = options.target or list(TARGETS)
    if options.input:
        with TemporaryDirectory() as folder:
            target = TARGETS[names[0]](Path(folder))
            target.process(options.input.read_bytes())
            target.close()
        print("no defect")
        return 0
    seed = options.seed if options.seed is not None else random.SystemRandom().randrange(2**31)
    reports = [TargetReport(name) for name in names]
    console = Console()
    console.print(f"seed {seed}")
    with Live(_table(reports), console=console, refresh_per_second=2) as live:
        for report in reports:
            fuzz_target(report, options.seconds / len(reports), seed, lambda: live.update(_table(reports)))
    findings = [path for report in reports for path in report.findings]
    for path in findings:
        cause = path.with_suffix(".txt").read_text(encoding="utf-8").strip().splitlines()
        console.print(f"{path}: {cause[-1] if cause else ''}", markup=False)
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
