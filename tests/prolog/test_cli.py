"""The command `mindstage prolog`."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.prolog.terminal import Terminal

VERB = [sys.executable, "-m", "mindstage", "prolog", "--engine", "null"]
KITCHEN = "bundled:kitchen"


def run(*args: object, typed: str = "", before: str = "") -> subprocess.CompletedProcess[str]:
    """Runs the verb; `before` is Python that is run first in its process."""
    command = [*VERB, *map(str, args)]
    if before:
        script = (
            f"import sys; {before}; sys.argv = ['mindstage', *sys.argv[1:]]; from mindstage.cli import main; main()"
        )
        command = [sys.executable, "-c", script, *command[3:]]
    return subprocess.run(command, input=typed, capture_output=True, text=True, check=False, timeout=120)


@contextmanager
def terminal(*args: str, home: Path) -> Iterator[Terminal]:
    opened = Terminal([*VERB, *args], home=home)
    try:
        yield opened
    finally:
        opened.close()


# -- one goal ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("goal", "code", "out", "err"),
    [
        ("handle_of(_, fridge_door, X), print(X), nl", 0, "kitchen:fridge_door_handle\n", ""),
        ("handle_of(_, milk_carton_1, _)", 1, "", ""),
        ("no_such_thing(1)", 2, "", "cannot be answered: Unknown procedure: no_such_thing/1"),
        ("handle_of(", 2, "", "cannot be answered: Syntax error: "),
        ("write(bye), halt(7)", 7, "bye", ""),
        ("at_halt(write(bye)), write('good '), halt", 0, "good bye", ""),
        ("at_halt(write(bye)), fail", 1, "bye", ""),
    ],
)
def test_the_exit_code_is_the_outcome_of_the_goal(goal: str, code: int, out: str, err: str, prolog: Path) -> None:
    done = run(KITCHEN if "handle_of(_" in goal else "--no-bundled-ontology", "--goal", goal)
    assert (done.returncode, done.stdout) == (code, out)
    assert err in done.stderr
    assert bool(done.stderr) == bool(err)
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("goal", "message"),
    [
        ("between(1, inf, X)", "did not end within 3 s"),
        ("numlist(1, 60, L), foldl([_, A, f(A, A)]>>true, L, a, T)", "a solution has more than 2,000,000 parts"),
        ("numlist(1, 200, N), foldl([_, A, [A]]>>true, N, a, L)", "the term is nested too deeply or cyclic"),
    ],
)
def test_solutions_without_end_or_measure_are_an_error(goal: str, message: str, prolog: Path) -> None:
    done = run("--no-bundled-ontology", "--goal", goal, "--json", "--timeout", "3")
    assert done.returncode == 2, (done.stdout[-300:], done.stderr[-300:])
    assert message in done.stderr
    assert "Traceback" not in done.stderr


def test_all_solutions_as_json(prolog: Path) -> None:
    done = run(KITCHEN, "--json", "-g", "storage_place('Bread', Place, _, Steps)")
    assert done.returncode == 0
    printed = json.loads(done.stdout)
    assert printed["solutions"] == [
        {"Place": "http://mindstage.org/ontology#Breadbasket", "Steps": 0},
        {"Place": "http://knowrob.org/kb/knowrob.owl#Refrigerator", "Steps": 3},
    ]
    assert printed["complete"]
    none = run("--json", "-g", "fail")
    assert (none.returncode, json.loads(none.stdout)["solutions"]) == (1, [])
    assert run("--json").returncode == 2


def test_solutions_beyond_the_limit_are_said_to_be_missing(prolog: Path) -> None:
    done = run("--no-bundled-ontology", "--json", "-g", "repeat", "--limit", 5)
    printed = json.loads(done.stdout)
    assert (done.returncode, printed["solutions"], printed["complete"]) == (0, [{}] * 5, False)
    assert "the search stopped after 5 solutions; there may be more (--limit)" in done.stderr


def test_a_goal_that_takes_too_long_ends_with_2(prolog: Path) -> None:
    done = run("--no-bundled-ontology", "-g", "read(_)", "--timeout", "0.5", typed="")
    assert done.returncode == 0, "the end of the input is an answer"
    done = run("--no-bundled-ontology", "-g", "repeat, fail", "--timeout", "0.5")
    assert done.returncode == 2
    assert "did not end within 0.5 s" in done.stderr


def test_files_are_consulted_first(prolog: Path, tmp_path: Path) -> None:
    good, bad = tmp_path / "good.pl", tmp_path / "bad.pl"
    good.write_text("opens(Door) :- handle_of(_, Door, _).\n", encoding="utf-8")
    bad.write_text("opens(x).\nopens(.\n", encoding="utf-8")
    assert run(KITCHEN, "--consult", good, "-g", "opens(fridge_door)").returncode == 0
    broken = run("--no-bundled-ontology", "--consult", bad, "-g", "opens(x)")
    assert broken.returncode == 2
    assert f"{bad}:2:" in broken.stderr
    assert "1 error in it, printed above" in broken.stderr
    missing = run("--no-bundled-ontology", "--consult", "nowhere.pl", "-g", "true")
    assert missing.returncode == 2
    assert "nowhere.pl: there is no such file" in missing.stderr


@pytest.mark.parametrize(
    "missing",
    [
        "import sys; sys.modules['pyswip'] = None",
        "import os; os.environ |= {'LIBSWIPL_PATH': '/nowhere/libswipl.so', 'SWI_HOME_DIR': '/nowhere'}",
    ],
    ids=["pyswip", "swipl"],
)
def test_missing_packages_are_named_with_their_installation(missing: str, prolog: Path) -> None:
    done = run("-g", "true", before=missing)
    assert done.returncode == 2
    assert done.stderr.startswith("mindstage: error: Prolog is not available: ")
    assert "apt-get install swi-prolog-nox" in done.stderr
    assert "mindstage[prolog]" in done.stderr
    assert done.stderr.count("\n") == 1


# -- the toplevel ------------------------------------------------------------------------------------------------------


def test_the_toplevel_reads_a_pipe(prolog: Path) -> None:
    typed = (
        "storage_place('Bread', Place).\n;\n"
        "handle_of(M, fridge_door, H), \\+ handle_of(M, H, _).\n"
        "highlight(fridge).\n"
        "spawn_semantic_map(M), highlight(fridge).\n"
        "no_such_thing(1).\n"
        "halt(3).\n"
    )
    done = run(KITCHEN, typed=typed)
    assert done.returncode == 3
    for line in ("Place = ms:'Breadbasket'", "Place = knowrob:'Refrigerator'", "H = kitchen:fridge_door_handle."):
        assert line in done.stdout
    assert "fridge cannot be highlighted: it has no body here; spawn_semantic_map(Map)" in done.stderr
    assert "M = kitchen:kitchen." in done.stdout
    assert "Unknown procedure: no_such_thing/1" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_pipe_answers_each_query_also_after_one_with_several_answers(prolog: Path) -> None:
    typed = (
        "member(X, [1, 2]).\nX = second.\nmember(Y, [7, 8, 9]).\n ; ;\n;\nY = last.\n"
        "member(Z, [a, b]). % a comment\n\nZ = (x ; y), true.\nmember(End, [1, 2])."
    )
    done = run("--no-bundled-ontology", typed=typed)
    assert done.returncode == 0
    answers = [line for line in done.stdout.splitlines() if line.strip()]
    assert answers == [
        "X = 1 .",
        "X = second.",
        *("Y = 7 ;", "Y = 8 ;", "Y = 9."),
        "Y = last.",
        "Z = a .",
        "Z = (x;y).",
        "End = 1 .",
    ]
    assert done.stderr.count("a line with ; after a query prints the next one") == 1


def test_the_toplevel_exits_at_the_end_of_input(prolog: Path) -> None:
    done = run(typed="X = 1.\n")
    assert (done.returncode, done.stdout.split()) == (0, ["X", "=", "1."])


def test_the_toplevel_in_a_terminal(prolog: Path, tmp_path: Path) -> None:
    with terminal(KITCHEN, home=tmp_path) as screen:
        screen.wait_for(r"Mindstage .* with kitchen[\s\S]*\?- ")
        screen.type("handle_of(M, fridge_door, H).\n")
        screen.wait_for(r"H = kitchen:fridge_door_handle\.[\s\S]*\?- ")
        screen.type("write(going), nl, repeat, fail.\n")
        screen.wait_for(r"\ngoing\r\n")
        screen.type("\x03")
        screen.wait_for("Action")
        screen.type("a")
        screen.wait_for(r"\?- ")
        screen.type("member(X, [1, 2]).\n")
        screen.wait_for("X = 1 ")
        screen.type(";")
        screen.wait_for(r"X = 2\.[\s\S]*\?- ")
        screen.type("\x1b[A\n")  # the same once more
        screen.wait_for("X = 1 ")
        screen.type("\n")
        screen.wait_for(r"\?- ")
        screen.type("halt.\n")
        assert screen.wait_exit() == 0
    history = [path.read_text(encoding="utf-8") for path in tmp_path.rglob("dir-history/*")]
    assert any("member(X," in text for text in history), "what was typed is kept for the next time"


def test_ctrl_c_ends_a_goal(prolog: Path, tmp_path: Path) -> None:
    with terminal("-g", "write(started), nl, repeat, fail", home=tmp_path) as screen:
        screen.wait_for("started")
        screen.interrupt_until_end()
        assert screen.wait_exit() == 130


def test_the_simulation_can_be_viewed(prolog: Path) -> None:
    done = run(KITCHEN, "--viewer", "--port", 0, typed="spawn_semantic_map(_), highlight(fridge).\nhalt.\n")
    assert done.returncode == 0
    assert "The world is served at http://127.0.0.1:" in done.stderr
    assert "true." in done.stdout
