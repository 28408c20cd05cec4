"""Robots' descriptions (URDF and xacro): read safely, and told as worlds and maps.

A description becomes a map in the words of dialect 1 before anything else reads it, so questions, engines and writers
treat it as any other map. What has no field stays with its link or joint as the text that told it.
"""

from mindstage.knowledge.robots.class_names import ClassNames
from mindstage.knowledge.robots.reading import looks_like_robot, read_robot
from mindstage.knowledge.robots.robot import Robot
from mindstage.knowledge.robots.world import RobotWorld, robot_world

__all__ = ["ClassNames", "Robot", "RobotWorld", "looks_like_robot", "read_robot", "robot_world"]
