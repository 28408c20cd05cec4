"""Designators of CRAM in three notations become skills, with the bodies that fit their descriptions."""

from __future__ import annotations

import json
from collections.abc import Iterator
from math import pi
from typing import Any

import pytest

from mindstage.engines import NullEngine
from mindstage.errors import AmbiguousNameError, InvalidArgumentError, NameNotFoundError
from mindstage.knowledge import KnowledgeBase
from mindstage.maps import bundled_kitchen
from mindstage.robots.skills import skill_specs
from mindstage.robots.skills.designators import ACTION_TYPES, DesignatedSkill, read_designator
from mindstage.simulation import Simulation
from tests.cases import each_case


@pytest.fixture(scope="module")
def kitchen() -> Iterator[Simulation]:
    knowledge = KnowledgeBase()
    knowledge.load(bundled_kitchen())
    with knowledge, Simulation(knowledge, NullEngine(), threaded=False) as sim:
        sim.spawn()
        yield sim


def read(kitchen: Simulation, type: str, **properties: Any) -> DesignatedSkill:
    return read_designator({"an": "action", "type": type, **properties}, kitchen)


JUICE = {"the": "object", "type": "OrangeJuiceCarton"}


@each_case(
    ("type", "properties", "skill", "args"),
    [
        ("picking-up", {"object": JUICE}, "pick", {"thing": "orange_juice_carton_1"}),
        ("grasping", {"object": "orange_juice_carton_1"}, "grasp", {"thing": "orange_juice_carton_1"}),
        ("releasing", {}, "release", {}),
        ("parking-arms", {}, "park", {}),
        ("opening", {"object": "fridge_door", "degree": 0.5}, "open", {"thing": "fridge_door", "fraction": 0.5}),
        ("accessing", {"object": {"the": "object", "name": "fridge"}}, "open", {"thing": "fridge"}),
        ("sealing", {"object": "fridge"}, "close", {"thing": "fridge"}),
        ("looking", {"object": JUICE}, "look_at", {"thing": "orange_juice_carton_1"}),
        ("reaching", {"object": JUICE}, "reach", {"thing": "orange_juice_carton_1"}),
        ("pouring", {"object": JUICE, "target": "sink"}, "pour", {"thing": "orange_juice_carton_1", "into": "sink"}),
        ("pouring", {"source": JUICE, "into": "sink"}, "pour", {"thing": "orange_juice_carton_1", "into": "sink"}),
        (
            "placing",
            {"object": JUICE, "target": {"a": "location", "on": {"the": "object", "name": "table"}}},
            "place",
            {"thing": "orange_juice_carton_1", "on": "table"},
        ),
        (
            "transporting",
            {"object": JUICE, "target": {"a": "location", "in": "fridge"}},
            "place",
            {"thing": "orange_juice_carton_1", "into": "fridge"},
        ),
        ("transporting", {"object": JUICE}, "put_away", {"thing": "orange_juice_carton_1"}),
        ("storing", {"object": JUICE}, "put_away", {"thing": "orange_juice_carton_1"}),
        ("going", {"target": {"a": "location", "pose": [1.0, 2.0, 0.5]}}, "go_to", {"x": 1.0, "y": 2.0, "yaw": 0.5}),
        ("navigating", {"target": {"a": "location", "at": "table"}}, "go_to", {"thing": "table"}),
    ],
)
def test_each_type_of_action_is_a_skill(
    kitchen: Simulation, type: str, properties: dict[str, Any], skill: str, args: dict[str, Any]
) -> None:
    found = read(kitchen, type, **properties)
    assert (found.skill, found.args) == (skill, args)
    assert not found.choices


def test_fetching_takes_a_kind_or_a_described_object(kitchen: Simulation) -> None:
    kind = read(kitchen, "fetching", object={"an": "object", "type": "CoffeeMug"})
    assert (kind.skill, kind.args) == ("fetch", {"kind": "CoffeeMug"})
    inside = {"the": "object", "type": "OrangeJuiceCarton", "location": {"a": "location", "in": "fridge"}}
    described = read(kitchen, "fetching", object=inside)
    assert (described.skill, described.args) == ("pick", {"thing": "orange_juice_carton_1"})
    elsewhere = {"an": "object", "type": "OrangeJuiceCarton", "location": {"a": "location", "on": "table"}}
    with pytest.raises(NameNotFoundError, match="OrangeJuiceCarton"):
        read(kitchen, "fetching", object=elsewhere)
    of_action = {"object": {"an": "object", "type": "Milk"}, "location": {"a": "location", "in": "fridge"}}
    assert read(kitchen, "fetching", **of_action).skill == "pick"


@pytest.mark.parametrize(
    ("type", "key", "holder", "is_found"),
    [
        ("OrangeJuiceCarton", "in", "fridge", True),
        ("OrangeJuiceCarton", "on", "fridge", False),
        ("OrangeJuiceCarton", "at", "fridge", True),
        ("JamJar", "on", "table", True),
        ("JamJar", "inside", "table", False),
        ("JamJar", "at", "table", True),
    ],
)
def test_what_is_inside_is_not_on_and_what_is_on_is_not_inside(
    kitchen: Simulation, type: str, key: str, holder: str, is_found: bool
) -> None:
    where = {"a": "location", key: {"the": "object", "name": holder}}
    wanted = {"the": "object", "type": type, "location": where}
    if is_found:
        assert read(kitchen, "grasping", object=wanted).skill == "grasp"
    else:
        with pytest.raises(NameNotFoundError, match=type):
            read(kitchen, "grasping", object=wanted)


def test_an_indefinite_object_is_the_first_that_fits_and_the_others_are_reported(kitchen: Simulation) -> None:
    found = read(kitchen, "picking-up", object={"an": "object", "type": "DinnerPlate"})
    (choice,) = found.choices
    assert found.args["thing"] == choice.chosen
    assert choice.key == "thing"
    assert len(choice.others) >= 1
    assert choice.chosen not in choice.others
    with pytest.raises(AmbiguousNameError, match=str(choice.others[0])):
        read(kitchen, "picking-up", object={"the": "object", "type": "DinnerPlate"})


def test_a_location_and_a_whole_narrow_an_object_down(kitchen: Simulation) -> None:
    handle = {"the": "object", "type": "Handle", "part-of": {"the": "object", "name": "fridge_door"}}
    assert read(kitchen, "grasping", object=handle).args == {"thing": "fridge_door_handle"}


def test_all_notations_are_read_alike(kitchen: Simulation) -> None:
    expected = DesignatedSkill(skill="place", args={"thing": "orange_juice_carton_1", "on": "table"})
    cram = {
        "an": "action",
        "type": "transporting",
        "object": {"the": "object", "type": "OrangeJuiceCarton"},
        "target": {"a": "location", "on": {"the": "object", "name": "table"}},
    }
    lisp = [
        "an", "action", ["type", ":TRANSPORTING"],
        ["object", ["the", "object", ["type", "OrangeJuiceCarton"]]],
        ["target", ["a", "location", ["on", ["the", "object", ["name", "table"]]]]],
    ]  # fmt: skip
    knowrob = {
        "anAction": {
            "type": "Transporting",
            "objectActedOn": {"theObject": {"type": "OrangeJuiceCarton"}},
            "toLocation": {"aLocation": {"on": {"theObject": {"name": "table"}}}},
        }
    }
    for notation in (cram, lisp, knowrob):
        assert read_designator(notation, kitchen) == expected
        assert read_designator(json.dumps(notation), kitchen) == expected


@each_case(
    "pose",
    [
        [1.0, -2.0, pi / 2],
        [[1.0, -2.0, 0.0], [0.0, 0.0, 0.70710678, 0.70710678]],
        {"position": {"x": 1.0, "y": -2.0}, "orientation": {"z": 0.70710678, "w": 0.70710678}},
        {
            "header": {"frame_id": "map"},
            "pose": {"position": {"x": 1.0, "y": -2.0}, "orientation": {"z": 0.70710678, "w": 0.70710678}},
        },
        ["map", 0.0, [1.0, -2.0, 0.0], [0.0, 0.0, 0.70710678, 0.70710678]],
    ],
)
def test_poses_are_those_of_ros_or_planar(kitchen: Simulation, pose: Any) -> None:
    args = read(kitchen, "going", target={"a": "location", "pose": pose}).args
    assert args == {"x": 1.0, "y": -2.0, "yaw": pytest.approx(pi / 2, abs=1e-6)}


def test_what_is_not_used_is_named(kitchen: Simulation) -> None:
    assert read(kitchen, "picking-up", object=JUICE, arm="left", grasp="top").ignored == ("arm", "grasp")


def test_every_type_has_a_skill_of_the_catalog(kitchen: Simulation) -> None:
    generous = {"object": JUICE, "target": {"a": "location", "on": "table"}}
    found = {read(kitchen, type, **generous).skill for type in ACTION_TYPES}
    assert found >= set(skill_specs()) - {
        "put_away",
        "fetch",
    }


@each_case(
    ("designator", "cause"),
    [
        ("{", "it is no JSON"),
        ("3", "3 is no designator"),
        ({"an": "action"}, "it has no type"),
        ({"an": "object", "type": "milk"}, "it describes object"),
        ({"an": "action", "a": "action", "type": "going"}, "it has an and a"),
        ({"an": "action", "type": "flying"}, "its type 'flying' is unknown"),
        ({"an": "action", "type": "placing", "object": JUICE}, "it has no target"),
        ({"an": "action", "type": "picking-up"}, "it has no object"),
        ({"an": "action", "type": "picking-up", "object": {"an": "object"}}, "the object is not described"),
        ({"an": "action", "type": "picking-up", "object": {"an": "object", "color": "red"}}, "not searched by color"),
        (
            {"an": "action", "type": "placing", "object": JUICE, "target": {"a": "location", "near": "x"}},
            "it names no object",
        ),
        ({"an": "action", "type": "going", "target": {"a": "location", "pose": [1, "x"]}}, "is no pose"),
        (
            {"an": "action", "type": "grasping", "object": {"an": "object", "type": "Milk", "location": 5}},
            "the location: 5 is no designator",
        ),
        (["an", "action", "type"], "'type' is no key with a value"),
        (
            {"an": "action", "type": "opening", "object": "fridge", "fraction": 2},
            "fraction 2: it must be",
        ),
    ],
)
def test_what_is_no_designator_is_refused_with_the_reason(kitchen: Simulation, designator: Any, cause: str) -> None:
    with pytest.raises(InvalidArgumentError, match=cause):
        read_designator(designator, kitchen)


def test_unknown_names_and_deep_nesting_are_refused(kitchen: Simulation) -> None:
    with pytest.raises(NameNotFoundError, match="unicorn"):
        read(kitchen, "picking-up", object="unicorn")
    with pytest.raises(NameNotFoundError):
        read(kitchen, "picking-up", object={"an": "object", "type": "Unicorn"})
    nested: Any = {"type": "going"}
    for _ in range(30):
        nested = {"anAction": nested}
    with pytest.raises(InvalidArgumentError, match="more than 10 levels"):
        read_designator(nested, kitchen)
