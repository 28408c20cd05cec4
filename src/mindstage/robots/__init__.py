"""Robots: their models, controllers, motion planning and skills.

A module is imported when one of its names is first used: reading the state of a robot needs no motion planning.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Protocol, cast

from mindstage.errors import RobotNotFoundError
from mindstage.lazy_names import lazy_names

if TYPE_CHECKING:
    from mindstage.robots.base_placement import BasePlacement, find_base_placements
    from mindstage.robots.edits import AddRobot, RemoveRobot, add_robot
    from mindstage.robots.models.robot_model import RobotModel
    from mindstage.robots.navigation import plan_base
    from mindstage.robots.planning import plan_arm, plan_path
    from mindstage.robots.robot import JointState, Odometry, Robot
    from mindstage.robots.robot_kinematics import IkResult, RobotKinematics
    from mindstage.robots.self_models import add_self_model, read_self_model
    from mindstage.robots.standing import add_standing_robot
    from mindstage.robots.trajectories import JointTrajectory, TrajectoryPoint

__all__ = [
    "AddRobot",
    "BasePlacement",
    "HasRobots",
    "IkResult",
    "JointState",
    "JointTrajectory",
    "Odometry",
    "RemoveRobot",
    "Robot",
    "RobotKinematics",
    "RobotModel",
    "TrajectoryPoint",
    "add_robot",
    "add_self_model",
    "add_standing_robot",
    "find_base_placements",
    "find_robot",
    "plan_arm",
    "plan_base",
    "plan_path",
    "read_self_model",
    "robots_of",
]

_NAMES_BY_MODULE = {
    "base_placement": ("BasePlacement", "find_base_placements"),
    "edits": ("AddRobot", "RemoveRobot", "add_robot"),
    "robot_kinematics": ("IkResult", "RobotKinematics"),
    "models.robot_model": ("RobotModel",),
    "navigation": ("plan_base",),
    "planning": ("plan_arm", "plan_path"),
    "robot": ("JointState", "Odometry", "Robot"),
    "self_models": ("add_self_model", "read_self_model"),
    "standing": ("add_standing_robot",),
    "trajectories": ("JointTrajectory", "TrajectoryPoint"),
}

__getattr__, __dir__ = lazy_names(
    __name__,
    {name: f"{__name__}.{module}" for module, names in _NAMES_BY_MODULE.items() for name in names},
    packages=["models"],
)


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
