"""The controller of a robot: goals for its joints, grippers and base, which command the actuators of the engine.

Every goal has exactly one end, with a reason. Joints without a goal hold their last command, which the engine keeps, so
that a controller without goals does nothing. A newer goal replaces older ones of the same actuators; a joint whose goal
was canceled or replaced stops within 0.1 s. Commands are clamped to the limits of the joints in any case.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from enum import StrEnum
from itertools import pairwise

import msgspec
import numpy as np

from mindstage.engines.base import ActuatorState, Capability, Engine
from mindstage.errors import CommandRefusedError
from mindstage.robots.drives import BaseDrive, JointDrive, RobotDrives
from mindstage.robots.model import BaseType, Gripper
from mindstage.robots.trajectories import JointSpline, JointTrajectory, spline_of
from mindstage.scene import BodyId
from mindstage.scene.transforms import Array

__all__ = [
    "MotionFailure",
    "MotionFeedback",
    "MotionGoal",
    "MotionOutcome",
    "MotionResult",
    "RobotController",
]

PERIOD_S = 0.004
"""The period of control in simulated time [s]."""
DRIVE_TIMEOUT_S = 0.5
"""A velocity of the base is that of the last command for so long at most [s]."""
_BRAKE_S = 0.1
"""The time in which a canceled motion stops [s]."""
_BLOCKED_S = 0.15
"""A joint that has been at its largest effort without moving for so long is blocked [s]."""
_SATURATED = 0.95
"""Fraction of the effort limit that counts as the limit."""
_SLOW = {True: 0.01, False: 0.05}
"""A prismatic [m/s] or revolute joint [rad/s] that is slower does not move."""
_PATH_TOLERANCES = {True: 0.06, False: 0.25}
"""Largest deviation from a trajectory [m or rad], after which it is given up."""
_GOAL_TOLERANCES = {True: 0.01, False: 0.02}
_BASE_GOAL_TOLERANCES = (0.01, 0.01, 0.02)
"""Largest error of the base at the end of a path: x, y [m], yaw [rad]."""
_BASE_TIMEOUT_S = 2.0
_MAX_LEAD = 1.5
"""The reference of the base leads by at most so many times the error at which its drive is at its limit."""
_CORNER_VELOCITY = 0.1
"""Largest change of the velocity of the base between two segments of a path [m/s]."""
_CORNER_TURN_VELOCITY = 0.25
"""[rad/s]."""
_STALLED_S = 0.2
_GRIPPER_TOLERANCE_M = 0.002
_FINGER_VELOCITY_M = 0.1
"""Speed at which the opening of a gripper changes, unless its joints are slower [m/s]."""
_STALLED_VELOCITY_M = 0.002
_TURN_TOLERANCE = 0.15
"""A differential base turns on the spot before it drives in a direction that differs by more [rad]."""


class MotionOutcome(StrEnum):
    """The state of a goal: active, or how it has ended."""

    ACTIVE = "active"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELED = "canceled"


class MotionFailure(StrEnum):
    """Why a goal was not reached."""

    BLOCKED = "blocked"
    """A drive is at its limit, and its joint does not move."""
    PATH_TOLERANCE = "path tolerance"
    """A joint deviates too far from its trajectory."""
    GOAL_TOLERANCE = "goal tolerance"
    """It was not close enough to its end in time."""
    REPLACED = "replaced"
    """A newer goal uses the same actuators."""
    TIMEOUT = "timeout"
    """No velocity was commanded for 0.5 s, and the base had been driven by velocities."""
    RESET = "reset"
    """The world was reset, or the robot removed."""


class MotionResult(msgspec.Struct, frozen=True, kw_only=True):
    """How a motion has ended; truthy if it succeeded."""

    outcome: MotionOutcome
    reason: str = ""
    """In words; it names the bodies that are in the way."""
    duration_s: float = 0.0
    """Simulated time [s]."""
    error: Mapping[str, float] = {}
    """The remaining error of each joint [m or rad]; "x", "y" [m] and "yaw" [rad] of a base, "opening" of a gripper."""
    failure: MotionFailure | None = None
    obstacles: tuple[BodyId, ...] = ()
    """The bodies that were touched when it was blocked, the strongest contact first."""
    stalled: bool = False
    """Whether the fingers of a gripper were stopped by something between them."""

    def __bool__(self) -> bool:
        return self.outcome is MotionOutcome.SUCCEEDED


class MotionFeedback(msgspec.Struct, frozen=True, kw_only=True):
    """The progress of a motion."""

    elapsed_s: float
    """Simulated time since it started [s]."""
    desired: Mapping[str, float]
    """Positions [m or rad] by joint, or "x", "y", "yaw" of a base in the world frame, or "opening" of a gripper."""
    actual: Mapping[str, float]
    desired_velocities: Mapping[str, float] = {}
    actual_velocities: Mapping[str, float] = {}


class ControlView:
    """What a goal reads in one update."""

    def __init__(self, engine: Engine, drives: RobotDrives) -> None:
        self._engine = engine
        self._drives = drives
        self.states: Mapping[str, ActuatorState] = engine.actuator_states()

    def position(self, drive: JointDrive) -> float:
        """The position of a joint [m or rad]."""
        return self.states[drive.actuator].position + drive.zero

    def command(self, drive: JointDrive) -> float:
        """The commanded position of a joint [m or rad]."""
        return self.states[drive.actuator].command + drive.zero

    def positions(self, drives: Sequence[JointDrive]) -> Array:
        """The positions of joints [m or rad]."""
        return np.array([self.position(each) for each in drives])

    def velocities(self, drives: Sequence[JointDrive]) -> Array:
        """The velocities of joints [m/s or rad/s]."""
        return np.array([self.states[each.actuator].velocity for each in drives])

    def base(self, base: BaseDrive) -> tuple[Array, Array]:
        """The coordinates x, y, yaw of the base joint, and their derivatives."""
        states = [self.states[name] for name in base.actuators]
        return np.array([each.position for each in states]), np.array([each.velocity for each in states])

    def obstacles(self, moved: Collection[BodyId]) -> tuple[BodyId, ...]:
        """The bodies that parts of the robot touch, the strongest contact first; and those that what it holds touches.

        Args:
            moved: the bodies of the robot whose contacts count.
        """
        held = frozenset(held_bodies(self._engine, self._drives).values())
        holds = not self._drives.gripper_bodies.isdisjoint(moved)
        return self.touched(held.union(moved) if holds else moved, ignored=held)

    def touched(self, parts: Collection[BodyId], *, ignored: frozenset[BodyId] = frozenset()) -> tuple[BodyId, ...]:
        """The bodies that touch some bodies and do not belong to the robot, the strongest contact first."""
        if Capability.CONTACTS not in self._engine.capabilities:
            return ()
        forces: dict[BodyId, float] = {}
        for contact in self._engine.contacts():
            for one, other in ((contact.a, contact.b), (contact.b, contact.a)):
                if one not in parts or other is None or other in ignored or other in self._drives.link_of_body:
                    continue
                forces[other] = forces.get(other, 0.0) + contact.force_n
        return tuple(sorted(forces, key=forces.__getitem__, reverse=True))


def held_bodies(engine: Engine, drives: RobotDrives) -> dict[str, BodyId]:
    """What each gripper holds: a body that is attached to one of its links, or that two of its fingers touch."""
    found: dict[str, BodyId] = {}
    if Capability.CONTACTS in engine.capabilities and drives.grippers:
        touched: dict[BodyId, set[BodyId]] = {}
        for contact in engine.contacts():
            for one, other in ((contact.a, contact.b), (contact.b, contact.a)):
                if one in drives.gripper_bodies and other is not None and other not in drives.link_of_body:
                    touched.setdefault(other, set()).add(one)
        for name, fingers in drives.finger_bodies.items():
            both = [body for body, by in touched.items() if sum(not by.isdisjoint(each) for each in fingers) > 1]
            if both:
                found[name] = both[0]
    for attachment in engine.snapshot().attachments:
        for name, bodies in drives.hand_bodies.items():
            if attachment.parent in bodies and attachment.child not in drives.link_of_body:
                found[name] = attachment.child
    return found


class MotionGoal:
    """A motion that was started; read it from any thread."""

    def __init__(self, kind: str, actuators: Iterable[str]) -> None:
        self.kind = kind
        """What it is, such as "trajectory"."""
        self.actuators = frozenset(actuators)
        self.elapsed_s = 0.0
        """Simulated time since it started [s]."""
        self.feedback: MotionFeedback | None = None
        """None before the first update."""
        self.result: MotionResult | None = None
        """None while it is active."""
        self._cancel = False

    @property
    def status(self) -> MotionOutcome:
        """Whether it is active, or how it has ended."""
        return MotionOutcome.ACTIVE if self.result is None else self.result.outcome

    def cancel(self) -> None:
        """Ends it at the next update; its joints stop and hold their positions."""
        self._cancel = True

    @property
    def is_canceled(self) -> bool:
        """Whether it ends at the next update."""
        return self._cancel

    def update(self, view: ControlView) -> dict[str, float]:
        """Commands for the next period, by actuator; it may end the goal."""
        raise NotImplementedError

    def brake(self, view: ControlView, used: frozenset[str]) -> MotionGoal | None:
        """The motion that stops its joints, without those whose actuators are used; None if they need none."""
        raise NotImplementedError

    def end(
        self,
        outcome: MotionOutcome,
        reason: str = "",
        *,
        failure: MotionFailure | None = None,
        error: Mapping[str, float] | None = None,
        obstacles: tuple[BodyId, ...] = (),
        stalled: bool = False,
    ) -> None:
        """Ends it, unless it has ended."""
        if self.result is None:
            self.result = MotionResult(
                outcome=outcome,
                reason=reason,
                failure=failure,
                duration_s=round(self.elapsed_s, 6),
                error=error or {},
                obstacles=obstacles,
                stalled=stalled,
            )

    def errors(self) -> dict[str, float]:
        """The difference of what is desired and the state, by name."""
        if self.feedback is None:
            return {}
        return {name: value - self.feedback.actual[name] for name, value in self.feedback.desired.items()}


class _JointGoal(MotionGoal):
    """Moves joints along a spline."""

    def __init__(
        self,
        spline: JointSpline,
        drives: Sequence[JointDrive],
        *,
        tolerance: Mapping[str, float] | float | None = None,
        path_tolerance: Mapping[str, float] | float | None = None,
        goal_time_tolerance_s: float = 2.0,
        kind: str = "trajectory",
    ) -> None:
        super().__init__(kind, (each.actuator for each in drives))
        self._spline = spline
        self._drives = tuple(drives)
        self._tolerance = _tolerances(tolerance, drives, _GOAL_TOLERANCES)
        self._path_tolerance = _tolerances(path_tolerance, drives, _PATH_TOLERANCES)
        self._goal_time_tolerance_s = goal_time_tolerance_s
        self._blocked_s = np.zeros(len(drives))

    @property
    def spline(self) -> JointSpline:
        """Its positions over time."""
        return self._spline

    def desired(self, joint: str) -> tuple[float, float] | None:
        """The current reference of a joint: position and velocity; None if it does not move it."""
        if joint not in self._spline.joints:
            return None
        positions, velocities = self._spline.sample(self.elapsed_s)
        column = self._spline.joints.index(joint)
        return float(positions[column]), float(velocities[column])

    def update(self, view: ControlView) -> dict[str, float]:
        """See `MotionGoal`."""
        drives = self._drives
        reference, speed = self._spline.sample(self.elapsed_s)
        actual, velocities = view.positions(drives), view.velocities(drives)
        self.feedback = MotionFeedback(
            elapsed_s=self.elapsed_s,
            desired=dict(zip(self._spline.joints, reference.tolist(), strict=True)),
            actual=dict(zip(self._spline.joints, actual.tolist(), strict=True)),
            desired_velocities=dict(zip(self._spline.joints, speed.tolist(), strict=True)),
            actual_velocities=dict(zip(self._spline.joints, velocities.tolist(), strict=True)),
        )
        error = reference - actual
        if self._is_stopped(view, error, velocities):
            return {each.actuator: each.clamped(value) for each, value in zip(drives, actual.tolist(), strict=True)}
        if self.elapsed_s >= self._spline.duration_s:
            self._finish(error, velocities)
        self.elapsed_s += PERIOD_S
        target, speed = self._spline.sample(self.elapsed_s)
        return {
            each.actuator: each.clamped(position + each.lag_s * velocity)
            for each, position, velocity in zip(drives, target.tolist(), speed.tolist(), strict=True)
        }

    def brake(self, view: ControlView, used: frozenset[str]) -> MotionGoal | None:
        """See `MotionGoal`."""
        positions, speed = self._spline.sample(self.elapsed_s)
        return brake_joints(positions, speed, self._drives, used)

    def _is_stopped(self, view: ControlView, error: Array, velocities: Array) -> bool:
        """Ends the goal if a joint is blocked or off its path."""
        efforts = np.array([view.states[each.actuator].effort for each in self._drives])
        limits = np.array([each.effort_limit for each in self._drives])
        slow = np.array([_SLOW[each.is_prismatic] for each in self._drives])
        pushes = (np.abs(efforts) >= _SATURATED * limits) & (efforts * error > 0.0) & (np.abs(velocities) < slow)
        self._blocked_s = np.where(pushes, self._blocked_s + PERIOD_S, 0.0)
        blocked = np.flatnonzero(self._blocked_s >= _BLOCKED_S)
        deviating = np.flatnonzero(np.abs(error) > self._path_tolerance)
        if not len(blocked) and not len(deviating):
            return False
        index = int(blocked[0] if len(blocked) else deviating[0])
        drive = self._drives[index]
        moved = frozenset[BodyId]().union(*(each.moved for each in self._drives))
        obstacles = view.obstacles(drive.moved) or view.obstacles(moved)
        unit = "m" if drive.is_prismatic else "rad"
        what = f"{drive.name} is {abs(float(error[index])):.3g} {unit} from its path"
        if len(blocked):
            what = f"{drive.name} does not move at its largest effort ({drive.effort_limit:.3g})"
        failure = MotionFailure.BLOCKED if len(blocked) or obstacles else MotionFailure.PATH_TOLERANCE
        by = f"; in contact with {_named(obstacles)}" if obstacles else ""
        self.end(MotionOutcome.FAILED, what + by, failure=failure, error=self.errors(), obstacles=obstacles)
        return True

    def _finish(self, error: Array, velocities: Array) -> None:
        """Ends the goal if the joints are at rest at its end, or if its time is over."""
        slow = np.array([_SLOW[each.is_prismatic] for each in self._drives])
        is_near = np.abs(error) <= self._tolerance
        if is_near.all() and (np.abs(velocities) <= slow).all():
            self.end(MotionOutcome.SUCCEEDED, error=self.errors())
        elif self.elapsed_s > self._spline.duration_s + self._goal_time_tolerance_s:
            worst = int(np.argmax(np.abs(error) / self._tolerance))
            drive = self._drives[worst]
            unit = "m" if drive.is_prismatic else "rad"
            reason = f"{drive.name} is {abs(float(error[worst])):.3g} {unit} from its goal"
            if is_near.all():
                reason = f"{drive.name} is not at rest"
            self.end(MotionOutcome.FAILED, reason, failure=MotionFailure.GOAL_TOLERANCE, error=self.errors())


class _GripperGoal(MotionGoal):
    """Opens or closes a gripper, with a limited force."""

    def __init__(self, gripper: Gripper, drives: Sequence[JointDrive], opening_m: float, force_n: float) -> None:
        super().__init__("gripper", (each.actuator for each in drives))
        self._gripper = gripper
        self._drives = tuple(drives)
        self._opening_m = opening_m
        closed, opened = np.array(gripper.closed_positions), np.array(gripper.open_positions)
        self._target = closed + opening_m / gripper.max_opening_m * (opened - closed)
        travel = np.maximum(np.abs(opened - closed), 1e-9)
        # By virtual work: the effort of a drive times its travel is the force times its part of the opening.
        ratio = gripper.max_opening_m / len(drives) / travel
        efforts = np.minimum(force_n * ratio, [each.effort_limit for each in drives])
        self._lead = efforts / np.array([each.stiffness for each in drives])
        limits = [each.joint.velocity or math.inf for each in drives]
        self._speed = np.minimum(_FINGER_VELOCITY_M / (ratio * len(drives)), limits)
        self._reference: Array | None = None
        self._starts_open = self._still_s = 0.0

    def opening(self, positions: Array) -> float:
        """The opening of the gripper at positions of its joints [m]."""
        return gripper_opening(self._gripper, positions)

    def update(self, view: ControlView) -> dict[str, float]:
        """See `MotionGoal`."""
        actual, velocities = view.positions(self._drives), view.velocities(self._drives)
        opening_m = self.opening(actual)
        self.feedback = MotionFeedback(
            elapsed_s=self.elapsed_s, desired={"opening": self._opening_m}, actual={"opening": opening_m}
        )
        if self._reference is None:
            self._reference, self._starts_open = actual, opening_m
        step = self._speed * PERIOD_S
        reference = self._reference + np.clip(self._target - self._reference, -step, step)
        self._reference = np.clip(reference, actual - self._lead, actual + self._lead)
        per_joint = _STALLED_VELOCITY_M * np.abs(self._target_travel()) / self._gripper.max_opening_m
        is_still = bool((np.abs(velocities) <= np.maximum(per_joint, 1e-4)).all())
        self._still_s = self._still_s + PERIOD_S if is_still else 0.0
        self.elapsed_s += PERIOD_S
        error = self.errors()
        if self._still_s >= _STALLED_S and abs(opening_m - self._opening_m) <= _GRIPPER_TOLERANCE_M:
            self.end(MotionOutcome.SUCCEEDED, error=error)
        elif self._still_s >= _STALLED_S and self._is_pushing(actual):
            self._end_stalled(view, opening_m, error)
        lag = np.array([each.lag_s for each in self._drives])
        moving = np.where(np.abs(self._target - self._reference) > step, np.sign(self._target - self._reference), 0.0)
        command = self._reference + lag * moving * self._speed * (0.0 if is_still else 1.0)
        command = np.clip(command, actual - self._lead - lag * self._speed, actual + self._lead + lag * self._speed)
        return {each.actuator: each.clamped(value) for each, value in zip(self._drives, command.tolist(), strict=True)}

    def brake(self, view: ControlView, used: frozenset[str]) -> MotionGoal | None:
        """See `MotionGoal`."""
        return brake_joints(view.positions(self._drives), view.velocities(self._drives), self._drives, used)

    def _target_travel(self) -> Array:
        return np.asarray(np.subtract(self._gripper.open_positions, self._gripper.closed_positions))

    def _is_pushing(self, actual: Array) -> bool:
        """Whether the reference is as far ahead as the force allows, or at the target."""
        assert self._reference is not None
        ahead = np.abs(self._reference - actual) >= 0.9 * self._lead
        return bool((ahead | (np.abs(self._reference - self._target) < 1e-9)).all())

    def _end_stalled(self, view: ControlView, opening_m: float, error: Mapping[str, float]) -> None:
        hand = frozenset[BodyId]().union(*(each.moved for each in self._drives))
        if self._opening_m <= self._starts_open:
            touched = view.touched(hand)
            reason = f"stopped by {_named(touched) or 'a limit'} at an opening of {opening_m:.3f} m"
            self.end(MotionOutcome.SUCCEEDED, reason, error=error, stalled=True)
        else:
            obstacles = view.obstacles(hand)
            reason = f"the fingers do not open beyond {opening_m:.3f} m"
            reason += f"; in contact with {_named(obstacles)}" if obstacles else ""
            self.end(
                MotionOutcome.FAILED,
                reason,
                failure=MotionFailure.BLOCKED,
                error=error,
                obstacles=obstacles,
                stalled=True,
            )


class _BaseGoal(MotionGoal):
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
        if self._blocked_s >= _BLOCKED_S:
            self._end_blocked(view)
            return self.commands(actual, np.zeros(3))
        self.elapsed_s += PERIOD_S
        if saturated.any():
            self._velocity = np.zeros(3)
            self.hold()
        else:
            self._reference, self._velocity = self.advance(self._reference, self._velocity, actual)
        limit = _MAX_LEAD * np.array(self._base.error_limits)
        self._reference = np.clip(self._reference, actual - limit, actual + limit)
        self.check(actual, velocity)
        return self.commands(self._reference, self._velocity)

    def commands(self, reference: Array, velocity: Array) -> dict[str, float]:
        """Commands for a reference and its velocity."""
        values = reference + np.array(self._base.lags_s) * velocity
        return dict(zip(self._base.actuators, values.tolist(), strict=True))

    def brake(self, view: ControlView, used: frozenset[str]) -> MotionGoal | None:
        """See `MotionGoal`."""
        return None if used & self.actuators else BaseBrake(self._base, self._velocity, self._reference)

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
        by = f"blocked by {_named(obstacles)}" if obstacles else "the base does not move at its largest force"
        self.end(MotionOutcome.FAILED, by, failure=MotionFailure.BLOCKED, error=self.errors(), obstacles=obstacles)


class BaseBrake(_BaseGoal):
    """Stops the base with its largest acceleration."""

    def __init__(self, base: BaseDrive, velocity: Array, reference: Array | None) -> None:
        super().__init__("stop", base)
        self._velocity, self._reference = velocity, reference

    def advance(self, reference: Array, velocity: Array, actual: Array) -> tuple[Array, Array]:
        """See `_BaseGoal`."""
        change = np.array(self._base.accelerations) * 2.0 * PERIOD_S  # a stop may be quicker than a drive
        velocity = velocity - np.clip(velocity, -change, change)
        return reference + velocity * PERIOD_S, velocity

    def check(self, actual: Array, velocity: Array) -> None:
        """See `_BaseGoal`."""
        if not self._velocity.any():
            self.end(MotionOutcome.SUCCEEDED)


class _PathGoal(_BaseGoal):
    """Drives the base along poses."""

    def __init__(self, base: BaseDrive, path: Sequence[tuple[float, float, float]], speed: float) -> None:
        super().__init__("path", base)
        self._path = tuple(path)
        self._speed = speed
        self._points = np.zeros((1, 3))
        self._nodes = np.zeros(1)
        self._rates = np.zeros(1)
        """The largest rate of progress at each point, at which it can still stop at the end."""
        self._progress = self._rate = self._late_s = 0.0
        self._acceleration = 1.0

    def begin(self, actual: Array) -> None:
        """See `_BaseGoal`."""
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
        """See `_BaseGoal`."""
        self._rate = 0.0

    def advance(self, reference: Array, velocity: Array, actual: Array) -> tuple[Array, Array]:
        """See `_BaseGoal`."""
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
        """See `_BaseGoal`."""
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


class _VelocityGoal(_BaseGoal):
    """Drives the base with a velocity, until it is not commanded any more."""

    def __init__(self, base: BaseDrive) -> None:
        super().__init__("velocity", base)
        self._wanted = np.zeros(3)
        """Velocity in the base frame."""
        self._left_s = DRIVE_TIMEOUT_S

    def command(self, velocity: tuple[float, float, float]) -> None:
        """Sets the velocity in the base frame, for 0.5 s at most."""
        self._wanted, self._left_s = np.array(velocity), DRIVE_TIMEOUT_S

    def advance(self, reference: Array, velocity: Array, actual: Array) -> tuple[Array, Array]:
        """See `_BaseGoal`."""
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
        """See `_BaseGoal`."""
        if self._velocity.any():
            return
        if not self._wanted.any():
            self.end(MotionOutcome.SUCCEEDED)
        elif self._left_s <= 0.0:
            reason = f"no velocity was commanded for {DRIVE_TIMEOUT_S:g} s"
            self.end(MotionOutcome.CANCELED, reason, failure=MotionFailure.TIMEOUT)


def wrapped(angle: float) -> float:
    """An angle within [-pi, pi)."""
    return (angle + math.pi) % (2 * math.pi) - math.pi


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


def gripper_opening(gripper: Gripper, positions: Sequence[float] | Array) -> float:
    """The distance between the finger pads at positions of the gripper's joints [m]."""
    closed, opened = np.array(gripper.closed_positions), np.array(gripper.open_positions)
    travel = opened - closed
    parts = np.where(
        np.abs(travel) > 1e-9, (np.asarray(positions) - closed) / np.where(travel == 0.0, 1.0, travel), 0.0
    )
    return float(gripper.max_opening_m * parts.mean())


def brake_joints(
    positions: Array, velocities: Array, drives: Sequence[JointDrive], used: frozenset[str]
) -> MotionGoal | None:
    """The motion that stops joints, without those whose actuators are used; None if they do not move."""
    rows = [row for row, each in enumerate(drives) if each.actuator not in used and abs(velocities[row]) > 1e-3]
    if not rows:
        return None
    stopped = [drives[row] for row in rows]
    c = np.zeros((1, 6, len(rows)))
    c[0, 0], c[0, 1], c[0, 2] = positions[rows], velocities[rows], -velocities[rows] / (2 * _BRAKE_S)
    spline = JointSpline(tuple(each.name for each in stopped), np.array([0.0, _BRAKE_S]), c)
    return _JointGoal(spline, stopped, goal_time_tolerance_s=0.0, kind="stop")


def _tolerances(
    given: Mapping[str, float] | float | None, drives: Sequence[JointDrive], defaults: Mapping[bool, float]
) -> Array:
    """A tolerance for each joint; those that are not given, or not positive, are the defaults."""
    found = []
    for each in drives:
        value = given.get(each.name) if isinstance(given, Mapping) else given
        found.append(value if value is not None and value > 0.0 else defaults[each.is_prismatic])
    return np.array(found)


def _named(ids: Sequence[BodyId]) -> str:
    return " and ".join(repr(str(id)) for id in ids[:3])


class RobotController:
    """Updates the goals of a robot; use it through `Robot`.

    A `simulation.controllers.Controller`; the methods that start goals are called in the engine thread.
    """

    period_s = PERIOD_S

    def __init__(self, drives: RobotDrives) -> None:
        self.drives = drives
        self._goals: tuple[MotionGoal, ...] = ()

    @property
    def is_active(self) -> bool:
        """See `Controller`; the same holds for the methods below."""
        return bool(self._goals)

    @property
    def goals(self) -> tuple[MotionGoal, ...]:
        """The active goals."""
        return self._goals

    def update(self, engine: Engine, time_s: float) -> None:
        """See `Controller`."""
        view = ControlView(engine, self.drives)
        if not self.drives.actuators <= view.states.keys():
            self._end_all("the robot was removed")
            return
        for goal in self._goals:
            if goal.is_canceled:
                self._replace(goal, view, "canceled", None)
        commands: dict[str, float] = {}
        for goal in self._goals:
            commands |= goal.update(view)
        engine.set_commands(commands)
        self._goals = tuple(goal for goal in self._goals if goal.result is None)

    def copy(self) -> RobotController:
        """See `Controller`."""
        copied = RobotController(self.drives)
        copied._goals = tuple(copy.copy(goal) for goal in self._goals)  # goals replace arrays, and never change them
        return copied

    def reset(self, engine: Engine) -> None:
        """See `Controller`."""
        self._end_all("the world was reset")
        if Capability.ACTUATORS not in engine.capabilities or not self.drives.exist_in(engine):
            return
        if not self.drives.actuators <= engine.actuator_states().keys():
            self.drives.add_to(engine)

    def start_trajectory(
        self,
        engine: Engine,
        trajectory: JointTrajectory,
        *,
        tolerance: Mapping[str, float] | float | None = None,
        path_tolerance: Mapping[str, float] | float | None = None,
        goal_time_tolerance_s: float = 2.0,
    ) -> MotionGoal:
        """See `Robot.start_trajectory`."""
        view = self._view(engine)
        state, velocities = {}, {}
        for name, drive in self.drives.joints.items():
            state[name], velocities[name] = self._reference(drive, view)
        spline = spline_of(
            trajectory,
            robot=self.drives.robot,
            limits={name: drive.joint for name, drive in self.drives.joints.items()},
            state=state,
            velocities=velocities,
        )
        return self._start(
            _JointGoal(
                spline,
                [self.drives.joints[name] for name in trajectory.joints],
                tolerance=tolerance,
                path_tolerance=path_tolerance,
                goal_time_tolerance_s=goal_time_tolerance_s,
            ),
            view,
        )

    def start_gripping(
        self, engine: Engine, gripper: str, opening_m: float, *, max_force_n: float | None = None
    ) -> MotionGoal:
        """See `Robot.start_gripping`."""
        view = self._view(engine)
        if gripper not in self.drives.grippers:
            known = ", ".join(self.drives.grippers) or "it has none"
            raise self._refused(f"the gripper {gripper!r}", "it has no gripper of that name", f"known: {known}")
        record = self.drives.grippers[gripper]
        if not 0.0 <= opening_m <= record.max_opening_m + 1e-3:
            cause = f"the gripper opens from 0 to {record.max_opening_m:.3g} m"
            raise self._refused(f"an opening of {opening_m:.4g} m", cause, "stay within the limits")
        force_n = record.max_force_n if max_force_n is None else max_force_n
        if not 0.0 < force_n <= record.max_force_n * 1.001:
            cause = f"the largest force of {gripper} is {record.max_force_n:.3g} N"
            raise self._refused(f"a force of {force_n:.4g} N", cause, "give a force within the limit")
        drives = [self.drives.joints[name] for name in record.joints]
        return self._start(_GripperGoal(record, drives, min(opening_m, record.max_opening_m), force_n), view)

    def start_driving(
        self, engine: Engine, path: Sequence[tuple[float, float, float]], *, speed: float = 1.0
    ) -> MotionGoal:
        """See `Robot.start_driving`."""
        view, base = self._view(engine), self._base()
        if not path:
            raise self._refused("a path", "it has no poses", "give at least one")
        if not all(math.isfinite(value) for pose in path for value in pose):
            raise self._refused("a path", "a number is not finite", "correct it")
        if not 0.0 < speed <= 1.0:
            raise self._refused(f"the speed {speed:g}", "it is a fraction of the velocity limits", "give 0 to 1")
        return self._start(_PathGoal(base, path, speed), view)

    def drive(self, engine: Engine, velocity: tuple[float, float, float]) -> MotionGoal:
        """See `Robot.drive`."""
        base = self._base()
        vx, vy, wz = velocity
        if not all(math.isfinite(value) for value in velocity):
            raise self._refused("a velocity", "it is not finite", "correct it")
        if math.hypot(vx, vy) > base.velocity * 1.001:
            raise self._refused(
                f"{math.hypot(vx, vy):.4g} m/s", f"the limit of its base is {base.velocity:.4g} m/s", "be slower"
            )
        if abs(wz) > base.turn_velocity * 1.001:
            cause = f"the limit of its base is {base.turn_velocity:.4g} rad/s"
            raise self._refused(f"{abs(wz):.4g} rad/s", cause, "turn slower")
        if base.type is BaseType.DIFFERENTIAL and abs(vy) > 1e-6:
            raise self._refused(
                f"{vy:.4g} m/s sideways", "its base drives forward and backward only", "turn first, then drive"
            )
        for goal in self._goals:
            if isinstance(goal, _VelocityGoal) and not goal.is_canceled:
                goal.command(velocity)
                return goal
        goal = _VelocityGoal(base)
        goal.command(velocity)
        self._start(goal, self._view(engine))
        return goal

    def set_base_pose(self, engine: Engine, pose: tuple[float, float, float]) -> None:
        """See `Robot.set_base_pose`."""
        base = self._base()
        if not all(math.isfinite(value) for value in pose):
            raise self._refused("a pose of the base", "it is not finite", "correct it")
        self._view(engine)
        for goal in self._goals:
            if goal.actuators & set(base.actuators):
                goal.end(MotionOutcome.CANCELED, "the base was put elsewhere", failure=MotionFailure.RESET)
        self._goals = tuple(goal for goal in self._goals if goal.result is None)
        engine.set_pose(base.root, base.root_pose(pose))
        states = engine.actuator_states()
        engine.set_commands({name: states[name].position for name in base.actuators})

    def stop(self) -> None:
        """Cancels all goals."""
        for goal in self._goals:
            goal.cancel()

    def _start(self, goal: MotionGoal, view: ControlView) -> MotionGoal:
        for other in self._goals:
            if other.actuators & goal.actuators:
                self._replace(other, view, "replaced by a newer goal", MotionFailure.REPLACED, used=goal.actuators)
        self._goals = (*self._goals, goal)
        return goal

    def _replace(
        self,
        goal: MotionGoal,
        view: ControlView,
        reason: str,
        failure: MotionFailure | None,
        *,
        used: frozenset[str] = frozenset(),
    ) -> None:
        """Ends a goal, and stops those of its joints that a newer goal does not use."""
        brake = goal.brake(view, used) if goal.kind != "stop" else None
        goal.end(MotionOutcome.CANCELED, reason, failure=failure, error=goal.errors())
        kept = tuple(each for each in self._goals if each is not goal)
        self._goals = kept if brake is None else (*kept, brake)

    def _reference(self, drive: JointDrive, view: ControlView) -> tuple[float, float]:
        """Where a joint is commanded to be, and its commanded velocity; where it is, if it is not close to that."""
        for goal in self._goals:
            if isinstance(goal, _JointGoal) and (desired := goal.desired(drive.name)) is not None:
                return desired
        command, position = view.command(drive), view.position(drive)
        tolerance = 0.005 if drive.is_prismatic else 0.02
        return (command if abs(command - position) <= tolerance else position), 0.0

    def _view(self, engine: Engine) -> ControlView:
        """The state of the actuators.

        Raises:
            CommandRefusedError: the engine has no actuators, or the robot was removed.
        """
        if Capability.ACTUATORS not in engine.capabilities:
            raise self._refused("every motion", f"the engine {engine.name!r} has no actuators", "simulate it in MuJoCo")
        view = ControlView(engine, self.drives)
        if not self.drives.actuators <= view.states.keys():
            if not self.drives.exist_in(engine):
                raise self._refused("every motion", "its bodies were deleted", "add it again")
            self.drives.add_to(engine)  # its bodies were restored after they had been deleted
            view = ControlView(engine, self.drives)
        return view

    def _base(self) -> BaseDrive:
        if self.drives.base is None:
            raise self._refused("a drive", "its base is fixed", "move its arms only")
        return self.drives.base

    def _refused(self, command: str, cause: str, remedy: str) -> CommandRefusedError:
        return CommandRefusedError(self.drives.robot, command=command, cause=cause, remedy=remedy)

    def _end_all(self, reason: str) -> None:
        for goal in self._goals:
            goal.end(MotionOutcome.CANCELED, reason, failure=MotionFailure.RESET)
        self._goals = ()
