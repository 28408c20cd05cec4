"""A robot in a simulation: its state, and the motions of its joints, grippers and base.

robot = add_robot(sim, "mobile_manipulator")
robot.run(robot.driving([(1.0, 0.0, 0.0)]))
print(robot.joint_positions())

A motion is started as a goal, which can be watched and canceled, or as a generator that yields the simulated times by
which its caller steps the simulation; a generator that is closed stops what it started.
"""

from __future__ import annotations

import re
import time
import uuid
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

import msgspec
import numpy as np

from mindstage.access.limits import Timeout
from mindstage.engines.actuators import ActuatedBodies
from mindstage.engines.base import ActuatorMode, ActuatorState, Capability, Engine, SpawnReport
from mindstage.engines.kinematic_tree import movable_axes
from mindstage.errors import BodyNotFoundError, CommandRefusedError, RobotNotFoundError
from mindstage.ranges import Angle, Coordinate, Factor, Finite, NotNegative, Seed, checked
from mindstage.robots.control import MotionGoal, MotionOutcome, MotionResult, gripper_opening, held_bodies
from mindstage.robots.controller import RobotController
from mindstage.robots.floor_poses import BaseFrame, BasePose, base_pose_of, planar_inverse, planar_multiply
from mindstage.robots.models.robot_model import Gripper, RobotModel, SensorType
from mindstage.robots.skill_declaration import SkillResult, SkillStep
from mindstage.robots.trajectories import JointTrajectory, point_to_point
from mindstage.robots.world import RobotWorld
from mindstage.scene import BodyId, Pose
from mindstage.scene.transforms import Array, normalized_pose_array, pose_multiply
from mindstage.sensors.camera_model import CameraModel, CameraMount
from mindstage.simulation.controllers import ControllerSchedule
from mindstage.simulation.observation import SKILL_EDIT
from mindstage.simulation.simulation import Simulation
from mindstage.simulation.state import poses_in

__all__ = ["JointState", "Odometry", "Robot", "contact_free_pairs"]

T = TypeVar("T")

_WAIT_S = 0.02
"""Simulated time between two checks of a goal [s]."""


_FRAME_SUFFIX = re.compile(r"(_optical)?(_frame|_link)*$|_optical$", re.IGNORECASE)
_OPTICAL_IN_LINK = (0.5, -0.5, 0.5, -0.5)
"""The rotation of an optical frame (y down, z forward) on a link with x forward and z up."""


class JointState(msgspec.Struct, frozen=True, kw_only=True):
    """The state of a joint."""

    position: float
    """[m or rad]."""
    velocity: float = 0.0
    effort: float = 0.0
    """Of its drive, without what compensates gravity [N or Nm]."""


class Odometry(msgspec.Struct, frozen=True, kw_only=True):
    """The motion of a base since it was added, without error."""

    x: float
    """Position of the base link in the frame `odom`: that of the base link when the robot was added [m]."""
    y: float
    yaw: float
    """[rad]."""
    vx: float
    """Velocity in the frame of the base link [m/s]."""
    vy: float
    wz: float
    """[rad/s]."""


class Robot:
    """A robot in a simulation; made by `add_robot`."""

    def __init__(
        self,
        name: str,
        model: RobotModel,
        placed: RobotWorld,
        *,
        edit: Any,
        session: Simulation,
        controller: RobotController,
        report: SpawnReport,
        start_skill: Callable[..., Generator[float, None, SkillResult]],
    ) -> None:
        """Made by the edit `AddRobot`.

        Args:
            name: its name in the simulation.
            placed: its bodies and joints.
            edit: the `AddRobot` that has added it.
            controller: what commands its actuators.
            report: of the spawn of its bodies.
            start_skill: starts a skill, as `robots.skills.start_skill`, whose module imports this one.
        """
        self.name = name
        self.model = model
        self.edit = edit
        self.session = session
        self.controller = controller
        self.report = report
        self._placed = placed
        self._start_skill = start_skill
        self._root = placed.link_ids[model.root]
        controller.on_end(self._report_end)
        self._seen: tuple[BodyId, ...] | None = None
        """The ids for which `exists` was computed."""
        self._exists = True
        self._last_goal: MotionGoal | None = None
        joints = {joint.id: joint for joint in placed.world.joints}
        self._axes = {
            name: (id, axes[0].index) for name, id in placed.joint_ids.items() if (axes := movable_axes(joints[id]))
        }
        """The joint and the index of the axis of each joint that moves."""

    # -- state ---------------------------------------------------------------------------------------------

    @property
    def link_ids(self) -> Mapping[str, BodyId]:
        """The body of each link."""
        return self._placed.link_ids

    @property
    def body_ids(self) -> frozenset[BodyId]:
        """All of its bodies: those of its links, and that of the frame `odom`."""
        return frozenset(body.id for body in self._placed.world.bodies)

    @property
    def cameras(self) -> tuple[CameraMount, ...]:
        """Its cameras: those that its description states, and those that are found by the names of links.

        A camera found by a name has the default model; one with a link and an optical frame is one camera.
        """
        found: dict[str, CameraMount] = {}
        sensors = [each for each in self.model.sensors if each.type in {SensorType.CAMERA, SensorType.DEPTH_CAMERA}]
        for each in sorted(sensors, key=lambda sensor: (sensor.camera is None, not sensor.is_optical)):
            name = each.name if each.camera is not None else _FRAME_SUFFIX.sub("", each.name)
            if name in found:
                continue
            pose = each.pose
            if each.camera is None and not each.is_optical:
                pose = Pose((0.0, 0.0, 0.0), _OPTICAL_IN_LINK)
            found[name] = CameraMount(
                name=name,
                model=each.camera or CameraModel(),
                body=self.link_ids[each.link],
                pose=pose,
                owner=self.body_ids,
                frame=each.link if each.is_optical else f"{name}_optical_frame",
            )
        return tuple(found.values())

    @property
    def joint_ids(self) -> Mapping[str, BodyId]:
        """The id of each joint in the world."""
        return self._placed.joint_ids

    @property
    def placed(self) -> RobotWorld:
        """Its bodies and joints as they were spawned."""
        return self._placed

    @property
    def drives(self) -> Mapping[str, object]:
        """The joints that have drives, by name."""
        return self.controller.drives.joints

    def actuated_bodies(self) -> ActuatedBodies:
        """Its actuators as a file has them, with commands relative to its present poses; see `Simulation.save`."""
        drives, placed = self.controller.drives, self._placed
        states = self.session.engine.run(_actuator_states, label="actuators")
        commands = {
            each.name: states[each.name].command
            - (states[each.name].position if each.mode is ActuatorMode.POSITION else 0.0)
            for each in drives.records
            if each.name in states
        }
        return ActuatedBodies(
            actuators=drives.records,
            commands=commands,
            without_weight=frozenset(drives.link_of_body),
            excluded_pairs=contact_free_pairs(self.model, placed),
            geometry=placed.geometry,
        )

    @property
    def exists(self) -> bool:
        """Whether its bodies are in the simulation."""
        ids = self.session.state.ids
        if self._seen is not ids:
            self._seen, self._exists = ids, self.body_ids <= set(ids)
        return self._exists

    def joint_states(self) -> dict[str, JointState]:
        """The state of each joint that moves, in the order of the model."""
        return self.session.engine.run(self.read_joint_states, label="joint states")

    def read_joint_states(self, engine: Engine) -> dict[str, JointState]:
        """The same for callers in the engine thread."""
        drives, zero = self.controller.drives.joints, self._placed.zero
        states = engine.actuator_states() if Capability.ACTUATORS in engine.capabilities else {}
        driven = {name for name, drive in drives.items() if drive.actuator in states}
        coordinates: Mapping[BodyId, tuple[float, ...]] = {}
        if driven != self._axes.keys():
            if Capability.JOINTS not in engine.capabilities:
                return {name: JointState(position=zero.get(name, 0.0)) for name in self._axes}
            coordinates = engine.joint_positions()
        found = {}
        for name, (id, index) in self._axes.items():
            if name in driven:
                state = states[drives[name].actuator]
                position, velocity, effort = state.position, state.velocity, state.effort
            elif id in coordinates:
                position, velocity, effort = coordinates[id][index], 0.0, 0.0
            else:
                raise BodyNotFoundError(id, known=tuple(coordinates))
            found[name] = JointState(position=position + zero.get(name, 0.0), velocity=velocity, effort=effort)
        return self._with_mimics(found)

    def joint_positions(self) -> dict[str, float]:
        """The position of each joint that moves [m or rad], as in its description."""
        return {name: each.position for name, each in self.joint_states().items()}

    def joint_velocities(self) -> dict[str, float]:
        """The velocity of each joint that moves [m/s or rad/s]."""
        return {name: each.velocity for name, each in self.joint_states().items()}

    def joint_efforts(self) -> dict[str, float]:
        """The force [N] or moment [Nm] of the drive of each joint that moves, without what compensates gravity."""
        return {name: each.effort for name, each in self.joint_states().items()}

    def link_pose(self, link: str) -> Array:
        """The pose of a link in the world frame: x y z [m], w x y z.

        Raises:
            RobotNotFoundError: the robot was deleted.
            KeyError: it has no such link.
        """
        id = self._placed.link_ids[link]
        poses = poses_in(self.session.state, {id})
        if id not in poses:
            raise RobotNotFoundError(self.name, remedy="its bodies were deleted; add it again")
        return poses[id]

    def base_pose(self) -> BasePose:
        """The pose of the base link on the floor, in the world frame: x, y [m], yaw [rad]."""
        return base_pose_of(self.link_pose(self.model.base.link))

    def base_frame(self) -> BaseFrame:
        """Where its root link is for a pose of its base."""
        return BaseFrame(self.base_pose(), self.link_pose(self.model.root))

    def grasp_pose(self, gripper: str = "") -> Array:
        """The grasp frame of a gripper in the world frame; by default of the only gripper."""
        record = self.gripper(gripper)
        return pose_multiply(self.link_pose(record.link), normalized_pose_array(record.grasp_pose))

    def gripper(self, name: str = "") -> Gripper:
        """A gripper; by default the only one.

        Raises:
            CommandRefusedError: there is no gripper of that name, or several and no name is given.
        """
        found = [each for each in self.model.grippers if name in {"", each.name}]
        if len(found) != 1:
            known = ", ".join(each.name for each in self.model.grippers)
            cause = f"it has {len(found)} grippers of that name" if name else f"it has {len(found)} grippers"
            raise CommandRefusedError(
                self.name, command=f"the gripper {name!r}", cause=cause, remedy=f"use one of: {known or 'none'}"
            )
        return found[0]

    def opening(self, gripper: str = "") -> float:
        """The distance between the finger pads of a gripper [m]."""
        record, positions = self.gripper(gripper), self.joint_positions()
        return gripper_opening(record, [positions[name] for name in record.joints])

    @property
    def held(self) -> Mapping[str, BodyId]:
        """What each gripper holds: a body that is attached to it, or that two of its fingers touch."""
        drives = self.controller.drives
        return self.session.engine.run(lambda engine: held_bodies(engine, drives), label="held bodies")

    def odometry(self) -> Odometry:
        """The motion of the base since the robot was added; zero for a fixed one."""
        base = self.controller.drives.base
        if base is None:
            return Odometry(x=0.0, y=0.0, yaw=0.0, vx=0.0, vy=0.0, wz=0.0)

        def read(engine: Engine) -> tuple[Array, Array]:
            if Capability.ACTUATORS not in engine.capabilities:
                return base.joint_from_world(self.base_pose()), np.zeros(3)
            states = engine.actuator_states()
            rows = [states[name] for name in base.actuators]
            return np.array([each.position for each in rows]), np.array([each.velocity for each in rows])

        coordinates, (vx, vy, wz) = self.session.engine.run(read, label="odometry")
        start = base.world_from_joint(np.zeros(3))
        x, y, yaw = planar_multiply(planar_inverse(start), base.world_from_joint(coordinates))
        # The origin of the base link moves along when the joint turns at a distance.
        turned = float(coordinates[2])
        lever = np.array([np.cos(turned) * base.offset[0] - np.sin(turned) * base.offset[1],
                          np.sin(turned) * base.offset[0] + np.cos(turned) * base.offset[1]])  # fmt: skip
        velocity = np.array([vx - wz * lever[1], vy + wz * lever[0]])
        heading = turned + base.offset[2]
        forward = np.array([np.cos(heading), np.sin(heading)])
        left = np.array([-forward[1], forward[0]])
        return Odometry(x=x, y=y, yaw=yaw, vx=float(velocity @ forward), vy=float(velocity @ left), wz=float(wz))

    @checked
    def set_base_pose(self, x: Coordinate, y: Coordinate, yaw: Angle) -> None:
        """Puts the base at another place at once, at rest: x, y [m] and yaw [rad] of the base link in the world frame.

        Raises:
            CommandRefusedError: the base is fixed.
        """
        self.session.engine.run(
            lambda engine: self.controller.set_base_pose(engine, (x, y, yaw)), label="set base pose", edits=True
        )

    # -- goals ---------------------------------------------------------------------------------------------

    @checked
    def start_trajectory(
        self,
        trajectory: JointTrajectory,
        *,
        tolerance: Mapping[str, NotNegative] | NotNegative | None = None,
        path_tolerance: Mapping[str, NotNegative] | NotNegative | None = None,
        goal_time_tolerance_s: Timeout = 2.0,
    ) -> MotionGoal:
        """Starts to move joints along a trajectory, which replaces other motions of these joints.

        Args:
            trajectory: see `JointTrajectory`; everything in it is checked before anything moves.
            tolerance: the largest error at the end [m or rad], for all joints or by joint; by default 0.01 m and
                0.02 rad.
            path_tolerance: the largest deviation on the way; by default 0.06 m and 0.25 rad.
            goal_time_tolerance_s: how much later than planned the end may be reached [s].

        Returns:
            The goal, which is updated while simulated time advances.

        Raises:
            CommandRefusedError: a limit would be exceeded, a joint is unknown, or the robot has no drives here.
        """
        return self._start(
            lambda engine: self.controller.start_trajectory(
                engine,
                trajectory,
                tolerance=tolerance,
                path_tolerance=path_tolerance,
                goal_time_tolerance_s=goal_time_tolerance_s,
            ),
            "start trajectory",
        )

    @checked
    def start_gripping(self, gripper: str, opening_m: Finite, *, max_force_n: NotNegative | None = None) -> MotionGoal:
        """Starts to open or close a gripper.

        Closing succeeds if the fingers are stopped by something between them, which they then hold with that force.

        Args:
            gripper: its name; empty for the only one.
            opening_m: the distance between the finger pads [m].
            max_force_n: the largest force of each finger; by default that of the gripper [N].

        Raises:
            CommandRefusedError: the opening or the force is out of range, or there is no such gripper.
        """
        name = self.gripper(gripper).name
        return self._start(
            lambda engine: self.controller.start_gripping(engine, name, opening_m, max_force_n=max_force_n),
            "start gripping",
        )

    @checked
    def start_driving(self, path: Sequence[tuple[Finite, Finite, Finite]], *, speed: Factor = 1.0) -> MotionGoal:
        """Starts to drive the base along poses of the base link in the world frame: x, y [m], yaw [rad].

        A differential base turns to where it drives, and at the end to the last yaw; the others are ignored.

        Args:
            path: the poses after the current one.
            speed: the fraction of its velocity that is used.

        Raises:
            CommandRefusedError: the base is fixed, or a number is not finite.
        """
        return self._start(lambda engine: self.controller.start_driving(engine, path, speed=speed), "start driving")

    @checked
    def drive(self, vx: Finite, vy: Finite = 0.0, wz: Finite = 0.0) -> MotionGoal:
        """Drives the base with a velocity for at most 0.5 s of simulated time; call it again to go on.

        Args:
            vx: forward [m/s].
            vy: to the left [m/s].
            wz: counterclockwise [rad/s].

        Returns:
            The goal; it fails if the base is blocked, and is canceled when no velocity is commanded any more.

        Raises:
            CommandRefusedError: a velocity is beyond a limit, or the base cannot move in that direction.
        """
        return self._start(lambda engine: self.controller.drive(engine, (vx, vy, wz)), "drive")

    @checked
    def point_head(self, pan: Angle | None = None, tilt: Angle | None = None) -> MotionGoal:
        """Starts to turn the head to a pan and a tilt [rad]; None leaves a joint as it is.

        Raises:
            CommandRefusedError: there is no head, or an angle is beyond a limit.
        """
        joints = self.model.head.joints if self.model.head is not None else ()
        wanted = {name: value for name, value in zip(joints, (pan, tilt), strict=False) if value is not None}
        if not wanted:
            raise CommandRefusedError(
                self.name, command="a turn of the head", cause="it has no such joint", remedy="move its base instead"
            )
        return self.start_trajectory(self.trajectory_to(wanted))

    @checked
    def trajectory_to(self, positions: Mapping[str, Finite], *, speed: Factor = 0.8) -> JointTrajectory:
        """The straight trajectory in joint space from the current state, without regard to obstacles.

        Args:
            positions: where joints are at the end [m or rad].
            speed: the fraction of their velocity limits that is used.

        Raises:
            CommandRefusedError: a joint is unknown.
        """
        drives = self.controller.drives.joints
        if unknown := [name for name in positions if name not in drives]:
            raise CommandRefusedError(
                self.name,
                command=f"a motion of {unknown[0]!r}",
                cause="it has no joint with a drive of that name",
                remedy=f"use {', '.join(drives)}",
            )
        now = self.joint_positions()
        joints = [drives[name].joint for name in positions]
        return point_to_point(joints, [now[name] for name in positions], list(positions.values()), speed=speed)

    def stop(self) -> None:
        """Ends all motions; the joints hold their positions."""
        self.session.engine.run(lambda _: self.controller.stop(), label="stop robot")

    def halt(self) -> None:
        """Ends all motions at once, without a ramp: for what has been pressed into something."""
        for goal in self.controller.goals:
            goal.halt()

    # -- motions -------------------------------------------------------------------------------------------

    @checked
    def following(
        self,
        trajectory: JointTrajectory,
        *,
        tolerance: Mapping[str, NotNegative] | NotNegative | None = None,
        path_tolerance: Mapping[str, NotNegative] | NotNegative | None = None,
        goal_time_tolerance_s: Timeout = 2.0,
    ) -> Generator[float, None, MotionResult]:
        """Moves joints along a trajectory; see `start_trajectory`. Yields the times by which the caller steps [s]."""
        goal = self.start_trajectory(
            trajectory,
            tolerance=tolerance,
            path_tolerance=path_tolerance,
            goal_time_tolerance_s=goal_time_tolerance_s,
        )
        return (yield from self.waiting(goal))

    @checked
    def moving_to(
        self, positions: Mapping[str, Finite], *, speed: Factor = 0.8
    ) -> Generator[float, None, MotionResult]:
        """Moves joints straight to positions [m or rad], without regard to obstacles; see `trajectory_to`."""
        return (yield from self.following(self.trajectory_to(positions, speed=speed)))

    @checked
    def gripping(
        self, gripper: str, opening_m: Finite, *, max_force_n: NotNegative | None = None
    ) -> Generator[float, None, MotionResult]:
        """Opens or closes a gripper; see `start_gripping`."""
        return (yield from self.waiting(self.start_gripping(gripper, opening_m, max_force_n=max_force_n)))

    @checked
    def driving(
        self, path: Sequence[tuple[Finite, Finite, Finite]], *, speed: Factor = 1.0
    ) -> Generator[float, None, MotionResult]:
        """Drives the base along poses in the world frame; see `start_driving`."""
        return (yield from self.waiting(self.start_driving(path, speed=speed)))

    def waiting(self, goal: MotionGoal) -> Generator[float, None, MotionResult]:
        """Yields until a goal has ended; cancels it when the generator is closed."""
        try:
            while goal.result is None:
                yield _WAIT_S
            return goal.result
        finally:
            if goal.result is None:
                goal.cancel()

    @checked
    def do(
        self,
        skill: str,
        /,
        *,
        deadline_s: Timeout = 300.0,
        seed: Seed = 0,
        on_step: Callable[[SkillStep], object] | None = None,
        **args: object,
    ) -> SkillResult:
        """Performs a skill, while the simulation is stepped as by `run`: `robot.do("open fridge_door")`.

        Args:
            skill: its name, `robot.do("open", thing="fridge_door")`, or a command with arguments, of which those that
                belong together are in quotes.
            deadline_s: the skill fails if it has not ended after this simulated time [s].
            seed: of everything that is sampled.
            on_step: called when a step begins and when it ends.
            args: the arguments of the skill.

        Returns:
            The result, which is true if the skill succeeded. One that fails is a result, not an error.

        Raises:
            InvalidArgumentError: there is no such skill, or it does not take these arguments; nothing moved.
        """
        motion = self._start_skill(self, skill, args, deadline_s=deadline_s, seed=seed, on_step=on_step)
        return self.run(motion, timeout_s=deadline_s)

    @checked
    def run(self, motion: Generator[float, None, T], *, timeout_s: Timeout = 600.0) -> T:
        """Steps the simulation until a motion has ended, and returns its result.

        While the simulation plays in real time, it waits for the simulated time to pass instead.

        Args:
            motion: a generator of simulated times [s].
            timeout_s: the largest simulated time [s].

        Raises:
            TimeoutError: the motion did not end; it was closed.
        """
        left_s = timeout_s
        try:
            while True:
                try:
                    duration_s = next(motion)
                except StopIteration as end:
                    result: T = end.value
                    return result
                if left_s <= 0.0:
                    raise TimeoutError(f"the motion of {self.name} did not end within {timeout_s:g} s")
                left_s -= duration_s
                self._pass(duration_s)
        finally:
            motion.close()

    def _pass(self, duration_s: float) -> None:
        """Lets simulated time pass: by steps, or by waiting while it plays."""
        start_s = self.session.state.time_s
        while self.session.state.playing and self.session.state.time_s < start_s + duration_s - 1e-9:
            time.sleep(min(duration_s, 0.01))
        if (left_s := start_s + duration_s - self.session.state.time_s) > 1e-9:
            self.session.step(left_s)

    def _start(self, start: Callable[[Engine], MotionGoal], label: str) -> MotionGoal:
        goal = self.session.engine.run(start, label=label)
        if goal is not self._last_goal:  # a velocity is commanded again and again
            self._last_goal = goal
            details = {"robot": self.name, "motion": goal.kind, **goal.command_details()}
            self.session.observers.report("command", ids=(self._root,), details=details)
        return goal

    def _report_end(self, goal: MotionGoal) -> None:
        """Reports the end of a motion to observers; called in the engine thread."""
        if goal.result is not None:
            details = {"robot": self.name, "motion": goal.kind, **msgspec.to_builtins(goal.result)}
            self.session.observers.report("motion", ids=(self._root,), details=details, client=self.name)

    @contextmanager
    def performing(self, skill: str, args: Mapping[str, object]) -> Iterator[Callable[[str, str], None]]:
        """In the context the robot performs a skill, which recordings have as an event.

        Args:
            skill: the name of the skill.
            args: its arguments, as JSON values.

        Yields:
            A function that takes the outcome and the reason; without a call the skill was canceled.
        """
        present = set(self.session.state.ids)
        things = tuple(BodyId(str(value)) for value in args.values() if str(value) in present)
        details = {"performance": uuid.uuid4().hex, "skill": skill, "args": dict(args), "agent": self._root}
        end: dict[str, str] = {}

        def finish(outcome: str, reason: str) -> None:
            end.update(outcome=outcome, reason=reason)

        ids = (*things, self._root)
        self.session.observers.report(SKILL_EDIT, ids=ids, details=details, client=self.name)
        try:
            yield finish
        finally:
            result = end or {"outcome": MotionOutcome.CANCELED.value, "reason": ""}
            self.session.observers.report(SKILL_EDIT, ids=ids, details=details | result, client=self.name)

    # -- copies --------------------------------------------------------------------------------------------

    @property
    def controller_name(self) -> str:
        """The name of its controller in the simulation."""
        return f"robot {self.name}"

    def remove(self) -> None:
        """Deletes it with its bodies."""
        self.session.edits.apply(self.edit.removal(self.session.state.ids))

    def in_copy(self, session: Simulation, controllers: ControllerSchedule) -> Robot:
        """The same robot in a copy of its simulation.

        Args:
            session: the copy.
            controllers: the controllers of the copy.
        """
        controller = controllers.controllers[self.controller_name]
        assert isinstance(controller, RobotController)
        if Capability.ACTUATORS in session.engine.capabilities:  # an engine that was not forked has no actuators yet
            session.engine.run(controller.connect, label="connect robot")
        return Robot(
            self.name,
            self.model,
            self._placed,
            edit=self.edit,
            session=session,
            controller=controller,
            report=self.report,
            start_skill=self._start_skill,
        )

    def __repr__(self) -> str:
        kind = self.model.base.type.value
        return f"<{type(self).__name__} {self.name}: {self.model.name}, {kind} base, {len(self._axes)} joints>"

    def _with_mimics(self, states: dict[str, JointState]) -> dict[str, JointState]:
        """The states with the velocities of joints that follow others."""
        for joint in self.model.joints:
            if joint.mimic is not None and joint.name in states and joint.mimic.joint in states:
                velocity = joint.mimic.multiplier * states[joint.mimic.joint].velocity
                states[joint.name] = msgspec.structs.replace(states[joint.name], velocity=velocity)
        return states


def _actuator_states(engine: Engine) -> Mapping[str, ActuatorState]:
    """The states of the actuators; empty for an engine without any."""
    return engine.actuator_states() if Capability.ACTUATORS in engine.capabilities else {}


def contact_free_pairs(model: RobotModel, placed: RobotWorld) -> frozenset[tuple[BodyId, BodyId]]:
    """The pairs of bodies of a robot that have no contacts with each other."""
    return frozenset((placed.link_ids[a], placed.link_ids[b]) for a, b in model.disabled_collisions)
