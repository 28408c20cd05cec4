"""Robots: their models, controllers, motion planning and skills."""

from mindstage.robots.model import RobotModel

__all__ = ["RobotModel"]
