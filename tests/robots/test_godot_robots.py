"""Robots in Godot: their bases drive."""

from __future__ import annotations

from math import cos, sin
from pathlib import Path

import pytest

from mindstage.engines.remote.godot import GodotEngine
from mindstage.errors import CommandRefusedError
from mindstage.knowledge import KnowledgeBase
from mindstage.robots import add_robot
from mindstage.robots.control import MotionFailure
from mindstage.scene import Iri, Pose, World
from mindstage.simulation import Simulation
from tests.robots.rooms import box, robot_in

WALL = Iri("http://example.org/wall#map")


def test_a_base_drives_and_turns_in_godot(godot: Path) -> None:
    yaw = 0.4
    with Simulation(KnowledgeBase(), GodotEngine(godot, timeout_s=60.0), timeout_s=60.0) as sim:
        robot = add_robot(sim, "mobile_manipulator", Pose((0.5, -0.3, 0.0), (cos(yaw / 2), 0.0, 0.0, sin(yaw / 2))))
        arm = {joint: robot.joint_positions()[joint] for joint in robot.model.arms[0].joints}
        goal = (0.5 + 0.3 * cos(yaw), -0.3 + 0.3 * sin(yaw), yaw - 0.8)
        result = robot.run(robot.driving([(goal[0], goal[1], yaw), goal]), timeout_s=120.0)
        assert result, result.reason
        assert robot.base_pose() == pytest.approx(goal, abs=0.02)
        now = robot.joint_positions()
        assert {joint: now[joint] for joint in arm} == pytest.approx(arm, abs=0.03), "the arm is held meanwhile"


def test_what_is_pushed_into_a_wall_stops_and_says_so_in_godot(godot: Path) -> None:
    with robot_in(box("wall", (1.1, 0.0, 0.5), (0.1, 3.0, 1.0)), engine=GodotEngine(godot, timeout_s=60.0)) as robot:
        with pytest.raises(CommandRefusedError, match="2 m/s"):
            robot.drive(2.0)
        with pytest.raises(CommandRefusedError, match=r"lift_joint = 1.5 m: its upper limit is 1 m"):
            robot.start_trajectory(robot.trajectory_to({"lift_joint": 1.5}))
        result = robot.run(robot.driving([(2.0, 0.0, 0.0)]), timeout_s=60.0)
        assert result.failure is MotionFailure.BLOCKED, result
        assert result.reason == "the base does not move at its largest force"
        assert result.obstacles == (), "this engine reports no contacts"


def test_an_arm_that_is_blocked_stops_and_says_so_in_godot(godot: Path) -> None:
    with robot_in(engine=GodotEngine(godot, timeout_s=60.0)) as robot:
        session = robot.session
        assert isinstance(session, Simulation)
        ahead = {"shoulder_pitch_joint": 2.5, "elbow_joint": 1.6, "wrist_pitch_joint": 0.67}  # the hand points forward
        result = robot.run(robot.moving_to(ahead), timeout_s=60.0)
        assert result, result.reason
        x, _, z = robot.grasp_pose()[:3].tolist()
        session.spawn(World(iri=WALL, bodies=(box("pillar", (x, 0.4, z), (0.3, 0.1, 0.4)),)), ground=False)
        blocked = robot.run(robot.moving_to({"shoulder_pan_joint": 1.5}, speed=0.2), timeout_s=60.0)
        assert blocked.failure is MotionFailure.BLOCKED, blocked
        assert blocked.obstacles == (), "this engine reports no contacts"
        assert "does not move at its largest effort" in blocked.reason


def link(name: str, mass_kg: float, size_m: float) -> str:
    moment = mass_kg * size_m**2 / 6
    return f"""<link name="{name}"><inertial><mass value="{mass_kg}"/>
      <inertia ixx="{moment}" iyy="{moment}" izz="{moment}" ixy="0" ixz="0" iyz="0"/></inertial>
      <collision><geometry><box size="{size_m} {size_m} {size_m}"/></geometry></collision></link>"""


def joint(name: str, parent: str, child: str, kind: str, *, x: float, axis: str = "0 0 1") -> str:
    limit = '<limit lower="-2" upper="2" effort="100" velocity="1"/>' if kind == "revolute" else ""
    return f"""<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
      <origin xyz="{x} 0 0"/><axis xyz="{axis}"/>{limit}</joint>"""


WRIST = "\n".join(
    [
        '<robot name="wrist">',
        link("base", 10.0, 0.4),
        link("forearm", 0.3, 0.05),
        link("yaw", 0.05, 0.03),
        link("yaw_bottom", 0.002, 0.01),
        link("pitch", 0.05, 0.03),
        link("roll", 0.05, 0.03),
        link("gripper", 0.002, 0.01),
        link("finger", 0.02, 0.02),
        joint("forearm_joint", "base", "forearm", "revolute", x=0.3),
        joint("yaw_joint", "forearm", "yaw", "revolute", x=0.1),
        joint("yaw_bottom_joint", "yaw", "yaw_bottom", "fixed", x=0.04),
        joint("pitch_joint", "yaw_bottom", "pitch", "revolute", x=0.04, axis="0 1 0"),
        joint("roll_joint", "pitch", "roll", "revolute", x=0.04, axis="1 0 0"),
        joint("gripper_joint", "roll", "gripper", "fixed", x=0.04),
        joint("finger_joint", "gripper", "finger", "revolute", x=0.04),
        "</robot>",
    ]
)
"""Grams between the joints of a wrist, as Stretch has them: links that only carry others."""


def test_drives_hold_a_wrist_whose_joints_are_connected_by_light_links(godot: Path, tmp_path: Path) -> None:
    (tmp_path / "wrist.urdf").write_text(WRIST, encoding="utf-8")
    with Simulation(KnowledgeBase(), GodotEngine(godot, timeout_s=60.0), timeout_s=60.0) as sim:
        robot = add_robot(sim, str(tmp_path / "wrist.urdf"), Pose((0.0, 0.0, 0.0)))
        expected = dict(robot.joint_positions())
        for name, goal in (("roll_joint", 0.5), ("pitch_joint", -0.4), ("yaw_joint", -0.6)):
            result = robot.run(robot.moving_to({name: goal}), timeout_s=60.0)
            assert result, result.reason
            sim.step(0.5)
            expected[name] = goal
            assert robot.joint_positions() == pytest.approx(expected, abs=0.01)
