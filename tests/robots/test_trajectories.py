"""Trajectories: interpolation as in ROS 2's joint_trajectory_controller, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicHermiteSpline

from mindstage.errors import CommandRefusedError
from mindstage.robots.models.robot_model import RobotJoint, RobotJointType
from mindstage.robots.trajectories import JointSpline, JointTrajectory, TrajectoryPoint, point_to_point, spline_of
from tests.cases import each_case

LIFT = RobotJoint(
    name="lift", type=RobotJointType.PRISMATIC, parent="a", child="b", lower=0.0, upper=1.0, velocity=0.5, effort=100.0
)
ELBOW = RobotJoint(
    name="elbow", type=RobotJointType.REVOLUTE, parent="b", child="c", lower=-2.0, upper=2.0, velocity=2.0, effort=50.0
)
WHEEL = RobotJoint(name="wheel", type=RobotJointType.CONTINUOUS, parent="c", child="d", velocity=3.0)
LIMITS = {joint.name: joint for joint in (LIFT, ELBOW, WHEEL)}


def point(time_s: float, *positions: float, velocities=None, accelerations=None) -> TrajectoryPoint:
    return TrajectoryPoint(positions=positions, time_s=time_s, velocities=velocities, accelerations=accelerations)


def spline(trajectory: JointTrajectory, state: dict[str, float] | None = None, **options) -> JointSpline:
    now = {"lift": 0.0, "elbow": 0.0, "wheel": 0.0} | (state or {})
    return spline_of(trajectory, robot="tester", limits=LIMITS, state=now, **options)


def refusal(trajectory: JointTrajectory, state: dict[str, float] | None = None) -> str:
    with pytest.raises(CommandRefusedError) as caught:
        spline(trajectory, state)
    assert caught.value.robot == "tester"
    return str(caught.value)


def test_positions_alone_are_interpolated_linearly() -> None:
    found = spline(JointTrajectory(("elbow",), (point(0.0, 0.0), point(1.0, 1.0), point(3.0, 0.0))))
    positions, velocities = found.sample(0.25)
    assert positions[0] == pytest.approx(0.25)
    assert velocities[0] == pytest.approx(1.0)
    assert found.sample(2.0)[0][0] == pytest.approx(0.5)


def test_velocities_give_the_cubic_hermite_spline_of_scipy() -> None:
    times, positions, velocities = [0.0, 0.7, 2.0], [0.0, 0.5, -0.3], [0.0, 0.4, 0.0]
    points = [point(t, p, velocities=(v,)) for t, p, v in zip(times, positions, velocities, strict=True)]
    found = spline(JointTrajectory(("elbow",), tuple(points)))
    reference = CubicHermiteSpline(times, positions, velocities)
    for time_s in np.linspace(0.0, 1.999, 40):
        position, velocity = found.sample(time_s)
        assert position[0] == pytest.approx(float(reference(time_s)), abs=1e-12)
        assert velocity[0] == pytest.approx(float(reference(time_s, 1)), abs=1e-12)


@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-0.3, 0.3), st.floats(1.0, 3.0))
@settings(max_examples=50, deadline=None)
def test_accelerations_give_a_quintic_that_meets_all_six_conditions(p1, v1, a1, p2, t) -> None:
    points = (
        point(0.0, 0.0, velocities=(0.0,), accelerations=(0.0,)),
        point(t, p1, velocities=(v1,), accelerations=(a1,)),
        point(2 * t, p2, velocities=(0.0,), accelerations=(0.0,)),
    )
    found = spline(JointTrajectory(("elbow",), points))
    for time_s, position, velocity in ((0.0, 0.0, 0.0), (t, p1, v1), (2 * t - 1e-9, p2, 0.0)):
        sampled = found.sample(time_s)
        assert sampled[0][0] == pytest.approx(position, abs=1e-6)
        assert sampled[1][0] == pytest.approx(velocity, abs=1e-6)
    h = 1e-4
    acceleration = (found.sample(t + h)[1][0] - found.sample(t)[1][0]) / h
    assert acceleration == pytest.approx(a1, abs=0.05)


def test_a_trajectory_without_a_point_at_time_0_starts_at_the_state_and_its_velocity() -> None:
    trajectory = JointTrajectory(("elbow",), (point(1.0, 1.0, velocities=(0.0,)),))
    found = spline(trajectory, {"elbow": 0.4}, velocities={"elbow": 0.5})
    positions, velocities = found.sample(0.0)
    assert positions[0] == pytest.approx(0.4)
    assert velocities[0] == pytest.approx(0.5)
    assert found.end[0] == pytest.approx(1.0)


def test_before_the_start_and_after_the_end_it_rests() -> None:
    found = spline(JointTrajectory(("lift",), (point(0.0, 0.0), point(1.0, 0.3))))
    assert found.sample(-1.0)[1].tolist() == [0.0]
    assert found.sample(5.0)[0].tolist() == pytest.approx([0.3])
    assert found.sample(5.0)[1].tolist() == [0.0]


def test_a_continuous_joint_takes_the_nearest_turn() -> None:
    found = spline(JointTrajectory(("wheel",), (point(2.0, 0.5),)), {"wheel": 4 * math.pi})
    assert found.end[0] == pytest.approx(4 * math.pi + 0.5)


def test_a_continuous_joint_makes_the_turns_that_are_asked_for() -> None:
    found = spline(JointTrajectory(("wheel",), (point(4.0, 10.0),)))
    assert found.end[0] == pytest.approx(10.0)
    back = spline(JointTrajectory(("wheel",), (point(9.0, -7.0),)), {"wheel": 10.0})
    assert back.end[0] == pytest.approx(-7.0)
    message = refusal(JointTrajectory(("wheel",), (point(1.0, 54.0),)))
    assert "wheel with 54 rad/s" in message
    assert "its velocity limit is 3 rad/s" in message


def test_a_trajectory_that_begins_at_time_0_begins_at_the_turn_of_the_state() -> None:
    points = (point(0.0, 0.0), point(4.0, 10.0), point(9.0, 0.0))
    found = spline(JointTrajectory(("wheel",), points), {"wheel": 4 * math.pi})
    assert found.sample(0.0)[0][0] == pytest.approx(4 * math.pi)
    assert found.sample(4.0)[0][0] == pytest.approx(4 * math.pi + 10.0)
    assert found.end[0] == pytest.approx(4 * math.pi)


@each_case(
    ("trajectory", "words"),
    [
        (JointTrajectory(("wrist",), (point(1.0, 0.0),)), ["wrist", "lift, elbow, wheel"]),
        (JointTrajectory(("lift", "lift"), (point(1.0, 0.0, 0.0),)), ["twice"]),
        (JointTrajectory(("lift",), ()), ["no points"]),
        (JointTrajectory(("lift", "elbow"), (point(1.0, 0.0),)), ["point 1", "1 positions for 2 joints"]),
        (JointTrajectory(("lift",), (point(1.0, math.nan),)), ["point 1", "not finite"]),
        (JointTrajectory(("lift",), (point(1.0, 0.1), point(1.0, 0.2))), ["point 2", "1 s"]),
        (JointTrajectory(("lift",), (point(-1.0, 0.1),)), ["-1 s"]),
        (JointTrajectory(("lift",), (point(4.0, 1.2),)), ["lift = 1.2 m", "upper limit is 1 m"]),
        (JointTrajectory(("elbow",), (point(9.0, -2.5),)), ["elbow = -2.5 rad", "lower limit is -2 rad"]),
        (JointTrajectory(("lift",), (point(1.0, 0.9),)), ["lift with 0.9 m/s", "0.5 m/s"]),
        (JointTrajectory(("elbow",), (point(0.0, 1.0), point(2.0, 1.5))), ["start at elbow = 1 rad", "at 0 rad"]),
        (JointTrajectory(("elbow",), (point(1.0, 0.5, velocities=(0.3,)),)), ["elbow still moves", "0.3"]),
    ],
)
def test_a_trajectory_is_refused_with_the_joint_the_value_and_the_limit(trajectory, words) -> None:
    message = refusal(trajectory)
    assert all(word in message for word in words), message


def test_a_cubic_is_refused_where_it_is_quickest_between_its_points() -> None:
    slow_ends = (point(0.0, 0.0, velocities=(0.0,)), point(1.0, 1.5, velocities=(0.0,)))
    assert "elbow with 2.25 rad/s" in refusal(JointTrajectory(("elbow",), slow_ends))


def test_a_spline_that_swings_beyond_a_limit_between_its_points_is_refused() -> None:
    overshoot = (
        point(0.0, 0.0, velocities=(0.0,)),
        point(2.0, 1.95, velocities=(1.9,)),
        point(2.5, 1.95, velocities=(0.0,)),
    )
    assert "between two points" in refusal(JointTrajectory(("elbow",), overshoot))


def test_rounding_at_a_limit_is_moved_to_it() -> None:
    found = spline(JointTrajectory(("lift",), (point(4.0, 1.00005),)))
    assert found.end[0] == 1.0


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(0.05, 1.0))
@settings(max_examples=60, deadline=None)
def test_point_to_point_is_always_accepted_and_within_its_share_of_the_speed(l0, l1, e0, e1, speed) -> None:
    trajectory = point_to_point((LIFT, ELBOW), (l0, e0), (l1, e1), speed=speed)
    found = spline(trajectory, {"lift": l0, "elbow": e0})
    velocities = np.array([found.sample(t)[1] for t in np.linspace(0.0, found.duration_s, 100)])
    assert np.abs(velocities[:, 0]).max() <= 0.5 * speed * 1.001
    assert np.abs(velocities[:, 1]).max() <= 2.0 * speed * 1.001
    assert found.end.tolist() == pytest.approx([l1, e1])
