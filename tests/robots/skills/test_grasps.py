"""Grasps by the geometry of things, and the times of paths."""

from __future__ import annotations

from math import pi, sqrt

import numpy as np
import pytest

from mindstage.robots.arm_paths import ArmPath, follow_poses, interpolated_poses, timed
from mindstage.robots.models.reading import load_model
from mindstage.robots.models.robot_model import RobotModel
from mindstage.robots.robot_kinematics import BASE_JOINTS, RobotKinematics
from mindstage.robots.skills.grasps import (
    Grasp,
    GripperShape,
    approaches_of,
    diagonal_grasps_of,
    edge_grasps_of,
    grasps_of,
    pushes_of,
    sweeps_of,
)
from mindstage.scene import Body, BodyId, Iri, Pose, Vector
from mindstage.scene.transforms import Array, pose_inverse, pose_multiply, quat_angle, quat_rotate

HALF = sqrt(0.5)
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def model() -> RobotModel:
    return load_model("mobile_manipulator")


@pytest.fixture(scope="module")
def shape(model: RobotModel) -> GripperShape:
    return GripperShape.of(model, model.grippers[0], RobotKinematics(model))


def box(size: Vector) -> Body:
    return Body(id=BodyId("box"), iri=Iri("urn:box"), cls=Iri("urn:Box"), pose=Pose(), size=size)


def grasps(model: RobotModel, shape: GripperShape, size: Vector) -> list[Grasp]:
    return list(grasps_of(box(size), None, UPRIGHT, model.grippers[0], shape))


def axis(grasp: Grasp, number: int) -> Array:
    return quat_rotate(grasp.pose[3:], np.eye(3)[number])


def test_the_extents_of_the_gripper_are_those_of_its_description(shape: GripperShape) -> None:
    assert shape.opening == pytest.approx(0.12)
    assert shape.tip == pytest.approx(0.025, abs=1e-6)
    assert shape.palm == pytest.approx(0.065, abs=1e-6)


def test_a_thing_that_is_a_little_out_of_reach_is_held_with_the_finger_tips(
    model: RobotModel, shape: GripperShape
) -> None:
    whole = next(each for each in grasps(model, shape, (0.07, 0.07, 0.2)) if each.is_central)
    tips = whole.shallow()
    assert tips is not None
    away = pose_multiply(pose_inverse(whole.pose), tips.pose)
    assert away[:3] == pytest.approx((-0.025, 0.0, 0.0), abs=1e-6)
    near_side = -0.035  # in the direction of approach; the tips are 25 mm in front of the grasp frame
    assert tips.pose[:3] @ axis(tips, 0) + 0.025 - near_side == pytest.approx(0.035, abs=1e-6)
    assert all(each.shallow() is None for each in grasps(model, shape, (0.03, 0.03, 0.01)))


def test_fingers_close_across_the_narrow_sides_only(model: RobotModel, shape: GripperShape) -> None:
    found = grasps(model, shape, (0.07, 0.3, 0.2))
    assert found
    assert all(abs(axis(each, 1)[0]) == pytest.approx(1.0) for each in found)
    assert {round(each.width_m, 3) for each in found} == {0.07}


def test_what_is_too_wide_has_no_grasp_but_sides_to_approach(model: RobotModel, shape: GripperShape) -> None:
    assert not grasps(model, shape, (0.3, 0.3, 0.3))
    found = list(approaches_of(box((0.3, 0.3, 0.3)), None, UPRIGHT, shape))
    assert found
    for each in found:
        tip = each.pose[:3] + axis(each, 0) * shape.tip
        assert np.abs(tip).max() == pytest.approx(0.155, abs=1e-6)  # 5 mm in front of a side
    curved = shape._replace(tips=(0.045, 0.035, 0.025))  # closing fingers reach farther, as those of a linkage
    for each in approaches_of(box((0.3, 0.3, 0.3)), None, UPRIGHT, curved):
        assert np.abs(each.pose[:3]).max() == pytest.approx(0.15 + 0.005 + 0.045, abs=1e-6)


def test_hands_do_not_come_from_below(model: RobotModel, shape: GripperShape) -> None:
    assert all(axis(each, 0)[2] < 0.4 for each in grasps(model, shape, (0.07, 0.07, 0.2)))


def test_finger_tips_stay_in_front_of_what_is_behind(model: RobotModel, shape: GripperShape) -> None:
    """A handle of 4 cm depth is on a door."""
    for each in grasps(model, shape, (0.04, 0.02, 0.4)):
        x = axis(each, 0)
        if abs(x[0]) > 0.99:
            assert (each.pose[:3] + x * shape.tip) @ x <= 0.02 - 0.005


def test_the_tips_of_fingers_that_turn_are_those_of_the_opening_with_which_they_come() -> None:
    """The fingers of Stretch turn: nearly closed around a bar they reach 4 cm farther than open."""
    stretch = load_model("stretch")
    found = GripperShape.of(stretch, stretch.grippers[0], RobotKinematics(stretch))
    assert found.tip_from(0.02) > found.tip + 0.04
    assert found.tip_from(0.2) < found.tip_from(0.1) < found.tip_from(0.02)
    handle = [each for each in grasps(stretch, found, (0.04, 0.02, 0.4)) if abs(axis(each, 0)[0]) > 0.99]
    assert handle
    for each in handle:
        assert (each.pose[:3] + axis(each, 0) * found.tip_from(0.02)) @ axis(each, 0) <= 0.02 - 0.005


def test_a_push_touches_the_outer_side_with_the_fingers(shape: GripperShape) -> None:
    door = box((0.02, 0.6, 1.4))
    outward, edge = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.28, 0.0])
    pushes = list(pushes_of(door, None, outward, edge, shape))
    assert pushes
    for each in pushes:
        assert each.pose[0] > 0.01  # in front of it
        assert 0.0 < each.pose[1] < 0.4  # near its free edge


def test_a_rod_beside_a_wall_is_grasped_across_its_edges(model: RobotModel, shape: GripperShape) -> None:
    """A bar of 1.4 x 2 cm, 33 mm in front of a door (at -x) and 46 mm from a wall (at +y)."""
    palm = np.array([[-shape.palm, y, z] for y in (-0.085, 0.085) for z in (-0.035, 0.035)])
    free = []
    for each in diagonal_grasps_of(box((0.014, 0.02, 0.4)), None, model.grippers[0], shape):
        corners = each.pose[:3] + quat_rotate(each.pose[3:], palm)
        half = each.width_m / 2 + each.room_m + 0.014
        tips = each.pose[:3] + quat_rotate(each.pose[3:], np.array([[shape.tip, -half, 0.0], [shape.tip, half, 0.0]]))
        points = np.vstack([corners, tips])
        assert abs(axis(each, 0)[2]) < 1e-9  # across the rod
        if points[:, 0].min() > -0.033 and points[:, 1].max() < 0.046:
            free.append(each)
    assert free
    straight = [each for each in grasps(model, shape, (0.014, 0.02, 0.4)) if axis(each, 0)[0] < -0.99]
    assert straight  # from the front, the palm is in the wall
    assert all((each.pose[:3] + quat_rotate(each.pose[3:], palm))[:, 1].max() > 0.046 for each in straight)


def test_a_rod_at_finger_tips_that_diverge_is_not_held() -> None:
    """The inner sides of the fingers of Stretch are nearest to each other 4 cm behind their tips."""
    stretch = load_model("stretch")
    found = GripperShape.of(stretch, stretch.grippers[0], RobotKinematics(stretch))
    tip = found.tip_from(0.02)
    assert found.touches(tip - 0.034, 0.02)
    assert not found.touches(tip - 0.01, 0.02)
    assert not list(diagonal_grasps_of(box((0.014, 0.02, 0.4)), None, stretch.grippers[0], found))


def test_fingers_with_parallel_sides_hold_a_rod_at_their_tips(shape: GripperShape) -> None:
    assert shape.touches(shape.tip - 0.005, 0.01)
    assert not shape.touches(shape.tip + 0.005, 0.01)  # beyond them


def test_what_is_no_rod_has_no_diagonal_grasp(model: RobotModel, shape: GripperShape) -> None:
    assert not list(diagonal_grasps_of(box((0.05, 0.05, 0.1)), None, model.grippers[0], shape))


def test_a_door_is_held_by_its_free_edges_with_a_finger_on_each_side(model: RobotModel, shape: GripperShape) -> None:
    normal, edge = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.28, 0.0])
    found = list(edge_grasps_of(box((0.02, 0.6, 1.4)), None, normal, edge, model.grippers[0], shape))
    assert {tuple(np.round(axis(each, 0)).tolist()) for each in found} == {(0, -1, 0), (0, 0, 1), (0, 0, -1)}
    for each in found:
        tip = each.pose[:3] + axis(each, 0) * shape.tip_from(each.width_m)
        assert abs(tip[1]) < 0.3  # beside the door, not beyond it
        assert abs(tip[2]) < 0.7
        assert abs(axis(each, 1)[0]) == pytest.approx(1.0)
    assert not list(edge_grasps_of(box((0.2, 0.6, 1.4)), None, normal, edge, model.grippers[0], shape))


def test_the_hand_that_sweeps_a_door_shut_keeps_its_direction_and_stays_outside(shape: GripperShape) -> None:
    """A door of 0.6 m that folds down about the y axis, 0.3 m below its middle; its outer side is at -x."""
    angles = np.linspace(pi / 2, 0.0, 10)  # from lying with its outer side down to upright
    spins = np.array([[np.cos(a / 2), 0.0, -np.sin(a / 2), 0.0] for a in angles])
    hinge = np.array([0.0, 0.0, -0.3])
    poses = np.array([[*(hinge - quat_rotate(spin, hinge)), *spin] for spin in spins])
    outward, edge = np.array([-1.0, 0.0, 0.0]), np.array([0.0, 0.0, 0.28])
    found = list(sweeps_of(box((0.02, 0.5, 0.6)), None, outward, edge, poses, shape))
    assert found
    finger = np.array([[x, y, z] for x in (-0.06, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
    finger[:, 0] = np.where(finger[:, 0] > 0.0, shape.tip_from(0.0), finger[:, 0])
    finger[:, 1:] *= (shape.half_width, shape.half_height)
    for grasp, path in found:
        assert pose_multiply(poses[0], grasp.pose) == pytest.approx(path[0], abs=1e-9)
        assert np.ptp(path[:, 3:], axis=0).max() < 1e-12
        for pose, hand in zip(poses, path, strict=True):
            corners = hand[:3] + quat_rotate(hand[3:], finger)
            outside = (corners - pose[:3]) @ quat_rotate(pose[3:], outward) - 0.01
            assert 0.0 < outside.min() < 0.005


def test_a_line_is_followed_within_the_limits_and_from_rest_to_rest(model: RobotModel) -> None:
    kinematics, arm = RobotKinematics(model), model.arms[0]
    ready = {name: value for group, state, values in model.group_states if state == "ready" for name, value in values}
    start = kinematics.pose("gripper", ready)
    end = start + np.array([0.1, 0.05, 0.05, 0.0, 0.0, 0.0, 0.0])
    line = interpolated_poses(start, end)
    path = follow_poses(kinematics, arm, line, root=UPRIGHT, seed=ready, from_seed=True)
    assert path.is_complete, path.reason
    for row, pose in enumerate(line):
        reached = kinematics.pose("gripper", path.at(row))
        assert reached[:3] == pytest.approx(pose[:3], abs=0.002)
        assert float(quat_angle(reached[3:], pose[3:])) < 0.02
    joints = {joint.name: joint for joint in model.joints}
    trajectory = timed(path, joints, speed=0.3)
    assert trajectory.points[0].velocities == pytest.approx(np.zeros(len(arm.joints)))
    assert trajectory.points[-1].velocities == pytest.approx(np.zeros(len(arm.joints)))
    for point in trajectory.points:
        for name, velocity in zip(trajectory.joints, point.velocities or (), strict=True):
            assert abs(velocity) <= 0.31 * (joints[name].velocity or 1.0)


def test_a_path_beyond_reach_ends_where_the_arm_ends(model: RobotModel) -> None:
    kinematics, arm = RobotKinematics(model), model.arms[0]
    ready = {name: value for group, state, values in model.group_states if state == "ready" for name, value in values}
    start = kinematics.pose("gripper", ready)
    line = interpolated_poses(start, start + np.array([2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    path = follow_poses(kinematics, arm, line, root=UPRIGHT, seed=ready, from_seed=True)
    assert not path.is_complete
    assert 1 < path.reached < len(line)
    assert path.reason
    driven = follow_poses(kinematics, arm, line, root=UPRIGHT, seed=ready, from_seed=True, may_drive=True)
    assert driven.is_complete
    assert driven.moves_base


def test_a_path_that_is_solved_from_its_middle_is_followed_farther() -> None:
    """Stretch opens a door of 0.55 m by its handle, and drives along."""
    stretch = load_model("stretch")
    kinematics, arm = RobotKinematics(stretch), stretch.arms[0]
    angles = np.linspace(0.0, pi / 2, 48)
    halves = pi / 4 - angles / 2
    zero = np.zeros_like(angles)
    handle = [0.55 * np.cos(angles), -0.55 * np.sin(angles), zero + 0.9, np.cos(halves), zero, zero, np.sin(halves)]
    poses = np.array(handle).T

    def path_from(row: int) -> ArmPath:
        ready = {"joint_lift": 0.55, "joint_arm_l3": 0.065}
        root = np.array([*(poses[row, :2] + (0.0, -0.6)), 0.0, -HALF, 0.0, 0.0, HALF])  # y points away from the door
        found = kinematics.solve_ik(
            "gripper", poses[row], joints=(*BASE_JOINTS, *arm.joints), seed=ready, root_pose=root
        )
        root = np.array(found.root_pose)
        onward, before = (
            follow_poses(kinematics, arm, part, root=root, seed=found.positions, may_drive=True)
            for part in (poses[row:], poses[row::-1])
        )
        return before.backwards().joined(onward) if before.reached > row else before

    whole = path_from(24)
    assert whole.reached == len(whole.positions) == len(whole.roots) == len(poses)
    for row in (0, 24, 47):
        reached = kinematics.pose("gripper", whole.at(row), root_pose=whole.roots[row])
        assert reached[:3] == pytest.approx(poses[row, :3], abs=0.003)
    assert path_from(0).reached < len(poses) / 2
