"""Robots: their models, controllers, motion planning and skills."""

from collections.abc import Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Protocol, cast

from mindstage.errors import RobotNotFoundError

if TYPE_CHECKING:
    from mindstage.robots.models.model import RobotModel
    from mindstage.robots.robot import JointState, Odometry, Robot, add_robot

__all__ = [
    "HasRobots",
    "JointState",
    "Odometry",
    "Robot",
    "RobotModel",
    "add_robot",
    "find_robot",
    "robots_of",
]


class HasRobots(Protocol):
    """A simulation, or a copy of one."""

    @property
    def robots(self) -> Mapping[str, object]:
        """The robots by name, except those whose bodies were deleted."""


def robots_of(simulation: HasRobots) -> "Mapping[str, Robot]":
    """The robots of a simulation by name, except those whose bodies were deleted."""
    return cast("Mapping[str, Robot]", simulation.robots)


def find_robot(simulation: HasRobots, name: str = "") -> "Robot":
    """A robot of a simulation; without a name the only one.

    Raises:
        RobotNotFoundError: there is no robot of that name, or not exactly one and no name is given.
    """
    robots = robots_of(simulation)
    if not name and len(robots) == 1:
        return next(iter(robots.values()))
    if name not in robots:
        known = f"there is {', '.join(robots)}" if robots else "add one with `add_robot`"
        raise RobotNotFoundError(name, remedy=known if name or not robots else f"give a name: {known}")
    return robots[name]


def __getattr__(name: str) -> object:
    if name == "RobotModel":
        return import_module("mindstage.robots.models.model").RobotModel
    if name in __all__:
        return getattr(import_module("mindstage.robots.robot"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
