"""The Prolog console from Python: solutions, errors, time limits, threads and files."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import msgspec
import pytest

from mindstage.access.limits import REQUEST_PARTS
from mindstage.errors import PrologGoalError, PrologTimeoutError, PrologUnavailableError, SourceParseError
from mindstage.prolog import PrologConsole
from mindstage.prolog.swipl import Compound
from mindstage.simulation import Simulation
from tests.cases import each_case


def test_solutions_come_in_prolog_s_order(kitchen: PrologConsole) -> None:
    assert kitchen.solutions("member(X, [c, a, b]), _Hidden = 1.") == [{"X": "c"}, {"X": "a"}, {"X": "b"}]


@each_case(
    ("value", "expected"),
    [
        ("atom", "atom"),
        ('"a string"', "a string"),
        ("'ünï ✓ \\u0000 end'", "ünï ✓ \0 end"),
        ("-12", -12),
        ("123456789012345678901234567890", 123456789012345678901234567890),
        ("0.1", 0.1),
        ("[1, [a, 2.5], []]", [1, ["a", 2.5], []]),
        ("f(x, 'Y')", "f(x,'Y')"),
        ("_", None),
        ("[a|_]", "[a|_]"),
        ("point{x: 1}", "point{x:1}"),
        ("knowrob:'Handle'", "knowrob:'Handle'"),
    ],
)
def test_values_are_plain(value: str, expected: Any, kitchen: PrologConsole) -> None:
    (row,) = kitchen.solutions(f"X = {value}")
    if isinstance(row["X"], str) and row["X"].startswith("[a|_"):
        row["X"] = "[a|_]"  # the name of the variable differs
    assert row == {"X": expected}


@pytest.mark.parametrize(
    ("goal", "complete"), [("between(1, inf, X)", False), ("between(1, 3, X)", True), ("member(X, [1, 2])", True)]
)
def test_a_limit_of_solutions_that_cut_some_off_is_said(goal: str, complete: bool, kitchen: PrologConsole) -> None:
    found = kitchen.solutions(goal, limit=3)
    assert found == [{"X": number} for number in range(1, len(found) + 1)]
    assert found.complete is complete
    assert kitchen.solutions(goal.replace("inf", "2000"), limit=5000).complete
    queried = kitchen.answers("member(X, [1, 2, 3, 4])", limit=3)
    assert (queried, queried.complete) == ([{"X": 1}, {"X": 2}, {"X": 3}], False)


def test_a_search_does_not_go_beyond_its_limit(kitchen: PrologConsole) -> None:
    found = kitchen.solutions("( X = 1 ; repeat, fail )", limit=1, timeout_s=60.0)
    assert (found, found.complete) == ([{"X": 1}], False)


def test_the_time_limit_includes_the_conversion_of_the_solutions(
    kitchen: PrologConsole, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = iter(range(0, 10**9, 1000))  # each look at the clock is 1,000 s after the last one
    monkeypatch.setattr("mindstage.prolog.console.time.monotonic", lambda: float(next(clock)))
    with pytest.raises(PrologTimeoutError, match="did not end within 30 s"):
        kitchen.solutions("between(1, 5, X)")


def test_numbers_and_variables_of_every_kind_are_converted(kitchen: PrologConsole) -> None:
    for number in (2**62, -(2**63), 2**63, 2**64 - 1, 2**100, -5):
        assert kitchen.solutions(f"X is {number}") == [{"X": number}]
    (row,) = kitchen.solutions("X is 2 ** 100000")
    assert len(row["X"]) == 30103, "more digits than Python converts to a number"
    assert kitchen.solutions("freeze(X, true), dif(Y, a), Z = b") == [{"X": None, "Y": None, "Z": "b"}]
    assert "<stream>" in kitchen.solutions("open_null_stream(S)")[0]["S"]


def test_all_solutions_together_have_a_limit_while_they_are_found(kitchen: PrologConsole) -> None:
    with pytest.raises(PrologGoalError, match="the text of the solutions is too long; ask for less"):
        kitchen.answers("A = [1, 2, 3, 4, 5, 6, 7, 8, 9], member(_, _), member(_, [a, b])", limit=10**6)


def test_the_message_about_a_large_term_is_short(kitchen: PrologConsole) -> None:
    with pytest.raises(PrologGoalError, match="Type error") as refused:
        kitchen.solutions("numlist(1, 900000, L), atom_length(f(L), _)")
    assert len(str(refused.value)) < 3000
    with pytest.raises(PrologGoalError, match="Type error") as refused:
        kitchen.answers(f"A = '{'a' * 3000}', sort(f(A, A, A, A), L)")
    assert len(refused.value.cause) < 2100


@pytest.mark.parametrize("goal", ["repeat, fail", "length(L, N), fail", "sleep(60)", "thread_get_message(never)"])
def test_a_goal_has_a_time_limit(goal: str, kitchen: PrologConsole) -> None:
    with pytest.raises(PrologTimeoutError, match=r"did not end within 0\.2 s"):
        kitchen.solutions(goal, timeout_s=0.2)
    assert kitchen.holds("true")


@each_case(
    ("goal", "message"),
    [
        ("foo(", "Syntax error"),
        ("foo(1) bar", "Syntax error"),
        ("", "Syntax error"),
        ("X", "not sufficiently instantiated"),
        ("no_such_predicate(1)", r"Unknown procedure: no_such_predicate/1"),
        ("handle_of(_, _)", r"Unknown procedure: handle_of/2.*handle_of/3"),
        ("X is a + 1", "Arithmetic"),
        ("throw(my_own(ball))", "my_own"),
        ("X = f(X), highlight(X)", "acyclic"),
    ],
)
def test_an_error_has_the_message_of_prolog(goal: str, message: str, kitchen: PrologConsole) -> None:
    with pytest.raises(PrologGoalError, match=message) as refused:
        kitchen.solutions(goal)
    assert refused.value.error_type == "prolog"
    assert kitchen.holds("true")


def test_a_deep_term_is_an_error(kitchen: PrologConsole) -> None:
    with pytest.raises(PrologGoalError, match="nested too deeply"):
        kitchen.solutions("numlist(1, 100000, L), foldl([_, A, f(A)]>>true, L, x, Deep), highlight(Deep)")


def test_a_request_that_is_too_large_is_an_error(kitchen: PrologConsole, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mindstage.prolog.console.REQUEST_PARTS", msgspec.structs.replace(REQUEST_PARTS, maximum=1000))
    with pytest.raises(PrologGoalError, match="the term is too large"):
        kitchen.solutions("numlist(1, 1000, Large), highlight(Large)")


def test_a_defect_in_python_is_an_error_in_prolog(kitchen: PrologConsole, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kitchen, "handlers", {"rows": lambda name, given: 1 / 0})
    assert kitchen.holds("catch(map_instance(_), mindstage_error(defect, S), sub_string(S, _, _, _, 'report'))")
    monkeypatch.setattr(kitchen, "handlers", {"rows": lambda name, given: [Compound("odd", (object(),))]})  # type: ignore[arg-type]
    with pytest.raises(PrologGoalError) as refused:
        kitchen.holds("map_instance(_)")
    assert refused.value.error_type == "defect"


def test_ctrl_c_inside_python_ends_the_goal(kitchen: PrologConsole, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(kitchen, "handlers", {"rows": interrupted})
    with pytest.raises(KeyboardInterrupt):
        kitchen.holds("map_instance(_)")


def test_other_threads_may_query(kitchen: PrologConsole) -> None:
    answers: list[object] = []
    threads = [
        threading.Thread(target=lambda: answers.append(kitchen.solutions("handle_of(_, fridge_door, X)")))
        for _ in range(3)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert len(answers) == 3
    assert all(answer == answers[0] and answer for answer in answers)


def test_threads_of_prolog_may_query(kitchen: PrologConsole) -> None:
    assert kitchen.holds("concurrent_maplist([T]>>once(handle_of(_, T, _)), [fridge_door, oven_door, fridge])")


def test_there_is_one_console_at_a_time(kitchen: PrologConsole, kitchen_simulation: Simulation) -> None:
    with pytest.raises(PrologUnavailableError, match="another console is open in this process; close it first"):
        PrologConsole(kitchen_simulation)
    kitchen.close()
    kitchen.close()
    with PrologConsole(kitchen_simulation) as another:
        assert another.holds("map_instance(_)")


@pytest.mark.parametrize(("limit", "timeout_s"), [(0, 1.0), (1, 0.0), (1, float("inf")), (1, float("nan"))])
def test_limits_must_be_positive_and_finite(limit: int, timeout_s: float, kitchen: PrologConsole) -> None:
    with pytest.raises(ValueError, match=r"(limit|timeout_s) .*: it must be"):
        kitchen.solutions("true", limit=limit, timeout_s=timeout_s)


# -- files -------------------------------------------------------------------------------------------------------------


def test_a_file_s_errors_are_counted(kitchen: PrologConsole, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "broken.pl"
    file.write_text("good_fact(1).\nbad fact.\ngood_fact(2).\nworse(.\n", encoding="utf-8")
    assert kitchen.consult(file) == 2
    assert f"{file}:2:" in capfd.readouterr().err
    assert kitchen.solutions("good_fact(X)") == [{"X": 1}, {"X": 2}]
    assert kitchen.holds(f"unload_file('{file}')")


def test_a_missing_file_cannot_be_consulted(kitchen: PrologConsole) -> None:
    with pytest.raises(SourceParseError, match=r"nowhere\.pl: there is no such file"):
        kitchen.consult("nowhere.pl")


def test_definitions_of_users_take_precedence(kitchen: PrologConsole, tmp_path: Path) -> None:
    file = tmp_path / "own.pl"
    file.write_text("siblings(tick, trick).\n", encoding="utf-8")
    assert kitchen.consult(file) == 0
    assert kitchen.solutions("siblings(X, _)") == [{"X": "tick"}]
    kitchen.holds(f"unload_file('{file}'), abolish(siblings/2)")
