"""Robots in Prolog: they are added, perform skills and designated actions, and are asked for their abilities."""

from __future__ import annotations

from collections.abc import Generator, Iterator

import pytest

from mindstage.engines.mujoco import MujocoEngine
from mindstage.errors import InvalidArgumentError, PrologGoalError
from mindstage.knowledge import KnowledgeBase
from mindstage.prolog import PrologConsole
from mindstage.prolog.plan_predicates import skill_from_term
from mindstage.prolog.swipl import Atom, Compound
from mindstage.registry import Group, added
from mindstage.robots import find_robot
from mindstage.robots.skill_declaration import ThingName, skill
from mindstage.robots.skill_task import SkillTask
from mindstage.simulation import Simulation
from tests.cases import each_case
from tests.kitchenette import kitchenette


@skill(needs=())
def pick(task: SkillTask, thing: ThingName) -> Generator[float, None, None]:
    """Succeeds for the mug only.

    Args:
        thing: what is picked.
    """
    yield 0.1
    if thing != "Mug":
        raise task.failure(f"{thing} is too heavy", "try the mug")
    task.assume("the mug is empty")


@pytest.fixture(scope="module")
def console() -> Iterator[PrologConsole]:
    with Simulation(KnowledgeBase(), MujocoEngine(), primitive_shapes=True) as sim:
        sim.spawn(kitchenette())
        with PrologConsole(sim) as console:
            assert console.solutions("robot(R)") == []
            (found,) = console.solutions("add_robot(mobile_manipulator, at(-0.5, 0.5), R)")
            assert found["R"] == "mobile_manipulator"
            yield console


@pytest.fixture
def fake_pick() -> Iterator[None]:
    """A skill of known behavior in place of the real one."""
    with added(Group.SKILLS, "pick", pick):
        yield


def result(console: PrologConsole, goal: str) -> tuple[object, str, object]:
    (found,) = console.solutions(f"{goal}, Result = result(Outcome, Why, Seconds)")
    return found["Outcome"], str(found["Why"]), found["Seconds"]


def test_an_added_robot_stands_where_it_was_put(console: PrologConsole) -> None:
    assert find_robot(console.simulation).base_pose() == pytest.approx((-0.5, 0.5, 0.0), abs=1e-3)
    assert [each["R"] for each in console.solutions("robot(R)")] == ["mobile_manipulator"]


@pytest.mark.usefixtures("fake_pick")
@pytest.mark.parametrize(
    "action",
    [
        "pick('Mug')",
        "pick(thing='Mug')",
        "pick(thing('Mug'))",
        "[pick('Mug'), pick('Mug')]",
        "[an, action, [type, 'picking-up'], [object, [an, object, [name, 'Mug']]]]",
        '\'{"an": "action", "type": "picking-up", "object": {"the": "object", "type": "Cup"}}\'',
    ],
)
def test_skills_and_designators_are_performed(console: PrologConsole, action: str) -> None:
    before_s = console.simulation.state.time_s
    outcome, why, seconds = result(console, f"perform({action}, Result)")
    assert (outcome, why) == ("succeeded", "assumed: the mug is empty") or action.startswith("[pick")
    assert outcome == "succeeded"
    assert isinstance(seconds, float)
    assert console.simulation.state.time_s - before_s == pytest.approx(seconds)


@pytest.mark.usefixtures("fake_pick")
def test_a_failed_skill_says_why(console: PrologConsole) -> None:
    outcome, why, _ = result(console, "perform(pick('Fridge'), Result)")
    assert outcome == "failed"
    assert "Fridge is too heavy" in why


@pytest.mark.usefixtures("fake_pick")
def test_what_is_improbable_is_not_done(console: PrologConsole) -> None:
    before_s = console.simulation.state.time_s
    outcome, why, seconds = result(console, "perform(pick('Fridge'), Result, [try_first(0.9)])")
    assert (outcome, seconds) == ("not_done", 0.0)
    assert "at least 0.90 is required" in why
    assert console.simulation.state.time_s == before_s
    options = "[try_first(0.5), samples(2), uncertainty('Mug', [position_m(0.001)]), robot(mobile_manipulator)]"
    assert result(console, f"perform(pick('Mug'), Result, {options})")[0] in {"succeeded", "not_done"}


@pytest.mark.usefixtures("fake_pick")
def test_plans_may_contain_skills(console: PrologConsole) -> None:
    assert console.holds("evaluate_plan([perform(pick('Mug')), wait(0.1)], verdict(succeeded, _, _, _))")
    assert console.holds("evaluate_plan([perform(mobile_manipulator, pick('Drawer'))], verdict(failed, _, _, _))")


@each_case(
    ("goal", "message"),
    [
        ("perform(fly('Mug'), R)", "there is no skill 'fly'"),
        ("perform(pick, R)", "thing is missing"),
        ("perform(pick(a, b), R)", "2 arguments are too many"),
        ("perform(pick('Nonsense'), R)", "Nonsense"),
        ("perform(park, R, [robot(r2d2)])", "no robot 'r2d2'"),
        ("perform(park, R, [samples(3)])", r"add try_first\(P\)"),
        ("perform(park, R, [sample(3), try_first(0.5)])", "sample/1 is no option"),
        ("perform([an, action, [type, flying]], R)", "'flying' is unknown"),
        ("perform(X, R)", "instantiated"),
        ("add_robot(mobile_manipulator, at(here), R)", r"give at\(X, Y\)"),
    ],
)
def test_what_is_no_action_is_an_error(console: PrologConsole, goal: str, message: str) -> None:
    with pytest.raises(PrologGoalError, match=message):
        console.solutions(goal)


def test_a_model_that_is_unknown_is_an_error(console: PrologConsole) -> None:
    with pytest.raises(PrologGoalError, match="r2d2"):
        console.solutions("add_robot(r2d2, R)")


def test_abilities_are_asked_in_the_terms_of_srdl(console: PrologConsole) -> None:
    feasible = console.solutions("action_feasible_on_robot(A, mobile_manipulator)")
    names = {str(each["A"]).rpartition("#")[2] for each in feasible}
    assert {"PickingUpAnObject", "StoringSomething", "OpeningADrawer"} <= names
    assert console.holds("action_feasible_on_robot(knowrob:'PickingUpAnObject', mobile_manipulator)")
    assert not console.holds("missing_comp_for_action(knowrob:'PickingUpAnObject', mobile_manipulator, _)")
    assert console.holds("can(mobile_manipulator, knowrob:'OpeningADoor')")


def test_untrusted_queries_cannot_move_robots(console: PrologConsole) -> None:
    for goal in ("perform(park, R)", "add_robot(mobile_manipulator, R)"):
        with pytest.raises(PrologGoalError, match="cannot be asked here"):
            console.answers(goal)


def test_the_arguments_of_a_skill_are_those_of_its_term() -> None:
    on_table = skill_from_term(Compound("place", (Atom("milk"), Compound("on", (Atom("table"),)))))
    assert on_table == ("place", {"thing": "milk", "on": "table"})
    inside = skill_from_term(Compound("place", (Atom("milk"), Compound("in", (Atom("fridge"),)))))
    assert inside == ("place", {"thing": "milk", "into": "fridge"})
    there = Compound("go_to", (Compound("=", (Atom("x"), 1)), Compound("=", (Atom("y"), 0.5))))
    assert skill_from_term(there) == ("go_to", {"x": 1.0, "y": 0.5})
    with pytest.raises(InvalidArgumentError, match="thing is given twice"):
        skill_from_term(Compound("pick", (Atom("a"), Compound("=", (Atom("thing"), Atom("b"))))))
