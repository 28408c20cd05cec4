"""The controller of a robot: it starts and updates goals, which command the actuators of the engine.

Joints without a goal hold their last command, which the engine keeps, so that a controller without goals does nothing.
A newer goal replaces older ones of the same actuators; a joint whose goal was canceled or replaced stops within 0.1 s.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from mindstage.engines.base import Capability, Engine
from mindstage.errors import CommandRefusedError
from mindstage.robots.base_motion import PathGoal, VelocityGoal
from mindstage.robots.control import (
    PERIOD_S,
    ControlView,
    GripperGoal,
    JointGoal,
    MotionFailure,
    MotionGoal,
    MotionOutcome,
)
from mindstage.robots.drives import BaseDrive, JointDrive, RobotDrives
from mindstage.robots.models.robot_model import BaseType
from mindstage.robots.trajectories import JointTrajectory, spline_of
from mindstage.scene.edits import SetPoses

__all__ = ["RobotController"]


class RobotController:
    """Updates the goals of a robot; use it through `Robot`.

    A `simulation.controllers.Controller`; the methods that start goals are called in the engine thread.
    """

    period_s = PERIOD_S

    def __init__(self, drives: RobotDrives) -> None:
        self.drives = drives
        self._goals: tuple[MotionGoal, ...] = ()
        self._on_end: Callable[[MotionGoal], None] | None = None
        self._time_s = -math.inf
        """Simulated time of the last update, or of the start of the first goal after that [s]."""

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_on_end": None}

    def on_end(self, callback: Callable[[MotionGoal], None]) -> None:
        """Sets the function that is called in the engine thread when a goal has ended; copies do not have it."""
        self._on_end = callback

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
        is_restored, self._time_s = time_s < self._time_s, time_s
        if is_restored:
            self._end_all("an earlier state was restored")
            return
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
        for goal in self._goals:
            self._report(goal)
        self._goals = tuple(each for goal in self._goals if (each := _next(goal)) is not None)

    def copy(self) -> RobotController:
        """See `Controller`."""
        copied = RobotController(self.drives)
        copied._time_s = self._time_s
        copied._goals = tuple(copy.copy(goal) for goal in self._goals)  # goals replace arrays, and never change them
        return copied

    def reset(self, engine: Engine) -> None:
        """See `Controller`."""
        self._end_all("the world was reset")
        self.connect(engine)

    def connect(self, engine: Engine, *, is_new: bool = False) -> None:
        """Adds the actuators to an engine that has the robot, but not them.

        Args:
            is_new: whether it is known that the engine does not have them.
        """
        if Capability.ACTUATORS not in engine.capabilities or not self.drives.exist_in(engine):
            return
        if is_new or not self.drives.actuators <= engine.actuator_states().keys():
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
            JointGoal(
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
        if record.max_opening_m <= 0.0:
            raise self._refused(
                f"the gripper {gripper!r}", "the distance of its fingers is unknown", f"move {', '.join(record.joints)}"
            )
        if not 0.0 <= opening_m <= record.max_opening_m + 1e-3:
            cause = f"the gripper opens from 0 to {record.max_opening_m:.3g} m"
            raise self._refused(f"an opening of {opening_m:.4g} m", cause, "stay within the limits")
        force_n = record.max_force_n if max_force_n is None else max_force_n
        if not 0.0 < force_n <= record.max_force_n * 1.001:
            cause = f"the largest force of {gripper} is {record.max_force_n:.3g} N"
            raise self._refused(f"a force of {force_n:.4g} N", cause, "give a force within the limit")
        drives = [self.drives.joints[name] for name in record.joints]
        return self._start(GripperGoal(record, drives, min(opening_m, record.max_opening_m), force_n), view)

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
        return self._start(PathGoal(base, path, speed), view)

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
            if isinstance(goal, VelocityGoal) and not goal.is_canceled:
                goal.command(velocity)
                return goal
        goal = VelocityGoal(base)
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
                self._report(goal)
        self._goals = tuple(goal for goal in self._goals if goal.result is None)
        engine.apply(SetPoses({base.root: base.root_pose(pose)}))
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
        if not self._goals:
            self._time_s = -math.inf
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
        brake = None
        if goal.kind != "stop":
            brake = goal.relaxation() if goal.is_halted else goal.brake(view, used)
        goal.end(MotionOutcome.CANCELED, reason, failure=failure, error=goal.errors())
        self._report(goal)
        kept = tuple(each for each in self._goals if each is not goal)
        self._goals = kept if brake is None else (*kept, brake)

    def _reference(self, drive: JointDrive, view: ControlView) -> tuple[float, float]:
        """Where a joint is commanded to be, and its commanded velocity; where it is, if it is not close to that.

        What has been halted is where it is, not where it should have been.
        """
        for goal in self._goals:
            if isinstance(goal, JointGoal) and not goal.is_halted and (desired := goal.desired(drive.name)) is not None:
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

    def _report(self, goal: MotionGoal) -> None:
        if goal.result is not None and goal.kind != "stop" and self._on_end is not None:
            self._on_end(goal)

    def _end_all(self, reason: str) -> None:
        for goal in self._goals:
            goal.end(MotionOutcome.CANCELED, reason, failure=MotionFailure.RESET)
            self._report(goal)
        self._goals, self._time_s = (), -math.inf


def _next(goal: MotionGoal) -> MotionGoal | None:
    """The goal if it is active, otherwise the motion that follows it, if any."""
    if goal.result is None:
        return goal
    failed = isinstance(goal, JointGoal) and goal.status is MotionOutcome.FAILED and goal.kind != "stop"
    is_blocked = failed and goal.result.failure is not MotionFailure.GOAL_TOLERANCE
    return goal.relaxation() if is_blocked and isinstance(goal, JointGoal) else None
