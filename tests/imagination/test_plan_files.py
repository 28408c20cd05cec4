"""Plans as JSON and YAML: round trips, the schema, and errors that name the line."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path

import jsonschema
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from mindstage.errors import PlanError
from mindstage.imagination import (
    Attach,
    ChangePhysics,
    Check,
    Close,
    Detach,
    EventKind,
    Move,
    Open,
    Perform,
    Place,
    Plan,
    PlanBuilder,
    Pull,
    Push,
    Uncertainty,
    Wait,
    dump_plan,
    load_plan,
    plan_schema,
)
from mindstage.scene import Mobility, Pose
from tests.cases import each_case

numbers = st.floats(-1e6, 1e6, allow_nan=False) | st.integers(-10, 10).map(float)
positive = st.floats(1e-3, 3600.0)
durations = st.floats(1e-3, 3600.0)
vectors = st.tuples(numbers, numbers, numbers)
# YAML's words for truth values, numbers and nothing are names, too.
texts = st.text(min_size=1, max_size=12) | st.sampled_from(
    ["on", "off", "yes", "no", "true", "null", "1e3", "1:20", "~", "0x1"]
)
values = texts | numbers | st.booleans()
arguments = st.dictionaries(texts, values, max_size=3)
checks = st.builds(
    Check, question=texts, args=arguments, expect=st.sampled_from(["any", "none"]) | arguments.filter(bool)
)
poses = st.builds(Pose, vectors, st.just((0.5, 0.5, -0.5, 0.5)))
steps = st.one_of(
    st.builds(Place, thing=texts, on=texts, deadline_s=positive),
    st.builds(Move, thing=texts, to=poses),
    st.builds(Move, thing=texts, by=vectors),
    st.builds(Pull, thing=texts, target=vectors, point=vectors),
    st.builds(Push, thing=texts, force=vectors, point=st.none() | vectors, duration_s=durations),
    st.builds(Open, thing=texts, fraction=st.floats(0, 1)),
    st.builds(Close, thing=texts),
    st.builds(Wait, duration_s=durations),
    st.builds(Attach, parent=texts, child=texts),
    st.builds(Detach, child=texts),
    st.builds(
        Perform,
        skill=texts,
        args=st.dictionaries(texts, texts | numbers, max_size=2),
        robot=st.sampled_from(["", "robot_1"]),
    ),
    st.builds(
        ChangePhysics, thing=texts, mass_kg=st.none() | positive, mobility=st.none() | st.sampled_from(list(Mobility))
    ),
)
deviations = st.floats(0, 100)
uncertainties = st.builds(
    Uncertainty,
    thing=texts,
    position_m=deviations | st.tuples(deviations, deviations, deviations),
    yaw_rad=deviations,
    mass=deviations,
)
plans = st.builds(
    Plan,
    steps=st.lists(steps, max_size=4).map(tuple),
    name=st.text(max_size=8),
    uncertainty=st.lists(uncertainties, max_size=2).map(tuple),
    check=st.none() | checks,
    until=st.none() | checks,
    deadline_s=st.none() | positive,
    forbid=st.lists(st.sampled_from(list(EventKind)), max_size=3).map(tuple),
)


@given(plan=plans, format=st.sampled_from(["json", "yaml"]))
@example(plan=Plan(steps=(), name="a\x85b"), format="yaml")
def test_a_plan_that_was_written_is_read_unchanged_and_follows_the_schema(plan: Plan, format: str) -> None:
    text = dump_plan(plan, format=format)
    assert load_plan(text).plan == plan
    if format == "json":
        jsonschema.Draft202012Validator(plan_schema()).validate(json.loads(text))


def test_the_schema_is_valid_and_refuses_what_is_refused() -> None:
    jsonschema.Draft202012Validator.check_schema(plan_schema())
    validator = jsonschema.Draft202012Validator(plan_schema())
    for content in ({}, {"steps": [{"do": "fly"}]}, {"steps": [{"do": "wait", "duration_s": 0}]}):
        assert not validator.is_valid(content)
        with pytest.raises(PlanError):
            load_plan(json.dumps(content))


YAML = """\
# Is the milk safe there?
name: milk
steps:
  - do: place
    thing: milk_carton_1
    on: table
  - {do: wait, duration_s: 1e0}
uncertainty:
  - thing: milk_carton_1
    position_m: [0.01, 0.02, 0]
check:
  question: where_is
  args: {thing: milk_carton_1}
  expect: {other: table, relation: on}
"""


def test_yaml_is_read_from_a_file(tmp_path: Path) -> None:
    path = tmp_path / "plan.yaml"
    path.write_text(YAML)
    assert load_plan(path).plan == Plan(
        name="milk",
        steps=(Place(thing="milk_carton_1", on="table"), Wait(duration_s=1.0)),
        uncertainty=(Uncertainty(thing="milk_carton_1", position_m=(0.01, 0.02, 0.0)),),
        check=Check(question="where_is", args={"thing": "milk_carton_1"}, expect={"other": "table", "relation": "on"}),
    )


def test_the_builder_gives_the_plan_of_the_file() -> None:
    built = (
        PlanBuilder("milk")
        .place("milk_carton_1", on="table")
        .wait(1.0)
        .uncertain("milk_carton_1", position_m=(0.01, 0.02, 0.0))
        .check("where_is", thing="milk_carton_1", expect={"other": "table", "relation": "on"})
        .build()
    )
    assert built == load_plan(YAML).plan


def test_each_method_of_the_builder_adds_its_step_with_all_fields() -> None:
    pose = Pose((1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0))
    built = (
        PlanBuilder("all")
        .place("a", on="b", deadline_s=1.5)
        .place("a", into="c")
        .move("a", to=pose, deadline_s=2.5)
        .move("a", by=(1.0, 2.0, 3.0))
        .pull("a", target=(1.0, 2.0, 3.0), point=(4.0, 5.0, 6.0), deadline_s=3.5)
        .push("a", force=(1.0, 2.0, 3.0), point=(4.0, 5.0, 6.0), duration_s=0.25, deadline_s=4.5)
        .open("a", fraction=0.25, deadline_s=5.5)
        .close("a", deadline_s=6.5)
        .wait(2.0)
        .wait(20.0)
        .wait(20.0, deadline_s=7.5)
        .attach("a", to="b")
        .detach("a")
        .change_physics("a", mass_kg=2.0, mobility=Mobility.STATIC, gravity=False, deadline_s=10.5)
        .perform("grasp", robot="r", deadline_s=11.5, thing="a", arm="left")
        .perform("park")
        .uncertain("a", yaw_rad=0.5)
        .uncertain("b", mass=0.25)
        .check("where_is", thing="a", expect="none")
        .until("on", thing="b")
        .forbid("fell", "tipped")
        .deadline(12.5)
        .build()
    )
    assert built == Plan(
        name="all",
        steps=(
            Place(thing="a", on="b", deadline_s=1.5),
            Place(thing="a", into="c"),
            Move(thing="a", to=pose, deadline_s=2.5),
            Move(thing="a", by=(1.0, 2.0, 3.0)),
            Pull(thing="a", target=(1.0, 2.0, 3.0), point=(4.0, 5.0, 6.0), deadline_s=3.5),
            Push(thing="a", force=(1.0, 2.0, 3.0), point=(4.0, 5.0, 6.0), duration_s=0.25, deadline_s=4.5),
            Open(thing="a", fraction=0.25, deadline_s=5.5),
            Close(thing="a", deadline_s=6.5),
            Wait(duration_s=2.0),
            Wait(duration_s=20.0),
            Wait(duration_s=20.0, deadline_s=7.5),
            Attach(parent="b", child="a"),
            Detach(child="a"),
            ChangePhysics(thing="a", mass_kg=2.0, mobility=Mobility.STATIC, gravity=False, deadline_s=10.5),
            Perform(skill="grasp", robot="r", deadline_s=11.5, args={"thing": "a", "arm": "left"}),
            Perform(skill="park", deadline_s=300.0),
        ),
        uncertainty=(Uncertainty(thing="a", yaw_rad=0.5), Uncertainty(thing="b", mass=0.25)),
        check=Check(question="where_is", args={"thing": "a"}, expect="none"),
        until=Check(question="on", args={"thing": "b"}),
        forbid=("fell", "tipped"),  # type: ignore[arg-type]
        deadline_s=12.5,
    )
    for format in ("yaml", "json"):
        assert load_plan(dump_plan(built, format=format)).plan == built


@each_case(
    ("text", "value"),
    [
        ("on", "on"),
        ("no", "no"),
        ("1:30", "1:30"),
        ("0o17", "0o17"),
        ("'5'", "5"),
        ("5", 5.0),
        ("-5", -5.0),
        ("+1.5e2", 150.0),
        (".5", 0.5),
        ("1e3", 1000.0),
        ("5 m", "5 m"),
    ],
)
def test_scalars_are_those_of_yaml_1_2(text: str, value: object) -> None:
    plan = load_plan(f"steps:\n  - do: perform\n    skill: s\n    args: {{a: {text}}}\n").plan
    (step,) = plan.steps
    assert isinstance(step, Perform)
    assert step.args == {"a": value}


@each_case(
    ("text", "message"),
    [
        (
            "steps:\n  - do: wait\n    duration_s: 1\n    duration_s: 2\n",
            r"the plan:4: steps\[0\].duration_s: .*occurs twice",
        ),
        ("steps: &a\n  - do: wait\n    duration_s: 1\nforbid: *a\n", r"the plan:4: aliases are refused: \*a"),
        ("steps: !!set {a}\n# \n", r"the plan:1.*(tag|steps)"),
        ("? [a]\n: 1\n", "the plan:1: a key must be a text"),
        ("- 1\n- 2\n", "the plan:1: it is a list; a plan is an object with the key `steps`"),
        ("just\na text\n", "the plan:1: it is a text"),
        ("\n", "the plan:1: it is empty"),
        (
            "steps:\n  - {do: wait, duration_s: 1}\n" + "a: " + "[" * 30 + "]" * 30 + "\n",
            "the plan:3: more than 30 levels",
        ),
        ("steps:\n  - {do: wait, duration_s: 1}\n" + "a: " + "[" * 29 + "]" * 29 + "\n", "unknown field `a`"),
        ('{"steps": [], "steps": []}', "the key occurs twice"),
    ],
)
def test_what_yaml_allows_and_plans_do_not_is_refused_with_its_line(text: str, message: str) -> None:
    with pytest.raises(PlanError, match=message):
        load_plan(text)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("do: place", "do: plac", r"plan.yaml:4: steps\[0\].do: .*'plac'"),
        ("thing: milk_carton_1\n    on", "thin: milk_carton_1\n    on", r"plan.yaml:4: steps\[0\]: .*(thin|thing)"),
        ("duration_s: 1e0", "duration_s: -1", r"plan.yaml:7: steps\[1\].duration_s: .*> 0"),
        ("duration_s: 1e0", "duration_s: 1e308", r"plan.yaml:7: steps\[1\].duration_s: .*<= 3600"),
        ("duration_s: 1e0", "duration_s: soon", r"plan.yaml:7: steps\[1\].duration_s: .*str"),
        ("[0.01, 0.02, 0]", "[0.01, 0.02]", r"plan.yaml:10: uncertainty\[0\].position_m"),
        ("on: table", "on: [table", r"plan.yaml:\d+: neither JSON nor YAML"),
        ("on: table", "on: table\n    on: shelf", r"plan.yaml:7: steps\[0\].on: the key occurs twice"),
        ("thing: milk_carton_1\n    on", "thing: &a milk_carton_1\n    name: *a\n    on", r"plan.yaml:6: aliases"),
        ("on: table", "on: !!python/name:os.system x", r"plan.yaml:6: steps\[0\].on: the tag .* is refused"),
        ("name: milk", "nam: milk", r"plan.yaml:2: .*`nam`"),
        (YAML, "", "plan.yaml:1: it is empty"),
        (YAML, "- wait\n- more\n", "plan.yaml:1: it is a list"),
        (YAML, "{\n" + "[" * 5000, "plan.yaml:2: more than 30 levels"),
        (YAML, "x" * 100_001, r"plan.yaml: it has 100,001 characters"),
    ],
)
def test_an_error_names_the_line_the_part_and_the_cause(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = tmp_path / "plan.yaml"
    assert old in YAML
    path.write_text(YAML.replace(old, new, 1))
    with pytest.raises(PlanError, match=message):
        load_plan(path)


def test_json_errors_name_the_line_too() -> None:
    text = json.dumps({"steps": [{"do": "wait", "duration_s": 1}, {"do": "wait"}]}, indent=2)
    with pytest.raises(PlanError, match=r"goal:7: steps\[1\]: .*duration_s"):
        load_plan(text, name="goal")
    with pytest.raises(PlanError, match=r"the plan:\d+: neither JSON nor YAML"):
        load_plan('{"steps": [}')


def test_a_missing_or_unreadable_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(PlanError, match=r"nothing.yaml: it cannot be read: No such file"):
        load_plan(tmp_path / "nothing.yaml")
    (tmp_path / "latin.yaml").write_bytes(b"name: K\xfcche\nsteps: []\n")
    with pytest.raises(PlanError, match="not UTF-8"):
        load_plan(tmp_path / "latin.yaml")


@given(text=st.text(alphabet="abc:-{}[]\"'\n #&*!|>0123456789.,", max_size=200))
def test_no_text_causes_another_error(text: str) -> None:
    with suppress(PlanError):
        load_plan(text + "\n")
