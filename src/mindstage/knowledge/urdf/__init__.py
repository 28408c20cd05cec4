"""Robots' descriptions (URDF and xacro): read safely, and told as worlds and maps.

A description becomes a map in the words of dialect 1 before anything else reads it, so questions, engines and writers
treat it as any other map. What has no field stays with its link or joint as the text that told it.
"""

from mindstage.knowledge.urdf.in_maps import ClassNameIndex
from mindstage.knowledge.urdf.model import UrdfRobot
from mindstage.knowledge.urdf.parse import is_urdf, read_urdf
from mindstage.knowledge.urdf.to_world import UrdfWorld, urdf_to_world

__all__ = ["ClassNameIndex", "UrdfRobot", "UrdfWorld", "is_urdf", "read_urdf", "urdf_to_world"]
