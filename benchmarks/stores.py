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
TO_ONE_FILE = """
import sys
from pathlib import Path
import pyoxigraph as ox
format = ox.RdfFormat.from_extension(Path(sys.argv[2]).suffix[1:])
with open(sys.argv[2], "wb") as file:
    for path in sorted(Path(sys.argv[1]).iterdir()):
        quads = ox.parse(path=path, format=ox.RdfFormat.RDF_XML, base_iri=path.as_uri(), rename_blank_nodes=True)
        graph = ox.NamedNode(path.as_uri())
        statements = (ox.Quad(*quad.triple, graph) if format.supports_datasets else quad.triple for quad in quads)
        ox.serialize(statements, file, format=format)
"""
ENGINE = """
import sys, time
import pyoxigraph as ox
store = ox.Store(sys.argv[2])
start = time.perf_counter()
store.bulk_load(path=sys.argv[1])
store.flush()
print(time.perf_counter() - start, len(store))
"""
FILL = """
import sys, time
from mindstage.knowledge import KnowledgeBase
start = time.perf_counter()
with KnowledgeBase(store=sys.argv[2]) as knowledge:
    knowledge.load((), ontologies=sys.argv[1])
    count = len(knowledge.store)
print(time.perf_counter() - start, count)
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
        graphs = Path(folder, "graphs.nq")
        subprocess.run([sys.executable, "-c", TO_ONE_FILE, maps, graphs], check=True)
        engine = once([sys.executable, "-c", ENGINE, graphs, Path(folder, "engine-of-graphs")])
        yield Measure(
            what=f"fill a store with {many} in {COPIES} files, and index it",
            ours=filled.seconds,
            peer="Store.bulk_load of pyoxigraph, of one file of N-Quads with the same graphs",
            theirs=engine.seconds,
            at_most=2.0,
            memory_mb=filled.memory_mb,
            their_memory_mb=engine.memory_mb,
        )
        yield from _filling(Path(folder), maps)
        for question in ("storage_place item=CowsMilk", "world"):
            there, here = timed(store, question=question), timed("", maps, question=question)
            yield Measure(
                what=f"first {question} of {many}, in a store",
                ours=there.seconds,
                peer="in memory",
                theirs=here.seconds,
                at_most=0.1 if question.startswith("storage") else None,
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


def _filling(folder: Path, maps: Path) -> Iterator[Measure]:
    """Fills a store with one file of N-Triples, and lets the engine load the same file."""
    path = folder / "all.nt"
    subprocess.run([sys.executable, "-c", TO_ONE_FILE, maps, path], check=True)
    engine = once([sys.executable, "-c", ENGINE, path, folder / "engine"])
    ours = once([sys.executable, "-c", FILL, path, folder / "ours"])
    yield Measure(
        what=f"fill a store with {engine.count / 1e6:.2g} million N-Triples, and index it",
        ours=ours.seconds,
        peer="Store.bulk_load of pyoxigraph",
        theirs=engine.seconds,
        at_most=2.0,
        memory_mb=ours.memory_mb,
        their_memory_mb=engine.memory_mb,
    )
    first = once([sys.executable, "-c", OPEN, folder / "ours", "", "storage_place item=CowsMilk"])
    yield Measure(what="first question over it", ours=first.seconds, at_most=1.0, memory_mb=first.memory_mb)


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
