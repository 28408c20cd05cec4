"""Times along paths: as quick as the limits allow, and never quicker."""

from __future__ import annotations

from math import sqrt

import numpy as np
import pytest

from mindstage.errors import InvalidArgumentError
from mindstage.robots.models.robot_model import RobotJoint, RobotJointType
from mindstage.robots.retiming import MotionLimits, resting_path, retimed, rounded_polyline, spline_path
from mindstage.robots.trajectories import JointTrajectory, spline_of
from mindstage.scene.transforms import Array
from tests.cases import each_case

JOINTS = tuple(
    RobotJoint(name=name, type=RobotJointType.REVOLUTE, parent="a", child="b", lower=-9.0, upper=9.0, velocity=velocity)
    for name, velocity in (("one", 1.0), ("two", 2.0), ("three", 0.5))
)
LIMITS = MotionLimits.of(JOINTS)
SCALE = np.ones(3)
NAMES = tuple(joint.name for joint in JOINTS)


def always_free(values: Array) -> bool:
    return True


def samples(trajectory: JointTrajectory) -> tuple[Array, Array, Array]:
    """Times, positions and velocities of a trajectory as the controller interpolates it."""
    spline = spline_of(
        trajectory,
        robot="robot",
        limits={joint.name: joint for joint in JOINTS},
        state=dict(zip(trajectory.joints, trajectory.points[0].positions, strict=True)),
    )
    times = np.linspace(0.0, spline.duration_s - 1e-9, 1500)
    rows = [spline.sample(t) for t in times.tolist()]
    return times, np.array([row[0] for row in rows]), np.array([row[1] for row in rows])


def check_limits(trajectory: JointTrajectory) -> None:
    times, _, velocities = samples(trajectory)
    assert (np.abs(velocities).max(axis=0) <= LIMITS.velocity * 1.01).all()
    coarse = slice(None, None, 30)  # of the planned motion: cubic splines change their accelerations in jumps
    accelerations = np.diff(velocities[coarse], axis=0) / np.diff(times[coarse])[:, None]
    assert (np.abs(accelerations).max(axis=0) <= LIMITS.acceleration * 1.1).all()


def test_one_joint_takes_the_time_of_a_trapezoidal_velocity() -> None:
    goal = np.array([2.0, 0.0, 0.0])
    trajectory = retimed(NAMES, rounded_polyline(np.array([np.zeros(3), goal]), SCALE, always_free), LIMITS)
    velocity, acceleration = float(LIMITS.velocity[0]), float(LIMITS.acceleration[0])
    shortest = 2.0 / velocity + velocity / acceleration
    assert shortest <= trajectory.duration_s <= 1.06 * shortest
    check_limits(trajectory)


@pytest.mark.parametrize("angle", [0.05, 0.002, 2e-5])
def test_a_short_motion_takes_the_time_of_a_triangular_velocity(angle: float) -> None:
    goal = np.array([0.0, angle, 0.0])
    trajectory = retimed(NAMES, rounded_polyline(np.array([np.zeros(3), goal]), SCALE, always_free), LIMITS)
    shortest = 2 * sqrt(angle / float(LIMITS.acceleration[1]))
    assert shortest <= trajectory.duration_s <= 1.08 * shortest


def test_a_motion_to_where_the_joints_are_takes_one_period() -> None:
    points = np.array([np.ones(3), np.ones(3) + 1e-6])
    assert rounded_polyline(points, SCALE, always_free) == []
    assert retimed(NAMES, [resting_path(points[0])], LIMITS).duration_s == pytest.approx(0.05)


@each_case("seed", range(6))
def test_no_limit_is_exceeded_on_polylines(seed: int) -> None:
    points = np.random.default_rng(seed).uniform(-2.0, 2.0, (5, 3))
    pieces = rounded_polyline(points, SCALE, always_free)
    assert len(pieces) == 1
    trajectory = retimed(NAMES, pieces, LIMITS)
    check_limits(trajectory)
    assert trajectory.points[0].positions == pytest.approx(points[0])
    assert trajectory.points[-1].positions == pytest.approx(points[-1])
    assert trajectory.points[0].velocities == trajectory.points[-1].velocities == (0.0, 0.0, 0.0)
    _, positions, _ = samples(trajectory)
    for corner in points:
        assert np.linalg.norm(positions - corner, axis=1).min() < 0.13


def test_positions_are_on_the_polyline_but_for_its_corners() -> None:
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]])
    _, positions, _ = samples(retimed(NAMES, rounded_polyline(points, SCALE, always_free, blend=0.2), LIMITS))
    away = np.linalg.norm(positions - [1.0, 0.0, 0.0], axis=1) > 0.21
    off = np.minimum(np.abs(positions[:, 1]), np.abs(positions[:, 0] - 1.0))
    assert off[away].max() < 2e-3
    assert off.max() < 0.2 / 4 + 5e-3


def test_the_motion_rests_at_a_corner_that_cannot_be_rounded() -> None:
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]])

    def is_free(values: Array) -> bool:
        return bool(min(abs(values[1]), abs(values[0] - 1.0)) < 1e-9)

    pieces = rounded_polyline(points, SCALE, is_free)
    assert len(pieces) == 2
    trajectory = retimed(NAMES, pieces, LIMITS)
    at_corner = [each for each in trajectory.points if each.positions == pytest.approx(points[1])]
    assert [each.velocities for each in at_corner] == [(0.0, 0.0, 0.0)]
    check_limits(trajectory)


def test_a_spline_goes_through_its_points() -> None:
    angles = np.linspace(0.0, 2.0, 25)
    points = np.stack([np.cos(angles), np.sin(angles), 0.1 * angles], axis=1)
    trajectory = retimed(NAMES, [spline_path(points, SCALE)], LIMITS)
    check_limits(trajectory)
    _, positions, _ = samples(trajectory)
    for point in points:
        assert np.linalg.norm(positions - point, axis=1).min() < 5e-3
    assert np.abs(np.hypot(positions[:, 0], positions[:, 1]) - 1.0).max() < 2e-3


def test_a_further_limit_slows_the_motion_down() -> None:
    path = spline_path(np.linspace([0.0, 0.0, 0.0], [0.0, 1.0, 0.0], 5), SCALE)
    slow = retimed(NAMES, [path], LIMITS, speed_limits=[np.full(len(path.parameter), 0.1)])
    assert slow.duration_s >= 10.0
    assert max(abs(each.velocities[1]) for each in slow.points if each.velocities) <= 0.1 + 1e-9


def test_a_point_that_is_repeated_does_no_harm() -> None:
    points = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.5, 0.0, 0.0]])
    trajectory = retimed(NAMES, rounded_polyline(points, SCALE, always_free), LIMITS)
    assert trajectory.points[-1].positions == pytest.approx((0.5, 0.0, 0.0))
    assert rounded_polyline(points[:2], SCALE, always_free) == []


def test_a_speed_out_of_range_is_refused() -> None:
    with pytest.raises(InvalidArgumentError, match="speed"):
        MotionLimits.of(JOINTS, speed=1.5)
