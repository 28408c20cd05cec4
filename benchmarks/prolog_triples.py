"""The RDF predicates of the Prolog console, compared with SWI-Prolog's own rdf_db and rdfs over the same statements.

Both run in one process and on one store: `rdf_db` contains the copy that the predicates read. That the answers are the
same is checked by `tests/prolog/test_rdf_mirror.py`.
"""

from __future__ import annotations

from collections.abc import Iterator
from shutil import which

from benchmarks import Measure
from mindstage.engines import NullEngine
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import bundled_kitchen
from mindstage.prolog import PrologConsole
from mindstage.simulation import Simulation

_AT_MOST = 5.0
_MIN_DURATION_S = 0.3
"""How long a goal is repeated for."""
_CHILD = "'http://knowrob.org/kb/knowrob.owl#child'"
_HANDLE = "'http://knowrob.org/kb/knowrob.owl#Handle'"
_THING = "'http://knowrob.org/kb/knowrob.owl#SpatialThing'"
_FRIDGE = "'http://mindstage.org/maps/kitchen.owl#fridge_door'"
GOALS = (
    ("rdf/3, all statements", "rdf(_, _, _)", "rdf_db:rdf(_, _, _)"),
    ("rdf/3, one subject", f"rdf({_FRIDGE}, _, _)", f"rdf_db:rdf({_FRIDGE}, _, _)"),
    ("rdf_has/3, one subject", f"rdf_has({_FRIDGE}, {_CHILD}, _)", f"rdf_db:rdf_has({_FRIDGE}, {_CHILD}, _)"),
    ("rdf_has/3, all subjects", f"rdf_has(_, {_CHILD}, _)", f"rdf_db:rdf_has(_, {_CHILD}, _)"),
    (
        "rdf_has/3 within rdf/3",
        f"rdf(X, {_CHILD}, Y), rdf_has(X, {_CHILD}, Y)",
        f"rdf_db:rdf(X, {_CHILD}, Y), rdf_db:rdf_has(X, {_CHILD}, Y)",
    ),
    (
        "rdfs_individual_of/2, of one class",
        f"rdfs_individual_of(_, {_HANDLE})",
        f"rdfs:rdfs_individual_of(_, {_HANDLE})",
    ),
    (
        "rdfs_individual_of/2, is it one",
        f"rdf(X, {_CHILD}, _), rdfs_individual_of(X, {_THING})",
        f"rdf_db:rdf(X, {_CHILD}, _), once(rdfs:rdfs_individual_of(X, {_THING}))",
    ),
)
"""Name, goal of the console, and goal of SWI-Prolog; also used by the tests, which compare the answers."""


def measure() -> Iterator[Measure]:
    """The time of all answers of each goal."""
    if not which("swipl"):
        return
    knowledge = KnowledgeBase()
    knowledge.load(bundled_kitchen())
    with Simulation(knowledge, NullEngine()) as simulation, PrologConsole(simulation) as console:
        console.holds("mindstage_rdf_mirror:mirrored, use_module(library(semweb/rdfs), [])")
        for what, ours, theirs in GOALS:
            yield Measure(
                what=what,
                ours=seconds(console, ours) * 1e6,
                unit="µs",
                peer="SWI-Prolog's rdf_db",
                theirs=seconds(console, theirs) * 1e6,
                at_most=_AT_MOST,
            )


def seconds(console: PrologConsole, goal: str) -> float:
    """The mean time of all answers of a goal [s]."""
    repetitions = 3
    while (duration_s := _duration(console, goal, repetitions)) < _MIN_DURATION_S:
        repetitions = round(repetitions * min(100.0, 1.5 * _MIN_DURATION_S / max(duration_s, 1e-6)))
    return duration_s / repetitions


def _duration(console: PrologConsole, goal: str, repetitions: int) -> float:
    timed = (
        f"Goal = ({goal}), statistics(cputime, Start), "
        f"forall(between(1, {repetitions}, _), forall(mindstage:Goal, true)), statistics(cputime, End), "
        "Duration is End - Start"
    )
    return float(console.solutions(timed, limit=1, timeout_s=120.0)[0]["Duration"])
