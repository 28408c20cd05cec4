"""The process that fuzzes one target: python -m tests.fuzz.worker TARGET FOLDER CORPUS SECONDS SEED.

An input that executes new lines of the package is added to the corpus, and later inputs are mutations of the corpus.
The input that is being processed is in FOLDER/input, so that it is known if the process hangs or dies. Each line on
stdout is a JSON object: progress, or a defect.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import random
import resource
import sys
import time
import traceback
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TextIO

import coverage

from tests.fuzz.targets import TARGETS, FuzzTarget
from tests.maps.corruption import corrupted
from tests.maps.fuzz_worker import SandboxAudit

__all__ = ["FuzzLoop"]

PROGRESS_INTERVAL_S = 1.0
MAX_INPUT_BYTES = 1_000_000
PACKAGE = Path(__import__("mindstage").__file__).parent


class FuzzLoop:
    """Mutates the corpus of a target and processes the results."""

    def __init__(
        self,
        target: FuzzTarget,
        measurement: coverage.Coverage,
        write: Callable[[dict[str, Any]], None],
        *,
        corpus: Path,
        folder: Path,
        seed: int,
    ) -> None:
        """Loads the corpus, and adds the seeds of the target."""
        self.target, self._write = target, write
        self._corpus_folder, self._input = corpus, folder / "input"
        self._chooser = random.Random(seed)
        self._coverage = measurement
        self._lines = 0
        self.corpus: list[bytes] = []
        self.count = 0
        self.defects: dict[str, str] = {}
        """Traceback by the place where it was raised."""
        corpus.mkdir(parents=True, exist_ok=True)
        known = [path.read_bytes() for path in sorted(corpus.iterdir())]
        self._begin = [*target.seeds(), *known]

    def run(self, seconds: float, *, max_inputs: float = math.inf) -> None:
        """Processes inputs until the time is used up, or their maximum number is reached."""
        end = time.monotonic() + seconds
        reported = 0.0
        for data in self._begin:
            self._process(data)
        while time.monotonic() < end and self.count < max_inputs:
            self._process(self._next_input())
            if time.monotonic() - reported > PROGRESS_INTERVAL_S:
                reported = time.monotonic()
                self._write({"inputs": self.count, "lines": self._lines, "corpus": len(self.corpus)})
        self._write({"inputs": self.count, "lines": self._lines, "corpus": len(self.corpus), "end": True})

    def _next_input(self) -> bytes:
        if self._chooser.random() < 0.3 and (made := self.target.random_input(self._chooser)) is not None:
            return made
        if not self.corpus:
            return self._chooser.randbytes(100)
        data = self._chooser.choice(self.corpus)
        if self._chooser.random() < 0.1:  # a cut of one with a cut of another
            other = self._chooser.choice(self.corpus)
            data = data[: self._chooser.randrange(len(data) + 1)] + other[self._chooser.randrange(len(other) + 1) :]
        return corrupted(data, self._chooser.randrange(1, 2**31))[:MAX_INPUT_BYTES]

    def _process(self, data: bytes) -> None:
        self._input.write_bytes(data)
        self.count += 1
        try:
            self.target.process(data)
        except MemoryError:
            self._report("MemoryError: the memory limit was reached", data)
        except Exception as error:
            frames = traceback.extract_tb(error.__traceback__)
            own = [frame for frame in frames if str(PACKAGE) in frame.filename] or frames
            place = f"{type(error).__name__} at {own[-1].filename}:{own[-1].lineno}"
            self._report(place, data)
        lines = self._line_count()
        if lines > self._lines:
            self._lines = lines
            self.corpus.append(data)
            (self._corpus_folder / hashlib.sha1(data).hexdigest()).write_bytes(data)

    def _line_count(self) -> int:
        found = self._coverage.get_data()
        return sum(len(found.lines(file) or ()) for file in found.measured_files())

    def _report(self, place: str, data: bytes) -> None:
        if place not in self.defects:
            self.defects[place] = traceback.format_exc()
            self._write({"defect": place, "traceback": self.defects[place], "input": data.hex()})


def _write(file: TextIO, message: dict[str, Any]) -> None:
    print(json.dumps(message), file=file, flush=True)


def main(name: str, folder: Path, corpus: Path, seconds: float, seed: int) -> None:
    messages = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # stdout is reserved for messages
    os.environ.pop("ROS_PACKAGE_PATH", None)
    measurement = coverage.Coverage(data_file=None, source=[str(PACKAGE)], config_file=False)
    measurement.start()  # before the target starts threads, which are measured only from then on
    target = TARGETS[name](folder)
    if target.memory_limit is not None:
        resource.setrlimit(resource.RLIMIT_AS, (target.memory_limit, target.memory_limit))
    if not target.uses_network and target.memory_limit is not None:
        SandboxAudit()
    try:
        FuzzLoop(target, measurement, partial(_write, messages), corpus=corpus, folder=folder, seed=seed).run(seconds)
    finally:
        target.close()


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]), float(sys.argv[4]), int(sys.argv[5]))
    os._exit(0)  # threads of servers do not delay the end
