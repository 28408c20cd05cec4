"""URDF and xacro: safe parsing of robot descriptions, and their conversion to worlds and maps.

A robot description is converted to a map in the vocabulary of dialect 1, so that queries, engines and writers
treat it as any other map. XML elements without an equivalent are kept as text facts of their link or joint.
"""

from typing import TYPE_CHECKING

from mindstage.lazy_names import lazy_names

if TYPE_CHECKING:
    from mindstage.maps.urdf.in_maps import ClassNameIndex, is_urdf
    from mindstage.maps.urdf.parse import read_urdf
    from mindstage.maps.urdf.to_world import UrdfWorld, urdf_to_world
    from mindstage.maps.urdf.urdf_model import UrdfRobot

__all__ = ["ClassNameIndex", "UrdfRobot", "UrdfWorld", "is_urdf", "read_urdf", "urdf_to_world"]

_MODULES = ("in_maps", "urdf_model", "parse", "to_world")

__getattr__, __dir__ = lazy_names(__name__, [f"{__name__}.{each}" for each in _MODULES])
