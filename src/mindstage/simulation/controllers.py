"""Controllers: functions that command the actuators of an engine while simulated time advances.

They are called in the engine thread at fixed periods of simulated time, whether the simulation plays or is stepped, and
are copied with it. While none is active, stepping costs the same as without controllers.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from traceback import format_exception_only
from typing import Any, Protocol

from mindstage.access.limits import CONTROLLER_PERIOD
from mindstage.engines.actuators import ActuatedBodies
from mindstage.engines.base import Engine
from mindstage.errors import EngineError, SimulationFaultError
from mindstage.scene import BodyId
from mindstage.sensors.camera_model import CameraMount

__all__ = ["EARLY_S", "Controller", "ControllerSchedule", "SimulatedRobot", "SimulatedRobots", "fault_error"]

EARLY_S = 1e-9
"""A time that is so little before that of an update counts as equal [s]."""


class Controller(Protocol):
    """Commands actuators. Its state can be copied and pickled; it keeps no reference to an engine."""

    period_s: float
    """The simulated time between two updates [s]."""

    @property
    def is_active(self) -> bool:
        """Whether it is to be updated; actuators keep their last command otherwise."""

    def update(self, engine: Engine, time_s: float) -> None:
        """Commands the actuators for the next period; called in the engine thread, and must not step the engine.

        Args:
            engine: the engine, to which no reference may be kept.
            time_s: the simulated time [s].
        """

    def copy(self) -> Controller:
        """An independent controller in the same state, for a copy of the simulation."""

    def reset(self, engine: Engine) -> None:
        """Ends everything that it does; the world was reset to its start."""


class ControllerSchedule:
    """The controllers of a simulation by name, and when each is updated next; used in the engine thread."""

    def __init__(self, *, caught: type[BaseException] = Exception) -> None:
        """Creates an empty schedule.

        Args:
            caught: what is caught of what controllers raise; all, in a thread that has to go on.
        """
        self.caught = caught
        self._controllers: Mapping[str, Controller] = {}
        self._waits_s: dict[str, float] = {}
        """The simulated time until the next update of each active controller [s]."""
        self._called = ""

    @property
    def controllers(self) -> Mapping[str, Controller]:
        """The controllers by name."""
        return self._controllers

    @property
    def called(self) -> str:
        """The name of the controller that is being called now, which has not returned; may be read from any thread."""
        return self._called

    def add(self, name: str, controller: Controller) -> None:
        """Adds a controller, replacing that of the same name.

        Raises:
            InvalidArgumentError: its period is out of range.
        """
        CONTROLLER_PERIOD.check(controller.period_s)
        self._controllers = {**self._controllers, name: controller}
        self._waits_s.pop(name, None)

    def remove(self, name: str, controller: Controller) -> None:
        """Removes a controller, unless another one of its name has replaced it."""
        if self._controllers.get(name) is controller:
            self._controllers = {key: value for key, value in self._controllers.items() if key != name}
            self._waits_s.pop(name, None)

    def update(self, engine: Engine, duration_s: float) -> float:
        """Updates the controllers that are due.

        Returns:
            The time by which the engine is to be stepped now [s], at most a duration; `elapse` has to follow.

        Raises:
            SimulationFaultError: a controller raised an exception; it was removed.
        """
        for name, controller in self._controllers.items():
            self._called = name
            try:
                if not controller.is_active:
                    self._waits_s.pop(name, None)
                    continue
                wait_s = self._waits_s.get(name, 0.0)
                if wait_s <= EARLY_S:
                    controller.update(engine, engine.time_s)
                    wait_s += CONTROLLER_PERIOD.check(controller.period_s)
            except EngineError:
                raise
            except self.caught as error:
                self.remove(name, controller)
                remedy = "it was removed; add it again when it is repaired"
                raise fault_error(f"the controller {name!r}", error, remedy=remedy) from error
            finally:
                self._called = ""
            if self._controllers.get(name) is controller:  # it has not removed itself
                self._waits_s[name] = wait_s
        return min((duration_s, *self._waits_s.values()))

    def elapse(self, duration_s: float) -> None:
        """Counts the time by which the engine was stepped [s]."""
        for name in self._waits_s:
            self._waits_s[name] -= duration_s

    def reset(self, engine: Engine) -> None:
        """Resets all controllers."""
        self._waits_s.clear()
        for name, controller in self._controllers.items():
            self._called = name
            try:
                controller.reset(engine)
            finally:
                self._called = ""

    def copy(self) -> ControllerSchedule:
        """An independent schedule with copies of the controllers."""
        copied = ControllerSchedule()
        copied._controllers = {name: each.copy() for name, each in self._controllers.items()}
        copied._waits_s = dict(self._waits_s)
        return copied


class ActuatorController(Controller, Protocol):
    """A controller that has actuators of its own."""

    def connect(self, engine: Engine, *, is_new: bool = False) -> None:
        """Adds its actuators to an engine; called in the engine thread."""


class SimulatedRobot(Protocol):
    """The part of `mindstage.robots.Robot` that a simulation uses."""

    name: str

    @property
    def controller(self) -> ActuatorController:
        """What commands its actuators."""

    @property
    def controller_name(self) -> str:
        """The name of its controller in the simulation."""

    @property
    def body_ids(self) -> frozenset[BodyId]:
        """All of its bodies."""

    @property
    def cameras(self) -> tuple[CameraMount, ...]:
        """Its cameras."""

    @property
    def exists(self) -> bool:
        """Whether its bodies are in the simulation."""

    def actuated_bodies(self) -> ActuatedBodies:
        """Its actuators as a file has them."""

    def in_copy(self, session: Any, controllers: ControllerSchedule) -> SimulatedRobot:
        """The same robot in a copy of its simulation."""


class SimulatedRobots(Mapping[str, SimulatedRobot]):
    """The robots of a simulation by name, except those whose bodies were deleted; see `mindstage.robots.robots_of`."""

    def __init__(self, controllers: ControllerSchedule, robots: Mapping[str, SimulatedRobot] | None = None) -> None:
        """Lists robots.

        Args:
            controllers: the schedule of the simulation, which has their controllers.
            robots: by name; by default none.
        """
        self._controllers = controllers
        self._robots: Mapping[str, SimulatedRobot] = robots or {}
        self._former: dict[str, SimulatedRobot] = {}

    def __getitem__(self, name: str) -> SimulatedRobot:
        robot = self._robots[name]
        if not robot.exists:
            raise KeyError(name)
        return robot

    def __iter__(self) -> Iterator[str]:
        return (name for name, robot in self._robots.items() if robot.exists)

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def keep(self, robot: SimulatedRobot) -> None:
        """Adds a robot that an edit has spawned; called in the engine thread."""
        self._former.pop(robot.name, None)
        self._controllers.add(robot.controller_name, robot.controller)
        self._robots = {**self._robots, robot.name: robot}

    def drop(self, name: str) -> None:
        """Ends a robot that an edit has deleted; called in the engine thread."""
        robot = self._robots[name]
        self._controllers.remove(robot.controller_name, robot.controller)
        self._robots = {key: each for key, each in self._robots.items() if each is not robot}
        self._former[name] = robot

    def former(self, name: str) -> SimulatedRobot | None:
        """The robot of that name that was dropped; undoing that keeps it again."""
        return self._former.get(name)

    def forget_former(self) -> None:
        """Ends that, when nothing can be undone any more."""
        self._former.clear()


def fault_error(source: str, error: BaseException, *, remedy: str) -> SimulationFaultError:
    """The error of something that raised an exception in the engine thread."""
    cause = format_exception_only(error)[-1].strip()  # unlike `str`, it does not raise what the exception raises
    return SimulationFaultError(source, cause=cause, remedy=remedy)
