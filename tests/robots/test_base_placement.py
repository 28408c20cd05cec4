"""Places of the base: from each one the arm reaches all targets, and the robot touches nothing."""

from __future__ import annotations

from math import cos, hypot, pi, sin

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage.errors import InvalidArgumentError, UnreachableError
from mindstage.robots.base_placement import find_base_placements, reachable_region
from mindstage.robots.collisions import CollisionChecker
from mindstage.robots.models.reading import load_model
from mindstage.robots.models.robot_model import BaseType
from mindstage.robots.navigation import plan_base
from mindstage.robots.planning import plan_arm
from mindstage.robots.robot_kinematics import RobotKinematics
from mindstage.scene import BodyId, Pose
from mindstage.scene.transforms import Array, quat_angle
from tests.robots.rooms import box, robot_in

COUNTER = box("counter", (2.3, 0.0, 0.45), (0.6, 2.0, 0.9))
TARGET = Pose((2.1, 0.3, 1.05))
"""Above the counter; the hand comes from its front."""


def at_base(base: tuple[float, float, float]) -> Array:
    x, y, yaw = base
    return np.array([x, y, 0.0, cos(yaw / 2), 0.0, 0.0, sin(yaw / 2)])


def test_each_place_serves_and_the_best_comes_first() -> None:
    with robot_in(COUNTER) as robot:
        found = find_base_placements(robot, "", [TARGET], count=4)
        assert 1 <= len(found) <= 4
        assert [each.score for each in found] == sorted((each.score for each in found), reverse=True)
        kinematics, joints = RobotKinematics(robot.model), robot.model.arms[0].joints
        checker = CollisionChecker(robot, joints=joints, base_moves=True)
        for each in found:
            pose = kinematics.pose("gripper", each.positions[0], root_pose=at_base(each.base))
            assert pose[:3] == pytest.approx(TARGET.position, abs=0.001)
            assert quat_angle(pose[3:], np.array(TARGET.quaternion)) < 0.01
            assert checker.find_at(each.positions[0], each.base) is None
            assert each.base[0] < 2.0 - 0.28  # in front of the counter


def test_the_robot_drives_there_and_reaches_the_target() -> None:
    with robot_in(COUNTER, at=(-1.0, -1.0, 0.0)) as robot:
        best = find_base_placements(robot, "arm", [TARGET])[0]
        assert hypot(best.base[0] + 1.0, best.base[1] + 1.0) - 0.1 < best.drive_m < 5.0
        assert robot.run(robot.driving(plan_base(robot, best.base)))
        assert robot.run(robot.following(plan_arm(robot, "arm", TARGET)))
        assert robot.grasp_pose("gripper")[:3] == pytest.approx(TARGET.position, abs=0.005)


def test_one_place_serves_all_targets_of_an_arc() -> None:
    poses = [
        Pose((2.0 - 0.4 * sin(a), -0.2 + 0.4 * cos(a), 1.0), (cos(a / 2), 0.0, 0.0, sin(a / 2)))
        for a in np.linspace(0.0, pi / 2.5, 5).tolist()
    ]
    with robot_in() as robot:
        best = find_base_placements(robot, "", poses)[0]
        kinematics = RobotKinematics(robot.model)
        for pose, positions in zip(poses, best.positions, strict=True):
            reached = kinematics.pose("gripper", positions, root_pose=at_base(best.base))
            assert reached[:3] == pytest.approx(pose.position, abs=0.001)


def test_a_robot_that_stands_well_may_stay() -> None:
    with robot_in() as robot:
        near = Pose((0.65, 0.0, 0.9))
        found = find_base_placements(robot, "", [near], count=1000, max_distance_m=0.6)
        assert [each.drive_m for each in found if each.base == pytest.approx(robot.base_pose())] == [0.0]


def test_targets_that_are_too_high_are_refused_with_a_reason() -> None:
    with robot_in(COUNTER) as robot, pytest.raises(UnreachableError, match=r"none of \d+ places") as caught:
        find_base_placements(robot, "", [Pose((2.1, 0.3, 2.9))])
    assert "limit" in caught.value.reason or "reach" in caught.value.reason


def test_a_target_behind_a_wall_is_refused_with_the_wall() -> None:
    wall = box("wall", (1.8, 0.0, 1.25), (0.1, 6.0, 2.5))
    with robot_in(COUNTER, wall) as robot:
        with pytest.raises(UnreachableError) as caught:
            find_base_placements(robot, "", [TARGET])
        assert caught.value.obstacle in {"wall", "counter"}
        assert find_base_placements(robot, "", [TARGET], ignore={BodyId("wall")})


def test_a_fixed_base_and_missing_targets_are_refused() -> None:
    model = load_model("mobile_manipulator")
    fixed = replace(model, base=replace(model.base, type=BaseType.FIXED))
    with robot_in(robot=fixed) as robot, pytest.raises(InvalidArgumentError, match="fixed"):
        find_base_placements(robot, "", [TARGET])
    with robot_in() as robot, pytest.raises(InvalidArgumentError, match="targets"):
        find_base_placements(robot, "", [])


def test_the_region_is_around_the_robot_and_ends_at_its_reach() -> None:
    with robot_in() as robot:
        points = reachable_region(robot, "", 0.9, step_m=0.2, collisions=False)
        assert (points[:, 2] == 0.9).all()
        away = np.hypot(points[:, 0], points[:, 1])
        kinematics = RobotKinematics(robot.model)
        assert away.max() < 1.35
        for x in np.arange(0.3, 1.5, 0.2):
            found = kinematics.solve_ik("gripper", Pose((float(x), 0.0, 0.9)), free="xyz")
            listed = np.hypot(points[:, 0] - x, points[:, 1]).min() < 0.15
            if away.max() - 0.2 > x:
                assert bool(found) == listed, x


def test_the_region_leaves_out_what_is_only_reached_with_collisions() -> None:
    block = box("block", (0.8, 0.3, 0.9), (0.3, 0.3, 0.4))
    with robot_in(block) as robot:
        free = reachable_region(robot, "", 0.9, step_m=0.15)
        every = reachable_region(robot, "", 0.9, step_m=0.15, collisions=False)

        def within(points: Array) -> int:
            return int((np.abs(points[:, :2] - (0.8, 0.3)) < 0.13).all(axis=1).sum())

        assert within(free) == 0
        assert within(every) > 0
        assert len(free) > 0.3 * len(every)


def test_a_step_that_is_no_distance_is_refused() -> None:
    with robot_in() as robot, pytest.raises(InvalidArgumentError, match="step_m"):
        reachable_region(robot, "", 1.0, step_m=0.0)
