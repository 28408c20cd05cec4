"""Motions of an arm: they reach their targets, keep the limits, and touch nothing while they are executed."""

from __future__ import annotations

import time
from collections.abc import Iterator
from math import cos, pi, sin
from pathlib import Path

import numpy as np
import pytest

from mindstage.engines import NullEngine
from mindstage.errors import InvalidArgumentError, UnreachableError
from mindstage.robots import add_robot
from mindstage.robots.arm_paths import interpolated_poses
from mindstage.robots.planning import find_arm, plan_arm, plan_path
from mindstage.robots.robot import Robot
from mindstage.robots.robot_kinematics import RobotKinematics
from mindstage.robots.search_limits import SearchLimit
from mindstage.robots.trajectories import JointTrajectory, spline_of
from mindstage.scene import Body, BodyId, Pose
from mindstage.scene.transforms import Array, normalized_pose_array, pose_array, quat_angle
from tests.robots.rooms import box, contacts_with, reaching, robot_in

WALL = box("wall", (0.75, 0.0, 0.8), (0.5, 0.04, 1.6))
"""A wall in front of the robot, between its left and its right."""
LEFT, RIGHT = (0.7, 0.25, 0.9), (0.7, -0.25, 0.9)


def tips(robot: Robot, trajectory: JointTrajectory, count: int = 200) -> Array:
    """Poses of the grasp frame along a trajectory, n x 7."""
    start = robot.joint_positions()
    spline = spline_of(trajectory, robot="robot", limits={each.name: each for each in robot.model.joints}, state=start)
    kinematics, root = RobotKinematics(robot.model), robot.link_pose(robot.model.root)
    rows = [spline.sample(t)[0].tolist() for t in np.linspace(0.0, spline.duration_s - 1e-9, count).tolist()]
    return np.array(
        [
            kinematics.pose("gripper", {**start, **dict(zip(trajectory.joints, row, strict=True))}, root_pose=root)
            for row in rows
        ]
    )


def executed(robot: Robot, trajectory: JointTrajectory, obstacles: set[str]) -> Iterator[str]:
    """Executes a trajectory, and yields each contact with an obstacle."""
    goal = robot.start_trajectory(trajectory)
    while goal.result is None:
        robot.session.step(0.02)
        yield from (f"{each.a} and {each.b}: {each.depth_m:.4f} m" for each in contacts_with(robot, obstacles))
    assert goal.result, goal.result


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_arm_goes_around_a_wall_without_a_contact(seed: int) -> None:
    with robot_in(WALL) as robot:
        assert robot.run(robot.following(plan_arm(robot, "", Pose(LEFT))))
        straight = robot.trajectory_to(reaching(robot, *RIGHT))
        assert (tips(robot, straight)[:, 2] < 1.5).all()  # it would go through the wall
        trajectory = plan_arm(robot, "arm", Pose(RIGHT), seed=seed)
        assert list(executed(robot, trajectory, {"wall"})) == []
        assert robot.grasp_pose("gripper")[:3] == pytest.approx(RIGHT, abs=0.004)


def test_the_target_is_reached_with_the_tolerance_of_inverse_kinematics() -> None:
    target = Pose((0.6, 0.2, 1.1), (cos(0.2), 0.0, 0.0, sin(0.2)))
    with robot_in() as robot:
        trajectory = plan_arm(robot, "", target)
        last = tips(robot, trajectory)[-1]
        assert last[:3] == pytest.approx(target.position, abs=0.001)
        assert quat_angle(last[3:], np.array(target.quaternion)) < 0.01


def test_the_velocity_limits_are_kept_and_the_speed_scales_them() -> None:
    with robot_in() as robot:
        joints = {each.name: each for each in robot.model.joints}
        goal = {"shoulder_pan_joint": 1.2, "lift_joint": 0.9, "elbow_joint": 1.5, "shoulder_pitch_joint": 1.5}
        durations = []
        for speed in (1.0, 0.5):
            trajectory = plan_arm(robot, "", goal, speed=speed)
            durations.append(trajectory.duration_s)
            spline = spline_of(trajectory, robot="robot", limits=joints, state=robot.joint_positions())
            velocities = np.array([spline.sample(t)[1] for t in np.arange(0.0, spline.duration_s, 0.01)])
            limits = np.array([joints[name].velocity for name in trajectory.joints])
            assert (np.abs(velocities).max(axis=0) <= speed * limits).all()
        assert durations[1] > 1.5 * durations[0]


def test_joints_that_are_left_out_stay() -> None:
    with robot_in() as robot:
        before = robot.joint_positions()
        trajectory = plan_arm(robot, "", {"lift_joint": 0.7})
        last = dict(zip(trajectory.joints, trajectory.points[-1].positions, strict=True))
        assert last.pop("lift_joint") == pytest.approx(0.7)
        assert last == pytest.approx({name: before[name] for name in last}, abs=1e-4)


def test_a_position_beyond_a_limit_is_refused_with_the_limit() -> None:
    with robot_in() as robot, pytest.raises(UnreachableError, match=r"upper limit of lift_joint is 1 m"):
        plan_arm(robot, "", {"lift_joint": 1.4})


def test_a_joint_without_limits_is_not_planned_beyond_one_turn(tmp_path: Path) -> None:
    shape = '<collision><origin xyz="0.1 0 0"/><geometry><sphere radius="0.02"/></geometry></collision>'
    chain = "".join(
        f'<link name="l{n + 1}">{shape}</link>'
        f'<joint name="j{n}" type="continuous"><parent link="l{n}"/><child link="l{n + 1}"/>'
        f'<origin xyz="0.2 0 {0.3 if n == 0 else 0.0}"/><axis xyz="0 {n % 2} {1 - n % 2}"/></joint>'
        for n in range(5)
    )
    path = tmp_path / "arm.urdf"
    path.write_text(f'<robot name="arm"><link name="l0"/>{chain}</robot>', encoding="utf-8")
    with robot_in() as other:
        robot = add_robot(other.session, path, (2.0, 0.0, 0.0))
        assert plan_arm(robot, "", {"j4": 1.0}).points[-1].positions[4] == pytest.approx(1.0)
        with pytest.raises(
            UnreachableError, match="j4 turns without limits, and a plan turns it by at most half a turn"
        ):
            plan_arm(robot, "", {"j4": 10.0})


def test_a_pose_beyond_reach_is_refused_with_the_distance() -> None:
    with robot_in() as robot, pytest.raises(UnreachableError, match=r"m beyond the reach of"):
        plan_arm(robot, "", Pose((2.5, 0.0, 1.0)))


def test_a_pose_within_a_body_is_refused_with_its_name() -> None:
    with robot_in(box("block", (0.8, 0.0, 0.9), (0.4, 0.6, 0.6))) as robot:
        with pytest.raises(UnreachableError, match="inside block, in all of") as caught:
            plan_arm(robot, "", Pose((0.8, 0.0, 0.9)))
        assert caught.value.obstacle == "block"


def test_a_closed_cage_is_named_when_no_way_is_found() -> None:
    x, y, z = 0.75, 0.0, 0.9
    sides = [
        box("top", (x, y, z + 0.2), (0.3, 0.3, 0.02)),
        box("bottom", (x, y, z - 0.2), (0.3, 0.3, 0.02)),
        box("left", (x, y + 0.14, z), (0.3, 0.02, 0.4)),
        box("right", (x, y - 0.14, z), (0.3, 0.02, 0.4)),
    ]
    with robot_in(*sides) as robot:  # open in front: it is reached
        assert robot.run(robot.following(plan_arm(robot, "", Pose((x, y, z)))))
    bars = [box(f"bar_{n}", (x - 0.16, y + 0.1 * (n - 1), z), (0.01, 0.02, 0.4)) for n in range(3)]
    with robot_in(*sides, *bars) as robot, pytest.raises(UnreachableError) as caught:
        plan_arm(robot, "", Pose((x, y, z)), max_tests=1500)
    assert caught.value.obstacle in {each.id for each in (*sides, *bars)}


def test_a_plan_depends_on_its_seed_and_not_on_what_was_planned_before() -> None:
    with robot_in(WALL) as robot:
        assert robot.run(robot.following(plan_arm(robot, "", Pose(LEFT))))
        first = plan_arm(robot, "", Pose(RIGHT), seed=4)
        plan_arm(robot, "", Pose(RIGHT), seed=5)
        assert plan_arm(robot, "", Pose(RIGHT), seed=4) == first


def test_a_search_that_its_processor_time_has_ended_says_so() -> None:
    with robot_in(WALL) as robot:
        assert robot.run(robot.following(plan_arm(robot, "", Pose(LEFT))))
        with pytest.raises(UnreachableError, match=r"after 0 s of processor time, in which \d+ of 40000 steps"):
            plan_arm(robot, "", Pose(RIGHT), cpu_s=0.0)
        with pytest.raises(UnreachableError, match="within 5 steps"):
            plan_arm(robot, "", Pose(RIGHT), max_tests=5)


def test_a_search_is_not_ended_by_what_else_the_machine_does() -> None:
    limit = SearchLimit(10, cpu_s=0.1)
    time.sleep(0.2)
    assert not limit.is_over
    limit.count(10)
    assert limit.is_over
    assert not limit.ended_by_time


def test_searches_that_are_parts_of_one_end_with_it_and_name_its_limit() -> None:
    whole = SearchLimit(10)
    first, second = SearchLimit(8, part_of=whole), SearchLimit(8, part_of=whole)
    first.count(6)
    assert not first.is_over
    second.count(5)
    assert (whole.done, whole.is_over, first.is_over, second.is_over) == (11, True, True, True)
    assert str(second) == "within 10 steps"
    assert not second.ended_by_time
    own = SearchLimit(2, part_of=SearchLimit(10))
    own.count(2)
    assert str(own) == "within 2 steps"
    assert SearchLimit(10, part_of=SearchLimit(10, cpu_s=0.0)).is_over


def test_the_arm_may_start_elsewhere() -> None:
    with robot_in() as robot:
        first = plan_arm(robot, "", Pose(LEFT))
        end = dict(zip(first.joints, first.points[-1].positions, strict=True))
        second = plan_arm(robot, "", Pose(RIGHT), start=end)
        assert second.points[0].positions == pytest.approx(first.points[-1].positions, abs=1e-6)


def test_a_line_is_straight_and_slow() -> None:
    with robot_in() as robot:
        assert robot.run(robot.following(plan_arm(robot, "", Pose(LEFT))))
        start, end = robot.grasp_pose("gripper"), np.array([*RIGHT, cos(0.3), 0.0, sin(0.3), 0.0])
        trajectory = plan_path(robot, "", [end], max_velocity=0.1)
        poses = tips(robot, trajectory)
        direction = (end[:3] - start[:3]) / np.linalg.norm(end[:3] - start[:3])
        away = poses[:, :3] - start[:3]
        off = away - (away @ direction)[:, None] * direction
        assert np.linalg.norm(off, axis=1).max() < 0.002
        length = float(np.linalg.norm(end[:3] - start[:3]))
        assert trajectory.duration_s >= length / 0.1
        steps = np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1)
        assert steps.max() / (trajectory.duration_s / len(steps)) < 0.11
        for share, row in ((0.25, 50), (0.5, 100), (0.75, 150)):  # the rotation is even
            moved = float(away[row] @ direction) / length
            assert quat_angle(start[3:], poses[row, 3:]) == pytest.approx(
                moved * quat_angle(start[3:], end[3:]), abs=0.03
            ), share
        assert robot.run(robot.following(trajectory))


def test_a_line_is_in_the_frame_of_the_world_wherever_the_robot_stands() -> None:
    with robot_in(at=(1.0, -2.0, 0.7)) as robot:
        end = robot.grasp_pose("gripper") + np.array([0.0, 0.0, 0.08, 0.0, 0.0, 0.0, 0.0])
        assert robot.run(robot.following(plan_path(robot, "", [end])))
        found = robot.grasp_pose("gripper")
        assert found[:3] == pytest.approx(end[:3], abs=0.005)
        assert quat_angle(found[3:], end[3:]) < 0.02


def test_a_line_through_a_wall_is_refused_with_its_name() -> None:
    with robot_in(WALL) as robot:
        assert robot.run(robot.following(plan_arm(robot, "", Pose(LEFT))))
        with pytest.raises(UnreachableError, match="on the line there") as caught:
            plan_path(robot, "", [Pose(RIGHT)])
        assert caught.value.obstacle == "wall"
        assert plan_path(robot, "", [Pose(RIGHT)], ignore={BodyId("wall")}).duration_s > 1.0


def test_a_line_beyond_reach_is_refused_with_the_limit() -> None:
    with robot_in() as robot:
        assert robot.run(robot.following(plan_arm(robot, "", Pose(LEFT))))
        with pytest.raises(UnreachableError, match=r"missing|beyond"):
            plan_path(robot, "", [Pose((1.6, 0.25, 0.9))])


def test_the_arc_of_a_handle_is_followed() -> None:
    hinge, radius = np.array([0.95, -0.15]), 0.35
    angles = np.linspace(0.0, pi / 4, 12)
    poses = pose_array(
        Pose(
            (hinge[0] - radius * sin(a), hinge[1] + radius * cos(a), 0.9),
            (cos(a / 2), 0.0, 0.0, sin(a / 2)),
        )
        for a in angles.tolist()
    )
    with robot_in() as robot:
        assert robot.run(robot.following(plan_arm(robot, "", poses[0])))
        trajectory = plan_path(robot, "", list(poses))
        found = tips(robot, trajectory)[:, :2]
        assert np.abs(np.linalg.norm(found - hinge, axis=1) - radius).max() < 0.004
        assert robot.run(robot.following(trajectory))
        assert robot.grasp_pose("gripper")[:3] == pytest.approx(poses[-1, :3], abs=0.004)


def test_a_free_axis_lets_the_hand_turn() -> None:
    poses = [Pose((0.7, 0.0, 0.9), (cos(a / 2), sin(a / 2), 0.0, 0.0)) for a in (0.0, 1.0, 2.0)]
    with robot_in() as robot:
        assert robot.run(robot.following(plan_arm(robot, "", poses[0])))
        fixed, free = plan_path(robot, "", poses), plan_path(robot, "", poses, free="x")
        roll = list(fixed.joints).index("wrist_roll_joint")
        turned = [abs(each.points[-1].positions[roll] - each.points[0].positions[roll]) for each in (fixed, free)]
        assert turned[0] > 1.5
        assert turned[1] < 0.2


def test_interpolated_rotations_turn_evenly() -> None:
    a = normalized_pose_array(Pose((0.0, 0.0, 0.0)))
    b = normalized_pose_array(Pose((1.0, 2.0, 3.0), (-cos(0.7), 0.0, 0.0, -sin(0.7))))  # the same as turned by 1.4
    found = interpolated_poses(a, b)
    for share, pose in zip(np.linspace(0.0, 1.0, len(found)).tolist(), found, strict=True):
        assert pose[:3] == pytest.approx(share * b[:3])
        assert pose[3:] == pytest.approx([cos(0.7 * share), 0.0, 0.0, sin(0.7 * share)])


def test_motions_are_planned_in_the_world_of_an_engine_without_physics() -> None:
    with robot_in(WALL, engine=NullEngine()) as robot:
        trajectory = plan_arm(robot, "", Pose(LEFT))
        assert tips(robot, trajectory)[-1, :3] == pytest.approx(LEFT, abs=0.001)
        with pytest.raises(UnreachableError) as caught:
            plan_arm(robot, "", Pose((0.7, 0.0, 0.9)))
        assert caught.value.obstacle == "wall"


def test_unknown_arms_joints_and_missing_poses_are_refused() -> None:
    with robot_in() as robot:
        with pytest.raises(InvalidArgumentError, match="no such arm; give one of arm"):
            find_arm(robot, "left")
        with pytest.raises(InvalidArgumentError, match="no such joint"):
            plan_arm(robot, "", {"left_finger_joint": 0.0})
        with pytest.raises(InvalidArgumentError, match="poses"):
            plan_path(robot, "", [])


def test_nothing_moves_while_it_is_planned() -> None:
    with robot_in(WALL) as robot:
        before = robot.session.state
        plan_arm(robot, "", Pose(RIGHT))
        after = robot.session.state
        assert after.time_s == before.time_s
        assert np.abs(after.poses - before.poses).max() < 1e-5  # a map has fewer digits
        wall: Body = robot.session.snapshot().body(BodyId("wall"))
        assert wall.pose == WALL.pose
