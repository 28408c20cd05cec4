"""The named questions against SWI-Prolog's semweb and rdflib, with one map of the thesis and with a hundred of them.

Everybody (see `askers`) loads the same files in one process and, warm, times each question alone, again and again. What
we are asked "again" comes out of the memory of answers that `KnowledgeBase.ask` has until something changes; otherwise
it is worked out each time. Whoever gives another number of answers ends the benchmark.
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

# Nothing heavy is imported here: a process begins with the peak memory of the one that started it.

SHARED = Path(os.environ.get("MINDSTAGE_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data")
MAP = SHARED / "maps" / "iai-kitchen-original.owl"
FIRST = "http://knowrob.org/kb/UE-IAI-Kitchen-0.owl#4tMUPVaKO0-M-PI7IlSiVA"
ASKERS = Path(__file__).with_name("askers")

NO_MAP = "-"
"""Asks for nothing: what counts is the load."""

COPIES = 100
TRIPLES = 1_000_000
GROWTH = 3.0
"""How many times as long a question about one map may take among a hundred."""
ALONE = ("index", "what_is", "analyse", "tell")
"""What nobody else is asked."""
WITH_ITSELF = ("subclass_of", "subclass_of, below")
"""The others count the class itself, we do not."""


class Told(NamedTuple):
    """What one process says of one question."""

    seconds: float
    count: int


class Asker(NamedTuple):
    """All that one process says, and its peak memory."""

    told: Mapping[str, Told]
    memory_mb: float


def measure() -> Iterator[Measure]:
    if not MAP.is_file():
        sys.stderr.write(f"no sample maps in {SHARED}; name their folder with MINDSTAGE_DATA\n")
        return
    ontologies = sorted((SHARED / "ontology").glob("*/owl/*.owl"))
    with TemporaryDirectory(prefix="mindstage-") as folder:
        one = yield from _asked([*_copies(Path(folder), 1), *ontologies], "1 map")
        many = yield from _asked([*_copies(Path(folder), COPIES), *ontologies], f"{COPIES} maps")
        for name, told in one.told.items():
            if told.count == many.told[name].count and name not in {"maps", "load"} and not name.endswith("again"):
                yield Measure(
                    what=f"{COPIES} maps: {name}",
                    ours=many.told[name].seconds * 1e6,
                    unit="µs",
                    peer="ours with 1 map",
                    theirs=told.seconds * 1e6,
                    at_most=GROWTH,
                )
        each = (many.told["load"].count - one.told["load"].count) // (COPIES - 1)
        yield from _loading([*_copies(Path(folder), TRIPLES // each + 1), *ontologies])


def _asked(files: Sequence[Path], where: str) -> Generator[Measure, None, Asker]:
    """Each question of ours beside everybody else's."""
    ours = _run(sys.executable, ASKERS / "ours.py", *files)
    peers = {f"rdflib {version('rdflib')}": _run(sys.executable, ASKERS / "in_rdflib.py", *files)}
    if swipl := shutil.which("swipl"):
        peers[_swi(swipl)] = _run(swipl, ASKERS / "in_prolog.pl", *files)
    for name in ALONE:
        yield Measure(what=f"{where}: {name}", ours=ours.told[name].seconds * 1e6, unit="µs", memory_mb=ours.memory_mb)
    for name, told in ours.told.items():
        for peer, asker in peers.items():
            plain = name.removesuffix(", again")
            if (theirs := asker.told.get(plain)) and name != "load":
                _check(plain, told.count, theirs.count, peer)
                yield Measure(
                    what=f"{where}: {name} ({told.count} answers)",
                    ours=told.seconds * 1e6,
                    unit="µs",
                    peer=peer,
                    theirs=theirs.seconds * 1e6,
                    at_most=_aim(name),
                    memory_mb=ours.memory_mb,
                    their_memory_mb=asker.memory_mb,
                )
    return ours


def _aim(name: str) -> float | None:
    if name.startswith("maps"):  # one look-up in C, which no call from Python can beat, unless it is remembered
        return 1.0 if name.endswith("again") else None
    return 0.1 if name.endswith("again") else 1.0


def _check(name: str, ours: int, theirs: int, peer: str) -> None:
    expected = ours + 1 if name in WITH_ITSELF else ours
    if theirs != expected:
        raise AssertionError(f"{name}: {peer} has {theirs} answers where we have {ours}")


def _loading(files: Sequence[Path]) -> Iterator[Measure]:
    """A million statements."""
    swipl = shutil.which("swipl")
    if not swipl:
        sys.stderr.write("SWI-Prolog is not installed (Debian's package swi-prolog-nox): no ratio to it\n")
        return
    ours = _run(sys.executable, ASKERS / "ours.py", *files, map=NO_MAP)
    theirs = _run(swipl, ASKERS / "in_prolog.pl", *files, map=NO_MAP)
    mine, its = ours.told["load"], theirs.told["load"]
    if not 0.9 < its.count / mine.count < 1.1:  # numbers that are equal are one value for us
        raise AssertionError(f"SWI-Prolog has {its.count} statements and we have {mine.count}")
    yield Measure(
        what=f"load {len(files)} files ({mine.count:,} statements)",
        ours=mine.seconds,
        peer=_swi(swipl),
        theirs=its.seconds,
        at_least=3.0,
        memory_mb=ours.memory_mb,
        their_memory_mb=theirs.memory_mb,
    )


def _copies(folder: Path, number: int) -> list[Path]:
    """The map of the thesis as many times as wanted, each a map of its own with individuals of its own."""
    text = MAP.read_text(encoding="utf-8")
    paths = [folder / f"map-{at}.owl" for at in range(number)]
    for at, path in enumerate(paths):
        if not path.exists():
            path.write_text(text.replace("UE-IAI-Kitchen.owl", f"UE-IAI-Kitchen-{at}.owl"), encoding="utf-8")
    return paths


def _run(program: str, script: Path, *files: Path, map: str = FIRST) -> Asker:
    """One asker from its start to its end."""
    process = subprocess.Popen(
        [program, script, map, *files], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    assert process.stdout is not None
    lines = process.stdout.read().splitlines()
    # wait4 alone tells the peak memory of just this child.
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    process.stdout.close()
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, f"{program} {script}")
    cells = (line.split("\t") for line in lines)
    return Asker({name: Told(float(seconds), int(count)) for name, seconds, count in cells}, usage.ru_maxrss / 1024)


def _swi(swipl: str) -> str:
    told = subprocess.run([swipl, "--version"], capture_output=True, text=True, check=True).stdout
    return f"SWI-Prolog {told.split()[2]}"
