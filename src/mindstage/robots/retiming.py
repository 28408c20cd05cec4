"""Times along paths of joints: as quick as limits of velocity and acceleration allow.

A path is a function q(s) with its first two derivatives, sampled densely. The speed along it is found by reachability
analysis (Pham and Pham 2018, "A new approach to time-optimal path parameterization based on reachability analysis"):
backward, the largest speed at each sample from which the path can still be followed to its end at rest; then forward,
the largest acceleration that stays below it. Corners of a polyline are rounded by parabolas, as Kunz and Stilman 2012
do by arcs, since a corner can only be passed at rest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import ceil
from typing import NamedTuple

import numpy as np

from mindstage.errors import InvalidArgumentError
from mindstage.robots.models.robot_model import RobotJoint
from mindstage.robots.trajectories import JointTrajectory, TrajectoryPoint
from mindstage.scene.transforms import Array

__all__ = ["MotionLimits", "PathSamples", "resting_path", "retimed", "rounded_polyline", "spline_path"]

_DEFAULT_VELOCITIES = {True: 0.15, False: 1.0}
"""Of prismatic [m/s] and other joints [rad/s] without a limit in their description."""
_MAX_ACCELERATIONS = {True: 0.8, False: 4.0}
"""Of prismatic [m/s²] and other joints [rad/s²]; descriptions have none."""
_SPEED_UP_S = 0.25
"""Shortest time in which a joint gets to its largest velocity [s]."""
_MARGIN = 0.97
"""Part of the limits that is used, since velocities are limited at samples only."""
_PERIOD_S = 0.05
"""Time between two points of a trajectory [s]."""
_SAMPLES_OF_BLEND = 13
"""Number of samples of a rounded corner."""
_MIN_LINE_SAMPLES = 3
"""It is at rest at both ends, so that it can only move at a sample between them."""
_LEAST_STEP = 1e-5
"""Corners that are nearer to the one before count as equal to it."""
_LEAST_SPEED = 1e-6
"""Of the parameter of a path, by which the time of its steps is limited [1/s]."""
_MIN_SAMPLES = 33
_MAX_GAP = 0.02
"""Largest distance between two samples of a path, in units of its parameter."""
_MIN_BLEND = 1e-3
"""Smaller blends are left out; in the metric of the path [rad or m]."""
_MIN_SPREAD = 0.3
"""Least distance between two points of a spline as part of the median."""
_CANDIDATES = 48
"""Number of squared speeds that are compared at a sample."""
_REFINEMENTS = 2
"""How often the interval between two of them is divided anew."""


class MotionLimits(NamedTuple):
    """The ranges, largest velocities and accelerations of joints."""

    velocity: Array
    """[m/s or rad/s]."""
    acceleration: Array
    """[m/s² or rad/s²]."""
    lower: Array
    """[m or rad]; infinite without a limit."""
    upper: Array

    @classmethod
    def of(cls, joints: Sequence[RobotJoint], *, speed: float = 1.0) -> MotionLimits:
        """The limits of some joints.

        Args:
            speed: the part of their velocity limits that is used, above 0, at most 1.

        Raises:
            InvalidArgumentError: the speed is out of range.
        """
        if not 0.0 < speed <= 1.0:
            raise InvalidArgumentError("speed", cause=f"{speed:g} is out of range", remedy="give above 0, at most 1")
        is_slide = [joint.is_prismatic for joint in joints]
        velocity = np.array(
            [joint.velocity or _DEFAULT_VELOCITIES[slide] for joint, slide in zip(joints, is_slide, strict=True)]
        )
        largest = np.array([_MAX_ACCELERATIONS[slide] for slide in is_slide])
        lower, upper = np.array([joint.limits for joint in joints]).T
        acceleration = np.minimum(velocity * speed / _SPEED_UP_S, largest)
        return cls(velocity * speed, acceleration, lower, upper)


class PathSamples(NamedTuple):
    """A smooth path, sampled at increasing values of its parameter."""

    parameter: Array
    """n values."""
    positions: Array
    """n x k [m or rad]."""
    first: Array
    """n x k: the derivative by the parameter."""
    second: Array
    """n x k: the second derivative."""

    def joined(self, other: PathSamples) -> PathSamples:
        """This path and one that continues it; its first sample replaces the last one of this."""
        shifted = other.parameter + self.parameter[-1]
        parts = zip(self[1:], other[1:], strict=True)
        return PathSamples(np.concatenate([self.parameter[:-1], shifted]), *(np.vstack([a[:-1], b]) for a, b in parts))


def rounded_polyline(
    points: Array, scale: Array, is_free: Callable[[Array], bool], *, blend: float = 0.25
) -> list[PathSamples]:
    """A polyline with rounded corners, cut at the corners that cannot be rounded.

    Args:
        points: n x k corners, at least two [m or rad].
        scale: for each joint, the displacement that counts as 1 in distances.
        is_free: whether a rounded corner may be passed through some positions.
        blend: the largest distance between a corner and the beginning of its rounding.
    """
    kept = [points[0]]
    for point in points[1:]:
        if np.linalg.norm((point - kept[-1]) / scale) > _LEAST_STEP:
            kept.append(point)
    if len(kept) < 2:
        return []
    corners = np.array(kept)
    steps = np.diff(corners, axis=0)
    lengths = np.linalg.norm(steps / scale, axis=1)
    directions = steps / lengths[:, None]
    radii = [0.0]
    for number in range(1, len(corners) - 1):
        radius = min(blend, 0.45 * float(lengths[number - 1]), 0.45 * float(lengths[number]))
        before, after = directions[number - 1], directions[number]
        while radius > _MIN_BLEND and not all(
            map(is_free, _parabola(corners[number], before, after, radius).positions)
        ):
            radius /= 2
        radii.append(radius if radius > _MIN_BLEND else 0.0)
    radii.append(0.0)
    pieces: list[PathSamples] = []
    for number, direction in enumerate(directions):
        start = corners[number] + radii[number] * direction
        line = _line(start, direction, float(lengths[number]) - radii[number] - radii[number + 1])
        if number and radii[number]:
            turn = _parabola(corners[number], directions[number - 1], direction, radii[number])
            pieces[-1] = pieces[-1].joined(turn).joined(line)
        else:
            pieces.append(line)
    return pieces


def _line(start: Array, direction: Array, length: float) -> PathSamples:
    parameter = np.linspace(0.0, length, max(_MIN_LINE_SAMPLES, ceil(length / _MAX_GAP) + 1))
    first = np.broadcast_to(direction, (len(parameter), len(start))).copy()
    return PathSamples(parameter, start + parameter[:, None] * direction, first, np.zeros_like(first))


def _parabola(corner: Array, before: Array, after: Array, radius: float) -> PathSamples:
    """The parabola from `radius` before a corner to as far behind it, whose parameter is that of the lines there."""
    parameter = np.linspace(0.0, 2 * radius, _SAMPLES_OF_BLEND)
    bend = (after - before) / (4 * radius)
    first = before + 2 * parameter[:, None] * bend
    positions = corner - radius * before + parameter[:, None] * before + parameter[:, None] ** 2 * bend
    return PathSamples(parameter, positions, first, np.broadcast_to(2 * bend, first.shape).copy())


def spline_path(points: Array, scale: Array) -> PathSamples:
    """The natural cubic spline through dense points, such as those of a straight line of the gripper.

    Args:
        points: n x k; all equal for a path that stays there [m or rad].
        scale: see `rounded_polyline`.
    """
    points = _spread(points, scale)
    if len(points) == 1:
        return resting_path(points[0])
    knots = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0) / scale, axis=1))])
    h, count = np.diff(knots), len(points)
    moments = np.zeros_like(points)
    if count > 2:
        matrix = np.diag(2 * (h[:-1] + h[1:])) + np.diag(h[1:-1], 1) + np.diag(h[1:-1], -1)
        slopes = np.diff(points, axis=0) / h[:, None]
        moments[1:-1] = np.linalg.solve(matrix, 6 * np.diff(slopes, axis=0))
    parameter = np.unique(np.concatenate([knots, np.linspace(0.0, knots[-1], max(_MIN_SAMPLES, 2 * count))]))
    at = np.clip(np.searchsorted(knots, parameter, side="right") - 1, 0, count - 2)
    left, right = (parameter - knots[at])[:, None], (knots[at + 1] - parameter)[:, None]
    width, m0, m1, p0, p1 = h[at][:, None], moments[at], moments[at + 1], points[at], points[at + 1]
    linear0, linear1 = p0 / width - m0 * width / 6, p1 / width - m1 * width / 6
    positions = (m0 * right**3 + m1 * left**3) / (6 * width) + linear0 * right + linear1 * left
    first = (m1 * left**2 - m0 * right**2) / (2 * width) + linear1 - linear0
    return PathSamples(parameter, positions, first, (m0 * right + m1 * left) / width)


def _spread(points: Array, scale: Array) -> Array:
    """Points without those that are much nearer to the one before than others: there a spline would swing."""
    lengths = np.linalg.norm(np.diff(points, axis=0) / scale, axis=1)
    least = max(1e-6, _MIN_SPREAD * float(np.median(lengths)) if len(lengths) else 0.0)
    kept = [0]
    for row in range(1, len(points)):
        if np.linalg.norm((points[row] - points[kept[-1]]) / scale) > least:
            kept.append(row)
    if kept[-1] != len(points) - 1:  # the last point counts, not one just before it
        kept[-1 if len(kept) > 1 else len(kept) :] = [len(points) - 1]
        if np.linalg.norm((points[-1] - points[0]) / scale) <= 1e-6:
            kept = [0]
    return points[kept]


def resting_path(point: Array) -> PathSamples:
    """A path that stays where it is, for one period."""
    return PathSamples(
        np.array([0.0, _PERIOD_S * _LEAST_SPEED / 2]), np.tile(point, (2, 1)), *np.zeros((2, 2, len(point)))
    )


def retimed(
    joints: Sequence[str],
    pieces: Sequence[PathSamples],
    limits: MotionLimits,
    *,
    speed_limits: Sequence[Array] | None = None,
) -> JointTrajectory:
    """The quickest trajectory along paths, at rest where one ends and the next one begins.

    Args:
        joints: the names of the joints.
        limits: velocities and accelerations.
        speed_limits: for each path and sample, a further limit of the derivative of the parameter by time; None for
            none.
    """
    points: list[TrajectoryPoint] = []
    start_s = 0.0
    for number, piece in enumerate(pieces):
        extra = speed_limits[number] if speed_limits is not None else np.full(len(piece.parameter), np.inf)
        times, positions, velocities = _sampled(piece, _squared_speeds(piece, limits, extra))
        inside = np.clip(positions, limits.lower, limits.upper)  # splines swing beyond by little
        velocities[inside != positions] = 0.0
        for t, position, velocity in zip(times.tolist(), inside.tolist(), velocities.tolist(), strict=True):
            if points and t == 0.0:
                continue
            points.append(TrajectoryPoint(positions=tuple(position), velocities=tuple(velocity), time_s=start_s + t))
        start_s += float(times[-1])
    return JointTrajectory(tuple(joints), tuple(points))


def _squared_speeds(path: PathSamples, limits: MotionLimits, extra: Array) -> Array:
    """The squared derivative of the parameter by time at each sample, 0 at both ends."""
    velocity, acceleration = limits.velocity * _MARGIN, limits.acceleration * _MARGIN
    with np.errstate(divide="ignore"):
        highest = np.min((velocity / np.abs(path.first)) ** 2, axis=1)
    highest = np.minimum(highest, extra**2)
    count, gaps = len(path.parameter), np.diff(path.parameter)
    reachable = np.zeros(count)
    for row in range(count - 2, -1, -1):
        low, high = 0.0, float(min(highest[row], 1e6))
        for _ in range(1 + _REFINEMENTS):
            x = np.linspace(low, high, _CANDIDATES)
            u_low, u_high = _accelerations(path, row, x, acceleration)
            u_low = np.maximum(u_low, -x / (2 * gaps[row]))
            u_high = np.minimum(u_high, (reachable[row + 1] - x) / (2 * gaps[row]))
            possible = np.flatnonzero(u_low <= u_high + 1e-12)
            last = int(possible[-1]) if len(possible) else 0
            low, high = float(x[last]), float(x[min(last + 1, _CANDIDATES - 1)])
        reachable[row] = low
    speeds = np.zeros(count)
    for row in range(count - 1):
        x = speeds[row : row + 1]
        u_low, u_high = _accelerations(path, row, x, acceleration)
        u = max(float(u_low[0]), min(float(u_high[0]), (reachable[row + 1] - x[0]) / (2 * gaps[row])))
        speeds[row + 1] = min(max(0.0, x[0] + 2 * u * gaps[row]), max(reachable[row + 1], 0.0))
    return speeds


def _accelerations(path: PathSamples, row: int, x: Array, acceleration: Array) -> tuple[Array, Array]:
    """The least and the largest second derivative of the parameter for squared speeds, each of the shape of `x`."""
    first, second = path.first[row][:, None], path.second[row][:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        a = (-acceleration[:, None] - second * x) / first
        b = (acceleration[:, None] - second * x) / first
    still = np.abs(first) < 1e-9
    low = np.where(still, -np.inf, np.minimum(a, b)).max(axis=0)
    high = np.where(still, np.inf, np.maximum(a, b)).min(axis=0)
    broken = (still & (np.abs(second * x) > acceleration[:, None])).any(axis=0)
    return np.where(broken, np.inf, low), np.where(broken, -np.inf, high)


def _sampled(path: PathSamples, squared: Array) -> tuple[Array, Array, Array]:
    """Times [s], positions and velocities, at intervals of at most `_PERIOD_S`."""
    speeds, gaps = np.sqrt(squared), np.diff(path.parameter)
    durations = 2 * gaps / np.maximum(speeds[:-1] + speeds[1:], _LEAST_SPEED)
    ends = np.concatenate([[0.0], np.cumsum(durations)])
    times = np.linspace(0.0, ends[-1], max(2, ceil(ends[-1] / _PERIOD_S) + 1))
    row = np.clip(np.searchsorted(ends, times, side="right") - 1, 0, len(gaps) - 1)
    since = times - ends[row]
    change = (speeds[row + 1] - speeds[row]) / durations[row]
    at = path.parameter[row] + speeds[row] * since + change * since**2 / 2
    fraction = np.clip((at - path.parameter[row]) / gaps[row], 0.0, 1.0)[:, None]
    width, p0, p1 = gaps[row][:, None], path.positions[row], path.positions[row + 1]
    d0, d1 = path.first[row] * width, path.first[row + 1] * width
    f2, f3 = fraction**2, fraction**3
    positions = (2 * f3 - 3 * f2 + 1) * p0 + (f3 - 2 * f2 + fraction) * d0 + (3 * f2 - 2 * f3) * p1 + (f3 - f2) * d1
    slope = (path.first[row] * (1 - fraction) + path.first[row + 1] * fraction) * (speeds[row] + change * since)[
        :, None
    ]
    slope[0] = slope[-1] = 0.0
    positions[-1] = path.positions[-1]
    return times, positions, slope
