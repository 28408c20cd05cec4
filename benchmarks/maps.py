"""Reading large maps of three dialects: how long the world takes beside the parse, how it grows, and SWI-Prolog's load.

Every step is a process of its own that times the step alone and prints the processor's seconds, to which it matters
little what else the machine does; the maps are made up for it (see `large_maps`). "The parse" is the way from the
file's bytes to the graph that a world is made from, and "the world" the way from there; what pyoxigraph needs to parse
the same bytes into nothing stands beside it.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from benchmarks import Measure
from benchmarks.knowledge import LOAD_PROLOG, Timed, once
from benchmarks.large_maps import DIALECTS

# Nothing heavy is imported here: a process begins with the peak memory of the one that started it.

REPEATS = 3
SMALL, LARGE = 10_000, 100_000

_BEGIN = """
import gc, sys, time
gc.set_threshold(50_000, 20, 50)  # as the command line has it
import pyoxigraph as ox
from collections import deque
from mindstage.knowledge import KnowledgeBase, base
from mindstage.knowledge.graph import graph_of
from mindstage.knowledge.wording.nesting import nested
path = sys.argv[1]
knowledge = KnowledgeBase(bundled_ontology=False)
"""
STEPS: Mapping[str, str] = {
    "bytes": _BEGIN
    + """
data = open(path, "rb").read()
start = time.process_time()
deque(ox.parse(data, ox.RdfFormat.RDF_XML), maxlen=0)
print(time.process_time() - start, 0)
""",
    "parse": _BEGIN
    + """
knowledge.load(path)
(source,) = knowledge._library.sources.values()
start = time.process_time()
graph = nested(graph_of(source.quads(), set()))
print(time.process_time() - start, len(graph))
""",
    "world": _BEGIN
    + """
knowledge.load(path)
read, times = base.read_world, []
def timed(excerpt):
    start = time.process_time()
    world = read(excerpt)
    times.append(time.process_time() - start)
    return world
base.read_world = timed
world = knowledge.world()
print(times[0], len(world.bodies) + len(world.constraints))
""",
    "load": _BEGIN
    + """
start = time.process_time()
knowledge.load(path)
print(time.process_time() - start, len(knowledge.store))
""",
    "read": _BEGIN
    + """
start = time.process_time()
knowledge.load(path)
world = knowledge.world()
print(time.process_time() - start, len(world.bodies) + len(world.constraints))
""",
}


def measure() -> Iterator[Measure]:
    with TemporaryDirectory(prefix="mindstage-") as name:
        folder = Path(name)
        prolog = _prolog(folder)
        for dialect in DIALECTS:
            small = _written(folder / f"{SMALL}.owl", dialect, SMALL)
            yield from _one(dialect, small, prolog)
            if dialect == DIALECTS[0]:
                large = _written(folder / f"{LARGE}.owl", dialect, LARGE)
                yield from _growth(dialect, small, large)
                large.unlink()


def _one(dialect: str, path: Path, prolog: Sequence[str | Path]) -> Iterator[Measure]:
    steps = _timed({name: [sys.executable, "-c", script, path] for name, script in STEPS.items()})
    world, read = steps["world"], steps["read"]
    if world.count != SMALL:
        raise AssertionError(f"{dialect}: {world.count:,} of {SMALL:,} individuals are in the world")
    what = f"{dialect}, {SMALL:,} individuals"
    yield _against(f"{what}: world from graph", world, "the parse", steps["parse"], at_most=2.0)
    yield _against(f"{what}: world from graph", world, "pyoxigraph's parse into nothing", steps["bytes"])
    if not prolog:
        yield Measure(what=f"{what}: load and read", ours=read.seconds, memory_mb=read.memory_mb)
        return
    theirs = _timed({"": [*prolog, path]})[""]
    yield _against(f"{what}: load", steps["load"], _version_of_prolog(), theirs, at_least=1.0)
    yield _against(f"{what}: load and read", read, f"{_version_of_prolog()}, load alone", theirs)


def _growth(dialect: str, small: Path, large: Path) -> Iterator[Measure]:
    for step, what in (("world", "world from graph"), ("read", "load and read")):
        # The large one takes so long that other work of the machine evens out within one run.
        tenfold, one = (
            _timed({"": [sys.executable, "-c", STEPS[step], path]}, repeats=repeats)[""]
            for path, repeats in ((large, 1), (small, REPEATS))
        )
        yield _against(f"{dialect}, {LARGE:,} individuals: {what}", tenfold, f"{SMALL:,} of them", one, at_most=12.0)


def _against(
    what: str, ours: Timed, peer: str, theirs: Timed, *, at_most: float | None = None, at_least: float | None = None
) -> Measure:
    return Measure(
        what=what,
        ours=ours.seconds,
        peer=peer,
        theirs=theirs.seconds,
        at_most=at_most,
        at_least=at_least,
        memory_mb=ours.memory_mb,
        their_memory_mb=theirs.memory_mb,
    )


def _timed(commands: Mapping[str, Sequence[str | Path]], *, repeats: int = REPEATS) -> dict[str, Timed]:
    """The medians of several commands, which take turns."""
    rounds = [{name: once(command) for name, command in commands.items()} for _ in range(repeats)]
    return {
        name: Timed(
            median(each[name].seconds for each in rounds),
            median(each[name].memory_mb for each in rounds),
            rounds[0][name].count,
        )
        for name in commands
    }


def _written(path: Path, dialect: str, individuals: int) -> Path:
    command = [sys.executable, "-m", "benchmarks.large_maps", dialect, str(individuals), path]
    subprocess.run(command, check=True, cwd=Path(__file__).resolve().parent.parent)
    return path


def _prolog(folder: Path) -> Sequence[str | Path]:
    swipl = shutil.which("swipl")
    if swipl is None:
        sys.stderr.write("SWI-Prolog is not installed (Debian's package swi-prolog-nox): no ratio to it\n")
        return ()
    script = folder / "load.pl"
    script.write_text(LOAD_PROLOG.replace("get_time(", "statistics(cputime, "), encoding="utf-8")
    return swipl, script, "--"


def _version_of_prolog() -> str:
    told = subprocess.run(["swipl", "--version"], capture_output=True, text=True, check=True).stdout
    return f"SWI-Prolog {told.split()[2]}"
