"""Motions of the base of a robot: along a path, with a velocity, and to a stop.

A motion moves a reference, which the drives of the base follow. The reference waits while a drive is at its limit, so
that a base that is blocked pushes with its largest force for a moment only.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from mindstage.robots.control import (
    BLOCKED_S,
    PERIOD_S,
    ControlView,
    MotionFailure,
    MotionFeedback,
    MotionGoal,
    MotionOutcome,
    named,
)
from mindstage.robots.drives import BaseDrive
from mindstage.robots.floor_poses import BasePose, wrapped
from mindstage.robots.models.robot_model import BaseType
from mindstage.scene.transforms import Array

__all__ = ["DRIVE_TIMEOUT_S", "BaseBrake", "BaseGoal", "PathGoal", "VelocityGoal", "differential_path"]

DRIVE_TIMEOUT_S = 0.5
"""A velocity of the base is that of the last command for so long at most [s]."""
_BASE_GOAL_TOLERANCES = (0.01, 0.01, 0.02)
"""Largest error of the base at the end of a path: x, y [m], yaw [rad]."""
_BASE_TIMEOUT_S = 2.0
_MAX_LEAD = 1.5
"""The reference of the base leads by at most so many times the error at which its drive is at its limit."""
_CORNER_VELOCITY = 0.1
"""Largest change of the velocity of the base between two segments of a path [m/s]."""
_CORNER_TURN_VELOCITY = 0.25
"""[rad/s]."""
_TURN_TOLERANCE = 0.15
"""A differential base turns on the spot before it drives in a direction that differs by more [rad]."""


class BaseGoal(MotionGoal):
    """Moves the base; subclasses move its reference."""

    def __init__(self, kind: str, base: BaseDrive) -> None:
        super().__init__(kind, base.actuators)
        self._base = base
        self._reference: Array | None = None
        self._velocity = np.zeros(3)
        """Of the reference, in the frame of the base joint."""
        self._blocked_s = 0.0

    def update(self, view: ControlView) -> dict[str, float]:
        """See `MotionGoal`."""
        actual, velocity = view.base(self._base)
        if self._reference is None:
            self._reference = actual
            self.begin(actual)
        lead = self._reference - actual
        saturated = np.abs(lead) >= np.array(self._base.error_limits)
        pose = self._base.world_from_joint(actual)
        desired = self._base.world_from_joint(self._reference)
        self.feedback = MotionFeedback(
            elapsed_s=self.elapsed_s,
            desired=dict(zip(("x", "y", "yaw"), desired, strict=True)),
            actual=dict(zip(("x", "y", "yaw"), pose, strict=True)),
        )
        slow = (np.abs(velocity) < np.array([0.02, 0.02, 0.05])) | ~saturated
        self._blocked_s = self._blocked_s + PERIOD_S if saturated.any() and slow.all() else 0.0
        if self._blocked_s >= BLOCKED_S:
            self._end_blocked(view)
            return self.commands(actual, np.zeros(3), np.zeros(3))
        self.elapsed_s += PERIOD_S
        acceleration = np.zeros(3)
        if saturated.any():
            self._velocity = np.zeros(3)
            self.hold()
        else:
            before = self._velocity
            self._reference, self._velocity = self.advance(self._reference, before, actual)
            most = np.array(self._base.accelerations)
            acceleration = np.clip((self._velocity - before) / PERIOD_S, -most, most)
        limit = _MAX_LEAD * np.array(self._base.error_limits)
        self._reference = np.clip(self._reference, actual - limit, actual + limit)
        self.check(actual, velocity)
        return self.commands(self._reference, self._velocity, acceleration)

    def commands(self, reference: Array, velocity: Array, acceleration: Array) -> dict[str, float]:
        """Commands for a reference, its velocity and acceleration."""
        lags_s = np.array(self._base.lags_s)  # as in `JointGoal`
        values = reference + lags_s * velocity + lags_s**2 / 4.0 * acceleration
        return dict(zip(self._base.actuators, values.tolist(), strict=True))

    def brake(self, view: ControlView, used: frozenset[str]) -> MotionGoal | None:
        """See `MotionGoal`."""
        return None if used & self.actuators else BaseBrake(self._base, self._velocity, self._reference)

    def relaxation(self) -> MotionGoal:
        """See `MotionGoal`: the base stops where it is."""
        return BaseBrake(self._base, np.zeros(3), None)

    def begin(self, actual: Array) -> None:
        """Called before the first update, with the coordinates of the base."""

    def hold(self) -> None:
        """Called instead of `advance` while the base does not follow."""

    def advance(self, reference: Array, velocity: Array, actual: Array) -> tuple[Array, Array]:
        """The reference after the next period, and its velocity."""
        raise NotImplementedError

    def check(self, actual: Array, velocity: Array) -> None:
        """Ends the goal if it is reached."""
        raise NotImplementedError

    def _end_blocked(self, view: ControlView) -> None:
        obstacles = view.obstacles(self._base.moved)
        by = f"blocked by {named(obstacles)}" if obstacles else "the base does not move at its largest force"
        self.end(MotionOutcome.FAILED, by, failure=MotionFailure.BLOCKED, error=self.errors(), obstacles=obstacles)


class BaseBrake(BaseGoal):
    """Stops the base with its largest acceleration."""

    def __init__(self, base: BaseDrive, velocity: Array, reference: Array | None) -> None:
        super().__init__("stop", base)
        self._velocity, self._reference = velocity, reference

    def advance(self, reference: Array, velocity: Array, actual: Array) -> tuple[Array, Array]:
        """See `BaseGoal`."""
        change = np.array(self._base.accelerations) * 2.0 * PERIOD_S  # a stop may be quicker than a drive
        velocity = velocity - np.clip(velocity, -change, change)
        return reference + velocity * PERIOD_S, velocity

    def check(self, actual: Array, velocity: Array) -> None:
        """See `BaseGoal`."""
        if not self._velocity.any():
            self.end(MotionOutcome.SUCCEEDED)


class PathGoal(BaseGoal):
    """Drives the base along poses."""

    def __init__(self, base: BaseDrive, path: Sequence[BasePose], speed: float) -> None:
        super().__init__("path", base)
        self._path = tuple(path)
        self._speed = speed
        self._points = np.zeros((1, 3))
        self._nodes = np.zeros(1)
        self._rates = np.zeros(1)
        """The largest rate of progress at each point, at which it can still stop at the end."""
        self._progress = self._rate = self._late_s = 0.0
        self._acceleration = 1.0

    def command_details(self) -> dict[str, Any]:
        """See `MotionGoal`."""
        return {"path": [list(pose) for pose in self._path]}

    def begin(self, actual: Array) -> None:
        """See `BaseGoal`."""
        points = [actual]
        for pose in self._path:
            point = self._base.joint_from_world(pose)
            point[2] = points[-1][2] + wrapped(point[2] - points[-1][2])
            points.append(point)
        if self._base.type is BaseType.DIFFERENTIAL:
            points = differential_path(points)
        kept = [points[0], *(b for a, b in pairwise(points) if np.abs(b - a).max() > 1e-6)]
        self._points = np.array(kept)
        velocity, turn = self._base.velocity * self._speed, self._base.turn_velocity * self._speed
        steps = np.diff(self._points, axis=0)
        times = np.maximum(np.hypot(steps[:, 0], steps[:, 1]) / velocity, np.abs(steps[:, 2]) / turn)
        self._nodes = np.concatenate([[0.0], np.cumsum(times)])
        self._acceleration = min(self._base.acceleration / velocity, self._base.turn_acceleration / turn)
        self._rates = np.zeros(len(self._points))
        if len(times) > 1:
            vectors = steps / times[:, None]
            jumps = np.diff(vectors, axis=0)
            corner = _CORNER_VELOCITY / np.maximum(np.hypot(jumps[:, 0], jumps[:, 1]), 1e-9)
            turns = _CORNER_TURN_VELOCITY / np.maximum(np.abs(jumps[:, 2]), 1e-9)
            self._rates[1:-1] = np.minimum(1.0, np.minimum(corner, turns))
        for row in range(len(times) - 1, -1, -1):
            reachable = math.sqrt(self._rates[row + 1] ** 2 + 2 * self._acceleration * times[row])
            self._rates[row] = min(self._rates[row], reachable) if row else 0.0

    def hold(self) -> None:
        """See `BaseGoal`."""
        self._rate = 0.0

    def advance(self, reference: Array, velocity: Array, actual: Array) -> tuple[Array, Array]:
        """See `BaseGoal`."""
        if len(self._points) == 1:
            return reference, np.zeros(3)
        row = min(int(np.searchsorted(self._nodes, self._progress, side="right")) - 1, len(self._nodes) - 2)
        left = self._nodes[row + 1] - self._progress
        stop = math.sqrt(self._rates[row + 1] ** 2 + 2 * self._acceleration * max(left, 0.0))
        self._rate = min(1.0, self._rate + self._acceleration * PERIOD_S, stop)
        before, self._progress = self._progress, min(self._progress + self._rate * PERIOD_S, float(self._nodes[-1]))
        if self._nodes[-1] - self._progress < 1e-4:
            self._progress = float(self._nodes[-1])
        point = np.array([np.interp(self._progress, self._nodes, column) for column in self._points.T])
        if self._progress >= self._nodes[-1]:
            return point, np.zeros(3)
        last = np.array([np.interp(before, self._nodes, column) for column in self._points.T])
        return point, (point - last) / PERIOD_S

    def check(self, actual: Array, velocity: Array) -> None:
        """See `BaseGoal`."""
        if self._progress < self._nodes[-1]:
            return
        error = self._points[-1] - actual
        self._late_s += PERIOD_S
        if (np.abs(error) <= _BASE_GOAL_TOLERANCES).all() and (np.abs(velocity) < [0.02, 0.02, 0.05]).all():
            self.end(MotionOutcome.SUCCEEDED, error=self.errors())
        elif self._late_s > _BASE_TIMEOUT_S:
            off = f"{math.hypot(error[0], error[1]):.3f} m and {abs(error[2]):.3f} rad"
            self.end(
                MotionOutcome.FAILED,
                f"the base is {off} from its goal",
                failure=MotionFailure.GOAL_TOLERANCE,
                error=self.errors(),
            )


class VelocityGoal(BaseGoal):
    """Drives the base with a velocity, until it is not commanded any more."""

    def __init__(self, base: BaseDrive) -> None:
        super().__init__("velocity", base)
        self._wanted = np.zeros(3)
        """Velocity in the base frame."""
        self._left_s = DRIVE_TIMEOUT_S

    def command_details(self) -> dict[str, Any]:
        """See `MotionGoal`."""
        return {"velocity": self._wanted.tolist()}

    def command(self, velocity: tuple[float, float, float]) -> None:
        """Sets the velocity in the base frame, for 0.5 s at most."""
        self._wanted, self._left_s = np.array(velocity), DRIVE_TIMEOUT_S

    def advance(self, reference: Array, velocity: Array, actual: Array) -> tuple[Array, Array]:
        """See `BaseGoal`."""
        self._left_s -= PERIOD_S
        wanted = self._wanted if self._left_s > 0.0 else np.zeros(3)
        change = np.array(self._base.accelerations) * PERIOD_S
        own = rotated(velocity, -reference[2])
        own = own + np.clip(wanted - own, -change, change)
        if self._base.type is BaseType.DIFFERENTIAL:
            own[1] = 0.0
        middle = reference[2] + 0.5 * own[2] * PERIOD_S
        velocity = rotated(own, middle)
        return reference + velocity * PERIOD_S, velocity

    def check(self, actual: Array, velocity: Array) -> None:
        """See `BaseGoal`."""
        if self._velocity.any():
            return
        if not self._wanted.any():
            self.end(MotionOutcome.SUCCEEDED)
        elif self._left_s <= 0.0:
            reason = f"no velocity was commanded for {DRIVE_TIMEOUT_S:g} s"
            self.end(MotionOutcome.CANCELED, reason, failure=MotionFailure.TIMEOUT)


def rotated(velocity: Array, yaw: float) -> Array:
    """A planar velocity (x, y, yaw) in a frame that is rotated by -yaw."""
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([c * velocity[0] - s * velocity[1], s * velocity[0] + c * velocity[1], velocity[2]])


def differential_path(points: Sequence[Array]) -> list[Array]:
    """Poses between which a differential base drives straight, forward or backward, or turns on the spot.

    A path whose directions change by little is driven in one go, with a heading that follows it.
    """
    found = [points[0]]
    for goal in points[1:]:
        here = found[-1]
        offset = goal[:2] - here[:2]
        heading = here[2]
        if np.hypot(*offset) > 1e-3:
            forward = here[2] + wrapped(math.atan2(offset[1], offset[0]) - here[2])
            backward = here[2] + wrapped(forward + math.pi - here[2])
            is_backward = abs(wrapped(goal[2] - backward)) < math.pi / 4 and abs(backward - here[2]) < math.pi / 4
            heading = backward if is_backward else forward
            if abs(heading - here[2]) > _TURN_TOLERANCE:
                found.append(np.array([here[0], here[1], heading]))
            found.append(np.array([goal[0], goal[1], heading]))
        yaw = heading + wrapped(goal[2] - heading)
        if abs(yaw - heading) > 1e-6:
            # A small turn belongs to the drive, so that a path of many short parts is driven without stops.
            if abs(yaw - heading) <= _TURN_TOLERANCE and len(found) > 1 and np.hypot(*offset) > 1e-3:
                found[-1] = np.array([goal[0], goal[1], yaw])
            else:
                found.append(np.array([goal[0], goal[1], yaw]))
    return found
