"""Quaternions and poses, against literal values and the invariants of rotations."""

from __future__ import annotations

from math import pi, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from tests.cases import each_case
from tests.worlds import poses, vectors

from mindstage.scene import IDENTITY, Pose, Vector
from mindstage.scene.transforms import (
    normalize,
    pose_array,
    pose_from_array,
    pose_inverse,
    pose_multiply,
    quat_angle,
    quat_conjugate,
    quat_multiply,
    quat_rotate,
    quaternion_from_matrix,
    rotation_matrix,
)

HALF = sqrt(0.5)
LEFT = (HALF, 0.0, 0.0, HALF)
"""A quarter turn to the left, about z."""
ROLL = (HALF, HALF, 0.0, 0.0)
"""A quarter turn about x."""


def test_a_quarter_turn_to_the_left_rotates_x_to_y() -> None:
    assert_allclose(quat_rotate(LEFT, (1.0, 0.0, 0.0)), (0.0, 1.0, 0.0), atol=1e-15)


def test_a_product_applies_its_right_factor_first() -> None:
    # Forward is not changed by the roll and then goes left; up goes right by the roll and then forward.
    assert_allclose(quat_rotate(quat_multiply(LEFT, ROLL), np.eye(3)), [[0, 1, 0], [0, 0, 1], [1, 0, 0]], atol=1e-15)


def test_the_columns_of_a_rotation_matrix_are_the_rotated_axes() -> None:
    assert_allclose(rotation_matrix(LEFT), [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)
    assert rotation_matrix([LEFT, ROLL]).shape == (2, 3, 3)


def test_frames_cancel_when_poses_are_composed() -> None:
    world_from_table = (1.0, 2.0, 3.0, *LEFT)
    table_from_cup = (0.5, 0.0, 0.25, *ROLL)
    world_from_cup = pose_multiply(world_from_table, table_from_cup)
    assert_allclose(world_from_cup[:3], (1.0, 2.5, 3.25), atol=1e-15)
    assert_allclose(pose_multiply(pose_inverse(world_from_table), world_from_cup), table_from_cup, atol=1e-15)


def test_a_zero_quaternion_normalizes_to_nan() -> None:
    assert np.isnan(normalize((0.0, 0.0, 0.0, 0.0))).all()


@each_case("angle", [1e-300, 1e-16, 1e-9, 1e-6, 0.1, pi / 2, 3.0, pi])
def test_small_angles_are_exact(angle: float) -> None:
    turned = (np.cos(angle / 2), 0.0, np.sin(angle / 2), 0.0)
    assert quat_angle(IDENTITY.quaternion, turned) == pytest.approx(angle, rel=1e-14)


def test_angles_above_pi_are_measured_the_other_way_around() -> None:
    turned = (np.cos(2.0), 0.0, 0.0, np.sin(2.0))
    assert quat_angle(IDENTITY.quaternion, turned) == pytest.approx(2.0 * pi - 4.0)


@given(pose=poses(), factor=st.sampled_from((-1.0, 2.0, -0.25)))
def test_angles_ignore_sign_and_norm_of_quaternions(pose: Pose, factor: float) -> None:
    assert quat_angle(pose.quaternion, np.array(pose.quaternion) * factor) == 0.0


@given(a=poses(), b=poses())
def test_angles_are_symmetric(a: Pose, b: Pose) -> None:
    assert quat_angle(a.quaternion, b.quaternion) == quat_angle(b.quaternion, a.quaternion)


@given(pose=poses(), vector=vectors(-10.0, 10.0))
def test_rotation_preserves_norms_and_is_inverted_by_the_conjugate(pose: Pose, vector: Vector) -> None:
    q = normalize(pose.quaternion)
    turned = quat_rotate(q, vector)
    assert_allclose(np.linalg.norm(turned), np.linalg.norm(vector), rtol=1e-13, atol=1e-13)
    assert_allclose(quat_rotate(quat_conjugate(q), turned), vector, atol=1e-13)


@given(many=st.lists(poses(), max_size=4))
def test_poses_survive_a_round_trip_through_an_array(many: list[Pose]) -> None:
    array = pose_array(many)
    assert array.shape == (len(many), 7)
    assert [pose_from_array(row) for row in array] == many


@given(poses(), poses(), vectors(-10, 10))
def test_single_values_are_those_of_arrays_of_them(a: Pose, b: Pose, vector: Vector) -> None:
    first, second, point = *pose_array([a, b]), np.array(vector)
    for found, many in (
        (pose_multiply(first, second), pose_multiply(first[None], second[None])),
        (pose_inverse(first), pose_inverse(first[None])),
        (quat_multiply(first[3:], second[3:]), quat_multiply(first[None, 3:], second[None, 3:])),
        (quat_rotate(first[3:], point), quat_rotate(first[None, 3:], point[None])),
        (normalize(first[3:]), normalize(first[None, 3:])),
    ):
        assert_allclose(found, many[0], rtol=1e-12, atol=1e-12)


@given(a=poses(), b=poses(), c=poses())
def test_pose_composition_is_associative(a: Pose, b: Pose, c: Pose) -> None:
    x, y, z = (np.concatenate([row[:3], normalize(row[3:])]) for row in pose_array((a, b, c)))
    assert_allclose(pose_multiply(pose_multiply(x, y), z), pose_multiply(x, pose_multiply(y, z)), atol=1e-9)


@given(poses())
def test_a_rotation_matrix_is_converted_back_to_its_quaternion(pose: Pose) -> None:
    quaternion = normalize(pose.quaternion)
    back = quaternion_from_matrix(rotation_matrix(quaternion))
    assert back[0] >= 0.0
    assert_allclose(quat_angle(quaternion, back), 0.0, atol=1e-9)


@pytest.mark.parametrize("diagonal", [(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)])
def test_half_turns_are_converted_to_quaternions(diagonal: Vector) -> None:
    half_turn = np.diag(np.array(diagonal, dtype=float))
    assert_allclose(rotation_matrix(quaternion_from_matrix(half_turn)), half_turn, atol=1e-15)
