"""Frames: literal poses, what a conversion may not break, and the way back."""

from __future__ import annotations

from math import cos, pi, radians, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from tests.worlds import poses, sizes, vectors

from mindstage.scene import Pose, Vector
from mindstage.scene.transforms import (
    GODOT_FROM_ROS,
    ROS_FROM_GODOT,
    ROS_FROM_UNREAL,
    UNREAL_FROM_ROS,
    FrameConversion,
    normalize,
    pose_array,
    quat_rotate,
    rotation_matrix,
    wxyz_from_xyzw,
    xyzw_from_wxyz,
)

COS15, SIN15 = cos(radians(15.0)), sin(radians(15.0))
YAWED = Pose((1.0, 2.0, 3.0), (COS15, 0.0, 0.0, SIN15))
"""Yaw 30 degrees, to the left."""
TURNED = Pose((-0.25, 0.5, 8.0), (0.5, 0.1, -0.7, 0.5))
"""About all three axes."""

CONVERSIONS = {
    "unreal from ros": UNREAL_FROM_ROS,
    "ros from unreal": ROS_FROM_UNREAL,
    "godot from ros": GODOT_FROM_ROS,
    "ros from godot": ROS_FROM_GODOT,
}
each_way = pytest.mark.parametrize("conversion", CONVERSIONS.values(), ids=CONVERSIONS.keys())


@pytest.mark.parametrize(
    ("there", "back", "ros", "other"),
    [
        # Unreal's y points to the right, so a yaw to the left is negative there.
        (UNREAL_FROM_ROS, ROS_FROM_UNREAL, YAWED, Pose((100.0, -200.0, 300.0), (COS15, 0.0, 0.0, -SIN15))),
        (UNREAL_FROM_ROS, ROS_FROM_UNREAL, TURNED, Pose((-25.0, -50.0, 800.0), (0.5, -0.1, -0.7, -0.5))),
        # Godot's y is up, so a yaw is a turn about y.
        (GODOT_FROM_ROS, ROS_FROM_GODOT, YAWED, Pose((-2.0, 3.0, -1.0), (COS15, 0.0, SIN15, 0.0))),
        (GODOT_FROM_ROS, ROS_FROM_GODOT, TURNED, Pose((-0.5, 8.0, 0.25), (0.5, 0.7, 0.5, -0.1))),
    ],
    ids=["unreal, yaw", "unreal, all axes", "godot, yaw", "godot, all axes"],
)
def test_a_literal_pose_is_converted_there_and_back(there: FrameConversion, back: FrameConversion, ros: Pose, other: Pose) -> None:
    assert there.pose(ros) == other
    assert back.pose(other) == ros


def test_forward_left_and_up_are_converted_to_the_axes_of_each_program() -> None:
    forward, left, up = np.eye(3)
    assert_allclose(GODOT_FROM_ROS.points([forward, left, up]), [[0, 0, -1], [-1, 0, 0], [0, 1, 0]])
    assert_allclose(UNREAL_FROM_ROS.points([forward, left, up]), [[100, 0, 0], [0, -100, 0], [0, 0, 100]])


def test_only_the_unreal_conversion_flips_handedness() -> None:
    assert UNREAL_FROM_ROS.flips_handedness
    assert ROS_FROM_UNREAL.flips_handedness
    assert not GODOT_FROM_ROS.flips_handedness
    assert not ROS_FROM_GODOT.flips_handedness


def test_sizes_are_reordered_with_the_axes() -> None:
    depth_width_height = (0.5, 1.5, 2.5)
    assert_allclose(UNREAL_FROM_ROS.sizes(depth_width_height), [50.0, 150.0, 250.0])
    assert_allclose(GODOT_FROM_ROS.sizes(depth_width_height), [1.5, 2.5, 0.5])
    assert_allclose(ROS_FROM_GODOT.sizes([1.5, 2.5, 0.5]), depth_width_height)


def test_lengths_are_only_scaled() -> None:
    assert UNREAL_FROM_ROS.lengths(0.45) == pytest.approx(45.0)
    assert ROS_FROM_UNREAL.lengths(45.0) == pytest.approx(0.45)
    assert GODOT_FROM_ROS.lengths(0.45) == 0.45


def test_directions_are_not_scaled() -> None:
    assert_allclose(UNREAL_FROM_ROS.directions([0.6, 0.8, 0.0]), [0.6, -0.8, 0.0])


def test_a_map_in_centimeters_and_ros_axes_needs_no_new_code() -> None:
    centimeters = FrameConversion(length_divisor=100.0)
    assert centimeters.pose(Pose((150.0, -20.0, 0.0), TURNED.quaternion)) == Pose((1.5, -0.2, 0.0), TURNED.quaternion)


@each_way
def test_the_inverse_of_the_inverse_is_the_conversion(conversion: FrameConversion) -> None:
    assert conversion.inverse.inverse == conversion


@each_way
def test_no_poses_are_converted_to_no_poses(conversion: FrameConversion) -> None:
    assert conversion.poses(pose_array([])).shape == (0, 7)


@each_way
@given(pose=poses())
def test_poses_survive_a_round_trip(conversion: FrameConversion, pose: Pose) -> None:
    back = conversion.inverse.pose(conversion.pose(pose))
    assert_allclose(back.position, pose.position, rtol=1e-15)
    assert back.quaternion == pose.quaternion


@each_way
@given(size=sizes())
def test_sizes_survive_a_round_trip_and_stay_positive(conversion: FrameConversion, size: Vector) -> None:
    there = conversion.sizes(size)
    assert (there > 0.0).all()
    assert_allclose(conversion.inverse.sizes(there), size, rtol=1e-15)


@each_way
@given(pose=poses(), vector=vectors(-10.0, 10.0))
def test_conversion_commutes_with_rotation(
    conversion: FrameConversion, pose: Pose, vector: Vector
) -> None:
    q = normalize(pose.quaternion)
    assert_allclose(
        conversion.points(quat_rotate(q, vector)),
        quat_rotate(conversion.quaternions(q), conversion.points(vector)),
        atol=1e-11,
    )


@each_way
@given(pose=poses())
def test_body_axes_are_converted_like_world_axes(conversion: FrameConversion, pose: Pose) -> None:
    # Independent of quaternions: the matrix of the frame on both sides of the matrix of the turn.
    frame = conversion.directions(np.eye(3)).T
    q = normalize(pose.quaternion)
    assert_allclose(frame @ rotation_matrix(q) @ frame.T, rotation_matrix(conversion.quaternions(q)), atol=1e-14)


@each_way
@given(many=st.lists(poses(), max_size=5))
def test_conversion_of_many_poses_equals_that_of_each(conversion: FrameConversion, many: list[Pose]) -> None:
    assert_allclose(conversion.poses(pose_array(many)), pose_array(map(conversion.pose, many)), rtol=0.0, atol=0.0)


def test_the_scalar_part_of_quaternions_is_moved() -> None:
    assert wxyz_from_xyzw([1, 2, 3, 0]).tolist() == [0, 1, 2, 3]
    assert xyzw_from_wxyz([0, 1, 2, 3]).tolist() == [1, 2, 3, 0]
    many = np.arange(8.0).reshape(2, 4)
    assert_allclose(wxyz_from_xyzw(xyzw_from_wxyz(many)), many)


def test_joint_limit_angles_are_preserved() -> None:
    # A hinge about ROS z, 30 degrees: its axis is Godot's y, and the angle is the same.
    hinge = GODOT_FROM_ROS.quaternions(YAWED.quaternion)
    assert 2.0 * np.arctan2(np.linalg.norm(hinge[1:]), hinge[0]) == pytest.approx(pi / 6)
    assert_allclose(hinge[1:] / np.linalg.norm(hinge[1:]), [0.0, 1.0, 0.0], atol=1e-15)
