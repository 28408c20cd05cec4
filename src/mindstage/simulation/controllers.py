"""Controllers: functions that command the actuators of an engine while simulated time advances.

They are called in the engine thread at fixed periods of simulated time, whether the simulation plays or is stepped, and
are copied with it. While none is active, stepping costs the same as without controllers.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Protocol, TypeVar

from mindstage.engines.base import Engine
from mindstage.errors import RobotNotFoundError

__all__ = ["Controller", "ControllerSchedule", "find_robot"]

R = TypeVar("R")

_EARLY_S = 1e-9
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

    def __init__(self) -> None:
        self._controllers: Mapping[str, Controller] = {}
        self._waits_s: dict[str, float] = {}
        """The simulated time until the next update of each active controller [s]."""

    @property
    def controllers(self) -> Mapping[str, Controller]:
        """The controllers by name."""
        return self._controllers

    def add(self, name: str, controller: Controller) -> None:
        """Adds a controller, replacing that of the same name."""
        self._controllers = {**self._controllers, name: controller}
        self._waits_s.pop(name, None)

    def remove(self, name: str, controller: Controller) -> None:
        """Removes a controller, unless another one of its name has replaced it."""
        if self._controllers.get(name) is controller:
            self._controllers = {key: value for key, value in self._controllers.items() if key != name}
            self._waits_s.pop(name, None)

    def parts(self, engine: Engine, duration_s: float) -> Iterator[float]:
        """Updates the controllers that are due, and yields the times by which the caller has to step the engine [s]."""
        left_s = duration_s
        while left_s > 0.0:
            active = [(name, each) for name, each in self._controllers.items() if each.is_active]
            if not active:
                self._waits_s.clear()
                yield left_s
                return
            waits_s = {name: self._waits_s.get(name, 0.0) for name, _ in active}
            for name, controller in active:
                if waits_s[name] <= _EARLY_S:
                    controller.update(engine, engine.time_s)
                    waits_s[name] += controller.period_s
            part_s = min(left_s, *waits_s.values())
            yield part_s
            self._waits_s = {name: wait_s - part_s for name, wait_s in waits_s.items()}
            left_s -= part_s
            if left_s < _EARLY_S:
                return

    def reset(self, engine: Engine) -> None:
        """Resets all controllers."""
        self._waits_s.clear()
        for controller in self._controllers.values():
            controller.reset(engine)

    def copy(self) -> ControllerSchedule:
        """An independent schedule with copies of the controllers."""
        copied = ControllerSchedule()
        copied._controllers = {name: each.copy() for name, each in self._controllers.items()}
        copied._waits_s = dict(self._waits_s)
        return copied


def find_robot(robots: Mapping[str, R], name: str) -> R:
    """The robot of a name; without a name the only one.

    Raises:
        RobotNotFoundError: there is no robot of that name, or not exactly one and no name is given.
    """
    if not name and len(robots) == 1:
        return next(iter(robots.values()))
    if name not in robots:
        known = f"there is {', '.join(robots)}" if robots else "add one with `add_robot`"
        raise RobotNotFoundError(name, remedy=known if name or not robots else f"give a name: {known}")
    return robots[name]
