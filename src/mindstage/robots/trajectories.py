"""Joint trajectories: what they may be, and the positions and velocities between their points.

Between two points a trajectory is interpolated as ROS 2's `joint_trajectory_controller` does: linearly if either end
has no velocities, by a cubic spline if both have velocities, by a quintic one if both have accelerations too. Lengths
are in meters, angles in radians.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import msgspec
import numpy as np

from mindstage.errors import CommandRefusedError
from mindstage.robots.models.robot_model import RobotJoint, RobotJointType
from mindstage.scene.transforms import Array

__all__ = ["JointSpline", "JointTrajectory", "TrajectoryPoint", "point_to_point", "spline_of"]

START_TOLERANCES = {True: 0.02, False: 0.1}
"""Largest distance between a first point at time 0 and the state, of a prismatic [m] and of a revolute joint [rad]."""
_LIMIT_SLACK = 1e-4
"""A point may be so far beyond a limit by rounding [m or rad]; it is then moved to the limit."""
_VELOCITY_SLACK = 1.01
"""Factor of the velocity limit that is not yet refused."""
_BETWEEN_SLACKS = dict.fromkeys(RobotJointType, 1e-2) | {RobotJointType.PRISMATIC: 1e-3}
"""How far a spline may be beyond a limit between points [m or rad]: limits are soft, and the state may be one end."""
_END_VELOCITY = 1e-3
"""The largest velocity at the end of a trajectory [rad/s or m/s]."""
_SAMPLES = 33
"""Number of points of a quintic segment at which its velocity is checked."""
_MIN_DURATION_S = 0.05
_QUINTIC_PEAK_VELOCITY = 1.875
"""Peak velocity of a quintic from rest to rest of length 1 in time 1."""
_QUINTIC_PEAK_ACCELERATION = 10.0 / math.sqrt(3.0)
"""Peak acceleration of that quintic; dimensionless, as the velocity."""


class TrajectoryPoint(msgspec.Struct, frozen=True, kw_only=True):
    """Where joints are at one time."""

    positions: tuple[float, ...]
    """[m or rad], in the order of the joints."""
    time_s: float
    """Simulated time since the start of the trajectory [s]."""
    velocities: tuple[float, ...] | None = None
    """[m/s or rad/s]."""
    accelerations: tuple[float, ...] | None = None
    """[m/s² or rad/s²]."""


class JointTrajectory(msgspec.Struct, frozen=True):
    """Positions of joints over time, as in `trajectory_msgs/JointTrajectory`.

    If the first point is later than time 0, the trajectory starts at the current state.
    """

    joints: tuple[str, ...]
    """Names of joints with drives."""
    points: tuple[TrajectoryPoint, ...]
    """At increasing times."""

    @property
    def duration_s(self) -> float:
        """The time of the last point [s]."""
        return self.points[-1].time_s if self.points else 0.0


@dataclass(frozen=True, slots=True, eq=False)
class JointSpline:
    """A trajectory that has been checked, as polynomials."""

    joints: tuple[str, ...]
    times: Array
    """Times of the n + 1 points, the first one 0 [s]."""
    coefficients: Array
    """n x 6 x joints: of the powers 0 to 5 of the time since the begin of each segment."""

    @property
    def duration_s(self) -> float:
        """The time of the last point [s]."""
        return float(self.times[-1])

    @property
    def end(self) -> Array:
        """The last positions [m or rad]."""
        return self.sample(self.duration_s)[0]

    def sample(self, time_s: float) -> tuple[Array, Array]:
        """The positions [m or rad] and velocities at a time [s]; at rest before the first and after the last point."""
        moving = self.times[0] <= time_s < self.times[-1]
        time_s = min(max(time_s, float(self.times[0])), float(self.times[-1]))
        segment = min(int(np.searchsorted(self.times, time_s, side="right")) - 1, len(self.coefficients) - 1)
        powers = (time_s - self.times[segment]) ** np.arange(6)
        c = self.coefficients[segment]
        velocities = (np.arange(1, 6) * powers[:5]) @ c[1:]
        return powers @ c, velocities if moving else np.zeros(len(self.joints))


def spline_of(
    trajectory: JointTrajectory,
    *,
    robot: str,
    limits: Mapping[str, RobotJoint],
    state: Mapping[str, float],
    velocities: Mapping[str, float] | None = None,
) -> JointSpline:
    """Checks a trajectory, and computes its polynomials.

    The positions of a continuous joint are shifted by whole turns to where the trajectory begins nearest to its state,
    if it begins at time 0, or has no position beyond one turn. Otherwise they are taken literally: the joint makes
    these turns, or the trajectory is refused for lack of time.

    Args:
        robot: the name of the robot, for errors.
        limits: the joints that have drives, by name.
        state: their current positions [m or rad].
        velocities: their current velocities, with which a trajectory without a point at time 0 starts; by default 0.

    Raises:
        CommandRefusedError: a joint is unknown or named twice, a number is missing or not finite, the times do not
            increase, a position or a velocity is beyond its limit, the start is too far from the state, or the last
            velocity is not 0.
    """
    _check_form(trajectory, limits, robot)
    joints = [limits[name] for name in trajectory.joints]
    times = np.array([point.time_s for point in trajectory.points])
    positions = np.array([point.positions for point in trajectory.points], dtype=float)
    now = np.array([state[name] for name in trajectory.joints])
    for column, joint in enumerate(joints):
        is_angle = times[0] == 0.0 or float(np.abs(positions[:, column]).max()) <= 2 * math.pi
        if joint.type is RobotJointType.CONTINUOUS and is_angle:
            turns = round((now[column] - positions[0, column]) / (2 * math.pi))
            positions[:, column] += turns * 2 * math.pi
    _check_positions(joints, times, positions, robot)
    speeds = [_row(point.velocities) for point in trajectory.points]
    accelerations = [_row(point.accelerations) for point in trajectory.points]
    if times[0] > 0.0:
        times = np.concatenate([[0.0], times])
        positions = np.vstack([now, positions])
        at_rest = np.zeros(len(joints))
        first = np.array([(velocities or {}).get(name, 0.0) for name in trajectory.joints])
        speeds = [first if speeds[0] is not None else None, *speeds]
        accelerations = [at_rest if accelerations[0] is not None else None, *accelerations]
    else:
        _check_start(joints, positions[0], now, robot)
    if len(times) == 1:  # a single point at time 0
        times, positions = np.array([0.0, _MIN_DURATION_S]), np.vstack([positions, positions])
        speeds, accelerations = speeds * 2, accelerations * 2
    coefficients = np.stack(
        [_segment(times, positions, speeds, accelerations, segment=segment) for segment in range(len(times) - 1)]
    )
    spline = JointSpline(trajectory.joints, times, coefficients)
    _check_extremes(spline, joints, robot)
    return spline


def point_to_point(
    joints: Sequence[RobotJoint],
    start: Sequence[float],
    end: Sequence[float],
    *,
    speed: float = 0.8,
    default_velocity: float = 1.0,
    ramp_s: float = 0.3,
) -> JointTrajectory:
    """The trajectory that moves joints from rest to rest, all in the same time, without regard to obstacles.

    Args:
        start: their positions at the start [m or rad].
        end: their positions at the end [m or rad].
        speed: the fraction of their velocity limits that is used.
        default_velocity: the limit of a joint without one [m/s or rad/s].
        ramp_s: the time in which a joint reaches its largest velocity at least [s].
    """
    duration_s = _MIN_DURATION_S
    for joint, first, last in zip(joints, start, end, strict=True):
        limit = speed * (joint.velocity or default_velocity)
        distance = abs(last - first)
        duration_s = max(
            duration_s,
            _QUINTIC_PEAK_VELOCITY * distance / limit,
            math.sqrt(_QUINTIC_PEAK_ACCELERATION * distance * ramp_s / limit),
        )
    zero = (0.0,) * len(joints)
    return JointTrajectory(
        tuple(joint.name for joint in joints),
        (
            TrajectoryPoint(positions=tuple(start), velocities=zero, accelerations=zero, time_s=0.0),
            TrajectoryPoint(positions=tuple(end), velocities=zero, accelerations=zero, time_s=duration_s),
        ),
    )


def _refused(robot: str, command: str, cause: str, remedy: str) -> CommandRefusedError:
    return CommandRefusedError(robot, command=command, cause=cause, remedy=remedy)


def _row(values: tuple[float, ...] | None) -> Array | None:
    return np.array(values, dtype=float) if values else None


def _check_form(trajectory: JointTrajectory, limits: Mapping[str, RobotJoint], robot: str) -> None:
    """Refuses unknown joints, numbers that are missing or not finite, and times that do not increase."""
    what = "a trajectory"
    if not trajectory.points or not trajectory.joints:
        raise _refused(robot, what, "it has no joints or no points", "give at least one of each")
    for name in trajectory.joints:
        if name not in limits:
            raise _refused(
                robot,
                f"a trajectory of {name!r}",
                "it has no joint with a drive of that name",
                f"use {', '.join(limits)}",
            )
    if len(set(trajectory.joints)) < len(trajectory.joints):
        raise _refused(robot, what, "it names a joint twice", "name each joint once")
    count, before_s = len(trajectory.joints), -math.inf
    for number, point in enumerate(trajectory.points, 1):
        rows = (
            ("positions", point.positions),
            ("velocities", point.velocities),
            ("accelerations", point.accelerations),
        )
        for kind, values in rows:
            if (values and len(values) != count) or (kind == "positions" and not values):
                cause = f"point {number} has {len(values or ())} {kind} for {count} joints"
                raise _refused(robot, what, cause, "give one number for each joint")
            if not all(math.isfinite(value) for value in values or ()):
                raise _refused(robot, what, f"a number in the {kind} of point {number} is not finite", "correct it")
        if not math.isfinite(point.time_s) or point.time_s < 0.0 or point.time_s <= before_s:
            cause = f"the time of point {number}, {point.time_s:g} s, is not after the one before"
            raise _refused(robot, what, cause, "give increasing times from 0")
        before_s = point.time_s
    last = trajectory.points[-1].velocities
    for name, velocity in zip(trajectory.joints, last or (), strict=False):
        if abs(velocity) > _END_VELOCITY:
            cause = f"{name} still moves at the last point, with {velocity:g}"
            raise _refused(robot, what, cause, "end with velocity 0")


def _check_positions(joints: Sequence[RobotJoint], times: Array, positions: Array, robot: str) -> None:
    """Refuses positions beyond a limit; those that are so by rounding are moved to it."""
    for column, joint in enumerate(joints):
        for limit, sign, word in ((joint.lower, -1.0, "lower"), (joint.upper, 1.0, "upper")):
            if limit is None:
                continue
            beyond = sign * (positions[:, column] - limit)
            row = int(np.argmax(beyond))
            if beyond[row] > _LIMIT_SLACK:
                raise _refused(
                    robot,
                    f"{joint.name} = {positions[row, column]:.4g} {joint.unit}",
                    f"its {word} limit is {limit:.4g} {joint.unit} (point {row + 1}, at {times[row]:g} s)",
                    "stay within the limits",
                )
            positions[beyond > 0.0, column] = limit


def _check_start(joints: Sequence[RobotJoint], first: Array, now: Array, robot: str) -> None:
    """Refuses a trajectory whose first point, at time 0, is not where the robot is."""
    for joint, position, current in zip(joints, first.tolist(), now.tolist(), strict=True):
        tolerance = START_TOLERANCES[joint.is_prismatic]
        if abs(position - current) > tolerance:
            raise _refused(
                robot,
                f"a start at {joint.name} = {position:.4g} {joint.unit}",
                f"it is at {current:.4g} {joint.unit}, and the tolerance is {tolerance:g} {joint.unit}",
                "start at the current state, or give the first point a time after 0",
            )


def _segment(
    times: Array,
    positions: Array,
    velocities: Sequence[Array | None],
    accelerations: Sequence[Array | None],
    *,
    segment: int,
) -> Array:
    """The coefficients of one segment, 6 x joints."""
    first, last = positions[segment], positions[segment + 1]
    v0, v1 = velocities[segment], velocities[segment + 1]
    a0, a1 = accelerations[segment], accelerations[segment + 1]
    t = float(times[segment + 1] - times[segment])
    d = last - first
    c = np.zeros((6, positions.shape[1]))
    c[0] = first
    if v0 is None or v1 is None:
        c[1] = d / t
    elif a0 is None or a1 is None:
        c[1] = v0
        c[2] = (3 * d - (2 * v0 + v1) * t) / t**2
        c[3] = (-2 * d + (v0 + v1) * t) / t**3
    else:
        c[1], c[2] = v0, a0 / 2
        c[3] = (20 * d - (8 * v1 + 12 * v0) * t - (3 * a0 - a1) * t**2) / (2 * t**3)
        c[4] = (-30 * d + (14 * v1 + 16 * v0) * t + (3 * a0 - 2 * a1) * t**2) / (2 * t**4)
        c[5] = (12 * d - 6 * (v1 + v0) * t + (a1 - a0) * t**2) / (2 * t**5)
    return c


def _check_extremes(spline: JointSpline, joints: Sequence[RobotJoint], robot: str) -> None:
    """Refuses a spline that between its points is quicker than a joint can move, or swings beyond a limit."""
    durations = np.diff(spline.times)
    fractions = np.linspace(0.0, 1.0, _SAMPLES)
    t = durations[:, None] * fractions
    c = spline.coefficients
    with np.errstate(divide="ignore", invalid="ignore"):  # where a cubic is quickest, exactly
        vertex = np.clip(np.nan_to_num(-c[:, 2] / (3 * c[:, 3])), 0.0, durations[:, None])
    for column, joint in enumerate(joints):
        at = np.concatenate([t, vertex[:, column, None]], axis=1)
        powers = at[..., None] ** np.arange(6)
        position = (powers * c[:, None, :, column]).sum(axis=-1)
        velocity = (powers[..., :5] * (np.arange(1, 6) * c[:, 1:, column])[:, None]).sum(axis=-1)
        if joint.velocity and (peak := float(np.abs(velocity).max())) > joint.velocity * _VELOCITY_SLACK:
            segment = int(np.abs(velocity).max(axis=1).argmax())
            raise _refused(
                robot,
                f"{joint.name} with {peak:.4g} {joint.unit}/s",
                f"its velocity limit is {joint.velocity:.4g} {joint.unit}/s (from {spline.times[segment]:.3g} s on)",
                "give it more time",
            )
        for limit, sign in ((joint.lower, -1.0), (joint.upper, 1.0)):
            if limit is not None and (sign * (position - limit)).max() > _BETWEEN_SLACKS[joint.type]:
                worst = float(position.flat[int((sign * position).argmax())])
                raise _refused(
                    robot,
                    f"{joint.name} = {worst:.4g} {joint.unit} between two points",
                    f"its limit is {limit:.4g} {joint.unit}",
                    "give the points near it smaller velocities",
                )
