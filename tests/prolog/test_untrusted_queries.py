"""Untrusted queries: questions and their combinations are allowed, everything else is refused."""

from __future__ import annotations

import resource
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mindstage.errors import PrologGoalError, PrologTimeoutError
from mindstage.prolog import PrologConsole
from mindstage.prolog.console import solve_query
from mindstage.simulation import Simulation

FRIDGE = "http://mindstage.org/maps/kitchen.owl#fridge"
MANY = f"[{','.join('1' * 1000)}]"


@pytest.fixture
def console(prolog: Path, kitchen_simulation: Simulation) -> Iterator[PrologConsole]:
    with PrologConsole(kitchen_simulation) as console:
        yield console


def test_questions_are_joined(console: PrologConsole) -> None:
    line = "storage_place_in_environment(Map, knowrob:'CowsMilk', Place), articulated_parts(Map, Place, State, Part)"
    (row,) = console.answers(line)
    assert (row["Place"], row["State"]) == (FRIDGE, "closed")
    assert row["Part"].endswith("#fridge_door")
    assert console.answers("likely_storage_place(knowrob:'CowsMilk', Class).")[0]["Class"].endswith("#Refrigerator")


@pytest.mark.parametrize(
    ("line", "rows"),
    [
        ("X = 1 ; X = 2", [{"X": 1}, {"X": 2}]),
        ("member(X, [3, 1, 2]), X > 1, \\+ X = 3", [{"X": 2}]),
        ("( storage_place('CowsMilk', _) -> X = kept ; X = nowhere )", [{"X": "kept"}]),
        ("findall(P, storage_place('CowsMilk', P), L), length(L, N), L = [P]", [{"N": 1}]),
        ("aggregate_all(count, member(_, [a, b]), N)", [{"N": 2}]),
        ("forall(member(X, [1, 2]), X < 3), sort([b, a, b], L)", [{"L": ["a", "b"]}]),
        ("1 =:= 1.0, a @< b, a \\== b", [{}]),
        ("fail", []),
        ("X = text, X > 1", []),
        ("X = f(X)", []),
        ("X = f(X), storage_place(X, Y)", []),
    ],
)
def test_answers_are_joined_as_prolog_does(console: PrologConsole, line: str, rows: list[dict[str, object]]) -> None:
    found = console.answers(line)
    assert [{name: row[name] for name in wanted} for row, wanted in zip(found, rows, strict=True)] == rows


@pytest.mark.parametrize(
    "line",
    [
        "shell(ls)",
        "user:shell(ls)",
        "system:shell(ls)",
        "mindstage:storage_place(X, Y)",
        "call(shell(ls))",
        "G = shell(ls), G",
        "G = shell(ls), call(G)",
        "G = shell(ls), \\+ G",
        "findall(X, shell(X), L)",
        "forall(member(G, [halt]), G)",
        "aggregate_all(max(X), member(X, [1]), M)",
        "aggregate_all(count, halt, N)",
        "( true -> halt ; true )",
        "open('/etc/passwd', read, S)",
        "read_term(X, [])",
        "consult('/etc/passwd')",
        "['/etc/passwd']",
        "assertz(storage_place(a, b))",
        "retractall(described(_, _))",
        "set_prolog_flag(stack_limit, 1)",
        "python(rows(maps, [_]), R)",
        "mindstage_questions:python(x, Y)",
        "request(spawn(x), Y)",
        "spawn_semantic_map(M)",
        "highlight(x)",
        "why(storage_place(X, Y))",
        "X is 2 ** 3",
        "format('~w', [x])",
        "thread_create(halt, _)",
        "halt",
        "{|html||x|}",
        "Line",
        "1",
        '"text"',
        ":- halt",
        "a --> b",
        "X = 1, !",
    ],
)
def test_goals_that_are_not_allowed_are_refused_before_anything_runs(console: PrologConsole, line: str) -> None:
    with pytest.raises(PrologGoalError, match=r"cannot be asked here|must not be a variable"):
        console.answers(f"member(X, [1, 2, 3]), {line}" if not line.startswith((":-", "a -->")) else line)


def test_every_question_is_allowed_in_untrusted_queries(console: PrologConsole) -> None:
    assert console.answers("maps(Map)") == console.solutions("maps(Map)")
    assert console.answers("storage_place(Item, 'Refrigerator')", limit=5000) == console.solutions(
        "storage_place(Item, 'Refrigerator')", limit=5000
    )


def test_invalid_and_overlong_queries_are_refused(console: PrologConsole) -> None:
    with pytest.raises(PrologGoalError, match="Syntax error"):
        console.answers("storage_place(")
    with pytest.raises(PrologGoalError, match="Syntax error"):
        console.answers("")
    with pytest.raises(PrologGoalError, match="at most 4000 characters, not 5000"):
        console.answers("a" * 5000)
    with pytest.raises(PrologGoalError, match="nested too deeply"):
        console.answers(f"storage_place({'f(' * 1200}a{')' * 1200}, Place)")


def test_time_inferences_and_memory_of_a_query_are_limited(console: PrologConsole) -> None:
    with pytest.raises(PrologTimeoutError):
        console.answers("maps(M), everything_in_map(M, _), everything_in_map(M, _), fail", timeout_s=0.5)
    with pytest.raises(PrologGoalError, match="the query takes more than 5,000,000 inferences"):
        console.answers(f"L = {MANY}, member(_, L), member(_, L), member(_, L), fail", timeout_s=60.0)
    with pytest.raises(PrologGoalError, match="the memory limit was exceeded"):
        console.answers(f"L = {MANY}, findall(L, (member(_, L), member(_, L)), All)", timeout_s=60.0)
    doubled = ", ".join(f"{one} = [{','.join([other] * 90)}]" for one, other in zip("BCDE", "ABCD", strict=True))
    with pytest.raises(PrologGoalError, match="the memory limit was exceeded"):
        console.answers(f"A = text, {doubled}, storage_place(E, Place)", timeout_s=60.0)
    assert len(console.answers("member(X, _)", limit=7)) == 7
    assert console.answers("X = 1") == [{"X": 1}]


# -- terms that double -------------------------------------------------------------------------------------------------


def doubled(levels: int, *, end: str = "a") -> str:
    """Unifications that make A0 a term of 2^levels parts, which Prolog stores in `levels` cells."""
    return ", ".join([*_doublings(levels), f"A{levels} = {end}"])


def _doublings(levels: int) -> list[str]:
    return [f"A{at} = f(A{at + 1}, A{at + 1})" for at in range(levels)]


@pytest.mark.parametrize(
    "line",
    [
        doubled(60),
        doubled(60, end="_"),
        ", ".join(["A60 = a", *reversed(_doublings(60))]),
        f"{doubled(60)}, findall(A0, member(_, [1, 2]), L)",
        f"findall(A0, ({doubled(60)}), L)",
        f"{doubled(14)}, findall(L, (member(_, [1, 2]), L = [A0, A0, A0, A0, A0, A0, A0, A0]), M), N = f(M, M)",
        f"{doubled(60)}, storage_place(A0, Place)",
        f"{doubled(60)}, A0 == B",
        f"{doubled(60)}, msort([A0, A0], L)",
        f"{doubled(60)}, \\+ A0 = A1",
        "X = [Y, Y], Y = [Z, Z], member(Z, [[A, A]]), member(A, [[B, B]]), " + doubled(30).replace("A", "B"),
        "findall(X, member(X, [1, 2]), L), " + doubled(20, end="L"),
        doubled(14, end="[B, B, B, B, B, B, B, B]"),
    ],
)
def test_a_term_that_doubles_is_refused_while_it_is_small(console: PrologConsole, line: str) -> None:
    before = peak_memory()
    with pytest.raises(PrologGoalError, match="the memory limit was exceeded"):
        console.answers(line, timeout_s=60.0)
    assert peak_memory() - before < 200 * 1024**2
    assert console.answers("X = 1") == [{"X": 1}]


def test_wide_terms_and_long_texts_are_refused(console: PrologConsole) -> None:
    with pytest.raises(PrologGoalError, match="f has 17 arguments, and a term of a query has at most 16"):
        console.answers(f"X = f({','.join('a' * 17)})")
    long = "a" * 1500
    with pytest.raises(PrologGoalError, match="the text of the solutions is too long; ask for less"):
        console.answers(f"X = {long}, Y = f(X, X, X, X, X, X, X, X), {doubled(10, end='Y')}")


_VARIABLES = ("A", "B", "C", "D", "_")
_terms = st.recursive(
    st.sampled_from([*_VARIABLES, "1", "a", "'Milk'", '"text"', "[]"]),
    lambda inner: st.one_of(
        st.lists(inner, min_size=1, max_size=4).map(lambda parts: f"f({', '.join(parts)})"),
        st.lists(inner, min_size=1, max_size=4).map(lambda parts: f"[{', '.join(parts)}]"),
        st.tuples(inner, inner).map(lambda parts: f"[{parts[0]}|{parts[1]}]"),
    ),
    max_leaves=6,
)
_simple_goals = st.one_of(
    st.tuples(st.sampled_from(_VARIABLES), _terms).map(" = ".join),
    st.tuples(_terms, st.sampled_from([" = ", " == ", " @< ", " \\= ", " < "]), _terms).map("".join),
    st.tuples(_terms, _terms).map(lambda parts: f"member({parts[0]}, {parts[1]})"),
    st.tuples(_terms, _terms).map(lambda parts: f"storage_place({parts[0]}, {parts[1]})"),
    st.sampled_from(["msort(A, B)", "sort(B, A)", "length(A, B)", "maps(A)", "memberchk(A, B)", "nonvar(A)"]),
)
_goals = st.recursive(
    _simple_goals,
    lambda inner: st.one_of(
        st.lists(inner, min_size=2, max_size=6).map(lambda goals: f"({', '.join(goals)})"),
        st.tuples(inner, inner).map(lambda goals: f"({goals[0]} ; {goals[1]})"),
        st.tuples(inner, inner).map(lambda goals: f"({goals[0]} -> {goals[1]} ; true)"),
        inner.map(lambda goal: f"\\+ {goal}"),
        st.tuples(_terms, inner).map(lambda parts: f"findall({parts[0]}, {parts[1]}, A)"),
        st.tuples(inner, inner).map(lambda goals: f"forall({goals[0]}, {goals[1]})"),
        st.tuples(st.sampled_from(_VARIABLES), inner).map(
            lambda parts: f"aggregate_all(count, {parts[1]}, {parts[0]})"
        ),
    ),
    max_leaves=8,
)


@settings(max_examples=80, deadline=None, suppress_health_check=list(HealthCheck))
@given(goals=st.lists(_goals, min_size=1, max_size=12), end=st.integers(0, 40))
def test_generated_queries_end_within_their_limits(goals: list[str], end: int, console: PrologConsole) -> None:
    line = ", ".join([*goals, doubled(end, end="A")])[:3900].rsplit(",", 1)[0]
    before = peak_memory()
    try:
        rows = console.answers(line, limit=100, timeout_s=2.0)
    except (PrologGoalError, PrologTimeoutError):
        rows = []
    assert len(rows) <= 100
    assert peak_memory() - before < 400 * 1024**2, line


def peak_memory() -> int:
    """The maximum resident size of this process so far [bytes]."""
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return used if sys.platform == "darwin" else used * 1024


def test_a_query_that_waits_for_another_one_ends_at_its_timeout(
    prolog: Path, kitchen_simulation: Simulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    from mindstage.prolog import console as module

    lock = threading.Lock()
    monkeypatch.setattr(module, "_query_lock", lock)
    with lock, pytest.raises(PrologTimeoutError, match=r"0\.05 s"):
        solve_query(kitchen_simulation, "maps(M)", limit=1, timeout_s=0.05)
    assert solve_query(kitchen_simulation, "maps(M)", limit=1, timeout_s=30.0)
