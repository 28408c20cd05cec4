"""Skills: their declaration, and what a robot does with them in the bundled kitchen."""

from __future__ import annotations

import re
from collections.abc import Generator, Iterator

import msgspec
import numpy as np
import pytest

import mindstage as ms
from mindstage.engines.base import DynamicsScale
from mindstage.errors import InvalidArgumentError, SkillFailedError, UnreachableError
from mindstage.robots import add_robot, find_robot
from mindstage.robots.arm_paths import interpolated_poses
from mindstage.robots.navigation import BasePath, FloorMap, plan_base
from mindstage.robots.robot import Robot
from mindstage.robots.search_limits import SearchLimit
from mindstage.robots.skill_declaration import SkillMotion
from mindstage.robots.skill_task import SkillTask
from mindstage.robots.skills import (
    ParameterType,
    PartContact,
    SkillOutcome,
    SkillResult,
    SkillStep,
    can_open,
    handling,
    manipulator,
    skill_specs,
    split_command,
    start_skill,
)
from mindstage.robots.skills.doors import moving_part
from mindstage.robots.skills.manipulator import BasePose, hands_of
from mindstage.robots.skills.part_motion import find_part_motion
from mindstage.robots.surroundings import ArticulatedPart, Surroundings
from mindstage.scene import BodyId, Iri, Mobility, Pose, World
from mindstage.scene.geometry import BodyGeometry, CollisionShape, CollisionShapeType
from mindstage.scene.transforms import pose_from_array, pose_inverse, pose_multiply, quat_rotate
from mindstage.simulation import Simulation
from tests.kitchenette import kitchenette
from tests.robots.rooms import box, robot_in


@pytest.fixture(scope="module")
def kitchen() -> Iterator[Simulation]:
    with ms.open("bundled:kitchen") as sim:
        add_robot(sim, "mobile_manipulator", Pose((-0.8, 0.6, 0.0), (0.7071068, 0.0, 0.0, 0.7071068)), name="robot")
        sim.step(0.2)
        yield sim


@pytest.fixture
def robot(kitchen: Simulation) -> Robot:
    kitchen.reset()
    return find_robot(kitchen)


def perform(robot: Robot, name: str, **args: object) -> SkillResult:
    return robot.run(start_skill(robot, name, args))


class TestDeclaration:
    def test_each_skill_documents_itself_and_its_arguments(self) -> None:
        for name, spec in skill_specs().items():
            assert spec.name == name
            assert spec.summary.endswith(".")
            assert "task" not in [each.name for each in spec.parameters]
            assert "task:" not in spec.documentation
            for each in spec.parameters:
                assert each.description != each.name, (name, each.name)

    def test_types_and_defaults_come_from_the_signature(self) -> None:
        thing, fraction = skill_specs()["open"].parameters
        assert (thing.name, thing.type, thing.required) == ("thing", ParameterType.THING, True)
        assert (fraction.name, fraction.type, fraction.default) == ("fraction", ParameterType.FRACTION, 1.0)

    def test_a_command_is_parsed_by_position_and_by_name(self) -> None:
        assert split_command("put-away 'milk carton'") == ("put_away", ["milk carton"])
        assert skill_specs()["place"].parse(["milk", "into=fridge"]) == {"thing": "milk", "into": "fridge"}
        assert skill_specs()["open"].parse(["fridge", "0.5"]) == {"thing": "fridge", "fraction": 0.5}
        assert skill_specs()["go_to"].parse(["1", "-0.5", "1.57"]) == {"x": 1.0, "y": -0.5, "yaw": 1.57}

    @pytest.mark.parametrize(
        ("name", "args", "cause"),
        [
            ("open", {}, "thing is missing"),
            ("open", {"thing": "fridge", "fraction": 2}, "fraction 2: it must be a number from 0 to 1"),
            ("open", {"thing": "fridge", "fraction": "half"}, "fraction 'half': it must be a number"),
            ("open", {"thing": " "}, "' ' is no name"),
            ("open", {"door": "fridge"}, "it has no argument 'door'"),
            ("place", {"thing": "milk"}, "no destination is given"),
            ("place", {"thing": "milk", "on": "table", "into": "fridge"}, "several destinations are given"),
            ("go_to", {"x": 1}, "y is missing"),
        ],
    )
    def test_a_wrong_argument_is_refused_before_anything_moves(
        self, name: str, args: dict[str, object], cause: str
    ) -> None:
        with pytest.raises(InvalidArgumentError, match=cause):
            skill_specs()[name].check(args)

    def test_an_unknown_skill_names_similar_ones(self, robot: Robot) -> None:
        with pytest.raises(InvalidArgumentError, match="near: 'pick'"):
            start_skill(robot, "pickk", {})

    def test_a_robot_does_what_a_command_or_a_name_with_arguments_says(self, robot: Robot) -> None:
        steps: list[SkillStep] = []
        by_command = robot.do("look_at milk_carton_1", on_step=steps.append)
        by_name = robot.do("look_at", thing="milk_carton_1")
        assert (
            (by_command.skill, by_command.args)
            == (by_name.skill, by_name.args)
            == ("look_at", {"thing": "milk_carton_1"})
        )
        assert by_command
        assert by_name
        assert {(each.name, each.text, each.depth) for each in steps} == {("look", "look at milk_carton_1", 0)}
        mixed = robot.do("go_to x=-0.8", y=0.7, yaw=1.5)
        assert mixed, mixed.reason
        assert mixed.args == {"x": -0.8, "y": 0.7, "yaw": 1.5}
        assert robot.base_pose()[:2] == pytest.approx((-0.8, 0.7), abs=0.02)

    @pytest.mark.parametrize(
        ("command", "args", "cause"),
        [
            ("", {}, "it is empty"),
            ("open 'fridge", {}, "close the quotes"),
            ("opne fridge", {}, "near: 'open'"),
            ("open", {}, "thing is missing"),
            ("open fridge_door thing=oven_door", {}, "thing is given twice"),
            ("open fridge_door 1 2", {}, "one argument too many"),
            ("open fridge_door", {"door": "x"}, "it has no argument 'door'"),
        ],
    )
    def test_a_command_that_no_skill_takes_is_refused(
        self, robot: Robot, command: str, args: dict[str, object], cause: str
    ) -> None:
        with pytest.raises(InvalidArgumentError, match=cause):
            robot.do(command, **args)

    def test_a_skill_that_takes_too_long_fails(self, robot: Robot) -> None:
        result = robot.do("go_to 1.2 0.6", deadline_s=0.5)
        assert result.outcome is SkillOutcome.FAILED
        assert "did not end within 0.5 s" in result.reason


class TestFailures:
    def test_an_unknown_thing_fails_with_a_reason_and_nothing_moves(self, robot: Robot) -> None:
        before = robot.joint_positions()
        result = perform(robot, "pick", thing="unicorn_1")
        assert result.outcome is SkillOutcome.FAILED
        assert "unicorn_1" in result.reason
        assert result.suggestion
        assert not result
        assert robot.joint_positions() == pytest.approx(before, abs=1e-3)

    def test_what_is_no_door_names_doors(self, robot: Robot) -> None:
        result = perform(robot, "open", thing="table")
        assert result.outcome is SkillOutcome.FAILED
        assert "door or drawer" in result.reason

    def test_a_container_with_several_doors_is_ambiguous(self, robot: Robot) -> None:
        result = perform(robot, "open", thing="sink_cupboard")
        assert result.outcome is SkillOutcome.FAILED
        assert "sink_cupboard_door_left" in result.reason

    def test_what_cannot_be_reached_says_why(self, robot: Robot) -> None:
        result = perform(robot, "reach", x=5.0, y=0.0, z=1.0)
        assert result.outcome is SkillOutcome.FAILED
        assert "beyond the reach" in result.reason

    def test_a_deadline_ends_a_skill_and_stops_the_robot(self, kitchen: Simulation, robot: Robot) -> None:
        result = robot.run(start_skill(robot, "go_to", {"x": 1.2, "y": 0.6}, deadline_s=1.0))
        assert result.outcome is SkillOutcome.FAILED
        assert "1 s" in result.reason
        assert result.duration_s <= 1.0 + 1e-6
        kitchen.step(0.5)
        before = robot.base_pose()
        kitchen.step(0.5)
        assert robot.base_pose() == pytest.approx(before, abs=1e-3)

    def test_closing_the_generator_stops_the_robot(self, kitchen: Simulation, robot: Robot) -> None:
        motion = start_skill(robot, "go_to", {"x": 1.2, "y": 0.6})
        for _ in range(40):
            kitchen.step(next(motion))
        assert robot.joint_velocities() is not None
        motion.close()
        kitchen.step(0.5)
        before = robot.base_pose()
        kitchen.step(0.5)
        assert robot.base_pose() == pytest.approx(before, abs=1e-3)


class TestSkills:
    def test_the_base_arrives_where_it_is_sent(self, robot: Robot) -> None:
        result = perform(robot, "go_to", x=0.3, y=0.6, yaw=0.5)
        assert result, result.reason
        assert robot.base_pose() == pytest.approx((0.3, 0.6, 0.5), abs=0.02)
        assert result.state.base == pytest.approx(robot.base_pose())

    def test_the_base_drives_to_the_side_of_a_thing_and_faces_it(self, robot: Robot) -> None:
        low, high = Surroundings(robot.session).box(BodyId("table"))
        result = perform(robot, "go_to", thing="table")
        assert result, result.reason
        x, y, yaw = robot.base_pose()
        away = np.maximum(np.maximum(low[:2] - (x, y), (x, y) - high[:2]), 0.0)
        assert 0.4 < np.hypot(*away) < 1.4, "beside it"
        middle = (low + high)[:2] / 2
        assert np.cos(yaw - np.arctan2(middle[1] - y, middle[0] - x)) > 0.999

    def test_the_camera_points_at_what_is_looked_at(self, kitchen: Simulation, robot: Robot) -> None:
        result = perform(robot, "look_at", thing="fridge")
        assert result, result.reason
        camera = next(each for each in robot.model.sensors if each.is_optical)
        pose = robot.link_pose(camera.link)
        x, y, z, w = pose[4], pose[5], pose[6], pose[3]
        forward = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
        towards = np.array(kitchen.snapshot().body("fridge").pose.position) - pose[:3]
        assert forward @ towards / np.linalg.norm(towards) > 0.995

    def test_a_result_is_plain_data(self, robot: Robot) -> None:
        result = perform(robot, "park")
        assert result, result.reason
        assert msgspec.json.decode(msgspec.json.encode(result), type=SkillResult) == result

    def test_a_skill_can_be_rehearsed_in_a_copy(self, kitchen: Simulation, robot: Robot) -> None:
        before = robot.base_pose()
        with kitchen.fork() as copy:
            imagined = find_robot(copy)
            assert imagined.run(start_skill(imagined, "go_to", {"x": 0.3, "y": 0.6}))
            assert imagined.base_pose()[0] == pytest.approx(0.3, abs=0.02)
        assert robot.base_pose() == pytest.approx(before, abs=1e-6)


@pytest.fixture(scope="module")
def pantry(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Simulation]:
    """A drawer, a door with handles and a mug on a cupboard, of which the knowledge base has the classes."""
    path = tmp_path_factory.mktemp("map") / "map.owl"
    ms.save(kitchenette(), path)
    with ms.open(path) as sim:
        add_robot(sim, "mobile_manipulator", Pose((0.6, 0.0, 0.0)))
        sim.step(0.2)
        yield sim


class TestSmallKitchen:
    @pytest.fixture(autouse=True)
    def start(self, pantry: Simulation) -> None:
        pantry.reset()

    def test_a_drawer_is_opened_and_closed_by_its_handle(self, pantry: Simulation) -> None:
        robot, steps = find_robot(pantry), list[SkillStep]()
        result = robot.run(start_skill(robot, "open", {"thing": "Drawer"}, on_step=steps.append))
        assert result, result.reason
        assert pantry.joint("Drawer").openness > 0.95
        assert result.state.openness == {"Drawer": pytest.approx(1.0, abs=0.05)}
        assert not result.assumptions  # held by friction
        assert [each.name for each in result.steps if each.depth == 0][-2:] == ["open gripper", "move"]
        assert all(each.succeeded for each in result.steps)
        assert len(steps) == 2 * len(result.steps)  # at the begin and at the end of each
        result = perform(robot, "close", thing="Drawer")
        assert result, result.reason
        assert pantry.joint("Drawer").openness < 0.05
        result = perform(robot, "close", thing="Drawer")
        assert (bool(result), result.steps) == (True, ()), "it is closed already"

    def test_what_did_not_move_a_part_is_tried_from_another_place_and_then_another_way(
        self, pantry: Simulation
    ) -> None:
        robot = find_robot(pantry)
        pantry.joint("Drawer").open(0.5)
        pantry.step(0.1)
        task = SkillTask(robot)
        hand, surroundings = hands_of(task)[0], task.surroundings()
        part = surroundings.articulated_part(BodyId("Drawer"))
        closed = part.joint.closed_position
        first = find_part_motion(hand, part, surroundings, closed)
        assert first.way is PartContact.HANDLE
        second = find_part_motion(hand, part, surroundings, closed, tried=[first])
        (x, y, yaw), (other_x, other_y, other_yaw) = first.placement.base, second.placement.base
        turn = abs((other_yaw - yaw + np.pi) % (2 * np.pi) - np.pi)
        assert np.hypot(other_x - x, other_y - y) > 0.09 or turn > 0.25
        third = find_part_motion(hand, part, surroundings, closed, tried=[first, first, first])
        assert third.way is PartContact.PUSH

    def test_a_way_is_planned_from_where_the_base_will_be_with_a_part_where_it_will_be(
        self, pantry: Simulation
    ) -> None:
        robot, drawer = find_robot(pantry), pantry.joint("Drawer")
        assert plan_base(robot, (1.1, 0.0, 0.0)) == ((1.1, 0.0, 0.0),)
        with pytest.raises(UnreachableError, match=r"inside Drawer"):
            plan_base(robot, (1.1, 0.0, 0.0), joints={drawer.id: drawer.open_position})
        floor = FloorMap(robot, start=(0.6, 0.0, 3.0))
        assert plan_base(robot, (0.6, 0.5, -3.0), floor=floor)[-1] == pytest.approx((0.6, 0.5, 2 * np.pi - 3.0))

    def test_the_bodies_of_a_class_are_those_of_its_subclasses(self, pantry: Simulation) -> None:
        surroundings = Surroundings(find_robot(pantry).session)
        assert surroundings.instances("Cup") == ["Mug"]
        assert "Drawer" in surroundings.instances("ContainerArtifact")

    def test_all_searches_of_a_skill_together_are_limited(self, pantry: Simulation) -> None:
        pantry.joint("Drawer").open(0.5)
        pantry.step(0.1)
        task = SkillTask(find_robot(pantry))
        surroundings = task.surroundings()
        part = surroundings.articulated_part(BodyId("Drawer"))
        find_part_motion(hands_of(task)[0], part, surroundings, part.joint.closed_position)
        assert task.limit.done > 10
        task.limit.steps = task.limit.done
        reason = f"Drawer is 5.% open instead of 0%: .* within {task.limit.steps} steps"
        with pytest.raises(SkillFailedError, match=reason):
            find_robot(pantry).run(moving_part(task, part, 0.0))

    def test_a_held_mug_is_set_aside_to_open_the_drawer_that_it_is_put_into(self, pantry: Simulation) -> None:
        robot, mug = find_robot(pantry), BodyId("Mug")
        result = perform(robot, "pick", thing="Mug")
        assert result, result.reason
        assert result.state.held == {"gripper": mug}
        assert all(each.child != mug for each in pantry.snapshot().attachments)  # by friction
        result = perform(robot, "place", thing="Mug", into="Drawer")
        assert result, result.reason
        texts = [each.text for each in result.steps if each.depth == 0]
        assert texts[0] == "set Mug aside on Cupboard"
        assert texts[-2:] == ["move the arm to carry Mug", "place Mug into Drawer"]
        assert result.state.supports == {mug: "in Drawer"}
        assert result.state.openness == {"Drawer": pytest.approx(1.0, abs=0.05)}
        assert not result.state.held

    def test_a_closed_drawer_is_opened_to_pick_what_is_in_it(self, pantry: Simulation) -> None:
        robot, mug = find_robot(pantry), BodyId("Mug")
        pantry.place(mug, into="Drawer")
        assert pantry.joint("Drawer").openness < 0.01
        result = perform(robot, "pick", thing="Mug")
        assert result, result.reason
        assert result.state.held == {"gripper": mug}
        assert result.state.openness == {"Drawer": pytest.approx(1.0, abs=0.05)}
        texts = [each.text for each in result.steps]
        assert texts.index("open Drawer to 100%") < texts.index("grasp Mug")

    def test_a_drawer_is_opened_farther_if_a_stance_is_found_but_no_way_of_the_arm(
        self, pantry: Simulation, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Motions are left out: the arm finds its way as soon as the drawer is wide open."""
        robot, mug, drawer = find_robot(pantry), BodyId("Mug"), pantry.joint("Drawer")
        pantry.place(mug, into="Drawer")
        drawer.open(0.6)
        pantry.step(0.2)
        attempts = list[float]()

        def standing_before(*args: object) -> Generator[float, None, str]:
            attempts.append(drawer.openness)
            yield 0.1
            if drawer.openness < 0.9:
                raise UnreachableError(robot.name, target=mug, reason="no way was found")
            return "in front of it"

        def moving_part(task: SkillTask, part: ArticulatedPart, fraction: float) -> SkillMotion:
            pantry.joint(part.id).open(fraction)
            yield 0.1

        monkeypatch.setattr(handling, "_find_grasp", lambda *args, **options: (None, None))
        monkeypatch.setattr(handling, "_standing_before", standing_before)
        monkeypatch.setattr(handling, "moving_part", moving_part)
        task = SkillTask(robot)
        motion = handling._hand_before(task, hands_of(task)[0], mug, upright=None, stays=False)
        assert robot.run(motion) == "in front of it"
        assert attempts == pytest.approx([0.6, 1.0], abs=0.05)


@pytest.fixture(scope="module")
def room() -> Iterator[Robot]:
    """A counter with a mug, a basin and a block that is too wide for the gripper."""
    bodies = (
        box("counter", (1.2, 0.0, 0.35), (0.6, 1.2, 0.7)),
        box("mug", (1.0, 0.2, 0.76), (0.06, 0.06, 0.12), Mobility.DYNAMIC, 0.2),
        box("basin", (1.05, -0.3, 0.75), (0.2, 0.2, 0.1)),
        box("block", (1.05, 0.48, 0.78), (0.16, 0.16, 0.16), Mobility.DYNAMIC, 0.3),
    )
    with robot_in(*bodies, floor=(4.0, 4.0), at=(0.45, 0.0, 0.0)) as robot:
        robot.session.step(0.2)
        yield robot


def position(robot: Robot, id: str) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return np.array(robot.session.snapshot().body(BodyId(id)).pose.position)


class TestSmallRoom:
    @pytest.fixture(autouse=True)
    def start(self, room: Robot) -> None:
        room.session.reset()
        room.session.step(0.2)

    def test_the_gripper_reaches_in_front_of_a_thing_and_leaves_it(self, room: Robot) -> None:
        before = position(room, "mug")
        result = perform(room, "reach", thing="mug")
        assert result, result.reason
        assert 0.05 < np.linalg.norm(room.grasp_pose("gripper")[:3] - before) < 0.25
        assert position(room, "mug") == pytest.approx(before, abs=0.002)
        assert not result.state.held
        assert room.base_pose() == pytest.approx((0.45, 0.0, 0.0), abs=0.02)

    def test_an_empty_arm_is_at_rest_when_the_robot_drives(self, room: Robot) -> None:
        (arm,) = room.model.arms
        rest = dict(zip(arm.joints, arm.rest_positions, strict=True))
        assert perform(room, "reach", thing="mug")
        away = room.joint_positions()
        assert max(abs(away[name] - at) for name, at in rest.items()) > 0.1
        result = perform(room, "go_to", x=0.3, y=0.1)
        assert result, result.reason
        found = room.joint_positions()
        assert {name: found[name] for name in rest} == pytest.approx(rest, abs=0.03)
        assert room.base_pose()[:2] == pytest.approx((0.3, 0.1), abs=0.03)

    def test_a_thing_is_grasped_from_where_the_robot_stands_and_released(self, room: Robot) -> None:
        before = position(room, "mug")
        result = perform(room, "grasp", thing="mug")
        assert result, result.reason
        assert result.state.held == {"gripper": "mug"}
        assert position(room, "mug")[2] > before[2] + 0.03
        assert not result.assumptions  # by friction
        assert "drive" not in [each.name for each in result.steps]
        result = perform(room, "release")
        assert result, result.reason
        assert not result.state.held
        assert result.state.supports == {"mug": "on counter"}

    def test_grasping_what_is_held_does_nothing_and_a_second_thing_is_refused(self, room: Robot) -> None:
        assert perform(room, "grasp", thing="mug")
        assert perform(room, "grasp", thing="mug").duration_s == 0.0
        result = perform(room, "grasp", thing="block")
        assert result.outcome is SkillOutcome.FAILED
        assert "no gripper is free" in result.reason
        assert "mug" in result.suggestion

    def test_a_path_ends_before_the_arm_touches_something(self, room: Robot) -> None:
        assert perform(room, "reach", x=0.95, y=0.0, z=0.95)
        hand = hands_of(SkillTask(room))[0]
        down = hand.grasp_pose - np.array([0.0, 0.0, 0.3, 0.0, 0.0, 0.0, 0.0])
        poses = interpolated_poses(hand.grasp_pose, down)
        path = hand.path(poses)
        assert path.is_complete
        part = hand.free_part(path, touch=())
        assert 2 <= part.reached < path.reached
        assert len(part.positions) == len(part.roots) == part.reached
        assert re.search(r"there \w+ is [\d.]+ mm (inside|from) counter", part.reason)

    def test_the_base_drives_only_if_it_is_elsewhere(self, room: Robot) -> None:
        task = SkillTask(room)
        hand, (x, y, yaw) = hands_of(task)[0], room.base_pose()
        room.run(hand.driving_to((x, y, yaw), why="to stay"))
        assert not task.steps
        room.run(hand.driving_to((x - 0.2, y, yaw), why="to make room"))
        assert [(each.name, "to make room" in each.text) for each in task.steps] == [("drive", True)]
        assert room.base_pose() == pytest.approx((x - 0.2, y, yaw), abs=0.02)

    def test_a_path_ends_before_the_base_drives_into_something(self, room: Robot) -> None:
        hand = hands_of(SkillTask(room))[0]
        up = hand.grasp_pose + np.array([0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0])
        path = hand.path(interpolated_poses(hand.grasp_pose, up))
        assert hand.free_part(path, touch=()).is_complete
        roots = np.array(path.roots)
        roots[:, 0] += np.linspace(0.0, 0.6, len(roots))
        part = hand.free_part(path._replace(roots=roots), touch=())
        assert part.reached < path.reached
        assert "counter" in part.reason

    def test_releasing_nothing_opens_the_gripper(self, room: Robot) -> None:
        result = perform(room, "release")
        assert result, result.reason
        assert room.opening("gripper") > 0.08

    def test_what_is_too_heavy_for_the_friction_of_the_fingers_is_not_picked_up(self, room: Robot) -> None:
        mug = BodyId("mug")
        room.session.engine.run(lambda engine: engine.scale_dynamics({mug: DynamicsScale(friction=0.1, mass=4.0)}))
        try:
            result = perform(room, "pick", thing="mug")
        finally:
            room.session.engine.run(lambda engine: engine.scale_dynamics({mug: DynamicsScale()}))
        assert result.outcome is SkillOutcome.FAILED
        assert result.reason == "mug slipped out of the gripper while it was lifted"
        assert not result.assumptions
        grasps = [each.succeeded for each in result.steps if (each.text, each.depth) == ("grasp mug", 0)]
        assert grasps == [False, False]

    def test_a_thing_is_tilted_with_its_lip_over_the_target(self, room: Robot) -> None:
        tilts, lips = [], []
        motion = start_skill(room, "pour", {"thing": "mug", "into": "basin"})
        result = None
        while result is None:
            try:
                room.session.step(next(motion))
            except StopIteration as end:
                result = end.value
            pose = room.session.snapshot().body(BodyId("mug")).pose
            up = quat_rotate(np.array(pose.quaternion), (0.0, 0.0, 1.0))
            tilts.append(float(np.arccos(np.clip(up[2], -1.0, 1.0))))
            lips.append(np.array(pose.position) + 0.06 * up)
        assert result.outcome is SkillOutcome.UNKNOWN  # liquids are not simulated
        assert "whether it was full is not known" in result.reason
        assert max(tilts) > 1.7
        over = lips[int(np.argmax(tilts))]
        assert over[:2] == pytest.approx((1.05, -0.3), abs=0.1)
        assert over[2] > 0.8
        assert tilts[-1] < 0.15
        assert result.state.held == {"gripper": "mug"}

    def test_surroundings_know_boxes_supports_and_names(self, room: Robot) -> None:
        surroundings = Surroundings(room.session, ignored=set(room.link_ids.values()))
        low, high = surroundings.box(BodyId("mug"))
        assert low == pytest.approx((0.97, 0.17, 0.7), abs=0.01)
        assert high == pytest.approx((1.03, 0.23, 0.82), abs=0.01)
        assert surroundings.find("mug") == "mug"
        assert surroundings.find("http://example.org/room#mug") == "mug"
        assert surroundings.support_of(BodyId("mug")) == "on counter"
        assert surroundings.support_of(BodyId("counter")) != "on counter"
        assert surroundings.articulated_parts() == ()
        assert not set(room.link_ids.values()) & set(surroundings.bodies())


def hollow(width: float, height: float, wall: float) -> BodyGeometry:
    """A box without a lid."""
    bottom = CollisionShape(size=(width, width, wall), pose=Pose((0.0, 0.0, (wall - height) / 2)))
    side = (width - wall) / 2
    walls = (
        CollisionShape(size=(wall if x else width, wall if y else width, height), pose=Pose((x * side, y * side, 0.0)))
        for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1))
    )
    return BodyGeometry(key=f"hollow {width} {height}", visuals=(), collision_shapes=(bottom, *walls))


@pytest.fixture(scope="module")
def peas() -> Iterator[Robot]:
    """A counter with a cup with three peas, a bowl, and an egg cup without room for any of them."""
    pea = CollisionShape(type=CollisionShapeType.SPHERE, size=(0.016, 0.016, 0.016))
    places = ((0.985, 0.195), (1.01, 0.2), (0.995, 0.215))
    contents = [
        box(f"pea_{row}", (x, y, 0.72), (0.016, 0.016, 0.016), Mobility.DYNAMIC, 0.005)
        for row, (x, y) in enumerate(places)
    ]
    bodies = (
        box("cup", (1.0, 0.2, 0.75), (0.07, 0.07, 0.1), Mobility.DYNAMIC, 0.15),
        box("bowl", (1.05, -0.3, 0.74), (0.2, 0.2, 0.08)),
        box("egg_cup", (1.05, -0.08, 0.72), (0.02, 0.02, 0.04)),
        *contents,
    )
    geometry = {
        BodyId("cup"): hollow(0.07, 0.1, 0.006),
        BodyId("bowl"): hollow(0.2, 0.08, 0.02),
        **{each.id: BodyGeometry(key="pea", visuals=(), collision_shapes=(pea,)) for each in contents},
    }
    with robot_in(box("counter", (1.2, 0.0, 0.35), (0.6, 1.2, 0.7)), floor=(4.0, 4.0), at=(0.45, 0.0, 0.0)) as robot:
        world = World(iri=Iri("http://example.org/room#bodies"), bodies=bodies)
        assert robot.session.spawn(world, geometry=geometry, ground=False).ok
        robot.session.step(0.4)
        yield robot


class TestPouring:
    def test_what_falls_into_the_target_is_counted(self, peas: Robot) -> None:
        peas.session.reset()
        peas.session.step(0.4)
        result = perform(peas, "pour", thing="cup", into="bowl")
        assert result, result.reason
        assert result.steps[-1].text == "3 of 3 things in cup fell into bowl"
        assert result.state.supports == {f"pea_{row}": "in bowl" for row in range(3)}
        assert result.state.held == {"gripper": "cup"}
        for row in range(3):
            assert position(peas, f"pea_{row}")[:2] == pytest.approx((1.05, -0.3), abs=0.1)

    def test_what_falls_beside_the_target_is_a_failure_with_where_it_is(self, peas: Robot) -> None:
        peas.session.reset()
        peas.session.step(0.4)
        result = perform(peas, "pour", thing="cup", into="egg_cup")
        assert result.outcome is SkillOutcome.FAILED
        assert "0 of 3 things in cup fell into egg_cup: pea_0 is " in result.reason
        assert "wider" in result.suggestion


class TestWhatCanBeOpened:
    def test_a_door_beside_a_wall_is_opened_by_its_handle_from_a_stance(
        self, kitchen: Simulation, robot: Robot
    ) -> None:
        before = kitchen.snapshot()
        reach = can_open(robot, "pantry_door")
        assert reach, reach.reason
        assert reach.openness > 0.95
        assert [each.way for each in reach.steps] == [PartContact.HANDLE]
        assert can_open(robot, "pantry_door") == reach  # it is not by chance
        assert kitchen.snapshot() == before

    def test_what_is_in_the_way_is_named_with_its_distance(self, kitchen: Simulation, robot: Robot) -> None:
        handle = kitchen.snapshot().body("microwave_door_handle").pose.position
        crate = box("crate", (handle[0] + 0.06, handle[1], handle[2]), (0.02, 0.3, 0.3))
        with kitchen.fork() as copy:
            copy.spawn(World(iri=Iri("http://example.org/crate"), bodies=(crate,)))
            reach = can_open(find_robot(copy), "microwave_door")
            result = perform(find_robot(copy), "open", thing="microwave_door")
            assert copy.joint("microwave_door").openness < 0.01
        assert not reach
        assert (reach.openness, reach.steps, reach.obstacle) == (0.0, (), "crate")
        assert re.fullmatch(r"when microwave_door is \d+% open, \w+ is [\d.]+ mm inside crate", reach.reason)
        assert result.outcome is SkillOutcome.FAILED
        assert reach.reason in result.reason
        assert re.search(
            r"no room at each of \d+ grasps .*: at best \w+ is [\d.]+ mm (inside|from) crate", result.reason
        )

    def test_what_a_handle_has_slid_in_the_fingers_is_pulled_at_once(self, kitchen: Simulation, robot: Robot) -> None:
        robot.set_base_pose(-1.1, -1.2, np.pi)  # where the open drawer leaves the arm no room to fold
        result = perform(robot, "open", thing="drawer_south_2")
        assert result, result.reason
        assert kitchen.joint("drawer_south_2").openness > 0.97

    def test_a_low_drawer_among_furniture_is_closed_with_the_arm_beside_the_base(
        self, kitchen: Simulation, robot: Robot
    ) -> None:
        robot.set_base_pose(-0.87, -1.49, 2.44)  # the nearest solutions of the arm are inside of the base there
        kitchen.joint("drawer_south_3").open(1.0)
        kitchen.step(0.1)
        task = SkillTask(robot)
        surroundings = task.surroundings()
        part = surroundings.articulated_part(BodyId("drawer_south_3"))
        motion = find_part_motion(hands_of(task)[0], part, surroundings, part.joint.closed_position)
        assert motion.placement.reach > 0.95


class TestArmsThatTakeTheBaseAlong:
    def test_an_open_drawer_is_closed_from_where_the_disc_around_the_base_has_no_room(self) -> None:
        with ms.open("bundled:kitchen") as sim:
            robot = add_robot(sim, "stretch", Pose((-0.96, -1.32, 0.0), (0.0119, 0.0, 0.0, 0.99993)))
            sim.joint("drawer_south_1").open(1.0)  # the robot is between the drawer and a chair
            sim.step(0.1)
            floor = FloorMap(robot)
            assert not len(floor.plan.cells_near(np.tile(robot.base_pose()[:2], (1, 6, 1)), 0.3))
            task = SkillTask(robot)
            surroundings = task.surroundings()
            part = surroundings.articulated_part(BodyId("drawer_south_1"))
            motion = find_part_motion(hands_of(task)[0], part, surroundings, part.joint.closed_position)
            assert motion.placement.reach > 0.95
            assert plan_base(robot, motion.placement.base)

    def test_a_door_is_closed_by_a_hand_that_has_no_room_to_withdraw_from_its_handle(self) -> None:
        base = (-0.9427, -1.7107, -1.4448)  # between the open door and a wall, the hand at the handle
        # rolled before it is turned, since its finger would pass 11 mm through the arm then
        arm = {"joint_lift": 0.9385, "joint_arm_l3": 0.0661, "joint_wrist_roll": -3.1399, "joint_wrist_yaw": -1.6924}
        with ms.open("bundled:kitchen") as sim:
            robot = add_robot(sim, "stretch", Pose((0.9, 0.6, 0.0)))
            assert all(robot.run(robot.moving_to({name: at})) for name, at in arm.items())
            robot.set_base_pose(*base)
            sim.joint("microwave_door").open(0.997)
            sim.step(0.02)
            task = SkillTask(robot)
            hand, surroundings = hands_of(task)[0], task.surroundings()
            part = surroundings.articulated_part(BodyId("microwave_door"))
            assert part.openness > 0.98
            motion = find_part_motion(hand, part, surroundings, part.joint.closed_position)
            assert motion.way is PartContact.HANDLE
            assert hand.distance_before(motion.path[0]) < 0.02
            assert motion.placement.base == pytest.approx(base, abs=0.02)
            assert motion.placement.part > 0.95

    def test_room_to_fold_the_arm_is_only_searched_if_no_straight_way_is_free(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        searched = list[int]()

        def plan(robot: Robot, goal: tuple[float, float, float], *, max_tests: int, **options: object) -> BasePath:
            searched.append(max_tests)
            if goal[1] < 0.3:  # not straight to the left, the fourth direction
                raise UnreachableError(robot.name, target="there", reason="no way was found")
            return (goal,)

        monkeypatch.setattr(manipulator, "plan_base", plan)
        with robot_in() as robot:
            robot.run(hands_of(SkillTask(robot))[0]._making_room(robot.joint_positions()))
            assert robot.base_pose()[:2] == pytest.approx((0.0, 0.35), abs=0.02)
        assert searched == [0] * 4

    def test_room_to_fold_the_arm_is_searched_everywhere_if_no_straight_way_is_free(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def plan(
            robot: Robot, goal: BasePose, *, max_tests: int, part_of: SearchLimit, **options: object
        ) -> tuple[BasePose, ...]:
            if max_tests == 0 or part_of.is_over or goal[1] < 0.45:
                raise UnreachableError(robot.name, target="there", reason="no way was found")
            return (goal,)

        monkeypatch.setattr(manipulator, "plan_base", plan)
        with robot_in() as robot:
            robot.run(hands_of(SkillTask(robot))[0]._making_room(robot.joint_positions()))
            assert robot.base_pose()[:2] == pytest.approx((0.0, 0.5), abs=0.02)

    def test_a_hand_withdraws_that_its_drawn_in_arm_cannot_keep_straight(self) -> None:
        with robot_in(robot="stretch") as robot:
            hand = hands_of(SkillTask(robot))[0]
            robot.run(robot.moving_to({"joint_arm_l3": 0.0, "joint_wrist_yaw": 0.8}))
            before = hand.grasp_pose
            back = interpolated_poses(before, pose_multiply(before, np.array([-0.1, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])))
            assert hand.path(back, may_drive=True).reached < 2
            robot.run(hand.withdrawing(0.1))
            away = pose_multiply(pose_inverse(before), hand.grasp_pose)[:3]
            assert away == pytest.approx((-0.1, 0.0, 0.0), abs=0.02)

    def test_a_door_is_opened_only_as_far_as_the_base_can_still_drive_away(self) -> None:
        """Beside the door that it pulls towards itself there are walls: farther on, it could not get out."""
        with ms.open("bundled:kitchen") as sim:
            robot = add_robot(sim, "stretch", Pose((0.9, 0.6, 0.0)))
            task = SkillTask(robot)
            hand, surroundings = hands_of(task)[0], task.surroundings()
            door = surroundings.articulated_part(BodyId("room_door"))
            motion = find_part_motion(hand, door, surroundings, door.joint.open_position)
            row, path = motion.end_row, motion.placement.path
            assert motion.placement.stop == row + 1 < path.reached
            moved = {door.id: door.joint.pose_at(motion.end), motion.body: pose_from_array(motion.poses[row])}
            x, y, _ = hand.base_frame.base_at(path.roots[row])
            assert FloorMap(robot, moved=moved).is_reachable(x, y)

    def test_doors_above_its_lift_are_given_up_at_once(self) -> None:
        with ms.open("bundled:kitchen") as sim:
            robot = add_robot(sim, "stretch", Pose((0.9, 0.6, 0.0)))
            hand = hands_of(SkillTask(robot))[0]
            before = hand.kinematics.iterations
            surroundings = SkillTask(robot).surroundings()
            cupboard = surroundings.articulated_part(BodyId("spice_cupboard_door"))
            with pytest.raises(
                UnreachableError, match=r"mm and .* are missing: joint_lift is at its upper limit 1.1 m"
            ):
                find_part_motion(hand, cupboard, surroundings, cupboard.joint.open_position)
            assert hand.kinematics.iterations - before < 5000  # no place of the base was searched for it


class TestKitchenSurroundings:
    def test_doors_handles_and_what_they_close(self, kitchen: Simulation, robot: Robot) -> None:
        surroundings = SkillTask(robot).surroundings()
        door = surroundings.articulated_part(BodyId("fridge"))
        assert (door.id, door.handle, door.container) == ("fridge_door", "fridge_door_handle", "fridge")
        assert door.is_closed
        milk = BodyId("milk_carton_1")
        assert surroundings.containers_of(milk)[0] == "fridge"
        assert [each.id for each in surroundings.closed_in_front_of(milk)] == ["fridge_door"]
        assert surroundings.storage_places(milk) == ["fridge"]
        kitchen.joint("fridge_door").open(0.6)
        kitchen.step(0.1)
        surroundings = SkillTask(robot).surroundings()
        assert surroundings.closed_in_front_of(milk) == []
        assert [each.id for each in surroundings.in_front_of(milk)] == ["fridge_door"]
        assert surroundings.articulated_parts_of(BodyId("fridge"))[0].openness == pytest.approx(0.6, abs=0.05)

    def test_a_kind_is_fetched_and_the_one_that_nothing_closes_comes_first(
        self, kitchen: Simulation, robot: Robot
    ) -> None:
        kitchen.place("milk_carton_1", on="counter_left")
        start = robot.base_pose()
        result = perform(robot, "fetch", kind="MilkCarton")
        assert result, result.reason
        assert result.state.held == {"gripper": "milk_carton_1"}
        assert robot.base_pose()[:2] == pytest.approx(start[:2], abs=0.03)
        assert kitchen.joint("fridge_door").openness < 0.02
