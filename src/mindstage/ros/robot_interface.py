"""What ROS programs see of the robots of a simulation: the topics, actions and services of real robots.

The first robot has the names of a real one, without a namespace, so that a program can be switched to it without a
change; a further one has its name as its namespace. Robots may be added and removed while programs are connected.
"""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

from mindstage.errors import MindstageError
from mindstage.msgs import builtin_interfaces, sensor_msgs, std_msgs
from mindstage.robots import robots_of
from mindstage.ros.endpoints import Endpoints
from mindstage.ros.robot_description import robot_description
from mindstage.ros.robot_skills import RobotSkills
from mindstage.ros.rosapi import ParameterServer
from mindstage.ros.state import StateReader
from mindstage.simulation import StateSnapshot

if TYPE_CHECKING:  # it is loaded with the first robot
    from mindstage.robots.robot import Robot

__all__ = ["RobotInterfaces"]


class _RobotInterface:
    """One robot."""

    def __init__(
        self, robot: Robot, endpoints: Endpoints, state_reader: StateReader, parameters: ParameterServer
    ) -> None:
        from mindstage.ros.robot_base import RobotBaseInterface
        from mindstage.ros.robot_controllers import RobotControllers

        self.robot = robot
        self.endpoints = endpoints
        self._parameters = parameters
        self._controllers = RobotControllers(robot, state_reader)
        self._base = RobotBaseInterface(robot, state_reader, endpoints.diagnostics)
        try:
            self._joint_states = endpoints.publisher("joint_states", sensor_msgs.JointState)
            self._description = endpoints.publisher("robot_description", std_msgs.String, latch=True)
            self._controllers.open(endpoints)
            self._base.open(endpoints)
        except BaseException:
            endpoints.close()
            raise
        text = robot_description(robot)
        self._description.publish(std_msgs.String(data=text))
        if endpoints.namespace:  # without one, the parameter is computed
            parameters.set(endpoints.full_name("robot_description"), text)
        endpoints.set_parameter("robot_description", text)

    def publish(self, snapshot: StateSnapshot) -> None:
        """Publishes the state of the robot."""
        if self._joint_states.has_subscribers:
            states = self.robot.joint_states()
            self._joint_states.publish(
                sensor_msgs.JointState(
                    header=std_msgs.Header(stamp=builtin_interfaces.Time.at(snapshot.time_s)),
                    name=tuple(states),
                    position=tuple(each.position for each in states.values()),
                    velocity=tuple(each.velocity for each in states.values()),
                    effort=tuple(each.effort for each in states.values()),
                )
            )
        self._controllers.publish(snapshot)
        self._base.publish(snapshot)

    def close(self) -> None:
        """Withdraws everything."""
        self.endpoints.close()
        if self.endpoints.namespace:
            self._parameters.delete(self.endpoints.full_name("robot_description"))


class RobotInterfaces:
    """All robots of a simulation; may be used from any thread."""

    def __init__(
        self, endpoints: Endpoints, state_reader: StateReader, parameters: ParameterServer, skills: RobotSkills
    ) -> None:
        """Offers the robots that exist.

        Args:
            endpoints: those of the place, at whose node the robots are offered.
            state_reader: reads the state of the simulation.
            parameters: the parameters of the node.
            skills: the skills of the robots, each of which is offered while there is a robot.

        Raises:
            AdvertiseError: a name is taken.
        """
        self._place = endpoints
        self._skills = skills
        self._skill_actions = endpoints.in_namespace(endpoints.namespace)
        self._state_reader = state_reader
        self._parameters = parameters
        self._lock = threading.RLock()
        self._closed = False
        self._version: object = None
        self._has_skills = False
        self._interfaces: dict[str, _RobotInterface] = {}
        self._refused: dict[str, Robot] = {}
        """Robots whose names are taken."""
        self._update(raises=True)

    def update(self) -> None:
        """Offers the robots that were added, and withdraws those that were removed; to be called regularly."""
        with self._lock:
            if not self._closed and self._state_reader.version() != self._version:
                self._update(raises=False)

    def publish(self, snapshot: StateSnapshot) -> None:
        """Publishes the state of all robots."""
        with self._lock:  # a topic that was withdrawn meanwhile would be announced again
            for each in self._interfaces.values():
                if each.robot.exists:
                    each.publish(snapshot)

    def publish_status(self) -> None:
        """Publishes the status of the goals in ROS 1; to be called regularly."""
        with self._lock:
            interfaces = tuple(self._interfaces.values())
        for each in (self._skill_actions, *(interface.endpoints for interface in interfaces)):
            each.publish_status()

    def close(self) -> None:
        """Withdraws everything; calling it again is harmless."""
        with self._lock:
            self._closed = True
            for each in self._interfaces.values():
                each.close()
            self._interfaces.clear()
            self._skill_actions.close()

    def _update(self, *, raises: bool) -> None:
        self._version = self._state_reader.version()
        namespaces, robots = self._state_reader.robot_namespaces(), robots_of(self._state_reader.simulation)
        for name, interface in list(self._interfaces.items()):
            if robots.get(name) is not interface.robot:
                self._interfaces.pop(name).close()
        if robots and not self._has_skills:
            self._offer_skills()
        elif not robots:
            self._skill_actions.close()
        self._has_skills = bool(robots)
        for name, robot in robots.items():
            if name in self._interfaces or name not in namespaces or self._refused.get(name) is robot:
                continue
            endpoints = self._place.in_namespace(namespaces[name])
            try:
                self._interfaces[name] = _RobotInterface(robot, endpoints, self._state_reader, self._parameters)
            except MindstageError as error:
                if raises:
                    raise
                self._refused[name] = robot
                self._place.diagnostics.report_error(f"robot {name}", error)

    def _offer_skills(self) -> None:
        """Offers the action of each skill; without the libraries of skills, the robots are offered without them."""
        try:
            for action in self._skills.skill_actions():
                self._skill_actions.create_action(action)
        except ImportError as error:
            self._place.diagnostics.report_failures("skills", [("", f"{error}; install mindstage[robots]")])
