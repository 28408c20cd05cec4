"""Persistent stores of a million statements, compared with parsing them; queries in worker processes.

Each measurement runs in a process of its own, without the time of start-up and imports.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from benchmarks import Measure
from benchmarks.knowledge import BUNDLED, Timed, once, small_map

COPIES = 310
"""Copies of the map of the thesis, a million statements."""
REPEATS = 3

OPEN = """
import sys, time, glob
from mindstage.knowledge import KnowledgeBase
folder, maps, question = sys.argv[1:]
start = time.perf_counter()
knowledge = KnowledgeBase(store=folder or None)
knowledge.load(sorted(glob.glob(maps + "/*")) if maps else [])
opened = time.perf_counter()
if question == "world":
    knowledge.world(knowledge.maps()[-1])
elif question:
    knowledge.ask(*question.split()[:1], **dict(pair.split("=") for pair in question.split()[1:]))
asked = time.perf_counter()
print(asked - (opened if question else start), len(knowledge.store))
"""
QUERY = """
import sys, time
from statistics import median
from mindstage.knowledge import KnowledgeBase
from mindstage.errors import SparqlTimeoutError
folder, maps, query, timeout = sys.argv[1:]
knowledge = KnowledgeBase(store=folder or None)
if maps:
    knowledge.load(maps)
def seconds():
    start = time.perf_counter()
    try:
        knowledge.sparql(query, timeout_s=float(timeout))
    except SparqlTimeoutError:
        pass
    return time.perf_counter() - start
first = seconds()
again = median(seconds() for _ in range(1 if float(timeout) < 30 else 99))
print(first, again)
"""
ENDLESS = "SELECT (COUNT(*) AS ?n) { ?a ?b ?c . ?d ?e ?f . ?g ?h ?i }"


def measure() -> Iterator[Measure]:
    with TemporaryDirectory(prefix="mindstage-") as folder:
        maps, store = Path(folder, "maps"), Path(folder, "store")
        copy(small_map(), maps)
        filled = timed(store, maps)
        parsed, reopened = timed("", maps), timed(store)
        assert parsed.count == reopened.count == filled.count
        many = f"{parsed.count / 1e6:.2g} million statements"
        yield Measure(
            what=f"reopen {many}",
            ours=reopened.seconds,
            peer="parsing them",
            theirs=parsed.seconds,
            at_least=10.0,
            memory_mb=reopened.memory_mb,
            their_memory_mb=parsed.memory_mb,
        )
        yield Measure(what=f"fill a store with {many}", ours=filled.seconds, memory_mb=filled.memory_mb)
        for question in ("storage_place item=CowsMilk", "world"):
            there, here = timed(store, question=question), timed("", maps, question=question)
            yield Measure(
                what=f"first {question} of {many}, in a store",
                ours=there.seconds,
                peer="in memory",
                theirs=here.seconds,
                memory_mb=there.memory_mb,
                their_memory_mb=here.memory_mb,
            )
        kitchen = BUNDLED / "kitchen.owl"
        # The first query of a store folder starts a process; in memory the process is forked.
        for where, args, start_s in (
            ("of the kitchen", ("", str(kitchen)), 0.1),
            (f"of {many}, in a store", (str(store), ""), 0.5),
        ):
            first, again = queried(*args, "ASK {}", 30.0)
            yield Measure(what=f"first query {where}", ours=first, at_most=start_s)
            yield Measure(what=f"next query {where}", ours=again, at_most=0.005)
            _, stopped = queried(*args, ENDLESS, 1.0)
            yield Measure(what=f"endless query {where}, stopped after 1 s", ours=stopped, at_most=1.0 + start_s)


def copy(map: Path, folder: Path) -> None:
    """Copies of a map, each with its own IRIs."""
    folder.mkdir()
    text = map.read_text(encoding="utf-8")
    name = next(word for word in ("UE-IAI-Kitchen", "mindstage.org/maps/kitchen") if word in text)
    for number in range(COPIES):
        named = text.replace(name, f"{name}-{number}")
        Path(folder, f"{number:03}.owl").write_text(named, encoding="utf-8")


def timed(store: Path | str = "", maps: Path | str = "", question: str = "") -> Timed:
    command: Sequence[str | Path] = [sys.executable, "-c", OPEN, str(store), str(maps), question]
    if store and maps:
        return once(command)  # a store is filled once
    # Parsing everything takes long enough to average over other load.
    runs = [once(command) for _ in range(1 if maps else REPEATS)]
    return Timed(median(run.seconds for run in runs), median(run.memory_mb for run in runs), runs[0].count)


def queried(store: str, maps: str, query: str, timeout_s: float) -> tuple[float, float]:
    """The times of the first query of a process, and of later ones [s]."""
    command = [sys.executable, "-c", QUERY, store, maps, query, str(timeout_s)]
    runs = [
        tuple(map(float, subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout.split()))
        for _ in range(REPEATS)
    ]
    first, again = (median(each) for each in zip(*runs, strict=True))
    return first, again
