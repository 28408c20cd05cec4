"""Robots: their models, controllers, motion planning and skills."""

from mindstage.robots.robot_model import RobotModel

__all__ = ["RobotModel"]
