"""Robots' descriptions (URDF and xacro): read safely, and told as worlds and maps.

A description becomes a map in the words of dialect 1 before anything else reads it, so questions, engines and writers
treat it as any other map. What has no field stays with its link or joint as the text that told it.
"""

from mindstage.knowledge.robots.class_names import ClassNameIndex
from mindstage.knowledge.robots.reading import is_urdf, read_urdf
from mindstage.knowledge.robots.robot import UrdfRobot
from mindstage.knowledge.robots.world import UrdfWorld, urdf_to_world

__all__ = ["ClassNameIndex", "UrdfRobot", "UrdfWorld", "is_urdf", "read_urdf", "urdf_to_world"]
