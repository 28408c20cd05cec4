"""The knowledge base, compared with rdflib and SWI-Prolog: loading maps and ontologies; reading and writing worlds.

Each load runs in a process of its own, which prints the time of the load without start-up and imports. All three load
the same files; the numbers of statements are compared.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import NamedTuple

import mindstage
from benchmarks import REPEATS, Measure

# No heavy imports: the peak memory of a process includes that of its parent at the fork.

SHARED = Path(os.environ.get("MINDSTAGE_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data")
BUNDLED = Path(mindstage.__file__).parent / "maps" / "bundled"

LOAD_OURS = """
import sys, time
from mindstage.knowledge import KnowledgeBase
knowledge = KnowledgeBase(bundled_ontology=False)
start = time.perf_counter()
knowledge.load(sys.argv[1:2], ontologies=sys.argv[2:])
print(time.perf_counter() - start, len(knowledge.store))
"""
LOAD_RDFLIB = """
import sys, time, logging
from rdflib import Graph
logging.disable(logging.WARNING)
graph = Graph()
start = time.perf_counter()
for path in sys.argv[1:]:
    graph.parse(path, format="turtle" if path.endswith(".ttl") else "xml")
print(time.perf_counter() - start, len(graph))
"""
LOAD_PROLOG = """
:- use_module(library(semweb/rdf11)).
:- use_module(library(semweb/turtle)).
load(Path) :- file_name_extension(_, ttl, Path), !, rdf_load(Path, [format(turtle), silent(true)]).
load(Path) :- rdf_load(Path, [format(xml), silent(true)]).
main :- current_prolog_flag(argv, Paths), get_time(Start), forall(member(Path, Paths), load(Path)), get_time(End),
    Seconds is End - Start, aggregate_all(count, rdf(_, _, _), Count), format('~w ~w~n', [Seconds, Count]).
:- initialization((main, halt)).
"""
READ = """
import sys, time
from mindstage.knowledge import KnowledgeBase
start = time.perf_counter()
knowledge = KnowledgeBase(bundled_ontology=False)
knowledge.load(sys.argv[1:])
world = knowledge.world()
print(time.perf_counter() - start, len(world.bodies) + len(world.joints))
"""
WRITE = """
import sys, time
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import write_map
knowledge = KnowledgeBase(bundled_ontology=False)
knowledge.load(sys.argv[1:])
world = knowledge.world()
start = time.perf_counter()
write_map(world)
print(time.perf_counter() - start, len(world.bodies) + len(world.joints))
"""
MULTIPLY = """
import sys
from msgspec.structs import replace
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import save_map
from mindstage.scene import Attachment, BodyId, Iri
small, large, count = sys.argv[1:]
knowledge = KnowledgeBase(bundled_ontology=False)
knowledge.load([small])
world = knowledge.world()
ids = [BodyId(f"body{number}") for number in range(int(count))]
bodies = tuple(
    replace(world.bodies[number % len(world.bodies)], id=id, iri=Iri(f"http://example.org/large.owl#{id}"), facts=())
    for number, id in enumerate(ids)
)
attachments = tuple(Attachment(parent=parent, child=child) for parent, child in zip(ids[::2], ids[1::2]))
save_map(replace(world, bodies=bodies, joints=(), attachments=attachments), large)
"""


class Timed(NamedTuple):
    """The medians of several processes."""

    seconds: float
    memory_mb: float
    count: int
    """The number of statements or individuals that the process printed."""


def measure() -> Iterator[Measure]:
    yield from _loading()
    with TemporaryDirectory(prefix="mindstage-") as folder:
        large = Path(folder, "10,000 bodies.owl")
        subprocess.run([sys.executable, "-c", MULTIPLY, small_map(), large, "10000"], check=True)
        for path, most in ((small_map(), None), (large, 2.0)):
            for verb, script in (("read", READ), ("write", WRITE)):
                (timed,) = _timed([sys.executable, "-c", script, path])
                what = f"{verb} {path.stem} ({timed.count:,} individuals)"
                yield Measure(what=what, ours=timed.seconds, at_most=most, memory_mb=timed.memory_mb)


def _loading() -> Iterator[Measure]:
    map, *ontologies = files = _sources()
    with TemporaryDirectory(prefix="mindstage-") as folder:
        script = Path(folder, "load.pl")
        script.write_text(LOAD_PROLOG, encoding="utf-8")
        commands: dict[str, Sequence[str | Path]] = {
            "ours": [sys.executable, "-c", LOAD_OURS, *files],
            f"rdflib {version('rdflib')}": [sys.executable, "-c", LOAD_RDFLIB, *files],
        }
        if swipl := shutil.which("swipl"):
            name = subprocess.run([swipl, "--version"], capture_output=True, text=True, check=True).stdout.split()[2]
            commands[f"SWI-Prolog {name}"] = [swipl, script, "--", *files]
        else:
            sys.stderr.write("SWI-Prolog is not installed (Debian: swi-prolog-nox); skipped\n")
        ours, *others = _timed(*commands.values())
    what = f"load {map.stem} with {len(ontologies)} ontologies ({ours.count:,} statements)"
    for peer, theirs, at_least in zip([*commands][1:], others, (15.0, 3.0), strict=False):
        yield _against(what, ours, theirs, peer, at_least=at_least)


def _against(what: str, ours: Timed, theirs: Timed, peer: str, *, at_least: float) -> Measure:
    # Mindstage has a named graph for each file, so that a statement in two files counts twice.
    if not 0.9 * ours.count <= theirs.count <= ours.count:
        raise AssertionError(f"{peer} has {theirs.count} statements and we have {ours.count}")
    return Measure(
        what=what,
        ours=ours.seconds,
        peer=peer,
        theirs=theirs.seconds,
        at_least=at_least,
        memory_mb=ours.memory_mb,
        their_memory_mb=theirs.memory_mb,
    )


def _sources() -> Sequence[Path]:
    if (SHARED / "maps").is_dir():
        return small_map(), *sorted((SHARED / "ontology").glob("*/owl/*.owl"))
    return small_map(), BUNDLED / "household.ttl"


def small_map() -> Path:
    path = SHARED / "maps" / "iai-kitchen-original.owl"
    return path if path.is_file() else BUNDLED / "kitchen.owl"


def _timed(*commands: Sequence[str | Path]) -> list[Timed]:
    """The medians of several commands, which alternate, so that other load affects all equally."""
    for command in commands:
        once(command)  # warm-up
    rounds = [[once(command) for command in commands] for _ in range(REPEATS)]
    return [
        Timed(median(run.seconds for run in runs), median(run.memory_mb for run in runs), runs[0].count)
        for runs in zip(*rounds, strict=True)
    ]


def once(command: Sequence[str | Path]) -> Timed:
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert process.stdout is not None
    output = process.stdout.read()
    # Only wait4 returns the peak memory of this child alone.
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    process.stdout.close()
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, list(map(str, command)))
    seconds, count = output.split()
    return Timed(float(seconds), usage.ru_maxrss / 1024, int(count))
