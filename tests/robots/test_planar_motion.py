"""Poses on the floor against complex numbers, and the path of a base that cannot move sideways."""

from __future__ import annotations

import cmath
import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mindstage.robots.base_motion import differential_path, rotated
from mindstage.robots.drives import BaseDrive
from mindstage.robots.floor_poses import planar_inverse, planar_multiply, wrapped, yaw_of
from mindstage.robots.models.robot_model import BaseType
from mindstage.scene import BodyId, Pose
from mindstage.scene.transforms import normalized_pose_array
from tests.cases import each_case

Planar = tuple[float, float, float]
coordinates = st.integers(-30, 30).map(lambda value: value / 10)
angles = st.integers(-31, 31).map(lambda value: value / 10)
poses = st.tuples(coordinates, coordinates, angles)


def moved(pose: Planar, point: complex) -> complex:
    """A point of the frame of a pose in the frame in which the pose is."""
    return complex(pose[0], pose[1]) + cmath.exp(1j * pose[2]) * point


@given(poses, poses, coordinates, coordinates)
def test_a_product_moves_points_by_the_second_pose_and_then_by_the_first(
    a: Planar, b: Planar, x: float, y: float
) -> None:
    product = planar_multiply(a, b)
    assert moved(product, complex(x, y)) == pytest.approx(moved(a, moved(b, complex(x, y))))
    assert -math.pi <= product[2] < math.pi


@given(poses)
def test_a_pose_times_its_inverse_is_nothing_on_both_sides(pose: Planar) -> None:
    for product in (planar_multiply(pose, planar_inverse(pose)), planar_multiply(planar_inverse(pose), pose)):
        assert product == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


@each_case(
    ("quaternion", "yaw"),
    [
        ((1.0, 0.0, 0.0, 0.0), 0.0),
        ((math.cos(0.4), 0.0, 0.0, math.sin(0.4)), 0.8),
        ((math.cos(0.4), 0.0, 0.0, -math.sin(0.4)), -0.8),
        ((-math.cos(0.4), 0.0, 0.0, -math.sin(0.4)), 0.8),
        ((math.cos(0.2), math.sin(0.2), 0.0, 0.0), 0.0),  # rolled
        ((0.0, 0.0, 0.0, 1.0), math.pi),
    ],
)
def test_the_yaw_of_a_quaternion(quaternion: tuple[float, ...], yaw: float) -> None:
    assert yaw_of(np.array(quaternion)) == pytest.approx(yaw)


@given(st.floats(-50.0, 50.0))
def test_a_wrapped_angle_is_the_same_direction(angle: float) -> None:
    found = wrapped(angle)
    assert -math.pi <= found < math.pi
    assert cmath.exp(1j * found) == pytest.approx(cmath.exp(1j * angle), abs=1e-9)


@given(poses, angles)
def test_a_rotated_velocity_keeps_its_turn(velocity: Planar, yaw: float) -> None:
    x, y, turn = rotated(np.array(velocity), yaw).tolist()
    assert complex(x, y) == pytest.approx(cmath.exp(1j * yaw) * complex(*velocity[:2]))
    assert turn == velocity[2]


def drive(odom: Planar, offset: Planar) -> BaseDrive:
    half = odom[2] / 2
    return BaseDrive(
        type=BaseType.PLANAR,
        joint_id=BodyId("joint"),
        actuators=("x", "y", "yaw"),
        error_limits=(1.0, 1.0, 1.0),
        lags_s=(0.0, 0.0, 0.0),
        root=BodyId("root"),
        frame=Pose((odom[0], odom[1], 0.0), (math.cos(half), 0.0, 0.0, math.sin(half))),
        root_offset=Pose((0.1, 0.2, 0.3)),
        odom=odom,
        offset=offset,
        velocity=1.0,
        turn_velocity=1.0,
        acceleration=2.0,
        turn_acceleration=3.0,
        moved=frozenset(),
    )


@given(poses, poses, poses)
def test_coordinates_of_a_base_are_those_of_its_pose(odom: Planar, offset: Planar, joint: Planar) -> None:
    base = drive(odom, offset)
    world = base.world_from_joint(np.array(joint))
    assert moved(world, 0.5) == pytest.approx(moved(odom, moved(joint, moved(offset, 0.5))))
    back = base.joint_from_world(world)
    assert back[:2] == pytest.approx(joint[:2], abs=1e-9)
    assert wrapped(back[2] - joint[2]) == pytest.approx(0.0, abs=1e-9)
    root = normalized_pose_array(base.root_pose(world))
    assert complex(root[0], root[1]) == pytest.approx(moved(odom, moved(joint, complex(0.1, 0.2))))
    assert root[2] == pytest.approx(0.3)
    assert base.accelerations == (2.0, 2.0, 3.0)


# -- a base that cannot move sideways ----------------------------------------------------------------------------------


def is_drivable(before: np.ndarray, after: np.ndarray, *, tolerance: float) -> bool:
    """Whether a differential base gets from one pose to the next: by turning on the spot, or straight ahead or back."""
    offset = after[:2] - before[:2]
    if np.hypot(*offset) < 1e-9:
        return True
    direction = math.atan2(offset[1], offset[0])
    return any(abs(wrapped(direction + side - before[2])) <= tolerance for side in (0.0, math.pi))


@given(st.lists(poses, min_size=1, max_size=5))
def test_every_part_of_a_path_is_a_turn_or_straight_and_all_places_are_reached(points: list[Planar]) -> None:
    wanted = [np.array(point) for point in points]
    path = differential_path(wanted)
    assert np.array_equal(path[0], wanted[0])
    assert all(is_drivable(before, after, tolerance=0.5) for before, after in pairwise(path))
    assert path[-1][:2] == pytest.approx(wanted[-1][:2])
    assert wrapped(path[-1][2] - wanted[-1][2]) == pytest.approx(0.0, abs=1e-6)
    places = [tuple(pose[:2]) for pose in path]
    assert all(tuple(point[:2]) in places for point in wanted)
    assert all(abs(after[2] - before[2]) <= math.pi + 1e-9 for before, after in pairwise(path)), "the shorter way"


@each_case(
    ("points", "expected"),
    [
        ([(0, 0, 0), (1, 0, 0)], [(0, 0, 0), (1, 0, 0)]),
        # turns at the start, and to the wanted heading at the end
        ([(0, 0, 0), (0, 1, 0)], [(0, 0, 0), (0, 0, math.pi / 2), (0, 1, math.pi / 2), (0, 1, 0)]),
        # drives back if it looks the other way at both ends
        ([(0, 0, 0), (-1, 0, 0)], [(0, 0, 0), (-1, 0, 0)]),
        ([(0, 0, 0), (-1, 0, math.pi)], [(0, 0, 0), (0, 0, -math.pi), (-1, 0, -math.pi)]),
        # turns only
        ([(1, 2, 0), (1, 2, 0.5)], [(1, 2, 0), (1, 2, 0.5)]),
        ([(1, 2, 3.0), (1, 2, -3.0)], [(1, 2, 3.0), (1, 2, 2 * math.pi - 3.0)]),
        ([(1, 2, 0)], [(1, 2, 0)]),
    ],
)
def test_simple_paths(points: list[Planar], expected: list[Planar]) -> None:
    path = differential_path([np.array(point, dtype=float) for point in points])
    assert np.array(path) == pytest.approx(np.array(expected), abs=1e-9)
