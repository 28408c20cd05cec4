"""The base of a robot as ROS programs use it: velocity commands, odometry, and goals of navigation.

A goal of navigation is planned once and then driven; a robot that is blocked on the way ends it, with the body that is
in the way. Odometry has no error.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from functools import partial
from math import hypot

from mindstage.access.policies import EDIT, GOAL
from mindstage.bridge.conversions import pose_from_message, pose_message
from mindstage.errors import CommandRefusedError, UnreachableError
from mindstage.msgs import (
    Message,
    RosVersion,
    builtin_interfaces,
    geometry_msgs,
    move_base_msgs,
    nav2_msgs,
    nav_msgs,
    std_msgs,
)
from mindstage.robots.control import MotionFailure, MotionGoal, MotionResult
from mindstage.robots.floor_poses import base_pose_of
from mindstage.robots.models.robot_model import BaseType
from mindstage.robots.robot import Robot
from mindstage.ros.diagnostics import DiagnosticsPublisher, Publisher
from mindstage.ros.endpoints import Endpoints
from mindstage.ros.frames import ROOT_FRAME
from mindstage.ros.robot_controllers import await_motion
from mindstage.ros.service import ActionSpec, GoalAbortedError, GoalContext
from mindstage.ros.state import StateReader, frame_in_namespace, odom_id
from mindstage.scene.transforms import normalized_pose_array, pose_from_array, pose_inverse, pose_multiply
from mindstage.simulation import StateSnapshot

__all__ = ["RobotBaseInterface"]

_VELOCITY_TOPICS = ("cmd_vel", "base_controller/cmd_vel", "base_controller/command", "mobile_base_controller/cmd_vel")
_GOAL_TOPICS = ("move_base_simple/goal", "goal_pose")


class NavigationCode(IntEnum):
    """Codes of errors in `nav2_msgs`, of the planner and the controller."""

    NONE = 0
    FAILED_TO_MAKE_PROGRESS = 105
    NO_VALID_PATH = 208
    UNKNOWN = 9000


class RobotBaseInterface:
    """The base of one robot; a fixed one offers nothing."""

    def __init__(self, robot: Robot, state_reader: StateReader, diagnostics: DiagnosticsPublisher) -> None:
        """Offers nothing yet.

        Args:
            state_reader: reads the state of its simulation.
            diagnostics: publishes why a velocity was not driven.
        """
        self._robot = robot
        self._base = robot.model.base
        self._state_reader = state_reader
        self._diagnostics = diagnostics
        self._odometry: list[Publisher[nav_msgs.Odometry]] = []
        self._namespace = ""
        self._driving: MotionGoal | None = None
        """The last motion that was started by a velocity, until its end was reported."""

    def open(self, endpoints: Endpoints) -> None:
        """Offers the topics and actions.

        Raises:
            AdvertiseError: a name is taken.
        """
        if self._base.type is BaseType.FIXED:
            return
        self._namespace = endpoints.namespace
        twist, stamped, pose = geometry_msgs.Twist, geometry_msgs.TwistStamped, geometry_msgs.PoseStamped
        for topic in _VELOCITY_TOPICS:
            endpoints.subscribe(topic, twist, self._on_velocity, EDIT, other=stamped)
        for topic in _GOAL_TOPICS:
            endpoints.subscribe(topic, pose, self._on_goal, EDIT)
        if endpoints.only_version is not RosVersion.TWO:
            endpoints.create_action(ActionSpec(move_base_msgs.MoveBase, self.move_base, GOAL, name="move_base"))
        if endpoints.only_version is not RosVersion.ONE:
            navigate = ActionSpec(nav2_msgs.NavigateToPose, self.navigate_to_pose, GOAL, name="navigate_to_pose")
            endpoints.create_action(navigate)
        self._odometry = [endpoints.publisher(name, nav_msgs.Odometry) for name in ("odom", "base_controller/odom")]

    # -- velocities ----------------------------------------------------------------------------------------------------

    def _on_velocity(self, message: geometry_msgs.Twist | geometry_msgs.TwistStamped) -> None:
        """Drives with a velocity, reduced to the limits of the base as a real one does it.

        Raises:
            CommandRefusedError: the robot cannot be driven.
        """
        self._report_end()
        twist = message.twist if isinstance(message, geometry_msgs.TwistStamped) else message
        vx, vy, wz = twist.linear.x, twist.linear.y, twist.angular.z
        if self._base.type is BaseType.DIFFERENTIAL:
            vy = 0.0
        factor = min(1.0, self._base.velocity / max(hypot(vx, vy), 1e-9))
        wz = max(-self._base.turn_velocity, min(self._base.turn_velocity, wz))
        self._driving = self._robot.drive(vx * factor, vy * factor, wz)

    def _report_end(self) -> None:
        """Publishes that the base was blocked."""
        result = self._driving.result if self._driving is not None else None
        if result is not None and result.failure is MotionFailure.BLOCKED:
            obstacle = result.obstacles[0] if result.obstacles else ""
            self._diagnostics.report_failures("cmd_vel", [(obstacle, f"{self._robot.name} stopped: {result.reason}")])
            self._driving = None

    # -- navigation ----------------------------------------------------------------------------------------------------

    def move_base(self, goal: move_base_msgs.MoveBase.Goal, context: GoalContext) -> move_base_msgs.MoveBase.Result:
        """Moves the base to a pose, as `move_base` of ROS 1.

        Raises:
            GoalAbortedError: there is no way, or something is in it.
            GoalCanceledError: the goal was canceled, or replaced by a newer one.
        """
        result = move_base_msgs.MoveBase.Result()

        def feedback(motion: MotionGoal) -> Message:
            return move_base_msgs.MoveBase.Feedback(base_position=self._pose())

        try:
            ended = self._navigate(goal.target_pose, context, feedback)
        except (UnreachableError, CommandRefusedError) as error:
            raise GoalAbortedError(result, reason=str(error)) from error
        if not ended:
            raise GoalAbortedError(result, reason=ended.reason)
        return result

    def navigate_to_pose(
        self, goal: nav2_msgs.NavigateToPose.Goal, context: GoalContext
    ) -> nav2_msgs.NavigateToPose.Result:
        """Moves the base to a pose, as `bt_navigator` of ROS 2; errors are as of `move_base`."""

        def aborted(code: NavigationCode, reason: str) -> GoalAbortedError:
            ended = nav2_msgs.NavigateToPose.Result(error_code=code, error_msg=reason)
            return GoalAbortedError(ended, reason=reason)

        def feedback(motion: MotionGoal) -> Message:
            elapsed_s, left = self._progress(motion, goal.pose)
            speed = max(self._base.velocity, 1e-3)
            return nav2_msgs.NavigateToPose.Feedback(
                current_pose=self._pose(),
                navigation_time=builtin_interfaces.Duration.at(elapsed_s),
                estimated_time_remaining=builtin_interfaces.Duration.at(left / speed),
                distance_remaining=left,
            )

        try:
            ended = self._navigate(goal.pose, context, feedback)
        except UnreachableError as error:
            raise aborted(NavigationCode.NO_VALID_PATH, str(error)) from error
        except CommandRefusedError as error:
            raise aborted(NavigationCode.UNKNOWN, str(error)) from error
        if not ended:
            raise aborted(NavigationCode.FAILED_TO_MAKE_PROGRESS, ended.reason)
        return nav2_msgs.NavigateToPose.Result()

    def _navigate(
        self, pose: geometry_msgs.PoseStamped, context: GoalContext, feedback: Callable[[MotionGoal], Message]
    ) -> MotionResult:
        context.check(None)
        path = self._plan(pose)
        context.check(None)
        motion = self._robot.start_driving(path)
        return await_motion(motion, context, partial(feedback, motion))

    def _on_goal(self, message: geometry_msgs.PoseStamped) -> None:
        """Drives to a pose without feedback, as from RViz.

        Raises:
            UnreachableError: there is no way.
        """
        self._robot.start_driving(self._plan(message))

    def _plan(self, pose: geometry_msgs.PoseStamped) -> tuple[tuple[float, float, float], ...]:
        from mindstage.robots.navigation import plan_base  # loads a library for planning

        return plan_base(self._robot, self._target(pose))

    def _target(self, message: geometry_msgs.PoseStamped) -> tuple[float, float, float]:
        """Returns a pose of the base link on the floor: x, y [m], yaw [rad] in the world frame."""
        frame = message.header.frame_id
        if self._namespace and (frame == "odom" or frame in self._robot.link_ids):
            frame = frame_in_namespace(self._namespace, frame)
        pose = self._state_reader.to_world_frame(pose_from_message(message.pose), frame)
        row = normalized_pose_array(pose)
        return base_pose_of(row)

    def _progress(self, motion: MotionGoal, goal: geometry_msgs.PoseStamped) -> tuple[float, float]:
        """Returns the time since the start of a motion [s], and the distance to its goal [m]."""
        x, y, _ = self._target(goal)
        here = self._robot.base_pose()
        return motion.elapsed_s, hypot(x - here[0], y - here[1])

    def _pose(self) -> geometry_msgs.PoseStamped:
        """Returns the pose of the base link in the map."""
        pose = pose_message(pose_from_array(self._robot.link_pose(self._base.link)))
        stamp = builtin_interfaces.Time.at(self._state_reader.state().time_s)
        return geometry_msgs.PoseStamped(header=std_msgs.Header(stamp=stamp, frame_id=ROOT_FRAME), pose=pose)

    # -- odometry ------------------------------------------------------------------------------------------------------

    def publish(self, snapshot: StateSnapshot) -> None:
        """Publishes the odometry, if it has subscribers."""
        self._report_end()
        wanted = [each for each in self._odometry if each.has_subscribers]
        if not wanted:
            return
        odom = self._robot.odometry()
        rows = self._state_reader.row_by_id(snapshot)
        ids = (odom_id(self._robot), self._robot.link_ids[self._base.link])
        world_from_odom, world_from_base = (
            normalized_pose_array(pose_from_array(snapshot.poses[rows[id]])) for id in ids if id in rows
        )
        pose = pose_from_array(pose_multiply(pose_inverse(world_from_odom), world_from_base))
        twist = geometry_msgs.Twist(
            linear=geometry_msgs.Vector3(x=odom.vx, y=odom.vy), angular=geometry_msgs.Vector3(z=odom.wz)
        )
        header = std_msgs.Header(
            stamp=builtin_interfaces.Time.at(snapshot.time_s), frame_id=frame_in_namespace(self._namespace, "odom")
        )
        message = nav_msgs.Odometry(
            header=header,
            child_frame_id=frame_in_namespace(self._namespace, self._base.link),
            pose=geometry_msgs.PoseWithCovariance(pose=pose_message(pose)),
            twist=geometry_msgs.TwistWithCovariance(twist=twist),
        )
        for each in wanted:
            each.publish(message)
