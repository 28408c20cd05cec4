"""Motions of a robot as goals: how they are started, watched and ended; those of joints and grippers.

Every goal has exactly one end, with a reason. Commands are clamped to the limits of the joints in any case.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from enum import StrEnum
from typing import Any

import msgspec
import numpy as np

from mindstage.engines.base import ActuatorState, Capability, Engine
from mindstage.robots.drives import BaseDrive, JointDrive, RobotDrives
from mindstage.robots.models.robot_model import Gripper
from mindstage.robots.trajectories import JointSpline
from mindstage.scene import BodyId
from mindstage.scene.transforms import Array

__all__ = [
    "PERIOD_S",
    "ControlView",
    "GripperGoal",
    "JointGoal",
    "MotionFailure",
    "MotionFeedback",
    "MotionGoal",
    "MotionOutcome",
    "MotionResult",
    "gripper_opening",
    "held_bodies",
]

PERIOD_S = 0.004
"""The period of control in simulated time [s]."""
_BRAKE_S = 0.1
"""The time in which a canceled motion stops [s]."""
_RELAXATION_S = 0.3
_LEAD_SLACK = 1.02
"""Factor of the velocity limit that a drive may have while it catches up."""
BLOCKED_S = 0.15
"""A joint that has been at its largest effort without moving for so long is blocked [s]."""
_SATURATED = 0.95
"""Fraction of the effort limit that counts as the limit."""
_SLOW = {True: 0.01, False: 0.05}
"""A prismatic [m/s] or revolute joint [rad/s] that is slower does not move."""
_PATH_TOLERANCES = {True: 0.06, False: 0.25}
"""Largest deviation from a trajectory [m or rad], after which it is given up."""
_GOAL_TOLERANCES = {True: 0.01, False: 0.02}
"""Largest error of a prismatic [m] or revolute joint [rad] at the end of a trajectory."""
_STALLED_S = 0.2
_GRIPPER_TOLERANCE_M = 0.002
_GRIPPER_TIMEOUT_S = 2.0
"""Time of a gripper in addition to twice that of its whole travel [s]."""
_FINGER_VELOCITY_M = 0.1
"""Speed at which the opening of a gripper changes, unless its joints are slower [m/s]."""
_STALLED_VELOCITY_M = 0.002


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

    def self_contact(self) -> str:
        """The strongest contact between two parts of the robot, as the end of a sentence; empty if there is none."""
        if Capability.CONTACTS not in self._engine.capabilities:
            return ""
        links = self._drives.link_of_body
        found = [each for each in self._engine.contacts() if each.a in links and each.b in links]
        strongest = max(found, key=lambda each: each.force_n, default=None)
        if strongest is None or strongest.b is None:
            return ""
        return f"; its {links[strongest.a]!r} touches its {links[strongest.b]!r}"


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
        self.is_canceled = self.is_halted = False
        """Whether it ends at the next update, and whether it was halted rather than canceled."""

    @property
    def status(self) -> MotionOutcome:
        """Whether it is active, or how it has ended."""
        return MotionOutcome.ACTIVE if self.result is None else self.result.outcome

    def cancel(self) -> None:
        """Ends it at the next update; its joints stop and hold their positions."""
        self.is_canceled = True

    def halt(self) -> None:
        """As `cancel`, but its joints stop where they are, without a ramp: for what has been pressed into something."""
        self.is_canceled = self.is_halted = True

    def update(self, view: ControlView) -> dict[str, float]:
        """Commands for the next period, by actuator; it may end the goal."""
        raise NotImplementedError

    def brake(self, view: ControlView, used: frozenset[str]) -> MotionGoal | None:
        """The motion that stops its joints, without those whose actuators are used; None if they need none."""
        raise NotImplementedError

    def relaxation(self) -> MotionGoal | None:
        """The motion after it was blocked or halted; None if its joints need none."""
        return None

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

    def command_details(self) -> dict[str, Any]:
        """What was commanded, as JSON values."""
        return {}

    def errors(self) -> dict[str, float]:
        """The difference of what is desired and the state, by name."""
        if self.feedback is None:
            return {}
        return {name: value - self.feedback.actual[name] for name, value in self.feedback.desired.items()}


class JointGoal(MotionGoal):
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
        self._lags_s = np.array([each.lag_s for each in drives])
        self._inertias = np.array([each.inertia / each.stiffness for each in drives])
        """A servo follows exactly what is ahead by lag * velocity + inertia / stiffness * acceleration."""
        limits = np.array([each.joint.velocity or math.inf for each in drives])
        self._leads = _LEAD_SLACK * (self._lags_s + PERIOD_S / 2) * limits
        self._blocked_s = np.zeros(len(drives))

    @property
    def spline(self) -> JointSpline:
        """Its positions over time."""
        return self._spline

    def command_details(self) -> dict[str, Any]:
        """See `MotionGoal`."""
        ends = dict(zip(self._spline.joints, self._spline.end.tolist(), strict=True))
        return {"positions": ends, "duration_s": round(self._spline.duration_s, 6)}

    def relaxation(self) -> MotionGoal:
        """See `MotionGoal`."""
        return JointRelaxation(self._drives)

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
        # The command is constant for a period, at the middle of which it is to be right.
        target, next_speed = self._spline.sample(self.elapsed_s + PERIOD_S / 2)
        self.elapsed_s += PERIOD_S
        ahead = self._lags_s * next_speed + self._inertias * (next_speed - speed) / (PERIOD_S / 2)
        # A drive does not exceed its velocity either when it catches up after it was held back.
        ahead = np.clip(target + ahead - actual, -self._leads, self._leads)
        values = (actual + ahead).tolist()
        return {each.actuator: each.clamped(value) for each, value in zip(drives, values, strict=True)}

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
        blocked = np.flatnonzero(self._blocked_s >= BLOCKED_S)
        deviating = np.flatnonzero(np.abs(error) > self._path_tolerance)
        if not len(blocked) and not len(deviating):
            return False
        index = int(blocked[0] if len(blocked) else deviating[0])
        drive = self._drives[index]
        moved = frozenset[BodyId]().union(*(each.moved for each in self._drives))
        obstacles = view.obstacles(drive.moved) or view.obstacles(moved)
        what = f"{drive.name} is {abs(float(error[index])):.3g} {drive.joint.unit} from its path"
        if len(blocked):
            what = f"{drive.name} does not move at its largest effort ({drive.effort_limit:.3g})"
        failure = MotionFailure.BLOCKED if len(blocked) or obstacles else MotionFailure.PATH_TOLERANCE
        by = f"; in contact with {named(obstacles)}" if obstacles else view.self_contact()
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
            reason = f"{drive.name} is {abs(float(error[worst])):.3g} {drive.joint.unit} from its goal"
            if is_near.all():
                reason = f"{drive.name} is not at rest"
            self.end(MotionOutcome.FAILED, reason, failure=MotionFailure.GOAL_TOLERANCE, error=self.errors())


class JointRelaxation(MotionGoal):
    """Lets joints yield for a moment, so that they do not go on pushing against what blocked them."""

    def __init__(self, drives: Sequence[JointDrive]) -> None:
        super().__init__("stop", (each.actuator for each in drives))
        self._drives = tuple(drives)

    def update(self, view: ControlView) -> dict[str, float]:
        """See `MotionGoal`."""
        self.elapsed_s += PERIOD_S
        if self.elapsed_s >= _RELAXATION_S:
            self.end(MotionOutcome.SUCCEEDED)
        return {each.actuator: each.clamped(view.position(each)) for each in self._drives}

    def brake(self, view: ControlView, used: frozenset[str]) -> MotionGoal | None:
        """See `MotionGoal`."""
        return None


class GripperGoal(MotionGoal):
    """Opens or closes a gripper, with a limited force."""

    def __init__(self, gripper: Gripper, drives: Sequence[JointDrive], opening_m: float, force_n: float) -> None:
        super().__init__("gripper", (each.actuator for each in drives))
        self._gripper = gripper
        self._drives = tuple(drives)
        self._opening_m, self._force_n = opening_m, force_n
        closed, opened = np.array(gripper.closed_positions), np.array(gripper.open_positions)
        self._target = closed + opening_m / gripper.max_opening_m * (opened - closed)
        ratio = np.array(gripper.levers)
        efforts = np.minimum(force_n * ratio, [each.effort_limit for each in drives])
        self._lead = efforts / np.array([each.stiffness for each in drives])
        self._lags_s = np.array([each.lag_s for each in drives])
        limits = [each.joint.velocity or math.inf for each in drives]
        self._speed = np.minimum(_FINGER_VELOCITY_M / (ratio * len(drives)), limits)
        self._speed = np.minimum(self._speed, self._lead / self._lags_s)  # more takes more than that force
        self._reference: Array | None = None
        self._starts_open = self._still_s = 0.0
        slowest = float((np.abs(opened - closed) / self._speed).max())
        self._timeout_s = _GRIPPER_TIMEOUT_S + 2.0 * slowest

    def command_details(self) -> dict[str, Any]:
        """See `MotionGoal`."""
        return {"gripper": self._gripper.name, "opening_m": self._opening_m, "max_force_n": self._force_n}

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
        elif self.elapsed_s >= self._timeout_s:
            reason = f"the opening is {opening_m:.3f} m, and the fingers are not at rest"
            self.end(MotionOutcome.FAILED, reason, failure=MotionFailure.GOAL_TOLERANCE, error=error)
        moving = np.where(np.abs(self._target - self._reference) > step, np.sign(self._target - self._reference), 0.0)
        command = self._reference + self._lags_s * moving * self._speed
        command = np.clip(command, actual - self._lead, actual + self._lead)
        return {each.actuator: each.clamped(value) for each, value in zip(self._drives, command.tolist(), strict=True)}

    def brake(self, view: ControlView, used: frozenset[str]) -> MotionGoal | None:
        """See `MotionGoal`."""
        return brake_joints(view.positions(self._drives), view.velocities(self._drives), self._drives, used)

    def relaxation(self) -> MotionGoal:
        """See `MotionGoal`."""
        return JointRelaxation(self._drives)

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
            reason = f"stopped by {named(touched) or 'a limit'} at an opening of {opening_m:.3f} m"
            self.end(MotionOutcome.SUCCEEDED, reason, error=error, stalled=True)
        else:
            obstacles = view.obstacles(hand)
            reason = f"the fingers do not open beyond {opening_m:.3f} m"
            reason += f"; in contact with {named(obstacles)}" if obstacles else ""
            self.end(
                MotionOutcome.FAILED,
                reason,
                failure=MotionFailure.BLOCKED,
                error=error,
                obstacles=obstacles,
                stalled=True,
            )


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
    return JointGoal(spline, stopped, goal_time_tolerance_s=0.0, kind="stop")


def _tolerances(
    given: Mapping[str, float] | float | None, drives: Sequence[JointDrive], defaults: Mapping[bool, float]
) -> Array:
    """A tolerance for each joint; those that are not given, or not positive, are the defaults."""
    found = []
    for each in drives:
        value = given.get(each.name) if isinstance(given, Mapping) else given
        found.append(value if value is not None and value > 0.0 else defaults[each.is_prismatic])
    return np.array(found)


def named(ids: Sequence[BodyId]) -> str:
    return " and ".join(repr(str(id)) for id in ids[:3])
