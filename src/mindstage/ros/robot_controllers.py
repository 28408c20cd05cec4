"""The controllers of a robot as ROS programs use them: trajectories, grippers, the head, and the list of controllers.

The names are those of a real robot: `arm_controller/follow_joint_trajectory`, `gripper_controller/gripper_cmd`. Besides
the controllers that follow from the model of a robot, robots of known makes have those of their drivers. There are the
topics of ROS 1 (`command`, `state`) and of ROS 2 (`joint_trajectory`, `controller_state`).

A goal is executed in simulated time; while the simulation is paused, it waits.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from math import inf

import msgspec
import numpy as np

from mindstage.access.policies import EDIT, GOAL, READ
from mindstage.engines import Capability, Engine
from mindstage.engines.base import ActuatorState
from mindstage.errors import CommandRefusedError
from mindstage.msgs import Message, RosVersion, builtin_interfaces, control_msgs, std_msgs, trajectory_msgs
from mindstage.msgs import controller_manager_msgs as manager
from mindstage.robots.control import MotionFailure, MotionGoal, MotionOutcome, MotionResult
from mindstage.robots.models.forward_kinematics import link_poses
from mindstage.robots.models.robot_model import RobotModel
from mindstage.robots.robot import Robot
from mindstage.robots.trajectories import JointTrajectory, TrajectoryPoint
from mindstage.ros.diagnostics import Publisher
from mindstage.ros.endpoints import Endpoints
from mindstage.ros.service import ActionSpec, GoalAbortedError, GoalCanceledError, GoalContext, ServiceSpec
from mindstage.ros.state import StateReader
from mindstage.scene import Pose
from mindstage.scene.transforms import Array, normalized_pose_array, pose_inverse, pose_multiply, quat_rotate
from mindstage.simulation import StateSnapshot

__all__ = ["ControllerSpec", "RobotControllers", "await_motion", "controllers_of"]

_Follow = control_msgs.FollowJointTrajectory
_Code = control_msgs.FollowJointTrajectoryCode
_POLL_S = 0.005
"""Interval at which the end of a motion is noticed [s]."""
_FEEDBACK_INTERVAL_S = 0.05
"""Interval of feedback, as of `joint_trajectory_controller` [s]."""
_CANCEL_WAIT_S = 0.15
"""Time for a canceled motion to end; while the simulation is paused, it ends when that goes on [s]."""
_DEFAULT_GOAL_TIME_TOLERANCE_S = 2.0
_START_SLACK_S = 0.01
"""A trajectory whose start is so near to the present starts at once [s]."""
_PEAK_VELOCITY = 1.875
"""Peak velocity of a motion from rest to rest, relative to its mean."""
_HEAD_ITERATIONS = 30
_HEAD_STEP = 1e-5
"""Step of numerical derivatives [rad]."""
_HEAD_MAX_CHANGE = 0.5
"""Largest change of a joint in one iteration [rad]."""
_HEAD_TOLERANCE = 0.02
"""Largest angle between the axis and the target [rad]."""
_ALL_JOINTS = "joint_trajectory_controller"
_ERROR_CODES: Mapping[MotionFailure | None, control_msgs.FollowJointTrajectoryCode] = {
    MotionFailure.BLOCKED: _Code.PATH_TOLERANCE_VIOLATED,
    MotionFailure.PATH_TOLERANCE: _Code.PATH_TOLERANCE_VIOLATED,
    MotionFailure.GOAL_TOLERANCE: _Code.GOAL_TOLERANCE_VIOLATED,
}

_PR2_ARM = ("shoulder_pan", "shoulder_lift", "upper_arm_roll", "elbow_flex", "forearm_roll", "wrist_flex", "wrist_roll")
_FETCH_ARM = tuple(
    f"{part}_joint"
    for part in (
        "shoulder_pan",
        "shoulder_lift",
        "upperarm_roll",
        "elbow_flex",
        "forearm_roll",
        "wrist_flex",
        "wrist_roll",
    )
)
_TIAGO_ARM = tuple(f"arm_{number}_joint" for number in range(1, 8))
_PANDA_ARM = tuple(f"panda_joint{number}" for number in range(1, 8))
_UR_ARM = (
    "shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint"
)  # fmt: skip
_STRETCH = ("joint_lift", "joint_arm_l3", "joint_wrist_yaw", "joint_head_pan", "joint_head_tilt")
_DRIVER_CONTROLLERS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("l_arm_controller", tuple(f"l_{part}_joint" for part in _PR2_ARM)),
    ("r_arm_controller", tuple(f"r_{part}_joint" for part in _PR2_ARM)),
    ("head_traj_controller", ("head_pan_joint", "head_tilt_joint")),
    ("torso_controller", ("torso_lift_joint",)),
    ("arm_controller", _TIAGO_ARM),
    ("arm_controller", _FETCH_ARM),
    ("arm_with_torso_controller", ("torso_lift_joint", *_FETCH_ARM)),
    ("panda_arm_controller", _PANDA_ARM),
    ("position_joint_trajectory_controller", _PANDA_ARM),
    ("scaled_joint_trajectory_controller", _UR_ARM),
    ("scaled_pos_joint_traj_controller", _UR_ARM),
    ("stretch_controller", _STRETCH),
)
"""Controllers of the drivers of PR2, TIAGo, Fetch, Panda, UR and Stretch: offered if a robot has all of the joints."""


class ControllerSpec(msgspec.Struct, frozen=True, kw_only=True):
    """A controller of a robot."""

    name: str
    joints: tuple[str, ...]
    gripper: str = ""
    """The gripper that it opens and closes; empty for none."""
    has_head: bool = False
    """Whether it points the head."""


def controllers_of(model: RobotModel) -> tuple[ControllerSpec, ...]:
    """Returns the controllers of a robot, each with another name.

    They are one for each arm, gripper and head, those of the driver of a known make, and one for all joints.
    """
    actuated = [joint.name for joint in model.actuated_joints]
    found: dict[str, ControllerSpec] = {}
    for name, joints in _DRIVER_CONTROLLERS:
        if set(joints) <= set(actuated):
            found.setdefault(name, ControllerSpec(name=name, joints=joints))

    def add(stem: str, joints: Iterable[str], *, gripper: str = "", has_head: bool = False) -> None:
        name = _controller_name(stem)
        known = found.get(name)
        if gripper and known is not None:
            name = _controller_name(f"{stem}_gripper")
        elif known is not None:
            joints = known.joints  # the driver's own
        found[name] = ControllerSpec(name=name, joints=tuple(joints), gripper=gripper, has_head=has_head)

    for arm in model.arms:
        add(arm.name, arm.joints)
    if model.head is not None:
        add("head", model.head.joints, has_head=True)
        for name, spec in list(found.items()):
            if name.startswith("head_") and set(spec.joints) == set(model.head.joints):
                found[name] = msgspec.structs.replace(spec, has_head=True)
    for gripper in model.grippers:
        add(gripper.name, gripper.joints, gripper=gripper.name)
    if actuated:
        found[_ALL_JOINTS] = ControllerSpec(name=_ALL_JOINTS, joints=tuple(actuated))
    return tuple(found.values())


def _controller_name(stem: str) -> str:
    valid = re.sub(r"[^A-Za-z0-9_]+", "_", stem).strip("_") or "arm"
    valid = valid if valid[0].isalpha() else f"arm_{valid}"
    return valid if valid.endswith("_controller") else f"{valid}_controller"


def await_motion(motion: MotionGoal, context: GoalContext, make_feedback: Callable[[], Message | None]) -> MotionResult:
    """Waits until a motion has ended, with feedback; it is canceled with its goal.

    The motion is canceled by the thread that receives the request: its joints brake in the next control period and
    stand 0.1 s of simulated time later, however long this thread takes to wake up.

    Raises:
        GoalCanceledError: the goal was canceled, or a newer one has replaced the motion.
        SimulationTimeoutError: the goal takes too long.
    """
    context.on_cancel(motion.cancel)
    try:
        while motion.result is None:
            context.check(make_feedback, interval_s=_FEEDBACK_INTERVAL_S)
            context.wait(_POLL_S)
    except BaseException:
        motion.cancel()
        _await_end(motion)
        raise
    if motion.result.outcome is MotionOutcome.CANCELED and motion.result.failure is not MotionFailure.RESET:
        raise GoalCanceledError(reason=motion.result.reason)
    return motion.result


def _await_end(motion: MotionGoal) -> None:
    deadline_s = time.monotonic() + _CANCEL_WAIT_S
    while motion.result is None and time.monotonic() < deadline_s:
        time.sleep(_POLL_S)


class RobotControllers:
    """The controllers of one robot."""

    def __init__(self, robot: Robot, state_reader: StateReader) -> None:
        """Offers nothing yet.

        Args:
            state_reader: reads the state of its simulation.
        """
        self.specs = controllers_of(robot.model)
        self._robot = robot
        self._state_reader = state_reader
        self._states: list[tuple[ControllerSpec, Publisher[control_msgs.JointTrajectoryControllerState]]] = []
        self._followed: dict[str, MotionGoal] = {}
        """The last trajectory of each controller that came by its topic."""

    def open(self, endpoints: Endpoints) -> None:
        """Offers all controllers.

        Raises:
            AdvertiseError: a name is taken.
        """
        state, trajectory = control_msgs.JointTrajectoryControllerState, trajectory_msgs.JointTrajectory
        for spec in self.specs:
            for action in self._actions(spec):
                endpoints.create_action(action)
            for topic in ("command", "joint_trajectory"):
                endpoints.subscribe(f"{spec.name}/{topic}", trajectory, partial(self._on_trajectory, spec), EDIT)
            for topic in ("state", "controller_state"):
                self._states.append((spec, endpoints.publisher(f"{spec.name}/{topic}", state)))
        endpoints.create_service(
            ServiceSpec(
                manager.ListControllers,
                partial(self.list_controllers, ros=endpoints.ros),
                READ,
                name="controller_manager/list_controllers",
            )
        )

    def _actions(self, spec: ControllerSpec) -> Iterator[ActionSpec]:
        follow = partial(self.follow, spec)
        yield ActionSpec(_Follow, follow, GOAL, name=f"{spec.name}/follow_joint_trajectory")
        if spec.gripper:
            grip = partial(self.grip, spec)
            for name in ("gripper_cmd", "gripper_action"):  # of ROS 2 and MoveIt, and of older drivers
                yield ActionSpec(control_msgs.GripperCommand, grip, GOAL, name=f"{spec.name}/{name}")
        if spec.has_head:
            yield ActionSpec(control_msgs.PointHead, self.point_head, GOAL, name=f"{spec.name}/point_head_action")

    # -- the list of controllers ---------------------------------------------------------------------------------------

    def list_controllers(
        self, _: manager.ListControllers.Request, *, ros: RosVersion
    ) -> manager.ListControllers.Response:
        """Returns the controllers with their types in a version of ROS."""
        is_two = ros is RosVersion.TWO
        package = "joint_trajectory_controller" if is_two else "position_controllers"
        broadcaster = "joint_state_broadcaster" if is_two else "joint_state_controller"
        kinds = [
            (spec.name, f"{package}/JointTrajectoryController", spec.joints) for spec in self.specs if not spec.gripper
        ]
        grippers = [spec for spec in self.specs if spec.gripper]
        kinds += [(spec.name, "position_controllers/GripperActionController", spec.joints) for spec in grippers]
        kinds.append((broadcaster, f"{broadcaster}/JointState{'Broadcaster' if is_two else 'Controller'}", ()))
        return manager.ListControllers.Response(controller=tuple(_state(*kind, is_two=is_two) for kind in kinds))

    # -- trajectories --------------------------------------------------------------------------------------------------

    def follow(self, spec: ControllerSpec, goal: _Follow.Goal, context: GoalContext) -> _Follow.Result:
        """Moves joints along a trajectory.

        Raises:
            GoalAbortedError: it was rejected before it began, or was not reached; with the code and the reason.
            GoalCanceledError: it was canceled, or replaced by a newer one.
        """
        trajectory = self._trajectory(spec, goal)
        tolerance_s = goal.goal_time_tolerance.seconds
        try:
            motion = self._robot.start_trajectory(
                trajectory,
                tolerance=_tolerances(goal.goal_tolerance),
                path_tolerance=_tolerances(goal.path_tolerance),
                goal_time_tolerance_s=tolerance_s if tolerance_s > 0.0 else _DEFAULT_GOAL_TIME_TOLERANCE_S,
            )
        except CommandRefusedError as error:
            raise _rejected(_Code.INVALID_GOAL, str(error)) from error
        result = await_motion(motion, context, lambda: self._feedback(trajectory.joints, motion))
        if result:
            return _Follow.Result(error_code=_Code.SUCCESSFUL)
        code = _ERROR_CODES.get(result.failure, _Code.INVALID_GOAL)
        ended = _Follow.Result(error_code=code, error_string=result.reason)
        raise GoalAbortedError(ended, reason=result.reason)

    def _trajectory(self, spec: ControllerSpec, goal: _Follow.Goal) -> JointTrajectory:
        """Returns the trajectory of a goal, with times from now.

        Raises:
            GoalAbortedError: it has joints of other controllers, no points, or is over already.
        """
        joints = goal.trajectory.joint_names
        if unknown := [name for name in joints if name not in spec.joints]:
            text = f"{', '.join(unknown)}: not of {spec.name}, which has {', '.join(spec.joints)}"
            raise _rejected(_Code.INVALID_JOINTS, text)
        if goal.multi_dof_trajectory.points or goal.component_path_tolerance or goal.component_goal_tolerance:
            raise _rejected(_Code.INVALID_GOAL, "it has no joints with several degrees of freedom")
        if not joints or not goal.trajectory.points:
            raise _rejected(_Code.INVALID_GOAL, "the trajectory has no joints or no points")
        delay_s = self._delay_s(goal.trajectory)
        if delay_s + goal.trajectory.points[-1].time_from_start.seconds < 0.0:
            text = f"it ended {-delay_s - goal.trajectory.points[-1].time_from_start.seconds:.3g} s ago"
            raise _rejected(_Code.OLD_HEADER_TIMESTAMP, text)
        return self._delayed(goal.trajectory, delay_s)

    def _delay_s(self, trajectory: trajectory_msgs.JointTrajectory) -> float:
        """Returns when a trajectory starts, relative to now; a time stamp of 0 means now [s].

        A program that has the time of a real robot, and not that of the simulation, stamps with the wall clock.
        """
        start_s = trajectory.header.stamp.seconds
        if not start_s:
            return 0.0
        delay_s = min(start_s - self._state_reader.state().time_s, start_s - time.time(), key=abs)
        return 0.0 if abs(delay_s) < _START_SLACK_S else delay_s

    def _delayed(self, trajectory: trajectory_msgs.JointTrajectory, delay_s: float) -> JointTrajectory:
        """Returns a trajectory from now: with a rest before it, or without the part that has passed."""
        points = [_point(each, delay_s) for each in trajectory.points]
        if delay_s < 0.0:
            points = [each for each in points if each.time_s > 0.0] or points[-1:]
        elif delay_s > 0.0:
            positions = self._robot.joint_positions()
            zero = (0.0,) * len(trajectory.joint_names)
            rest = tuple(positions.get(name, 0.0) for name in trajectory.joint_names)
            start = TrajectoryPoint(positions=rest, velocities=zero, accelerations=zero, time_s=delay_s)
            points = [start, *points] if points[0].time_s > delay_s else [*points]
        return JointTrajectory(trajectory.joint_names, tuple(points))

    def _feedback(self, joints: tuple[str, ...], motion: MotionGoal) -> _Follow.Feedback | None:
        found = motion.feedback
        if found is None:
            return None
        desired = _setpoint(joints, found.desired, found.desired_velocities, found.elapsed_s)
        actual = _setpoint(joints, found.actual, found.actual_velocities, found.elapsed_s)
        return _Follow.Feedback(
            header=self._header(),
            joint_names=joints,
            desired=desired,
            actual=actual,
            error=_difference(desired, actual),
        )

    def _on_trajectory(self, spec: ControllerSpec, message: trajectory_msgs.JointTrajectory) -> None:
        """Follows a trajectory without a goal; one without points stops the one before.

        Raises:
            CommandRefusedError: it is not valid.
        """
        if not message.points:
            if (before := self._followed.pop(spec.name, None)) is not None:
                before.cancel()
            return
        try:
            trajectory = self._trajectory(spec, _Follow.Goal(trajectory=message))
        except GoalAbortedError as error:
            what = f"a trajectory for {spec.name}"
            raise CommandRefusedError(self._robot.name, command=what, cause=str(error), remedy="correct it") from error
        self._followed[spec.name] = self._robot.start_trajectory(trajectory)

    # -- gripper and head ----------------------------------------------------------------------------------------------

    def grip(
        self, spec: ControllerSpec, goal: control_msgs.GripperCommand.Goal, context: GoalContext
    ) -> control_msgs.GripperCommand.Result:
        """Opens or closes a gripper; the position is the distance of its fingers [m].

        Raises:
            GoalAbortedError: the distance is out of range, or the gripper is blocked.
            GoalCanceledError: the goal was canceled, or replaced by a newer one.
        """
        gripper = self._robot.gripper(spec.gripper)
        # A limit above that of the gripper is always kept.
        force_n = min(goal.command.max_effort, gripper.max_force_n) if goal.command.max_effort > 0.0 else None

        def effort_n() -> float:
            states = self._robot.joint_states()
            return max((abs(states[name].effort) for name in gripper.joints), default=0.0)

        def feedback() -> control_msgs.GripperCommand.Feedback:
            return control_msgs.GripperCommand.Feedback(position=self._robot.opening(gripper.name), effort=effort_n())

        def result(*, stalled: bool = False, reached_goal: bool = False) -> control_msgs.GripperCommand.Result:
            return control_msgs.GripperCommand.Result(
                position=self._robot.opening(gripper.name),
                effort=effort_n(),
                stalled=stalled,
                reached_goal=reached_goal,
            )

        try:
            motion = self._robot.start_gripping(gripper.name, goal.command.position, max_force_n=force_n)
        except CommandRefusedError as error:
            raise GoalAbortedError(result(), reason=str(error), rejected=True) from error
        ended = await_motion(motion, context, feedback)
        if not ended:
            raise GoalAbortedError(result(stalled=ended.stalled), reason=ended.reason)
        return result(stalled=ended.stalled, reached_goal=not ended.stalled)

    def point_head(self, goal: control_msgs.PointHead.Goal, context: GoalContext) -> control_msgs.PointHead.Result:
        """Turns the head until an axis of it points to a target.

        Raises:
            GoalAbortedError: the target is beyond the limits of the head, or the head is blocked.
            GoalCanceledError: the goal was canceled, or replaced by a newer one.
            BodyNotFoundError: the target is in an unknown frame.
        """
        robot, model = self._robot, self._robot.model
        point = goal.target.point
        pose = self._state_reader.to_world_frame(Pose((point.x, point.y, point.z)), goal.target.header.frame_id)
        root_from_world = pose_inverse(robot.link_pose(model.root))
        target = pose_multiply(root_from_world, normalized_pose_array(pose))[:3]
        axis = np.array([goal.pointing_axis.x, goal.pointing_axis.y, goal.pointing_axis.z])
        pointing = _HeadPointing(model, robot.joint_positions(), target, axis=axis, frame=goal.pointing_frame)
        result = control_msgs.PointHead.Result()
        try:
            positions = pointing.solve()
            motion = robot.start_trajectory(self._head_motion(positions, goal))
        except CommandRefusedError as error:
            raise GoalAbortedError(result, reason=str(error), rejected=True) from error

        def feedback() -> control_msgs.PointHead.Feedback:
            return control_msgs.PointHead.Feedback(pointing_angle_error=pointing.angle(robot.joint_positions()))

        ended = await_motion(motion, context, feedback)
        if not ended:
            raise GoalAbortedError(result, reason=ended.reason)
        return result

    def _head_motion(self, positions: Mapping[str, float], goal: control_msgs.PointHead.Goal) -> JointTrajectory:
        """Returns the motion to positions, with the shortest duration and the largest velocity of a goal."""
        trajectory = self._robot.trajectory_to(positions)
        duration_s = max(trajectory.duration_s, goal.min_duration.seconds)
        if goal.max_velocity > 0.0:
            first, last = trajectory.points[0].positions, trajectory.points[-1].positions
            farthest = max(abs(b - a) for a, b in zip(first, last, strict=True))
            duration_s = max(duration_s, _PEAK_VELOCITY * farthest / goal.max_velocity)
        end = msgspec.structs.replace(trajectory.points[-1], time_s=duration_s)
        return JointTrajectory(trajectory.joints, (*trajectory.points[:-1], end))

    # -- state ---------------------------------------------------------------------------------------------------------

    def publish(self, snapshot: StateSnapshot) -> None:
        """Publishes the states of the controllers that have subscribers."""
        wanted = [(spec, publisher) for spec, publisher in self._states if publisher.has_subscribers]
        if not wanted:
            return
        drives = self._robot.controller.drives.joints

        def read(engine: Engine) -> Mapping[str, ActuatorState]:
            return engine.actuator_states() if Capability.ACTUATORS in engine.capabilities else {}

        states = self._robot.session.engine.run(read, label="controller states")
        header = std_msgs.Header(stamp=builtin_interfaces.Time.at(snapshot.time_s))
        for spec, publisher in wanted:
            rows = [(drives[name], states.get(drives[name].actuator)) for name in spec.joints if name in drives]
            found = [(drive, state) for drive, state in rows if state is not None]
            reference = trajectory_msgs.JointTrajectoryPoint(
                positions=tuple(state.command + drive.zero for drive, state in found)
            )
            feedback = trajectory_msgs.JointTrajectoryPoint(
                positions=tuple(state.position + drive.zero for drive, state in found),
                velocities=tuple(state.velocity for _, state in found),
                effort=tuple(state.effort for _, state in found),
            )
            publisher.publish(
                control_msgs.JointTrajectoryControllerState(
                    header=header,
                    joint_names=tuple(drive.name for drive, _ in found),
                    reference=reference,
                    feedback=feedback,
                    error=_difference(reference, feedback),
                    output=reference,
                )
            )

    def _header(self) -> std_msgs.Header:
        return std_msgs.Header(stamp=builtin_interfaces.Time.at(self._state_reader.state().time_s))


def _state(name: str, type: str, joints: tuple[str, ...], *, is_two: bool) -> manager.ControllerState:
    interfaces = tuple(f"{joint}/position" for joint in joints)
    resources = manager.HardwareInterfaceResources(
        hardware_interface="hardware_interface::PositionJointInterface", resources=joints
    )
    return manager.ControllerState(
        name=name,
        state="active" if is_two else "running",
        type=type,
        claimed_resources=(resources,) if joints else (),
        claimed_interfaces=interfaces,
        required_command_interfaces=interfaces,
        required_state_interfaces=tuple(f"{joint}/{kind}" for joint in joints for kind in ("position", "velocity")),
    )


def _rejected(code: _Code, text: str) -> GoalAbortedError:
    result = _Follow.Result(error_code=code, error_string=text)
    return GoalAbortedError(result, reason=text, rejected=True)


def _point(message: trajectory_msgs.JointTrajectoryPoint, delay_s: float) -> TrajectoryPoint:
    return TrajectoryPoint(
        positions=message.positions,
        velocities=message.velocities or None,
        accelerations=message.accelerations or None,
        time_s=message.time_from_start.seconds + delay_s,
    )


def _tolerances(messages: Iterable[control_msgs.JointTolerance]) -> dict[str, float]:
    """Returns the tolerances of positions by joint: 0 for the default, infinite for none."""
    return {each.name: each.position if each.position >= 0.0 else inf for each in messages}


def _setpoint(
    joints: tuple[str, ...], positions: Mapping[str, float], velocities: Mapping[str, float], time_s: float
) -> trajectory_msgs.JointTrajectoryPoint:
    return trajectory_msgs.JointTrajectoryPoint(
        positions=tuple(positions[name] for name in joints),
        velocities=tuple(velocities.get(name, 0.0) for name in joints),
        time_from_start=builtin_interfaces.Duration.at(time_s),
    )


def _difference(
    desired: trajectory_msgs.JointTrajectoryPoint, actual: trajectory_msgs.JointTrajectoryPoint
) -> trajectory_msgs.JointTrajectoryPoint:
    return trajectory_msgs.JointTrajectoryPoint(
        positions=tuple(a - b for a, b in zip(desired.positions, actual.positions, strict=True)),
        velocities=tuple(a - b for a, b in zip(desired.velocities, actual.velocities, strict=False)),
        time_from_start=desired.time_from_start,
    )


class _HeadPointing:
    """The positions of the joints of a head at which an axis points to a target."""

    def __init__(
        self, model: RobotModel, positions: Mapping[str, float], target: Array, *, axis: Array, frame: str
    ) -> None:
        """Takes the task.

        Args:
            positions: the current positions of all joints.
            target: the point in the frame of the root link [m].
            axis: the axis in the frame that points; zero for x.
            frame: the link that points; empty for the link of the head.
        """
        self._model = model
        self._target = target
        self._axis = axis / np.linalg.norm(axis) if np.linalg.norm(axis) > 0.0 else np.array([1.0, 0.0, 0.0])
        self._joints = model.head.joints if model.head is not None else ()
        self._frame = frame.rpartition("/")[2] or (model.head.link if model.head is not None else model.root)
        self._start = dict(positions)

    def solve(self) -> dict[str, float]:
        """Returns the positions, by Gauss-Newton with numerical derivatives.

        Raises:
            CommandRefusedError: there is no such link, or the limits of the head do not allow it.
        """
        if self._frame not in {link.name for link in self._model.links}:
            known = ", ".join(link.name for link in self._model.links[-5:])
            raise self._refused(f"it has no link {self._frame!r}", f"use a link such as {known}")
        limits = [self._model.joint(name) for name in self._joints]
        lower = np.array([-inf if each.lower is None else each.lower for each in limits])
        upper = np.array([inf if each.upper is None else each.upper for each in limits])
        q = np.array([self._start[name] for name in self._joints])
        for _ in range(_HEAD_ITERATIONS):
            residual = self._residual(q)
            columns = [(self._residual(q + step) - residual) / _HEAD_STEP for step in _HEAD_STEP * np.eye(len(q))]
            change = np.linalg.lstsq(np.array(columns).T, -residual, rcond=1e-6)[0]
            q = np.clip(q + np.clip(change, -_HEAD_MAX_CHANGE, _HEAD_MAX_CHANGE), lower, upper)
        positions = dict(zip(self._joints, q.tolist(), strict=True))
        error = self.angle(self._start | positions)
        if error > _HEAD_TOLERANCE:
            at = [
                joint.name for joint, value, low, up in zip(limits, q, lower, upper, strict=True) if value in {low, up}
            ]
            cause = f"{error:.2f} rad are left" + (f" at the limit of {' and '.join(at)}" if at else "")
            raise self._refused(cause, "turn the base first, or choose another target")
        return positions

    def angle(self, positions: Mapping[str, float]) -> float:
        """Returns the angle between the axis and the direction to the target [rad]."""
        direction, wanted = self._directions(positions)
        return float(np.arctan2(np.linalg.norm(np.cross(direction, wanted)), direction @ wanted))

    def _directions(self, positions: Mapping[str, float]) -> tuple[Array, Array]:
        pose = link_poses(self._model.joints, positions, self._model.root)[self._frame]
        offset = self._target - pose[:3]
        return quat_rotate(pose[3:], self._axis), offset / max(float(np.linalg.norm(offset)), 1e-9)

    def _residual(self, q: Array) -> Array:
        direction, wanted = self._directions(self._start | dict(zip(self._joints, q.tolist(), strict=True)))
        return direction - wanted

    def _refused(self, cause: str, remedy: str) -> CommandRefusedError:
        x, y, z = self._target.tolist()
        command = f"a look at ({x:.2f}, {y:.2f}, {z:.2f}) m in the frame of {self._model.root}"
        return CommandRefusedError(self._model.name, command=command, cause=cause, remedy=remedy)
