"""Robots: their models, controllers, motion planning and skills.

A module is imported when one of its names is first used: reading the state of a robot needs no motion planning.
"""

from typing import TYPE_CHECKING

from mindstage.lazy_names import lazy_names

if TYPE_CHECKING:
    from mindstage.robots.base_placement import BasePlacement, find_base_poses
    from mindstage.robots.gym import play_skill, success_rate
    from mindstage.robots.kinematics import IkResult, RobotKinematics
    from mindstage.robots.model import RobotModel
    from mindstage.robots.navigation import plan_base
    from mindstage.robots.planning import plan_arm, plan_line, plan_path
    from mindstage.robots.robot import Robot
    from mindstage.robots.self_models import add_self_model, read_self_model
    from mindstage.robots.trajectories import JointTrajectory, TrajectoryPoint

__all__ = [
    "BasePlacement",
    "IkResult",
    "JointTrajectory",
    "Robot",
    "RobotKinematics",
    "RobotModel",
    "TrajectoryPoint",
    "add_self_model",
    "find_base_poses",
    "plan_arm",
    "plan_base",
    "plan_line",
    "plan_path",
    "play_skill",
    "read_self_model",
    "success_rate",
]

_NAMES_BY_MODULE = {
    "base_placement": ("BasePlacement", "find_base_poses"),
    "gym": ("play_skill", "success_rate"),
    "kinematics": ("IkResult", "RobotKinematics"),
    "model": ("RobotModel",),
    "navigation": ("plan_base",),
    "planning": ("plan_arm", "plan_line", "plan_path"),
    "robot": ("Robot",),
    "self_models": ("add_self_model", "read_self_model"),
    "trajectories": ("JointTrajectory", "TrajectoryPoint"),
}

__getattr__, __dir__ = lazy_names(
    __name__,
    {name: f"{__name__}.{module}" for module, names in _NAMES_BY_MODULE.items() for name in names},
    packages=["models", "skills"],
)
