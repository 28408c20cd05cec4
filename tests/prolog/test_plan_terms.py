"""Plans, options, checks and skills from Prolog terms, without Prolog: each term and what it means, or its error."""

from __future__ import annotations

from typing import Any

import pytest

from mindstage.errors import InvalidArgumentError
from mindstage.imagination import Check, Move, Open, Place, Plan, Pull, Push, Uncertainty, Wait
from mindstage.imagination.plans import Attach, ChangePhysics, Close, Detach, Perform, PlanStep
from mindstage.prolog.plan_predicates import check_from_term, plan_from_term, skill_from_term, trial_options
from mindstage.prolog.swipl import Atom, Compound, Value
from mindstage.scene import Pose
from tests.cases import each_case

MUG, TABLE = Atom("mug"), Atom("table")


def term(name: str, *arguments: Value) -> Compound:
    return Compound(name, arguments)


def steps_of(value: Value) -> tuple[PlanStep, ...]:
    plan = plan_from_term(value)
    assert isinstance(plan, Plan)
    return plan.steps


@each_case(
    ("value", "step"),
    [
        (term("wait", 2), Wait(duration_s=2.0)),
        (term("open", MUG), Open(thing="mug")),
        (term("open", "mug", 0.25), Open(thing="mug", fraction=0.25)),
        (term("close", MUG), Close(thing="mug")),
        (term("attach", TABLE, MUG), Attach(parent="table", child="mug")),
        (term("detach", MUG), Detach(child="mug")),
        (term("place", MUG, term("on", TABLE)), Place(thing="mug", on="table")),
        (term("place", MUG, term("in", TABLE)), Place(thing="mug", into="table")),
        (term("place", MUG, term("into", TABLE)), Place(thing="mug", into="table")),
        (term("move", MUG, term("by", 1, 2.5, -3)), Move(thing="mug", by=(1.0, 2.5, -3.0))),
        (
            term("move", MUG, term("to", 1, 2, 3, 0, 0, 0, 1)),
            Move(thing="mug", to=Pose((1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0))),
        ),
        (term("pull", MUG, [1, 2, 3]), Pull(thing="mug", target=(1.0, 2.0, 3.0))),
        (
            term("pull", MUG, [1, 2, 3], term("p", 4, 5, 6)),
            Pull(thing="mug", target=(1.0, 2.0, 3.0), point=(4.0, 5.0, 6.0)),
        ),
        (term("push", MUG, [1, 2, 3]), Push(thing="mug", force=(1.0, 2.0, 3.0))),
        (term("push", MUG, [1, 2, 3], 0.75), Push(thing="mug", force=(1.0, 2.0, 3.0), duration_s=0.75)),
        (
            term("set_physics", MUG, [term("mass_kg", 2), term("=", Atom("gravity"), False)]),
            ChangePhysics(thing="mug", mass_kg=2.0, gravity=False),
        ),
        (term("perform", Atom("park")), Perform(skill="park")),
        (
            term("perform", Atom("tiago"), term("open", MUG)),
            Perform(skill="open", args={"thing": "mug"}, robot="tiago"),
        ),
    ],
)
def test_each_step_has_its_arguments_in_their_fields(value: Compound, step: PlanStep) -> None:
    assert steps_of(value) == (step,)
    assert steps_of([term("wait", 1), value, term("wait", 3)]) == (Wait(duration_s=1.0), step, Wait(duration_s=3.0))


def test_a_text_is_a_plan_in_json_or_yaml() -> None:
    found = plan_from_term("steps:\n  - {do: wait, duration_s: 4}\n")
    assert not isinstance(found, Plan)
    assert found.plan.steps == (Wait(duration_s=4.0),)


@each_case(
    ("value", "message"),
    [
        ([], "the plan: .* is neither a list of steps nor a text"),
        (5, "5 is neither a list of steps nor a text"),
        ([term("wait", 1), term("fly", MUG)], r"step 2: fly\(mug\) is no step; there is wait/1, open/1, open/2"),
        ([term("wait", 1, 2)], r"step 1: wait\(1, 2\) is no step"),
        ([MUG], "step 1: mug is no step"),
        ([term("place", MUG, TABLE)], r"step 1: table is no place; give on\(Holder\) or in\(Holder\)"),
        ([term("place", MUG, term("by", 1, 2, 3))], r"by\(1, 2, 3\) is no place"),
        ([term("move", MUG, term("on", TABLE))], r"on\(table\) is no place; give by\(X, Y, Z\)"),
        ([term("move", MUG, term("by", 1, 2))], r"step 1: \(?\[?1, 2\]?\)? is no list of 3 numbers"),
        ([term("move", MUG, term("to", 1, 2, 3))], "no list of 7 numbers"),
        ([term("pull", MUG, [1, MUG, 3])], r"\[1, mug, 3\] is no list of 3 numbers"),
        ([term("pull", MUG, "abc")], "abc is no list of 3 numbers"),
        ([term("place", MUG, term("on", 5))], "5 is not a name"),
        ([term("set_physics", MUG, [TABLE])], "step 1: table is no option"),
        ([term("set_physics", MUG, [term("mass_kg", 1, 2)])], r"step 1: mass_kg\(1, 2\)"),
        ([term("set_physics", MUG, [term("mass_kg", -1)])], "the plan: .*0.* - at `"),
        ([term("wait", MUG)], r"the plan: Expected `float`, got `str` - at `\$.steps\[0\].duration_s`"),
        ([term("perform", Atom("fly"))], "perform: there is no skill 'fly'"),
    ],
)
def test_what_is_no_plan_is_named_with_the_number_of_its_step(value: Value, message: str) -> None:
    with pytest.raises(InvalidArgumentError, match=message):
        plan_from_term(value)


@each_case(
    ("value", "expected"),
    [
        ([], {"budget_s": 20.0, "uncertainty": []}),
        (term("samples", 7), {"budget_s": 20.0, "uncertainty": [], "samples": 7}),
        (
            [term("samples", 7), term("seed", 3), term("workers", 2), term("budget", 5), term("threshold", 0.5)],
            {"budget_s": 5.0, "uncertainty": [], "samples": 7, "seed": 3, "workers": 2, "threshold": 0.5},
        ),
        ([term("=", Atom("seed"), 9)], {"budget_s": 20.0, "uncertainty": [], "seed": 9}),
        (
            [
                term("uncertainty", MUG, [term("yaw_rad", 0.5), term("=", Atom("mass"), 0.1)]),
                term("uncertainty", TABLE, term("position_m", 0.02)),
            ],
            {
                "budget_s": 20.0,
                "uncertainty": [
                    Uncertainty(thing="mug", yaw_rad=0.5, mass=0.1),
                    Uncertainty(thing="table", position_m=0.02),
                ],
            },
        ),
        (
            [term("check", term("where_is", term("=", Atom("thing"), MUG)))],
            {"budget_s": 20.0, "uncertainty": [], "check": Check(question="where_is", args={"thing": "mug"})},
        ),
    ],
)
def test_options_have_their_values(value: Value, expected: dict[str, Any]) -> None:
    assert trial_options(value, "evaluate_plan") == expected


@each_case(
    ("value", "message"),
    [
        (MUG, "evaluate_plan: mug is no option; there is samples"),
        ([term("samples", 2.5)], "samples/1 is no option with such values"),
        ([term("samples", 2, 3)], "samples/2 is no option"),
        ([term("speed", 2)], "speed/1 is no option"),
        ([term("budget", MUG)], "budget/1 is no option"),
        ([term("uncertainty", MUG)], "uncertainty/1 is no option"),
        ([term("uncertainty", MUG, [term("weight", 1)])], "uncertainty: .*weight"),
        ([term("uncertainty", MUG, [term("mass", 1, 2)])], r"mass\(1, 2\)"),
        ([term("uncertainty", 5, [])], "5 is not a name"),
    ],
)
def test_what_is_no_option_is_named_with_the_predicate(value: Value, message: str) -> None:
    with pytest.raises(InvalidArgumentError, match=message):
        trial_options(value, "evaluate_plan")


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (Atom("articulated_parts"), Check(question="articulated_parts", expect="any")),
        (term("\\+", Atom("articulated_parts")), Check(question="articulated_parts", expect="none")),
        (
            term("\\+", term("where_is", term("=", Atom("thing"), MUG), term("=", Atom("top"), 3))),
            Check(question="where_is", args={"thing": "mug", "top": 3}, expect="none"),
        ),
    ],
)
def test_a_check_is_a_question_with_named_arguments_or_its_negation(value: Value, expected: Check) -> None:
    assert check_from_term(value) == expected


def test_an_argument_of_a_check_without_a_name_is_refused() -> None:
    for argument in (MUG, term("thing", MUG), term("=", Atom("thing"), MUG, TABLE)):
        with pytest.raises(InvalidArgumentError, match="is no argument with its name"):
            check_from_term(term("where_is", argument))
    with pytest.raises(InvalidArgumentError, match="5 is not a name"):
        check_from_term(5)


@pytest.mark.parametrize(
    "value",
    [
        term("place", MUG, TABLE),
        term("place", MUG, term("on", TABLE)),
        term("place", MUG, term("=", Atom("on"), TABLE)),
        term("place", term("on", TABLE), term("thing", MUG)),
    ],
)
def test_arguments_of_skills_are_given_by_order_or_by_name(value: Compound) -> None:
    name, args = skill_from_term(value)
    assert name == "place"
    assert (args["thing"], args["on"]) == ("mug", "table")


def test_in_is_another_word_for_into() -> None:
    for word in ("in", "into"):
        assert skill_from_term(term("place", MUG, term(word, TABLE)))[1]["into"] == "table"


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (term("opn", MUG), "perform: there is no skill 'opn'.*open"),
        (term("park", *[1] * 9), "arguments are too many; it takes"),
        (term("place", MUG, term("thing", TABLE)), "thing is given twice"),
        (5, "5 is not a name"),
    ],
)
def test_what_is_no_skill_is_named(value: Value, message: str) -> None:
    with pytest.raises(InvalidArgumentError, match=message):
        skill_from_term(value)
