"""Skills: their declaration, and what a robot does with them in the bundled kitchen."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec
import numpy as np
import pytest

import mindstage as ms
from mindstage.errors import InvalidArgumentError
from mindstage.robots.robot import Robot
from mindstage.robots.skills import (
    SKILLS,
    ParameterType,
    SkillOutcome,
    SkillResult,
    SkillStep,
    split_command,
    start_skill,
)
from mindstage.scene import BodyId, Pose
from mindstage.simulation import Simulation


@pytest.fixture(scope="module")
def kitchen() -> Iterator[Simulation]:
    with ms.open("bundled:kitchen") as sim:
        sim.add_robot("mobile_manipulator", Pose((-0.8, 0.6, 0.0), (0.7071068, 0.0, 0.0, 0.7071068)), name="robot")
        sim.step(0.2)
        yield sim


@pytest.fixture
def robot(kitchen: Simulation) -> Robot:
    kitchen.reset()
    return kitchen.robot()


def perform(robot: Robot, name: str, **args: object) -> SkillResult:
    return robot.run(start_skill(robot, name, args))


class TestDeclaration:
    def test_each_skill_documents_itself_and_its_arguments(self) -> None:
        for name, spec in SKILLS.items():
            assert spec.name == name
            assert spec.summary.endswith(".")
            assert "task" not in [each.name for each in spec.parameters]
            assert "task:" not in spec.documentation
            for each in spec.parameters:
                assert each.description != each.name, (name, each.name)

    def test_types_and_defaults_come_from_the_signature(self) -> None:
        thing, fraction = SKILLS["open"].parameters
        assert (thing.name, thing.type, thing.required) == ("thing", ParameterType.THING, True)
        assert (fraction.name, fraction.type, fraction.default) == ("fraction", ParameterType.FRACTION, 1.0)

    def test_a_command_is_parsed_by_position_and_by_name(self) -> None:
        assert split_command("put-away 'milk carton'") == ("put_away", ["milk carton"])
        assert SKILLS["place"].parse(["milk", "into=fridge"]) == {"thing": "milk", "into": "fridge"}
        assert SKILLS["open"].parse(["fridge", "0.5"]) == {"thing": "fridge", "fraction": 0.5}
        assert SKILLS["go_to"].parse(["1", "-0.5", "1.57"]) == {"x": 1.0, "y": -0.5, "yaw": 1.57}

    @pytest.mark.parametrize(
        ("name", "args", "cause"),
        [
            ("open", {}, "thing is missing"),
            ("open", {"thing": "fridge", "fraction": 2}, "2 is out of range"),
            ("open", {"thing": "fridge", "fraction": "half"}, "'half' is no finite number"),
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
            SKILLS[name].check(args)

    def test_an_unknown_skill_names_similar_ones(self, robot: Robot) -> None:
        with pytest.raises(InvalidArgumentError, match="near: 'pick'"):
            start_skill(robot, "pickk", {})


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

    def test_the_camera_points_at_what_is_looked_at(self, kitchen: Simulation, robot: Robot) -> None:
        result = perform(robot, "look_at", thing="fridge")
        assert result, result.reason
        camera = next(each for each in robot.model.sensors if each.is_optical)
        pose = robot.link_pose(camera.link)
        x, y, z, w = pose[4], pose[5], pose[6], pose[3]
        forward = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
        towards = np.array(kitchen.snapshot().body("fridge").pose.position) - pose[:3]
        assert forward @ towards / np.linalg.norm(towards) > 0.995

    def test_a_drawer_is_opened_and_closed_by_its_handle(self, kitchen: Simulation, robot: Robot) -> None:
        steps: list[SkillStep] = []
        result = robot.run(start_skill(robot, "open", {"thing": "drawer_left_2"}, on_step=steps.append))
        assert result, result.reason
        assert kitchen.joint("drawer_left_2").openness > 0.95
        assert result.state.openness == {"drawer_left_2": pytest.approx(1.0, abs=0.05)}
        assert not result.assumptions  # held by friction
        assert [each.name for each in result.steps if each.depth == 0][-2:] == ["open gripper", "move"]
        assert all(each.succeeded for each in result.steps)
        assert len(steps) == 2 * len(result.steps)  # at the begin and at the end of each
        result = perform(robot, "close", thing="drawer_left_2")
        assert result, result.reason
        assert kitchen.joint("drawer_left_2").openness < 0.05

    def test_a_carton_is_picked_up_by_friction_and_put_down(self, kitchen: Simulation, robot: Robot) -> None:
        milk = BodyId("milk_carton_1")
        kitchen.place(milk, on="counter_left")
        result = perform(robot, "pick", thing="milk_carton_1")
        assert result, result.reason
        assert result.state.held == {"gripper": milk}
        assert not kitchen.snapshot().attachments or all(each.child != milk for each in kitchen.snapshot().attachments)
        result = perform(robot, "place", thing="milk_carton_1", on="counter_left")
        assert result, result.reason
        assert result.state.supports == {milk: "on counter_left"}
        assert not result.state.held

    def test_a_result_is_plain_data(self, robot: Robot) -> None:
        result = perform(robot, "park")
        assert result, result.reason
        assert msgspec.json.decode(msgspec.json.encode(result), type=SkillResult) == result

    def test_a_skill_can_be_rehearsed_in_a_copy(self, kitchen: Simulation, robot: Robot) -> None:
        before = robot.base_pose()
        with kitchen.imagine() as copy:
            imagined = copy.robot()
            assert imagined.run(start_skill(imagined, "go_to", {"x": 0.3, "y": 0.6}))
            assert imagined.base_pose()[0] == pytest.approx(0.3, abs=0.02)
        assert robot.base_pose() == pytest.approx(before, abs=1e-6)
