"""What users give as poses and plans: numbers in tuples, lists and arrays, and dicts, in every public function.

The inventory is of the signatures: a public function that takes a pose or a plan accepts all forms, and is called here.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from math import cos, inf, nan, sin
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from mindstage.errors import NumberRefusedError, PlanError, PoseRefusedError
from mindstage.imagination import (
    Check,
    Move,
    Plan,
    PlanBuilder,
    PlanRunner,
    Uncertainty,
    act,
    dump_plan,
    evaluate_plan,
    is_uncertain,
    load_plan,
    run_plan,
    try_first,
    validate_plan,
)
from mindstage.robots.base_placement import find_base_placements
from mindstage.robots.collisions import HandChecker
from mindstage.robots.edits import add_robot
from mindstage.robots.navigation import FloorMap
from mindstage.robots.planning import plan_arm, plan_path
from mindstage.robots.robot import Robot
from mindstage.robots.robot_kinematics import RobotKinematics
from mindstage.scene import (
    AttachedLight,
    Body,
    BodyId,
    CollisionShape,
    Iri,
    Joint,
    Light,
    LightType,
    Pose,
    PoseLike,
    World,
    as_pose,
)
from mindstage.scene.edits import Attach
from mindstage.scene.transforms import normalized_pose_array
from mindstage.simulation import Edits, Marker, MarkerType, Simulation
from tests.cases import each_case
from tests.engines.scenes import body
from tests.imagination.scenes import TABLE_HEIGHT_M, on_table
from tests.robots.rooms import box, robot_in
from tests.test_numbers import functions_of, input_records, is_own, is_protocol, public, record_fields

POSE = Pose((0.7, 0.25, 0.9), (cos(0.1), 0.0, 0.0, sin(0.1)))
NUMBERS = (*POSE.position, *POSE.quaternion)
FORMS: Mapping[str, Any] = {
    "tuple": NUMBERS,
    "list": list(NUMBERS),
    "array": np.array(NUMBERS),
    "pair": (POSE.position, POSE.quaternion),
    "pair of arrays": [np.array(POSE.position), np.array(POSE.quaternion)],
}
WRONG: Mapping[str, Any] = {
    "two numbers": (1.0, 2.0),
    "six numbers": (1.0, 2.0, 3.0, 0.0, 0.0, 0.0),
    "matrix": np.eye(4),
    "row of a table": np.zeros((1, 7)),
    "text": "cup",
    "number": 3.0,
    "no rotation": (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 0.0),
    "nan": (1.0, nan, 3.0),
    "infinite": (1.0, 2.0, 3.0, inf, 0.0, 0.0, 0.0),
    "words": ("a", "b", "c"),
    "dict": {"x": 1.0},
}


# -- poses -------------------------------------------------------------------------------------------------------------


@each_case("form", FORMS)
def test_numbers_are_a_pose(form: str) -> None:
    assert as_pose(FORMS[form]) == POSE


@pytest.mark.parametrize("form", [(1, 2, 3), [1.0, 2.0, 3.0], np.array([1, 2, 3]), np.array([1, 2, 3], np.float32)])
def test_three_numbers_are_a_position(form: Any) -> None:
    found = as_pose(form)
    assert found == Pose((1.0, 2.0, 3.0))
    assert {type(each) for each in (*found.position, *found.quaternion)} == {float}


@each_case("wrong", WRONG)
def test_anything_else_is_refused_with_what_is_right(wrong: str) -> None:
    with pytest.raises((PoseRefusedError, NumberRefusedError), match=r"give |must be a number") as refused:
        as_pose(WRONG[wrong], "target")
    assert str(refused.value).startswith("target")
    assert isinstance(refused.value, ValueError)


def first(found: Any) -> Any:
    return next(iter(found))


CALLS: Mapping[str, Callable[[Robot, PoseLike], object]] = {
    "FloorMap.__init__ moved": lambda robot, pose: (
        FloorMap(robot, moved={BodyId("block"): pose}).is_floor(0.7, 0.25),
        FloorMap(robot).is_floor(0.7, 0.25),
    ),
    "HandChecker.find grasp_pose": lambda robot, pose: HandChecker(robot, robot.gripper()).find(
        pose, robot.joint_positions()
    ),
    "PlanBuilder.move to": lambda _, pose: PlanBuilder().move("cup", to=pose).build(),
    "RobotKinematics.pose root_pose": lambda robot, pose: (
        RobotKinematics(robot.model).pose("gripper", {}, root_pose=pose).tolist()
    ),
    "RobotKinematics.solve_ik target": lambda robot, pose: RobotKinematics(robot.model).solve_ik("gripper", pose),
    "RobotKinematics.solve_ik root_pose": lambda robot, pose: RobotKinematics(robot.model).solve_ik(
        "gripper", Pose((1.4, 0.5, 1.8)), root_pose=pose
    ),
    "RobotKinematics.solutions target": lambda robot, pose: first(
        RobotKinematics(robot.model).solutions("gripper", pose)
    ),
    "RobotKinematics.solutions root_pose": lambda robot, pose: first(
        RobotKinematics(robot.model).solutions("gripper", Pose((1.4, 0.5, 1.8)), root_pose=pose)
    ),
    "Edits.move pose": lambda _, pose: moved(lambda stack: stack.move(BodyId("box"), pose)),
    "Edits.move_all poses": lambda _, pose: moved(lambda stack: stack.move_all({BodyId("box"): pose})),
    "Simulation.add_camera at": lambda _, pose: camera_at(pose),
    "add_robot pose": lambda robot, pose: added(robot, lambda sim: add_robot(sim, robot.model, pose)),
    "find_base_placements targets": lambda robot, pose: find_base_placements(robot, "", [pose], count=1),
    "plan_arm target": lambda robot, pose: plan_arm(robot, "", pose),
    "plan_path poses": lambda robot, pose: plan_path(robot, "", [pose]),
}
"""A call of each public function with a pose, by its name and that of the parameter."""
RECORDS_ONLY = {"Edits.record_motion before"}
"""Parameters that are given by what reads poses."""


def moved(move: Callable[[Edits], object]) -> Pose:
    """Where a box is after an edit."""
    with on_table(body("box", (-0.5, 0.0, TABLE_HEIGHT_M + 0.05), (0.2, 0.1, 0.1), "dynamic", 1.0)) as sim:
        move(sim.edits)
        return sim.body("box").pose


def camera_at(pose: Pose) -> Pose:
    """Where a camera is."""
    with on_table(body("box", (-0.5, 0.0, TABLE_HEIGHT_M + 0.05), (0.2, 0.1, 0.1), "dynamic", 1.0)) as sim:
        return sim.add_camera("camera", at=pose).pose


def added(robot: Robot, add: Callable[[Simulation], Robot]) -> list[float]:
    """Where the base of a robot is that is added to a copy of the world, without the robot that is there."""
    with robot.session.fork(threaded=False) as copy:  # type: ignore[attr-defined]
        return add(copy).link_pose(robot.model.base.link).round(9).tolist()  # type: ignore[no-any-return]


@pytest.fixture(scope="module")
def robot() -> Iterator[Robot]:
    with robot_in(box("block", (2.5, 2.0, 0.2), (0.2, 0.2, 0.4))) as robot:
        yield robot


def documented() -> Iterator[Any]:
    """What the modules of the reference show."""
    pages = (Path(__file__).parents[1] / "docs/reference/python").glob("*.md")
    for name in sorted({name for page in pages for name in re.findall(r"(?m)^::: (\S+)", page.read_text())}):
        module = import_module(name)
        yield from (each for each in (getattr(module, name) for name in module.__all__) if is_own(each))


def parameters_of(pattern: str) -> set[str]:
    """The parameters of public functions whose types match."""
    return {
        f"{name} {parameter.name}"
        for each in (*public(), *documented())
        if inspect.isclass(each) or inspect.isfunction(each)
        for name, function, owner in functions_of(each)
        if not is_protocol(owner)
        for parameter in inspect.signature(function).parameters.values()
        if re.search(pattern, re.sub(r"Callable\[.*", "", str(parameter.annotation)))
    }


def test_every_public_function_takes_poses_in_all_forms() -> None:
    assert parameters_of(r"\bPoseLike\b") == {"as_pose value", *CALLS}
    assert parameters_of(r"\bPose\b") == RECORDS_ONLY


@each_case("call", CALLS)
def test_a_pose_may_be_a_tuple_or_an_array(robot: Robot, call: str) -> None:
    expected = repr(CALLS[call](robot, POSE))
    assert repr(CALLS[call](robot, NUMBERS)) == expected
    assert repr(CALLS[call](robot, np.array(NUMBERS))) == expected


@each_case("call", CALLS)
def test_wrong_numbers_are_refused_with_what_is_right(robot: Robot, call: str) -> None:
    with pytest.raises(PoseRefusedError, match=r"\(1\.0, 2\.0\) is no pose; give x, y, z \[m\], or"):
        CALLS[call](robot, (1.0, 2.0))


IRI = Iri("http://example.org/map#x")
RECORDS: Mapping[str, Callable[[Any], Any]] = {
    "Attach pose": lambda pose: Attach(BodyId("a"), BodyId("b"), pose=pose),
    "AttachedLight pose": lambda pose: AttachedLight(pose=pose),
    "Body pose": lambda pose: Body(id=BodyId("x"), iri=IRI, cls=IRI, pose=pose),
    "CollisionShape pose": lambda pose: CollisionShape(size=(1.0, 1.0, 1.0), pose=pose),
    "Joint pose": lambda pose: Joint(id=BodyId("x"), iri=IRI, parent=BodyId("a"), child=BodyId("b"), pose=pose),
    "Light pose": lambda pose: Light(id=BodyId("x"), iri=IRI, type=LightType.POINT, pose=pose),
    "Marker pose": lambda pose: Marker(id="x", type=MarkerType.CUBE, pose=pose),
    "Move to": lambda pose: Move(thing="x", to=pose),
}
_RESULT = "made by Mindstage, not by its users"
_FILE = "read from the description of a robot"
UNCONVERTED_RECORDS: Mapping[str, str] = {
    **dict.fromkeys(("Gripper grasp_pose", "RobotJoint origin", "UrdfGeometry mesh_origin"), _FILE),
    **dict.fromkeys(("UrdfGeometry origin", "UrdfInertial origin", "UrdfJoint origin"), _FILE),
    **dict.fromkeys(("BaseDrive frame", "BaseDrive root_offset", "SampleResult end_poses"), _RESULT),
    "SpawnRecord poses": _RESULT,
    "CameraMount pose": _RESULT,
    "RobotSensor pose": _FILE,
}


def test_every_record_that_users_make_takes_poses_in_all_forms() -> None:
    fields = {
        f"{cls.__name__} {name}"
        for cls in input_records()
        for name, annotation, _ in record_fields(cls)
        if re.search(r"\bPose\b", str(annotation))
    }
    assert fields - UNCONVERTED_RECORDS.keys() == set(RECORDS)


@each_case("record", RECORDS)
def test_the_pose_of_a_record_may_be_a_tuple_or_an_array(record: str) -> None:
    made = RECORDS[record]
    assert made(NUMBERS) == made(np.array(NUMBERS)) == made(POSE)
    assert hash(made(NUMBERS)) == hash(made(POSE))
    assert msgspec.json.encode(made(NUMBERS)) == msgspec.json.encode(made(POSE))
    with pytest.raises(PoseRefusedError, match="is no pose"):
        made((1.0, 2.0))


def test_a_world_of_tuples_is_spawned_like_one_of_poses() -> None:
    with on_table() as sim:
        x, y, z = 0.0, 0.1, TABLE_HEIGHT_M + 0.05
        cup = msgspec.structs.replace(body("cup", (0.0, 0.0, 0.0), (0.1, 0.1, 0.1), "dynamic", 1.0), pose=(x, y, z))
        assert sim.spawn(World(iri=IRI, bodies=(cup,))).ok
        assert sim.snapshot().body("cup").pose == Pose((x, y, z))
        assert normalized_pose_array((x, y, z)).tolist() == [x, y, z, 1.0, 0.0, 0.0, 0.0]


# -- plans -------------------------------------------------------------------------------------------------------------

AS_DICT: dict[str, Any] = {
    "name": "aside",
    "steps": [
        {"do": "move", "thing": "box", "to": (-0.4, 0.0, TABLE_HEIGHT_M + 0.05)},
        {"do": "wait", "duration_s": 0.1},
    ],
    "uncertainty": [{"thing": "box", "position_m": np.float64(0.001)}],
    "check": {"question": "where_is", "args": {"thing": "box"}},
}
AS_PLAN = (
    PlanBuilder("aside")
    .move("box", to=(-0.4, 0.0, TABLE_HEIGHT_M + 0.05))
    .wait(0.1)
    .uncertain("box", position_m=0.001)
    .check("where_is", thing="box")
    .build()
)
WRONG_PLAN = {"steps": [{"do": "wait", "duration_s": 1.0}, {"do": "move", "thing": "box", "to": (1.0, 2.0)}]}

PLAN_CALLS: Mapping[str, Callable[[Simulation, Any], object]] = {
    "PlanRunner.__init__ plan": lambda sim, plan: PlanRunner(sim, plan, seed=3).run(sim, 0).end_poses,
    "act plan": lambda sim, plan: act(sim, plan).end_poses,
    "dump_plan plan": lambda _, plan: dump_plan(plan),
    "evaluate_plan plan": lambda sim, plan: evaluate_plan(sim, plan, samples=2).to_json(),
    "is_uncertain plan": lambda _, plan: is_uncertain(plan),
    "load_plan source": lambda _, plan: load_plan(plan).plan,
    "run_plan plan": lambda sim, plan: run_plan(sim, plan, seed=3).end_poses,
    "try_first plan": lambda sim, plan: try_first(sim, plan, samples=2, certain=False).to_dict(),
    "validate_plan plan": lambda sim, plan: validate_plan(plan, sim),
}


def test_every_public_function_takes_plans_in_all_forms() -> None:
    assert parameters_of(r"\bPlanLike\b") == PLAN_CALLS.keys()
    assert parameters_of(r"\bPlan(File)?\b") == set()


@each_case("call", PLAN_CALLS)
def test_a_plan_may_be_a_dict(call: str) -> None:
    found = []
    for plan in (AS_PLAN, AS_DICT, msgspec.json.encode(AS_PLAN).decode()):
        with on_table(body("box", (-0.5, 0.0, TABLE_HEIGHT_M + 0.05), (0.2, 0.1, 0.1), "dynamic", 1.0)) as sim:
            found.append(repr(PLAN_CALLS[call](sim, plan)))
    assert found[0] == found[1] == found[2]


@each_case("call", PLAN_CALLS)
def test_a_dict_that_is_no_plan_is_refused_with_the_place(call: str) -> None:
    with on_table() as sim, pytest.raises(PlanError, match=r"steps\[1\].*\(?1\.0, 2\.0.* is no pose; give x, y, z"):
        PLAN_CALLS[call](sim, WRONG_PLAN)


@each_case("wrong", [None, 3, [], object(), {"steps": [object()]}, {"steps": 3}, {1: 2}, {"step": []}])
def test_what_is_no_plan_is_refused(wrong: Any) -> None:
    with pytest.raises(PlanError, match=r"^the plan: "):
        load_plan(wrong)


def test_the_steps_of_a_dict_may_be_records() -> None:
    steps = (Move(thing="box", to=Pose((1.0, 2.0, 3.0))), {"do": "close", "thing": "door"})
    mixed = load_plan({"steps": steps, "check": Check(question="where_is"), "uncertainty": [Uncertainty(thing="box")]})
    assert isinstance(mixed.plan, Plan)
    assert mixed.plan.steps[0] == steps[0]
