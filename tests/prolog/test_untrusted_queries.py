"""Untrusted queries: questions and their combinations are allowed, everything else is refused."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from mindstage.errors import PrologGoalError, PrologTimeoutError
from mindstage.prolog import PrologConsole
from mindstage.simulation import Simulation

FRIDGE = "http://mindstage.org/maps/kitchen.owl#fridge"
MANY = f"[{','.join('1' * 1000)}]"


@pytest.fixture
def console(prolog: Path, kitchen_simulation: Simulation) -> Iterator[PrologConsole]:
    with PrologConsole(kitchen_simulation) as console:
        yield console


def test_questions_are_joined(console: PrologConsole) -> None:
    line = "storage_place_in_environment(Map, knowrob:'CowsMilk', Place), openings(Map, Place, State, Front)"
    (row,) = console.answers(line)
    assert (row["Place"], row["State"]) == (FRIDGE, "closed")
    assert row["Front"].endswith("#fridge_door")
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
