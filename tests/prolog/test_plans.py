"""Plans in Prolog: `evaluate_plan` with terms and texts, its verdicts, options and errors."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from mindstage.engines.mujoco import MujocoEngine
from mindstage.errors import InvalidArgumentError, PrologGoalError
from mindstage.imagination import Close, Move, Open, Place, Plan, Push, Wait
from mindstage.knowledge import KnowledgeBase
from mindstage.prolog import PrologConsole
from mindstage.prolog.plan_predicates import check_from_term, plan_from_term
from mindstage.prolog.swipl import Atom, Compound
from mindstage.scene import Pose, diff
from mindstage.simulation import Simulation
from tests.cases import each_case
from tests.kitchenette import kitchenette


@pytest.fixture(scope="module")
def console() -> Iterator[PrologConsole]:
    with Simulation(KnowledgeBase(), MujocoEngine(), primitive_shapes=True) as sim:
        sim.spawn(kitchenette())
        with PrologConsole(sim) as console:
            yield console


EDGE = "[move('Mug', to(1.71, 0.2, 0.85, 1, 0, 0, 0)), wait(0.3)]"
"""The edge of the cupboard is at x = 1.7; the mug is 8 cm wide."""


def verdict(console: PrologConsole, goal: str) -> dict[str, object]:
    (found,) = console.solutions(goal)
    return found


def test_a_plan_of_steps_has_a_verdict_and_leaves_the_world_as_it_is(console: PrologConsole) -> None:
    before = console.simulation.snapshot()
    goal = "evaluate_plan([place('Mug', on('Fridge')), open('FridgeDoor'), wait(0.5)], verdict(O, P, N, Why))"
    found = verdict(console, goal)
    assert (found["O"], found["P"], found["N"]) == ("succeeded", 1.0, 1)
    assert str(found["Why"]).startswith("succeeded")
    assert diff(before, console.simulation.snapshot()).identical(0.0)


@pytest.mark.parametrize(
    "text",
    [
        '{"steps": [{"do": "open", "thing": "Drawer"}]}',
        '[{"do": "open", "thing": "Drawer"}]',
        "steps:\\n  - do: open\\n    thing: Drawer\\n",
    ],
)
def test_a_plan_may_be_an_atom_or_string_with_json_or_yaml(console: PrologConsole, text: str) -> None:
    assert console.holds(f"evaluate_plan('{text}', verdict(succeeded, _, _, _))")
    quoted = text.replace('"', '\\"')
    assert console.holds(f'evaluate_plan("{quoted}", verdict(succeeded, _, _, _))')


def test_a_verdict_that_is_not_as_expected_fails(console: PrologConsole) -> None:
    assert not console.holds("evaluate_plan([open('Drawer')], verdict(failed, _, _, _))")


def test_options_give_samples_uncertainty_and_a_check(console: PrologConsole) -> None:
    options = "[samples(10), seed(3), budget(20), uncertainty('Mug', [position_m(0.02)])]"
    goal = f"evaluate_plan({EDGE}, verdict(O, P, N, Why), {options})"
    found = verdict(console, goal)
    assert found["N"] == 10
    assert 0.0 < float(str(found["P"])) < 1.0
    assert found["O"] in {"failed", "unknown"}
    assert verdict(console, goal) == found
    check = "check(where_is(thing='Mug', relation=on, other='Cupboard'))"
    assert console.holds(f"evaluate_plan([wait(0.1)], verdict(succeeded, _, _, _), [{check}])")
    assert console.holds(f"evaluate_plan([place('Mug', on('Fridge'))], verdict(failed, _, _, _), [{check}])")


@each_case(
    ("goal", "message"),
    [
        ("evaluate_plan([open('Nonsense')], _)", r"steps\[0\]\.thing: .*'Nonsense'"),
        ("evaluate_plan('steps:\\n  - do: open\\n    thing: Nonsense', _)", r"the plan:3: steps\[0\]\.thing"),
        ("evaluate_plan([wait(1), hop('Mug')], _)", r"step 2: hop\(Mug\) is no step; there is wait/1"),
        ("evaluate_plan([place('Mug', under('Fridge'))], _)", r"step 1: under\(Fridge\) is no place"),
        ("evaluate_plan([push('Mug', force(1, 2))], _)", r"force\(1, 2\) is no list of 3 numbers"),
        ("evaluate_plan([wait(1)], _, [sample(3)])", r"sample/1 is no option.*samples\(N\)"),
        ("evaluate_plan([wait(1)], _, [check(where_is('Mug'))])", "Mug is no argument with its name"),
        ("evaluate_plan([wait(-1)], _)", "duration_s"),
        ("evaluate_plan([wait(_)], _)", "instantiated"),
        ("evaluate_plan('/etc/passwd', _)", "the plan:1: it is a text"),
    ],
)
def test_what_is_no_plan_is_an_error_with_its_place(console: PrologConsole, goal: str, message: str) -> None:
    with pytest.raises(PrologGoalError, match=message):
        console.solutions(goal)


def test_questions_that_imagine_are_predicates(console: PrologConsole) -> None:
    assert console.holds("stays(_, 'Mug', _, _, _, _, _, _, _)")
    imagined = "what_if(_, 'open Drawer', 'articulated_parts Cupboard', 0.2, _, _, _, A, _, P, _, _, _, _)"
    goal = f"{imagined}, memberchk(state=State, A)"
    (found,) = console.solutions(goal)
    assert found["State"] == "open"
    assert found["P"] == 1.0


def test_untrusted_queries_cannot_try_plans(console: PrologConsole) -> None:
    with pytest.raises(PrologGoalError, match="cannot be asked here"):
        console.answers("evaluate_plan([wait(1)], V)")


def term(name: str, *arguments: object) -> Compound:
    return Compound(name, tuple(arguments))  # type: ignore[arg-type]


def test_each_step_has_a_term() -> None:
    steps = [
        term("place", Atom("a"), term("in", Atom("b"))),
        term("move", Atom("a"), term("by", 0, 0, 1)),
        term("move", Atom("a"), term("to", 0, 0, 1, 1, 0, 0, 0)),
        term("push", Atom("a"), term("force", 1, 2, 3), 0.25),
        term("open", Atom("a"), 0.5),
        term("close", Atom("a")),
        term("wait", 2),
    ]
    assert plan_from_term(steps) == Plan(
        steps=(
            Place(thing="a", into="b"),
            Move(thing="a", by=(0.0, 0.0, 1.0)),
            Move(thing="a", to=Pose((0.0, 0.0, 1.0))),
            Push(thing="a", force=(1.0, 2.0, 3.0), duration_s=0.25),
            Open(thing="a", fraction=0.5),
            Close(thing="a"),
            Wait(duration_s=2.0),
        )
    )


def test_a_negated_check_expects_no_answer() -> None:
    where = term("where_is", term("=", Atom("thing"), Atom("a")))
    assert (check_from_term(where).expect, check_from_term(term("\\+", where)).expect) == ("any", "none")
    with pytest.raises(InvalidArgumentError):
        check_from_term(term("where_is", Atom("a")))
