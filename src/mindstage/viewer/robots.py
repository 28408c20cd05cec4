"""The Robot panel: adds robots, runs their skills, and moves joints, grippers and bases while the simulation plays.

Every page shows the same robots and the skill that each one performs; one skill at a time runs for each robot, in a
thread of its own that waits for simulated time. Handles at the grippers are drawn for all pages; inverse kinematics
runs in one thread for all of them, which takes the latest pose and skips those in between.
"""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Callable, Generator, Mapping
from pathlib import Path
from typing import Annotated, Any
from urllib.parse import quote

import msgspec
import numpy as np
import viser
from msgspec import Meta

from mindstage.access.limits import SKILL_TIME
from mindstage.access.policies import EDIT, QUERY, READ, RUN, SPAWN, Policy
from mindstage.access.resources import without_paths
from mindstage.errors import CommandRefusedError, InvalidArgumentError, MindstageError
from mindstage.knowledge.names import EntityType
from mindstage.ranges import Angle, Coordinate
from mindstage.robots import find_robot, robots_of
from mindstage.robots.base_placement import reachable_region
from mindstage.robots.models.catalog import list_models
from mindstage.robots.models.robot_model import Arm
from mindstage.robots.robot import Robot
from mindstage.robots.robot_kinematics import RobotKinematics
from mindstage.robots.sensors import measure, sensor_names
from mindstage.robots.skill_declaration import (
    ParameterType,
    SkillParameter,
    SkillResult,
    SkillSpec,
    SkillStep,
    skill_specs,
)
from mindstage.robots.skill_performance import start_skill
from mindstage.robots.standing import add_standing_robot
from mindstage.scene import Vector
from mindstage.scene.transforms import Array, normalize
from mindstage.simulation import Simulation
from mindstage.simulation.observation import as_client
from mindstage.viewer.server import CLIENT, ClientSession, EmptyRequest, RpcChannel

__all__ = ["RobotHandler", "skill_form"]

_log = logging.getLogger(__name__)
_QUEUE = "robots"
_SLOW = frozenset({"add", "region"})
"""Requests that take seconds; the others, such as `stop`, do not wait for them."""
_Name = Annotated[str, Meta(min_length=1, max_length=300)]
_Share = Annotated[float, Meta(ge=-1.0, le=1.0)]
_POLL_S = 0.005
_HAND_SPEED = 0.5
"""Speed of joints that are moved by hand, as a share of their largest ones."""
_IK_ATTEMPTS = 3
_COMPLETIONS = {
    ParameterType.THING: EntityType.INDIVIDUAL,
    ParameterType.SUPPORT: EntityType.INDIVIDUAL,
    ParameterType.CLASS: EntityType.CLASS,
}
_HANDLE_SCALE = 0.25
_REGION_COLOR = (34, 158, 84)
_REGION_POINT_M = 0.012


class RobotRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `robots.remove` and `robots.stop`."""

    robot: _Name


class SensorRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `robots.measure`."""

    robot: _Name
    sensor: _Name
    link: Annotated[str, Meta(max_length=200)] = ""
    """By default see `mindstage.robots.sensors.measure`."""


class AddRobotRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `robots.add`."""

    model: _Name
    """A name of the catalog; pages cannot read files of this machine."""
    pose: tuple[Coordinate, Coordinate, Angle] | None = None
    """x, y [m] and yaw [rad]; by default on the free floor nearest to the point that the camera looks at."""


class MoveRobotJointRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `robots.move_joint`."""

    robot: _Name
    joint: _Name
    position: Annotated[float, Meta(ge=-1e3, le=1e3)]
    """[m] or [rad]."""


class GripRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `robots.grip`."""

    robot: _Name
    gripper: _Name
    opening_m: Annotated[float, Meta(ge=0.0, le=1.0)]


class DriveRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `robots.drive`: forward, left and turn, as shares of the largest velocities."""

    robot: _Name
    velocity: tuple[_Share, _Share, _Share]


class GripperHandleRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `robots.target`: shows or hides the handle at a gripper."""

    robot: _Name
    arm: _Name
    shown: bool


class RegionRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `robots.region`: shows or hides what an arm reaches at a height."""

    robot: _Name
    arm: _Name
    shown: bool
    height_m: Annotated[float, Meta(ge=0.0, le=3.0)] = 0.9


class RunSkillRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of `robots.skill`."""

    robot: _Name
    skill: _Name
    args: dict[str, str] = {}


class _FormField(msgspec.Struct, frozen=True, kw_only=True):
    name: str
    kind: str
    text: str
    choices: tuple[str, ...] = ()
    completion: str = ""
    """The kind of names that are completed, such as INDIVIDUAL; empty if it is a number."""
    required: bool = False


class _SkillForm(msgspec.Struct, frozen=True, kw_only=True):
    name: str
    text: str
    arguments: tuple[_FormField, ...]


def skill_form(spec: SkillSpec) -> _SkillForm:
    """Describes a skill for its form on the page."""
    return _SkillForm(name=spec.name, text=spec.documentation, arguments=tuple(map(_form_field, spec.parameters)))


def _form_field(parameter: SkillParameter) -> _FormField:
    completion = _COMPLETIONS.get(parameter.type)
    return _FormField(
        name=parameter.name,
        kind="number" if parameter.type.is_number else parameter.type.value,
        text=parameter.description,
        completion="" if completion is None else completion.name,
        required=parameter.required,
    )


class _SkillRun:
    """One performance of a skill by a robot: its thread, and what the pages show of it."""

    def __init__(
        self,
        simulation: Simulation,
        robot: Robot,
        name: str,
        args: Mapping[str, str],
    ) -> None:
        """Checks the arguments, and starts the skill.

        Raises:
            InvalidArgumentError: there is no such skill, or it does not take these arguments.
        """
        self._simulation, self._start_s = simulation, simulation.state.time_s
        self._canceled = threading.Event()
        self._step = ""
        self._result: SkillResult | None = None
        self._error = ""
        self.name, self._args, self._robot_name = name, dict(args), robot.name
        self._end_s: float | None = None
        motion = start_skill(robot, name, args, deadline_s=SKILL_TIME.maximum, on_step=self._on_step)
        self._thread = threading.Thread(target=self._run, args=(motion,), name=f"mindstage-{name}", daemon=True)
        self._thread.start()

    @property
    def is_running(self) -> bool:
        """Whether it has not ended."""
        return self._thread.is_alive()

    def cancel(self) -> None:
        """Stops the robot, and waits until it has."""
        self._canceled.set()
        self._thread.join(timeout=self._simulation.timeout_s)

    def state(self) -> dict[str, object]:
        """What the pages show."""
        end_s = self._simulation.state.time_s if self._end_s is None else self._end_s
        shown: dict[str, object] = {
            "state": "running" if self.is_running else "done",
            "skill": self.name,
            "args": self._args,
            "time_s": round(end_s - self._start_s, 1),
            "step": self._step,
            "outcome": "canceled" if self._canceled.is_set() else "failed",
            "reason": self._error,
        }
        if (result := self._result) is not None:
            shown |= {
                "outcome": result.outcome.value,
                "reason": result.reason or result.state.text,
                "suggestion": result.suggestion,
                "assumptions": result.assumptions,
            }
        return shown

    def _on_step(self, step: SkillStep) -> None:
        if step.end_s is None:
            self._step = step.text

    def _run(self, motion: Generator[float, None, SkillResult]) -> None:
        try:
            what = " ".join([self.name.replace("_", " "), *self._args.values()])
            with as_client(CLIENT), self._simulation.edits.one_step(f"{self._robot_name}: {what}"):
                self._result = self._perform(motion)
        except MindstageError as error:
            self._error = without_paths(str(error))
        except Exception as error:
            self._error = without_paths(f"{type(error).__name__}: {error}; this is a defect of Mindstage")
            raise
        finally:
            self._end_s = self._simulation.state.time_s
            self._step = ""

    def _perform(self, motion: Generator[float, None, SkillResult]) -> SkillResult | None:
        try:
            while not self._canceled.is_set():
                try:
                    duration_s = next(motion)
                except StopIteration as end:
                    result: SkillResult = end.value
                    return result
                self._wait(duration_s)
            return None
        finally:
            motion.close()

    def _wait(self, duration_s: float) -> None:
        """Waits until the simulation has advanced; it does not while it is paused."""
        before_s = self._simulation.state.time_s
        while not self._canceled.is_set():
            now_s = self._simulation.state.time_s
            if now_s >= before_s + duration_s or now_s < before_s or self._simulation.closed:  # less after a reset
                return
            self._canceled.wait(_POLL_S)


class _GripperHandle:
    """The handle in the view at the gripper of an arm, and the pose that it was dragged to."""

    def __init__(self, server: viser.ViserServer, robot: Robot, arm: Arm, on_drag: Callable[[], None]) -> None:
        """Shows the handle.

        Args:
            server: the server of the scene.
            on_drag: called in a thread of the server after each motion of the handle.
        """
        self.robot, self.arm = robot, arm
        self.reason = ""
        """Why the pose is not reached."""
        self._on_drag = on_drag
        self._lock = threading.Lock()
        self._wanted: Array | None = None
        self._dragging = False
        pose = self._gripper_pose()
        self._node = server.scene.add_transform_controls(
            f"/robots/{quote(robot.name, safe='')}/{quote(arm.name, safe='')}",
            scale=_HANDLE_SCALE,
            depth_test=False,
            position=pose[:3],
            wxyz=pose[3:],
        )
        self._node.on_update(self._drag)

    def take(self) -> Array | None:
        """The latest pose that it was dragged to, once."""
        with self._lock:
            wanted, self._wanted = self._wanted, None
            return wanted

    def follow(self) -> None:
        """Moves to the gripper, unless it is being dragged."""
        if not self._dragging:
            pose = self._gripper_pose()
            self._node.position, self._node.wxyz = pose[:3], pose[3:]

    def remove(self) -> None:
        """Removes it from the view."""
        self._node.remove()

    def _gripper_pose(self) -> Array:
        frame = self.arm.gripper
        return self.robot.link_pose(self.arm.tip_link) if frame is None else self.robot.grasp_pose(frame)

    def _drag(self, event: viser.TransformControlsEvent) -> None:
        with self._lock:
            self._dragging = event.phase != "end"
            self._wanted = np.concatenate([event.target.position, normalize(event.target.wxyz)])
        self._on_drag()


class RobotHandler:
    """Handles the requests `robots.…`, and publishes the topics `robots` and `robot_states`."""

    def __init__(
        self,
        simulation: Simulation,
        channel: RpcChannel,
        server: viser.ViserServer,
        *,
        view_center: Callable[[ClientSession], Vector | None],
    ) -> None:
        """Registers the requests.

        Args:
            simulation: the simulation that the robots are in.
            channel: the channel of the pages.
            server: the server of the scene, whose nodes only `update` and the requests use.
            view_center: returns the point that the camera of a session looks at.
        """
        self._simulation, self._channel, self._server = simulation, channel, server
        self._view_center = view_center
        self._runs: dict[str, _SkillRun] = {}
        self._handles: dict[tuple[str, str], _GripperHandle] = {}
        self._regions: dict[tuple[str, str], viser.PointCloudHandle] = {}
        self._kinematics: dict[str, RobotKinematics] = {}
        self._dragged = threading.Event()
        self._closing = False
        self._solver: threading.Thread | None = None
        requests: tuple[tuple[str, type[msgspec.Struct], Callable[[ClientSession, Any], object], Policy], ...] = (
            ("offer", EmptyRequest, self._offer, READ),
            ("add", AddRobotRequest, self._add, SPAWN),
            ("remove", RobotRequest, self._remove, EDIT),
            ("move_joint", MoveRobotJointRequest, self._move_joint, EDIT),
            ("grip", GripRequest, self._grip, EDIT),
            ("drive", DriveRequest, self._drive, EDIT),
            ("target", GripperHandleRequest, self._show_handle, EDIT),
            ("region", RegionRequest, self._show_region, QUERY),
            ("skill", RunSkillRequest, self._run_skill, RUN),
            ("stop", RobotRequest, self._stop, EDIT),
            ("measure", SensorRequest, self._measure, QUERY),
        )
        for name, request_type, handler, policy in requests:
            queue = f"{_QUEUE}.{name}" if name in _SLOW else _QUEUE
            channel.register(f"robots.{name}", request_type, handler, policy, queue=queue)
        self._publish_robots()

    def close(self) -> None:
        """Ends skills and threads."""
        self._closing = True
        self._dragged.set()
        for run in self._runs.values():
            run.cancel()
        if self._solver is not None:
            self._solver.join(timeout=self._simulation.timeout_s)

    # -- for the drawing thread ----------------------------------------------------------------------------------------

    def update(self) -> None:
        """Moves the handles with their grippers."""
        for (name, _), handle in list(self._handles.items()):
            if name in self._simulation.robots:
                handle.follow()

    def publish(self) -> None:
        """Publishes the robots and their states; called several times a second."""
        self._publish_robots()
        if self._channel.sessions:
            robots = robots_of(self._simulation)
            self._channel.publish("robot_states", {name: self._state(robot) for name, robot in robots.items()})

    def _publish_robots(self) -> None:
        robots = robots_of(self._simulation)
        self._channel.publish("robots", [_described(robot) for robot in robots.values()])
        for key in [key for key in (*self._handles, *self._regions) if key[0] not in robots]:
            self._hide(key)
        for name in [name for name in self._runs if name not in robots]:
            self._runs.pop(name).cancel()

    def _hide(self, key: tuple[str, str]) -> None:
        if (handle := self._handles.pop(key, None)) is not None:
            handle.remove()
        if (region := self._regions.pop(key, None)) is not None:
            region.remove()

    def _state(self, robot: Robot) -> dict[str, object]:
        model, run = robot.model, self._runs.get(robot.name)
        positions = robot.joint_positions()
        return {
            "positions": {name: round(position, 4) for name, position in positions.items()},
            "openings": {each.name: round(robot.opening(each.name), 4) for each in model.grippers},
            "targets": {arm.name: self._target_state(robot, arm) for arm in model.arms},
            "held": dict(robot.held),
            "base": tuple(round(each, 3) for each in robot.base_pose()),
            "skill": None if run is None else run.state(),
        }

    def _target_state(self, robot: Robot, arm: Arm) -> dict[str, object]:
        key = robot.name, arm.name
        handle = self._handles.get(key)
        return {
            "shown": handle is not None,
            "reason": "" if handle is None else handle.reason,
            "region": key in self._regions,
        }

    # -- robots --------------------------------------------------------------------------------------------------------

    def _offer(self, _: ClientSession, __: EmptyRequest) -> dict[str, object]:
        """The models that can be added, the skills, and the sensors."""
        models = [{"name": each.name, "title": each.title} for each in list_models() if each.is_installed]
        skills = [skill_form(spec) for spec in skill_specs().values()]
        return {"models": models, "skills": skills, "measurable": sensor_names()}

    def _add(self, session: ClientSession, request: AddRobotRequest) -> str:
        known = [each.name for each in list_models()]
        if request.model not in known:
            remedy = f"choose one of {', '.join(known)}"
            raise InvalidArgumentError(request.model, cause="there is no such model in the catalog", remedy=remedy)
        center = self._view_center(session)
        near = None if center is None else center[:2]
        robot = add_standing_robot(self._simulation, request.model, request.pose, near=near)
        self.publish()
        return robot.name

    def _measure(self, _: ClientSession, request: SensorRequest) -> object:
        return measure(self._robot(request.robot), request.sensor, request.link)

    def _remove(self, _: ClientSession, request: RobotRequest) -> None:
        robot = self._robot(request.robot)
        self._cancel(robot)
        robot.remove()
        self.publish()

    def _robot(self, name: str) -> Robot:
        return find_robot(self._simulation, name)

    # -- motion by hand ------------------------------------------------------------------------------------------------

    def _move_joint(self, _: ClientSession, request: MoveRobotJointRequest) -> None:
        robot = self._free_robot(request.robot)
        _move_to(robot, {request.joint: request.position})

    def _grip(self, _: ClientSession, request: GripRequest) -> None:
        robot = self._free_robot(request.robot)
        robot.start_gripping(request.gripper, request.opening_m)

    def _drive(self, _: ClientSession, request: DriveRequest) -> None:
        robot = self._free_robot(request.robot)
        base, (forward, left, turn) = robot.model.base, request.velocity
        speed = base.velocity / max(1.0, math.hypot(forward, left))
        robot.drive(forward * speed, left * speed, turn * base.turn_velocity)

    def _show_handle(self, _: ClientSession, request: GripperHandleRequest) -> None:
        robot, key = self._robot(request.robot), (request.robot, request.arm)
        if (handle := self._handles.pop(key, None)) is not None:
            handle.remove()
        if request.shown:
            self._handles[key] = _GripperHandle(self._server, robot, _arm(robot, request.arm), self._dragged.set)
            if self._solver is None:
                self._solver = threading.Thread(target=self._follow_handles, name="mindstage-handles", daemon=True)
                self._solver.start()
        self.publish()

    def _follow_handles(self) -> None:
        """Moves arms to where their handles were dragged, until the viewer is closed."""
        while not self._closing:
            self._dragged.wait()
            self._dragged.clear()
            for handle in list(self._handles.values()):
                if (wanted := handle.take()) is not None:
                    try:
                        with as_client(CLIENT):
                            handle.reason = self._reach(handle.robot, handle.arm, wanted)
                    except MindstageError as error:
                        handle.reason = without_paths(str(error))
                    except Exception as error:
                        handle.reason = without_paths(f"{type(error).__name__}: {error}; this is a defect of Mindstage")
                        _log.error("a gripper could not be moved to its handle", exc_info=error)

    def _reach(self, robot: Robot, arm: Arm, target: Array) -> str:
        """Moves a gripper as near to a pose as it gets; returns why it does not get there, or an empty text."""
        self._free_robot(robot.name)
        model = robot.model
        kinematics = self._kinematics.setdefault(robot.name, RobotKinematics(model))
        result = kinematics.solve_ik(
            kinematics.frame_of(arm),
            target,
            seed=robot.joint_positions(),
            root_pose=robot.link_pose(model.root),
            attempts=_IK_ATTEMPTS,
        )
        _move_to(robot, result.positions)
        return result.reason

    def _show_region(self, _: ClientSession, request: RegionRequest) -> None:
        robot, key = self._robot(request.robot), (request.robot, request.arm)
        arm = _arm(robot, request.arm)
        if (node := self._regions.pop(key, None)) is not None:
            node.remove()
        if request.shown:
            points: Array = reachable_region(robot, arm, request.height_m)
            self._regions[key] = self._server.scene.add_point_cloud(
                f"/regions/{quote(robot.name, safe='')}/{quote(arm.name, safe='')}",
                points,
                np.tile(np.array(_REGION_COLOR, np.uint8), (len(points), 1)),
                point_size=_REGION_POINT_M,
                point_shape="circle",
                precision="float32",
            )
        self.publish()

    # -- skills --------------------------------------------------------------------------------------------------------

    def _run_skill(self, _: ClientSession, request: RunSkillRequest) -> None:
        robot = self._free_robot(request.robot)
        args: dict[str, str] = {name: text for name, text in request.args.items() if text}
        self._runs[robot.name] = _SkillRun(self._simulation, robot, request.skill, args)
        if not self._simulation.state.playing:
            self._simulation.play()
        self.publish()

    def _stop(self, _: ClientSession, request: RobotRequest) -> None:
        robot = self._robot(request.robot)
        self._cancel(robot)
        robot.stop()
        self.publish()

    def _cancel(self, robot: Robot) -> None:
        if (run := self._runs.get(robot.name)) is not None and run.is_running:
            run.cancel()

    def _free_robot(self, name: str) -> Robot:
        """The robot, unless it performs a skill.

        Raises:
            RobotNotFoundError: there is no such robot.
            CommandRefusedError: it performs a skill.
        """
        robot, run = self._robot(name), self._runs.get(name)
        if run is not None and run.is_running:
            raise CommandRefusedError(
                name, command="a command", cause=f"it performs {run.name}", remedy="stop it first"
            )
        return robot


def _described(robot: Robot) -> dict[str, object]:
    """The description of a robot for its panel."""
    model = robot.model
    groups = {joint: arm.name for arm in model.arms for joint in arm.joints}
    groups |= {joint: gripper.name for gripper in model.grippers for joint in gripper.joints}
    groups |= dict.fromkeys(model.head.joints if model.head else (), "head")
    return {
        "name": robot.name,
        "model": model.name,
        "base": {"type": model.base.type.value},
        "arms": [{"name": arm.name, "gripper": arm.gripper} for arm in model.arms],
        "grippers": [{"name": each.name, "max_opening_m": each.max_opening_m} for each in model.grippers],
        "joints": [
            {
                "name": joint.name,
                "lower": joint.lower,
                "upper": joint.upper,
                "is_prismatic": joint.is_prismatic,
                "group": groups.get(joint.name, ""),
            }
            for joint in model.actuated_joints
        ],
        "sensors": [f"{each.name} ({each.type.value})" for each in model.sensors],
        "notes": [f"{each.subject}: {each.text}" if each.subject else each.text for each in model.notes],
        "source": Path(model.source).name,
    }


def _arm(robot: Robot, name: str) -> Arm:
    for arm in robot.model.arms:
        if arm.name == name:
            return arm
    known = ", ".join(arm.name for arm in robot.model.arms)
    raise InvalidArgumentError(name, cause=f"{robot.name} has no such arm", remedy=f"it has {known or 'none'}")


def _move_to(robot: Robot, positions: Mapping[str, float]) -> None:
    """Begins to move joints straight to positions, as fast as is comfortable to watch."""
    robot.start_trajectory(robot.trajectory_to(positions, speed=_HAND_SPEED))
