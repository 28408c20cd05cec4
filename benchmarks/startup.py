"""Start-up: importing Mindstage, printing the help, checking a map in a new process."""

from __future__ import annotations

import sys
from collections.abc import Iterator

from benchmarks import Measure, median_runs
from mindstage.maps.io.files import bundled_kitchen, bundled_ontology

# The libraries that `mindstage check` needs.
_LIBRARIES = "import numpy, scipy.spatial, msgspec, pyoxigraph, mujoco, typer, rich.console, rich.table"


def measure() -> Iterator[Measure]:
    python = [sys.executable, "-c"]
    mindstage = [sys.executable, "-m", "mindstage"]

    bare, package, shown = median_runs([*python, "pass"], [*python, "import mindstage"], [*mindstage, "--help"])
    yield Measure(
        what="import mindstage, without starting Python",
        ours=1000 * (package.seconds - bare.seconds),
        unit="ms",
        at_most=50.0,
        memory_mb=package.memory_mb,
        their_memory_mb=bare.memory_mb,
    )

    yield Measure(
        what="mindstage --help", ours=1000 * shown.seconds, unit="ms", at_most=300.0, memory_mb=shown.memory_mb
    )

    # The same ontology and map, loaded into SWI-Prolog's own store.
    files = [(bundled_ontology(), "turtle"), (bundled_kitchen(), "xml")]
    loads = ", ".join(f"rdf_load('{path}', [format({format}), silent(true)])" for path, format in files)
    load = f"use_module(library(semweb/rdf11)), use_module(library(semweb/turtle)), {loads}"
    swipl = ["swipl", "-g", load, "-t", "halt"]
    kitchen = ["--map", "bundled:kitchen"]
    for what, args, at_most in (
        ("ask storage_place", ["ask", "storage_place", "CowsMilk", *kitchen], 1.5),
        ("ask where_is", ["ask", "where_is", "milk_carton_1", *kitchen], 1.5),
        ("ask a sentence", ["ask", "where", "is", "the", "milk?", *kitchen], 1.5),
        ("sparql", ["sparql", "ASK { ?whole knowrob:child ?part }", *kitchen], 1.5),
        ("prolog --goal", ["prolog", "--goal", "storage_place(knowrob:'CowsMilk', _)", "bundled:kitchen"], None),
    ):
        theirs, ours = median_runs(swipl, [*mindstage, *args])
        yield Measure(
            what=f"mindstage {what}, bundled kitchen, new process",
            ours=ours.seconds,
            peer="swipl -t halt with rdf11 and the same two files loaded",
            theirs=theirs.seconds,
            at_most=at_most,
            memory_mb=ours.memory_mb,
            their_memory_mb=theirs.memory_mb,
        )

    libraries, check = median_runs([*python, _LIBRARIES], [*mindstage, "check", "bundled:kitchen"])
    yield Measure(
        what="mindstage check bundled:kitchen, new process",
        ours=check.seconds,
        peer="importing its libraries",
        theirs=libraries.seconds,
        at_most=2.0,
        memory_mb=check.memory_mb,
        their_memory_mb=libraries.memory_mb,
    )
