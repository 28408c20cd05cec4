"""URDF and xacro: safe parsing of robot descriptions, and their conversion to worlds and maps.

A robot description is converted to a map in the vocabulary of dialect 1, so that queries, engines and writers
treat it as any other map. XML elements without an equivalent are kept as text facts of their link or joint.
"""

from mindstage.knowledge.urdf.in_maps import ClassNameIndex
from mindstage.knowledge.urdf.model import UrdfRobot
from mindstage.knowledge.urdf.parse import is_urdf, read_urdf
from mindstage.knowledge.urdf.to_world import UrdfWorld, urdf_to_world

__all__ = ["ClassNameIndex", "UrdfRobot", "UrdfWorld", "is_urdf", "read_urdf", "urdf_to_world"]
