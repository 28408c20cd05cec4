"""Robots in Godot: their bases drive, and light links at the end of an arm stay where they are."""

from __future__ import annotations

from math import cos, sin
from pathlib import Path

import pytest

from mindstage.engines import GodotEngine
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import Pose
from mindstage.simulation import Simulation


def test_a_base_drives_and_turns_in_godot(godot: Path) -> None:
    yaw = 0.4
    with Simulation(KnowledgeBase(), GodotEngine(godot, timeout_s=60.0), timeout_s=60.0) as sim:
        robot = sim.add_robot("mobile_manipulator", Pose((0.5, -0.3, 0.0), (cos(yaw / 2), 0.0, 0.0, sin(yaw / 2))))
        arm = {joint: robot.joint_positions()[joint] for joint in robot.model.arms[0].joints}
        goal = (0.5 + 0.3 * cos(yaw), -0.3 + 0.3 * sin(yaw), yaw - 0.8)
        result = robot.run(robot.driving([(goal[0], goal[1], yaw), goal]), timeout_s=120.0)
        assert result, result.reason
        assert robot.base_pose() == pytest.approx(goal, abs=0.02)
        now = robot.joint_positions()
        assert {joint: now[joint] for joint in arm} == pytest.approx(arm, abs=0.03), "the arm is held meanwhile"


def test_a_wrist_with_a_light_hand_turns_in_godot(godot: Path) -> None:
    """The hand of the Stretch is fixed to a link of its wrist, and has a thousandth of the inertia of its drive."""
    with Simulation(KnowledgeBase(), GodotEngine(godot, timeout_s=60.0), timeout_s=60.0) as sim:
        robot = sim.add_robot("stretch")
        before = robot.joint_positions()
        goal = before["joint_wrist_yaw"] + 0.4
        result = robot.run(robot.moving_to({"joint_wrist_yaw": goal}), timeout_s=120.0)
        assert result, result.reason
        now = robot.joint_positions()
        assert now["joint_wrist_yaw"] == pytest.approx(goal, abs=0.02)
        for joint in ("joint_wrist_pitch", "joint_wrist_roll"):
            assert now[joint] == pytest.approx(before[joint], abs=0.03), joint
