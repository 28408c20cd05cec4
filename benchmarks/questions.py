"""The declared questions, compared with SWI-Prolog's semweb and rdflib, for one map of the thesis and for 100 copies.

Spatial questions over 10,000 bodies are compared with SciPy and MuJoCo.

Each program in `askers` loads the same files in one process and times each question repeatedly. "Again" uses the cache
of answers of `KnowledgeBase.ask`; the other rows compute the answers each time. A different number of answers is an
error.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Generator, Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from benchmarks import Measure

# No heavy imports: the peak memory of a process includes that of its parent at the fork.

SHARED = Path(os.environ.get("MINDSTAGE_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data")
MAP = SHARED / "maps" / "iai-kitchen-original.owl"
FIRST = "http://knowrob.org/kb/UE-IAI-Kitchen-0.owl#4tMUPVaKO0-M-PI7IlSiVA"
ASKERS = Path(__file__).with_name("askers")

NO_MAP = "-"
"""Loads the files without asking questions."""

COPIES = 100
TRIPLES = 1_000_000
GROWTH = 3.0
"""Aim for the ratio of a question about one map among 100 maps, to one map alone."""
ALONE = ("index", "what_is", "analyze", "tell")
"""Questions without a peer."""
WITH_ITSELF = ("subclass_of", "subclass_of, below")
"""Questions where the peers count the class itself as an answer."""


class Timing(NamedTuple):
    """The median time of a question, and the number of its answers."""

    seconds: float
    count: int


class Result(NamedTuple):
    """The output of a process, and its peak memory."""

    timings: Mapping[str, Timing]
    memory_mb: float


SPATIAL_AIMS = {
    "path": 10.0,
    "path, blocked": 20.0,
    "reachable, all": 15.0,
    "visibility of 200": 0.5,
    "visible_from, all": 0.25,
    "comp_toTheLeftOf, all pairs": 3.0,
    "comp_inFrontOf, all pairs": 25.0,
    "comp_inCenterOf, all pairs": 3.0,
}
"""Aims for the ratio of a question over 10,000 bodies to a peer, which for paths does a small part of the work.

The last three are predicates about the bundled kitchen, whose peer has the poses as facts; each of the 32,514 answers
of the second one is handed over from Python.
"""


def measure() -> Iterator[Measure]:
    yield from _spatial()
    if not MAP.is_file():
        sys.stderr.write(f"skipped: no sample maps in {SHARED}; set MINDSTAGE_DATA to their folder\n")
        return
    ontologies = sorted((SHARED / "ontology").glob("*/owl/*.owl"))
    with TemporaryDirectory(prefix="mindstage-") as folder:
        one = yield from _ask([*_copies(Path(folder), 1), *ontologies], "1 map")
        many = yield from _ask([*_copies(Path(folder), COPIES), *ontologies], f"{COPIES} maps")
        for name, timing in one.timings.items():
            if timing.count == many.timings[name].count and name not in {"maps", "load"} and not name.endswith("again"):
                yield Measure(
                    what=f"{COPIES} maps: {name}",
                    ours=many.timings[name].seconds * 1e6,
                    unit="µs",
                    peer="ours with 1 map",
                    theirs=timing.seconds * 1e6,
                    at_most=GROWTH,
                )
        each = (many.timings["load"].count - one.timings["load"].count) // (COPIES - 1)
        yield from _loading([*_copies(Path(folder), TRIPLES // each + 1), *ontologies])


def _spatial() -> Iterator[Measure]:
    command = [sys.executable, str(ASKERS / "spatial.py")]
    lines = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    for what, ours, peer, theirs in (line.split("\t") for line in lines):
        aim = SPATIAL_AIMS[what]
        where = "kitchen" if what.startswith("comp_") else "10,000 bodies"
        yield Measure(what=f"{where}: {what}", ours=float(ours), peer=peer, theirs=float(theirs), at_most=aim)


def _ask(files: Sequence[Path], where: str) -> Generator[Measure, None, Result]:
    """Yields a measure for each question and peer."""
    ours = _run(sys.executable, ASKERS / "ours.py", *files)
    peers = {f"rdflib {version('rdflib')}": _run(sys.executable, ASKERS / "in_rdflib.py", *files)}
    if swipl := shutil.which("swipl"):
        peers[_swipl_version(swipl)] = _run(swipl, ASKERS / "in_prolog.pl", *files)
    for name in ALONE:
        yield Measure(
            what=f"{where}: {name}", ours=ours.timings[name].seconds * 1e6, unit="µs", memory_mb=ours.memory_mb
        )
    for name, timing in ours.timings.items():
        for peer, result in peers.items():
            plain = name.removesuffix(", again")
            if (theirs := result.timings.get(plain)) and name != "load":
                _check(plain, timing.count, theirs.count, peer)
                yield Measure(
                    what=f"{where}: {name} ({timing.count} answers)",
                    ours=timing.seconds * 1e6,
                    unit="µs",
                    peer=peer,
                    theirs=theirs.seconds * 1e6,
                    at_most=_aim(name),
                    memory_mb=ours.memory_mb,
                    their_memory_mb=result.memory_mb,
                )
    return ours


def _aim(name: str) -> float | None:
    if name.startswith("maps"):  # a single look-up in C, faster than any call from Python
        return 1.0 if name.endswith("again") else None
    return 0.1 if name.endswith("again") else 1.0


def _check(name: str, ours: int, theirs: int, peer: str) -> None:
    expected = ours + 1 if name in WITH_ITSELF else ours
    if theirs != expected:
        raise AssertionError(f"{name}: {peer} has {theirs} answers where we have {ours}")


def _loading(files: Sequence[Path]) -> Iterator[Measure]:
    """Loads a million statements."""
    swipl = shutil.which("swipl")
    if not swipl:
        sys.stderr.write("SWI-Prolog is not installed (Debian: swi-prolog-nox); skipped\n")
        return
    ours = _run(sys.executable, ASKERS / "ours.py", *files, map=NO_MAP)
    theirs = _run(swipl, ASKERS / "in_prolog.pl", *files, map=NO_MAP)
    mine, its = ours.timings["load"], theirs.timings["load"]
    if not 0.9 < its.count / mine.count < 1.1:  # equal numbers are one value in pyoxigraph
        raise AssertionError(f"SWI-Prolog has {its.count} statements and we have {mine.count}")
    yield Measure(
        what=f"load {len(files)} files ({mine.count:,} statements)",
        ours=mine.seconds,
        peer=_swipl_version(swipl),
        theirs=its.seconds,
        at_least=3.0,
        memory_mb=ours.memory_mb,
        their_memory_mb=theirs.memory_mb,
    )


def _copies(folder: Path, number: int) -> list[Path]:
    """Copies of the map of the thesis, each with its own IRIs."""
    text = MAP.read_text(encoding="utf-8")
    paths = [folder / f"map-{at}.owl" for at in range(number)]
    for at, path in enumerate(paths):
        if not path.exists():
            path.write_text(text.replace("UE-IAI-Kitchen.owl", f"UE-IAI-Kitchen-{at}.owl"), encoding="utf-8")
    return paths


def _run(program: str, script: Path, *files: Path, map: str = FIRST) -> Result:
    """Runs one of the programs."""
    process = subprocess.Popen(
        [program, script, map, *files], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    assert process.stdout is not None
    lines = process.stdout.read().splitlines()
    # Only wait4 returns the peak memory of this child alone.
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    process.stdout.close()
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, f"{program} {script}")
    cells = (line.split("\t") for line in lines)
    return Result({name: Timing(float(seconds), int(count)) for name, seconds, count in cells}, usage.ru_maxrss / 1024)


def _swipl_version(swipl: str) -> str:
    output = subprocess.run([swipl, "--version"], capture_output=True, text=True, check=True).stdout
    return f"SWI-Prolog {output.split()[2]}"
