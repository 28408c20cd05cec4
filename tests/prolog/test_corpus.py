"""Small files as KnowRob's users write them: each predicate of the tables is used there, with the answers."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from mindstage.engines import NullEngine
from mindstage.engines.mujoco import MujocoEngine
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import write_map
from mindstage.prolog import PrologConsole
from mindstage.simulation import Simulation
from tests.kitchenette import kitchenette
from tests.knowledge.test_episode_graphs import recording
from tests.prolog.test_knowrob_language import ROWS

CORPUS = Path(__file__).with_name("corpus")
MODULES = ("semweb", "owl", "user_files", "veit2019_compat", "knowrob_objects", "knowrob_language", "episodes")
MODULES = (*MODULES, "plans", "robots")
INTERNAL = {"full_name/3", "bind/2", "described_event/3", "is_episode_event/1", "knowrob_not_here/2"}
"""Exports for other modules of Mindstage."""

TERMS = """
open('{file}', read, In),
repeat,
  read_term(In, Term, [module(user)]),
  ( Term == end_of_file -> !, close(In), fail ; true ),
  sub_term(Goal, Term), callable(Goal), functor(Goal, Name, Arity),
  format(atom(Found), '~w/~w', [Name, Arity])
"""


@pytest.fixture
def episode_console(prolog: Path, tmp_path: Path) -> Iterator[PrologConsole]:
    """A console of the kitchenette with an episode of three seconds."""
    path = tmp_path / "kitchenette.owl"
    path.write_text(write_map(kitchenette()), encoding="utf-8")
    with ExitStack() as stack:
        knowledge = stack.enter_context(KnowledgeBase())
        simulation = stack.enter_context(Simulation(knowledge, NullEngine()))
        knowledge.load(path)
        knowledge.add_episode(recording("run"))
        simulation.spawn()
        yield stack.enter_context(PrologConsole(simulation))


@pytest.fixture
def physics_console(prolog: Path) -> Iterator[PrologConsole]:
    """A console of the kitchenette in MuJoCo."""
    with Simulation(KnowledgeBase(), MujocoEngine(), primitive_shapes=True) as simulation:
        simulation.spawn(kitchenette())
        with PrologConsole(simulation) as console:
            yield console


CONSOLES = {"episodes": "episode_console", "robot": "physics_console"}


@pytest.mark.parametrize(
    "name", ["statements", "ontology", "kitchen", "spawning", "language", "shelf_plans/prolog/packages", *CONSOLES]
)
def test_the_tests_of_a_file_pass(name: str, request: pytest.FixtureRequest, capfd: pytest.CaptureFixture[str]) -> None:
    console: PrologConsole = request.getfixturevalue(CONSOLES.get(name, "console"))
    path = CORPUS / f"{name}.pl"
    assert console.consult(path) == 0, capfd.readouterr().err
    units = re.findall(r"^:- begin_(?:rdf_)?tests\((\w+)", path.read_text(encoding="utf-8"), re.MULTILINE)
    assert units
    for unit in units:
        passed = console.holds(f"run_tests({unit})", timeout_s=300.0)
        assert passed, capfd.readouterr().err


def test_what_is_not_here_is_said_when_it_is_called(kitchen: PrologConsole) -> None:
    assert kitchen.consult(CORPUS / "not_here.pl") == 0
    goal = "needs(_, Goal), catch(Goal, error(existence_error(procedure, Name/Arity), _), true)"
    listed = {predicate for predicate, status, _ in ROWS if status == "not here"}
    assert {f"{row['Name']}/{row['Arity']}" for row in kitchen.solutions(goal)} == listed


def test_every_predicate_of_the_tables_is_used_in_a_file(kitchen: PrologConsole) -> None:
    used: set[str] = set()
    for file in CORPUS.rglob("*.pl"):
        used.update(row["Found"] for row in kitchen.solutions(TERMS.format(file=file), limit=100_000, timeout_s=60.0))
    table = {predicate for predicate, _, _ in ROWS} | {"why/1", "missing/2"}
    for module in MODULES:
        goal = f"module_property(mindstage_{module}, exports(All)), member(Name/Arity, All)"
        table |= {f"{row['Name']}/{row['Arity']}" for row in kitchen.solutions(goal, limit=1000)}
    assert sorted(table - INTERNAL - used) == []
