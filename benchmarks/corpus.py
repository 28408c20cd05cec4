"""Spawning and ten seconds of life of the sample maps, and of generated maps of 400 bodies, in real time at least.

Each map is spawned by `mindstage spawn` in a process of its own. The figure is the simulated time over the wall time of
spawning, which includes two simulated seconds in which moving bodies are looked for, and of simulating.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from scripts.try_maps import find_maps, try_map

from benchmarks import Measure
from benchmarks.large_maps import DIALECTS

ROOT = Path(__file__).resolve().parent.parent
INDIVIDUALS = 500
"""Of the generated maps; 400 of them are bodies."""
SIMULATED_S = 10.0


def measure() -> Iterator[Measure]:
    yield _one("bundled:kitchen", Path("bundled:kitchen"))
    folder = Path(os.environ.get("MINDSTAGE_DATA") or ROOT.parent / "shared" / "data") / "maps"
    if not folder.is_dir():
        sys.stderr.write(f"no sample maps in {folder}; skipped\n")
    for path, _ in find_maps([folder]) if folder.is_dir() else ():
        yield _one(path.name, path)
    with TemporaryDirectory(prefix="mindstage-") as name:
        for dialect in DIALECTS:
            path = Path(name, f"{dialect.replace(' ', '-')}.owl")
            command = [sys.executable, "-m", "benchmarks.large_maps", dialect, str(INDIVIDUALS), path]
            subprocess.run(command, check=True, cwd=ROOT)
            yield _one(f"{dialect}, {INDIVIDUALS} individuals", path)


def _one(what: str, path: Path) -> Measure:
    result = try_map(path, steps=("spawn",), seconds=SIMULATED_S)
    factor = result.row()["real_time_factor_with_spawn"]
    if factor is None:
        raise AssertionError(f"{what}: {result.to_json()}")
    bodies = result.row()["bodies"]
    return Measure(
        what=f"{what}: {bodies} bodies, spawn and {SIMULATED_S:g} s, real time", ours=factor, unit="x", at_least=1.0
    )
